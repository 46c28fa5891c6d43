"""Exported packages of ros2_control: built, and driven by what a run measures."""

from __future__ import annotations

import re
import shutil
import subprocess
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pinocchio as pin
import pytest
import yaml
from typer.testing import CliRunner

from controller_samples import SERVOS, TASKS, program, recorded
from taskspec.geometry.rotation import from_rpy
from taskspec_runner.cli.app import app
from taskspec_runner.ros2_control.package import RosPackage, package_of

HERE = Path(__file__).resolve().parent
STUBS = HERE / "stubs"
WARNED = ("-std=c++17", "-Wall", "-Wextra", "-Werror", f"-I{STUBS}")
#: Contact alone, as it is in the world; a sensor whose zero is learned; reactions of an equation;
#: a gripper, whose command is the last interface.
RUNS = {
    "wipe-table": ["wrench_in_world=b:true", "sensor=s:wrist"],
    "unknown-normal": [],
    "linkage-in-joints": ["wrench_in_world=b:true"],
    "grip": ["wrench_in_world=b:true"],
}
#: Packages of ROS that the CMakeLists.txt finds, with targets of their own or without.
PACKAGES = (
    *("controller_interface", "diagnostic_msgs", "hardware_interface"),
    *("pluginlib", "rcl_interfaces", "rclcpp", "rclcpp_lifecycle"),
)
OK, ERROR = 0.0, 1.0
NOTHING, UNREADABLE, UNWRITABLE = 0.0, 1.0, 2.0

pytestmark = pytest.mark.skipif(
    shutil.which("g++") is None or shutil.which("cmake") is None, reason="no g++ or cmake"
)


@cache
def package(name: str) -> RosPackage:
    return package_of(program(name))


def add_ros(folder: Path) -> None:
    """Writes what CMake finds of ROS: the declarations, and the functions of ament."""
    for name in PACKAGES:
        text = f"add_library({name}::{name} INTERFACE IMPORTED)\n"
        text += f'target_include_directories({name}::{name} INTERFACE "{STUBS}")\n'
        (folder / f"{name}Config.cmake").write_text(text)
    with (folder / "pluginlibConfig.cmake").open("a") as file:
        file.write(
            "function(pluginlib_export_plugin_description_file base file)\n"
            "  install(FILES ${file} DESTINATION share/${PROJECT_NAME})\nendfunction()\n"
        )
    (folder / "ament_cmakeConfig.cmake").write_text("function(ament_package)\nendfunction()\n")


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """The library of a task's package, built and installed as colcon would."""
    found: dict[str, Path] = {}
    ros = tmp_path_factory.mktemp("ros")
    add_ros(ros)

    def library(name: str) -> Path:
        if name not in found:
            folder = tmp_path_factory.mktemp("package")
            made = package(name)
            made.write(folder / "source")
            run = [
                ["cmake", "-S", "source", "-B", "build", f"-DCMAKE_PREFIX_PATH={ros}",
                 "-DCMAKE_BUILD_TYPE=None", "-DCMAKE_C_FLAGS=-Wall -Werror -Wno-unused-function",
                 "-DCMAKE_CXX_FLAGS=-Wall -Wextra -Werror"],
                ["cmake", "--build", "build"],
                ["cmake", "--install", "build", "--prefix", "installed"],
            ]  # fmt: skip
            for command in run:
                done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
                assert done.returncode == 0, done.stdout + done.stderr
            found[name] = folder / "installed" / "lib" / f"lib{made.name}.so"
        return found[name]

    return library


@pytest.fixture(scope="module")
def drive(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("drive") / "drive"
    command = ["g++", *WARNED, str(HERE / "drive.cpp"), "-o", str(path), "-ldl", "-rdynamic"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return path


@pytest.fixture(scope="module")
def driven(built, drive):
    """What a plugin answers to records (rows, 2 + values), what it says, and the exit code."""

    def answers(name: str, records: np.ndarray, *given: str, rate: str = "") -> tuple:
        wanted = rate or f"{1 / program(name).context.period:g}"
        done = subprocess.run(
            [drive, built(name), wanted, *given], input=records.tobytes(), capture_output=True
        )
        made = program(name).context
        commands = made.robot.n + bool(made.loaded.task.gripped)
        answered = np.frombuffer(done.stdout).reshape(-1, commands + 1)
        return answered, done.stderr.decode(), done.returncode

    return answers


@cache
def records(name: str) -> np.ndarray:
    """What a run of a task measures, as records of the driver."""
    samples, _, _ = recorded(name)
    made = program(name).context
    values = 2 * made.robot.n + 6 + len(made.loaded.task.reported)
    nanoseconds = np.rint(samples[:, -1] * 1e9) + 12_345_678_901
    return np.column_stack([np.full(len(samples), NOTHING), nanoseconds, samples[:, :values]])


@pytest.mark.parametrize("name", RUNS)
def test_efforts_are_the_torques_of_the_run_to_the_bit(name, driven) -> None:
    _, torques, ended = recorded(name)
    assert ended == "end"
    assert len(torques) > 500
    found, said, code = driven(name, records(name), *RUNS[name])
    assert code == 0, said
    assert set(found[:, 0]) == {OK}
    assert found[:-1, 1:].tobytes() == torques.tobytes()
    stages = re.findall(r"~/status: 0 .* state=running stage=(\S+)", said)
    assert set(stages) == {runner.name for runner in program(name).stages}
    assert re.search(r"~/status: 0 .* state=done stage=\S+ event=\S+ ticks=\d+ lost=0", said)
    assert "info: done in stage" in said
    assert "allocations: 0\n" in said


def test_a_gripper_has_interfaces_and_holds_on_after_a_deactivation(driven) -> None:
    _, commands, _ = recorded("grip")
    some = records("grip")[: len(commands) // 2]
    given = [*RUNS["grip"], "gripper=s:hand/force", "prefix=s:left_"]
    found, said, code = driven("grip", some, *given)
    assert code == 0, said
    names = re.findall(r"interface: (\S+)", said)
    assert names[:3] == ["left_joint1/effort", "left_joint2/effort", "left_hand/force"]
    assert names[-2:] == ["left_grip/force", "left_grip/slip"]
    assert found[-2, -1] == 10.0
    assert found[-1, -1] == 10.0
    readme = package("grip").files["README.md"].decode()
    assert "| command | `gripper/effort` | N" in readme
    assert "| state | `grip/force`, `grip/slip` | N, m" in readme
    assert "The scene has no gripper" in readme
    assert "| `gripper` |" not in package("ring").files["README.md"].decode()


def test_what_is_left_after_the_deactivation_carries_the_arm(driven) -> None:
    name = "unknown-normal"
    some = records(name)[:50]
    found, _, _ = driven(name, some)
    robot = program(name).context.robot
    gravity = pin.computeGeneralizedGravity(robot.pin, robot.pin.createData(), some[-1, 2:9])
    assert found[-1, 1:] == pytest.approx(gravity, abs=1e-9)
    without, _, _ = driven(name, some, "gravity_compensated=b:true")
    assert not without[-1, 1:].any()
    assert without[-2, 1:] == pytest.approx(found[-2, 1:] - gravity, abs=1e-9)


@pytest.mark.parametrize("column", [2, 12, -1])
def test_a_value_that_is_no_number_ends_the_task_and_the_efforts_stay_finite(
    column, driven
) -> None:
    some = records("linkage-in-joints")[:80].copy()
    some[40, column] = np.nan
    found, said, _ = driven("linkage-in-joints", some, *RUNS["linkage-in-joints"])
    assert "~/status: 2 a number of a sample is not finite: state=bad_sample" in said
    assert "error: bad_sample in stage swing" in said
    assert np.isfinite(found).all()
    assert set(found[:, 0]) == {OK}


def test_values_that_cannot_be_read_are_lost_samples(driven) -> None:
    name = "linkage-in-joints"
    some = records(name)[:120].copy()
    whole, _, _ = driven(name, np.delete(some, slice(30, 50), axis=0), *RUNS[name])
    some[30:50, 0] = UNREADABLE
    found, said, _ = driven(name, some, *RUNS[name])
    assert (found[30:50] == found[29]).all()
    assert found[50:].tobytes() == whole[30:].tobytes()
    assert "state=running stage=swing event= ticks=120 lost=20" in said
    some[30:51, 0] = UNREADABLE
    _, said, _ = driven(name, some, *RUNS[name], "lost_samples=i:15")
    assert "~/status: 2 too many samples in a row have been lost" in said
    assert "state=lost" in said


def test_efforts_that_cannot_be_written_are_an_error_after_a_while(driven) -> None:
    some = records("linkage-in-joints")[:60].copy()
    some[30:, 0] = UNWRITABLE
    found, _, _ = driven("linkage-in-joints", some, *RUNS["linkage-in-joints"])
    assert set(found[:50, 0]) == {OK}
    assert set(found[50:60, 0]) == {ERROR}


@pytest.mark.parametrize(
    ("given", "why"),
    [
        (["joints=S:a,b"], "error: joints has 2 names; the task has 3 joints"),
        (["sensor=s:"], "error: sensor has no name"),
        (["sensor_rpy=D:0,0"], "error: sensor_position and sensor_rpy have three numbers each"),
        (["reactions=S:a,b"], "error: reactions has one interface for each of these: bars"),
        (["lost_samples=i:-1"], "error: lost_samples is 0 or more"),
        (["lost_samples=d:1.5"], "error: a parameter has another type: parameter 'lost_samples'"),
        (["wrench_in_world=b:true", "weight_in_reading=b:true"], "error: a wrench in world axes"),
    ],
)
def test_parameters_that_do_not_fit_are_refused(given, why, driven) -> None:
    _, said, code = driven("linkage-in-joints", records("linkage-in-joints")[:1], *given)
    assert code == 3
    assert why in said


def test_another_rate_or_another_start_is_refused(driven) -> None:
    name = "linkage-in-joints"
    one = records(name)[:1].copy()
    _, said, code = driven(name, one, rate="500")
    assert code == 3
    assert "error: the task is controlled at 1000 Hz, and update_rate is 500" in said
    one[0, 3] += 0.2
    _, said, code = driven(name, one)
    assert code == 4
    assert "error: joint2/position is -1.37" in said
    assert driven(name, one, "start_tolerance=d:0")[2] == 0
    one[0, 3] = np.nan
    _, said, code = driven(name, one)
    assert code == 4
    assert "has no number yet" in said


def test_names_are_prefixed(driven) -> None:
    given = ["joints=S:a,b,c", "prefix=s:left_", "sensor=s:wrist", "reactions=S:bars/torque"]
    _, said, code = driven("linkage-in-joints", records("linkage-in-joints")[:1], *given)
    assert code == 0
    names = re.findall(r"interface: (\S+)", said)
    assert names[:3] == ["left_a/effort", "left_b/effort", "left_c/effort"]
    assert names[3:9] == [f"left_{j}/{k}" for k in ("position", "velocity") for j in "abc"]
    assert names[9:15] == [f"left_wrist/{k}.{a}" for k in ("force", "torque") for a in "xyz"]
    assert names[15:] == ["left_bars/torque"]


def test_a_sensor_that_sits_elsewhere_reads_the_same_contact(driven) -> None:
    """Readings in the axes of the tip, of a sensor that is turned, moved, and of the other sign."""
    name, place, rpy = "wipe-table", np.array([0.01, -0.02, -0.15]), [0.3, -0.5, 1.1]
    some, robot = records(name)[:4000].copy(), program(name).context.robot
    wrench = some[:, -6:]
    assert np.abs(wrench).max() > 1.0
    twin, turn = robot.twin(), from_rpy(rpy)
    weight = robot.tool_body.mass * np.array([0.0, 0.0, -9.81])
    for row in some:
        R = twin.tip(row[2:9]).rotation
        own = R.T @ weight
        force = R.T @ row[-6:-3] + own
        moment = R.T @ row[-3:] + np.cross(robot.tool_body.lever, own)
        row[-6:-3] = -turn.T @ force
        row[-3:] = -turn.T @ (moment - np.cross(place, force))
    position = ",".join(map(str, place))
    given = [f"sensor_position=D:{position}", f"sensor_rpy=D:{','.join(map(str, rpy))}"]
    found, said, code = driven(
        name, some, *given, "sensor_inverted=b:true", "weight_in_reading=b:true"
    )
    assert code == 0, said
    torques = recorded(name)[1][:4000]
    assert found[:-1, 1:] == pytest.approx(torques, abs=1e-6)


def test_the_example_in_mujoco_is_the_task(built, drive, tmp_path) -> None:
    """The scene as mujoco_ros2_control steps it: it turns the sign of MuJoCo's sensors."""
    name = "wipe-table"
    made, robot = package(name), program(name).context.robot
    made.write(tmp_path)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "mujoco" / "scene.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("start").id)
    for _ in range(500):
        mujoco.mj_step(model, data)
    assert data.qpos == pytest.approx(program(name).context.start, abs=1e-5)
    # The tool points down, and so does z of its tip.
    weight = 9.81 * robot.tool_body.mass
    assert -data.sensor("tool_sensor_force").data == pytest.approx([0, 0, weight], abs=1e-4)
    settings = yaml.safe_load(made.files["config/controllers.yaml"])["wipe_table"]
    kinds = {bool: "b", int: "i", float: "d", str: "s"}
    given = [
        f"{key}={kinds[type(value)]}:{str(value).lower() if value in (True, False) else value}"
        for key, value in settings["ros__parameters"].items()
        if key != "joints"
    ]
    command = [str(drive), str(built(name)), "1000", *given]
    with (
        (tmp_path / "said").open("wb") as said,
        subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=said
        ) as process,
    ):
        assert process.stdin is not None
        assert process.stdout is not None
        forces = []
        for tick in range(12_500):
            sensed = -data.sensordata
            record = np.concatenate([[NOTHING, tick * 1e6], data.qpos, data.qvel, sensed])
            process.stdin.write(record.tobytes())
            process.stdin.flush()
            answer = np.frombuffer(process.stdout.read(8 * (robot.n + 1)))
            assert answer[0] == OK
            data.ctrl[:] = answer[1:]
            mujoco.mj_step(model, data)
            forces.append(sensed[2])
        process.stdin.close()
    report = (tmp_path / "said").read_text()
    assert "state=done stage=retreat" in report
    # A push against the tool is along -z of the tip: 15 N of contact, less the weight.
    pressed = weight - np.array(forces[4000:8000])
    assert np.median(pressed) == pytest.approx(15.0, abs=0.3)


@pytest.mark.parametrize("command", SERVOS)
def test_commands_of_a_servo_are_those_of_the_run_to_the_bit(command, driven) -> None:
    """The interfaces are those of what is commanded; what is left at the end leaves it there."""
    commands_of = {"velocity": "velocities", "position": "positions"}
    _, commands, ended = recorded(command)
    found, said, code = driven(command, records(command), "sensor=s:wrist")
    assert (code, ended) == (0, "end"), said
    assert found[:-1, 1:].tobytes() == commands.tobytes()
    names = re.findall(r"interface: (\S+)", said)
    assert names[:2] == [f"joint1/{command}", f"joint2/{command}"]
    assert names[2:6] == [f"joint{i}/{k}" for k in ("position", "velocity") for i in (1, 2)]
    left = np.zeros(2) if command == "velocity" else commands[-1]
    assert (found[-1, 1:] == left).all()
    assert np.abs(commands[-1]).max() > 0
    files = package(command).files
    text = (files["README.md"] + files["config/controllers.yaml"]).decode()
    assert "gravity_compensated" not in text
    assert f"writes its {commands_of[command]} to {command} interfaces" in text


@pytest.mark.parametrize("command", SERVOS)
def test_the_example_of_a_servo_follows_commands(command, tmp_path) -> None:
    made, robot = package(command), program(command).context.robot
    made.write(tmp_path)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "mujoco" / "scene.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("start").id)
    begin, rate = data.qpos.copy(), np.array([0.2, -0.1])
    for _ in range(round(0.5 / model.opt.timestep)):
        data.ctrl[:] = rate if command == "velocity" else begin + 0.5 * rate
        mujoco.mj_step(model, data)
    assert data.qpos == pytest.approx(begin + 0.5 * rate, abs=0.01)
    assert model.actuator_forcerange[:, 1] == pytest.approx(robot.torque_limit)
    urdf = ElementTree.parse(tmp_path / f"urdf/touch_{command}.urdf.xacro").getroot()
    given = {each.get("name") for each in urdf.findall("ros2_control/joint/command_interface")}
    assert given == {command}


def test_params_are_set_while_the_task_runs(driven) -> None:
    """The moves of the recorded run, to the bit; those of its tick 0 after the activation."""
    _, torques, ended = recorded("live")
    moves = ["@0:param.push=4", "@0:param.sway=0.003", "@31:param.sway=0.007"]
    moves += ["@200:param.push=8", "@250:param.push=3"]
    some = records("live")
    found, said, code = driven("live", some, *moves, "@100:param.push=nan", "@100:param.push=9")
    assert (code, ended) == (0, "end"), said
    assert said.count("param.push: refused") == 2
    assert said.count(": taken") == 5
    assert "allocations: 0\n" in said
    assert found[:-1, 1:].tobytes() == torques.tobytes()
    # Given before, it is what the task begins with.
    begun, said, code = driven("live", some, "param.push=d:3", *moves[1:3])
    assert code == 0, said
    assert begun[:-1, 1:].tobytes() != torques.tobytes()
    _, said, code = driven("live", some[:1], "param.push=d:80")
    assert code == 3
    assert "parameter 'param.push' is out of its range" in said
    readme = package("live").files["README.md"].decode()
    assert "| `param.push` | `5.0` | of the task, 2 N to 8 N: may be set while it runs" in readme


@pytest.mark.parametrize("name", ["wipe-table", "unknown-normal", "linkage-in-joints", "ring"])
def test_the_files_of_a_package_agree(name, tmp_path) -> None:
    made, robot = package(name), program(name).context.robot
    made.write(tmp_path)
    short = name.replace("-", "_")
    assert made.name == f"taskspec_{short}"
    for path in ("package.xml", "plugin.xml", f"urdf/{short}.urdf.xacro"):
        ElementTree.parse(tmp_path / path)
    assert ElementTree.parse(tmp_path / "package.xml").findtext("name") == made.name
    plugin = ElementTree.parse(tmp_path / "plugin.xml").getroot()
    assert plugin.get("path") == made.name
    settings = yaml.safe_load((tmp_path / "config/controllers.yaml").read_text())
    kinds = settings["controller_manager"]["ros__parameters"]
    assert plugin.find("class").get("name") == kinds[short]["type"]
    assert kinds["update_rate"] * program(name).context.period == 1.0
    assert settings[short]["ros__parameters"]["joints"] == list(robot.joint_names)
    launch = (tmp_path / "launch/mujoco.launch.py").read_text()
    compile(launch, "launch", "exec")
    assert f"{short}.urdf.xacro" in launch
    readme = (tmp_path / "README.md").read_text()
    source = made.files["src/controller.cpp"].decode()
    declared = re.findall(r'auto_declare<[^(]*>\("(\w+)"', source)
    assert len(declared) == 12
    listed = re.findall(r"^\| `(\w+)` \| .* \| .* \|$", readme, re.M)
    needless = {
        "wrench_in_world": "_READS_SENSOR 1\n" in made.files[f"src/{short}.h"].decode(),
        "weight_in_reading": program(name).context.loaded.task.robot.sensor.at == "wrist",
        "reactions": not program(name).context.equations,
    }
    left_out = {parameter for parameter, out in needless.items() if out}
    assert set(declared) - left_out == set(listed) - set(robot.joint_names)


def test_the_description_of_the_example_is_the_arm(tmp_path) -> None:
    robot = program("wipe-table").context.robot
    made = package("wipe-table")
    made.write(tmp_path)
    text = (tmp_path / "urdf/wipe_table.urdf.xacro").read_text()
    urdf = pin.buildModelFromXML(text)
    assert list(urdf.names[1:]) == list(robot.joint_names)
    q = program("wipe-table").context.start
    found, wanted = (
        pin.computeGeneralizedGravity(model, model.createData(), q) for model in (urdf, robot.pin)
    )
    assert found == pytest.approx(wanted, abs=1e-6)
    root = ElementTree.fromstring(text)
    meshes = {m.get("filename") for m in root.iter("mesh")}
    assert meshes
    for mesh in meshes:
        path = tmp_path / mesh.removeprefix(f"package://{made.name}/")
        data = path.read_bytes()
        assert len(data) == 84 + 50 * int.from_bytes(data[80:84], "little")
    hardware = root.find("ros2_control/hardware")
    assert hardware.findtext("plugin") == "mujoco_ros2_control/MujocoSystemInterface"
    commands = [j.get("name") for j in root.findall("ros2_control/joint")]
    assert commands == list(robot.joint_names)


def test_the_command_line_writes_a_package(tmp_path) -> None:
    run, task = CliRunner(), str(TASKS / "linkage-in-joints.yaml")
    done = run.invoke(app, ["export", task, "--ros2-control", str(tmp_path / "package")])
    assert done.exit_code == 0, done.output
    assert "  colcon build --packages-select taskspec_linkage_in_joints\n" in done.output
    found = {str(p.relative_to(tmp_path / "package")) for p in tmp_path.rglob("*") if p.is_file()}
    assert found == set(package("linkage-in-joints").files)
    done = run.invoke(app, ["export", task, "--ros2-control", "a", "--c", "b"])
    assert done.exit_code == 2
    assert "name one of --c and --ros2-control" in done.output
    done = run.invoke(app, ["export", str(tmp_path), "--ros2-control", "a"])
    assert done.exit_code == 2
    assert "--ros2-control takes a task file" in done.output
