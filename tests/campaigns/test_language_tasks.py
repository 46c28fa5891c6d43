"""The second generator of `make truth`: its files are such of the language, and cover it."""

from __future__ import annotations

import ast
from pathlib import Path

import language_tasks
import pytest
from language_draft import LAWS, scaled
from language_scenes import SCENES
from language_tasks import MISTAKEN, MISTAKES, draft, language_task, write_companions
from truth_file import row_of

from taskspec.spec import load_text
from taskspec.text.diagnostic import SpecError

HERE = Path(language_tasks.__file__).parent


def accepted(text: str, folder: Path) -> bool:
    """Whether a file is one of the language."""
    try:
        load_text(text, "task.yaml", base=folder)
    except SpecError:
        return False
    return True


def test_a_file_is_its_seed_and_number() -> None:
    assert language_task(1, 17) == language_task(1, 17)
    assert len({language_task(1, 17), language_task(1, 18), language_task(2, 17)}) == 3


def test_it_reads_nothing_of_what_it_is_to_judge() -> None:
    """Nor of the generator that rules were fitted to."""
    read = set()
    for path in HERE.glob("language_*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Import):
                read |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                read.add(str(node.module))
    assert "language_draft" in read
    assert not {name for name in read if name.startswith("taskspec")}
    assert not read & {"truth_tasks", "random_tasks", "workshop_scenes"}


def test_nearly_all_files_are_read_but_those_with_a_slip_of_the_pen(tmp_path: Path) -> None:
    write_companions(tmp_path)
    drafts = [draft(0, number) for number in range(200)]
    taken = [accepted(made.written(), tmp_path) for made in drafts]
    careful = [ok for made, ok in zip(drafts, taken, strict=True) if made.slip != "pen"]
    assert sum(taken) >= 0.9 * 200
    assert sum(careful) >= 0.98 * len(careful)


def test_the_files_cover_the_language() -> None:
    drafts = [draft(0, number) for number in range(480)]
    text = "\n".join(made.written() for made in drafts)
    words = [f"model: {arm}\n" for arm in ("planar2", "planar3", "ur5e", "panda")]
    words += [
        "shape: " + s for s in ("plane", "box", "cylinder", "sphere", "hole", "slot", "groove")
    ]
    words += ["equation: z >=", "equation: z <=", "equation: x^2", "equation: q1"]
    words += ["bushing: tool", "equation: rz +", "angle(tool.z, -world.z)"]
    words += ["mechanism: " + kind for kind in ("hinge", "slide", "screw")]
    words += ["grasp:", "on: button", "on: door", "free: true", "detent:", "stop:", "knob: free"]
    words += [
        key + ":" for key in ("line", "to", "arc", "raster", "spiral", "waypoints", "lissajous")
    ]
    words += ["file: outline.csv", "joints:", "clamp(1.5 - norm(force)"]
    words += [key + ":" for key in ("position", "velocity", "move", "force", "torque", "stiffness")]
    words += ["free", "hold: start", "hold: world", "hold: force", "follows:", "ramp:", "contact:"]
    words += ["until:", "within:", "fail_if:", "on_fail:", "attempts:", "next:", "when:", "repeat:"]
    words += ["visits", "then: lift", "use:", "with:", "include:", "templates:", "params:"]
    words += [
        "surface:",
        "heading:",
        "track: force",
        "track: velocity",
        "estimate:",
        "frame: world",
    ]
    words += ["motion:", "sensor:", "noise:", "bias:", "filter:", "delay:", "tare:", "at: wrist"]
    words += ["joint_friction:", "joint_damping:", "protection:", "payload", "faults:", "base:"]
    words += ["solve: qp", "solver: osqp", "null_space:", "orientation:", "bandwidth:", "integral:"]
    words += ["deviation:", "torque_rate:", "rate: 500 Hz", "vary:", "sweep:", "truth:", "allow:"]
    words += [call + "(" for call in ("max", "min", "mean", "rms", "std", "last", "abs", "norm")]
    words += [".ref", " in ", "friction: 0.", "stiffness: rigid", "balanced: true", "posture:"]
    assert [word for word in words if word not in text] == []
    assert {made.law for made in drafts} == set(LAWS)
    assert {made.kind for made in drafts} == set(SCENES)
    assert {made.slip for made in drafts} == {"", *MISTAKES}
    slips = sum(made.slip != "" for made in drafts) / len(drafts)
    assert slips == pytest.approx(MISTAKEN, abs=0.08)
    assert {len(made.stages) for made in drafts} >= {1, 2, 3, 4, 5}


def test_a_stage_goes_the_same_way_more_slowly() -> None:
    made = draft(0, 0)
    made.stages.clear()
    made.stages["go"] = {
        "axes": {
            "x": {"velocity": "20 mm/s * smooth(t/(1 s))"},
            "y": {"move": "30 mm"},
            "z": {"force": "-5 N * smooth(t/(2 s))"},
        },
        "until": "t > 1 s",
        "within": {"time": "3 s", "travel": "40 mm"},
    }
    made.lengthen("go", 10.0)
    assert made.stages["go"] == {
        "axes": {
            "x": {"velocity": "(20 mm/s * smooth((t/10)/(1 s)))/10"},
            "y": {"move": "30 mm", "speed": "(50 mm/s)/10"},
            "z": {"force": "-5 N * smooth((t/10)/(2 s))"},
        },
        "until": "t > 1 s",
        "within": {"time": "(3 s)*10", "travel": "40 mm"},
    }


def test_longer_stages_softer_contacts_and_other_gains_are_of_the_language(tmp_path: Path) -> None:
    write_companions(tmp_path)
    altered = 0
    for number in range(60):
        plain = draft(0, number).written()
        if not accepted(plain, tmp_path):
            continue
        made = draft(0, number)
        made.lengthen(list(made.stages)[-1], 10.0)
        made.soften(0.96)
        made.gain_factor = 0.96
        altered += made.written() != plain
        load_text(made.written(), "task.yaml", base=tmp_path)
    assert altered > 50


def test_a_number_is_scaled_as_one_writes_it() -> None:
    assert scaled("-20 mm/s * smooth(t)", 0.1) == "-2 mm/s * smooth(t)"
    assert scaled("rigid", 0.1) == "rigid"


def test_a_file_is_run_and_judged_as_those_of_the_other_generator() -> None:
    number = next(n for n in range(99) if draft(0, n).kind == "planar" and not draft(0, n).slip)
    row = row_of("language", 0, number)
    assert row["scene"] == "planar"
    assert row["clock"] > 0
    assert row["end"] not in ("crashed", "refused")
