/* Calls every FMI 3.0 function in a long random order, with good and bad arguments: for the sanitizers to watch. */
#include "fmi3Functions.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static unsigned seed = 1;
static unsigned pick(unsigned n) { return (seed = seed * 1103515245u + 12345u) / 65536u % n; }

static void logger(fmi3InstanceEnvironment e, fmi3Status status, fmi3String category, fmi3String message)
{
    (void)status;
    *(size_t *)e += strlen(category) + strlen(message);
}

static double real(void)
{
    const double values[] = {0.0, 1.0, -1.0, 0.3, 49.0, 1e300, NAN, INFINITY};
    return values[pick(8)];
}

static void absent(fmi3Instance c, const fmi3ValueReference *vr, size_t n)
{
    fmi3GetFloat32(c, vr, n, NULL, n), fmi3SetFloat32(c, vr, n, NULL, n), fmi3GetInt8(c, vr, n, NULL, n), fmi3SetInt8(c, vr, n, NULL, n);
    fmi3GetUInt8(c, vr, n, NULL, n), fmi3SetUInt8(c, vr, n, NULL, n), fmi3GetInt16(c, vr, n, NULL, n), fmi3SetInt16(c, vr, n, NULL, n);
    fmi3GetUInt16(c, vr, n, NULL, n), fmi3SetUInt16(c, vr, n, NULL, n), fmi3GetUInt32(c, vr, n, NULL, n), fmi3SetUInt32(c, vr, n, NULL, n);
    fmi3GetUInt64(c, vr, n, NULL, n), fmi3SetUInt64(c, vr, n, NULL, n), fmi3GetString(c, vr, n, NULL, n), fmi3SetString(c, vr, n, NULL, n);
    fmi3GetBinary(c, vr, n, NULL, NULL, n), fmi3SetBinary(c, vr, n, NULL, NULL, n), fmi3GetClock(c, vr, n, NULL), fmi3SetClock(c, vr, n, NULL);
    fmi3GetIntervalDecimal(c, vr, n, NULL, NULL), fmi3GetIntervalFraction(c, vr, n, NULL, NULL, NULL), fmi3GetShiftDecimal(c, vr, n, NULL);
    fmi3GetShiftFraction(c, vr, n, NULL, NULL), fmi3SetIntervalDecimal(c, vr, n, NULL), fmi3SetIntervalFraction(c, vr, n, NULL, NULL);
    fmi3SetShiftDecimal(c, vr, n, NULL), fmi3SetShiftFraction(c, vr, n, NULL, NULL), fmi3GetOutputDerivatives(c, vr, n, NULL, NULL, n);
}

static void one_call(fmi3Instance c, fmi3FMUState *state, double *time)
{
    fmi3ValueReference vr[3] = {pick(19), pick(19), pick(19)}, known[2] = {pick(19), 8};
    fmi3Float64 r[3] = {real(), real(), real()}, out[3], last;
    fmi3Int32 i[3] = {(int)pick(4), 1, 2};
    fmi3Int64 l[3] = {pick(4), 1, 2};
    fmi3Boolean b[3] = {pick(2), 0, 1}, f[5];
    const size_t n = pick(4);
    size_t size = 0;
    fmi3Byte *bytes;
    switch (pick(40)) {
    case 0: fmi3SetDebugLogging(c, pick(2), 0, NULL); break;
    case 1: case 2: if (fmi3EnterInitializationMode(c, 0, 0.0, 0.0, pick(2), 10.0) == fmi3OK) *time = 0.0; break;
    case 3: fmi3ExitInitializationMode(c); break;
    case 4: if (pick(4) == 0) fmi3Terminate(c); break;
    case 5: if (pick(4) == 0) fmi3Reset(c); break;
    case 6: fmi3GetFloat64(c, vr, n, n ? out : NULL, n); break;
    case 7: fmi3GetInt32(c, vr, n, i, n); break;
    case 8: fmi3GetInt64(c, vr, 1, l, 1); break;
    case 9: fmi3GetBoolean(c, n ? vr : NULL, 1, b, 1); break;
    case 10: fmi3SetFloat64(c, vr, n, r, n); break;
    case 11: fmi3SetInt32(c, vr, n, i, n); break;
    case 12: fmi3SetInt64(c, vr, 1, l, 1); break;
    case 13: fmi3SetBoolean(c, vr, 1, b, 1); break;
    case 14: case 15: fmi3GetFMUState(c, state); break;
    case 16: case 17: case 18: fmi3SetFMUState(c, *state); break;
    case 19: fmi3FreeFMUState(c, state); break;
    case 20:
        if (fmi3SerializedFMUStateSize(c, *state, &size) != fmi3OK) break;
        bytes = malloc(size);
        fmi3SerializeFMUState(c, *state, bytes, size);
        if (pick(2)) bytes[pick((unsigned)size)] ^= (fmi3Byte)(1 << pick(8));
        fmi3DeserializeFMUState(c, bytes, pick(3) ? size : pick((unsigned)size), state);
        free(bytes);
        break;
    case 21: fmi3GetDirectionalDerivative(c, vr, n, known, 2, r, 2, out, n); break;
    case 22: fmi3GetAdjointDerivative(c, vr, n, known, 2, r, n, out, 2); break;
    case 23: fmi3EnterEventMode(c); break;
    case 24: case 25: fmi3UpdateDiscreteStates(c, &f[0], &f[1], &f[2], &f[3], &f[4], pick(9) ? &last : NULL); break;
    case 26: case 27: fmi3EnterContinuousTimeMode(c); break;
    case 28: fmi3CompletedIntegratorStep(c, 1, &f[0], &f[1]); break;
    case 29: fmi3SetTime(c, real()); break;
    case 30: fmi3SetContinuousStates(c, r, pick(4)); break;
    case 31: fmi3GetContinuousStateDerivatives(c, out, pick(4)); break;
    case 32: fmi3GetEventIndicators(c, out, pick(3)); break;
    case 33: fmi3GetContinuousStates(c, pick(5) ? out : NULL, 2); break;
    case 34: fmi3GetNominalsOfContinuousStates(c, out, 2); break;
    case 35: fmi3GetNumberOfEventIndicators(c, &size); fmi3GetNumberOfContinuousStates(c, pick(3) ? &size : NULL); break;
    case 36: absent(c, vr, pick(2)); break;
    case 37: case 38: if (fmi3DoStep(c, *time, 0.05, 1, &f[0], &f[1], &f[2], pick(9) ? &last : NULL) == fmi3OK) *time += 0.05; break;
    default:
        if (pick(3)) break;
        fmi3EnterConfigurationMode(c), fmi3ExitConfigurationMode(c), fmi3EnterStepMode(c), fmi3EvaluateDiscreteStates(c);
        fmi3GetNumberOfVariableDependencies(c, 0, &size), fmi3GetVariableDependencies(c, 0, NULL, NULL, NULL, NULL, 0);
        fmi3ActivateModelPartition(c, 0, 0.0);
    }
}

int main(void)
{
    size_t said = 0, calls = 0;
    fmi3InstantiateModelExchange("it", "wrong", "", 0, 1, &said, logger);
    fmi3InstantiateModelExchange("", "{token}", NULL, 0, 0, &said, NULL);
    fmi3InstantiateCoSimulation("it", "{token}", NULL, 0, 1, 1, 0, NULL, 0, &said, logger, NULL);
    fmi3InstantiateScheduledExecution("it", "{token}", NULL, 0, 1, &said, logger, NULL, NULL, NULL);
    for (int run = 0; run < 3000; run++) {
        double time = 0.0;
        fmi3FMUState state = NULL;
        fmi3Instance c = pick(2) ? fmi3InstantiateModelExchange("it", "{token}", NULL, 0, pick(2), &said, logger)
                                 : fmi3InstantiateCoSimulation("it", "{token}", NULL, 0, pick(2), 0, 0, NULL, 0, &said, logger, NULL);
        if (pick(4)) { /* a good start, most of the time */
            fmi3EnterInitializationMode(c, 0, 0.0, 0.0, 0, 0.0);
            if (pick(4)) fmi3ExitInitializationMode(c);
            fmi3GetFMUState(c, &state);
        }
        for (int k = 0; k < 60; k++, calls++)
            one_call(c, &state, &time);
        fmi3FreeFMUState(c, &state);
        fmi3FreeInstance(c);
    }
    printf("%lu calls, %lu characters said\n", (unsigned long)calls, (unsigned long)said);
    return 0;
}
