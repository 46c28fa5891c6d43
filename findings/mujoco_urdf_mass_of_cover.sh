#!/usr/bin/env bash
# mujoco 4.0.0: a URDF link without <inertial> gets a mass from its collision shape.
#
# The URDF has an arm link of 1 kg and, fixed to it, a cover with a <collision>
# box of 10 cm and no <inertial>, as covers, flanges and keep-out shapes have.
# The URDF page of the link element makes <inertial> optional and gives a link
# without one zero mass and zero inertia. So one expects an arm of 1 kg.
# MuJoCo takes the collision box as water (1000 kg/m3) and merges it into the arm:
# 2 kg, the centre of mass half a metre away, without a word. Pinocchio reads 1 kg.
# Gravity compensation computed from the same file with another library is then
# wrong at the joint: here by 9.8 N*m, about twice the effort that the file allows.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile mujoco==4.0.0 pin==4.1.0 numpy==2.4.6

"$work/venv/bin/python" - <<'PY'
import mujoco
import numpy as np
import pinocchio as pin

urdf = """<robot name="r"><link name="base"/>
<link name="arm"><inertial><origin xyz="0 0 0"/><mass value="1"/>
  <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="cover"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
<joint name="j" type="revolute"><axis xyz="0 1 0"/><parent link="base"/><child link="arm"/>
  <limit lower="-1" upper="1" effort="5" velocity="2"/></joint>
<joint name="k" type="fixed"><origin xyz="1 0 0"/><parent link="arm"/><child link="cover"/></joint>
</robot>"""
m = mujoco.MjModel.from_xml_string(urdf)
d = mujoco.MjData(m)
mujoco.mj_forward(m, d)
p = pin.buildModelFromXML(urdf)
gravity = pin.rnea(p, p.createData(), np.zeros(1), np.zeros(1), np.zeros(1))[0]

print("mujoco", mujoco.__version__, "pinocchio", pin.__version__)
print(f"mass of the arm:       expected 1.0 kg (pinocchio {p.inertias[1].mass:.1f}), "
      f"observed {m.body_mass[1]:.3f} kg")
print(f"gravity at the joint:  expected 0.0 N*m (pinocchio {gravity:.1f}), "
      f"observed {d.qfrc_bias[0]:.3f} N*m")
assert abs(p.inertias[1].mass - 1) < 1e-9 and abs(gravity) < 1e-9
assert abs(m.body_mass[1] - 2) < 1e-6 and abs(abs(d.qfrc_bias[0]) - 9.81) < 1e-6
PY
