"""A stage as a function of a program: it returns the number of the stage that follows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression
from taskspec.geometry.axis import AXES, Axis
from taskspec.modes import FreeAxis, Hold
from taskspec.motion.joint_path import JointPath
from taskspec.program.execution.transition import FAIL
from taskspec.program.plan import StagePlan
from taskspec.spec import FILE, KeyPath, Limits
from taskspec.text.units import LENGTH, TIME, show
from taskspec_runner.urscript import losses
from taskspec_runner.urscript.expressions import UntranslatableError
from taskspec_runner.urscript.references import MotionLines, MotionWriter, by_rates, stands
from taskspec_runner.urscript.script import (
    Loss,
    NamedValues,
    ScriptLines,
    ScriptSection,
    listed,
    number,
)
from taskspec_runner.urscript.signals import Reader

#: A force that a compliant axis is given has it move at no less than this in free space [m/s].
_SLOWEST = 0.01


class PartError(Exception):
    """A part of a stage has no counterpart in URScript.

    Attributes:
        place: of the expression.
        error: which part, and why.
    """

    def __init__(self, place: KeyPath, error: UntranslatableError, expression: Expression) -> None:
        super().__init__(str(error))
        self.place, self.error, self.expression = place, error, expression


@dataclass(frozen=True, slots=True)
class Counted:
    """What a program counts because something in the task reads it.

    Attributes:
        clock: the time since the task began.
        visits: stages whose entries are counted.
    """

    clock: bool
    visits: frozenset[str]


class StageWriter:
    """Writes the function of a stage."""

    def __init__(
        self,
        stage: StagePlan,
        following: str,
        frame: str,
        reader: Reader,
        numbers: Mapping[str, str],
        prefix: str,
        counted: Counted,
        outer: NamedValues,
        follows: Sequence[str] = (),
    ) -> None:
        """Of a stage.

        Args:
            stage: its plan.
            following: name of the next stage of the file, `end` after the last one.
            frame: expression of its frame in the base as the stage starts.
            reader: of its signals.
            numbers: names of the stages' numbers in the program, `end` among them.
            prefix: of the stage's names.
            counted: what the program counts.
            outer: named values of the program.
            follows: lines of each control period in which params follow what they are set to.
        """
        self._counted, self._follows = counted, follows
        self._stage, self._following, self._frame = stage, following, frame
        self._reader, self._numbers, self._prefix = reader, numbers, prefix
        self._constants = NamedValues(outer)
        self._place = FILE.stages[stage.name]
        self._losses: list[Loss] = losses.of_stage(stage)
        pressed = {
            axis: plan
            for axis, plan in stage.plans.items()
            if stage.joint_path is None and (plan.set_point or isinstance(plan.mode, FreeAxis))
        }
        self._pressed = pressed

    def section(self, title: str, quoted: Iterable[str], function: str) -> ScriptSection:
        """The stage as a part of the program.

        Raises:
            PartError: a part has no counterpart.
        """
        if self._stage.joint_path is not None:
            lines = self._joints(function)
        else:
            lines = self._cartesian(function)
        return ScriptSection(title, tuple(quoted), self._losses, self._constants.all, lines)

    # The tool

    def _cartesian(self, function: str) -> list[str]:
        stage, reader = self._stage, self._reader
        motion = self._motion()
        forces = self._forces()
        ending = self._ending(motion)
        self._losses += motion.losses
        out = ScriptLines()
        with out.block(f"def {function}():"):
            out.add(f'textmsg(PROGRAM, "stage {stage.name}")')
            self._count(out)
            if self._pressed:
                out.add("start_force_mode()")
            else:
                out.add("start_motion()" if by_rates(stage) else "rest()")
            out.add(f"local frame = {self._frame}")
            if self._uses_place() or "turned" in reader.now:
                out.add("local place = tool_in(frame)")
            if self._uses_start():
                out.add("local began = get_actual_tcp_pose()")
            if forces:
                out.add("local applied_before = applied_in(frame)")
            out.add("local t = 0.0", *motion.before, *reader.before)
            with out.block("while True:"):
                out.add(*self._follows)
                for name, value in reader.now.items():
                    out.add(f"local {name} = {value}")
                if any("path_done" in line for line in (*ending.lines, *reader.update)):
                    last = motion.path_lasts or "0.0"
                    out.add(f"local path_done = {motion.path_time} >= {last} - STEP / 2.0")
                out.add(*reader.update, *ending.lines)
                out.note("What is commanded")
                out.add(*motion.each, *forces, *self._command(motion), *motion.after)
                out.add(*self._clocks())
        return out.lines

    def _clocks(self) -> list[str]:
        """Lines that count time on."""
        lines = ["t = t + STEP"]
        return [*lines, "clock = clock + STEP"] if self._counted.clock else lines

    def _motion(self) -> MotionLines:
        motion = MotionWriter(self._stage, self._constants, self._prefix)

        def written(expression: Expression, **given: str) -> str:
            names = {"t": "own_time"} if self._is_position(expression) else {}
            names |= {axis: self._leader(axis) for axis in AXES if expression.uses(axis)}
            return self._translated(self._place_of(expression), expression, **(names | given))

        if stands(self._stage):
            return MotionLines()
        return motion.rates(written) if by_rates(self._stage) else motion.coordinates(written)

    def _leader(self, axis: Axis) -> str:
        """The coordinate of an axis that others follow: its reference, or what is measured."""
        plan = self._stage.plans[axis]
        if plan.leads and not isinstance(plan.mode, Hold):
            return str(axis)
        return self._reader.coordinate(axis)

    def _is_position(self, expression: Expression) -> bool:
        modes = (plan.mode for plan in self._stage.plans.values())
        return any(getattr(mode, "position", None) is expression for mode in modes)

    def _place_of(self, expression: Expression) -> KeyPath:
        for axis, entry in self._stage.spec.axes.items():
            if any(each is expression for each, _ in entry.expressions()):
                return self._place.axes[axis]
        return self._place.path

    def _translated(self, place: KeyPath, expression: Expression, **names: str) -> str:
        try:
            return self._reader.reference(expression, **names)
        except UntranslatableError as error:
            raise PartError(place, error, expression) from error

    def _forces(self) -> list[str]:
        """The call of force_mode in each period."""
        if not self._pressed:
            return []
        selection, wrench, most = [0] * 6, ["0.0"] * 6, list[str]()
        for axis, plan in self._pressed.items():
            selection[axis.row] = 1
            point = plan.axis.set_point
            if point is None:
                continue
            wanted = self._wanted(axis, point.wanted)
            if point.ramp == 0:
                wrench[axis.row] = wanted
                continue
            ramp = "FORCE_RAMP"
            if point.ramp is not None:
                name = f"{self._prefix}_{axis.upper()}_RAMP"
                ramp = self._constants.add(name, number(point.ramp), "s")
            wrench[axis.row] = f"risen(applied_before[{axis.row}], {wanted}, t / {ramp})"
        for axis in AXES:
            most.append(self._bound(axis, compliant=bool(selection[axis.row])))
        chosen = self._constants.add(
            f"{self._prefix}_COMPLIANT", f"[{', '.join(map(str, selection))}]", "1: yields"
        )
        bounds = self._constants.add(
            f"{self._prefix}_BOUNDS",
            f"[{', '.join(most)}]",
            "of compliant axes: speed, m/s and rad/s; of stiff ones: deviation, m and rad",
        )
        wanted = f"local wrench = [{', '.join(wrench)}]"
        call = f"force_mode(at_tool(frame), {chosen}, wrench, FRAME_AS_IT_IS, {bounds})"
        return [wanted, call]

    def _wanted(self, axis: Axis, expression: Expression) -> str:
        text = self._translated(self._place_of(expression), expression)
        known = self._stage.known(expression)
        if known == 0.0:
            return "0.0"
        if text.lstrip("-").replace(".", "").isdigit():
            unit = "N m" if axis.is_rotation else "N"
            effort = "MOMENT" if axis.is_rotation else "FORCE"
            name = f"{self._prefix}_{axis.upper()}_{effort}"
            return self._constants.add(name, text, f"{unit}, {expression}")
        return text

    def _bound(self, axis: Axis, *, compliant: bool) -> str:
        """The bound that force_mode has on an axis."""
        limits = self._stage.limits
        if not compliant:
            if limits.deviation is not None and not axis.is_rotation:
                return number(limits.deviation)
            return "DEVIATION_TURN" if axis.is_rotation else "DEVIATION"
        if axis.is_rotation:
            return "COMPLIANT_TURN"
        point, gains = self._pressed[axis].axis.set_point, self._stage.gains
        force = None if point is None else self._stage.known(point.wanted, {"t": 0.0})
        damping = gains.get("force.damping", {}).get(axis) or gains.get("damping", {}).get(axis)
        if not force or damping is None or damping.value <= 0:
            return "COMPLIANT_SPEED"
        speed = max(abs(force) / damping.value, _SLOWEST)
        name = f"{self._prefix}_{axis.upper()}_FREE_SPEED"
        most = min(speed, limits.speed or speed)
        about = "m/s, at which the law's damping takes up the force in free space"
        return self._constants.add(name, number(round(most, 4)), about)

    def _command(self, motion: MotionLines) -> list[str]:
        if stands(self._stage):
            return ["sync()"]
        values = ", ".join(motion.value[axis] for axis in AXES)
        if by_rates(self._stage):
            return [f"move_at(frame, {values})"]
        return [f"track(pose_trans(frame, pose_trans(p[{values}], axes_of(place))))"]

    def _uses_place(self) -> bool:
        return not stands(self._stage) and not by_rates(self._stage)

    def _uses_start(self) -> bool:
        within = self._stage.spec.within
        travels = within is not None and within.travel is not None
        conditions = (self._stage.spec.until, self._stage.spec.fail_if)
        return travels or any(c is not None and c.uses("travel") for c in conditions)

    # Joints

    def _joints(self, function: str) -> list[str]:
        path = self._stage.joint_path
        assert isinstance(path, JointPath)
        assert path.speed is not None
        speed = self._constants.add(f"{self._prefix}_SPEED", number(path.speed), "rad/s")
        names = [
            self._constants.add(f"{self._prefix}_JOINTS_{i}", listed(target), "rad")
            for i, target in enumerate(path.targets, 1)
        ]
        motion = MotionLines(path_lasts="0.0")
        ending = self._ending(motion, own=f"piece >= {len(names)}")
        out = ScriptLines()
        with out.block(f"def {function}():"):
            out.add(f'textmsg(PROGRAM, "stage {self._stage.name}")')
            self._count(out)
            out.add("rest()")
            if self._reads_frame():
                out.add(f"local frame = {self._frame}")
            if self._uses_start():
                out.add("local began = get_actual_tcp_pose()")
            out.add("local t = 0.0", "local piece = 0", "local piece_t = 0.0")
            out.add("local from_joints = get_actual_joint_positions()")
            out.add(f"local to_joints = {names[0]}")
            out.add(*self._reader.before)
            with out.block("while True:"):
                out.add(*self._follows)
                for name, value in self._reader.now.items():
                    out.add(f"local {name} = {value}")
                out.add("local way = longest_travel(from_joints, to_joints)")
                with out.block(f"if piece_t >= travel_time(way, {speed}, RISE_TIME) - STEP / 2.0:"):
                    out.add("piece = piece + 1", "piece_t = 0.0", "from_joints = to_joints")
                    for i, name in enumerate(names[1:], 1):
                        with out.block(f"if piece == {i}:"):
                            out.add(f"to_joints = {name}")
                    out.add("way = longest_travel(from_joints, to_joints)")
                out.add(*self._reader.update, *ending.lines)
                covered = f"travel(piece_t, way, {speed}, RISE_TIME)"
                share = f"{covered} / larger(way, NOWHERE)"
                out.add(f"track_joints(between(from_joints, to_joints, {share}))")
                out.add("piece_t = piece_t + STEP", *self._clocks())
        return out.lines

    def _reads_frame(self) -> bool:
        return any("(frame)" in value for value in self._reader.now.values())

    # Its ends

    def _count(self, out: ScriptLines) -> None:
        """Counts entries: all, those but repetitions, and repetitions in a row."""
        spec, name = self._stage.spec, self._stage.name
        if self._stage.name in self._counted.visits:
            out.add(f"visits_{name} = visits_{name} + 1")
        if spec.repeat > 1:
            out.add(f"rounds_{name} = rounds_{name} + 1")
        if spec.attempts is None:
            return
        tries = f"tries_{name} = tries_{name} + 1"
        if spec.repeat > 1:
            with out.block(f"if rounds_{name} == 1:"):
                out.add(tries)
        else:
            out.add(tries)
        most = self._constants.add(f"{self._prefix}_ATTEMPTS", str(spec.attempts))
        with out.block(f"if tries_{name} > {most}:"):
            out.add(self._fails(f"more than {spec.attempts} attempts"))

    def _ending(self, motion: MotionLines, own: str = "") -> ScriptLines:
        """The ends of the stage, in the order in which a tick decides."""
        out, spec = ScriptLines(), self._stage.spec
        self._limits(out)
        out.note("Ends of the stage")
        if spec.fail_if is not None:
            with out.block(f"if {self._condition('fail_if', spec.fail_if)}:"):
                out.add(*self._failed(f"{spec.fail_if}"))
        if spec.until is not None:
            with out.block(f"if {self._condition('until', spec.until)}:"):
                self._done(out, f"{spec.until}")
        if spec.within is not None and spec.within.time is not None:
            bound = self._constants.add(
                f"{self._prefix}_WITHIN", number(spec.within.time), "s, bound of the stage"
            )
            with out.block(f"if t >= {bound} - STEP / 2.0:"):
                out.add(*self._failed(f"not within {show(spec.within.time, TIME)}"))
        if spec.within is not None and spec.within.travel is not None:
            bound = self._constants.add(
                f"{self._prefix}_TRAVEL", number(spec.within.travel), "m, bound of the stage"
            )
            with out.block(f"if distance_from(began) > {bound}:"):
                out.add(*self._failed(f"not within {show(spec.within.travel, LENGTH)} of travel"))
        if spec.until is None:
            with out.block(f"if {own or self._over(motion)}:"):
                self._done(out, "done")
        return out

    def _over(self, motion: MotionLines) -> str:
        """The condition of the planned end; what servoj tracks arrives late."""
        conditions, spec = [], self._stage.spec
        if spec.time is not None:
            name = self._constants.add(f"{self._prefix}_TIME", number(spec.time), "s")
            conditions.append(f"t >= {name} - STEP / 2.0")
        if motion.ends:
            name = self._constants.add(f"{self._prefix}_MOTION", number(max(motion.ends)), "s")
            conditions.append(f"t >= {name} + SERVO_LOOKAHEAD - STEP / 2.0")
        if motion.path_lasts and motion.path_time == "t":
            conditions.append(f"t >= {motion.path_lasts} + SERVO_LOOKAHEAD - STEP / 2.0")
        elif motion.path_lasts:
            conditions.append(f"{motion.path_time} >= {motion.path_lasts} - STEP / 2.0")
        return " and ".join(conditions)

    def _limits(self, out: ScriptLines) -> None:
        limits = self._stage.limits
        if (limits.force, limits.torque, limits.speed) != (None, None, None):
            out.note("Limits")
        for name, rows in (("force", (0, 1, 2)), ("torque", (3, 4, 5))):
            bound = getattr(limits, name)
            if bound is None:
                continue
            if self._stage.joint_path is not None:
                self._reader.now["applied"] = "applied_in(WORLD)"
            else:
                self._reader.measured("applied")
            parts = ", ".join(f"applied[{row}]" for row in rows)
            self._limit(out, name, bound, f"length_of({parts})")
        if limits.speed is not None:
            self._limit(out, "speed", limits.speed, "tool_speed()")

    def _limit(self, out: ScriptLines, name: str, bound: float, value: str) -> None:
        text = f"limit on {name}: {show(bound, Limits.dimension_of(name))}"
        task = self._stage.context.loaded.task.limits
        most = f"MOST_{name.upper()}"
        if getattr(task, name) != bound:
            unit = {"force": "N", "torque": "N m", "speed": "m/s"}[name]
            most = self._constants.add(f"{self._prefix}_{most}", number(bound), unit)
        then = self._stage.limits.then(name)
        if then == self._stage.name:
            # It led here, so it counts once it has been kept again.
            kept = f"{name}_kept"
            self._reader.before.append(f"local {kept} = False")
            with out.block(f"if {value} <= {most}:"):
                out.add(f"{kept} = True")
            with out.block(f"if {kept} and {value} > {most}:"):
                out.add(self._fails(text))
            return
        with out.block(f"if {value} > {most}:"):
            out.add(*(self._to(then, text) if then else [self._fails(text)]))

    def _condition(self, key: str, expression: Expression) -> str:
        try:
            return self._reader.condition(expression)
        except UntranslatableError as error:
            place = self._place.until if key == "until" else self._place.fail_if
            raise PartError(place, error, expression) from error

    def _done(self, out: ScriptLines, text: str) -> None:
        spec = self._stage.spec
        if spec.tare:
            out.add("zero_ftsensor()")
        if spec.repeat > 1:
            rounds = f"rounds_{self._stage.name}"
            many = self._constants.add(f"{self._prefix}_REPEAT", str(spec.repeat))
            with out.block(f"if {rounds} < {many}:"):
                out.add(f"return {self._numbers[self._stage.name]}")
        for number_, branch in enumerate(spec.next):
            if branch.when is None:
                continue
            try:
                condition = self._reader.condition(branch.when)
            except UntranslatableError as error:
                place = self._place.next[number_]
                raise PartError(place, error, branch.when) from error
            with out.block(f"if {condition}:"):
                out.add(*self._to(branch.to, f"{text}; {branch.when}"))
        out.add(*self._to(spec.targets(self._following)[-1], text))

    def _failed(self, text: str) -> list[str]:
        return self._to(self._stage.spec.on_fail or FAIL, text)

    def _to(self, target: str, text: str) -> list[str]:
        if target == FAIL:
            return [self._fails(text)]
        lines = [f'textmsg(PROGRAM, "{self._stage.name} ends: {_quoted(text)}")']
        if self._stage.spec.repeat > 1:
            lines.append(f"rounds_{self._stage.name} = 0")
        return [*lines, f"return {self._numbers[target]}"]

    def _fails(self, text: str) -> str:
        return f'fail("{self._stage.name}: {_quoted(text)}")'


def _quoted(text: str) -> str:
    return text.replace('"', "'")
