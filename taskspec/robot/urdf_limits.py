"""Limits of a URDF file's joints, as the file has them.

MuJoCo's reader passes over limits that are equal, and gives those of a `planar` joint to the first
of its three coordinates alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from xml.etree import ElementTree

from taskspec.deferred import mujoco
from taskspec.deferred_methods import dataclass
from taskspec.robot.errors import RobotError
from taskspec.robot.files import line_of
from taskspec.robot.types import FileRemark

#: Types of joints that have a range; without one it is from 0 to 0.
_RANGED = ("revolute", "prismatic")
#: What MuJoCo calls the coordinates of a `planar` joint, behind its name.
_PLANAR = ("_TX", "_TY", "_RZ")
#: Elements of a transmission, or of a joint, that say how a motor's inertia adds to a link's.
_ROTORS = frozenset({"mechanicalReduction", "motorInertia", "rotor_inertia", "gear_ratio"})


@dataclass(frozen=True, slots=True)
class LockedJoint:
    """A joint whose limits are one value.

    Attributes:
        name: Of the joint, as the file has it.
        value: [rad or m]
        stated: Whether the file gives the limits; without them both are 0.
        place: File and line, as the end of a phrase.
    """

    name: str
    value: float
    stated: bool
    place: str

    @property
    def what(self) -> str:
        """The limits, for messages about what else ties the joint."""
        return f"<limit> of joint '{self.name}'{self.place}"

    @property
    def remark(self) -> FileRemark:
        """That the joint is locked, and why."""
        why, remedy = "its limits are equal", "give it its range"
        if not self.stated:
            why = "without lower and upper, both of its limits are 0 in URDF"
            remedy = 'give it its range, or type="continuous" if it turns without end'
        return FileRemark(
            "TS449",
            f"joint '{self.name}' is locked at {self.value:g}: {why}{self.place}",
            f'{remedy}; type="fixed" says that it is meant so',
            ("model",),
        )


@dataclass(frozen=True, slots=True)
class UrdfLimits:
    """What a file says of its joints beside how they move, by MuJoCo's number of the joint.

    Attributes:
        velocity: Limits [rad/s or m/s]; zero in a file means that it gives none.
        locked: Joints whose limits are one value.
    """

    velocity: dict[int, float]
    locked: dict[int, LockedJoint]


def check_limits(root: ElementTree.Element) -> None:
    """Checks the limits of a URDF file.

    Raises:
        RobotError: TS405 for a joint whose limits are missing, no numbers, or swapped.
    """
    for joint in root.findall("joint"):
        limit, name = joint.find("limit"), joint.get("name", "")
        if limit is None:
            if joint.get("type") in _RANGED:
                raise RobotError(
                    "TS405",
                    f"joint '{name}' is {joint.get('type')} and has no <limit>",
                    'URDF wants one: give it <limit lower="" upper="" effort="" velocity=""/>, or '
                    'type="continuous" if it turns without end',
                )
            continue
        lower, upper = (number(limit, key, name) for key in ("lower", "upper"))
        if lower > upper:
            raise RobotError(
                "TS405", f"joint '{name}' has lower {lower:g} above upper {upper:g}", "swap them"
            )


def apply_limits(m: mujoco.MjModel, root: ElementTree.Element, shown: str) -> UrdfLimits:
    """Gives the joints of a model the limits of its file.

    Args:
        m: The file, compiled; its ranges and torque limits are written.
        root: The file's elements.
        shown: The file, for messages.
    """
    found = UrdfLimits({}, {})
    ids = {m.joint(j).name: j for j in range(m.njnt)}
    for joint in root.findall("joint"):
        limit, name, kind = joint.find("limit"), joint.get("name", ""), joint.get("type")
        if limit is None:
            continue
        planar = kind == "planar"
        numbers = [ids[each] for each in ((f"{name}{end}" for end in _PLANAR) if planar else [name])
                   if each in ids]  # fmt: skip
        lower, upper, effort, velocity = (
            number(limit, key, name) for key in ("lower", "upper", "effort", "velocity")
        )
        stated = "lower" in limit.attrib or "upper" in limit.attrib
        for j in numbers:
            if velocity > 0:
                found.velocity[j] = velocity
            if planar and effort > 0:
                m.jnt_actfrclimited[j], m.jnt_actfrcrange[j] = True, (-effort, effort)
            if not (kind in _RANGED or (planar and stated)):
                continue
            # What follows another joint has that one's range, whatever is written of its own.
            locked = lower == upper and joint.find("mimic") is None
            m.jnt_limited[j], m.jnt_range[j] = lower < upper, (lower, upper)
            if locked:
                place = line_of(limit, shown)
                found.locked[j] = LockedJoint(m.joint(j).name, lower, stated, place)
    return found


def left_out(root: ElementTree.Element) -> Iterator[str]:
    """What limits or inertia a file gives beside those that count, a sentence each."""
    soft = [
        joint.get("name", "")
        for joint in root.findall("joint")
        if joint.find("safety_controller") is not None
    ]
    if soft:
        yield (
            f"the soft limits of <safety_controller> are left out, those of <limit> count: "
            f"{', '.join(soft)}"
        )
    geared = [
        each.get("name", "")
        for part in root
        if part.tag in ("transmission", "joint")
        if any(inner.tag.rpartition("}")[2] in _ROTORS for inner in part.iter())
        for each in (part.findall("joint") if part.tag == "transmission" else [part])
    ]
    if geared:
        yield (
            "the inertia of rotors behind gears (<transmission>) is left out, joints have that of "
            f"their links: {', '.join(dict.fromkeys(geared))}"
        )


def number(element: ElementTree.Element, key: str, name: str) -> float:
    """A number of an element, zero where it is not given.

    Raises:
        RobotError: TS405 where it is none.
    """
    text = element.get(key, "0")
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if math.isnan(value):
        raise RobotError("TS405", f"'{name}': {key} of <{element.tag}> is not a number: {text}")
    return value
