"""A task that would tell what logs do not: presses, slides and turns within a file's limits.

Its amplitude is the largest of some that are safe, in the file's world and with its contact twice
as stiff and half as stiff. Its length is the shortest of some of which the intervals, identified
from a trial of it, are as narrow as wanted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from taskspec.compiler import compile_unchecked
from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import TRANSLATIONS, Axis
from taskspec.program.components import changed
from taskspec.program.plan import StagePlan
from taskspec.program.program import Program
from taskspec.program.worlds import World
from taskspec.spec import LoadedTask, Task, load_text
from taskspec.spec.patch import without
from taskspec.spec.robot import Noise
from taskspec.text import nodes
from taskspec.text.diagnostic import Severity, SpecError
from taskspec.text.units import number
from taskspec_runner.errors import InputError
from taskspec_runner.identify.estimate import Estimate
from taskspec_runner.identify.identification import Identification, identify
from taskspec_runner.identify.parameters import Parameter, parameters_of
from taskspec_runner.trial.check import check
from taskspec_runner.trial.trial import Trial, trial
from taskspec_runner.verdict.metrics import peaks

#: Sections of the file that the new task has none of, or its own.
_OTHERS = ("name", "about", "templates", "stages", "expect", "vary", "sweep", "truth")
#: Amplitudes that are tried, as shares of the largest, and lengths, as multiples of the shortest.
_AMPLITUDES, _LENGTHS = (1.0, 0.6, 0.35, 0.2), (1.0, 2.0, 4.0, 8.0)
#: Of the limit on forces: the contact that ends an approach, a light press, the mean and the swing
#: of a hard one, and what no trial comes above.
_TOUCH, _LIGHT, _MEAN, _SWING, _MOST = 0.08, 0.15, 0.4, 0.25, 0.9
#: A force that surely is a contact and no noise, in standard deviations.
_SURE = 8.0
#: Of a file without a limit on forces, times its own set point.
_OF_SET_POINT = 2.0
#: Noise of the sensor where neither the file nor a log has any [N, N m].
_NOISE = Noise(force=0.1, torque=0.005)
#: Of what a value plausibly may be, that one is expected to be that the file has not.
_THERE = 0.1
#: Contacts that have to be safe, times the stiffness of the file.
_STIFFNESSES = (1.0, 0.5, 2.0)
#: Turns in the air [deg], slides [mm/s] and periods [s]: of the swing of a press, of two slides.
_TURN, _SLIDE, _PERIODS = 15.0, 30.0, (0.4, 0.9, 0.7)


@dataclass(frozen=True, slots=True)
class Predicted:
    """What the designed task would tell of a value.

    Attributes:
        estimate: as a trial of it has the value.
        half: half of its interval [SI].
        wanted: what that is to be at most [SI].
    """

    estimate: Estimate
    half: float
    wanted: float

    @property
    def met(self) -> bool:
        """Whether it is as narrow as wanted."""
        return self.half <= self.wanted


@dataclass(frozen=True, slots=True)
class DesignedTask:
    """A task that would identify something.

    Attributes:
        text: of its file.
        predicted: of each value that it tells.
        unidentified: names of wanted values that it does not identify.
        remarks: about what was assumed.
        duration: of its trial [s].
        peak: largest force in trials [N].
        limit: that it stays below [N].
    """

    text: str
    predicted: tuple[Predicted, ...]
    unidentified: tuple[str, ...]
    remarks: tuple[str, ...]
    duration: float
    peak: float
    limit: float

    @property
    def met(self) -> bool:
        """Whether every wanted value would be known as well as wanted."""
        return not self.unidentified and all(each.met for each in self.predicted)

    def as_data(self) -> dict[str, Any]:
        """For scripts, in SI."""
        return {
            "met": self.met,
            "duration": self.duration,
            "peak": self.peak,
            "limit": self.limit,
            "predicted": [
                each.estimate.as_data() | {"half": each.half, "wanted": each.wanted}
                for each in self.predicted
            ],
            "unidentified": list(self.unidentified),
            "remarks": list(self.remarks),
        }


@dataclass(frozen=True, slots=True)
class _Press:
    """Where a file presses.

    Attributes:
        frame: of the stage.
        axis: along which.
        way: 1 or -1, which way it presses.
        thing: what it presses on.
        limit: on forces [N].
        law: of the stage, as its file has it; empty for that of the task.
    """

    frame: str
    axis: Axis
    way: int
    thing: str
    limit: float
    law: str


def design(
    loaded: LoadedTask,
    what: Sequence[str] | None,
    width: float,
    level: float,
    known: Identification | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> DesignedTask:
    """A task that would tell values of a file's world and arm.

    Args:
        loaded: the file; its `truth` is not used.
        what: paths of what is to be known; None for all.
        width: half of an interval at most, as a share of the value, or of what it plausibly may be
            where it is 0.
        level: of the intervals.
        known: what logs say, whose world and noise it is designed for; None for those of the file.
        progress: is called with what is being done.

    Raises:
        InputError: no stage of the file presses, or no amplitude is safe.
        SpecError: the file does not compile.
    """
    program = compile_unchecked(loaded)
    press = _press_of(program)
    wanted = parameters_of(program, what)
    task, remarks = _expected(loaded, known, wanted)
    needed = {each.path for each in wanted}
    rest = without(loaded.source.text, _OTHERS).rstrip("\n")
    noise = task.robot.sensor.noise

    def text(amplitude: float, length: float) -> str:
        stages = "\n".join(_stages(press, needed, amplitude, length, noise))
        return f"{rest}\nname: {loaded.task.name}-identify\nstages:\n{stages}\n"

    amplitude, peak = _safe(lambda a: text(a, _LENGTHS[0]), loaded, press, task, progress)
    best: DesignedTask | None = None
    for length in _LENGTHS:
        progress(f"intervals of a task {length:g} times as long as the shortest")
        written = text(amplitude, length)
        made = _compiled(written, loaded)
        run = trial(made, World(task))
        if not run.good:
            break
        found = identify(made, [run.history], what, level)
        predicted = tuple(_predicted(found.estimates, wanted, width))
        found_names = {each.estimate.name for each in predicted}
        unidentified = tuple(
            each.name for each in wanted if not any(n.startswith(each.name) for n in found_names)
        )
        best = DesignedTask(
            written, predicted, unidentified, remarks, run.outcome.clock, peak, press.limit
        )
        if all(each.met for each in predicted):
            break
    if best is None:
        raise InputError("the designed task does not come to its end in a trial")
    return best


def _press_of(program: Program) -> _Press:
    """The hardest press of a file along one axis.

    Raises:
        InputError: no stage presses.
    """
    best: tuple[float, StagePlan, Axis] | None = None
    for stage in program.stages:
        for axis, force in stage.plan.set_points.constant.items():
            pressing = axis in TRANSLATIONS and stage.plan.contacts.main
            if pressing and (best is None or abs(force) > abs(best[0])):
                best = (force, stage.plan, axis)
    if best is None:
        raise InputError(
            "no stage of this task presses with a constant force, so nothing says where a designed "
            "task may touch: add one, such as press: {axes: {z: {force: -10 N}}, time: 1 s}"
        )
    force, plan, axis = best
    root = program.context.loaded.root
    node, depth = nodes.find(root, ("stages", plan.name, "law"))
    law = nodes.in_one_line(node) if depth == len(("stages", plan.name, "law")) else ""
    limit = plan.limits.force
    most = _OF_SET_POINT * abs(force) if limit is None else float(limit)
    return _Press(plan.frame.name, axis, 1 if force > 0 else -1, str(plan.contacts.main), most, law)


def _expected(
    loaded: LoadedTask, known: Identification | None, wanted: Sequence[Parameter]
) -> tuple[Task, tuple[str, ...]]:
    """The task whose world and sensor a designed one is expected to meet, and what was assumed."""
    task = loaded.task if known is None else known.task
    noise, remarks = task.robot.sensor.noise, []
    if known is not None:
        white = {
            unit: max((r.white for r in known.residuals if r.unit == unit), default=0.0)
            for unit in ("N", "N*m")
        }
        if white["N"] > 0:
            noise = Noise(force=white["N"], torque=white["N*m"])
            remarks.append(f"the noise is that of the logs, {number(white['N'], 2)} N")
    if noise is None or not (noise.force or noise.torque):
        noise = _NOISE
        remarks.append(
            "the file's sensor has no noise, so intervals are predicted with "
            f"{number(noise.force, 2)} N and {number(1e3 * noise.torque, 2)} mN*m: give "
            "robot.sensor.noise what the sensor has"
        )
    sensor = task.robot.sensor.model_copy(update={"noise": noise})
    robot = task.robot.model_copy(update={"sensor": sensor})
    task = task.model_copy(update={"robot": robot})
    for each in wanted:
        # What is not there shows nothing of itself: at the end of what it may be it has no spread.
        if each.least == 0 and each.declared == 0 and not each.path.startswith("robot.sensor"):
            task = changed(task, each.path, each.index, _THERE * each.scale)
            shown = number(_THERE * each.scale, 3)
            remarks.append(f"{each.name} is 0 in the file; it is expected as {shown} {each.unit}")
    return task, tuple(remarks)


def _stages(
    press: _Press, needed: set[str], amplitude: float, length: float, noise: Noise | None
) -> Iterator[str]:
    """The lines of the stages that tell what is needed."""
    sign = "-" if press.way < 0 else ""
    across = [axis for axis in TRANSLATIONS if axis != press.axis]
    law = f"\n    law: {press.law}" if press.law else ""
    frame = f"\n    frame: {press.frame}"
    if any(
        path.startswith(("robot.payload", "robot.sensor.bias", "robot.joint")) for path in needed
    ):
        turn = f"{number(_TURN * amplitude, 3)} deg"
        for name, way in (("lean", ""), ("back", "-")):
            both = ", ".join(f"{a}: {{move: {way}{turn}, speed: 20 deg/s}}" for a in ("rx", "ry"))
            yield f"  {name}:\n    frame: world\n    axes: {{{both}}}"
        yield f"  rest:\n    frame: world\n    time: {number(0.3 * length, 3)} s"
    touching = any(path.startswith("world.") for path in needed)
    if not (touching or any(path.startswith("robot.sensor") for path in needed)):
        return
    least = _SURE * (noise.force if noise is not None else 0.0)
    touch = max(_TOUCH * press.limit, least)
    side = "<" if press.way < 0 else ">"
    yield (
        f"  approach:{frame}{law}\n    axes: {{{press.axis}: {{velocity: {sign}15 mm/s}}}}\n"
        f"    until: force.{press.axis} {side} {sign}{number(touch, 3)} N for 10 ms\n"
        f"    within: 8 s"
    )
    light, mean, swing = (
        number(share * amplitude * press.limit, 3) for share in (_LIGHT, _MEAN, _SWING)
    )
    swinging, *sliding = _PERIODS
    yield (
        f"  light:{frame}{law}\n    axes: {{{press.axis}: {{force: {sign}{light} N}}}}\n"
        f"    time: {number(0.5 * length, 3)} s"
    )
    slides = "".join(
        f"\n      {axis}: {{velocity: {number(_SLIDE * amplitude, 3)} mm/s*sin(2*pi*t/({per} s))}}"
        for axis, per in zip(across, sliding, strict=True)
    )
    inner = f"({mean} N + {swing} N*sin(2*pi*t/({swinging} s)))"
    yield (
        f"  swing:{frame}{law}\n    axes:\n      {press.axis}: {{force: {sign}{inner}}}{slides}\n"
        f"    time: {number(1.2 * length, 3)} s"
    )
    away = "" if press.way < 0 else "-"
    yield f"  lift:{frame}\n    axes: {{{press.axis}: {{move: {away}20 mm, speed: 40 mm/s}}}}"


def _compiled(text: str, loaded: LoadedTask) -> Program:
    return compile_unchecked(load_text(text, loaded.source.name, None, loaded.base))


def _safe(
    text: Callable[[float], str],
    loaded: LoadedTask,
    press: _Press,
    task: Task,
    progress: Callable[[str], None],
) -> tuple[float, float]:
    """The largest amplitude that is safe, and the largest force that trials of it have [N].

    Raises:
        InputError: none is.
    """
    why = ""
    for amplitude in _AMPLITUDES:
        progress(f"trials at {100 * amplitude:g} % of the largest amplitude")
        try:
            made = load_text(text(amplitude), loaded.source.name, None, loaded.base)
        except SpecError as error:
            raise InputError(
                f"the file leaves no room for a designed task: {error.diagnostics[0].message}"
            ) from error
        errors = [e for e in check(made).findings if e.severity is Severity.ERROR]
        if errors:
            why = errors[0].message
            continue
        program = compile_unchecked(made)
        most = 0.0
        for factor in _STIFFNESSES:
            run = trial(program, World(_stiffer(program, task, press.thing, factor)))
            most = max(most, _peak(run, program))
            if not run.good:
                why = run.outcome.text
                break
        else:
            if most <= _MOST * press.limit:
                return amplitude, most
            why = f"it comes to {number(most, 3)} N of {number(press.limit, 3)} N"
    raise InputError(f"no designed task was safe in trials: {why}")


def _stiffer(program: Program, task: Task, thing: str, factor: float) -> Task:
    """The task with a contact of another stiffness; a rigid one stays."""
    path = f"world.{thing}.stiffness"
    shape = task.shapes.get(thing)
    if factor == 1 or shape is None or isinstance(shape.stiffness, str):
        return task
    return changed(task, path, None, factor * program.context.compliances[thing].stiffness)


def _peak(run: Trial, program: Program) -> float:
    found = peaks(run.history, [stage.name for stage in program.stages])
    return max((each["force"] for each in found.values()), default=0.0)


def _predicted(
    estimates: Sequence[Estimate], wanted: Sequence[Parameter], width: float
) -> Iterator[Predicted]:
    scales = {each.name: each.scale for each in wanted}
    for each in estimates:
        size = abs(each.value)
        scale = next((s for name, s in scales.items() if each.name.startswith(name)), size)
        placed = each.path.endswith((".xyz", ".rpy"))
        half = (each.high - each.low) / 2
        # A place has no size of its own: it counts from where the file has it.
        yield Predicted(each, half, width * (scale if placed or size < scale else size))


__all__ = ["DesignedTask", "Predicted", "design"]
