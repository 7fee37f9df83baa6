/* FMI 2.0: model exchange and co-simulation in one binary. Rules that differ from a plain reading of the standard (2.0.4):
 * inputs may also be set in state Instantiated, and in Initialization Mode every variable may be read (importers rely on both).
 */
#include "fmi2Functions.h"
#include "wrapper.h"

#include <math.h>
#include <stdlib.h>

typedef struct {
    Wrapper w; /* first: a Component is a Wrapper */
    fmi2CallbackLogger logger;
    fmi2ComponentEnvironment environment;
} Component;

/* ---- table of legal calls: FMI 2.0.4, sections 3.2.3 (model exchange) and 4.2.4 (co-simulation) ---- */

enum {
    F_SET_DEBUG_LOGGING, F_SETUP_EXPERIMENT, F_ENTER_INITIALIZATION, F_EXIT_INITIALIZATION, F_TERMINATE, F_RESET,
    F_GET_REAL, F_GET_INTEGER, F_GET_BOOLEAN, F_GET_STRING, F_SET_REAL, F_SET_INTEGER, F_SET_BOOLEAN, F_SET_STRING,
    F_GET_STATE, F_SET_STATE, F_FREE_STATE, F_SERIALIZED_SIZE, F_SERIALIZE, F_DESERIALIZE, F_DIRECTIONAL,
    F_ENTER_EVENT, F_NEW_DISCRETE, F_ENTER_CONTINUOUS, F_COMPLETED_STEP, F_SET_TIME, F_SET_STATES, F_GET_DERIVATIVES,
    F_GET_INDICATORS, F_GET_STATES, F_GET_NOMINALS,
    F_SET_INPUT_DERIVATIVES, F_GET_OUTPUT_DERIVATIVES, F_DO_STEP, F_CANCEL_STEP, F_GET_STATUS, F_GET_REAL_STATUS,
    F_GET_INTEGER_STATUS, F_GET_BOOLEAN_STATUS, F_GET_STRING_STATUS
};

#define ME_RUN (P_EVENT | P_CONTINUOUS)
#define ME_READ (P_INITIALIZATION | ME_RUN | P_TERMINATED | P_ERROR)
#define CS_READ (P_INITIALIZATION | P_STEP | P_STEP_FAILED | P_TERMINATED | P_ERROR)
#define START (P_INSTANTIATED | P_INITIALIZATION)
#define CS_STATUS (P_STEP | P_STEP_FAILED | P_TERMINATED)

static const FunctionRule rules[] = {
    [F_SET_DEBUG_LOGGING] = {"fmi2SetDebugLogging", {P_ANY, P_ANY}},
    [F_SETUP_EXPERIMENT] = {"fmi2SetupExperiment", {P_INSTANTIATED, P_INSTANTIATED}},
    [F_ENTER_INITIALIZATION] = {"fmi2EnterInitializationMode", {P_INSTANTIATED, P_INSTANTIATED}},
    [F_EXIT_INITIALIZATION] = {"fmi2ExitInitializationMode", {P_INITIALIZATION, P_INITIALIZATION}},
    [F_TERMINATE] = {"fmi2Terminate", {ME_RUN, P_STEP | P_STEP_FAILED}},
    [F_RESET] = {"fmi2Reset", {P_ANY, P_ANY}},
    [F_GET_REAL] = {"fmi2GetReal", {ME_READ, CS_READ}},
    [F_GET_INTEGER] = {"fmi2GetInteger", {ME_READ, CS_READ}},
    [F_GET_BOOLEAN] = {"fmi2GetBoolean", {ME_READ, CS_READ}},
    [F_GET_STRING] = {"fmi2GetString", {ME_READ, CS_READ}},
    [F_SET_REAL] = {"fmi2SetReal", {START | ME_RUN, START | P_STEP}},
    [F_SET_INTEGER] = {"fmi2SetInteger", {START | P_EVENT, START | P_STEP}},
    [F_SET_BOOLEAN] = {"fmi2SetBoolean", {START | P_EVENT, START | P_STEP}},
    [F_SET_STRING] = {"fmi2SetString", {START | P_EVENT, START | P_STEP}},
    [F_GET_STATE] = {"fmi2GetFMUstate", {P_ANY, P_ANY}},
    [F_SET_STATE] = {"fmi2SetFMUstate", {P_ANY, P_ANY}},
    [F_FREE_STATE] = {"fmi2FreeFMUstate", {P_ANY, P_ANY}},
    [F_SERIALIZED_SIZE] = {"fmi2SerializedFMUstateSize", {P_ANY, P_ANY}},
    [F_SERIALIZE] = {"fmi2SerializeFMUstate", {P_ANY, P_ANY}},
    [F_DESERIALIZE] = {"fmi2DeSerializeFMUstate", {P_ANY, P_ANY}},
    [F_DIRECTIONAL] = {"fmi2GetDirectionalDerivative", {ME_READ, CS_READ}},
    [F_ENTER_EVENT] = {"fmi2EnterEventMode", {ME_RUN, 0}},
    [F_NEW_DISCRETE] = {"fmi2NewDiscreteStates", {P_EVENT, 0}},
    [F_ENTER_CONTINUOUS] = {"fmi2EnterContinuousTimeMode", {P_EVENT, 0}},
    [F_COMPLETED_STEP] = {"fmi2CompletedIntegratorStep", {P_CONTINUOUS, 0}},
    [F_SET_TIME] = {"fmi2SetTime", {ME_RUN, 0}},
    [F_SET_STATES] = {"fmi2SetContinuousStates", {P_CONTINUOUS, 0}},
    [F_GET_DERIVATIVES] = {"fmi2GetDerivatives", {ME_READ, 0}},
    [F_GET_INDICATORS] = {"fmi2GetEventIndicators", {ME_READ, 0}},
    [F_GET_STATES] = {"fmi2GetContinuousStates", {ME_READ, 0}},
    [F_GET_NOMINALS] = {"fmi2GetNominalsOfContinuousStates", {P_INSTANTIATED | ME_READ, 0}},
    [F_SET_INPUT_DERIVATIVES] = {"fmi2SetRealInputDerivatives", {0, START | P_STEP}},
    [F_GET_OUTPUT_DERIVATIVES] = {"fmi2GetRealOutputDerivatives", {0, CS_STATUS | P_ERROR}},
    [F_DO_STEP] = {"fmi2DoStep", {0, P_STEP}},
    [F_CANCEL_STEP] = {"fmi2CancelStep", {0, 0}}, /* only while an asynchronous step is pending; steps are synchronous */
    [F_GET_STATUS] = {"fmi2GetStatus", {0, CS_STATUS}},
    [F_GET_REAL_STATUS] = {"fmi2GetRealStatus", {0, CS_STATUS}},
    [F_GET_INTEGER_STATUS] = {"fmi2GetIntegerStatus", {0, CS_STATUS}},
    [F_GET_BOOLEAN_STATUS] = {"fmi2GetBooleanStatus", {0, CS_STATUS}},
    [F_GET_STRING_STATUS] = {"fmi2GetStringStatus", {0, CS_STATUS}},
};

static unsigned settable(unsigned phase)
{
    switch (phase) {
    case P_INSTANTIATED:
    case P_INITIALIZATION: return V_INPUT | V_TUNABLE | V_FIXED | V_START;
    case P_EVENT: return V_INPUT | V_TUNABLE;
    case P_CONTINUOUS: return V_INPUT_REAL | V_STATE | V_STATE_REINIT;
    case P_STEP: return V_INPUT | V_TUNABLE;
    default: return 0;
    }
}

/* The logger takes a printf format, in which "#" is an escape character of the standard: both are doubled. */
static void emit(Wrapper *w, CoreStatus status, const char *category, const char *message)
{
    const Component *c = (const Component *)w;
    char escaped[2048];
    size_t n = 0;
    if (!c->logger)
        return;
    for (; *message && n < sizeof escaped - 2; message++) {
        if (*message == '%' || *message == '#')
            escaped[n++] = *message;
        escaped[n++] = *message;
    }
    escaped[n] = '\0';
    c->logger(c->environment, w->name ? w->name : "", (fmi2Status)status, category, escaped);
}

#define ENTER(FUNCTION)                                                                                                                  \
    Wrapper *const w = c;                                                                                                                \
    if (!w || !wrapper_enter(w, FUNCTION))                                                                                               \
        return fmi2Error
#define LEAVE(STATUS) return (fmi2Status)wrapper_done(w, STATUS)

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

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean loggingOn, size_t nCategories, const fmi2String categories[])
{
    unsigned mask;
    ENTER(F_SET_DEBUG_LOGGING);
    if (!wrapper_categories(w, categories, nCategories, &mask))
        LEAVE(CORE_ERROR);
    /* Switching everything off leaves warnings and errors: they are no debug messages. */
    w->log_mask = nCategories == 0 ? (loggingOn ? L_ALL : L_BASE) : loggingOn ? mask : w->log_mask & ~mask;
    LEAVE(CORE_OK);
}

fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID, fmi2String fmuResourceLocation,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean loggingOn)
{
    Component *c = functions ? calloc(1, sizeof *c) : NULL;
    (void)fmuResourceLocation, (void)visible; /* no resources, no windows */
    if (!c)
        return NULL;
    c->logger = functions->logger;
    c->environment = functions->componentEnvironment;
    c->w.rules = rules;
    c->w.settable = settable;
    c->w.emit = emit;
    c->w.error_phase = P_ERROR;
    c->w.log_mask = loggingOn ? L_ALL : L_BASE;
    if (!wrapper_open(&c->w, fmuType == fmi2CoSimulation ? CO_SIMULATION : MODEL_EXCHANGE, instanceName, fmuGUID)) {
        wrapper_close(&c->w);
        free(c);
        return NULL;
    }
    return c;
}

void fmi2FreeInstance(fmi2Component c)
{
    if (c) {
        wrapper_close(c);
        free(c);
    }
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance, fmi2Real startTime,
                               fmi2Boolean stopTimeDefined, fmi2Real stopTime)
{
    ENTER(F_SETUP_EXPERIMENT);
    if (toleranceDefined && !(tolerance > 0.0)) /* otherwise unused: the solver has a fixed step */
        LEAVE(wrapper_report(w, CORE_ERROR, "fmi2SetupExperiment: tolerance %g must be > 0", tolerance));
    if (!isfinite(startTime) || (stopTimeDefined && !(stopTime >= startTime)))
        LEAVE(wrapper_report(w, CORE_ERROR, "fmi2SetupExperiment: start time %g s must be finite and not after stop time %g s", startTime,
                             stopTime));
    w->r.setup = 1;
    w->r.start_time = startTime;
    w->r.stop_defined = stopTimeDefined != fmi2False;
    w->r.stop_time = stopTime;
    LEAVE(CORE_OK);
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    ENTER(F_ENTER_INITIALIZATION);
    if (!w->r.setup)
        LEAVE(wrapper_report(w, CORE_ERROR, "fmi2EnterInitializationMode: call fmi2SetupExperiment first"));
    w->r.phase = P_INITIALIZATION;
    w->r.initialised = 0;
    LEAVE(CORE_OK);
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    CoreStatus status = CORE_OK;
    ENTER(F_EXIT_INITIALIZATION);
    TRY(wrapper_ready(w));
    w->r.phase = w->r.kind == CO_SIMULATION ? P_STEP : P_EVENT;
    w->r.event_done = 0;
    LEAVE(status);
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    ENTER(F_TERMINATE);
    w->r.phase = P_TERMINATED;
    LEAVE(CORE_OK);
}

fmi2Status fmi2Reset(fmi2Component c)
{
    ENTER(F_RESET);
    wrapper_reset(w);
    LEAVE(CORE_OK);
}

/* ---- variables ---- */

#define INTEGERS (TYPE_BIT(VT_INTEGER) | TYPE_BIT(VT_ENUMERATION))

#define GETTER(NAME, FUNCTION, TYPE, TYPES)                                                                                              \
    fmi2Status NAME(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, TYPE value[])                                            \
    {                                                                                                                                    \
        CoreStatus status = CORE_OK;                                                                                                     \
        ENTER(FUNCTION);                                                                                                                 \
        TRY(wrapper_check_array(w, FUNCTION, vr, value, nvr));                                                                           \
        TRY(wrapper_ready(w));                                                                                                           \
        for (size_t i = 0; i < nvr; i++) {                                                                                               \
            double x = 0.0;                                                                                                              \
            TRY(wrapper_check(w, FUNCTION, vr[i], TYPES));                                                                               \
            TRY(core_get(w->core, vr[i], &x));                                                                                           \
            value[i] = (TYPE)x;                                                                                                          \
        }                                                                                                                                \
        LEAVE(status);                                                                                                                   \
    }

#define SETTER(NAME, FUNCTION, TYPE, TYPES)                                                                                              \
    fmi2Status NAME(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const TYPE value[])                                      \
    {                                                                                                                                    \
        CoreStatus status = CORE_OK;                                                                                                     \
        ENTER(FUNCTION);                                                                                                                 \
        TRY(wrapper_check_array(w, FUNCTION, vr, value, nvr));                                                                           \
        for (size_t i = 0; i < nvr; i++)                                                                                                 \
            TRY(wrapper_check_set(w, FUNCTION, vr[i], TYPES, (double)value[i]));                                                         \
        for (size_t i = 0; i < nvr; i++)                                                                                                 \
            TRY(wrapper_set(w, vr[i], (double)value[i]));                                                                                \
        LEAVE(status);                                                                                                                   \
    }

GETTER(fmi2GetReal, F_GET_REAL, fmi2Real, TYPE_BIT(VT_REAL))
GETTER(fmi2GetInteger, F_GET_INTEGER, fmi2Integer, INTEGERS)
GETTER(fmi2GetBoolean, F_GET_BOOLEAN, fmi2Boolean, TYPE_BIT(VT_BOOLEAN))
SETTER(fmi2SetReal, F_SET_REAL, fmi2Real, TYPE_BIT(VT_REAL))
SETTER(fmi2SetInteger, F_SET_INTEGER, fmi2Integer, INTEGERS)
SETTER(fmi2SetBoolean, F_SET_BOOLEAN, fmi2Boolean, TYPE_BIT(VT_BOOLEAN))

/* A feature this FMU does not have: fine when nothing is asked of it. */
static fmi2Status absent(fmi2Component c, int function, size_t n, const char *what)
{
    ENTER(function);
    LEAVE(n ? wrapper_report(w, CORE_ERROR, "%s: this FMU has no %s", rules[function].name, what) : CORE_OK);
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2String value[])
{
    (void)vr, (void)value;
    return absent(c, F_GET_STRING, nvr, "String variables");
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2String value[])
{
    (void)vr, (void)value;
    return absent(c, F_SET_STRING, nvr, "String variables");
}

/* ---- FMU states and derivatives ---- */

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *FMUstate)
{
    ENTER(F_GET_STATE);
    LEAVE(wrapper_save(w, FMUstate));
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate FMUstate)
{
    ENTER(F_SET_STATE);
    LEAVE(wrapper_load(w, FMUstate));
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *FMUstate)
{
    ENTER(F_FREE_STATE);
    wrapper_free_state(FMUstate);
    LEAVE(CORE_OK);
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate FMUstate, size_t *size)
{
    ENTER(F_SERIALIZED_SIZE);
    LEAVE(wrapper_serialised_size(w, FMUstate, size));
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate FMUstate, fmi2Byte serializedState[], size_t size)
{
    ENTER(F_SERIALIZE);
    LEAVE(wrapper_serialise(w, FMUstate, serializedState, size));
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte serializedState[], size_t size, fmi2FMUstate *FMUstate)
{
    ENTER(F_DESERIALIZE);
    LEAVE(wrapper_deserialise(w, serializedState, size, FMUstate));
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference vUnknown_ref[], size_t nUnknown,
                                        const fmi2ValueReference vKnown_ref[], size_t nKnown, const fmi2Real dvKnown[],
                                        fmi2Real dvUnknown[])
{
    CoreStatus status = CORE_OK;
    ENTER(F_DIRECTIONAL);
    TRY(wrapper_check_array(w, F_DIRECTIONAL, vUnknown_ref, dvUnknown, nUnknown));
    TRY(wrapper_check_array(w, F_DIRECTIONAL, vKnown_ref, dvKnown, nKnown));
    for (size_t i = 0; i < nUnknown; i++)
        TRY(wrapper_check(w, F_DIRECTIONAL, vUnknown_ref[i], TYPE_BIT(VT_REAL)));
    for (size_t i = 0; i < nKnown; i++)
        TRY(wrapper_check(w, F_DIRECTIONAL, vKnown_ref[i], TYPE_BIT(VT_REAL)));
    TRY(wrapper_ready(w));
    TRY(core_directional(w->core, vUnknown_ref, nUnknown, vKnown_ref, nKnown, dvKnown, dvUnknown));
    LEAVE(status);
}

/* ---- model exchange ---- */

fmi2Status fmi2EnterEventMode(fmi2Component c)
{
    ENTER(F_ENTER_EVENT);
    w->r.phase = P_EVENT;
    w->r.event_done = 0;
    LEAVE(CORE_OK);
}

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *fmi2eventInfo)
{
    CoreStatus status = CORE_OK;
    EventInfo info = {0};
    ENTER(F_NEW_DISCRETE);
    TRY(wrapper_check_array(w, F_NEW_DISCRETE, w, fmi2eventInfo, 1));
    TRY(core_update_discrete(w->core, &info));
    w->r.event_done = !info.again;
    fmi2eventInfo->newDiscreteStatesNeeded = info.again != 0;
    fmi2eventInfo->terminateSimulation = info.terminate != 0;
    fmi2eventInfo->nominalsOfContinuousStatesChanged = info.nominals_changed != 0;
    fmi2eventInfo->valuesOfContinuousStatesChanged = info.states_changed != 0;
    fmi2eventInfo->nextEventTimeDefined = info.next_time_defined != 0;
    fmi2eventInfo->nextEventTime = info.next_time_defined ? info.next_time : 0.0;
    LEAVE(status);
}

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c)
{
    ENTER(F_ENTER_CONTINUOUS);
    if (!w->r.event_done)
        LEAVE(wrapper_report(w, CORE_ERROR, "fmi2EnterContinuousTimeMode: call fmi2NewDiscreteStates until newDiscreteStatesNeeded is false"));
    w->r.phase = P_CONTINUOUS;
    LEAVE(CORE_OK);
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean noSetFMUStatePriorToCurrentPoint, fmi2Boolean *enterEventMode,
                                       fmi2Boolean *terminateSimulation)
{
    CoreStatus status = CORE_OK;
    int event = 0;
    ENTER(F_COMPLETED_STEP);
    (void)noSetFMUStatePriorToCurrentPoint;
    TRY(wrapper_check_array(w, F_COMPLETED_STEP, terminateSimulation, enterEventMode, 1));
    TRY(core_completed_step(w->core, &event));
    *enterEventMode = event != 0;
    *terminateSimulation = fmi2False;
    LEAVE(status);
}

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time)
{
    ENTER(F_SET_TIME);
    if (!isfinite(time))
        LEAVE(wrapper_report(w, CORE_ERROR, "fmi2SetTime: time must be finite"));
    LEAVE(core_set_time(w->core, time));
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t nx)
{
    CoreStatus status = CORE_OK;
    ENTER(F_SET_STATES);
    TRY(wrapper_length(w, F_SET_STATES, x, nx, model_n_states));
    TRY(core_set_states(w->core, x));
    LEAVE(status);
}

#define VECTOR(NAME, FUNCTION, COUNT, CALL)                                                                                              \
    fmi2Status NAME(fmi2Component c, fmi2Real values[], size_t n)                                                                        \
    {                                                                                                                                    \
        CoreStatus status = CORE_OK;                                                                                                     \
        ENTER(FUNCTION);                                                                                                                 \
        TRY(wrapper_length(w, FUNCTION, values, n, COUNT));                                                                              \
        TRY(wrapper_ready(w));                                                                                                           \
        TRY(CALL);                                                                                                                       \
        LEAVE(status);                                                                                                                   \
    }

VECTOR(fmi2GetDerivatives, F_GET_DERIVATIVES, model_n_states, core_derivatives(w->core, values))
VECTOR(fmi2GetEventIndicators, F_GET_INDICATORS, model_n_indicators, core_indicators(w->core, values))
VECTOR(fmi2GetContinuousStates, F_GET_STATES, model_n_states, (core_get_states(w->core, values), CORE_OK))
VECTOR(fmi2GetNominalsOfContinuousStates, F_GET_NOMINALS, model_n_states, wrapper_nominals(w, values))

/* ---- co-simulation ---- */

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer order[],
                                       const fmi2Real value[])
{
    (void)vr, (void)order, (void)value;
    return absent(c, F_SET_INPUT_DERIVATIVES, nvr, "input interpolation (canInterpolateInputs is false)");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer order[],
                                        fmi2Real value[])
{
    (void)vr, (void)order, (void)value;
    return absent(c, F_GET_OUTPUT_DERIVATIVES, nvr, "output derivatives (maxOutputDerivativeOrder is 0)");
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real currentCommunicationPoint, fmi2Real communicationStepSize,
                      fmi2Boolean noSetFMUStatePriorToCurrentPoint)
{
    ENTER(F_DO_STEP);
    (void)noSetFMUStatePriorToCurrentPoint;
    w->r.step_status = wrapper_step(w, F_DO_STEP, currentCommunicationPoint, communicationStepSize);
    if (w->r.step_status == CORE_DISCARD)
        w->r.phase = P_STEP_FAILED;
    LEAVE((CoreStatus)w->r.step_status);
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
    ENTER(F_CANCEL_STEP);
    LEAVE(CORE_ERROR);
}

static fmi2Status unknown_status(Wrapper *w, int function, const void *value)
{
    if (!value)
        LEAVE(wrapper_report(w, CORE_ERROR, "%s: no place given to store the status", rules[function].name));
    LEAVE(wrapper_report(w, CORE_DISCARD, "%s: this status is not available", rules[function].name));
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind s, fmi2Status *value)
{
    ENTER(F_GET_STATUS);
    if (s != fmi2DoStepStatus || !value)
        return unknown_status(w, F_GET_STATUS, value);
    *value = (fmi2Status)w->r.step_status;
    LEAVE(CORE_OK);
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind s, fmi2Real *value)
{
    ENTER(F_GET_REAL_STATUS);
    if (s != fmi2LastSuccessfulTime || !value)
        return unknown_status(w, F_GET_REAL_STATUS, value);
    *value = core_time(w->core);
    LEAVE(CORE_OK);
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind s, fmi2Integer *value)
{
    ENTER(F_GET_INTEGER_STATUS);
    (void)s;
    return unknown_status(w, F_GET_INTEGER_STATUS, value);
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind s, fmi2Boolean *value)
{
    ENTER(F_GET_BOOLEAN_STATUS);
    if (s != fmi2Terminated || !value)
        return unknown_status(w, F_GET_BOOLEAN_STATUS, value);
    *value = fmi2False;
    LEAVE(CORE_OK);
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind s, fmi2String *value)
{
    ENTER(F_GET_STRING_STATUS);
    (void)s;
    return unknown_status(w, F_GET_STRING_STATUS, value);
}
