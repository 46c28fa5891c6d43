"""Springs whose stiffness varies so fast that nothing ensures that they settle."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from taskspec.expression import Expression, FloatAlgebra, evaluate
from taskspec.expression.series import Series, SeriesAlgebra
from taskspec.expression.tree import Name, walk
from taskspec.geometry.axis import PAIRS, entry_dimension
from taskspec.laws.gains import STIFFNESS, Gain, pairs_of
from taskspec.program.context import Context
from taskspec.program.plan import StagePlan
from taskspec.program.signals import constant
from taskspec.rules import Finding, Phase, rule, warning
from taskspec.stability.gain_paths import gain_path
from taskspec.text.units import scaled, show

Vector = NDArray[np.float64]

#: How far a stage without an end is examined [s], and at how many times at most.
_LONGEST, _TIMES = 60.0, 20_000
#: A stage of fewer ticks changes nothing.
_FEWEST = 3
#: At so many of them gains are designed anew, where they follow the stiffness.
_DESIGNS = 64


@rule("TS509", "a stiffness that rises faster than its damper settles it", phase=Phase.PATH)
def rising_stiffness(stage: StagePlan) -> Iterator[Finding]:
    """Stiffnesses that vary with time, against the condition of Kronander and Billard (2016).

    A mass h on a spring k(t) and a damper d(t) comes to rest, left alone, where an alpha <= d / h
    has k' + alpha d' <= 2 alpha k at all times, whatever e and e' are: then the function
    1/2 h (e' + alpha e)^2 + 1/2 (k + alpha d - alpha^2 h) e^2 falls. What such a spring puts in
    where something holds it stretched, 1/2 k' e^2, is for the run to say.
    """
    law = stage.law
    if law.control_law.selects or stage.joint_path is not None or law.tank is not None:
        return  # A tank pays for what a stiffness puts in.
    for on, gain in stage.gains.get("stiffness", {}).items():
        formula = gain.formula
        coupled = any(on in PAIRS[pair] for pair in pairs_of(stage.gains, "stiffness"))
        if formula is None or on in PAIRS or coupled or not _timed(stage.context, formula):
            continue
        most = min(stage.longest, _LONGEST)
        times = np.linspace(0.0, most, min(round(most / stage.context.period), _TIMES) + 1)
        k, k_rate = _course(stage, formula, times)
        if len(times) < _FEWEST or not np.min(k) > 0:
            continue  # What is not positive, TS218 reports.
        d, d_rate, h = _dampers(stage, on, times)
        alpha = float(np.min(d)) / h
        beyond = k_rate + alpha * d_rate - 2 * alpha * k
        if not np.max(beyond) > 0:
            continue
        # Of a periodic one the first time, whatever rounding makes of the others.
        worst = int(np.flatnonzero(beyond > (1 - 1e-6) * np.max(beyond))[0])
        dimension = entry_dimension(STIFFNESS.dimension, on)
        allowed = max(2 * alpha * k[worst] - alpha * d_rate[worst], 0.0)
        text = (
            f"the stiffness on {on!r} rises by {scaled(k_rate[worst], dimension, 3)} a second at "
            f"t = {show(times[worst], 's', 3)} of stage {stage.name!r}, and its damper makes up "
            f"for {scaled(allowed, dimension, 3)}: nothing ensures that it settles"
        )
        place = gain_path(stage.context, stage.name, "stiffness", on)
        yield warning("TS509", text, place, _REMEDY, unless=("TS218", "TS509"))


_REMEDY = "let it rise more slowly, or give more damping; `taskspec run` says what is gained"


def _timed(context: Context, formula: Expression) -> bool:
    """Whether an expression goes by the time of its stage alone."""
    names = {str(node): node for node in walk(formula.tree) if isinstance(node, Name)}
    of_time = names.pop("t", None) is not None
    return of_time and all(_number(context, node) is not None for node in names.values())


def _number(context: Context, name: Name) -> float | None:
    """The value of a name that stays what it is, None of another one."""
    known = constant(context, name)
    return None if known is None or known.low != known.high else known.low


def _course(stage: StagePlan, formula: Expression, times: Vector) -> tuple[Vector, Vector]:
    """(times,) values of an expression of t [SI], and their rates."""
    everywhere = np.ones(len(times), dtype=bool)

    def lookup(name: Name) -> Series:
        if str(name) == "t":
            return Series(times, everywhere)
        known = _number(stage.context, name)
        return Series.one(np.nan if known is None else known)

    values = evaluate(formula.tree, SeriesAlgebra(), lookup).values
    return values, np.gradient(values, times)


def _dampers(stage: StagePlan, on: str, times: Vector) -> tuple[Vector, Vector, float]:
    """(times,) of the damping on an axis and of its rate, and the least mass that it moves [SI]."""
    few = np.linspace(0.0, times[-1], _DESIGNS)
    found = [_designed(stage, on, float(t)) for t in few]
    damping = np.interp(times, few, [d.value for d, _ in found])
    return damping, np.gradient(damping, times), max(mass.value for _, mass in found)


def _designed(stage: StagePlan, on: str, t: float) -> tuple[Gain, Gain]:
    """Damping and mass on an axis at a time of the stage."""

    def start(name: Name) -> float:
        return t if str(name) == "t" else _number(stage.context, name) or 0.0

    def worth(formula: Expression) -> float:
        if _timed(stage.context, formula):
            return evaluate(formula.tree, FloatAlgebra(), start)
        return stage.gain_range.nominal(formula)

    gains = stage.design_rules.design(consistent=stage.consistent, worth=worth).gains
    none = Gain(0.0, "none")
    return gains.get("damping", {}).get(on, none), gains.get("mass", {}).get(on, Gain(1.0, "none"))
