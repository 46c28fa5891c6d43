#!/usr/bin/env bash
# mujoco 4.0.0: a force sensor above a suction cup reads a push while the cup carries a load.
#
# The model is plain MJCF: a stiff vertical slide, a cup welded below it with a
# force sensor at its site, a free box of 2 kg hung on the cup by an adhesion
# actuator of 100 N. At rest the slide's spring carries the weight of all bodies.
# The XML reference, sensor/force, says that the computation takes all forces on
# the system into account. So one expects the weight of cup and box, 24.5 N.
# The sensor subtracts the contact force, which the adhesion has raised by 100 N,
# but never adds the adhesion force itself: it reads -75.5 N, with the wrong sign.
# The force of an actuator with a site transmission and gravity compensation of a
# body are left out in the same manner: 0 N instead of -20 N, 19.6 N instead of 0.
# A force controller or a load estimate on such a reading works against a load
# that is not there; the joint force (qfrc_spring) shows the right value.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile mujoco==4.0.0 numpy==2.4.6

"$work/venv/bin/python" - <<'PY'
import mujoco
import numpy as np

G = 9.81


def settle(xml, steps, ctrl=None, qpos=None):
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    if ctrl is not None:
        data.ctrl[:] = ctrl
    if qpos is not None:
        data.qpos[:] = qpos
    for _ in range(steps):
        mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    return data


suction = """<mujoco><option timestep="0.001"/>
<worldbody>
  <body name="arm" pos="0 0 1">
    <geom size=".02" mass="1" contype="0" conaffinity="0"/>
    <joint type="slide" axis="0 0 1" stiffness="1e6" damping="2000"/>
    <body name="cup"><site name="s"/><geom type="box" size=".05 .05 .01" mass=".5"/></body>
  </body>
  <body name="box"><freejoint/><geom type="box" size=".1 .1 .09" mass="2"/></body>
</worldbody>
<actuator><adhesion body="cup" ctrlrange="0 100"/></actuator>
<sensor><force site="s"/></sensor></mujoco>"""
data = settle(suction, 3000, ctrl=[100], qpos=[0, 0, 0, 0.9005, 1, 0, 0, 0])
held = abs(data.qpos[3] - 0.9) < 0.002 and np.abs(data.qvel).max() < 1e-3
above = data.qfrc_spring[0] - 1.0 * G  # what the slide carries without the arm's own weight
suction_reading = data.sensordata[2]

payload = """<mujoco><option gravity="0 0 %s"/>
<worldbody>
  <body pos="0 0 1">
    <geom size=".05" mass="1"/><joint type="slide" axis="0 0 1" stiffness="1e5" damping="300"/>
    <body pos="0 0 .1" gravcomp="%s"><site name="s"/><geom size=".05" mass="2"/></body>
  </body>
</worldbody>%s
<sensor><force site="s"/></sensor></mujoco>"""
push = """<actuator><general site="s" gear="0 0 20 0 0 0" gainprm="0" biastype="affine"
biasprm="1"/></actuator>"""
pushed = settle(payload % (0, 0, push), 1000)
compensated = settle(payload % (-G, 1, ""), 1000)

print("mujoco", mujoco.__version__)
print("                                       expected   observed (N, along +z)")
print(f"suction cup of 0.5 kg carries 2 kg     {2.5 * G:8.2f}   {suction_reading:8.2f}")
print(f"  the same by the joint's spring       {2.5 * G:8.2f}   {above:8.2f}")
print(f"site actuator pushes payload up, 20 N  {-20:8.2f}   {pushed.sensordata[2]:8.2f}")
print(f"payload with gravcomp=1                {0:8.2f}   {compensated.sensordata[2]:8.2f}")
assert held and abs(above - 2.5 * G) < 0.05
assert abs(pushed.qfrc_spring[0] + 20) < 0.05
assert abs(compensated.qfrc_spring[0] - 1.0 * G) < 0.05
assert abs(suction_reading - (2.5 * G - 100)) < 0.05
assert abs(pushed.sensordata[2]) < 0.05
assert abs(compensated.sensordata[2] - 2 * G) < 0.05
PY
