"""A run as other tools draw it: frames and how they move, what is fixed to them, and arrows.

The arm is a tree of links as URDF has them, each placed in its parent. Everything else that moves
is a frame in the world.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.robot.coupling import JointCoupling
from taskspec_runner.export.messages import unique
from taskspec_runner.plant.names import PREFIX
from taskspec_runner.runs import Run
from taskspec_runner.scene.meshes import Triangles
from taskspec_runner.scene.model import coloring_material
from taskspec_runner.video.marks import COLORS, LINK, LINK_RADIUS, SURFACE, Color, Marks
from taskspec_runner.video.recording import Recording
from taskspec_runner.video.world import RecordedWorld

Vector = NDArray[np.float64]

#: Frames of every export beside the scene's.
WORLD, TOOL, TASK_FRAME, CONTROL_POINT = "world", "tool", "task", "control_point"
#: Times a second of run time at which the scene is known, and how many these are at most.
RATE, _MOST_ROWS = 50.0, 30_000
#: The arrows of a row: axes of the stage's frame, and the force that the robot applies.
ARROWS = ("x", "y", "z", "force")
#: Cells along a mesh of too many triangles, of which corners in one cell become one.
_MOST_TRIANGLES, _CELLS = 20_000, 48
_IDENTITY = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True)
class ScenePiece:
    """A solid of one colour that is fixed to a frame.

    Attributes:
        frame: that it is fixed to.
        owner: link or object that it belongs to.
        kind: box, sphere, cylinder or mesh.
        size: (3,) its extent [m], which of a sphere may differ by axis; a cylinder is along z.
        pose: (7,) in the frame: place [m], and unit quaternion x, y, z, w.
        color: red, green, blue, opacity.
        vertices, faces: (n, 3) [m], (m, 3) of a mesh.
    """

    frame: str
    owner: str
    kind: str
    size: Vector
    pose: Vector
    color: Color
    vertices: Vector | None = None
    faces: NDArray[np.int64] | None = None


@dataclass(frozen=True, slots=True)
class SceneLink:
    """A link of the arm with the joint that carries it.

    Attributes:
        name: of its frame.
        parent: frame that the joint stands on.
        pose: (7,) in the parent where the joint's position is 0.
        joint: its name; empty for a fixed one.
        hinge: whether the joint turns; else it slides.
        axis: (3,) unit vector, in the link.
        body: MuJoCo's; -1 for a frame between the joints of one body.
    """

    name: str
    parent: str
    pose: Vector
    joint: str = ""
    hinge: bool = True
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    body: int = -1

    def poses(self, positions: Vector) -> Vector:
        """(k, 7) in the parent at positions (k,) of the joint [rad or m]."""
        found = np.tile(self.pose, (len(positions), 1))
        axis = np.array(self.axis)
        if self.hinge:
            half = positions[:, None] / 2
            spin = np.hstack([np.sin(half) * axis, np.cos(half)])
            found[:, 3:] = _product(self.pose[None, 3:], spin)
        else:
            found[:, :3] += positions[:, None] * _rotated(self.pose[3:], axis)
        return found


@dataclass(frozen=True, slots=True)
class ArrowTrack:
    """An arrow at every row.

    Attributes:
        shown: (k,) whether there is one.
        starts, ends: (k, 3) in the world [m].
        colors: (k, 4) red, green, blue, opacity.
    """

    shown: NDArray[np.bool_]
    starts: Vector
    ends: Vector
    colors: Vector


@dataclass(frozen=True, slots=True)
class RunScene:
    """The scene of a run at some of its ticks.

    Attributes:
        model: MuJoCo's, of the arm in its world.
        coupling: of the arm's joints.
        clock: (k,) times of the rows [s].
        links: of the arm, parents first.
        fixed: parent and pose (7,) of each frame that stands still in it.
        moving: parent and poses (k, 7) of the others.
        pieces: what is drawn.
        arrows: by the names in `ARROWS`.
        path: (m, 2, 3) line segments of the reference's path in the world [m].
    """

    model: mujoco.MjModel
    coupling: JointCoupling
    clock: Vector
    links: tuple[SceneLink, ...]
    fixed: Mapping[str, tuple[str, Vector]]
    moving: Mapping[str, tuple[str, Vector]]
    pieces: tuple[ScenePiece, ...]
    arrows: Mapping[str, ArrowTrack]
    path: Vector

    @classmethod
    def of(cls, run: Run) -> RunScene:
        """The scene of a run.

        Raises:
            InputError: the run cannot be drawn; the message says why.
        """
        recording = Recording.of(run)
        world = RecordedWorld(recording)
        marks, model = Marks(world), world.model
        coupling = recording.program.context.robot.coupling
        rows = _rows(recording.clock)
        names = _frame_names(model)
        links = tuple(_links(model, coupling, names))
        joints = np.array([coupling.joints(q) for q in recording.q[rows]])
        fixed, moving = dict[str, tuple[str, Vector]](), dict[str, tuple[str, Vector]]()
        for link in links:
            if link.joint:
                positions = joints[:, coupling.names.index(link.joint)]
                moving[link.name] = link.parent, link.poses(positions)
            else:
                fixed[link.name] = link.parent, link.pose
        arm = {link.body for link in links}
        pieces = [*_pieces(model, arm, names), *_added_pieces(world, marks, names)]
        drawn = {piece.frame for piece in pieces}
        loose = [b for b in range(1, model.nbody) if b not in arm and names[b] in drawn]
        for body, poses in zip(loose, _poses_of(world, rows, loose), strict=True):
            if np.ptp(poses, axis=0).any():
                moving[names[body]] = WORLD, poses
            else:
                fixed[names[body]] = WORLD, poses[0]
        path = marks.wanted
        half = path.halves[:, None] * path.axes[:, :, 2]
        return cls(
            model, coupling, recording.clock[rows], links, fixed, moving, tuple(pieces),
            _arrows(marks, rows), np.stack([path.middles - half, path.middles + half], axis=1),
        )  # fmt: skip

    @classmethod
    def still(cls, model: mujoco.MjModel, coupling: JointCoupling) -> RunScene:
        """The scene of a model without a run: of the arm its links and what is drawn of them."""
        names = _frame_names(model)
        links = tuple(_links(model, coupling, names))
        pieces = tuple(_pieces(model, {link.body for link in links}, names))
        return cls(model, coupling, np.zeros(0), links, {}, {}, pieces, {}, np.zeros((0, 2, 3)))

    def pieces_of_arm(self, *, arm: bool) -> list[ScenePiece]:
        """The pieces of the arm, or those of the world."""
        links = {link.name for link in self.links}
        return [piece for piece in self.pieces if (piece.frame in links) == arm]

    def placed(self, frame: str) -> Vector:
        """(k, 7) or (1, 7), of a frame that stands still: its poses in the world."""
        found = _IDENTITY[None]
        while frame != WORLD:
            still = frame in self.fixed
            frame, pose = (self.fixed if still else self.moving)[frame]
            found = _composed(pose[None] if still else pose, found)
        return found


def _rows(clock: Vector) -> NDArray[np.int64]:
    """Rows `RATE` times a second, of a long run less often, with the first and the last one."""
    rate = min(RATE, _MOST_ROWS / max(float(clock[-1] - clock[0]), 1e-9))
    new = np.diff(np.floor(clock * rate + 1e-6), prepend=-1.0) > 0
    return np.union1d(np.flatnonzero(new), [0, len(clock) - 1])


def _frame_names(model: mujoco.MjModel) -> list[str]:
    """The frame of each body: its name, in which nothing tells apart world and robot, made unique.

    What is called like a frame of the task, as the tool of most arms is, becomes `tool_link`.
    """
    taken = {WORLD, TOOL, TASK_FRAME, CONTROL_POINT}
    names = [WORLD]
    for body in range(1, model.nbody):
        own = model.body(body).name.removeprefix(PREFIX).replace("/", "_") or f"body{body}"
        names.append(unique(f"{own}_link" if own in taken else own, taken))
    return names


def _links(
    model: mujoco.MjModel, coupling: JointCoupling, names: Sequence[str]
) -> Iterator[SceneLink]:
    """The arm's links; a joint whose axis does not go through its body has a frame of its own."""
    arm, taken = {0}, {*names}
    for body in range(1, model.nbody):
        first = int(model.body_jntadr[body])
        joints = range(first, first + int(model.body_jntnum[body]))
        parent = int(model.body_parentid[body])
        strange = any(model.joint(j).name not in coupling.names for j in joints)
        if parent not in arm or strange or model.body(body).name.startswith(PREFIX):
            continue
        arm.add(body)
        frame, at = names[parent], np.zeros(3)
        pose = np.concatenate([model.body_pos[body], _scalar_last(model.body_quat[body])])
        for joint in joints:
            name = model.joint(joint).name
            hinge = coupling.hinges[coupling.names.index(name)]
            anchor = model.jnt_pos[joint].copy() if hinge else at
            axis = model.jnt_axis[joint]
            placed = _composed(pose[None], _moved(anchor - at)[None])[0]
            own = joint == joints[-1] and not anchor.any()
            link = names[body] if own else unique(f"{names[body]}_{name}", taken)
            made = SceneLink(link, frame, placed, name, hinge, tuple(axis.tolist()))
            zero = float(model.qpos0[model.jnt_qposadr[joint]])
            placed = made.poses(np.array([-zero]))[0]
            yield SceneLink(link, frame, placed, name, hinge, made.axis, body if own else -1)
            frame, at, pose = link, anchor, _IDENTITY
        if frame != names[body]:
            placed = _composed(pose[None], _moved(-at)[None])[0]
            yield SceneLink(names[body], frame, placed, body=body)


def _pieces(model: mujoco.MjModel, arm: set[int], names: Sequence[str]) -> Iterator[ScenePiece]:
    """What MuJoCo draws of its geoms by default; planes and height fields are left out."""
    shown = mujoco.MjvOption().geomgroup
    for geom in range(model.ngeom):
        material = coloring_material(model, geom)
        looks = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
        red, green, blue, opacity = looks.tolist()
        color: Color = (red, green, blue, opacity)
        if not shown[model.geom_group[geom]] or opacity == 0.0:
            continue
        body = int(model.geom_bodyid[geom])
        name = model.geom(geom).name.removeprefix(PREFIX).partition("/")[0]
        owner = names[body] if body in arm else name or names[body]
        pose = np.concatenate([model.geom_pos[geom], _scalar_last(model.geom_quat[geom])])
        for kind, size, offset in _solids(model, geom):
            placed = _composed(pose[None], _moved(offset)[None])[0]
            corners, faces = _mesh(model, geom) if kind == "mesh" else (None, None)
            yield ScenePiece(names[body], owner, kind, size, placed, color, corners, faces)


def _solids(model: mujoco.MjModel, geom: int) -> Iterator[tuple[str, Vector, Vector]]:
    """Kind, extent (3,) and place in the geom (3,) of the solids that make up a geom."""
    kinds, (a, b, c) = mujoco.mjtGeom, model.geom_size[geom]
    kind = int(model.geom_type[geom])
    if kind == kinds.mjGEOM_BOX:
        yield "box", np.array([2 * a, 2 * b, 2 * c]), np.zeros(3)
    elif kind == kinds.mjGEOM_SPHERE:
        yield "sphere", np.full(3, 2 * a), np.zeros(3)
    elif kind == kinds.mjGEOM_ELLIPSOID:
        yield "sphere", np.array([2 * a, 2 * b, 2 * c]), np.zeros(3)
    elif kind in (kinds.mjGEOM_CYLINDER, kinds.mjGEOM_CAPSULE):
        yield "cylinder", np.array([2 * a, 2 * a, 2 * b]), np.zeros(3)
        if kind == kinds.mjGEOM_CAPSULE:
            for end in (-b, b):
                yield "sphere", np.full(3, 2 * a), np.array([0.0, 0.0, end])
    elif kind in (kinds.mjGEOM_MESH, kinds.mjGEOM_SDF):
        yield "mesh", np.ones(3), np.zeros(3)


def _mesh(model: mujoco.MjModel, geom: int) -> tuple[Vector, NDArray[np.int64]]:
    """Vertices (n, 3) and faces (m, 3) of a mesh; one of very many triangles is made coarser."""
    mesh = Triangles.of(model, int(model.geom_dataid[geom]))
    if len(mesh.faces) > _MOST_TRIANGLES:
        mesh = mesh.clustered(float(np.ptp(mesh.vertices)) / _CELLS)
    return mesh.vertices, mesh.faces


def _added_pieces(world: RecordedWorld, marks: Marks, names: Sequence[str]) -> Iterator[ScenePiece]:
    """Links that the robot's file draws nothing of, and surfaces of equations."""
    for upper, lower in world.links:
        along = world.model.body_pos[lower].copy()
        length = float(np.linalg.norm(along))
        if length > 0.0:
            turn = np.zeros(4)
            mujoco.mju_quatZ2Vec(turn, along)
            pose = np.concatenate([along / 2, _scalar_last(turn)])
            size = np.array([2 * LINK_RADIUS, 2 * LINK_RADIUS, length])
            yield ScenePiece(names[upper], names[upper], "cylinder", size, pose, LINK)
    kinds = {
        mujoco.mjtGeom.mjGEOM_BOX: "box",
        mujoco.mjtGeom.mjGEOM_SPHERE: "sphere",
        mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
    }
    for number, surface in enumerate(marks.surfaces, 1):
        turn = np.zeros(4)
        mujoco.mju_mat2Quat(turn, surface.rotation.ravel())
        pose = np.concatenate([surface.center, _scalar_last(turn)])
        owner, kind = f"equation{number}", kinds[surface.kind]
        yield ScenePiece(WORLD, owner, kind, 2 * surface.size, pose, SURFACE)


def _poses_of(
    world: RecordedWorld, rows: NDArray[np.int64], bodies: Sequence[int]
) -> Iterator[Vector]:
    """(k, 7) poses of each of some bodies in the world."""
    found = np.empty((len(bodies), len(rows), 7))
    for i, row in enumerate(rows if bodies else ()):
        data = world.show(int(row))
        found[:, i, :3] = data.xpos[bodies]
        found[:, i, 3:] = _scalar_last(data.xquat[bodies])
    yield from found


def _arrows(marks: Marks, rows: NDArray[np.int64]) -> dict[str, ArrowTrack]:
    k = len(rows)
    tracks = {
        name: ArrowTrack(np.zeros(k, bool), np.zeros((k, 3)), np.zeros((k, 3)), np.ones((k, 4)))
        for name in ARROWS
    }
    for i, row in enumerate(rows):
        for arm in marks.arms(int(row)):
            track = tracks["force" if arm.kind == "applied" else arm.name]
            track.shown[i] = True
            track.starts[i], track.ends[i], track.colors[i] = arm.start, arm.end, COLORS[arm.kind]
    return tracks


# Poses (k, 7): places, and unit quaternions x, y, z, w.


def _scalar_last(q: Vector) -> Vector:
    return np.roll(q, -1, axis=-1)


def _moved(by: Vector) -> Vector:
    return np.concatenate([by, _IDENTITY[3:]])


def _product(a: Vector, b: Vector) -> Vector:
    """(k, 4) products of quaternions (k, 4)."""
    v, w = a[:, :3], b[:, :3]
    s, t = a[:, 3:], b[:, 3:]
    return np.hstack([s * w + t * v + np.cross(v, w), s * t - np.sum(v * w, axis=1, keepdims=True)])


def _rotated(q: Vector, v: Vector) -> Vector:
    """(..., 3) vectors turned by quaternions (..., 4)."""
    u, s = q[..., :3], q[..., 3:]
    across = np.cross(u, v)
    return np.asarray(v + 2 * (s * across + np.cross(u, across)))


def _composed(a: Vector, b: Vector) -> Vector:
    """(k, 7) poses b, in frames that have the poses a."""
    return np.hstack([a[:, :3] + _rotated(a[:, 3:], b[:, :3]), _product(a[:, 3:], b[:, 3:])])
