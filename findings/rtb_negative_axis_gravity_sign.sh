#!/usr/bin/env bash
# roboticstoolbox-python 1.5.0: about an axis of a URDF that points backwards, torques have the wrong sign.
#
# One joint about "0 1 0", and the same arm with the joint about "0 -1 0" at the opposite angle. It
# lies where the other does, in fkine too. So one expects the torque that holds it to be the other's,
# with the sign changed: the joint is counted the other way round.
# gravload and rne answer both with the same sign; Pinocchio changes it.
# Gravity compensation by gravload doubles the load of every such joint. Many arms have some.
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
for axis, sign in (("0 1 0", 1), ("0 -1 0", -1)):
    r, p = both(arm(axis))
    q, zero = np.array([sign * 0.4]), np.zeros(1)
    d = p.createData()
    pin.framesForwardKinematics(p, d, q)
    apart = np.abs(r.fkine(q, end="tool").t - d.oMf[p.getFrameId("tool")].translation).max()
    found[axis] = (pin.computeGeneralizedGravity(p, d, q)[0], r.gravload(q)[0], r.rne(q, zero, zero)[0])
    assert apart < 1e-12
    print(f"axis {axis}: tool at the same place; torque expected {found[axis][0]:+.2f} N*m (pinocchio), "
          f"gravload {found[axis][1]:+.2f}, rne {found[axis][2]:+.2f}")
forth, back = found["0 1 0"], found["0 -1 0"]
assert abs(forth[1] - forth[0]) < 1e-9 and abs(back[0] + forth[0]) < 1e-9
assert abs(back[1] - forth[1]) < 1e-9 and abs(back[2] - forth[2]) < 1e-9
PY
