"""Searches that pass by what they look for."""

from __future__ import annotations

from collections.abc import Iterator

from taskspec.motion.paths.spiral import Spiral
from taskspec.program.plan import StagePlan
from taskspec.rules import Finding, rule, warning
from taskspec.shapes.hole import Hole
from taskspec.spec import FILE
from taskspec.text.units import LENGTH, scaled


@rule("TS331", "a search that is coarser than what it looks for")
def coarse_searches(stage: StagePlan) -> Iterator[Finding]:
    """Spirals whose turns are farther apart than a bore catches the peg.

    A cylinder of radius r goes into a bore of radius R with a chamfer c from R - r + c off its axis
    on. No point between two turns of a pitch p is farther than p/2 from one of them.
    """
    path = stage.path
    shape = None if stage.contacts.main is None else (
        stage.context.surfaces.get(stage.contacts.main)
    )  # fmt: skip
    tool = stage.context.loaded.task.robot.tool
    if path is None or not isinstance(path.form, Spiral) or not isinstance(shape, Hole):
        return
    if tool.shape != "cylinder" or tool.radius is None or tool.radius >= shape.radius:
        return
    caught = shape.radius - tool.radius + shape.chamfer
    pitch = path.form.pitch
    if pitch / 2 <= caught:
        return
    name = stage.contacts.main
    yield warning(
        "TS331",
        f"the turns of this spiral are {scaled(pitch, LENGTH, 3)} apart, and {name!r} catches the "
        f"tool within {scaled(caught, LENGTH, 3)} of its axis: the search may pass it by",
        FILE.stages[stage.name].path.spiral.pitch,
        f"a pitch of {scaled(2 * caught, LENGTH, 2)} or less, or a chamfer on the bore",
    )
