"""What is reported of a trial: each end at the key that it concerns, when it was, and its cause."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence

import numpy as np

from taskspec.expression.tree import Held, Name, Node, walk
from taskspec.laws.adaptation import described
from taskspec.program import events
from taskspec.program.plan import StagePlan
from taskspec.program.signals import entry_of
from taskspec.program.stages.protected import PROTECTION, about_force
from taskspec.rules.finding import Finding, Place, info, warning
from taskspec.rules.places import adaptation_of, motion_of
from taskspec.spec import FILE, KeyPath, key_of
from taskspec.spec.stage import OSCILLATION
from taskspec.stability.gain_paths import gain_path, law_path
from taskspec.stability.sampled_stage import loop_of
from taskspec.text.codes import register
from taskspec.text.units import MASS, scaled, show
from taskspec_runner.record.history import Visit
from taskspec_runner.trial import causes
from taskspec_runner.trial.causes import Cause, first_cause
from taskspec_runner.trial.moment import Moment
from taskspec_runner.trial.trial import OPEN, Trial
from taskspec_runner.verdict.energy import RunEnergies, gain_text
from taskspec_runner.verdict.judged import Judged
from taskspec_runner.verdict.payload import payload_block, unshown
from taskspec_runner.verdict.run_finding import RunFinding
from taskspec_runner.verdict.slips import slips
from taskspec_runner.verdict.tank import refusal

register(
    {
        "TS219": "a gain that stops being positive definite in the trial",
        "TS344": "an energy tank that refuses something in the trial",
        "TS422": "an arm that is singular on its way",
        "TS424": "a joint that comes to its limit",
        "TS425": "a motion that leaves what its frame follows",
        "TS346": "a payload as heavy as its bounds let it be",
        "TS426": "a tip that passes the limit on speed",
        "TS427": "a joint that is at its limit for much of a stage",
        "TS429": "a tool that passes the limit on its deviation",
        "TS428": "an arm that runs into an object",
        "TS443": "a motion beyond the robot's protection",
        "TS444": "a force beyond the robot's protection",
        "TS445": "a torque that changes faster than the robot's protection lets it",
        "TS508": "a stage that oscillates",
        "TS510": "a stage that gains energy in the trial, by gains that vary",
        "TS514": "a payload that the trial does not show",
        "TS521": "a body that slips in the gripper in the trial",
        "TS611": "a guard that does not hold in time",
        "TS613": "a guard that holds as its stage begins",
        "TS614": "a guard that holds with nothing touched",
        "TS616": "a force or moment that passes its limit",
        "TS617": "a bound that ends a stage before it comes to its surface",
        "TS618": "a failure that comes about",
        "TS621": "a run that breaks off",
        "TS622": "worlds of `vary` that end badly",
        "TS726": "an expectation that is missed",
    }
)


def about(message: str) -> Finding:
    """A trial that could not begin."""
    return warning("TS621", f"the run cannot begin: {message}", FILE.robot, "")


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
    "gain": "TS219",
}
#: A mode that is damped less than this is the one that shows in a noisy signal.
_PASSES_NOISE_ON = 0.3
#: Share of a signal's greatest value below which its least one counts as zero.
_NOTHING = 1e-6
#: What helps where no cause can be read off the trial.
_REMEDIES = {
    "TS219": "bound the expression: max(.., 100 N/m) of a stiffness",
    "TS422": "keep the arm bent: shorten the motion, or start elsewhere",
    "TS424": "move more slowly, or start in another posture",
    "TS425": "shorten the motion, or end the stage before",
    "TS426": "move more slowly, or raise the limit",
    "TS429": "move more slowly, hold its axes more stiffly, or raise the limit",
    "TS443": "move more slowly",
    "TS444": "approach more slowly, or press with less",
    "TS613": "turn the relation round, or let it begin beyond what is there already",
    "TS616": "approach more slowly, press with less, or raise the limit",
    "TS611": "change the number that it compares with, or give the stage more time",
    "TS617": "give it more time or travel, or move faster",
    "TS618": "let it begin beyond what the stage comes to",
    "TS621": "see what the stage does up to there: `taskspec run` keeps its log",
}


def reported(trials: Sequence[Trial]) -> Iterator[Finding]:
    """The findings about trials of one world, each past the limit that stopped the one before.

    What follows in the stage of a limit that was passed is its consequence, and left out; so is a
    stop in the first ticks of the stage after it.
    """
    ended: set[str] = set()
    for each, further in zip(trials, [*trials[1:], None], strict=True):
        if each.outcome.status not in ("done", OPEN) and not _follows(each, ended):
            yield _end(each, further)
        ended.add(each.outcome.stage)
    last = trials[-1]
    yield from _slips(last)
    if last.outcome.status == "done":
        passed = {each.outcome.stage for each in trials[:-1]}
        for finding in last.faults:
            if finding.stage not in passed:
                yield _of_run(last, finding)
        yield from _gained(last)
        yield from _refused(last)
        yield from _adapted(last)
        expectations = last.program.context.loaded.task.expect
        for expectation, judged in zip(expectations, last.judged, strict=True):
            if judged.missed:
                yield _missed(last, judged, expectation.expression.span)
    yield from _early_guards(trials[0])


def _follows(trial: Trial, ended: Collection[str]) -> bool:
    """Whether an end is the consequence of one in the stages that have ended already."""
    outcome, transitions = trial.outcome, trial.transitions
    if outcome.stage in ended:
        return True
    visit = _last_visit(trial, outcome.stage)
    before = transitions[-2].stage if len(transitions) > 1 else ""
    return visit is not None and before in ended and visit.last - visit.first < _FIRST_TICKS


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
        text = f"in the trial, stage {stage.name!r} {does}: {outcome.text}"
        return warning("TS621", text, key_of(own))
    moment = Moment(trial, visit)
    code, place, cause = _explained(moment, name, outcome.text)
    if cause is not None and cause.place is not None and place == key_of(own):
        place = cause.place
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
    motion: Place = motion_of(stage)
    if name in ("force", "torque"):
        place = own.limits[name] if limits is not None and getattr(limits, name) else motion
        return _LIMIT_CODES[name], place, _of_force(moment)
    if name == "deviation":
        place = own.limits[name] if limits is not None and getattr(limits, name) else motion
        return _LIMIT_CODES[name], place, first_cause(moment, causes.runaway, causes.behind)
    if name == "speed":
        place = own.limits[name] if limits is not None and getattr(limits, name) else motion
        return _LIMIT_CODES[name], place, first_cause(moment, *_MOTION_CAUSES)
    if name in ("joint_position", "joint_velocity"):
        return "TS424", motion, _of_joint(moment, name, text)
    if name == "gain":
        return _LIMIT_CODES[name], _varying(stage), None
    if name in _LIMIT_CODES:
        return _LIMIT_CODES[name], motion, None
    if name == PROTECTION:
        if about_force(text):
            return "TS444", motion, _of_force(moment)
        return "TS443", motion, first_cause(moment, *_MOTION_CAUSES)
    if name == events.FAIL_IF:
        expression = stage.spec.fail_if
        assert expression is not None
        at_once = moment.value("t") <= _held(expression.tree) + _FIRST_TICKS * stage.context.period
        cause = _of_guard(moment, expression.tree)
        return "TS613" if at_once and cause is None else "TS618", own.fail_if, cause
    if name in ("time", "travel"):
        return _of_bound(moment, name)
    if name == events.ATTEMPTS:
        return "TS618", key_of(own), None
    return (
        "TS621",
        key_of(own),
        causes.no_number(text, stage) or first_cause(moment, *_MOTION_CAUSES),
    )


def _varying(stage: StagePlan) -> KeyPath:
    """Where the file has the first gain of a stage that varies."""
    name, on = stage.law.varying[0]
    return gain_path(stage.context, stage.name, name, on)


_FORCE_CAUSES = (
    causes.sensor_error,
    causes.commanded,
    causes.blow,
    causes.mechanism,
    causes.runaway,
    causes.motion_into_contact,
)
_MOTION_CAUSES = (causes.runaway, causes.reference_speed, causes.saturated)


def _of_force(moment: Moment) -> Cause | None:
    return first_cause(moment, *_FORCE_CAUSES)


def _of_joint(moment: Moment, name: str, text: str) -> Cause | None:
    """Why a joint came to its limit; `text` names it."""
    found = first_cause(moment, causes.runaway, causes.saturated)
    if found is not None:
        return found
    robot = moment.stage.context.robot
    joint = next((i for i in range(robot.n) if f"of joint {i + 1} " in f"{text} "), None)
    if joint is None:
        return None
    if name == "joint_position":
        return causes.turned_joint(moment, joint)
    return causes.fast_joint(moment, joint)


def _of_guard(moment: Moment, guard: Node) -> Cause | None:
    """Why a guard held, where it is about forces that are not those of a contact."""
    named = _axes_of(guard)
    # The tick in which it held is the first of the next stage; of the last stage it is not logged.
    logged = moment.row + 1 < len(moment.trial.history)
    then = Moment(moment.trial, moment.visit, moment.row + logged)
    if not _feels(guard):
        return None
    return causes.sensor_error(then, named, reading=logged) or causes.sensor_error(moment, named)


def _of_bound(moment: Moment, name: str) -> tuple[str, Place, Cause | None]:
    """A stage that its bound on time or travel ended."""
    stage, until = moment.stage, moment.stage.spec.until
    place = FILE.stages[stage.name].within[name]
    if until is None:
        code = "TS617" if name == "travel" else "TS611"
        return code, place, causes.unfinished_path(moment)
    if _feels(until.tree) and (apart := causes.left_apart(moment)) is not None:
        return "TS617", place, apart
    found = causes.sensor_error(moment, _axes_of(until.tree)) if _feels(until.tree) else None
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
        entry = entry_of(moment.nominal, signal.path)
        if len(values) and entry is not None:
            least, most = float(values.min()), float(values.max())
            # What is nothing beside the other bound is shown as nothing.
            nothing = _NOTHING * max(abs(least), abs(most))
            low, high = (
                show(x if abs(x) > nothing else 0.0, entry.dimension, 3) for x in (least, most)
            )
            ranges.append(f"{signal} was {low} to {high}")
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
    """Guards about forces that held with nothing touched, or any from their first tick on.

    The latter are reported where the trial ends badly: a stage may be passed through on purpose.
    """
    bad = not trial.good and trial.outcome.status != OPEN
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
        at_once = lasted <= held + _FIRST_TICKS * stage.context.period
        if at_once and (bad or (_feels(guard.tree) and not ended.touches)):
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


def _axes_of(guard: Node) -> frozenset[str]:
    """The axes whose forces a guard is about; none for all of them."""
    named = (n.path for n in walk(guard) if isinstance(n, Name))
    return frozenset(path[-1] for path in named if len(path) > 1 and path[-2] == "force")


# --- what is wrong with a run that ended well ----------------------------------------------------


def _of_run(trial: Trial, finding: RunFinding) -> Finding:
    """An oscillation or a saturation of a stage."""
    stage = next(s.plan for s in trial.program.stages if s.name == finding.stage)
    place = motion_of(stage)
    text = (
        f"in the trial, {finding.text} (stage {finding.stage!r}, run time "
        f"{show(finding.start, 's', 3)} to {show(finding.end, 's', 3)})"
    )
    if finding.kind != OSCILLATION:
        hint = "move more slowly, command or carry less, or start where the arm bears it better"
        return warning("TS427", text, place, hint)
    visits = [visit for visit in trial.history.visits() if visit.stage == finding.stage]
    cause = causes.late_force(Moment(trial, visits[finding.visit - 1]), finding.frequency or 0.0)
    if cause is None:
        return warning("TS508", text, place, "lower the gains of its loop, or approach more slowly")
    return warning("TS508", f"{text}: {cause.text}", cause.place or place, cause.hint)


def _slips(trial: Trial) -> Iterator[Finding]:
    """Stages in which a body slides on the pads, or out of the jaws: the first of each."""
    hint = "press harder, move more gently, or answer it: fail_if: grip.slip > 1 mm"
    for slip in slips(trial.program.context.loaded.task, trial.history):
        stage = slip.visit.stage
        place = key_of(FILE.stages[stage])
        if slip.lost:
            text = f"in the trial, stage {stage!r} loses what is gripped: it slips out"
            yield warning("TS521", text, place, hint)
        else:
            far = show(slip.distance, "mm", 2)
            text = f"in the trial, what is gripped slips by {far} in stage {stage!r}"
            yield info("TS521", text, place, hint)


def _gained(trial: Trial) -> Iterator[Finding]:
    """Stages that gain energy by gains that vary: of others no energy is worked out."""
    varying = {s.name: s.plan for s in trial.program.stages if s.plan.law.varying}
    if not varying:
        return
    clock = trial.history.columns["clock"]
    for each in RunEnergies(trial.program, trial.history, trial.world.task).visits:
        data = each.as_data(clock)
        if each.visit.stage in varying and data.get("gained", {}).get("by") == "gains":
            place = _varying(varying.pop(each.visit.stage))
            text = f"in the trial, {gain_text(data)}"
            hint = "let them rise more slowly, or with more damping"
            yield info("TS510", text, place, hint, unless=("TS509", "TS510"))


def _refused(trial: Trial) -> Iterator[Finding]:
    """Stages whose tank refuses something of what their law commands."""
    tanks = {s.name: s.plan for s in trial.program.stages if s.plan.law.tank is not None}
    if not tanks:
        return
    clock = trial.history.columns["clock"]
    for each in RunEnergies(trial.program, trial.history, trial.world.task).visits:
        data = each.as_data(clock)
        if each.visit.stage in tanks and "time" in data.get("tank", {}):
            plan = tanks.pop(each.visit.stage)
            text = f"in the trial, {refusal(plan.name, data['tank'])}"
            hint = "that is its purpose; where it should not, give it more energy, or more power"
            place = law_path(plan.context, plan.name).tank
            yield info("TS344", text, place, hint, unless=("TS511", "TS512", "TS344"))


def _adapted(trial: Trial) -> Iterator[Finding]:
    """A payload that a trial does not show, or that is beyond what it is let be."""
    data = payload_block(trial.program, trial.history).get("payload")
    if data is None:
        return
    stage = next(s.plan for s in trial.program.stages if s.plan.adapt is not None)
    place = adaptation_of(stage)
    if data["at_bound"]:
        text = f"in the trial, the payload comes to {scaled(data['mass'], MASS, 3)}, its bound"
        hint = "let 'mass' go further, or see what else the arm carries or is pushed by"
        yield warning("TS346", text, place, hint)
    missing = unshown(data)
    if missing:
        text = (
            f"in the trial, the stages that adapt do not show the payload's {described(missing)}: "
            "that stays near its first value"
        )
        hint = "let one of them turn the tool, each axis out of the vertical; or leave it as it is"
        yield info("TS514", text, place, hint)


def _missed(trial: Trial, judged: Judged, place: Place | None) -> Finding:
    """An expectation that a trial misses."""
    finders = (_error_at_break, _blown, _swinging, _noisy, _commanded_outside, _late)
    cause = next((found for find in finders if (found := find(trial, judged)) is not None), None)
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


def _blown(trial: Trial, judged: Judged) -> Cause | None:
    """A force whose greatest value is that of a touch with a speed."""
    if not judged.signals or not all("force" in each.split(".") for each in judged.signals):
        return None
    visits = [v for v in trial.history.visits() if judged.stage in (None, v.stage)]
    peaks = [
        Moment(trial, visit, visit.first + int(np.argmax(sizes)))
        for visit in visits
        if len(sizes := _sizes_of_force(trial, visit))
    ]
    if not peaks:
        return None
    return causes.blow(max(peaks, key=lambda each: float(np.linalg.norm(each.force()))))


def _sizes_of_force(trial: Trial, visit: Visit) -> np.ndarray:
    """(k,) of the force in each tick of a visit [N]."""
    moment = Moment(trial, visit)
    columns = [moment.stretch(f"force.{axis}") for axis in moment.axes]
    return np.linalg.norm(np.nan_to_num(columns), axis=0) if columns else np.zeros(0)


def _commanded_outside(trial: Trial, judged: Judged) -> Cause | None:
    """A signal whose set point itself leaves the band."""
    reference = f"{judged.signal}.ref"
    if judged.stage is None or judged.band is None or reference not in trial.history.columns:
        return None
    visit = _last_visit(trial, judged.stage)
    if visit is None:
        return None
    moment = Moment(trial, visit)
    entry = entry_of(moment.nominal, tuple(str(judged.signal).split(".")))
    # In the first half a force may still be handed over.
    values = moment.stretch(reference)
    values = values[len(values) // 2 :]
    low, high = (bound if bound is not None else math.nan for bound in judged.band)
    if entry is None or not (np.any(values < low) or np.any(values > high)):
        return None
    least, most = (show(float(x), entry.dimension, 3) for x in (values.min(), values.max()))
    return Cause(
        f"its set point itself goes from {least} to {most}",
        "widen this by what the set point changes, or expect its mean",
    )


def _swinging(trial: Trial, judged: Judged) -> Cause | None:
    """A signal that swings while its stage goes on."""
    for finding in trial.findings:
        if finding.kind == OSCILLATION and finding.stage == judged.stage:
            return Cause(finding.text, "lower the gains of its loop, or lower the delay in it")
    return None


def _noisy(trial: Trial, judged: Judged) -> Cause | None:
    """A force that swings by more than its band, by noise that its loop passes on."""
    noise = trial.world.task.robot.sensor.noise
    if noise is None or judged.stage is None or judged.band is None or judged.signal is None:
        return None
    visit, (low, high) = _last_visit(trial, judged.stage), judged.band
    if visit is None or low is None or high is None or not judged.signal.startswith("force"):
        return None
    values = Moment(trial, visit).stretch(judged.signal)
    spread = float(np.std(values[len(values) // 2 :]))
    if spread < (high - low) / 4:
        return None
    text = (
        f"by the end of the stage {judged.signal} has a standard deviation of "
        f"{show(spread, 'N', 2)}, of a sensor's noise of {show(noise.force, 'N', 2)}"
    )
    analysed = loop_of(trial.program.plan, judged.stage)
    swinging = [] if analysed is None else [m for m in analysed.modes() if m.frequency > 0]
    mode = min(swinging, key=lambda m: m.damping_ratio, default=None)
    if mode is not None and mode.damping_ratio < _PASSES_NOISE_ON:
        text += (
            f": its loop has a mode of {mode.frequency:.3g} Hz with a damping ratio of "
            f"{mode.damping_ratio:.2g}, which amplifies it"
        )
    return Cause(text, "lower the force gains, shorten the sensor's delay, or give it a filter")


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
