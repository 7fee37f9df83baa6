/* Runs a compiled model and counts its internal steps; used by stiff.py. */
#include "core.h"
#include <string.h>

#ifdef _WIN32
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED __attribute__((visibility("default")))
#endif

static void log_into(void *environment, CoreStatus status, const char *category, const char *message) {
    (void)status, (void)category;
    strncpy(environment, message, 255);
}

/* States at times[0..n-1], row by row; settings: references and values of two parameters; said: 256 bytes for the last message. */
EXPORTED int run_counted(const unsigned *setting, const double *value, int n, const double *times, double *states, unsigned long *steps,
                         char *said) {
    Instance *s = core_new(log_into, said);
    int failed = !s;
    for (int i = 0; i < 2 && !failed; i++) failed = core_set(s, setting[i], value[i]) > CORE_WARNING;
    failed = failed || core_initialise(s, times[0]) > CORE_WARNING;
    for (int k = 0; k < n && !failed; k++) {
        if (k > 0) failed = core_step(s, times[k - 1], times[k] - times[k - 1]) > CORE_WARNING;
        core_get_states(s, states + k * model_n_states);
    }
    if (s) *steps = core_taken(s);
    core_free(s);
    return failed;
}
