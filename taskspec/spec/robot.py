"""`robot`: the arm, its tool, where it stands and where it starts."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from taskspec.shapes import tool_shapes
from taskspec.spec.alias import Diameter
from taskspec.spec.fields import RPY, XYZ
from taskspec.spec.gripper import Gripper
from taskspec.spec.model import Model, complete, mapping, short_form
from taskspec.spec.parse_context import ParseContext, span_of
from taskspec.spec.protection import Protection
from taskspec.spec.quantities import Constant, Entries, ForJoints, QuantityList
from taskspec.spec.servo import COMMANDS, PLURALS, TORQUE, VELOCITY, Servo
from taskspec.spec.sizes import check_sizes
from taskspec.spec.words import Free, NameReference, Switch, Texts, Word
from taskspec.text.codes import register
from taskspec.text.data import Items, Map
from taskspec.text.units import (
    ANGLE,
    ANGULAR_DAMPING,
    FORCE,
    FREQUENCY,
    INERTIA,
    LENGTH,
    MASS,
    MOMENT,
    TIME,
)

register({"TS128": "something that cannot be held"})

Held = Annotated[
    str,
    NameReference(
        lambda r: r.held,
        "handle or loose body",
        "TS128",
        "handles and loose bodies",
        "'{}' is neither a mechanism's handle nor a loose body",
    ),
]
_ENDS = tool_shapes()


class Pose(Model):
    """A placement: `xyz` [m], then `rpy` [rad], about fixed axes x, y, z in this order."""

    noun = "a pose"

    xyz: XYZ = Field((0.0, 0.0, 0.0), title="Position", description="[x, y, z], lengths")
    rpy: RPY = Field((0.0, 0.0, 0.0), title="Orientation", description="[roll, pitch, yaw], angles")


class Flange(Model):
    """What carries the tool: a frame of the robot's file, and one of one's own in it.

    Attributes:
        body: the body, site or frame; None for the end of the arm, where it is clear.
        xyz: where in its frame the tool is mounted [m].
        rpy: how that is turned [rad]; the tool goes along its z.
    """

    noun = "a flange"
    example = "flange: {body: wrist_link, rpy: [0, 90 deg, 0]}"
    short: ClassVar = Free(filled=True).json()

    body: Annotated[str, Free(filled=True)] | None = Field(
        None, title="Body", description="The body, site or frame that carries the tool"
    )
    xyz: XYZ = Field(
        (0.0, 0.0, 0.0), title="Position", description="[x, y, z] in the frame of that body"
    )
    rpy: RPY = Field(
        (0.0, 0.0, 0.0), title="Orientation", description="[roll, pitch, yaw] of the tool's frame"
    )

    @classmethod
    def expand(cls, data: object, context: ParseContext) -> object:  # noqa: ARG003
        """Reads a bare name."""
        return short_form(data, "body")


class Tool(Model):
    """The tool. Its tip is its extreme point on the tool axis.

    Attributes:
        shape: of the end that touches.
        radius: of a sphere or cylinder [m]; None for the default.
        size: full edges of a box [m].
        thickness: of a cylinder, along the tool's axis [m]; None for its whole length.
        length: from the flange to the tip [m]; None for the default.
        mass: [kg].
        com: centre of mass from the flange in the tool's axes [m]; None where the mass is shared
            out over stem and head by volume.
        inertia: about the centre of mass in the tool's axes [kg m^2], xx, yy, zz and xy, xz, yz, or
            the first three of these; None for that of stem and head.
    """

    noun = "a tool"
    aliases: ClassVar = {"diameter": Diameter()}

    shape: Annotated[str, Word(tuple(_ENDS), "tool shape")] = Field(
        next(iter(_ENDS)), title="Shape of the tool's end"
    )
    radius: Annotated[float, Constant(LENGTH, above=0)] | None = Field(None, title="Radius")
    size: Annotated[tuple[float, float, float], Entries((LENGTH,) * 3, above=0)] | None = Field(
        None, title="Full edges of a box"
    )
    thickness: Annotated[float, Constant(LENGTH, above=0)] | None = Field(
        None, title="Thickness of a cylinder"
    )
    length: Annotated[float, Constant(LENGTH, least=0)] | None = Field(
        None, title="Length from flange to tip"
    )
    mass: Annotated[float, Constant(MASS, least=0)] = Field(0.0, title="Mass")
    com: XYZ | None = Field(
        None,
        title="Centre of mass",
        description="[x, y, z] from the flange, in the tool's axes",
    )
    inertia: Annotated[tuple[float, ...], Entries((INERTIA,) * 6, fewest=3)] | None = Field(
        None,
        title="Inertia about the centre of mass",
        description="[xx, yy, zz] or [xx, yy, zz, xy, xz, yz], in the tool's axes",
    )

    @classmethod
    def rules(cls, data: Map, context: ParseContext) -> None:
        """Requires the sizes of the tool's shape, and a mass where there is inertia."""
        for key in ("com", "inertia"):
            if key in data and "mass" not in data and not context.truth:
                message = f"a tool with '{key}' needs its mass"
                context.error("TS302", message, data.node.key_span(key), "mass: 1.2 kg")
        inertia = data.get("inertia")
        if isinstance(inertia, Items) and 3 < len(inertia) < 6:
            message = f"3 or 6 entries are needed here, these are {len(inertia)}"
            hint = "[xx, yy, zz] or [xx, yy, zz, xy, xz, yz]"
            context.error("TS023", message, span_of(inertia), hint)
        shape = data.get("shape", cls.model_fields["shape"].default)
        if isinstance(shape, str) and shape in _ENDS:
            keys = _ENDS[shape].tool_keys
            needed = [key for key, is_needed in keys.items() if is_needed]
            # A tool of every shape has a length.
            check_sizes(shape, needed, {*keys, "length"}, data, context)
            if "thickness" in data and "thickness" not in keys:
                message, span = f"a {shape} has no 'thickness'", data.node.key_span("thickness")
                context.error("TS302", message, span, f"its sizes: {', '.join(sorted(keys))}")


class Start(Model):
    """Where the run begins: a pose of the tool tip in the world, or joint positions.

    Attributes:
        xyz: position of the tip in the world [m]; None for where it takes hold of `grasp`.
        rpy: its orientation [rad]; None for pointing down with any yaw.
        joints: joint positions [rad or m].
    """

    noun = "a start"

    xyz: XYZ | None = Field(None, title="Tool tip in the world", description="[x, y, z], lengths")
    rpy: RPY | None = Field(None, title="Orientation of the tool", description="[roll, pitch, yaw]")
    joints: Annotated[tuple[float, ...], QuantityList(ANGLE, LENGTH)] | None = Field(
        None,
        title="Joint positions",
        description="One for each joint: angles of hinges, lengths of slides",
    )

    @classmethod
    def rules(cls, data: Map, context: ParseContext) -> None:
        """Allows a pose or joints, not both."""
        if "joints" in data and ("xyz" in data or "rpy" in data):
            context.error(
                "TS026",
                "a start is given by 'xyz' and 'rpy', or by 'joints'",
                data.node.key_span("joints"),
                "keep one of the two",
            )
        elif (
            not data.keys() & {"joints", "xyz"}
            and complete(data, context)
            and "grasp" not in mapping(context.data.get("robot"))
        ):
            context.error(
                "TS021", "a start needs 'xyz' or 'joints'", data.node.key_span("rpy"),
                "leave 'start' out to begin in the robot's home position; alone, 'rpy' goes with a "
                "'grasp'",
            )  # fmt: skip


class Noise(Model):
    """Standard deviations of the sensor's noise: `force` [N] and `torque` [N*m]."""

    noun = "noise"
    example = "noise: {force: 0.1 N, torque: 5 mN*m}"
    short: ClassVar = Constant(FORCE, least=0).json()

    force: Annotated[float, Constant(FORCE, least=0)] = Field(0.0, title="Of each force")
    torque: Annotated[float, Constant(MOMENT, least=0)] = Field(0.0, title="Of each moment")

    @classmethod
    def expand(cls, data: object, context: ParseContext) -> object:  # noqa: ARG003
        """Reads a bare force as the noise of the forces."""
        return short_form(data, "force")


class Sensor(Model):
    """The force sensor.

    Attributes:
        at: `contact` measures the contact alone; `wrist` also the weight and the inertia of the
            tool, which hangs on it.
        rate: of its samples [Hz]; None for the controller's.
        delay: of a sample beyond the one tick that it always takes [s].
        noise: standard deviations, None for none.
        bias: force [N] and moment [N*m] that it shows when there is none, in the tool's axes.
        filter: corner frequency of its first-order low-pass [Hz]; None for none.
    """

    noun = "a sensor"
    example = "sensor: {at: wrist, delay: 2 ms, noise: 0.1 N}"

    at: Annotated[Literal["wrist", "contact"], Word(("wrist", "contact"), "place")] = Field(
        "contact",
        title="What it measures",
        description="contact: the contact alone; wrist: also the tool's weight and inertia",
    )
    rate: Annotated[float, Constant(FREQUENCY, least=1.0, most=100e3)] | None = Field(
        None, title="Rate of its samples"
    )
    delay: Annotated[float, Constant(TIME, least=0, most=1.0)] = Field(0.0, title="Delay")
    noise: Noise | None = Field(None, title="Standard deviation of its noise")
    bias: Annotated[tuple[float, ...], Entries((FORCE,) * 3 + (MOMENT,) * 3)] = Field(
        (0.0,) * 6, title="Bias", description="[x, y, z, rx, ry, rz], in the tool's axes"
    )
    filter: Annotated[float, Constant(FREQUENCY, above=0)] | None = Field(
        None, title="Corner frequency of its low-pass"
    )


class JointEncoder(Model):
    """What measures the joints' positions.

    Attributes:
        resolution: from line to line [rad; of a slide the same number in m]: one for all, or one
            for each joint; 0 for exact readings.
    """

    noun = "an encoder"
    example = "encoder: {resolution: 0.1 mrad}"
    short: ClassVar = Constant(ANGLE, least=0).json()

    resolution: Annotated[tuple[float, ...], ForJoints(ANGLE)] = Field(
        (0.0,), title="Resolution", description="From line to line: one for all, or one for each"
    )

    @classmethod
    def expand(cls, data: object, context: ParseContext) -> object:  # noqa: ARG003
        """Reads a bare angle."""
        return short_form(data, "resolution")


class Payload(Model):
    """What the tool carries without the controller's knowledge.

    Attributes:
        mass: [kg].
        xyz: of its centre of mass in the tool's axes, from the tip [m].
    """

    noun = "a payload"
    example = "robot.payload: {mass: 300 g, xyz: [0, 0, 20 mm]}"
    short: ClassVar = Constant(MASS, least=0).json()

    mass: Annotated[float, Constant(MASS, least=0)] = Field(0.0, title="Mass")
    xyz: XYZ = Field(
        (0.0, 0.0, 0.0),
        title="Centre of mass",
        description="[x, y, z] in the tool's axes, from the tip",
    )

    @classmethod
    def expand(cls, data: object, context: ParseContext) -> object:  # noqa: ARG003
        """Reads a bare mass."""
        return short_form(data, "mass")


class Robot(Model):
    """The arm and what it carries.

    Attributes:
        model: a built-in name, or a path relative to the task file.
        xacro: values of the arguments of a xacro file, as text.
        flange: what carries the tool; None if it is clear without.
        base: placement of the robot's base in the world.
        tool: what is mounted on the flange.
        start: where the run begins; None for the model's home position.
        posture: joint positions that a redundant arm stays near [rad or m]; None for the start.
        balanced: a counterweight carries the arm's gravity.
        joint_damping: of the plant's joints [N*m*s/rad]: one for all, or one for each. The
            controller knows of it what `control.friction` has it compensate.
        joint_friction: Coulomb's, of the plant's joints [N*m]: one for all, or one for each. The
            controller knows of it what `control.friction` has it compensate.
        payload: what the plant's tool carries in addition; under `truth` and `vary` alone, for the
            controller knows of it what laws adapt to. None for nothing.
        grasp: the handle or loose body that it holds from the start; None for nothing.
        gripper: the jaws at the tool tip, which stages close and open.
        encoder: what measures the joints; None for exact readings.
        sensor: what measures the contact wrench.
        protection: where the robot's own controller stops; None where nobody says.
        command: what its joints are commanded: torques, velocities or positions.
        servo: how they follow velocities and positions; of an arm that takes torques, no matter.
    """

    noun = "a robot"
    example = "robot: {model: panda}"
    model: Annotated[str, Free(filled=True)] = Field(
        title="Robot model",
        description="A built-in name, the path of an MJCF, URDF or xacro file, or "
        "PACKAGE:NAME of a robot that pip has installed (taskspec robots)",
    )
    xacro: Annotated[dict[str, str], Texts("an argument", "xacro: {name: ur5e}")] = Field(
        {}, title="Arguments", description="Of a xacro file: what it has in <xacro:arg>"
    )
    flange: Flange | None = Field(
        None, title="Flange", description="The body or frame that carries the tool"
    )
    base: Pose = Field(Pose(), title="Placement of the base in the world")
    tool: Tool = Field(Tool(), title="Tool")
    start: Start | None = Field(None, title="Start of the run")
    posture: Annotated[tuple[float, ...], QuantityList(ANGLE, LENGTH)] | None = Field(
        None, title="Posture", description="Joint positions that a redundant arm stays near"
    )
    balanced: Annotated[bool, Switch()] = Field(
        False, title="Balanced", description="A counterweight carries the arm's gravity"
    )
    joint_damping: Annotated[tuple[float, ...], ForJoints(ANGULAR_DAMPING)] = Field(
        (0.0,), title="Damping of the plant's joints"
    )
    joint_friction: Annotated[tuple[float, ...], ForJoints(MOMENT)] = Field(
        (0.0,), title="Coulomb friction of the plant's joints"
    )
    payload: Payload | None = Field(
        None,
        title="Payload",
        description="Under 'truth' and 'vary': the controller does not know it",
    )
    grasp: Held | None = Field(
        None, title="What it holds", description="OBJECT.handle, or a loose body"
    )
    gripper: Gripper = Field(
        Gripper(), title="Gripper", description="Two jaws at the tool tip, for 'grip' of stages"
    )
    encoder: JointEncoder | None = Field(None, title="Encoders of the joints")
    sensor: Sensor = Field(Sensor(), title="Force sensor")
    protection: Protection | None = Field(
        None,
        title="Protection",
        description="Where the robot's own controller stops: a built-in name (taskspec robots), "
        "the path of a YAML file, or what stands in one",
    )
    command: Annotated[Literal["torque", "velocity", "position"], Word(COMMANDS, "command")] = (
        Field(TORQUE, title="What its joints are commanded")
    )
    servo: Servo = Field(
        Servo(),
        title="Servo of its joints",
        description="How it follows velocities and positions: a built-in name, the path of a YAML "
        "file, or what stands in one",
    )

    @property
    def takes_torques(self) -> bool:
        """Whether its joints are commanded torques."""
        return self.command == TORQUE

    @property
    def commands(self) -> str:
        """What its joints take, in the plural."""
        return PLURALS[self.command]

    @property
    def laws_command(self) -> str:
        """What laws command its joints: positions are the sums of velocities."""
        return TORQUE if self.takes_torques else VELOCITY

    @classmethod
    def rules(cls, data: Map, context: ParseContext) -> None:
        """Keeps out what only the real robot has, and the servo of an arm that takes torques."""
        if "servo" in data and data.get("command", TORQUE) == TORQUE:
            context.error(
                "TS026",
                "joints that are commanded torques have no servo",
                data.node.key_span("servo"),
                "say what they are commanded: command: velocity, or command: position",
            )
        if "payload" in data and not context.truth:
            context.error(
                "TS026",
                "the controller does not know of a payload, so 'robot' does not have one",
                data.node.key_span("payload"),
                "under 'truth' it is what the tool really carries, such as "
                f"truth: {{{Payload.example}}}; what it is known to carry belongs to tool.mass",
            )
