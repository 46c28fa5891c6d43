"""Whether forces and motions of a stage can be had together with its limits, arm and contacts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from taskspec.control.qp.certificate import Certificate, contradiction, feasible
from taskspec.program.passage import End
from taskspec.program.plan import StagePlan
from taskspec.program.trajectory import Place
from taskspec.program.walk.course import moving_axes
from taskspec.rules import Finding, rule, warning
from taskspec.spec import FILE, key_of
from taskspec.statics.forces import TORQUE, statics
from taskspec.statics.rates import VELOCITY, motion
from taskspec.statics.rows import RowCause, RowSystem
from taskspec.text.diagnostic import Severity
from taskspec.text.units import show

Vector = NDArray[np.float64]

_COMMANDED = ("set point", "velocity")
_GIVEN = ("hold", "contact", "face")
#: Relative to the row, below which a bound counts as met.
_MET = 1e-9
_HALVINGS = 20
_NONE = 1e-3
_FEW = 2
#: By this share a tip is faster than its reference as a rate is blended in, or as it leaves what it
#: pressed on: up to 7 % in four of five moves of random files, by its contact's spring farther.
_OVERSHOOT = 0.1


@rule("TS420", "lines that contradict each other", predicts=("TS420",))
def contradictions(stage: StagePlan) -> Iterator[Finding]:
    """Lines of a stage that contradict each other, at the first place where they do."""
    places = stage.nominal.places
    for place in places:
        finding = None
        if place.missed:
            continue
        if stage.set_points.constant or len(places) > 1:
            finding = _contradiction(stage, place, *statics(stage, place))
        if finding is None and place.q is not None and any(place.rates.values()):
            finding = _contradiction(stage, place, *motion(stage, place))
        if finding is not None:
            yield finding
            return


@rule("TS421", "a motion that leads out of reach", predicts=("TS421",))
def out_of_reach(stage: StagePlan) -> Iterator[Finding]:
    """Motions that lead where the arm cannot be."""
    spec, frame, own = stage.spec, stage.frame, FILE.stages[stage.name]
    possible = stage.law.solve == "qp" or spec.until is not None
    first = next(iter(moving_axes(spec)), None)
    where = own.path if spec.path else own.axes if first is None else own.axes[first]
    placed = stage.path is not None and not stage.path.form.relative
    placed = placed or any(e.mode.placed for e in spec.axes.values())
    origin = "its origin" if frame.still else "where the stage begins"
    counts = f"; in frame {frame.name!r} coordinates count from {origin}" if placed else ""
    hint = f"shorten the way, start elsewhere, or leave the orientation to the arm{counts}"
    missed = [place for place in stage.nominal.places if place.missed]
    for place in missed:
        yield Finding(
            "TS421",
            f"in stage {stage.name!r}, {place.words}, the arm cannot be where the motion "
            f"leads: it misses that by {place.missed}",
            key_of(where),
            hint,
            severity=Severity.WARNING if possible else Severity.ERROR,
        )
    passage = stage.nominal.passage
    if not missed and passage is not None and passage.end is End.REACH:
        yield warning(
            "TS421",
            f"in stage {stage.name!r} the motion leads out of reach: {passage.last.words} the arm "
            "is as far as it gets",
            key_of(where),
            hint,
        )


def _contradiction(
    stage: StagePlan, place: Place, system: RowSystem, guess: Vector
) -> Finding | None:
    """What is commanded against what cannot give way; None where all goes together.

    Args:
        stage: the stage.
        place: where.
        system: its rows there.
        guess: what satisfies them if nothing is in its way.
    """
    A, lower, upper = system.arrays()
    reached = A @ guess
    room = _MET * (1.0 + np.abs(A) @ np.abs(guess))
    if np.all(reached >= lower - room) and np.all(reached <= upper + room):
        return None
    certificate = contradiction(A, lower, upper, _kept(system, reached))
    if certificate is None:
        return None
    causes = _causes(system, certificate)
    wanted = [cause for cause in causes if cause.kind in _COMMANDED]
    against, given = _opponents(causes)
    if not wanted or not against:
        return None
    held = [cause.text for cause in causes if cause.kind == "hold"]
    others = "the other axes" if len(held) > _FEW else _listed(held)
    first, *rest = wanted
    other = (*rest, *(cause for cause in causes if cause.kind not in _COMMANDED))
    return Finding(
        "TS420",
        f"in stage {stage.name!r}, {place.words}, {_listed([cause.text for cause in wanted])} "
        f"{'does' if len(wanted) == 1 else 'do'} not go with {_opposed(against)}"
        f"{f', with {others} held' if held else ''}"
        f"{f', given {_listed(given)}' if given else ''}",
        first.place,
        _hint(system, wanted, against),
        tuple((cause.text, cause.place) for cause in other if cause.place is not None),
        severity=_severity(stage, against),
    )


def _kept(system: RowSystem, reached: Vector) -> list[int]:
    """Rows that stay in a certificate when others can go.

    Those are the joints' limits, the tightest last, and after them how contacts and held axes are.
    """
    _, lower, upper = system.arrays()
    bound = np.where(reached > 0, upper, -lower)
    with np.errstate(divide="ignore", invalid="ignore"):
        used = np.where(bound > 0, np.abs(reached) / bound, np.inf)
    joints = [i for i, cause in enumerate(system.causes) if cause.kind in (TORQUE, VELOCITY)]
    joints.sort(key=lambda i: used[i])
    return joints + [i for i, cause in enumerate(system.causes) if cause.kind in _GIVEN]


def _severity(stage: StagePlan, against: Sequence[RowCause]) -> Severity:
    """An error is what arm or contact cannot give to a closed form that counts on it.

    Limits stop the run when it gets there, a quadratic program gives the closest that is
    possible, and under a law on which force wins over motion the tool drifts, (4.49).
    """
    law = stage.law
    kinds = {cause.kind for cause in against}
    torque, contact = TORQUE in kinds, bool(kinds & {"contact", "face"})
    refused = torque or (contact and not law.control_law.shares)
    return Severity.ERROR if refused and law.solve == "closed-form" else Severity.WARNING


def _causes(system: RowSystem, certificate: Certificate) -> list[RowCause]:
    """The causes of a certificate's rows, those that weigh most first."""
    order = np.argsort(-np.abs(certificate.multipliers), kind="stable")
    return list(dict.fromkeys(system.causes[certificate.rows[i]] for i in order))


def _opponents(causes: Sequence[RowCause]) -> tuple[list[RowCause], list[str]]:
    """What stands against the wishes, and under which contacts where it is not these alone."""
    against = [cause for cause in causes if cause.kind not in (*_COMMANDED, "hold")]
    contacts = [cause for cause in against if cause.kind in ("contact", "face")]
    if len(contacts) == len(against):
        named = [cause for cause in contacts if cause.kind != "face"]
        return named or contacts, []
    return (
        [cause for cause in against if cause not in contacts],
        [cause.text for cause in contacts if cause.kind != "face"],
    )


def _listed(words: Sequence[str]) -> str:
    *most, last = words or [""]
    return f"{', '.join(most)} and {last}" if most else last


def _opposed(against: Sequence[RowCause]) -> str:
    """What stands against the wishes; limits of joints together."""
    words = [cause.text for cause in against if cause.kind not in (TORQUE, VELOCITY)]
    for kind in (TORQUE, VELOCITY):
        joints = [cause.text for cause in against if cause.kind == kind]
        joints.sort(key=lambda word: int(word.split()[1]))
        if joints:
            words.append(f"the {kind}{'s' if len(joints) > 1 else ''} of {_listed(joints)}")
    return _listed(words)


def _hint(system: RowSystem, wanted: Sequence[RowCause], against: Sequence[RowCause]) -> str:
    """What would help, and how much of a single wish is possible."""
    ways = list(dict.fromkeys(cause.remedy for cause in (*wanted, *against)))
    hint = f"{', '.join(ways[:-1])} or {ways[-1]}"
    if len(wanted) > 1:
        return hint
    share = _possible(system, wanted[0])
    if share < _NONE:
        return f"{hint}; nothing of it is possible here"
    most = show(abs(share * wanted[0].value), wanted[0].dimension, 3)
    return f"{hint}; no more than {most} is possible here"


def _possible(system: RowSystem, wanted: RowCause) -> float:
    """Largest share of what a line asks for that the others allow, 0 to 1."""
    A, lower, upper = system.arrays()
    rows = [i for i, cause in enumerate(system.causes) if cause == wanted]
    least, most = 0.0, 1.0
    for _ in range(_HALVINGS):
        share = (least + most) / 2
        low, high = lower.copy(), upper.copy()
        low[rows], high[rows] = share * lower[rows], share * upper[rows]
        least, most = (share, most) if feasible(A, low, high) else (least, share)
    return least
