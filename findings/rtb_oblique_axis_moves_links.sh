#!/usr/bin/env bash
# roboticstoolbox-python 1.5.0: behind a URDF joint about an oblique axis, all links are elsewhere.
#
# A joint about "0 0.6 0.8", at the angle 0, and a tool 0.4 m along x of the link. At 0 an axis does
# not matter: one expects the tool at (0.4, 0, 0.5) m.
# The link's frame is turned so that its z is the axis, and what follows is placed in the turned
# frame: the tool is 0.38 m away from there. About x, y and z it is right. No warning.
# Wrists with bent axes come out as another arm, kinematics and torques.
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


found = {}
for axis in ("0 1 0", "0 0.6 0.8"):
    r, p = both(arm(axis))
    d = p.createData()
    pin.framesForwardKinematics(p, d, np.zeros(1))
    expected = d.oMf[p.getFrameId("tool")].translation
    found[axis] = (expected, r.fkine(np.zeros(1), end="tool").t)
    print(f"axis {axis}: tool expected at {expected.round(3)} (pinocchio), observed {found[axis][1].round(3)}")
assert all(np.allclose(expected, [0.4, 0, 0.5]) for expected, _ in found.values())
assert np.allclose(found["0 1 0"][1], [0.4, 0, 0.5])
print("off by", np.linalg.norm(found["0 0.6 0.8"][1] - [0.4, 0, 0.5]).round(3), "m")
assert np.linalg.norm(found["0 0.6 0.8"][1] - [0.4, 0, 0.5]) > 0.3
PY
