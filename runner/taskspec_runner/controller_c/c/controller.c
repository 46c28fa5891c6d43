/* The controller of the task "@TITLE@", made by taskspec @VERSION@. See @NAME@.h.
 *
 * Compile with -std=c99 or newer, without -ffast-math; link with libm. */
#include "@NAME@.h"

/* No product is rounded together with a sum. gcc 12 does that to vectors, whatever -ffp-contract
 * says, so that it is to form none. */
#if defined __clang__
#pragma STDC FP_CONTRACT OFF
#elif defined __GNUC__
#pragma GCC optimize("fp-contract=off", "no-tree-slp-vectorize")
#endif

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__)
#error "compile it without -ffast-math and -Ofast: numbers that are not finite have to end the task"
#endif

#ifdef __GNUC__
/* Not every task needs all of what follows. */
#pragma GCC diagnostic ignored "-Wunused-function"
#endif

/* ---- what Python means where C means something else */

@PRELUDE@

/* ---- the machine */

@KERNEL@

/* ---- expressions */

@FUNCTIONS@

/* ---- memory */

@INITIAL@

#define TS_LENGTH(table) (sizeof table / sizeof table[0])
/* Stamps further ahead than so many periods are no time of a run. */
#define TS_FARTHEST 1e9
/* A sample is that of a tick if its stamp is nearer than this [periods]. */
#define TS_TOLERANCE 0.75

#define TS_POSITIONS 2
static const double host_posture[] = @UPPER@_START;
enum { TS_DONE = @UPPER@_DONE, TS_FAILED = @UPPER@_FAILED, TS_STOPPED = @UPPER@_STOPPED };

static const char *const host_stages[] = {@STAGE_NAMES@};
static const struct { int32_t state; const char *name; const char *text; } host_events[] = {
@EVENTS@
};

static const struct @NAME@_param_facts host_params[] = {
@PARAM_FACTS@
};

struct @NAME@ {
@MEMBERS@
    struct Evaluation nothing;
    struct ControllerMemory *now;
    double *wrench;
    double begin, stamp, answer[@JOINTS@];
    int64_t due, row, lost;
    int32_t state, event, bears;
    bool measured;
};
/* The size in the header is enough. */
typedef char ts_fits[sizeof(struct @NAME@) <= @UPPER@_SIZE ? 1 : -1];

const char *@NAME@_task(void) { return "@HASH@"; }

uint64_t @NAME@_size(void) { return sizeof(struct @NAME@); }

struct @NAME@ *@NAME@_init(void *memory)
{
    struct @NAME@ *m = (struct @NAME@ *)memory;
    uint64_t i;
    memset(m, 0, sizeof *m);
    for (i = 0; i < TS_LENGTH(ts_first_numbers); i++)
        m->numbers[ts_first_numbers[i].at] = ts_first_numbers[i].value;
    for (i = 0; i < TS_LENGTH(ts_first_words); i++)
        m->words[ts_first_words[i].at] = ts_first_words[i].value;
    for (i = 0; i < TS_LENGTH(ts_first_counts); i++)
        m->counts[ts_first_counts[i].at] = ts_first_counts[i].value;
    for (i = 0; i < TS_LENGTH(ts_arguments_at); i++)
        m->arguments[i] = m->numbers + ts_arguments_at[i];
    for (i = 0; i < TS_LENGTH(ts_results_at); i++)
        m->results[i] = m->numbers + ts_results_at[i];
@FILLING@
    m->now = &m->controllermemory[0];
    m->wrench = @READING@;
    m->state = @UPPER@_NOT_STARTED;
    m->event = -1;
    m->bears = @UPPER@_BEARS;
    if (@NAME@_quantity == TS_POSITIONS) memcpy(m->answer, host_posture, sizeof m->answer);
    return m;
}

void @NAME@_bear(struct @NAME@ *m, int32_t lost) { m->bears = lost < 0 ? 0 : lost; }

const struct @NAME@_param_facts *@NAME@_params(void) { return host_params; }

double @NAME@_set(struct @NAME@ *m, int32_t param, double value)
{
    struct LiveTable *live = m->now->live;
    if (param < 0 || param >= @UPPER@_PARAMS) return NAN;
    if (isnan(value)) return live->targets[param];
    if (m->state == @UPPER@_NOT_STARTED) return declare(live, param, value);
    return request(live, param, value, m->now->now[1]);
}

double @NAME@_get(const struct @NAME@ *m, int32_t param)
{
    return param < 0 || param >= @UPPER@_PARAMS ? NAN : m->now->live->values[param];
}

/* Takes what a sample measures; whether its numbers are finite. */
static bool host_take(struct @NAME@ *m, const struct @NAME@_input *in)
{
    double sum = in->stamp;
    int i;
    for (i = 0; i < @JOINTS@; i++) sum += 0.0 * in->q[i] + 0.0 * in->v[i];
    for (i = 0; i < 6; i++) sum += 0.0 * in->wrench[i];
    for (i = 0; i < @REACTIONS@; i++) sum += 0.0 * in->reactions[i];
    if (!isfinite(sum)) return false;
    for (i = 0; i < @JOINTS@; i++) {
        m->now->q[i] = in->q[i];
        m->now->v[i] = in->v[i];
    }
    /* Where nothing has been commanded yet, positions are held where they are measured. */
    for (i = 0; @NAME@_quantity == TS_POSITIONS && !m->measured && i < @JOINTS@; i++)
        m->answer[i] = in->q[i];
    for (i = 0; i < 6; i++) m->wrench[i] = in->wrench[i];
    for (i = 0; i < @REACTIONS@; i++) m->now->reactions[i] = in->reactions[i];
    m->measured = true;
    return true;
}

/* Whether the commands of a tick may be used; sets the state where only they say that not. */
static bool host_sane(struct @NAME@ *m)
{
    bool finite = true;
    int i;
    for (i = 0; i < @JOINTS@; i++) finite = finite && isfinite(m->now->torque[i]);
    if (!finite && m->state == @UPPER@_RUNNING) m->state = @UPPER@_DIVERGED;
    return finite && m->state != @UPPER@_DIVERGED;
}

/* Takes note of how fast the positions go that are commanded. */
static void host_note(struct @NAME@ *m, int32_t lost)
{
    int i;
    for (i = 0; @NAME@_quantity == TS_POSITIONS && i < @JOINTS@; i++)
        m->now->rate[i] = (m->now->torque[i] - m->answer[i]) / ((1 + lost) * @UPPER@_PERIOD);
}

/* Takes the arm's motion away, from the commands of the last answer on. */
static void host_rest(struct @NAME@ *m)
{
    int i;
    for (i = 0; i < @JOINTS@; i++) m->now->torque[i] = m->answer[i];
    if (m->measured) stop(m->now);
    for (i = 0; i < @JOINTS@; i++)
        if (!isfinite(m->now->torque[i])) m->now->torque[i] = m->answer[i];
}

static int32_t host_answer(struct @NAME@ *m, struct @NAME@_output *out, int32_t lost)
{
    int i;
    for (i = 0; i < @JOINTS@; i++) out->@COMMAND@[i] = m->answer[i] = m->now->torque[i];
    out->state = m->state;@GRIP_ANSWER@
    out->stage = (int32_t)m->now->stage;
    out->lost = lost;
    return m->state;
}

void @NAME@_start(struct @NAME@ *m, const struct @NAME@_input *in, struct @NAME@_output *out)
{
    if (m->state != @UPPER@_NOT_STARTED) {
        int32_t bears = m->bears;
        @NAME@_init(m);
        m->bears = bears;
    }
    if (!host_take(m, in)) {
        m->state = @UPPER@_BAD_SAMPLE;
    } else {
        m->state = @UPPER@_RUNNING;
        m->begin = in->stamp;
        m->stamp = in->stamp - @UPPER@_PERIOD;
        start(m->now);
        if (!host_sane(m)) host_rest(m);
    }
    host_answer(m, out, 0);
}

/* The state of a task that goes on in none of its stages. */
static int32_t host_over(struct @NAME@ *m, int64_t why)
{
    int64_t event = m->now->exits->first[m->now->stage] + (int64_t)m->now->outputs[0] - 1;
    m->event = (int32_t)event;
    if (why == -2) return @UPPER@_ATTEMPTS;
    if (why == -3) return @UPPER@_UNKNOWN;
    return host_events[event].state;
}

/* One period of the machine. */
static void host_tick(struct @NAME@ *m)
{
    int64_t event = control(m->now);
    while (event > 0) {
        int64_t to = leave(m->now);
        if (to < 0) {
            m->state = host_over(m, to);
            return;
        }
        struct ControllerMemory *after = &m->controllermemory[to];
        bool again = repeats(m->now->exits, m->now->stage, event);
        begin(m->now, after, again);
        m->now = after;
        event = open_stage(m->now);
    }
    if (event < 0) m->state = event == -1 ? @UPPER@_UNANSWERED : @UPPER@_DIVERGED;
    m->now->ticks += 1;
}

int32_t @NAME@_step(struct @NAME@ *m, const struct @NAME@_input *in, struct @NAME@_output *out)
{
    double ahead = (in->stamp - m->begin) / @UPPER@_PERIOD - (double)m->due;
    int32_t lost = 0, i;
    bool over;
    if (m->state == @UPPER@_RUNNING) {
        if (!isfinite(ahead) || ahead >= TS_FARTHEST || in->stamp <= m->stamp) {
            m->state = isfinite(in->stamp) ? @UPPER@_BAD_STAMP : @UPPER@_BAD_SAMPLE;
        } else if (ahead <= -TS_TOLERANCE) {
            /* Earlier than its tick is due: the answer is the last one. */
            return host_answer(m, out, 0);
        } else {
            lost = ahead >= TS_TOLERANCE ? (int32_t)nearbyint(ahead) : 0;
            m->stamp = in->stamp;
            m->due += 1 + lost;
            /* A host of half the rate loses one before each sample. */
            m->row = lost > 0 ? m->row + lost : 0;
            m->lost += lost;
            if (m->row > m->bears) m->state = @UPPER@_LOST;
        }
    }
    for (i = 0; i < lost && m->state == @UPPER@_RUNNING; i++) host_tick(m);
    if (!host_take(m, in) && m->state == @UPPER@_RUNNING) m->state = @UPPER@_BAD_SAMPLE;
    over = m->state != @UPPER@_RUNNING;
    if (!over) host_tick(m);
    if (over || !host_sane(m)) host_rest(m);
    else host_note(m, lost);
    return host_answer(m, out, lost);
}

static const char *const host_words[] = {
@STATE_WORDS@
};

struct @NAME@_status @NAME@_status(const struct @NAME@ *m)
{
    struct @NAME@_status s;
    bool by_event = m->state >= TS_DONE && m->state <= TS_STOPPED;
    s.state = m->state;
    s.stage = host_stages[m->now->stage];
    s.event = m->event >= 0 ? host_events[m->event].name : "";
    s.text = by_event ? host_events[m->event].text : host_words[m->state];
    s.ticks = m->now->ticks;
    s.lost = m->lost;
    return s;
}
