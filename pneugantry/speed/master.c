/* The loop of pyfmi_runner/compiled_loop.py written in C: what a hand-written master needs for the same work.
 *
 * Same order of operations, hence the same bits: FMU by the same functions, sensor noise (Table 3.3), PI force/velocity controller (Eq. 3-3
 * to 3-17), all channels logged to memory. A workpiece of the user's own, and errors of the sensors beyond their noise, are left out. */
#include <math.h>
#include <stddef.h>
#include <stdint.h>

typedef int (*Values)(void *component, const uint32_t *references, size_t n, void *values);
typedef int (*DoStep)(void *component, double time, double step, int discard_earlier_states);

typedef struct {
    void *component;
    Values set_real, set_boolean, get_real;
    DoStep do_step;
    const uint32_t *commands, *clamps, *manual, *outputs; /* two, two, two and nine value references */
} Wiring;

typedef struct {
    int64_t samples, period; /* period in us */
    const int64_t *phase, *acts;
    const double *f_nd, *v_td, *manual, *noise;
    const int32_t *clamps;
    double approach[2], sigma[8];
} Course;

typedef struct {
    double k_p, k_i;
} Gains;

typedef struct {
    Gains v_x, f_z, f_x, v_z;
    double u_0x, u_0z, dt;
} Controller;

typedef struct {
    double v_x, f_z, f_x, v_z; /* integrals, V */
} State;

enum { APPROACH, CONTACT, CONTOUR, RETREAT };
enum { X, Z, V_X, V_Z, F_X, F_Z, F_AX, F_AZ, THETA };
static const double MICROSECOND = 1e-6, U_MAX = 5.0, F_MIN = 2.0;

static double clip(double u) { return u < 0.0 ? 0.0 : u > U_MAX ? U_MAX : u; }

/* Side of c that would drive a clipped command further out: conditional integration. */
static int barred(double u, int valve) { return u > U_MAX ? valve : u < 0.0 ? -valve : 0; }

static void integrate(const Gains *gains, double *integral, double error, double dt, int side) {
    if (!(side * error > 0.0)) *integral += gains->k_i * dt * error;
}

static void control(const Controller *p, State *s, double f_nd, double v_td, const double *seen, double *u) {
    const double f_x = seen[F_X], f_z = seen[F_Z];
    const double theta = f_x * f_x + f_z * f_z < F_MIN * F_MIN ? 0.0 : atan2(-f_x, f_z);
    const double si = sin(theta), co = cos(theta);
    const double e_fn = f_nd - (-f_x * si + f_z * co), e_vt = v_td - (seen[V_X] * co + seen[V_Z] * si);
    const double e_vx = e_vt * co, e_fz = e_fn * co, e_fx = -e_fn * si, e_vz = e_vt * si;
    const double c_x = (p->v_x.k_p * e_vx + s->v_x) + (p->f_x.k_p * e_fx + s->f_x) + 0.0;
    const double c_z = (p->f_z.k_p * e_fz + s->f_z) + (p->v_z.k_p * e_vz + s->v_z) + 0.0;
    const double u_x = p->u_0x - c_x, u_z = p->u_0z + c_z;
    const int bar_x = barred(u_x, -1), bar_z = barred(u_z, 1);
    integrate(&p->v_x, &s->v_x, e_vx, p->dt, bar_x);
    integrate(&p->f_z, &s->f_z, e_fz, p->dt, bar_z);
    integrate(&p->f_x, &s->f_x, e_fx, p->dt, bar_x);
    integrate(&p->v_z, &s->v_z, e_vz, p->dt, bar_z);
    u[0] = clip(u_x);
    u[1] = clip(u_z);
}

/* Runs the course on an FMU that is ready to step; returns the number of samples recorded. */
__attribute__((visibility("default"))) int64_t master_run(const Wiring *fmu, const Course *course, const Controller *controller,
                                                          double *given, double *commands, double *measured, double *theta) {
    State state = {0, 0, 0, 0};
    double acting[2] = {course->approach[0], course->approach[1]}, outputs[9];
    int64_t acted = 0;
    int status = 0;
    for (int64_t k = 0; k < course->samples; k++) {
        int64_t now = k * course->period;
        const int64_t end = now + course->period;
        const int32_t *clamp = course->clamps + 2 * k;
        const double *manual = course->manual + 2 * k, *noise = course->noise + 8 * k;
        double *u = given + 2 * k, *seen = measured + 8 * k;
        if (k == 0 || clamp[0] != clamp[-2] || clamp[1] != clamp[-1])
            status |= fmu->set_boolean(fmu->component, fmu->clamps, 2, (void *)clamp);
        if (k == 0 || manual[0] != manual[-2] || manual[1] != manual[-1])
            status |= fmu->set_real(fmu->component, fmu->manual, 2, (void *)manual);
        status |= fmu->get_real(fmu->component, fmu->outputs, 9, outputs);
        for (int j = 0; j < 8; j++) seen[j] = outputs[j] + course->sigma[j] * noise[j];
        if (course->phase[k] == APPROACH) u[0] = course->approach[0], u[1] = course->approach[1];
        else if (course->phase[k] == RETREAT) u[0] = u[1] = 0.0;
        else control(controller, &state, course->f_nd[k], course->v_td[k], seen, u);
        for (; acted <= k && course->acts[acted] <= now; acted++) acting[0] = given[2 * acted], acting[1] = given[2 * acted + 1];
        commands[2 * k] = acting[0];
        commands[2 * k + 1] = acting[1];
        theta[k] = outputs[THETA];
        status |= fmu->set_real(fmu->component, fmu->commands, 2, acting);
        for (; acted <= k && course->acts[acted] < end; acted++) {
            const int64_t until = course->acts[acted];
            status |= fmu->do_step(fmu->component, now * MICROSECOND, (until - now) * MICROSECOND, 1);
            now = until;
            acting[0] = given[2 * acted];
            acting[1] = given[2 * acted + 1];
            status |= fmu->set_real(fmu->component, fmu->commands, 2, acting);
        }
        status |= fmu->do_step(fmu->component, now * MICROSECOND, (end - now) * MICROSECOND, 1);
        if (status > 1) return k + 1;
    }
    return course->samples;
}
