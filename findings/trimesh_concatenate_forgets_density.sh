#!/usr/bin/env bash
# trimesh 5.2.0: two steel parts put together weigh as much as air, not steel.
#
# Two watertight boxes, density set to 7850 kg/m3 on each as the Trimesh reference
# describes, joined by trimesh.util.concatenate; copy and scale keep the density.
# The reference of concatenate says: concatenate two or more meshes. As both have
# the same density, one expects a mesh whose mass is the sum of the two masses.
# The joined mesh is back at density 1: mass and moment of inertia are 7850 times
# too small. Volume and centre of mass are right, so a look at it shows nothing.
# Inertia of a gripper put together from its parts and written to a URDF or MJCF
# is then near zero: simulation stiff and unstable, force control far off.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile trimesh==5.2.0 numpy==2.4.6

"$work/venv/bin/python" - <<'PY'
import numpy as np
import trimesh

STEEL = 7850.0
part = trimesh.creation.box((0.1, 0.1, 0.2))
part.density = STEEL
other = part.copy()
other.apply_translation([0.5, 0, 0])
joined = trimesh.util.concatenate([part, other])
wanted = part.mass + other.mass
inertia = np.trace(joined.moment_inertia)
reference = joined.copy()
reference.density = STEEL
print("trimesh", trimesh.__version__)
print(f"mass:              expected {wanted:.2f} kg, observed {joined.mass:.6f} kg")
print(f"trace of inertia:  expected {np.trace(reference.moment_inertia):.4f}, observed {inertia:.8f}")
print(f"volume:            expected {part.volume + other.volume:.4f} m3, observed {joined.volume:.4f} m3")
assert other.density == STEEL and abs(wanted - 31.4) < 1e-6
assert abs(joined.volume - 0.004) < 1e-9 and joined.density == 1.0
assert abs(joined.mass * STEEL / wanted - 1) < 1e-9
PY
