/* The controller of the task "@TITLE@", made by taskspec @VERSION@.
 *
 * SHA-256 of what it is made of: @HASH@
 *
 * Use:
 *   @NAME@_init prepares an instance;
 *   @NAME@_start takes the first sample, of an arm at rest;
 *   @NAME@_step takes the sample of each control period, the first one once more, in order and
 *   @RATE@ times a second.
 * The @COMMANDS@ of an answer hold until the next one. Nothing is allocated, printed or global:
 * several instances, and several tasks, may run in one program. An instance stays where it is.
 *
 * Guarantees: each call ends after a bounded number of instructions. The @COMMANDS@ are finite.
@KEPT@
 * A number that is not finite, a stamp that stands still or runs back, and more lost samples in a
 * row than are borne end the task by name, and enter no @COMMAND@.
@AT_END@
 *
@ROBOT@
 *
 * Joints, in the order of all vectors:
@JOINT_TABLE@
 *
 * Stages, and the events that end them:
@STAGE_TABLE@
 *
 * Params that may be set while the task runs:
@PARAM_TABLE@
 *
 * Limits that end the task, as "stopped":
@LIMITS@
 */
#ifndef @UPPER@_H
#define @UPPER@_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define @UPPER@_JOINTS @JOINTS@
#define @UPPER@_REACTIONS @REACTIONS@
#define @UPPER@_STAGES @STAGES@
#define @UPPER@_PARAMS @PARAMS@
/* Of control [s]. */
#define @UPPER@_PERIOD @PERIOD@
/* Lost samples in a row that are borne at first. */
#define @UPPER@_BEARS @BEARS@
/* What is commanded: 0 torques, 1 velocities, 2 positions. */
enum { @NAME@_quantity = @QUANTITY@ };
/* Whether the wrench is a reading, from which weight and zero are still to be taken. */
#define @UPPER@_READS_SENSOR @SENSOR@
/* Joint positions where the task of the file starts. */
#define @UPPER@_START {@START@}
/* Bytes that are enough for an instance. */
#define @UPPER@_SIZE @SIZE@

/* Why a task has ended, or that it goes on. */
enum @NAME@_state {
@STATES@
};

/* A sample: what is measured at one instant. */
struct @NAME@_input {
    /* Joint positions, counted as the robot's file counts them; units in the table above. */
    double q[@JOINTS@];
    /* Joint velocities. */
    double v[@JOINTS@];
    /*
@WRENCH@ */
    double wrench[6];
    /*
@REACTION_NAMES@ */
    double reactions[@REACTION_ROOM@];
    /* Time of the sample by the robot's clock [s]. Its zero is anywhere. */
    double stamp;
};

/* The answer to a sample. It begins with what is commanded. */
struct @NAME@_output {
    double @COMMAND@[@JOINTS@]; /* @MEANS@ */@GRIP_OUT@
    int32_t state; /* of enum @NAME@_state */
    int32_t stage; /* its number, as above */
    int32_t lost; /* samples lost before this one */
};

/* How far a task is, and what has ended it. */
struct @NAME@_status {
    int32_t state; /* of enum @NAME@_state */
    const char *stage; /* in which it is, or ended */
    const char *event; /* name of what ended it, as above; empty while it runs, and of other ends */
    const char *text; /* why it ended, or that it goes on, as a sentence */
    int64_t ticks; /* control periods so far */
    int64_t lost; /* of them, without a sample of their own */
};

/* The params that may be set, by number. */
@PARAM_ENUM@

/* What the file says of such a param, in SI units. */
struct @NAME@_param_facts {
    const char *name;
    const char *unit; /* empty of a plain number */
    double value; /* where the task begins */
    double low, high; /* its range */
    double rate; /* how fast it goes to what it is set to, by the second; 0 where it jumps */
};

struct @NAME@;

/* What the controller is made of, as above. */
const char *@NAME@_task(void);
/* Bytes of an instance, at most @UPPER@_SIZE. */
uint64_t @NAME@_size(void);
/* Prepares an instance in memory of that size, which is aligned as a double is. */
struct @NAME@ *@NAME@_init(void *memory);
/* Begins the task where the first sample says that the arm rests. Once more, it begins it anew.
 * @AT_START@ */
void @NAME@_start(struct @NAME@ *m, const struct @NAME@_input *in, struct @NAME@_output *out);
/* One control period; the first sample is that of the start. Returns the state. */
int32_t @NAME@_step(struct @NAME@ *m, const struct @NAME@_input *in, struct @NAME@_output *out);
struct @NAME@_status @NAME@_status(const struct @NAME@ *m);
/* So many lost samples in a row are borne. Each is a period on the sample before it.
 * Two samples without one lost between them end a row. */
void @NAME@_bear(struct @NAME@ *m, int32_t lost);
/* The params that may be set, @UPPER@_PARAMS of them. */
const struct @NAME@_param_facts *@NAME@_params(void);
/* Sets a param [SI] for the next step on, at its rate where it has one. Before @NAME@_start the task
 * begins with the value; a start that begins the task anew has those of the file.
 * Returns what it goes to: the nearest value in its range. What is not a number changes nothing, nor
 * does the value that it goes to already. Returns NaN where there is no such param.
 * It is for the thread that steps: nothing in here waits or locks. */
double @NAME@_set(struct @NAME@ *m, int32_t param, double value);
/* The value of a param in the last step [SI]; NaN where there is no such param. */
double @NAME@_get(const struct @NAME@ *m, int32_t param);

#ifdef __cplusplus
}
#endif

#endif
