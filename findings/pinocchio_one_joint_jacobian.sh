#!/usr/bin/env bash
# pin 4.1.0: the Jacobian of an arm with one joint is a vector of six, not a 6 x 1 matrix.
#
# A model of one joint, as of a testing machine, a gripper or a linear axis.
# Pinocchio's reference says of computeFrameJacobian: the Jacobian of the frame,
# size 6 x model.nv, and two joints give (6, 2). So one expects (6, 1).
# The bindings return shape (6,); inertia and Coriolis matrix stay (1, 1), so it
# is not that all of one joint were vectors. J @ v raises, J.T @ wrench is a
# number instead of a torque of one entry, J @ J.T is a number instead of the
# 6 x 6 of a manipulability, and code that is tested on arms fails on a slide.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile pin==4.1.0 numpy==2.4.6

"$work/venv/bin/python" - <<'PY'
import numpy as np
import pinocchio as pin


def shapes(joints):
    model = pin.Model()
    for i in range(joints):
        joint = model.addJoint(i, pin.JointModelPZ(), pin.SE3.Identity(), f"slide{i}")
        model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
    tip = model.addFrame(
        pin.Frame("tip", joints, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME)
    )
    data, q, v = model.createData(), np.zeros(joints), np.ones(joints)
    world = pin.LOCAL_WORLD_ALIGNED
    found = {
        "computeFrameJacobian": pin.computeFrameJacobian(model, data, q, tip, world),
        "computeJointJacobians": pin.computeJointJacobians(model, data, q),
        "data.J": data.J,
    }
    pin.computeJointJacobiansTimeVariation(model, data, q, v)
    found["getFrameJacobianTimeVariation"] = pin.getFrameJacobianTimeVariation(
        model, data, tip, world
    )
    found["crba"] = pin.crba(model, data, q)
    found["computeCoriolisMatrix"] = pin.computeCoriolisMatrix(model, data, q, v)
    return {name: value.shape for name, value in found.items()}


print("pinocchio", pin.__version__)
print(f"{'':32} two joints   one joint: expected   observed")
one, two = shapes(1), shapes(2)
for name, shape in two.items():
    print(f"{name:32} {shape!s:12} {(shape[0] if shape[0] == 6 else 1, 1)!s:21} {one[name]}")
    jacobian = shape[0] == 6
    assert shape == ((6, 2) if jacobian else (2, 2))
    assert one[name] == ((6,) if jacobian else (1, 1))
PY
