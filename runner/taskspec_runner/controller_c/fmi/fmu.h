/* The controller of the task "@TITLE@" as an FMU: what all versions of the interface share.
 *
 * Made by taskspec @VERSION@. */
#include "@NAME@.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define FMU_TOKEN "@TOKEN@"
/* A communication step is so many periods if it is nearer to them than this [periods]. */
#define FMU_TOLERANCE 1e-3

/* References of the variables: the time, the doubles of a sample in their order, the commands, and
 * what else modelDescription.xml has. */
enum {
    FMU_TIME = 0,
    FMU_INPUTS = @INPUTS@,
    FMU_COMMAND = FMU_INPUTS + 1,
    FMU_GRIP = FMU_COMMAND + @UPPER@_JOINTS, /* of a task that grips */
    FMU_STATE = FMU_GRIP + @GRIPS@,
    FMU_STAGE,
    FMU_LOST,
    FMU_EVENT,
    FMU_REASON,
    FMU_SET, /* what each param is set to, then its value */
    FMU_PARAM = FMU_SET + @UPPER@_PARAMS,
    FMU_END = FMU_PARAM + @UPPER@_PARAMS
};

/* Statuses, as all versions number them. */
enum { FMU_OK, FMU_WARNING, FMU_DISCARD, FMU_ERROR };

enum fmu_mode { FMU_INSTANTIATED, FMU_INITIALIZING, FMU_STEPPING, FMU_TERMINATED };

/* Positions of the joints where the task starts; nothing moves, nothing presses. */
static const double fmu_first[@UPPER@_JOINTS] = @UPPER@_START;

struct fmu {
    struct fmu_host host;
    struct @NAME@ *task;
    struct @NAME@_input in;
    struct @NAME@_output out;
    double set[@UPPER@_PARAMS + 1]; /* what params go to; the last is none */
    double time;
    int64_t lost;
    enum fmu_mode mode;
    bool started; /* with the sample that is there */
};

/* An instance, and what it was. */
struct fmu_state {
    struct fmu fmu;
    char memory[];
};

static int fmu_refuse(const struct fmu *f, const char *text)
{
    host_log(&f->host, FMU_ERROR, "logStatusError", text);
    return FMU_ERROR;
}

/* Begins the task with the sample that is there. */
static void fmu_start(struct fmu *f)
{
    int32_t i;
    f->task = @NAME@_init(f->task);
    @NAME@_bear(f->task, (int32_t)f->lost);
    for (i = 0; i < @UPPER@_PARAMS; i++) @NAME@_set(f->task, i, f->set[i]);
    f->in.stamp = f->time;
    @NAME@_start(f->task, &f->in, &f->out);
    f->started = true;
}

static void fmu_reset(struct fmu *f)
{
    int32_t i;
    for (i = 0; i < @UPPER@_PARAMS; i++) f->set[i] = @NAME@_params()[i].value;
    memset(&f->in, 0, sizeof f->in);
    memcpy(&f->in, fmu_first, sizeof fmu_first);
    f->time = 0.0;
    f->lost = @UPPER@_BEARS;
    f->mode = FMU_INSTANTIATED;
    fmu_start(f);
}

static struct fmu *fmu_new(const struct fmu_host *host, const char *token)
{
    struct fmu *f = NULL;
    if (token == NULL || strcmp(token, FMU_TOKEN) != 0) {
        host_log(host, FMU_ERROR, "logStatusError",
                 "the token is not the one of this FMU's modelDescription.xml");
        return NULL;
    }
    f = calloc(1, sizeof *f);
    if (f != NULL) f->task = malloc(@NAME@_size());
    if (f == NULL || f->task == NULL) {
        free(f);
        host_log(host, FMU_ERROR, "logStatusError", "there is no memory for an instance");
        return NULL;
    }
    f->host = *host;
    fmu_reset(f);
    return f;
}

static void fmu_free(struct fmu *f)
{
    if (f == NULL) return;
    free(f->task);
    free(f);
}

static bool fmu_get_number(struct fmu *f, uint32_t reference, double *value)
{
    if (!f->started) fmu_start(f);
    if (reference == FMU_TIME)
        *value = f->time;
    else if (reference <= FMU_INPUTS)
        memcpy(value, (const char *)&f->in + (reference - 1) * sizeof *value, sizeof *value);
    else if (reference >= FMU_GRIP && reference < FMU_STATE)
        *value = @GRIP_OUT@;
    else if (reference < FMU_GRIP)
        *value = f->out.@COMMAND@[reference - FMU_COMMAND];
    else if (reference >= FMU_SET && reference < FMU_PARAM)
        *value = f->set[reference - FMU_SET];
    else if (reference >= FMU_PARAM && reference < FMU_END)
        *value = @NAME@_get(f->task, (int32_t)(reference - FMU_PARAM));
    else
        return false;
    return true;
}

static bool fmu_set_number(struct fmu *f, uint32_t reference, double value)
{
    if (reference >= FMU_SET && reference < FMU_PARAM && !isnan(value)) {
        int32_t param = (int32_t)(reference - FMU_SET);
        f->set[param] = @NAME@_set(f->task, param, value);
    } else if (reference == FMU_TIME || reference > FMU_INPUTS) {
        return false;
    } else {
        memcpy((char *)&f->in + (reference - 1) * sizeof value, &value, sizeof value);
    }
    if (f->mode < FMU_STEPPING) f->started = false;
    return true;
}

static bool fmu_get_whole(struct fmu *f, uint32_t reference, int64_t *value)
{
    if (!f->started) fmu_start(f);
    if (reference == FMU_STATE)
        *value = f->out.state;
    else if (reference == FMU_STAGE)
        *value = f->out.stage;
    else if (reference == FMU_LOST)
        *value = f->lost;
    else
        return false;
    return true;
}

static bool fmu_set_whole(struct fmu *f, uint32_t reference, int64_t value)
{
    if (reference != FMU_LOST || f->mode >= FMU_STEPPING) return false;
    if (value < 0 || value > INT32_MAX) return false;
    f->lost = value;
    f->started = false;
    return true;
}

static bool fmu_get_text(struct fmu *f, uint32_t reference, const char **value)
{
    if (reference != FMU_EVENT && reference != FMU_REASON) return false;
    if (!f->started) fmu_start(f);
    struct @NAME@_status status = @NAME@_status(f->task);
    *value = reference == FMU_EVENT ? status.event : status.text;
    return true;
}

/* What a function returns after which the task is in a state, and was in another before. */
static int fmu_status(const struct fmu *f, int32_t before)
{
    if (f->out.state == before || f->out.state == @UPPER@_DONE) return FMU_OK;
    host_log(&f->host, FMU_WARNING, "logStatusWarning", @NAME@_status(f->task).text);
    return FMU_WARNING;
}

static int fmu_initialize(struct fmu *f, double time)
{
    if (f->mode != FMU_INSTANTIATED) return fmu_refuse(f, "it is initialized already");
    f->time = time;
    f->mode = FMU_INITIALIZING;
    f->started = false;
    return FMU_OK;
}

static int fmu_initialized(struct fmu *f)
{
    if (f->mode != FMU_INITIALIZING) return fmu_refuse(f, "it is not in initialization mode");
    fmu_start(f);
    f->mode = FMU_STEPPING;
    return fmu_status(f, @UPPER@_RUNNING);
}

/* The control periods of a communication step, all with the sample of its begin. */
static int fmu_step(struct fmu *f, double time, double size)
{
    double periods = size / @UPPER@_PERIOD, whole = nearbyint(periods);
    int32_t before = f->out.state;
    if (f->mode != FMU_STEPPING) return fmu_refuse(f, "a step is made after initialization only");
    if (!(whole >= 1.0 && fabs(periods - whole) < FMU_TOLERANCE))
        return fmu_refuse(f, "a communication step must be a multiple of the control period, "
                             "@PERIOD@ s");
    f->in.stamp = time;
    @NAME@_step(f->task, &f->in, &f->out);
    if (whole > 1.0) {
        /* The controller counts the samples between as lost. */
        f->in.stamp = time + (whole - 1.0) * @UPPER@_PERIOD;
        @NAME@_step(f->task, &f->in, &f->out);
    }
    f->time = time + size;
    return fmu_status(f, before);
}

/* A copy of all that an instance is, in its place or a new one; NULL without memory. */
static struct fmu_state *fmu_copy(struct fmu *f, struct fmu_state *to)
{
    if (to == NULL) to = malloc(sizeof *to + @NAME@_size());
    if (to == NULL) return NULL;
    if (!f->started) fmu_start(f);
    to->fmu = *f;
    memcpy(to->memory, f->task, @NAME@_size());
    return to;
}

/* The memory of a controller has addresses within itself: it goes back where it was. */
static int fmu_restore(struct fmu *f, const struct fmu_state *from)
{
    if (from == NULL || from->fmu.task != f->task)
        return fmu_refuse(f, "a state can be set in the instance that it was of, no other");
    *f = from->fmu;
    memcpy(f->task, from->memory, @NAME@_size());
    return FMU_OK;
}
