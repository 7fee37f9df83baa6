/* What lanes do within a row: events at its beginning, steps, and events on the way. Included by lanes.h. */

/* Flags are doubles, as what they are made of: vectors are not converted. */
static inline void refuse_endless(const Lane *values, int n, double *restrict off) {
    for (int i = 0; i < n; i++)
        for (int l = 0; l < LANES; l++) off[l] += values[i][l] - values[i][l]; /* 0, or no number */
}

static inline int any(const double *lanes) {
    Whole bits;
    int64_t found = 0;
    memcpy(bits, lanes, sizeof bits); /* flags are 0, more, or no number: comparing them takes longer */
    for (int l = 0; l < LANES; l++) found |= bits[l];
    return found != 0;
}

static inline void set_time(LaneData *q, double time) {
    for (int l = 0; l < LANES; l++) q->time[l] = time;
}

/* A lane is off where an assertion does not hold that hangs on more than parameters. */
static inline void refuse_unasserted(Lanes *w) {
#if N_ASSERTIONS > 0 && !ASSERTED_ONCE
    Lane ok[N_ASSERTIONS];
    lanes_check(&w->q, ok);
    for (int i = 0; i < N_ASSERTIONS; i++)
        for (int l = 0; l < LANES; l++) w->off[l] += ok[i][l] != 0 ? 0 : 1;
#else
    (void)w;
#endif
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

/* Rates; of a model without states outputs. */
static inline void evaluate_lanes(Lanes *w) {
#if N_STATES > 0
    lanes_rates(&w->q, w->dx, w->z);
#else
    lanes_observed(&w->q, w->z, w->y);
#endif
}

/* Of a clock, when it ticks next. */
static inline double next_tick_of(const Lanes *w, int i, int l) { return w->begins[i][l] + w->ticks[i][l] * w->interval[i][l]; }

/* Clocks that tick by now, as take_due_ticks of core.c; `due`: lanes in which any does. */
static inline void due_lanes(Lanes *w, double *restrict due) {
    const double now = w->q.time[0] + time_slack(w->q.time[0]);
    int found = 0;
    for (int i = 0; i < N_SAMPLES; i++)
        for (int l = 0; l < LANES; l++) {
            w->q.tick[i][l] = w->over[l] == 0 && next_tick_of(w, i, l) <= now ? 1 : 0;
            due[l] += w->q.tick[i][l];
            found |= w->q.tick[i][l] != 0;
        }
    if (!found) return;
    keep_lanes(w);
    for (int i = 0; i < N_SAMPLES; i++)
        for (int l = 0; l < LANES; l++)
            while (w->over[l] == 0 && next_tick_of(w, i, l) <= now) w->ticks[i][l] += 1;
}

/* A lane is off whose clock ticks on the way to `end`. */
static inline void refuse_ticks(Lanes *w, double end) {
    for (int i = 0; i < N_SAMPLES; i++)
        for (int l = 0; l < LANES; l++) w->off[l] += w->over[l] == 0 && next_tick_of(w, i, l) < end - time_slack(end) ? 1 : 0;
}

/* What fires in lanes that are busy, and what that sets, as update of core.c; they stay busy where anything is new. */
static inline void update_lanes(Lanes *w, double *restrict busy) {
#if N_BRANCHES + N_MEMORIES > 0
    Lane now[AT_LEAST_1(N_BRANCHES)], d[AT_LEAST_1(N_MEMORIES)], x[AT_LEAST_1(N_STATES)], chain = {0}, new = {0};
    lanes_conditions(&w->q, now);
    for (int i = 0; i < N_BRANCHES; i++)
        for (int l = 0; l < LANES; l++) {
            const int before = i > 0 && model_chain[i] == model_chain[i - 1] && chain[l] != 0;
            w->q.fired[i][l] = busy[l] != 0 && now[i][l] != 0 && w->condition[i][l] == 0 && !before ? 1 : 0;
            chain[l] = before || w->q.fired[i][l] != 0;
            new[l] += w->q.fired[i][l];
            w->condition[i][l] = busy[l] != 0 ? now[i][l] : w->condition[i][l];
        }
    memcpy(x, w->q.x, sizeof x);
    lanes_updates(&w->q, d, x);
    for (int i = 0; i < N_MEMORIES; i++)
        for (int l = 0; l < LANES; l++) {
            new[l] += busy[l] != 0 && d[i][l] != w->q.d[i][l] ? 1 : 0;
            w->q.d[i][l] = busy[l] != 0 ? d[i][l] : w->q.d[i][l];
        }
    for (int i = 0; i < N_STATES; i++)
        for (int l = 0; l < LANES; l++) w->q.x[i][l] = busy[l] != 0 ? x[i][l] : w->q.x[i][l];
    memset(w->q.fired, 0, sizeof w->q.fired);
    for (int l = 0; l < LANES; l++) w->off[l] += CHAINED ? new[l] : 0; /* of one event: core.c's alone */
    memcpy(busy, new, sizeof new);
#else
    (void)w;
    memset(busy, 0, sizeof(Lane));
#endif
}

/* Relations that agree with the equations, and rates under them. A lane is off where following them does not lead there. */
static inline void relations_lanes(Lanes *w) {
    Lane odd = {0};
    for (int round = 0; round < ROUNDS; round++) {
        memset(odd, 0, sizeof odd);
        evaluate_lanes(w);
        contradict(&w->q, w->z, odd);
        for (int l = 0; l < LANES; l++) odd[l] = w->off[l] == 0 ? odd[l] : 0;
        if (!any(odd)) return;
        for (int i = 0; i < N_RELATIONS; i++)
            for (int l = 0; l < LANES; l++) w->q.m[i][l] = holds(i, w->z[i][l]);
    }
    for (int l = 0; l < LANES; l++) w->off[l] += odd[l];
}

/* New relations, when-clauses and memories in lanes that are busy, as iterate_events of core.c. */
APART void iterate_lanes(Lanes *w, double *busy) {
#if N_SAMPLES > 0
    Lane began;
    memcpy(began, busy, sizeof began);
#endif
    keep_lanes(w);
    for (int round = 0; round < ROUNDS && any(busy); round++) {
        memcpy(w->q.pre, w->q.d, sizeof w->q.pre);
        relations_lanes(w);
        update_lanes(w, busy);
    }
    for (int l = 0; l < LANES; l++) w->off[l] += busy[l];
    refuse_endless(w->q.x, N_STATES, w->off);
    refuse_endless(w->dx, N_STATES, w->off);
#if N_SAMPLES > 0
    Lane now[AT_LEAST_1(N_BRANCHES)];
    memset(w->q.tick, 0, sizeof w->q.tick);
    lanes_conditions(&w->q, now);
    for (int i = 0; i < N_BRANCHES; i++)
        for (int l = 0; l < LANES; l++) w->condition[i][l] = began[l] != 0 ? now[i][l] : w->condition[i][l];
#endif
}

/* Events that are due, as settle_now of core.c; else rates as they are. */
static inline void settle_lanes(Lanes *w) {
    Lane busy = {0};
    due_lanes(w, busy);
    evaluate_lanes(w);
    contradict(&w->q, w->z, busy);
    for (int l = 0; l < LANES; l++) busy[l] = w->off[l] == 0 ? busy[l] : 0;
    if (any(busy)) iterate_lanes(w, busy);
    else refuse_endless(w->dx, N_STATES, w->off);
}

#if N_STATES > 0
/* x of a stage, `share` behind x0 at the rates dx. */
static inline void stage(Lane *restrict x, const Lane *restrict x0, const double *restrict share, const Lane *restrict dx) {
    for (int i = 0; i < N_STATES; i++)
        for (int l = 0; l < LANES; l++) x[i][l] = x0[i][l] + share[l] * dx[i][l];
}

/* One Runge-Kutta step of length h from (begun, x0, k1), as attempt_explicit of core.c: to q.x, with rates dx and operands z there.
 * before: rates before the last ones; passed: more where a relation was contradicted on the way. */
static inline void attempt_lanes(Lanes *w, const double *begun, const Lane *x0, const Lane *k1, const double *h, Lane *before,
                                 double *passed) {
    LaneData *q = &w->q;
    Lane half, k2[N_STATES], k3[N_STATES];
    for (int l = 0; l < LANES; l++) half[l] = 0.5 * h[l], q->time[l] = begun[l] + half[l];
    stage(q->x, x0, half, k1);
    lanes_rates(q, k2, w->z);
    stage(q->x, x0, half, k2);
    lanes_rates(q, k3, w->z);
    contradict(q, w->z, passed);
    for (int l = 0; l < LANES; l++) q->time[l] = begun[l] + h[l];
    stage(q->x, x0, h, k3);
    lanes_rates(q, before, w->z);
    for (int i = 0; i < N_STATES; i++)
        for (int l = 0; l < LANES; l++) q->x[i][l] = x0[i][l] + h[l] / 6 * (k1[i][l] + 2 * (k2[i][l] + k3[i][l]) + before[i][l]);
    lanes_rates(q, w->dx, w->z);
}

/* A lane is off whose step's error is not small, or not finite. calm: of each lane, the least that is not small. */
static inline void refuse_rough(Lanes *w, const Lane *before, const double *restrict h, const double *restrict calm) {
    for (int i = 0; i < N_STATES; i++) {
        const double *restrict x = w->q.x[i], *restrict k4 = before[i], *restrict dx = w->dx[i], *restrict tolerance = w->q.p[P_TOLERANCE];
        const double nominal = model_nominals[i];
        double *restrict off = w->off;
        for (int l = 0; l < LANES; l++) {
            const double size = fabs(x[l]) > nominal ? fabs(x[l]) : nominal;
            const double error = fabs(h[l] * 0.1 * (k4[l] - dx[l]));
            off[l] += error <= calm[l] * tolerance[l] * size ? 0.0 : 1.0;
        }
    }
    refuse_endless(w->q.x, N_STATES, w->off);
    refuse_endless(w->dx, N_STATES, w->off);
}

static inline void gather(double *to, const Lane *from, int n, int l) {
    for (int i = 0; i < n; i++) to[i] = from[i][l];
}

static inline void copy_lane(Lane *to, const Lane *from, int n, int l) {
    for (int i = 0; i < n; i++) to[i][l] = from[i][l];
}

/* Where a step of length h ended in a contradiction (found), to right behind the earliest one, as locate of core.c; h: where that is. */
APART void locate_lanes(Lanes *w, const double *begun, const Lane *x0, const Lane *k1, const Lane *z0, const double *found, double width,
                        double *h) {
    Bracket bracket[LANES];
    Lane x[N_STATES], dx[N_STATES], z[AT_LEAST_1(N_RELATIONS)], length;
    Lane before[N_STATES], passed = {0}; /* of no account here */
    double start_z[AT_LEAST_1(N_RELATIONS)], own_z[AT_LEAST_1(N_RELATIONS)], own_m[AT_LEAST_1(N_RELATIONS)];
    memcpy(x, w->q.x, sizeof x);
    memcpy(dx, w->dx, sizeof dx);
    memcpy(z, w->z, sizeof z);
    memcpy(length, h, sizeof length);
    for (int l = 0; l < LANES; l++) {
        if (found[l] == 0) continue;
        gather(start_z, z0, N_RELATIONS, l);
        gather(own_z, w->z, N_RELATIONS, l);
        open_bracket(bracket + l, start_z, own_z, h[l]);
    }
    for (int trying = 1; trying;) {
        int tries[LANES] = {0};
        trying = 0;
        for (int l = 0; l < LANES; l++) {
            if (found[l] == 0 || !is_open(bracket + l, width)) continue;
            gather(own_m, w->q.m, N_RELATIONS, l);
            length[l] = next_length(bracket + l, own_m, width);
            trying = tries[l] = 1;
        }
        if (trying) attempt_lanes(w, begun, x0, k1, length, before, passed);
        for (int l = 0; l < LANES; l++) {
            if (!tries[l]) continue;
            gather(own_m, w->q.m, N_RELATIONS, l);
            gather(own_z, w->z, N_RELATIONS, l);
            if (!narrow(bracket + l, own_m, length[l], own_z)) continue;
            copy_lane(x, w->q.x, N_STATES, l);
            copy_lane(dx, w->dx, N_STATES, l);
            copy_lane(z, w->z, N_RELATIONS, l);
        }
    }
    for (int l = 0; l < LANES; l++) h[l] = found[l] != 0 ? bracket[l].high : h[l];
    memcpy(w->q.x, x, sizeof x);
    memcpy(w->dx, dx, sizeof dx);
    memcpy(w->z, z, sizeof z);
}

/* Error up to which a step is small. Another one may follow behind an event: core.c makes that no longer than grows from this one. */
static inline double calm_of(int last) { return last ? CALM : CALM / 16; }

/* A step of each lane from where it stands towards `end`, as advance of core.c. found: more in lanes where it ends in an event. */
static inline void advance_lanes(Lanes *w, double *at, double end, double width, double *found) {
    LaneData *q = &w->q;
    Lane x0[N_STATES], k1[N_STATES], z0[AT_LEAST_1(N_RELATIONS)], h, whole, calm, before[N_STATES], passed = {0};
    int last[LANES];
    for (int l = 0; l < LANES; l++) {
        h[l] = piece_of(end - at[l], w->run[0]->c.q.p[P_MAX_STEP], last + l);
        calm[l] = calm_of(last[l]);
    }
    memcpy(x0, q->x, sizeof x0);
    memcpy(k1, w->dx, sizeof k1);
    memcpy(z0, w->z, sizeof z0);
    memcpy(whole, h, sizeof whole);
    attempt_lanes(w, at, x0, k1, h, before, passed);
    contradict(q, w->z, found);
    refuse_rough(w, before, h, calm);
    for (int i = 0; i < N_STATES; i++)
        for (int l = 0; l < LANES; l++) q->x[i][l] = at[l] < end ? q->x[i][l] : x0[i][l]; /* with the sign that a 0 has */
    for (int l = 0; l < LANES; l++) {
        w->off[l] += found[l] == 0 ? passed[l] : 0;
        found[l] = w->off[l] == 0 && at[l] < end ? found[l] : 0;
    }
    if (any(found)) locate_lanes(w, at, x0, k1, z0, found, width, h);
    for (int l = 0; l < LANES; l++) q->time[l] = at[l] = last[l] && h[l] >= whole[l] ? end : at[l] + h[l];
    refuse_endless(q->x, N_STATES, w->off);
    refuse_endless(w->dx, N_STATES, w->off);
}

/* Lanes from where each stands (at, with states q.x) on to `end`, event after event, as core_step. */
APART void pass_events(Lanes *w, double *at, double end, double width) {
    Lane events = {0};
    keep_lanes(w);
    memcpy(w->q.time, at, sizeof w->q.time);
    evaluate_lanes(w);
    for (;;) {
        Lane found = {0};
        int left = 0;
        for (int l = 0; l < LANES; l++) {
            w->off[l] += events[l] >= EVENTS_LANED ? 1 : 0;
            at[l] = w->off[l] == 0 ? at[l] : end;
            left |= at[l] < end;
        }
        if (!left) return;
        advance_lanes(w, at, end, width, found);
        for (int l = 0; l < LANES; l++) events[l] += found[l] != 0 ? 1 : 0;
        if (any(found)) iterate_lanes(w, found);
    }
}

/* One step of length h of all lanes, to a time; last: of its part of a row. Whether it is to be taken to an event in some lanes; then
 * q.x, at: where each lane stands. */
static inline int step_lanes(Lanes *w, const double *h, int last, double to, double *at) {
    LaneData *q = &w->q;
    Lane x0[N_STATES], begun, before[N_STATES], passed = {0}, found = {0}, calm;
    for (int l = 0; l < LANES; l++) calm[l] = calm_of(last);
    memcpy(begun, q->time, sizeof begun);
    memcpy(x0, q->x, sizeof x0);
    attempt_lanes(w, begun, x0, w->dx, h, before, passed);
    contradict(q, w->z, found);
    refuse_rough(w, before, h, calm);
    for (int l = 0; l < LANES; l++) {
        w->off[l] += found[l] == 0 ? passed[l] : 0;
        found[l] = w->off[l] == 0 ? found[l] : 0;
    }
    if (!any(found)) return 0;
    for (int i = 0; i < N_STATES; i++)
        for (int l = 0; l < LANES; l++) q->x[i][l] = found[l] != 0 ? x0[i][l] : q->x[i][l];
    for (int l = 0; l < LANES; l++) at[l] = found[l] != 0 ? begun[l] : to;
    return 1;
}

/* Over a time under constant inputs, in steps as core.c would take. */
static inline void pass_lanes(Lanes *w, double time, double length) {
    const double end = time + length, longest = w->run[0]->c.q.p[P_MAX_STEP], usual = length < longest ? length : longest;
    double now = time;
    for (int l = 0; l < LANES; l++) w->off[l] += w->allowed[l] < usual ? 1 : 0;
    set_time(&w->q, time);
    settle_lanes(w);
    refuse_ticks(w, end);
    for (int last = 0; !last;) {
        const double step = piece_of(end - now, longest, &last);
        Lane h, at;
        for (int l = 0; l < LANES; l++) h[l] = step;
        now = last ? end : now + step;
        if (step_lanes(w, h, last, now, at)) {
            pass_events(w, at, end, event_width(time, length));
            return;
        }
        set_time(&w->q, now);
    }
}
#endif
