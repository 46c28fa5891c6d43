"""Limits that nothing keeps."""

from __future__ import annotations

from taskspec.program.context import Context
from taskspec.spec import FILE, key_of
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics

register({"TS214": "a limit that nothing keeps"})


def check_limits(context: Context, name: str, found: Diagnostics) -> None:
    """Reports a limit on the torques' rate in a stage whose torques are a closed form's."""
    task = context.loaded.task
    stage = task.stages[name]
    if context.law_of(stage).solve == "qp" or context.limits_of(stage).torque_rate is None:
        return
    own = stage.limits is not None and stage.limits.torque_rate is not None
    owner = FILE.stages[name].limits if own else FILE.limits
    place = context.loaded.span(key_of(owner.torque_rate))
    if found.says("TS214", place):
        return  # The file's limits are those of several stages.
    found.error(
        "TS214",
        f"nothing keeps 'torque_rate' in stage {name!r}: its torques are those of a closed form",
        place,
        "solve the law by a program that keeps it, as in 'law: {kind: hybrid, solve: qp}'",
    )
