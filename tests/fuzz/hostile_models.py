"""Robot files that are after something, or wrong in ways that MuJoCo lets pass."""

from __future__ import annotations

import os
import struct
from dataclasses import dataclass, field
from pathlib import Path

_INERTIA = '<inertia ixx="{i}" ixy="0" ixz="0" iyy="{i}" iyz="0" izz="{i}"/>'
_LIMIT = 'lower="-2" upper="2" effort="10" velocity="2"'
TURNS = 'axis="0 0 1" range="-170 170"'


def arm(head: str = "", inside: str = "", end: str = "", tail: str = "", joint: str = TURNS) -> str:
    """A planar arm in MJCF, with something put in."""
    return (
        f'<mujoco>{head}<worldbody><body name="upper" pos="0 0 0.3"><joint name="one" {joint}/>'
        '<geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="2"/>'
        f'{inside}<body name="fore" pos="0.3 0 0"><joint name="two" {TURNS}/>'
        '<geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="1"/>'
        f'<site name="flange" pos="0.3 0 0" euler="0 90 0"/>{end}</body></body></worldbody>{tail}'
        "</mujoco>"
    )


def urdf(joints: int = 3, **keys: str) -> str:
    """A chain in URDF: `mass`, `inertia`, `axis`, `limit` of each link, and something more."""
    inertia = _INERTIA.format(i=keys.get("inertia", "0.01"))
    text = '<robot name="r"><link name="l0"/>'
    for i in range(joints):
        text += (
            f'<link name="l{i + 1}"><inertial><mass value="{keys.get("mass", "1")}"/>{inertia}'
            f'</inertial></link><joint name="j{i}" type="revolute"><parent link="l{i}"/>'
            f'<child link="l{i + 1}"/><origin xyz="0 0 0.1" rpy="{0.3 * i} 0.5 0"/>'
            f'<axis xyz="{keys.get("axis", "0 0 1")}"/><limit {keys.get("limit", _LIMIT)}/></joint>'
        )
    return text + keys.get("more", "") + "</robot>"


def mesh(file: str) -> str:
    """An arm that shows a mesh."""
    asset = f'<asset><mesh name="m" file="{file}"/></asset>'
    return arm(tail=asset, end='<geom type="mesh" mesh="m" mass="1"/>')


def size(text: str) -> str:
    """An arm with a `<size>`."""
    return arm(head=f"<size {text}/>")


def asset(text: str) -> str:
    """An arm with an asset."""
    return arm(tail=f"<asset><{text}/></asset>")


@dataclass(frozen=True)
class Model:
    """A robot file.

    Attributes:
        text: of it. codes: of the errors that it may end in; none if it is harmless.
        suffix: of its name. files: written beside it, by name.
    """

    text: str
    codes: tuple[str, ...] = ()
    suffix: str = ".xml"
    files: dict[str, bytes] = field(default_factory=dict)


def _inclusion(file: str, *codes: str) -> Model:
    return Model(f'<mujoco><include file="{file}"/></mujoco>', codes)


def _urdf(*codes: str, joints: int = 3, **keys: str) -> Model:
    return Model(urdf(joints, **keys), codes, ".urdf")


_GEOM = '<geom size="0.1"/>'
_STL = b"\0" * 80 + struct.pack("<I", 4_000_000_000) + b"\0" * 100
_OBJ = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 999999999\nf 1 2 4\nf 1 3 4\n"
_MSH = struct.pack("<4i", *[2_000_000_000] * 4) + b"\0" * 64
_LINK = '<link name="m"/><joint name="z" type="fixed"><parent link="{}"/><child link="{}"/></joint>'
_DEEP = "".join(f'<body pos="0 0 .1"><joint axis="{i % 2} {1 - i % 2} 0"/>'
                '<geom size=".05" mass="1"/>' for i in range(150)) + "</body>" * 150  # fmt: skip

MODELS: dict[str, Model] = {
    # What it opens.
    "includes /etc/passwd": _inclusion("/etc/passwd", "TS403"),
    "includes a file above": _inclusion("../../etc/passwd", "TS403", "TS402"),
    "includes a pipe": _inclusion("pipe.xml", "TS402"),
    "includes a device": _inclusion("/dev/zero", "TS403"),
    "includes a link out": _inclusion("link.xml", "TS403"),
    "includes itself": _inclusion("arm.xml", "TS403"),
    "includes a folder": _inclusion(".", "TS402"),
    "includes nothing": Model("<mujoco><include/></mujoco>", ("TS402",)),
    "includes a name that no system has": _inclusion("a" * 5000, "TS402"),
    "a mesh that is a pipe": Model(mesh("pipe.stl")),
    "a mesh that is a device": Model(mesh("/dev/zero")),
    "a mesh name that no system has": Model(mesh("a" * 5000 + ".stl")),
    "a mesh from a package above": _urdf(
        "TS408",
        more='<link name="m"><visual><geometry><mesh filename="package://../../x.stl"/></geometry>'
        '</visual></link><joint name="z" type="fixed"><parent link="l3"/><child link="m"/></joint>',
    ),
    "a compiled model": Model("", ("TS402",), ".mjb"),
    "plugins": Model(arm(tail='<extension><plugin plugin="x"/></extension>'), ("TS403",)),
    # What grows.
    "entities": Model(
        '<!DOCTYPE m [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><mujoco>&b;</mujoco>', ("TS403",)
    ),
    "a document type in small letters": Model("<!doctype m><mujoco/>", ("TS402",)),
    "nested 5000 deep": Model("<mujoco>" + "<body>" * 5000, ("TS403",)),
    "two million elements": Model("<mujoco>" + "<a/>" * 2_000_000 + "</mujoco>", ("TS403",)),
    "20 000 copies": Model(
        arm(inside=f'<replicate count="20000">{_GEOM}</replicate>'), ("TS403",)
    ),
    "copies of copies": Model(
        arm(inside='<replicate count="30">' * 3 + _GEOM + "</replicate>" * 3), ("TS403",)
    ),
    "copies of many": Model(
        arm(inside='<replicate count="200">' + f"<body>{_GEOM}</body>" * 100 + "</replicate>"),
        ("TS403",),
    ),
    "6000 bodies": Model(arm(inside=f"<body>{_GEOM}</body>" * 6000), ("TS403", "TS405")),
    "19 000 shapes": Model(arm(inside=_GEOM * 19_000), ("TS403",)),
    "150 joints": Model(f"<mujoco><worldbody>{_DEEP}</worldbody></mujoco>", ("TS405",)),
    "400 joints": _urdf("TS405", joints=400),
    "100 GB of memory": Model(size('memory="100G"')),
    "2e9 numbers of a user": Model(size('nuserdata="2000000000"'), ("TS403",)),
    "2e9 numbers of a user for each body": Model(size('nuser_body="2000000000"'), ("TS403",)),
    "1e8 keyframes": Model(size('nkey="100000000"'), ("TS403",)),
    "2e9 constraints": Model(size('njmax="2000000000" nconmax="2000000000"')),
    "2e9 numbers of a field": Model(
        arm(tail='<custom><numeric name="a" size="2000000000"/></custom>'), ("TS404",)
    ),
    "a field of heights": Model(
        asset('hfield name="h" nrow="60000" ncol="60000" size="1 1 1 1"'), ("TS403",)
    ),
    "a texture": Model(
        asset('texture name="t" type="2d" builtin="flat" width="60000" height="60000"'), ("TS403",)
    ),
    "a mesh that is built": Model(
        asset('mesh name="m" builtin="supersphere" params="100000 1 1"'), ("TS403",)
    ),
    "an STL file of 4e9 faces": Model(mesh("bomb.stl"), (), files={"bomb.stl": _STL}),
    "an OBJ file with a face of no vertex": Model(
        mesh("bomb.obj"), ("TS404",), files={"bomb.obj": _OBJ}
    ),
    "an MSH file of 2e9 vertices": Model(mesh("bomb.msh"), (), files={"bomb.msh": _MSH}),
    "a name of 100 000 characters": Model(
        arm(end=f'<body name="{"b" * 100_000}"/>'), ("TS403",)
    ),
    # Numbers.
    "a time step of zero": Model(arm(head='<option timestep="0"/>')),
    "a time step backwards": Model(arm(head='<option timestep="-1"/>')),
    "a time step of 1e300": Model(arm(head='<option timestep="1e300"/>')),
    "a time step that is no number": Model(arm(head='<option timestep="nan"/>'), ("TS405",)),
    "gravity": Model(arm(head='<option gravity="0 0 1e300"/>')),
    "a mass that is no number": Model(arm(inside='<geom size="1" mass="nan"/>'), ("TS405",)),
    "a mass of 1e300": Model(arm(inside='<geom size="1" mass="1e300"/>'), ("TS405",)),
    "a size of 1e300": Model(arm(inside='<geom size="1e300" mass="1"/>'), ("TS405",)),
    "an inertia of 1e300": Model(
        arm(inside='<inertial pos="0 0 0" mass="1" diaginertia="1e300 1e300 1e300"/>'), ("TS405",)
    ),
    "an armature of 1e300": Model(arm(joint='armature="1e300"'), ("TS405",)),
    "a negative armature": Model(arm(joint='armature="-5"'), ("TS405",)),
    "a range of 1e300": Model(arm(joint='limited="true" range="-1e300 1e300"'), ("TS405",)),
    "a range of none": Model(arm(joint='limited="true" range="10 10"'), ("TS404",)),
    "an axis of zero": Model(arm(joint='axis="0 0 0"'), ("TS404",)),
    "an axis of 1e300": Model(arm(joint='axis="1e300 1e300 0"'), ("TS405",)),
    "a joint far away": Model(arm(joint='pos="1e300 0 0"'), ("TS405",)),
    "a home far away": Model(
        arm(tail='<keyframe><key name="home" qpos="1e300 1e300"/></keyframe>'), ("TS405",)
    ),
    "a flange far away": Model(arm(end='<site name="tool0" pos="1e300 0 0"/>'), ("TS405",)),
    "a gear of 1e300": Model(
        arm(tail='<actuator><motor joint="two" gear="1e300" ctrllimited="true" '
            'ctrlrange="-1e300 1e300"/></actuator>')
    ),
    "URDF: a mass that is no number": _urdf("TS405", mass="nan"),
    "URDF: an infinite mass": _urdf("TS405", mass="1e999"),
    "URDF: a negative mass": _urdf("TS405", mass="-1"),
    "URDF: a mass of 1e300": _urdf("TS405", mass="1e300"),
    "URDF: an infinite inertia": _urdf("TS405", inertia="1e999"),
    "URDF: a negative inertia": _urdf("TS405", inertia="-1"),
    "URDF: limits the wrong way round": _urdf("TS405", limit='lower="2" upper="-2"'),
    "URDF: infinite limits": _urdf("TS405", limit='lower="-inf" upper="inf"'),
    "URDF: limits of 1e300": _urdf("TS405", limit='lower="-1e300" upper="1e300"'),
    "URDF: an axis of zero": _urdf("TS404", axis="0 0 0"),
    "URDF: an axis of 1e200": _urdf("TS405", axis="1e200 1e200 0"),
    "URDF: a link in a circle": _urdf("TS404", more=_LINK.format("m", "m")),
    "URDF: a link with two parents": _urdf("TS404", more=_LINK.format("l0", "l3")),
    "URDF: a link that is not there": _urdf("TS404", more=_LINK.format("nowhere", "m")),
    # What it says to a terminal.
    "a name that turns the text round": Model(
        arm().replace('name="two"', 'name="t\u202ewo" type="free"'), ("TS404",)
    ),
    "a command to GitHub": Model(
        '<mujoco><include file="&#10;::error::owned"/></mujoco>', ("TS402",)
    ),
    "empty": Model("", ("TS402",)),
    "another root": Model("<html/>", ("TS402",)),
}  # fmt: skip


def write(model: Model, folder: Path) -> Path:
    """Writes a model, what it asks for, and a task with it; returns the task's path."""
    os.mkfifo(folder / "pipe.xml")
    os.mkfifo(folder / "pipe.stl")
    secret = folder.parent / "secret.xml"
    secret.write_text("<mujoco/>")
    (folder / "link.xml").symlink_to(secret)
    for name, data in model.files.items():
        (folder / name).write_bytes(data)
    (folder / f"arm{model.suffix}").write_text(model.text, "utf-8")
    path = folder / "t.yaml"
    path.write_text(
        f"taskspec: 1\nrobot: {{model: arm{model.suffix}}}\nstages: {{a: {{time: 1 s}}}}\n"
    )
    return path
