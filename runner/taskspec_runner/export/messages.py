"""Definitions of the messages in an MCAP export, as ROS 2 has them, and of the task's own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from taskspec.deferred_methods import dataclass
from taskspec_runner.record.nested import path_of

_RULE = "\n" + 80 * "=" + "\n"
_PARTS = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec\n",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
    "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
    "geometry_msgs/Wrench": "geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque\n",
    "geometry_msgs/Transform": (
        "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n"
    ),
    "geometry_msgs/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n"
    ),
}
_MESSAGES = {
    "sensor_msgs/msg/JointState": (
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n"
        "float64[] effort\n"
    ),
    "geometry_msgs/msg/WrenchStamped": "std_msgs/Header header\ngeometry_msgs/Wrench wrench\n",
    "geometry_msgs/msg/PoseStamped": "std_msgs/Header header\ngeometry_msgs/Pose pose\n",
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms\n",
    "std_msgs/msg/String": "string data\n",
}
SIGNALS = "taskspec_msgs/msg/Signals"


def definition(message: str) -> str:
    """The definition of a message with all that it is made of."""
    return complete(_MESSAGES[message], {})


def complete(text: str, own: Mapping[str, str]) -> str:
    """A definition followed by those of every message in it; `own` are the task's."""
    known, found, waiting = {**_PARTS, **own}, {}, [text]
    while waiting:
        for line in waiting.pop().splitlines():
            kind = line.split(" ")[0].removesuffix("[]")
            if kind in known and kind not in found:
                found[kind] = known[kind]
                waiting.append(known[kind])
    return text + "".join(f"{_RULE}MSG: {kind}\n{body}" for kind, body in found.items())


@dataclass(frozen=True, slots=True)
class Signals:
    """The message that holds all scalars of a log.

    Attributes:
        definition: its fields, nested as the names of the columns are, units as comments.
        columns: of the log, in the order of its numbers.
        units: by path of the field.
    """

    definition: str
    columns: tuple[str, ...]
    units: Mapping[str, str]


def signals_message(names: Sequence[str], units: Mapping[str, str]) -> Signals:
    """The message of a log's columns; those of joints have a message of their own."""
    groups: dict[str, dict[str, str]] = {}
    for name in names:
        if name not in ("clock", "stage") and not name.startswith("joint."):
            group, field = _place(name)
            groups.setdefault(group, {})[field] = name
    top = groups.pop("", {})
    lines, own = ["std_msgs/Header header\n", *_fields(top, units)], {}
    for group, fields in groups.items():
        kind = f"taskspec_msgs/Group{group[0].upper()}{group[1:]}"
        lines.append(f"{kind} {group}\n")
        own[kind] = "".join(_fields(fields, units))
    columns = [*top.values(), *(name for fields in groups.values() for name in fields.values())]
    paths = {field_of(name): units.get(name, "") for name in columns}
    return Signals(complete("".join([*lines, "string stage\n"]), own), tuple(columns), paths)


def _place(column: str) -> tuple[str, str]:
    """Group, or none, and field of a column: `force.z.ref` is `z_ref` of `force`."""
    *groups, field = path_of(column)
    return (groups[0], "_".join([*groups[1:], field])) if groups else ("", field)


def _fields(fields: Mapping[str, str], units: Mapping[str, str]) -> list[str]:
    said = {field: units.get(name, "") for field, name in fields.items()}
    return [f"float64 {field}" + (f"  # [{u}]\n" if u else "\n") for field, u in said.items()]


def field_of(column: str) -> str:
    """The path of a column in the message of all scalars: `force.z.ref` is `force.z_ref`."""
    return ".".join(filter(None, _place(column)))
