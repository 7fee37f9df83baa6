/* FMI 3.0: model exchange and co-simulation in one binary; no Clocks, no arrays, no event mode in co-simulation. Value references past
 * the model's variables name the event indicators, which FMI 3.0 wants as variables.
 */
#include "fmi3Functions.h"
#include "wrapper.h"

#include <math.h>
#include <stdlib.h>

typedef struct {
    Wrapper w; /* first: a Component is a Wrapper */
    fmi3LogMessageCallback logger;
    fmi3InstanceEnvironment environment;
} Component;

/* ---- table of legal calls: FMI 3.0, sections 2.3 (common), 3.2 (model exchange) and 4.2 (co-simulation) ---- */

enum {
    F_SET_DEBUG_LOGGING, F_ENTER_INITIALIZATION, F_EXIT_INITIALIZATION, F_ENTER_EVENT, F_TERMINATE, F_RESET,
    F_GET_FLOAT32, F_GET_FLOAT64, F_GET_INT8, F_GET_UINT8, F_GET_INT16, F_GET_UINT16, F_GET_INT32, F_GET_UINT32, F_GET_INT64,
    F_GET_UINT64, F_GET_BOOLEAN, F_GET_STRING, F_GET_BINARY, F_GET_CLOCK,
    F_SET_FLOAT32, F_SET_FLOAT64, F_SET_INT8, F_SET_UINT8, F_SET_INT16, F_SET_UINT16, F_SET_INT32, F_SET_UINT32, F_SET_INT64,
    F_SET_UINT64, F_SET_BOOLEAN, F_SET_STRING, F_SET_BINARY, F_SET_CLOCK,
    F_NUMBER_OF_DEPENDENCIES, F_GET_DEPENDENCIES,
    F_GET_STATE, F_SET_STATE, F_FREE_STATE, F_SERIALIZED_SIZE, F_SERIALIZE, F_DESERIALIZE, F_DIRECTIONAL, F_ADJOINT,
    F_ENTER_CONFIGURATION, F_EXIT_CONFIGURATION,
    F_GET_INTERVAL_DECIMAL, F_GET_INTERVAL_FRACTION, F_GET_SHIFT_DECIMAL, F_GET_SHIFT_FRACTION,
    F_SET_INTERVAL_DECIMAL, F_SET_INTERVAL_FRACTION, F_SET_SHIFT_DECIMAL, F_SET_SHIFT_FRACTION,
    F_EVALUATE_DISCRETE, F_UPDATE_DISCRETE,
    F_ENTER_CONTINUOUS, F_COMPLETED_STEP, F_SET_TIME, F_SET_STATES, F_GET_DERIVATIVES, F_GET_INDICATORS, F_GET_STATES,
    F_GET_NOMINALS, F_NUMBER_OF_INDICATORS, F_NUMBER_OF_STATES,
    F_ENTER_STEP, F_GET_OUTPUT_DERIVATIVES, F_DO_STEP, F_ACTIVATE_PARTITION
};

#define ME_RUN (P_EVENT | P_CONTINUOUS)
#define START (P_INSTANTIATED | P_INITIALIZATION)
#define ME_EVALUATE (P_INITIALIZATION | ME_RUN | P_TERMINATED)
#define CS_EVALUATE (P_INITIALIZATION | P_STEP | P_TERMINATED)
#define GET {P_INSTANTIATED | ME_EVALUATE, P_INSTANTIATED | CS_EVALUATE}
#define SET_FLOAT {START | ME_RUN, START | P_STEP}
#define SET_DISCRETE {START | P_EVENT, START | P_STEP}
#define CLOCK {P_INITIALIZATION | P_EVENT, P_INITIALIZATION}

static const FunctionRule rules[] = {
    [F_SET_DEBUG_LOGGING] = {"fmi3SetDebugLogging", {P_ANY, P_ANY}},
    [F_ENTER_INITIALIZATION] = {"fmi3EnterInitializationMode", {P_INSTANTIATED, P_INSTANTIATED}},
    [F_EXIT_INITIALIZATION] = {"fmi3ExitInitializationMode", {P_INITIALIZATION, P_INITIALIZATION}},
    [F_ENTER_EVENT] = {"fmi3EnterEventMode", {P_CONTINUOUS, 0}}, /* co-simulation: hasEventMode is false */
    [F_TERMINATE] = {"fmi3Terminate", {ME_RUN, P_STEP}},
    [F_RESET] = {"fmi3Reset", {P_ANY, P_ANY}},
    [F_GET_FLOAT32] = {"fmi3GetFloat32", GET},
    [F_GET_FLOAT64] = {"fmi3GetFloat64", GET},
    [F_GET_INT8] = {"fmi3GetInt8", GET},
    [F_GET_UINT8] = {"fmi3GetUInt8", GET},
    [F_GET_INT16] = {"fmi3GetInt16", GET},
    [F_GET_UINT16] = {"fmi3GetUInt16", GET},
    [F_GET_INT32] = {"fmi3GetInt32", GET},
    [F_GET_UINT32] = {"fmi3GetUInt32", GET},
    [F_GET_INT64] = {"fmi3GetInt64", GET},
    [F_GET_UINT64] = {"fmi3GetUInt64", GET},
    [F_GET_BOOLEAN] = {"fmi3GetBoolean", GET},
    [F_GET_STRING] = {"fmi3GetString", GET},
    [F_GET_BINARY] = {"fmi3GetBinary", GET},
    [F_GET_CLOCK] = {"fmi3GetClock", CLOCK},
    [F_SET_FLOAT32] = {"fmi3SetFloat32", SET_FLOAT},
    [F_SET_FLOAT64] = {"fmi3SetFloat64", SET_FLOAT},
    [F_SET_INT8] = {"fmi3SetInt8", SET_DISCRETE},
    [F_SET_UINT8] = {"fmi3SetUInt8", SET_DISCRETE},
    [F_SET_INT16] = {"fmi3SetInt16", SET_DISCRETE},
    [F_SET_UINT16] = {"fmi3SetUInt16", SET_DISCRETE},
    [F_SET_INT32] = {"fmi3SetInt32", SET_DISCRETE},
    [F_SET_UINT32] = {"fmi3SetUInt32", SET_DISCRETE},
    [F_SET_INT64] = {"fmi3SetInt64", SET_DISCRETE},
    [F_SET_UINT64] = {"fmi3SetUInt64", SET_DISCRETE},
    [F_SET_BOOLEAN] = {"fmi3SetBoolean", SET_DISCRETE},
    [F_SET_STRING] = {"fmi3SetString", SET_DISCRETE},
    [F_SET_BINARY] = {"fmi3SetBinary", SET_DISCRETE},
    [F_SET_CLOCK] = {"fmi3SetClock", CLOCK},
    [F_NUMBER_OF_DEPENDENCIES] = {"fmi3GetNumberOfVariableDependencies", {0, 0}}, /* providesPerElementDependencies is false */
    [F_GET_DEPENDENCIES] = {"fmi3GetVariableDependencies", {0, 0}},
    [F_GET_STATE] = {"fmi3GetFMUState", {P_ANY, P_ANY}},
    [F_SET_STATE] = {"fmi3SetFMUState", {P_ANY, P_ANY}},
    [F_FREE_STATE] = {"fmi3FreeFMUState", {P_ANY, P_ANY}},
    [F_SERIALIZED_SIZE] = {"fmi3SerializedFMUStateSize", {P_ANY, P_ANY}},
    [F_SERIALIZE] = {"fmi3SerializeFMUState", {P_ANY, P_ANY}},
    [F_DESERIALIZE] = {"fmi3DeserializeFMUState", {P_ANY, P_ANY}},
    [F_DIRECTIONAL] = {"fmi3GetDirectionalDerivative", {ME_EVALUATE, CS_EVALUATE}},
    [F_ADJOINT] = {"fmi3GetAdjointDerivative", {ME_EVALUATE, CS_EVALUATE}},
    [F_ENTER_CONFIGURATION] = {"fmi3EnterConfigurationMode", {0, 0}}, /* no structural parameters */
    [F_EXIT_CONFIGURATION] = {"fmi3ExitConfigurationMode", {0, 0}},
    [F_GET_INTERVAL_DECIMAL] = {"fmi3GetIntervalDecimal", CLOCK},
    [F_GET_INTERVAL_FRACTION] = {"fmi3GetIntervalFraction", CLOCK},
    [F_GET_SHIFT_DECIMAL] = {"fmi3GetShiftDecimal", CLOCK},
    [F_GET_SHIFT_FRACTION] = {"fmi3GetShiftFraction", CLOCK},
    [F_SET_INTERVAL_DECIMAL] = {"fmi3SetIntervalDecimal", CLOCK},
    [F_SET_INTERVAL_FRACTION] = {"fmi3SetIntervalFraction", CLOCK},
    [F_SET_SHIFT_DECIMAL] = {"fmi3SetShiftDecimal", CLOCK},
    [F_SET_SHIFT_FRACTION] = {"fmi3SetShiftFraction", CLOCK},
    [F_EVALUATE_DISCRETE] = {"fmi3EvaluateDiscreteStates", {P_EVENT, 0}},
    [F_UPDATE_DISCRETE] = {"fmi3UpdateDiscreteStates", {P_EVENT, 0}},
    [F_ENTER_CONTINUOUS] = {"fmi3EnterContinuousTimeMode", {P_EVENT, 0}},
    [F_COMPLETED_STEP] = {"fmi3CompletedIntegratorStep", {P_CONTINUOUS, 0}},
    [F_SET_TIME] = {"fmi3SetTime", {P_CONTINUOUS, 0}},
    [F_SET_STATES] = {"fmi3SetContinuousStates", {P_CONTINUOUS, 0}},
    [F_GET_DERIVATIVES] = {"fmi3GetContinuousStateDerivatives", {ME_EVALUATE, 0}},
    [F_GET_INDICATORS] = {"fmi3GetEventIndicators", {ME_EVALUATE, 0}},
    [F_GET_STATES] = {"fmi3GetContinuousStates", {ME_EVALUATE, 0}},
    [F_GET_NOMINALS] = {"fmi3GetNominalsOfContinuousStates", {ME_EVALUATE, 0}},
    [F_NUMBER_OF_INDICATORS] = {"fmi3GetNumberOfEventIndicators", {P_ANY, 0}},
    [F_NUMBER_OF_STATES] = {"fmi3GetNumberOfContinuousStates", {P_ANY, 0}},
    [F_ENTER_STEP] = {"fmi3EnterStepMode", {0, 0}}, /* hasEventMode is false */
    [F_GET_OUTPUT_DERIVATIVES] = {"fmi3GetOutputDerivatives", {0, P_STEP | P_TERMINATED}},
    [F_DO_STEP] = {"fmi3DoStep", {0, P_STEP}},
    [F_ACTIVATE_PARTITION] = {"fmi3ActivateModelPartition", {0, 0}}, /* no scheduled execution */
};

static unsigned settable(unsigned phase)
{
    switch (phase) {
    case P_INSTANTIATED:
    case P_INITIALIZATION: return V_INPUT | V_TUNABLE | V_FIXED | V_START;
    case P_EVENT: return V_INPUT | V_TUNABLE | V_STATE;
    case P_CONTINUOUS: return V_INPUT_REAL | V_STATE | V_STATE_REINIT;
    case P_STEP: return V_INPUT | V_TUNABLE;
    default: return 0;
    }
}

static void emit(Wrapper *w, CoreStatus status, const char *category, const char *message)
{
    const Component *c = (const Component *)w;
    char escaped[2048];
    size_t n = 0;
    if (!c->logger)
        return;
    for (; *message && n < sizeof escaped - 2; message++) {
        if (*message == '#') /* the standard's escape character */
            escaped[n++] = *message;
        escaped[n++] = *message;
    }
    escaped[n] = '\0';
    c->logger(c->environment, (fmi3Status)status, category, escaped);
}

#define ENTER(FUNCTION)                                                                                                                  \
    Wrapper *const w = instance;                                                                                                         \
    if (!w || !wrapper_enter(w, FUNCTION))                                                                                               \
        return fmi3Error
#define LEAVE(STATUS) return (fmi3Status)wrapper_done(w, STATUS)

/* Leaves when STATUS is a Discard or worse; warnings are kept in `status`. */
#define TRY(STATUS)                                                                                                                      \
    do {                                                                                                                                 \
        const CoreStatus tried = STATUS;                                                                                                 \
        if (tried >= CORE_DISCARD)                                                                                                       \
            LEAVE(tried);                                                                                                                \
        if (tried > status)                                                                                                              \
            status = tried;                                                                                                              \
    } while (0)

/* ---- common functions ---- */

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean loggingOn, size_t nCategories, const fmi3String categories[])
{
    unsigned mask;
    ENTER(F_SET_DEBUG_LOGGING);
    if (!wrapper_categories(w, categories, nCategories, &mask))
        LEAVE(CORE_ERROR);
    w->log_mask = loggingOn ? w->log_mask | mask : w->log_mask & ~mask;
    LEAVE(CORE_OK);
}

static Component *component_new(fmi3Boolean loggingOn, fmi3InstanceEnvironment environment, fmi3LogMessageCallback logMessage)
{
    Component *c = calloc(1, sizeof *c);
    if (!c)
        return NULL;
    c->logger = logMessage;
    c->environment = environment;
    c->w.rules = rules;
    c->w.settable = settable;
    c->w.emit = emit;
    c->w.error_phase = P_TERMINATED;
    c->w.log_mask = loggingOn ? L_ALL : 0; /* "any logging is disabled", errors too */
    return c;
}

static fmi3Instance component_open(Component *c, InterfaceKind kind, const char *name, const char *token)
{
    const unsigned mask = c->w.log_mask;
    c->w.log_mask = L_ALL; /* a failed instantiation gives its reason */
    if (!wrapper_open(&c->w, kind, name, token)) {
        wrapper_close(&c->w);
        free(c);
        return NULL;
    }
    c->w.log_mask = mask;
    return c;
}

static fmi3Instance refuse(Component *c, const char *reason)
{
    if (c) {
        c->w.log_mask = L_ALL;
        wrapper_report(&c->w, CORE_ERROR, "instantiation failed: %s", reason);
    }
    free(c);
    return NULL;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath,
                                          fmi3Boolean visible, fmi3Boolean loggingOn, fmi3InstanceEnvironment instanceEnvironment,
                                          fmi3LogMessageCallback logMessage)
{
    Component *c = component_new(loggingOn, instanceEnvironment, logMessage);
    (void)resourcePath, (void)visible; /* no resources, no windows */
    return c ? component_open(c, MODEL_EXCHANGE, instanceName, instantiationToken) : NULL;
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath,
                                         fmi3Boolean visible, fmi3Boolean loggingOn, fmi3Boolean eventModeUsed,
                                         fmi3Boolean earlyReturnAllowed, const fmi3ValueReference requiredIntermediateVariables[],
                                         size_t nRequiredIntermediateVariables, fmi3InstanceEnvironment instanceEnvironment,
                                         fmi3LogMessageCallback logMessage, fmi3IntermediateUpdateCallback intermediateUpdate)
{
    Component *c = component_new(loggingOn, instanceEnvironment, logMessage);
    (void)resourcePath, (void)visible, (void)requiredIntermediateVariables, (void)intermediateUpdate;
    (void)earlyReturnAllowed; /* allowed, never made use of */
    if (!c || eventModeUsed)
        return refuse(c, "eventModeUsed is true, but hasEventMode is false");
    if (nRequiredIntermediateVariables)
        return refuse(c, "intermediate variables are required, but no variable has intermediateUpdate");
    return component_open(c, CO_SIMULATION, instanceName, instantiationToken);
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath,
                                               fmi3Boolean visible, fmi3Boolean loggingOn, fmi3InstanceEnvironment instanceEnvironment,
                                               fmi3LogMessageCallback logMessage, fmi3ClockUpdateCallback clockUpdate,
                                               fmi3LockPreemptionCallback lockPreemption, fmi3UnlockPreemptionCallback unlockPreemption)
{
    Component *c = component_new(loggingOn, instanceEnvironment, logMessage);
    (void)instanceName, (void)instantiationToken, (void)resourcePath, (void)visible, (void)clockUpdate, (void)lockPreemption;
    (void)unlockPreemption;
    return refuse(c, "this FMU has no scheduled execution; use model exchange or co-simulation");
}

void fmi3FreeInstance(fmi3Instance instance)
{
    if (instance) {
        wrapper_close(instance);
        free(instance);
    }
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean toleranceDefined, fmi3Float64 tolerance, fmi3Float64 startTime,
                                       fmi3Boolean stopTimeDefined, fmi3Float64 stopTime)
{
    ENTER(F_ENTER_INITIALIZATION);
    if (toleranceDefined && !(tolerance > 0.0)) /* otherwise unused: the solver has a fixed step */
        LEAVE(wrapper_report(w, CORE_ERROR, "fmi3EnterInitializationMode: tolerance %g must be > 0", tolerance));
    if (!isfinite(startTime) || (stopTimeDefined && !(stopTime >= startTime)))
        LEAVE(wrapper_report(w, CORE_ERROR, "fmi3EnterInitializationMode: start time %g s must be finite and not after stop time %g s",
                             startTime, stopTime));
    w->r.start_time = startTime;
    w->r.stop_defined = stopTimeDefined;
    w->r.stop_time = stopTime;
    w->r.phase = P_INITIALIZATION;
    w->r.initialised = 0;
    LEAVE(CORE_OK);
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    CoreStatus status = CORE_OK;
    ENTER(F_EXIT_INITIALIZATION);
    TRY(wrapper_ready(w));
    w->r.phase = w->r.kind == CO_SIMULATION ? P_STEP : P_EVENT;
    w->r.event_done = 0;
    LEAVE(status);
}

fmi3Status fmi3EnterEventMode(fmi3Instance instance)
{
    ENTER(F_ENTER_EVENT);
    w->r.phase = P_EVENT;
    w->r.event_done = 0;
    LEAVE(CORE_OK);
}

fmi3Status fmi3Terminate(fmi3Instance instance)
{
    ENTER(F_TERMINATE);
    w->r.phase = P_TERMINATED;
    LEAVE(CORE_OK);
}

fmi3Status fmi3Reset(fmi3Instance instance)
{
    ENTER(F_RESET);
    wrapper_reset(w);
    LEAVE(CORE_OK);
}

/* ---- variables ---- */

static CoreStatus get_value(Wrapper *w, int function, unsigned reference, unsigned types, double *x)
{
    CoreStatus status;
    if (reference >= model_n_variables && reference - model_n_variables < model_n_indicators && (types & TYPE_BIT(VT_REAL))) {
        status = core_indicators(w->core, w->indicators);
        *x = w->indicators[reference - model_n_variables];
        return status;
    }
    status = wrapper_check(w, function, reference, types);
    return status == CORE_OK ? core_get(w->core, reference, x) : status;
}

#define GETTER(NAME, FUNCTION, TYPE, TYPES)                                                                                              \
    fmi3Status NAME(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, TYPE values[], size_t nValues)                       \
    {                                                                                                                                    \
        CoreStatus status = CORE_OK;                                                                                                     \
        ENTER(FUNCTION);                                                                                                                 \
        TRY(wrapper_check_array(w, FUNCTION, vr, values, n));                                                                            \
        TRY(wrapper_length(w, FUNCTION, values, nValues, n));                                                                            \
        TRY(wrapper_ready(w));                                                                                                           \
        for (size_t i = 0; i < n; i++) {                                                                                                 \
            double x = 0.0;                                                                                                              \
            TRY(get_value(w, FUNCTION, vr[i], TYPES, &x));                                                                               \
            values[i] = (TYPE)x;                                                                                                         \
        }                                                                                                                                \
        LEAVE(status);                                                                                                                   \
    }

#define SETTER(NAME, FUNCTION, TYPE, TYPES)                                                                                              \
    fmi3Status NAME(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const TYPE values[], size_t nValues)                 \
    {                                                                                                                                    \
        CoreStatus status = CORE_OK;                                                                                                     \
        ENTER(FUNCTION);                                                                                                                 \
        TRY(wrapper_check_array(w, FUNCTION, vr, values, n));                                                                            \
        TRY(wrapper_length(w, FUNCTION, values, nValues, n));                                                                            \
        for (size_t i = 0; i < n; i++)                                                                                                   \
            TRY(wrapper_check_set(w, FUNCTION, vr[i], TYPES, (double)values[i]));                                                        \
        for (size_t i = 0; i < n; i++)                                                                                                   \
            TRY(wrapper_set(w, vr[i], (double)values[i]));                                                                               \
        LEAVE(status);                                                                                                                   \
    }

GETTER(fmi3GetFloat64, F_GET_FLOAT64, fmi3Float64, TYPE_BIT(VT_REAL))
GETTER(fmi3GetInt32, F_GET_INT32, fmi3Int32, TYPE_BIT(VT_INTEGER))
GETTER(fmi3GetInt64, F_GET_INT64, fmi3Int64, TYPE_BIT(VT_ENUMERATION))
GETTER(fmi3GetBoolean, F_GET_BOOLEAN, fmi3Boolean, TYPE_BIT(VT_BOOLEAN))
SETTER(fmi3SetFloat64, F_SET_FLOAT64, fmi3Float64, TYPE_BIT(VT_REAL))
SETTER(fmi3SetInt32, F_SET_INT32, fmi3Int32, TYPE_BIT(VT_INTEGER))
SETTER(fmi3SetInt64, F_SET_INT64, fmi3Int64, TYPE_BIT(VT_ENUMERATION))
SETTER(fmi3SetBoolean, F_SET_BOOLEAN, fmi3Boolean, TYPE_BIT(VT_BOOLEAN))

/* A feature this FMU does not have: fine when nothing is asked of it. */
static fmi3Status absent(fmi3Instance instance, int function, size_t n, const char *what)
{
    ENTER(function);
    LEAVE(n ? wrapper_report(w, CORE_ERROR, "%s: this FMU has no %s", rules[function].name, what) : CORE_OK);
}

#define ABSENT_TYPE(TYPE, CODE)                                                                                                          \
    fmi3Status fmi3Get##TYPE(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3##TYPE values[], size_t nValues)        \
    {                                                                                                                                    \
        (void)vr, (void)values, (void)nValues;                                                                                           \
        return absent(instance, F_GET_##CODE, n, #TYPE " variables");                                                                    \
    }                                                                                                                                    \
    fmi3Status fmi3Set##TYPE(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3##TYPE values[], size_t nValues)  \
    {                                                                                                                                    \
        (void)vr, (void)values, (void)nValues;                                                                                           \
        return absent(instance, F_SET_##CODE, n, #TYPE " variables");                                                                    \
    }

ABSENT_TYPE(Float32, FLOAT32)
ABSENT_TYPE(Int8, INT8)
ABSENT_TYPE(UInt8, UINT8)
ABSENT_TYPE(Int16, INT16)
ABSENT_TYPE(UInt16, UINT16)
ABSENT_TYPE(UInt32, UINT32)
ABSENT_TYPE(UInt64, UINT64)
ABSENT_TYPE(String, STRING)

fmi3Status fmi3GetBinary(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, size_t sizes[], fmi3Binary values[],
                         size_t nValues)
{
    (void)vr, (void)sizes, (void)values, (void)nValues;
    return absent(instance, F_GET_BINARY, n, "Binary variables");
}

fmi3Status fmi3SetBinary(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const size_t sizes[], const fmi3Binary values[],
                         size_t nValues)
{
    (void)vr, (void)sizes, (void)values, (void)nValues;
    return absent(instance, F_SET_BINARY, n, "Binary variables");
}

/* ---- Clocks, dependencies, configuration: none ---- */

#define CLOCKS "Clocks"
#define VRS const fmi3ValueReference vr[], size_t n

fmi3Status fmi3GetClock(fmi3Instance instance, VRS, fmi3Clock values[])
{
    (void)vr, (void)values;
    return absent(instance, F_GET_CLOCK, n, CLOCKS);
}

fmi3Status fmi3SetClock(fmi3Instance instance, VRS, const fmi3Clock values[])
{
    (void)vr, (void)values;
    return absent(instance, F_SET_CLOCK, n, CLOCKS);
}

fmi3Status fmi3GetIntervalDecimal(fmi3Instance instance, VRS, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
{
    (void)vr, (void)intervals, (void)qualifiers;
    return absent(instance, F_GET_INTERVAL_DECIMAL, n, CLOCKS);
}

fmi3Status fmi3GetIntervalFraction(fmi3Instance instance, VRS, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
                                   fmi3IntervalQualifier qualifiers[])
{
    (void)vr, (void)counters, (void)resolutions, (void)qualifiers;
    return absent(instance, F_GET_INTERVAL_FRACTION, n, CLOCKS);
}

fmi3Status fmi3GetShiftDecimal(fmi3Instance instance, VRS, fmi3Float64 shifts[])
{
    (void)vr, (void)shifts;
    return absent(instance, F_GET_SHIFT_DECIMAL, n, CLOCKS);
}

fmi3Status fmi3GetShiftFraction(fmi3Instance instance, VRS, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
{
    (void)vr, (void)counters, (void)resolutions;
    return absent(instance, F_GET_SHIFT_FRACTION, n, CLOCKS);
}

fmi3Status fmi3SetIntervalDecimal(fmi3Instance instance, VRS, const fmi3Float64 intervals[])
{
    (void)vr, (void)intervals;
    return absent(instance, F_SET_INTERVAL_DECIMAL, n, CLOCKS);
}

fmi3Status fmi3SetIntervalFraction(fmi3Instance instance, VRS, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
{
    (void)vr, (void)counters, (void)resolutions;
    return absent(instance, F_SET_INTERVAL_FRACTION, n, CLOCKS);
}

fmi3Status fmi3SetShiftDecimal(fmi3Instance instance, VRS, const fmi3Float64 shifts[])
{
    (void)vr, (void)shifts;
    return absent(instance, F_SET_SHIFT_DECIMAL, n, CLOCKS);
}

fmi3Status fmi3SetShiftFraction(fmi3Instance instance, VRS, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
{
    (void)vr, (void)counters, (void)resolutions;
    return absent(instance, F_SET_SHIFT_FRACTION, n, CLOCKS);
}

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance instance, fmi3ValueReference valueReference, size_t *nDependencies)
{
    (void)valueReference, (void)nDependencies;
    return absent(instance, F_NUMBER_OF_DEPENDENCIES, 1, "arrays");
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance instance, fmi3ValueReference dependent, size_t elementIndicesOfDependent[],
                                       fmi3ValueReference independents[], size_t elementIndicesOfIndependents[],
                                       fmi3DependencyKind dependencyKinds[], size_t nDependencies)
{
    (void)dependent, (void)elementIndicesOfDependent, (void)independents, (void)elementIndicesOfIndependents;
    (void)dependencyKinds, (void)nDependencies;
    return absent(instance, F_GET_DEPENDENCIES, 1, "arrays");
}

fmi3Status fmi3EnterConfigurationMode(fmi3Instance instance) { return absent(instance, F_ENTER_CONFIGURATION, 1, "structural parameters"); }
fmi3Status fmi3ExitConfigurationMode(fmi3Instance instance) { return absent(instance, F_EXIT_CONFIGURATION, 1, "structural parameters"); }

/* ---- FMU states ---- */

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *FMUState)
{
    ENTER(F_GET_STATE);
    LEAVE(wrapper_save(w, FMUState));
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState FMUState)
{
    ENTER(F_SET_STATE);
    LEAVE(wrapper_load(w, FMUState));
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *FMUState)
{
    ENTER(F_FREE_STATE);
    wrapper_free_state(FMUState);
    LEAVE(CORE_OK);
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState FMUState, size_t *size)
{
    ENTER(F_SERIALIZED_SIZE);
    LEAVE(wrapper_serialised_size(w, FMUState, size));
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState FMUState, fmi3Byte serializedState[], size_t size)
{
    ENTER(F_SERIALIZE);
    LEAVE(wrapper_serialise(w, FMUState, serializedState, size));
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte serializedState[], size_t size, fmi3FMUState *FMUState)
{
    ENTER(F_DESERIALIZE);
    LEAVE(wrapper_deserialise(w, serializedState, size, FMUState));
}

/* ---- partial derivatives ---- */

static CoreStatus check_derivative(Wrapper *w, int function, const fmi3ValueReference *unknowns, size_t nUnknowns,
                                   const fmi3ValueReference *knowns, size_t nKnowns)
{
    CoreStatus status = CORE_OK;
    for (size_t i = 0; i < nUnknowns && status == CORE_OK; i++)
        status = wrapper_check(w, function, unknowns[i], TYPE_BIT(VT_REAL));
    for (size_t i = 0; i < nKnowns && status == CORE_OK; i++)
        status = wrapper_check(w, function, knowns[i], TYPE_BIT(VT_REAL));
    return status;
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t nUnknowns,
                                        const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[], size_t nSeed,
                                        fmi3Float64 sensitivity[], size_t nSensitivity)
{
    CoreStatus status = CORE_OK;
    ENTER(F_DIRECTIONAL);
    TRY(wrapper_check_array(w, F_DIRECTIONAL, unknowns, sensitivity, nUnknowns));
    TRY(wrapper_check_array(w, F_DIRECTIONAL, knowns, seed, nKnowns));
    TRY(wrapper_length(w, F_DIRECTIONAL, seed, nSeed, nKnowns));
    TRY(wrapper_length(w, F_DIRECTIONAL, sensitivity, nSensitivity, nUnknowns));
    TRY(check_derivative(w, F_DIRECTIONAL, unknowns, nUnknowns, knowns, nKnowns));
    TRY(wrapper_ready(w));
    TRY(core_directional(w->core, unknowns, nUnknowns, knowns, nKnowns, seed, sensitivity));
    LEAVE(status);
}

/* sensitivity[j] = sum_i seed[i] * d unknown_i / d known_j, column by column. */
static CoreStatus adjoint(Wrapper *w, const fmi3ValueReference *unknowns, size_t nUnknowns, fmi3ValueReference known, const double *seed,
                          double *sensitivity)
{
    enum { CHUNK = 64 };
    const double one = 1.0;
    double column[CHUNK];
    CoreStatus status = CORE_OK;
    *sensitivity = 0.0;
    for (size_t start = 0; start < nUnknowns && status < CORE_DISCARD; start += CHUNK) {
        const size_t n = nUnknowns - start < CHUNK ? nUnknowns - start : CHUNK;
        status = core_directional(w->core, unknowns + start, n, &known, 1, &one, column);
        for (size_t i = 0; i < n && status < CORE_DISCARD; i++)
            *sensitivity += seed[start + i] * column[i];
    }
    return status;
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t nUnknowns,
                                    const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[], size_t nSeed,
                                    fmi3Float64 sensitivity[], size_t nSensitivity)
{
    CoreStatus status = CORE_OK;
    ENTER(F_ADJOINT);
    TRY(wrapper_check_array(w, F_ADJOINT, unknowns, seed, nUnknowns));
    TRY(wrapper_check_array(w, F_ADJOINT, knowns, sensitivity, nKnowns));
    TRY(wrapper_length(w, F_ADJOINT, seed, nSeed, nUnknowns));
    TRY(wrapper_length(w, F_ADJOINT, sensitivity, nSensitivity, nKnowns));
    TRY(check_derivative(w, F_ADJOINT, unknowns, nUnknowns, knowns, nKnowns));
    TRY(wrapper_ready(w));
    for (size_t j = 0; j < nKnowns; j++)
        TRY(adjoint(w, unknowns, nUnknowns, knowns[j], seed, &sensitivity[j]));
    LEAVE(status);
}

/* ---- model exchange ---- */

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance instance)
{
    ENTER(F_EVALUATE_DISCRETE);
    LEAVE(CORE_OK); /* providesEvaluateDiscreteStates is false: the standard has this call ignored */
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *discreteStatesNeedUpdate, fmi3Boolean *terminateSimulation,
                                    fmi3Boolean *nominalsOfContinuousStatesChanged, fmi3Boolean *valuesOfContinuousStatesChanged,
                                    fmi3Boolean *nextEventTimeDefined, fmi3Float64 *nextEventTime)
{
    CoreStatus status = CORE_OK;
    EventInfo info = {0};
    ENTER(F_UPDATE_DISCRETE);
    TRY(wrapper_check_array(w, F_UPDATE_DISCRETE, discreteStatesNeedUpdate, terminateSimulation, 1));
    TRY(wrapper_check_array(w, F_UPDATE_DISCRETE, nominalsOfContinuousStatesChanged, valuesOfContinuousStatesChanged, 1));
    TRY(wrapper_check_array(w, F_UPDATE_DISCRETE, nextEventTimeDefined, nextEventTime, 1));
    TRY(core_update_discrete(w->core, &info));
    w->r.event_done = !info.again;
    *discreteStatesNeedUpdate = info.again != 0;
    *terminateSimulation = info.terminate != 0;
    *nominalsOfContinuousStatesChanged = info.nominals_changed != 0;
    *valuesOfContinuousStatesChanged = info.states_changed != 0;
    *nextEventTimeDefined = info.next_time_defined != 0;
    *nextEventTime = info.next_time_defined ? info.next_time : 0.0;
    LEAVE(status);
}

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance)
{
    ENTER(F_ENTER_CONTINUOUS);
    if (!w->r.event_done)
        LEAVE(wrapper_report(w, CORE_ERROR, "fmi3EnterContinuousTimeMode: call fmi3UpdateDiscreteStates until discreteStatesNeedUpdate is false"));
    w->r.phase = P_CONTINUOUS;
    LEAVE(CORE_OK);
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance, fmi3Boolean noSetFMUStatePriorToCurrentPoint, fmi3Boolean *enterEventMode,
                                       fmi3Boolean *terminateSimulation)
{
    CoreStatus status = CORE_OK;
    int event = 0;
    ENTER(F_COMPLETED_STEP);
    (void)noSetFMUStatePriorToCurrentPoint;
    TRY(wrapper_check_array(w, F_COMPLETED_STEP, terminateSimulation, enterEventMode, 1));
    TRY(core_completed_step(w->core, &event));
    *enterEventMode = event != 0;
    *terminateSimulation = fmi3False;
    LEAVE(status);
}

fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time)
{
    ENTER(F_SET_TIME);
    if (!isfinite(time))
        LEAVE(wrapper_report(w, CORE_ERROR, "fmi3SetTime: time must be finite"));
    LEAVE(core_set_time(w->core, time));
}

fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 continuousStates[], size_t nContinuousStates)
{
    CoreStatus status = CORE_OK;
    ENTER(F_SET_STATES);
    TRY(wrapper_length(w, F_SET_STATES, continuousStates, nContinuousStates, model_n_states));
    TRY(core_set_states(w->core, continuousStates));
    LEAVE(status);
}

#define VECTOR(NAME, FUNCTION, COUNT, CALL)                                                                                              \
    fmi3Status NAME(fmi3Instance instance, fmi3Float64 values[], size_t n)                                                               \
    {                                                                                                                                    \
        CoreStatus status = CORE_OK;                                                                                                     \
        ENTER(FUNCTION);                                                                                                                 \
        TRY(wrapper_length(w, FUNCTION, values, n, COUNT));                                                                              \
        TRY(wrapper_ready(w));                                                                                                           \
        TRY(CALL);                                                                                                                       \
        LEAVE(status);                                                                                                                   \
    }

VECTOR(fmi3GetContinuousStateDerivatives, F_GET_DERIVATIVES, model_n_states, core_derivatives(w->core, values))
VECTOR(fmi3GetEventIndicators, F_GET_INDICATORS, model_n_indicators, core_indicators(w->core, values))
VECTOR(fmi3GetContinuousStates, F_GET_STATES, model_n_states, (core_get_states(w->core, values), CORE_OK))
VECTOR(fmi3GetNominalsOfContinuousStates, F_GET_NOMINALS, model_n_states, wrapper_nominals(w, values))

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *nEventIndicators)
{
    CoreStatus status = CORE_OK;
    ENTER(F_NUMBER_OF_INDICATORS);
    TRY(wrapper_check_array(w, F_NUMBER_OF_INDICATORS, w, nEventIndicators, 1));
    *nEventIndicators = model_n_indicators;
    LEAVE(status);
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *nContinuousStates)
{
    CoreStatus status = CORE_OK;
    ENTER(F_NUMBER_OF_STATES);
    TRY(wrapper_check_array(w, F_NUMBER_OF_STATES, w, nContinuousStates, 1));
    *nContinuousStates = model_n_states;
    LEAVE(status);
}

/* ---- co-simulation ---- */

fmi3Status fmi3EnterStepMode(fmi3Instance instance) { return absent(instance, F_ENTER_STEP, 1, "event mode in co-simulation"); }

fmi3Status fmi3GetOutputDerivatives(fmi3Instance instance, VRS, const fmi3Int32 orders[], fmi3Float64 values[], size_t nValues)
{
    (void)vr, (void)orders, (void)values, (void)nValues;
    return absent(instance, F_GET_OUTPUT_DERIVATIVES, n, "output derivatives (maxOutputDerivativeOrder is 0)");
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 currentCommunicationPoint, fmi3Float64 communicationStepSize,
                      fmi3Boolean noSetFMUStatePriorToCurrentPoint, fmi3Boolean *eventHandlingNeeded, fmi3Boolean *terminateSimulation,
                      fmi3Boolean *earlyReturn, fmi3Float64 *lastSuccessfulTime)
{
    CoreStatus status = CORE_OK;
    ENTER(F_DO_STEP);
    (void)noSetFMUStatePriorToCurrentPoint;
    TRY(wrapper_check_array(w, F_DO_STEP, eventHandlingNeeded, terminateSimulation, 1));
    TRY(wrapper_check_array(w, F_DO_STEP, earlyReturn, lastSuccessfulTime, 1));
    status = wrapper_step(w, F_DO_STEP, currentCommunicationPoint, communicationStepSize);
    *eventHandlingNeeded = *terminateSimulation = *earlyReturn = fmi3False;
    *lastSuccessfulTime = core_time(w->core);
    if (status == CORE_DISCARD) /* fmi3Discard would promise the state before the call */
        status = CORE_ERROR;
    LEAVE(status);
}

fmi3Status fmi3ActivateModelPartition(fmi3Instance instance, fmi3ValueReference clockReference, fmi3Float64 activationTime)
{
    (void)clockReference, (void)activationTime;
    return absent(instance, F_ACTIVATE_PARTITION, 1, "model partitions");
}
