/* What both wrappers share; its interface and its rules stand in wrapper.h. */
#include "wrapper.h"

#include <math.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmu_config.h"

static const char *const log_categories[] = {"logEvents", "logStatusWarning", "logStatusDiscard", "logStatusError", "logStatusFatal"};
static const unsigned status_category[] = {L_EVENTS, L_WARNING, L_DISCARD, L_ERROR, L_FATAL};
static const double nominals[] = FMU_NOMINALS;
enum { N_CATEGORIES = sizeof log_categories / sizeof log_categories[0] };

/* ---- logging ---- */

static const char *category_name(unsigned bit)
{
    int i = 0;
    while (bit >>= 1)
        i++;
    return log_categories[i];
}

static unsigned category_bit(const char *name)
{
    if (strcmp(name, "logAll") == 0)
        return L_ALL;
    for (int i = 0; i < N_CATEGORIES; i++)
        if (strcmp(name, log_categories[i]) == 0)
            return 1u << i;
    return 0;
}

static void deliver(Wrapper *w, CoreStatus status, unsigned category, const char *message)
{
    if (w->log_mask & category)
        w->emit(w, status, category_name(category), message);
}

static void core_message(void *environment, CoreStatus status, const char *category, const char *message)
{
    unsigned bit = category ? category_bit(category) : 0;
    if (bit == 0 || bit == L_ALL)
        bit = status_category[status];
    deliver(environment, status, bit, message);
}

CoreStatus wrapper_report(Wrapper *w, CoreStatus status, const char *format, ...)
{
    char message[1024];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    deliver(w, status, status_category[status], message);
    return status;
}

int wrapper_categories(Wrapper *w, const char *const names[], size_t n, unsigned *mask)
{
    *mask = n ? 0 : L_ALL;
    for (size_t i = 0; i < n; i++) {
        const unsigned bit = names && names[i] ? category_bit(names[i]) : 0;
        if (!bit) {
            wrapper_report(w, CORE_ERROR, "unknown log category %s", names && names[i] ? names[i] : "NULL");
            return 0;
        }
        *mask |= bit;
    }
    return 1;
}

/* ---- life cycle and calls ---- */

int wrapper_open(Wrapper *w, InterfaceKind kind, const char *name, const char *token)
{
    w->r.kind = kind;
    if (!name || name[strspn(name, " \t\r\n")] == '\0') {
        wrapper_report(w, CORE_ERROR, "instantiation failed: the instance name is empty");
        return 0;
    }
    if (!token || strcmp(token, FMU_TOKEN) != 0) {
        wrapper_report(w, CORE_ERROR, "instantiation failed: token %.200s does not match this binary (%s); use the modelDescription.xml "
                       "of the same FMU", token ? token : "NULL", FMU_TOKEN);
        return 0;
    }
    w->core = core_new(core_message, w);
    w->name = malloc(strlen(name) + 1);
    w->states = calloc(model_n_states + 1, sizeof *w->states);
    w->indicators = calloc(model_n_indicators + 1, sizeof *w->indicators);
    if (!w->core || !w->name || !w->states || !w->indicators) {
        wrapper_report(w, CORE_ERROR, "instantiation failed: out of memory");
        return 0;
    }
    strcpy(w->name, name);
    wrapper_reset(w);
    return 1;
}

void wrapper_close(Wrapper *w)
{
    if (w->core)
        core_free(w->core);
    free(w->name);
    free(w->states);
    free(w->indicators);
    free(w->before);
}

void wrapper_reset(Wrapper *w)
{
    const int kind = w->r.kind;
    memset(&w->r, 0, sizeof w->r);
    w->r.kind = kind;
    w->r.phase = P_INSTANTIATED;
    core_reset(w->core);
}

static const char *phase_name(unsigned phase, int kind)
{
    switch (phase) {
    case P_INSTANTIATED: return "Instantiated";
    case P_INITIALIZATION: return "Initialization Mode";
    case P_EVENT: return "Event Mode";
    case P_CONTINUOUS: return "Continuous-Time Mode";
    case P_STEP: return kind == CO_SIMULATION ? "Step Mode" : "?";
    case P_STEP_FAILED: return "Step Failed";
    case P_TERMINATED: return "Terminated";
    case P_ERROR: return "Error";
    default: return "Fatal";
    }
}

static CoreStatus illegal(Wrapper *w, int function)
{
    const FunctionRule *rule = &w->rules[function];
    const unsigned legal = rule->legal[w->r.kind];
    char list[200] = "";
    for (unsigned phase = 1; phase < P_ERROR; phase <<= 1)
        if (legal & phase)
            snprintf(list + strlen(list), sizeof list - strlen(list), "%s%s", *list ? ", " : "", phase_name(phase, w->r.kind));
    if (!legal)
        return wrapper_report(w, CORE_ERROR, "%s is not available in this %s FMU", rule->name,
                              w->r.kind == CO_SIMULATION ? "co-simulation" : "model exchange");
    return wrapper_report(w, CORE_ERROR, "%s is illegal in state %s; legal in: %s", rule->name,
                          phase_name((unsigned)w->r.phase, w->r.kind), list);
}

int wrapper_enter(Wrapper *w, int function)
{
    if (w->rules[function].legal[w->r.kind] & (unsigned)w->r.phase)
        return 1;
    if (w->r.phase != P_FATAL)
        wrapper_done(w, illegal(w, function));
    return 0;
}

CoreStatus wrapper_done(Wrapper *w, CoreStatus status)
{
    if (status == CORE_ERROR)
        w->r.phase = w->error_phase;
    if (status == CORE_FATAL)
        w->r.phase = P_FATAL;
    return status;
}

static CoreStatus out_of_memory(Wrapper *w, uint64_t size)
{
    return wrapper_report(w, CORE_ERROR, "out of memory for an FMU state of %lu bytes", (unsigned long)size);
}

static int resize_before(Wrapper *w, size_t size)
{
    void *bytes = size <= w->before_size ? w->before : realloc(w->before, size);
    if (!bytes)
        return 0;
    w->before = bytes;
    w->before_size = size;
    return 1;
}

CoreStatus wrapper_ready(Wrapper *w)
{
    CoreStatus status;
    if (w->r.phase != P_INITIALIZATION || w->r.initialised)
        return CORE_OK;
    if (!resize_before(w, core_snapshot_size(w->core)))
        return out_of_memory(w, core_snapshot_size(w->core));
    core_save(w->core, w->before);
    status = core_initialise(w->core, w->r.start_time);
    w->r.initialised = status < CORE_DISCARD;
    return status == CORE_DISCARD ? CORE_ERROR : status;
}

/* ---- variables ---- */

static const char *type_name(unsigned type)
{
    static const char *const names[] = {"Real", "Integer", "Boolean", "Enumeration"};
    return names[type];
}

CoreStatus wrapper_check_array(Wrapper *w, int function, const void *references, const void *values, size_t n)
{
    if (n == 0 || (references && values))
        return CORE_OK;
    return wrapper_report(w, CORE_ERROR, "%s: %s is NULL", w->rules[function].name, references ? "value array" : "value reference array");
}

CoreStatus wrapper_check(Wrapper *w, int function, unsigned reference, unsigned types)
{
    if (reference >= model_n_variables)
        return wrapper_report(w, CORE_ERROR, "%s: value reference %u does not exist; the last one is %lu", w->rules[function].name,
                              reference, (unsigned long)model_n_variables - 1);
    if (!(TYPE_BIT(model_variables[reference].type) & types))
        return wrapper_report(w, CORE_ERROR, "%s: %s (value reference %u) is of type %s", w->rules[function].name,
                              model_variables[reference].name, reference, type_name(model_variables[reference].type));
    return CORE_OK;
}

static unsigned variable_class(const ModelVariable *v)
{
    switch (v->kind) {
    case VK_INPUT: return v->type == VT_REAL ? V_INPUT_REAL : V_INPUT_OTHER;
    case VK_STATE: return (v->settable != SET_NEVER ? V_START : 0u) | (model_n_indicators ? V_STATE_REINIT : V_STATE);
    default: return v->settable == SET_ALWAYS ? V_TUNABLE : v->settable == SET_BEFORE_START ? V_FIXED : 0u;
    }
}

CoreStatus wrapper_check_set(Wrapper *w, int function, unsigned reference, unsigned types, double value)
{
    const char *name = w->rules[function].name;
    const ModelVariable *v;
    CoreStatus status = wrapper_check(w, function, reference, types);
    if (status != CORE_OK)
        return status;
    v = &model_variables[reference];
    if (!(variable_class(v) & w->settable((unsigned)w->r.phase)))
        return wrapper_report(w, CORE_ERROR, "%s: %s may not be set in state %s", name, v->name,
                              phase_name((unsigned)w->r.phase, w->r.kind));
    if (!isfinite(value) || value < v->min || value > v->max)
        return wrapper_report(w, CORE_DISCARD, "%s: %s = %.17g is refused: it must be a finite value within [%.17g, %.17g]", name, v->name,
                              value, v->min, v->max);
    if (v->type == VT_BOOLEAN && value != 0.0 && value != 1.0)
        return wrapper_report(w, CORE_DISCARD, "%s: %s = %g is refused: a Boolean is 0 or 1", name, v->name, value);
    return CORE_OK;
}

static CoreStatus set_state(Wrapper *w, int index, double value)
{
    core_get_states(w->core, w->states);
    w->states[index] = value;
    return core_set_states(w->core, w->states);
}

CoreStatus wrapper_set(Wrapper *w, unsigned reference, double value)
{
    const ModelVariable *v = &model_variables[reference];
    if (v->kind == VK_STATE && (w->r.phase & (P_EVENT | P_CONTINUOUS)))
        return set_state(w, v->index, value);
    if (w->r.initialised && w->r.phase == P_INITIALIZATION) {
        const CoreStatus status = core_load(w->core, w->before, w->before_size);
        if (status >= CORE_DISCARD)
            return status;
        w->r.initialised = 0;
    }
    return core_set(w->core, reference, value);
}

CoreStatus wrapper_length(Wrapper *w, int function, const void *values, size_t got, size_t expected)
{
    if (got != expected)
        return wrapper_report(w, CORE_ERROR, "%s: %lu values given, %lu expected", w->rules[function].name, (unsigned long)got,
                              (unsigned long)expected);
    if (expected && !values)
        return wrapper_report(w, CORE_ERROR, "%s: value array is NULL", w->rules[function].name);
    return CORE_OK;
}

CoreStatus wrapper_nominals(Wrapper *w, double *values)
{
    (void)w;
    for (size_t i = 0; i < model_n_states; i++)
        values[i] = nominals[i];
    return CORE_OK;
}

/* ---- co-simulation step ---- */

static double tolerance(double time) { return 1e-9 * fmax(1.0, fabs(time)); }

CoreStatus wrapper_step(Wrapper *w, int function, double time, double step)
{
    const char *name = w->rules[function].name;
    const double now = core_time(w->core);
    if (!isfinite(step) || step <= 0.0)
        return wrapper_report(w, CORE_ERROR, "%s: communication step size %.17g s must be finite and > 0", name, step);
    if (!(fabs(time - now) <= tolerance(now)))
        return wrapper_report(w, CORE_ERROR, "%s: current communication point %.17g s given, the FMU is at %.17g s", name, time, now);
    if (w->r.stop_defined && time + step > w->r.stop_time + tolerance(w->r.stop_time))
        return wrapper_report(w, CORE_ERROR, "%s: a step to %.17g s passes the stop time %.17g s", name, time + step, w->r.stop_time);
    return core_step(w->core, time, step);
}

/* ---- FMU states ---- */

typedef struct {
    char magic[8];
    uint64_t build, checksum, size, core_size, before_size; /* bytes: header, core snapshot, snapshot before initialisation */
    Record record;
} Snapshot;

static uint64_t fnv(uint64_t hash, const void *bytes, size_t n)
{
    const unsigned char *b = bytes;
    for (size_t i = 0; i < n; i++)
        hash = (hash ^ b[i]) * UINT64_C(1099511628211);
    return hash;
}

/* Everything but the header's own checksum field. */
static uint64_t checksum_of(const Snapshot *s)
{
    Snapshot header = *s;
    header.checksum = 0;
    return fnv(fnv(UINT64_C(14695981039346656037), &header, sizeof header), s + 1, s->size - sizeof *s);
}

static const char snapshot_magic[8] = "PGstate";

static int is_snapshot(const Snapshot *s)
{
    return memcmp(s->magic, snapshot_magic, sizeof s->magic) == 0 && s->build == FMU_BUILD && s->core_size < s->size &&
           s->before_size < s->size && s->size == sizeof *s + s->core_size + s->before_size;
}

static const Snapshot *expect_snapshot(Wrapper *w, const void *state)
{
    if (state && is_snapshot(state))
        return state;
    wrapper_report(w, CORE_ERROR, state ? "the FMU state is not one of this FMU" : "the FMU state is NULL");
    return NULL;
}

CoreStatus wrapper_save(Wrapper *w, void **state)
{
    const size_t core_size = core_snapshot_size(w->core);
    const size_t before_size = w->r.phase == P_INITIALIZATION && w->r.initialised ? w->before_size : 0;
    const size_t size = sizeof(Snapshot) + core_size + before_size;
    Snapshot *s;
    if (!state)
        return wrapper_report(w, CORE_ERROR, "no place given to store the FMU state");
    if (*state && !expect_snapshot(w, *state))
        return CORE_ERROR;
    s = *state;
    if (!s || s->size < size)
        s = realloc(s, size);
    if (!s)
        return out_of_memory(w, size);
    *state = s;
    memset(s, 0, sizeof *s); /* no undefined padding in serialised states */
    memcpy(s->magic, snapshot_magic, sizeof s->magic);
    s->build = FMU_BUILD;
    s->size = size;
    s->core_size = core_size;
    s->before_size = before_size;
    s->record = w->r;
    core_save(w->core, s + 1);
    if (before_size)
        memcpy((char *)(s + 1) + core_size, w->before, before_size);
    return CORE_OK;
}

CoreStatus wrapper_load(Wrapper *w, const void *state)
{
    const Snapshot *s = expect_snapshot(w, state);
    CoreStatus status;
    if (!s)
        return CORE_ERROR;
    if (s->record.kind != w->r.kind)
        return wrapper_report(w, CORE_ERROR, "the FMU state is one of a %s instance", s->record.kind == CO_SIMULATION ? "co-simulation" : "model exchange");
    if (s->before_size && !resize_before(w, s->before_size))
        return out_of_memory(w, s->before_size);
    status = core_load(w->core, s + 1, s->core_size);
    if (status >= CORE_DISCARD)
        return CORE_ERROR;
    if (s->before_size)
        memcpy(w->before, (const char *)(s + 1) + s->core_size, s->before_size);
    w->r = s->record;
    return status;
}

void wrapper_free_state(void **state)
{
    if (state) {
        free(*state);
        *state = NULL;
    }
}

CoreStatus wrapper_serialised_size(Wrapper *w, const void *state, size_t *size)
{
    const Snapshot *s = expect_snapshot(w, state);
    if (!s)
        return CORE_ERROR;
    if (!size)
        return wrapper_report(w, CORE_ERROR, "no place given to store the size of the FMU state");
    *size = (size_t)s->size;
    return CORE_OK;
}

CoreStatus wrapper_serialise(Wrapper *w, const void *state, void *bytes, size_t size)
{
    const Snapshot *s = expect_snapshot(w, state);
    Snapshot header;
    if (!s)
        return CORE_ERROR;
    if (!bytes || size < s->size)
        return wrapper_report(w, CORE_ERROR, "%lu bytes given for a serialised FMU state of %lu bytes", bytes ? (unsigned long)size : 0ul,
                              (unsigned long)s->size);
    header = *s;
    header.checksum = checksum_of(s);
    memcpy(bytes, s, s->size);
    memcpy((char *)bytes + offsetof(Snapshot, checksum), &header.checksum, sizeof header.checksum);
    return CORE_OK;
}

CoreStatus wrapper_deserialise(Wrapper *w, const void *bytes, size_t size, void **state)
{
    Snapshot header;
    Snapshot *s;
    if (!bytes || !state)
        return wrapper_report(w, CORE_ERROR, "no serialised FMU state or no place to store the FMU state");
    if (size < sizeof header)
        return wrapper_report(w, CORE_ERROR, "the serialised FMU state is truncated");
    memcpy(&header, bytes, sizeof header);
    if (header.size != size || !is_snapshot(&header))
        return wrapper_report(w, CORE_ERROR, "the serialised FMU state is truncated or from another build of the FMU");
    s = malloc(size);
    if (!s)
        return out_of_memory(w, size);
    memcpy(s, bytes, size);
    if (checksum_of(s) != header.checksum) {
        free(s);
        return wrapper_report(w, CORE_ERROR, "the serialised FMU state is damaged");
    }
    s->checksum = 0;
    if (*state)
        free(*state);
    *state = s;
    return CORE_OK;
}
