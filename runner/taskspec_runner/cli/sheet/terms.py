"""Terms of operational space along a stage, for `explain --terms`: (4.8) to (4.11), (4.71)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.laws.gains import value_of
from taskspec.program.program import Program
from taskspec.program.stages.stage import CompiledStage
from taskspec.robot.operational import OperationalTerms, SingularPoseError, operational_terms
from taskspec.text.units import DAMPING, INERTIA, LENGTH, scaled, show
from taskspec_runner.trial.trial import Trial

Vector = NDArray[np.float64]

#: Configurations of a visit at which the terms are evaluated, at most.
_SAMPLES = 50


@dataclass(frozen=True, slots=True)
class TermsSheet:
    """The terms of a stage over the configurations of its trial, or at the start pose.

    Attributes:
        where: over which configurations.
        masses: lambda_m and lambda_M of translations while the rotations are held [kg].
        moments: the same of rotations while translations are held [kg m^2]; zeros without any.
        coriolis: k_Cx of translations [kg/m], the largest.
        axes: of the matrices, world axes.
        inertia: (m, m) H_x at the first of them [kg, kg m, kg m^2].
        gravity: (m,) g_x there [N, N m].
        region: Phi of (4.65), the farthest of the tip from where the stage ends [m].
        damping: d_m [N s/m] of a regulator that (4.71) is about, and what it has to be more than.
    """

    where: str
    masses: tuple[float, float]
    moments: tuple[float, float]
    coriolis: float
    axes: tuple[str, ...]
    inertia: tuple[tuple[float, ...], ...]
    gravity: tuple[float, ...]
    region: float
    damping: tuple[float, float] | None

    @property
    def rows(self) -> tuple[tuple[str, str], ...]:
        """In words."""
        found = [
            ("terms", self.where),
            ("H_x", f"{_range(self.masses, 'kg')} along translations, rotations held (4.10)"),
        ]
        if any(self.moments):
            moments = " to ".join(scaled(each, INERTIA) for each in self.moments)
            found.append(("", f"{moments} about rotations, translations held"))
        carried = zip(self.axes, self.gravity, strict=True)
        forces = ", ".join(f"{show(g, 'N', 3)} along {a}" for a, g in carried if "r" not in a)
        found.append(("g_x", f"{forces} at first (4.9)"))
        found.append(("C_x", f"|C_x v| <= {show(self.coriolis, 'kg/m', 3)} |v|^2 (4.11)"))
        if self.damping is not None:
            has, needs = (scaled(each, DAMPING) for each in self.damping)
            verdict = "holds" if self.damping[0] > self.damping[1] else "does not hold"
            region = scaled(self.region, LENGTH)
            found.append(
                ("(4.71)", f"{verdict}: d_m = {has}, rho (lambda_M + Phi k_Cx) = {needs}, "
                           f"Phi = {region} (4.65)")
            )  # fmt: skip
        return tuple(found)


def terms_sheet(program: Program, stage: CompiledStage, trial: Trial | None) -> TermsSheet | str:
    """The terms of a stage, or why there are none.

    Args:
        program: the compiled task.
        stage: of it.
        trial: of the program; None for the terms at the start pose.
    """
    robot = program.context.robot
    visits = [] if trial is None else [v for v in trial.history.visits() if v.stage == stage.name]
    configurations = [_configurations(trial, v.first, v.last, robot.n) for v in visits if trial]
    if not configurations:
        if trial is not None:
            return "the trial does not come to this stage"
        configurations = [program.context.start[None]]
    twin, reached = robot.twin(), np.concatenate(configurations)
    try:
        terms = [operational_terms(twin, robot.axes, q) for q in reached]
    except SingularPoseError as error:
        return str(error)
    tips = [np.array([twin.tip(q).translation for q in each]) for each in configurations]
    region = max(float(np.linalg.norm(each - each[-1], axis=1).max()) for each in tips)
    return TermsSheet(
        where=f"over {len(terms)} configurations of the trial" if visits else "at the start pose",
        masses=_bounds(terms, angular=False),
        moments=_bounds(terms, angular=True),
        coriolis=max(each.coriolis_bound() for each in terms),
        axes=tuple(str(axis) for axis in terms[0].axes),
        inertia=tuple(tuple(row) for row in terms[0].inertia.tolist()),
        gravity=tuple(terms[0].gravity.tolist()),
        region=region,
        damping=_regulator(stage, terms, region),
    )


def _configurations(trial: Trial, first: int, last: int, n: int) -> Vector:
    """(k, n) coordinates of some ticks of a visit, its first and its last among them."""
    rows = np.unique(np.linspace(first, last, _SAMPLES).astype(int))
    columns = trial.history.columns
    return np.stack([columns[f"joint.{i + 1}.position"][rows] for i in range(n)], axis=1)


def _bounds(terms: list[OperationalTerms], *, angular: bool) -> tuple[float, float]:
    found = [each.masses(angular=angular) for each in terms]
    return min(low for low, _ in found), max(high for _, high in found)


def _regulator(
    stage: CompiledStage, terms: list[OperationalTerms], region: float
) -> tuple[float, float] | None:
    """d_m of the law (4.50), and rho (lambda_M + Phi k_Cx), with the least rho of (4.70)."""
    plan = stage.plan
    forces = [a for a, p in plan.plans.items() if p.force and not a.is_rotation]
    if plan.law.kind != "parallel-pid" or not forces:
        return None
    integral, proportional = (
        [value_of(plan.gains, f"force.{name}", a) for a in forces]
        for name in ("integral", "proportional")
    )
    rho = max(k_I / (1 + k_F) for k_I, k_F in zip(integral, proportional, strict=True))
    least = min(value_of(plan.gains, "damping", a) for a in plan.translations)
    needed = max(each.masses()[1] + region * each.coriolis_bound() for each in terms)
    return least, rho * needed


def _range(both: tuple[float, float], unit: str) -> str:
    return f"{show(both[0], unit, 3)} to {show(both[1], unit, 3)}"
