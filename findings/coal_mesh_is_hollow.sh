#!/usr/bin/env bash
# coal 3.0.3: a ball wholly inside a closed mesh is free of collision, at positive distance.
#
# A watertight box of 1 m, once as coal.Box and once as the triangle mesh that a
# URDF <mesh> becomes (BVHModelOBBRSS), and a ball of 10 cm at its centre.
# The documentation's overview calls collide and distance functions for shapes and
# meshes alike; the mesh is closed and oriented. So one expects the same answer
# from both: collision, distance -0.6 m.
# The mesh is a surface without inside: distance +0.4 m and no collision. It grows
# when the ball goes deeper, and turns right only where the surface is cut.
# A planner or collision check that steps across a thin wall finds the inside of
# the workpiece free, and a gradient of the distance pulls the tool further in.
set -euo pipefail

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-compile coal==3.0.3 numpy==2.4.6

"$work/venv/bin/python" - <<'PY'
import itertools

import coal
import numpy as np

vertices = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
triangles = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
mesh = coal.BVHModelOBBRSS()
mesh.beginModel(len(triangles), 3 * len(triangles))
for triangle in triangles:
    mesh.addTriangle(*(vertices[i] for i in triangle))
mesh.endModel()
volume = sum(np.dot(vertices[a], np.cross(vertices[b], vertices[c])) for a, b, c in triangles) / 6
box, ball, at_origin = coal.Box(1, 1, 1), coal.Sphere(0.1), coal.Transform3s()


def query(shape, x):
    pose = coal.Transform3s(np.eye(3), np.array([x, 0.0, 0.0]))
    distance = coal.distance(shape, at_origin, ball, pose, coal.DistanceRequest(),
                             coal.DistanceResult())
    hits = coal.collide(shape, at_origin, ball, pose, coal.CollisionRequest(),
                        coal.CollisionResult())
    return distance, hits > 0


print("coal", coal.__version__, f"  volume of the closed mesh {abs(volume):.1f} m3")
print("ball at x   expected (Box)           observed (mesh)")
for x in (0.0, 0.2, 0.3, 0.7):
    (d_box, hit_box), (d_mesh, hit_mesh) = query(box, x), query(mesh, x)
    print(f"{x:6.1f}     {d_box:+.2f} m collides {hit_box!s:5}   {d_mesh:+.2f} m collides {hit_mesh}")
assert abs(abs(volume) - 1) < 1e-9
assert query(box, 0.0)[1] and abs(query(box, 0.0)[0] + 0.6) < 1e-3
assert not query(mesh, 0.0)[1] and abs(query(mesh, 0.0)[0] - 0.4) < 1e-6
assert abs(query(mesh, 0.7)[0] - query(box, 0.7)[0]) < 1e-6  # outside both agree
PY
