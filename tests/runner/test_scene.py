"""The moving arm of pages: what its data are, and that a browser draws it where the log has it."""

from __future__ import annotations

import base64
import io
import json
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
from PIL import Image
from screen import DESKTOP, PHONE, shown

from browser import Browser
from taskspec.compiler import compile_task
from taskspec.spec import load_text
from taskspec_runner.report.page import render
from taskspec_runner.runs import Run
from taskspec_runner.scene import recorded
from taskspec_runner.scene.bundle import bundle, sources_stamp, stamp
from taskspec_runner.scene.meshes import Triangles, within
from taskspec_runner.scene.model import model_scene, positions
from taskspec_runner.scene.page import pictured
from taskspec_runner.session import execute_program
from taskspec_runner.video.camera import frame_arm
from taskspec_runner.video.recording import Recording
from taskspec_runner.video.world import RecordedWorld

#: A joint of every kind, none of them through the origin of its body, below a body that is put.
JOINTS = """
<mujoco>
  <worldbody>
    <body name="put" mocap="true" pos="0.1 0.2 0.3" quat="0.8 0.6 0 0"/>
    <body name="loose" pos="0 0 1">
      <freejoint/> <geom type="sphere" size="0.05"/>
      <body name="turned" pos="0.2 0 0.1" quat="0.6 0 0.8 0">
        <joint type="ball" pos="0.03 -0.02 0.05"/> <geom type="box" size="0.02 0.03 0.04"/>
        <body name="tip" pos="0 0.2 0">
          <joint type="slide" axis="1 0 1" ref="0.05"/>
          <joint type="hinge" axis="0 1 1" pos="0.1 0 -0.04" ref="0.3"/>
          <geom type="capsule" size="0.01 0.05"/>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
#: Goes to the side and down, and presses: 2 s in which the whole arm moves.
SWING = """\
taskspec: 1
name: swing
about: Carry the tool to the side and down, and press on a block.
robot: {model: panda, start: {xyz: [450 mm, -150 mm, 350 mm]}}
world:
  block: {shape: plane, xyz: [450 mm, 150 mm, 249 mm], stiffness: 10 kN/m, damping: 30 N*s/m}
stages:
  over:
    axes: {y: {move: 300 mm, speed: 400 mm/s}}
  down:
    axes: {z: {move: -96 mm, speed: 200 mm/s}}
  press:
    axes: {z: {force: -10 N}}
    time: 0.3 s
"""
#: What the page says once its scene is drawn.
LIVE = """new Promise((done, fail) => {
    const arm = document.querySelector(".arm"), end = performance.now() + 20000;
    const look = () => {
        const { without } = arm.dataset, { tip } = arm.querySelector(".view").dataset;
        if (tip || without) done(without ?? arm.className);
        else if (performance.now() > end) fail(new Error("no scene"));
        else setTimeout(look, 20);
    };
    look();
})"""
#: Moves the slider to a time, waits for the drawing, says what the scene does of itself.
AT = """new Promise((done) => {{
    const seek = document.querySelector(".seek"), view = document.querySelector(".view");
    seek.value = {time};
    seek.dispatchEvent(new Event("input"));
    requestAnimationFrame(() => setTimeout(() => done({{
        camera: JSON.parse(view.dataset.camera), tip: JSON.parse(view.dataset.tip),
        size: [view.clientWidth, view.clientHeight], time: Number(seek.value),
    }})));
}})"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = tmp_path_factory.mktemp("scene")
    program = compile_task(load_text(SWING, "swing.yaml"))
    return Run(execute_program(program, folder / "swing", report=False).folder)


@pytest.fixture(scope="module")
def report(run: Run) -> Path:
    """Its page, with a still that needs no OpenGL."""
    file = io.BytesIO()
    Image.new("RGB", (1120, 490), "tan").save(file, "png")
    still = f"data:image/png;base64,{base64.b64encode(file.getvalue()).decode()}"
    arm = pictured(run)
    assert arm is not None
    page = run.folder / "report.html"
    page.write_text(render(run, replace(arm, still=still)), encoding="utf-8")
    return page


def projected(place: np.ndarray, camera: list, size: list[int]) -> np.ndarray:
    """Where a place of the world is in a picture [px], by an eye, a target and an angle."""
    eye, target, angle = np.array(camera[0]), np.array(camera[1]), camera[2]
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    away = place - eye
    scale = size[1] / 2 / np.tan(np.radians(angle) / 2) / (away @ forward)
    return np.array([size[0] / 2 + scale * (away @ right), size[1] / 2 - scale * (away @ up)])


def test_the_bundle_was_built_from_the_sources_and_keeps_the_licence() -> None:
    assert stamp() == sources_stamp(), "the sources of the scene have changed: make scene"
    sources = Path(__file__).parents[2] / "runner/taskspec_runner/scene/js"
    three = json.loads((sources / "package.json").read_text())["devDependencies"]["three"]
    start = bundle()[:1600]
    assert f"three.js {three}" in start
    assert "The MIT License" in start
    assert "The above copyright notice and this permission notice shall be included" in start


def test_the_tip_is_where_the_log_has_it(browser: Browser, run: Run, report: Path) -> None:
    world = RecordedWorld(Recording.of(run))
    tip = world.model.body(world.recording.program.context.robot.tip_body).id
    shown(browser, report)
    assert "live" in browser.run(LIVE).split()
    places = []
    # None of them is a time at which the page has a row.
    for share in (0.013, 0.217, 0.491, 0.738, 0.962):
        time = run.start + share * (run.end - run.start)
        said = browser.run(AT.format(time=time))
        row = world.recording.row(said["time"])
        wanted = projected(world.show(row).xpos[tip], said["camera"], said["size"])
        assert said["tip"] == pytest.approx(wanted.tolist(), abs=1.0)
        places.append(wanted)
    assert np.ptp(places, axis=0).max() > 50
    assert browser.errors == []


def test_the_scene_shows_the_arm_on_the_first_screen(browser: Browser, report: Path) -> None:
    shown(browser, report, (1280, 800))
    browser.run(LIVE)
    box = browser.run("document.querySelector('.view').getBoundingClientRect().toJSON()")
    assert 0 <= box["top"] < box["bottom"] <= 800
    # It covers a part of the canvas, and not all of it: pixels that are not transparent.
    drawn = browser.run(
        """(() => {
        const from = document.querySelector(".view canvas"), to = document.createElement("canvas");
        document.querySelector(".seek").dispatchEvent(new Event("input"));
        return new Promise((done) => requestAnimationFrame(() => {
            [to.width, to.height] = [from.width, from.height];
            const pen = to.getContext("2d");
            pen.drawImage(from, 0, 0);
            const { data } = pen.getImageData(0, 0, to.width, to.height);
            let count = 0;
            for (let i = 3; i < data.length; i += 4) count += data[i] > 200;
            done(count / (to.width * to.height));
        }));
        })()"""
    )
    assert 0.03 < drawn < 0.6
    assert browser.run("performance.getEntriesByType('resource').length") == 0


def test_the_cursor_of_the_charts_moves_the_scene(browser: Browser, report: Path) -> None:
    shown(browser, report)
    browser.run(LIVE)
    box = browser.run("document.querySelector('.main .plot').getBoundingClientRect().toJSON()")
    browser.mouse("Moved", box["left"] + 0.3 * box["width"], box["top"] + 100)
    first = float(browser.run("document.querySelector('.seek').value"))
    browser.mouse("Moved", box["left"] + 0.8 * box["width"], box["top"] + 100)
    assert float(browser.run("document.querySelector('.seek').value")) > first
    said = browser.run("document.querySelector('.bar output').textContent")
    now = float(browser.run("document.querySelector('.seek').value"))
    assert said.startswith(f"{now:.3f} s")


def test_it_plays_by_button_and_keys(browser: Browser, report: Path) -> None:
    shown(browser, report)
    browser.run(LIVE)
    browser.run("document.querySelector('.seek').value = 0")
    browser.run("document.querySelector('.speed').value = 0.25")
    browser.run("document.querySelector('.play').click()")
    assert browser.run("document.querySelector('.play').textContent") == "Pause"
    moved = (
        "new Promise((done) => setTimeout(() => done(+document.querySelector('.seek').value), 300))"
    )
    first, second = browser.run(moved), browser.run(moved)
    assert 0 < first < second
    press = """document.querySelector(".view").dispatchEvent(
        new KeyboardEvent("keydown", {{ key: "{0}", shiftKey: {1}, bubbles: true }}))"""
    browser.run(press.format(" ", "false"))
    assert browser.run("document.querySelector('.play').textContent") == "Play"
    rested = browser.run("document.querySelector('.seek').value")
    assert browser.run(moved) == float(rested)
    camera = "document.querySelector('.view').dataset.camera"
    browser.run(moved)
    before = browser.run(camera)
    for key, shift in (("ArrowLeft", "true"), ("+", "false"), ("f", "false"), ("0", "false")):
        browser.run(press.format(key, shift))
        browser.run(moved)
        assert (browser.run(camera) == before) == (key == "0")


def test_a_phone_shows_it_without_overflow(browser: Browser, report: Path) -> None:
    shown(browser, report, PHONE)
    assert "live" in browser.run(LIVE).split()
    assert browser.run("document.documentElement.scrollWidth <= innerWidth")
    boxes = browser.run(
        "[...document.querySelectorAll('.arm .view, .player > *')]"
        ".map((e) => e.getBoundingClientRect().toJSON())"
    )
    assert len(boxes) == 6
    assert all(0 <= b["left"] < b["right"] <= PHONE[0] and b["width"] > 40 for b in boxes)
    # A finger scrolls the page over it.
    touch = "getComputedStyle(document.querySelector('.view canvas')).touchAction"
    assert browser.run(touch) == "pan-y"


@pytest.mark.parametrize("missing", ["WebGL", "DecompressionStream"])
def test_without_webgl_the_still_stays(browser: Browser, report: Path, missing: str) -> None:
    source = {
        "WebGL": """const before = HTMLCanvasElement.prototype.getContext;
            HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
                return kind.startsWith("webgl") ? null : before.call(this, kind, ...more);
            };""",
        "DecompressionStream": "delete globalThis.DecompressionStream;",
    }[missing]
    added = browser.command("Page.addScriptToEvaluateOnNewDocument", source=source)
    try:
        shown(browser, report)
        assert missing in browser.run(LIVE)
        assert browser.errors == []
        picture = "document.querySelector('.arm img')"
        assert browser.run(f"{picture}.getBoundingClientRect().height") > 100
        assert browser.run(f"{picture}.naturalWidth") == 1120
        assert not browser.run("document.querySelector('.player').checkVisibility()")
        assert browser.run("document.querySelectorAll('.view canvas').length") == 0
    finally:
        browser.command("Page.removeScriptToEvaluateOnNewDocument", identifier=added["identifier"])


def test_paper_has_the_still(browser: Browser, report: Path) -> None:
    shown(browser, report, DESKTOP)
    browser.run(LIVE)
    browser.media("print")
    assert browser.run("document.querySelector('.arm img').checkVisibility()")
    assert not browser.run("document.querySelector('.view canvas').checkVisibility()")
    browser.media()


def test_bodies_are_where_mujoco_has_them(browser: Browser, tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_string(JOINTS)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    numbers = np.random.default_rng(3)
    bodies = [model.body(name).id for name in ("put", "loose", "turned", "tip")]
    # The script says where the tip is: each body has a scene with itself for the tip.
    scenes = [model_scene(model, frame_arm(model, data, body), body) for body in bodies]
    page = tmp_path / "scene.html"
    page.write_text(
        "<!doctype html><meta charset=utf-8>"
        '<div id="box" style="width: 400px; height: 300px"></div>'
        + f"<script>{bundle().replace('</script', '<!script')}</script>"
    )
    browser.size(400, 300)
    browser.open(page)
    for body, scene in zip(bodies, scenes, strict=True):
        for _ in range(3):
            data.qpos[:] = numbers.normal(size=model.nq)
            data.mocap_pos[:] = numbers.normal(size=(1, 3))
            data.mocap_quat[:] = numbers.normal(size=(1, 4))
            mujoco.mj_kinematics(model, data)
            q = positions(data)
            assert len(q) == scene["width"]
            said = browser.run(
                f"""new Promise((done) => {{
                const box = document.getElementById("box");
                const arm = taskspecScene.create(box, {json.dumps(scene)});
                arm.show({{ q: {q.tolist()} }});
                requestAnimationFrame(() => setTimeout(() => {{
                    done([JSON.parse(box.dataset.camera), JSON.parse(box.dataset.tip)]);
                    arm.dispose();
                }}));
                }})"""
            )
            wanted = projected(data.xpos[body], said[0], [400, 300])
            assert said[1] == pytest.approx(wanted.tolist(), rel=1e-3, abs=0.2)
    assert browser.errors == []


def test_meshes_that_are_too_fine_are_made_coarser() -> None:
    ball = trimesh.creation.icosphere(subdivisions=6, radius=0.1)
    fine = Triangles(np.array(ball.vertices), np.array(ball.faces, dtype=np.int64))
    assert len(fine.faces) > 80_000
    (coarse,) = within([fine], 10_000)
    assert 2_000 < len(coarse.faces) <= 10_000
    radii = np.linalg.norm(coarse.vertices, axis=1)
    assert np.abs(radii - 0.1).max() < 1e-3
    made = trimesh.Trimesh(coarse.vertices, coarse.faces, process=False)
    assert made.volume == pytest.approx(ball.volume, rel=0.02)
    assert within([coarse]) == [coarse]


def test_a_long_run_has_no_more_rows_than_there_is_room_for(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorded, "MOST_ROWS", 12)
    world = RecordedWorld(Recording.of(run))
    scene = recorded.recorded_scene(world)
    clock = np.frombuffer(base64.b64decode(scene["track"]["clock"]), "<f4")
    assert len(clock) == 12
    assert clock[[0, -1]] == pytest.approx(world.recording.clock[[0, -1]], abs=1e-6)
    values = np.frombuffer(base64.b64decode(scene["track"]["values"]), "<f4")
    assert len(values) == 12 * (scene["width"] + 13)
