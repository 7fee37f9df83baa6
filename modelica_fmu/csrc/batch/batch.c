/* Many runs of a model over records, in one call. Parameters differ from run to run; runs may share what drives them: inputs and
 * measured states. Records may differ in length.
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

#define SIDE_BY_SIDE 3 /* runs from which on lanes are worth it */

typedef struct {
    size_t n_runs, n_parameters, n_parts, n_inputs, n_corrected, n_outputs, n_drives;
    double period;             /* s */
    const unsigned *parameters; /* value references */
    const double *values;      /* [n_runs][n_parameters] */
    const unsigned *drive;     /* [n_runs], what drives each run */
    const unsigned *inputs;
    const size_t *rows, *sound; /* [n_drives], of each, and until an input is out of its bounds */
    const unsigned char *const *kind; /* [n_drives] of [rows], of RowKind */
    const double *const *at;   /* [n_drives] of [rows][n_inputs], at the rows */
    const double *const *over; /* [n_drives] of [rows][n_parts][n_inputs], over the parts of the period behind each row */
    const unsigned *corrected; /* states */
    const double *const *measured; /* [n_drives] of [rows][n_corrected]; NaN: no correction */
    const double *gains;       /* [n_corrected], share of the difference that is taken away per period */
    const unsigned *outputs;
    double *const *result;     /* [n_runs] of [rows][n_outputs]; NaN behind a failure */
} Batch;

/* What one call finds out once of each drive: where things lie in an instance. */
typedef struct {
    const double *at, *over, *measured;
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

static int set_all(Instance *s, size_t n, const unsigned *references, const double *values) {
    for (size_t i = 0; i < n; i++)
        if (core_set(s, references[i], values[i]) > CORE_WARNING) return 0;
    return 1;
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

/* From row k to the next; at once, where no input changes on the way. */
static int pass(Instance *s, const Batch *b, const Plan *plan, size_t k) {
    const double time = (double)k * b->period, part = b->period / (double)b->n_parts;
    const double *row = plan->over + k * b->n_parts * b->n_inputs;
    if (plan->kind[k] & STEADY) return core_step(s, time, b->period) <= CORE_WARNING;
    for (size_t j = 0; j < b->n_parts; j++) {
        if (j > 0) put_inputs(s, b, plan, row + j * b->n_inputs);
        if (core_step(s, time + (double)j * part, part) > CORE_WARNING) return 0;
    }
    return 1;
}

static int begin_run(Instance *s, const Batch *b, const Plan *plan, size_t run) {
    if (!set_all(s, b->n_parameters, b->parameters, b->values + run * b->n_parameters) || plan->sound == 0) return 0;
    put_inputs(s, b, plan, plan->at);
    return core_initialise(s, 0.0) <= CORE_WARNING;
}

/* What row k says, then the way to the next one. */
static int one_row(Instance *s, const Batch *b, const Plan *plan, size_t k, double *result) {
    const double time = (double)k * b->period;
    const int settle = k == 0 || !plan->plain || plan->kind[k] & SWITCHED; /* else no output feels the new inputs at once */
    if (settle) {
        if (k > 0 || !plan->same) put_inputs(s, b, plan, plan->at + k * b->n_inputs);
        if (core_step(s, time, 0.0) > CORE_WARNING) return 0; /* events that the new inputs bring */
    }
    if (!read_all(s, b, result + k * b->n_outputs)) return 0;
    if (N_STATES == 0 || k + 1 == plan->rows) return 1;
    if (!plan->same || !settle) put_inputs(s, b, plan, plan->over + k * b->n_parts * b->n_inputs);
    correct(s, b, plan, k);
    return pass(s, b, plan, k) && core_taken(s) < STEPS_AT_FIRST + STEPS_PER_ROW * (k + 1);
}

/* No more results from row k on. */
static void end_run(const Batch *b, const Plan *plan, size_t k, double *result) {
    for (size_t i = k * b->n_outputs; i < plan->rows * b->n_outputs; i++) result[i] = NAN;
}

static int one_run(Instance *s, const Batch *b, const Plan *plan, size_t run) {
    size_t k = 0;
    int good = begin_run(s, b, plan, run);
    for (; good && k < plan->sound; k += good) good = one_row(s, b, plan, k, b->result[run]);
    end_run(b, plan, k, b->result[run]);
    return k == plan->rows;
}

#include "lanes.h"

/* Whether what is to be corrected are states. */
static int planned(const Batch *b, size_t drive, Plan *plan) {
    plan->rows = b->rows[drive], plan->sound = b->sound[drive], plan->kind = b->kind[drive];
    plan->at = b->at[drive], plan->over = b->over[drive], plan->measured = b->measured[drive];
    for (size_t i = 0; i < b->n_corrected; i++) {
        size_t j = 0;
        while (j < model_n_states && model_state_references[j] != b->corrected[i]) j++;
        if (j == model_n_states || b->n_corrected > model_n_states) return 0;
        plan->state[i] = j;
    }
    plan->same = plan->at == plan->over;
    plan->plain = 1;
    plan->laned = 1;
    for (size_t i = 0; i < b->n_outputs; i++) {
        const ModelVariable *v = &model_variables[b->outputs[i]];
        plan->plain &= v->kind == VK_STATE;
        plan->laned &= v->kind == VK_STATE || (v->kind == VK_ALGEBRAIC && v->index < N_OUTPUTS);
    }
    for (size_t i = 0; i < b->n_inputs; i++) plan->place[i] = model_variables[b->inputs[i]].index;
    return 1;
}

/* Runs from `first` on side by side. Returns how many failed; -1: out of memory. */
static int group(const Batch *b, const Plan *plans, size_t first, int n) {
#if LANED
    Lanes *w = calloc(1, sizeof *w);
    int failed = -1, l = 0;
    if (!w) return -1;
    w->q.path = 1;
    w->q.n = n;
    for (; l < n && (w->run[l] = core_new(NULL, NULL)) != NULL; l++) {
        w->plan[l] = plans + b->drive[first + (size_t)l];
        w->result[l] = b->result[first + (size_t)l];
        w->failed[l] = !begin_run(w->run[l], b, w->plan[l], first + (size_t)l);
        if (w->failed[l]) end_run(b, w->plan[l], 0, w->result[l]);
    }
    if (l == n) failed = lanes_run(w, b);
    while (l-- > 0) core_free(w->run[l]);
    free(w);
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
        if (LANED && plans->laned && n >= SIDE_BY_SIDE) {
            found = group(b, plans, run, n);
        } else {
            n = 1;
            core_reset(s);
            found = !one_run(s, b, plans + b->drive[run], run);
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

/* Rows until one is out of its inputs' bounds. */
static size_t sound(size_t n, const unsigned *inputs, const double *values, size_t rows) {
    double least[AT_LEAST_1(N_INPUTS)], most[AT_LEAST_1(N_INPUTS)];
    for (size_t i = 0; i < n; i++) {
        const ModelVariable *v = &model_variables[inputs[i]];
        least[i] = fmax(v->min, -DBL_MAX), most[i] = fmin(v->max, DBL_MAX);
    }
    for (size_t k = 0; k < rows; k++, values += n) {
        int good = 1;
        for (size_t i = 0; i < n; i++) good &= values[i] >= least[i] && values[i] <= most[i];
        if (!good) return k;
    }
    return rows;
}

/* What is found out once of a drive: of what kind each of its rows is. Returns the rows until an input is out of its bounds. */
EXPORTED size_t batch_kinds(size_t rows, size_t parts, size_t n, const unsigned *inputs, const double *at, const double *over, unsigned char *kind) {
    memset(kind, STEADY, rows);
    for (size_t k = 0; parts > 1 && k < rows; k++) {
        const double *row = over + k * parts * n;
        int steady = 1;
        for (size_t j = n; j < parts * n; j++) steady &= row[j] == row[j - n];
        kind[k] = steady ? STEADY : 0;
    }
    for (size_t i = 0; i < n; i++)
        for (size_t k = 1; model_variables[inputs[i]].type != VT_REAL && k < rows; k++) {
            const double now = at[k * n + i];
            int changed = now != at[(k - 1) * n + i];
            for (size_t j = (k - 1) * parts; j < (k + 1) * parts; j++) changed |= over[j * n + i] != now;
            if (changed) kind[k] |= SWITCHED;
        }
    const size_t first = sound(n, inputs, at, rows), behind = at == over ? rows : sound(n, inputs, over, rows * parts) / parts;
    return first < behind ? first : behind;
}
