/* What the FMI 2.0 and the FMI 3.0 wrapper share: phases and the table of legal calls, variable access, FMU states, logging.
 *
 * fmu_config.h (written by package.py) defines FMU_TOKEN, the string that modelDescription.xml carries, FMU_BUILD, its
 * 64-bit hash, and FMU_NOMINALS, the initialiser of the nominal values of the continuous states.
 */
#ifndef MODELICA_FMU_WRAPPER_H
#define MODELICA_FMU_WRAPPER_H

#include "core.h"

/* Phases of the standards' state machines, as bits so that a table can list the legal ones. */
enum {
    P_INSTANTIATED = 1, P_INITIALIZATION = 2, P_EVENT = 4, P_CONTINUOUS = 8, P_STEP = 16, P_STEP_FAILED = 32, P_TERMINATED = 64,
    P_ERROR = 128, P_FATAL = 256,
    P_ANY = 255 /* but fatal */
};
typedef enum { MODEL_EXCHANGE, CO_SIMULATION } InterfaceKind;

/* Log categories, as bits; `log_categories` holds their names in this order. */
enum { L_EVENTS = 1, L_WARNING = 2, L_DISCARD = 4, L_ERROR = 8, L_FATAL = 16, L_ALL = 31, L_BASE = L_WARNING | L_ERROR | L_FATAL };

/* Classes of settable variables, as bits so that a table can list those a phase allows. */
enum {
    V_INPUT_REAL = 1, V_INPUT_OTHER = 2, V_TUNABLE = 4, V_FIXED = 8, V_START = 16 /* start value of a state */,
    V_STATE = 32 /* current value of a state */, V_STATE_REINIT = 64 /* the same of a state that events may change */,
    V_INPUT = V_INPUT_REAL | V_INPUT_OTHER
};

typedef struct {
    const char *name;
    unsigned legal[2]; /* phases, by InterfaceKind; 0: never */
} FunctionRule;

/* The wrapper's own part of an FMU state. */
typedef struct {
    int phase, kind, initialised, setup, stop_defined, event_done, step_status;
    double start_time, stop_time;
} Record;

typedef struct Wrapper Wrapper;
struct Wrapper {
    Instance *core;
    const FunctionRule *rules;
    unsigned (*settable)(unsigned phase); /* classes of variables that may be set in a phase */
    void (*emit)(Wrapper *w, CoreStatus status, const char *category, const char *message);
    int error_phase; /* after an Error: P_ERROR (FMI 2.0) or P_TERMINATED (FMI 3.0) */
    unsigned log_mask;
    char *name;
    double *states, *indicators; /* scratch */
    void *before; /* snapshot of the core before its initialisation, valid while initialised in Initialization Mode */
    size_t before_size;
    Record r;
};

/* Life cycle. wrapper_open fills a zeroed wrapper; 0: refused, the reason logged. */
int wrapper_open(Wrapper *w, InterfaceKind kind, const char *name, const char *token);
void wrapper_close(Wrapper *w);
void wrapper_reset(Wrapper *w);

/* Calls: wrapper_enter refuses an illegal call (0, now in the error phase), wrapper_done moves to the error phase on an Error. */
int wrapper_enter(Wrapper *w, int function);
CoreStatus wrapper_done(Wrapper *w, CoreStatus status);
CoreStatus wrapper_report(Wrapper *w, CoreStatus status, const char *format, ...); /* logs, returns `status` */
int wrapper_categories(Wrapper *w, const char *const names[], size_t n, unsigned *mask); /* 0: an unknown name, logged */

/* Initialization Mode is lazy: the core is initialised at the first call that needs results, and again after further sets. */
CoreStatus wrapper_ready(Wrapper *w);

/* Variables. Checks: reference, type, phase, value; a refused value is a Discard and leaves everything as it was. */
CoreStatus wrapper_check_array(Wrapper *w, int function, const void *references, const void *values, size_t n);
CoreStatus wrapper_check(Wrapper *w, int function, unsigned reference, unsigned types);
CoreStatus wrapper_check_set(Wrapper *w, int function, unsigned reference, unsigned types, double value);
CoreStatus wrapper_set(Wrapper *w, unsigned reference, double value);
CoreStatus wrapper_nominals(Wrapper *w, double *nominals);
CoreStatus wrapper_length(Wrapper *w, int function, const void *values, size_t got, size_t expected);

/* Co-simulation step: checks time, step and stop time, then advances the core. */
CoreStatus wrapper_step(Wrapper *w, int function, double time, double step);

/* FMU states. */
CoreStatus wrapper_save(Wrapper *w, void **state);
CoreStatus wrapper_load(Wrapper *w, const void *state);
void wrapper_free_state(void **state);
CoreStatus wrapper_serialised_size(Wrapper *w, const void *state, size_t *size);
CoreStatus wrapper_serialise(Wrapper *w, const void *state, void *bytes, size_t size);
CoreStatus wrapper_deserialise(Wrapper *w, const void *bytes, size_t size, void **state);

#define TYPE_BIT(type) (1u << (type))

#endif
