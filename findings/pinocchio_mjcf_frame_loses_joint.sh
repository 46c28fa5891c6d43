#!/usr/bin/env bash
# pin 4.1.0: a <frame> of an MJCF file, and the arm's links within it, are left out without a word.
#
# An arm of two hinges, the second link in a <frame> that turns it by 90 degrees. Frames are part
# of MJCF and take no body of their own; MuJoCo has two joints and 2.5 kg.
# buildModelFromMJCF raises for a <frame> that stands first in the worldbody, so one expects that,
# or two joints. Within a body it returns a model of one joint and 1.5 kg.
# A controller that takes its joints from the file balances half an arm.
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
<body name="upper"><joint name="shoulder" axis="0 1 0"/>
  <inertial pos="0 0 0.1" mass="1.5" diaginertia="0.02 0.02 0.01"/>
  <frame pos="0 0 0.3" euler="0 0 1.5708">
    <body name="fore"><joint name="elbow" axis="0 1 0"/>
      <inertial pos="0 0 0.1" mass="1" diaginertia="0.01 0.01 0.01"/></body>
  </frame>
</body></worldbody></mujoco>"""
Path("arm.xml").write_text(xml)
m = mujoco.MjModel.from_xml_string(xml)
p = pin.buildModelFromMJCF("arm.xml")
mass = sum(each.mass for each in p.inertias)
print("pinocchio", pin.__version__, "mujoco", mujoco.__version__)
print(f"expected {m.nv} joints, {np.sum(m.body_mass):.1f} kg (mujoco)")
print(f"observed {p.nv} joints, {mass:.1f} kg, joints {list(p.names)[1:]}")
assert m.nv == 2 and abs(np.sum(m.body_mass) - 2.5) < 1e-9
assert p.nv == 1 and abs(mass - 1.5) < 1e-9 and list(p.names)[1:] == ["shoulder"]
PY
