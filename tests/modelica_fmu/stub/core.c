/* The solver core of the stub: RK4 with a fixed step, events by bisection. */
#include "core.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { M, G, K, E, MEDIUM, N, WEIGHT, N_PARAMETERS };
enum { F, ON, N_INPUTS };
#define STEP 1e-3

typedef struct {
    double time, p[N_PARAMETERS], u[N_INPUTS], x[2], bounces;
    int started, resting;
} Core;

struct Instance {
    Core c;
    CoreLog log;
    void *environment;
};

static CoreStatus say(Instance *s, CoreStatus status, const char *category, const char *text, const char *name)
{
    char message[200];
    snprintf(message, sizeof message, "%s%s", name, text);
    s->log(s->environment, status, category, message);
    return status;
}

static double force(const Core *c) { return c->u[ON] != 0.0 ? c->p[N] * c->u[F] : 0.0; }
static double drag(const Core *c) { return c->p[MEDIUM] == 2.0 ? c->p[K] : 0.0; }

static void rates(const Core *c, const double *x, double *dx)
{
    const double a = (force(c) - drag(c) * x[1]) / c->p[M] - c->p[G];
    const int rests = c->resting && a <= 0.0;
    dx[0] = rests ? 0.0 : x[1];
    dx[1] = rests ? 0.0 : a;
}

Instance *core_new(CoreLog log, void *environment)
{
    Instance *s = calloc(1, sizeof *s);
    if (s) {
        s->log = log;
        s->environment = environment;
        core_reset(s);
    }
    return s;
}

void core_free(Instance *s) { free(s); }

void core_reset(Instance *s)
{
    static const Core start = {0.0, {1.0, 9.81, 0.5, 0.7, 2.0, 1.0, 9.81}, {0.0, 0.0}, {1.0, 0.0}, 0.0, 0, 0};
    s->c = start;
}

CoreStatus core_set(Instance *s, unsigned reference, double value)
{
    const ModelVariable *v = &model_variables[reference];
    if (reference >= model_n_variables || v->settable == SET_NEVER || (v->settable == SET_BEFORE_START && s->c.started))
        return say(s, CORE_ERROR, "logStatusError", " may not be set", v->name);
    if (!isfinite(value) || value < v->min || value > v->max)
        return say(s, CORE_ERROR, "logStatusError", " is out of bounds", v->name);
    if (v->kind == VK_PARAMETER)
        s->c.p[v->index] = value;
    if (v->kind == VK_INPUT)
        s->c.u[v->index] = value;
    if (v->kind == VK_STATE)
        s->c.x[v->index] = value;
    s->c.p[WEIGHT] = s->c.p[M] * s->c.p[G];
    return CORE_OK;
}

CoreStatus core_get(Instance *s, unsigned reference, double *value)
{
    const ModelVariable *v = &model_variables[reference];
    double dx[2];
    rates(&s->c, s->c.x, dx);
    switch (v->kind) {
    case VK_TIME: *value = s->c.time; break;
    case VK_INPUT: *value = s->c.u[v->index]; break;
    case VK_STATE: *value = s->c.x[v->index]; break;
    case VK_DERIVATIVE: *value = dx[v->index]; break;
    case VK_ALGEBRAIC: *value = v->index == 0 ? s->c.x[0] + 0.01 * s->c.u[F] : dx[1]; break;
    case VK_DISCRETE: *value = s->c.bounces; break;
    default: *value = s->c.p[v->index];
    }
    return CORE_OK;
}

CoreStatus core_initialise(Instance *s, double start_time)
{
    s->c.time = start_time;
    s->c.started = 1;
    if (s->c.x[0] < 0.0)
        return say(s, CORE_ERROR, "logStatusError", " must be >= 0 at the start", "ball.h");
    return CORE_OK;
}

/* Floor contact: reflected, or at rest when slow. */
static int bounce(Instance *s)
{
    Core *c = &s->c;
    if (c->resting || c->x[0] > 0.0 || c->x[1] >= 0.0)
        return 0;
    c->x[0] = 0.0;
    c->resting = c->x[1] > -0.05;
    c->x[1] = c->resting ? 0.0 : -c->p[E] * c->x[1];
    c->bounces += 1.0;
    say(s, CORE_OK, "logEvents", " hits the floor", "ball");
    return 1;
}

static void rk4(const Core *c, const double *x0, double h, double *x)
{
    double k1[2], k2[2], k3[2], k4[2];
    rates(c, x0, k1);
    for (int i = 0; i < 2; i++) x[i] = x0[i] + 0.5 * h * k1[i];
    rates(c, x, k2);
    for (int i = 0; i < 2; i++) x[i] = x0[i] + 0.5 * h * k2[i];
    rates(c, x, k3);
    for (int i = 0; i < 2; i++) x[i] = x0[i] + h * k3[i];
    rates(c, x, k4);
    for (int i = 0; i < 2; i++) x[i] = x0[i] + h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
}

CoreStatus core_step(Instance *s, double time, double step)
{
    Core *c = &s->c;
    const double end = time + step;
    c->time = time;
    if (c->resting && force(c) / c->p[M] > c->p[G])
        c->resting = 0;
    while (c->time < end) {
        double h = fmin(STEP, end - c->time), low = 0.0, x[2];
        const int last = c->time + h >= end - 1e-12;
        rk4(c, c->x, h, x);
        if (!isfinite(x[0]) || !isfinite(x[1]))
            return say(s, CORE_ERROR, "logStatusError", " is not finite", "ball.h");
        if (!c->resting && x[0] < 0.0 && c->x[0] >= 0.0 && x[1] < 0.0) {
            while (h - low > 1e-12) {
                const double middle = 0.5 * (low + h);
                rk4(c, c->x, middle, x);
                if (x[0] < 0.0) h = middle; else low = middle;
            }
            rk4(c, c->x, h, x);
            c->time += h;
        } else {
            c->time = last ? end : c->time + h;
        }
        memcpy(c->x, x, sizeof x);
        bounce(s);
    }
    return CORE_OK;
}

double core_time(const Instance *s) { return s->c.time; }

CoreStatus core_set_time(Instance *s, double time)
{
    s->c.time = time;
    return CORE_OK;
}

CoreStatus core_set_states(Instance *s, const double *x)
{
    if (!isfinite(x[0]) || !isfinite(x[1]))
        return say(s, CORE_ERROR, "logStatusError", " is not finite", "a state");
    memcpy(s->c.x, x, sizeof s->c.x);
    return CORE_OK;
}

void core_get_states(Instance *s, double *x) { memcpy(x, s->c.x, sizeof s->c.x); }

CoreStatus core_derivatives(Instance *s, double *dx)
{
    rates(&s->c, s->c.x, dx);
    return CORE_OK;
}

CoreStatus core_indicators(Instance *s, double *z)
{
    z[0] = s->c.resting ? 1.0 : s->c.x[0] + (s->c.x[1] > 0.0 ? 1e-12 : 0.0);
    return CORE_OK;
}

CoreStatus core_update_discrete(Instance *s, EventInfo *info)
{
    memset(info, 0, sizeof *info);
    info->states_changed = bounce(s);
    return CORE_OK;
}

CoreStatus core_completed_step(Instance *s, int *enter_event_mode)
{
    (void)s;
    *enter_event_mode = 0;
    return CORE_OK;
}

CoreStatus core_directional(Instance *s, const unsigned *unknown, size_t n_unknown, const unsigned *known, size_t n_known,
                            const double *seed, double *out)
{
    const Core *c = &s->c;
    for (size_t i = 0; i < n_unknown; i++) {
        out[i] = 0.0;
        for (size_t j = 0; j < n_known; j++) {
            const int acceleration = unknown[i] == 13 || unknown[i] == 15;
            if (known[j] != 8 && known[j] != 10 && known[j] != 11)
                return say(s, CORE_ERROR, "logStatusError", " is no known of a derivative", model_variables[known[j]].name);
            if (acceleration && known[j] == 8) out[i] += seed[j] * (c->u[ON] != 0.0 ? c->p[N] / c->p[M] : 0.0);
            if (acceleration && known[j] == 11) out[i] -= seed[j] * drag(c) / c->p[M];
            if (unknown[i] == 12 && known[j] == 11) out[i] += seed[j];
            if (unknown[i] == 14 && known[j] == 8) out[i] += 0.01 * seed[j];
            if (unknown[i] == 14 && known[j] == 10) out[i] += seed[j];
        }
    }
    return CORE_OK;
}

size_t core_snapshot_size(const Instance *s) { return sizeof s->c; }
void core_save(const Instance *s, void *bytes) { memcpy(bytes, &s->c, sizeof s->c); }

CoreStatus core_load(Instance *s, const void *bytes, size_t size)
{
    if (size != sizeof s->c)
        return say(s, CORE_ERROR, "logStatusError", " has another size", "snapshot");
    memcpy(&s->c, bytes, size);
    return CORE_OK;
}
