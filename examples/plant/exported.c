/* The exported controller of a task drives `taskspec plant`: TASK is what its files are called.
 *
 *     taskspec export tasks/wipe-table.yaml --c controller
 *     cc -std=c99 -O2 -DTASK=wipe_table -Icontroller -o exported \
 *         examples/plant/exported.c controller/wipe_table.c -lm
 *     taskspec plant tasks/wipe-table.yaml --listen udp://127.0.0.1:39017
 *     ./exported 39017
 *
 * link.h has the packets. */
#include "link.h"
#include <stddef.h>

#define PASTED(task, part) task##_##part
#define JOINED(task, part) PASTED(task, part)
#define QUOTED(text) #text
#define HEADER(name) QUOTED(name.h)
#define OF(part) JOINED(TASK, part)
#include HEADER(TASK)

static struct OF(input) in;
static struct OF(output) answer;
static struct TASK *task;

/* The sample's numbers stand in the order of the header. Its stamp says which period it is of:
 * where samples were lost, `step` goes through their periods, too. */
static const char *answered(const struct sample *s, double *command) {
    enum { N = sizeof in.q / sizeof *in.q };
    const double *values = s->values;
    int over = answer.state != 0;
    if (s->joints != N) return "the plant's robot has another number of joints";
    if (s->quantity != OF(quantity)) return "the plant's robot is commanded something else";
    memcpy(in.q, values, sizeof in.q), memcpy(in.v, values + N, sizeof in.v);
    memcpy(in.wrench, values + 2 * N, sizeof in.wrench);
    for (int i = 0; i < s->reactions; i++) in.reactions[i] = values[2 * N + 6 + i];
    in.stamp = s->stamp;
    if (s->flags & START) OF(start)(task, &in, &answer);
    else OF(step)(task, &in, &answer);
    /* It begins with what is commanded: the joints, then the gripper where the task grips. */
    memcpy(command, &answer, offsetof(struct OF(output), state));
    /* The plant ends the run where the file does. Where it goes on, the plant gets the reason. */
    return over && answer.state != 0 ? OF(status)(task).text : 0;
}

int main(int argc, char **argv) {
    if (argc < 2) return fprintf(stderr, "usage: exported PORT\n"), 2;
    task = OF(init)(malloc(OF(size)()));
    int failed = drive("exported.c", atoi(argv[1]), answered);
    struct OF(status) s = OF(status)(task);
    printf("the controller says: state %d in stage '%s': %s; %lld periods, %lld samples lost\n",
           (int)s.state, s.stage, s.text, (long long)s.ticks, (long long)s.lost);
    return failed || s.state != 1;
}
