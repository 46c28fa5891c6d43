/* A controller of one's own for `taskspec plant`, in C: a Cartesian spring with a force on top.
 *
 *     cc -O2 -o client examples/plant/client.c -lm
 *     taskspec plant tasks/wipe-table.yaml --listen udp://127.0.0.1:39017
 *     ./client 39017
 *
 * link.h has the packets. */
#include "link.h"

#include <math.h>

static const double SPRING[2] = {8000, 40}, DAMPER[2] = {250, 2}; /* linear, angular */
static const double INTEGRAL = 10, JOINT_DAMPING = 0.3, PERIOD = 1e-3;

static double or_zero(double x) { return isfinite(x) ? x : 0; }

/* Joint torques Jt w + g: w is a spring to the reference, or the force that is wanted. The extras
 * come in this order: gravity, jacobian, tip, tip_rotation, offset, frame, position, position_ref,
 * velocity, velocity_ref, force, force_ref. */
static const char *law(const struct sample *s, double *torque) {
    static double memory[6];
    int n = s->joints;
    const double *v = s->values + n, *g = v + n + 6 + s->reactions, *J = g + n;
    const double *frame = J + 6 * n + 15, *x = frame + 9, *x_ref = x + 6, *dx = x_ref + 6;
    const double *dx_ref = dx + 6, *f = dx_ref + 6, *f_ref = f + 6;
    double w[6], turned[6] = {0};
    for (int i = 0; i < 6; i++) {
        w[i] = DAMPER[i / 3] * (or_zero(dx_ref[i]) - or_zero(dx[i]));
        if (isfinite(f_ref[i])) {
            memory[i] += PERIOD * INTEGRAL * (f_ref[i] - or_zero(f[i]));
            w[i] += f_ref[i] + memory[i];
        } else {
            memory[i] = 0;
            w[i] += SPRING[i / 3] * or_zero(x_ref[i] - x[i]);
        }
    }
    for (int i = 0; i < 6; i++) /* the frame's axes stand in the columns of `frame` */
        for (int k = 0; k < 3; k++) turned[i] += frame[3 * k + i % 3] * w[i / 3 * 3 + k];
    for (int j = 0; j < n; j++) {
        torque[j] = g[j] - JOINT_DAMPING * v[j];
        for (int i = 0; i < 6; i++) torque[j] += J[6 * j + i] * turned[i];
    }
    return 0;
}

int main(int argc, char **argv) {
    if (argc < 2) return fprintf(stderr, "usage: client PORT\n"), 2;
    return drive("client.c", atoi(argv[1]), law);
}
