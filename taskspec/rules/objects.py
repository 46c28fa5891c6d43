"""Objects of the world: numbers that are off by a thousand, and contacts that are too stiff."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from taskspec.program.axes import MOSTLY
from taskspec.program.plan import StagePlan, TaskPlan
from taskspec.program.world.stiffness import RESOLVED_PHASE
from taskspec.rules import Finding, Phase, error, rule, warning
from taskspec.shapes.mesh import UNITS, Mesh
from taskspec.shapes.round_patch import RoundPatch
from taskspec.spec import FILE
from taskspec.text.units import show

#: Rubber on dry concrete has about 1, soft rubber on glass 2.
_ROUGHEST = 2.0
#: A contact that gives way by more than this is none that the laws are meant for [m].
_DEEPEST = 0.05
#: Largest extents of parts that arms of a few kilograms work on [m].
_SMALLEST_PART, _LARGEST_PART = 2e-3, 5.0


@rule("TS129", "a number that is hardly meant", phase=Phase.TASK)
def implausible_friction(task: TaskPlan) -> Iterator[Finding]:
    """Coefficients of friction that no surfaces have."""
    for name, shape in task.context.loaded.task.shapes.items():
        if shape.friction > _ROUGHEST:
            yield warning(
                "TS129",
                f"a coefficient of friction of {shape.friction:g}: dry rubber has about 1",
                FILE.world[name].friction,
                "it is a plain number, such as 0.2; a percentage takes its sign: 20 %",
            )


@rule({}, also=("TS129",), phase=Phase.AXES)
def implausible_depth(stage: StagePlan) -> Iterator[Finding]:
    """A force that deforms its contact farther than contacts give way."""
    for axis, entry in stage.spec.axes.items():
        contact = stage.contacts.of(axis) if axis in stage.axes else None
        force = None if axis.is_rotation else entry.set_point
        if contact is None or contact not in stage.context.compliances or force is None:
            continue
        wanted = stage.known(force.wanted)
        if wanted is None:
            continue
        stiffness = stage.context.compliances[contact].stiffness
        depth = abs(wanted) / stiffness
        if (
            abs(stage.kinematics.along(axis, stage.contacts.normal(contact))) < MOSTLY
            or depth < _DEEPEST
        ):
            continue
        yield warning(
            "TS129",
            f"{show(abs(wanted), 'N')} on a stiffness of {show(stiffness, 'N/m')} deform "
            f"{contact!r} by {show(depth, 'mm', 3)}",
            FILE.world[contact].stiffness,
            "steel on a table is some 100 kN/m, rubber 10 kN/m, foam 1 kN/m; mind the k of kN/m",
            unless=("TS129",),
        )


@rule("TS330", "a bore that its block has no room for", phase=Phase.TASK)
def bore_in_block(task: TaskPlan) -> Iterator[Finding]:
    """Holes that reach the sides or the bottom of their block."""
    for name, shape in task.context.loaded.task.shapes.items():
        sizes = shape.sizes
        if shape.shape != "hole" or "size" not in sizes:
            continue
        wide = 2 * (sizes["radius"] + sizes.get("chamfer", 0.0))
        needed = (("wide", wide), ("long", wide), ("high", sizes["depth"]))
        for (what, least), given in zip(needed, sizes["size"], strict=True):
            if given <= least:
                of = "bore with its chamfer" if what != "high" and "chamfer" in sizes else "bore"
                yield error(
                    "TS330",
                    f"the {of} of {name!r} takes {show(least, 'mm')} of a block that is "
                    f"{show(given, 'mm')} {what}",
                    FILE.world[name].size,
                    "take a larger block, or leave 'size' out for an endless plate",
                )
                break


@rule("TS332", "a tool that does not fit an object", phase=Phase.TASK, bars=True)
def tool_fits(task: TaskPlan) -> Iterator[Finding]:
    """Tools that a hollow has no room for, and flat ones on what a ball alone touches."""
    tool = task.context.robot.tool
    for name, surface in task.context.surfaces.items():
        hollow = surface if isinstance(surface, RoundPatch) and surface.within else None
        if tool.flat and (hollow or isinstance(surface, Mesh)):
            what = "the inside of a bowl or tube" if hollow else "a mesh"
            yield error(
                "TS332",
                f"the tool ends in a flat face, and {name!r} is {what}: of that only the contact "
                "of a ball is modelled, in one point",
                FILE.robot.tool.shape,
                "take a sphere as the tool's end, as large as the face or edge is round where it "
                "touches",
            )
        elif hollow and not tool.flat and hollow.radius <= (ball := float(tool.radii[0])):
            yield error(
                "TS332",
                f"a ball of {show(ball, 'mm')} has no room in {name!r}, whose radius is "
                f"{show(hollow.radius, 'mm')}",
                FILE.world[name].radius,
                "take a smaller tool, or a wider bowl or tube",
            )


@rule({}, also=("TS129",), phase=Phase.TASK)
def implausible_mesh(task: TaskPlan) -> Iterator[Finding]:
    """Meshes of a size that tells of another unit."""
    for name, surface in task.context.surfaces.items():
        if not isinstance(surface, Mesh):
            continue
        extents = np.ptp(surface.body.corners, axis=0)
        if _SMALLEST_PART < extents.max() < _LARGEST_PART:
            continue
        x, y, z = (show(float(e), "m" if e > 1 else "mm", 3) for e in extents)
        unit = task.context.loaded.task.shapes[name].sizes["unit"]
        yield warning(
            "TS129",
            f"in {unit!r} {name!r} is {x} by {y} by {z}",
            FILE.world[name].unit,
            f"its file may be in another unit: {', '.join(u for u in UNITS if u != unit)}",
        )


@rule("TS307", "a contact stiffer than the plant's steps resolve", phase=Phase.TASK)
def unresolved_stiffness(task: TaskPlan) -> Iterator[Finding]:
    """Contacts that the plant's steps do not resolve."""
    for name, contact in task.context.compliances.items():
        if contact.phase > RESOLVED_PHASE:
            most = contact.stiffness * (RESOLVED_PHASE / contact.phase) ** 2
            yield warning(
                "TS307",
                f"{name!r} is stiffer than the plant's steps resolve: up to "
                f"{show(most, 'kN/m', 3)} on this arm at this rate",
                FILE.world[name].stiffness,
                "raise control.plant_rate, or write `rigid`",
            )
