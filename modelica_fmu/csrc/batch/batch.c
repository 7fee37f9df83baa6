/* Many runs of a model over records, in one call. Parameters differ from run to run; runs may share what drives them: inputs and
 * measured states. Records may differ in length.
 *
 * Row k holds the values at k * period. Between rows the inputs are held, each for one of n_parts equal parts of the row. Outputs are
 * read at the rows; then a state may be drawn towards a measured value by a fixed share (an observer): outputs are predictions. Calls
 * are independent: several threads may run at once.
 */
#include "core.c" /* in one piece with the driver and the model: a row is short, and calls would be half of it */
#include "model.c"
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

/* A model for lanes: nothing but states, relations, memories, clocks that set these, assertions; delays in runs that read none of them.
 * Assertions that hold or not from the start on (ASSERTED_ONCE) are not watched. */
#ifndef LANED
#define CLOCKS_LANED (N_SAMPLES == 0 || (N_STATES > 0 && !CHAINED))
#define LANED (N_LOOPS + N_ROUNDINGS + N_CONSTRAINTS == 0 && CLOCKS_LANED)
#endif

typedef struct {
    size_t n_runs, n_parameters, n_parts, n_inputs, n_corrected, n_outputs, n_drives;
    double period;             /* s */
    const unsigned *parameters; /* value references */
    const double *values;      /* [n_runs][n_parameters] */
    const unsigned *drive;     /* [n_runs], what drives each run */
    const unsigned *inputs;
    const size_t *rows, *sound; /* [n_drives], of each, and until an input is out of its bounds */
    const unsigned char *const *kind; /* [n_drives] of [rows], of RowKind */
    const double *const *at;   /* [n_drives][n_inputs] of [rows], at the rows */
    const double *const *over; /* [n_drives][n_inputs] of [rows][apart], over the period behind each row */
    const size_t *apart;       /* [n_drives][n_inputs], parts of a period over which an input differs: n_parts or 1 */
    const unsigned *corrected; /* states */
    const double *const *measured; /* [n_drives] of [rows][n_corrected]; NaN: no correction */
    const double *gains;       /* [n_corrected], share of the difference that is taken away per period */
    const unsigned *outputs;
    double *const *result;     /* [n_runs] of [rows][n_outputs]; NaN behind a failure */
} Batch;

/* What one call finds out once of each drive: where things lie in an instance. */
typedef struct {
    const double *const *at, *const *over, *measured; /* of each input */
    const size_t *apart;
    const unsigned char *kind;
    int place[AT_LEAST_1(N_INPUTS)];    /* of each input among the model's */
    size_t state[AT_LEAST_1(N_STATES)]; /* of each corrected state among the model's */
    size_t rows, sound;
    int same;                           /* inputs at the rows are those behind them */
    int plain;                          /* every output is a state, which inputs alone do not change */
    int laned;                          /* every output is a state or among the model's own outputs */
} Plan;

typedef enum {
    STEADY = 1,  /* no input changes up to the next row */
    SWITCHED = 2 /* one that is no number changes behind the row before or up to the next */
} RowKind;

static inline double over_part(const Plan *plan, size_t i, size_t k, size_t part) {
    const size_t n = plan->apart[i];
    return plan->over[i][k * n + (n > 1 ? part : 0)];
}

static int set_all(Instance *s, size_t n, const unsigned *references, const double *values) {
    for (size_t i = 0; i < n; i++)
        if (core_set(s, references[i], values[i]) > CORE_WARNING) return 0;
    return 1;
}

/* An input that is sound; of one that is no number (a clamp) a change may bring an event. */
static void put_input(Instance *s, const Batch *b, const Plan *plan, size_t i, double value) {
    double *to = &s->c.q.u[plan->place[i]];
    s->c.events_possible |= *to != value && model_variables[b->inputs[i]].type != VT_REAL;
    *to = value;
}

static void put_at(Instance *s, const Batch *b, const Plan *plan, size_t k) {
    for (size_t i = 0; i < b->n_inputs; i++) put_input(s, b, plan, i, plan->at[i][k]);
    invalidate(s);
}

/* What holds over a part of the period behind row k. */
static void put_over(Instance *s, const Batch *b, const Plan *plan, size_t k, size_t part) {
    for (size_t i = 0; i < b->n_inputs; i++) put_input(s, b, plan, i, over_part(plan, i, k, part));
    invalidate(s);
}

static int read_all(Instance *s, const Batch *b, double *row) {
    for (size_t i = 0; i < b->n_outputs; i++)
        if (core_get(s, b->outputs[i], row + i) > CORE_WARNING || !isfinite(row[i])) return 0;
    return 1;
}

/* Draws the corrected states of row k towards their measured values. */
static void correct(Instance *s, const Batch *b, const Plan *plan, size_t k) {
    for (size_t i = 0; i < b->n_corrected; i++) {
        double to = plan->measured[k * b->n_corrected + i], *x = &s->c.q.x[plan->state[i]];
        if (isfinite(to)) *x += b->gains[i] * (to - *x);
    }
    invalidate(s);
}

/* From row k to the next; at once, where no input changes on the way. Lanes take the parts of all rows one by one, for what is beside
 * them may change: so does a row that they leave to core.c. A run that reads what is delayed has no lane. */
static int pass(Instance *s, const Batch *b, const Plan *plan, size_t k) {
    const double time = (double)k * b->period, part = b->period / (double)b->n_parts;
    if ((!LANED || delays_matter(s)) && plan->kind[k] & STEADY) return core_step(s, time, b->period) <= CORE_WARNING;
    for (size_t j = 0; j < b->n_parts; j++) {
        if (j > 0) put_over(s, b, plan, k, j);
        if (core_step(s, time + (double)j * part, part) > CORE_WARNING) return 0;
    }
    return 1;
}

static int begin_run(Instance *s, const Batch *b, const Plan *plan, size_t run) {
    if (!set_all(s, b->n_parameters, b->parameters, b->values + run * b->n_parameters) || plan->sound == 0) return 0;
    put_at(s, b, plan, 0);
    return core_initialise(s, 0.0) <= CORE_WARNING;
}

/* What row k says, then the way to the next one. */
static int one_row(Instance *s, const Batch *b, const Plan *plan, size_t k, double *result) {
    const double time = (double)k * b->period;
    const int settle = k == 0 || !plan->plain || plan->kind[k] & SWITCHED; /* else no output feels the new inputs at once */
    if (settle) {
        if (k > 0 || !plan->same) put_at(s, b, plan, k);
        if (core_step(s, time, 0.0) > CORE_WARNING) return 0; /* events that the new inputs bring */
    }
    if (!read_all(s, b, result + k * b->n_outputs)) return 0;
    if (N_STATES == 0 || k + 1 == plan->rows) return 1;
    if (!plan->same || !settle) put_over(s, b, plan, k, 0);
    correct(s, b, plan, k);
    return pass(s, b, plan, k) && core_taken(s) < STEPS_AT_FIRST + STEPS_PER_ROW * (k + 1);
}

/* No more results from row k on. */
static void end_run(const Batch *b, const Plan *plan, size_t k, double *result) {
    for (size_t i = k * b->n_outputs; i < plan->rows * b->n_outputs; i++) result[i] = NAN;
}

/* Of a run that has begun, well or not. Whether all rows are good. */
static int all_rows(Instance *s, const Batch *b, const Plan *plan, size_t run, int good) {
    size_t k = 0;
    for (; good && k < plan->sound; k += good) good = one_row(s, b, plan, k, b->result[run]);
    end_run(b, plan, k, b->result[run]);
    return k == plan->rows;
}

#include "lanes.h"

/* Whether what is to be corrected are states. */
static int planned(const Batch *b, size_t drive, Plan *plan) {
    plan->rows = b->rows[drive], plan->sound = b->sound[drive], plan->kind = b->kind[drive];
    plan->at = b->at + drive * b->n_inputs, plan->over = b->over + drive * b->n_inputs;
    plan->apart = b->apart + drive * b->n_inputs, plan->measured = b->measured[drive];
    for (size_t i = 0; i < b->n_corrected; i++) {
        size_t j = 0;
        while (j < model_n_states && model_state_references[j] != b->corrected[i]) j++;
        if (j == model_n_states || b->n_corrected > model_n_states) return 0;
        plan->state[i] = j;
    }
    plan->same = 1;
    plan->plain = 1;
    plan->laned = 1;
    for (size_t i = 0; i < b->n_outputs; i++) {
        const ModelVariable *v = &model_variables[b->outputs[i]];
        plan->plain &= v->kind == VK_STATE;
        plan->laned &= v->kind == VK_STATE || (v->kind == VK_ALGEBRAIC && v->index < N_OUTPUTS);
    }
    for (size_t i = 0; i < b->n_inputs; i++) {
        plan->same &= plan->at[i] == plan->over[i];
        plan->place[i] = model_variables[b->inputs[i]].index;
    }
    return 1;
}

/* Runs from `first` on side by side. Returns how many failed; -1: out of memory. */
static int group(const Batch *b, const Plan *plans, size_t first, int n) {
#if LANED
    void *held = calloc(1, sizeof(Lanes) + sizeof(Lane));
    Lanes *w = at_lane(held);
    int failed = -1, l = 0;
    if (!w) return -1;
    w->q.path = 1;
    w->q.n = n;
    for (; l < n && (w->run[l] = core_new(NULL, NULL)) != NULL; l++) {
        const size_t run = first + (size_t)l;
        w->plan[l] = plans + b->drive[run];
        w->result[l] = b->result[run];
        const int good = begin_run(w->run[l], b, w->plan[l], run);
        w->done[l] = !good || delays_matter(w->run[l]);
        if (w->done[l]) w->failed[l] = !all_rows(w->run[l], b, w->plan[l], run, good);
    }
    if (l == n) failed = lanes_run(w, b);
    while (l-- > 0) core_free(w->run[l]);
    free(held);
    return failed;
#else
    (void)b, (void)plans, (void)first, (void)n;
    return -1;
#endif
}

static int all_runs(const Batch *b, const Plan *plans) {
    int failed = 0, n;
    Instance *s = core_new(NULL, NULL);
    if (!s) return -1;
    for (size_t run = 0; run < b->n_runs && failed >= 0; run += (size_t)n) {
        int found;
        n = b->n_runs - run > LANES ? LANES : (int)(b->n_runs - run);
        if (LANED && plans->laned) {
            found = group(b, plans, run, n);
        } else {
            n = 1;
            core_reset(s);
            found = !all_rows(s, b, plans + b->drive[run], run, begin_run(s, b, plans + b->drive[run], run));
        }
        failed = found < 0 ? -1 : failed + found;
    }
    core_free(s);
    return failed;
}

/* Returns how many runs failed; -1: out of memory or a corrected variable that is no state. */
EXPORTED int batch_run(const Batch *b) {
    Plan *plans = calloc(b->n_drives, sizeof *plans);
    int good = plans != NULL;
    for (size_t i = 0; good && i < b->n_drives; i++) good = planned(b, i, plans + i);
    const int failed = good ? all_runs(b, plans) : -1;
    free(plans);
    return failed;
}

/* Values until one is out of a variable's bounds. */
static size_t sound(const ModelVariable *v, const double *values, size_t n) {
    const double least = fmax(v->min, -DBL_MAX), most = fmin(v->max, DBL_MAX);
    size_t k = 0;
    while (k < n && values[k] >= least && values[k] <= most) k++;
    return k;
}

/* What is found out once of an input's course: what each row is to it. Returns the rows until it is out of its bounds. */
EXPORTED size_t batch_kinds(unsigned input, size_t rows, size_t parts, const double *at, const double *over, unsigned char *kind) {
    const ModelVariable *v = &model_variables[input];
    memset(kind, STEADY, rows);
    for (size_t k = 0; parts > 1 && k < rows; k++)
        for (size_t j = 1; j < parts; j++)
            if (over[k * parts + j] != over[k * parts + j - 1]) kind[k] = 0;
    for (size_t k = 1; v->type != VT_REAL && k < rows; k++) {
        int changed = at[k] != at[k - 1];
        for (size_t j = (k - 1) * parts; j < (k + 1) * parts; j++) changed |= over[j] != at[k];
        if (changed) kind[k] |= SWITCHED;
    }
    const size_t first = sound(v, at, rows), behind = at == over ? rows : sound(v, over, rows * parts) / parts;
    return first < behind ? first : behind;
}
