/* Several runs of a model side by side: the same step for all of them, each in a lane of its own (SIMD).
 *
 * A lane does what core.c does: ticks of clocks that are due, events, then Runge-Kutta steps with the modes that hold, to events on the way
 * and on (lane_steps.h). Where a relation changes and changes back within a step, when-clauses follow from one another, a clock ticks within
 * a row, an input that is no number switches, events are many, the error is not small, a value is not finite or an assertion does not hold,
 * the lane is off: core.c does that row for its run alone, from where it began. So a run's result does not depend on what runs beside it.
 * model_lanes.h holds the model's own functions as loops over the lanes.
 */
#define LANES 8
#define ROUNDS 6    /* of settling relations; core.c tries more */
#define AHEAD 32    /* rows */
#define ALL_INPUTS AT_LEAST_1(N_INPUTS)
#define EVENTS_LANED 6 /* of a lane in a part of a row; core.c makes modes last from MAX_EVENTS on */
#define CALM 0.6561 /* error, in units of the tolerance, up to which core.c does not shorten its next step: 0.9^4 */

#if LANED
#define APART static __attribute__((noinline)) /* long: copies would take long to compile */

#define WIDE __attribute__((aligned(64))) /* a vector that lies in two cache lines costs twice as much */
typedef double Lane[LANES] WIDE;
typedef int64_t Whole[LANES] WIDE; /* as wide: no vector is split */

_Static_assert(EVENTS_LANED < MAX_EVENTS, "lanes leave many events to core.c");

typedef struct {
    double initial, path; /* of all lanes */
    int n;                /* lanes in use */
    Lane time;
    Lane u[AT_LEAST_1(N_INPUTS)], x[AT_LEAST_1(N_STATES)], p[AT_LEAST_1(N_PARAMETERS + N_CALCULATED)], h[AT_LEAST_1(N_HOISTED)];
    Lane m[AT_LEAST_1(N_RELATIONS)], d[AT_LEAST_1(N_MEMORIES)], pre[AT_LEAST_1(N_MEMORIES)];
    Lane fired[AT_LEAST_1(N_BRANCHES)], tick[AT_LEAST_1(N_SAMPLES)], late[AT_LEAST_1(N_DELAYS)];
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
    int done[LANES]; /* before the lanes begin: it has failed, or reads what is delayed */
    int active[LANES], n_active; /* lanes that are not over; where one is off, core.c puts its own result */
    size_t rows;         /* of the longest run */
    unsigned char *kind; /* [rows], SWITCHED where one lane is or ends */
    size_t ahead;        /* row from which on these are of all lanes, side by side; see look_ahead */
    Lane *at, *over_parts, *measured;
    void *held; /* what these are in */
} Lanes;

/* Within what was allocated with a Lane more. */
static inline void *at_lane(void *held) { return held ? (char *)held + (sizeof(Lane) - (uintptr_t)held % sizeof(Lane)) : NULL; }

#include "lane_steps.h"

/* Rows of a lane that are to come, at most AHEAD; a lane that is over keeps what it was given last. */
static inline size_t to_come(const Lanes *w, int l, size_t k) {
    const size_t left = w->plan[l]->rows > k ? w->plan[l]->rows - k : 0;
    return left < AHEAD ? left : AHEAD;
}

/* Values of a drive's next rows into a lane. */
static inline void look_at(Lane *to, size_t to_step, int l, const double *from, size_t from_step, size_t rows) {
    for (size_t r = 0; r < rows; r++) to[r * to_step][l] = from[r * from_step];
}

/* Inputs and measured states of the next rows: what is stored one by one cannot be read as a vector at once. */
static inline void look_ahead(Lanes *w, const Batch *b, size_t k) {
    const size_t parts = b->n_parts, states = b->n_corrected;
    const int ahead = !w->plan[0]->plain;
    for (int l = 0; l < LANES; l++) {
        const Plan *plan = w->plan[l];
        const size_t rows = to_come(w, l, k);
        if (rows == 0) continue;
        for (size_t i = 0; i < b->n_inputs; i++) {
            const size_t apart = plan->apart[i];
            const int place = plan->place[i];
            if (ahead) look_at(w->at + place, ALL_INPUTS, l, plan->at[i] + k, 1, rows);
            for (size_t j = 0; j < parts && N_STATES > 0; j++) {
                const double *from = plan->over[i] + k * apart + (apart > 1 ? j : 0);
                look_at(w->over_parts + j * ALL_INPUTS + place, parts * ALL_INPUTS, l, from, apart, rows);
            }
        }
        if (N_STATES > 0) look_at(w->measured, 1, l, plan->measured + k * states, 1, rows * states);
    }
    w->ahead = k;
}

static inline void put_lanes(Lanes *w, const Lane *row) { memcpy(w->q.u, row, sizeof w->q.u); }

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

/* What row k says, then the way to the next one, of the lanes that are not off. */
static inline void lanes_row(Lanes *w, const Batch *b, size_t k) {
    const double time = (double)k * b->period;
    if (!w->plan[0]->plain) {
        put_lanes(w, w->at + (k - w->ahead) * ALL_INPUTS);
        set_time(&w->q, time);
        settle_lanes(w);
        refuse_unasserted(w);
#if N_STATES > 0
        lanes_outputs(&w->q, w->y);
#endif
    }
    for (size_t i = 0; i < b->n_outputs; i++) {
        const ModelVariable *v = &model_variables[b->outputs[i]];
        const Lane *from = v->kind == VK_STATE ? &w->q.x[v->index] : &w->y[v->index];
        double *const *result = w->result;
        refuse_endless(from, 1, w->off);
        for (int a = 0; a < w->n_active; a++) result[w->active[a]][k * b->n_outputs + i] = (*from)[w->active[a]];
    }
#if N_STATES > 0
    const double part = b->period / (double)b->n_parts;
    if (k + 1 == w->rows) return;
    draw_lanes(w, b, w->measured + (k - w->ahead) * b->n_corrected);
    for (size_t j = 0; j < b->n_parts; j++) {
        put_lanes(w, w->over_parts + ((k - w->ahead) * b->n_parts + j) * ALL_INPUTS);
        pass_lanes(w, time + (double)j * part, part);
        refuse_unasserted(w);
    }
#endif
}

static void find_active(Lanes *w) {
    w->n_active = 0;
    for (int l = 0; l < LANES; l++)
        if (w->over[l] == 0) w->active[w->n_active++] = l;
}

/* What ends or switches at row k, and what is off from its beginning. Whether anything is left to the lanes. */
static int begin_row(Lanes *w, size_t k) {
    int left = 0;
    if (k > 0 && !(w->kind[k] & SWITCHED)) {
        memcpy(w->off, w->over, sizeof w->off);
        return w->n_active > 0;
    }
    for (int l = 0; l < LANES; l++) {
        if (k >= w->plan[l]->sound) w->over[l] = 1;
        w->off[l] = w->over[l] != 0 || k == 0 || w->plan[l]->kind[k] & SWITCHED ? 1 : 0;
        left |= w->off[l] == 0;
    }
    find_active(w);
    return left;
}

/* Whether any lane is off that is not over. */
static inline int some_off(const Lanes *w) {
    Lane found;
    for (int l = 0; l < LANES; l++) found[l] = w->over[l] == 0 ? w->off[l] : 0;
    return any(found);
}

/* Rows from k on, until one that some lane leaves to core.c: that row. */
static size_t lanes_rows(Lanes *w, const Batch *b, size_t k) {
    find_active(w);
    for (; k < w->rows; k++) {
        const int left = begin_row(w, k);
        if (k == 0 || k >= w->ahead + AHEAD) look_ahead(w, b, k);
        memcpy(w->x0, w->q.x, sizeof w->x0);
        w->kept = 0;
        if (left) lanes_row(w, b, k);
        if (some_off(w)) return k;
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

/* What does not change, and inputs that nothing drives. */
static void parameters_of_run(Lanes *w, int l) {
    const ModelData *from = &w->run[l]->c.q;
    for (int i = 0; i < N_INPUTS; i++) w->q.u[i][l] = from->u[i];
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
    for (int l = 0; l < LANES; l++)
        if (w->over[l] == 0 && w->plan[l]->sound > w->rows) w->rows = w->plan[l]->sound;
    w->kind = malloc(w->rows + 1);
    w->held = calloc(AHEAD * (ALL_INPUTS * (1 + b->n_parts) + b->n_corrected) + 1, sizeof *w->at);
    w->at = at_lane(w->held);
    if (!w->kind || !w->at) return 0;
    w->over_parts = w->at + AHEAD * ALL_INPUTS;
    w->measured = w->over_parts + AHEAD * ALL_INPUTS * b->n_parts;
    for (size_t r = 0; r < AHEAD * (1 + b->n_parts); r++) memcpy(w->at + r * ALL_INPUTS, w->q.u, sizeof w->q.u);
    memset(w->kind, 0, w->rows);
    for (int l = 0; l < LANES; l++) {
        const Plan *plan = w->plan[l];
        if (w->over[l] != 0) continue;
        for (size_t k = 0; k < plan->sound; k++) w->kind[k] |= plan->kind[k] & SWITCHED;
        if (plan->sound < w->rows) w->kind[plan->sound] |= SWITCHED;
    }
    return 1;
}

/* Runs a group of at most LANES runs; they are initialised, and some done. Returns how many failed; -1: out of memory. */
static int lanes_run(Lanes *w, const Batch *b) {
    int failed = 0;
    for (int l = 0; l < LANES; l++) {
        if (l >= w->q.n) w->run[l] = w->run[0], w->plan[l] = w->plan[0]; /* numbers to compute with */
        w->over[l] = l >= w->q.n || w->done[l];
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
