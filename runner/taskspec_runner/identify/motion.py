"""How arm and tool moved in each step of the plant that a log's readings come from."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES
from taskspec.program.bound import RowFunction
from taskspec.program.program import Program
from taskspec.robot.rigid_body import rigid_body
from taskspec_runner.errors import InputError
from taskspec_runner.record.history import History, NotRecordedError, commanded
from taskspec_runner.verdict.replay import Replay

Vector = NDArray[np.float64]

#: Fewer ticks than these are no course.
_LEAST_TICKS = 20


@dataclass(frozen=True)
class LoggedMotion:
    """The arm in the plant step before tick k + 1 senses, for each tick k of a log but the last.

    World axes. The step starts at joint positions q and velocities v, and accelerates them by a:
    with one step in a tick these are row k and (v[k+1] - v[k])/T.

    Attributes:
        p: (n, 3) place of the tip [m].
        R: (n, 3, 3) its axes.
        twist: (n, 6) of the tip [m/s, rad/s].
        push: (n, 6) J a [m/s^2, rad/s^2].
        drift: (n, 6) J' v, what the tip accelerates by beyond that.
        jacobian: (n, 6, joints) J.
        rates: (n, joints) v [rad/s, m/s].
        acceleration: (n, joints) a [rad/s^2, m/s^2].
        inertia: (n, joints, joints) H of the nominal arm.
        bias: (n, joints) C v + g of it [N m, N].
        exerted: (n, joints) what the joints were commanded; None where the log has no torques, or
            of an arm that takes none.
    """

    p: Vector
    R: Vector
    twist: Vector
    push: Vector
    drift: Vector
    jacobian: Vector
    rates: Vector
    acceleration: Vector
    inertia: Vector
    bias: Vector
    exerted: Vector | None


def motion_of(program: Program, history: History) -> LoggedMotion:
    """The motion of a log.

    Raises:
        InputError: it has no joint positions, or too few ticks.
    """
    context = program.context
    control, n = context.loaded.task.control, context.robot.n
    if len(history) < _LEAST_TICKS:
        raise InputError(f"it has {len(history)} ticks, of which nothing can be identified")
    try:
        q = _joints(history, "position", n)
    except NotRecordedError as error:
        raise InputError(
            f"it has no {error.column}, and a contact is identified from where the tool is; name "
            "the joint positions in the column map"
        ) from error
    period = 1.0 / control.rate
    try:
        v = _joints(history, "velocity", n)
    except NotRecordedError:
        # A sampled arm is at q[k] = q[k-1] + T v[k].
        v = np.diff(q, axis=0, prepend=q[:1]) / period
    steps = round(control.plant_rate / control.rate)
    start, rates, acceleration = _last_step(q, v, period, steps)
    terms = RowFunction(rigid_body(context.robot).function)
    packed, bias, _, flat, p, R, drift = terms(start, rates)
    J = flat.reshape(-1, n, 6).transpose(0, 2, 1)
    H = _whole(packed, n)
    exerted = None
    if commanded(history.columns) == "torque" and context.loaded.task.robot.takes_torques:
        names = [f"joint.{i + 1}.torque" for i in range(n)]
        if all(name in history.columns for name in names):
            exerted = np.column_stack([history.columns[name][:-1] for name in names])
    return LoggedMotion(
        p=p,
        R=R.reshape(-1, 3, 3).transpose(0, 2, 1),
        twist=np.einsum("kij,kj->ki", J, rates),
        push=np.einsum("kij,kj->ki", J, acceleration),
        drift=drift,
        jacobian=J,
        rates=rates,
        acceleration=acceleration,
        inertia=H,
        bias=bias,
        exerted=exerted,
    )


def _joints(history: History, name: str, n: int) -> Vector:
    """(ticks, n) of all joints as they were measured."""
    columns = history.columns
    found = []
    for i in range(n):
        plain = f"joint.{i + 1}.{name}"
        found.append(columns[f"{plain}.measured" if f"{plain}.measured" in columns else plain])
    return np.column_stack(found)


def _last_step(q: Vector, v: Vector, period: float, steps: int) -> tuple[Vector, Vector, Vector]:
    """Positions, velocities and acceleration (n - 1, joints) of the last plant step of each tick.

    Positions are those of semi-implicit steps h: q' = q + h v', so the last one starts at
    q[k+1] - h v[k+1]. With several, the acceleration is taken to change linearly over the tick,
    which the velocities and positions at both of its ends decide.
    """
    h = period / steps
    after, mean = v[1:], np.diff(v, axis=0) / period
    if steps == 1:
        return q[:-1], v[:-1], mean
    count = steps
    moved = np.diff(q, axis=0) / h
    even = count * v[:-1] + h * mean * count * (count + 1) / 2
    slope = (even - moved) * 12.0 / (h * count * (count**2 - 1))
    last = mean + slope * (count - 1) / 2
    return q[1:] - h * after, after - h * last, last


def _whole(packed: Vector, n: int) -> Vector:
    """(k, n, n) symmetric matrices of their upper triangles (k, n (n + 1)/2), by columns."""
    H = np.zeros((len(packed), n, n))
    rows, columns = np.tril_indices(n)
    H[:, rows, columns] = packed
    H[:, columns, rows] = packed
    return H


class Readings:
    """What the controller measured of the wrench, and the axes in which the log has it.

    Attributes:
        values: (n, 6) what the environment exerts, NaN where the log has none [N, N m].
        axes: (n, 3, 3) in which it is, world.
        tip_axes: (n, 3, 3) of the tool at the tick.
        lever: (n, 3) from the tip to the point that moments are about, world [m].
        epoch: (n,) number of the tares before the tick.
        taring: (n,) whether the stage of the tick tares.
    """

    def __init__(self, program: Program, history: History) -> None:
        """Reads them of a log."""
        context = program.context
        n = len(history)
        stages = {stage.name: stage for stage in program.stages}
        replay = Replay(
            context.robot, context.frames, program.stages, history, context.moving_bases
        )
        self.values = np.full((n, 6), np.nan)
        self.axes, self.tip_axes = np.zeros((n, 3, 3)), np.zeros((n, 3, 3))
        self.epoch, self.taring = np.zeros(n, dtype=int), np.zeros(n, dtype=bool)
        self.lever = np.zeros((n, 3))
        tares = 0
        for visit in history.visits():
            plan = stages[visit.stage].plan
            self.tip_axes[visit.rows], self.axes[visit.rows] = replay.axes(plan.frame, visit.rows)
            self.epoch[visit.rows] = tares
            if plan.spec.tare:
                self.taring[visit.rows] = True
                tares += 1
            for axis in AXES:
                name = f"{axis.effort}.{axis}"
                # What was recorded elsewhere was measured: there is no truth beside it.
                found = history.columns.get(f"{name}.measured", history.columns.get(name))
                if axis in plan.axes and found is not None:
                    self.values[visit.rows, axis.row] = -found[visit.rows]
        self.lever[:] = replay.offset()

    @cached_property
    def present(self) -> NDArray[np.bool_]:
        """(n, 6) which of them there are."""
        placed = np.all(np.isfinite(self.axes), axis=(1, 2))
        return np.asarray(np.isfinite(self.values) & placed[:, np.newaxis])
