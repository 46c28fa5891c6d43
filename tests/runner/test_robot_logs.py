"""Logs in the forms in which robots, sensors and recorders write them.

The project's own run is written in each form, in its axes, signs and units, and has to be judged as
the run was; and the forms of public reports, over a press that is met for 87 % of its ticks.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from command_line import call
from mcap.writer import Writer as McapWriter
from mcap_ros2.writer import Writer as Ros2Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import Stores, get_typestore

from taskspec.compiler import compile_unchecked
from taskspec.geometry import rotation
from taskspec.spec import load_task, load_text
from taskspec_runner import read
from taskspec_runner.errors import InputError
from taskspec_runner.exit_codes import FAILED, MISSED
from taskspec_runner.export.messages import definition
from taskspec_runner.record.history import History
from taskspec_runner.recorded.assignment import Assigned
from taskspec_runner.recorded.column_map import WrenchAxes, read_columns, ready_maps
from taskspec_runner.recorded.recording import read_recording
from taskspec_runner.recorded.source import read_csv
from taskspec_runner.recorded.stamps import Stamps
from taskspec_runner.recorded.units import column_unit
from taskspec_runner.recorded.wrench import WrenchTurn
from taskspec_runner.runs import Run
from taskspec_runner.session import execute
from taskspec_runner.verdict.replay import Replay

ROOT = Path(__file__).resolve().parents[2]

# A press as public reports have it: 2000 samples, 2 ms apart, 10 N from 1.05 s to 3.05 s on.

PRESS = """\
taskspec: 1
name: press
robot: {model: ur5e, start: {xyz: [450 mm, 100 mm, 320 mm]}}
world: {table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 20 kN/m}}
frames: {task: {surface: table}}
frame: task
limits: {force: 40 N}
stages:
  approach:
    axes: {z: {velocity: -20 mm/s}}
    until: force.z < -2 N for 10 ms
    within: {time: 3 s}
  press: {axes: {z: {force: -10 N}}, time: 2 s}
  leave: {axes: {z: {velocity: 30 mm/s}}, time: 0.9 s}
expect: [press.force.z within -10 N +- 0.5 N for 70 %]
"""
TILTED = PRESS.replace("320 mm]", "180 mm]").replace("300 mm],", "300 mm], rpy: [0, 20 deg, 0],")
STAGES = (
    "stages: [{stage: approach, at: 0 s}, {stage: press, at: 1.05 s}, {stage: leave, at: 3.05 s}]\n"
)
FORCE = "signals: {force.z: {column: fz, unit: N, sign: -1}}\n"
TIME = "time: {column: time, unit: s}\n"
N = 2000
T = np.arange(N) * 2e-3


def reaction(seed: int = 0) -> np.ndarray:
    """(N,) what the table exerts on the tool: contact at 1 s, a ramp of 0.25 s, 10 N, off again."""
    noise = np.random.default_rng(seed).normal(0.0, 0.1, N)
    return np.asarray(np.interp(T, [1.0, 1.3, 3.05, 3.1], [0.0, 10.0, 10.0, 0.0]) + noise)


def lines(path: Path, header: str, *columns: Sequence[object], by: str = ",") -> Path:
    rows = [by.join(map(str, row)) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return path


def texts(values: np.ndarray, digits: int = 4) -> list[str]:
    return [f"{value:.{digits}f}" for value in values]


def commas(values: Sequence[str]) -> list[str]:
    """Numbers as they are written where a comma stands before the decimals."""
    return [value.replace(".", ",") for value in values]


def judged(folder: Path, columns: str, task: str = PRESS) -> Any:
    (folder / "press.yaml").write_text(task, encoding="utf-8")
    name = columns
    if ":" in columns:
        (folder / "map.yaml").write_text(columns, encoding="utf-8")
        name = str(folder / "map.yaml")
    return call("judge", folder / "press.yaml", folder / "log.csv", "--columns", name,
                "--out", folder / "out")  # fmt: skip


def share(folder: Path) -> float:
    """Ticks at which the press was met [%]."""
    found = read(folder / "out").summary["expectations"]
    assert len(found) == 1
    return float(found[0]["explanation"].split(" ")[0])


def forms() -> dict[str, tuple[Callable[[Path], object], str]]:
    """Each form of a log, by its name, and the map that reads it."""
    f, time = reaction(), texts(T, 3)
    epoch = 1_700_000_000
    nano = [epoch * 10**9 + 2_000_000 * i for i in range(N)]
    names = [f"O_F_ext_hat_K[{i}]" for i in range(6)]
    zeros = ["0"] * N

    def csv(header: str, *columns: Sequence[object], by: str = ",") -> Callable[[Path], object]:
        return lambda folder: lines(folder / "log.csv", header, *columns, by=by)

    fz = texts(f)
    clock = f"stages: [{{stage: approach, at: {1834.512} s}}, {{stage: press, at: 1835.562 s}}, "
    clock += "{stage: leave, at: 1837.562 s}]\n"
    ur = " ".join(["timestamp", *(f"actual_q_{i}" for i in range(6)),
                   *(f"actual_TCP_force_{i}" for i in range(6))])  # fmt: skip
    ur_columns = (texts(T + 1834.512, 3), *(zeros,) * 8, fz, *(zeros,) * 3)
    stamp = "time: {column: [header.stamp.sec, header.stamp.nanosec]}\n"
    seconds, rest = [n // 10**9 for n in nano], [n % 10**9 for n in nano]
    return {
        "RTDE, parted by spaces, stages as its clock counts": (
            csv(ur, *ur_columns, by=" "),
            "time: {column: timestamp, unit: s}\n" + clock
            + "signals: {force.z: {column: actual_TCP_force_2, unit: N, sign: -1}}",
        ),
        "ready map of RTDE, stages by guards": (csv(ur, *ur_columns, by=" "), "ur-rtde"),
        "columns of one width, parted by many spaces": (
            lambda folder: (folder / "log.csv").write_text(
                "   time        fz\n"
                + "".join(f"{t:>9}  {v:>9} \n" for t, v in zip(time, fz, strict=True))
            ),
            TIME + STAGES + FORCE,
        ),
        "tabs": (csv("time\tfz", time, fz, by="\t"), TIME + STAGES + FORCE),
        "semicolons": (
            csv("time;fz;note, or none", time, fz, zeros, by=";"), TIME + STAGES + FORCE,
        ),
        "semicolons, and commas before decimals": (
            csv("time;fz", commas(time), commas(fz), by=";"), TIME + STAGES + FORCE,
        ),
        "tabs and stated commas": (
            csv("time\tfz", commas(time), commas(fz), by="\t"),
            "decimal: comma\n" + TIME + STAGES + FORCE,
        ),
        "comment sign before the names": (csv("# time,fz", time, fz), TIME + STAGES + FORCE),
        "lines above the names": (
            csv("rig: B\nrate: 500\n\ntime,fz,q", time, fz, zeros), TIME + STAGES + FORCE,
        ),
        "named line of the names": (
            csv("a,b\n1,2\ntime,fz", time, fz), "header: 3\n" + TIME + STAGES + FORCE,
        ),
        "arrays of libfranka": (
            csv(f"time,{','.join(names)},q[0]", time, zeros, zeros, fz, *(zeros,) * 4),
            TIME + STAGES + FORCE.replace("fz", '"O_F_ext_hat_K[2]"'),
        ),
        "array with a unit behind the index": (
            csv("time [s],f[0] [N],f[1] [N],f[2] [N]", time, zeros, zeros, fz),
            STAGES + 'signals: {force.z: {column: "f[2]", sign: -1}}',
        ),
        "array with dots, brackets in the map": (
            csv("time,f.0,f.1,f.2", time, zeros, zeros, fz),
            TIME + STAGES + FORCE.replace("fz", '"f[2]"'),
        ),
        "duplicate columns that the map does not use": (
            csv("time,fz,q[0],q[0],q [rad],q [deg]", time, fz, *(zeros,) * 4),
            TIME + STAGES + FORCE,
        ),
        "nanoseconds of rostopic echo -p": (
            csv("%time,field.header.seq,field.wrench.force.z", nano, range(N), fz),
            'time: {column: "%time", unit: ns}\n' + STAGES
            + FORCE.replace("fz", "field.wrench.force.z"),
        ),
        "microseconds since 1970": (
            csv("time [µs],fz", [n // 1000 for n in nano], fz), STAGES + FORCE,
        ),
        "stamp in two columns": (
            csv("header.stamp.sec,header.stamp.nanosec,fz", seconds, rest, fz),
            stamp + STAGES + FORCE,
        ),
        "stamp in two columns that needs no map": (
            csv("header.stamp.sec,header.stamp.nanosec,fz", seconds, rest, fz), STAGES + FORCE,
        ),
        "counter of a sensor": (
            csv("sequence,fz", range(N), fz),
            "time: {column: sequence, unit: s, scale: 1/500}\n" + STAGES + FORCE,
        ),
        "pounds-force": (csv("time,fz", time, texts(f / 4.4482216152605, 6)),
                         TIME + STAGES + FORCE.replace("unit: N", "unit: lbf")),
        "counts": (csv("time,fz", time, [round(1e6 * v) for v in f]),
                   TIME + STAGES + FORCE.replace("unit: N", "unit: N, scale: 1e-6")),
        "bias of 20 N, as a number": (
            csv("time,fz", time, texts(f + 20)),
            TIME + STAGES + FORCE.replace("unit: N", "unit: N, offset: 20 N"),
        ),
        "bias of 20 N, by the first half second, stages by guards": (
            csv("time,fz", time, texts(f + 20)),
            TIME + FORCE.replace("unit: N", "unit: N, offset: first 0.5 s"),
        ),
        "bias in pounds-force, and counts": (
            csv("time,fz", time, [round(1000 * (v + 20) / 4.4482216152605) for v in f]),
            TIME + STAGES
            + FORCE.replace("unit: N", "unit: lbf, scale: 0.001, offset: 4.49618 lbf"),
        ),
        "a coarse clock, the last sample of each stamp": (
            csv("time,fz", texts(np.floor(T * 100 + 1e-9) / 100, 2), fz),
            TIME + STAGES + FORCE + "repeated: last\n",
        ),
        "a coarse clock, the mean of each stamp": (
            csv("time,fz", texts(np.floor(T * 100 + 1e-9) / 100, 2), fz),
            TIME + STAGES + FORCE + "repeated: mean\n",
        ),
        "sparse columns of PlotJuggler": (
            csv("__time,/fts/wrench/force/z,/joint_states/q1/position",
                texts(T + epoch, 6), [v if i % 2 == 0 else "" for i, v in enumerate(fz)],
                ["" if i % 2 == 0 else "0.1" for i in range(N)]),
            TIME.replace("time, unit", "__time, unit") + STAGES
            + FORCE.replace("fz", "/fts/wrench/force/z"),
        ),
    }  # fmt: skip


@pytest.mark.parametrize("form", [*forms()])
def test_press_is_met_for_the_same_share_in_every_form(tmp_path: Path, form: str) -> None:
    """10 N are reached after 1.3 s of the log: 1.75 s of 2 s, and noise."""
    write, columns = forms()[form]
    write(tmp_path)
    result = judged(tmp_path, columns)
    assert result.exit_code == 0, result.output
    assert share(tmp_path) == pytest.approx(87.9, abs=1.0)


TURNS = ("frame: base\n", "frame: {rpy: [0, -20 deg, 0]}\n", "column", "")


@pytest.mark.parametrize("said", TURNS)
def test_force_in_axes_of_the_base_on_a_tilted_panel(tmp_path: Path, said: str) -> None:
    """10 N along a normal that leans by 20 degrees: along it alone there are 10 N."""
    normal = np.array([np.sin(np.radians(20)), 0.0, np.cos(np.radians(20))])
    parts = [texts(reaction() * part) for part in normal]
    lines(tmp_path / "log.csv", "timestamp,Fx,Fy,Fz", texts(T, 3), *parts)
    each = ", frame: base" if said == "column" else ""
    signals = "".join(
        f"  force.{axis}: {{column: F{axis}, unit: N, sign: -1{each}}}\n" for axis in "xyz"
    )
    columns = f"time: {{column: timestamp, unit: s}}\n{STAGES}signals:\n{signals}"
    result = judged(tmp_path, columns + (said if said != "column" else ""), TILTED)
    assert result.exit_code == (0 if said else 1), result.output
    if said:
        assert share(tmp_path) == pytest.approx(87.9, abs=1.0)
        by_guards = judged(tmp_path, (columns + (said if said != "column" else "")).replace(
            STAGES, ""), TILTED)  # fmt: skip
        assert by_guards.exit_code == 0, by_guards.output


def test_a_part_that_other_axes_need_is_named(tmp_path: Path) -> None:
    lines(tmp_path / "log.csv", "time,fz", texts(T, 3), texts(reaction()))
    result = judged(tmp_path, TIME + STAGES + FORCE + "frame: base\n", TILTED)
    assert result.exit_code == 2
    assert "force.z in the frame of stage 'approach' needs force.x too" in result.stderr
    # On a level table its axes are those of the base.
    assert judged(tmp_path, TIME + STAGES + FORCE + "frame: base\n").exit_code == 0


def test_axes_of_the_flange_need_the_joints(tmp_path: Path) -> None:
    lines(tmp_path / "log.csv", "time,fz", texts(T, 3), texts(reaction()))
    result = judged(tmp_path, TIME + STAGES + FORCE + "frame: flange\n")
    assert result.exit_code == 2
    assert "joint.1.position, which was not recorded" in result.stderr
    assert "frame: {rpy: " in result.stderr


def test_rows_out_of_order_are_named_by_line_and_relative_times(tmp_path: Path) -> None:
    t = texts(T + 1_700_000_000, 6)
    t[600], t[602] = t[602], t[600]
    lines(tmp_path / "log.csv", "time,fz", t, texts(reaction()))
    result = judged(tmp_path, TIME + STAGES + FORCE)
    assert result.exit_code == 2
    assert "time does not rise in line 603: 1.202 s after 1.204 s" in result.stderr
    assert "1.7e+09" not in result.stderr


@pytest.mark.parametrize(
    ("header", "columns", "message"),
    [
        ("time,fz,fz", "", "it has more than one column 'fz'"),
        ("time,fz,x", "repeated: some\n", "'some'"),
        ("time,fz,x", "sign: -1\n", "a sign belongs to a column"),
        ("time,fz,x", FORCE.replace("unit: N", "unit: 4.448 N"), "unit: N, scale: 4.448"),
        ("time,fz,x", FORCE.replace("unit: N", "unit: counts"), "scale: 1e-6"),
        ("time,fz,x", FORCE.replace("unit: N", "unit: N, offset: 20"), "write offset: 20 N"),
        ("time,fz,x", FORCE.replace("unit: N", "unit: N, offset: 20 mm"), "its offset is a length"),
        ("time,fz,x", FORCE.replace("unit: N", "unit: N, offset: first"), "such as first 0.5 s"),
        ("time,fz,x", FORCE.replace("unit: N", "unit: N, scale: 0"), "leaves nothing"),
        ("time,fz,x", FORCE.replace("unit: N", "unit: N, repeated: last"), "at the top of the map"),
        ("time,fz,x", FORCE.replace("fz", "'f*'") + "gap: 1 s\n", None),
        ("time,fz,fx", FORCE.replace("fz", "'f*'"), "may be fz or fx; name one of them"),
        ("time,fz,x", "frame: wrist\n", "'wrist'"),
        ("time,fz,x", "include: ur\n", "there is no ready map 'ur'"),
        ("time,fz,x", "include: libfranka\n", "it has none of the columns of the map"),
        ("time,fz,x", "include: ati-netft\n", "it has none of the columns of the map"),
    ],
)
def test_what_is_wrong_is_said_with_its_remedy(
    tmp_path: Path, header: str, columns: str, message: str | None
) -> None:
    lines(tmp_path / "log.csv", header, texts(T, 3), texts(reaction()), ["0"] * N)
    whole = columns if "signals" in columns or "include" in columns else columns + FORCE
    whole += "" if "include: ati" in columns else TIME
    result = judged(tmp_path, whole + STAGES)
    if message is None:
        assert result.exit_code == 0, result.output
        return
    assert result.exit_code == 2, result.output
    assert message in " ".join(result.stderr.split())


def test_repeated_stamps_ask_for_a_choice(tmp_path: Path) -> None:
    t = texts(np.floor(T * 100 + 1e-9) / 100, 2)
    lines(tmp_path / "log.csv", "time,fz", t, texts(reaction()))
    result = judged(tmp_path, TIME + STAGES + FORCE)
    assert result.exit_code == 2
    assert "in line 3" in result.stderr
    assert "repeated: last, first or mean" in result.stderr


def test_a_gap_is_named_by_its_line(tmp_path: Path) -> None:
    keep = np.r_[0:700, 720:N]
    lines(tmp_path / "log.csv", "time,fz", texts(T[keep] + 5e8, 3), texts(reaction()[keep]))
    result = judged(tmp_path, TIME + STAGES + FORCE)
    assert result.exit_code == 2
    assert "from 1.398 s on, line 701" in result.stderr


# The mirror image.


@pytest.mark.parametrize(("stages", "code"), [(STAGES, MISSED), ("", FAILED)])
def test_a_forgotten_sign_is_suspected(tmp_path: Path, stages: str, code: int) -> None:
    lines(tmp_path / "log.csv", "time,fz", texts(T, 3), texts(reaction()))
    result = judged(tmp_path, TIME + stages + FORCE.replace(", sign: -1", ""))
    assert result.exit_code == code
    assert "The sign of the forces seems to be turned" in result.stdout
    assert "sign: -1" in result.stdout
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "The sign of the forces seems to be turned" in page


def test_a_press_that_is_too_weak_is_no_mirror_image(tmp_path: Path) -> None:
    lines(tmp_path / "log.csv", "time,fz", texts(T, 3), texts(0.8 * reaction()))
    result = judged(tmp_path, TIME + STAGES + FORCE)
    assert result.exit_code == 1
    assert "seems to be turned" not in result.stdout


# The page.


def test_page_says_what_was_recorded_and_nothing_of_the_file(tmp_path: Path) -> None:
    lines(tmp_path / "log.csv", "time,fz", texts(T, 3), texts(reaction()))
    assert judged(tmp_path, TIME + STAGES + FORCE).exit_code == 0
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "2000 samples at 500 Hz" in page
    assert "to 1 ms, linearly; gaps up to 10 ms are bridged" in page
    assert "Control rate" not in page
    assert "<dt>Robot</dt>" not in page
    head, _, task = page.partition("The task file")
    assert "ur5e" not in head
    foot = page[page.index("<footer") :]
    assert str(tmp_path) not in foot
    assert "error.rx" not in foot
    assert task


# The project's own run, as others would have recorded it.


WIPE = TILTED.replace("stiffness", "friction: 0.3, stiffness").replace(
    "press: {axes: {z: {force: -10 N}}, time: 2 s}",
    "press: {axes: {z: {force: -10 N}, y: {velocity: 20 mm/s}}, time: 1 s}",
).replace("180 mm]", "158 mm]") + "  # judged as the run was\n"  # fmt: skip
STAGED = "stage: stage\n"
JOINTS = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint",
          "wrist_2_joint", "wrist_3_joint")  # fmt: skip
WRENCH = (*(f"force.{a}" for a in "xyz"), *(f"torque.r{a}" for a in "xyz"))


@pytest.fixture(scope="module")
def wipe(tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = tmp_path_factory.mktemp("wipe")
    (folder / "press.yaml").write_text(WIPE, encoding="utf-8")
    return execute(load_task(folder / "press.yaml"), folder / "run", report=False)


class Recorded:
    """What sensors and controllers would have shown of a run.

    Attributes:
        clock: (n,) [s].
        base: (n, 6) wrench that the environment exerts, about the tip, axes of the robot's base.
        sensor: (n, 6) the same about the origin of the flange, in its axes.
        tip: (n, 3) its place in the base [m].
        q: (n, joints) [rad].
    """

    def __init__(self, run: Run) -> None:
        program = run.program
        context, self.history = program.context, run.history
        replay = Replay(
            context.robot, context.frames, program.stages, self.history, context.moving_bases
        )
        columns = self.history.columns
        rows = slice(0, len(self.history))
        frames = {stage.name: stage.plan.frame for stage in program.stages}
        assert len(set(map(id, frames.values()))) == 1
        tip_axes, axes = replay.axes(next(iter(frames.values())), rows)
        force, moment = (
            -np.einsum("kij,kj->ki", axes, np.array([columns[n] for n in names]).T)
            for names in (WRENCH[:3], WRENCH[3:])
        )
        lever = tip_axes @ np.array([0.0, 0.0, 0.1])
        at_flange = moment + np.cross(lever, force)
        turned = [np.einsum("kji,kj->ki", tip_axes, part) for part in (force, at_flange)]
        self.clock, self.base = columns["clock"], np.hstack([force, moment])
        self.sensor, self.tip = np.hstack(turned), replay.tip_pose()[0]
        joints = range(context.robot.pin.nv)
        self.q = np.array([columns[f"joint.{i + 1}.position"] for i in joints]).T
        self.stages = self.history.stages.tolist()


@pytest.fixture(scope="module")
def recorded(wipe: Run) -> Recorded:
    return Recorded(wipe)


def exact(values: np.ndarray) -> list[str]:
    return [repr(value) for value in values.tolist()]


def judged_as_the_run(run: Run, log: Path, columns: str, tolerance: float = 1e-9) -> History:
    """Judges a log, and holds verdict and forces against those of the run."""
    (log.parent / "map.yaml").write_text(columns, encoding="utf-8")
    task = run.folder.parent / "press.yaml"
    out = log.parent / "out"
    result = call("judge", task, log, "--columns", log.parent / "map.yaml", "--out", out)
    assert result.exit_code == run.exit_code == 0, result.output
    again = read(out)
    assert (again.history.stages == run.history.stages).all()
    for name in WRENCH:
        values = run.history.columns[name]
        np.testing.assert_allclose(again.history.columns[name], values, atol=tolerance)
        assert np.abs(values).max() > 100 * tolerance, name
    mine, theirs = again.summary["expectations"], run.summary["expectations"]
    assert len(mine) == len(theirs) == 1
    assert (mine[0]["passed"], mine[0]["explanation"]) == (True, theirs[0]["explanation"])
    return again.history


@pytest.mark.parametrize("turned", [True, False])
def test_own_run_as_rtde_would_have_recorded_it(
    wipe: Run, recorded: Recorded, tmp_path: Path, turned: bool
) -> None:
    """A controller whose base is turned against the robot's is found by the place of the tip."""
    half = np.array([-1.0, -1.0, 1.0]) if turned else np.ones(3)
    wrench = recorded.base * np.tile(half, 2)
    names = ["timestamp", *(f"actual_q_{i}" for i in range(6)),
             *(f"actual_TCP_pose_{i}" for i in range(3)),
             *(f"actual_TCP_force_{i}" for i in range(6)), "stage"]  # fmt: skip
    columns = [recorded.clock + 1834.5, *recorded.q.T, *(recorded.tip * half).T, *wrench.T]
    log = lines(
        tmp_path / "log.csv", " ".join(names), *map(exact, columns), recorded.stages, by=" "
    )
    history = judged_as_the_run(wipe, log, f"include: ur-rtde\n{STAGED}", 1e-8)
    np.testing.assert_allclose(history.columns["joint.1.position"], recorded.q[:, 0], atol=1e-9)
    assert read(tmp_path / "out").manifest["recorded"]["base_turned"] is turned


def test_tip_that_is_not_where_the_joints_have_it(
    wipe: Run, recorded: Recorded, tmp_path: Path
) -> None:
    names = ["timestamp", *(f"actual_q_{i}" for i in range(6)),
             "actual_TCP_pose_0", "actual_TCP_pose_1", "actual_TCP_force_2", "stage"]  # fmt: skip
    columns = [recorded.clock, *recorded.q.T, recorded.tip[:, 1], -recorded.tip[:, 0],
               recorded.base[:, 2]]  # fmt: skip
    log = lines(tmp_path / "log.csv", ",".join(names), *map(exact, columns), recorded.stages)
    (tmp_path / "map.yaml").write_text(f"include: ur-rtde\n{STAGED}")
    task = wipe.folder.parent / "press.yaml"
    result = call("judge", task, log, "--columns", tmp_path / "map.yaml", "--out", tmp_path / "o")
    assert result.exit_code == 2
    assert "is not where the recorded joint positions have it" in result.stderr


def test_own_run_as_libfranka_would_have_recorded_it(
    wipe: Run, recorded: Recorded, tmp_path: Path
) -> None:
    """Its wrench is the one that the robot exerts."""
    names = ["time", *(f"O_F_ext_hat_K[{i}]" for i in range(6)), "stage"]
    columns = [recorded.clock, *(-recorded.base).T]
    log = lines(tmp_path / "log.csv", ",".join(names), *map(exact, columns), recorded.stages)
    judged_as_the_run(wipe, log, f"include: libfranka\n{STAGED}")


def test_own_run_as_plotjuggler_would_have_exported_it(
    wipe: Run, recorded: Recorded, tmp_path: Path
) -> None:
    parts = [f"/ft/wrench/{kind}/{axis}" for kind in ("force", "torque") for axis in "xyz"]
    names = ["__time", *parts, *(f"/joint_states/{joint}/position" for joint in JOINTS), "stage"]
    columns = [recorded.clock + 1.7e9, *recorded.sensor.T, *recorded.q.T]
    log = lines(tmp_path / "log.csv", ",".join(names), *map(exact, columns), recorded.stages)
    # Seconds since 1970 have a resolution of 0.2 us, which is well within a hundredth of a tick.
    judged_as_the_run(wipe, log, f"include: plotjuggler\n{STAGED}")


def test_own_run_as_a_net_ft_would_have_recorded_it(
    wipe: Run, recorded: Recorded, tmp_path: Path
) -> None:
    """Counts of pounds, in axes that are known against the frame of the stages alone."""
    head = ("Start Time:,27.11.2026 17:00\nRDT Sample Rate:,1000\nForce Units:,lbf\n"
            "Counts per Unit Force:,1000000\nTorque Units:,lbf-in\n"
            "Counts per Unit Torque:,1000000\n")  # fmt: skip
    names = "Status (hex),RDT Sequence,F/T Sequence,Fx,Fy,Fz,Tx,Ty,Tz,Time,stage"
    in_stage = -np.array([wipe.history.columns[name] for name in WRENCH]).T
    R = rotation.from_rpy((np.pi, 0.0, np.pi / 4))
    turned = np.hstack([in_stage[:, :3] @ R, in_stage[:, 3:] @ R])
    scales = np.repeat([1 / 4.4482216152605, 1 / (4.4482216152605 * 0.0254)], 3)
    counts = np.round(turned * scales * 1e6).astype(int)
    n = range(len(counts))
    columns = [["0"] * len(n), [i + 1 for i in n], n, *counts.T, ["12:00"] * len(n)]
    log = lines(tmp_path / "log.csv", head + names, *columns, recorded.stages)
    frame = "frame: {rpy: [180 deg, 0, 45 deg]}\n"
    # Roll, then yaw about the fixed axis: the rotation that the columns were written with.
    np.testing.assert_allclose(R, rotation.from_rpy((np.pi, 0.0, np.pi / 4)))
    judged_as_the_run(wipe, log, f"include: ati-netft\n{STAGED}{frame}", 1e-5)


def wrench_message(row: np.ndarray, stamp: tuple[int, int]) -> dict[str, Any]:
    parts = {kind: dict(zip("xyz", row[at : at + 3].tolist(), strict=True))
             for kind, at in (("force", 0), ("torque", 3))}  # fmt: skip
    return {"header": {"stamp": {"sec": stamp[0], "nanosec": stamp[1]}, "frame_id": "ft_frame"},
            "wrench": parts}  # fmt: skip


def joint_message(q: np.ndarray, stamp: tuple[int, int]) -> dict[str, Any]:
    """In the order of the alphabet, as drivers publish them."""
    order = sorted(range(len(JOINTS)), key=lambda i: JOINTS[i])
    return {"header": {"stamp": {"sec": stamp[0], "nanosec": stamp[1]}, "frame_id": ""},
            "name": [JOINTS[i] for i in order], "position": [float(q[i]) for i in order],
            "velocity": [], "effort": []}  # fmt: skip


def stream(recorded: Recorded) -> list[tuple[int, list[tuple[str, str, dict[str, Any]]]]]:
    """Time [ns], and the messages at it: topic, type, content."""
    begin = 1_700_000_000 * 10**9
    found = []
    for t, wrench, q, stage in zip(
        recorded.clock, recorded.sensor, recorded.q, recorded.stages, strict=True
    ):
        now = begin + round(1e9 * t)
        stamp = now // 10**9, now % 10**9
        messages = [
            ("/ft/wrench", "geometry_msgs/msg/WrenchStamped", wrench_message(wrench, stamp)),
            ("/joint_states", "sensor_msgs/msg/JointState", joint_message(q, stamp)),
            ("/stage", "std_msgs/msg/String", {"data": stage}),
        ]
        found.append((now, messages))
    return found


def with_ros2_support(path: Path, recorded: Recorded) -> Path:
    log = path / "log.mcap"
    with log.open("wb") as file, Ros2Writer(file) as writer:
        known: dict[str, Any] = {}
        for now, messages in stream(recorded):
            for topic, kind, content in messages:
                if kind not in known:
                    known[kind] = writer.register_msgdef(kind, definition(kind))
                writer.write_message(topic, known[kind], content, log_time=now, publish_time=now)
    return log


def _object(store: Any, kind: str, content: Mapping[str, Any]) -> Any:
    """A message of rosbags from its fields."""
    made = {}
    for name, (_, what) in zip(content, store.fielddefs[kind][1], strict=True):
        value = content[name]
        if isinstance(value, Mapping):
            value = _object(store, what[1], value)
        elif isinstance(value, list) and name != "name":
            value = np.array(value, dtype=float)
        made[name] = value
    return store.types[kind](**made)


def with_rosbags(path: Path, recorded: Recorded) -> Path:
    store = get_typestore(Stores.ROS2_HUMBLE)
    with BagWriter(path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        known: dict[str, Any] = {}
        for now, messages in stream(recorded):
            for topic, kind, content in messages:
                if topic not in known:
                    known[topic] = writer.add_connection(topic, kind, typestore=store)
                data = store.serialize_cdr(_object(store, kind, content), kind)
                writer.write(known[topic], now, data)
    return next((path / "bag").glob("*.mcap"))


_IDL = {
    "builtin_interfaces/msg/Time": "int32 sec; uint32 nanosec;",
    "std_msgs/msg/Header": "builtin_interfaces::msg::Time stamp; string frame_id;",
    "geometry_msgs/msg/Vector3": "double x; double y; double z;",
    "geometry_msgs/msg/Wrench": "geometry_msgs::msg::Vector3 force; "
    "geometry_msgs::msg::Vector3 torque;",
    "geometry_msgs/msg/WrenchStamped": "std_msgs::msg::Header header; "
    "geometry_msgs::msg::Wrench wrench;",
    "sensor_msgs/msg/JointState": "std_msgs::msg::Header header; sequence<string> name; "
    "sequence<double> position; sequence<double> velocity; sequence<double> effort;",
    "std_msgs/msg/String": "string data;",
}  # fmt: skip


def idl(kind: str) -> str:
    """A definition with all that it is made of, as rosbag2 puts them into MCAP."""
    wanted, found = [kind], dict[str, None]()
    while wanted:
        name = wanted.pop()
        found[name] = None
        wanted += [each for each in _IDL if each.replace("/", "::") in _IDL[name]]
    parts = []
    for name in found:
        package, _, own = name.replace("/msg/", "/").partition("/")
        body = f"module {package} {{ module msg {{ struct {own} {{ {_IDL[name]} }}; }}; }};\n"
        parts.append(f"{80 * '='}\nIDL: {name}\n{body}")
    return "".join(parts)


def with_idl(path: Path, recorded: Recorded) -> Path:
    store, log = get_typestore(Stores.ROS2_HUMBLE), path / "log.mcap"
    with log.open("wb") as file:
        writer = McapWriter(file)
        writer.start("ros2")
        known: dict[str, int] = {}
        for now, messages in stream(recorded):
            for topic, kind, content in messages:
                if topic not in known:
                    schema = writer.register_schema(kind, "ros2idl", idl(kind).encode())
                    known[topic] = writer.register_channel(topic, "cdr", schema)
                data = bytes(store.serialize_cdr(_object(store, kind, content), kind))
                writer.add_message(known[topic], now, data, now)
        writer.finish()
    return log


def with_json(path: Path, recorded: Recorded) -> Path:
    log = path / "log.mcap"
    with log.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        known: dict[str, int] = {}
        for now, messages in stream(recorded):
            for topic, kind, content in messages:
                if topic not in known:
                    schema = writer.register_schema(kind, "jsonschema", b'{"type": "object"}')
                    known[topic] = writer.register_channel(topic, "json", schema)
                writer.add_message(known[topic], now, json.dumps(content).encode(), now)
        writer.finish()
    return log


@pytest.mark.parametrize("write", [with_ros2_support, with_rosbags, with_idl, with_json])
def test_own_run_as_ros2_bag_would_have_recorded_it(
    wipe: Run,
    recorded: Recorded,
    tmp_path: Path,
    write: Callable[[Path, Recorded], Path],
) -> None:
    """A sensor at the flange, its moments about the flange, joints in the order of the alphabet."""
    log = write(tmp_path, recorded)
    history = judged_as_the_run(wipe, log, "include: ros2\nstage: /stage.data\n")
    for i in range(6):
        values = history.columns[f"joint.{i + 1}.position"]
        np.testing.assert_allclose(values, recorded.q[:, i], atol=1e-12)
    by_header = "include: ros2\ntime: header.stamp\nstage: /stage.data\n"
    if write is not with_json:
        (tmp_path / "map.yaml").write_text(by_header)
        result = call("judge", wipe.folder.parent / "press.yaml", log,
                    "--columns", tmp_path / "map.yaml", "--out", tmp_path / "o")  # fmt: skip
        # The messages that name stages have no header.
        assert result.exit_code == 2
        assert "have no stamp of that name" in result.stderr


def test_messages_by_the_stamps_in_their_headers(
    wipe: Run, recorded: Recorded, tmp_path: Path
) -> None:
    """Messages that were logged late have the time of their stamps."""
    log = tmp_path / "log.mcap"
    late = np.random.default_rng(3).integers(0, 4_000_000, len(recorded.clock))
    with log.open("wb") as file, Ros2Writer(file) as writer:
        kind = "geometry_msgs/msg/WrenchStamped"
        schema = writer.register_msgdef(kind, definition(kind))
        for (now, messages), delay in zip(stream(recorded), np.sort(late).tolist(), strict=True):
            writer.write_message("/ft/wrench", schema, messages[0][2], log_time=now + delay)
    columns = read_columns(None)
    assert columns.map.time is None
    (tmp_path / "map.yaml").write_text(
        "include: ros2\nframe: {rpy: [180 deg, 0, 0]}\ntime: header.stamp\n"
        f"stages: [{{stage: approach, at: 0 s}}, {{stage: press, at: {wipe.visits[1].start} s}}]\n"
    )
    result = call("judge", wipe.folder.parent / "press.yaml", log,
                  "--columns", tmp_path / "map.yaml", "--out", tmp_path / "out")  # fmt: skip
    # The stages of the map end before the last one of the task.
    assert result.exit_code == FAILED, result.output
    again = read(tmp_path / "out").history
    sensor = recorded.sensor[: len(again)]
    assert len(again) == len(recorded.clock)
    np.testing.assert_allclose(again.columns["force.x"], -sensor[:, 0], atol=1e-9)
    np.testing.assert_allclose(again.columns["force.z"], sensor[:, 2], atol=1e-9)


# Ready maps.


def test_ready_maps_say_their_source_and_what_they_assume() -> None:
    result = call("judge", "--columns", "list")
    assert result.exit_code == 0
    names = [*ready_maps()]
    assert names == ["ati-netft", "libfranka", "plotjuggler", "ros2", "ur-rtde"]
    guide = (ROOT / "docs" / "how-to" / "judging.md").read_text(encoding="utf-8")
    for name in names:
        found = read_columns(Path(name)).map
        assert found.about
        assert found.source
        assert "sign" in found.assumes
        assert "frame" in found.assumes
        assert found.frame is not None
        assert found.optional
        assert name in result.stdout
        assert f"`{name}`" in guide
        assert set(WRENCH) <= set(found.signals)


def test_a_name_that_is_no_ready_map(tmp_path: Path) -> None:
    lines(tmp_path / "log.csv", "time,fz", texts(T, 3), texts(reaction()))
    result = judged(tmp_path, "ur-rtd")
    assert result.exit_code == 2
    assert "neither a file nor a ready one; did you mean 'ur-rtde'?" in result.stderr
    assert call("judge").exit_code == 2


def test_half_turn_of_the_base_is_that_of_universal_robots() -> None:
    """The built-in ur5e stretches along +x at zero, the controller's base has it along -x."""
    program = compile_unchecked(load_task_text())
    robot = program.context.robot
    data = robot.pin.createData()
    pin.forwardKinematics(robot.pin, data, np.zeros(6))
    tip = (data.oMi[robot.tip_joint] * robot.tip).translation
    # a2 + a3 and d4 + d6 of Universal Robots' table for the UR5e, and 100 mm of tool.
    np.testing.assert_allclose(tip[:2], [0.425 + 0.3922, 0.1333 + 0.0997 + 0.1], atol=2e-3)


def load_task_text() -> Any:
    from taskspec.spec import load_text

    return load_text(PRESS, "press.yaml")


@pytest.mark.parametrize(
    ("text", "scale"),
    [("ns", 1e-9), ("µs", 1e-6), ("lbf", 4.4482216152605), ("Lbf-in", 0.1129848290276167),
     ("N-m", 1.0), ("N·m", 1.0), ("Nmm", 1e-3), ("°/s", np.pi / 180), ("kgf", 9.80665),
     ("in/s", 0.0254)],
)  # fmt: skip
def test_units_of_columns(text: str, scale: float) -> None:
    assert column_unit(text).scale == pytest.approx(scale, rel=1e-12)


@pytest.mark.parametrize("text", ["", "lb", "counts", "/lbf", "N N", "lbf*", "foo*N"])
def test_what_is_no_unit_of_a_column(text: str) -> None:
    with pytest.raises(ValueError, match="is not a unit"):
        column_unit(text)


@pytest.mark.parametrize("name", ["crank", "unknown-normal", "vibrating-table"])
def test_wrench_in_axes_of_the_base_in_frames_that_move_or_are_measured(
    tmp_path: Path, name: str
) -> None:
    """What was measured in axes of the base comes back in those of each stage."""
    run = execute(load_task(ROOT / "tasks" / f"{name}.yaml"), tmp_path / "run", report=False)
    program, columns, log = run.program, dict(run.history.columns), tmp_path / "log.csv"
    context = program.context
    replay = Replay(
        context.robot, context.frames, program.stages, run.history, context.moving_bases
    )
    frames = {stage.name: stage.plan.frame for stage in program.stages}
    base = rotation.from_rpy(context.loaded.task.robot.base.rpy)
    names = [each for each in WRENCH if f"{each}.measured" in columns]
    assert names
    for visit in run.history.visits():
        rows = slice(visit.first, visit.last + 1)
        axes = base.T @ replay.axes(frames[visit.stage], rows)[1]
        for part in (WRENCH[:3], WRENCH[3:]):
            kept = [each for each in part if f"{each}.measured" in columns]
            vector = np.zeros((rows.stop - rows.start, 3))
            for each in kept:
                vector[:, part.index(each)] = run.history.columns[f"{each}.measured"][rows]
            turned = np.einsum("kij,kj->ki", axes, vector)
            for each in kept:
                key = f"{each}.measured"
                columns[key] = np.array(columns[key])
                columns[key][rows] = turned[:, part.index(each)]
    taken = {key: values for key, values in columns.items() if key not in (*WRENCH, "t")}
    header = ",".join(f"{key} [{run.history.units[key]}]" if run.history.units[key] else key
                      for key in taken)  # fmt: skip
    cells = [["" if v != v else repr(v) for v in values.tolist()] for values in taken.values()]
    lines(log, f"{header},stage", *cells, run.history.stages.tolist())
    (tmp_path / "map.yaml").write_text("frame: base\n")
    again = read_recording(program, log, read_columns(tmp_path / "map.yaml")).history
    for each in names:
        key = f"{each}.measured"
        np.testing.assert_allclose(again.columns[key], run.history.columns[key], atol=1e-9)
        np.testing.assert_array_equal(again.columns[each], again.columns[key])


@pytest.mark.parametrize(
    ("robot", "length"),
    [
        ("{model: planar3, start: {joints: [20 deg, 40 deg, 30 deg]}}", 0.0),
        ("{model: panda, start: {xyz: [500 mm, 0, 400 mm]}}", 0.1),
        ("{model: panda, tool: {length: 150 mm}, start: {xyz: [500 mm, 0, 400 mm]}}", 0.15),
    ],
)
def test_moments_of_a_sensor_move_by_the_length_of_the_tool(robot: str, length: float) -> None:
    """Also by that which the file leaves out: the tool of a planar arm ends where its link does."""
    text = f"taskspec: 1\nrobot: {robot}\nstages: {{rest: {{axes: {{x: hold}}, time: 1 s}}}}\n"
    program = compile_unchecked(load_text(text, "task.yaml"))
    stamps = Stamps(np.array([0.0, 1.0]), str, "log")
    names = ["force.x", "force.y", "force.z", "torque.rx", "torque.ry", "torque.rz"]
    axes = WrenchAxes(of="flange")
    signals = [Assigned(name, name, "", 1, 1.0, axes, 0.0, stamps, np.zeros(2)) for name in names]
    turn = WrenchTurn(program, signals, names, lambda _: None)
    assert [turn._lever(group).tolist() for group in turn._groups] == [[0, 0, 0], [0, 0, length]]


def test_a_comma_that_may_part_thousands_is_not_guessed(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("time;fz\n1,000;2,500\n2,000;3,750\n", encoding="utf-8")
    source = read_csv(tmp_path / "log.csv", decimal="comma")
    assert source.numbers(["fz"])["fz"].tolist() == [2.5, 3.75]
    with pytest.raises(InputError, match=r"'1,000' may be 1\.000 or 1000; say which .* decimal: "):
        read_csv(tmp_path / "log.csv")
    (tmp_path / "log.csv").write_text("time;fz\n1,000;0,500\n2,000;3,750\n", encoding="utf-8")
    assert read_csv(tmp_path / "log.csv").numbers(["fz"])["fz"].tolist() == [0.5, 3.75]


def test_groups_of_signals_at_the_top_of_a_map(tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text("force: {columns: [Fx, Fy, Fz], unit: N}\n")
    with pytest.raises(InputError, match=r"stand one by one under 'signals': force\.z: "):
        read_columns(tmp_path / "map.yaml")
