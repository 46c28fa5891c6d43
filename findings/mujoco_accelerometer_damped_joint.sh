#!/usr/bin/env bash
# mujoco 4.0.0: accelerometer and force sensor disagree with the motion of the same step.
#
# A slide with damping 100 N*s/m carries two bodies of 1 kg, one welded to the
# other, at 1 m/s, no gravity, time step 10 ms, integrators Euler and implicitfast
# at their defaults. All of it is plain MJCF.
# The XML reference, sensor/accelerometer, calls the output the linear
# acceleration of the site. So one expects output times time step to be the
# change of velocity over the step.
# Both integrators treat joint damping implicitly, the sensors do not: they keep
# the acceleration before that correction. The sensor says -50 m/s2, the velocity
# changes by -33.3 m/s2 times the step: half as much again. The force sensor
# between the two bodies is wrong by the same factor.
# An impulse or a velocity integrated from logged sensors does not match the
# logged motion, most of all on stiffly damped joints, as in contact tasks.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile mujoco==4.0.0 numpy==2.4.6

"$work/venv/bin/python" - <<'PY'
import mujoco

STEP = 0.01
xml = """<mujoco><option gravity="0 0 0" timestep="0.01" integrator="%s"/>
<worldbody><body>
  <joint type="slide" axis="1 0 0" damping="100"/><geom size=".1" mass="1"/>
  <body><geom size=".1" mass="1"/><site name="s"/></body>
</body></worldbody>
<sensor><accelerometer site="s"/><force site="s"/></sensor></mujoco>"""
print("mujoco", mujoco.__version__)
for integrator in ("Euler", "implicitfast"):
    model = mujoco.MjModel.from_xml_string(xml % integrator)
    data = mujoco.MjData(model)
    data.qvel[0] = 1.0
    mujoco.mj_step(model, data)
    moved = (data.qvel[0] - 1.0) / STEP
    acceleration, force = data.sensordata[0], data.sensordata[3]
    print(f"{integrator}: expected {moved:.2f} m/s2 and {moved * 1.0:.2f} N (change of velocity),")
    print(f"    observed {acceleration:.2f} m/s2 and {force:.2f} N: {acceleration / moved:.2f} times")
    assert abs(moved + 100 / 3) < 1e-6
    assert abs(acceleration + 50) < 1e-6 and abs(force + 50) < 1e-6
PY
