"""What is reported of a trial: each end at the key that it concerns, when it was, and its cause."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from taskspec.program import events
from taskspec.program.plan import StagePlan
from taskspec.program.stages.protected import PROTECTION, about_force
from taskspec.rules.finding import Finding, Place, warning
from taskspec.rules.places import motion_of
from taskspec.spec import FILE
from taskspec.spec.stage import OSCILLATION
from taskspec.text.codes import register
from taskspec.text.expression.tree import Held, Name, Node, walk
from taskspec.text.units import show
from taskspec_runner.record.history import Visit
from taskspec_runner.trial import causes
from taskspec_runner.trial.causes import Cause, first_cause
from taskspec_runner.trial.moment import Moment
from taskspec_runner.trial.trial import OPEN, Trial
from taskspec_runner.verdict.judged import Judged
from taskspec_runner.verdict.run_finding import RunFinding

register(
    {
        "TS422": "an arm that is singular on its way",
        "TS424": "a joint that comes to its limit",
        "TS425": "a motion that leaves what its frame follows",
        "TS426": "a tip that passes the limit on speed",
        "TS427": "a joint that is at its limit for much of a stage",
        "TS429": "a tool that passes the limit on its deviation",
        "TS443": "a motion beyond the robot's protection",
        "TS444": "a force beyond the robot's protection",
        "TS502": "a stage that oscillates",
        "TS611": "a guard that does not hold in time",
        "TS613": "a guard that holds as its stage begins",
        "TS614": "a guard that holds with nothing touched",
        "TS616": "a force or moment that passes its limit",
        "TS617": "a bound that ends a stage before it comes to its surface",
        "TS618": "a failure that comes about",
        "TS621": "a run that breaks off",
        "TS726": "an expectation that is missed",
    }
)

#: A guard that ends its stage within so many ticks more than it has to hold did so from the start.
_FIRST_TICKS = 2
_LIMIT_CODES = {
    "force": "TS616",
    "torque": "TS616",
    "speed": "TS426",
    "deviation": "TS429",
    "joint_position": "TS424",
    "joint_velocity": "TS424",
    "singularity": "TS422",
    "representation_singularity": "TS422",
    "frame_left": "TS425",
}
#: What helps where no cause can be read off the trial.
_REMEDIES = {
    "TS422": "keep the arm bent: shorten the motion, or start elsewhere",
    "TS424": "move more slowly, or start in another posture",
    "TS425": "shorten the motion, or end the stage before",
    "TS426": "move more slowly, or raise the limit",
    "TS429": "move more slowly, hold its axes more stiffly, or raise the limit",
    "TS443": "move more slowly",
    "TS444": "approach more slowly, or press with less",
    "TS616": "approach more slowly, press with less, or raise the limit",
    "TS611": "change the number that it compares with, or give the stage more time",
    "TS617": "give it more time or travel, or move faster",
    "TS618": "let it begin beyond what the stage comes to",
    "TS621": "see what the stage does up to there: `taskspec run` keeps its log",
}


def reported(trials: Sequence[Trial]) -> Iterator[Finding]:
    """The findings about trials of one world, each past the limit that stopped the one before.

    What follows in the stage of a limit that was passed is its consequence, and left out.
    """
    ended: set[str] = set()
    for each, further in zip(trials, [*trials[1:], None], strict=True):
        if each.outcome.status not in ("done", OPEN) and each.outcome.stage not in ended:
            yield _end(each, further)
        ended.add(each.outcome.stage)
    last = trials[-1]
    if last.outcome.status == "done":
        passed = {each.outcome.stage for each in trials[:-1]}
        for finding in last.faults:
            if finding.stage not in passed:
                yield _of_run(last, finding)
        expectations = last.program.context.loaded.task.expect
        for expectation, judged in zip(expectations, last.judged, strict=True):
            if judged.missed:
                yield _missed(last, judged, expectation.expression.span)
    if not trials[0].good and trials[0].outcome.status != OPEN:
        yield from _early_guards(trials[0])


# --- how a trial ended ---------------------------------------------------------------------------


def _end(trial: Trial, further: Trial | None) -> Finding:
    """How a trial did not come to its end."""
    outcome = trial.outcome
    visit = _last_visit(trial, outcome.stage)
    stage = next(s.plan for s in trial.program.stages if s.name == outcome.stage)
    name = trial.transitions[-1].name if trial.transitions else outcome.reason
    own = FILE.stages[outcome.stage]
    does = "stops the run" if outcome.status == "stopped" else "fails"
    if visit is None:
        return warning("TS621", f"in the trial, stage {stage.name!r} {does}: {outcome.text}", own)
    moment = Moment(trial, visit)
    code, place, cause = _explained(moment, name, outcome.text)
    text = f"in the trial, stage {stage.name!r} {does} {moment.when}: {outcome.text}"
    if further is not None:
        text += _peak(further, stage, name)
    notes: tuple[tuple[str, Place], ...] = ()
    if cause is not None:
        text += f"; {cause.text}"
        if cause.place is not None and cause.place != place:
            notes = (("what led there", cause.place),)
    return warning(code, text, place, _REMEDIES[code] if cause is None else cause.hint, notes)


def _explained(moment: Moment, name: str, text: str) -> tuple[str, Place, Cause | None]:
    """Code, place and cause of an end by the event of a name."""
    stage, own = moment.stage, FILE.stages[moment.stage.name]
    limits = stage.spec.limits
    motion: Place = motion_of(stage) if stage.spec.axes or stage.spec.path else own
    if name in ("force", "torque"):
        place = own.limits[name] if limits is not None and getattr(limits, name) else motion
        return _LIMIT_CODES[name], place, _of_force(moment)
    if name in ("speed", "deviation"):
        place = own.limits[name] if limits is not None and getattr(limits, name) else motion
        return _LIMIT_CODES[name], place, first_cause(moment, *_MOTION_CAUSES)
    if name in ("joint_position", "joint_velocity"):
        return "TS424", motion, _of_joint(moment, name, text)
    if name in _LIMIT_CODES:
        return _LIMIT_CODES[name], motion, None
    if name == PROTECTION:
        if about_force(text):
            return "TS444", motion, _of_force(moment)
        return "TS443", motion, first_cause(moment, *_MOTION_CAUSES)
    if name == events.FAIL_IF:
        expression = stage.spec.fail_if
        assert expression is not None
        return "TS618", own.fail_if, _of_guard(moment, expression.tree)
    if name in ("time", "travel"):
        return _of_bound(moment, name)
    if name == events.ATTEMPTS:
        return "TS618", own, None
    return "TS621", own, first_cause(moment, *_MOTION_CAUSES)


_FORCE_CAUSES = (causes.sensor_error, causes.blow, causes.motion_into_contact)
_MOTION_CAUSES = (causes.runaway, causes.reference_speed)


def _of_force(moment: Moment) -> Cause | None:
    return first_cause(moment, *_FORCE_CAUSES)


def _of_joint(moment: Moment, name: str, text: str) -> Cause | None:
    """Why a joint came to its limit; `text` names it."""
    found = causes.runaway(moment)
    if found is not None:
        return found
    robot = moment.stage.context.robot
    joint = next((i for i in range(robot.pin.nv) if f"of joint {i + 1} " in f"{text} "), None)
    if joint is None:
        return None
    if name == "joint_position":
        return causes.turned_joint(moment, joint)
    return causes.fast_joint(moment, joint)


def _of_guard(moment: Moment, guard: Node) -> Cause | None:
    """Why a guard held, where it is about forces that are not those of a contact."""
    after = min(moment.row + 1, len(moment.trial.history) - 1)
    then = Moment(moment.trial, moment.visit, after)
    if not _feels(guard):
        return None
    return causes.sensor_error(then) or causes.sensor_error(moment)


def _of_bound(moment: Moment, name: str) -> tuple[str, Place, Cause | None]:
    """A stage that its bound on time or travel ended."""
    stage, until = moment.stage, moment.stage.spec.until
    place = FILE.stages[stage.name].within[name]
    if until is None:
        return "TS617" if name == "travel" else "TS611", place, None
    if _feels(until.tree) and (apart := causes.left_apart(moment)) is not None:
        return "TS617", place, apart
    found = causes.sensor_error(moment) if _feels(until.tree) else None
    code = "TS617" if name == "travel" else "TS611"
    return code, place, found or _extremes(moment, until.tree)


def _extremes(moment: Moment, guard: Node) -> Cause | None:
    """Between which values the signals of a guard were that did not hold."""
    ranges = []
    for signal in dict.fromkeys(n for n in walk(guard) if isinstance(n, Name)):
        column = str(signal)
        measured = f"{column}.measured"
        column = measured if moment.has(measured) else column
        if signal.frame is not None or not moment.has(column):
            continue
        values = moment.stretch(column)
        values = values[np.isfinite(values)]
        unit = moment.trial.history.units.get(column, "")
        if len(values):
            low, high = float(values.min()), float(values.max())
            ranges.append(f"{signal} was {low:.3g} to {high:.3g} {unit}".rstrip())
    if not ranges:
        return None
    text = f"`until` did not hold: {', '.join(ranges)}"
    return Cause(text, "change the number that it compares with, or give the stage more time")


def _peak(further: Trial, stage: StagePlan, name: str) -> str:
    """How far beyond a limit the trial goes that passes it."""
    visit = _last_visit(further, stage.name)
    kind = {"force": "force", "torque": "torque"}.get(name)
    if visit is None or kind is None:
        return ""
    moment = Moment(further, visit)
    names = [f"{kind}.{a}" for a in stage.axes if a.effort == kind]
    if not names:
        return ""
    most = float(np.linalg.norm([moment.stretch(each) for each in names], axis=0).max())
    if not math.isfinite(most):
        return ""
    return f" (without the limit it comes to {show(most, 'N' if kind == 'force' else 'N*m', 3)})"


# --- guards that held too early ------------------------------------------------------------------


def _early_guards(trial: Trial) -> Iterator[Finding]:
    """Guards before a bad end that held with nothing touched, or from their first tick on."""
    for visit, transition in zip(trial.history.visits(), trial.transitions, strict=False):
        stage = next(s.plan for s in trial.program.stages if s.name == visit.stage)
        guard = stage.spec.until
        if transition.kind != events.UNTIL or guard is None or transition.stage != visit.stage:
            continue
        held = _held(guard.tree)
        ended = Moment(trial, visit)
        if _feels(guard.tree) and not ended.touches:
            cause = _of_guard(ended, guard.tree)
            if cause is not None:
                yield warning(
                    "TS614",
                    f"in the trial, this holds {ended.when} with nothing touched; {cause.text}",
                    FILE.stages[visit.stage].until,
                    cause.hint,
                )
                continue
        lasted = (visit.last + 1 - visit.first) * stage.context.period
        if lasted <= held + _FIRST_TICKS * stage.context.period:
            yield warning(
                "TS613",
                f"in the trial, this holds from the first tick of stage {visit.stage!r} on, so the "
                "stage ends as it begins",
                FILE.stages[visit.stage].until,
                "turn the relation round, wait for more than is there already, or leave it out",
            )


def _held(node: Node) -> float:
    """For how long a guard has to hold [s]."""
    return node.amount.value_si if isinstance(node, Held) else 0.0


def _feels(node: Node) -> bool:
    """Whether a guard is about what a sensor measures."""
    sensed = {"force", "torque", "touching"}
    return any(isinstance(n, Name) and {n.path[0], n.path[-1]} & sensed for n in walk(node))


# --- what is wrong with a run that ended well ----------------------------------------------------


def _of_run(trial: Trial, finding: RunFinding) -> Finding:
    """An oscillation or a saturation of a stage."""
    stage = next(s.plan for s in trial.program.stages if s.name == finding.stage)
    place = motion_of(stage) if stage.spec.axes or stage.spec.path else FILE.stages[stage.name]
    oscillates = finding.kind == OSCILLATION
    return warning(
        "TS502" if oscillates else "TS427",
        f"in the trial, {finding.text} (stage {finding.stage!r}, run time "
        f"{show(finding.start, 's', 3)} to {show(finding.end, 's', 3)})",
        place,
        "lower the gains of its loop, or approach more slowly"
        if oscillates
        else "command less, or start where the arm bears it better",
    )


def _missed(trial: Trial, judged: Judged, place: Place | None) -> Finding:
    """An expectation that a trial misses."""
    finders: list[Callable[[], Cause | None]] = [
        lambda: _error_at_break(trial, judged),
        lambda: _swinging(trial, judged),
        lambda: _late(trial, judged),
    ]
    cause = next((found for find in finders if (found := find()) is not None), None)
    text = f"the trial misses this: {judged.explanation}"
    hint = "change what moves the stage, or expect what it comes to"
    notes: tuple[tuple[str, Place], ...] = ()
    if cause is not None:
        text, hint = f"{text}; {cause.text}", cause.hint
        notes = (("what led there", cause.place),) if cause.place is not None else ()
    return warning("TS726", text, place, hint, notes)


def _error_at_break(trial: Trial, judged: Judged) -> Cause | None:
    """A force that misses its bound since it is measured as another one."""
    if judged.stage is None or not (judged.signal or "").startswith(("force", "torque")):
        return None
    visit = _last_visit(trial, judged.stage)
    return None if visit is None else causes.sensor_error(Moment(trial, visit))


def _swinging(trial: Trial, judged: Judged) -> Cause | None:
    """A signal that swings while its stage goes on."""
    for finding in trial.findings:
        if finding.kind == OSCILLATION and finding.stage == judged.stage:
            return Cause(finding.text, "lower the gains of its loop, or lower the delay in it")
    return None


def _late(trial: Trial, judged: Judged) -> Cause | None:
    """A signal that comes into its band, and stays there, but too late."""
    if judged.stage is None or judged.band is None or judged.signal is None:
        return None
    visit = _last_visit(trial, judged.stage)
    if visit is None or judged.signal not in trial.history.columns:
        return None
    values = Moment(trial, visit).stretch(judged.signal)
    low, high = judged.band
    inside = np.ones(len(values), bool)
    inside &= values >= (-math.inf if low is None else low)
    inside &= values <= (math.inf if high is None else high)
    if not inside[-1]:
        return None
    first = int(np.flatnonzero(~inside)[-1]) + 1 if not inside.all() else 0
    if first == 0:
        return None
    t = float(trial.history.columns["t"][visit.first + first])
    return Cause(
        f"it holds from t = {show(t, 's', 3)} of the stage on",
        "let the stage last longer, raise the gains of its loop, or expect it for less of it",
    )


def _last_visit(trial: Trial, stage: str) -> Visit | None:
    return next((v for v in reversed([*trial.history.visits()]) if v.stage == stage), None)
