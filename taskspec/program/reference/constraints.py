"""The constraints of a stage under a multiplier law: its force axes and the world's equations.

A force axis of the task frame is the constraint that the surface there imposes; an equation of the
world is one whether or not the stage gives it a set point, if it holds in both directions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.control import linear
from taskspec.control.reference import Reference, opposite
from taskspec.control.resolution import inverse_directions
from taskspec.control.state import ARM_LENGTH, TaskState
from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis
from taskspec.laws.gains import AxisPlant, Gains
from taskspec.laws.servo_loop import Contact
from taskspec.program.context import Context
from taskspec.program.slots import Slots
from taskspec.program.world.equations import EquationModel, EquationTerms
from taskspec.robot.model_terms import TermSymbols
from taskspec.spec import Law, Stage
from taskspec.spec.law import Worth

#: How far a stage may go along a curved equation for which gains are designed [m].
_WAY = 0.5


@dataclass(frozen=True, slots=True)
class EquationRow:
    """An equation at this instant, on the joints.

    Attributes:
        model: the equation.
        terms: at the tip or the joints.
        J: (1, n) unit normal on the joints' rates.
        gamma: what J q'' has to cancel.
        closing: J q' + r_t [m/s, rad/s].
    """

    model: EquationModel
    terms: EquationTerms
    J: ca.SX
    gamma: ca.SX
    closing: ca.SX


def equation_rows(
    models: Mapping[str, EquationModel], terms: TermSymbols, q: ca.SX, v: ca.SX, clock: ca.SX
) -> dict[str, EquationRow]:
    """All equations of the world, by name, for the tip's kinematics in the world."""
    rows = {}
    for name, model in models.items():
        rate = model.rate(v, terms.twist)
        at = model.terms(model.place(q, terms.p, terms.R), clock, rate)
        if model.joints:
            J, gamma = at.normal, at.drift
        else:
            J = at.normal @ terms.J[model.on, :]
            gamma = at.drift + at.normal @ terms.drift[model.on]
        rows[name] = EquationRow(model, at, J, gamma, J @ v + at.by_time)
    return rows


def reactions(rows: Mapping[str, EquationRow], wrench: ca.SX, sensed: ca.SX) -> dict[str, ca.SX]:
    """The force of the robot along each equation's unit gradient, as measured [N, N m].

    On the tip it is the part of the measured force that the normals span, or of the measured wrench
    where one of them is on its rotation too; on joints what is sensed there.

    Args:
        rows: the equations.
        wrench: (6,) by the environment on the tip.
        sensed: (equations,) applied by the robot, of which those on joints count.
    """
    found = {name: sensed[i] for i, (name, row) in enumerate(rows.items()) if row.model.joints}
    tip = [name for name, row in rows.items() if not row.model.joints]
    turns = any(rows[name].model.turns for name in tip)
    if tip:
        N = ca.vertcat(*(_on_tip(rows[name], turns) for name in tip))
        # Moments count as forces at an arm's length, so that the sum of squares has one unit.
        scale = ca.DM([1.0] * 3 + [1.0 / ARM_LENGTH] * (3 if turns else 0))
        parts = spread(N @ ca.diag(scale) if turns else N, opposite(wrench[: N.shape[1]]) * scale)
        found |= {name: parts[i] for i, name in enumerate(tip)}
    return found


def _on_tip(row: EquationRow, turns: bool) -> ca.SX:
    """(1, 3) a unit gradient on the tip, (1, 6) if another one is on its rotation."""
    normal = row.terms.normal
    return ca.horzcat(normal, ca.SX(1, 3)) if turns and not row.model.turns else normal


def spread(N: ca.SX, wrench: ca.SX) -> ca.SX:
    """Multipliers (m,) with N^T lambda = wrench, in the sense of least squares; N (m, d)."""
    return linear.small_solve(N @ N.T, N @ wrench)


def active_equations(
    law: Law, stage: Stage, models: Mapping[str, EquationModel]
) -> tuple[str, ...]:
    """Names of the equations that constrain a stage; none under a law without multipliers."""
    if not law.control_law.multipliers:
        return ()
    return tuple(
        name
        for name, model in models.items()
        if name in stage.constraints or model.constraint.relation == "="
    )


def equation_gains(
    context: Context,
    law: Law,
    names: Sequence[str],
    models: Mapping[str, EquationModel],
    worth: Worth,
) -> Gains:
    """Gains of the equations' force loops, by gain and equation."""
    gains: Gains = {}
    share = _held_share(context, names)
    for name in names:
        model, normals = models[name], _normals(context, name)
        inverse = (normals * np.linalg.solve(context.start_inertia, normals)).sum(0)
        timing, given = context.drives.timing, context.compliances[name]
        h = 1.0 / inverse.max() if inverse.max() > 0 else 1.0
        contact = Contact(given.stiffness, given.damping)
        plant = AxisPlant(
            h=h,
            held=share[name] / inverse.min() if inverse.min() > 0 else 1.0,
            k=given.stiffness,
            period=context.period,
            servo=None if timing is None else timing.along(h, contact),
        )
        for gain, value in law.design_equation(model.angular, plant, worth).items():
            gains.setdefault(gain, {})[name] = value
    return gains


def _held_share(context: Context, names: Sequence[str]) -> dict[str, float]:
    """By how much more mass the arm has along each equation at the start while the others hold."""
    normals = np.array([context.start_equations[name].normal for name in names])
    if not names:
        return {}
    mobility = normals @ np.linalg.solve(context.start_inertia, normals.T)
    found = np.diag(np.linalg.pinv(mobility)) * np.diag(mobility)
    return {name: max(float(share), 1.0) for name, share in zip(names, found, strict=True)}


def _normals(context: Context, equation: str) -> NDArray[np.float64]:
    """(n, k) unit normals on the joints' rates that an equation may come to have along a stage.

    Along a curved one the arm is lighter in some directions than in others: its gains are those of
    the lightest, so that the loop is as stable along the whole stage as where it begins.
    """
    at = context.start_equations[equation]
    if at.gradient is None:
        return at.normal[:, None]
    return context.start_jacobian[:3].T @ at.gradients_within(_WAY)


@dataclass(frozen=True, slots=True)
class ConstraintSet:
    """The m constraints of a stage, force axes first.

    Attributes:
        names: axes, then equations.
        J: (m, n).
        gamma, closing: (m,).
        measured: (m,) applied by the robot [N, N m].
        candidates: (n, c) joint accelerations of the c generalised coordinates: the task axes, and
            on a redundant arm with equations on joints also its inner motions.
        weights: (c,) how readily each yields; scaled to metres.
        selection: (c, m) which of them are eliminated; a parameter.
    """

    names: tuple[str, ...]
    J: ca.SX
    gamma: ca.SX
    closing: ca.SX
    measured: ca.SX
    candidates: ca.SX
    weights: NDArray[np.float64]
    selection: ca.SX

    @property
    def directions(self) -> ca.SX:
        """(n, m) the directions of the eliminated coordinates, T E_1^T."""
        return self.candidates @ self.selection

    @property
    def conditioning(self) -> ca.SX:
        """The minor, relative to the one after the best exchange of one coordinate.

        1 where no exchange makes it larger, 0 where it is singular.
        """
        scaled = self.J @ self.candidates @ ca.diag(ca.DM(self.weights))
        gains = ca.fabs(linear.small_solve(scaled @ self.selection, scaled))
        return 1 / ca.mmax(gains)


#: How readily a coordinate yields to a constraint: a force axis before one that the file does
#: not name, and that before one whose motion it commands.
FORCED, UNNAMED, NAMED = 100.0, 10.0, 1.0


def weigh(axes: Sequence[Axis], named: Sequence[str], forced: Sequence[str]) -> list[float]:
    """Weights of the task axes."""
    return [
        (FORCED if a in forced else NAMED if a in named else UNNAMED)
        / (ARM_LENGTH if a.is_rotation else 1.0)
        for a in axes
    ]


def constraint_set(
    *,
    state: TaskState,
    forced: Sequence[Axis],
    named: Sequence[str],
    rows: Mapping[str, EquationRow],
    measured: Mapping[str, ca.SX],
    references: Reference,
    parameters: Slots,
) -> ConstraintSet | None:
    """The constraints of a stage; None where it has none.

    Args:
        state: the arm on the task axes.
        forced: its force axes.
        named: axes that the file names.
        rows: the equations that constrain the stage.
        measured: reaction of each of them.
        references: whose velocity and acceleration on force axes are those of the frame itself.
        parameters: where the selection takes its slot.
    """
    force_rows = state.rows(forced)
    tip = [name for name, row in rows.items() if not row.model.joints]
    names = (*forced, *rows)
    if not names:
        return None
    J = ca.vertcat(state.J[force_rows, :], *(row.J for row in rows.values()))
    along = state.drift - references.acceleration
    relative = state.velocity - references.velocity
    gamma = ca.vertcat(along[force_rows], *(row.gamma for row in rows.values()))
    closing = ca.vertcat(relative[force_rows], *(row.closing for row in rows.values()))
    candidates = inverse_directions(state)
    weights = weigh(state.axes, named, forced)
    n = state.J.shape[1]
    if n > len(state.axes) and len(tip) < len(rows):
        inner = ca.SX.eye(n) - candidates @ state.J
        candidates = ca.horzcat(candidates, inner)
        weights += [UNNAMED / ARM_LENGTH] * n
    c, m = candidates.shape[1], len(names)
    return ConstraintSet(
        names=names,
        J=J,
        gamma=gamma,
        closing=closing,
        measured=_measured(state, forced, rows, tip, measured),
        candidates=candidates,
        weights=np.array(weights),
        selection=ca.reshape(parameters.add("selection", c * m), c, m),
    )


def joint_constraint_set(
    rows: Mapping[str, EquationRow],
    measured: Mapping[str, ca.SX],
    turns: Sequence[bool],
    parameters: Slots,
) -> ConstraintSet | None:
    """The constraints of a stage with a path of joints, which decide about joints; None without.

    Args:
        rows: the equations that constrain the stage.
        measured: reaction of each of them.
        turns: which joints are hinges.
        parameters: where the selection takes its slot.
    """
    if not rows:
        return None
    n = len(turns)
    return ConstraintSet(
        names=tuple(rows),
        J=ca.vertcat(*(row.J for row in rows.values())),
        gamma=ca.vertcat(*(row.gamma for row in rows.values())),
        closing=ca.vertcat(*(row.closing for row in rows.values())),
        measured=ca.vertcat(*(measured[name] for name in rows)),
        candidates=ca.SX.eye(n),
        weights=np.array([NAMED / (ARM_LENGTH if turn else 1.0) for turn in turns]),
        selection=ca.reshape(parameters.add("selection", n * len(rows)), n, len(rows)),
    )


def _measured(
    state: TaskState,
    forced: Sequence[str],
    rows: Mapping[str, EquationRow],
    tip: Sequence[str],
    measured: Mapping[str, ca.SX],
) -> ca.SX:
    """(m,) what the robot applies along each constraint, shared out between those on the tip."""
    axes = opposite(state.f[state.rows(forced)])
    if not (forced and tip):
        return ca.vertcat(axes, *(measured[name] for name in rows))
    normals = ca.vertcat(*(rows[name].J for name in tip))
    # Each row is a combination of the task axes, found again through J^bar.
    on_axes = ca.vertcat(
        ca.SX.eye(len(state.axes))[state.rows(forced), :], normals @ inverse_directions(state)
    )
    parts = spread(on_axes, opposite(state.f))
    shared = {name: parts[len(forced) + i] for i, name in enumerate(tip)}
    return ca.vertcat(parts[: len(forced)], *(shared.get(name, measured[name]) for name in rows))
