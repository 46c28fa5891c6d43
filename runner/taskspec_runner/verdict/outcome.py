"""The outcome of a run as one word and one sentence."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Protocol

from taskspec.deferred_methods import dataclass
from taskspec_runner.record.extent import Extent
from taskspec_runner.record.folder import Json, number
from taskspec_runner.record.visits import StageVisit
from taskspec_runner.verdict.judged import Judged
from taskspec_runner.verdict.run_finding import RunFinding


@dataclass(frozen=True, slots=True)
class Verdict:
    """The verdict of a run.

    Attributes:
        kind: passed, missed, stopped, failed, unfinished or damaged; done where nothing was
            expected of a run that came to its end; undecided where an expectation needs what was
            not recorded, or a log does not show whether its task ended.
        sentence: why, and when, in one sentence.
        first: the expectation that was broken first, of a run that missed some.
        stage: then.
        rest: of the sentence, without the first expectation.
    """

    kind: str
    sentence: str
    first: Judged | None = None
    stage: str = ""
    rest: str = ""


class JudgedRun(Protocol):
    """The run that a verdict follows from; see `taskspec_runner.runs.Run`."""

    @property
    def extent(self) -> Extent: ...  # noqa: D102
    @property
    def damage(self) -> str: ...  # noqa: D102
    @property
    def manifest(self) -> Json: ...  # noqa: D102
    @property
    def summary(self) -> Json: ...  # noqa: D102
    @property
    def link(self) -> Json: ...  # noqa: D102
    @property
    def expectations(self) -> Sequence[Judged]: ...  # noqa: D102
    @property
    def not_judged(self) -> str | None: ...  # noqa: D102
    @property
    def faults(self) -> Sequence[RunFinding]: ...  # noqa: D102
    @property
    def visits(self) -> Sequence[StageVisit]: ...  # noqa: D102
    @property
    def period(self) -> float: ...  # noqa: D102
    def label(self, visit: StageVisit) -> str: ...  # noqa: D102


def verdict(run: JudgedRun) -> Verdict:
    """The verdict on a run, from its summary; without one, the run did not finish."""
    status = run.extent.status
    if run.damage:
        sentence = f"{run.damage}. What is shown is not evidence of the run"
        said = f", which said of itself that it was {status}" if status else ""
        return Verdict("damaged", f"{sentence}{said}.")
    if not run.summary or status in ("", "running", "crashed"):
        return Verdict("unfinished", _unfinished(run, status))
    ending = run.summary.get("ending")
    ending = ending if isinstance(ending, Mapping) else {}
    if status in ("stopped", "failed"):
        return Verdict(status, f"{_broken_off(ending)} {so_far(run)}".rstrip())
    missed = [e for e in run.expectations if e.missed]
    if missed:
        return _missed_verdict(run, len(missed))
    if run.faults:
        text = f"{_faults(run.faults)} {_all_else(run)}"
        return Verdict("missed", text, stage=run.faults[0].stage)
    if status == "undecided":
        return Verdict("undecided", f"{_broken_off(ending)} {so_far(run)}".rstrip())
    if any(each.passed is None for each in run.expectations):
        return Verdict("undecided", f"{_undecided(run)} {_reached_end(run)}")
    kind = "passed" if run.expectations else "done"
    return Verdict(kind, _passed(len(run.expectations)) + f" {_reached_end(run)}")


def _unfinished(run: JudgedRun, status: str) -> str:
    holds = run.extent.holds
    holds = f"{holds[0].upper()}{holds[1:]}."
    if status == "crashed":
        reason = run.manifest.get("reason")
        return f"The run crashed{f': {reason}' if reason else ''}. {holds} {so_far(run)}".rstrip()
    so = so_far(run)
    if not so and run.not_judged:
        so = f"Its expectations were not judged: {run.not_judged}."
    return f"The run did not finish: {run.extent.why}. {holds} {so}".rstrip()


def so_far(run: JudgedRun) -> str:
    """The count of met expectations of a run that broke off; empty otherwise."""
    status, total = run.summary.get("status"), len(run.expectations)
    met = sum(e.passed is True for e in run.expectations)
    if run.not_judged == "" and total:
        return f"So far: {met} of {total} expectations met on the ticks that there are."
    if status == "undecided" and total:
        return f"So far: {met} of {total} expectations met until the log ends."
    if status not in ("stopped", "failed") or not total:
        return ""
    return f"So far: {met} of {total} expectations met until it {status}."


def _broken_off(ending: Mapping[str, Any]) -> str:
    why = str(ending.get("text") or ending.get("reason") or "no reason was recorded")
    clock = number(ending.get("clock"))
    where = f"in stage {ending['stage']}" if ending.get("stage") else ""
    when = "" if clock is None else f"at {clock:.3f} s"
    place = " ".join(part for part in (where, when) if part)
    return f"{place[0].upper()}{place[1:]}: {why}." if place else f"{why}."


def first_broken(run: JudgedRun) -> Judged | None:
    """The expectation that was broken before all others; None where no tick broke one."""
    broken = [e for e in run.expectations if e.missed and e.broken is not None]
    return min(broken, key=lambda e: e.broken.clock if e.broken else 0.0, default=None)


def _undecided(run: JudgedRun) -> str:
    """The sentence about expectations that could not be judged, and about the others."""
    open_ = [each for each in run.expectations if each.passed is None]
    lacking = ", ".join(dict.fromkeys(name for each in open_ for name in each.unrecorded))
    met = len(run.expectations) - len(open_)
    some = f"{len(open_)} of {len(run.expectations)} expectations"
    rest = f" The other {met} held." if met else ""
    return f"{some} cannot be judged, as {lacking} was not recorded.{rest}"


def _missed_verdict(run: JudgedRun, missed: int) -> Verdict:
    rest = _missed(missed, len(run.expectations), _missing(run))
    first = first_broken(run)
    if first is None or first.broken is None:
        return Verdict("missed", rest)
    stage = stage_at(run, first.broken.clock)
    where = f" in stage {stage}" if stage else ""
    what = f"{first.name} (`{first.text}`)" if first.name else f"`{first.text}`"
    sentence = f"At {first.broken.clock:.3f} s{where}, {what} was broken: {first.broken.text}."
    return Verdict("missed", f"{sentence} {rest}", first, stage, rest)


def stage_at(run: JudgedRun, clock: float) -> str:
    """Label of the visit at a run time [s]; empty without one."""
    found = (v for v in run.visits if v.start - run.period / 2 < clock < v.end - run.period / 2)
    visit = next(found, None)
    return run.label(visit) if visit else ""


def _faults(faults: Sequence[RunFinding]) -> str:
    return " ".join(f"In stage {each.stage}, {each.text}." for each in faults)


def _all_else(run: JudgedRun) -> str:
    total = len(run.expectations)
    if any(each.passed is None for each in run.expectations):
        return _undecided(run)
    return _passed(total) if total else _reached_end(run)


def is_recorded(run: JudgedRun) -> bool:
    """Whether a log was judged that was recorded elsewhere."""
    return bool(run.summary.get("recorded"))


def is_measured(run: JudgedRun) -> bool:
    """Whether what is judged was measured, and nobody knows what was true."""
    return is_recorded(run) or run.link.get("measured") is True


def mirrored(run: JudgedRun) -> Iterator[str]:
    """That the forces of a log seem to have the opposite sign; nothing where they do not."""
    said = run.summary.get("recorded")
    texts = said.get("mirrored") if isinstance(said, Mapping) else None
    if isinstance(texts, list) and texts:
        would = " and ".join(f"`{text}`" for text in texts)
        yield (
            f"The sign of the forces seems to be turned: with the opposite sign {would} would be "
            "met. A task file speaks of the force that the robot applies, a sensor measures what "
            "it bears: the column map turns it with sign: -1, and leaves it with sign: 1."
        )


def _missing(run: JudgedRun) -> str:
    """The subject of the sentence that says what was missed."""
    if is_recorded(run):
        return "As measured, the log"
    end = "The run reached its end, but"
    return f"{end}, as measured, it" if is_measured(run) else end


def _missed(missed: int, total: int, end: str) -> str:
    if total == 1:
        return f"{end} missed its expectation."
    return f"{end} missed {missed} of {total} expectations."


def _passed(total: int) -> str:
    if total == 0:
        return "The task states no expectations, so nothing was judged."
    return "The expectation held." if total == 1 else f"All {total} expectations held."


def _reached_end(run: JudgedRun) -> str:
    visits, stages = len(run.visits), len({v.stage for v in run.visits})
    after = f" after {stages} stage{'s' if stages != 1 else ''}" if stages else ""
    if visits > stages:
        after = f" after {visits} visits of {stages} stage{'s' if stages != 1 else ''}"
    if is_recorded(run):
        return f"This is as measured; the log ends{after}."
    measured = " This is as measured." if is_measured(run) else ""
    return f"The run reached its end{after}.{measured}"
