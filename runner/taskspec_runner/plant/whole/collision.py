"""The contacts of whole surfaces in MuJoCo's table of collision functions.

Geoms that carry data (`contacts`) are ellipsoids, which nothing else here is; two unmarked
ellipsoids go to MuJoCo's own function. The function adds its contacts itself, with the stiffness,
damping and friction of each, for MuJoCo gives all contacts of a pair the same.

What it reads of `mjModel` and `mjData` is found by comparing addresses, and a press on a plate
has to come out right before any scene is made with it.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Sequence
from functools import cache
from threading import Lock
from typing import Any

import mujoco

from taskspec.deferred_methods import dataclass
from taskspec.native.engine import Engine, available
from taskspec.native.kernel_ir import kernel_ir, kernel_source
from taskspec.shapes import overlap, patches
from taskspec_runner.plant import simulator
from taskspec_runner.plant.simulator import LayoutError
from taskspec_runner.plant.whole import contacts

_KIND = int(mujoco.mjtGeom.mjGEOM_ELLIPSOID)
_KINDS = int(mujoco.mjtGeom.mjNGEOMTYPES)
#: User data of a geom that no other number of a model equals.
_WIDTH = 1237
_PROBE = f"""
<mujoco><size nuser_geom="{_WIDTH}"/><worldbody><geom size="0.1"/>
<body><freejoint/><geom size="0.1" pos="1 0 0"/></body></worldbody></mujoco>
"""
_ARGUMENTS = (ctypes.c_void_p,) * 3 + (ctypes.c_int32,) * 2 + (ctypes.c_double,)
_FUNCTION = ctypes.CFUNCTYPE(ctypes.c_int32, *_ARGUMENTS)
_LOCK = Lock()

# MuJoCo's function: memory from where model and data have it, contacts on the stack.
_ENTRY = """
declare i64 @touch(ptr, ptr, ptr, i64, i64, i64, ptr, ptr, ptr)
@added = internal global ptr null
@others = internal global ptr null
define void @provide(ptr %add, ptr %other) {{
  store ptr %add, ptr @added
  store ptr %other, ptr @others
  ret void
}}
define i32 @collide(ptr %m, ptr %d, ptr %con, i32 %g1, i32 %g2, double %margin) {{
  %contacts = alloca [{contacts} x double]
  %work = alloca [{work} x double]
  %place.at = getelementptr i64, ptr %d, i64 {place}
  %place = load ptr, ptr %place.at
  %axes.at = getelementptr i64, ptr %d, i64 {axes}
  %axes = load ptr, ptr %axes.at
  %data.at = getelementptr i64, ptr %m, i64 {data}
  %data = load ptr, ptr %data.at
  %width.at = getelementptr i64, ptr %m, i64 {width}
  %width = load i64, ptr %width.at
  %first = sext i32 %g1 to i64
  %second = sext i32 %g2 to i64
  %n = call i64 @touch(ptr %place, ptr %axes, ptr %data, i64 %width, i64 %first, i64 %second,
                       ptr %contacts, ptr %contacts, ptr %work)
  %unmarked = icmp slt i64 %n, 0
  br i1 %unmarked, label %else, label %loop
else:
  %other = load ptr, ptr @others
  %found = call i32 %other(ptr %m, ptr %d, ptr %con, i32 %g1, i32 %g2, double %margin)
  ret i32 %found
loop:
  %i = phi i64 [ 0, %0 ], [ %next, %each ]
  %more = icmp slt i64 %i, %n
  br i1 %more, label %each, label %done
each:
  %word = mul i64 %i, {contact}
  %one = getelementptr double, ptr %contacts, i64 %word
  %add = load ptr, ptr @added
  %full = call i32 %add(ptr %m, ptr %d, ptr %one)
  %next = add i64 %i, 1
  br label %loop
done:
  ret i32 0
}}
"""


@dataclass(frozen=True, slots=True)
class ContactLayout:
    """Words of 64 bit from the beginning of `mjData` and `mjModel`.

    Attributes:
        place: the address of the geoms' positions, in the data.
        axes: of their rotations, in the data.
        data: of their user data, in the model.
        width: how much user data a geom has, in the model.
    """

    place: int
    axes: int
    data: int
    width: int


@cache
def layout() -> ContactLayout:
    """Offsets of what a collision needs in every `mjModel` and `mjData` of this MuJoCo.

    Raises:
        LayoutError: it is not there.
    """
    model = mujoco.MjModel.from_xml_string(_PROBE)
    data = mujoco.MjData(model)
    word = simulator.word
    return ContactLayout(
        place=word(data, data.geom_xpos.ctypes.data),
        axes=word(data, data.geom_xmat.ctypes.data),
        data=word(model, model.geom_user.ctypes.data),
        width=word(model, _WIDTH),
    )


def install() -> None:
    """Puts the function into MuJoCo's table, for this process.

    Raises:
        LayoutError: this MuJoCo is not as expected.
    """
    with _LOCK:
        _installed()


@cache
def _installed() -> tuple[Any, ...]:
    """Objects that have to live as long as the table names them."""
    found, add = layout(), simulator.address("mj_addContact")
    table = _table()
    at = _KIND * _KINDS + _KIND
    other = table[at]
    if not other:
        raise LayoutError("MuJoCo's table of collision functions is not as expected")
    held = compiled(found, add, other) if available() else interpreted(found, add, other)
    table[at] = held[0]
    try:
        _try()
    except LayoutError:
        table[at] = other
        raise
    return held


def _table() -> Any:
    kind = ctypes.c_void_p * (_KINDS * _KINDS)
    return kind.from_address(simulator.address("mjCOLLISIONFUNC"))


def compiled(found: ContactLayout, add: int, other: int) -> tuple[int, Any]:
    """Address of the function as machine code, and what has to live with it.

    Args:
        found: where things are.
        add: the address of `mj_addContact`.
        other: the address of the function for what is not marked.
    """
    entry = _ENTRY.format(
        place=found.place, axes=found.axes, data=found.data, width=found.width,
        contacts=contacts.CONTACT * patches.MOST, contact=contacts.CONTACT, work=contacts.WORK,
    )  # fmt: skip
    engine = Engine(
        lambda: [kernel_ir(contacts.touch), entry],
        level=2,
        source=kernel_source(contacts, patches, overlap) + entry.encode(),
    )
    engine.function("provide", None, ctypes.c_void_p, ctypes.c_void_p)(add, other)
    return engine.address("collide"), engine


def interpreted(found: ContactLayout, add: int, other: int) -> tuple[int, Any]:
    """The same in Python, where there is no machine code."""
    adds = ctypes.CFUNCTYPE(ctypes.c_int32, *_ARGUMENTS[:3])(add)
    others = _FUNCTION(other)

    def collide(m: int, d: int, con: int, first: int, second: int, margin: float) -> int:
        model = (ctypes.c_int64 * (max(found.data, found.width) + 1)).from_address(m)
        data = (ctypes.c_int64 * (max(found.place, found.axes) + 1)).from_address(d)
        width, most = model[found.width], max(first, second) + 1
        made = (ctypes.c_double * (contacts.CONTACT * patches.MOST))()
        n = contacts.touch(
            _doubles(data[found.place], 3 * most),
            _doubles(data[found.axes], 9 * most),
            _doubles(model[found.data], width * most),
            width,
            first,
            second,
            memoryview(made).cast("B").cast("d"),
            memoryview(made).cast("B").cast("i"),
            memoryview(bytearray(8 * contacts.WORK)).cast("d"),
        )
        if n < 0:
            return int(others(m, d, con, first, second, margin))
        for i in range(n):
            adds(m, d, ctypes.addressof(made) + 8 * contacts.CONTACT * i)
        return 0

    function = _FUNCTION(collide)
    return ctypes.cast(function, ctypes.c_void_p).value or 0, (function, adds, others)


def _doubles(address: int, count: int) -> Any:
    if not (address and count):
        return memoryview(bytearray()).cast("d")
    return memoryview((ctypes.c_double * count).from_address(address)).cast("B").cast("d")


def mark_tool(geom: mujoco.MjsGeom, kind: int, half: Sequence[float], rounding: float) -> None:
    """Gives a marker geom, at the centre of a tool, what the tool is.

    Args:
        geom: an ellipsoid with the tool's axes.
        kind: of `overlap`.
        half: (3,) radius or half edges, the third half its length [m].
        rounding: how far its faces bulge [m].
    """
    geom.userdata = _padded([contacts.TOOL, kind, *half, rounding, 0.0])


def mark_shape(
    geom: mujoco.MjsGeom, kind: int, sizes: Sequence[float], contact: Sequence[float]
) -> None:
    """Gives a marker geom what the shape is.

    Args:
        geom: an ellipsoid with the shape's axes.
        kind: of `patches`.
        sizes: (at most 6,) [m, rad].
        contact: stiffness, damping, friction, mobility A, settling rate, impedance.
    """
    filled = [*sizes, *([0.0] * (6 - len(sizes)))]
    geom.userdata = _padded([contacts.SHAPE, kind, *filled, *contact, 0.0])


def _padded(data: Sequence[float]) -> list[float]:
    return [float(x) for x in data] + [0.0] * (contacts.DATA - len(data))


def connect(model: mujoco.MjModel, marker: int, reported: int) -> None:
    """Has the contacts of a marker be reported as those of another geom."""
    place = 6 if model.geom_user[marker][0] == contacts.TOOL else 14
    model.geom_user[marker][place] = reported
    # Whether they touch is for the function to say, at any distance.
    model.geom_rbound[marker] = 0.0


_TRIAL = f"""
<mujoco><size nuser_geom="{contacts.DATA}"/>
<option timestep="0.001" cone="elliptic" impratio="100" tolerance="1e-14" integrator="Euler"/>
<worldbody><geom name="plate" type="ellipsoid" size="1 1 1" contype="0" conaffinity="0"/>
<body name="tool" pos="0 0 0.02"><joint type="slide" axis="0 0 1" damping="400"/>
<inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/>
<geom name="tool" type="ellipsoid" size="1 1 1" contype="0" conaffinity="0" euler="180 0 0"/>
</body></worldbody><contact><pair geom1="plate" geom2="tool" condim="3"/></contact></mujoco>
"""


def _try() -> None:
    """Lets a weight down on a plate: it has to sink in by its weight over the stiffness."""
    model = mujoco.MjModel.from_xml_string(_TRIAL)
    stiffness, mobility, impedance = 20e3, 0.5, 0.02
    tool, plate = model.geom("tool").id, model.geom("plate").id
    model.geom_user[tool] = _padded([contacts.TOOL, overlap.BALL, 0.02, 0.02, 0.02, 1e-6, tool])
    contact = [stiffness, 40.0, 0.2, mobility, 10.0, impedance, plate]
    model.geom_user[plate] = _padded([contacts.SHAPE, patches.PLATE, *([0.0] * 6), *contact])
    model.geom_rbound[:] = 0.0
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 1500)
    wanted = 2.0 * 9.81 / stiffness
    if data.ncon != 1 or abs(-float(data.qpos[0]) / wanted - 1.0) > 1e-6:
        raise LayoutError(
            f"MuJoCo {mujoco.__version__} on {sys.platform} takes contacts otherwise than 4.0.0: "
            f"a weight sinks in by {-1e3 * float(data.qpos[0]):.6g} mm, not {1e3 * wanted:.6g} mm"
        )


def wide(spec: mujoco.MjSpec) -> None:
    """Makes room for the data of markers in every geom of a scene."""
    spec.nuser_geom = max(spec.nuser_geom, contacts.DATA)
