/* Several runs of a model side by side: the same step for all of them, each in a lane of its own (SIMD).
 *
 * A lane does what core.c does in most rows: ticks of clocks that are due and new relations, then one Runge-Kutta step with the modes
 * that hold. Where any other when-clause fires, a clock ticks within a step, a relation changes on the way, the error is not small or a
 * value is not finite, the lane is off: core.c does that row for its run alone, from where it began. So a run's result does not depend
 * on what runs beside it. model_lanes.h holds the model's own functions as loops over the lanes.
 */
#define LANES 8
#define ROUNDS 6    /* of settling relations; core.c tries more */
#define AHEAD 32    /* rows */
#define CALM 0.6561 /* error, in units of the tolerance, up to which core.c does not shorten its next step: 0.9^4 */

#if LANED
#define APART static __attribute__((noinline)) /* called from several places: copies would take long to compile */

#define WIDE __attribute__((aligned(64))) /* a vector that lies in two cache lines costs twice as much */
typedef double Lane[LANES] WIDE;
typedef int64_t Whole[LANES] WIDE; /* as wide: no vector is split */

typedef struct {
    double time, initial, path; /* of all lanes */
    int n;                      /* lanes in use */
    Lane u[AT_LEAST_1(N_INPUTS)], x[AT_LEAST_1(N_STATES)], p[AT_LEAST_1(N_PARAMETERS + N_CALCULATED)], h[AT_LEAST_1(N_HOISTED)];
    Lane m[AT_LEAST_1(N_RELATIONS)], d[AT_LEAST_1(N_MEMORIES)], pre[AT_LEAST_1(N_MEMORIES)];
    Lane fired[AT_LEAST_1(N_BRANCHES)], tick[AT_LEAST_1(N_SAMPLES)];
} LaneData;

#include "elementary.h"
#include "model_lanes.h"

typedef struct {
    LaneData q;
    Lane dx[AT_LEAST_1(N_STATES)], z[AT_LEAST_1(N_RELATIONS)], y[AT_LEAST_1(N_OUTPUTS)];
    Lane condition[AT_LEAST_1(N_BRANCHES)]; /* of when-clauses, after the last event */
    Lane x0[AT_LEAST_1(N_STATES)], m0[AT_LEAST_1(N_RELATIONS)], condition0[AT_LEAST_1(N_BRANCHES)]; /* where the row began */
    Lane d0[AT_LEAST_1(N_MEMORIES)], ticks0[AT_LEAST_1(N_SAMPLES)];
    int kept;       /* these but x0 are set: relations, memories or clocks have changed since */
    Lane ticks[AT_LEAST_1(N_SAMPLES)]; /* of each clock, already taken */
    Lane begins[AT_LEAST_1(N_SAMPLES)], interval[AT_LEAST_1(N_SAMPLES)]; /* s, of each clock */
    Lane allowed;   /* s, step that each run's error allows; 0: an implicit one, which is core.c's alone */
    Lane off;       /* not 0: lanes that leave this row to core.c */
    Lane over;      /* 1: lanes without a run, or whose run is over */
    Instance *run[LANES];
    const Plan *plan[LANES];
    double *result[LANES];
    int failed[LANES];
    size_t rows;         /* of the longest run */
    unsigned char *kind; /* [rows], SWITCHED where one lane is or ends */
    size_t ahead;        /* row from which on these are of all lanes, side by side; see look_ahead */
    Lane *at, *over_parts, *measured;
    void *held; /* what these are in */
} Lanes;

/* Within what was allocated with a Lane more. */
static inline void *at_lane(void *held) { return held ? (char *)held + (sizeof(Lane) - (uintptr_t)held % sizeof(Lane)) : NULL; }

/* Flags are doubles, as what they are made of: vectors are not converted. */
static inline void contradict(const LaneData *q, const Lane *z, double *restrict off) {
    for (int i = 0; i < N_RELATIONS; i++) {
        const int inclusive = model_inclusive[i];
        for (int l = 0; l < LANES; l++) {
            const double now = (inclusive ? z[i][l] >= 0 : z[i][l] > 0) ? 1 : 0;
            off[l] += now != q->m[i][l] ? 1 : 0;
        }
    }
}

static inline void refuse_endless(const Lane *values, int n, double *restrict off) {
    for (int i = 0; i < n; i++)
        for (int l = 0; l < LANES; l++) off[l] += values[i][l] - values[i][l]; /* 0, or no number */
}

static inline int any(const double *lanes) {
    int64_t found = 0;
    for (int l = 0; l < LANES; l++) found |= lanes[l] != 0;
    return found != 0;
}

/* What may change within a row, as it was at its beginning. */
static inline void keep_lanes(Lanes *w) {
    if (w->kept) return;
    memcpy(w->m0, w->q.m, sizeof w->m0);
    memcpy(w->condition0, w->condition, sizeof w->condition0);
    memcpy(w->d0, w->q.d, sizeof w->d0);
    memcpy(w->ticks0, w->ticks, sizeof w->ticks0);
    w->kept = 1;
}

/* Conditions under new relations; a lane in which one rises is off: its when-clause fires. */
static inline void condition_lanes(Lanes *w, const double *changed) {
    Lane now[AT_LEAST_1(N_BRANCHES)];
    lanes_conditions(&w->q, now);
    for (int i = 0; i < N_BRANCHES; i++)
        for (int l = 0; l < LANES; l++) {
            w->off[l] += (changed[l] != 0) & (now[i][l] != 0) & (w->condition[i][l] == 0) ? 1 : 0;
            w->condition[i][l] = changed[l] != 0 ? now[i][l] : w->condition[i][l];
        }
}

/* Rates; of a model without states outputs. */
static inline void evaluate_lanes(Lanes *w) {
#if N_STATES > 0
    lanes_rates(&w->q, w->dx, w->z);
#else
    lanes_observed(&w->q, w->z, w->y);
#endif
}

#if N_SAMPLES > 0
/* Of a clock, when it ticks next. */
static inline double next_tick_of(const Lanes *w, int i, int l) {
    return w->begins[i][l] + w->ticks[i][l] * w->interval[i][l];
}

/* Clocks that tick by now, as take_due_ticks of core.c; `due`: lanes in which any does. Whether there are such. */
static inline int due_lanes(Lanes *w, double *restrict due) {
    const double now = w->q.time + time_slack(w->q.time);
    int found = 0;
    for (int i = 0; i < N_SAMPLES; i++)
        for (int l = 0; l < LANES; l++) {
            w->q.tick[i][l] = w->over[l] == 0 && next_tick_of(w, i, l) <= now ? 1 : 0;
            due[l] += w->q.tick[i][l];
            found |= w->q.tick[i][l] != 0;
        }
    if (!found) return 0;
    keep_lanes(w);
    for (int i = 0; i < N_SAMPLES; i++)
        for (int l = 0; l < LANES; l++)
            while (w->over[l] == 0 && next_tick_of(w, i, l) <= now) w->ticks[i][l] += 1;
    return 1;
}

/* What fires where a clock was due, and what that sets, as update of core.c; `new`: lanes in which anything is. */
static inline void update_lanes(Lanes *w, const double *due, double *restrict new) {
    Lane now[AT_LEAST_1(N_BRANCHES)], d[AT_LEAST_1(N_MEMORIES)], x[AT_LEAST_1(N_STATES)], chain = {0};
    lanes_conditions(&w->q, now);
    for (int i = 0; i < N_BRANCHES; i++)
        for (int l = 0; l < LANES; l++) {
            const int before = i > 0 && model_chain[i] == model_chain[i - 1] && chain[l] != 0;
            w->q.fired[i][l] = due[l] != 0 && now[i][l] != 0 && w->condition[i][l] == 0 && !before ? 1 : 0;
            chain[l] = before || w->q.fired[i][l] != 0;
            new[l] += w->q.fired[i][l];
            w->condition[i][l] = due[l] != 0 ? now[i][l] : w->condition[i][l];
        }
    memcpy(x, w->q.x, sizeof x);
    lanes_updates(&w->q, d, x);
    for (int i = 0; i < N_MEMORIES; i++)
        for (int l = 0; l < LANES; l++) {
            new[l] += due[l] != 0 && d[i][l] != w->q.d[i][l] ? 1 : 0;
            w->q.d[i][l] = w->q.pre[i][l] = due[l] != 0 ? d[i][l] : w->q.d[i][l];
        }
    for (int i = 0; i < N_STATES; i++)
        for (int l = 0; l < LANES; l++) w->q.x[i][l] = due[l] != 0 ? x[i][l] : w->q.x[i][l];
    memset(w->q.fired, 0, sizeof w->q.fired);
}

/* Clocks that are due, as iterate_events of core.c: what they set, once. A lane in which that brings anything further is off; whether
 * it changes relations is found when these are settled. */
static inline void tick_lanes(Lanes *w) {
    Lane due = {0}, new = {0}, odd = {0};
    if (!due_lanes(w, due)) return;
    evaluate_lanes(w);
    contradict(&w->q, w->z, odd);
    update_lanes(w, due, new);
    memset(new, 0, sizeof new);
    update_lanes(w, due, new);
    for (int l = 0; l < LANES; l++) w->off[l] += new[l] + (due[l] != 0 ? odd[l] : 0);
    memset(w->q.tick, 0, sizeof w->q.tick);
    condition_lanes(w, due);
}

/* A lane is off whose clock ticks on the way to `end`. */
static inline void refuse_ticks(Lanes *w, double end) {
    for (int i = 0; i < N_SAMPLES; i++)
        for (int l = 0; l < LANES; l++) w->off[l] += w->over[l] == 0 && next_tick_of(w, i, l) < end - time_slack(end) ? 1 : 0;
}
#else
static inline void tick_lanes(Lanes *w) { (void)w; }
static inline void refuse_ticks(Lanes *w, double end) { (void)w, (void)end; }
#endif

/* Relations as they are now, and rates under them, as iterate_events of core.c finds them. */
static inline void settle_lanes(Lanes *w) {
    Lane changed = {0}, odd = {0};
    tick_lanes(w);
    for (int round = 0; round < ROUNDS; round++) {
        memset(odd, 0, sizeof odd);
        evaluate_lanes(w);
        contradict(&w->q, w->z, odd);
        if (!any(odd)) break;
        keep_lanes(w);
        for (int l = 0; l < LANES; l++) changed[l] += odd[l];
        for (int i = 0; i < N_RELATIONS; i++) {
            const int inclusive = model_inclusive[i];
            for (int l = 0; l < LANES; l++) w->q.m[i][l] = (inclusive ? w->z[i][l] >= 0 : w->z[i][l] > 0) ? 1 : 0;
        }
    }
    for (int l = 0; l < LANES; l++) w->off[l] += odd[l] + (N_MEMORIES ? changed[l] : 0);
    if (N_BRANCHES && any(changed)) condition_lanes(w, changed);
    refuse_endless(w->dx, N_STATES, w->off);
}

#if N_STATES > 0
/* x of a stage, `share` of a step behind x0 at the rates dx. */
static inline void stage(Lane *restrict x, const Lane *restrict x0, double share, const Lane *restrict dx) {
    for (int i = 0; i < N_STATES; i++)
        for (int l = 0; l < LANES; l++) x[i][l] = x0[i][l] + share * dx[i][l];
}

/* One Runge-Kutta step of length h, as attempt_explicit of core.c. */
static inline void step_lanes(Lanes *w, double h) {
    LaneData *q = &w->q;
    Lane x0[AT_LEAST_1(N_STATES)], k2[AT_LEAST_1(N_STATES)], k3[AT_LEAST_1(N_STATES)], k4[AT_LEAST_1(N_STATES)];
    const double time = q->time;
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
    for (int i = 0; i < N_STATES; i++) {
        const double *restrict x = q->x[i], *restrict first = k4[i], *restrict last = w->dx[i], *restrict tolerance = q->p[P_TOLERANCE];
        const double nominal = model_nominals[i];
        double *restrict off = w->off;
        for (int l = 0; l < LANES; l++) {
            const double size = fabs(x[l]) > nominal ? fabs(x[l]) : nominal;
            const double error = fabs(h * 0.1 * (first[l] - last[l]));
            off[l] += error <= CALM * tolerance[l] * size ? 0.0 : 1.0;
        }
    }
    refuse_endless(q->x, N_STATES, w->off);
    refuse_endless(w->dx, N_STATES, w->off);
}
#endif

/* Rows of a lane that are to come, at most AHEAD; a lane that is over keeps what it was given last. */
static inline size_t to_come(const Lanes *w, int l, size_t k) {
    const size_t left = w->plan[l]->rows > k ? w->plan[l]->rows - k : 0;
    return left < AHEAD ? left : AHEAD;
}

/* Inputs and measured states of the next rows: what is stored one by one cannot be read as a vector at once. */
static inline void look_ahead(Lanes *w, const Batch *b, size_t k) {
    const size_t n = b->n_inputs, parts = b->n_parts, states = b->n_corrected;
    const int ahead = !w->plan[0]->plain;
    for (int l = 0; l < LANES; l++) {
        const Plan *plan = w->plan[l];
        const size_t rows = to_come(w, l, k);
        for (size_t i = 0; i < n && ahead; i++)
            for (size_t r = 0; r < rows; r++) w->at[r * n + i][l] = plan->at[i][k + r];
        for (size_t i = 0; i < n && N_STATES > 0; i++)
            for (size_t r = 0; r < rows; r++)
                for (size_t j = 0; j < parts; j++) w->over_parts[(r * parts + j) * n + i][l] = over_part(plan, i, k + r, j);
        for (size_t r = 0; r < rows * states && N_STATES > 0; r++) w->measured[r][l] = plan->measured[k * states + r];
    }
    w->ahead = k;
}

static inline void put_lanes(Lanes *w, const Batch *b, const Lane *row) {
    for (size_t i = 0; i < b->n_inputs; i++) memcpy(w->q.u[w->plan[0]->place[i]], row[i], sizeof row[i]);
}

static inline void draw_lanes(Lanes *w, const Batch *b, const Lane *measured) {
    for (size_t i = 0; i < b->n_corrected; i++) {
        double *restrict x = w->q.x[w->plan[0]->state[i]];
        const double *restrict to = measured[i], gain = b->gains[i];
        for (int l = 0; l < LANES; l++) {
            const double drawn = x[l] + gain * (to[l] - x[l]);
            x[l] = fabs(to[l]) < HUGE_VAL ? drawn : x[l];
        }
    }
}

#if N_STATES > 0
/* Over a time under constant inputs, in steps as core.c would take. */
static inline void pass_lanes(Lanes *w, double time, double length) {
    const double end = time + length, longest = w->run[0]->c.q.p[P_MAX_STEP], usual = length < longest ? length : longest;
    for (int l = 0; l < LANES; l++) w->off[l] += w->allowed[l] < usual ? 1 : 0;
    w->q.time = time;
    settle_lanes(w);
    refuse_ticks(w, end);
    for (int last = 0; !last;) {
        const double left = end - w->q.time, pieces = ceil(left / longest * (1 - 1e-9));
        last = pieces <= 1;
        step_lanes(w, last ? left : left / pieces);
    }
}
#endif

/* What row k says, then the way to the next one, of the lanes that are not off. */
static inline void lanes_row(Lanes *w, const Batch *b, size_t k) {
    const double time = (double)k * b->period;
    if (!w->plan[0]->plain) {
        put_lanes(w, b, w->at + (k - w->ahead) * b->n_inputs);
        w->q.time = time;
        settle_lanes(w);
#if N_STATES > 0
        lanes_outputs(&w->q, w->y);
#endif
    }
    for (size_t i = 0; i < b->n_outputs; i++) {
        const ModelVariable *v = &model_variables[b->outputs[i]];
        const Lane *from = v->kind == VK_STATE ? &w->q.x[v->index] : &w->y[v->index];
        refuse_endless(from, 1, w->off);
        for (int l = 0; l < LANES; l++)
            if (w->off[l] == 0) w->result[l][k * b->n_outputs + i] = (*from)[l];
    }
#if N_STATES > 0
    const double part = b->period / (double)b->n_parts;
    if (k + 1 == w->rows) return;
    draw_lanes(w, b, w->measured + (k - w->ahead) * b->n_corrected);
    for (size_t j = 0; j < b->n_parts; j++) {
        put_lanes(w, b, w->over_parts + ((k - w->ahead) * b->n_parts + j) * b->n_inputs);
        pass_lanes(w, time + (double)j * part, part);
    }
#endif
}

/* Rows from k on, until one that some lane leaves to core.c: that row. */
static size_t lanes_rows(Lanes *w, const Batch *b, size_t k) {
    for (; k < w->rows; k++) {
        int64_t left = 0, some = 0;
        if (w->kind[k] & SWITCHED)
            for (int l = 0; l < LANES; l++) w->over[l] = k >= w->plan[l]->sound ? 1 : w->over[l];
        memcpy(w->off, w->over, sizeof w->off);
        if (w->kind[k] & SWITCHED || k == 0)
            for (int l = 0; l < LANES; l++) w->off[l] += k == 0 || (w->over[l] == 0 && w->plan[l]->kind[k] & SWITCHED);
        if (k == 0 || k >= w->ahead + AHEAD) look_ahead(w, b, k);
        memcpy(w->x0, w->q.x, sizeof w->x0);
        w->kept = 0;
        for (int l = 0; l < LANES; l++) left |= w->off[l] == 0;
        if (left) lanes_row(w, b, k);
        for (int l = 0; l < LANES; l++) some |= (w->off[l] != 0) & (w->over[l] == 0);
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
    for (int i = 0; i < N_SAMPLES; i++) w->ticks[i][l] = (double)c->tick_count[i];
    for (int i = 0; i < N_BRANCHES; i++) w->condition[i][l] = c->condition[i];
    w->allowed[l] = c->implicit || c->q.p[P_MAX_STEP] != w->run[0]->c.q.p[P_MAX_STEP] ? 0 : c->step;
}

static void parameters_of_run(Lanes *w, int l) {
    const ModelData *from = &w->run[l]->c.q;
    for (int i = 0; i < N_PARAMETERS + N_CALCULATED; i++) w->q.p[i][l] = from->p[i];
    for (int i = 0; i < N_HOISTED; i++) w->q.h[i][l] = from->h[i];
    for (int i = 0; i < N_SAMPLES; i++) {
        w->begins[i][l] = w->run[l]->c.tick_start[i];
        w->interval[i][l] = w->run[l]->c.tick_interval[i];
    }
}

/* Of the row's beginning. */
static void run_of_lane(const Lanes *w, int l) {
    Core *c = &w->run[l]->c;
    for (int i = 0; i < N_STATES; i++) c->q.x[i] = w->x0[i][l];
    for (int i = 0; i < N_RELATIONS; i++) c->q.m[i] = (w->kept ? w->m0 : w->q.m)[i][l];
    for (int i = 0; i < N_BRANCHES; i++) c->condition[i] = (w->kept ? w->condition0 : w->condition)[i][l];
    for (int i = 0; i < N_MEMORIES; i++) c->q.d[i] = c->q.pre[i] = (w->kept ? w->d0 : w->q.d)[i][l];
    for (int i = 0; i < N_SAMPLES; i++) c->tick_count[i] = (int64_t)(w->kept ? w->ticks0 : w->ticks)[i][l];
    invalidate(w->run[l]);
}

/* What the lanes' rows have in common, and room for what is looked ahead at. */
static int prepare_rows(Lanes *w, const Batch *b) {
    for (int l = 0; l < w->q.n; l++) w->rows = w->plan[l]->sound > w->rows ? w->plan[l]->sound : w->rows;
    w->kind = malloc(w->rows + 1);
    w->held = calloc(AHEAD * (b->n_inputs * (1 + b->n_parts) + b->n_corrected) + 1, sizeof *w->at);
    w->at = at_lane(w->held);
    if (!w->kind || !w->at) return 0;
    w->over_parts = w->at + AHEAD * b->n_inputs;
    w->measured = w->over_parts + AHEAD * b->n_inputs * b->n_parts;
    memset(w->kind, 0, w->rows);
    for (int l = 0; l < w->q.n; l++) {
        const Plan *plan = w->plan[l];
        for (size_t k = 0; k < plan->sound; k++) w->kind[k] |= plan->kind[k] & SWITCHED;
        if (plan->sound < w->rows) w->kind[plan->sound] |= SWITCHED;
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
    if (!prepare_rows(w, b)) failed = -1;
    for (size_t k = failed ? w->rows : lanes_rows(w, b, 0); k < w->rows; k = lanes_rows(w, b, k + 1))
        for (int l = 0; l < w->q.n; l++) {
            if (w->off[l] == 0 || w->over[l] != 0) continue;
            run_of_lane(w, l);
            w->failed[l] = !one_row(w->run[l], b, w->plan[l], k, w->result[l]);
            if (w->failed[l]) end_run(b, w->plan[l], k, w->result[l]);
            w->over[l] = w->failed[l];
            lane_of_run(w, l);
        }
    for (int l = 0; l < w->q.n && failed >= 0; l++) {
        if (!w->failed[l]) end_run(b, w->plan[l], w->plan[l]->sound, w->result[l]);
        failed += w->failed[l] || w->plan[l]->sound < w->plan[l]->rows;
    }
    free(w->kind);
    free(w->held);
    return failed;
}
#endif
