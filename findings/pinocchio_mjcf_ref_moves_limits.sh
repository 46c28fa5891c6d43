#!/usr/bin/env bash
# pin 4.1.0: a hinge with ref="0.5" in an MJCF file has limits that are 0.5 rad off its positions.
#
# MuJoCo's range is of the joint's position, the number in qpos, whatever `ref` is: ref only says
# which position the joint has as the file draws it. Pinocchio takes ref into its positions as well:
# at the same q both have the same gravity torque. So one expects the same range, -1 to 1 rad.
# Its limits are -1.5 to 0.5 rad.
# A planner stops half a radian before the stop on one side, and runs into it on the other.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile pin==4.1.0 mujoco==4.0.0 numpy==2.4.6

cd "$work"
"$work/venv/bin/python" - <<'PY'
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin

xml = """<mujoco><compiler angle="radian"/><worldbody>
<body name="link"><joint name="j" axis="0 1 0" ref="0.5" range="-1 1"/>
  <inertial pos="0.2 0 0.1" mass="1.5" diaginertia="0.02 0.02 0.01"/></body></worldbody></mujoco>"""
Path("arm.xml").write_text(xml)
m = mujoco.MjModel.from_xml_string(xml)
s = mujoco.MjData(m)
p = pin.buildModelFromMJCF("arm.xml")
d = p.createData()
apart = []
for position in (-1.0, 0.0, 0.5, 1.0):
    s.qpos[0] = position
    mujoco.mj_forward(m, s)
    torque = pin.computeGeneralizedGravity(p, d, np.array([position]))[0]
    apart.append(abs(torque - s.qfrc_bias[0]))
found = [p.lowerPositionLimit[0], p.upperPositionLimit[0]]
print("pinocchio", pin.__version__, "mujoco", mujoco.__version__)
print(f"gravity torques at the same positions differ by {max(apart):.1e} N*m")
print(f"limits: expected {m.jnt_range[0]} (mujoco), observed {np.array(found)}")
assert max(apart) < 1e-12
assert np.allclose(m.jnt_range[0], [-1, 1]) and np.allclose(found, [-1.5, 0.5])
PY
