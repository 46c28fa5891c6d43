#!/usr/bin/env bash
# drake 1.51.1: after its end a trajectory stands still and reports full speed.
#
# A straight line from 0 to 1 m within 1 s as PiecewisePolynomial.FirstOrderHold,
# and a turn of 3 rad as PiecewiseQuaternionSlerp, both evaluated at t = 5 s.
# The reference of value and EvalDerivative says that they evaluate the trajectory
# and its derivative at t; value outside the range is that of the nearest end. So
# one expects the derivative of a value that does not change: 0, as PiecewisePose
# gives for the very same straight line.
# Observed is 1 m/s and 3 rad/s for ever, those of the last segment.
# As feed-forward of a controller this pushes on with full speed against whatever
# was reached: position error zero, velocity error of the whole approach speed.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile drake==1.51.1 numpy==2.4.6

"$work/venv/bin/python" - <<'PY'
import importlib.metadata as metadata

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.trajectories import PiecewisePolynomial, PiecewisePose, PiecewiseQuaternionSlerp

line = PiecewisePolynomial.FirstOrderHold([0.0, 1.0], np.array([[0.0, 1.0]]))
turn = PiecewiseQuaternionSlerp(
    [0.0, 1.0], [Quaternion(1, 0, 0, 0), RotationMatrix.MakeZRotation(3.0).ToQuaternion()])
pose = PiecewisePose.MakeLinear([0.0, 1.0], [RigidTransform(), RigidTransform([1.0, 0, 0])])
moved = line.value(6.0)[0, 0] - line.value(5.0)[0, 0]
speed = line.EvalDerivative(5.0)[0, 0]
rate = turn.angular_velocity(5.0)[2]
turned = turn.orientation(6.0).wxyz() - turn.orientation(5.0).wxyz()

print("drake", metadata.version("drake"))
print(f"line, t = 5 to 6 s: moved {moved:.3f} m; velocity expected 0, observed {speed:.3f} m/s")
print(f"turn: quaternion changed {np.abs(turned).max():.3f}; rate expected 0, observed {rate:.3f} rad/s")
print(f"PiecewisePose, same line: velocity {pose.GetVelocity(5.0)[3]:.3f} m/s")
assert moved == 0 and np.abs(turned).max() == 0
assert abs(speed - 1) < 1e-12 and abs(rate - 3) < 1e-9
assert not np.any(pose.GetVelocity(5.0))
PY
