/* Stiff models: a Rosenbrock method with the exact Jacobian, switched to while running. Included by core.c.
 *
 * RODAS (Hairer & Wanner, Solving Ordinary Differential Equations II, IV.10): six stages, order 4 with an embedded order 3, stiffly
 * accurate and L-stable. With W = 1/(gamma h) - df/dx the stages k_i solve
 *
 *     W k_i = f(t + c_i h, x + sum_j a_ij k_j) + h g_i df/dt + sum_j (C_ij / h) k_j,
 *
 * the new state is the last stage's argument plus k_6, and k_6 is the error estimate. The Jacobian comes from the directional
 * derivatives of the model, through its algebraic loops; it is taken once for each step, and factored for each length tried. */
#ifndef MODELICA_FMU_IMPLICIT_H
#define MODELICA_FMU_IMPLICIT_H

#ifdef __GNUC__
#define RARELY __attribute__((cold, noinline)) /* out of the way of models that are not stiff */
#else
#define RARELY
#endif
#ifndef STIFF_WATCH
#define STIFF_WATCH 100 /* internal steps within one communication step, after which stiffness is looked for */
#endif
#define STIFF_LIMIT 2.0 /* of h |df/dx|: Runge and Kutta's steps are unstable beyond 2.8 */
#ifndef STIFF_STEPS
#define STIFF_STEPS 15 /* at that limit, one after the other */
#endif

static const double RODAS_C[6] = {0, 0.386, 0.21, 0.63, 1, 1};
static const double RODAS_G[6] = {0.25, -0.1043, 0.1035, -0.0362, 0, 0};
static const double RODAS_A[6][5] = {
    {0},
    {1.544},
    {0.9466785280815826, 0.2557011698983284},
    {3.314825187068521, 2.896124015972201, 0.9986419139977817},
    {1.221224509226641, 6.019134481288629, 12.53708332932087, -0.687886036105895},
    {1.221224509226641, 6.019134481288629, 12.53708332932087, -0.687886036105895, 1},
};
static const double RODAS_B[6][5] = {
    {0},
    {-5.6688},
    {-2.430093356833875, -0.2063599157091915},
    {-0.1073529058151375, -9.594562251023355, -20.47028614809616},
    {7.496443313967647, -10.24680431464352, -33.99990352819905, 11.7089089320616},
    {8.083246795921522, -7.981132988064893, -31.52159432874371, 16.31930543123136, -6.058818238834054},
};

static double scaled(const Trial *trial, int i) {
    return fabs(trial->x[i]) > model_nominals[i] ? fabs(trial->x[i]) : model_nominals[i];
}

/* Whether the step just taken was as long as stability, not accuracy, lets it be: then the implicit method takes over, for good. */
static void watch_stiffness(Instance *s, double h, const Trial *trial) {
    Core *c = &s->c;
    if (c->implicit || ++c->steps < STIFF_WATCH) return;
    c->stiff = h * trial->rate > STIFF_LIMIT ? c->stiff + 1 : 0;
    if (c->stiff < STIFF_STEPS) return;
    c->implicit = 1;
    say(s, CORE_OK, "logEvents", "stiff from t = %g s on: rates of %g 1/s; steps are implicit now", c->q.time, trial->rate);
}

/* df/dx by columns and df/dt at the present point. 0: out of memory. */
RARELY static int take_jacobian(Instance *s) {
    const size_t n = N_STATES;
    if (!s->jacobian) {
        s->jacobian = malloc(AT_LEAST_1(n * n) * sizeof(double));
        s->factored = malloc(AT_LEAST_1(n * n) * sizeof(double));
        if (!s->jacobian || !s->factored) return 0;
    }
    double seeds[AT_LEAST_1(N_SEEDS)] = {0}, y[AT_LEAST_1(N_ALGEBRAICS)];
    for (size_t j = 0; j <= n; j++) {
        const size_t at = j < n ? j : N_SEEDS - 1; /* the last one is time */
        seeds[at] = 1;
        loop_seeds(s, seeds);
        model_directional(&s->c.q, seeds, j < n ? s->jacobian + j * n : s->by_time, y);
        seeds[at] = 0;
    }
    return 1;
}

/* One step of length h from (time, x0) with frozen modes and the Jacobian taken there; `error` is infinite where W is singular. */
RARELY static void attempt_implicit(Instance *s, double time, const double *x0, const double *f0, double h, Trial *trial) {
    const double tolerance = s->c.q.p[P_TOLERANCE];
    double k[6][AT_LEAST_1(N_STATES)], x[AT_LEAST_1(N_STATES)], f[AT_LEAST_1(N_STATES)];
    int row[AT_LEAST_1(N_STATES)];
    for (size_t i = 0; i < (size_t)N_STATES * N_STATES; i++) s->factored[i] = -s->jacobian[i];
    for (int i = 0; i < N_STATES; i++) s->factored[i + (size_t)i * N_STATES] += 1 / (RODAS_G[0] * h);
    trial->error = HUGE_VAL;
    trial->passed_through = 0;
    memcpy(trial->x, x0, sizeof trial->x);
    memcpy(trial->dx, f0, sizeof trial->dx);
    memcpy(trial->z, s->c.z, sizeof trial->z);
    if (!lu_factor(s->factored, N_STATES, row)) return;
    memcpy(f, f0, sizeof f);
    for (int stage = 0; stage < 6; stage++) {
        for (int i = 0; i < N_STATES; i++) {
            x[i] = x0[i];
            for (int j = 0; j < stage; j++) x[i] += RODAS_A[stage][j] * k[j][i];
        }
        if (stage > 0) evaluate(s, time + RODAS_C[stage] * h, x, f, trial->z);
        if (stage == 3) trial->passed_through = contradicted(s->c.q.m, trial->z);
        for (int i = 0; i < N_STATES; i++) {
            f[i] += h * RODAS_G[stage] * s->by_time[i];
            for (int j = 0; j < stage; j++) f[i] += RODAS_B[stage][j] / h * k[j][i];
        }
        lu_solve(s->factored, N_STATES, row, f, k[stage]);
    }
    for (int i = 0; i < N_STATES; i++) trial->x[i] = x[i] + k[5][i];
    evaluate(s, time + h, trial->x, trial->dx, trial->z);
    trial->error = 0;
    for (int i = 0; i < N_STATES; i++) {
        const double error = fabs(k[5][i]) / (tolerance * scaled(trial, i));
        if (!(error <= trial->error)) trial->error = error; /* keeps a NaN */
    }
}

#endif
