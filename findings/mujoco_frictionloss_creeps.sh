#!/usr/bin/env bash
# mujoco 4.0.0: a joint that dry friction holds goes on moving.
#
# A slide of 1 kg with frictionloss 10 N is pushed with 5 N, no gravity, time step 1 ms, all else at
# its defaults. All of it is plain MJCF.
# Coulomb's friction holds it: 5 N are less than 10 N. So one expects it to stand.
# It creeps at 5.3 mm/s for as long as it is pushed, a / b (1 - d) / d by the defaults of solimp and
# solref, with a the acceleration of the push: half a metre in 100 s, whatever the friction is. An
# arm of 0.1 kg m2 that is held against 1 N m creeps at 11 mrad/s. What a law leaves of its error in
# a joint that sticks, or whether compensated friction gives energy, is so not what Coulomb's gives.
# With a stiffer solimpfriction and solreffriction it stands to a few um/s.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile mujoco==4.0.0 numpy==2.4.6

"$work/venv/bin/python" - <<'PY'
import mujoco

xml = """<mujoco><option gravity="0 0 0" timestep="0.001"/><worldbody><body>
  <joint type="slide" axis="1 0 0" frictionloss="10" %s/><geom size=".1" mass="1"/>
</body></worldbody></mujoco>"""
STIFF = 'solimpfriction="0.999 0.999 0.001 0.5 2" solreffriction="-1e-9 -500"'
print("mujoco", mujoco.__version__)
found = {}
for name, more in (("defaults", ""), ("stiff", STIFF)):
    model = mujoco.MjModel.from_xml_string(xml % more)
    data = mujoco.MjData(model)
    data.qfrc_applied[0] = 5.0
    mujoco.mj_step(model, data, 1000)
    found[name] = data.qvel[0]
    print(f"{name}: expected 0 mm/s, observed {1e3 * data.qvel[0]:.4f} mm/s under half the friction")
assert abs(found["defaults"] - 5.3e-3) < 1e-4
assert abs(found["stiff"]) < 2e-5
PY
