/* Many runs of a model over one record, in one call: parameters differ from run to run, inputs and corrections are shared.
 *
 * Row k holds the values at k * period. Between rows the inputs are held. Outputs are read at the rows; then a state may be drawn
 * towards a measured value by a fixed share (an observer): outputs are predictions. Calls are independent: several threads may run at
 * once.
 */
#include "model.h"
#include <math.h>
#include <stdlib.h>

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED __attribute__((visibility("default")))
#endif

/* Internal steps that a run may take, at first and for each row: one that chatters would cost as much as thousands that do not. */
#define STEPS_AT_FIRST 2000
#define STEPS_PER_ROW 100

typedef struct {
    size_t n_runs, n_parameters, n_rows, n_inputs, n_corrected, n_outputs;
    double period;             /* s */
    const unsigned *parameters; /* value references */
    const double *values;      /* [n_runs][n_parameters] */
    const unsigned *inputs;
    const double *at;          /* [n_rows][n_inputs], at the rows */
    const double *over;        /* [n_rows][n_inputs], over the period behind each row */
    const unsigned *corrected; /* states */
    const double *measured;    /* [n_rows][n_corrected]; NaN: no correction */
    const double *gains;       /* [n_corrected], share of the difference that is taken away per period */
    const unsigned *outputs;
    double *result;            /* [n_runs][n_rows][n_outputs]; NaN behind a failure */
} Batch;

static int set_all(Instance *s, size_t n, const unsigned *references, const double *values) {
    for (size_t i = 0; i < n; i++)
        if (core_set(s, references[i], values[i]) > CORE_WARNING) return 0;
    return 1;
}

static int read_all(Instance *s, const Batch *b, double *row) {
    for (size_t i = 0; i < b->n_outputs; i++)
        if (core_get(s, b->outputs[i], row + i) > CORE_WARNING || !isfinite(row[i])) return 0;
    return 1;
}

/* Draws the corrected states of row k towards their measured values. `index`: of each among the states. */
static int correct(Instance *s, const Batch *b, const size_t *index, size_t k, double *x) {
    if (b->n_corrected == 0) return 1;
    core_get_states(s, x);
    for (size_t i = 0; i < b->n_corrected; i++) {
        double to = b->measured[k * b->n_corrected + i];
        if (isfinite(to)) x[index[i]] += b->gains[i] * (to - x[index[i]]);
    }
    return core_set_states(s, x) <= CORE_WARNING;
}

static int one_run(Instance *s, const Batch *b, size_t run, const size_t *index, double *x) {
    double *result = b->result + run * b->n_rows * b->n_outputs;
    size_t k = 0;
    int same = b->at == b->over;
    int good = set_all(s, b->n_parameters, b->parameters, b->values + run * b->n_parameters) && set_all(s, b->n_inputs, b->inputs, b->at)
               && core_initialise(s, 0.0) <= CORE_WARNING;
    for (; good && k < b->n_rows; k++) {
        double time = (double)k * b->period;
        if (k > 0 || !same) good = set_all(s, b->n_inputs, b->inputs, b->at + k * b->n_inputs);
        good = good && core_step(s, time, 0.0) <= CORE_WARNING; /* events that the new inputs bring */
        if (!good || !read_all(s, b, result + k * b->n_outputs)) break;
        if (N_STATES == 0 || k + 1 == b->n_rows) continue;
        if (!same) good = set_all(s, b->n_inputs, b->inputs, b->over + k * b->n_inputs);
        good = good && correct(s, b, index, k, x) && core_step(s, time, b->period) <= CORE_WARNING;
        good = good && core_taken(s) < STEPS_AT_FIRST + STEPS_PER_ROW * (k + 1);
    }
    for (size_t i = k * b->n_outputs; i < b->n_rows * b->n_outputs; i++) result[i] = NAN;
    return k == b->n_rows;
}

/* Returns how many runs failed; -1: out of memory or a corrected variable that is no state. */
EXPORTED int batch_run(const Batch *b) {
    int failed = 0;
    size_t index[AT_LEAST_1(N_STATES)];
    double x[AT_LEAST_1(N_STATES)];
    for (size_t i = 0; i < b->n_corrected; i++) {
        size_t j = 0;
        while (j < model_n_states && model_state_references[j] != b->corrected[i]) j++;
        if (j == model_n_states || b->n_corrected > model_n_states) return -1;
        index[i] = j;
    }
    Instance *s = core_new(NULL, NULL);
    if (!s) return -1;
    for (size_t run = 0; run < b->n_runs; run++) {
        core_reset(s);
        failed += !one_run(s, b, run, index, x);
    }
    core_free(s);
    return failed;
}
