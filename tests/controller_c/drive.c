/* Drives an exported controller with samples from standard input, and writes its answers.
 *
 * A sample is the doubles of the input; an answer those of the output, which are the torques and of
 * a task that grips the force of the jaws, then the state and the stage as doubles. */
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include HEADER

#define JOIN_(a, b) a##_##b
#define JOIN(a, b) JOIN_(a, b)
#define OF(part) JOIN(NAME, part)

int main(void)
{
    struct OF(input) in;
    struct OF(output) out;
    void *memory = malloc(OF(size)());
    struct NAME *m = OF(init)(memory);
    double answer[offsetof(struct OF(output), state) / sizeof(double) + 2];
    size_t n = offsetof(struct OF(output), state) / sizeof(double);
    int first = 1;
    memset(&in, 0, sizeof in);
    while (fread(&in, sizeof in, 1, stdin) == 1) {
        if (first) OF(start)(m, &in, &out);
        if (!first || out.state == 0) OF(step)(m, &in, &out);
        first = 0;
        memcpy(answer, &out, n * sizeof(double));
        answer[n] = out.state;
        answer[n + 1] = out.stage;
        fwrite(answer, sizeof(double), n + 2, stdout);
        fflush(stdout);
    }
    free(memory);
    return 0;
}
