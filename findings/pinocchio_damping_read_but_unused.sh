#!/usr/bin/env bash
# pin 4.1.0: joint damping and friction of a URDF are read into the model and have no effect.
#
# One revolute joint with <dynamics damping="3" friction="2"/>, inertia
# 0.1 kg*m2, no gravity torque; the joint turns at 10 rad/s without torque.
# The Model reference lists damping and dry friction among the model's parameters,
# and the file's values are there after loading. So one expects aba to slow the
# joint: (-3 * 10 - 2) / 0.1 = -320 rad/s2, as MuJoCo does with the file.
# aba answers 0, rnea 0 N*m; neither function's reference says that it leaves them
# out, while armature, the field beside them, is counted.
# A feed-forward torque by rnea lacks all friction; a simulation with aba never
# comes to rest.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile pin==4.1.0 mujoco==4.0.0 numpy==2.4.6

"$work/venv/bin/python" - <<'PY'
import mujoco
import numpy as np
import pinocchio as pin

urdf = """<robot name="r"><link name="base"/>
<link name="arm"><inertial><mass value="1"/>
  <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="revolute"><axis xyz="0 0 1"/><parent link="base"/><child link="arm"/>
  <limit lower="-3" upper="3" effort="50" velocity="20"/><dynamics damping="3" friction="2"/>
</joint></robot>"""
p = pin.buildModelFromXML(urdf)
d = p.createData()
q, v, zero = np.zeros(1), np.full(1, 10.0), np.zeros(1)
slowing = pin.aba(p, d, q, v, zero)[0]
torque = pin.rnea(p, d, q, v, zero)[0]

m = mujoco.MjModel.from_xml_string(urdf)
m.opt.timestep = 1e-5
s = mujoco.MjData(m)
s.qvel[0] = 10.0
mujoco.mj_step(m, s)
mujoco_slowing = (s.qvel[0] - 10) / m.opt.timestep

print("pinocchio", pin.__version__, "mujoco", mujoco.__version__)
print("model.damping", p.damping, "dry friction", p.lowerDryFrictionLimit, p.upperDryFrictionLimit)
print(f"aba:  expected about -320 rad/s2 (mujoco {mujoco_slowing:.0f}), observed {slowing:.1f}")
print(f"rnea: expected 32 N*m, observed {torque:.1f}")
assert p.damping[0] == 3 and p.upperDryFrictionLimit[0] == 2
assert abs(mujoco_slowing + 320) < 10
assert abs(slowing) < 1e-9 and abs(torque) < 1e-9
PY
