"""What a comparison came to, as data: the content of `compare.json`, in SI."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from taskspec.laws import LAWS
from taskspec_runner import exit_codes
from taskspec_runner.compare.attempt import AS_WRITTEN, CRASHED, Attempt
from taskspec_runner.compare.gains import stage_gains
from taskspec_runner.compare.ranking import ranks
from taskspec_runner.compare.tracking import Json, force_axes, tracking

FORMAT = 1
#: Runs that make a comparison.
_ENOUGH = 2


def exit_code(attempts: Sequence[Attempt]) -> int:
    """That of the task as written; MISSED where too few other laws could be run.

    That another law misses what is expected, fails or is stopped is a result like another.
    INTERNAL after an internal error, 128 + n where signal n has broken it off.
    """
    signals = [each.broken_off for each in attempts if each.broken_off]
    if signals:
        return signals[0]
    if any(each.outcome == CRASHED for each in attempts):
        return exit_codes.INTERNAL
    own = next((each for each in attempts if each.law == AS_WRITTEN), None)
    if own is not None and not own.good:
        return exit_codes.WRONG if own.run is None else own.run.exit_code
    return exit_codes.WELL if comparable(attempts) else exit_codes.MISSED


def comparable(attempts: Sequence[Attempt]) -> bool:
    """Whether enough laws could be run, besides the task as written."""
    runs = [each.run is not None for each in attempts if each.law != AS_WRITTEN]
    return sum(runs) >= min(_ENOUGH, len(runs))


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
    laws = [_law(each, forces) for each in attempts]
    return {
        **opened,
        "notes": [*opened["notes"], *_same(attempts)],
        "about": next((s["about"] for s in summaries), None),
        "robot": next((s["robot"]["name"] for s in summaries), None),
        "exit_code": exit_code(attempts),
        "force_axes": forces,
        "comparable": comparable(attempts),
        "laws": [
            {**law, "rank": rank} for law, rank in zip(laws, ranks(laws, forces), strict=True)
        ],
        "expectations": _expectations(attempts),
    }


def _same(attempts: Sequence[Attempt]) -> Iterator[str]:
    """Which law has made the same run as the task as written: stages, laws and gains are equal."""
    own = next((a for a in attempts if a.law == AS_WRITTEN and a.run), None)
    for each in attempts:
        if own is None or each is own or each.run is None:
            continue
        if _controlled(each) == _controlled(own):
            yield f"'{AS_WRITTEN}' and {each.law} are the same run: the file gives no other gains"


def _controlled(each: Attempt) -> list[tuple[Any, ...]]:
    """Law and gains of each stage."""
    if each.program is None:
        return []
    gains = stage_gains(each.program)
    return [
        (stage.name, stage.plan.law.kind, [(g["name"], g["axes"], g["value"]) for g in of_stage])
        for stage, of_stage in zip(each.program.stages, gains.values(), strict=True)
    ]


def _law(each: Attempt, forces: Mapping[str, Sequence[str]]) -> dict[str, Any]:
    facts, summary = LAWS.get(each.kind), each.run.summary if each.run else None
    return {
        "law": each.law,
        "kind": each.kind,
        "equations": facts.equations if facts else "",
        "force_loop": bool(facts and facts.force_loop),
        "outcome": each.outcome,
        "reason": each.reason,
        "codes": [d.code for d in each.diagnostics],
        "folder": each.folder if summary or each.crash else None,
        "gains": stage_gains(each.program) if each.program and summary else {},
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
            named = {key: verdict[key] for key in ("name", "text") if key in verdict}
            entry = found.setdefault(number, {**named, "laws": {}})
            entry["laws"][each.law] = {k: verdict[k] for k in ("passed", "explanation")}
    return list(found.values())
