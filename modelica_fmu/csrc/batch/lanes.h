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
    int kept;       /* m0 and condition0 are set: relations have changed since */
    int alike;      /* one plan drives all lanes */
    Lane allowed;   /* s, step that each run's error allows; 0: an implicit one, which is core.c's alone */
    Whole off;      /* lanes that leave this row to core.c */
    Whole over;     /* lanes without a run, or whose run is over */
    Instance *run[LANES];
    const Plan *plan[LANES];
    double *result[LANES];
    int failed[LANES];
    size_t rows;         /* of the longest run */
    unsigned char *kind; /* [rows], STEADY where all lanes are, SWITCHED where one is or ends */
} Lanes;

INLINE void contradict(const LaneData *q, const Lane *z, int64_t *restrict off) {
    for (int i = 0; i < N_RELATIONS; i++) {
        const int inclusive = model_inclusive[i];
        for (int l = 0; l < LANES; l++) off[l] |= (inclusive ? z[i][l] >= 0 : z[i][l] > 0) != (q->m[i][l] != 0);
    }
}

INLINE void refuse_endless(const Lane *values, int n, int64_t *restrict off) {
    for (int i = 0; i < n; i++)
        for (int l = 0; l < LANES; l++) off[l] |= !(fabs(values[i][l]) < HUGE_VAL);
}

INLINE int64_t any(const int64_t *lanes) {
    int64_t found = 0;
    for (int l = 0; l < LANES; l++) found |= lanes[l];
    return found;
}

/* Conditions under new relations; a lane in which one rises is off: its when-clause fires. */
INLINE void condition_lanes(Lanes *w, const int64_t *changed) {
    Lane now[AT_LEAST_1(N_BRANCHES)];
    lanes_conditions(&w->q, now);
    for (int i = 0; i < N_BRANCHES; i++)
        for (int l = 0; l < LANES; l++) {
            w->off[l] |= changed[l] && now[i][l] != 0 && w->condition[i][l] == 0;
            w->condition[i][l] = changed[l] ? now[i][l] : w->condition[i][l];
        }
}

/* Relations as they are now, and rates under them, as iterate_events of core.c finds them. */
INLINE void settle_lanes(Lanes *w) {
    Whole changed = {0}, odd = {0};
    for (int round = 0; round < ROUNDS; round++) {
        memset(odd, 0, sizeof odd);
        lanes_rates(&w->q, w->dx, w->z);
        contradict(&w->q, w->z, odd);
        if (!any(odd)) break;
        if (!w->kept) {
            memcpy(w->m0, w->q.m, sizeof w->m0);
            memcpy(w->condition0, w->condition, sizeof w->condition0);
            w->kept = 1;
        }
        for (int l = 0; l < LANES; l++) changed[l] |= odd[l];
        for (int i = 0; i < N_RELATIONS; i++) {
            const int inclusive = model_inclusive[i];
            for (int l = 0; l < LANES; l++) w->q.m[i][l] = inclusive ? w->z[i][l] >= 0 : w->z[i][l] > 0;
        }
    }
    for (int l = 0; l < LANES; l++) w->off[l] |= odd[l] | (N_MEMORIES ? changed[l] : 0);
    if (N_BRANCHES && any(changed)) condition_lanes(w, changed);
    refuse_endless(w->dx, N_STATES, w->off);
}

/* x of a stage, `share` of a step behind x0 at the rates dx. */
INLINE void stage(Lane *restrict x, const Lane *restrict x0, double share, const Lane *restrict dx) {
    for (int i = 0; i < N_STATES; i++)
        for (int l = 0; l < LANES; l++) x[i][l] = x0[i][l] + share * dx[i][l];
}

/* One Runge-Kutta step of length h, as attempt_explicit of core.c. */
INLINE void step_lanes(Lanes *w, double h) {
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

/* Inputs, from a row of those at the rows or over parts of them. */
INLINE void put_lanes(Lanes *w, const Batch *b, int over, size_t row) {
    for (size_t i = 0; i < b->n_inputs; i++) {
        double *to = w->q.u[w->plan[0]->place[i]];
        const size_t at = row * b->n_inputs + i;
        if (w->alike) {
            const double value = (over ? w->plan[0]->over : w->plan[0]->at)[at];
            for (int l = 0; l < LANES; l++) to[l] = value;
        } else {
            for (int l = 0; l < LANES; l++)
                if (!w->over[l]) to[l] = (over ? w->plan[l]->over : w->plan[l]->at)[at];
        }
    }
}

INLINE void draw_lanes(Lanes *w, const Batch *b, size_t k) {
    for (size_t i = 0; i < b->n_corrected; i++) {
        double *x = w->q.x[w->plan[0]->state[i]];
        const double gain = b->gains[i];
        for (int l = 0; l < LANES; l++) {
            if (w->over[l]) continue;
            const double to = w->plan[l]->measured[k * b->n_corrected + i];
            if (isfinite(to)) x[l] += gain * (to - x[l]);
        }
    }
}

/* Over a time under constant inputs, in steps as core.c would take. */
INLINE void pass_lanes(Lanes *w, double time, double length) {
    const double end = time + length, longest = w->run[0]->c.q.p[P_MAX_STEP], usual = length < longest ? length : longest;
    for (int l = 0; l < LANES; l++) w->off[l] |= w->allowed[l] < usual;
    w->q.time = time;
    settle_lanes(w);
    for (int last = 0; !last;) {
        const double left = end - w->q.time, pieces = ceil(left / longest * (1 - 1e-9));
        last = pieces <= 1;
        step_lanes(w, last ? left : left / pieces);
    }
}

/* What row k says, then the way to the next one, of the lanes that are not off. */
INLINE void lanes_row(Lanes *w, const Batch *b, size_t k) {
    const double time = (double)k * b->period, part = b->period / (double)b->n_parts;
    const int whole = w->kind[k] & STEADY;
    if (!w->plan[0]->plain) {
        put_lanes(w, b, 0, k);
        w->q.time = time;
        settle_lanes(w);
        lanes_outputs(&w->q, w->y);
    }
    for (size_t i = 0; i < b->n_outputs; i++) {
        const ModelVariable *v = &model_variables[b->outputs[i]];
        const Lane *from = v->kind == VK_STATE ? &w->q.x[v->index] : &w->y[v->index];
        refuse_endless(from, 1, w->off);
        for (int l = 0; l < LANES; l++)
            if (!w->off[l]) w->result[l][k * b->n_outputs + i] = (*from)[l];
    }
    if (N_STATES == 0 || k + 1 == w->rows) return;
    draw_lanes(w, b, k);
    for (size_t j = 0; j < (whole ? 1 : b->n_parts); j++) {
        put_lanes(w, b, 1, k * b->n_parts + j);
        pass_lanes(w, time + (double)j * part, whole ? b->period : part);
    }
}

/* Rows from k on, until one that some lane leaves to core.c: that row. */
WIDE size_t lanes_rows(Lanes *w, const Batch *b, size_t k) {
    for (; k < w->rows; k++) {
        int64_t left = 0, some = 0;
        if (w->kind[k] & SWITCHED)
            for (int l = 0; l < LANES; l++) w->over[l] |= k >= w->plan[l]->sound;
        memcpy(w->off, w->over, sizeof w->off);
        if (w->kind[k] & SWITCHED || k == 0)
            for (int l = 0; l < LANES; l++) w->off[l] |= k == 0 || (!w->over[l] && w->plan[l]->kind[k] & SWITCHED);
        memcpy(w->x0, w->q.x, sizeof w->x0);
        w->kept = 0;
        for (int l = 0; l < LANES; l++) left |= !w->off[l];
        if (left) lanes_row(w, b, k);
        for (int l = 0; l < LANES; l++) some |= w->off[l] & !w->over[l];
        if (some) return k;
    }
    return k;
}

/* What a row of core.c changes of a run, into its lane. */
static void lane_of_run(Lanes *w, int l) {
    const Core *c = &w->run[l]->c;
    for (int i = 0; i < N_STATES; i++) w->q.x[i][l] = c->q.x[i];
    for (int i = 0; i < N_RELATIONS; i++) w->q.m[i][l] = c->q.m[i];
    for (int i = 0; i < N_MEMORIES; i++) w->q.d[i][l] = c->q.d[i], w->q.pre[i][l] = c->q.pre[i];
    for (int i = 0; i < N_BRANCHES; i++) w->condition[i][l] = c->condition[i];
    w->allowed[l] = c->implicit || c->q.p[P_MAX_STEP] != w->run[0]->c.q.p[P_MAX_STEP] ? 0 : c->step;
}

static void parameters_of_run(Lanes *w, int l) {
    const ModelData *from = &w->run[l]->c.q;
    for (int i = 0; i < N_PARAMETERS + N_CALCULATED; i++) w->q.p[i][l] = from->p[i];
    for (int i = 0; i < N_HOISTED; i++) w->q.h[i][l] = from->h[i];
}

/* Of the row's beginning. */
static void run_of_lane(const Lanes *w, int l) {
    Core *c = &w->run[l]->c;
    for (int i = 0; i < N_STATES; i++) c->q.x[i] = w->x0[i][l];
    for (int i = 0; i < N_RELATIONS; i++) c->q.m[i] = (w->kept ? w->m0 : w->q.m)[i][l];
    for (int i = 0; i < N_BRANCHES; i++) c->condition[i] = (w->kept ? w->condition0 : w->condition)[i][l];
    invalidate(w->run[l]);
}

/* What the lanes' rows have in common. */
static int find_joint(Lanes *w) {
    for (int l = 0; l < w->q.n; l++) w->rows = w->plan[l]->sound > w->rows ? w->plan[l]->sound : w->rows;
    w->kind = malloc(w->rows + 1);
    if (!w->kind) return 0;
    memset(w->kind, STEADY, w->rows);
    w->alike = 1;
    for (int l = 0; l < w->q.n; l++) {
        const Plan *plan = w->plan[l];
        for (size_t k = 0; k < plan->sound; k++) w->kind[k] = (w->kind[k] & plan->kind[k] & STEADY) | ((w->kind[k] | plan->kind[k]) & SWITCHED);
        if (plan->sound < w->rows) w->kind[plan->sound] |= SWITCHED;
        w->alike &= plan == w->plan[0];
    }
    return 1;
}

/* Runs a group of at most LANES runs; they are initialised. Returns how many failed; -1: out of memory. */
static int lanes_run(Lanes *w, const Batch *b) {
    int failed = 0;
    for (int l = 0; l < LANES; l++) {
        if (l >= w->q.n) w->run[l] = w->run[0], w->plan[l] = w->plan[0]; /* numbers to compute with */
        w->over[l] = l >= w->q.n || w->failed[l];
        parameters_of_run(w, l);
        lane_of_run(w, l);
    }
    if (!find_joint(w)) return -1;
    for (size_t k = lanes_rows(w, b, 0); k < w->rows; k = lanes_rows(w, b, k + 1))
        for (int l = 0; l < w->q.n; l++) {
            if (!w->off[l] || w->over[l]) continue;
            run_of_lane(w, l);
            w->failed[l] = !one_row(w->run[l], b, w->plan[l], k, w->result[l]);
            if (w->failed[l]) end_run(b, w->plan[l], k, w->result[l]);
            w->over[l] = w->failed[l];
            lane_of_run(w, l);
        }
    for (int l = 0; l < w->q.n; l++) {
        if (!w->failed[l]) end_run(b, w->plan[l], w->plan[l]->sound, w->result[l]);
        failed += w->failed[l] || w->plan[l]->sound < w->plan[l]->rows;
    }
    free(w->kind);
    return failed;
}
#endif
