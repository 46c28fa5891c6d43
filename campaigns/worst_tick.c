/* Times the ticks of an exported controller.
 *
 *     worst_tick SAMPLES REPETITIONS
 *
 * A sample is the doubles of the input. The whole of them is repeated, each time by an instance
 * that begins; of each tick the least thread time over the repetitions is kept, without what the
 * clock itself takes: a worst tick of these is free of interrupts, but runs code that nobody has run
 * for thousands of ticks. Then some ticks, those that took longest and one of 64, are each repeated
 * from the memory that they began with, which has their code in the caches. Both are written to
 * standard output, one after the other, as doubles [s]; of ticks that were not repeated so the
 * second number is none. */
#define _POSIX_C_SOURCE 200809L
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include HEADER

#define JOIN_(a, b) a##_##b
#define JOIN(a, b) JOIN_(a, b)
#define OF(part) JOIN(NAME, part)

enum { ONE_OF = 64, LONGEST = 32, IN_PLACE = 10 };

static double seconds(void)
{
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static double of_the_clock(void)
{
    double least = 1.0;
    for (int i = 0; i < 1000; i++) {
        double begin = seconds(), taken = seconds() - begin;
        if (taken < least) least = taken;
    }
    return least;
}

/* The least time of a tick in `turns` runs of all of them, or each of those that are `chosen` in ten
 * times as many repetitions from the same memory. */
static void repeat(
    const struct OF(input) *in, size_t ticks, long turns, const bool *chosen, double *least)
{
    struct OF(output) out;
    void *memory = malloc(OF(size)()), *before = malloc(OF(size)());
    double clock = of_the_clock();
    long runs = chosen == NULL ? turns : 1;
    for (size_t i = 0; i < ticks; i++) least[i] = NAN;
    for (long run = 0; run < runs; run++) {
        struct NAME *m = OF(init)(memory);
        OF(start)(m, in, &out);
        for (size_t i = 0; i < ticks; i++) {
            long turn = chosen == NULL || !chosen[i] ? 1 : IN_PLACE * turns;
            if (turn > 1) memcpy(before, memory, OF(size)());
            for (; turn > 0; turn--) {
                double begin = seconds();
                OF(step)(m, &in[i], &out);
                double taken = seconds() - begin - clock;
                if ((chosen == NULL || chosen[i]) && !(least[i] <= taken)) least[i] = taken;
                if (turn > 1) memcpy(memory, before, OF(size)());
            }
        }
    }
    free(before);
    free(memory);
}

static int descending(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x < y) - (x > y);
}

int main(int count, char **words)
{
    struct OF(input) *in = NULL;
    size_t ticks = 0, room = 0;
    long turns = count == 3 ? atol(words[2]) : 0;
    FILE *file = count == 3 ? fopen(words[1], "rb") : NULL;
    if (file == NULL || turns < 1) return 2;
    do {
        if (ticks == room) {
            room = room ? 2 * room : 1024;
            in = realloc(in, room * sizeof *in);
        }
    } while (fread(&in[ticks], sizeof *in, 1, file) == 1 && ++ticks);
    fclose(file);
    double *least = malloc(ticks * sizeof *least), *sorted = malloc(ticks * sizeof *least);
    bool *chosen = malloc(ticks * sizeof *chosen);
    repeat(in, ticks, turns, NULL, least);
    memcpy(sorted, least, ticks * sizeof *least);
    qsort(sorted, ticks, sizeof *sorted, descending);
    for (size_t i = 0; i < ticks; i++)
        chosen[i] = i % ONE_OF == 0 || ticks <= LONGEST || least[i] > sorted[LONGEST];
    fwrite(least, sizeof *least, ticks, stdout);
    repeat(in, ticks, turns, chosen, least);
    fwrite(least, sizeof *least, ticks, stdout);
    free(chosen);
    free(sorted);
    free(least);
    free(in);
    return 0;
}
