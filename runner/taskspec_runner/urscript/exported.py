"""The program of a task for a Universal Robots arm."""

from __future__ import annotations

import math
from collections.abc import Mapping
from importlib.metadata import version
from itertools import takewhile

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec.expression.tree import Name, walk
from taskspec.geometry import rotation
from taskspec.modes import DEFAULT_RAMP, move_speed
from taskspec.motion import blend
from taskspec.motion.profile import RISE_TIME
from taskspec.program.execution.transition import END
from taskspec.program.plan import StagePlan, TaskPlan
from taskspec.program.world.frames import FrameModel, normal_at
from taskspec.robot.tool import make_tool
from taskspec.spec import FILE, key_of
from taskspec.spec.params import FollowingParam
from taskspec.text.units import si_unit
from taskspec_runner.urscript import losses, refusals
from taskspec_runner.urscript.expressions import translated
from taskspec_runner.urscript.losses import REGISTERS, located
from taskspec_runner.urscript.refusals import UNIVERSAL_ROBOTS, NotMappedError
from taskspec_runner.urscript.script import (
    NamedValues,
    Script,
    ScriptLines,
    ScriptSection,
    identifier,
    listed,
    number,
    pose,
)
from taskspec_runner.urscript.signals import Reader
from taskspec_runner.urscript.stages import Counted, PartError, StageWriter

Vector = NDArray[np.float64]

#: The base frame of a Universal Robots arm against that of a file's arm: half a turn about z.
_HALF_TURN = rotation.from_rpy((0.0, 0.0, math.pi))
#: A rotation vector with an angle nearer to half a turn than this has two signs [rad].
_NEARLY = 1e-6
#: How often force_mode yields where a file does not say: speed [m/s], turn [rad/s].
_COMPLIANT_SPEED, _COMPLIANT_TURN = 0.05, 0.5
#: How far stiff axes may be off the program in force mode [m, rad].
_DEVIATION, _DEVIATION_TURN = 0.1, 0.35


def script_of(plan: TaskPlan) -> Script:
    """The program of a task.

    Raises:
        NotMappedError: the task has none.
    """
    loaded = plan.context.loaded
    found = refusals.reasons(plan)
    if found:
        raise NotMappedError(tuple(str(located(loaded, r.place, r.text)) for r in found))
    try:
        return _Writer(plan).script()
    except PartError as error:
        span = error.expression.where(error.error.node) or loaded.span(error.place)
        at = f"{span.source or loaded.source.name}:{span.line}:{span.column}"
        raise NotMappedError((f"{at}: {error.error.reason}",)) from error


class _Writer:
    def __init__(self, plan: TaskPlan) -> None:
        self._plan, self._context = plan, plan.context
        self._task = plan.context.loaded.task
        self._constants = NamedValues()
        self._params: dict[str, str] = {}
        #: Float input registers of live params.
        self._registers = dict(zip(self._task.live, REGISTERS, strict=False))
        self._frames: dict[str, str] = {}
        self._surfaces: dict[str, str] = {}

    def script(self) -> Script:
        self._cell()
        self._general()
        self._constants.group = "Frames of the task, in the base of the robot"
        for stage in self._plan.stages.values():
            self._frame(stage)
        numbers = self._numbers()
        self._counted = _counted(self._plan)
        stages = [self._stage(stage, numbers) for stage in self._plan.stages.values()]
        main = self._main(numbers)
        return Script(
            f"task_{identifier(self._task.name)}",
            self._header(),
            losses.of_task(self._plan),
            self._constants.all,
            stages,
            main,
        )

    def _header(self) -> list[str]:
        loaded = self._context.loaded
        about = " ".join((self._task.about or "").split())
        return [
            f"{self._task.name}: {about}" if about else self._task.name,
            "",
            f"Made by taskspec {version('taskspec-robotics')} from {loaded.source.name}.",
            "NEVER EXECUTED, neither on a robot nor in URSim. Read it; adapt WORLD, the tool and",
            "the start to your cell; try it at reduced speed, without contact first.",
            "",
            "For e-Series and later, PolyScope 5.11 or newer: a force sensor, and 500 Hz.",
            "Units are m, rad, s, kg, N and N m. Forces are those that the robot applies.",
            "What the task has and this program lacks is marked by LOST, with its line there.",
        ]

    # Named values

    def _general(self) -> None:
        self._constants.group = "Tune on the robot"
        add = self._constants.add
        add("FORCE_MODE_DAMPING", "0.025", "0 to 1: what is free slows down faster")
        add("FORCE_MODE_GAIN", "0.5", "0 to 2: above 1 hard contacts may be unstable")
        add("SERVO_LOOKAHEAD", "0.1", "s, of servoj: 0.03 follows faster, 0.2 smoother")
        add("SERVO_GAIN", "300", "of servoj, 100 to 2000")
        add("TOOL_ACCELERATION", "2.0", "m/s^2, of guarded motions and stops")
        add("COMPLIANT_SPEED", number(self._slow()), "m/s, of compliant axes without a force")
        add("COMPLIANT_TURN", number(_COMPLIANT_TURN), "rad/s, of compliant axes")
        add("DEVIATION", number(_DEVIATION), "m, of stiff axes: beyond it the robot stops")
        add("DEVIATION_TURN", number(_DEVIATION_TURN), "rad, of stiff axes")
        add("TOUCHING", "0.5", "N, from which on the tool touches")
        add("START_SPEED", "0.5", "rad/s, of the way to the start")
        add("START_ACCELERATION", "0.5", "rad/s^2, of the way to the start")
        add("SETTLE_TIME", "0.5", "s at rest before the sensor is zeroed")
        add("FORCE_MODE_PAUSE", "0.02", "s at rest before force mode")
        self._constants.group = "Of the task"
        for key, unit in (("force", "N"), ("torque", "N m"), ("speed", "m/s")):
            bound = getattr(self._task.limits, key)
            if bound is not None:
                add(f"MOST_{key.upper()}", number(bound), f"{unit}, limit")
        self._constants.group = "Not to be changed"
        add("PROGRAM", f'"{self._task.name}: "', "in the log and in messages")
        add("STEP", "get_steptime()", "s, control period: 0.002 on e-Series")
        add("PI", number(math.pi))
        add("NOWHERE", "0.000000001", "m, rad or s: none")
        add("RISE_TIME", number(RISE_TIME), "s, in which motions rise to their speed")
        add("FORCE_RAMP", number(DEFAULT_RAMP), "s, in which forces rise from those measured")
        add("FADE_PEAK", number(float(blend.blend_time(1.0, 1.0))), "of the speed of a fade")
        add("FADE_SPEED", number(move_speed(rotation=False)), "m/s, of the way to a coordinate")
        add("FADE_TURN", number(move_speed(rotation=True)), "rad/s, of the turn to one")
        add("FRAME_AS_IT_IS", "2", "type of force_mode: its frame is not transformed")
        self._constants.group = "Params of the task"
        for param, quantity in self._task.params.items():
            about = si_unit(quantity.dimension)
            if param in self._registers:
                register = self._registers[param]
                place = f"float input register {register} while boolean {register + 40} is true"
                about = ", ".join(filter(None, (about, f"set at {place}")))
            named = identifier(param).upper()
            taken = any(each.name == named for each in self._constants.all)
            self._params[param] = add(
                f"PARAM_{named}" if taken else named,
                number(quantity.value),
                about,
            )

    def _follows(self) -> list[str]:
        """Lines of each control period that have params follow their registers."""
        lines, params = list[str](), self._task.params
        for name, param in self._task.live.items():
            if name in self._registers:
                own = self._params[name]
                numbers = ", ".join(map(number, (param.low, param.high, param.rate)))
                lines.append(f"{own} = followed({own}, {self._registers[name]}, {numbers})")
        for name, quantity in params.items():
            if isinstance(quantity, FollowingParam):
                known = lambda part: self._params.get(str(part)) or "PI"  # noqa: E731
                lines.append(f"{self._params[name]} = {translated(quantity.tree, known)}")
        return lines

    def _slow(self) -> float:
        most = self._task.limits.speed
        return min(_COMPLIANT_SPEED, most or _COMPLIANT_SPEED)

    def _cell(self) -> None:
        """World, tool and start."""
        self._constants.group = "Adapt to your cell"
        add, context, robot = self._constants.add, self._context, self._task.robot
        base = rotation.from_rpy(robot.base.rpy) @ _HALF_TURN
        world = base.T, -base.T @ np.array(robot.base.xyz)
        add("WORLD", _pose(*world), "world of the task in the base of the robot")
        self._frames["world"] = "WORLD"
        tool = make_tool(robot.tool, planar=False)
        add("TCP", pose((0.0, 0.0, tool.length), (0.0, 0.0, 0.0)), "tip of the tool")
        add("MASS", number(tool.mass), "kg, of the tool")
        lever = np.array([0.0, 0.0, tool.length]) + tool.inertia.lever
        add(
            "COG",
            listed(np.round(lever if tool.mass else np.zeros(3), 6)),
            "m, its centre from the flange",
        )
        I = tool.inertia.inertia if tool.mass else np.zeros((3, 3))  # noqa: E741
        six = (I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2])
        add("INERTIA", listed(np.round(six, 9)), "kg m^2, xx, yy, zz, xy, xz, yz about its centre")
        if robot.model in UNIVERSAL_ROBOTS:
            add("START_JOINTS", listed(np.round(context.start, 6)), "rad, where the task starts")
        else:
            placed = _pose(context.start_R, context.start_p)
            add("START", f"pose_trans(WORLD, {placed})", "tip of the tool where the task starts")

    def _numbers(self) -> dict[str, str]:
        self._constants.group = "Stages, and what the program counts"
        found = {END: self._constants.add("STAGE_END", "0")}
        for i, name in enumerate(self._plan.stages, 1):
            found[name] = self._constants.add(f"STAGE_{identifier(name).upper()}", str(i))
        for name, stage in self._plan.stages.items():
            self._constants.add(f"visits_{name}", "0", "entries of the stage")
            if stage.spec.attempts is not None:
                self._constants.add(f"tries_{name}", "0", "entries but for repetitions")
            if stage.spec.repeat > 1:
                self._constants.add(f"rounds_{name}", "0", "repetitions in a row")
        self._constants.add("clock", "0.0", "s, since the task began")
        self._constants.add("force_mode_on", "False", "whether the stage is one of force mode")
        return found

    # Stages

    def _stage(self, stage: StagePlan, numbers: Mapping[str, str]) -> ScriptSection:
        names = list(self._plan.stages)
        after = names.index(stage.name) + 1
        following = names[after] if after < len(names) else END
        frame = self._frame(stage)
        for condition in (stage.spec.until, stage.spec.fail_if):
            for model in self._context.frames.values() if condition is not None else ():
                if model.kind == "fixed" and f"in {model.name}" in str(condition):
                    self._fixed(model)
        reader = Reader(stage, self._params, self._frames)
        prefix = identifier(stage.name).upper()
        writer = StageWriter(
            *(stage, following, frame, reader, numbers, prefix, self._counted, self._constants),
            follows=self._follows(),
        )
        title = f"{stage.name} ({self._context.loaded.source.name}:{self._line(stage)})"
        return writer.section(title, self._quoted(stage), f"stage_{stage.name}")

    def _frame(self, stage: StagePlan) -> str:
        """A stage's frame in the base as the stage starts."""
        frame = stage.frame
        if stage.joint_path is not None:
            return "WORLD"
        if frame.kind != "following":
            return self._fixed(frame)
        if frame.name not in self._surfaces:
            shape = self._task.shapes[frame.surface_name]
            normal, _, distance = normal_at(shape, self._context.start_p)
            foot = self._context.start_p - distance * normal
            text = f"pose_trans(WORLD, {_pose(stage.rotation, foot)})"
            about = f"plane of {frame.surface_name}, z outward"
            name = identifier(frame.name).upper()
            self._surfaces[frame.name] = self._constants.add(name, text, about)
        return f"below_tool({self._surfaces[frame.name]})"

    def _fixed(self, frame: FrameModel) -> str:
        if frame.name not in self._frames:
            text = f"pose_trans(WORLD, {_pose(*self._context.placed(frame))})"
            name = identifier(frame.name).upper()
            self._frames[frame.name] = self._constants.add(name, text, f"frame {frame.name}")
        return self._frames[frame.name]

    def _line(self, stage: StagePlan) -> int:
        return self._context.loaded.span(key_of(FILE.stages[stage.name])).line

    def _quoted(self, stage: StagePlan) -> list[str]:
        """The stage's lines in the file."""
        loaded = self._context.loaded
        span = loaded.span(FILE.stages[stage.name])
        if span.source:
            return []
        head, *rest = loaded.source.text.splitlines()[self._line(stage) - 1 :]
        indent = len(head) - len(head.lstrip())
        inside = takewhile(lambda line: not line.strip() or line[: indent + 1].isspace(), rest)
        return [line[indent:].rstrip() for line in (head, *inside) if line.strip()]

    def _main(self, numbers: Mapping[str, str]) -> list[str]:
        out = ScriptLines()
        out.note("The tool, the way to the start, and the zero of the sensor in free space")
        out.add("set_tcp(TCP)", "set_target_payload(MASS, COG, INERTIA)")
        if self._task.robot.model in UNIVERSAL_ROBOTS:
            out.add("movej(START_JOINTS, a=START_ACCELERATION, v=START_SPEED)")
        else:
            out.add("movej(get_inverse_kin(START), a=START_ACCELERATION, v=START_SPEED)")
        out.add("sleep(SETTLE_TIME)", "zero_ftsensor()")
        out.add("force_mode_set_damping(FORCE_MODE_DAMPING)")
        out.add("force_mode_set_gain_scaling(FORCE_MODE_GAIN)", "")
        out.note("The stages, until one of them leads to the end")
        first = next(iter(self._plan.stages))
        out.add(f"local stage = {numbers[first]}")
        with out.block(f"while stage != {numbers[END]}:"):
            for i, name in enumerate(self._plan.stages):
                word = "elif" if i else "if"
                out.add(f"{word} stage == {numbers[name]}:")
                out.add(f"  stage = stage_{name}()")
            out.add("end")
        out.add("rest()", 'textmsg(PROGRAM, "done")')
        return out.lines


def _counted(plan: TaskPlan) -> Counted:
    """What the program of a task counts."""
    clock, visits = False, set[str]()
    for stage in plan.stages.values():
        spec = stage.spec
        used = [spec.until, spec.fail_if, *(branch.when for branch in spec.next)]
        used += [each for entry in spec.axes.values() for each, _ in entry.expressions()]
        used.append(None if spec.path is None else spec.path.slowed)
        for expression in used:
            for node in walk(expression.tree) if expression is not None else ():
                if isinstance(node, Name):
                    clock |= node.path == ("clock",)
                    visits |= {node.path[0]} if node.path[1:] == ("visits",) else set()
    return Counted(clock, frozenset(visits))


def _pose(R: Vector, p: Vector) -> str:
    """A pose with the rotation as a vector."""
    turn = np.asarray(pin.log3(np.asarray(R, dtype=float)), dtype=float)
    if abs(np.linalg.norm(turn) - math.pi) < _NEARLY:
        first = next((each for each in turn if abs(each) > _NEARLY), 1.0)
        turn = turn * np.sign(first)
    return pose(np.round(p, 6), np.round(turn, 9))
