/* A controller of one's own for `taskspec plant`, in C: a Cartesian spring with a force on top.
 *
 *     cc -O2 -o client examples/plant/client.c -lm
 *     taskspec plant tasks/wipe-table.yaml --listen udp://127.0.0.1:39017
 *     ./client 39017
 *
 * An arm that takes velocities or positions follows the set points, and yields to forces.
 *
 * link.h has the packets. */
#include "link.h"

#include <math.h>

static const double SPRING[2] = {8000, 40}, DAMPER[2] = {250, 2}; /* linear, angular */
static const double INTEGRAL = 10, JOINT_DAMPING = 0.3, PERIOD = 1e-3;

/* How fast velocities take an error of position away [1/s], and what they are by force. */
static const double FOLLOWING = 8, YIELDING[2] = {8e-4, 0.05};

static double or_zero(double x) { return isfinite(x) ? x : 0; }

/* Solves A x = b of six rows in place; A is symmetric and positive. */
static void solve(double A[6][6], double *x) {
    for (int i = 0; i < 6; i++)
        for (int r = i + 1; r < 6; r++) {
            double share = A[r][i] / A[i][i];
            for (int c = i; c < 6; c++) A[r][c] -= share * A[i][c];
            x[r] -= share * x[i];
        }
    for (int i = 5; i >= 0; i--) {
        for (int c = i + 1; c < 6; c++) x[i] -= A[i][c] * x[c];
        x[i] /= A[i][i];
    }
}

/* Joint velocities Jt (J Jt)^-1 v: v leads along the references, or by the force that lacks. Of an
 * arm that takes positions, their sum. */
static const char *rates(const struct sample *s, double *command) {
    static double place[JOINTS];
    int n = s->joints;
    const double *J = s->values + 3 * n + 6 + s->reactions, *frame = J + 6 * n + 15;
    const double *x = frame + 9, *x_ref = x + 6, *dx_ref = x + 18, *f = x + 24, *f_ref = x + 30;
    double v[6], turned[6] = {0}, A[6][6] = {{0}};
    for (int i = 0; i < 6; i++)
        v[i] = isfinite(f_ref[i]) ? YIELDING[i / 3] * (f_ref[i] - or_zero(f[i]))
                                  : or_zero(dx_ref[i]) + FOLLOWING * or_zero(x_ref[i] - x[i]);
    for (int i = 0; i < 6; i++)
        for (int k = 0; k < 3; k++) turned[i] += frame[3 * k + i % 3] * v[i / 3 * 3 + k];
    for (int i = 0; i < 6; i++)
        for (int k = 0; k < 6; k++)
            for (int j = 0; j < n; j++) A[i][k] += J[6 * j + i] * J[6 * j + k];
    solve(A, turned);
    for (int j = 0; j < n; j++) {
        double rate = 0;
        for (int i = 0; i < 6; i++) rate += J[6 * j + i] * turned[i];
        place[j] = s->flags & START ? s->values[j] : place[j] + PERIOD * rate;
        command[j] = s->quantity == POSITION ? place[j] : rate;
    }
    return 0;
}

/* Joint torques Jt w + g: w is a spring to the reference, or the force that is wanted. The extras
 * come in this order: gravity, jacobian, tip, tip_rotation, offset, frame, position, position_ref,
 * velocity, velocity_ref, force, force_ref. */
static const char *law(const struct sample *s, double *torque) {
    static double memory[6];
    int n = s->joints;
    if (s->quantity != TORQUE) return rates(s, torque);
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
