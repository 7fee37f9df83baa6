/* Several runs of a model side by side: the same step for all of them, each in a lane of its own (SIMD).
 *
 * A lane does what core.c does in most rows: new relations where the inputs or the correction ask for them, then one Runge-Kutta step
 * with the modes that hold. Where a when-clause fires, a relation changes on the way, the error is not small or a value is not finite,
 * the lane is off: core.c does that row for its run alone, from where it began. So a run's result does not depend on what runs beside
 * it. model_lanes.h holds the model's own functions as loops over the lanes.
 */
#define LANES 8
#define ROUNDS 6    /* of settling relations; core.c tries more */
#define CALM 0.6561 /* error, in units of the tolerance, up to which core.c does not shorten its next step: 0.9^4 */

/* A model for this: nothing but states, relations and memories. */
#define LANED (N_DELAYS + N_SAMPLES + N_LOOPS + N_ROUNDINGS + N_CONSTRAINTS + N_ASSERTIONS == 0)

#if LANED
#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__)
#define WIDE __attribute__((target_clones("arch=x86-64-v4", "avx2", "default")))
#define INLINE static inline __attribute__((always_inline)) /* for the processor of what calls it */
#else
#define WIDE
#define INLINE static inline
#endif

typedef double Lane[LANES];
typedef int64_t Whole[LANES]; /* as wide: no vector is split */

typedef struct {
    double time, initial, path, fired[AT_LEAST_1(N_BRANCHES)]; /* of all lanes */
    int n;                                                     /* lanes in use */
    Lane u[AT_LEAST_1(N_INPUTS)], x[AT_LEAST_1(N_STATES)], p[AT_LEAST_1(N_PARAMETERS + N_CALCULATED)], h[AT_LEAST_1(N_HOISTED)];
    Lane m[AT_LEAST_1(N_RELATIONS)], d[AT_LEAST_1(N_MEMORIES)], pre[AT_LEAST_1(N_MEMORIES)];
} LaneData;

#include "elementary.h"
#include "model_lanes.h"

typedef struct {
    LaneData q;
    Lane dx[AT_LEAST_1(N_STATES)], z[AT_LEAST_1(N_RELATIONS)], y[AT_LEAST_1(N_OUTPUTS)];
    Lane condition[AT_LEAST_1(N_BRANCHES)]; /* of when-clauses, after the last event */
    Lane x0[AT_LEAST_1(N_STATES)], m0[AT_LEAST_1(N_RELATIONS)], condition0[AT_LEAST_1(N_BRANCHES)]; /* where the row began */
    Instance *run[LANES];
    const Plan *plan[LANES];
    double *result[LANES];
    int failed[LANES]; /* runs that are over */
    int off[LANES];   /* lanes that leave this row to core.c */
} Lanes;

INLINE void contradict(const LaneData *q, const Lane *z, int *restrict off) {
    for (int i = 0; i < N_RELATIONS; i++) {
        const int inclusive = model_inclusive[i];
        for (int l = 0; l < LANES; l++) off[l] |= (inclusive ? z[i][l] >= 0 : z[i][l] > 0) != (q->m[i][l] != 0);
    }
}

INLINE void refuse_endless(const Lane *values, int n, int *restrict off) {
    for (int i = 0; i < n; i++)
        for (int l = 0; l < LANES; l++) off[l] |= !(fabs(values[i][l]) < HUGE_VAL);
}

/* Conditions under new relations; a lane in which one rises is off: its when-clause fires. */
INLINE void condition(Lanes *w, const int *changed) {
    Lane now[AT_LEAST_1(N_BRANCHES)];
    lanes_conditions(&w->q, now);
    for (int i = 0; i < N_BRANCHES; i++)
        for (int l = 0; l < LANES; l++) {
            w->off[l] |= changed[l] && now[i][l] != 0 && w->condition[i][l] == 0;
            w->condition[i][l] = changed[l] ? now[i][l] : w->condition[i][l];
        }
}

/* Relations as they are now, and rates under them, as iterate_events of core.c finds them. */
WIDE void lanes_settle(Lanes *w) {
    int changed[LANES] = {0}, odd[LANES], any = 1;
    for (int round = 0; any && round < ROUNDS; round++) {
        memset(odd, 0, sizeof odd);
        lanes_rates(&w->q, w->dx, w->z);
        contradict(&w->q, w->z, odd);
        any = 0;
        for (int l = 0; l < LANES; l++) any |= odd[l], changed[l] |= odd[l];
        for (int i = 0; any && i < N_RELATIONS; i++) {
            const int inclusive = model_inclusive[i];
            for (int l = 0; l < LANES; l++) w->q.m[i][l] = inclusive ? w->z[i][l] >= 0 : w->z[i][l] > 0;
        }
    }
    any = 0;
    for (int l = 0; l < LANES; l++) any |= changed[l], w->off[l] |= odd[l] || (N_MEMORIES && changed[l]);
    if (N_BRANCHES && any) condition(w, changed);
    refuse_endless(w->dx, N_STATES, w->off);
}

WIDE void lanes_read(Lanes *w) {
    lanes_outputs(&w->q, w->y);
}

/* x of a stage, `share` of a step behind x0 at the rates dx. */
INLINE void stage(Lane *restrict x, const Lane *restrict x0, double share, const Lane *restrict dx) {
    for (int i = 0; i < N_STATES; i++)
        for (int l = 0; l < LANES; l++) x[i][l] = x0[i][l] + share * dx[i][l];
}

/* One Runge-Kutta step of length h, as attempt_explicit of core.c. */
WIDE void lanes_step(Lanes *w, double h) {
    LaneData *q = &w->q;
    Lane x0[AT_LEAST_1(N_STATES)], k2[AT_LEAST_1(N_STATES)], k3[AT_LEAST_1(N_STATES)], k4[AT_LEAST_1(N_STATES)];
    const double time = q->time, calm = CALM;
    memcpy(x0, q->x, sizeof x0);
    q->time = time + 0.5 * h;
    stage(q->x, x0, 0.5 * h, w->dx);
    lanes_rates(q, k2, w->z);
    stage(q->x, x0, 0.5 * h, k2);
    lanes_rates(q, k3, w->z);
    contradict(q, w->z, w->off);
    q->time = time + h;
    stage(q->x, x0, h, k3);
    lanes_rates(q, k4, w->z);
    for (int i = 0; i < N_STATES; i++)
        for (int l = 0; l < LANES; l++) q->x[i][l] = x0[i][l] + h / 6 * (w->dx[i][l] + 2 * (k2[i][l] + k3[i][l]) + k4[i][l]);
    lanes_rates(q, w->dx, w->z);
    contradict(q, w->z, w->off);
    for (int i = 0; i < N_STATES; i++)
        for (int l = 0; l < LANES; l++) {
            const double size = fabs(q->x[i][l]) > model_nominals[i] ? fabs(q->x[i][l]) : model_nominals[i];
            w->off[l] |= !(fabs(h * 0.1 * (k4[i][l] - w->dx[i][l])) <= calm * q->p[P_TOLERANCE][l] * size);
        }
    refuse_endless(q->x, N_STATES, w->off);
    refuse_endless(w->dx, N_STATES, w->off);
}

/* A run's state into its lane, and back. */
static void lane_of_run(Lanes *w, int l) {
    const ModelData *from = &w->run[l]->c.q;
    for (int i = 0; i < N_STATES; i++) w->q.x[i][l] = from->x[i];
    for (int i = 0; i < N_PARAMETERS + N_CALCULATED; i++) w->q.p[i][l] = from->p[i];
    for (int i = 0; i < N_HOISTED; i++) w->q.h[i][l] = from->h[i];
    for (int i = 0; i < N_RELATIONS; i++) w->q.m[i][l] = from->m[i];
    for (int i = 0; i < N_MEMORIES; i++) w->q.d[i][l] = from->d[i], w->q.pre[i][l] = from->pre[i];
    for (int i = 0; i < N_BRANCHES; i++) w->condition[i][l] = w->run[l]->c.condition[i];
}

/* Of the row's beginning. */
static void run_of_lane(const Lanes *w, int l) {
    Core *c = &w->run[l]->c;
    for (int i = 0; i < N_STATES; i++) c->q.x[i] = w->x0[i][l];
    for (int i = 0; i < N_RELATIONS; i++) c->q.m[i] = w->m0[i][l];
    for (int i = 0; i < N_BRANCHES; i++) c->condition[i] = w->condition0[i][l];
    invalidate(w->run[l]);
}

/* Inputs of the lanes that are not off, from a row of those at the rows or over parts of them. */
static void lanes_put(Lanes *w, const Batch *b, int over, size_t row) {
    for (int l = 0; l < w->q.n; l++) {
        const Plan *plan = w->plan[l];
        const double *from = (over ? plan->over : plan->at) + row * b->n_inputs;
        if (w->off[l]) continue;
        for (size_t i = 0; i < b->n_inputs; i++) w->q.u[plan->place[i]][l] = from[i];
    }
}

/* Over a time under constant inputs, in steps as core.c would take. */
static void lanes_pass(Lanes *w, double time, double length) {
    const double end = time + length, longest = w->run[0]->c.q.p[P_MAX_STEP];
    for (int l = 0; l < w->q.n; l++) {
        const Core *c = &w->run[l]->c;
        w->off[l] |= c->implicit || c->step < fmin(length, longest) || c->q.p[P_MAX_STEP] != longest;
    }
    w->q.time = time;
    lanes_settle(w);
    for (int last = 0; !last;) {
        const double left = end - w->q.time, pieces = ceil(left / longest * (1 - 1e-9));
        last = pieces <= 1;
        lanes_step(w, last ? left : left / pieces);
    }
}

static void lanes_correct(Lanes *w, const Batch *b, size_t k) {
    for (int l = 0; l < w->q.n; l++)
        for (size_t i = 0; i < b->n_corrected && !w->off[l]; i++) {
            const double to = w->plan[l]->measured[k * b->n_corrected + i];
            double *x = &w->q.x[w->plan[l]->state[i]][l];
            if (isfinite(to)) *x += b->gains[i] * (to - *x);
        }
}

/* What row k says, then the way to the next one, of the lanes that are not off. */
static void lanes_row(Lanes *w, const Batch *b, size_t k) {
    const double time = (double)k * b->period, part = b->period / (double)b->n_parts;
    int whole = 1, further = 0;
    if (!w->plan[0]->plain) {
        lanes_put(w, b, 0, k);
        w->q.time = time;
        lanes_settle(w);
        lanes_read(w);
    }
    for (size_t i = 0; i < b->n_outputs; i++) {
        const ModelVariable *v = &model_variables[b->outputs[i]];
        const Lane *from = v->kind == VK_STATE ? &w->q.x[v->index] : &w->y[v->index];
        refuse_endless(from, 1, w->off);
        for (int l = 0; l < w->q.n; l++)
            if (!w->off[l]) w->result[l][k * b->n_outputs + i] = (*from)[l];
    }
    for (int l = 0; l < w->q.n; l++) further |= !w->off[l] && k + 1 < w->plan[l]->rows;
    if (N_STATES == 0 || !further) return;
    lanes_correct(w, b, k);
    for (int l = 0; l < w->q.n; l++) whole &= w->off[l] || (w->plan[l]->kind[k] & STEADY);
    for (size_t j = 0; j < (whole ? 1 : b->n_parts); j++) {
        lanes_put(w, b, 1, k * b->n_parts + j);
        lanes_pass(w, time + (double)j * part, whole ? b->period : part);
    }
}

/* Row k of every run that is not over: side by side, and by core.c where a lane is off. */
static void lanes_or_runs(Lanes *w, const Batch *b, size_t k) {
    int left = 0;
    memcpy(w->x0, w->q.x, sizeof w->x0);
    memcpy(w->m0, w->q.m, sizeof w->m0);
    memcpy(w->condition0, w->condition, sizeof w->condition0);
    for (int l = 0; l < LANES; l++) {
        w->off[l] = l >= w->q.n || w->failed[l] || k >= w->plan[l]->sound || k == 0 || w->plan[l]->kind[k] & SWITCHED;
        left += !w->off[l];
    }
    if (left > 0) lanes_row(w, b, k);
    for (int l = 0; l < w->q.n; l++) {
        if (!w->off[l] || w->failed[l] || k >= w->plan[l]->sound) continue;
        run_of_lane(w, l);
        w->failed[l] = !one_row(w->run[l], b, w->plan[l], k, w->result[l]);
        if (w->failed[l]) end_run(b, w->plan[l], k, w->result[l]);
        lane_of_run(w, l);
    }
}

/* Runs a group of at most LANES runs; they are initialised. Returns how many failed. */
static int lanes_run(Lanes *w, const Batch *b) {
    int failed = 0;
    size_t rows = 0;
    for (int l = 0; l < LANES; l++) {
        if (l >= w->q.n) w->run[l] = w->run[0]; /* numbers to compute with */
        lane_of_run(w, l);
    }
    for (int l = 0; l < w->q.n; l++) rows = w->plan[l]->sound > rows ? w->plan[l]->sound : rows;
    for (size_t k = 0; k < rows; k++) lanes_or_runs(w, b, k);
    for (int l = 0; l < w->q.n; l++) {
        if (!w->failed[l]) end_run(b, w->plan[l], w->plan[l]->sound, w->result[l]);
        failed += w->failed[l] || w->plan[l]->sound < w->plan[l]->rows;
    }
    return failed;
}
#endif
