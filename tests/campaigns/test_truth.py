"""What `make truth` holds against runs, and how it counts."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from truth import HERE, Judged, announcements, kept_line, shares
from truth_file import GENERATORS, Row, row_of, said
from truth_page import page
from truth_tasks import draft, scaled, truth_task, write_companions

import taskspec_runner.trial.reported  # noqa: F401
from taskspec.examination import examine
from taskspec.spec import load_text
from taskspec.text.codes import CODES

CORPUS = Path(__file__).parents[1] / "corpus"
_ANNOUNCES = {"TS501": ("*",), "TS616": ("stop: force",), "TS304": ()}


def judged(end: str, *codes: str, **more: Any) -> Judged:
    found = [
        {"code": c, "severity": "warning" if c == "TS616" else "error", "stage": "", "text": ""}
        for c in codes
    ]
    return Judged({**vars(Row(1, end=end)), "said": found, **more}, _ANNOUNCES)


def test_a_file_is_its_seed_and_number() -> None:
    assert truth_task(1, 17) == truth_task(1, 17)
    assert len({truth_task(1, 17), truth_task(1, 18), truth_task(2, 17)}) == 3


def test_the_files_are_such_of_the_language(tmp_path: Path) -> None:
    """What is refused by its text alone is not run, and says nothing of predictions."""
    write_companions(tmp_path)
    for number in range(100):
        load_text(truth_task(0, number), "task.yaml", base=tmp_path)


def test_the_files_have_all_that_they_are_to_cover() -> None:
    drafts = [draft(0, number) for number in range(400)]
    text = "\n".join(made.written() for made in drafts)
    words = [f"model: {arm}\n" for arm in ("planar2", "planar3", "ur5e", "panda")]
    words += [f"shape: {shape}" for shape in ("plane", "box", "cylinder", "sphere")]
    words += [f"shape: {shape}" for shape in ("hole", "slot", "groove")]
    words += ["track: force", "track: velocity", "on: button", "thickness:", "templates:", "use:"]
    words += ["hold: force", "repeat: 2", "then: leave", "visits < 2", "Feed against"]
    words += ["mm/s * clamp(1 - norm(", "mm/s * clamp(1 - abs(", "mm/s * smooth(t/("]
    words += [
        "include: [habits.yaml]",
        "use: pause",
        "joints:",
        "generalised:",
        "raster:",
        "spiral:",
        "waypoints:",
    ]
    words += [f"mechanism: {kind}" for kind in ("hinge", "slide", "screw")]
    words += ["knob: free", "solve: qp", "noise:", "filter:", "delay:", "bias:", "rate: 250 Hz"]
    words += ["move:", "path:", "follows:", "fail_if:", "attempts:", "until:", "limits:", "expect:"]
    assert [word for word in words if word not in text] == []
    slips = {made.slip for made in drafts}
    assert slips == {"", "gain", "fast", "far", "limit", "time", "guard", "late"}
    stiffness = [float(found) for found in re.findall(r"stiffness: ([\d.]+) kN/m,", text)]
    assert min(stiffness) < 1.5
    assert max(stiffness) > 250
    assert (
        0.2 < sum(value > 55 for value in stiffness) / len(stiffness) < 0.4
    )  # log(300/55)/log(300)


def test_a_stage_goes_the_same_way_more_slowly() -> None:
    made = next(
        d for n in range(99) if (d := draft(0, n)).kind == "surface" and "time" in d.stages["slide"]
    )
    before = yaml.safe_load(made.written())
    made.lengthen("slide", 10.0)
    after = yaml.safe_load(made.written())
    assert {n for n, s in after["stages"].items() if s != before["stages"][n]} == {"slide"}
    times = [float(t["stages"]["slide"]["time"].removesuffix(" s")) for t in (before, after)]
    assert times[1] == pytest.approx(10 * times[0])
    assert scaled("-20 mm/s * smooth(t)", 0.1) == "-2 mm/s * smooth(t)"
    assert scaled("rigid", 0.1) == "rigid"


@pytest.mark.parametrize(
    ("row", "kind"),
    [
        (judged("well"), ""),
        (judged("well", "TS616"), "warned"),
        (judged("well", "TS501", refused=True, forced=True), "false refusal"),
        (judged("well", "TS501", refused=True, forced=True, near=True), ""),
        (judged("well", "TS501", refused=True, forced=True, grew="grows"), ""),
        (judged("stop: force", "TS616"), ""),
        (judged("stop: speed", "TS616"), "missed"),
        (judged("stop: speed", "TS304"), "missed"),
        (judged("missed"), "silent"),
        (judged("refused", "TS021"), ""),
        (judged("crashed"), "crash"),
    ],
)
def test_what_is_said_agrees_with_the_end_or_not(row: Judged, kind: str) -> None:
    assert row.disagreement == kind


def test_the_shares_are_those_of_the_promises() -> None:
    rows = [judged("well"), judged("well", "TS616"), judged("stop: force", "TS616")]
    rows += [judged("missed"), judged("missed", "TS501", refused=True, forced=True)]
    counts = [(share.count, share.total) for share in shares(rows)]
    assert counts == [(2, 3), (2, 3), (1, 2), (1, 1), (1, 2)]
    assert not any(share.kept for share in shares(rows) if share.title.startswith("bad"))


def test_the_table_of_announcements_knows_its_codes() -> None:
    assert set(announcements()) - set(CODES) == set()


def test_a_finding_is_of_the_stage_that_it_stands_in() -> None:
    text = (CORPUS / "err" / "TS420_speed.yaml").read_text("utf-8")
    found = said(text, examine(load_text(text, "task.yaml")).findings)
    assert ("TS420", "warning", "go") in [(d["code"], d["severity"], d["stage"]) for d in found]


#: Of the first 60 files of seed 0 the first 24, and those that have a finding or do not end well.
FIXED = {
    (generator, seed, number): line
    for generator, seeds in yaml.safe_load((HERE / "fixed.yaml").read_text("utf-8")).items()
    for seed, lines in seeds.items()
    for number, line in lines.items()
}


def test_files_of_every_kind_of_end_are_fixed() -> None:
    assert set(FIXED) >= {("workshop", 0, number) for number in range(24)}
    later = {line for (_, _, number), line in FIXED.items() if number >= 24}
    assert len(later) == 4
    assert "well" not in later


@pytest.mark.parametrize(("generator", "seed", "number"), FIXED)
def test_a_fixed_file_ends_as_it_did_and_as_much_is_said(
    generator: str, seed: int, number: int
) -> None:
    assert kept_line(row_of(generator, seed, number)) == FIXED[generator, seed, number]


def test_the_page_has_the_tables_of_both_generators() -> None:
    rows = [judged("well"), judged("stop: force", "TS616"), judged("missed")]
    text = page(3, {name: rows for name in GENERATORS})
    assert list(GENERATORS) == ["workshop", "language"]
    assert text.count("| bad runs that were announced | 1 | 2 | 50.0% |") == 2
    assert text.index("## Workshop\n") < text.index("## Language\n")
