"""Open-loop forces: what becomes of them where the real surface differs from the nominal one."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from taskspec.check.contact.set_points import steady_force
from taskspec.geometry.axis import AXES, Axis
from taskspec.laws.gains import value_of
from taskspec.motion.path import PathShape
from taskspec.program.context import Context
from taskspec.program.reference.axis_plan import plan_axes
from taskspec.spec import FILE, AxisEntry, Variation
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics

register(
    {
        "TS303": "a force without a surface to press on",
        "TS304": "an open-loop force that `vary` makes vague",
        "TS306": "an open-loop force on an axis without a spring",
    }
)


def check_forces(
    context: Context,
    name: str,
    axes: tuple[Axis, ...],
    rotation: NDArray[np.float64],
    path: PathShape | None,
    found: Diagnostics,
) -> None:
    """Reports open-loop forces of stage `name` that nothing returns, or that `vary` makes vague."""
    loaded = context.loaded
    stage = loaded.task.stages[name]
    frame, law = context.frame_of(stage), context.law_of(stage)
    contact = context.contact_of(frame)
    plans = plan_axes(axes, stage.axes, path, law, ())
    open_loop = [a for a, p in plans.items() if p.open_loop]
    if not open_loop:
        return
    place = FILE.stages[name].axes[open_loop[0]]
    gripped = context.gripped(frame)
    if contact is None and not gripped and not all(a.is_rotation for a in open_loop):
        found.error(
            "TS303",
            f"under {law.kind!r} a force is reached by pressing below a surface, and the world "
            "has none",
            loaded.span(place.force),
            "declare the surface under `world`, or use a law with a force loop: hybrid, "
            "parallel, parallel-pid",
        )
        return
    k = context.stiffness_of(frame)
    felt, lever = context.felt_stiffness(frame, axes, rotation), context.lever_of(frame)
    entries = {a: p.axis for a, p in plans.items()}
    gains = law.design(entries, context.plants(axes, rotation, felt, lever=lever))
    for axis in open_loop:
        own = value_of(gains, "stiffness", axis)
        if own == 0:
            found.error(
                "TS306",
                f"under {law.kind!r} a force stretches the law's spring, and {axis!r} has none",
                loaded.span(FILE.stages[name].axes[axis]),
                "give the law a stiffness above zero, or use a law with a force loop",
            )
            continue
        if axis.is_rotation or contact is None:
            continue
        normal = rotation[:, AXES.index(axis)]
        span = _span(context, contact, normal, entries[axis], own, k)
        if span is not None:
            low, high = span
            found.warning(
                "TS304",
                f"under {law.kind!r} this force is open loop: for the surfaces that `vary` allows "
                f"it becomes {low:.3g} to {high:.3g} N",
                loaded.span(FILE.stages[name].axes[axis].force),
                "a law with a force loop (hybrid, parallel, parallel-pid) reaches it on all",
            )


def _span(
    context: Context,
    contact: str,
    normal: NDArray[np.float64],
    axis: AxisEntry,
    own: float,
    k: float,
) -> tuple[float, float] | None:
    """Least and greatest force over the corners of `vary`; None where it does not matter.

    From (4.26), (4.27) with the reference f (1/k_m + 1/k) below the nominal surface.
    """
    wanted = steady_force(context, axis)
    if wanted is None:
        return None
    vary = context.loaded.task.vary
    stiffness = _ends(vary.get(f"world.{contact}.stiffness", ()), [k])
    places = _ends(vary.get(f"world.{contact}.xyz", ()), list(context.surfaces[contact].origin))
    if len(stiffness[0]) == 1 and all(len(p) == 1 for p in places):
        return None
    nominal = context.surfaces[contact].origin
    forces = []
    for true_k, *place in itertools.product(stiffness[0], *places):
        depth = wanted * (1 / own + 1 / k) - float(normal @ (np.array(place) - nominal))
        forces.append(depth * own * true_k / (own + true_k))
    return min(forces), max(forces)


def _ends(variations: tuple[Variation | None, ...], nominal: list[float]) -> list[list[float]]:
    ends = [[float(value)] for value in nominal]
    for i, variation in enumerate(variations):
        if variation is not None:
            base = nominal[i] if variation.relative else 0.0
            ends[i] = [base + variation.low, base + variation.high]
    return ends
