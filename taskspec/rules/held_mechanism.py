"""Motions against the mechanism whose handle the robot holds."""

from __future__ import annotations

from collections.abc import Iterator

from taskspec.program.plan import StagePlan
from taskspec.program.walk.held_motion import held_motion
from taskspec.rules import Finding, rule, warning
from taskspec.spec import FILE, key_of
from taskspec.text.units import VELOCITY, show

#: Slower than this is the rounding of a mechanism that stands still [m/s, rad/s].
_NOTHING = 1e-9


@rule("TS322", "a motion that the mechanism does not allow", predicts=("TS322",))
def motions_against_a_mechanism(stage: StagePlan) -> Iterator[Finding]:
    """Constant rates that the held mechanism does not allow."""
    held = stage.context.held
    if not held:
        return
    if stage.path is not None or not stage.law.control_law.selects:
        return
    motion = held_motion(stage)
    axis = None if motion is None else motion.contradicted
    if motion is None or axis is None:
        return
    rate = motion.rates[axis]
    unit = axis.of(VELOCITY)
    has = motion.allowed(axis)
    has = has if abs(has) > _NOTHING else 0.0
    does = f"is to move with {show(rate, unit, 3)}" if rate else "is held"
    axes = FILE.stages[stage.name].axes
    first = list(motion.rates)[motion.moved[0]]
    yield warning(
        "TS322",
        f"{axis!r} {does}, and {held!r} lets it move with {show(has, unit, 3)} where the "
        "run begins: the arm works against the grip",
        key_of(axes[axis if axis in stage.spec.axes else first]),
        f"let it give way: {axis}: {{{axis.effort}: 0}}",
        unless=("TS232",),
        unless_at=axes[axis],
    )
