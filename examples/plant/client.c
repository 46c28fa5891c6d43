/* A controller of one's own for `taskspec plant`, in C: a Cartesian spring with a force on top.
 *
 *     cc -O2 -o client examples/plant/client.c -lm
 *     taskspec plant tasks/wipe-table.yaml --listen udp://127.0.0.1:39017
 *     ./client 39017
 *
 * It needs POSIX sockets and a little-endian machine; docs/protocol.md has every byte. */
#include <arpa/inet.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

enum { HELLO = 1, WELCOME, STATE, COMMAND, STOP, HEAD = 24, BODY = 24, JOINTS = 16 };
static const double SPRING[2] = {8000, 40}, DAMPER[2] = {250, 2}; /* linear, angular */
static const double INTEGRAL = 10, JOINT_DAMPING = 0.3, PERIOD = 1e-3;

static uint32_t crc32(const unsigned char *data, size_t size) {
    uint32_t crc = ~0u;
    for (size_t i = 0; i < size; i++) {
        crc ^= data[i];
        for (int k = 0; k < 8; k++) crc = crc >> 1 ^ (crc & 1 ? 0xEDB88320u : 0);
    }
    return ~crc;
}

static size_t seal(unsigned char *p, int kind, uint32_t session, uint32_t number, size_t body) {
    uint16_t size = (uint16_t)(HEAD + body + 4);
    memset(p, 0, HEAD);
    memcpy(p, "TSPK", 4), p[4] = 1, p[5] = (unsigned char)kind;
    memcpy(p + 6, &size, 2), memcpy(p + 8, &session, 4), memcpy(p + 12, &number, 4);
    uint32_t crc = crc32(p, HEAD + body);
    memcpy(p + HEAD + body, &crc, 4);
    return size;
}

/* Kind of a packet; 0 of what is none. */
static int kind_of(const unsigned char *p, ssize_t size) {
    uint16_t said;
    uint32_t crc;
    if (size < HEAD + 4 || memcmp(p, "TSPK", 4) || p[4] != 1) return 0;
    memcpy(&said, p + 6, 2), memcpy(&crc, p + size - 4, 4);
    return said == size && crc == crc32(p, (size_t)size - 4) ? p[5] : 0;
}

static double or_zero(double x) { return isfinite(x) ? x : 0; }

/* Joint torques Jt w + g: w is a spring to the reference, or the force that is wanted. The extras
 * come in this order: gravity, jacobian, tip, tip_rotation, offset, frame, position, position_ref,
 * velocity, velocity_ref, force, force_ref. */
static void law(int n, const double *v, const double *extras, double *memory, double *torque) {
    const double *g = extras, *J = g + n, *frame = J + 6 * n + 15, *x = frame + 9, *x_ref = x + 6;
    const double *dx = x_ref + 6, *dx_ref = dx + 6, *f = dx_ref + 6, *f_ref = f + 6;
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
}

int main(int argc, char **argv) {
    static unsigned char in[16384], out[HEAD + 8 + 8 * JOINTS + 4];
    struct sockaddr_in at = {.sin_family = AF_INET};
    struct timeval half = {.tv_usec = 500000};
    int link = socket(AF_INET, SOCK_DGRAM, 0), kind = 0, silent = 0;
    uint32_t session = 0, number, newest = 0, any = 0;
    double memory[6] = {0}, values[2048];
    size_t size = 0;
    if (argc < 2) return fprintf(stderr, "usage: client PORT\n"), 2;
    at.sin_port = htons((uint16_t)atoi(argv[1])), at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    setsockopt(link, SOL_SOCKET, SO_RCVTIMEO, &half, sizeof half);
    if (link < 0 || connect(link, (struct sockaddr *)&at, sizeof at)) return perror("client"), 2;
    while (kind != STOP) {
        if (!session) { /* a hello is sent until it is answered */
            memcpy(out + HEAD, "{\"client\":\"client.c\"}", 21);
            send(link, out, seal(out, HELLO, 0, 0, 21), 0);
        }
        ssize_t got = recv(link, in, sizeof in, 0);
        if (got < 0) usleep(100000); /* nobody listens yet */
        silent = got < 0 ? silent + 1 : 0;
        if (silent > 100) return fprintf(stderr, "client: the plant says nothing\n"), 1;
        kind = got < 0 ? 0 : kind_of(in, got);
        if (kind == WELCOME) memcpy(&session, in + 8, 4);
        if (kind != STATE || !session) continue;
        int n = in[HEAD + 4], m = in[HEAD + 5];
        memcpy(&number, in + 12, 4);
        if (n > JOINTS || (size_t)got > HEAD + BODY + sizeof values) return 1;
        if (!any || number > newest) {
            memcpy(values, in + HEAD + BODY, (size_t)got - HEAD - BODY - 4);
            double torque[JOINTS];
            law(n, values + n, values + 2 * n + 6 + m, memory, torque);
            memset(out + HEAD, 0, 8), out[HEAD + 2] = (unsigned char)n;
            memcpy(out + HEAD + 8, torque, 8 * (size_t)n);
            size = seal(out, COMMAND, session, number, 8 + 8 * (size_t)n);
            newest = number, any = 1;
        }
        if (number == newest) send(link, out, size, 0); /* one that comes again, again */
    }
    printf("the plant says: %.*s\n", (int)(in[6] + 256 * in[7] - HEAD - 4), in + HEAD);
    return 0;
}
