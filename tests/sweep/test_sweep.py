"""Sweeps as a whole: the same table whoever runs them, and however often they are broken off."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from typer.testing import CliRunner

from taskspec.compiler import compile_task
from taskspec.spec import load_task, load_text
from taskspec_runner.cli.app import app
from taskspec_runner.errors import InputError, OutputError
from taskspec_runner.record.lock import FolderLock
from taskspec_runner.record.manifest import seal
from taskspec_runner.record.names import JOURNAL, LOG, SWEEP, TABLE, TASK
from taskspec_runner.runs import Run
from taskspec_runner.session import execute
from taskspec_runner.sweep.bundle import Bundle, program_of
from taskspec_runner.sweep.engine import Work, run_work
from taskspec_runner.sweep.executors import Workers
from taskspec_runner.sweep.folder import PAGE, SweepFolder
from taskspec_runner.sweep.progress import describe
from taskspec_runner.sweep.session import sweep
from taskspec_runner.sweep.table import read_table
from taskspec_runner.sweep.world_run import run_world
from taskspec_runner.sweep.worlds import Worlds

TAP = """taskspec: 1
name: tap
robot: {model: planar3, start: {xyz: [500 mm, 300 mm, 0]}}
world: {wall: {shape: plane, xyz: [520 mm, 0, 0], rpy: [0, -90 deg, 0]}}
frame: wall
stages:
  touch: {axes: {z: {velocity: -40 mm/s}}, until: force.z < -2 N, within: 0.6 s}
  press: {axes: {z: {force: -10 N}}, time: 0.1 s}
vary: {world.wall.stiffness: 1..100 kN/m, world.wall.xyz: [normal(1 mm), 0, 0]}
expect: [max(norm(force)) < 12 N, last(press.force.z) within -10 N +- 3 N]
sweep: {worlds: 6, expect: success >= 50 %}
"""
CLI = CliRunner()


@pytest.fixture
def tap(tmp_path: Path) -> Path:
    path = tmp_path / "tap.yaml"
    path.write_text(TAP, encoding="utf-8")
    return path


def ran(*arguments: object):
    result = CLI.invoke(app, [str(a) for a in arguments])
    assert result.exit_code in (0, 1), result.output
    return result


def test_the_table_is_the_same_whoever_runs_it(tap, tmp_path):
    """Here, in processes, in shares that are merged, and on a local cluster of Dask."""
    pytest.importorskip("distributed")
    ways = {
        "here": ["-j", 1],
        "processes": ["-j", 2],
        "dask": ["-j", 1, "--executor", "dask"],
    }
    for name, options in ways.items():
        ran("sweep", tap, "--out", tmp_path / name, "--keep", "none", "-q", *options)
    for number in (1, 2, 3):
        share = ["--shard", f"{number}/3", "-j", 1, "-q"]
        ran("sweep", tap, "--out", tmp_path / f"part{number}", *share)
    parts = [tmp_path / f"part{number}" for number in (3, 1, 2)]
    ran("sweep", "--merge", *parts, "--out", tmp_path / "merged", "-q")
    tables = {name: (tmp_path / name / TABLE).read_bytes() for name in (*ways, "merged")}
    assert len(set(tables.values())) == 1
    assert read_table(tmp_path / "here" / TABLE).num_rows == 6


def test_a_share_that_is_missing_is_said(tap, tmp_path):
    ran("sweep", tap, "--out", tmp_path / "part", "--shard", "1/2", "-j", 1, "-q")
    result = CLI.invoke(
        app, ["sweep", "--merge", str(tmp_path / "part"), "--out", str(tmp_path / "all")]
    )
    assert result.exit_code == 2
    assert "3 of 6 worlds are in none of the shares: 1, 3, 5" in result.output


def test_any_executor_will_do(tap, tmp_path):
    program = compile_task(load_task(tap))
    worlds = Worlds.of(program.context, 0, 4)
    one = sweep(program, worlds, tmp_path / "one", keep="none")
    with ThreadPoolExecutor(1) as pool:
        two = sweep(program, worlds, tmp_path / "two", workers=Workers(pool, 1), keep="none")
    assert one.rows == two.rows


def test_a_world_is_that_of_a_run(tap, tmp_path):
    """By its number under the seed and by its row: the same verdict, peaks and duration."""
    ran("sweep", tap, "--out", tmp_path / "s", "-j", 1, "--seed", 3, "--worlds", 3, "--keep", "1")
    row = read_table(tmp_path / "s" / TABLE).to_pylist()[1]
    by_number = execute(load_task(tap), tmp_path / "n", seed=3, world=1, report=False)
    result = ran("run", tap, "--world", f"{tmp_path / 's' / TABLE}:1", "--out", tmp_path / "t")
    assert result.exit_code == by_number.exit_code
    kept = Run.load(tmp_path / "s" / "worlds" / "000001")
    for run in (by_number, Run.load(tmp_path / "t"), kept):
        assert (run.verdict == "passed") == row["success"]
        assert run.summary["duration"] == row["duration"]
        assert run.summary["world"]["number"] == 1
        told = {each["path"]: each["true"] for each in run.summary["world"]["differs"]}
        assert told["world.wall.stiffness"] == row["world.wall.stiffness"]
        assert max(peak["force"] for peak in run.summary["peaks"].values()) == row["peak force"]
    # The world is part of what the log is of.
    assert kept.damage == ""


def test_the_same_command_continues(tap, tmp_path):
    out = tmp_path / "s"
    ran("sweep", tap, "--out", out, "-j", 1, "--keep", "none", "-q")
    whole = (out / TABLE).read_bytes()
    journal = out / JOURNAL
    lines = journal.read_bytes().splitlines(keepends=True)
    # Killed in the middle of the fourth row.
    journal.write_bytes(b"".join(lines[:3]) + lines[3][:40])
    (out / TABLE).unlink()
    result = ran("sweep", tap, "--out", out, "-j", 1, "--keep", "none")
    assert "3 worlds were there already" in result.output
    assert (out / TABLE).read_bytes() == whole
    # Another sweep does not take its place.
    result = CLI.invoke(app, ["sweep", str(tap), "--out", str(out), "--seed", "1"])
    assert result.exit_code == 2
    assert "it holds the sweep of other worlds, which is not thrown away" in result.output


def test_what_is_broken_off_says_how_far_it_came(tap, tmp_path):
    program = compile_task(load_task(tap))
    worlds = Worlds.of(program.context, 0, 4)

    def watch(glimpse):
        if glimpse.done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt, match=r"^interrupted: 2 of 4 worlds are in .*/s; the"):
        sweep(program, worlds, tmp_path / "s", keep="none", watch=watch)
    glimpses = []
    sweep(program, worlds, tmp_path / "s", keep="none", watch=glimpses.append)
    assert [each.done for each in glimpses] == [2, 3, 4]
    assert "more are running" in describe(glimpses[0])


def test_a_sweep_has_one_writer(tap, tmp_path):
    """A second one into its folder ends at once and names the first; so do its page and a merge."""
    out = tmp_path / "s"
    ran("sweep", tap, "--out", out, "-j", 1, "--keep", "none", "-q")
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    lock = FolderLock(out)
    said = f"process {os.getpid()} on {socket.gethostname()} since "
    for command in (
        ["sweep", str(tap), "--out", str(out), "-j", "1"],
        ["sweep", "--merge", str(out), "--out", str(out)],
        ["report", str(out)],
    ):
        result = CLI.invoke(app, command)
        assert result.exit_code == 2
        assert said in result.output
    lock.close()
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


@pytest.mark.parametrize("content", [{"sweep.json": "{}"}, {"notes.txt": "x"}, {LOG: "x"}])
def test_a_folder_of_something_else_is_left_alone(content, tap, tmp_path):
    out = tmp_path / "s"
    out.mkdir()
    for name, text in content.items():
        (out / name).write_text(text)
    result = CLI.invoke(app, ["sweep", str(tap), "--out", str(out), "-j", "1"])
    assert result.exit_code == 2
    assert "the folder is not empty and holds no sweep" in result.output
    assert {path.name: path.read_text() for path in out.iterdir()} == content


def test_rows_are_not_written_through_links(tap, tmp_path):
    out, other = tmp_path / "s", tmp_path / "precious"
    ran("sweep", tap, "--out", out, "-j", 1, "--keep", "none", "-q")
    other.write_bytes(b"")
    (out / JOURNAL).unlink()
    (out / JOURNAL).symlink_to(other)
    result = CLI.invoke(app, ["sweep", str(tap), "--out", str(out), "-j", "1"])
    assert result.exit_code == 2
    assert f"cannot write {out / JOURNAL}: " in result.output
    assert other.read_bytes() == b""


def test_a_row_that_the_disk_takes_a_part_of_ends_the_sweep_and_is_cut_off(tap, tmp_path):
    program = compile_task(load_task(tap))
    worlds = Worlds.of(program.context, 0, 3)
    whole = sweep(program, worlds, tmp_path / "whole", keep="none")

    class Full:
        """A file on a disk that is full after so many bytes."""

        def __init__(self, folder, room):
            self.file, self.room = (folder / JOURNAL).open("ab", buffering=0), room

        def write(self, data):
            self.room -= len(data)
            return self.file.write(data if self.room > 0 else data[: len(data) // 2])

        def close(self):
            self.file.close()

    usual = SweepFolder.begin
    out = tmp_path / "s"

    def begin(folder, content):
        usual(folder, content)
        folder._journal.close()
        folder._journal = Full(folder.path, 1500)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(SweepFolder, "begin", begin)
        with pytest.raises(OutputError, match=r"worlds\.jsonl: No space left on device"):
            sweep(program, worlds, out, keep="none")
    again = sweep(program, worlds, out, keep="none")
    assert again.rows == whole.rows
    assert 0 < again.continued < 3
    assert (out / JOURNAL).read_bytes() == (tmp_path / "whole" / JOURNAL).read_bytes()


def test_the_page_is_rendered_again_from_rows_that_are_as_they_were(tap, tmp_path):
    out = tmp_path / "s"
    ran("sweep", tap, "--out", out, "-j", 1, "--keep", "none", "-q")
    page, lines = (out / PAGE).read_bytes(), (out / JOURNAL).read_bytes().splitlines(True)
    (out / PAGE).unlink()
    assert ran("report", out).exit_code == 0
    assert (out / PAGE).read_bytes() == page

    def told(name, content):
        usual = (out / name).read_bytes()
        (out / name).write_bytes(content)
        result = CLI.invoke(app, ["report", str(out)])
        (out / name).write_bytes(usual)
        return result.exit_code, result.output

    # The table is not what the page is made of; it is told that it was altered.
    code, said = told(TABLE, b"PAR1")
    assert (code, f"{TABLE} was altered" in said) == (1, True)
    assert (out / PAGE).read_bytes() == page
    for name, old, new, why in (
        (JOURNAL, b'"world": 0', b'"world": 9', "has 0 of 6 worlds: worlds.jsonl was"),
        (SWEEP, b'"good": ', b'"good": 1', "it was altered"),
        (TASK, b"50 %", b"10 %", "it is not what was swept"),
    ):
        content = (out / name).read_bytes()
        assert old in content
        code, said = told(name, content.replace(old, new, 1))
        assert (code, why in said) == (2, True), said
    # A verdict that is written into it is not taken over: it follows from the rows.
    sweep_json = json.loads((out / SWEEP).read_text())
    forged = {**sweep_json, "exit_code": 7, "judged": []}
    forged["seal"] = seal(forged)
    (out / SWEEP).write_text(json.dumps(forged))
    assert ran("report", out).exit_code == 0
    assert (out / PAGE).read_bytes() == page
    (out / JOURNAL).write_bytes(b"".join(lines[:4]))
    result = CLI.invoke(app, ["report", str(out)])
    assert result.exit_code == 2
    assert "has 4 of 6 worlds; the command that it was made with goes on" in result.output


def test_what_a_task_includes_is_what_was_swept(tap, tmp_path):
    world = TAP.splitlines(keepends=True)[3]
    assert world.startswith("world:")
    (tmp_path / "cell.yaml").write_text(f"taskspec: 1\n{world}", encoding="utf-8")
    tap.write_text(TAP.replace(world, "include: cell.yaml\n"), encoding="utf-8")
    out = tmp_path / "s"
    ran("sweep", tap, "--out", out, "-j", 1, "--keep", "none", "-q")
    page = (out / PAGE).read_bytes()
    assert ran("report", out).exit_code == 0
    assert (out / PAGE).read_bytes() == page
    (tmp_path / "cell.yaml").write_text(f"# mine\ntaskspec: 1\n{world}", encoding="utf-8")
    result = CLI.invoke(app, ["report", str(out)])
    assert result.exit_code == 2
    assert "cell.yaml is no longer what was swept" in result.output


def test_shares_that_were_altered_are_not_merged(tap, tmp_path):
    for number in (1, 2):
        share = ["--shard", f"{number}/2", "-j", 1, "-q"]
        ran("sweep", tap, "--out", tmp_path / f"part{number}", *share)
    parts = [str(tmp_path / f"part{number}") for number in (1, 2)]
    result = CLI.invoke(app, ["report", parts[0]])
    assert result.exit_code == 2
    assert "holds share 1 of 2 of a sweep; taskspec sweep --merge" in result.output
    for name, old, new, why in (
        (SWEEP, '"count": 6', '"count": 3', "it was altered"),
        (SWEEP, '"format": 1', '"format": 9', "a newer taskspec made it (format 9"),
        (TASK, "50 %", "10 %", "it is not what was swept"),
    ):
        path = tmp_path / "part1" / name
        usual = path.read_text()
        assert old in usual
        path.write_text(usual.replace(old, new))
        result = CLI.invoke(app, ["sweep", "--merge", *parts, "--out", str(tmp_path / "all")])
        path.write_text(usual)
        assert (result.exit_code, why in result.output) == (2, True), result.output
    assert not (tmp_path / "all").exists()


def test_killed_workers_and_killed_sweeps_lose_nothing(tap, tmp_path):
    """A worker is killed, then the whole sweep; the same command ends with the same table."""
    ran("sweep", tap, "--out", tmp_path / "whole", "-j", 1, "--worlds", 8, "--keep", "none", "-q")
    out = tmp_path / "killed"
    command = [sys.executable, "-m", "taskspec_runner", "sweep", str(tap), "--out", str(out)]
    command += ["-j", "2", "--worlds", "8", "--keep", "none", "-q"]
    sweeping = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    workers = _until(lambda: _children(sweeping.pid), sweeping)
    os.kill(workers[0], signal.SIGKILL)
    _until(lambda: (out / JOURNAL).is_file() and (out / JOURNAL).stat().st_size > 0, sweeping)
    sweeping.kill()
    sweeping.wait(60)
    assert subprocess.run(command, check=False, stdout=subprocess.DEVNULL).returncode in (0, 1)
    assert (out / TABLE).read_bytes() == (tmp_path / "whole" / TABLE).read_bytes()


SCRIPT = """import sys
from pathlib import Path
from taskspec.compiler import compile_task
from taskspec.spec import load_task
from taskspec_runner.errors import InputError
from taskspec_runner.sweep.engine import Work, run_work
from taskspec_runner.sweep.executors import Workers
from taskspec_runner.sweep.session import sweep
from taskspec_runner.sweep.worlds import Worlds

program = compile_task(load_task(Path(sys.argv[1])))
worlds = Worlds.of(program.context, 0, 4)
try:
    sweep(program, worlds, Path("s"), workers=Workers(None, 2), keep="none")
except InputError as error:
    print("refused:", error)
"""


def test_a_script_that_every_process_would_run_is_told_so(tap, tmp_path):
    """Its processes import it: without a guard each would sweep, and none comes to its work."""
    (tmp_path / "script.py").write_text(SCRIPT, encoding="utf-8")
    command = [sys.executable, "script.py", str(tap)]
    ran = subprocess.run(command, capture_output=True, text=True, check=True, cwd=tmp_path)
    assert ran.stdout.count("refused: no process of this sweep could begin") == 1
    assert 'if __name__ == "__main__":' in ran.stdout
    assert ran.stderr == ""
    assert (tmp_path / "s" / JOURNAL).read_bytes() == b""


def _children(pid: int) -> list[int]:
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            try:
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
                line = (entry / "cmdline").read_bytes()
            except OSError:
                continue
            if int(fields[1]) == pid and b"spawn_main" in line:
                found.append(int(entry.name))
    return found


def _until(found, process):
    for _ in range(3000):
        if (what := found()) or process.poll() is not None:
            return what
        time.sleep(0.02)
    raise AssertionError("nothing happened for a minute")


def test_a_world_that_breaks_is_a_row(tmp_path):
    text = """taskspec: 1
robot: {model: planar3, grasp: door.handle}
world: {door: {mechanism: hinge, xyz: [400 mm, 0, 0], handle: [200 mm, 0, 0]}}
frame: door
stages: {wait: {axes: {x: {velocity: 0}}, time: 10 ms}}
vary: {world.door.xyz: [0..2 m, 0, 0]}
"""
    program = compile_task(load_text(text, "far.yaml"), force=True)
    result = sweep(program, Worlds.of(program.context, 0, 0, corners=True), tmp_path / "s")
    near, far = result.rows
    assert near["status"] in ("done", "stopped", "broken")
    assert far["status"] == "broken"
    assert "'door.handle' is really where the arm cannot hold it" in far["text"]
    assert result.summary["exit_code"] == 1
    assert result.summary["ends"]["broken"] >= 1


OWN = """taskspec: 1
include: {cell}
robot: {{model: {robot}, start: {{xyz: [500 mm, 300 mm, 0]}}}}
stages: {{go: {{path: {{file: {table}, speed: 50 mm/s}}}}}}
vary: {{world.wall.stiffness: 1..100 kN/m}}
"""
CELL = """taskspec: 1
world: {wall: {shape: plane, xyz: [600 mm, 0, 0], rpy: [0, -90 deg, 0]}}
"""
ARM = """<mujoco>
  <compiler meshdir="{meshes}"/>
  <include file="{links}"/>
  <asset><mesh name="palm" file="palm.obj"/></asset>
</mujoco>
"""
LINKS = """<mujoco><worldbody>
  <body name="a"><joint name="a" axis="0 0 1"/>
    <geom type="capsule" size="0.03" fromto="0 0 0 0.4 0 0" mass="2"/>
    <body name="b" pos="0.4 0 0"><joint name="b" axis="0 0 1"/>
      <geom type="capsule" size="0.03" fromto="0 0 0 0.3 0 0" mass="1"/>
      <body name="c" pos="0.3 0 0"><joint name="c" axis="0 0 1"/>
        <geom type="mesh" mesh="palm" density="800"/>
        <site name="flange" pos="0.1 0 0" euler="0 90 0"/>
      </body>
    </body>
  </body>
</worldbody></mujoco>
"""
PALM = "v 0 0 0\nv .1 0 0\nv 0 .05 0\nv 0 0 .05\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.mark.parametrize("named", ["beside", "absolute"])
def test_a_bundle_is_all_that_a_worker_needs(named, tmp_path):
    """The file, its robot and its tables, unpacked where none of them exists: the same row."""
    home = tmp_path / "here"
    files = {
        "project/tasks/own.yaml": OWN,
        "project/parts/cell.yaml": CELL,
        "project/robots/arm.xml": ARM,
        "project/parts/links.xml": LINKS,
        "project/parts/palm.obj": PALM,
        "project/tables/way.csv": "x [mm],y [mm]\n0,0\n-20,10\n-40,0\n",
    }
    above = f"{home}/project" if named == "absolute" else ".."
    places = {
        "cell": f"{above}/parts/cell.yaml",
        "robot": f"{above}/robots/arm.xml",
        "table": f"{above}/tables/way.csv",
        "links": f"{above}/parts/links.xml",
        "meshes": f"{above}/parts",
    }
    for name, text in files.items():
        (home / name).parent.mkdir(parents=True, exist_ok=True)
        braces = name.endswith(("own.yaml", "arm.xml"))
        (home / name).write_text(text.format(**places) if braces else text, encoding="utf-8")
    (home / "project" / "pyproject.toml").touch()
    program = compile_task(load_task(home / "project" / "tasks" / "own.yaml"))
    worlds = Worlds.of(program.context, 0, 2)
    row = run_world(program, 1, worlds.world(program.context, 1))
    assert row["status"] == "done"
    bundle = Bundle.of(program)
    assert len(bundle.contents) == len(files)
    home.rename(tmp_path / "elsewhere")
    (found,) = run_work(Work(bundle, worlds, (1,)))
    assert found == row
    assert not str(program_of(bundle).context.loaded.path).startswith(str(tmp_path))
    if named == "beside":
        # The same files elsewhere are the same sweep.
        again = load_task(tmp_path / "elsewhere" / "project" / "tasks" / "own.yaml")
        assert Bundle.of(compile_task(again)).key == bundle.key


def test_worlds_to_keep_are_asked_for_before_any_is_run(tap, tmp_path):
    program = compile_task(load_task(tap))
    worlds = Worlds.of(program.context, 0, 4)
    with pytest.raises(InputError, match="--keep names world 7; this sweep has those from 0 to 3"):
        sweep(program, worlds, tmp_path / "s", keep="1,7")
    assert not (tmp_path / "s").exists()


def test_the_worst_world_of_each_end_is_kept_and_named(tmp_path):
    """The wall is up to 60 mm away, and the tool goes 24 mm: most worlds touch nothing."""
    task = tmp_path / "far.yaml"
    task.write_text(TAP.replace("[normal(1 mm), 0, 0]", "[510..560 mm, 0, 0]"), encoding="utf-8")
    said = ran("sweep", task, "--out", tmp_path / "s", "--worlds", "8", "-j", 1).stdout
    summary = json.loads((tmp_path / "s" / SWEEP).read_text(encoding="utf-8"))
    gentle = summary["expectations"][0]
    early = [row for row in read_table(tmp_path / "s" / TABLE).to_pylist()
             if row["status"] == "failed"]  # fmt: skip
    assert len(early) > 1
    assert gentle["good"] == 8
    assert gentle["so_far"] == len(early)
    assert f"{len(early)} of them as far as they got" in said
    ends = {each["end"]: each["world"] for each in summary["worst"]}
    assert ends.keys() == summary["ends"].keys() >= {"failed: time"}
    for end, world in ends.items():
        assert f"worst ({summary['ends'][end]} {end}): world {world}" in said
        assert (tmp_path / "s" / "worlds" / f"{world:06}" / "report.html").is_file()
        assert f"worst of {end}" in (tmp_path / "s" / PAGE).read_text(encoding="utf-8")
