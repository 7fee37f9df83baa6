/* Calls of an FMI 2.0 FMU in any order, legal and illegal, with sound and unsound arguments; built with its sources and the sanitizers.
 *
 * calls SEED COUNT TOKEN -> one line of counts by status. */
#include "core.h"
#include "fmi2Functions.h"
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static uint64_t state;

static uint64_t draw(uint64_t n) { /* xorshift64*, 0 .. n - 1 */
    state ^= state >> 12, state ^= state << 25, state ^= state >> 27;
    return (state * UINT64_C(2685821657736338717) >> 16) % n;
}

static double number(void) {
    static const double odd[] = {0, -0.0, 1, -1, 1e-3, 1e300, -1e300, NAN, INFINITY, -INFINITY, 5e-324};
    if (draw(10) == 0) return odd[draw(sizeof odd / sizeof odd[0])];
    return ((double)draw(2000001) - 1e6) * (draw(2) ? 1e-6 : 5e-6);
}

static void quiet(fmi2ComponentEnvironment e, fmi2String name, fmi2Status status, fmi2String category, fmi2String message, ...) {
    (void)e, (void)name, (void)status, (void)category, (void)message;
}

enum { MOST = 64, ANY = -1 };

/* Up to four variables, mostly of one type and, to be set, settable; now and then any, or one that does not exist. */
static unsigned references(fmi2ValueReference *vr, int type, int to_set) {
    const unsigned n = (unsigned)draw(5);
    for (unsigned i = 0; i < n; i++) {
        for (int k = 0; k < 400; k++) {
            vr[i] = (fmi2ValueReference)draw(model_n_variables);
            const ModelVariable *v = &model_variables[vr[i]];
            const int fits = type == ANY || v->type == type || (type == VT_INTEGER && v->type == VT_ENUMERATION);
            if (fits && (!to_set || v->settable == SET_ALWAYS || (v->settable == SET_BEFORE_START && draw(30) == 0))) break;
        }
        if (draw(200) == 0) vr[i] = (fmi2ValueReference)draw(draw(2) ? model_n_variables : UINT32_MAX);
    }
    return n;
}

/* Mostly within the variable's bounds. */
static double value_for(fmi2ValueReference vr) {
    if (vr >= model_n_variables || draw(60) == 0) return number();
    const ModelVariable *v = &model_variables[vr];
    const double low = v->min > -1e3 ? v->min : -1.0, high = v->max < 1e3 ? v->max : low + 2.0;
    const double share = (double)draw(1000001) * 1e-6;
    return v->type == VT_REAL ? low + (high - low) * share * share : v->type == VT_BOOLEAN ? (double)draw(2) : floor(low + (high - low + 1) * share);
}

static size_t length(size_t right) { return draw(60) ? right : draw(MOST); }

enum { ME_FIRST = 18, ME_LAST = 27, N_CALLS = 34 }; /* calls of model exchange alone; from 30 on: doStep */

/* A call, mostly one of the instance's kind. */
static int choose(fmi2Type kind) {
    for (;;) {
        const int call = (int)draw(N_CALLS);
        const int exchange = call >= ME_FIRST && call <= ME_LAST, stepping = call >= 29;
        if (draw(40) == 0 || !(kind == fmi2CoSimulation ? exchange : stepping)) return call;
    }
}

/* One call chosen at random; `time` is where a well-behaved master would stand. */
static fmi2Status one_call(fmi2Component c, fmi2Type kind, double *time, fmi2FMUstate *saved) {
    fmi2ValueReference vr[MOST], known[MOST];
    fmi2Real real[MOST], seed[MOST];
    fmi2Integer integer[MOST];
    fmi2String text[MOST] = {0};
    for (unsigned i = 0; i < MOST; i++) real[i] = number(), seed[i] = number(), integer[i] = (fmi2Integer)draw(5) - 1;
    fmi2Status status = fmi2OK;
    size_t size = 0;
    unsigned n;
    switch (choose(kind)) {
    case 0: return draw(10) ? fmi2OK : fmi2SetupExperiment(c, (fmi2Boolean)draw(2), number(), draw(3) ? 0 : number(), (fmi2Boolean)(draw(4) == 0), number());
    case 1: return draw(10) ? fmi2OK : fmi2EnterInitializationMode(c);
    case 2: return draw(3) ? fmi2OK : fmi2ExitInitializationMode(c);
    case 3: return draw(40) ? fmi2OK : fmi2Terminate(c);
    case 4:
        if (draw(20)) return fmi2OK;
        *time = 0;
        return fmi2Reset(c);
    case 5: n = references(vr, VT_REAL, 0); return fmi2GetReal(c, vr, n, real);
    case 6: n = references(vr, VT_INTEGER, 0); return fmi2GetInteger(c, vr, n, integer);
    case 7: n = references(vr, VT_BOOLEAN, 0); return fmi2GetBoolean(c, vr, n, integer);
    case 8: return fmi2GetString(c, vr, draw(20) == 0, text);
    case 9:
        n = references(vr, VT_REAL, 1);
        for (unsigned i = 0; i < n; i++) real[i] = value_for(vr[i]);
        return fmi2SetReal(c, vr, n, real);
    case 10:
        n = references(vr, VT_INTEGER, 1);
        for (unsigned i = 0; i < n; i++) integer[i] = (fmi2Integer)fmax(-9, fmin(9, value_for(vr[i]))) /* no cast out of range */;
        return fmi2SetInteger(c, vr, n, integer);
    case 11:
        n = references(vr, VT_BOOLEAN, 1);
        for (unsigned i = 0; i < n; i++) integer[i] = (fmi2Integer)fmax(-9, fmin(9, value_for(vr[i]))) /* no cast out of range */;
        return fmi2SetBoolean(c, vr, n, integer);
    case 12: return fmi2SetString(c, vr, draw(20) == 0, text);
    case 13: return fmi2GetFMUstate(c, saved);
    case 14: return *saved || draw(20) == 0 ? fmi2SetFMUstate(c, *saved) : fmi2OK;
    case 15: return draw(4) ? fmi2OK : fmi2FreeFMUstate(c, saved);
    case 16:
        if (!*saved && draw(20)) return fmi2OK;
        status = fmi2SerializedFMUstateSize(c, *saved, &size);
        if (status == fmi2OK && size > 0) {
            fmi2Byte *bytes = malloc(size);
            status = fmi2SerializeFMUstate(c, *saved, bytes, size);
            if (draw(10) == 0) bytes[draw(size)] ^= (fmi2Byte)draw(256); /* damaged, perhaps */
            fmi2FMUstate other = NULL;
            status = fmi2DeSerializeFMUstate(c, bytes, draw(20) ? size : draw(size), &other);
            if (status == fmi2OK && draw(2)) status = fmi2SetFMUstate(c, other);
            if (other) fmi2FreeFMUstate(c, &other);
            free(bytes);
        }
        return status;
    case 17:
        n = references(vr, VT_REAL, 0);
        for (unsigned i = 0; i < n; i++) {
            if (draw(10)) vr[i] = model_derivative_references[draw(model_n_states)];
            known[i] = draw(10) ? model_state_references[draw(model_n_states)] : (fmi2ValueReference)draw(model_n_variables);
        }
        return fmi2GetDirectionalDerivative(c, vr, n, known, n, seed, real);
    case 18: return fmi2EnterEventMode(c);
    case 19: {
        fmi2EventInfo info;
        return fmi2NewDiscreteStates(c, &info);
    }
    case 20: return fmi2EnterContinuousTimeMode(c);
    case 21: {
        fmi2Boolean enter, terminate;
        return fmi2CompletedIntegratorStep(c, (fmi2Boolean)draw(2), &enter, &terminate);
    }
    case 22: return fmi2SetTime(c, draw(40) ? (*time += 1e-4) : number());
    case 23: 
        if (draw(10) && fmi2GetContinuousStates(c, real, model_n_states) == fmi2OK) real[draw(model_n_states)] += 1e-4;
        return fmi2SetContinuousStates(c, real, length(model_n_states));
    case 24: return fmi2GetDerivatives(c, real, length(model_n_states));
    case 25: return fmi2GetEventIndicators(c, real, length(model_n_indicators));
    case 26: return fmi2GetContinuousStates(c, real, length(model_n_states));
    case 27: return fmi2GetNominalsOfContinuousStates(c, real, length(model_n_states));
    case 28: return fmi2SetDebugLogging(c, (fmi2Boolean)draw(2), 0, NULL);
    case 29: return fmi2GetRealOutputDerivatives(c, vr, draw(20) == 0, integer, real);
    default: {
        const double step = draw(30) ? 1e-3 * (double)(1 + draw(3)) : number();
        status = fmi2DoStep(c, draw(60) ? *time : number(), step, fmi2True);
        if (status <= fmi2Warning) *time += step;
        return status;
    }
    }
}

int main(int argc, char **argv) {
    if (argc != 4) return 2;
    state = strtoull(argv[1], NULL, 10) * 2654435769u + 1;
    const uint64_t total = strtoull(argv[2], NULL, 10);
    if (model_n_states > MOST || model_n_indicators > MOST) return 3;
    const fmi2CallbackFunctions functions = {quiet, calloc, free, NULL, NULL};
    uint64_t by_status[6] = {0}, instances = 0, calls = 0;
    while (calls < total) {
        const fmi2Type kind = draw(2) ? fmi2CoSimulation : fmi2ModelExchange;
        fmi2Component c = fmi2Instantiate("fuzz", kind, argv[3], NULL, &functions, fmi2False, fmi2False);
        if (!c) return 4;
        instances++;
        double time = 0;
        fmi2FMUstate saved = NULL;
        if (draw(8)) { /* mostly as a master begins, so that the rest does not end in the first error */
            fmi2SetupExperiment(c, fmi2False, 0, 0, fmi2False, 0);
            fmi2EnterInitializationMode(c);
            if (draw(8)) fmi2ExitInitializationMode(c);
            if (kind == fmi2ModelExchange && draw(2)) fmi2EnterContinuousTimeMode(c);
        }
        for (unsigned k = 0, n = 1 + (unsigned)draw(400), errors = 0; k < n && calls < total && errors < 5; k++, calls++) {
            const fmi2Status status = one_call(c, kind, &time, &saved);
            by_status[status]++;
            if (status == fmi2Error) { /* the instance takes little more: back to a fresh one, most times */
                errors++;
                if (draw(3)) {
                    fmi2Reset(c);
                    time = 0;
                    fmi2SetupExperiment(c, fmi2False, 0, 0, fmi2False, 0);
                    fmi2EnterInitializationMode(c);
                    fmi2ExitInitializationMode(c);
                }
            }
        }
        if (saved) fmi2FreeFMUstate(c, &saved);
        fmi2FreeInstance(c);
    }
    printf("{\"calls\": %llu, \"instances\": %llu, \"ok\": %llu, \"warning\": %llu, \"discard\": %llu, \"error\": %llu, \"fatal\": %llu}\n",
           (unsigned long long)calls, (unsigned long long)instances, (unsigned long long)by_status[0], (unsigned long long)by_status[1],
           (unsigned long long)by_status[2], (unsigned long long)by_status[3], (unsigned long long)by_status[4]);
    return 0;
}
