/* The controller of the task "@TITLE@", made by taskspec @VERSION@.
 *
 * SHA-256 of what it is made of: @HASH@
 *
 * The host calls @NAME@_init once, @NAME@_start with the first sample, and then @NAME@_step with
 * the sample of each control period, @RATE@ times a second, in order. It applies the torques of
 * each answer until the next one. Nothing is allocated, nothing is printed, nothing is global:
 * several instances may run beside each other. An instance is not to be moved after its init.
 *
 * A sample whose numbers are not finite, a stamp that runs back, and more lost samples in a row
 * than are borne end the task by name. From its end on, whatever it is, the torques carry the arm
 * and take its motion away.
 *
 * Joints, in the order of all vectors [rad or m, rad/s or m/s, N m or N]:
@JOINT_NAMES@
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
/* Of an instance, where pointers have 64 bits; with smaller ones it needs less. It never grows. */
#define @UPPER@_BYTES @BYTES@
/* Of control [s]. */
#define @UPPER@_PERIOD @PERIOD@
/* Whether the wrench is a reading, from which weight and zero are still to be taken. */
#define @UPPER@_READS_SENSOR @SENSOR@

/* Why a task has ended, or that it goes on. */
enum @NAME@_state {
    @UPPER@_RUNNING = 0,
    @UPPER@_DONE = 1,        /* it reached its end */
    @UPPER@_FAILED = 2,      /* it reached `fail` */
    @UPPER@_STOPPED = 3,     /* a limit of the task */
    @UPPER@_ATTEMPTS = 4,    /* a stage has been entered as often as it may be */
    @UPPER@_UNKNOWN = 5,     /* a frame has not been estimated */
    @UPPER@_UNANSWERED = 6,  /* the program that keeps the limits has had no answer */
    @UPPER@_DIVERGED = 7,    /* numbers are not those of a sane arm */
    @UPPER@_BAD_SAMPLE = 8,  /* a number of a sample is not finite */
    @UPPER@_BAD_STAMP = 9,   /* a stamp runs back, or goes on by more than a run lasts */
    @UPPER@_LOST = 10        /* more samples in a row have been lost than are borne */
};

/* A sample. */
struct @NAME@_input {
    double q[@JOINTS@];       /* joint positions */
    double v[@JOINTS@];       /* joint velocities */
    double wrench[6];         /* @WRENCH@ [N, N m] */
    double reactions[@REACTION_ROOM@]; /* along the gradients of the equations on joints: @REACTION_NAMES@ [N, N m] */
    double stamp;             /* of the robot's clock [s] */
};

/* The answer to a sample. */
struct @NAME@_output {
    double torque[@JOINTS@];  /* gravity included */
    int32_t state;            /* of enum @NAME@_state */
    int32_t stage;            /* number of the stage */
    int32_t lost;             /* samples lost before this one */
};

/* What has ended a task, in words. */
struct @NAME@_status {
    int32_t state;
    const char *stage;        /* in which it is, or ended */
    const char *event;        /* short name of what ended it; empty while it runs */
    const char *text;         /* the same as a sentence */
    int64_t ticks;            /* control periods so far */
};

struct @NAME@;

/* What the controller is made of, as above. */
const char *@NAME@_task(void);
/* Bytes of an instance, @UPPER@_BYTES or less; it is to be aligned as a double is. */
uint64_t @NAME@_size(void);
/* Prepares an instance in memory of that size. */
struct @NAME@ *@NAME@_init(void *memory);
/* Begins the task where the first sample says that the arm rests. Its torques carry the arm. */
void @NAME@_start(struct @NAME@ *m, const struct @NAME@_input *in, struct @NAME@_output *out);
/* One control period; the first sample is that of the start. Returns the state. */
int32_t @NAME@_step(struct @NAME@ *m, const struct @NAME@_input *in, struct @NAME@_output *out);
struct @NAME@_status @NAME@_status(const struct @NAME@ *m);
/* So many lost samples in a row are borne, each a period on the last one; 20 at first. */
void @NAME@_bear(struct @NAME@ *m, int32_t lost);

#ifdef __cplusplus
}
#endif

#endif
