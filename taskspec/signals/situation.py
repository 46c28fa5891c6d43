"""The arguments of a formula: the tool in a frame at one instant, as expressions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field
from typing import TYPE_CHECKING, Any

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis
from taskspec.signals.table import VECTORS, Entry, Index, Signal, find

if TYPE_CHECKING:
    import casadi as ca

#: What a situation lacks; a formula that needs it cannot be evaluated there.
UNKNOWN: Any = None


@dataclass(frozen=True, slots=True)
class MovingPose:
    """A pose of the tip.

    Attributes:
        p: (3,) [m].
        R: (3, 3).
        twist: (6,) its velocity [m/s, rad/s].
    """

    p: ca.SX
    R: ca.SX
    twist: ca.SX = UNKNOWN


@dataclass(frozen=True, slots=True)
class ObjectState:
    """An object of the world; None is what is not known of it.

    Attributes:
        kind: as in `OBJECT`.
        distance: of the tool from it [m, rad].
        coordinate: of a mechanism [rad, m].
        travel: of a mechanism's handle along its axis [m].
        effort: what the robot applies to it [N, N m].
        displacement: (6,) of a bushing, in its axes [m, rad].
        wrench: (6,) what the robot applies to a bushing at the tip, in its axes [N, N m].
    """

    kind: str
    distance: ca.SX | None = None
    coordinate: ca.SX | None = None
    travel: ca.SX | None = None
    effort: ca.SX | None = None
    displacement: ca.SX | None = None
    wrench: ca.SX | None = None


@dataclass(slots=True)
class Situation:
    """The tool in a frame at one instant; grows while a stage is put together.

    A frame may be carried by an object that moves. What is relative to that object is in its axes;
    these are the world's where nothing carries the frame.

    Attributes:
        axes: axes of the frame that exist for the arm.
        t: since the stage began [s].
        clock: since the run began [s].
        world: the tip in the world.
        tip: the tip, relative to what carries the frame.
        frame: (3, 3) axes of the frame, relative.
        twist: (6,) velocity of the control point, relative [m/s, rad/s].
        applied: (6,) what the robot applies at the control point, relative [N, N m].
        start: (3,) where the tip was as the stage began, world [m].
        q: (n,) joint positions [rad].
        v: (n,) joint velocities [rad/s].
        torque: (n,) what is commanded to the joints [N m].
        contact: the object whose gap is meant where none is named, None without one.
        objects: by name.
        visits: how often each stage was entered.
        position: by axis, as far as there is one [m, rad].
        error: by axis, as far as there is one [m, rad].
        path_done: whether the stage's path is at its end.
        limited: whether a limit changed the torque of the tick before.
        force_inconsistent: what contacts cannot return of the force set points [N].
        joint_error: of the joint that is farthest from its reference [rad, m].
        grip: signals of the gripper by the last part of their names; empty in a task without.
        payload: (4,) mass [kg] and centre [m] of one that laws adapt to; empty without any.
        energies: gives the energies and powers of the stage's law by name; empty where it states
            none.
        disturbance: (n,) what the stage's observer estimates [N m, N]; None without one.
        tank: signals of the stage's energy tank by name; empty without one.
        estimates: what the law estimates along axes, by the name of its signal.
        known: signals by full name that are given instead of evaluated, and those evaluated so far.
    """

    axes: tuple[Axis, ...]
    t: ca.SX = UNKNOWN
    clock: ca.SX = UNKNOWN
    world: MovingPose = UNKNOWN
    tip: MovingPose = UNKNOWN
    frame: ca.SX = UNKNOWN
    twist: ca.SX = UNKNOWN
    applied: ca.SX = UNKNOWN
    start: ca.SX = UNKNOWN
    q: ca.SX = UNKNOWN
    v: ca.SX = UNKNOWN
    torque: ca.SX = UNKNOWN
    contact: str | None = None
    objects: Mapping[str, ObjectState] = field(default_factory=dict)
    visits: Mapping[str, ca.SX] = field(default_factory=dict)
    position: Mapping[Axis, ca.SX] = field(default_factory=dict)
    error: Mapping[Axis, ca.SX] = field(default_factory=dict)
    path_done: ca.SX = UNKNOWN
    limited: ca.SX = UNKNOWN
    force_inconsistent: ca.SX = UNKNOWN
    joint_error: ca.SX = UNKNOWN
    grip: Mapping[str, ca.SX] = field(default_factory=dict)
    payload: ca.SX = UNKNOWN
    energies: Callable[[], Mapping[str, ca.SX]] = dict
    disturbance: ca.SX | None = None
    tank: Mapping[str, ca.SX] = field(default_factory=dict)
    estimates: Mapping[str, Mapping[Axis, ca.SX]] = field(default_factory=dict)
    known: dict[str, ca.SX] = field(default_factory=dict)

    def signal(self, *path: str) -> ca.SX | None:
        """A signal by the parts of its name; None where it is not known."""
        text = ".".join(path)
        if text not in self.known:
            kinds = {name: thing.kind for name, thing in self.objects.items()}
            found = find(path, kinds, self.visits)
            value = None if found is None else self._value(found)
            if found is None or value is None or found.signal.axes:
                return value
            self.known[text] = value
        return self.known[text]

    def _value(self, entry: Entry) -> ca.SX | None:
        """The formula of an entry here; None where it is not known."""
        signal, member = entry.signal, entry.member
        if entry.beside:
            return None
        if signal.index is Index.AXIS:
            return self.components(signal).get(Axis(member))
        found: ca.SX | None = signal.formula(self, member) if member else signal.formula(self)
        return found

    def components(self, signal: Signal) -> Mapping[Axis, ca.SX]:
        """All components of a family of axes that there are, by axis."""
        names = {axis: f"{signal.name}.{axis}" for axis in signal.axes}
        given = {axis: self.known[name] for axis, name in names.items() if name in self.known}
        if given:
            return given
        value = signal.formula(self)
        if value is None or isinstance(value, Mapping):
            # These grow, and are restated, as long as the stage is put together.
            return value or {}
        found = {axis: value[i] for i, axis in enumerate(signal.axes) if axis in self.axes}
        self.known |= {names[axis]: each for axis, each in found.items()}
        return found

    def six(self, group: str) -> Mapping[Axis, ca.SX]:
        """A vector of six numbers by axis, such as the wrench: `force` with `torque`."""
        found: dict[Axis, ca.SX] = {}
        for each in VECTORS.values():
            if each.group == group:
                found |= self.components(each)
        return found
