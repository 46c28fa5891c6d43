"""What a comparison came to, as data: the content of `compare.json`, in SI."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from taskspec.laws import LAWS
from taskspec_runner.compare.attempt import CRASHED, Attempt
from taskspec_runner.compare.tracking import Json, force_axes, tracking

FORMAT = 1
#: Runs that make a comparison.
_ENOUGH = 2
_GOOD, _INTERNAL = 0, 3
#: Exit code where fewer laws could be run than make a comparison.
NOTHING_TO_COMPARE = 1


def exit_code(attempts: Sequence[Attempt]) -> int:
    """0 well; 1 too few laws could be run; 3 an internal error; 128 + n ended by signal n.

    A run that misses what it expects, fails or is stopped is a result like another.
    """
    signals = [each.broken_off for each in attempts if each.broken_off]
    if signals:
        return signals[0]
    if any(each.outcome == CRASHED for each in attempts):
        return _INTERNAL
    ran = sum(each.run is not None for each in attempts)
    return _GOOD if ran >= min(_ENOUGH, len(attempts)) else NOTHING_TO_COMPARE


def opening(
    name: str, file: str, overrides: Sequence[str], seed: int, notes: Sequence[str]
) -> dict[str, Any]:
    """What is known of a comparison before it begins.

    Args:
        name: of the task.
        file: its path.
        overrides: as given.
        seed: of everything random.
        notes: what a reader of the numbers must know.
    """
    return {
        "format": FORMAT,
        "task": name,
        "file": file,
        "overrides": list(overrides),
        "seed": seed,
        "notes": list(notes),
        "exit_code": None,
        "laws": [],
    }


def summarise(attempts: Sequence[Attempt], opened: Mapping[str, Any]) -> dict[str, Any]:
    """The content of `compare.json`; the same file and seed give the same bytes."""
    summaries = [each.run.summary for each in attempts if each.run]
    forces = force_axes(summaries)
    return {
        **opened,
        "about": next((s["about"] for s in summaries), None),
        "robot": next((s["robot"]["name"] for s in summaries), None),
        "exit_code": exit_code(attempts),
        "force_axes": forces,
        "laws": [_law(each, forces) for each in attempts],
        "expectations": _expectations(attempts),
    }


def _law(each: Attempt, forces: Mapping[str, Sequence[str]]) -> dict[str, Any]:
    facts, summary = LAWS.get(each.law), each.run.summary if each.run else None
    return {
        "law": each.law,
        "equations": facts.equations if facts else "",
        "force_loop": bool(facts and facts.force_loop),
        "outcome": each.outcome,
        "reason": each.reason,
        "codes": [d.code for d in each.diagnostics],
        "folder": each.law if summary or each.crash else None,
        **(_run(summary, forces) if summary else {}),
    }


def _run(summary: Json, forces: Mapping[str, Sequence[str]]) -> dict[str, Any]:
    expectations = summary["expectations"]
    return {
        "exit_code": summary["exit_code"],
        "duration": summary["duration"],
        "met": sum(e["passed"] for e in expectations),
        "expected": len(expectations),
        "peak_force": largest([p["force"] for p in summary["peaks"].values()]),
        "stages": tracking(summary, forces),
    }


def largest(forces: Sequence[float | None]) -> float | None:
    """The largest of some forces [N]; None where one of them is not finite."""
    known = [force for force in forces if force is not None]
    return max(known, default=0.0) if len(known) == len(forces) else None


def _expectations(attempts: Sequence[Attempt]) -> list[dict[str, Any]]:
    """Each expectation with what every run made of it."""
    found: dict[int, dict[str, Any]] = {}
    for each in attempts:
        for number, verdict in enumerate(each.run.summary["expectations"] if each.run else ()):
            entry = found.setdefault(number, {"text": verdict["text"], "laws": {}})
            entry["laws"][each.law] = {k: verdict[k] for k in ("passed", "explanation")}
    return list(found.values())
