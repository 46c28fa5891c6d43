"""Estimates of a contact's stiffness that nothing follows, or that cannot be made."""

from __future__ import annotations

from collections.abc import Iterator

from taskspec.laws.contact_stiffness import UNKNOWNS
from taskspec.program.plan import StagePlan
from taskspec.rules import Finding, Phase, error, rule, warning
from taskspec.spec import FILE, below
from taskspec.stability.gain_paths import law_path
from taskspec.text.units import STIFFNESS, scaled, show


@rule(
    {
        "TS347": "a declared stiffness outside of the bounds of its estimate",
        "TS348": "an axis along which no stiffness can be estimated",
    },
    also=("TS139",),
    phase=Phase.MOTION,
)
def stiffness_estimates(stage: StagePlan) -> Iterator[Finding]:
    """Force axes of a stage under a law that estimates the stiffness of its contact."""
    estimate, estimates = stage.law.estimate, stage.estimates
    if estimate is None or stage.joint_path is not None:
        return
    place = below(law_path(stage.context, stage.name), "estimate")
    forces = [a for a, plan in stage.plans.items() if plan.force and not a.is_rotation]
    if forces and not estimates.named:
        names = " and ".join(stage.law.control_law.follows)
        text = f"no gain of {forces[0]!r} follows the stiffness that is estimated: "
        text += f"{names} are given"
        hint = f"leave one of them out, or the estimate; {names} would follow"
        yield error("TS139", text, place, hint, unless=("TS139",))
        return
    if forces and estimate.memory < UNKNOWNS * stage.context.period:
        remembered, period = (show(t, "ms", 2) for t in (estimate.memory, stage.context.period))
        yield error(
            "TS348",
            f"a memory of {remembered} holds fewer readings, one each {period}, than the "
            f"{UNKNOWNS} numbers that are estimated of them",
            below(place, "memory"),
            "tens of periods and more, such as 200 ms",
            unless=("TS348",),
        )
        return
    for axis in estimates.named:
        where = FILE.stages[stage.name].axes[axis].force
        if reason := estimates.refused(axis):
            text = f"the stiffness along {axis!r} cannot be estimated: {reason}"
            yield error("TS348", text, where, "give this stage a law without 'estimate'",
                        unless=("TS348",))  # fmt: skip
            continue
        k, (low, high) = stage.environment.by_axis[axis], estimate.stiffness
        if not low <= k <= high:
            name = stage.contacts.of(axis)
            bounds = f"{scaled(low, STIFFNESS, 3)} to {scaled(high, STIFFNESS, 3)}"
            yield warning(
                "TS347",
                f"{name!r} is declared with {scaled(k, STIFFNESS, 3)}, outside of the {bounds} "
                "within which its stiffness is estimated: gains begin with those of the nearer end",
                place,
                "let the bounds hold the declared stiffness too",
                unless=("TS347",),
            )
