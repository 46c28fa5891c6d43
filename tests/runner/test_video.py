"""Runs as pictures: what is where in them, and what is said where none can be drawn."""

from __future__ import annotations

import io
import os
import platform
import resource
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from sealed import seal_folder
from short_tasks import DRUM, TAP
from typer.testing import CliRunner, Result

from taskspec.spec import load_text
from taskspec_runner import headless
from taskspec_runner.cli import app
from taskspec_runner.errors import InputError
from taskspec_runner.report import write_report
from taskspec_runner.runs import Run
from taskspec_runner.session import execute
from taskspec_runner.video import canvas as canvases
from taskspec_runner.video import film as films
from taskspec_runner.video.canvas import Canvas, NoCanvasError, new_context
from taskspec_runner.video.film import Clip, Film, check_video, write_video
from taskspec_runner.video.picture import Pictures, project
from taskspec_runner.video.recording import Recording, steadiest_contact
from taskspec_runner.video.still import MOST_BYTES, render_still
from taskspec_runner.video.world import RecordedWorld

TASKS = Path(__file__).parents[2] / "tasks"
SMALL = Clip(width=480, height=270, fps=10)
Picture = NDArray[np.uint8]


@pytest.fixture(scope="module")
def drum(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return folder_of(DRUM, tmp_path_factory.mktemp("drum") / "run")


@pytest.fixture(scope="module")
def wall(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return folder_of(TAP, tmp_path_factory.mktemp("wall") / "run")


def folder_of(text: str, out: Path) -> Path:
    return execute(load_text(text, "task.yaml"), out, report=False).folder


@pytest.fixture
def gl(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    try:
        new_context(16, 16).free()
    except NoCanvasError as error:
        pytest.skip(str(error))


@pytest.fixture
def no_gl(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """A machine without OpenGL; which kinds were tried."""
    tried: list[str] = []

    def missing(name: str) -> Any:
        tried.append(name)
        raise AttributeError("'NoneType' object has no attribute 'glGetError'")

    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(canvases, "_context_class", missing)
    monkeypatch.setattr(canvases.platform, "system", lambda: "Linux")
    return tried


def call(*args: str | Path) -> Result:
    result = CliRunner().invoke(app, [str(arg) for arg in args])
    assert "Traceback" not in result.output
    return result


def at(picture: Picture, pixel: NDArray[np.float64]) -> list[int]:
    """Median colour of 3 x 3 pixels: an edge is no wider."""
    x, y = (round(float(v)) for v in pixel)
    return [int(v) for v in np.median(picture[y - 1 : y + 2, x - 1 : x + 2], axis=(0, 1))]


# what a picture shows


@pytest.fixture
def drawn(drum: Path, gl: None) -> Iterator[tuple[Pictures, Picture, int]]:  # noqa: ARG001
    recording = Recording.of(Run(drum))
    row = steadiest_contact(recording)
    pictures = Pictures(RecordedWorld(recording), 960, 420)
    yield pictures, pictures.draw(row), row
    pictures.close_canvas()


def test_arrows_have_their_colours_where_they_are(drawn: tuple[Pictures, Picture, int]) -> None:
    pictures, picture, row = drawn
    arms = {arm.name: arm for arm in pictures.marks[1].arms(row)}
    assert [arms[a].kind for a in "xyz"] == ["motion", "motion", "force"]
    scene, width = pictures.canvas.scene, 960 - round(0.62 * 960)
    right = picture[:, -width:]

    def along(name: str, share: float) -> list[int]:
        arm = arms[name]
        point = arm.start + share * (arm.end - arm.start)
        return at(right, project(scene, point[None], (width, 420))[0])

    # The head begins at about 0.7 of an arrow; marks that are hidden shine through by half.
    red, green, blue = along("z", 0.85)
    assert red > 1.5 * max(green, blue)
    red, green, blue = along("x", 0.85)
    assert blue > 1.5 * red
    applied = next(arm for arm in arms.values() if arm.kind == "applied")
    red, green, blue = along(applied.name, 0.9)
    assert red > 1.2 * blue
    assert green > 1.1 * blue
    # MuJoCo draws arrows at half the length that it is told: this one ends where it should.
    red, green, blue = along(applied.name, 1.25)
    assert red < 1.1 * blue


def test_force_is_what_the_robot_applies(drawn: tuple[Pictures, Picture, int]) -> None:
    pictures, _, row = drawn
    recording = pictures.marks[0].recording
    applied = pictures.marks[0].arms(row)[-1]
    # Down on the drum, whose normal at the top is the world's z.
    assert applied.end[2] < applied.start[2]
    force = recording.history.columns["force.z"][row]
    assert recording.visit(row).stage == "follow"
    assert float(applied.name.removesuffix(" N")) == pytest.approx(-force, abs=0.06)


@pytest.mark.usefixtures("gl")
def test_the_arm_is_in_the_picture(drum: Path) -> None:
    recording = Recording.of(Run(drum))
    world = RecordedWorld(recording)
    pictures = Pictures(world, 480, 210)
    pictures.close_canvas()
    model, data = world.model, world.show(0)
    with Canvas(model, 300, 210) as canvas:
        canvas.update(data, pictures.view.camera())
        whole = np.array(canvas.render())
        for name in ("link1", "link3", "link5"):
            geoms = np.flatnonzero(model.geom_bodyid == model.body(name).id)
            colors, materials = model.geom_rgba[geoms], model.geom_matid[geoms]
            places = project(canvas.scene, data.geom_xpos[geoms], (300, 210))
            assert ((places > 0) & (places < [300, 210])).all()
            model.geom_rgba[geoms, 3] = 0.0
            model.geom_matid[geoms] = -1
            canvas.update(data, pictures.view.camera())
            # What lies behind a link is seen where the link was, of another white here and there.
            changed = np.any(whole != np.array(canvas.render()), axis=-1)
            assert np.count_nonzero(changed) > 100, name
            model.geom_rgba[geoms], model.geom_matid[geoms] = colors, materials


@pytest.mark.usefixtures("gl")
def test_frames_are_deterministic(wall: Path) -> None:
    def frames() -> bytes:
        with Film(Recording.of(Run(wall)), SMALL) as film:
            return b"".join(frame.tobytes() for frame in film.frames())

    assert frames() == frames()


def test_loose_bodies_are_where_they_were(tmp_path: Path) -> None:
    text = """\
taskspec: 1
name: shove
robot: {model: panda, tool: {shape: sphere, radius: 10 mm}, start: {xyz: [450 mm, 0, 330 mm]}}
world:
  table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 20 kN/m, friction: 0.1}
  ball: {shape: sphere, xyz: [500 mm, 0, 330 mm], radius: 30 mm, free: true, mass: 200 g}
stages:
  shove: {axes: {x: {move: 60 mm, speed: 100 mm/s}}}
"""
    recording = Recording.of(Run(folder_of(text, tmp_path / "run")))
    world, gaps = RecordedWorld(recording), recording.history.columns["ball.gap"]
    joint = world.model.joint("world/ball").qposadr[0]
    places = []
    for row in range(0, len(recording), 50):
        place = world.show(row).qpos[joint : joint + 3].copy()
        R = world.data.body(recording.program.context.robot.tip_body).xmat.reshape(3, 3)
        ball = recording.tip[row] - 0.010 * R[:, 2]
        # The plant is the same and so is the arm; what is left is rounding.
        assert np.linalg.norm(ball - place) - 0.040 == pytest.approx(gaps[row], abs=1e-9)
        places.append(place[0])
    assert places[-1] > places[0] + 0.02


def test_mechanisms_and_moving_planes(tmp_path: Path) -> None:
    text = """\
taskspec: 1
name: turn
robot: {model: panda, grasp: crank.handle}
world:
  crank: {mechanism: hinge, xyz: [500 mm, 0, 350 mm], handle: [120 mm, 0, 0], knob: free}
  belt: {shape: plane, xyz: [0, 0, 100 mm], motion: {x: 50 mm/s * clock}}
frame: crank.handle
stages:
  rotate: {axes: {y: {velocity: 100 mm/s}, rz: {hold: world}}, time: 0.5 s}
"""
    recording = Recording.of(Run(folder_of(text, tmp_path / "run")))
    world = RecordedWorld(recording)
    first = world.show(0).geom("world/belt/slab").xpos.copy()
    data = world.show(len(recording) - 1)
    # 50 kN/m hold the tip at the handle: less than 1 mm below 50 N.
    assert np.linalg.norm(data.body("world/crank/knob").xpos - recording.tip[-1]) < 1e-3
    assert np.linalg.norm(recording.tip[-1] - recording.tip[0]) > 0.02
    moved = data.geom("world/belt/slab").xpos - first
    assert moved == pytest.approx([0.05 * float(recording.clock[-1]), 0, 0], abs=1e-9)


@pytest.mark.usefixtures("gl")
def test_a_still_shows_the_press(wall: Path) -> None:
    recording = Recording.of(Run(wall))
    row = steadiest_contact(recording)
    assert recording.visit(row).stage == "hold"
    # Of the 0.3 s of the stage, 0.05 s are the ramp.
    assert np.linalg.norm(recording.force[row]) == pytest.approx(5.0, abs=0.5)
    png = render_still(Run(wall))
    assert len(png) < MOST_BYTES
    assert Image.open(io.BytesIO(png)).size == (1120, 490)


@pytest.mark.usefixtures("gl")
def test_the_report_has_the_still(wall: Path) -> None:
    text = write_report(Run(wall)).read_text(encoding="utf-8")
    assert '<img src="data:image/png;base64,' in text
    assert "The arm" in text


# videos


@pytest.mark.usefixtures("gl")
def test_video_has_as_many_frames_as_the_run_is_long(wall: Path, tmp_path: Path) -> None:
    recording = Recording.of(Run(wall))
    told: list[tuple[int, int]] = []
    path = tmp_path / "out.mp4"
    write_video(recording, path, SMALL, lambda done, frames: told.append((done, frames)))
    frames = int(np.ceil(recording.end * 10 - 1e-9))
    assert told == [(i + 1, frames) for i in range(frames)]
    assert imageio_ffmpeg.count_frames_and_secs(str(path))[0] == frames
    reader = imageio_ffmpeg.read_frames(str(path))
    about = next(reader)
    reader.close()
    assert about["size"] == (480, 270)
    assert about["fps"] == 10
    assert [p.name for p in tmp_path.iterdir()] == ["out.mp4"]


@pytest.mark.parametrize(
    ("cut", "clocks"),
    [
        (Clip(start=0.1, end=0.3, fps=10), [0.1, 0.2]),
        (Clip(start=0.1, end=0.3, fps=10, speed=0.5), [0.1, 0.15, 0.2, 0.25]),
        (Clip(start=-5.0, end=0.15, fps=10), [0.0, 0.1]),
    ],
)
def test_cuts(wall: Path, cut: Clip, clocks: list[float]) -> None:
    recording = Recording.of(Run(wall))
    assert cut.clocks(recording) == pytest.approx(clocks)
    # A tick holds until the next: rounding of the frame's time must not miss it.
    assert [recording.row(c) for c in clocks] == [round(c * 1000) for c in clocks]


def test_nothing_to_cut(wall: Path) -> None:
    with pytest.raises(InputError, match=r"nothing to show: the log goes from 0 to 0\.\d+ s"):
        Clip(start=99.0).clocks(Recording.of(Run(wall)))


@pytest.mark.usefixtures("gl")
def test_killed_runs_are_drawn_to_the_end_of_their_log(drum: Path, tmp_path: Path) -> None:
    whole = Recording.of(Run(drum))
    assert len(whole) > 500
    cut = tmp_path / "killed"
    cut.mkdir()
    for name in ("task.yaml", "manifest.json"):
        (cut / name).write_bytes((drum / name).read_bytes())
    log = (drum / "log.arrow").read_bytes()
    # A little less than the last batch, which is all that a killed run loses.
    (cut / "log.arrow").write_bytes(log[: int(0.9 * len(log))])
    seal_folder(cut, status="running")
    recording = Recording.of(Run(cut))
    assert len(recording) == 500
    with Film(recording, SMALL) as film:
        assert len(list(film.frames())) == len(film.rows) == 5


def test_overrides_and_files_beside_the_task_are_found_again(tmp_path: Path) -> None:
    beside = tmp_path / "there"
    beside.mkdir()
    task = beside / "tap.yaml"
    task.write_text(TAP, encoding="utf-8")
    result = call("run", task, "--out", tmp_path / "run", "--set", "params.press=8N", "-q")
    assert result.exit_code in (0, 1)
    recording = Recording.of(Run(tmp_path / "run"))
    loaded = recording.program.context.loaded
    assert loaded.task.params["press"].value == 8.0
    assert loaded.base == beside.absolute()


# the command line


@pytest.mark.usefixtures("gl")
def test_run_with_video(tap: Path, tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.chdir(tmp_path)
    seen: list[Recording] = []
    monkeypatch.setattr(films, "write_video", lambda recording, *_: seen.append(recording))
    assert call("run", tap, "--video", "out.mp4", "--out", "run", "-q").exit_code == 0
    assert len(seen) == 1


@pytest.mark.usefixtures("gl")
def test_replay_writes_a_video(wall: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.mp4"
    size = ("--size", "320x180", "--fps", "5", "--camera", "90,-30,2", "--to", "0.4")
    result = call("replay", wall, "--video", out, *size)
    assert (result.exit_code, result.stdout) == (0, f"{out}\n")
    assert imageio_ffmpeg.count_frames_and_secs(str(out))[0] == 2


@pytest.mark.usefixtures("gl")
@pytest.mark.parametrize("room", [1000, 8192])
def test_encoder_that_fails_is_an_error_and_leaves_the_old_video(
    room: int, wall: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out.mp4"
    out.write_bytes(b"old")

    def limit() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))

    # Without -B, Python would leave half a file of what it compiles, too.
    command = [sys.executable, "-B", "-m", "taskspec_runner", "replay", wall, "--video", out]
    said = subprocess.run(
        [*command, "--size", "640x360", "--fps", "10"],
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=limit,
    )
    assert said.returncode == 2
    assert said.stderr.startswith(f"taskspec: cannot write {out}: the encoder failed with code ")
    assert said.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["out.mp4"]
    assert out.read_bytes() == b"old"


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--video", "x.txt"), "x.txt is not the name of a video; it ends in .mp4, .mkv, .mov"),
        (("--video", "nowhere/x.mp4"), "cannot write nowhere/x.mp4: there is no folder"),
        (("--video", "x.mp4", "--view"), "give one of --video, --view and --web"),
        (("--video", "x.mp4", "--size", "big"), "--size needs two even numbers of pixels"),
        (("--video", "x.mp4", "--size", "321x201"), "--size needs two even numbers of pixels"),
        (("--video", "x.mp4", "--fps", "0"), "--fps is from 1 to 240, not 0"),
        (("--video", "x.mp4", "--speed", "-1"), "--speed is from 0.001 to 1000, not -1"),
        (("--video", "x.mp4", "--from", "nan"), "--from needs a time in seconds, not nan"),
        (("--video", "x.mp4", "--camera", "1,2"), "--camera needs azimuth and elevation"),
        (("--video", "x.mp4", "--camera", "1,2,nan"), "--camera needs azimuth and elevation"),
    ],
)
def test_wrong_options(wall: Path, options: tuple[str, ...], told: str) -> None:
    result = call("replay", wall, *options)
    assert result.exit_code == 2
    assert told in result.stderr


def test_no_run_to_replay(tmp_path: Path) -> None:
    result = call("replay", tmp_path, "--video", "x.mp4")
    assert result.exit_code == 2
    assert f"cannot read {tmp_path}: it is not the folder of a run" in result.stderr


def test_an_empty_log_is_told(wall: Path, tmp_path: Path) -> None:
    (tmp_path / "task.yaml").write_bytes((wall / "task.yaml").read_bytes())
    (tmp_path / "log.arrow").write_bytes(b"")
    with pytest.raises(InputError, match="its log holds no complete batch of ticks"):
        Recording.of(Run(tmp_path))


# without OpenGL, without ffmpeg


def test_without_opengl_it_is_said_what_to_install(
    wall: Path, no_gl: list[str], tmp_path: Path
) -> None:
    result = call("replay", wall, "--video", tmp_path / "x.mp4")
    assert result.exit_code == 2
    assert no_gl == ["egl", "osmesa"]
    assert "EGL: its library is not there; OSMesa: its library is not there" in result.stderr
    assert "apt-get install libegl1" in result.stderr


def test_without_opengl_a_run_with_video_does_not_begin(
    tap: Path, no_gl: list[str], tmp_path: Path
) -> None:
    out = tmp_path / "run"
    result = call("run", tap, "--out", out, "--video", tmp_path / "x.mp4")
    assert result.exit_code == 2
    assert no_gl
    assert not out.exists()


def test_without_opengl_reports_have_no_still(wall: Path, no_gl: list[str]) -> None:
    text = write_report(Run(wall)).read_text(encoding="utf-8")
    assert no_gl
    assert "<img" not in text
    # The scene needs no OpenGL here; where a browser has none either, its figure stays hidden.
    assert '<figure class="still arm" hidden' in text


def test_drawing_can_be_switched_off(
    wall: Path, no_gl: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MUJOCO_GL", "disable")
    with pytest.raises(NoCanvasError, match="MUJOCO_GL switches drawing off"):
        new_context(16, 16)
    write_report(Run(wall))
    assert not no_gl


def test_the_kind_that_is_asked_for_is_the_only_one(
    no_gl: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    with pytest.raises(NoCanvasError):
        new_context(16, 16)
    assert no_gl == ["osmesa"]


@pytest.mark.usefixtures("gl")
def test_a_kind_that_fails_does_not_keep_the_next_from_working(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tried, real = [], canvases._context_class

    def fragile(name: str) -> Any:
        tried.append(name)
        if len(tried) == 1:
            os.environ["PYOPENGL_PLATFORM"] = "osmesa"
            raise AttributeError("no library")
        return real(name)

    monkeypatch.setattr(canvases, "_context_class", fragile)
    monkeypatch.setattr(canvases, "backends", lambda: ("osmesa", "egl"))
    before = os.environ.get("PYOPENGL_PLATFORM")
    new_context(16, 16).free()
    assert tried == ["osmesa", "egl"]
    assert os.environ.get("PYOPENGL_PLATFORM") in (before, "egl")


@pytest.mark.skipif(platform.system() != "Linux", reason="MuJoCo has its own ways elsewhere")
@pytest.mark.parametrize("asked", ["", "osmesa"])
def test_mujoco_loads_no_opengl_that_nothing_needs(asked: str, tmp_path: Path) -> None:
    """OSMesa is rarely there, and GLFW takes a twentieth of a second to load."""
    script = (
        "import sys, atexit; atexit.register(lambda: print(*sys.modules)); "
        "from taskspec_runner.cli import main; main()"
    )
    # A robot that is kept is not looked at by MuJoCo again.
    environment = {**os.environ, "MUJOCO_GL": asked, "TASKSPEC_CACHE": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", script, "validate", TASKS / "press-pd.yaml"],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    loaded = done.stdout.split()
    assert "mujoco" in loaded
    assert not {"glfw", "OpenGL", "mujoco.egl", "mujoco.osmesa"} & set(loaded)


def test_what_is_set_aside_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(headless.platform, "system", lambda: "Linux")
    monkeypatch.setenv("MUJOCO_GL", "EGL ")
    # Set and taken away, so that it is away again afterwards.
    monkeypatch.setenv("TASKSPEC_GL", "")
    monkeypatch.delenv("TASKSPEC_GL")
    for _ in range(2):
        headless.set_aside()
        assert os.environ["MUJOCO_GL"] == "disable"
        assert headless.wanted_library() == "egl"
    assert canvases.backends()[-1] in ("egl", "")


def test_without_ffmpeg_it_is_said_what_to_install(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def missing() -> str:
        raise RuntimeError("No ffmpeg exe could be found.")

    monkeypatch.setattr(imageio_ffmpeg, "get_ffmpeg_exe", missing)
    with pytest.raises(InputError, match="there is no ffmpeg; install imageio-ffmpeg"):
        check_video(tmp_path / "x.mp4")


@pytest.mark.usefixtures("gl")
def test_projection_of_the_point_that_is_looked_at() -> None:
    model = mujoco.MjModel.from_xml_string("<mujoco><worldbody/></mujoco>")
    data = mujoco.MjData(model)
    camera = mujoco.MjvCamera()
    camera.lookat[:], camera.distance = (0.3, -0.2, 0.1), 1.5
    with Canvas(model, 64, 48) as canvas:
        canvas.update(data, camera)
        pixel = project(canvas.scene, np.array([[0.3, -0.2, 0.1]]), (64, 48))[0]
    # The scene has single precision.
    assert pixel == pytest.approx([32, 24], abs=1e-3)
