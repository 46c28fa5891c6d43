"""How a press under the parallel PID regulator settles, beside the bound of Theorem 4.1."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from taskspec.control.regulator_bound import (
    ArmBounds,
    PressedContact,
    RegulatedAxis,
    RegulatorBound,
    RegulatorState,
    regulator_bound,
)
from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis
from taskspec.laws.gains import value_of
from taskspec.program.plan import StagePlan
from taskspec.program.world.stiffness import Compliance
from taskspec.robot.operational import SingularPoseError, operational_terms
from taskspec.text.units import LENGTH, show
from taskspec_runner.pages.numbers import figure
from taskspec_runner.record.history import Vector, Visit
from taskspec_runner.runs import RebuildError, Run

#: The law that Theorem 4.1 is about.
REGULATOR = "parallel-pid"
#: Set points are constant where they are this near to their last values [m, rad, N, N m].
_CONSTANT = {"position": 1e-9, "force": 1e-6, "torque": 1e-6}
#: Configurations at which the terms of the arm are evaluated, at most.
_SAMPLES = 50
#: Of a force that is one tick late, and whose torque is held for one, in ticks.
_LATE, _HELD = 1.5, 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Settling:
    """A part of a visit of a stage in which nothing but the regulator acts, and its bound.

    Attributes:
        stage: of the visit.
        rows: of the log, in which set points are constant and the tool touches.
        error: (k,) ||e||, e = x_E - x of (4.51) [m].
        bound: of Theorem 4.1, None where the gains do not satisfy its conditions.
    """

    stage: str
    rows: slice
    error: Vector
    bound: RegulatorBound | None

    @property
    def text(self) -> str:
        """The bound in words, and by what factor it is above the run."""
        if self.bound is None:
            return f"{self.stage}: no bound, the gains do not satisfy (4.70), (4.71)"
        region, rate = show(self.bound.region, LENGTH, 3), f"{figure(self.bound.rate)} 1/s"
        above = figure(self.bound.region / self.error[0], 2) if self.error[0] > 0 else ""
        begins = f", {above} times ||e|| at its start" if above else ""
        return f"{self.stage}: Phi exp(-r t) with Phi = {region}{begins}, r = {rate}"


def settlings(run: Run) -> Iterator[Settling]:
    """The parts of a run that Theorem 4.1 is about.

    That is where one translation presses under (4.50) on a spring, and all other references hold.
    Friction and what rotations do is not in the theorem.
    """
    if REGULATOR not in {visit.law for visit in run.visits}:
        return
    try:
        plans = {stage.name: stage.plan for stage in run.program.stages}
    except RebuildError:
        return
    for visit in run.history.visits():
        found = _settling(run, plans[visit.stage], visit)
        if found is not None:
            yield found


def _settling(run: Run, plan: StagePlan, visit: Visit) -> Settling | None:
    """The part of a visit at its end, if it has one."""
    pressing = [a for a, p in plan.plans.items() if p.force]
    if plan.law.kind != REGULATOR or len(pressing) != 1 or pressing[0].is_rotation:
        return None
    (normal,) = pressing
    contact = plan.contacts.of(normal)
    if contact is None or plan.frame.at_origin or not _is_recorded(run, plan, visit):
        return None
    rows = _constant_rows(run, plan, visit, normal)
    if rows is None:
        return None
    at = _State(run, plan, normal, plan.context.compliances[contact], rows)
    try:
        bound = at.bound()
    except SingularPoseError:
        return None
    return Settling(plan.name, rows, np.linalg.norm(at.error, axis=0), bound)


def _is_recorded(run: Run, plan: StagePlan, visit: Visit) -> bool:
    """Whether a log has all that the state is made of; what was measured elsewhere may lack it."""
    names = [f"{kind}.{a}" for a in plan.translations for kind in ("velocity", "error")]
    names += [f"joint.{i + 1}.position" for i in range(plan.context.robot.n)]
    names += [f"position.{a}.ref" for a, p in plan.plans.items() if p.motion]
    names += [f"force.{a}{end}" for a, p in plan.plans.items() if p.force for end in ("", ".ref")]
    columns = [run.column(name) for name in names]
    return all(c is not None and bool(np.isfinite(c[visit.rows]).all()) for c in columns)


def _constant_rows(run: Run, plan: StagePlan, visit: Visit, normal: Axis) -> slice | None:
    """The rows from which on nothing changes but what the regulator does; None for too few."""
    changed, columns = visit.first, run.columns
    names = [f"position.{a}" for a, p in plan.plans.items() if p.motion]
    for name in (*names, f"force.{normal}"):
        reference = columns[f"{name}.ref"][visit.rows]
        off = np.abs(reference - reference[-1]) > _CONSTANT[name.partition(".")[0]]
        if off.any():
            changed = max(changed, visit.first + int(np.flatnonzero(off)[-1]) + 1)
    apart = np.flatnonzero(columns[f"force.{normal}"][visit.rows] == 0)
    if len(apart):
        changed = max(changed, visit.first + int(apart[-1]) + 1)
    rows = slice(changed, visit.last + 1)
    return rows if rows.stop - rows.start >= _SAMPLES else None


class _State:
    """The state z of (4.59) along some rows of a log, and the gains of its closed loop."""

    def __init__(
        self, run: Run, plan: StagePlan, normal: Axis, contact: Compliance, rows: slice
    ) -> None:
        self._run, self._plan, self._rows = run, plan, rows
        self.axes = (normal, *(a for a in plan.translations if a != normal))
        columns, T = run.columns, run.period
        gain = {n: value_of(plan.gains, f"force.{n}", normal) for n in ("proportional", "integral")}
        k_F, k_I = gain["proportional"], gain["integral"]
        k_e, d_e = contact.stiffness, contact.damping
        self.contact = PressedContact(k_e, k_F, k_I)
        self.gains = [
            RegulatedAxis(k, value_of(plan.gains, "damping", a) - _HELD * T * k)
            for a in self.axes
            if (k := value_of(plan.gains, "stiffness", a)) is not None
        ]
        # The contact's damper, and the ticks by which the force loop is late, as far as they are of
        # first order: what acts on e' damps, what acts on the integral of e is a spring.
        first = self.gains[0]
        self.gains[0] = RegulatedAxis(
            first.stiffness + k_I * (d_e - _LATE * T * k_e),
            first.damping + (1 + k_F) * d_e - _LATE * T * k_F * k_e,
        )
        rates = [columns[f"velocity.{a}"][rows] for a in self.axes]
        pressed = columns[f"force.{normal}"][rows]
        wanted = columns[f"force.{normal}.ref"][rows]
        # The spring's force alone says how deep the tool is.
        normal_error = (wanted - pressed + d_e * rates[0]) / k_e
        self.error = np.array([normal_error, *(columns[f"error.{a}"][rows] for a in self.axes[1:])])
        self.rate = -np.array(rates)

    def bound(self) -> RegulatorBound | None:
        """The bound from the first row on."""
        rows, T = self._rows, self._run.period
        e, rate = self.error[0], self.rate[0]
        # w is zero at rest; at the last row the springs of (4.56) hold it, at no acceleration.
        first, k_e = self.gains[0], self.contact.stiffness
        stiff = first.stiffness + (1 + self.contact.proportional) * k_e
        held = (stiff * e[-1] + first.damping * rate[-1]) / (self.contact.integral * k_e)
        integral = -held - float(np.sum(e[1:] + e[:-1])) * T / 2
        start = RegulatorState(self.error[:, 0], self.rate[:, 0], integral)
        time = (rows.stop - rows.start) * T
        return regulator_bound(self.gains, self.contact, self._arm(), start, time)

    def _arm(self) -> ArmBounds:
        """Bounds of H_x and C_x over the configurations of these rows, rotations held."""
        rows = np.unique(np.linspace(self._rows.start, self._rows.stop - 1, _SAMPLES).astype(int))
        robot = self._plan.context.robot
        columns = [self._run.columns[f"joint.{i + 1}.position"][rows] for i in range(robot.n)]
        twin = robot.twin()
        terms = [operational_terms(twin, robot.axes, q) for q in np.stack(columns, axis=1)]
        masses = [each.masses() for each in terms]
        return ArmBounds(
            min(low for low, _ in masses),
            max(high for _, high in masses),
            max(each.coriolis_bound() for each in terms),
        )
