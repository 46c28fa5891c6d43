#!/usr/bin/env bash
# pin 4.1.0: the mass that a default class of an MJCF file gives its geoms does not count.
#
# A link has a shape that only draws it, of a class with mass="0", and a block of 2 kg, mass="2" at
# the geom. Colours, sizes and armature of classes are read, and mass="0" at the geom itself as
# well, so one expects 2 kg, as MuJoCo has. The class's 0 is taken for not given: the drawn shape
# weighs what it would in water, and the link 35.5 kg.
# Robot files put exactly this into a class of their visual meshes.
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


def arm(of_class, of_geom):
    return f"""<mujoco><default><default class="visual"><geom {of_class}/></default></default><worldbody>
<body pos="0 0 1"><joint name="j" axis="0 1 0"/>
  <geom class="visual" type="sphere" size="0.2" {of_geom}/>
  <geom type="box" size="0.05 0.05 0.05" pos="0 0 0.1" mass="2"/></body></worldbody></mujoco>"""

found = {}
for name, given in (("class", ('mass="0"', "")), ("geom", ("", 'mass="0"'))):
    Path("arm.xml").write_text(arm(*given))
    m = mujoco.MjModel.from_xml_path("arm.xml")
    p = pin.buildModelFromMJCF("arm.xml")
    found[name] = (float(np.sum(m.body_mass)), p.inertias[1].mass)
print("pinocchio", pin.__version__, "mujoco", mujoco.__version__)
for name, (expected, observed) in found.items():
    print(f'mass="0" of the {name}: expected {expected:.1f} kg (mujoco), observed {observed:.1f} kg')
assert all(abs(expected - 2) < 1e-9 for expected, _ in found.values())
assert abs(found["geom"][1] - 2) < 1e-9
assert abs(found["class"][1] - (2 + 1000 * 4 / 3 * np.pi * 0.2**3)) < 1e-3
PY
