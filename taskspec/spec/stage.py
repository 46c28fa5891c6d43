"""`stages`: what the robot does, one after the other."""

from __future__ import annotations

import re
from typing import Annotated, Any, ClassVar

from pydantic import Field, GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, core_schema

from taskspec.expression import Expression, ScopeKind
from taskspec.expression.tree import Name, walk
from taskspec.geometry.axis import Axis
from taskspec.laws import DEFAULTS, LAWS
from taskspec.laws.law import commanding
from taskspec.modes import MODES
from taskspec.spec import values
from taskspec.spec.axis import FORCES, MOTIONS, SHORT, AxisEntry, ByName
from taskspec.spec.fields import ContactName, FrameName
from taskspec.spec.gripper import GripCommand, Released
from taskspec.spec.law import Law, law_of
from taskspec.spec.limits import Limits
from taskspec.spec.model import Model, complete, mapping, short_form
from taskspec.spec.parse_context import ParseContext, span_of
from taskspec.spec.path import FORMS, Path
from taskspec.spec.quantities import Constant, Formula
from taskspec.spec.servo import TORQUE
from taskspec.spec.set_point import SetPoint, SetPoints
from taskspec.spec.templates import USE, WITH
from taskspec.spec.words import ENDS, Count, NameReference, Switch, Word, Words
from taskspec.text.codes import register
from taskspec.text.data import Items, Map, Text
from taskspec.text.nodes import pointer
from taskspec.text.units import LENGTH, TIME, alternatives

register(
    {
        "TS124": "an unknown stage",
        "TS203": "a motion and a force on one axis",
        "TS210": "a damping of an axis under a law that damps no axis",
        "TS211": "set points of equations under a law without multipliers",
        "TS212": "a soft axis under a law that has none",
        "TS601": "a guard without a bound",
        "TS602": "a stage that nothing ends",
        "TS603": "a stage with two ends",
        "TS607": "`path_done` in a stage without a path",
        "TS608": "ways on without a last one",
    }
)


def _no_condition(name: str, _context: ParseContext) -> str:
    """What to write in place of a condition on a stage that follows."""
    if len(name.split()) < 2:
        return ""
    return "a condition stands in a list: next: [{when: knock.visits < 5, to: knock}, {to: end}]"


STAGE_NAME = NameReference(
    lambda r: r.targets, "stage", "TS124", instead=_no_condition, always=ENDS
)
StageName = Annotated[str, STAGE_NAME]
#: What a run of a stage may be found to do, which is a fault unless the stage allows it.
OSCILLATION, SATURATION = "oscillation", "saturation"
_ALLOWED = Words(Word((OSCILLATION, SATURATION), "fault"))

Condition = Annotated[Expression, Formula(None, ScopeKind.GUARD)]


class Within(Model):
    """The bound of a stage; reaching it ends the stage as a failure.

    Attributes:
        time: since the stage began [s].
        travel: straight distance from where the stage began [m].
    """

    noun = "a bound"
    example = "within: {time: 5 s, travel: 50 mm}"
    short: ClassVar = Constant(TIME, above=0).json()

    time: Annotated[float, Constant(TIME, above=0)] | None = Field(None, title="Time")
    travel: Annotated[float, Constant(LENGTH, above=0)] | None = Field(None, title="Distance")

    @classmethod
    def expand(cls, data: object, context: ParseContext) -> object:
        """`4 s` is short for `{time: 4 s}`, the bound that nearly every stage has."""
        full = short_form(data, "time")
        if isinstance(full, Map) and full is not data and values.measures(data, LENGTH, context):
            message = "a time (s) is needed here, this is a length (m)"
            hint = f"a distance stands by its name: within: {{travel: {data}}}"
            context.error("TS112", message, span_of(data), hint)
            context.quiet.add(id(full.node))
            full.clear()
        return full

    @classmethod
    def rules(cls, data: Map, context: ParseContext) -> None:
        """Require a time or a distance."""
        if not data and complete(data, context):
            context.error("TS601", "'within' needs a time or a travel", pointer(data.node),
                          "within: {time: 5 s, travel: 50 mm}, or one of the two")  # fmt: skip


class Branch(Model):
    """Where a stage leads if a condition holds as it ends well.

    Attributes:
        when: the condition; None for the last one, which is taken where no other holds.
        to: a stage, `end` or `fail`.
    """

    noun = "a way on"
    example = "{when: knock.visits < 5, to: knock}"
    advice: ClassVar = dict.fromkeys(("if", "unless"), "a condition stands under 'when'") | (
        dict.fromkeys(("then", "goto", "next", "stage"), "the stage stands under 'to'")
        | dict.fromkeys(("else", "otherwise"), "the last way has no condition: {to: end}")
    )

    short: ClassVar = STAGE_NAME.json()

    @classmethod
    def expand(cls, data: object, context: ParseContext) -> object:  # noqa: ARG003
        """`end` is short for `{to: end}`."""
        return short_form(data, "to")

    when: Condition | None = Field(None, title="The condition under which it is taken")
    to: StageName = Field(title="Where it leads", description="A stage, end or fail")


class Branches:
    """Reads `next`: a name, or a list of branches of which the last one has no condition."""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.with_info_wrap_validator_function(_ways, handler(source))

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        listed = handler(schema)
        return {"anyOf": [STAGE_NAME.json(), {**listed, "minItems": 1}]}


def _ways(
    value: Any, handler: core_schema.ValidatorFunctionWrapHandler, info: core_schema.ValidationInfo
) -> Any:
    context: ParseContext | None = info.context
    if context is None:
        return handler(value)
    if isinstance(value, Map):
        message = "'next' is a stage or a list of ways, this is a mapping"
        hint = "next: [{when: knock.visits < 5, to: knock}, {to: end}]"
        context.error("TS022", message, span_of(value), hint)
        return ()
    if not isinstance(value, Items):
        return handler([short_form(value, "to")])
    _check_branches(value, context)
    return handler(list(value))


def _check_branches(branches: Items, context: ParseContext) -> None:
    """Requires one branch without a condition, at the end."""
    if not branches and not branches.node.broken:
        context.error("TS023", "this list is empty", span_of(branches))
    if not branches or branches.node.broken:
        return
    always = [isinstance(each, Text) or _is_unconditional(mapping(each)) for each in branches]
    for number, branch in enumerate(branches[:-1]):
        if always[number]:
            message = "nothing comes to the ways behind this one, which has no 'when'"
            context.error("TS608", message, span_of(branch), "put it last, or give it a 'when'")
    if isinstance(branches[-1], Map) and not always[-1] and "when" in branches[-1]:
        message = "nothing says where the stage leads if none of the conditions holds"
        hint = "add a last way without 'when', such as {to: end}"
        context.error("TS608", message, span_of(branches[-1]), hint)


def _is_unconditional(branch: Map) -> bool:
    return branch.keys() == {"to"} and not branch.node.broken


class Stage(Model):
    """A stage.

    Attributes:
        axes: what each named axis does; the others hold.
        path: a curve that drives axes.
        constraints: set points of the world's equations, by name.
        until: the guard that ends the stage well.
        within: the bound of the guard.
        fail_if: the guard that ends the stage as a failure.
        time: planned length [s].
        next: stages, `end` or `fail`, the first whose condition holds; empty for the following
            stage.
        on_fail: a stage, `end` or `fail`; None for `fail`.
        repeat: so often it ends well before `next` follows.
        attempts: entering the stage once more than that fails the run; repeats do not count.
        frame: task frame; None for that of the task.
        contact: the object that its axes press on, or run into; None for that of each axis.
        law: control law; None for that of the task.
        limits: replace those of the task key by key.
        tare: the sensor's mean over this stage becomes its zero.
        grip: closes the gripper as the stage begins; None for no command.
        release: opens it; the body that is let go, `gripper.ALL` for any, None for no command.
        allow: faults that a run may have in it.
    """

    noun = "a stage"
    example = "approach: {axes: {z: {move: -50 mm}}}"
    advice: ClassVar = (
        {
            name: f"a mode stands under an axis: axes: {{z: {{{name}: ..}}}}"
            for name in (*MODES, "force")
        }
        | {name: f"a curve stands under 'path': path: {{{name}: ..}}" for name in FORMS}
        | {
            "params": "params of a template stand in it, the values of a stage under 'with', and "
            "those of the file in its own section 'params'"
        }
        | {"stages": "a template is one stage: its keys stand beside 'params'"}
    )
    composed: ClassVar = {
        USE: {"type": "string", "title": "Template that it is"},
        WITH: {"type": "object", "title": "Params of the template"},
    }
    axes: Annotated[dict[Axis, AxisEntry], ByName()] = Field({}, title="What each axis does")
    path: Path | None = Field(None, title="A curve that drives axes")
    constraints: Annotated[dict[str, SetPoint], SetPoints()] = Field(
        {}, title="Set points of the world's equations"
    )
    until: Condition | None = Field(None, title="The condition that ends the stage well")
    within: Within | None = Field(None, title="The bound of the condition")
    fail_if: Condition | None = Field(None, title="The condition that ends the stage as a failure")
    time: Annotated[float, Constant(TIME, above=0)] | None = Field(None, title="Planned length")
    next: Annotated[tuple[Branch, ...], Branches()] = Field(
        (), title="What follows", description="A stage, end or fail; or a list of them by condition"
    )
    on_fail: StageName | None = Field(
        None, title="What follows a failure", description="A stage, end or fail"
    )
    repeat: Annotated[int, Count()] = Field(1, title="How often it is done in a row")
    attempts: Annotated[int, Count()] | None = Field(None, title="How often it may be entered")
    frame: FrameName | None = Field(None, title="Task frame")
    contact: ContactName | None = Field(None, title="Object that the stage presses on")
    law: Law | None = Field(None, title="Control law")
    limits: Limits | None = Field(None, title="Limits")
    tare: Annotated[bool, Switch()] = Field(
        False, title="Tare", description="The sensor's mean over this stage becomes its zero"
    )

    grip: GripCommand | None = Field(None, title="Grips a loose body as the stage begins")
    release: Annotated[str, Released()] | None = Field(
        None, title="Opens the gripper as the stage begins"
    )
    allow: Annotated[tuple[str, ...], _ALLOWED] = Field((), title="Faults that a run may have")

    @property
    def ends_in_contact(self) -> bool:
        """Whether it holds a force, or ends as soon as one is measured."""
        if any(axis.has_force for axis in self.axes.values()):
            return True
        if self.until is None:
            return False
        names = (node for node in walk(self.until.tree) if isinstance(node, Name))
        return any(node.path[0] in ("force", "touching") for node in names)

    @property
    def generalised(self) -> tuple[str, ...]:
        """The equations whose set points are given as joint torques."""
        return tuple(n for n, point in self.constraints.items() if point.generalised is not None)

    def targets(self, following: str) -> tuple[str, ...]:
        """Where it may lead when it ends well, the default last.

        Args:
            following: the next stage of the file, `end` after the last one.
        """
        return tuple(branch.to for branch in self.next) or (following,)

    @classmethod
    def rules(cls, data: Map, context: ParseContext) -> None:
        """Require one end, a bound for the guard, and one mode on each axis."""
        _check_end(data, context)
        _check_path_done(data, context)
        _check_modes(data, context)
        _check_joints(data, context)
        if "grip" in data and "release" in data:
            message, span = "'release' beside 'grip'", data.node.key_span("release")
            context.error("TS026", message, span, "make two stages of it: the jaws need a time")


def _check_end(data: Map, context: ParseContext) -> None:
    sure = complete(data, context)
    axes = mapping(data.get("axes"))
    ending = [name for name, mode in MODES.items() if mode.ends]
    moves = any(name in mapping(axis) for axis in axes.values() for name in ending)
    if "until" in data:
        if "within" not in data and sure:
            context.error(
                "TS601",
                "'until' without 'within': nothing ends the stage if the condition never comes",
                data.node.key_span("until"),
                "add a bound, such as within: {time: 5 s, travel: 50 mm}",
            )
        if "time" in data:
            context.error(
                "TS603",
                "'time' beside 'until'",
                data.node.key_span("time"),
                "a stage ends by its condition or after its time; a bound stands under 'within'",
            )
    elif sure and not (moves or "time" in data or "path" in data) and not _damaged(data):
        ends = [f"a '{key}'" for key in ("time", "path", *ending)]
        context.error(
            "TS602",
            "nothing ends this stage",
            context.key_of(data),
            "'within' only bounds what 'until' ends: add 'until'"
            if "within" in data
            else f"add 'until' with 'within', {alternatives(ends)}",
        )


def _check_joints(data: Map, context: ParseContext) -> None:
    """A path of joints decides about the whole arm, by a law of its own or one with multipliers."""
    if "joints" not in mapping(data.get("path")):
        return
    for key, hint in _NOT_WITH_JOINTS.items():
        law = law_of(data.get("law", context.data.get("law")), context)
        of_multipliers = key != "axes" and law is not None and LAWS[law].multipliers
        if key in data and not of_multipliers:
            message = f"'{key}' in a stage whose path is one of joints"
            context.error("TS026", message, data.node.key_span(key), hint)


_HAVING = " or ".join(commanding(TORQUE, lambda law: law.multipliers))
#: Remedies for a motion and a force on one axis, by what laws command.
_ONE = "one or the other; a parallel law lets force win over position"
_ONE_AFTER_THE_OTHER = "one after the other: the motion until a force is measured, then the force"
_NOT_WITH_JOINTS = {
    "axes": "all joints are on the path, and none is left to an axis: make two stages of it",
    "law": "it is followed by inverse dynamics in joint space: leave the law out, or take "
    f"{_HAVING} for a path on constraints",
}


def _damaged(data: Map) -> bool:
    """Whether something in a stage's axes is wrong that may have been meant as an end."""
    axes = data.get("axes", {})
    if not isinstance(axes, Map):
        return bool(axes)
    if axes and axes.node.broken:
        return True
    return any(_is_damaged(axis) for axis in axes.values())


def _is_damaged(axis: object) -> bool:
    if isinstance(axis, Map):
        return axis.node.broken or not axis.keys() <= AxisEntry.model_fields.keys()
    return not isinstance(axis, str) or axis not in SHORT


def _check_path_done(data: Map, context: ParseContext) -> None:
    for key in ("until", "fail_if"):
        text = data.get(key)
        if not isinstance(text, Text) or "path" in data or not complete(data, context):
            continue
        if match := re.search(r"(?<![\w.])path_done(?![\w.])", text):
            context.error(
                "TS607",
                "'path_done' in a stage without a path",
                text.node.origin.at(match.start(), match.end()),
                "add a 'path', or take another condition",
            )


def _check_modes(data: Map, context: ParseContext) -> None:
    """Report what the stage's law cannot do: motion and force, dampers of axes, set points."""
    law = law_of(data.get("law", context.data.get("law")), context)
    if law is None:
        return
    facts, article = LAWS[law], "an" if law[0] in "aeio" else "a"
    for name, axis in mapping(data.get("axes")).items():
        modes = mapping(axis)
        motion = next((key for key in MOTIONS if key in modes), None)
        force = next((key for key in FORCES if key in modes), None)
        frees = motion is not None and MODES[motion].lets_go
        if motion and force and not (facts.shares or frees):
            context.error(
                "TS203",
                f"axis '{name}' has both a {motion} and a {force} under {article} {law} law",
                pointer(modes.node),
                _ONE if facts.commands == TORQUE else _ONE_AFTER_THE_OTHER,
            )
        if "damping" in modes and facts.undamped:
            context.error(
                "TS210",
                f"a 'damping' of axis '{name}' under the law {law}, which damps no axis",
                modes.node.key_span("damping"),
                facts.undamped,
            )
        soft = next((key for key in ("stiffness", "damping") if key in modes), None)
        if soft is not None and motion and not force and not facts.axis_springs:
            context.error(
                "TS212",
                f"a '{soft}' of axis '{name}' under the law {law}, which has no soft axes",
                modes.node.key_span(soft),
                f"take the law {DEFAULTS[facts.commands]}, or leave it out",
            )
    if "constraints" in data and not facts.multipliers:
        having = " or ".join(commanding(facts.commands, lambda law: law.multipliers))
        take = f"take {having}; under other laws " if having else ""
        context.error(
            "TS211",
            f"the law {law} has no multipliers, so it cannot reach set points of equations",
            data.node.key_span("constraints"),
            f"{take}give the axis a force",
        )
