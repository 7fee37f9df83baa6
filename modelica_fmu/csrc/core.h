/* The simulation core of a compiled model: what the FMI 2.0 and FMI 3.0 wrappers call.
 *
 * One Instance holds everything; there are no globals, so instances are independent. Every value is a double here (Boolean 0/1,
 * Integer and enumeration exact); a value reference is an index into model_variables[]. Functions that can fail return a
 * CoreStatus; the message has then gone through the instance's logger.
 */
#ifndef MODELICA_FMU_CORE_H
#define MODELICA_FMU_CORE_H

#include <stddef.h>

typedef enum { CORE_OK, CORE_WARNING, CORE_DISCARD, CORE_ERROR, CORE_FATAL } CoreStatus;
typedef enum { VK_TIME, VK_PARAMETER, VK_CALCULATED, VK_INPUT, VK_STATE, VK_DERIVATIVE, VK_ALGEBRAIC, VK_DISCRETE } VariableKind;
typedef enum { VT_REAL, VT_INTEGER, VT_BOOLEAN, VT_ENUMERATION } VariableType;
typedef enum { SET_NEVER, SET_BEFORE_START, SET_ALWAYS } Settable; /* before start: fixed parameters */

typedef struct {
    const char *name;
    unsigned char kind, type, settable;
    int index; /* into the array of its kind */
    double min, max; /* bounds, both included */
} ModelVariable;

/* Constants of the generated model (generated model.c defines them). */
extern const char model_name[];
extern const ModelVariable model_variables[];
extern const size_t model_n_variables, model_n_states, model_n_indicators;
extern const unsigned model_state_references[], model_derivative_references[];

typedef struct Instance Instance;
typedef void (*CoreLog)(void *environment, CoreStatus status, const char *category, const char *message);

Instance *core_new(CoreLog log, void *environment); /* NULL: out of memory */
void core_free(Instance *s);
void core_reset(Instance *s); /* start values of a fresh instance */

/* Any time after core_new. core_set refuses NaN, infinities and values out of bounds (CORE_ERROR, old value kept). `started` decides
 * whether SET_BEFORE_START variables are still settable; the wrapper enforces finer rules of its standard. */
CoreStatus core_set(Instance *s, unsigned reference, double value);
CoreStatus core_get(Instance *s, unsigned reference, double *value);

/* Initialisation: dependent parameters, initial states, initial modes (a fixed point of the event iteration). */
CoreStatus core_initialise(Instance *s, double start_time);

/* Co-simulation: advances from the current time to `time + step`, locating events on the way. CORE_ERROR: the state is that of the
 * last good internal step and core_time tells how far it came. */
CoreStatus core_step(Instance *s, double time, double step);
double core_time(const Instance *s);
unsigned long core_taken(const Instance *s); /* internal steps since core_reset */

/* Model exchange. */
CoreStatus core_set_time(Instance *s, double time);
CoreStatus core_set_states(Instance *s, const double *x);
void core_get_states(Instance *s, double *x);
CoreStatus core_derivatives(Instance *s, double *dx);
CoreStatus core_indicators(Instance *s, double *z);
typedef struct { int states_changed, nominals_changed, terminate, next_time_defined, again; double next_time; } EventInfo;
CoreStatus core_update_discrete(Instance *s, EventInfo *info); /* one full event iteration; `again` is then 0 */
CoreStatus core_completed_step(Instance *s, int *enter_event_mode);

/* Directional derivative: out[i] = sum_j d unknown_i / d known_j * seed[j]; unknowns: derivatives, algebraics, outputs;
 * knowns: states, inputs, parameters (tunable or fixed: real ones). */
CoreStatus core_directional(Instance *s, const unsigned *unknown, size_t n_unknown, const unsigned *known, size_t n_known,
                            const double *seed, double *out);

/* Snapshot of everything that influences the future (bytes; same build only). */
size_t core_snapshot_size(const Instance *s);
void core_save(const Instance *s, void *bytes);
CoreStatus core_load(Instance *s, const void *bytes, size_t size); /* refuses a foreign or damaged snapshot */

#endif
