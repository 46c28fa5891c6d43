"""The arm, its world and its forces in exports, read back by the libraries of other tools."""

from __future__ import annotations

import base64
import io
import json
from collections import defaultdict
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
import pinocchio as pin
import pytest
import trimesh
from rosbags.highlevel import AnyReader
from short_tasks import DRUM

from taskspec.robot.coupling import JointCoupling
from taskspec.spec import load_task, load_text
from taskspec_runner.export import export_run
from taskspec_runner.export.robot_description import robot_description
from taskspec_runner.export.scene import RATE, RunScene, _frame_names, _links, _pieces
from taskspec_runner.runs import Run
from taskspec_runner.session import execute
from taskspec_runner.video.recording import Recording
from taskspec_runner.video.world import RecordedWorld

SHIPPED = Path(__file__).resolve().parent.parent.parent / "tasks"
#: A run in frames that turn along, and one with a mechanism, whose handle moves.
TASKS = ("drum", "push-button")
#: Joints beside their bodies' origins, two of them in one body, one that slides, with references;
#: a body without a joint between them; a mesh, an ellipsoid and a capsule.
STRANGE = """
<mujoco>
  <compiler autolimits="true"/>
  <asset><mesh name="wedge" vertex="0 0 0  0.1 0 0  0 0.2 0  0 0 0.3"/></asset>
  <worldbody>
    <geom name="world/table" type="box" size="0.1 0.2 0.3"/>
    <body name="base" pos="0.1 0.2 0.3" euler="0 90 0">
      <geom type="mesh" mesh="wedge"/>
      <body name="upper" pos="0 0.1 0.4" euler="30 0 20">
        <joint name="j1" axis="0 1 0" pos="0.02 0.03 -0.04" ref="20"/>
        <joint name="j2" axis="1 2 0" pos="-0.1 0 0.05" range="-90 90"/>
        <geom type="capsule" size="0.03 0.2"/>
        <body name="tool" pos="0 0.05 0.3" quat="0.7071 0 0.7071 0">
          <geom type="ellipsoid" size="0.1 0.05 0.02"/>
          <body name="" pos="0 0 0.1">
            <joint name="j3" type="slide" axis="0 0.6 0.8" ref="0.05" range="-0.2 0.3"/>
            <geom type="cylinder" size="0.02 0.1"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.fixture(scope="module", params=TASKS)
def exported(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run with its export."""
    out = tmp_path_factory.mktemp(request.param) / "run"
    own = request.param == "drum"
    task = load_text(DRUM, "drum.yaml") if own else load_task(SHIPPED / f"{request.param}.yaml")
    execute(task, out, report=False)
    assert export_run(Run(out), "mcap").note == ""
    return out


@pytest.fixture(scope="module")
def messages(exported: Path) -> dict[str, list[tuple[int, Any]]]:
    found = defaultdict(list)
    with AnyReader([exported / "log.mcap"]) as reader:
        for connection, time, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            found[connection.topic].append((time, message))
    return found


def _matrix(place: Any, turn: Any) -> np.ndarray:
    T = np.eye(4)
    R = np.zeros(9)
    mujoco.mju_quat2Mat(R, np.array([turn.w, turn.x, turn.y, turn.z]))
    T[:3, :3], T[:3, 3] = R.reshape(3, 3), [place.x, place.y, place.z]
    return T


class _Transforms:
    """Frames in their parents, as they are heard of."""

    def __init__(self) -> None:
        self.known: dict[str, tuple[str, np.ndarray]] = {}

    def hear(self, message: Any) -> None:
        for each in message.transforms:
            T = _matrix(each.transform.translation, each.transform.rotation)
            self.known[each.child_frame_id] = each.header.frame_id, T

    def placed(self, frame: str) -> np.ndarray:
        T = np.eye(4)
        while frame != "world":
            frame, in_parent = self.known[frame]
            T = in_parent @ T
        return T


def _scene_times(messages: dict[str, list[tuple[int, Any]]]) -> list[int]:
    return [time for time, _ in messages["/forces"]]


def test_urdf_with_joint_states_puts_links_where_tf_does(
    messages: dict[str, list[tuple[int, Any]]],
) -> None:
    ((_, text),) = messages["/robot_description"]
    model = pin.buildModelFromXML(text.data)
    data, heard = model.createData(), _Transforms()
    ((_, fixed),) = messages["/tf_static"]
    heard.hear(fixed)
    states, sent = dict(messages["/joint_states"]), defaultdict(list)
    for time, message in messages["/tf"]:
        sent[time].append(message)
    links = {link.get("name") for link in ElementTree.fromstring(text.data).iter("link")}
    assert len(links) > 7
    times = _scene_times(messages)[::5]
    assert len(times) > 4
    for time in times:
        for message in sent[time]:
            heard.hear(message)
        state = states[time]
        q = pin.neutral(model)
        for name, value in zip(state.name, state.position, strict=True):
            q[model.joints[model.getJointId(name)].idx_q] = value
        if model.nq != model.nv:  # A joint without limits is a point of a circle.
            q = pin.integrate(model, pin.neutral(model), np.array(state.position))
        pin.framesForwardKinematics(model, data, q)
        for link in links:
            T = data.oMf[model.getFrameId(link)].homogeneous
            np.testing.assert_allclose(heard.placed(link), T, rtol=0, atol=1e-9, err_msg=link)


def test_frames_are_one_tree_that_every_marker_stands_in(
    messages: dict[str, list[tuple[int, Any]]],
) -> None:
    parents = defaultdict(set)
    sent = [*messages["/tf_static"], *messages["/tf"]]
    for _, message in sent:
        for each in message.transforms:
            parents[each.child_frame_id].add(each.header.frame_id)
    fixed = {each.child_frame_id for each in messages["/tf_static"][0][1].transforms}
    moving = {e.child_frame_id for _, message in messages["/tf"] for e in message.transforms}
    assert len(parents) > 9
    assert not fixed & moving
    assert all(len(each) == 1 for each in parents.values())
    assert {each for found in parents.values() for each in found} - parents.keys() == {"world"}
    ((_, world),) = messages["/world"]
    assert len(world.markers) > 1
    assert {marker.header.frame_id for marker in world.markers} <= {"world", *parents}
    assert all(sum(vars(m.pose.orientation)[k] ** 2 for k in "xyzw") == pytest.approx(1)
               for m in world.markers)  # fmt: skip


def test_scene_comes_fifty_times_a_second_and_signals_at_every_tick(
    exported: Path, messages: dict[str, list[tuple[int, Any]]]
) -> None:
    run, times = Run(exported), _scene_times(messages)
    assert len(times) <= RATE * run.end + 2
    assert max(np.diff(times)) <= 1e9 / RATE + 1e6
    assert len(messages["/signals"]) == len(run)


def test_bodies_are_where_mujoco_has_them(exported: Path) -> None:
    recording = Recording.of(Run(exported))
    world, scene = RecordedWorld(recording), RunScene.of(Run(exported))
    names = _frame_names(world.model)
    drawn = {piece.frame for piece in scene.pieces} - {"world"}
    assert len(drawn) > 7
    for number in (0, len(scene.clock) // 2, len(scene.clock) - 1):
        data = world.show(recording.row(float(scene.clock[number])))
        for frame in drawn:
            found = scene.placed(frame)
            place = found[min(number, len(found) - 1), :3]
            np.testing.assert_allclose(
                place, data.xpos[names.index(frame)], rtol=0, atol=1e-9, err_msg=frame
            )
    if exported.parent.name.startswith("push-button"):
        loose = drawn & scene.moving.keys() - {link.name for link in scene.links}
        assert loose, "the button moves"


def test_arrow_is_the_force_at_the_control_point(
    messages: dict[str, list[tuple[int, Any]]],
) -> None:
    heard, wrenches = _Transforms(), dict(messages["/wrench"])
    sent = defaultdict(list)
    for time, message in messages["/tf"]:
        sent[time].append(message)
    arrows = []
    for time, message in messages["/forces"]:
        for each in sent[time]:
            heard.hear(each)
        arrow = next(marker for marker in message.markers if marker.ns == "force")
        if arrow.action == 0:
            start, end = (np.array([p.x, p.y, p.z]) for p in arrow.points)
            force = wrenches[time].wrench.force
            T = heard.placed("control_point")
            applied = T[:3, :3] @ [force.x, force.y, force.z]
            np.testing.assert_allclose(start, T[:3, 3], rtol=0, atol=1e-9)
            along = (end - start) / np.linalg.norm(end - start)
            np.testing.assert_allclose(along, applied / np.linalg.norm(applied), atol=1e-6)
            arrows.append(np.linalg.norm(end - start) / np.linalg.norm(applied))
    assert len(arrows) > 5
    # One scale, but for what overshoots by far.
    assert np.median(arrows) == pytest.approx(max(arrows), rel=1e-6)


def test_layout_names_what_the_log_has(
    exported: Path, messages: dict[str, list[tuple[int, Any]]]
) -> None:
    layout = json.loads((exported / "log.foxglove.json").read_text("utf-8"))
    panels = layout["configById"]

    def placed(part: Any) -> list[str]:
        return (
            [part] if isinstance(part, str) else [*placed(part["first"]), *placed(part["second"])]
        )

    assert sorted(placed(layout["layout"])) == sorted(panels)
    assert {"3D!scene", "Plot!forces", "StateTransitions!stages"} <= panels.keys()
    assert panels["3D!scene"]["topics"].keys() <= messages.keys()
    paths = [path["value"] for panel in panels.values() for path in panel.get("paths", ())]
    assert len(paths) > 8
    for path in paths:
        topic, *fields = path.split(".")
        value = messages[topic][0][1]
        for field in fields:
            value = getattr(value, field)
        assert isinstance(value, float | str)


# Arms of other people.


@pytest.fixture(scope="module")
def strange() -> RunScene:
    model = mujoco.MjModel.from_xml_string(STRANGE)
    # The second joint follows the first one.
    coupling = JointCoupling(
        ("j1", "j2", "j3"), (True, True, False), (0, 2),
        np.array([[1.0, 0.0], [-0.5, 0.0], [0.0, 1.0]]), np.array([0.0, 0.1, 0.0]),
    )  # fmt: skip
    names = _frame_names(model)
    links = tuple(_links(model, coupling, names))
    pieces = tuple(_pieces(model, {link.body for link in links} - {-1}, names))
    none = np.zeros(1)
    fixed = {link.name: (link.parent, link.pose) for link in links}
    return RunScene(model, coupling, none, links, fixed, {}, pieces, {}, np.zeros((0, 2, 3)))


def test_joints_beside_their_bodies_move_these_as_in_mujoco(strange: RunScene) -> None:
    urdf = pin.buildModelFromXML(robot_description(strange, "strange"))
    data, state = urdf.createData(), mujoco.MjData(strange.model)
    names = _frame_names(strange.model)
    assert "tool_link" in names
    random = np.random.default_rng(1)
    for x in random.uniform(-1, 1, (20, 2)):
        state.qpos[:] = joints = strange.coupling.joints(x)
        mujoco.mj_kinematics(strange.model, state)
        q = pin.integrate(urdf, pin.neutral(urdf), joints)
        pin.framesForwardKinematics(urdf, data, q)
        for body in range(1, strange.model.nbody):
            T = data.oMf[urdf.getFrameId(names[body])]
            np.testing.assert_allclose(T.translation, state.xpos[body], rtol=0, atol=1e-9)
            np.testing.assert_allclose(T.rotation, state.xmat[body].reshape(3, 3), atol=1e-9)
        for link in strange.links:
            if link.joint:
                position = joints[strange.coupling.names.index(link.joint)]
                parent = data.oMf[urdf.getFrameId(link.parent)]
                (pose,) = link.poses(np.array([position]))
                own = parent * pin.XYZQUATToSE3(pose)
                assert own.isApprox(data.oMf[urdf.getFrameId(link.name)], 1e-9)


def test_urdf_says_what_follows_what_is_drawn_and_what_it_weighs(strange: RunScene) -> None:
    root = ElementTree.fromstring(robot_description(strange, "strange"))
    (mimic,) = root.iter("mimic")
    assert (mimic.get("joint"), mimic.get("multiplier"), mimic.get("offset")) == (
        "j1", "-0.5", "0.1",
    )  # fmt: skip
    kinds = {joint.get("name"): joint.get("type") for joint in root.iter("joint")}
    assert (kinds["j1"], kinds["j2"], kinds["j3"]) == ("continuous", "revolute", "prismatic")
    assert len([*root.iter("sphere")]) == 2  # ends of the capsule
    assert len([*root.iter("cylinder")]) == 2
    masses = [float(mass.get("value", 0)) for mass in root.iter("mass")]
    assert sum(masses) == pytest.approx(strange.model.body_mass.sum())
    # What the robot's file has in the world belongs to the world.
    (table,) = strange.pieces_of_arm(arm=False)
    assert (table.frame, table.owner, table.kind) == ("world", "table", "box")


def test_embedded_meshes_open_with_the_axes_of_gltf(strange: RunScene) -> None:
    root = ElementTree.fromstring(robot_description(strange, "strange"))
    meshes = [mesh.get("filename", "") for mesh in root.iter("mesh")]
    assert len(meshes) == 2
    opened = []
    for url in meshes:
        kind, _, content = url.partition(";base64,")
        assert kind == "data:model/gltf-binary"
        opened.append(
            trimesh.load(io.BytesIO(base64.b64decode(content)), file_type="glb", force="mesh")
        )
    wedge, ellipsoid = opened
    # x, y, z of a robot are x, -z, y of glTF; MuJoCo turns a mesh into its axes of inertia.
    (piece,) = (piece for piece in strange.pieces if piece.kind == "mesh")
    x, y, z = wedge.vertices.T
    inside = pin.XYZQUATToSE3(piece.pose)
    corners = np.array([inside.act(corner) for corner in np.column_stack([x, -z, y])])
    wanted = [[0, 0, 0], [0.1, 0, 0], [0, 0.2, 0], [0, 0, 0.3]]
    apart = np.linalg.norm(corners[:, None] - np.array(wanted), axis=2)
    assert sorted(apart.argmin(axis=1)) == [0, 1, 2, 3]
    assert apart.min(axis=1).max() < 1e-6
    np.testing.assert_allclose(ellipsoid.extents, [0.2, 0.04, 0.1], rtol=1e-6)
    assert wedge.volume == pytest.approx(0.1 * 0.2 * 0.3 / 6)
    assert ellipsoid.volume == pytest.approx(4 / 3 * np.pi * 0.1 * 0.05 * 0.02, rel=0.05)
