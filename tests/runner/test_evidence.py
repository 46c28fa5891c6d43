"""What of a run's folder is not as the run wrote it is named, and no verdict is made of it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from command_line import call
from sealed import seal_folder
from short_tasks import TAP

from taskspec.spec import load_task, load_text
from taskspec_runner import read
from taskspec_runner.errors import InputError
from taskspec_runner.record.log import LogReader
from taskspec_runner.session import execute

#: Three batches.
TASK = TAP.replace("time: 0.3 s", "time: 1.2 s")
READERS = (("report",), ("export", "--csv"), ("judge",))


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("evidence") / "run"
    assert execute(load_text(TASK, "tap.yaml"), out).passed
    return out


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "run"))


def altered(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


def flipped(path: Path, at: int) -> None:
    content = bytearray(path.read_bytes())
    content[at] ^= 1
    path.write_bytes(content)


def test_whole_folder(folder: Path) -> None:
    assert read(folder).damage == ""
    for command, *options in READERS:
        result = call(command, folder, *options)
        assert (result.exit_code, result.stderr) == (0, "")


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("summary.json", '"passed": true', '"passed": false'),
        ("summary.json", '"status": "done"', '"status": "stopped"'),
        ("manifest.json", '"seed": 0', '"seed": 1'),
        ("manifest.json", '"status": "done"', '"status": "running"'),
        ("task.yaml", "press: 5 N", "press: 6 N"),
    ],
)
def test_file_that_was_altered_is_named(folder: Path, name: str, old: str, new: str) -> None:
    altered(folder / name, old, new)
    run = read(folder)
    assert run.damage == f"{name} was altered: it is not as the run wrote it"
    assert (run.verdict, run.passed) == ("damaged", False)
    for command, *options in READERS[:2]:
        result = call(command, folder, *options)
        assert result.exit_code == 1
        assert result.stderr.startswith(f"taskspec: {run.damage}; ")
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert run.damage in page
    result = call("diff", folder, folder)
    assert result.exit_code == 1
    assert "The runs are equal" not in result.stdout
    assert f"A is damaged: {run.damage}" in result.stdout


@pytest.mark.parametrize("name", ["summary.json", "manifest.json", "task.yaml", "log.arrow"])
def test_file_that_is_missing_is_named(folder: Path, name: str) -> None:
    (folder / name).unlink()
    run = read(folder)
    assert run.damage == f"{name} is missing"
    assert run.verdict == "damaged"
    assert call("report", folder).exit_code == 1


def test_every_bit_of_a_log_counts(folder: Path) -> None:
    """One in each of 200 places; the batch that has it is named, and those before it are read."""
    log = folder / "log.arrow"
    whole, size = read(folder).history, log.stat().st_size
    table = pa.ipc.open_stream(log.read_bytes())
    assert [batch.num_rows for batch in table] == [500, 500, len(whole) - 1000]
    named = set()
    for at in np.linspace(0, size - 9, 200).astype(int).tolist():
        flipped(log, at)
        run = read(folder)
        assert run.verdict == "damaged"
        assert run.damage.startswith("log.arrow ")
        assert len(run) < len(whole)
        ticks = run.columns.get("clock", np.zeros(0))
        assert np.array_equal(ticks, whole.columns["clock"][: len(ticks)])
        named.add(run.damage.partition("batch ")[2][:1])
        flipped(log, at)
    assert named >= {"0", "1", "2"}
    assert read(folder).damage == ""


def test_log_that_was_cut_short_says_after_how_many_ticks(folder: Path) -> None:
    log, ticks = folder / "log.arrow", len(read(folder))
    log.write_bytes(log.read_bytes()[:-100])
    # The second batch was whole, of which only the third, which is gone, could tell.
    told = f"log.arrow was cut short: it ends after 500 of {ticks} ticks"
    assert read(folder).damage == told


def test_log_of_another_run_is_not_taken_for_this_ones(folder: Path, tmp_path: Path) -> None:
    other = execute(load_text(TASK, "tap.yaml"), tmp_path / "other", seed=1).folder
    shutil.copy(other / "log.arrow", folder / "log.arrow")
    assert read(folder).damage == "log.arrow was altered: it is the log of another run"


def test_batches_that_were_exchanged_are_told(folder: Path) -> None:
    log = folder / "log.arrow"
    stream = pa.ipc.open_stream(log.read_bytes())
    found = [stream.read_next_batch_with_custom_metadata() for _ in range(3)]
    with log.open("wb") as file, pa.ipc.new_stream(file, stream.schema) as writer:
        for number in (0, 2, 1):
            writer.write_batch(*found[number])
    reader = LogReader(log)
    assert sum(batch.num_rows for batch in reader) == 0
    assert "batch 0 (from tick 0) is not as the run wrote it" in reader.damage


def test_forged_summary_is_found_out_by_judging_again(tmp_path: Path) -> None:
    """Who alters the manifest's checksums too is told by the log."""
    text = TASK.replace("max(abs(hold.error.y)) < 1 mm", "max(abs(hold.error.y)) < 1 um")
    folder = execute(load_text(text, "tap.yaml"), tmp_path / "run", report=False).folder
    assert read(folder).verdict == "missed"
    result = call("judge", folder)
    assert result.exit_code == 1
    assert "summary.json says the same" in result.stdout
    altered(folder / "summary.json", '"passed": false', '"passed": true')
    for seal in (False, True):
        if seal:
            log = json.loads((folder / "manifest.json").read_text())["log"]
            seal_folder(folder, log=log)
            assert read(folder).damage == ""
        result = call("judge", folder)
        assert result.exit_code == 1
        assert "not so in summary.json: `max(abs(hold.error.y)) < 1 um` was missed" in result.stdout
    data = json.loads(call("judge", folder, "--format", "json").stdout)
    assert [each["passed"] for each in data["expectations"]] == [True, True, False, True]
    assert len(data["apart"]) == 1


@pytest.mark.parametrize("command", ["report", "judge", "export", "diff"])
def test_a_task_that_is_not_that_of_the_log_is_told_however_it_is_sealed(
    folder: Path, command: str
) -> None:
    """Each batch of the log says of which task it is; the bytes of the log alone do not."""
    altered(folder / "task.yaml", "press: 5 N", "press: 6 N")
    seal_folder(folder, log=json.loads((folder / "manifest.json").read_text())["log"])
    assert read(folder).damage == "log.arrow was altered: it is the log of another run"
    assert read(folder).verdict == "damaged"
    options = {"export": ["--csv"], "diff": [folder]}.get(command, [])
    result = call(command, folder, *options)
    assert result.exit_code == (1 if command in ("report", "diff") else 2), result.output
    if command != "export":
        assert "it is the log of another run" in result.stderr


def test_judge_says_what_it_needs(folder: Path, tmp_path: Path) -> None:
    altered(folder / "task.yaml", "press: 5 N", "press: 6 N")
    result = call("judge", folder)
    assert result.exit_code == 2
    assert f"cannot judge {folder}: its task: task.yaml was altered" in result.stderr
    (folder / "log.arrow").unlink()
    assert "log.arrow is missing" in call("judge", folder).stderr
    assert call("judge", tmp_path).exit_code == 2


@pytest.mark.parametrize("command", ["report", "judge", "export", "diff"])
def test_newer_format_is_refused(folder: Path, command: str) -> None:
    seal_folder(folder, format=99)
    options = {"export": ["--csv"], "diff": [folder]}.get(command, [])
    result = call(command, folder, *options)
    assert result.exit_code == 2
    assert "a newer taskspec made it (format 99, this one reads up to 2)" in result.stderr
    with pytest.raises(InputError, match="a newer taskspec"):
        read(folder)


def test_run_of_an_earlier_version_has_no_evidence_of_its_summary(folder: Path) -> None:
    manifest = json.loads((folder / "manifest.json").read_text())
    del manifest["seal"], manifest["sha256"]["summary.json"]
    (folder / "manifest.json").write_text(json.dumps(manifest | {"format": 1}))
    run = read(folder)
    assert "an earlier taskspec made it" in run.damage
    assert run.verdict == "damaged"


ARM = (Path(__file__).parents[2] / "taskspec" / "robot" / "models" / "planar2.xml").read_text()


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """A run of a robot from a file, along points from another one."""
    (tmp_path / "arm.xml").write_text(ARM, encoding="utf-8")
    text = TAP.replace("model: planar2", "model: arm.xml")
    (tmp_path / "tap.yaml").write_text(text, encoding="utf-8")
    return execute(load_task(tmp_path / "tap.yaml"), tmp_path / "run").folder


def test_files_that_a_task_draws_on_are_in_the_manifest(own: Path) -> None:
    inputs = read(own).manifest["inputs"]
    assert list(inputs) == ["arm.xml"]
    # An arm that is not on this machine is no damage.
    (own.parent / "arm.xml").unlink()
    assert call("report", own).exit_code == 0
    assert read(own).passed
    result = call("judge", own)
    assert result.exit_code == 2
    assert "there is no file 'arm.xml'" in result.stderr


def test_file_that_a_task_draws_on_and_that_has_changed_is_told(own: Path) -> None:
    (own.parent / "arm.xml").write_text(ARM + "<!-- -->\n", encoding="utf-8")
    result = call("report", own)
    assert result.exit_code == 0
    assert result.stderr == "taskspec: arm.xml is no longer as the run read it\n"
    assert "arm.xml is no longer as the run read it" in call("judge", own).stderr


def test_length_that_says_more_than_there_is_makes_no_room_for_it(folder: Path) -> None:
    """Of the schema's description, and of a batch: their high bits."""
    log = folder / "log.arrow"
    content = log.read_bytes()
    first = 8 + int.from_bytes(content[4:8], "little")
    for at in (7, first + 7):
        log.write_bytes(content[:at] + bytes([content[at] ^ 0x40]) + content[at + 1 :])
        assert read(folder).damage.startswith("log.arrow was ")
        assert call("report", folder).exit_code == 1
