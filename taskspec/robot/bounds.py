"""Bounds on the size of a robot's file, before it is built."""

from __future__ import annotations

import re
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np

from taskspec.deferred import mujoco
from taskspec.robot.errors import RobotError
from taskspec.text.codes import register

register({"TS403": "something in a robot file that is refused"})

MOST_ELEMENTS = 20_000
MOST_DEPTH = 200
MOST_BODIES = 500
MOST_JOINTS = 50
_SHAPES = 5000
_COPIES = 200
_LONGEST_NAME = 256
_HINT = "leave the arm alone in it"
#: Attributes that make MuJoCo reserve memory or build a mesh, and how large their numbers may be.
_RESERVING = {"size": 10_000, "hfield": 4096, "texture": 4096, "mesh": 1000}
_KEYS = {
    "hfield": ("nrow", "ncol"),
    "texture": ("width", "height", "gridsize"),
    "mesh": ("params",),
}
#: Sizes of `<size>` that are not used, since the arm is written down anew.
_UNUSED = frozenset({"memory", "njmax", "nconmax", "nstack"})
_NUMBER = re.compile(r"[^\s]+")
#: Greatest magnitudes: lengths [m], angles [rad] and lengths, masses [kg], inertias [kg·m²].
_GREATEST = {
    **dict.fromkeys(("body_pos", "body_ipos", "jnt_pos", "geom_pos", "site_pos"), 100.0),
    **dict.fromkeys(("jnt_range", "qpos0", "key_qpos"), 1e6),
    **dict.fromkeys(("body_inertia", "dof_armature"), 1e7),
    "body_mass": 1e5,
    "geom_size": 1e4,
}
_FINITE = ("body_quat", "body_ipos", "jnt_axis", "geom_quat", "site_quat")
_UNITS = {"body_pos": "lengths are in m", "body_mass": "masses are in kg"}


class _EnoughError(Exception):
    """The rest of a file need not be read."""


def check_text(text: str, shown: str) -> None:
    """Refuses a file with too many elements, or too deep ones, before they are kept in memory.

    Text that is no XML passes: whoever reads it says so.

    Raises:
        RobotError: TS403.
    """
    count = depth = 0

    def begin(_name: str, _attributes: dict[str, str]) -> None:
        nonlocal count, depth
        count, depth = count + 1, depth + 1
        if count > MOST_ELEMENTS or depth > MOST_DEPTH:
            raise _EnoughError

    def end(_name: str) -> None:
        nonlocal depth
        depth -= 1

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = begin, end
    try:
        parser.Parse(text, True)
    except expat.ExpatError:
        return
    except _EnoughError:
        raise too_large(shown, count, depth) from None


def too_large(shown: str, count: int, depth: int) -> RobotError:
    """The error of a file with so many elements, or such deep ones."""
    what = f"more than {MOST_ELEMENTS} elements"
    if depth > MOST_DEPTH:
        what = f"nested deeper than {MOST_DEPTH}"
    assert count > MOST_ELEMENTS or depth > MOST_DEPTH
    return RobotError("TS403", f"'{shown}' is too large: {what}", _HINT)


def check_growth(root: ElementTree.Element, shown: str) -> None:
    """Refuses a file that becomes too large when it is built: copies, bodies, declared sizes.

    Raises:
        RobotError: TS403, or TS405 for too many bodies.
    """
    elements = bodies = shapes = 0
    waiting = [(root, 1)]
    while waiting:
        element, copies = waiting.pop()
        if element.tag == "replicate":
            copies *= _count(element)
            if copies > _COPIES:
                raise RobotError("TS403", f"'{shown}' replicates more than {_COPIES} times")
        elements += copies
        bodies += copies * (element.tag in ("body", "link"))
        shapes += copies * (element.tag in ("geom", "visual", "collision"))
        waiting += [(child, copies) for child in element]
        _check_reserved(element, shown)
        name = element.get("name", "")
        if len(name) > _LONGEST_NAME:
            what = f"the name of a <{element.tag}> has {len(name)} characters"
            raise RobotError("TS403", f"'{shown}' is too large: {what}", "give it a short name")
    if elements > MOST_ELEMENTS:
        raise too_large(shown, elements, 0)
    if shapes > _SHAPES:
        message = f"'{shown}' is too large: {shapes} shapes, more than {_SHAPES}"
        raise RobotError("TS403", message, _HINT)
    if bodies > MOST_BODIES:
        message = f"'{shown}' has {bodies} bodies, more than {MOST_BODIES}"
        raise RobotError("TS405", message, _HINT)


def _count(replicate: ElementTree.Element) -> int:
    count = replicate.get("count", "1")
    return int(count) if count.isdecimal() and len(count) < 6 else _COPIES + 1


def _check_reserved(element: ElementTree.Element, shown: str) -> None:
    most = _RESERVING.get(element.tag)
    if most is None:
        return
    for key in _KEYS.get(element.tag, [k for k in element.attrib if k not in _UNUSED]):
        for word in _NUMBER.findall(element.get(key, "")):
            if not _at_most(word, most):
                raise RobotError(
                    "TS403",
                    f"'{shown}' is too large: {key} of a <{element.tag}> is beyond {most}",
                    _HINT,
                )


def _at_most(word: str, most: int) -> bool:
    try:
        return float(word) <= most
    except ValueError:
        # MuJoCo refuses what is no number, and knows words.
        return not word[:1].isdigit()


def check_numbers(m: mujoco.MjModel, shown: str) -> None:
    """Refuses numbers with which no simulation goes well.

    Raises:
        RobotError: TS405.
    """
    for name in (*_GREATEST, *_FINITE):
        values = getattr(m, name)
        if not np.isfinite(values).all():
            raise RobotError("TS405", f"'{shown}' has a number in {name} that is not finite")
    for name, most in _GREATEST.items():
        values = np.abs(getattr(m, name))
        if values.size and values.max() > most:
            raise _beyond(m, name, values, most)
    axes = np.linalg.norm(m.jnt_axis, axis=1)
    if (np.abs(axes - 1.0) > 1e-6).any():
        name = m.joint(int(np.abs(axes - 1.0).argmax())).name
        raise RobotError("TS405", f"the axis of joint '{name}' has no direction", "such as 0 0 1")
    if (m.dof_armature < 0).any():
        raise RobotError("TS405", f"'{shown}' has a joint with a negative armature")


def _beyond(
    m: mujoco.MjModel,
    name: str,
    values: np.ndarray[tuple[int, ...], np.dtype[np.float64]],
    most: float,
) -> RobotError:
    i = int(values.reshape(len(values), -1).max(axis=1).argmax())
    value = f"{values.max():g}"
    if name == "body_mass":
        message = f"body '{m.body(i).name}' has a mass of {value} kg"
    elif name == "body_pos":
        message = f"body '{m.body(i).name}' is {value} m from its parent"
    else:
        message = f"{name} has a number of magnitude {value}, beyond {most:g}"
    return RobotError("TS405", message, _UNITS.get(name, "lengths are in m, masses in kg"))
