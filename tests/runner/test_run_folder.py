"""A run folder has one writer, and its files are whole or not there."""

from __future__ import annotations

import fcntl
import json
import os
import resource
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from short_tasks import TAP
from typer.testing import CliRunner, Result

from taskspec.regular_file import open_regular
from taskspec_runner.cli import app
from taskspec_runner.errors import OutputError
from taskspec_runner.record import whole as wholes
from taskspec_runner.record.folder import RunFolder
from taskspec_runner.record.lock import LOCK, FolderLock, holder
from taskspec_runner.record.log import read_log
from taskspec_runner.record.recorder import BATCH, ROOM
from taskspec_runner.record.whole import PARTIAL, whole, write_whole
from taskspec_runner.runs import Run

#: Goes on until it is ended.
LONG = TAP.replace("time: 0.3 s", "time: 600 s")
COMMAND = [sys.executable, "-c", "from taskspec_runner.cli import main; main()"]


def call(*args: str | Path) -> Result:
    result = CliRunner().invoke(app, [str(arg) for arg in args])
    assert "Traceback" not in result.output
    return result


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


@pytest.fixture
def writing(tmp_path: Path) -> subprocess.Popen[bytes]:
    """A process that runs a task into the folder `run`."""
    task, out = tmp_path / "long.yaml", tmp_path / "run"
    task.write_text(LONG, encoding="utf-8")
    process = subprocess.Popen([*COMMAND, "run", task, "--out", out, "--quiet"])
    began = time.monotonic()
    while not (out / "log.arrow").is_file():
        assert process.poll() is None
        assert time.monotonic() - began < 60
        time.sleep(0.02)
    yield process
    process.kill()
    process.wait()


def test_second_run_into_a_folder_names_the_first(
    writing: subprocess.Popen[bytes], tap: Path, tmp_path: Path
) -> None:
    out = tmp_path / "run"
    since = json.loads((out / LOCK).read_bytes().rstrip(b"\0"))["since"]
    second = subprocess.run(
        [*COMMAND, "run", tap, "--out", out], capture_output=True, text=True, check=False
    )
    assert second.returncode == 2
    who = f"process {writing.pid} on {socket.gethostname()} since {since}"
    assert second.stderr == f"taskspec: cannot write {out}: {who} writes into it\n"
    # The first has not noticed.
    assert json.loads((out / "manifest.json").read_text())["status"] == "running"
    writing.send_signal(signal.SIGINT)
    assert writing.wait(60) == 130
    assert json.loads((out / "manifest.json").read_text())["reason"] == "interrupted"
    assert not (out / LOCK).exists()


def test_lock_of_a_process_that_was_killed_is_stale(
    writing: subprocess.Popen[bytes], tap: Path, tmp_path: Path
) -> None:
    writing.kill()
    writing.wait()
    assert (tmp_path / "run" / LOCK).is_file()
    assert holder(tmp_path / "run") is None
    assert call("run", tap, "--out", tmp_path / "run", "--quiet").exit_code == 0
    assert not (tmp_path / "run" / LOCK).exists()


def test_lock_is_taken_before_a_comparison_and_its_runs_are_replaced(
    tap: Path, tmp_path: Path
) -> None:
    assert call("compare", tap, "--law", "hybrid", "--out", tmp_path / "c").exit_code == 0
    before = contents(tmp_path / "c" / "hybrid")
    for locked in (tmp_path / "c", tmp_path / "c" / "hybrid"):
        lock = FolderLock(locked)
        result = call("compare", tap, "--law", "hybrid", "--out", tmp_path / "c")
        lock.close()
        assert result.exit_code == 2
        assert f"process {os.getpid()} on " in result.stderr
    assert contents(tmp_path / "c" / "hybrid") == before


def test_file_of_a_lock_that_was_removed_in_between_is_not_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else two processes would each hold the lock of a file of their own."""
    first, usual = FolderLock(tmp_path), fcntl.flock

    def slow(descriptor: int, operation: int) -> None:
        first.close()
        monkeypatch.setattr(fcntl, "flock", usual)
        usual(descriptor, operation)

    monkeypatch.setattr(fcntl, "flock", slow)
    second = FolderLock(tmp_path)
    with pytest.raises(OutputError, match=f"process {os.getpid()} "):
        FolderLock(tmp_path)
    second.close()


MANIFESTS = {
    "another's": '{"mine": 1}',
    "another's with a format": '{"format": 1, "versions": {"npm": "9"}}',
    "a list": "[]",
    "no JSON": "{",
    "too deep": "[" * 100_000,
}


@pytest.mark.parametrize("text", MANIFESTS.values(), ids=MANIFESTS)
def test_folder_with_a_manifest_of_another_kind_is_left_alone(
    text: str, tap: Path, tmp_path: Path
) -> None:
    out = tmp_path / "mine"
    out.mkdir()
    for name in ("task.yaml", "summary.json", "report.html", "log.csv"):
        (out / name).write_text("precious")
    (out / "manifest.json").write_text(text)
    before = contents(out)
    result = call("run", tap, "--out", out)
    assert result.exit_code == 2
    assert "the folder is not empty and holds no run" in result.stderr
    assert contents(out) == before


@pytest.mark.parametrize("left", ["nothing", "a lock", "a partial"])
def test_folder_with_next_to_nothing_is_taken(left: str, tap: Path, tmp_path: Path) -> None:
    """A run that was killed before its manifest was there."""
    out = tmp_path / "out"
    out.mkdir()
    if left != "nothing":
        (out / (LOCK if left == "a lock" else f"{PARTIAL}0a.json")).write_bytes(b"")
    assert call("run", tap, "--out", out, "--quiet").exit_code == 0
    names = {"task.yaml", "manifest.json", "log.arrow", "summary.json", "report.html"}
    assert {path.name for path in out.iterdir()} == names


def test_nothing_is_written_through_links(tap: Path, tmp_path: Path) -> None:
    out, victim = tmp_path / "out", tmp_path / "victim"
    assert call("run", tap, "--out", out, "--quiet").exit_code == 0
    victim.write_text("precious")
    for name in ("summary.json", "log.arrow", "report.html", "log.csv"):
        (out / name).unlink(missing_ok=True)
        (out / name).symlink_to(victim)
    for name in (f".{name}.partial" for name in ("summary.json", "manifest.json")):
        (out / name).symlink_to(victim)
    assert call("run", tap, "--out", out, "--quiet").exit_code == 0
    assert victim.read_text() == "precious"
    assert not (out / "log.arrow").is_symlink()
    # A lock that is a link is none.
    (out / LOCK).symlink_to(victim)
    result = call("run", tap, "--out", out, "--quiet")
    assert result.exit_code == 2
    assert victim.read_text() == "precious"


def test_partial_is_made_exclusively(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    victim = tmp_path / "victim"
    victim.write_text("precious")
    monkeypatch.setattr(wholes.secrets, "token_hex", lambda _: "known")
    (tmp_path / f"{PARTIAL}known.txt").symlink_to(victim)
    with pytest.raises(OutputError, match="File exists"):
        write_whole(tmp_path / "new.txt", "mine")
    assert victim.read_text() == "precious"
    assert not (tmp_path / "new.txt").exists()


def test_partial_that_was_exchanged_does_not_take_the_place(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")

    def exchanged() -> None:
        with whole(path) as partial:
            partial.unlink()
            partial.write_text("theirs")

    with pytest.raises(OutputError, match="was replaced while it was written"):
        exchanged()
    assert contents(tmp_path) == {"a.txt": b"old"}


@pytest.mark.parametrize("kind", ["folder", "pipe"])
def test_place_that_is_no_file_is_not_replaced(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "there"
    path.mkdir() if kind == "folder" else os.mkfifo(path)
    with pytest.raises(OutputError, match="it is not a regular file"):
        write_whole(path, "x")
    with pytest.raises(OSError, match="it is not a regular file"):
        open_regular(path)
    assert path.exists()


def test_writer_that_fails_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")

    def failing() -> None:
        with whole(path) as partial:
            partial.write_text("half")
            raise OSError(28, "No space left on device")

    with pytest.raises(OutputError, match=f"cannot write {path}: No space left"):
        failing()
    assert contents(tmp_path) == {"a.txt": b"old"}


def limited(*args: str | Path, size: int) -> subprocess.CompletedProcess[str]:
    """The command in a process whose files cannot be larger than a size [bytes]."""

    def limit() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

    return subprocess.run(
        # Python would leave half a file of what it compiles, too.
        [sys.executable, "-B", *COMMAND[1:], *args],
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=limit,
    )


def test_manifest_of_a_run_on_a_full_disk_names_the_log(tap: Path, tmp_path: Path) -> None:
    out, task = tmp_path / "run", tmp_path / "long.yaml"
    task.write_text(LONG, encoding="utf-8")
    said = limited("run", task, "--out", out, size=3_000_000)
    assert said.returncode == 2
    told = f"cannot write {out / 'log.arrow'}: File too large"
    assert said.stderr.endswith(f"taskspec: {told}\n")
    manifest = json.loads((out / "manifest.json").read_text())
    assert (manifest["status"], manifest["reason"]) == ("crashed", told)
    assert manifest["unwritten"] == {"file": "log.arrow", "reason": "File too large"}
    assert not (out / LOCK).exists()
    # The batches that had no room are still in their block.
    run, logged = Run.load(str(out)), read_log(out / "log.arrow")
    assert len(logged) + BATCH <= len(run) <= len(logged) + ROOM
    assert len(logged) > 1000
    assert np.array_equal(run.columns["clock"], 1e-3 * np.arange(len(run)))
    assert run.verdict == "unfinished"
    assert run.reason.startswith(f"The run crashed: {told}.")
    # It is a run folder like another.
    assert call("run", tap, "--out", out, "--quiet").exit_code == 0
    assert "unwritten" not in json.loads((out / "manifest.json").read_text())


@pytest.mark.parametrize(
    ("size", "file", "status"),
    [(100_000, "log.arrow", "crashed"), (130_000, "report.html", "done")],
)
def test_manifest_of_a_judged_log_on_a_full_disk_names_the_file(
    tap: Path, tmp_path: Path, size: int, file: str, status: str
) -> None:
    assert call("run", tap, "--out", tmp_path / "run", "--quiet").exit_code == 0
    assert call("export", tmp_path / "run", "--csv").exit_code == 0
    out = tmp_path / "judged"
    said = limited("judge", tap, tmp_path / "run" / "log.csv", "--out", out, size=size)
    assert said.returncode == 2
    told = f"cannot write {out / file}: File too large"
    assert said.stderr.endswith(f"taskspec: {told}\n")
    manifest = json.loads((out / "manifest.json").read_text())
    assert manifest["unwritten"] == {"file": file, "reason": "File too large"}
    assert manifest["status"] == status
    assert not (out / LOCK).exists()
    run = Run.load(out)
    assert not run.damage
    assert run.passed == (status == "done")


def test_report_on_a_full_disk_leaves_the_old_one(tap: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    assert call("run", tap, "--out", out, "--quiet").exit_code == 0
    before = contents(out)
    said = limited("report", out, size=60_000)
    assert said.stderr == f"taskspec: cannot write {out / 'report.html'}: File too large\n"
    assert said.returncode == 2
    assert contents(out) == before


def test_run_that_was_judged_stands_though_its_report_has_no_room(
    tap: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, usual = tmp_path / "run", wholes.os.fsync

    def full(descriptor: int) -> None:
        usual(descriptor)
        if any(p.suffix == ".html" and p.stat().st_size for p in out.glob(f"{PARTIAL}*")):
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(wholes.os, "fsync", full)
    result = call("run", tap, "--out", out)
    assert result.exit_code == 2
    assert f"cannot write {out / 'report.html'}: No space left on device" in result.stderr
    manifest = json.loads((out / "manifest.json").read_text())
    assert (manifest["status"], manifest["exit_code"]) == ("done", 0)
    assert manifest["unwritten"] == {"file": "report.html", "reason": "No space left on device"}
    assert not (out / "report.html").exists()


def test_manifest_has_room_on_a_full_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The lock keeps some: a disk that has none left takes the manifest when it is given up."""
    folder = RunFolder(tmp_path, lock=FolderLock(tmp_path))
    assert folder.lock is not None
    usual = wholes.os.fsync

    def full(descriptor: int) -> None:
        if (tmp_path / LOCK).stat().st_size:
            raise OSError(28, "No space left on device")
        usual(descriptor)

    monkeypatch.setattr(wholes.os, "fsync", full)
    folder.note(status="crashed")
    assert json.loads((tmp_path / "manifest.json").read_text())["status"] == "crashed"
    with pytest.raises(OutputError):
        FolderLock(tmp_path)
    folder.close()


#: Commands that write where a user says; `{run}` is the folder of a run, `{target}` the file.
WRITERS = (
    ("export", "{run}", "{target}", "--csv"),
    ("schema", "--write", "{target}"),
    ("test", "{task}", "--junit", "{target}", "--out", "{run}-tests"),
)


@pytest.mark.parametrize("command", WRITERS, ids=lambda command: command[0])
@pytest.mark.parametrize("name", ["log.arrow", "summary.json", "manifest.json", "task.yaml"])
def test_evidence_is_never_the_target_of_a_command(
    name: str, command: tuple[str, ...], tap: Path, tmp_path: Path
) -> None:
    out = tmp_path / "run"
    assert call("run", tap, "--out", out, "--quiet").exit_code == 0
    (tmp_path / "linked.csv").symlink_to(out / name)
    before = contents(out)
    for target in (out / name, tmp_path / "linked.csv"):
        result = call(*(part.format(run=out, target=target, task=tap) for part in command))
        assert result.exit_code == 2
        assert "it is part of the evidence of a run; choose another name" in result.stderr
    assert contents(out) == before


@pytest.mark.parametrize(
    ("marker", "name", "said"),
    [
        ("compare.json", "compare.json", {"format": 1, "laws": []}),
        ("sweep.json", "sweep.json", {"format": 1, "identity": "a"}),
        ("sweep.json", "worlds.jsonl", {"format": 1, "identity": "a"}),
        ("sweep.json", "worlds.parquet", {"format": 1, "identity": "a"}),
        ("sweep.json", "task.yaml", {"format": 1, "identity": "a"}),
    ],
)
def test_evidence_of_comparisons_and_sweeps_is_no_target_either(
    marker: str, name: str, said: dict[str, object], tmp_path: Path
) -> None:
    (tmp_path / name).write_text("evidence")
    (tmp_path / marker).write_text(json.dumps(said))
    before = contents(tmp_path)
    result = call("schema", "--write", tmp_path / name)
    assert result.exit_code == 2
    assert "it is part of the evidence of a" in result.stderr
    assert contents(tmp_path) == before
    # Elsewhere the name is one like any other.
    (tmp_path / marker).unlink()
    assert call("schema", "--write", tmp_path / name).exit_code == 0


def test_targets_that_a_command_knows_by_their_suffix_are_no_evidence(
    tap: Path, tmp_path: Path
) -> None:
    out = tmp_path / "run"
    assert call("run", tap, "--out", out, "--quiet").exit_code == 0
    before = contents(out)
    for command, target in (
        (("diff", out, out, "--html"), out / "log.arrow"),
        (("replay", out, "--video"), out / "summary.json"),
    ):
        result = call(*command, target)
        assert result.exit_code == 2
        assert str(target) in result.stderr
    result = call("new", "wipe-table", "--out", out / "task.yaml")
    assert result.exit_code == 2
    assert "exists already" in result.stderr
    assert contents(out) == before


def test_what_tests_keep_is_not_put_over_a_file_of_others(tap: Path, tmp_path: Path) -> None:
    out = tmp_path / "kept"
    (out / "tap").mkdir(parents=True)
    (out / "last.json").write_text("[1, 2]")
    result = call("test", tap, "--out", out)
    assert result.exit_code == 2
    assert "last.json: taskspec test did not write it; choose another --out" in result.stderr
    assert (out / "last.json").read_text() == "[1, 2]"
    # Nor is a note lost that lies beside a run that passed and is not kept.
    (out / "last.json").unlink()
    assert call("test", tap, "--out", out, "--keep").exit_code == 0
    (out / "tap" / "note.txt").write_text("mine")
    assert call("test", tap, "--out", out).exit_code == 0
    assert [path.name for path in (out / "tap").iterdir()] == ["note.txt"]
