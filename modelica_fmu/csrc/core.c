/* Simulation core: hybrid integration of a generated model (model.h).
 *
 * Between events the relations are frozen and the smooth system is advanced by the classical Runge-Kutta method of order 4. The rates at
 * the end of a step, needed for the event indicators anyway, are the first stage of the next step and give an embedded third-order
 * estimate, (k4 - k5) h/10, which controls the step. A step in which an indicator contradicts its frozen relation is shortened to the
 * contradiction's earliest instant: a bracket on the step's length, narrowed by interpolation to EVENT_WIDTH. The step then ends on the
 * far side, where the event iteration finds the new modes. Where stability alone keeps steps short an implicit method takes over
 * (implicit.h). */
#include "model.h"
#include <float.h>
#include <math.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define EVENT_WIDTH 1e-10     /* s, bracket of an event; of a communication step no more than WIDTH_SHARE */
#define WIDTH_SHARE 1e-6
#define PARABOLAS 5           /* rounds of narrowing it in which operands are taken as parabolas */
#define INDICATOR_MARGIN 1e-10 /* model exchange: indicators cross zero this far beyond the relation's own threshold */
#define MAX_ITERATIONS 50     /* of one event iteration */
#define MAX_RESTLESS 12       /* relations whose values are tried one after the other where following them leads nowhere */
#ifndef MAX_EVENTS
#define MAX_EVENTS 200        /* within one communication step; after them each mode holds for this part of it */
#endif
#define MIN_STEP 10           /* brackets of an event */
#define PATH_STEP 0.25        /* of homotopy(), the first one; the shortest is a 256th of it */
#define DOUBTED 50            /* unknowns at the start up to which another solution is looked for */
#define ANOTHER 1e-6          /* difference of two solutions, relative to max(|value|, 1) */
#define MOVED 1e-5            /* change of a loop's unknown below which it counts as none, relative to max(|unknown|, 1) */
#define JUMP_SHARE 0.1        /* of a step's change: less than that in a small part of the step is no jump */
#define MAX_DOUBTS 50         /* within one communication step, that came to nothing; after them no jump is looked for in it */

typedef struct {
    ModelData q;
    double dx[AT_LEAST_1(N_STATES)], z[AT_LEAST_1(N_RELATIONS)];
    double condition[AT_LEAST_1(N_BRANCHES)]; /* when-conditions after the last event iteration */
    double tick_start[AT_LEAST_1(N_SAMPLES)], tick_interval[AT_LEAST_1(N_SAMPLES)];
    int64_t tick_count[AT_LEAST_1(N_SAMPLES)]; /* ticks already taken */
    double step;  /* last internal step that the error estimate allowed, s */
    double width; /* bracket of an event in this communication step, s */
    double delay_used[AT_LEAST_1(N_DELAYS)]; /* 0: nothing reads the delayed value with the present parameters */
    int started, rates_valid, parameters_changed, events_possible;
    int guessed;                  /* the initial system's first guess has been made */
    int loops_valid, loop_failed; /* 1 + the loop that could not be solved; 0: none */
    int implicit, steps, stiff;   /* steps are implicit; explicit ones within this communication step; of these at the stability limit */
#if JUMPING
    int frozen;                   /* modes are: neither start nor event */
    int doubts;                   /* whether a loop jumps, within this communication step, that came to nothing */
    double leap;                  /* s, length of the next step, within which a loop's solution ends; 0: none is known of */
    double held_time, held_x[AT_LEAST_1(N_STATES)], held_u[AT_LEAST_1(N_INPUTS)], held[N_LOOPED]; /* see hold_solution */
#endif
} Core;

typedef struct {
    double *time, *value;
    size_t n, capacity, at; /* at: where the last look-up ended */
} History;

struct Instance {
    Core c;
    double y[AT_LEAST_1(N_ALGEBRAICS)];
    int outputs_valid, locals_valid;
    int warned; /* that the start is one of several */
#if JUMPING
    int jumped;            /* that a loop's solution has ended has been told */
    double from[N_LOOPED]; /* the loops' unknowns at the start of the step that is tried */
#endif
    unsigned long taken; /* internal steps */
    CoreLog log;
    void *environment;
    History history[AT_LEAST_1(N_DELAYS)];
    double delay[AT_LEAST_1(N_DELAYS)], delay_maximum[AT_LEAST_1(N_DELAYS)];
#if N_CONSTRAINTS > 0
    double constraint[N_CONSTRAINTS * N_STATES], normal[N_CONSTRAINTS * N_CONSTRAINTS];
#endif
    double *jacobian, *factored, by_time[AT_LEAST_1(N_STATES)]; /* of the rates, by columns; W of implicit.h; both NULL until needed */
    double matrix[AT_LEAST_1(N_LARGEST * N_LARGEST)], unused[AT_LEAST_1(N_LARGEST * N_LARGEST)]; /* scratch of Newton's method, by columns */
};

static CoreStatus say(const Instance *s, CoreStatus status, const char *category, const char *format, ...) {
    char text[512];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    if (s->log) s->log(s->environment, status, category, text);
    return status;
}

/* Of numbers, in two instructions; fmin and fmax are calls where a NaN is to count. */
static inline double smaller(double a, double b) { return a < b ? a : b; }
static inline double larger(double a, double b) { return a > b ? a : b; }

static const char *state_name(size_t i) { return model_variables[model_state_references[i]].name; }

/* ---- delays ------------------------------------------------------------------------------------------------------------------- */

/* By which two times may differ that are one: the end of a step and where the next one says that it begins. */
static double time_slack(double time) { return 1e-12 * (1 + fabs(time)); }

static int history_push(History *h, double time, double value) {
    if (h->n == h->capacity) {
        size_t capacity = h->capacity ? 2 * h->capacity : 64;
        double *t = realloc(h->time, capacity * sizeof *t);
        if (t) h->time = t;
        double *v = realloc(h->value, capacity * sizeof *v);
        if (v) h->value = v;
        if (!t || !v) return 0;
        h->capacity = capacity;
    }
    h->time[h->n] = time;
    h->value[h->n++] = value;
    return 1;
}

/* A second entry at the same time is a jump; constant stretches are kept as two entries. */
static int history_record(History *h, double time, double value) {
    size_t last = h->n - 1;
    if (h->n > 0 && time <= h->time[last] + time_slack(time)) {
        if (value == h->value[last]) return 1;
        if (h->n > 1 && h->time[last - 1] == h->time[last]) {
            h->value[last] = value;
            return 1;
        }
        return history_push(h, h->time[last], value);
    }
    if (h->n > 1 && value == h->value[last] && value == h->value[last - 1]) {
        h->time[last] = time;
        return 1;
    }
    return history_push(h, time, value);
}

static void history_trim(History *h, double before) {
    size_t keep = 256;
    if (h->n < keep + 2 || h->time[keep] >= before) return; /* move rarely */
    while (keep + 2 < h->n && h->time[keep + 1] < before) keep++;
    memmove(h->time, h->time + keep, (h->n - keep) * sizeof *h->time);
    memmove(h->value, h->value + keep, (h->n - keep) * sizeof *h->value);
    h->n -= keep;
    h->at = h->at > keep ? h->at - keep : 0;
}

static int history_reached(const History *h, size_t k, double time, int right) {
    const double slack = time_slack(time);
    return right ? h->time[k] <= time + slack : h->time[k] < time - slack;
}

/* Value at `time`; at a jump the later value if `right`, else the earlier one. */
static double history_value(History *h, double time, int right) {
    if (h->n == 0) return 0;
    if (!history_reached(h, 0, time, right)) return h->value[0];
    size_t k = h->at < h->n ? h->at : h->n - 1;
    while (k > 0 && !history_reached(h, k, time, right)) k--;
    while (k + 1 < h->n && history_reached(h, k + 1, time, right)) k++;
    h->at = k;
    if (k + 1 == h->n) return h->value[k];
    double width = h->time[k + 1] - h->time[k];
    if (width <= 0) return right ? h->value[k + 1] : h->value[k];
    double share = (time - h->time[k]) / width;
    return h->value[k] + (h->value[k + 1] - h->value[k]) * (share < 1 ? (share > 0 ? share : 0) : 1);
}

/* Whether the signal's last stretch is a slope: neither held nor a jump. */
static int history_moves(const History *h) {
    if (h->n < 2) return 0;
    size_t last = h->n - 1;
    return h->time[last] > h->time[last - 1] && h->value[last] != h->value[last - 1];
}

static void look_up_delays(Instance *s, int right) {
    for (int i = 0; i < N_DELAYS; i++)
        if (s->c.delay_used[i]) s->c.q.late[i] = history_value(&s->history[i], s->c.q.time - s->delay[i], right);
}

/* Whether any delayed value is read: if not, time and a recorded signal alone change no rate. */
static int delays_matter(const Instance *s) {
    for (int i = 0; i < N_DELAYS; i++)
        if (s->c.delay_used[i]) return 1;
    return 0;
}

static CoreStatus record_delays(Instance *s) {
    if (N_DELAYS == 0) return CORE_OK;
    double value[AT_LEAST_1(N_DELAYS)];
    look_up_delays(s, 1);
    model_delays(&s->c.q, value, s->delay, s->delay_maximum);
    for (int i = 0; i < N_DELAYS; i++) {
        if (s->delay[i] < 0 || s->delay[i] > s->delay_maximum[i])
            return say(s, CORE_ERROR, "logStatusError", "delay time %g s must lie in 0..%g s", s->delay[i], s->delay_maximum[i]);
        if (!history_record(&s->history[i], s->c.q.time, value[i]))
            return say(s, CORE_FATAL, "logStatusFatal", "out of memory for the delay's history");
        history_trim(&s->history[i], s->c.q.time - s->delay_maximum[i] - 1e-3);
    }
    look_up_delays(s, 1);
    return CORE_OK;
}

/* ---- evaluation --------------------------------------------------------------------------------------------------------------- */

static void prepare(Instance *s) {
    if (!s->c.parameters_changed) return;
    model_calculated(&s->c.q);
    model_prepare(&s->c.q);
    model_samples(&s->c.q, s->c.tick_start, s->c.tick_interval);
    model_delays_used(&s->c.q, s->c.delay_used);
    if (N_DELAYS && s->c.started) look_up_delays(s, 1); /* one that has just been switched on: its history is kept all the time */
    s->c.parameters_changed = 0;
    s->c.rates_valid = s->outputs_valid = s->locals_valid = s->c.loops_valid = 0;
}

#include "newton.h"

static void rates(Instance *s) {
    prepare(s);
    if (s->c.rates_valid) return;
    loops(s);
    model_rates(&s->c.q, s->c.dx, s->c.z);
    s->c.rates_valid = 1;
}

static void invalidate(Instance *s) {
    s->c.rates_valid = s->outputs_valid = s->locals_valid = s->c.loops_valid = 0;
}

static int holds(int relation, double indicator) { return model_inclusive[relation] ? indicator >= 0 : indicator > 0; }

static int contradicted(const double *m, const double *z) {
    for (int i = 0; i < N_RELATIONS; i++)
        if (holds(i, z[i]) != (m[i] != 0)) return 1;
    return 0;
}

static CoreStatus check_assertions(Instance *s) {
    if (N_ASSERTIONS == 0) return CORE_OK;
    double ok[AT_LEAST_1(N_ASSERTIONS)];
    CoreStatus status = CORE_OK;
    model_check(&s->c.q, ok);
    for (int i = 0; i < N_ASSERTIONS; i++) {
        if (ok[i] != 0) continue;
        int warning = model_assertions[i].warning;
        say(s, warning ? CORE_WARNING : CORE_ERROR, warning ? "logStatusWarning" : "logStatusError", "%s at t = %g s",
            model_assertions[i].message, s->c.q.time);
        if (!warning) status = CORE_ERROR;
    }
    return status;
}

static CoreStatus check_finite(Instance *s) {
#if N_LOOPS > 0
    if (s->c.loop_failed)
        return say(s, CORE_ERROR, "logStatusError", "the equations of line %d have no solution for %s near t = %g s",
                   model_loop_line[s->c.loop_failed - 1], model_loop_names[s->c.loop_failed - 1], s->c.q.time);
#endif
    for (int i = 0; i < N_STATES; i++)
        if (!isfinite(s->c.q.x[i]) || !isfinite(s->c.dx[i]))
            return say(s, CORE_ERROR, "logStatusError", "%s or its rate is not finite at t = %g s (%g, %g)", state_name(i), s->c.q.time,
                       s->c.q.x[i], s->c.dx[i]);
    return CORE_OK;
}

/* Which branches fire: the first of each chain whose condition has risen. */
static int fire(Instance *s, const double *condition) {
    int any = 0, chain_fired = -1;
    for (int i = 0; i < N_BRANCHES; i++) {
        int rises = condition[i] != 0 && s->c.condition[i] == 0 && chain_fired != model_chain[i];
        s->c.q.fired[i] = rises;
        if (rises) chain_fired = model_chain[i];
        any |= rises;
    }
    return any;
}

/* Frozen relations and roundings as they are now; whether any has changed. */
static int refresh(Instance *s) {
    Core *c = &s->c;
    int changed = 0;
    for (int i = 0; i < N_RELATIONS; i++) {
        double now = holds(i, c->z[i]);
        if (now != c->q.m[i]) c->q.m[i] = now, changed = 1;
    }
#if N_ROUNDINGS > 0
    double r[N_ROUNDINGS];
    model_roundings(&c->q, r);
    for (int i = 0; i < N_ROUNDINGS; i++)
        if (r[i] != c->q.r[i]) c->q.r[i] = r[i], changed = 1;
#endif
    return changed;
}

/* Whether any memory has changed. */
static int take_memories(Instance *s, const double *d) {
    int changed = 0;
    for (int i = 0; i < N_MEMORIES; i++)
        if (d[i] != s->c.q.d[i]) s->c.q.d[i] = d[i], changed = 1;
    return changed;
}

/* Whether some choice of the restless relations agrees with the equations; it is taken, with as few of them true as can be. */
static int search_relations(Instance *s, const unsigned char *restless) {
    Core *c = &s->c;
    int which[MAX_RESTLESS], n = 0;
    for (int i = 0; i < N_RELATIONS; i++) {
        if (!restless[i]) continue;
        if (n == MAX_RESTLESS) return 0;
        which[n++] = i;
    }
    for (int count = 0; count <= n; count++)
        for (int choice = 0; choice < 1 << n; choice++) {
            int true_ones = 0, agrees = 1, changed = 1;
            for (int i = 0; i < n; i++) true_ones += choice >> i & 1;
            if (true_ones != count) continue;
            for (int i = 0; i < n; i++) c->q.m[which[i]] = choice >> i & 1;
            for (int round = 0; round < MAX_ITERATIONS && agrees && changed; round++) { /* the others follow */
                invalidate(s);
                rates(s);
                changed = refresh(s);
                for (int i = 0; i < n; i++) agrees &= c->q.m[which[i]] == (choice >> i & 1);
            }
            if (agrees && !changed) return 1;
        }
    return 0;
}

/* Relations that agree with the equations, for the present pre(): by following them, where they go round in circles by trying. */
static int settle_relations(Instance *s) {
    unsigned char restless[AT_LEAST_1(N_RELATIONS)] = {0};
    for (int round = 0; round < MAX_ITERATIONS; round++) {
        double m[AT_LEAST_1(N_RELATIONS)];
        memcpy(m, s->c.q.m, sizeof m);
        invalidate(s);
        rates(s);
        if (!refresh(s)) return 1;
        for (int i = 0; i < N_RELATIONS; i++) restless[i] |= round >= MAX_ITERATIONS / 2 && m[i] != s->c.q.m[i];
    }
    return search_relations(s, restless);
}

/* What fires, and the new values of memories and states; whether anything of it is new. */
static int update(Instance *s, double *condition, double *x) {
    double d[AT_LEAST_1(N_MEMORIES)];
    if (N_BRANCHES) model_conditions(&s->c.q, condition);
    int any = fire(s, condition);
    if (any || N_MEMORIES) {
        model_updates(&s->c.q, d, x);
        any |= take_memories(s, d);
    }
    return any;
}

static void freeze(Instance *s, int frozen) {
#if JUMPING
    s->c.frozen = frozen;
#else
    (void)s, (void)frozen;
#endif
}

/* New relations, when-clauses and memories until nothing changes any more. */
static CoreStatus iterate_events(Instance *s) {
    Core *c = &s->c;
    double condition[AT_LEAST_1(N_BRANCHES)], x[AT_LEAST_1(N_STATES)];
    int any = 1, settled = 1;
    freeze(s, 0);
    for (int round = 0; any && settled && round < MAX_ITERATIONS; round++) {
        memcpy(c->q.pre, c->q.d, sizeof c->q.pre);
        settled = settle_relations(s);
        if (!settled) break;
        memcpy(x, c->q.x, sizeof x);
        any = update(s, condition, x);
#if CHAINED
        for (int inner = 0, new = any; new && settled; inner++) { /* with the same pre() */
            settled = settle_relations(s) && inner < MAX_ITERATIONS;
            double d[AT_LEAST_1(N_MEMORIES)];
            model_conditions(&c->q, condition);
            fire(s, condition);
            model_updates(&c->q, d, x);
            new = take_memories(s, d);
        }
#endif
        memcpy(c->q.x, x, sizeof x);
        if (N_BRANCHES) memcpy(c->condition, condition, sizeof condition);
    }
    memset(c->q.tick, 0, sizeof c->q.tick);
    if (N_SAMPLES && !any && settled) model_conditions(&c->q, c->condition);
    memset(c->q.fired, 0, sizeof c->q.fired);
    freeze(s, 1);
    if (settled && !any) return check_finite(s);
    invalidate(s);
    rates(s);
    CoreStatus status = check_finite(s);
    if (status != CORE_OK) return status;
    return say(s, CORE_ERROR, "logStatusError", "the conditions at t = %.9g s contradict one another: the event has no solution", c->q.time);
}

/* ---- time events -------------------------------------------------------------------------------------------------------------- */

static double next_tick(const Instance *s, int i) { return s->c.tick_start[i] + (double)s->c.tick_count[i] * s->c.tick_interval[i]; }

static int take_due_ticks(Instance *s) {
    int any = 0;
    for (int i = 0; i < N_SAMPLES; i++) {
        if (next_tick(s, i) > s->c.q.time + time_slack(s->c.q.time)) continue;
        while (next_tick(s, i) <= s->c.q.time + time_slack(s->c.q.time)) s->c.tick_count[i]++;
        s->c.q.tick[i] = 1;
        any = 1;
    }
    return any;
}

static double next_time_event(const Instance *s) {
    double next = HUGE_VAL, now = s->c.q.time + time_slack(s->c.q.time);
    for (int i = 0; i < N_SAMPLES; i++)
        if (next_tick(s, i) < next) next = next_tick(s, i);
    for (int i = 0; i < N_DELAYS; i++) {
        const History *h = &s->history[i];
        if (!s->c.delay_used[i]) continue;
        for (size_t k = h->n; k-- > 1;) {
            double due = h->time[k] + s->delay[i];
            if (due <= now) break;
            if (h->time[k] == h->time[k - 1] && due < next) next = due;
        }
    }
    return next;
}

/* ---- integration -------------------------------------------------------------------------------------------------------------- */

typedef struct {
    double x[AT_LEAST_1(N_STATES)], dx[AT_LEAST_1(N_STATES)], z[AT_LEAST_1(N_RELATIONS)];
    double error;       /* of the embedded estimate, in units of the tolerance */
    double rate;        /* 1/s, how fast the rates change with the states, once that is looked for */
    int passed_through; /* an indicator contradicted its relation on the way but not at the end */
#if JUMPING
    double w[N_LOOPED]; /* the loops' unknowns at the step's end */
    int loop_failed;
#endif
} Trial;

static void evaluate(Instance *s, double time, const double *x, double *dx, double *z) {
    s->c.q.time = time;
    memcpy(s->c.q.x, x, sizeof s->c.q.x);
    if (N_DELAYS) look_up_delays(s, 0);
#if N_LOOPS > 0
    s->c.loops_valid = 0;
    loops(s);
#endif
    model_rates(&s->c.q, dx, z);
}

#include "implicit.h"

/* One Runge-Kutta step of length h from (time, x0, k1) with frozen modes. */
static void attempt_explicit(Instance *s, double time, const double *x0, const double *k1, double h, Trial *trial) {
    double k2[AT_LEAST_1(N_STATES)], k3[AT_LEAST_1(N_STATES)], k4[AT_LEAST_1(N_STATES)], x[AT_LEAST_1(N_STATES)];
    const double tolerance = s->c.q.p[P_TOLERANCE];
    for (int i = 0; i < N_STATES; i++) x[i] = x0[i] + 0.5 * h * k1[i];
    evaluate(s, time + 0.5 * h, x, k2, trial->z);
    for (int i = 0; i < N_STATES; i++) x[i] = x0[i] + 0.5 * h * k2[i];
    evaluate(s, time + 0.5 * h, x, k3, trial->z);
    trial->passed_through = contradicted(s->c.q.m, trial->z);
    for (int i = 0; i < N_STATES; i++) x[i] = x0[i] + h * k3[i];
    evaluate(s, time + h, x, k4, trial->z);
    for (int i = 0; i < N_STATES; i++) trial->x[i] = x0[i] + h / 6 * (k1[i] + 2 * (k2[i] + k3[i]) + k4[i]);
    evaluate(s, time + h, trial->x, trial->dx, trial->z);
    trial->error = 0;
    for (int i = 0; i < N_STATES; i++) {
        double size = fabs(trial->x[i]) > model_nominals[i] ? fabs(trial->x[i]) : model_nominals[i];
        double error = fabs(h * 0.1 * (k4[i] - trial->dx[i])) / (tolerance * size);
        if (!(error <= trial->error)) trial->error = error; /* keeps a NaN */
    }
    trial->rate = 0;
    if (s->c.steps + 1 < STIFF_WATCH && h > MIN_STEP * s->c.width) return;
    double far = 0, apart = 0; /* two points at the step's end, and their rates */
    for (int i = 0; i < N_STATES; i++) {
        const double size = scaled(trial, i);
        far = fmax(far, fabs(trial->x[i] - x[i]) / size);
        apart = fmax(apart, fabs(trial->dx[i] - k4[i]) / size);
    }
    trial->rate = far > 0 ? apart / far : 0;
}

static void attempt(Instance *s, double time, const double *x0, const double *k1, double h, Trial *trial) {
#if JUMPING
    memcpy(s->c.q.w, s->from, sizeof s->from); /* not from where a longer trial has led */
#endif
    if (s->c.implicit) attempt_implicit(s, time, x0, k1, h, trial);
    else attempt_explicit(s, time, x0, k1, h, trial);
#if JUMPING
    memcpy(trial->w, s->c.q.w, sizeof trial->w);
    trial->loop_failed = s->c.loop_failed;
#endif
}

#if JUMPING
/* ---- jumps of algebraic loops -------------------------------------------------------------------------------------------------
 *
 * Under noEvent() a nonlinear loop can lose the solution that it was at and go to another one: a Schmitt trigger made of an ideal
 * amplifier. That is found by going back: Newton's method, from the unknowns at the end of a step, does not lead to those at its
 * start. Whether it is a jump or a steep change is then decided by halving the step. */

static double floor_of(double unknown) { return MOVED * fmax(1, fabs(unknown)); }

/* Whether the unknowns w belong to another solution than w0 did at (time0, x0). Leaves time, states and unknowns anywhere. */
static int left_solution(Instance *s, const double *w, double time0, const double *x0, const double *w0) {
    Core *c = &s->c;
    int moved = 0;
    for (int i = 0; i < N_LOOPED; i++) moved |= fabs(w[i] - w0[i]) > floor_of(w0[i]);
    if (!moved) return 0;
    c->q.time = time0;
    memcpy(c->q.x, x0, sizeof c->q.x);
    memmove(c->q.w, w, sizeof c->q.w);
    if (N_DELAYS) look_up_delays(s, 1);
    c->loops_valid = 0;
    loops(s);
    for (int i = 0; i < N_LOOPED; i++)
        if (!(fabs(c->q.w[i] - w0[i]) <= fmax(JUMP_SHARE * fabs(w[i] - w0[i]), floor_of(w0[i])))) return 1;
    return 0;
}

/* Largest change from low to high as a share of that from w0 to w. */
static double share_between(const double *low, const double *high, const double *w0, const double *w) {
    double largest = 0;
    for (int i = 0; i < N_LOOPED; i++) {
        const double whole = fabs(w[i] - w0[i]);
        if (whole > floor_of(w0[i])) largest = fmax(largest, fabs(high[i] - low[i]) / whole);
    }
    return largest;
}

/* A warning once: where there are several others the equations do not say which. */
static void tell_jump(Instance *s, double time, const double *w) {
    int loop = 0, which = 0;
    for (int i = 0; i < N_LOOPED; i++)
        if (fabs(w[i] - s->from[i]) > fabs(w[which] - s->from[which])) which = i;
    for (int first = 0; first + model_loop_size[loop] <= which;) first += model_loop_size[loop++];
    say(s, s->jumped ? CORE_OK : CORE_WARNING, s->jumped ? "logEvents" : "logStatusWarning",
        "the solution of the equations of line %d for %s ends at t = %.9g s: another one is taken, as at an event", model_loop_line[loop],
        model_loop_names[loop], time);
    s->jumped = 1;
}

/* Shortens a step, at the end of which the loops have another solution, to where they still have theirs. Sets `leap` where that is
 * lost right behind it, `event` where it is lost at once. Returns the new length. */
static double stop_before_jump(Instance *s, double time, const double *x0, const double *k1, double h, Trial *trial, int *event) {
    double whole[N_LOOPED], low = 0, high = h, low_w[N_LOOPED], high_w[N_LOOPED], share = 1;
    memcpy(whole, trial->w, sizeof whole);
    memcpy(low_w, s->from, sizeof low_w);
    memcpy(high_w, trial->w, sizeof high_w);
    while (high - low > s->c.width && (low == 0 || share > JUMP_SHARE)) {
        const double guess = 0.5 * (low + high);
        Trial inner;
        attempt(s, time, x0, k1, guess, &inner);
        if (left_solution(s, inner.w, time, x0, s->from)) {
            high = guess;
            memcpy(high_w, inner.w, sizeof high_w);
        } else {
            low = guess;
            memcpy(low_w, inner.w, sizeof low_w);
            *trial = inner;
        }
        share = share_between(low_w, high_w, s->from, whole);
    }
    const int jumps = share > JUMP_SHARE;
    if (low > 0) s->c.leap = jumps ? 2 * (high - low) : 0;
    else attempt(s, time, x0, k1, high, trial), *event = jumps;
    if (!jumps && ++s->c.doubts == MAX_DOUBTS)
        say(s, CORE_WARNING, "logStatusWarning", "near t = %.9g s algebraic loops have solutions too close to tell a jump from", time);
    return low > 0 ? low : high;
}
#endif

/* Where the parabola through three points (t, z) has its root next to the last one; NaN: nowhere. */
static double root_of(const double *t, const double *z) {
    const double slope = (z[2] - z[1]) / (t[2] - t[1]), bend = (slope - (z[1] - z[0]) / (t[1] - t[0])) / (t[2] - t[0]);
    const double at_last = slope + bend * (t[2] - t[1]), root = sqrt(at_last * at_last - 4 * bend * z[2]);
    return t[2] - 2 * z[2] / (at_last + copysign(root, at_last));
}

/* Where in a step of length h the earliest contradiction lies: behind `low`, and by `high`. */
typedef struct {
    double low, high, low_share, high_share;
    double low_z[AT_LEAST_1(N_RELATIONS)], high_z[AT_LEAST_1(N_RELATIONS)]; /* operands of the relations there */
    double t[3], last_z[3][AT_LEAST_1(N_RELATIONS)];                        /* at the last three trials */
    int side, round;
} Bracket;

/* z0, z: operands at the step's start and at its end. */
static void open_bracket(Bracket *b, const double *z0, const double *z, double h) {
    memset(b, 0, sizeof *b);
    b->high = b->t[2] = h;
    b->low_share = b->high_share = 1;
    memcpy(b->low_z, z0, sizeof b->low_z);
    memcpy(b->high_z, z, sizeof b->high_z);
    memcpy(b->last_z[1], z0, sizeof b->low_z);
    memcpy(b->last_z[2], z, sizeof b->high_z);
}

static int is_open(const Bracket *b, double width) { return b->round < 100 && b->high - b->low > width; }

/* The length to try next. Parabolas through the last three trials first, which foretell a smooth operand's zero at once; else secants,
 * whose end that stays counts half each time. m: the frozen relations. */
static double next_length(const Bracket *b, const double *m, double width) {
    double guess = b->high;
    for (int i = 0; i < N_RELATIONS; i++) {
        if (holds(i, b->high_z[i]) == (m[i] != 0)) continue;
        const double from = b->low_share * b->low_z[i], rise = b->high_share * b->high_z[i] - from;
        const double z[] = {b->last_z[0][i], b->last_z[1][i], b->last_z[2][i]};
        double share = rise != 0 ? -from / rise : 0.5;
        if (!(share >= 0 && share <= 1)) share = 0.5;
        double zero = b->round > 0 && b->round <= PARABOLAS ? root_of(b->t, z) : NAN;
        if (!(zero >= b->low && zero <= b->high)) zero = b->low + share * (b->high - b->low);
        if (zero < guess) guess = zero;
    }
    if (b->round > 30) guess = 0.5 * (b->low + b->high);
    if (guess < b->low + 0.4 * width) guess = b->low + 0.4 * width;
    if (guess > b->high - 0.4 * width) guess = b->high - 0.4 * width;
    return guess;
}

/* Narrowed by a trial of some length with operands z. Whether it ends behind the contradiction. */
static int narrow(Bracket *b, const double *m, double length, const double *z) {
    const int behind = contradicted(m, z);
    memmove(b->t, b->t + 1, 2 * sizeof *b->t);
    memmove(b->last_z, b->last_z + 1, 2 * sizeof *b->last_z);
    b->t[2] = length;
    memcpy(b->last_z[2], z, sizeof b->high_z);
    memcpy(behind ? b->high_z : b->low_z, z, sizeof b->high_z);
    if (behind) {
        b->high = length, b->high_share = 1;
        if (b->side < 0) b->low_share *= 0.5;
    } else {
        b->low = length, b->low_share = 1;
        if (b->side > 0) b->high_share *= 0.5;
    }
    b->side = behind ? -1 : 1;
    b->round++;
    return behind;
}

/* Shortens the step that ends in a contradiction to the earliest one found: on return `trial` ends just behind it. */
static double locate(Instance *s, double time, const double *x0, const double *k1, const double *z0, double h, Trial *trial) {
    Bracket bracket;
    open_bracket(&bracket, z0, trial->z, h);
    while (is_open(&bracket, s->c.width)) {
        Trial inner;
        const double length = next_length(&bracket, s->c.q.m, s->c.width);
        attempt(s, time, x0, k1, length, &inner);
        if (narrow(&bracket, s->c.q.m, length, inner.z)) *trial = inner;
    }
    return bracket.high;
}

/* Puts the states back onto the constraints that index reduction left, by the shortest way. */
static void project(Instance *s) {
#if N_CONSTRAINTS > 0
    double residual[N_CONSTRAINTS], factor[N_CONSTRAINTS];
    int row[N_CONSTRAINTS];
    for (int round = 0; round < 5; round++) {
        model_constraints(&s->c.q, residual, s->constraint);
        for (int i = 0; i < N_CONSTRAINTS; i++)
            for (int j = 0; j < N_CONSTRAINTS; j++) {
                double sum = 0;
                for (int k = 0; k < N_STATES; k++) sum += s->constraint[i + k * N_CONSTRAINTS] * s->constraint[j + k * N_CONSTRAINTS];
                s->normal[i + j * N_CONSTRAINTS] = sum;
            }
        if (!lu_factor(s->normal, N_CONSTRAINTS, row)) return; /* one follows from the others */
        lu_solve(s->normal, N_CONSTRAINTS, row, residual, factor);
        double largest = 0;
        for (int k = 0; k < N_STATES; k++) {
            double change = 0;
            for (int i = 0; i < N_CONSTRAINTS; i++) change += s->constraint[i + k * N_CONSTRAINTS] * factor[i];
            if (!isfinite(change)) return;
            s->c.q.x[k] -= change;
            const double share = fabs(change) / (1 + fabs(s->c.q.x[k]));
            if (share > largest) largest = share;
        }
        if (largest < 1e-14) break;
    }
    invalidate(s);
    rates(s);
#else
    (void)s;
#endif
}

/* The first of as few equal steps over what is left as are no longer than `longest`; `last`: it is the only one. */
static inline double piece_of(double left, double longest, int *last) {
    const double pieces = ceil(left / longest * (1 - 1e-9));
    *last = pieces <= 1;
    return *last ? left : left / pieces;
}

/* One accepted internal step, not beyond `end`. Sets `event` where it ends in one. */
static CoreStatus advance(Instance *s, double end, int locating, int *event) {
    Core *c = &s->c;
    double x0[AT_LEAST_1(N_STATES)], k1[AT_LEAST_1(N_STATES)], z0[AT_LEAST_1(N_RELATIONS)];
    const double time = c->q.time, longest = c->q.p[P_MAX_STEP];
    memcpy(x0, c->q.x, sizeof x0);
    memcpy(k1, c->dx, sizeof k1);
    memcpy(z0, c->z, sizeof z0);
    if (c->implicit && !take_jacobian(s)) return say(s, CORE_FATAL, "logStatusFatal", "out of memory for the Jacobian");
    double h = c->step < longest ? c->step : longest;
    for (int i = 0; i < N_DELAYS; i++) /* a moving signal is not known further ahead than its delay; a held one is */
        if (s->c.delay_used[i] && history_moves(&s->history[i]) && h > s->delay[i]) h = s->delay[i] > 1e-5 ? s->delay[i] : 1e-5;
    const double left = end - time;
    int last, jumps = 0, shortened = 0;
    h = piece_of(left, h, &last);
    const int whole = last;
#if JUMPING
    memcpy(s->from, c->q.w, sizeof s->from);
    jumps = locating && c->leap > 0;
    if (jumps && c->leap < h) h = c->leap, last = 0;
    c->leap = 0;
#endif
    const double wanted = h;
    Trial trial;
    for (;;) {
        attempt(s, time, x0, k1, h, &trial);
        if (trial.error <= 1 || jumps) break;
        if (h <= MIN_STEP * c->width) {
            if (c->implicit || !(h * trial.rate > STIFF_LIMIT)) break;
            c->implicit = 1; /* too stiff even for the shortest explicit step */
            c->q.time = time;
            memcpy(c->q.x, x0, sizeof x0);
            invalidate(s);
            if (!take_jacobian(s)) return say(s, CORE_FATAL, "logStatusFatal", "out of memory for the Jacobian");
            h = wanted;
            last = whole;
            continue;
        }
        h *= trial.error < 1e8 ? fmax(0.2, 0.9 / sqrt(sqrt(trial.error))) : 0.1;
        last = 0;
    }
#if JUMPING
    if (locating && c->doubts < MAX_DOUBTS && left_solution(s, trial.w, time, x0, s->from)) {
        if (!jumps) h = stop_before_jump(s, time, x0, k1, h, &trial, &jumps), last = 0;
        if (jumps) tell_jump(s, time + h, trial.w);
        shortened = 1;
    } else
        jumps = 0; /* not yet */
#endif
    *event = locating && !jumps && contradicted(c->q.m, trial.z);
    if (locating && !*event && trial.passed_through && h > 16 * MIN_STEP * c->width) { /* look closer: two half steps */
        Trial half;
        attempt(s, time, x0, k1, 0.5 * h, &half);
        if (contradicted(c->q.m, half.z)) trial = half, h = 0.5 * h, last = 0, *event = 1;
    }
    if (*event) {
        h = locate(s, time, x0, k1, z0, h, &trial);
        last = last && h >= left;
    } else if (jumps || shortened) {
        *event = jumps;
    } else {
        double grow = trial.error > 1e-6 ? 0.9 / sqrt(sqrt(trial.error)) : 5;
        const double next = h * smaller(5, larger(0.5, grow));
        if (!last || grow < 1 || next > c->step) c->step = larger(MIN_STEP * c->width, next); /* else it was its end that made it short */
        watch_stiffness(s, h, &trial);
    }
    s->taken++;
    c->q.time = last ? end : time + h;
    memcpy(c->q.x, trial.x, sizeof trial.x);
    memcpy(c->dx, trial.dx, sizeof trial.dx);
    memcpy(c->z, trial.z, sizeof trial.z);
    c->rates_valid = 1;
#if JUMPING
    memcpy(c->q.w, trial.w, sizeof trial.w);
    c->loop_failed = trial.loop_failed;
    c->loops_valid = 1;
#elif N_LOOPS > 0
    c->loops_valid = 0; /* the last trial may have been another one */
    loops(s);
#endif
    project(s);
    CoreStatus status = check_finite(s);
    if (status != CORE_OK) { /* back to the last good state */
        c->q.time = time;
        memcpy(c->q.x, x0, sizeof x0);
        invalidate(s);
    }
    return status;
}

static CoreStatus settle_now(Instance *s) {
    CoreStatus status = record_delays(s);
    if (status != CORE_OK) return status;
    if (delays_matter(s)) invalidate(s);
    if (take_due_ticks(s) || s->c.events_possible) {
        s->c.events_possible = 0;
    } else {
        rates(s);
        if (!contradicted(s->c.q.m, s->c.z)) return check_finite(s);
    }
    status = iterate_events(s);
    return status == CORE_OK ? record_delays(s) : status; /* what the event changed jumps here */
}

/* Bracket of an event in a communication step, s. */
static double event_width(double time, double step) {
    return larger(smaller(EVENT_WIDTH, WIDTH_SHARE * step), 4 * DBL_EPSILON * fabs(time));
}

CoreStatus core_step(Instance *s, double time, double step) {
    const double end = time + step, longest = s->c.q.p[P_MAX_STEP];
    double held = time; /* modes are kept until then */
    s->c.steps = s->c.stiff = 0;
#if JUMPING
    s->c.doubts = 0;
#endif
    s->c.width = event_width(time, step);
    int events = 0;
    if (!(end - (end - longest) > 0.5 * longest)) /* a sampled clock would tick for ever without getting there */
        return say(s, CORE_ERROR, "logStatusError", "a step to t = %g s: its end is no number that internal steps of %g s can reach", end, longest);
    prepare(s);
    s->c.q.time = time;
    CoreStatus status = settle_now(s);
    while (status == CORE_OK && s->c.q.time < end) {
        double due = next_time_event(s), target = due < end - time_slack(end) ? due : end;
        int event = 0, holding = s->c.q.time < held;
        if (holding && held < target) target = held;
        status = advance(s, target, !holding, &event);
        if (status != CORE_OK) break;
        if (event && ++events >= MAX_EVENTS) {
            held = s->c.q.time + step / MAX_EVENTS;
            if (events == MAX_EVENTS)
                say(s, CORE_WARNING, "logEvents", "more than %d events before t = %.9g s: each mode now holds for %g s", MAX_EVENTS, end, step / MAX_EVENTS);
        }
        if (event) {
            status = record_delays(s); /* what led up to it; what it changes is recorded below, as a jump */
            if (status == CORE_OK) status = iterate_events(s);
        }
        if (N_DELAYS && status == CORE_OK) {
            double jump = s->c.q.time;
            status = record_delays(s);
            if (jump >= due && delays_matter(s)) invalidate(s); /* evaluated when the next step settles */
        }
        const int tick = due <= s->c.q.time + time_slack(end), released = holding && s->c.q.time >= held;
        if (status == CORE_OK && s->c.q.time < end && (tick || released)) status = settle_now(s);
    }
    s->outputs_valid = s->locals_valid = 0;
    if (status == CORE_OK) status = check_assertions(s);
    return status;
}

/* Model exchange: the solution of the loops at the last completed step, from which each trial of the importer starts. */
static void hold_solution(Instance *s) {
#if JUMPING
    s->c.held_time = s->c.q.time;
    memcpy(s->c.held_x, s->c.q.x, sizeof s->c.q.x);
    memcpy(s->c.held_u, s->c.q.u, sizeof s->c.q.u);
    memcpy(s->c.held, s->c.q.w, sizeof s->c.held);
#else
    (void)s;
#endif
}

static void back_to_held(Instance *s) {
#if JUMPING
    memcpy(s->c.q.w, s->c.held, sizeof s->c.held);
#else
    (void)s;
#endif
}

#if JUMPING
/* Whether the loops have left the solution that is held. */
static int left_held(Instance *s) {
    if (!s->c.frozen) return 0;
    rates(s);
    const Core now = s->c;
    memcpy(s->c.q.u, now.held_u, sizeof now.held_u);
    const int left = left_solution(s, now.q.w, now.held_time, now.held_x, now.held);
    s->c = now;
    return left;
}

/* The same at a completed step or an event, after which another solution may be held. */
static int tell_left(Instance *s) {
    const int left = left_held(s);
    memcpy(s->from, s->c.held, sizeof s->from);
    if (left) tell_jump(s, s->c.q.time, s->c.q.w);
    hold_solution(s);
    return left;
}
#endif

/* ---- life cycle --------------------------------------------------------------------------------------------------------------- */

Instance *core_new(CoreLog log, void *environment) {
    Instance *s = calloc(1, sizeof *s);
    if (!s) return NULL;
    s->log = log;
    s->environment = environment;
    core_reset(s);
    return s;
}

void core_free(Instance *s) {
    if (!s) return;
    for (int i = 0; i < N_DELAYS; i++) {
        free(s->history[i].time);
        free(s->history[i].value);
    }
    free(s->jacobian);
    free(s->factored);
    free(s);
}

void core_reset(Instance *s) {
    memset(&s->c, 0, sizeof s->c);
    memset(s->y, 0, sizeof s->y);
    memcpy(s->c.q.p, model_parameter_starts, N_PARAMETERS * sizeof(double));
    memcpy(s->c.q.u, model_input_starts, N_INPUTS * sizeof(double));
    s->c.q.path = 1;
    s->warned = 0;
#if JUMPING
    s->jumped = 0;
#endif
    for (int i = 0; i < N_DELAYS; i++) s->history[i].n = s->history[i].at = 0;
    s->c.step = HUGE_VAL;
    s->taken = 0;
    s->c.parameters_changed = 1;
    prepare(s);
    model_loop_starts(&s->c.q, s->c.q.w);
    hold_solution(s);
    model_starts(&s->c.q, s->c.q.x);
    model_memory_starts(&s->c.q, s->c.q.d);
    invalidate(s);
}

static CoreStatus refuse(const Instance *s, const ModelVariable *v, double value, const char *why) {
    return say(s, CORE_ERROR, "logStatusError", "%s = %g refused: %s", v->name, value, why);
}

CoreStatus core_set(Instance *s, unsigned reference, double value) {
    if (reference >= model_n_variables) return say(s, CORE_ERROR, "logStatusError", "unknown value reference %u", reference);
    const ModelVariable *v = &model_variables[reference];
    if (!isfinite(value)) return refuse(s, v, value, "not a finite number");
    if (v->settable == SET_NEVER) return refuse(s, v, value, "it cannot be set");
    if (v->settable == SET_BEFORE_START && s->c.started) return refuse(s, v, value, "it is fixed once the simulation has started");
    if (value < v->min || value > v->max) {
        char bounds[96];
        snprintf(bounds, sizeof bounds, "must lie in %g..%g", v->min, v->max);
        return refuse(s, v, value, bounds);
    }
    switch (v->kind) {
    case VK_PARAMETER:
        if (s->c.q.p[v->index] == value) return CORE_OK;
        s->c.q.p[v->index] = value;
        s->c.parameters_changed = s->c.events_possible = 1;
        break;
    case VK_INPUT:
        if (s->c.q.u[v->index] == value) return CORE_OK;
        s->c.q.u[v->index] = value;
        if (v->type != VT_REAL) s->c.events_possible = 1;
        break;
    default: s->c.q.x[v->index] = value;
    }
    invalidate(s);
    return CORE_OK;
}

CoreStatus core_get(Instance *s, unsigned reference, double *value) {
    if (reference >= model_n_variables) return say(s, CORE_ERROR, "logStatusError", "unknown value reference %u", reference);
    const ModelVariable *v = &model_variables[reference];
    prepare(s);
    switch (v->kind) {
    case VK_TIME: *value = s->c.q.time; break;
    case VK_PARAMETER:
    case VK_CALCULATED: *value = s->c.q.p[v->index]; break;
    case VK_INPUT: *value = s->c.q.u[v->index]; break;
    case VK_STATE:
        if (!s->c.started && v->settable == SET_NEVER) { /* follows the parameters until the start */
            double x[AT_LEAST_1(N_STATES)];
            model_starts(&s->c.q, x);
            s->c.q.x[v->index] = x[v->index];
        }
        *value = s->c.q.x[v->index];
        break;
    case VK_DERIVATIVE:
        rates(s);
        *value = s->c.dx[v->index];
        break;
    case VK_DISCRETE: *value = s->c.q.d[v->index]; break;
    default:
        loops(s);
        if (v->index < N_OUTPUTS && !s->locals_valid) {
            if (!s->outputs_valid) model_outputs(&s->c.q, s->y);
            s->outputs_valid = 1;
        } else if (!s->locals_valid) {
            model_locals(&s->c.q, s->y);
            s->locals_valid = s->outputs_valid = 1;
        }
        *value = s->y[v->index];
    }
    return CORE_OK;
}

/* Modes, and what the initial equations determine with them; 0: the equations have no solution near the start values. */
static int start_modes(Instance *s) {
    const int once = N_RELATIONS + N_ROUNDINGS == 0;
    for (int round = 0; round < MAX_ITERATIONS; round++) {
#if N_INITIAL > 0
        if ((round > 0 || once) && !solve_initial(s)) return 0;
#endif
        invalidate(s);
        rates(s);
        if (!refresh(s) && (round > 0 || N_INITIAL == 0 || once)) break;
    }
    return 1;
}

/* The start along the path of homotopy(), from the simplified equations to the actual ones. 0: there is none, or it does not lead
 * there; all is then as before. */
static int follow_homotopy(Instance *s) {
#if HOMOTOPY
    Core *c = &s->c;
    const Core before = *c;
    Core reached = *c;
    double step = PATH_STEP;
    for (c->q.path = 0;; c->q.path = fmin(1, reached.q.path + step)) {
        const int found = start_modes(s) && !c->loop_failed;
        if (found && c->q.path >= 1) return 1;
        if (found) {
            reached = *c;
            continue;
        }
        step *= 0.5;
        if (c->q.path == 0 || step < PATH_STEP / 256) break;
        *c = reached;
    }
    *c = before;
    invalidate(s);
#else
    (void)s;
#endif
    return 0;
}

#define DOUBTFUL ((N_LARGEST > 0 || CIRCULAR) && N_LARGEST <= DOUBTED && !HOMOTOPY)
#define LAST_TRIAL 4
#if DOUBTFUL
/* Other guesses, where the model gives none; the last one is that of modes, all the other way round. 0: it has nothing to change. */
static int guess_otherwise(Core *c, int trial) {
    static const double far[LAST_TRIAL] = {1, -1, 30, -30};
    int any = 0;
    if (trial == LAST_TRIAL) {
        for (int i = 0; i < N_RELATIONS && CIRCULAR; i++) c->q.m[i] = c->q.m[i] == 0;
        return CIRCULAR;
    }
    for (int i = 0; i < N_INITIAL + N_LOOPED; i++) {
        double *value = i < N_INITIAL ? initial_unknown(c, i) : &c->q.w[i - N_INITIAL];
        if (model_open[i] == '1') *value += far[trial] * fmax(1, fabs(*value)), any = 1;
    }
    return any;
}

/* The first variable with another value than in `values`, which are taken where `compare` is 0; else model_n_variables. */
static size_t another(Instance *s, double *values, int compare, double *now) {
    for (size_t i = 0; i < model_n_variables; i++) {
        core_get(s, (unsigned)i, now);
        if (compare && fabs(*now - values[i]) > ANOTHER * fmax(1, fmax(fabs(*now), fabs(values[i])))) return i;
        if (!compare) values[i] = *now;
    }
    return model_n_variables;
}
#endif

/* Warns where another guess leads to another start: the model does not say then which of them it means. */
static void doubt_start(Instance *s) {
#if DOUBTFUL
    const Core found = s->c;
    double now, *taken = s->warned || found.loop_failed ? NULL : malloc(model_n_variables * sizeof *taken);
    if (!taken) return;
    another(s, taken, 0, &now);
    for (int trial = 0; trial <= LAST_TRIAL && !s->warned; trial++) {
        if (!guess_otherwise(&s->c, trial)) continue; /* nothing to guess */
        if (start_modes(s) && !s->c.loop_failed && !contradicted(s->c.q.m, s->c.z)) {
            const size_t i = another(s, taken, 1, &now);
            s->warned = i < model_n_variables;
            if (s->warned)
                say(s, CORE_WARNING, "logStatusWarning", "the start is one of several: %s = %g is taken, %g solves the equations, too; %s",
                    model_variables[i].name, taken[i], now,
                    trial < LAST_TRIAL ? "give start values near the one that is meant" : "remember by pre() which mode it is in");
        }
        s->c = found;
    }
    free(taken);
    invalidate(s);
#else
    (void)s;
#endif
}

CoreStatus core_initialise(Instance *s, double start_time) {
    Core *c = &s->c;
    double x[AT_LEAST_1(N_STATES)], on[AT_LEAST_1(N_BRANCHES)];
    prepare(s);
    model_starts(&c->q, x);
    for (int i = 0; i < N_STATES; i++)
        if (model_variables[model_state_references[i]].settable == SET_NEVER) c->q.x[i] = x[i];
    model_memory_starts(&c->q, c->q.d);
    memcpy(c->q.pre, c->q.d, sizeof c->q.pre);
    c->q.time = start_time;
    for (int i = 0; i < N_SAMPLES; i++) {
        if (!(c->tick_interval[i] > 0)) return say(s, CORE_ERROR, "logStatusError", "sample interval %g s must be > 0 s", c->tick_interval[i]);
        double passed = (start_time - c->tick_start[i]) / c->tick_interval[i];
        c->tick_count[i] = passed > 0 ? (int64_t)ceil(passed - 1e-9) : 0;
    }
    c->started = 1;
    c->guessed = 0;
    freeze(s, 0);
    CoreStatus status = N_INITIAL > 0 || N_LOOPS > 0 ? CORE_OK : check_assertions(s);
    if (status == CORE_OK) status = record_delays(s);
    if (status != CORE_OK) return status;
    /* relations first, without firing what is true from the start; when initial() does fire */
    if (!follow_homotopy(s) && !start_modes(s))
        return say(s, CORE_ERROR, "logStatusError", "the initial equations have no solution near the start values");
    doubt_start(s);
#if N_INITIAL > 0
    memcpy(c->q.pre, c->q.d, sizeof c->q.pre);
#endif
    if (N_BRANCHES) {
        model_conditions(&c->q, c->condition);
        c->q.initial = 1;
        model_conditions(&c->q, on);
        for (int i = 0; i < N_BRANCHES; i++)
            if (on[i] != c->condition[i]) c->condition[i] = 0;
    }
    c->q.initial = 1;
    status = iterate_events(s);
    c->q.initial = 0;
    if ((N_INITIAL > 0 || N_LOOPS > 0) && status == CORE_OK) status = check_assertions(s);
    if (N_BRANCHES) model_conditions(&c->q, c->condition);
    hold_solution(s);
    invalidate(s);
    return status;
}

double core_time(const Instance *s) { return s->c.q.time; }

unsigned long core_taken(const Instance *s) { return s->taken; }

/* ---- model exchange ----------------------------------------------------------------------------------------------------------- */

CoreStatus core_set_time(Instance *s, double time) {
    if (!isfinite(time)) return say(s, CORE_ERROR, "logStatusError", "time is not finite");
    if (time == s->c.q.time) return CORE_OK;
    s->c.q.time = time;
    if (N_DELAYS) look_up_delays(s, 0);
    back_to_held(s);
    invalidate(s);
    return CORE_OK;
}

CoreStatus core_set_states(Instance *s, const double *x) {
    for (int i = 0; i < N_STATES; i++)
        if (!isfinite(x[i])) return say(s, CORE_ERROR, "logStatusError", "%s is not finite", state_name(i));
    memcpy(s->c.q.x, x, N_STATES * sizeof *x);
    back_to_held(s);
    invalidate(s);
    return CORE_OK;
}

void core_get_states(Instance *s, double *x) { memcpy(x, s->c.q.x, N_STATES * sizeof *x); }

CoreStatus core_derivatives(Instance *s, double *dx) {
    rates(s);
    memcpy(dx, s->c.dx, N_STATES * sizeof *dx);
#if JUMPING
    if (left_held(s)) { /* the importer's method has to get across, to where the indicator sends it back: as if nothing jumped */
        ModelData q = s->c.q;
        double z[AT_LEAST_1(N_RELATIONS)];
        memcpy(q.w, s->c.held, sizeof q.w);
        model_rates(&q, dx, z);
    }
#endif
    return CORE_OK;
}

CoreStatus core_indicators(Instance *s, double *z) {
    rates(s);
    for (int i = 0; i < N_RELATIONS; i++) z[i] = s->c.z[i] + (s->c.q.m[i] != 0 ? INDICATOR_MARGIN : -INDICATOR_MARGIN);
#if JUMPING
    z[N_RELATIONS] = left_held(s) ? -1 : 1;
#endif
    return CORE_OK;
}

CoreStatus core_update_discrete(Instance *s, EventInfo *info) {
    double before[AT_LEAST_1(N_STATES)];
    memcpy(before, s->c.q.x, sizeof before);
    prepare(s);
    CoreStatus status = record_delays(s);
    if (status != CORE_OK) return status;
#if JUMPING
    tell_left(s);
#endif
    take_due_ticks(s);
    s->c.events_possible = 0;
    status = iterate_events(s);
    if (status == CORE_OK) status = record_delays(s); /* what the event changed jumps here */
    memset(info, 0, sizeof *info);
    info->states_changed = memcmp(before, s->c.q.x, N_STATES * sizeof *before) != 0;
    info->next_time = next_time_event(s);
    info->next_time_defined = info->next_time < HUGE_VAL;
    s->outputs_valid = s->locals_valid = 0;
    hold_solution(s);
    return status == CORE_OK ? check_assertions(s) : status;
}

CoreStatus core_completed_step(Instance *s, int *enter_event_mode) {
    *enter_event_mode = 0;
    prepare(s);
#if JUMPING
    *enter_event_mode = tell_left(s);
#endif
    CoreStatus status = record_delays(s);
    if (delays_matter(s)) invalidate(s);
#if N_LOOPS > 0
    rates(s); /* of a step that was tried only it is no error */
    if (status == CORE_OK) status = check_finite(s);
#endif
    return status == CORE_OK ? check_assertions(s) : status;
}

/* ---- directional derivatives -------------------------------------------------------------------------------------------------- */

static int seed_index(const ModelVariable *v) {
    switch (v->kind) {
    case VK_STATE: return v->index;
    case VK_INPUT: return v->type == VT_REAL ? N_STATES + v->index : -1;
    case VK_PARAMETER: return v->type == VT_REAL ? N_STATES + N_INPUTS + v->index : -1;
    default: return -1;
    }
}

CoreStatus core_directional(Instance *s, const unsigned *unknown, size_t n_unknown, const unsigned *known, size_t n_known,
                            const double *seed, double *out) {
    double seeds[AT_LEAST_1(N_SEEDS)] = {0}, dx[AT_LEAST_1(N_STATES)], y[AT_LEAST_1(N_ALGEBRAICS)];
    prepare(s);
    for (size_t j = 0; j < n_known; j++) {
        int i = known[j] < model_n_variables ? seed_index(&model_variables[known[j]]) : -1;
        if (i < 0) return say(s, CORE_ERROR, "logStatusError", "no derivative with respect to value reference %u", known[j]);
        seeds[i] += seed[j];
    }
    loop_seeds(s, seeds);
    model_directional(&s->c.q, seeds, dx, y);
    for (size_t j = 0; j < n_unknown; j++) {
        const ModelVariable *v = unknown[j] < model_n_variables ? &model_variables[unknown[j]] : NULL;
        if (v && v->kind == VK_DERIVATIVE) out[j] = dx[v->index];
        else if (v && v->kind == VK_ALGEBRAIC && v->type == VT_REAL) out[j] = y[v->index];
        else return say(s, CORE_ERROR, "logStatusError", "no derivative of value reference %u", unknown[j]);
    }
    return CORE_OK;
}

/* ---- snapshots ---------------------------------------------------------------------------------------------------------------- */

typedef struct {
    uint64_t magic, size;
} SnapshotHead;

static uint64_t snapshot_magic(void) { /* FNV-1a of what tells this model from others */
    uint64_t hash = 1469598103934665603u;
    for (const char *c = model_name; *c; c++) hash = (hash ^ (unsigned char)*c) * 1099511628211u;
    hash = (hash ^ sizeof(Core)) * 1099511628211u;
    return (hash ^ model_n_variables) * 1099511628211u;
}

size_t core_snapshot_size(const Instance *s) {
    size_t size = sizeof(SnapshotHead) + sizeof(Core);
    for (int i = 0; i < N_DELAYS; i++) size += 2 * sizeof(uint64_t) + 2 * s->history[i].n * sizeof(double);
    return size;
}

static char *put(char *to, const void *from, size_t size) {
    if (size) memcpy(to, from, size);
    return to + size;
}

void core_save(const Instance *s, void *bytes) {
    SnapshotHead head = {snapshot_magic(), core_snapshot_size(s)};
    char *to = put(put(bytes, &head, sizeof head), &s->c, sizeof s->c);
    for (int i = 0; i < N_DELAYS; i++) {
        const History *h = &s->history[i];
        uint64_t n[2] = {h->n, h->at};
        to = put(to, n, sizeof n);
        to = put(put(to, h->time, h->n * sizeof(double)), h->value, h->n * sizeof(double));
    }
}

CoreStatus core_load(Instance *s, const void *bytes, size_t size) {
    SnapshotHead head;
    const char *from = bytes, *end = from + size;
    if (size < sizeof head + sizeof(Core)) return say(s, CORE_ERROR, "logStatusError", "the snapshot is truncated");
    memcpy(&head, from, sizeof head);
    if (head.magic != snapshot_magic() || head.size != size) return say(s, CORE_ERROR, "logStatusError", "the snapshot is not one of this model");
    const char *histories = from + sizeof head + sizeof(Core);
    for (int i = 0; i < N_DELAYS; i++) { /* check before anything is touched */
        uint64_t n[2];
        if ((size_t)(end - histories) < sizeof n) return say(s, CORE_ERROR, "logStatusError", "the snapshot is truncated");
        memcpy(n, histories, sizeof n);
        histories += sizeof n;
        if (n[0] > (size_t)(end - histories) / (2 * sizeof(double)) || n[1] > n[0])
            return say(s, CORE_ERROR, "logStatusError", "the snapshot is damaged");
        histories += 2 * n[0] * sizeof(double);
    }
    memcpy(&s->c, from + sizeof head, sizeof(Core));
    from += sizeof head + sizeof(Core);
    for (int i = 0; i < N_DELAYS; i++) {
        History *h = &s->history[i];
        uint64_t n[2];
        memcpy(n, from, sizeof n);
        from += sizeof n;
        h->n = 0;
        for (size_t k = 0; k < n[0]; k++) {
            double entry[2];
            memcpy(&entry[0], from + k * sizeof(double), sizeof(double));
            memcpy(&entry[1], from + (n[0] + k) * sizeof(double), sizeof(double));
            if (!history_push(h, entry[0], entry[1])) return say(s, CORE_FATAL, "logStatusFatal", "out of memory for the delay's history");
        }
        h->at = n[1];
        from += 2 * n[0] * sizeof(double);
    }
    s->outputs_valid = s->locals_valid = 0;
    if (N_DELAYS) { /* the delay times themselves follow from the parameters */
        double value[AT_LEAST_1(N_DELAYS)];
        model_delays(&s->c.q, value, s->delay, s->delay_maximum);
    }
    return CORE_OK;
}
