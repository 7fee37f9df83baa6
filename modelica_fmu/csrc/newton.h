/* Newton's method with the exact Jacobian: algebraic loops and the initial system. Included by core.c. */
#ifndef MODELICA_FMU_NEWTON_H
#define MODELICA_FMU_NEWTON_H

#define NEWTON_ROUNDS 100
#define NEWTON_TOLERANCE 1e-11 /* of a step, relative to max(|unknown|, 1) */
#define NEWTON_GOOD 1e-6       /* of a step that rounding keeps from shrinking any more */
#define NEWTON_ROUNDING 1e-9   /* of a residual that rounding leaves, relative to its terms */
#define FIRST_STRIDE 1e-3      /* away from a solution that ends, relative to max(|unknown|, 1) */
#define LAST_STRIDE 1e4

/* LU factors of a matrix by columns, rows exchanged; 0: singular. */
static inline int lu_factor(double *a, int n, int *row) {
    for (int i = 0; i < n; i++) row[i] = i;
    for (int k = 0; k < n; k++) {
        int best = k;
        for (int i = k + 1; i < n; i++)
            if (fabs(a[i + k * n]) > fabs(a[best + k * n])) best = i;
        if (!(fabs(a[best + k * n]) > 0) || !isfinite(a[best + k * n])) return 0;
        if (best != k) {
            int other = row[k];
            row[k] = row[best];
            row[best] = other;
            for (int j = 0; j < n; j++) {
                double value = a[k + j * n];
                a[k + j * n] = a[best + j * n];
                a[best + j * n] = value;
            }
        }
        const double pivot = 1 / a[k + k * n];
        for (int i = k + 1; i < n; i++) a[i + k * n] *= pivot;
        for (int j = k + 1; j < n; j++) {
            const double factor = a[k + j * n];
            if (factor == 0) continue;
            for (int i = k + 1; i < n; i++) a[i + j * n] -= a[i + k * n] * factor;
        }
    }
    return 1;
}

static inline void lu_solve(const double *a, int n, const int *row, const double *right, double *x) {
    for (int i = 0; i < n; i++) x[i] = right[row[i]];
    for (int j = 0; j < n; j++)
        for (int i = j + 1; i < n; i++) x[i] -= a[i + j * n] * x[j];
    for (int j = n - 1; j >= 0; j--) {
        x[j] /= a[j + j * n];
        for (int i = 0; i < j; i++) x[i] -= a[i + j * n] * x[j];
    }
}

#if N_LARGEST > 0
typedef void (*NewtonSystem)(Instance *s, int which, double *residual, double *jacobian);

static inline double newton_size(const double *step, const double *at, int n) {
    double size = 0;
    for (int i = 0; i < n; i++) {
        const double share = fabs(step[i]) / (fabs(at[i]) > 1 ? fabs(at[i]) : 1);
        if (isnan(share)) return share;
        if (share > size) size = share;
    }
    return size;
}

/* The step of Levenberg and Marquardt, away from where the matrix is singular. */
static inline int regularised(Instance *s, NewtonSystem system, int which, int n, double *step) {
    double residual[N_LARGEST], right[N_LARGEST], largest = 0;
    int row[N_LARGEST];
    system(s, which, residual, s->matrix);
    for (int i = 0; i < n; i++) {
        right[i] = 0;
        for (int k = 0; k < n; k++) right[i] += s->matrix[k + i * n] * residual[k];
        for (int j = 0; j < n; j++) {
            double sum = 0;
            for (int k = 0; k < n; k++) sum += s->matrix[k + i * n] * s->matrix[k + j * n];
            s->unused[i + j * n] = sum;
        }
        if (s->unused[i + i * n] > largest) largest = s->unused[i + i * n];
    }
    for (int i = 0; i < n; i++) s->unused[i + i * n] += 1e-3 * largest;
    if (!lu_factor(s->unused, n, row)) return 0;
    lu_solve(s->unused, n, row, right, step);
    return 1;
}

/* Whether the residuals are as small as rounding lets them be: no step is too short for that where a solution has just ended. */
static inline int only_rounding(Instance *s, NewtonSystem system, int which, double *const *unknown, int n) {
    double residual[N_LARGEST];
    system(s, which, residual, s->unused);
    for (int i = 0; i < n; i++) {
        double terms = 0;
        for (int j = 0; j < n; j++) terms += fabs(s->unused[i + j * n]) * fmax(1, fabs(*unknown[j]));
        if (!(fabs(residual[i]) <= NEWTON_ROUNDING * terms)) return 0;
    }
    return 1;
}

/* `damped`: a step is halved until the next one, with the same matrix, is shorter. 1: found. */
static inline int newton_tried(Instance *s, NewtonSystem system, int which, double *const *unknown, int n, int damped) {
    double residual[N_LARGEST], step[N_LARGEST], next[N_LARGEST], from[N_LARGEST];
    int row[N_LARGEST], singular = 0;
    for (int round = 0; round < NEWTON_ROUNDS; round++) {
        system(s, which, residual, s->matrix);
        if (!lu_factor(s->matrix, n, row)) {
            double largest = 0;
            for (int i = 0; i < n; i++) {
                if (!isfinite(residual[i])) return 0;
                if (fabs(residual[i]) > largest) largest = fabs(residual[i]);
            }
            if (largest < 1e-14) return 1; /* solved, though not by these equations alone */
            if (++singular > 5 || !regularised(s, system, which, n, step)) return 0;
            for (int i = 0; i < n; i++) *unknown[i] -= step[i];
            continue;
        }
        lu_solve(s->matrix, n, row, residual, step);
        for (int i = 0; i < n; i++) from[i] = *unknown[i];
        const double size = newton_size(step, from, n);
        if (!isfinite(size)) return 0;
        double share = 1, after = 0;
        for (int halved = 0;; halved++) {
            for (int i = 0; i < n; i++) *unknown[i] = from[i] - share * step[i];
            if (size <= NEWTON_TOLERANCE) return 1;
            if (!damped) break;
            system(s, which, residual, NULL);
            lu_solve(s->matrix, n, row, residual, next);
            after = newton_size(next, from, n);
            if (after < (1 - 0.1 * share) * size) break;
            if (size < NEWTON_GOOD && after <= NEWTON_GOOD && only_rounding(s, system, which, unknown, n)) return 1;
            if (halved == 30) return 0;
            share *= 0.5;
        }
        if (damped && share == 1 && after <= NEWTON_TOLERANCE) {
            for (int i = 0; i < n; i++) *unknown[i] -= next[i];
            return 1;
        }
    }
    return 0;
}

static inline int newton(Instance *s, NewtonSystem system, int which, double *const *unknown, int n) {
    double from[N_LARGEST];
    for (int i = 0; i < n; i++) from[i] = *unknown[i];
    if (newton_tried(s, system, which, unknown, n, 1)) return 1;
    for (int i = 0; i < n; i++) *unknown[i] = from[i];
    return newton_tried(s, system, which, unknown, n, 0);
}
#endif

#if N_LOOPS > 0
static inline void loop_system(Instance *s, int which, double *residual, double *jacobian) {
    model_loop(&s->c.q, which, residual, jacobian ? jacobian : s->unused);
}
#endif

#if JUMPING
/* A loop whose solution has ended: another one, onward the way that the unknowns were going, by longer and longer strides,
 * or back, since so near to the end rounding decides which way is which. */
static inline int newton_onward(Instance *s, int which, double *const *unknown, const double *from, int n) {
    double residual[N_LARGEST], step[N_LARGEST];
    int row[N_LARGEST];
    for (int i = 0; i < n; i++) *unknown[i] = from[i];
    loop_system(s, which, residual, s->matrix);
    if (!lu_factor(s->matrix, n, row)) return 0;
    lu_solve(s->matrix, n, row, residual, step);
    const double size = newton_size(step, from, n);
    if (!(size > 0) || !isfinite(size)) return 0;
    for (double stride = FIRST_STRIDE; fabs(stride) <= LAST_STRIDE; stride *= stride > 0 ? -1 : -4) {
        for (int i = 0; i < n; i++) *unknown[i] = from[i] - stride * step[i] / size;
        if (newton(s, loop_system, which, unknown, n)) return 1;
    }
    return 0;
}
#endif

/* Unknowns of all algebraic loops at the present states, inputs and modes; NaN where there is no solution. */
static inline void loops(Instance *s) {
#if N_LOOPS > 0
    if (s->c.loops_valid) return;
    s->c.loop_failed = 0;
    for (int k = 0, first = 0; k < N_LOOPS; first += model_loop_size[k++]) {
        double *unknown[N_LARGEST], before[N_LARGEST], start[AT_LEAST_1(N_LOOPED)];
        const int n = model_loop_size[k];
        for (int i = 0; i < n; i++) {
            unknown[i] = &s->c.q.w[first + i];
            if (!isfinite(*unknown[i])) *unknown[i] = 0;
            before[i] = *unknown[i];
        }
        if (newton(s, loop_system, k, unknown, n)) continue;
#if JUMPING
        if (s->c.frozen && newton_onward(s, k, unknown, before, n)) continue;
#endif
        model_loop_starts(&s->c.q, start); /* once more, from the start values */
        for (int i = 0; i < n; i++) *unknown[i] = start[first + i];
        if (newton(s, loop_system, k, unknown, n)) continue;
        for (int i = 0; i < n; i++) *unknown[i] = before[i];
        s->c.loop_failed = k + 1;
    }
    s->c.loops_valid = 1;
#else
    (void)s;
#endif
}

/* Seeds of the loops' unknowns, from those of all else: the implicit function theorem. */
static inline void loop_seeds(Instance *s, double *seeds) {
#if N_LOOPS > 0
    loops(s);
    double *own = seeds + N_STATES + N_INPUTS + N_PARAMETERS, product[N_LARGEST], step[N_LARGEST], residual[N_LARGEST];
    int row[N_LARGEST];
    for (int i = 0; i < N_LOOPED; i++) own[i] = 0;
    for (int k = 0, first = 0; k < N_LOOPS; first += model_loop_size[k++]) {
        const int n = model_loop_size[k];
        model_loop_product(&s->c.q, k, seeds, product);
        model_loop(&s->c.q, k, residual, s->matrix);
        if (lu_factor(s->matrix, n, row)) lu_solve(s->matrix, n, row, product, step);
        else
            for (int i = 0; i < n; i++) step[i] = NAN;
        for (int i = 0; i < n; i++) own[first + i] = -step[i];
    }
#else
    (void)s, (void)seeds;
#endif
}

/* Where an unknown of the initial equations stands. */
static inline double *initial_unknown(Core *c, int i) {
    double *place = model_initial_kind[i] == 'x' ? c->q.x : model_initial_kind[i] == 'p' ? c->q.p : c->q.d;
    return place + model_initial_index[i];
}

#if N_INITIAL > 0
static inline void initial_equations(Instance *s, int which, double *residual, double *jacobian) {
    (void)which;
    for (int i = 0; i < N_INITIAL; i++)
        if (model_initial_kind[i] == 'p') {
            model_calculated(&s->c.q);
            model_prepare(&s->c.q);
            break;
        }
    model_initial(&s->c.q, residual, jacobian ? jacobian : s->unused);
}

static int solve_initial(Instance *s) {
    double *unknown[N_LARGEST], guess[N_INITIAL];
    Core *c = &s->c;
    if (!c->guessed) {
        model_initial_guess(&c->q, guess);
        c->guessed = 1;
    } else
        for (int i = 0; i < N_INITIAL; i++) guess[i] = NAN;
    for (int i = 0; i < N_INITIAL; i++) {
        unknown[i] = initial_unknown(c, i);
        if (!isnan(guess[i])) *unknown[i] = guess[i];
    }
    for (int i = 0; i < N_LOOPED; i++) unknown[N_INITIAL + i] = &c->q.w[i];
    return newton(s, initial_equations, 0, unknown, N_INITIAL + N_LOOPED);
}
#endif

#endif
