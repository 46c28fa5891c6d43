"""The design of a stage that holds a mechanism: its rules, held against its own sampled loop."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from taskspec.laws.gains import BANDWIDTH, Gain, Gains
from taskspec.laws.law import gain_named
from taskspec.program.plan import Design, StagePlan
from taskspec.program.stages.stage import CompiledStage, compile_stage
from taskspec.stability.loop import Mode, UnfitError
from taskspec.stability.margin import grows, near_boundary, rings
from taskspec.stability.sampled_stage import analyse
from taskspec.text.diagnostic import SpecError

#: Where every form is unstable as the rules have it, designed gains are made softer by these
#: factors, then stiffer; at last one gain after the other.
_FACTORS = (0.5, 0.25, 0.125, 2.0, 4.0)
#: Gains that make a loop quick, with the power of the factor; an apparent mass makes it slow.
_POWERS = {
    "force.integral": 1,
    "stiffness": 1,
    "mass": -1,
    "bandwidth": 1,
    "K_P": 2,
    "K_D": 1,
}


def best_design(stage: StagePlan) -> Design:
    """The first design of a stage whose sampled loop is quiet, else the best of them.

    Tried are the law's own form and that for a mechanism, as the rules have them, and while every
    one is unstable or about to be, the same with other factors on designed gains. Gains that vary,
    and what follows from them, are those of the rules.
    """
    first = stage.by_rules()
    if stage.law.varying:
        return first
    best: tuple[tuple[int, float], Design] | None = None
    forms: dict[bool, CompiledStage] = {}
    try:
        for design, only_if in _designs(stage, first):
            if best is not None and best[0][0] < only_if:
                break
            plan, form = stage.designed_as(design), design.consistent
            # Gains are parameters, and none that is zero becomes another.
            forms[form] = replace(forms[form], plan=plan) if form in forms else compile_stage(plan)
            loop = analyse(forms[form])
            if loop is None:
                continue
            worst = _worst(loop.modes())
            if best is None or worst < best[0]:
                best = worst, Design(design.gains, design.consistent, loop)
    except (UnfitError, SpecError, np.linalg.LinAlgError):
        pass
    return first if best is None else best[1]


def _designs(stage: StagePlan, first: Design) -> Iterator[tuple[Design, int]]:
    """Designs in the order in which they are tried, and how bad the best must be for the next."""
    forms = [first]
    if stage.design_rules.has_mechanism_form:
        forms.append(stage.design_rules.design(consistent=True))
        if stage.design_rules.cancels_late >= 1:
            # A pose away it flips, if it does not here.
            forms.reverse()
    for form in forms:
        yield form, 1
    for factor in _FACTORS:
        for form in forms:
            scaled = _scaled(form.gains, factor)
            if scaled != form.gains:
                yield Design(scaled, form.consistent), 2
    for name in (*_POWERS, "damping_ratio", "damping", "force.damping", "joint_damping"):
        for factor in (0.25, 4.0):
            for form in forms:
                scaled = _scaled(form.gains, factor, name)
                if scaled != form.gains:
                    yield Design(scaled, form.consistent), 2


def _scaled(gains: Gains, factor: float, of: str = "") -> Gains:
    """The same gains, with those stiffer by a factor that rules have designed.

    Args:
        gains: of a stage.
        factor: on how quick the loops are.
        of: a gain that is moved alone, with what follows from it; "" for all that make them quick.
    """
    found: Gains = {}
    powers = _POWERS if not of else gain_named(of).powers or {of: 1}
    for name, by in gains.items():
        times = factor ** powers.get(name, 0)
        origins = gains["bandwidth"] if name in BANDWIDTH.powers else by
        found[name] = {
            axis: gain
            if times == 1 or "file" in (gain.origin, origins[axis].origin) or gain.value == 0
            else Gain(gain.value * times, f"{gain.origin}, {times:g} times that")
            for axis, gain in by.items()
        }
    return found


def _worst(modes: tuple[Mode, ...]) -> tuple[int, float]:
    """How bad a loop is: whether it is near growing (2) or rings (1), and how fast it is [1/s]."""
    grown = any(grows(mode) or near_boundary(mode) for mode in modes)
    kind = 2 if grown else 1 if any(map(rings, modes)) else 0
    return kind, max((mode.s.real for mode in modes), default=-np.inf)
