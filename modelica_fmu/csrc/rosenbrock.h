/* Implicit internal solver for stiff models: RODAS3 (Sandu et al. 1997), a Rosenbrock method of order 3 with 4 stages, L-stable and
 * stiffly accurate, with the exact Jacobian. Included by core.c in place of the Runge-Kutta step. */
#ifndef PNEUGANTRY_ROSENBROCK_H
#define PNEUGANTRY_ROSENBROCK_H

/* d rates / d states by columns, and d rates / d time, at (time, x0). */
static void take_jacobian(Instance *s, double time, const double *x0) {
    if (s->jacobian_valid && s->jacobian_time == time && memcmp(s->jacobian_at, x0, sizeof s->jacobian_at) == 0) return;
    double seeds[N_SEEDS] = {0}, unused[AT_LEAST_1(N_ALGEBRAICS)];
    s->c.q.time = time;
    memcpy(s->c.q.x, x0, sizeof s->c.q.x);
    s->c.loops_valid = 0;
    for (int k = 0; k < N_STATES; k++) {
        seeds[k] = 1;
        loop_seeds(s, seeds);
        model_directional(&s->c.q, seeds, s->jacobian + k * N_STATES, unused);
        seeds[k] = 0;
    }
    seeds[N_SEEDS - 1] = 1;
    loop_seeds(s, seeds);
    model_directional(&s->c.q, seeds, s->rate_of_time, unused);
    s->jacobian_time = time;
    memcpy(s->jacobian_at, x0, sizeof s->jacobian_at);
    s->jacobian_valid = 1;
}

/* One step of length h from (time, x0, k1) with frozen modes. */
static void attempt(Instance *s, double time, const double *x0, const double *k1, double h, Trial *trial) {
    static const double gamma = 0.5, reach[4] = {0, 0, 1, 1}, slope[4] = {0.5, 1.5, 0, 0};
    static const double a[4][3] = {{0}, {0}, {2, 0}, {2, 0, 1}}, c[4][3] = {{0}, {4}, {1, -1}, {1, -1, -8.0 / 3}};
    static const double weight[4] = {2, 0, 1, 1};
    double k[4][N_STATES], x[N_STATES], f[N_STATES], right[N_STATES];
    int row[N_STATES];
    const double tolerance = s->c.q.p[P_TOLERANCE];
    take_jacobian(s, time, x0);
    for (int i = 0; i < N_STATES * N_STATES; i++) s->factors[i] = -s->jacobian[i];
    for (int i = 0; i < N_STATES; i++) s->factors[i + i * N_STATES] += 1 / (h * gamma);
    trial->error = NAN;
    trial->passed_through = 0;
    if (!lu_factor(s->factors, N_STATES, row)) {
        memcpy(trial->x, x0, sizeof trial->x);
        evaluate(s, time + h, trial->x, trial->dx, trial->z);
        return;
    }
    memcpy(f, k1, sizeof f);
    for (int stage = 0; stage < 4; stage++) {
        if (stage > 1) { /* the second stage uses the rates of the first */
            for (int i = 0; i < N_STATES; i++) {
                x[i] = x0[i];
                for (int j = 0; j < stage; j++) x[i] += a[stage][j] * k[j][i];
            }
            evaluate(s, time + reach[stage] * h, x, f, trial->z);
        }
        for (int i = 0; i < N_STATES; i++) {
            right[i] = f[i] + h * slope[stage] * s->rate_of_time[i];
            for (int j = 0; j < stage; j++) right[i] += c[stage][j] / h * k[j][i];
        }
        lu_solve(s->factors, N_STATES, row, right, k[stage]);
    }
    for (int i = 0; i < N_STATES; i++) {
        trial->x[i] = x0[i];
        for (int j = 0; j < 4; j++) trial->x[i] += weight[j] * k[j][i];
    }
    evaluate(s, time + h, trial->x, trial->dx, trial->z);
    trial->error = 0;
    for (int i = 0; i < N_STATES; i++) {
        double size = fabs(trial->x[i]) > model_nominals[i] ? fabs(trial->x[i]) : model_nominals[i];
        double error = fabs(k[3][i]) / (tolerance * size);
        if (!(error <= trial->error)) trial->error = error; /* keeps a NaN */
    }
}

#endif
