"""`explain --picture`: a task drawn before any run, without OpenGL."""

from __future__ import annotations

import io
from itertools import combinations
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from command_line import call
from PIL import Image

from taskspec.examination import examine
from taskspec.spec import load_task
from taskspec_runner.plant.looks import settle
from taskspec_runner.preview import TaskPicture
from taskspec_runner.preview.picture import WIDTH
from taskspec_runner.preview.rays import RayCamera, RayPicture
from taskspec_runner.preview.stages import pictured
from taskspec_runner.video import canvas
from taskspec_runner.video.camera import View
from taskspec_runner.video.labels import Labels, Rectangle, width_of

ROOT = Path(__file__).resolve().parents[2]
TASKS = ROOT / "tasks"
NAMES = ("wipe-table", "crank", "trace-points")
#: Coarse: what is tested here is what is written over the scene.
FINE = 0.15


def plan_of(name):
    plan = examine(load_task(TASKS / f"{name}.yaml"), stability=False).plan
    assert plan is not None
    return plan


@pytest.fixture(scope="module")
def plans():
    return {name: plan_of(name) for name in NAMES}


@pytest.fixture(scope="module")
def drawn(plans):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(canvas, "new_context", None)
        pictures = {name: TaskPicture(plan).svg(fineness=FINE) for name, plan in plans.items()}
    return {name: ElementTree.fromstring(svg) for name, svg in pictures.items()}


def texts(svg):
    found = [each for each in svg.iter() if each.tag.endswith("}text")]
    assert found
    return found


def box_of(text):
    size, width = float(text.get("font-size")), width_of(text.text, float(text.get("font-size")))
    shift = {"start": 0.5, "middle": 0.0, "end": -0.5}[text.get("text-anchor")]
    middle = float(text.get("x")) + shift * width, float(text.get("y")) - 0.35 * size
    return Rectangle.about(np.array(middle), width, 0.9 * size)


@pytest.mark.parametrize("name", NAMES)
def test_texts_do_not_overlap_and_can_be_read_on_a_phone(name, drawn):
    found = texts(drawn[name])
    for one, other in combinations(found, 2):
        assert not box_of(one).meets(box_of(other)), (one.text, other.text)
    for text in found:
        assert float(text.get("font-size")) * 390 / WIDTH >= 9
        assert box_of(text).within(Rectangle(0, 0, WIDTH, float(drawn[name].get("height"))))


def test_a_picture_says_what_each_stage_controls_in_its_colour(drawn):
    words = {text.text: text.get("fill") for text in texts(drawn["wipe-table"])}
    assert {"approach", "wipe", "retreat", "table", "force controlled", "path"} <= words.keys()
    force, motion = words["f_z = -press, reached in 0.3 s"], words["v_z = -30 mm/s"]
    assert int(force[1:3], 16) > 2 * int(force[5:7], 16)
    assert int(motion[5:7], 16) > 2 * int(motion[1:3], 16)
    assert words["x, y, rx, ry, rz held"] == motion


def test_stages_have_the_frame_the_controls_and_the_path_of_the_plan(plans):
    task = plans["wipe-table"]
    stages = {stage.name: stage for stage in pictured(task)}
    assert list(stages) == list(task.stages)
    wipe = stages["wipe"]
    assert wipe.kinds["z"] == "force"
    assert {kind for axis, kind in wipe.kinds.items() if axis != "z"} == {"motion"}
    assert wipe.axes == pytest.approx(np.eye(3), abs=1e-9)
    # A figure of eight of 60 and 30 mm.
    assert np.ptp(wipe.path, axis=0) == pytest.approx([0.12, 0.06, 0.0], abs=2e-3)
    assert stages["retreat"].path[-1][2] - stages["retreat"].path[0][2] == pytest.approx(0.05)


def test_labels_take_free_places_or_none():
    panel, random = Rectangle(0, 0, 300, 200), np.random.default_rng(3)
    labels, placed = Labels(panel), 0
    for _ in range(60):
        at = random.uniform([0, 0], [300, 200])
        placed += labels.place(at, "label", 16, random.normal(size=2)) is not None
    assert 10 < placed < 60
    assert len(labels.taken) == placed
    assert all(box.within(panel) for box in labels.taken)
    assert not any(a.meets(b) for a, b in combinations(labels.taken, 2))


BALL = """<mujoco><worldbody><geom type="plane" size="0 0 .1"/>
<geom name="ball" type="sphere" size="0.1" pos="0 0 0.3" rgba="1 0 0 1"/></worldbody></mujoco>"""


def test_rays_draw_the_silhouette_of_a_ball_and_its_shadow():
    model = mujoco.MjModel.from_xml_string(BALL)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    paper = np.array([0.9, 0.9, 0.9])
    tangent = 0.4
    camera = RayCamera(View(90.0, -30.0, 1.0, (0.0, 0.0, 0.3)), 240, 200, tangent)
    image = RayPicture(model, data, paper).draw(camera).astype(int)
    red = image[..., 0] > image[..., 1] + 40
    # Of a ball of radius r at d the half angle has the sine r / d.
    radius = 100 / tangent * np.tan(np.arcsin(0.1))
    # Pixels on the edge count as red or not by their share.
    assert red.sum() == pytest.approx(np.pi * radius**2, rel=0.02)
    assert np.argwhere(red).mean(axis=0) == pytest.approx([99.5, 119.5], abs=0.6)
    shadow = ~red & (image.max(axis=2) < 215)
    assert 0.3 < shadow.sum() / red.sum() < 3
    (middle,) = camera.project(np.array([[0.0, 0.0, 0.3]]))
    assert middle == pytest.approx([120, 100])


def test_what_stands_still_in_the_air_has_a_stand_down_to_the_floor(plans):
    picture = TaskPicture(plans["wipe-table"])
    model, data = picture._model, picture._data
    slab, stand = model.geom("world/table/slab").id, model.geom("world/table/slab/stand").id
    half = model.geom_size[stand][1]
    low, high = data.geom_xpos[stand][2] - half, data.geom_xpos[stand][2] + half
    top = data.geom_xpos[slab][2] + model.geom_size[slab][2]
    assert low == pytest.approx(0, abs=1e-9)
    assert top - 2 * model.geom_size[slab][2] < high < top == pytest.approx(0.3)
    # Lowered to the floor it needs none.
    model.geom_pos[slab][2] = 0.0
    lowered = mujoco.MjData(model)
    task = plans["wipe-table"].context.loaded.task.model_copy(update={"world": {}})
    settle(model, lowered, task, picture._path)
    assert model.geom_rgba[stand][3] == 0


def test_the_command_writes_an_svg_or_a_png_and_says_where(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(canvas, "new_context", None)
    said = call("explain", TASKS / "press-hybrid.yaml", "--picture")
    assert (said.exit_code, said.stdout) == (0, "picture: press-hybrid.svg\n")
    assert ElementTree.parse("press-hybrid.svg").getroot().get("viewBox").startswith("0 0 640 ")
    assert call("explain", TASKS / "press-hybrid.yaml", "--picture", "p.png").exit_code == 0
    image = Image.open(io.BytesIO((tmp_path / "p.png").read_bytes()))
    assert image.width == 2 * WIDTH
    assert len(np.unique(np.asarray(image).reshape(-1, 3), axis=0)) > 500


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("--picture", "p.gif"), "it ends in .svg or .png"),
        (("p.svg",), "add --picture"),
        (("--picture", "--terms"), "leave out --terms"),
    ],
)
def test_what_does_not_go_together_is_said(args, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    said = call("explain", TASKS / "press-hybrid.yaml", *args)
    assert said.exit_code == 2
    assert message in said.stderr
    assert not list(tmp_path.iterdir())


def test_the_gallery_has_small_pictures_of_every_task():
    tasks = sorted(path.stem for path in TASKS.glob("*.yaml"))
    files = sorted((ROOT / "docs" / "images" / "tasks").iterdir())
    assert len(tasks) > 60
    for suffix in (".svg", ".webp"):
        assert sorted(path.stem for path in files if path.suffix == suffix) == tasks
    assert sum(path.stat().st_size for path in files) < 4e6
