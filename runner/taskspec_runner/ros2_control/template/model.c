/* The arm's model at a posture; made by taskspec @VERSION@. See @NAME@_model.h. */
#include "@NAME@_model.h"

@PRELUDE@
@MODEL@

void @NAME@_model(const double *q, double *axes, double *gravity, double *weight)
{
    const double *const given[] = {q};
    double *const found[] = {axes, gravity, weight};
    model(given, found);
}
