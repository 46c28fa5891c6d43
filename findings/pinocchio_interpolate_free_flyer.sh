#!/usr/bin/env bash
# pin 4.1.0: half way between two poses of a free body lies half a metre off the line.
#
# A free-flyer joint, from the origin to x = 1 m with half a turn about z.
# The reference of pinocchio.interpolate says: interpolate between two
# configurations, coefficient 0 to 1. Tools that interpolate poses,
# as Drake's PiecewisePose, take the straight line for the position and turn
# meanwhile, so one expects x = 0.5, y = 0 half way.
# Pinocchio follows a constant screw: the body passes y = -0.5 m, on a half circle.
# The ends are right, so a test of the ends shows nothing; a tool that is turned
# while it moves along a table or into a hole sweeps through the neighbourhood.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile pin==4.1.0 numpy==2.4.6

"$work/venv/bin/python" - <<'PY'
import numpy as np
import pinocchio as pin

model = pin.Model()
model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "free")
start = pin.neutral(model)
goal = np.array([1.0, 0, 0, 0, 0, 1, 0])  # x y z, quaternion x y z w: half a turn about z
path = np.array([pin.interpolate(model, start, goal, s)[:3] for s in np.linspace(0, 1, 101)])

print("pinocchio", pin.__version__)
print("half way:             expected", (start[:3] + goal[:3]) / 2, " observed", path[50].round(4))
print(f"largest distance from the line: expected 0, observed {np.abs(path[:, 1:]).max():.3f} m")
length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
print(f"length of the path:             expected 1, observed {length:.3f} m")
assert np.allclose(path[0], start[:3]) and np.allclose(path[-1], goal[:3], atol=1e-9)
assert np.allclose(np.abs(path[50]), [0.5, 0.5, 0], atol=1e-6)
PY
