"""Meshes of COLLADA files are drawn, where they should be and as large."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from taskspec.robot.collada import as_obj
from taskspec.robot.files import Roots
from taskspec.robot.urdf import drawable, urdf_spec
from taskspec.text.confines import Confines

#: A tetrahedron, 100 mm along each axis, in millimeters, turned about z and moved by its node.
DAE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
  <asset><unit name="millimeter" meter="0.001"/><up_axis>Z_UP</up_axis></asset>
  <library_geometries><geometry id="shape"><mesh>
    <source id="at"><float_array id="a" count="12">0 0 0 100 0 0 0 100 0 0 0 100</float_array>
      <technique_common><accessor source="#a" count="4" stride="3"/></technique_common></source>
    <source id="normals"><float_array id="n" count="3">0 0 1</float_array></source>
    <vertices id="v"><input semantic="POSITION" source="#at"/></vertices>
    FACES
  </mesh></geometry></library_geometries>
  <library_visual_scenes><visual_scene id="s">
    <node id="outer"><translate>10 20 30</translate>
      <node><rotate>0 0 1 90</rotate><instance_geometry url="#shape"/></node></node>
  </visual_scene></library_visual_scenes>
</COLLADA>
"""
INPUTS = (
    '<input semantic="VERTEX" source="#v" offset="0"/>'
    '<input semantic="NORMAL" source="#normals" offset="1"/>'
)
FACES = {
    "triangles": f'<triangles count="4">{INPUTS}'
    "<p>0 0 2 0 1 0 0 0 1 0 3 0 0 0 3 0 2 0 1 0 2 0 3 0</p></triangles>",
    "polylist": f'<polylist count="4">{INPUTS}<vcount>3 3 3 3</vcount>'
    "<p>0 0 2 0 1 0 0 0 1 0 3 0 0 0 3 0 2 0 1 0 2 0 3 0</p></polylist>",
    "polygons": f"<polygons>{INPUTS}<p>0 0 2 0 1 0</p><p>0 0 1 0 3 0</p><p>0 0 3 0 2 0</p>"
    "<p>1 0 2 0 3 0</p></polygons>",
}


@pytest.mark.parametrize("kind", FACES)
def test_vertices_and_faces_are_those_of_the_scene(kind: str) -> None:
    text = as_obj(DAE.replace("FACES", FACES[kind]).encode())
    assert text is not None
    lines = [line.split() for line in text.decode().splitlines()]
    points = np.array([line[1:] for line in lines if line[0] == "v"], dtype=float)
    # Turned by 90 degrees x goes to y and y to -x; then moved, in meters.
    expected = [[0.01, 0.02, 0.03], [0.01, 0.12, 0.03], [-0.09, 0.02, 0.03], [0.01, 0.02, 0.13]]
    np.testing.assert_allclose(points, expected, atol=1e-12)
    faces = {tuple(map(int, line[1:])) for line in lines if line[0] == "f"}
    assert faces == {(1, 3, 2), (1, 2, 4), (1, 4, 3), (2, 3, 4)}


def test_a_quadrilateral_is_cut_in_two() -> None:
    face = f'<polylist count="1">{INPUTS}<vcount>4</vcount><p>0 0 1 0 3 0 2 0</p></polylist>'
    text = as_obj(DAE.replace("FACES", face).encode())
    assert text is not None
    assert [line for line in text.decode().splitlines() if line[0] == "f"] == ["f 1 2 4", "f 1 4 3"]


@pytest.mark.parametrize(
    "text",
    [
        "", "<COLLADA/>", "no xml", DAE.replace("FACES", ""),
        DAE.replace("FACES", FACES["triangles"].replace("3 0</p>", "9 0</p>")),
        DAE.replace("FACES", FACES["triangles"]).replace("0 100 0", "0 nan 0"),
        "<!DOCTYPE x [<!ENTITY a 'b'>]>" + DAE.replace("FACES", FACES["triangles"]),
        DAE.replace("FACES", FACES["triangles"]).replace('url="#shape"', 'url="#other"')
           .replace("<p>", "<p>x "),
    ],
)  # fmt: skip
def test_what_is_no_shape_is_not_drawn(text: str) -> None:
    assert as_obj(text.encode()) is None


def test_a_robot_with_such_meshes_is_drawn_with_them(tmp_path: Path) -> None:
    (tmp_path / "link.dae").write_text(DAE.replace("FACES", FACES["triangles"]))
    root = ElementTree.fromstring(
        """<robot name="r"><link name="base"/><link name="arm">
        <inertial><mass value="1"/>
        <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
        <visual><geometry><mesh filename="link.dae"/></geometry></visual></link>
        <joint name="j" type="revolute"><parent link="base"/><child link="arm"/>
        <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
    )
    roots = Roots(tmp_path, Confines((tmp_path.resolve(),)))
    spec, notes = urdf_spec(drawable(root, roots, meshes=True))
    model = spec.compile()
    assert not any("link.dae" in note for note in notes)
    assert model.nmesh == 1
    assert mujoco.mjtGeom.mjGEOM_MESH in model.geom_type
    # MuJoCo turns a mesh into the axes of its inertia; its longest edge stays.
    edge = np.sqrt(2) * 0.1
    gaps = model.mesh_vert[:, None] - model.mesh_vert[None]
    assert np.linalg.norm(gaps, axis=2).max() == pytest.approx(edge, rel=1e-5)
