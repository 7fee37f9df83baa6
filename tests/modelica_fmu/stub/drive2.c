/* Calls every FMI 2.0 function in a long random order, with good and bad arguments: for the sanitizers to watch. */
#include "fmi2Functions.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static unsigned seed = 1;
static unsigned pick(unsigned n) { return (seed = seed * 1103515245u + 12345u) / 65536u % n; }

static void logger(fmi2ComponentEnvironment e, fmi2String name, fmi2Status status, fmi2String category, fmi2String message, ...)
{
    (void)status;
    *(size_t *)e += strlen(name) + strlen(category) + strlen(message);
}

static double real(void)
{
    const double values[] = {0.0, 1.0, -1.0, 0.3, 49.0, 1e300, NAN, INFINITY};
    return values[pick(8)];
}

static void one_call(fmi2Component c, fmi2FMUstate *state, double *time)
{
    fmi2ValueReference vr[3] = {pick(19), pick(19), pick(19)}, known[2] = {pick(19), 8};
    fmi2Real r[3] = {real(), real(), real()}, out[3];
    fmi2Integer i[3] = {(int)pick(4), 1, 2};
    fmi2Status status;
    fmi2Boolean b;
    fmi2String s;
    fmi2EventInfo info;
    const size_t n = pick(4);
    size_t size = 0;
    char *bytes;
    switch (pick(40)) {
    case 0: fmi2SetDebugLogging(c, (int)pick(2), 0, NULL); break;
    case 1: fmi2SetupExperiment(c, 0, 0.0, 0.0, (int)pick(2), 10.0); *time = 0.0; break;
    case 2: fmi2EnterInitializationMode(c); break;
    case 3: fmi2ExitInitializationMode(c); break;
    case 4: if (pick(4) == 0) fmi2Terminate(c); break;
    case 5: if (pick(4) == 0) fmi2Reset(c); break;
    case 6: fmi2GetReal(c, vr, n, n ? out : NULL); break;
    case 7: fmi2GetInteger(c, vr, n, i); break;
    case 8: fmi2GetBoolean(c, n ? vr : NULL, 1, i); break;
    case 9: fmi2GetString(c, vr, n, &s); break;
    case 10: fmi2SetReal(c, vr, n, r); break;
    case 11: fmi2SetInteger(c, vr, n, i); break;
    case 12: fmi2SetBoolean(c, vr, 1, i); break;
    case 13: fmi2SetString(c, vr, n, NULL); break;
    case 14: case 15: fmi2GetFMUstate(c, state); break;
    case 16: case 17: case 18: fmi2SetFMUstate(c, *state); break;
    case 19: fmi2FreeFMUstate(c, state); break;
    case 20:
        if (fmi2SerializedFMUstateSize(c, *state, &size) != fmi2OK) break;
        bytes = malloc(size);
        fmi2SerializeFMUstate(c, *state, bytes, size);
        if (pick(2)) bytes[pick((unsigned)size)] ^= (char)(1 << pick(7));
        fmi2DeSerializeFMUstate(c, bytes, pick(3) ? size : pick((unsigned)size), state);
        free(bytes);
        break;
    case 21: fmi2GetDirectionalDerivative(c, vr, n, known, pick(3), r, out); break;
    case 22: fmi2EnterEventMode(c); break;
    case 23: case 24: fmi2NewDiscreteStates(c, pick(9) ? &info : NULL); break;
    case 25: case 26: fmi2EnterContinuousTimeMode(c); break;
    case 27: fmi2CompletedIntegratorStep(c, 1, &b, pick(9) ? &b : NULL); break;
    case 28: fmi2SetTime(c, real()); break;
    case 29: fmi2SetContinuousStates(c, r, pick(4)); break;
    case 30: fmi2GetDerivatives(c, out, pick(4)); break;
    case 31: fmi2GetEventIndicators(c, out, pick(3)); break;
    case 32: fmi2GetContinuousStates(c, pick(5) ? out : NULL, 2); break;
    case 33: fmi2GetNominalsOfContinuousStates(c, out, 2); break;
    case 34: fmi2SetRealInputDerivatives(c, vr, pick(2), i, r); fmi2GetRealOutputDerivatives(c, vr, pick(2), i, out); break;
    case 35: case 36: case 37: if (fmi2DoStep(c, *time, 0.05, 1) == fmi2OK) *time += 0.05; break;
    case 38: fmi2CancelStep(c); break;
    default:
        fmi2GetStatus(c, (fmi2StatusKind)pick(4), &status);
        fmi2GetRealStatus(c, (fmi2StatusKind)pick(4), &out[0]);
        fmi2GetIntegerStatus(c, (fmi2StatusKind)pick(4), pick(3) ? i : NULL);
        fmi2GetBooleanStatus(c, (fmi2StatusKind)pick(4), &b);
        fmi2GetStringStatus(c, (fmi2StatusKind)pick(4), &s);
    }
}

int main(void)
{
    size_t said = 0, calls = 0;
    fmi2CallbackFunctions functions = {logger, NULL, NULL, NULL, &said};
    fmi2Instantiate("it", fmi2CoSimulation, "wrong", "", &functions, 0, 1);
    fmi2Instantiate("it", fmi2CoSimulation, NULL, NULL, NULL, 0, 1);
    for (int run = 0; run < 3000; run++) {
        double time = 0.0;
        fmi2FMUstate state = NULL;
        fmi2Component c = fmi2Instantiate("it", pick(2) ? fmi2CoSimulation : fmi2ModelExchange, "{token}", "", &functions, 0, (int)pick(2));
        if (pick(4)) { /* a good start, most of the time */
            fmi2SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0);
            fmi2EnterInitializationMode(c);
            if (pick(4)) fmi2ExitInitializationMode(c);
            fmi2GetFMUstate(c, &state);
        }
        for (int k = 0; k < 60; k++, calls++)
            one_call(c, &state, &time);
        fmi2FreeFMUstate(c, &state);
        fmi2FreeInstance(c);
    }
    printf("%lu calls, %lu characters said\n", (unsigned long)calls, (unsigned long)said);
    return 0;
}
