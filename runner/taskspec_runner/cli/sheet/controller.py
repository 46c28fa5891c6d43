"""What the controller makes of encoders and of the joints' friction, for `explain`."""

from __future__ import annotations

from collections.abc import Iterator

from taskspec.program.context import Context
from taskspec.program.velocity_estimate import VelocityEstimate


def controller_rows(context: Context) -> Iterator[tuple[str, str]]:
    """Pairs of what and how; none where velocities are measured and friction is left alone."""
    task = context.loaded.task
    estimate = VelocityEstimate.of(task.control.velocity, context.period)
    if estimate is not None:
        encoder = task.robot.encoder
        yield from estimate.rows(() if encoder is None else encoder.resolution)
    if context.friction is not None:
        yield from context.friction.rows()
