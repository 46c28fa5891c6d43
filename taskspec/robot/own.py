"""People's own robots: a file on disk becomes a `Description`."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

from taskspec.deferred import mujoco
from taskspec.robot.bounds import check_growth, check_numbers
from taskspec.robot.constraints import words
from taskspec.robot.description import (
    BOUND_INERTIA,
    BOUND_MASS,
    Description,
    RobotFile,
    listening,
    velocity_limits,
)
from taskspec.robot.errors import RobotError
from taskspec.robot.files import Roots, line_of, parse_xml, read_model
from taskspec.robot.inertias import Unphysical, make_physical
from taskspec.robot.mjcf import mjcf_spec, mjcf_text
from taskspec.robot.packages import find_packaged
from taskspec.robot.urdf import (
    check_urdf,
    drawable,
    urdf_mimics,
    urdf_spec,
)
from taskspec.robot.urdf_limits import apply_limits, left_out
from taskspec.robot.xacro_file import SUFFIX, expanded, finished
from taskspec.text.confines import Confines, confines, here

#: What MuJoCo's reader warns of, and what is not so here.
_EQUAL = "has equal lower and upper limits"
MakeSpec = Callable[[bool], tuple["mujoco.MjSpec", list[str]]]


def read_own(shown: str, folder: Path, arguments: Mapping[str, str]) -> RobotFile:
    """The robot in a file.

    Args:
        shown: The path as the task file has it.
        folder: Where relative paths begin.
        arguments: Of a xacro file.

    Raises:
        RobotError: TS401 to TS405, TS409.
    """
    path = here(folder / shown)
    return _read_file(path, shown, Roots(path.parent, confines(folder)), arguments)


def read_packaged(shown: str, arguments: Mapping[str, str]) -> RobotFile:
    """The robot that `PACKAGE:NAME` means; its files lie in the folder of that package.

    Args:
        shown: As the task file has it.
        arguments: Of a xacro file.

    Raises:
        RobotError: TS401 to TS405, TS409.
    """
    robot = find_packaged(shown)
    roots = Roots(robot.path.parent, Confines((robot.folder,)))
    return _read_file(robot.path, shown, roots, arguments)


def _read_file(path: Path, shown: str, roots: Roots, arguments: Mapping[str, str]) -> RobotFile:
    text = read_model(path, shown, roots.confines)
    root = parse_xml(text, shown)
    if arguments or not finished(root):
        if arguments and path.suffix.lower() != SUFFIX and finished(root):
            raise RobotError(
                "TS402",
                f"'{shown}' is not xacro: it has no arguments",
                "leave `xacro` out",
                ("xacro",),
            )
        text, opened = expanded(path, shown, roots, arguments)
        root, roots = parse_xml(text, shown, placed=False), replace(roots, confines=opened)
    if root.tag == "robot":
        return _urdf(text, root, shown, roots, path.stem)
    if root.tag == "mujoco":
        return _mjcf(mjcf_text(text, root, shown, roots), root, shown, roots, path.stem)
    raise RobotError(
        "TS402",
        f"'{shown}' is neither MJCF nor URDF: it begins with <{root.tag}>",
        "MJCF begins with <mujoco>, URDF with <robot>",
    )


def _urdf(text: str, root: ElementTree.Element, shown: str, roots: Roots, name: str) -> RobotFile:
    check_growth(root, shown)
    check_urdf(root)
    drawn = drawable(root, roots, meshes=True)
    mimics = urdf_mimics(root)
    coupled = (*mimics, *(mimic.get("joint", "") for mimic in mimics.values()))

    def describe() -> Description:
        notes: list[str] = []
        m, unphysical = _compile(
            shown,
            lambda meshes: urdf_spec(drawn if meshes else drawable(root, roots, meshes=False)),
            notes,
        )
        limits = apply_limits(m, root, shown)
        check_numbers(m, shown)
        ids = {m.joint(j).name: j for j in range(m.njnt)}
        constraints = {
            i: f"<mimic> of joint '{joint}'{line_of(mimics[joint], shown)}"
            for i in range(m.neq)
            if (joint := m.joint(m.eq_obj1id[i]).name) in mimics
        }
        # MuJoCo passes over what follows no joint of its own.
        untied = {
            ids[joint]: f"<mimic> of joint '{joint}'{line_of(mimic, shown)} is to follow "
            f"'{mimic.get('joint', '')}', which is no joint that moves"
            for joint, mimic in mimics.items()
            if joint in ids and mimic.get("joint") not in ids
        }
        return Description(
            name,
            m,
            shown,
            limits.velocity,
            limits.locked,
            coupled,
            constraints,
            untied,
            (*(each for each in notes if _EQUAL not in each), *left_out(root)),
            unphysical,
        )

    assets = [part for token, data in drawn.assets.items() for part in (token.encode(), data)]
    absent = [word.encode() for word in drawn.absent]
    return RobotFile(name, (text.encode(), drawn.text.encode(), *absent, b"", *assets), describe)


def _mjcf(text: str, root: ElementTree.Element, shown: str, roots: Roots, name: str) -> RobotFile:
    def describe() -> Description:
        notes: list[str] = []
        m, unphysical = _compile(shown, lambda meshes: mjcf_spec(text, roots, meshes=meshes), notes)
        check_numbers(m, shown)
        written = [each for part in root.iter("equality") for each in part]
        constraints = (
            {i: f"{words(m, i)}{line_of(each, shown)}" for i, each in enumerate(written)}
            if len(written) == m.neq
            else {}
        )
        return Description(
            name, m, shown, velocity_limits(m), {}, (), constraints, {}, tuple(notes), unphysical
        )

    # Only MuJoCo knows which files are meant.
    alone = not any("file" in key for element in root.iter() for key in element.attrib)
    return RobotFile(name, (text.encode(),) if alone else None, describe)


def _compile(
    shown: str, make: MakeSpec, notes: list[str]
) -> tuple[mujoco.MjModel, tuple[Unphysical, ...]]:
    """Compiles what `make` makes, without meshes if it takes that, with inertias that bodies have.

    What was left out is added to `notes`.
    """
    meshes = True
    while True:
        heard: list[str] = []
        try:
            with listening(heard):
                spec, absent = make(meshes)
                _settle(spec)
                unphysical, rounded = make_physical(spec)
                m = spec.compile()
        except (ValueError, RuntimeError, mujoco.FatalError) as error:
            reason = _reason(error)
            if "mesh" in reason.lower() and meshes:
                meshes = False
                notes.append(f"meshes are left out: {reason}")
            else:
                raise RobotError("TS404", f"MuJoCo cannot compile '{shown}': {reason}") from None
            continue
        if absent and meshes:
            notes.append(
                "meshes that are not there, lie outside of the project or cannot be drawn are left "
                f"out: {', '.join(absent)}"
            )
        notes.extend((*rounded, *heard))
        return m, tuple(unphysical)


def _settle(spec: mujoco.MjSpec) -> None:
    """Sets what every file is compiled with."""
    spec.memory = spec.njmax = spec.nconmax = spec.nstack = -1
    spec.compiler.fusestatic = False
    spec.compiler.boundmass = max(spec.compiler.boundmass, BOUND_MASS)
    spec.compiler.boundinertia = max(spec.compiler.boundinertia, BOUND_INERTIA)
    # Nothing collides here, which spares the meshes their convex hulls.
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0
    for mesh in spec.meshes:
        mesh.smoothnormal = True


def _reason(error: Exception) -> str:
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    text = ", ".join(lines) or type(error).__name__
    # A file that was put together for MuJoCo stands on one line.
    return re.sub(r"(XML )?Error: |,? \(?line 1\b\)?", "", text)
