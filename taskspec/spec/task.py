"""A whole task file."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field

from taskspec.faults import ENCODER
from taskspec.geometry.axis import AXES, Axis
from taskspec.laws import DEFAULTS
from taskspec.spec.adapt import Adapt
from taskspec.spec.bushing import Bushing
from taskspec.spec.control import Control
from taskspec.spec.equation import EquationObject
from taskspec.spec.expectation import Expectation, Expectations
from taskspec.spec.field_type import FieldType
from taskspec.spec.fields import FrameName
from taskspec.spec.flow import check_flow
from taskspec.spec.frame import Frame, check_loops
from taskspec.spec.gripper import REPORTED
from taskspec.spec.include import Included
from taskspec.spec.law import Law
from taskspec.spec.limits import Limits
from taskspec.spec.mechanism import Mechanism
from taskspec.spec.model import Model, mapping
from taskspec.spec.objects import ByKind, Object, bushings, equations, mechanisms, shapes
from taskspec.spec.params import LiveParam, Params, live_params
from taskspec.spec.parse_context import ParseContext, span_of
from taskspec.spec.reward import Reward
from taskspec.spec.robot import Robot
from taskspec.spec.stage import Stage
from taskspec.spec.sweep import Sweep
from taskspec.spec.templates import Templates
from taskspec.spec.truth import DeclaredTruth, Truths
from taskspec.spec.value_path import ValuePath
from taskspec.spec.varied import OBJECT, ROBOT, VariedValue
from taskspec.spec.vary import Variation, Variations
from taskspec.spec.words import Free
from taskspec.spec.world import Shape
from taskspec.text.codes import register
from taskspec.text.data import Map, Real, Text, Whole
from taskspec.text.units import Dimension, Quantity

register(
    {
        "TS016": "a text that a comment cuts short",
        "TS024": "an unknown version of the language",
    }
)

VERSION = 1
_NAME = re.compile(r"[a-z][a-z0-9-]*\Z")


def _default_law(read: Mapping[str, Any]) -> Law:
    """The law of a task that names none, by what was read of it before."""
    robot = read.get("robot")
    return Law() if robot is None else Law(kind=DEFAULTS[robot.laws_command])


class Version(FieldType):
    """The version of the language."""

    def read(self, value: object, context: ParseContext) -> int:
        """The version, which is 1."""
        if not (isinstance(value, Whole) and value == VERSION):
            text = str(value) if isinstance(value, Text | Whole | Real) else "this"
            message = f"version '{text}' of the language is not known"
            context.error("TS024", message, span_of(value), f"write taskspec: {VERSION}")
        return VERSION

    def json(self) -> dict[str, Any]:
        """Describes the version."""
        return {"const": VERSION}


class Task(Model):
    """A task: everything that a file says, with defaults for what it does not say.

    Attributes:
        taskspec: version of the language.
        include: files that bring further robot, world, params, frames and templates.
        name: of the task; from the file's name if it says none.
        about: what it does.
        robot: the arm and what it carries.
        world: objects by name.
        params: named quantities.
        frames: named frames.
        frame: task frame of every stage that names none.
        law: control law of every stage that names none.
        limits: of every stage, key by key.
        templates: as written; stages that use one are as if they were written out.
        stages: by name, in order.
        expect: what counts as success.
        vary: path of a value to an uncertain interval for each component.
        truth: what the world and the robot really are, where that is otherwise.
        sweep: what `taskspec sweep` does; None where the file says nothing of it.
        reward: what a learner is to make large; None where the file says nothing of it.
        control: rates.
    """

    noun = "a task"
    reserved = frozenset({"robots"})

    taskspec: Annotated[Literal[1], Version()] = Field(title="Version of the language")
    include: Annotated[tuple[str, ...], Included()] = Field((), title="Files that it includes")
    name: Annotated[
        str,
        Free(
            "a name: small letters, digits and '-', a letter first",
            lambda text: bool(_NAME.match(text)),
            "^[a-z][a-z0-9-]*$",
        ),
    ] = Field("task", title="Name of the task")
    about: Annotated[str, Free()] | None = Field(None, title="What the task does")
    robot: Robot = Field(title="Robot")
    world: dict[str, Annotated[Object, ByKind()]] = Field({}, title="Objects by name")
    params: Annotated[dict[str, Quantity], Params()] = Field({}, title="Named quantities")
    frames: dict[str, Frame] = Field({}, title="Frames by name")
    frame: FrameName = Field("world", title="Task frame of all stages")
    law: Law = Field(default_factory=_default_law, title="Control law of all stages")
    limits: Limits = Field(Limits(), title="Limits of all stages")
    templates: Annotated[Mapping[str, object], Templates()] = Field(
        {}, title="Stages with params, by name"
    )
    stages: dict[str, Stage] = Field(title="Stages by name, in order")
    expect: Annotated[tuple[Expectation, ...], Expectations()] = Field(
        (), title="What counts as success"
    )
    vary: Annotated[dict[str, tuple[Variation | None, ...]], Variations()] = Field(
        {}, title="What is uncertain about the real world"
    )
    truth: Annotated[DeclaredTruth, Truths()] = Field(
        DeclaredTruth(), title="What the world and the robot really are"
    )
    sweep: Sweep | None = Field(None, title="Random worlds, and how often they succeed")
    reward: Reward | None = Field(None, title="What a learner is to make large")
    control: Control = Field(Control(), title="Rates")

    @property
    def shapes(self) -> dict[str, Shape]:
        """Objects with a surface."""
        return shapes(self.world)

    @property
    def equations(self) -> dict[str, EquationObject]:
        """Constraint equations."""
        return equations(self.world)

    @property
    def in_joints(self) -> bool:
        """Whether a stage has a path of joints."""
        return any(s.path is not None and s.path.joints is not None for s in self.stages.values())

    @property
    def joints_exact(self) -> bool:
        """Whether the controller has the joints' true positions and velocities."""
        coarse = self.robot.encoder is not None or bool(self.truth.of(ENCODER))
        return self.control.velocity.measured and not coarse

    @property
    def bushings(self) -> dict[str, Bushing]:
        """Springs in six directions on the tool tip."""
        return bushings(self.world)

    @property
    def mechanisms(self) -> dict[str, Mechanism]:
        """Mechanisms with a handle."""
        return mechanisms(self.world)

    @property
    def gripped(self) -> tuple[str, ...]:
        """The loose bodies that stages grip, in the order of the world."""
        named = {stage.grip.object for stage in self.stages.values() if stage.grip is not None}
        return tuple(name for name in self.world if name in named)

    @property
    def carried(self) -> tuple[str, ...]:
        """What the tool's shape does not touch, as it holds it from the start or grips it."""
        return (*self.gripped, *filter(None, (self.robot.grasp,)))

    @property
    def reported(self) -> tuple[str, ...]:
        """What is measured beside joints and wrench: reactions of equations, then of the gripper.

        In the order of `Machine.reactions`.
        """
        return (*self.equations, *(REPORTED if self.gripped else ()))

    def limits_of(self, stage: Stage) -> Limits:
        """The file's limits, with those of a stage put over them key by key."""
        given = stage.limits
        if given is None:
            return self.limits
        own = {key: getattr(given, key) for key in given.model_fields_set}
        return self.limits.model_copy(update={k: v for k, v in own.items() if v is not None})

    @property
    def live(self) -> dict[str, LiveParam]:
        """The params that may be set while a stage runs, in the order of the log."""
        return live_params(self.params)

    @property
    def observes(self) -> bool:
        """Whether the law of any stage has a disturbance observer."""
        laws = [self.law, *(stage.law for stage in self.stages.values())]
        return any(law is not None and law.disturbance_observer is not None for law in laws)

    @property
    def varying_gains(self) -> tuple[tuple[str, str], ...]:
        """The gains that vary in any of its stages, by name and entry, in the order of the log."""
        laws = [self.law, *(stage.law for stage in self.stages.values() if stage.law is not None)]
        given = [each for law in laws for each in law.varying]
        followed = [(name, on) for on, names in self._following for name in names]
        return tuple(dict.fromkeys([*given, *followed]))

    @property
    def estimates(self) -> tuple[Axis, ...]:
        """Axes along which a stage estimates the contact's stiffness, in the order of the log."""
        found = {on for on, names in self._following if names}
        return tuple(axis for axis in AXES if axis in found)

    @property
    def _following(self) -> list[tuple[Axis, tuple[str, ...]]]:
        """Axes of stages with the designed gains that follow the stiffness there."""
        return [
            (on, (stage.law or self.law).following(axis, on))
            for stage in self.stages.values()
            for on, axis in stage.axes.items()
        ]

    @property
    def tanks(self) -> bool:
        """Whether a law of any of its stages has an energy tank."""
        laws = (self.law, *(stage.law for stage in self.stages.values()))
        return any(law is not None and law.tank is not None for law in laws)

    @property
    def adapt(self) -> Adapt | None:
        """What its laws adapt to, which is one for all stages; None for nothing."""
        laws = (stage.law or self.law for stage in self.stages.values())
        return next((law.adapt for law in laws if law.adapt is not None), None)

    def dimensions_of(self, path: str) -> tuple[Dimension, ...]:
        """The dimension of each component of a value that can vary, by its path under `vary`."""
        return self.target_of(path).dimensions

    def target_of(self, path: str) -> VariedValue:
        """What a path under `vary` or `truth` names."""
        of = ValuePath.of(path)
        return self._values_of(of)[of.key]

    def _values_of(self, path: ValuePath) -> Mapping[str, VariedValue]:
        """The values that can vary of the object, or of the robot, that a path leads to."""
        return ROBOT if path.section == "robot" else OBJECT[self.world[path.owner].kind]

    @property
    def true_numbers(self) -> tuple[str, ...]:
        """The paths of all numbers that `truth` gives; of a payload or a noise, those of its parts.

        A motion and the rate of a sensor are none.
        """
        found = []
        for path in self.truth.paths:
            of = ValuePath.of(path)
            head, below = path.removesuffix(of.key), f"{of.key}."
            known = self._values_of(of)
            found += [head + key for key in known if key == of.key or key.startswith(below)]
        return tuple(dict.fromkeys(found))

    @classmethod
    def rules(cls, data: Map, context: ParseContext) -> None:
        """Checks the file as a whole."""
        stages = data.get("stages")
        if isinstance(stages, Map):
            if not stages and not stages.node.broken:
                context.error("TS021", "a task needs at least one stage",
                              data.node.key_span("stages"))  # fmt: skip
            check_flow(stages, context)
        check_loops(mapping(data.get("frames")), context)
        about = data.get("about")
        if isinstance(about, Text) and about.node.comment:
            context.diagnostics.warning(
                "TS016",
                f"the text ends before '{about.node.comment}'",
                about.node.span,
                "' #' begins a comment; put the text in quotes if it belongs to it",
            )
