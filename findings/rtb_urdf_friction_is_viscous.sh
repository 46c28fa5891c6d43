#!/usr/bin/env bash
# roboticstoolbox-python 1.5.0: dry friction of a URDF is taken for viscous, viscous not at all.
#
# By the URDF reference `friction` is the static friction [N m], `damping` the viscous coefficient
# [N m s/rad]. The class Link has both, Tc and B. So one expects for <dynamics friction="2"/> a torque
# of 2 N m at any speed, and for <dynamics damping="2"/> one of 2 N m s/rad times the speed.
# With `friction` rne has 2 N m s/rad times the speed: B is 2, Tc is 0. `damping` changes nothing.
# At 0.1 rad/s a joint that sticks with 2 N m is compensated by 0.2 N m.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile roboticstoolbox-python==1.5.0 \
  spatialmath-python==1.1.18 pin==4.1.0 numpy==2.2.6

cd "$work"
"$work/venv/bin/python" - <<'PY'
from pathlib import Path

import numpy as np
import pinocchio as pin
import roboticstoolbox as rtb
from roboticstoolbox.models.URDF.URDFRobot import URDF_file


def arm(axis, more=""):
    return f"""<robot name="r"><link name="base"/>
<link name="link"><inertial><origin xyz="0.2 0 0.1"/><mass value="1.5"/>
  <inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="revolute"><origin xyz="0 0 0.5"/><axis xyz="{axis}"/><parent link="base"/><child link="link"/>
  <limit lower="-3" upper="3" effort="50" velocity="20"/>{more}</joint>
<link name="tool"><inertial><mass value="0.5"/>
  <inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="flange" type="fixed"><origin xyz="0.4 0 0"/><parent link="link"/><child link="tool"/></joint>
</robot>"""


def both(text):
    Path("arm.urdf").write_text(text)
    return rtb.Robot(URDF_file(Path("arm.urdf").resolve())[0]), pin.buildModelFromXML(text)


plain, _ = both(arm("0 1 0"))
q, zero, found = np.zeros(1), np.zeros(1), {}
for given in ("friction", "damping"):
    r, _ = both(arm("0 1 0", f'<dynamics {given}="2"/>'))
    for speed in (0.1, 5.0):
        v = np.array([speed])
        found[given, speed] = r.rne(q, v, zero)[0] - plain.rne(q, v, zero)[0]
        expected = 2.0 if given == "friction" else 2 * speed
        print(f'{given}="2" at {speed} rad/s: expected {expected:.1f} N*m, observed {found[given, speed]:.1f}')
assert abs(found["friction", 0.1] - 0.2) < 1e-9 and abs(found["friction", 5.0] - 10) < 1e-9
assert abs(found["damping", 0.1]) < 1e-9 and abs(found["damping", 5.0]) < 1e-9
PY
