"""Signals of the language over a rehearsal, as far as its expectations need them."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.analysis.coordinates import coordinates
from taskspec.analysis.loose_bodies import loose_bodies
from taskspec.analysis.point_contacts import Ground
from taskspec.analysis.rehearsal import Rehearsal
from taskspec.geometry.axis import AXES, as_axis
from taskspec.program.bound import RowFunction
from taskspec.program.context import Context
from taskspec.program.world import frames, kinematics
from taskspec.program.world.moving_base import moving_bases
from taskspec.text.expression.series import Series
from taskspec.text.expression.tree import Name

Vector = NDArray[np.float64]

_EFFORTS, _MOTIONS = ("force", "torque"), ("position", "velocity", "error")
_REF = "ref"


class RehearsedSignals:
    """Looks up names of expectations in what was rehearsed.

    Args:
        context: of the task.
        rehearsal: of it.
        share: by which forces are farther from their set points than they were rehearsed to be.
    """

    def __init__(self, context: Context, rehearsal: Rehearsal, share: float = 0.0) -> None:
        self._context, self._run, self._share = context, rehearsal, share
        self._every = np.ones(len(rehearsal.times), dtype=bool)
        self._coordinates = coordinates(context.loaded.true_task, context.held, 0)

    def find(self, name: Name) -> Series:
        """The values of a name; one that is not known has none."""
        run, path = self._run, name.path
        window = self._every
        if name.frame is not None:
            return Series(np.full(len(run.times), np.nan), window)
        if len(path) == 1 and path[0] in ("pi", *self._context.loaded.task.params):
            return Series.one(self._constant(path[0]))
        if path[0] in run.names and len(path) > 1:
            window, path = run.ticks(path[0]), path[1:]
        values = self._values(path)
        return Series(np.full(len(run.times), np.nan) if values is None else values, window)

    def _constant(self, name: str) -> float:
        if name == "pi":
            return float(np.pi)
        return float(self._context.loaded.task.params[name].value)

    def _values(self, path: tuple[str, ...]) -> Vector | None:
        run, context = self._run, self._context
        match path:
            case ("t",):
                return run.times
            case ("link", _):
                return np.zeros(len(run.times))
            case ("clock",):
                return np.asarray(context.period * np.arange(len(run.times)))
            case ("speed",) | ("travel",) | ("tilt",) | ("path_done",):
                return run.field(path[0])[:, 0]
            case (kind, axis) | (kind, axis, "ref") if as_axis(axis) is not None:
                return self._on_axis(kind, AXES.index(axis), ref=path[-1] == _REF)
            case ("joint", number, "torque"):
                return run.torque[:, int(number) - 1]
            case ("joint", number, "velocity"):
                return run.v[:, int(number) - 1]
            case (owner, what) if owner in self._coordinates:
                return self._of_mechanism(owner, what)
            case (owner, what) | (owner, what, "ref") if owner in context.equations:
                return self._of_equation(owner, what, ref=path[-1] == _REF)
            case (owner, "gap") if owner in context.surfaces:
                return self._gap(owner)
        return None

    def _on_axis(self, kind: str, i: int, *, ref: bool) -> Vector | None:
        run = self._run
        if kind in _EFFORTS:
            wanted = run.field("force_ref")[:, i]
            if ref:
                return wanted
            applied = self.forces[:, i]
            apart: Vector = np.where(np.isfinite(wanted), applied - wanted, 0.0)
            return applied + self._share * apart
        if kind not in _MOTIONS:
            return None
        return run.field(f"{kind}_ref" if ref else kind)[:, i]

    @property
    def forces(self) -> Vector:
        """(k, 6) forces and moments that the robot applies, in the stages' frames."""
        run = self._run
        R = run.field("frame").reshape(-1, 3, 3).transpose(0, 2, 1)
        force, moment = -run.wrench[:, :3], -run.wrench[:, 3:]
        moment = moment - np.cross(run.field("offset"), force)
        parts = [np.einsum("kji,kj->ki", R, each) for each in (force, moment)]
        return np.asarray(np.hstack(parts), dtype=np.float64)

    def _of_mechanism(self, name: str, what: str) -> Vector | None:
        run, coordinate = self._run, self._coordinates[name]
        if what in _EFFORTS:
            return run.effort if name == self._context.held else None
        model = coordinate.model
        lead = model.lead if model.angular and what == "travel" else 1.0
        places = run.mechanisms[:, 2 * coordinate.row]
        return lead * places if what in ("angle", "travel") else None

    def _of_equation(self, name: str, what: str, *, ref: bool) -> Vector | None:
        i = list(self._context.equations).index(name)
        if what not in _EFFORTS:
            return None
        return self._run.field("reaction_ref")[:, i] if ref else self._run.reactions[:, i]

    def _gap(self, name: str) -> Vector:
        """Of the tool from a shape [m]."""
        context = self._context
        run, task = self._run, context.loaded.true_task
        shape, bodies = task.shapes[name], loose_bodies(task)
        clock, where = ca.SX.sym("clock"), ca.SX.sym("where", run.bodies.shape[1])
        turned = ca.SX.sym("turned", run.mechanisms.shape[1])
        ground = Ground(frames.surface(shape))
        if shape.motion is not None:
            ground = Ground(ground.surface, base=moving_bases(task)[name].at(clock))
        elif name in bodies:
            ground = bodies[name].ground(where[bodies[name].pose])
        elif shape.on is not None:
            row = 2 * self._coordinates[shape.on].row
            ground = self._coordinates[shape.on].ground(turned[row : row + 2], shape)
        p, R = ca.SX.sym("p", 3), ca.SX.sym("R", 9)
        axes = ca.reshape(R, 3, 3)
        place = ground.place(p)
        there = ca.horzcat(*(ground.place(p + axes[:, i]) - place for i in range(3)))
        least = ca.densify(kinematics.gap(context.robot, ground.surface, place, there))
        function = ca.Function("gap", [p, R, clock, where, turned], [least])
        clocks: Vector = context.period * np.arange(len(run.times), dtype=np.float64)[:, None]
        tip = run.field("tip"), run.field("tip_rotation")
        return RowFunction(function)(*tip, clocks, run.bodies, run.mechanisms)[0][:, 0]
