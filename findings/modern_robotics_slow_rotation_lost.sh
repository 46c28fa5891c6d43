#!/usr/bin/env bash
# modern-robotics 1.1.1: a slow turn, integrated step by step, never turns.
#
# A body turns at 0.5 mrad/s about z while it moves at 1 mm/s along x; its pose is
# updated by MatrixExp6 of the twist over 1 ms, as the book integrates motion, for
# 60 s.
# The reference of MatrixExp6 says that it computes the matrix exponential. So one
# expects 30 mrad at the end, to rounding.
# A rotation below 1e-6 rad in one step is taken as none at all: after 60,000 steps
# the body has turned 0 rad. Faster turns are right, so the threshold
# is hidden in the step: with 10 ms steps the same motion turns.
# Slow alignment while in contact, or drift correction, at a 1 kHz loop does
# nothing and shows no error.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile modern-robotics==1.1.1 numpy==2.4.6

"$work/venv/bin/python" - <<'PY'
import importlib.metadata as metadata

import modern_robotics as mr
import numpy as np


def turned(rate, step, seconds=60.0):
    pose = np.eye(4)
    increment = mr.MatrixExp6(mr.VecTose3(np.array([0, 0, rate, 0.001, 0, 0]) * step))
    for _ in range(round(seconds / step)):
        pose = pose @ increment
    return np.arctan2(pose[1, 0], pose[0, 0]), np.hypot(pose[0, 3], pose[1, 3])


print("modern-robotics", metadata.version("modern-robotics"))
cases = [(5e-4, 0.001), (5e-4, 0.01), (2e-3, 0.001)]
got = [turned(*case) for case in cases]
for (rate, step), (angle, moved) in zip(cases, got, strict=True):
    print(f"{rate * 1000:.1f} mrad/s, step {step * 1000:.0f} ms: expected {rate * 60000:6.1f} mrad, "
          f"observed {angle * 1000:6.1f} mrad (moved {moved * 1000:.1f} mm)")
assert got[0][0] == 0.0 and got[0][1] > 0.059
assert abs(got[1][0] - 0.03) < 1e-6 and abs(got[2][0] - 0.12) < 1e-6
PY
