/* The link of a controller to `taskspec plant`, for the examples of this folder.
 *
 * It needs POSIX sockets and a little-endian machine; docs/protocol.md has every byte. */
#define _POSIX_C_SOURCE 200809L
#include <arpa/inet.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <time.h>

enum { HELLO = 1, WELCOME, STATE, COMMAND, STOP, HEAD = 24, BODY = 24, JOINTS = 16, LONGEST = 16384 };
enum { START = 1, LAST = 2 }; /* flags of a sample: its answer is not applied; it has none */

enum { TORQUE, VELOCITY, POSITION }; /* what the joints are commanded */

/* A sample. After the velocities come wrench (6), reactions and extras. */
struct sample {
    int flags, joints, reactions, quantity, grips;
    double stamp, values[LONGEST / 8];
};
/* Answers a sample with what the joints are commanded, a torque, velocity or position each, as
 * the sample's `quantity` says, and one number more where it `grips`: what each jaw of the gripper
 * presses with; 0 to go on, else why it ends the run. */
typedef const char *controller(const struct sample *s, double *command);

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

/* What the arm of a welcome takes. */
static int quantity_of(unsigned char *welcome, ssize_t size) {
    welcome[size - 4] = 0; /* its text ends where the checksum was */
    const char *text = (const char *)welcome + HEAD;
    if (strstr(text, "\"command\":\"velocity\"")) return VELOCITY;
    return strstr(text, "\"command\":\"position\"") ? POSITION : TORQUE;
}

/* Has a controller drive the plant at a port of this machine, until the plant or it stops.
 * Returns 0 where the plant had the last word. */
static int drive(const char *name, int port, controller *answer) {
    static unsigned char in[LONGEST], out[HEAD + 8 + 8 * JOINTS + 8 + 4];
    static struct sample s;
    struct sockaddr_in at = {.sin_family = AF_INET};
    struct timeval half = {.tv_usec = 500000};
    struct timespec tenth = {.tv_nsec = 100000000};
    int link = socket(AF_INET, SOCK_DGRAM, 0), kind = 0, silent = 0;
    uint32_t session = 0, number, newest = 0, any = 0;
    double command[JOINTS + 1] = {0};
    const char *why = 0;
    size_t size = 0;
    at.sin_port = htons((uint16_t)port), at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (link < 0 || connect(link, (struct sockaddr *)&at, sizeof at)) return perror(name), 2;
    setsockopt(link, SOL_SOCKET, SO_RCVTIMEO, &half, sizeof half);
    while (kind != STOP) {
        if (!session) { /* a hello is sent until it is answered */
            int body = snprintf((char *)out + HEAD, sizeof out - HEAD, "{\"client\":\"%.40s\"}", name);
            send(link, out, seal(out, HELLO, 0, 0, (size_t)body), 0);
        }
        ssize_t got = recv(link, in, sizeof in, 0);
        if (got < 0) nanosleep(&tenth, 0); /* nobody listens yet */
        silent = got < 0 ? silent + 1 : 0;
        if (silent > (session ? 100 : 600))
            return fprintf(stderr, "%s: no plant answers at port %d\n", name, port), 1;
        kind = got < 0 ? 0 : kind_of(in, got);
        if (kind == WELCOME) {
            memcpy(&session, in + 8, 4), s.quantity = quantity_of(in, got);
            s.grips = strstr((const char *)in + HEAD, "\"grips\":true") != 0;
        }
        if (kind != STATE || !session) continue;
        memcpy(&number, in + 12, 4);
        if (!any || number > newest) {
            memcpy(&s.stamp, in + 16, 8), s.flags = in[HEAD];
            s.joints = in[HEAD + 4], s.reactions = in[HEAD + 5];
            if (s.joints > JOINTS) return fprintf(stderr, "%s: too many joints\n", name), 1;
            memcpy(s.values, in + HEAD + BODY, (size_t)got - HEAD - BODY - 4);
            why = answer(&s, command);
            if (why && !(s.flags & LAST)) { /* the plant's server brings the arm to rest */
                size_t body = strlen(why) < 8 * JOINTS ? strlen(why) : 8 * JOINTS;
                memcpy(out + HEAD, why, body);
                size = seal(out, STOP, session, 0, body);
            } else {
                memset(out + HEAD, 0, 8);
                out[HEAD] = (unsigned char)s.quantity, out[HEAD + 2] = (unsigned char)s.joints;
                size_t body = 8 * (size_t)(s.joints + s.grips);
                out[HEAD + 3] = (unsigned char)s.grips;
                memcpy(out + HEAD + 8, command, body);
                size = seal(out, COMMAND, session, number, 8 + body);
            }
            newest = number, any = 1;
        }
        if (number == newest) send(link, out, size, 0); /* one that comes again, again */
        if (why && !(s.flags & LAST)) return fprintf(stderr, "%s: %s\n", name, why), 1;
    }
    printf("the plant says: %.*s\n", (int)(in[6] + 256 * in[7] - HEAD - 4), in + HEAD);
    return 0;
}
