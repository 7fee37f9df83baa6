/* The FMU's own sources with a counter at each call that the solver makes of the model; see step_profile.py. */
#include "model.h"
#include "wrapper.h"
#include "fmi2Functions.h"
#include <stdint.h>
#include <time.h>

enum { RATES, OUTPUTS, CONDITIONS, UPDATES, DELAYS, CHECK, N_COUNTS };
static int64_t counts[N_COUNTS];

#define COUNTED(NAME, INDEX, PARAMETERS, ARGUMENTS)                                                                                      \
    static void counted_##NAME PARAMETERS {                                                                                              \
        counts[INDEX]++;                                                                                                                 \
        model_##NAME ARGUMENTS;                                                                                                          \
    }
COUNTED(rates, RATES, (const ModelData *q, double *dx, double *z), (q, dx, z))
COUNTED(outputs, OUTPUTS, (const ModelData *q, double *y), (q, y))
COUNTED(conditions, CONDITIONS, (const ModelData *q, double *c), (q, c))
COUNTED(updates, UPDATES, (const ModelData *q, double *d, double *x), (q, d, x))
COUNTED(delays, DELAYS, (const ModelData *q, double *value, double *delay, double *maximum), (q, value, delay, maximum))
COUNTED(check, CHECK, (const ModelData *q, double *ok), (q, ok))
#define model_rates counted_rates
#define model_outputs counted_outputs
#define model_conditions counted_conditions
#define model_updates counted_updates
#define model_delays counted_delays
#define model_check counted_check
#include "core.c"
#undef model_rates
#undef model_outputs
#undef model_conditions
#undef model_updates
#undef model_delays
#undef model_check

#define EXPORTED __attribute__((visibility("default")))

EXPORTED void profile_counts(int64_t *to) {
    for (int i = 0; i < N_COUNTS; i++) to[i] = counts[i], counts[i] = 0;
}

/* CPU seconds of n calls in the instance's present state: RATES .. CHECK, then fmi2GetReal and fmi2SetReal of n_references values. */
EXPORTED double profile_seconds(Wrapper *w, int what, int64_t n, const unsigned *references, size_t n_references, double *values) {
    static double a[4096], b[4096], c[4096]; /* larger than any of the model's arrays */
    const ModelData *q = &w->core->c.q;
    const clock_t start = clock();
    for (int64_t k = 0; k < n; k++) {
        switch (what) {
        case RATES: model_rates(q, a, b); break;
        case OUTPUTS: model_outputs(q, a); break;
        case CONDITIONS: model_conditions(q, a); break;
        case UPDATES: model_updates(q, a, b); break;
        case DELAYS: model_delays(q, a, b, c); break;
        case CHECK: model_check(q, a); break;
        case N_COUNTS: fmi2GetReal(w, references, n_references, values); break;
        default: fmi2SetReal(w, references, n_references, values);
        }
    }
    return (double)(clock() - start) / CLOCKS_PER_SEC;
}

/* CPU seconds of n steps with recorded commands, outputs read each step: what the loop asks of the FMU and nothing else. */
EXPORTED double profile_steps(Wrapper *w, int64_t n, const unsigned *inputs, const double *commands, const unsigned *outputs, size_t n_outputs) {
    double y[64];
    const clock_t start = clock();
    for (int64_t k = 0; k < n; k++) {
        fmi2GetReal(w, outputs, n_outputs, y);
        fmi2SetReal(w, inputs, 2, commands + 2 * k);
        if (fmi2DoStep(w, k * 1e-3, 1e-3, 1) > 1) return -1;
    }
    return (double)(clock() - start) / CLOCKS_PER_SEC;
}
