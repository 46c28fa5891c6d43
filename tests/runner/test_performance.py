"""What the summary of a real run has beside its verdict."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from short_tasks import TAP

from taskspec.compiler import compile_task
from taskspec.spec import load_text
from taskspec_runner.session import execute_program


def summary(folder: Path, text: str = TAP, **overrides: str) -> dict[str, Any]:
    program = compile_task(load_text(text, "tap.yaml", overrides=overrides))
    result = execute_program(program, folder, report=False)
    found: dict[str, Any] = json.loads((result.folder / "summary.json").read_text())
    return found


@pytest.fixture(scope="module")
def tap_summary(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return summary(tmp_path_factory.mktemp("performance") / "run")


def test_the_response_of_a_press(tap_summary: dict[str, Any]) -> None:
    found = tap_summary["responses"]["hold"]["force.x"]
    assert found["set_point"] == 5.0
    assert found["target"] == "set point"
    # What the task expects of the last value; 0.3 s do not bring it to 2 %.
    assert found["rest"] == pytest.approx(5.0, abs=0.5)
    assert abs(found["rest"] - 5.0) > 0.1
    assert found["settling_time"] is None
    # `hold.force.x within 0..7 N` bounds it, from far away.
    assert found["settled_within"] == "2 %"
    assert found["below"] == found["above"] == pytest.approx(0.02 * 5.0)
    # What moves freely has no response.
    assert "approach" not in tap_summary["responses"]
    assert tap_summary["contact"] == {"hold": {"losses": 0, "time": 0.0}}


def test_closed_forms_at_rest_are_kept(tap_summary: dict[str, Any]) -> None:
    assert tap_summary["rest_values"] == {
        "approach": {},
        "hold": {"force.x": {"value": 5.0, "source": "set point"}},
    }


def test_expectations_know_their_lines(tap_summary: dict[str, Any]) -> None:
    lines = TAP.splitlines()
    for each in tap_summary["expectations"]:
        assert lines[each["line"] - 1] == f"  - {each['text']}"


def test_a_program_of_limits_is_accounted_for(tmp_path: Path) -> None:
    found = summary(tmp_path / "run", **{"law": "{kind: hybrid, solve: qp}"})["solver"]
    assert list(found) == ["approach", "hold"]
    for stage in found.values():
        assert stage["ticks"] > 0
        assert 0 <= stage["held"] <= stage["solved"] <= stage["ticks"]


def test_findings_are_kept_without_the_place_of_the_file(tmp_path: Path) -> None:
    # Without a force loop, what is pressed depends on the surface.
    text = f"{TAP}law: impedance-natural\nvary: {{world.wall.stiffness: 2..20 kN/m}}\n"
    found = summary(tmp_path / "run", text)["diagnostics"]
    (open_loop,) = [d for d in found if d["code"] == "TS304"]
    assert open_loop["severity"] == "warning"
    assert "force: press" in text.splitlines()[open_loop["line"] - 1]
    assert open_loop["source"] == ""
    assert str(tmp_path) not in json.dumps(found)
