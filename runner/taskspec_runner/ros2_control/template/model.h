/* What the plugin needs of the arm's model beside the task; made by taskspec @VERSION@. */
#ifndef @UPPER@_MODEL_H
#define @UPPER@_MODEL_H

#ifdef __cplusplus
extern "C" {
#endif

/* At joint positions q (@JOINTS@) [rad or m], as the task's file has arm and tool:
 *   axes (9): of the tip in the world, column after column;
 *   gravity (@JOINTS@): torques that carry the arm [N m or N];
 *   weight (6): of what is beyond the sensor, about the tip, in its axes [N, N m]. */
void @NAME@_model(const double *q, double *axes, double *gravity, double *weight);

#ifdef __cplusplus
}
#endif

#endif
