"""What a stage presses on, runs into or holds."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.axis import Axis
from taskspec.program.axes import MOSTLY
from taskspec.program.contacts import Encounter, directions
from taskspec.program.context import Context
from taskspec.program.known_value import KnownValues
from taskspec.program.plan.kinematics import StageKinematics
from taskspec.program.world.frames import FrameModel
from taskspec.spec import AxisEntry, Stage

Vector = NDArray[np.float64]

#: Cosine from which on two normals are taken as one: 1 deg.
_SAME = float(np.cos(np.deg2rad(1.0)))


class StageContacts:
    """The objects that a stage is about, by axis, with their normals where it meets them."""

    def __init__(
        self,
        context: Context,
        spec: Stage,
        frame: FrameModel,
        kinematics: StageKinematics,
        known: KnownValues,
    ) -> None:
        """Of a stage.

        Args:
            context: objects of the world, and what the robot holds.
            spec: entry of the stage in the file.
            frame: of the stage.
            kinematics: its axes, and where the tool is as it starts.
            known: values of expressions before a run.
        """
        self._context, self._spec, self._frame = context, spec, frame
        self._kinematics, self._known = kinematics, known
        self._met: dict[Axis, Encounter] = {}
        self._normals: dict[str, Vector] = {}

    @cached_property
    def surface(self) -> str | None:
        """The object that the frame follows or is fixed on, and that forces then act on."""
        owner = self._frame.surface_name or self._frame.owner
        here = owner in self._context.surfaces and owner not in self._context.loaded.task.carried
        return owner if here else None

    @cached_property
    def gripped(self) -> bool:
        """Whether forces are returned by what the robot holds, and both ways.

        A handle returns them in every frame but those of an object; a loose body where the world
        has no other object.
        """
        context = self._context
        if context.loaded.task.robot.grasp is None or self.surface is not None:
            return False
        return bool(context.held) or not context.touchable_gaps

    @cached_property
    def held(self) -> str:
        """The mechanism whose handle returns forces instead of a contact; empty for none."""
        return self._context.held if self.gripped else ""

    @cached_property
    def by_axis(self) -> dict[Axis, str | None]:
        """The object that each translation presses on, or runs into."""
        return {a: self._along(a) for a in self._kinematics.axes if not a.is_rotation}

    def of(self, axis: Axis) -> str | None:
        """The object that an axis presses on, or runs into; else that which the stage is about.

        What the tool touches also acts on axes along which it lies in nobody's way: by friction,
        and by its moments.
        """
        own = self.by_axis.get(axis)
        if own is None and axis.is_rotation:
            entry = self._spec.axes.get(axis)
            own = None if entry is None else entry.contact
        return own or self.main

    @cached_property
    def main(self) -> str | None:
        """The object that the stage is about: the stiffest that it presses on, or what it meets."""
        named = self._spec.contact or self.surface
        if named is not None or self.gripped:
            return named
        if self.of_forces:
            return max(self.of_forces, key=lambda c: self._context.compliances[c].stiffness)
        if self.approached is not None:
            return self.approached
        near = [self._met[a] for a in self.by_axis if a in self._met]
        if near:
            return min(near, key=lambda met: met.travel).contact
        return next((c for c in self.by_axis.values() if c is not None), None)

    @cached_property
    def of_gap(self) -> str | None:
        """The object that `gap` is the distance from; None where its forces have several."""
        return None if len(self.of_forces) > 1 else self.main

    @cached_property
    def forces(self) -> tuple[Axis, ...]:
        """Translations with a force set point."""
        entries = self._spec.axes
        return tuple(a for a in self.by_axis if a in entries and entries[a].has_force)

    @cached_property
    def of_forces(self) -> tuple[str, ...]:
        """The objects that its forces press on, each once, by the order of their axes."""
        contacts = (self.by_axis[a] for a in self.forces)
        return tuple(dict.fromkeys(c for c in contacts if c is not None))

    @cached_property
    def approached(self) -> str | None:
        """The first object on the way of its steady velocities; None where there is none."""
        if self.surface is not None or self._spec.contact is not None or self.gripped:
            return self.main
        rates = np.zeros(3)
        for axis, entry in self._spec.axes.items():
            if axis in self.by_axis:
                rates[axis.row] = entry.mode.settled_rate(self._known) or 0.0
        if not np.isfinite(rates).all() or not rates.any():
            return None
        p, R = self._kinematics.tool
        way = self._kinematics.frame_at_tool @ rates
        speed = np.linalg.norm(way)
        # The squares of what is hardly a number are none.
        met = self._context.obstacles.first(p, R, way / speed) if speed > 0 else None
        if met is None:
            return None
        self._normals.setdefault(met.contact, met.normal)
        return met.contact

    @cached_property
    def objects(self) -> tuple[str, ...]:
        """All objects that its axes press on or may run into."""
        found = [c for a in self._kinematics.axes if (c := self.of(a)) is not None]
        return tuple(dict.fromkeys(found))

    @cached_property
    def touched(self) -> tuple[str, ...]:
        """The objects that it touches: that which it is about, then those of its other forces."""
        first = () if self.main is None else (self.main,)
        others = (c for a in self.forces if (c := self.by_axis[a]) is not None)
        return tuple(dict.fromkeys((*first, *others)))

    @cached_property
    def pressed(self) -> frozenset[str]:
        """Those of them along whose normal a force acts."""
        along = (a for a in self.forces if abs(self.facing(a)) > MOSTLY)
        return frozenset(c for a in along if (c := self.by_axis[a]) is not None)

    def normal(self, contact: str) -> Vector:
        """(3,) outward normal of an object where the stage meets it, world axes."""
        context = self._context
        at_start = context.start_normals[contact]
        if contact == self.surface:
            return at_start
        if contact not in self._normals:
            self._normals[contact] = context.obstacles.normal(contact, *self._kinematics.tool)
        normal = self._normals[contact]
        return at_start if float(normal @ at_start) > _SAME else normal

    def facing(self, axis: Axis) -> float:
        """Component of an axis along the outward normal of its contact; 0 without one."""
        contact = self.of(axis)
        if contact is None or axis.is_rotation:
            return 0.0
        return self._kinematics.along(axis, self.normal(contact))

    def _along(self, axis: Axis) -> str | None:
        entry = self._spec.axes.get(axis)
        named = (entry.contact if entry is not None else None) or self._spec.contact
        if named is not None or self.gripped:
            return named
        if self.surface is not None:
            normal = self._context.start_normals[self.surface]
            across = abs(self._kinematics.along(axis, normal)) < MOSTLY
            if not (across and entry is not None and entry.has_force):
                return self.surface
            # A force along the surface is returned by what stands on it.
        met = self._ahead(axis, entry)
        if met is None:
            return self.surface
        self._met[axis] = met
        self._normals.setdefault(met.contact, met.normal)
        return met.contact

    def _ahead(self, axis: Axis, entry: AxisEntry | None) -> Encounter | None:
        """The first object that an axis leads to."""
        p, R = self._kinematics.tool
        way = self._kinematics.frame_at_tool[:, axis.column]
        for signs in directions(entry, self._known):
            met = [self._context.obstacles.first(p, R, sign * way) for sign in signs]
            nearest = min((m for m in met if m is not None), key=lambda m: m.travel, default=None)
            if nearest is not None:
                return nearest
        return None
