"""What links run into: against MuJoCo's own distances of geoms, and against runs."""

from __future__ import annotations

import casadi as ca
import mujoco
import numpy as np
import pytest
from taskspec_runner.trial.kept_out import KeptOut

from taskspec.examination import examine
from taskspec.program.bound import RowFunction
from taskspec.robot.links import links_of
from taskspec.robot.pinocchio_model import Bodies, pinocchio_model
from taskspec.shapes import Plane, Sphere
from taskspec.shapes.box import Box
from taskspec.spec import load_text
from taskspec_runner import run
from taskspec_runner.trial.collisions import TOOL_END, Surroundings, _along

FOLDED = "[0, -1.2 rad, 0, -2.8 rad, 0, 1.6 rad, 0.7854 rad]"
UNFOLD = """
taskspec: 1
robot:
  model: panda
  tool: {{shape: sphere, radius: 10 mm, length: 100 mm, mass: 300 g}}
  start: {{joints: {start}}}
world:
  table: {{shape: plane, xyz: [0, 0, 200 mm]}}
  thing: {thing}
stages:
  unfold: {{path: {{joints: [0, 0, 0, -120 deg, 0, 120 deg, 45 deg], speed: 30 deg/s}}}}
  swing: {{path: {{joints: [40 deg, 0, 0, -120 deg, 0, 120 deg, 45 deg], speed: 30 deg/s}}}}
"""
THINGS = {
    "post": "{shape: cylinder, radius: 40 mm, length: 400 mm, xyz: [450 mm, 0, 700 mm]}",
    "ball": "{shape: sphere, radius: 90 mm, xyz: [400 mm, 0, 750 mm]}",
    "block": "{shape: box, size: [160 mm, 300 mm, 200 mm], xyz: [480 mm, 0, 680 mm]}",
    "wall": "{shape: plane, xyz: [500 mm, 0, 0], rpy: [0, -90 deg, 0]}",
    "out of the way": "{shape: sphere, radius: 50 mm, xyz: [-600 mm, 0, 400 mm]}",
}


def plan_of(text):
    return examine(load_text(text, "t.yaml")).plan


def geom_of(spec, thing):
    """MuJoCo's geom of an object, in a copy of the arm's specification."""
    size = {
        "sphere": lambda: [thing.sizes["radius"], 0, 0],
        "cylinder": lambda: [thing.sizes["radius"], thing.sizes["length"] / 2, 0],
        "box": lambda: [x / 2 for x in thing.sizes["size"]],
        "plane": lambda: [5, 5, 1],
    }[thing.shape]()
    kind = getattr(mujoco.mjtGeom, f"mjGEOM_{thing.shape.upper()}")
    quat = np.zeros(4)
    mujoco.mju_euler2Quat(quat, np.array(thing.rpy), "XYZ")
    spec.worldbody.add_geom(name="thing", type=kind, size=size, pos=thing.xyz, quat=quat)


class Judge:
    """Where links are in the object, by MuJoCo's geoms."""

    def __init__(self, plan):
        robot = plan.context.robot
        spec = robot.spec.copy()
        geom_of(spec, plan.context.loaded.task.shapes["thing"])
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.thing = self.model.geom("thing").id
        moving = {robot.links.names.index(n): n for n in robot.links.names}
        self.geoms = [
            g
            for g in range(self.model.ngeom)
            if self.model.body(self.model.geom_bodyid[g]).name in moving.values()
        ]

    def gap(self, q):
        """The least distance of a link from the object, and which link that is."""
        self.data.qpos[:] = q
        mujoco.mj_kinematics(self.model, self.data)
        gaps = {
            g: mujoco.mj_geomDistance(self.model, self.data, g, self.thing, 2.0, None)
            for g in self.geoms
        }
        nearest = min(gaps, key=gaps.get)
        return gaps[nearest], self.model.body(self.model.geom_bodyid[nearest]).name


@pytest.mark.parametrize("thing", THINGS)
def test_the_first_collision_is_that_of_mujocos_geoms(thing):
    """Balls lie within the geoms: they meet later, by the dent of a row and the points of a rim."""
    plan = plan_of(UNFOLD.format(start=FOLDED, thing=THINGS[thing]))
    surroundings, judge = Surroundings(plan.context), Judge(plan)
    found = 0
    for stage in plan.framed.values():
        met = surroundings.first(stage)
        times, configurations = _along(stage.nominal.passage.instants)
        gaps = [judge.gap(q)[0] for q in configurations]
        if met is None:
            # Nothing comes farther in than the balls may miss of a rim, and of a row.
            assert min(gaps) > -3e-3
            continue
        found += 1
        at = times.index(met.time)
        assert gaps[at] < 0
        before = [t for t, gap in zip(times, gaps, strict=True) if gap < -5e-3]
        assert met.time <= min(before, default=np.inf)
        if met.part != TOOL_END:
            nearest = judge.gap(configurations[at])[1]
            assert judge.gap(configurations[at])[0] < 0
            assert met.part == nearest or gaps[at] > -0.02
    assert bool(found) == (thing != "out of the way")


def test_balls_lie_within_their_geoms_and_reach_nearly_as_far():
    """Along any way, by the support of both: never farther, and short of it by 3 % of a radius."""
    m = mujoco.MjModel.from_xml_string("""<mujoco><worldbody><body name="a"><joint axis="0 0 1"/>
      <geom type="capsule" size="0.05 0.2" pos="0.1 0 0" euler="20 30 0"/>
      <geom type="cylinder" size="0.06 0.1" euler="0 50 0"/><geom type="sphere" size="0.07"/>
      <geom type="cylinder" size="0.08 0.01" pos="0 0.1 0"/>
      <geom type="box" size="0.03 0.1 0.05" euler="10 20 30" pos="0 0 0.2"/>
      <geom type="ellipsoid" size="0.03 0.1 0.05"/></body></worldbody></mujoco>""")
    _, carried = pinocchio_model(Bodies.of(m))
    data = mujoco.MjData(m)
    mujoco.mj_kinematics(m, data)
    random = np.random.default_rng(5)
    for g in range(m.ngeom):
        one = m.geom_type.copy()
        others = np.arange(m.ngeom) != g
        m.geom_type[others] = mujoco.mjtGeom.mjGEOM_PLANE
        links = links_of(m, carried, -1, 0.0)
        m.geom_type[:] = one
        kind, size = mujoco.mjtGeom(int(m.geom_type[g])).name[7:], m.geom_size[g]
        R, p = data.geom_xmat[g].reshape(3, 3), data.geom_xpos[g]
        for way in random.normal(size=(200, 3)):
            n = way / np.linalg.norm(way)
            u = R.T @ n
            reaches = float(p @ n) + {
                "SPHERE": lambda _, s: s[0],
                "CAPSULE": lambda u, s: s[0] + s[1] * abs(u[2]),
                "CYLINDER": lambda u, s: s[0] * np.hypot(u[0], u[1]) + s[1] * abs(u[2]),
                "BOX": lambda u, s: np.abs(u) @ s,
                "ELLIPSOID": lambda u, s: np.linalg.norm(u * s),
            }[kind](u, size)
            balls = float(np.max(links.centers @ n + links.radii))
            short = 0.03 * size[0] if kind != "ELLIPSOID" else 0.5 * size.max()
            assert reaches - short <= balls <= reaches + 1e-12


def test_a_tool_that_is_a_thread_has_so_many_balls_and_no_more():
    text = UNFOLD.format(start=FOLDED, thing=THINGS["ball"])
    thin = text.replace("radius: 10 mm, length: 100 mm", "radius: 0.001 mm, length: 900 mm")
    links = plan_of(thin).context.robot.links
    assert len(links.radii) < 5000
    assert np.sum(links.link == links.names.index("tool")) > 100


def test_a_run_comes_into_the_object_when_it_is_announced(tmp_path):
    """Links of a run meet nothing; where its joints were, MuJoCo's geoms meet the object."""
    text = UNFOLD.format(start=FOLDED, thing=THINGS["ball"])
    plan = plan_of(text)
    stage = next(iter(plan.framed.values()))
    met = Surroundings(plan.context).first(stage)
    done = run(load_text(text, "t.yaml", base=tmp_path), tmp_path / "run", report=False, force=True)
    columns, judge = done.history.columns, Judge(plan)
    q = np.column_stack([columns[f"joint.{i}.position"] for i in range(1, 8)])
    clock = columns["clock"]
    inside = next(t for t, row in zip(clock[::10], q[::10], strict=True) if judge.gap(row)[0] < 0)
    # One configuration of the look is 20 mrad of the fastest joint: 38 ms; a millimetre is granted.
    assert inside <= met.time <= inside + 0.1


@pytest.mark.parametrize(
    ("law", "depth"), [("impedance-natural", "-30 mm"), ("impedance-natural", "-100 mm")]
)
def test_a_reference_inside_an_object_does_not_take_the_arm_there(law, depth):
    text = f"""
taskspec: 1
robot: {{model: panda, tool: {{shape: sphere, radius: 10 mm, length: 100 mm, mass: 300 g}},
  start: {{xyz: [500 mm, 0, 310 mm]}}}}
world: {{table: {{shape: plane, xyz: [0, 0, 300 mm]}}}}
frames: {{task: {{surface: table}}}}
frame: task
law: {{kind: {law}, stiffness: {{linear: 500 N/m}}}}
limits: {{force: 200 N}}
stages: {{press: {{axes: {{z: {{position: {depth}}}}}, time: 1 s}}}}
"""
    plan = plan_of(text)
    assert Surroundings(plan.context).first(next(iter(plan.framed.values()))) is None


def test_what_stands_in_an_endless_plane_from_the_start_is_beside_it():
    """The first links stand below the height of the table; in a box of that height they collide."""
    plane = UNFOLD.format(start=FOLDED, thing=THINGS["out of the way"])
    assert "TS428" not in [d.code for d in examine(load_text(plane, "t.yaml")).findings]
    box = "{shape: box, size: [1 m, 1 m, 300 mm], xyz: [0, 0, 150 mm]}"
    found = examine(load_text(UNFOLD.format(start=FOLDED, thing=box), "t.yaml")).findings
    (told,) = [d for d in found if d.code == "TS428"][:1]
    assert "where it begins, link 'link" in told.message


THIN = """
taskspec: 1
robot: {{model: panda, tool: {{shape: sphere, radius: 6 mm, length: 141 mm, mass: 300 g}},
  start: {{xyz: [500 mm, 0, 326 mm]}}}}
world: {{work: {{shape: box, size: [190 mm, 260 mm, {thick} mm], xyz: [500 mm, 0, {middle} mm],
  rpy: [0, 0, 30 deg]}}}}
frames: {{task: {{surface: work}}}}
frame: task
law: {{kind: pd, stiffness: {{linear: 500 N/m}}}}
limits: {{force: 200 N}}
stages:
  press: {{axes: {{z: {{position: {depth} mm}}}}, time: 1 s}}
  leave: {{axes: {{z: {{move: 14 mm, speed: 100 mm/s}}}}}}
"""


@pytest.mark.parametrize("thick", [3, 40, 100])
@pytest.mark.parametrize("depth", [-4, -28.333, -60])
def test_a_thin_box_keeps_the_tool_out_past_its_middle_and_beyond(thick, depth):
    """The spring's reference leads inside or through; the tool's end stays on top of it."""
    plan = plan_of(THIN.format(thick=thick, middle=320 - thick / 2, depth=depth))
    surroundings = Surroundings(plan.context)
    assert [surroundings.first(stage) for stage in plan.framed.values()] == [None, None]


def test_how_far_a_box_a_ball_and_a_plane_keep_it_back():
    """Against closed forms: to the face on which it came in, also from beyond."""
    box = Box(np.zeros(3), np.eye(3), np.array([0.2, 0.2, 0.04]))
    ball = Sphere(np.array([1.0, 0, 0]), np.eye(3), 0.1)
    plane = Plane(np.array([0, 0, -1.0]), np.eye(3))
    radius = 0.01
    heights = np.array([0.05, 0.025, 0.01, -0.015, -0.05, 0.0, 0.05, -0.05])

    def follow(kept, xyz):
        centers = np.asarray(xyz)[:, np.newaxis]
        functions = [RowFunction(ca.Function("d", [x], [s.distance(x)])) for s in surfaces]
        gaps = np.stack([f(centers[:, 0])[0] for f in functions], axis=-1) - radius
        return kept.follow(centers, gaps)

    x, surfaces = ca.SX.sym("x", 3), (box, ball, plane)
    kept = KeptOut(surfaces, np.array([radius]))
    over = np.column_stack([0 * heights, 0 * heights, heights])
    top = np.maximum(0.02 + radius - heights, 0.0)
    # The last one is below without having come through the top since it was free.
    top[-1] = 0.0
    assert follow(kept, over) == pytest.approx(np.outer(top, [0, 0, 1]), abs=1e-5)
    # Into the ball from above, off its axis: back up to where its own height is.
    side, z = 0.03, np.array([0.2, 0.09, 0.0, -0.2])
    found = follow(kept, np.column_stack([np.full(4, 1 + side), 0 * z, z]))
    normal = np.array([side, 0, 0.2]) / np.hypot(side, 0.2)
    for at, back in zip(z[1:3], found[1:3], strict=True):
        assert np.cross(back, normal) == pytest.approx(0, abs=1e-9)
        assert np.hypot(side + back[0], at + back[2]) == pytest.approx(0.1 + radius, abs=1e-5)
    deep = follow(kept, [[3, 0, -0.9], [3, 0, -1.2], [3, 0, -0.9]])
    assert deep == pytest.approx(np.array([[0, 0, 0], [0, 0, 0.21], [0, 0, 0]]), abs=1e-9)


def test_a_link_that_meets_the_side_is_told_though_the_tool_is_kept_out():
    """A wall beside the box: being kept on top does not take the links out of the wall."""
    text = THIN.format(thick=40, middle=300, depth=-28).replace(
        "frames:",
        "  wall: {shape: box, size: [50 mm, 800 mm, 1 m], xyz: [500 mm, 0, 950 mm]}\nframes:",
    )
    text = text.replace("world: {work: ", "world:\n  work: ").replace("30 deg]}}", "30 deg]}")
    plan = plan_of(text)
    met = Surroundings(plan.context).first(next(iter(plan.framed.values())))
    assert met is not None
    assert (met.object, met.time) == ("wall", 0)
