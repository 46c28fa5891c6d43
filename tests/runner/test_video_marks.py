"""What is shown beside the arm, and what a window would show; no OpenGL is needed for it."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from short_tasks import DRUM, TAP
from typer.testing import CliRunner

from taskspec.program.world.equations import equation_models
from taskspec.spec import load_text
from taskspec_runner.cli import app
from taskspec_runner.errors import InputError
from taskspec_runner.runs import Run
from taskspec_runner.session import execute
from taskspec_runner.video import viewer
from taskspec_runner.video.camera import axes_of, close_view, frame_run
from taskspec_runner.video.equations import DrawnSurface, equation_surfaces
from taskspec_runner.video.film import Clip
from taskspec_runner.video.marks import Marks
from taskspec_runner.video.panel_force import panel_forces
from taskspec_runner.video.recording import Recording
from taskspec_runner.video.viewer import Show
from taskspec_runner.video.world import RecordedWorld, bare_links

RAIL = """\
taskspec: 1
name: rail
robot: {model: panda, start: {xyz: [540 mm, 0, 350 mm]}}
frames: {rail: {xyz: [450 mm, 0, 350 mm], rpy: [0, 0, 20 deg]}}
world:
  rim: {equation: "x^2 + y^2 = (90 mm)^2", frame: rail, stiffness: 50 kN/m, damping: 100 N*s/m}
  level: {equation: "z = 0", frame: rail, stiffness: 50 kN/m, damping: 100 N*s/m}
  OTHER
frame: rail
law: hybrid-multipliers
stages:
  wait: {time: 50 ms}
  press: {constraints: {rim: {force: 10 N}}, time: 0.1 s}
"""

TIP = np.array([[0.54, 0.0, 0.35], [0.36, 0.0, 0.35]])


@pytest.fixture
def record(tmp_path: Path) -> Callable[[str], Recording]:
    def run(text: str) -> Recording:
        return Recording.of(Run(execute(load_text(text, "task.yaml"), tmp_path / "run").folder))

    return run


@pytest.fixture
def tapped(record: Callable[[str], Recording]) -> Recording:
    return record(TAP)


Record = Callable[[str], Recording]


# equations


def surfaces(other: str) -> list[DrawnSurface]:
    task = load_text(RAIL.replace("OTHER", other), "task.yaml").task
    return equation_surfaces(equation_models(task).values(), TIP)


def test_simple_equations_have_surfaces() -> None:
    rim, level = surfaces("")
    assert rim.kind == mujoco.mjtGeom.mjGEOM_CYLINDER
    assert rim.size[:2] == pytest.approx([0.09, 0.09], rel=1e-9)
    assert rim.center[:2] == pytest.approx([0.45, 0.0], abs=1e-9)
    assert abs(rim.rotation[2, 2]) == pytest.approx(1.0)
    assert level.kind == mujoco.mjtGeom.mjGEOM_BOX
    assert level.center[2] == pytest.approx(0.35, abs=1e-9)
    assert abs(level.rotation[2, 2]) == pytest.approx(1.0)
    assert np.linalg.det(rim.rotation) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("equation", "kind"),
    [
        ("(x - 1 m)^2 + y^2 + z^2 >= (300 mm)^2", "mjGEOM_SPHERE"),
        ("z >= -1 m + 20 mm * sin(2*pi*clock/(1 s))", None),
        ("x^2 + 2*y^2 >= (1 mm)^2", None),
        ("z >= -1 m + x*y*z/(1 m)^2", None),
        ("x^2 + y^2 >= -(50 mm)^2", None),
    ],
)
def test_other_equations_are_left_out(equation: str, kind: str | None) -> None:
    other = f'other: {{equation: "{equation}", frame: rail, stiffness: 10 kN/m}}'
    found = surfaces(other)[2:]
    assert [s.kind.name for s in found] == ([] if kind is None else [kind])
    if kind is not None:
        assert found[0].size == pytest.approx([0.3] * 3, rel=1e-9)


# forces and paths


def test_forces_shown_are_those_with_set_points(record: Record, tapped: Recording) -> None:
    approach, hold = panel_forces(tapped)
    assert (approach.name, approach.wanted) == ("force.x", None)
    assert hold.name == "force.x"
    row = hold.visit.last
    force = tapped.history.columns["force.x"][row]
    assert hold.text(row) == f"{force:.2f} of 5.00 N"
    _, press = panel_forces(record(RAIL.replace("OTHER", "")))
    assert press.name == "rim.force"
    assert press.unit == "N"


def test_a_set_point_of_zero_is_nothing_to_look_at(record: Record) -> None:
    shown = panel_forces(record(TAP.replace("force: press, ramp", "force: 0 N, ramp")))
    assert [each.name for each in shown] == ["norm(force)", "norm(force)"]


def test_of_a_held_mechanism_its_effort_is_shown(record: Record) -> None:
    text = """\
taskspec: 1
name: turn
robot: {model: panda, grasp: crank.handle}
world: {crank: {mechanism: hinge, xyz: [500 mm, 0, 350 mm], handle: [120 mm, 0, 0]}}
frame: crank.handle
stages: {rotate: {axes: {y: {velocity: 50 mm/s}, rz: {follows: crank}}, time: 0.1 s}}
"""
    (shown,) = panel_forces(record(text))
    assert (shown.name, shown.unit, shown.wanted) == ("crank.torque", "N m", None)


def test_the_reference_is_a_point_of_the_world(record: Record) -> None:
    recording = record(DRUM)
    stage = recording.visits[0]
    assert stage.stage == "fixed"
    for i, axis in enumerate("xyz"):
        wanted = recording.history.columns[f"position.{axis}.ref"][stage.rows]
        good = np.isfinite(wanted)
        assert recording.wanted[stage.rows][good, i] == pytest.approx(wanted[good], abs=1e-12)
    # With good laws the tool is where it should be, in a frame that turns as well.
    away = np.linalg.norm(recording.wanted - recording.point, axis=1)
    assert away.max() < 2e-3


def test_the_longest_arrow_fits_and_small_forces_have_none(tapped: Recording) -> None:
    marks = Marks(RecordedWorld(tapped))
    arms = marks.arms(len(tapped) - 1)
    assert [(a.name, a.kind) for a in arms[:2]] == [("x", "force"), ("y", "motion")]
    assert np.linalg.norm(arms[-1].end - arms[-1].start) < 0.24
    assert arms[-1].end[0] > arms[-1].start[0]
    assert all(arm.kind != "applied" for arm in marks.arms(0))


def test_the_way_of_the_tool_grows(tapped: Recording) -> None:
    world, counts = RecordedWorld(tapped), []
    marks, scene = Marks(world), mujoco.MjvScene(world.model, maxgeom=2000)
    for row in (0, len(tapped) // 2, len(tapped) - 1):
        world.show(row)
        scene.ngeom = 0
        marks.draw(scene, row)
        counts.append(scene.ngeom)
    assert counts == sorted(counts)
    assert counts[0] < counts[-1]


def test_a_full_scene_takes_no_more(tapped: Recording) -> None:
    world = RecordedWorld(tapped)
    scene = mujoco.MjvScene(world.model, maxgeom=2)
    Marks(world).draw(scene, len(tapped) - 1)
    assert scene.ngeom == 2


# the camera


@pytest.mark.parametrize("text", [TAP, DRUM])
def test_the_camera_has_the_action_in_its_picture(record: Record, text: str) -> None:
    world = RecordedWorld(record(text))
    aspect = 1.4
    view = frame_run(world).view(world.model, aspect)
    axes = axes_of(view.azimuth, view.elevation)
    eye = np.array(view.lookat) + view.distance * axes[2]
    points = np.vstack([world.recording.point, np.zeros((1, 3))])
    seen = (points - eye) @ axes.T
    half = np.tan(np.radians(world.model.vis.global_.fovy) / 2)
    place = seen[:, :2] / -seen[:, 2:] / (half * np.array([aspect, 1.0]))
    assert (seen[:, 2] < 0).all()
    assert np.abs(place).max() < 1.0
    near = close_view(world, view, 0.9)
    rows = [0, len(points) // 2, len(points) - 2]
    for row in rows:
        away = np.linalg.norm(np.array(near.at(row).lookat) - world.recording.point[row])
        assert away < 0.1


def test_the_close_view_goes_where_nothing_hides_the_tool(record: Record) -> None:
    world = RecordedWorld(record(DRUM))
    view = frame_run(world).view(world.model, 1.3)
    usual = close_view(world, view, 0.9)
    model, tip = world.model, world.recording.point.mean(axis=0)
    assert (usual.view.azimuth, usual.view.elevation) == (view.azimuth, view.elevation)
    # The drum is put between the camera and the tool, as a part of an arm would be.
    drum = model.geom("world/drum").id
    back = axes_of(view.azimuth, view.elevation)[2]
    model.geom_pos[drum] = tip + 0.5 * usual.view.distance * back
    model.geom_size[drum] = [0.06, 0.06, 0.06]
    model.geom_rbound[drum] = 0.11
    moved = close_view(world, view, 0.9)
    assert (moved.view.azimuth, moved.view.elevation) != (view.azimuth, view.elevation)
    # From there the drum is beside the line of sight.
    sight = axes_of(moved.view.azimuth, moved.view.elevation)[2]
    off = model.geom_pos[drum] - tip
    assert np.linalg.norm(off - (off @ sight) * sight) > 0.06


def test_what_is_drawn_for_bare_links_does_not_cover_the_tool() -> None:
    chain = """
    <mujoco><worldbody><body name="upper"><geom size="0.02"/>
      <body name="wrist" pos="0 0 .1"><body name="flange" pos="0 0 .1">TIP</body></body>
    </body></worldbody></mujoco>"""
    tool = '<body name="tip" pos="0 0 .12"><geom size="0.01"/></body>'
    links = {}
    for name, tip in (("with", tool), ("without", tool.replace('<geom size="0.01"/>', ""))):
        model = mujoco.MjModel.from_xml_string(chain.replace("TIP", tip))
        pairs = bare_links(model, "tip")
        links[name] = [tuple(model.body(b).name for b in pair) for pair in pairs]
    assert links["with"] == [("wrist", "flange")]
    # A tip that nothing shows is joined to its flange.
    assert links["without"] == [("flange", "tip"), ("wrist", "flange")]


# the window


class Window:
    """What MuJoCo's handle of a window offers, for a few rounds."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self.cam, self.user_scn = mujoco.MjvCamera(), mujoco.MjvScene(model, maxgeom=2000)
        self.texts: list[tuple[Any, ...]] = []
        self.geoms: list[int] = []

    def is_running(self) -> bool:
        return len(self.geoms) < 3

    def lock(self) -> contextlib.AbstractContextManager[None]:
        return contextlib.nullcontext()

    def set_texts(self, texts: tuple[Any, ...]) -> None:
        self.texts.append(texts)

    def sync(self) -> None:
        self.geoms.append(self.user_scn.ngeom)


def test_a_window_shows_the_run(tapped: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    windows = []

    @contextlib.contextmanager
    def open_window(world: RecordedWorld) -> Iterator[Window]:
        windows.append(Window(world.model))
        yield windows[0]

    monkeypatch.setattr(viewer, "_window", open_window)
    monkeypatch.setattr(viewer, "check_display", lambda: None)
    viewer.view(tapped, Clip(camera=(90.0, -30.0, 2.0)))
    (window,) = windows
    assert (window.cam.azimuth, window.cam.elevation, window.cam.distance) == (90, -30, 2)
    assert min(window.geoms) > 3
    assert window.texts[0][2] == "time\nstage\nforce.x"
    assert "approach" in window.texts[0][3]


def test_a_window_begins_anew(tapped: Recording) -> None:
    show = Show(tapped, Clip(start=0.1, end=0.3, speed=0.5, fps=100))
    assert [show.row(t) for t in (0.0, 0.2, 0.39, 0.4)] == [100, 200, 295, 100]


def test_without_a_screen_it_is_said_what_to_do(
    tapped: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert len(tapped)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(viewer.platform, "system", lambda: "Linux")
    result = CliRunner().invoke(app, ["replay", str(tmp_path / "run"), "--view"])
    assert result.exit_code == 2
    assert "cannot open a window: there is no screen" in result.stderr
    assert "taskspec replay RUN --web serves a page" in result.stderr


def test_a_mac_needs_its_own_launcher(tapped: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    import mujoco.viewer

    def refuse(*_: object, **__: object) -> None:
        raise RuntimeError("`launch_passive` requires that the Python script be run under mjpython")

    monkeypatch.setattr(mujoco.viewer, "launch_passive", refuse)
    monkeypatch.setattr(viewer.platform, "system", lambda: "Darwin")
    with pytest.raises(InputError, match="mjpython -m taskspec_runner replay RUN --view"):
        viewer.view(tapped, Clip())
