"""Whether forces and motions of a stage can be had together with its limits, arm and contacts."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from taskspec.check.reach.rates import VELOCITY, motion
from taskspec.check.reach.rows import Asked, Line, System, shares_of
from taskspec.check.reach.statics import TORQUE, statics, steady
from taskspec.control.qp.certificate import Certificate, contradiction, feasible
from taskspec.foresight.course import moving_axes
from taskspec.geometry.axis import AXES, Axis
from taskspec.program.axes import MOSTLY
from taskspec.program.context import Context
from taskspec.program.trajectory import Place
from taskspec.spec import FILE, key_of
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics, Severity
from taskspec.text.show import show

register(
    {
        "TS420": "lines that contradict each other",
        "TS421": "a motion that leads out of reach",
    }
)

Vector = NDArray[np.float64]
Model = Callable[[Context, Asked, Place], tuple[System, Vector]]

_ASKED = ("set point", "velocity")
_GIVEN = ("hold", "contact", "face")
#: Relative to the row, below which a bound counts as met.
_MET = 1e-9
_HALVINGS = 20
_NONE = 1e-3
_FEW = 2


def check_feasibility(
    context: Context,
    name: str,
    axes: tuple[Axis, ...],
    places: Sequence[Place],
    found: Diagnostics,
) -> None:
    """Reports lines of stage `name` that contradict each other, and motions out of reach.

    Each at the first place where that is so.

    Args:
        context: the task. name: of the stage. axes: that exist in its frame.
        places: where it is looked at. found: where findings go.
    """
    forces, told = steady(context, name, axes), False
    for place in places:
        if place.missed:
            _report_reach(context, name, place, found)
        if told or place.missed:
            continue
        normals = _leaned_on(context, name, forces, place)
        asked = Asked(name, forces, normals, _limited(context, name, forces))
        told = (forces or len(places) > 1) and _report(statics, context, asked, place, found)
        moves = place.q is not None and any(place.rates.values())
        if not told and moves:
            told = _report(motion, context, asked, place, found)


def _report(model: Model, context: Context, asked: Asked, place: Place, found: Diagnostics) -> bool:
    system, guess = model(context, asked, place)
    A, lower, upper = system.arrays()
    reached = A @ guess
    room = _MET * (1.0 + np.abs(A) @ np.abs(guess))
    if np.all(reached >= lower - room) and np.all(reached <= upper + room):
        return False
    certificate = contradiction(A, lower, upper, _kept(system, reached))
    if certificate is None:
        return False
    lines = _lines(system, certificate)
    wanted = [line for line in lines if line.kind in _ASKED]
    against, given = _opponents(lines)
    if not wanted or not against:
        return False
    held = [line.words for line in lines if line.kind == "hold"]
    others = "the other axes" if len(held) > _FEW else _listed(held)
    message = (
        f"in stage {asked.name!r}, {place.words}, {_listed([line.words for line in wanted])} "
        f"{'does' if len(wanted) == 1 else 'do'} not go with {_opposed(against)}"
        f"{f', with {others} held' if held else ''}"
        f"{f', given {_listed(given)}' if given else ''}"
    )
    first, *rest = wanted
    other = (*rest, *(line for line in lines if line.kind not in _ASKED))
    found.add(
        _severity(context, asked.name, against),
        "TS420",
        message,
        first.span,
        _hint(system, wanted, against),
        tuple((line.words, line.span) for line in other if line.span is not None),
    )
    return True


def _kept(system: System, reached: Vector) -> list[int]:
    """Rows that stay in a certificate when others can go.

    Those are the joints' limits, the tightest last, and after them how contacts and held axes are.
    """
    _, lower, upper = system.arrays()
    bound = np.where(reached > 0, upper, -lower)
    with np.errstate(divide="ignore", invalid="ignore"):
        used = np.where(bound > 0, np.abs(reached) / bound, np.inf)
    joints = [i for i, line in enumerate(system.lines) if line.kind in (TORQUE, VELOCITY)]
    joints.sort(key=lambda i: used[i])
    return joints + [i for i, line in enumerate(system.lines) if line.kind in _GIVEN]


def _report_reach(context: Context, name: str, place: Place, found: Diagnostics) -> None:
    stage = context.loaded.task.stages[name]
    law = context.law_of(stage)
    possible = law.solve == "qp" or stage.until is not None
    moved = next(iter(moving_axes(stage)), None)
    own = FILE.stages[name]
    where = own.path if stage.path else own.axes if moved is None else own.axes[moved]
    frame = context.frame_of(stage)
    placed = stage.path is not None and stage.path.to is not None
    placed = placed or any(e.mode.placed for e in stage.axes.values())
    origin = "its origin" if frame.still else "where the stage begins"
    counts = f"; in frame {frame.name!r} coordinates count from {origin}" if placed else ""
    found.add(
        Severity.WARNING if possible else Severity.ERROR,
        "TS421",
        f"in stage {name!r}, {place.words}, the arm cannot be where the motion leads: it misses "
        f"that by {place.missed}",
        context.loaded.span(key_of(where)),
        f"shorten the way, start elsewhere, or leave the orientation to the arm{counts}",
    )


def _severity(context: Context, name: str, against: Sequence[Line]) -> Severity:
    """An error is what arm or contact cannot give to a closed form that counts on it.

    Limits stop the run when it gets there, a quadratic program gives the closest that is
    possible, and under a law on which force wins over motion the tool drifts, (4.49).
    """
    law = context.law_of(context.loaded.task.stages[name])
    kinds = {line.kind for line in against}
    torque, contact = TORQUE in kinds, bool(kinds & {"contact", "face"})
    refused = torque or (contact and not law.control_law.shares)
    return Severity.ERROR if refused and law.solve == "closed-form" else Severity.WARNING


def _lines(system: System, certificate: Certificate) -> list[Line]:
    """The lines of a certificate, those that weigh most first."""
    order = np.argsort(-np.abs(certificate.multipliers), kind="stable")
    return list(dict.fromkeys(system.lines[certificate.rows[i]] for i in order))


def _opponents(lines: Sequence[Line]) -> tuple[list[Line], list[str]]:
    """What stands against the wishes, and under which contacts where it is not these alone."""
    against = [line for line in lines if line.kind not in (*_ASKED, "hold")]
    contacts = [line for line in against if line.kind in ("contact", "face")]
    if len(contacts) == len(against):
        named = [line for line in contacts if line.kind != "face"]
        return named or contacts, []
    return (
        [line for line in against if line not in contacts],
        [line.words for line in contacts if line.kind != "face"],
    )


def _listed(words: Sequence[str]) -> str:
    *most, last = words or [""]
    return f"{', '.join(most)} and {last}" if most else last


def _opposed(against: Sequence[Line]) -> str:
    """What stands against the wishes; limits of joints together."""
    words = [line.words for line in against if line.kind not in (TORQUE, VELOCITY)]
    for kind in (TORQUE, VELOCITY):
        joints = [line.words for line in against if line.kind == kind]
        joints.sort(key=lambda word: int(word.split()[1]))
        if joints:
            words.append(f"the {kind}{'s' if len(joints) > 1 else ''} of {_listed(joints)}")
    return _listed(words)


def _hint(system: System, wanted: Sequence[Line], against: Sequence[Line]) -> str:
    """What would mend it, and how much of a single wish is possible."""
    ways = list(dict.fromkeys(line.mend for line in (*wanted, *against)))
    hint = f"{', '.join(ways[:-1])} or {ways[-1]}"
    if len(wanted) > 1:
        return hint
    share = _possible(system, wanted[0])
    if share < _NONE:
        return f"{hint}; nothing of it is possible here"
    most = show(abs(share * wanted[0].value), wanted[0].unit, 3)
    return f"{hint}; no more than {most} is possible here"


def _possible(system: System, wanted: Line) -> float:
    """Largest share of what a line asks for that the others allow, 0 to 1."""
    A, lower, upper = system.arrays()
    rows = [i for i, line in enumerate(system.lines) if line == wanted]
    least, most = 0.0, 1.0
    for _ in range(_HALVINGS):
        share = (least + most) / 2
        low, high = lower.copy(), upper.copy()
        low[rows], high[rows] = share * lower[rows], share * upper[rows]
        least, most = (share, most) if feasible(A, low, high) else (least, share)
    return least


def _limited(context: Context, name: str, forces: dict[Axis, float]) -> bool:
    """Whether no force alone is beyond `limits.force`, which TS610 reports."""
    most = context.limits_of(context.loaded.task.stages[name]).force
    own = [abs(value) for axis, value in forces.items() if not axis.is_rotation]
    share = shares_of(context, name).force
    return most is not None and all(value <= share * most for value in own)


def _leaned_on(
    context: Context, name: str, forces: dict[Axis, float], place: Place
) -> dict[str, Vector] | None:
    """Outward normals of all that the tool may lean on; None where these cannot be told.

    Grips, mechanisms, equations and loose bodies return what no cone describes. Of shapes that
    are not flat the normal is known where a frame follows them. A pull along the normal is TS308.
    """
    task = context.loaded.task
    frame = context.frame_of(task.stages[name])
    others = task.robot.grasp is not None or task.mechanisms or task.equations
    if others or not task.shapes or any(shape.free for shape in task.shapes.values()):
        return None
    if any(base.turns for base in context.moving_bases.values()):
        return None
    normals = {}
    for object_name, surface in context.surfaces.items():
        if object_name == frame.surface_name:
            normals[object_name] = place.rotation[:, 2]
        elif surface.level:
            normals[object_name] = context.start_normals[object_name]
        else:
            return None
    contact = context.contact_of(frame)
    for axis, value in forces.items():
        if contact is None or axis.is_rotation:
            continue
        along = float(place.rotation[:, AXES.index(axis)] @ context.start_normals[contact])
        if abs(along) > MOSTLY and value * along > 0:
            return None
    return normals
