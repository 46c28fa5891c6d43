#!/usr/bin/env bash
# pin 4.1.0: a link of an MJCF file whose geoms do not collide has no mass.
#
# A link without <inertial>, drawn by a box with contype="0" conaffinity="0", as visual shapes are.
# By the MJCF reference the inertia of a body without <inertial> comes from its geoms; whether they
# collide is not among the conditions (`group` is, by inertiagrouprange). MuJoCo has 4 kg.
# buildModelFromMJCF has 0 kg, without a warning; with contype="1" it has the 4 kg.
# Gravity compensation of such an arm commands nothing.
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


def arm(collides):
    return f"""<mujoco><worldbody><body pos="0 0 1"><joint name="j" axis="0 1 0"/>
  <geom type="box" size="0.1 0.1 0.1" density="500" pos="0.2 0 0" contype="{collides}" conaffinity="{collides}"/>
</body></worldbody></mujoco>"""

found = {}
for collides in (0, 1):
    Path("arm.xml").write_text(arm(collides))
    m = mujoco.MjModel.from_xml_path("arm.xml")
    p = pin.buildModelFromMJCF("arm.xml")
    torque = pin.computeGeneralizedGravity(p, p.createData(), np.zeros(1))[0]
    found[collides] = (float(np.sum(m.body_mass)), p.inertias[1].mass, torque)
print("pinocchio", pin.__version__, "mujoco", mujoco.__version__)
for collides, (expected, observed, torque) in found.items():
    print(f"contype {collides}: expected {expected:.1f} kg (mujoco), observed {observed:.1f} kg, "
          f"gravity torque {torque:.2f} N*m")
assert abs(found[0][0] - 4) < 1e-9 and abs(found[1][0] - 4) < 1e-9
assert found[0][1] == 0 and found[0][2] == 0
assert abs(found[1][1] - 4) < 1e-9 and abs(found[1][2] + 4 * 9.81 * 0.2) < 1e-6
PY
