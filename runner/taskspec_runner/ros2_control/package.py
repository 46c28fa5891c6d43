"""The files of a ROS 2 package with a task's controller as a plugin of ros2_control."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from xml.etree import ElementTree

import casadi as ca
import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.control.servo import drive_gains
from taskspec.deferred_methods import dataclass
from taskspec.native import expressions_c, kernel_c
from taskspec.program.execution.sensor_zero import SensorZero, sensor_zero
from taskspec.program.program import Program
from taskspec.robot import RobotModel
from taskspec.robot.rigid_body import rigid_body
from taskspec.spec import Robot
from taskspec.spec.gripper import REPORTED
from taskspec.spec.params import LiveParam
from taskspec.text.units import in_si
from taskspec_runner.controller_c.commanded import CommandedQuantity
from taskspec_runner.controller_c.source import Controller, controller_of, filled
from taskspec_runner.controller_c.states import BEARS, STATES
from taskspec_runner.export.robot_description import robot_description
from taskspec_runner.export.scene import RunScene
from taskspec_runner.plant.arm import SceneArm
from taskspec_runner.plant.names import PREFIX
from taskspec_runner.plant.scene import scene_spec

_TEMPLATES = Path(__file__).parent / "template"
#: Of the example's force sensor: in ros2_control, and its site in MuJoCo.
_SENSOR = "tool_sensor"
_STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
_WEIGHT_ROW = (
    "| `weight_in_reading` | `false` | `true` where the tool's weight is in the reading: that of "
    "the task's tool is subtracted |\n"
)
_WORLD_ROW = (
    "| `wrench_in_world` | `false` | `true` where the six interfaces give the contact about the "
    "tip in world axes: `sensor_position` and `sensor_rpy` are not used |\n"
)
_COMPENSATED_ROW = (
    "| `gravity_compensated` | `false` | `true` where the robot adds the torques of gravity "
    "itself: the model's, of arm and tool, are subtracted |\n"
)
_WEIGHED = "The tool's weight is in it (`at: wrist`), and the task takes it off."
_UNWEIGHED = (
    "The tool's weight must not be in it (`at: contact`): either the driver has taken it off, or "
    "`weight_in_reading` is set."
)


@dataclass(frozen=True, slots=True)
class RosPackage:
    """A package of ROS 2.

    Attributes:
        name: of the package.
        files: contents by their paths in it.
    """

    name: str
    files: dict[str, bytes]

    def write(self, folder: Path) -> list[Path]:
        """Writes the files; their paths.

        Raises:
            OSError: the folder cannot be written.
        """
        paths = []
        for name, content in self.files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
            paths.append(path)
        return paths


#: What the plugin of a task that grips has in addition, by its places in the template.
_GRIPPER = {
    "GRIP_DECLARED": '\n    auto_declare<std::string>("gripper", "gripper/effort");',
    "GRIP_CLAIMED": (
        '\n    commands_.push_back(prefix + node->get_parameter("gripper").as_string());'
    ),
    "GRIP_WRITTEN": (
        "\n    written = command_interfaces_[JOINTS].set_value(output_.grip) && written;"
    ),
}
_GRIPPER_INTERFACES = (
    "| command | `gripper/effort` | N, what each jaw is to press with; 0 opens the gripper |\n"
    "| state | {reports} | N, m: what each jaw presses with, 0 with nothing between them, and how "
    "far what is gripped has slid since the jaws closed |\n"
)
_GRIPPER_ROW = "| `gripper` | `gripper/effort` | the command interface of the gripper |\n"
_NO_GRIPPER = (
    "The scene has no gripper: hardware that has one exports its interfaces, or the controller "
    "cannot be activated."
)


def package_of(program: Program) -> RosPackage:
    """The package of a program's controller.

    Raises:
        UnsupportedOperationError: an expression has an operation that C lacks.
        ValueError: MuJoCo cannot write the scene.
    """
    made = controller_of(program)
    package = re.sub("_+", "_", f"taskspec_{made.name.lower()}").rstrip("_")
    example = _Example(program, package, made.name)
    parts = _parts(program, made, package, example.notes)
    texts = {
        "src/controller.cpp": _filled("controller.cpp", parts),
        f"src/{made.name}.h": made.header,
        f"src/{made.name}.c": made.source,
        f"src/{made.name}_model.h": _filled("model.h", parts),
        f"src/{made.name}_model.c": _filled("model.c", parts),
        "CMakeLists.txt": _filled("CMakeLists.txt", parts),
        "package.xml": _filled("package.xml", parts),
        "plugin.xml": _filled("plugin.xml", parts),
        "README.md": _filled("README.md", parts),
        "config/controllers.yaml": _filled("controllers.yaml", parts),
        "launch/mujoco.launch.py": _filled("mujoco.launch.py.in", parts),
        f"urdf/{made.name}.urdf.xacro": example.urdf,
        "mujoco/scene.xml": example.scene,
    }
    files = {name: text.encode() for name, text in texts.items()}
    return RosPackage(package, files | example.meshes)


def _filled(name: str, parts: dict[str, str]) -> str:
    return filled((_TEMPLATES / name).read_text(encoding="utf-8"), parts)


def _parts(
    program: Program, made: Controller, package: str, notes: Sequence[str]
) -> dict[str, str]:
    """What stands in the places of the templates."""
    context = program.context
    robot, task, equations = context.robot, context.loaded.task, list(context.equations)
    zero = sensor_zero(task, task.robot.sensor, robot)
    weighs = zero is not None and task.robot.sensor.at == "wrist"
    grips = bool(task.gripped)
    reports = [name.replace(".", "/") for name in REPORTED] if grips else []
    of_equations = [f"{name}/reaction" for name in equations]
    reactions = [*of_equations, *reports]
    weight = {"WEIGHT": _WEIGHED if weighs else _UNWEIGHED}
    return {
        "NAME": made.name,
        "UPPER": made.name.upper(),
        "PACKAGE": package,
        # It stands in comments, strings, XML and YAML.
        "TITLE": re.sub(r"[^\w .,-]", "_", task.name, flags=re.ASCII),
        "VERSION": version("taskspec-robotics"),
        "RATE": f"{1 / context.period:g}",
        "BEARS": str(BEARS),
        "STATES": str(len(STATES)),
        "STATE_LIST": ", ".join(json.dumps(name.lower()) for name, _ in STATES),
        "JOINTS": str(robot.n),
        "JOINT_LIST": ", ".join(map(json.dumps, robot.joint_names)),
        "JOINT_DEFAULT": ", ".join(f"`{name}`" for name in robot.joint_names),
        "REACTION_LIST": ", ".join(map(json.dumps, reactions)),
        "REACTION_NAMES": ", ".join(task.reported),
        **{key: text if grips else "" for key, text in _GRIPPER.items()},
        **_commanded(program),
        "WEIGHS": "true" if weighs else "false",
        "START_ROWS": "".join(
            f"| `{name}` | {float(x):.6g} |\n"
            for name, x in zip(robot.joint_names, context.start, strict=True)
        ),
        "REACTION_ROW": (
            "| state | `EQUATION/reaction`: "
            + ", ".join(f"`{name}`" for name in of_equations)
            + " | N or N m, along the gradient of the equation on joints as the file writes it, by "
            "the constraint on the arm |\n"
            if of_equations
            else ""
        )
        + (_GRIPPER_INTERFACES.format(reports=", ".join(f"`{n}`" for n in reports)) * grips),
        "AND_SENSOR": _listed(["sensor", *["reactions"] * bool(reactions), *["gripper"] * grips]),
        "REACTION_PARAMETER": (
            "| `reactions` | "
            + ", ".join(f"`{name}`" for name in reactions)
            + " | the state interfaces of "
            + " and of ".join(
                ["the reaction of each equation"] * bool(of_equations)
                + ["what the gripper reports"] * grips
            )
            + ", in this order; no driver has these by itself: hardware that measures or estimates "
            "them exports them |\n"
            if reactions
            else ""
        )
        + (_GRIPPER_ROW if grips else ""),
        "PARAM_ROWS": "".join(_param_row(name, p) for name, p in task.live.items()),
        "WRENCH_ROWS": ("" if weighs else _WEIGHT_ROW) + (_WORLD_ROW if zero is None else ""),
        "WRENCH_MEANING": _filled(
            "wrench_of_contact.md" if zero is None else "wrench_read.md", weight
        ),
        "EXAMPLE_PARAMETERS": "" if weighs else "    weight_in_reading: true\n",
        "SCENE_NOTES": "".join(f"\n{note}\n" for note in notes),
        "PRELUDE": kernel_c.INCLUDES + expressions_c.PRELUDE,
        "MODEL": expressions_c.expression_c(_model(robot), "model"),
    }


def _listed(names: Sequence[str]) -> str:
    """Names that go on with a list, with an `and` ahead of the last."""
    *others, last = names
    return "".join(f", {name}" for name in others) + f" and {last}"


def _param_row(name: str, param: LiveParam) -> str:
    """The row of the README about a param that may be set."""
    low, high = (in_si(x, param.dimension) for x in (param.low, param.high))
    goes = f"goes there at {in_si(param.rate, param.dimension)} per second" if param.rate else ""
    return (
        f"| `param.{name}` | `{param.value!r}` | of the task, {low} to {high}: may be set while it "
        f"runs, and {goes or 'jumps there'} |\n"
    )


def _commanded(program: Program) -> dict[str, str]:
    """What is said of the commands."""
    commanded, servo = CommandedQuantity.of(program), program.context.loaded.task.robot.servo
    torques, interface = commanded.name == "torque", interface_of(commanded.name)
    units = {
        "torque": "N m, of a slide N",
        "velocity": "rad/s, of a slide m/s",
        "position": "rad, of a slide m",
    }
    left = {
        "torque": "the efforts are those of gravity alone, or zero where the robot carries itself",
        "velocity": "the velocities are zero",
        "position": "the positions stay as they are",
    }
    beyond = (
        "What a real arm has beyond it (friction, a payload, flexible joints) is not in the "
        "torques."
    )
    numbers = ", ".join(f"{key} {text}" for key, text in servo.written)
    return {
        "COMMAND": commanded.name,
        "COMMANDS": "efforts" if torques else commanded.plural,
        "INTERFACE": interface,
        "HARDWARE": interface.upper(),
        "UNITS": units[commanded.name],
        "LEFT": left[commanded.name],
        "AT_END": commanded.at_end.removesuffix("."),
        "COMPENSATED": _COMPENSATED_ROW if torques else "",
        "BEYOND": beyond if torques else f"Its servo is that of the file, or near: {numbers}.",
        "CARRIED": "; the controller's\n`gravity_compensated` belongs to that" if torques else "",
        "CARRIES": (
            "    gravity_compensated: true  # the example's arm carries itself\n" if torques else ""
        ),
    }


def interface_of(commanded: str) -> str:
    """What ros2_control calls a quantity that is commanded."""
    return "effort" if commanded == "torque" else commanded


def _model(robot: RobotModel) -> ca.Function:
    """q (n,) -> axes of the tip (9,), gravity (n,), weight of the tool in these axes (6,)."""
    body, q = rigid_body(robot), ca.SX.sym("q", robot.n)
    terms = body.terms(q, ca.SX.zeros(robot.n))
    weight = SensorZero(robot, weighs=True).weight(terms.R)
    outputs = [ca.densify(ca.vec(terms.R)), ca.densify(terms.gravity), ca.densify(weight)]
    return ca.Function("model", [q], outputs, {"cse": True})


class _Example:
    """The arm at the task's start in its world, for mujoco_ros2_control.

    Attributes:
        scene: MJCF.
        urdf: with the ros2_control section, as xacro.
        meshes: files of meshes by their paths in the package.
        notes: what of the task's world the scene has not.
    """

    def __init__(self, program: Program, package: str, name: str) -> None:
        """The example of a program.

        Args:
            program: whose nominal world it is.
            package: the package's name.
            name: of the controller.
        """
        context = program.context
        task, robot = context.loaded.task, context.robot
        arm = SceneArm(robot, task.robot, context.start)
        spec = scene_spec(arm, task, drawn=True, whole=False)
        for sensor in list(spec.sensors):
            spec.delete(sensor)
        for body in spec.bodies:
            if not body.name.startswith(PREFIX) and body is not spec.worldbody:
                body.gravcomp = 1.0
        spec.body(robot.tip_body).add_site(name=_SENSOR)
        for kind in ("force", "torque"):
            spec.add_sensor(
                name=f"{_SENSOR}_{kind}",
                type=getattr(mujoco.mjtSensor, f"mjSENS_{kind.upper()}"),
                objtype=mujoco.mjtObj.mjOBJ_SITE,
                objname=_SENSOR,
            )
        if not task.robot.takes_torques:
            _serve(spec, task.robot, context.start_inertia, list(robot.joint_names))
        model = spec.compile()
        positions = model.qpos0.copy()
        positions[arm.places(model).positions] = robot.coupling.joints(context.start)
        spec.add_key(name="start", qpos=positions)
        model = spec.compile()
        self.scene = spec.to_xml()
        self.meshes: dict[str, bytes] = {}
        self._package = package
        described = robot_description(RunScene.still(model, robot.coupling), name, self._mesh_file)
        self.urdf = _controlled(described, package, robot, interface_of(task.robot.command))
        self.notes = _left_out(program)

    def _mesh_file(self, vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> str:
        path = f"urdf/meshes/{len(self.meshes)}.stl"
        self.meshes[path] = _stl(vertices, faces)
        return f"package://{self._package}/{path}"


def _stl(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> bytes:
    """A mesh as binary STL; readers take the normals from the order of the corners."""
    triangles = np.zeros(len(faces), dtype=_STL_TRIANGLE)
    triangles["corners"] = vertices[faces]
    return bytes(80) + np.uint32(len(faces)).tobytes() + triangles.tobytes()


def _serve(
    spec: mujoco.MjSpec, robot: Robot, inertia: NDArray[np.float64], joints: Sequence[str]
) -> None:
    """Gives the example's joints MuJoCo's own servos, with the gains of the file's at the start."""
    servo = robot.servo
    K, D = drive_gains(inertia, 2 * np.pi * servo.bandwidth, servo.damping, servo.stiffness)
    for i, name in enumerate(joints):
        drive, positions = spec.actuator(name), robot.command == "position"
        drive.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        drive.gainprm[0] = K[i, i] if positions else D[i, i]
        drive.biasprm[:3] = 0.0, -K[i, i] if positions else 0.0, -D[i, i]
        # What limits a motor's command limits its torque.
        drive.forcelimited, drive.forcerange = drive.ctrllimited, drive.ctrlrange
        drive.ctrllimited = mujoco.mjtLimited.mjLIMITED_FALSE


def _controlled(urdf: str, package: str, robot: RobotModel, interface: str) -> str:
    """A URDF with the section of ros2_control, as xacro."""
    xacro = "http://www.ros.org/wiki/xacro"
    ElementTree.register_namespace("xacro", xacro)
    root = ElementTree.fromstring(urdf)
    root.insert(0, ElementTree.Element(f"{{{xacro}}}arg", name="headless", default="false"))
    made = ElementTree.SubElement(root, "ros2_control", name="MujocoSystem", type="system")
    hardware = ElementTree.SubElement(made, "hardware")
    plugin = ElementTree.SubElement(hardware, "plugin")
    plugin.text = "mujoco_ros2_control/MujocoSystemInterface"
    for name, value in (
        ("mujoco_model", f"$(find {package})/mujoco/scene.xml"),
        ("initial_keyframe", "start"),
        ("headless", "$(arg headless)"),
    ):
        ElementTree.SubElement(hardware, "param", name=name).text = value
    for name in robot.joint_names:
        joint = ElementTree.SubElement(made, "joint", name=name)
        ElementTree.SubElement(joint, "command_interface", name=interface)
        for kind in ("position", "velocity", "effort"):
            ElementTree.SubElement(joint, "state_interface", name=kind)
    sensor = ElementTree.SubElement(made, "sensor", name=_SENSOR)
    ElementTree.SubElement(sensor, "param", name="mujoco_type").text = "fts"
    ElementTree.SubElement(sensor, "param", name="mujoco_sensor_name").text = _SENSOR
    for kind in ("force", "torque"):
        for axis in "xyz":
            ElementTree.SubElement(sensor, "state_interface", name=f"{kind}.{axis}")
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True)


def _left_out(program: Program) -> list[str]:
    """What of a task's world the example's scene has not, a paragraph each."""
    context = program.context
    task = context.loaded.task
    notes = [
        f"MuJoCo {mujoco.__version__} has written the scene; mujoco_ros2_control brings its own."
    ]
    if context.equations or context.bushings:
        named = ", ".join(f"`{name}`" for name in (*context.equations, *context.bushings))
        notes.append(
            f"The scene has not: the equations and bushings of the task ({named}), which "
            f"taskspec's plant adds to MuJoCo. Nothing exports their reactions here."
        )
    if context.moving_bases:
        named = ", ".join(f"`{name}`" for name in context.moving_bases)
        notes.append(f"In the scene stand still what moves by itself in the task: {named}.")
    if not task.robot.takes_torques:
        notes.append(
            "The joints of the scene have MuJoCo's own servos, with the stiffness and damping that "
            "the file's has at the start. They have no delay, no limits of acceleration and no "
            "rate of their own."
        )
    if task.shapes and context.robot.tool.flat:
        notes.append(
            "In the scene the tool touches with a few spheres, not with its whole surface."
        )
    if task.gripped:
        notes.append(_NO_GRIPPER)
    if task.robot.sensor != type(task.robot.sensor)():
        notes.append("The sensor of the scene has no bias, noise, low-pass or delay.")
    return notes
