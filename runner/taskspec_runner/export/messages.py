"""Definitions of the messages in an MCAP export, as ROS 2 has them, and of the task's own."""

from __future__ import annotations

import keyword
import re
from collections.abc import Hashable, Iterable, Mapping, Sequence
from itertools import chain, count
from typing import TypeVar

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
    "builtin_interfaces/Duration": "int32 sec\nuint32 nanosec\n",
    "std_msgs/ColorRGBA": "float32 r\nfloat32 g\nfloat32 b\nfloat32 a\n",
    "sensor_msgs/CompressedImage": "std_msgs/Header header\nstring format\nuint8[] data\n",
    "visualization_msgs/UVCoordinate": "float32 u\nfloat32 v\n",
    "visualization_msgs/MeshFile": "string filename\nuint8[] data\n",
    "visualization_msgs/Marker": (
        "std_msgs/Header header\nstring ns\nint32 id\nint32 type\nint32 action\n"
        "geometry_msgs/Pose pose\ngeometry_msgs/Vector3 scale\nstd_msgs/ColorRGBA color\n"
        "builtin_interfaces/Duration lifetime\nbool frame_locked\n"
        "geometry_msgs/Point[] points\nstd_msgs/ColorRGBA[] colors\nstring texture_resource\n"
        "sensor_msgs/CompressedImage texture\n"
        "visualization_msgs/UVCoordinate[] uv_coordinates\nstring text\nstring mesh_resource\n"
        "visualization_msgs/MeshFile mesh_file\nbool mesh_use_embedded_materials\n"
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
    "visualization_msgs/msg/MarkerArray": "visualization_msgs/Marker[] markers\n",
}
SIGNALS = "taskspec_msgs/msg/Signals"
Key = TypeVar("Key", bound=Hashable)
_LEGAL = re.compile(r"[a-z](?:_?[a-z0-9]+)*")


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
        columns: of the log by the paths of their fields, in the order of the message's numbers.
    """

    definition: str
    columns: Mapping[str, str]


def signals_message(names: Sequence[str], units: Mapping[str, str]) -> Signals:
    """The message of a log's columns; those of joints have a message of their own."""
    groups: dict[str, dict[str, str]] = {}
    for name in names:
        if name not in ("clock", "stage") and not name.startswith("joint."):
            group, field = _place(name)
            groups.setdefault(group, {})[name] = field
    own = groups.pop("", {})
    # Fields without a group stand beside the groups, which may be called like one of them.
    beside = {("", name): field for name, field in own.items()}
    beside |= {(group, ""): group for group in groups}
    fields = _legal(beside, taken=("header", "stage"))
    lines = [_field(fields["", name], units.get(name, "")) for name in own]
    columns = {fields["", name]: name for name in own}
    messages, kinds = {}, set[str]()
    for group, members in groups.items():
        field, legal = fields[group, ""], _legal(members)
        kind = unique("".join(part.capitalize() for part in field.split("_")), kinds, "")
        kind = f"taskspec_msgs/Group{kind}"
        lines.append(f"{kind} {field}\n")
        messages[kind] = "".join(_field(legal[name], units.get(name, "")) for name in members)
        columns |= {f"{field}.{legal[name]}": name for name in members}
    text = "".join(["std_msgs/Header header\n", *lines, "string stage\n"])
    return Signals(complete(text, messages), columns)


def _place(column: str) -> tuple[str, str]:
    """Group, or none, and field of a column: `force.z.ref` is `z_ref` of `force`."""
    *groups, field = path_of(column)
    return (groups[0], "_".join([*groups[1:], field])) if groups else ("", field)


def _field(name: str, unit: str) -> str:
    return f"float64 {name}" + (f"  # [{unit}]\n" if unit else "\n")


def _legal(names: Mapping[Key, str], taken: Iterable[str] = ()) -> dict[Key, str]:
    """The fields of names: as ROS 2 has them and all different, legal names as they are.

    A field is of lower case, digits and single underlines, and begins with a letter, as the ROS 2
    interface definition has it: `tableTop` becomes `table_top`. Words of Python, of which readers
    make attributes, are not taken either.
    """
    found, used = dict[Key, str](), {*taken, *keyword.kwlist, *keyword.softkwlist}
    for key in sorted(names, key=lambda key: _LEGAL.fullmatch(names[key]) is None):
        snake = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", names[key]).lower()
        found[key] = unique(re.sub("_+", "_", snake).strip("_"), used)
    return found


def unique(name: str, used: set[str], between: str = "_") -> str:
    """A name, numbered where it is used; from now on it is."""
    numbered = (f"{name}{between}{i}" for i in count(2))
    made = next(each for each in chain([name], numbered) if each not in used)
    used.add(made)
    return made


def field_of(column: str) -> str:
    """The path of a column whose names are legal fields: `force.z.ref` is `force.z_ref`."""
    return ".".join(filter(None, _place(column)))
