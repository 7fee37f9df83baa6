/* Many runs of a model over one record, in one call: parameters differ from run to run, inputs and corrections are shared.
 *
 * Row k holds the values at k * period. Between rows the inputs are held, each for one of n_parts equal parts of the row. Outputs are
 * read at the rows; then a state may be drawn towards a measured value by a fixed share (an observer): outputs are predictions. Calls
 * are independent: several threads may run at once.
 */
#include "core.c" /* in one piece with the driver: a row is short, and calls would be half of it */
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
    size_t n_runs, n_parameters, n_rows, n_parts, n_inputs, n_corrected, n_outputs;
    double period;             /* s */
    const unsigned *parameters; /* value references */
    const double *values;      /* [n_runs][n_parameters] */
    const unsigned *inputs;
    const double *at;          /* [n_rows][n_inputs], at the rows */
    const double *over;        /* [n_rows][n_parts][n_inputs], over the parts of the period behind each row */
    const unsigned *corrected; /* states */
    const double *measured;    /* [n_rows][n_corrected]; NaN: no correction */
    const double *gains;       /* [n_corrected], share of the difference that is taken away per period */
    const unsigned *outputs;
    double *result;            /* [n_runs][n_rows][n_outputs]; NaN behind a failure */
} Batch;

/* What one call finds out once: where things lie in an instance, and how far the inputs are sound. */
typedef struct {
    int place[AT_LEAST_1(N_INPUTS)];    /* of each input among the model's */
    size_t state[AT_LEAST_1(N_STATES)]; /* of each corrected state among the model's */
    size_t rows;                        /* rows until an input is out of its bounds */
    int same;                           /* inputs at the rows are those behind them */
    int plain;                          /* every output is a state, which inputs alone do not change */
} Plan;

static int set_all(Instance *s, size_t n, const unsigned *references, const double *values) {
    for (size_t i = 0; i < n; i++)
        if (core_set(s, references[i], values[i]) > CORE_WARNING) return 0;
    return 1;
}

static int sound(const Batch *b, const double *row) {
    for (size_t i = 0; i < b->n_inputs; i++) {
        const ModelVariable *v = &model_variables[b->inputs[i]];
        if (!(row[i] >= v->min && row[i] <= v->max && isfinite(row[i]))) return 0;
    }
    return 1;
}

static int sound_row(const Batch *b, size_t k) {
    int good = sound(b, b->at + k * b->n_inputs);
    for (size_t j = 0; good && j < b->n_parts; j++) good = sound(b, b->over + (k * b->n_parts + j) * b->n_inputs);
    return good;
}

/* Inputs that are sound; of those that are no numbers (a clamp) a change may bring an event. */
static void put_inputs(Instance *s, const Batch *b, const Plan *plan, const double *row) {
    for (size_t i = 0; i < b->n_inputs; i++) {
        double *to = &s->c.q.u[plan->place[i]];
        s->c.events_possible |= *to != row[i] && model_variables[b->inputs[i]].type != VT_REAL;
        *to = row[i];
    }
    invalidate(s);
}

static int switched(const Batch *b, size_t k) {
    const double *now = b->at + k * b->n_inputs, *before = now - b->n_inputs;
    for (size_t i = 0; i < b->n_inputs; i++)
        if (now[i] != before[i] && model_variables[b->inputs[i]].type != VT_REAL) return 1;
    return 0;
}

static int read_all(Instance *s, const Batch *b, double *row) {
    for (size_t i = 0; i < b->n_outputs; i++)
        if (core_get(s, b->outputs[i], row + i) > CORE_WARNING || !isfinite(row[i])) return 0;
    return 1;
}

/* Draws the corrected states of row k towards their measured values. */
static void correct(Instance *s, const Batch *b, const Plan *plan, size_t k) {
    for (size_t i = 0; i < b->n_corrected; i++) {
        double to = b->measured[k * b->n_corrected + i], *x = &s->c.q.x[plan->state[i]];
        if (isfinite(to)) *x += b->gains[i] * (to - *x);
    }
    invalidate(s);
}

/* From row k to the next; at once, where no input changes on the way. */
static int pass(Instance *s, const Batch *b, const Plan *plan, size_t k) {
    const double time = (double)k * b->period, part = b->period / (double)b->n_parts;
    const double *row = b->over + k * b->n_parts * b->n_inputs;
    int steady = 1;
    for (size_t j = 1; j < b->n_parts; j++) steady &= memcmp(row, row + j * b->n_inputs, b->n_inputs * sizeof *row) == 0;
    if (steady) return core_step(s, time, b->period) <= CORE_WARNING;
    for (size_t j = 0; j < b->n_parts; j++) {
        if (j > 0) put_inputs(s, b, plan, row + j * b->n_inputs);
        if (core_step(s, time + (double)j * part, part) > CORE_WARNING) return 0;
    }
    return 1;
}

static int one_run(Instance *s, const Batch *b, const Plan *plan, size_t run) {
    double *result = b->result + run * b->n_rows * b->n_outputs;
    size_t k = 0;
    int good = set_all(s, b->n_parameters, b->parameters, b->values + run * b->n_parameters);
    if (good && plan->rows > 0) put_inputs(s, b, plan, b->at);
    good = good && plan->rows > 0 && core_initialise(s, 0.0) <= CORE_WARNING;
    for (; good && k < plan->rows; k++) {
        const double time = (double)k * b->period;
        const int settle = k == 0 || !plan->plain || switched(b, k); /* else no output feels the new inputs at once */
        if (settle) {
            if (k > 0 || !plan->same) put_inputs(s, b, plan, b->at + k * b->n_inputs);
            good = core_step(s, time, 0.0) <= CORE_WARNING; /* events that the new inputs bring */
        }
        if (!good || !read_all(s, b, result + k * b->n_outputs)) break;
        if (N_STATES == 0 || k + 1 == b->n_rows) continue;
        if (!plan->same || !settle) put_inputs(s, b, plan, b->over + k * b->n_parts * b->n_inputs);
        correct(s, b, plan, k);
        good = pass(s, b, plan, k) && core_taken(s) < STEPS_AT_FIRST + STEPS_PER_ROW * (k + 1);
    }
    for (size_t i = k * b->n_outputs; i < b->n_rows * b->n_outputs; i++) result[i] = NAN;
    return k == b->n_rows;
}

/* Whether what is to be corrected are states. */
static int planned(const Batch *b, Plan *plan) {
    for (size_t i = 0; i < b->n_corrected; i++) {
        size_t j = 0;
        while (j < model_n_states && model_state_references[j] != b->corrected[i]) j++;
        if (j == model_n_states || b->n_corrected > model_n_states) return 0;
        plan->state[i] = j;
    }
    plan->same = b->at == b->over;
    plan->plain = 1;
    for (size_t i = 0; i < b->n_outputs; i++) plan->plain &= model_variables[b->outputs[i]].kind == VK_STATE;
    for (size_t i = 0; i < b->n_inputs; i++) plan->place[i] = model_variables[b->inputs[i]].index;
    plan->rows = 0;
    while (plan->rows < b->n_rows && sound_row(b, plan->rows)) plan->rows++;
    return 1;
}

/* Returns how many runs failed; -1: out of memory or a corrected variable that is no state. */
EXPORTED int batch_run(const Batch *b) {
    Plan plan;
    int failed = 0;
    if (!planned(b, &plan)) return -1;
    Instance *s = core_new(NULL, NULL);
    if (!s) return -1;
    for (size_t run = 0; run < b->n_runs; run++) {
        core_reset(s);
        failed += !one_run(s, b, &plan, run);
    }
    core_free(s);
    return failed;
}
