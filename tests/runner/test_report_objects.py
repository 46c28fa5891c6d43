"""What reports show of mechanisms and equations, and which force their picture shows."""

from __future__ import annotations

from pathlib import Path

from typer.testing import CliRunner

from taskspec_runner.cli.app import app
from taskspec_runner.report.figures import sections
from taskspec_runner.report.overview import overview_svg
from taskspec_runner.report.page import render
from taskspec_runner.runs import Run

TASKS = Path(__file__).parents[2] / "tasks"
ROBOT = "taskspec: 1\nrobot: {model: planar3, start: {xyz: [400 mm, 200 mm, 0], rpy: [0, 0, 0]}}\n"
CONSTRAINED = (
    ROBOT
    + """world:
  bars: {equation: q1 + q2 + q3 = 0}
  line: {equation: y = 200 mm}
law: hybrid-multipliers
stages:
  load: {constraints: {bars: {torque: 0.5 N*m}, line: {force: 4 N}}, time: 50 ms}
"""
)
SCREW = """taskspec: 1
robot: {model: panda, grasp: cap.handle}
world: {cap: {mechanism: screw, xyz: [500 mm, 0, 300 mm], pitch: 4 mm/turn}}
frame: cap
stages:
  drive: {axes: {z: {follows: cap}, rz: {velocity: 60 deg/s}}, time: 0.2 s}
expect: [last(cap.angle) > 1 deg]
"""


def reported(tmp_path: Path, text: str) -> Run:
    path = tmp_path / "task.yaml"
    path.write_text(text, encoding="utf-8")
    result = CliRunner().invoke(app, ["run", str(path), "--out", str(tmp_path / "run")])
    assert result.exit_code == 0, result.output
    return Run(tmp_path / "run")


def charts(run: Run) -> dict[str, tuple[str, str, list[str]]]:
    """Title, unit and signals of every chart, by its key."""
    return {
        chart.key: (chart.title, chart.unit, [t.signal for t in chart.traces])
        for part in sections(run)
        for chart in part.charts
    }


def test_a_mechanism_is_drawn_with_its_coordinate_and_effort(tmp_path: Path) -> None:
    run = reported(tmp_path, SCREW)
    found = charts(run)
    assert found["mechanism angle"] == ("Angle", "deg", ["cap.angle"])
    assert found["mechanism travel"] == ("Travel along the axis", "mm", ["cap.travel"])
    assert found["mechanism torque"][2] == ["cap.torque"]
    # The robot's own `travel` and the contact's `force` are no mechanism's.
    assert "mechanism force" not in found
    assert "<dd>cap</dd>" in render(run).replace("\n", "").replace(" ", "")


def test_distances_from_equations_have_their_own_units_and_no_inside(tmp_path: Path) -> None:
    run = reported(tmp_path, CONSTRAINED)
    found = charts(run)
    title = "Distance from the constraints"
    assert found["gap"][0] == title
    assert found["gap"][2] == ["line.gap"]
    assert found["gap of joints"][0] == title
    assert found["gap of joints"][2] == ["bars.gap"]
    assert run.units["bars.gap"] == "rad"
    assert found["gap of joints"][1] in ("deg", "mdeg", "µdeg")
    notes = {chart.key: chart.note for part in sections(run) for chart in part.charts}
    assert notes["gap"] == notes["gap of joints"] == ""


def test_the_picture_shows_the_largest_set_point_where_no_band_chooses(tmp_path: Path) -> None:
    shipped = (TASKS / "tilted-force.yaml").read_text(encoding="utf-8")
    text = shipped.partition("expect:")[0].replace("time: 4 s", "time: 0.3 s")
    assert text != shipped.partition("expect:")[0]
    assert "Force z" in overview_svg(reported(tmp_path, text))
    banded = text + "expect: [press.force.x within 0 N..5 N]\n"
    (tmp_path / "run").rename(tmp_path / "first")
    assert "Force x" in overview_svg(reported(tmp_path, banded))
