"""`law`: which control law a stage follows, and its gains."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import combinations
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field
from pydantic.json_schema import SkipJsonSchema

from taskspec.expression import Expression
from taskspec.geometry.axis import AXES, PAIRS, Axis, axes_of, coupled
from taskspec.laws import DEFAULTS, LAWS, ControlLaw
from taskspec.laws.computed_torque import COMPUTED_TORQUE, ComputedTorque
from taskspec.laws.coupled import groups, with_damping
from taskspec.laws.design import joint_damping
from taskspec.laws.gains import AxisDesign, AxisPlant, Gain, Gains
from taskspec.laws.joint_velocity import JOINT_VELOCITY, JointVelocity
from taskspec.laws.law import Solve, commanding
from taskspec.laws.tank import misfit
from taskspec.spec.adapt import Adapt
from taskspec.spec.axis import AxisEntry
from taskspec.spec.disturbance_observer import DisturbanceObserver
from taskspec.spec.gains import AxisValues, GainField
from taskspec.spec.model import Model, mapping, short_form
from taskspec.spec.parse_context import ParseContext, span_of
from taskspec.spec.quantities import Constant, ForJoints, PositiveInterval
from taskspec.spec.servo import PLURALS, TORQUE, VELOCITY, command_of
from taskspec.spec.sliding import Sliding
from taskspec.spec.tank import Tank
from taskspec.spec.words import Word, Words
from taskspec.text.codes import register
from taskspec.text.data import Map, Text
from taskspec.text.units import (
    ANGULAR_DAMPING,
    DAMPING,
    FORCE,
    FREQUENCY,
    MASS,
    NUMBER,
    STIFFNESS,
    TIME,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

register(
    {
        "TS137": "an energy tank of a law that takes none",
        "TS139": "an estimate of the contact's stiffness that no gain would follow",
        "TS140": "a law that commands what the robot does not take",
        "TS143": "a sliding term or a disturbance observer where the law cannot have one",
        "TS206": "an unknown law",
        "TS207": "a gain that the law does not have",
        "TS213": "a goal in the null space under a law that leaves it alone",
    }
)

_GAINS = ("mass", "stiffness", "damping", "bandwidth", "damping_ratio", "dead_band")
NULL_SPACE_GOALS = ("posture", "joint-limits", "manipulability")

Damping = Annotated[AxisValues, GainField(DAMPING, least=0, matrix=True)]


Worth = Callable[[Expression], Any]
"""The value of an expression by which a gain varies: a number, or what it is of the inputs."""


def _constant(expression: Expression) -> float:
    """Of a law whose gains do not vary.

    Raises:
        ValueError: one does.
    """
    raise ValueError(f"a gain varies: {expression}")


def _gain(given: float | Expression, worth: Worth) -> Gain:
    if isinstance(given, Expression):
        return Gain(worth(given), "file", given)
    return Gain(given, "file")


def _usual_solve(given: dict[str, Any]) -> Solve:
    """How the law of these keys becomes what joints are commanded, unless a file says it."""
    kind = given.get("kind")
    return LAWS[kind].solve if kind in LAWS else ControlLaw.solve


class ForceGains(Model):
    """Gains of a force loop.

    Attributes:
        proportional: dimensionless.
        integral: [1/s].
        damping: on the measured velocity along a force axis [N*s/m, N*m*s/rad].
    """

    noun = "the gains of a force loop"

    proportional: Annotated[AxisValues, GainField(NUMBER, least=0, matrix=True)] | None = Field(
        None, title="Proportional gain"
    )
    integral: Annotated[AxisValues, GainField(FREQUENCY, least=0, matrix=True)] | None = Field(
        None, title="Integral gain"
    )
    damping: Damping | None = Field(None, title="Damping along force axes")


class StiffnessEstimate(Model):
    """The contact's stiffness along force axes, estimated while they press.

    Attributes:
        stiffness: bounds of what is estimated, and of what gains are designed for [N/m].
        memory: time constant of forgetting [s].
        dead_zone: changes of the force that tell nothing; None for what the sensor's noise makes
            it [N].
        rate: how fast the stiffness that gains are designed for changes at most, by its logarithm
            [1/s].
    """

    noun = "an estimate of the contact's stiffness"
    example = "estimate: {stiffness: 2..200 kN/m, memory: 200 ms}"
    short: ClassVar = PositiveInterval(STIFFNESS).json()

    stiffness: Annotated[tuple[float, float], PositiveInterval(STIFFNESS)] = Field(
        title="Bounds of the stiffness"
    )
    memory: Annotated[float, Constant(TIME, above=0)] = Field(0.2, title="Memory")
    dead_zone: Annotated[float, Constant(FORCE, above=0)] | None = Field(
        None, title="Changes of the force that tell nothing"
    )
    rate: Annotated[float, Constant(FREQUENCY, above=0)] = Field(
        50.0, title="Greatest relative rate of the stiffness that gains follow"
    )

    @classmethod
    def expand(cls, data: object, context: ParseContext) -> object:  # noqa: ARG003
        """Reads bare bounds."""
        return short_form(data, "stiffness")


class Law(Model):
    """A control law. Gains that are left out are designed.

    Attributes:
        kind: its name; it stands for one equation.
        mass: apparent mass [kg, kg*m^2].
        stiffness: [N/m, N*m/rad].
        damping: [N*s/m, N*m*s/rad].
        joint_damping: what a file calls the `damping` of a law that damps joints [N*m*s/rad]: one
            for all joints, or one for each.
        bandwidth: of motion axes [Hz].
        damping_ratio: of motion axes.
        dead_band: force error below which an axis is not moved [N, N*m].
        force: gains of the force loop.
        sliding: what motion axes are held with against what the model lacks; None for nothing.
        disturbance_observer: that takes off what pushes the arm; None for none.
        tank: what it may put into the arm beyond what its dampers take; None for whatever it does.
        estimate: of the contact's stiffness, which designed gains of force axes follow.
        orientation: how orientation errors are measured.
        null_space: what a redundant arm does with the joints that the task leaves free; these
            goals are added up.
        solve: how the command of the law becomes that of the joints: by its own closed form, or by
            a quadratic program that keeps the limits; by default as the law has it.
        solver: of the quadratic program.
        adapt: what it finds out about the arm as it moves; None for nothing.
    """

    noun = "a law"
    short: ClassVar = {"enum": list(LAWS)}
    advice: ClassVar = {
        "M": "the apparent mass is 'mass'",
        "D": "the damping is 'damping'",
        "K": "the spring is 'stiffness', of a law or of an axis",
    }

    kind: Annotated[str, Word(tuple(LAWS), "law", code="TS206")] = Field(
        DEFAULTS[TORQUE], title="Control law"
    )
    mass: Annotated[AxisValues, GainField(MASS, above=0, matrix=True)] | None = Field(
        None, title="Apparent mass"
    )
    stiffness: Annotated[AxisValues, GainField(STIFFNESS, least=0, matrix=True)] | None = Field(
        None, title="Stiffness"
    )
    damping: (
        Annotated[AxisValues, GainField(DAMPING, least=0, matrix=True, of_joints=True)] | None
    ) = Field(None, title="Damping")
    joint_damping: SkipJsonSchema[
        Annotated[tuple[float, ...], ForJoints(ANGULAR_DAMPING)] | None
    ] = None
    bandwidth: Annotated[AxisValues, GainField(FREQUENCY, above=0)] | None = Field(
        None, title="Bandwidth of motion axes"
    )
    damping_ratio: Annotated[AxisValues, GainField(NUMBER, above=0)] | None = Field(
        None, title="Damping ratio of motion axes"
    )
    dead_band: Annotated[AxisValues, GainField(FORCE, above=0)] | None = Field(
        None, title="Dead band of the force"
    )
    force: ForceGains | None = Field(None, title="Gains of the force loop")
    sliding: Sliding | None = Field(None, title="Sliding term of the motion axes")
    disturbance_observer: DisturbanceObserver | None = Field(None, title="Disturbance observer")
    tank: Tank | None = Field(None, title="Energy tank")
    estimate: StiffnessEstimate | None = Field(None, title="Estimate of the contact's stiffness")
    orientation: Annotated[
        Literal["so3", "rpy", "zyz"], Word(("so3", "rpy", "zyz"), "orientation error")
    ] = Field("so3", title="Orientation error")
    null_space: Annotated[tuple[str, ...], Words(Word(NULL_SPACE_GOALS, "null-space goal"))] = (
        Field(("posture",), title="Goals in the null space")
    )
    solve: Annotated[Solve, Word(("closed-form", "qp"), "torque computation")] = Field(
        default_factory=_usual_solve, title="Computation of the joints' command"
    )
    solver: Annotated[Literal["daqp", "osqp"], Word(("daqp", "osqp"), "solver")] = Field(
        "daqp", title="Solver of the quadratic program"
    )
    adapt: Adapt | None = Field(
        None,
        title="Adaptation",
        description="payload: to what the tool carries; gravity: to its weight alone",
    )

    @property
    def control_law(self) -> ControlLaw:
        """What is known of the law that `kind` names."""
        return JOINT_LAWS.get(self.kind) or LAWS[self.kind]

    @property
    def by_entry(self) -> dict[str, dict[str, float | Expression]]:
        """The gains that the file gives, by name and entry, numbers in SI units."""
        found: dict[str, dict[str, float | Expression]] = {}
        owners: tuple[tuple[str, Model | None, tuple[str, ...]], ...] = (
            ("", self, _GAINS),
            ("force.", self.force, tuple(ForceGains.model_fields)),
            ("sliding.", self.sliding, ("layer", "gain")),
        )
        for prefix, owner, names in owners:
            for name in names if owner is not None else ():
                values: AxisValues | None = getattr(owner, name)
                if values is not None:
                    found[f"{prefix}{name}"] = values.entries
        return found

    @property
    def varying(self) -> tuple[tuple[str, str], ...]:
        """The gains that vary, by name and entry: those of the file, and what follows from them.

        A designed damping follows mass and stiffness of its axis, and of those that are coupled
        with it, a designed integral the damping.
        """
        given, law = self.by_entry, self.control_law
        found = [
            (name, on)
            for name, entries in given.items()
            for on, value in entries.items()
            if isinstance(value, Expression)
        ]
        if not any(name in ("mass", "stiffness", "damping") for name, _ in found):
            return tuple(found)
        moved = [on for name in ("mass", "stiffness") for on in given.get(name, ()) if on in PAIRS]
        damping = {axis for on in given.get("damping", ()) for axis in axes_of(on)}
        varies = {axis for name, on in found if name != "damping" for axis in axes_of(on)}
        follow: list[str] = [axis for axis in AXES if axis in varies - damping]
        for group in coupled(moved):
            if varies & {*group} and not damping & {*group}:
                follow += [axis for axis in group if axis not in follow]
                follow += [a + b for a, b in combinations(group, 2)]
        if "damping" not in law.gain_names or law.damps_joints:
            follow = []
        found += [("damping", on) for on in follow]
        if "force.integral" in law.gain_names:
            damped = {axis for name, on in found if name == "damping" for axis in axes_of(on)}
            own = given.get("force.integral", {})
            found += [("force.integral", a) for a in AXES if a in damped and a not in own]
        return tuple(found)

    def following(self, axis: AxisEntry, on: Axis) -> tuple[str, ...]:
        """The designed gains of an axis that follow the stiffness that is estimated there."""
        if self.estimate is None or not axis.has_force or on.is_rotation:
            return ()
        own = {"damping"} if axis.damping is not None else set()
        given = {name for name, entries in self.by_entry.items() if on in entries} | own
        return tuple(name for name in self.control_law.follows if name not in given)

    @property
    def matrices(self) -> bool:
        """Whether a gain of the file couples axes, or varies."""
        pairs = any(on in PAIRS for entries in self.by_entry.values() for on in entries)
        return pairs or bool(self.varying)

    def given(self, axis: Axis, worth: Worth) -> dict[str, Gain]:
        """The gains that the file gives on an axis, by name.

        Args:
            axis: of the stage.
            worth: values of expressions.
        """
        return {
            name: _gain(entries[axis], worth)
            for name, entries in self.by_entry.items()
            if axis in entries
        }

    def design(
        self,
        axes: Mapping[Axis, AxisEntry],
        plants: Mapping[Axis, AxisPlant],
        mobility: NDArray[np.float64] | None = None,
        worth: Worth = _constant,
    ) -> Gains:
        """All gains of a stage: those of the file, and designed ones for what it leaves out.

        Args:
            axes: modes of the axes that exist.
            plants: mass and stiffness of the same axes.
            mobility: (m, m) J H^-1 J^T on them; None where they do not move each other.
            worth: values of the expressions by which gains vary.
        """
        gains: Gains = {}
        each = {
            name: AxisDesign(
                plant=plants[name],
                given=self.given(name, worth),
                rotation=name.is_rotation,
                force=axis.has_force,
                stiffness=axis.stiffness,
                damping=axis.damping,
                lets_go=axis.mode.lets_go,
            )
            for name, axis in axes.items()
        }
        for name, of_axis in each.items():
            for gain, value in self.control_law.design(of_axis).items():
                gains.setdefault(gain, {})[name] = value
        for gain, entries in self.by_entry.items():
            for on, given in entries.items():
                if on in PAIRS and all(axis in gains.get(gain, {}) for axis in PAIRS[on]):
                    gains[gain][on] = _gain(given, worth)
        if groups(gains):
            with_damping(self.control_law, gains, each, mobility)
        return gains

    def design_equation(
        self, joints: bool, plant: AxisPlant, worth: Worth = _constant
    ) -> dict[str, Gain]:
        """The gains of the force loop of one equation.

        An equation takes what is given for translations, one on joints what is given for rotations.

        Args:
            joints: whether it is on joints.
            plant: mass and stiffness along its unit gradient.
            worth: values of the expressions by which gains vary.
        """
        given = self.given(Axis.RX if joints else Axis.X, worth)
        return self.control_law.design_equation(AxisDesign(plant, given, rotation=joints))

    def design_joint(self, plant: AxisPlant, *, turns: bool, worth: Worth) -> dict[str, Gain]:
        """The gains of the motion of one joint on a path of joints.

        It takes what is given for rotations where it turns, and for translations where it slides;
        what is given for the others alone where nothing is given for these.

        Args:
            plant: inertia of the joint.
            turns: whether it is a hinge.
            worth: values of the expressions by which gains vary.
        """
        linear, angular = self.given(Axis.X, worth), self.given(Axis.RX, worth)
        given = linear | angular if turns else angular | linear
        return self.control_law.design(AxisDesign(plant, given, rotation=turns))

    def design_joints(self, joints: Sequence[AxisPlant]) -> dict[str, Gain]:
        """The damping of each joint [N m s/rad], by `joint.N`.

        Args:
            joints: for each joint, its inertia with the others free (h) and held, and the
                stiffness that springs and contact have about it (k).
        """
        return joint_damping(self.joint_damping, joints)

    @classmethod
    def expand(cls, data: object, context: ParseContext) -> object:
        """Reads a bare name as a law with designed gains, and damping in the joints as such.

        A law without a name is the default one of what the robot takes.
        """
        full = short_form(data, "kind")
        if not isinstance(full, Map):
            return full
        if "kind" not in full.node.entries:
            named = Map({"kind": Text(default_law(context)), **full})
            named.node = full.node
            full = named
        kind = full.get("kind")
        if isinstance(kind, str) and kind in LAWS and LAWS[kind].damps_joints:
            renamed = Map({"joint_damping" if k == "damping" else k: v for k, v in full.items()})
            renamed.node = full.node
            return renamed
        return full

    @classmethod
    def rules(cls, data: Map, context: ParseContext) -> None:
        """Reports gains, and goals of the null space, that the named law does not have."""
        if "joint_damping" in data.node.entries:
            span = data.node.key_span("joint_damping")
            having = " or ".join(name for name, law in LAWS.items() if law.damps_joints)
            context.error(
                "TS020",
                "unknown key 'joint_damping' in a law",
                span,
                f"the law {having} calls it 'damping'",
            )
        kind = data.get("kind")
        if "solver" in data and data.get("solve", _usual_solve({"kind": kind})) == "closed-form":
            context.error(
                "TS026",
                "a solver is of the quadratic program, and this law does not solve one",
                data.node.key_span("solver"),
                "add 'solve: qp'",
            )
        if not isinstance(kind, str) or kind not in LAWS:
            return
        _check_command(kind, data, context)
        reason = misfit(LAWS[kind])
        if "tank" in data and reason:
            fitting = ", ".join(name for name, law in LAWS.items() if not misfit(law))
            context.error(
                "TS137",
                f"the law '{kind}' takes no tank: {reason}",
                data.node.key_span("tank"),
                f"laws that take one: {fitting}",
            )
        if "adapt" in data and not LAWS[kind].compensates:
            law, takes = LAWS[kind], command_of(context.data)
            why = "compensates no weight" if law.commands == TORQUE else "leaves that to the servo"
            having = ", ".join(commanding(TORQUE, lambda each: each.compensates))
            context.error(
                "TS138",
                f"the law '{kind}' {why}: a payload that it knows of changes nothing",
                data.node.key_span("adapt"),
                f"leave it out, or take one of {having}"
                + ("" if takes == TORQUE else "; of a wrist sensor's weight, 'tare' takes care"),
            )
        if "null_space" in data and not LAWS[kind].holds_null_space:
            context.error(
                "TS213",
                f"the law '{kind}' leaves the null space alone",
                data.node.key_span("null_space"),
                "laws that do not: "
                + ", ".join(commanding(LAWS[kind].commands, lambda law: law.holds_null_space)),
            )
        _check_robust(kind, data, context)
        if "estimate" in data and not LAWS[kind].follows:
            context.error(
                "TS139",
                f"the law '{kind}' has no force loop, whose gains would follow the stiffness that "
                "is estimated",
                data.node.key_span("estimate"),
                "laws that have one: "
                + ", ".join(commanding(LAWS[kind].commands, lambda law: bool(law.follows))),
            )
        has = LAWS[kind].gain_names
        force = mapping(data.get("force"))
        given = [(key, data) for key in _GAINS if key in data]
        if "force" in data and not any(gain.startswith("force.") for gain in has):
            given.append(("force", data))
        else:
            given += [(key, force) for key in force if key in ForceGains.model_fields]
        for key, owner in given:
            name = f"force.{key}" if owner is force else key
            if name not in has:
                hint = f"its gains: {', '.join(has)}"
                if name == "stiffness" and LAWS[kind].soft_axes:
                    hint += "; a spring is one of an axis: x: {stiffness: 500 N/m}"
                message = f"the law '{kind}' has no gain '{name}'"
                context.error("TS207", message, owner.node.key_span(key), hint)


#: Laws of a stage with a path of joints, by name; no file names them.
JOINT_LAWS: dict[str, ComputedTorque | JointVelocity] = {
    law.kind: law for law in (COMPUTED_TORQUE, JOINT_VELOCITY)
}


def joint_law(command: str, law: Law) -> Law:
    """The law of a stage with a path of joints of an arm that is commanded so.

    Args:
        command: what the joints take.
        law: the file's, whose observer and whose way to what they are commanded it has.
    """
    if command == "torque":
        return Law.model_construct(
            kind=COMPUTED_TORQUE.kind,
            solve=ControlLaw.solve,
            disturbance_observer=law.disturbance_observer,
        )
    return Law.model_construct(kind=JOINT_VELOCITY.kind, solve=law.solve)


def default_law(context: ParseContext) -> str:
    """The law where the file names none: of those that command what the robot takes."""
    return DEFAULTS[TORQUE if command_of(context.data) == TORQUE else VELOCITY]


def law_of(data: object, context: ParseContext) -> str | None:
    """The supported law that a raw `law` names, the default where it names none, else None."""
    kind = data.get("kind") if isinstance(data, Map) else data
    if kind is None:
        return default_law(context)
    return str(kind) if isinstance(kind, Text | str) and kind in LAWS else None


def _check_robust(kind: str, data: Map, context: ParseContext) -> None:
    """Reports a sliding term, or a disturbance observer, that the law cannot have."""
    law = LAWS[kind]
    slides = [name for name, each in LAWS.items() if each.slides]
    observing = commanding(TORQUE, lambda each: each.observes_disturbances)
    if "sliding" in data and not law.slides:
        hint = f"laws that have one: {', '.join(slides)}"
        if law.observes_disturbances:
            hint += "; or 'disturbance_observer' in its place"
        why = "its axes have no acceleration of their own that a sliding term could be added to"
        span = data.node.key_span("sliding")
        context.error("TS143", f"the law '{kind}' does not slide: {why}", span, hint)
    if "disturbance_observer" in data and not law.observes_disturbances:
        span, hint = data.node.key_span("disturbance_observer"), "laws beside which one may stand: "
        text = f"the law '{kind}' has no disturbance observer: {_why_unobserved(law)}"
        context.error("TS143", text, span, hint + ", ".join(observing))


def _why_unobserved(law: ControlLaw) -> str:
    if law.commands != TORQUE:
        return "it commands velocities, and the servo that follows them holds against pushes"
    if law.bare:
        return "it leaves the arm's weight to a counterweight, and all of it would be a disturbance"
    return "the forces of its constraints follow from the same torques, and would be taken off"


def _check_command(kind: str, data: Map, context: ParseContext) -> None:
    """Reports a law that commands what the robot does not take, with the law to take instead.

    That is the first with all gains that are given, of those alike its dual.
    """
    takes, law = command_of(context.data), LAWS[kind]
    if (law.commands == TORQUE) == (takes == TORQUE):
        return
    given = {key for key in _GAINS if key in data}
    given |= {f"force.{key}" for key in mapping(data.get("force"))}
    others = [LAWS[law.dual], *(each for each in LAWS.values() if each.commands != law.commands)]
    dual = next((each for each in others if given <= {*each.gain_names}), others[0]).kind
    other = "command: torque" if takes != TORQUE else "command: velocity, or command: position"
    context.error(
        "TS140",
        f"the law '{kind}' commands {PLURALS[law.commands]}, and this robot takes {PLURALS[takes]}",
        span_of(data.get("kind")),
        f"law: {dual}; or, for an arm that takes {PLURALS[law.commands]}, under 'robot' {other}",
    )
