#!/usr/bin/env bash
# pin 4.1.0: the torque regressor leaves out armature that inverse dynamics counts.
#
# A six-joint sample arm with armature 2 kg*m2 at each joint (model.armature, the
# documented field), at a random state.
# The reference of computeJointTorqueRegressor says that it links the joint torque
# to the dynamic parameters of each link. So one expects Y times the parameters of
# the model's own inertias to be what rnea returns for that model and state.
# rnea, aba, crba and kinetic energy all count armature; the regressor does not.
# The difference is armature times acceleration, exactly: here up to 4.7 N*m.
# Identification with Y on torque from rnea, or from a robot with geared motors,
# puts rotor inertia into the links' masses; payload estimates are then wrong.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile pin==4.1.0 numpy==2.4.6

"$work/venv/bin/python" - <<'PY'
import numpy as np
import pinocchio as pin

model = pin.buildSampleModelManipulator()
model.armature = np.full(model.nv, 2.0)
data = model.createData()
rng = np.random.default_rng(0)
q = rng.uniform(-1, 1, model.nq)
v, a = rng.normal(size=model.nv), rng.normal(size=model.nv)

tau = pin.rnea(model, data, q, v, a)
parameters = np.concatenate([i.toDynamicParameters() for i in list(model.inertias)[1:]])
by_regressor = pin.computeJointTorqueRegressor(model, data, q, v, a) @ parameters
back = pin.aba(model, data, q, v, tau)

print("pinocchio", pin.__version__)
print("expected  Y @ parameters == rnea, that is difference 0")
print("observed  difference     ", (tau - by_regressor).round(4))
print("          armature * a   ", (2 * a).round(4))
assert np.abs(back - a).max() < 1e-9  # the forward dynamics counts the armature as well
assert np.abs(2 * a).max() > 1
assert np.abs(tau - by_regressor - 2 * a).max() < 1e-9
PY
