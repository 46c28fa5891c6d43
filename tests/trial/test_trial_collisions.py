"""What links run into: against MuJoCo's own distances of geoms, and against runs."""

from __future__ import annotations

import re

import mujoco
import numpy as np
import pytest
from trials import checked, found, serious

from taskspec.compiler import admit
from taskspec.examination import examine
from taskspec.robot.links import links_of
from taskspec.robot.pinocchio_model import Bodies, pinocchio_model
from taskspec.spec import load_text
from taskspec_runner.trial.collisions import Surroundings
from taskspec_runner.trial.trial import trial

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


def tried(text):
    """A trial, and the joint positions (k, n) of its ticks."""
    once = trial(admit(examine(load_text(text, "t.yaml"))))
    names = [f"joint.{i}.position" for i in range(1, 8)]
    return once, np.column_stack([once.history.columns[name] for name in names])


@pytest.mark.parametrize("thing", THINGS)
def test_the_first_collision_is_that_of_mujocos_geoms(thing):
    """Balls lie within the geoms: they meet later, by the dent of a row and the points of a rim."""
    plan = plan_of(UNFOLD.format(start=FOLDED, thing=THINGS[thing]))
    _, q = tried(UNFOLD.format(start=FOLDED, thing=THINGS[thing]))
    q, judge = q[::20], Judge(plan)
    met = [each for each in Surroundings(plan.context).first(q) if each[2] == "thing"]
    gaps = [judge.gap(each)[0] for each in q]
    assert bool(met) == (thing != "out of the way")
    if not met:
        # Nothing comes farther in than the balls may miss of a rim, and of a row.
        assert min(gaps) > -3e-3
        return
    ((row, link, _, depth),) = met
    assert gaps[row] < 0
    assert row <= min((i for i, gap in enumerate(gaps) if gap < -6e-3), default=len(gaps))
    assert 0 < depth <= -min(gaps) + 5e-3
    assert link == judge.gap(q[row])[1] or gaps[row] > -0.02


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
            short = 0.03 * size[0] if kind != "ELLIPSOID" else 0.1 * size.max()
            assert reaches - short <= balls <= reaches + 1e-12


def test_a_tool_that_is_a_thread_has_so_many_balls_and_no_more():
    text = UNFOLD.format(start=FOLDED, thing=THINGS["ball"])
    thin = text.replace("radius: 10 mm, length: 100 mm", "radius: 0.001 mm, length: 900 mm")
    links = plan_of(thin).context.robot.links
    assert len(links.radii) < 5000
    assert np.sum(links.link == links.names.index("tool")) > 100


def test_a_collision_is_reported_when_the_trial_comes_into_the_object():
    """Links of a run meet nothing; where its joints were, MuJoCo's geoms meet the object."""
    text = UNFOLD.format(start=FOLDED, thing=THINGS["ball"])
    once, q = tried(text)
    judge, clock = Judge(plan_of(text)), once.history.columns["clock"]
    inside = next(t for t, row in zip(clock[::10], q[::10], strict=True) if judge.gap(row)[0] < 0)
    (finding,) = (each for each in checked(text).findings if each.code == "TS428")
    (reported,) = re.findall(r"run time ([\d.]+) s", finding.message)
    # One configuration of the look is 20 mrad of the fastest joint: 38 ms; a millimetre is granted.
    assert inside <= float(reported) <= inside + 0.1
    assert "runs into 'thing'" in finding.message


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
    assert "TS428" not in serious(text)


def test_what_stands_in_an_endless_plane_from_the_start_is_beside_it():
    """The first links stand below the height of the table; in a box of that height they collide."""
    plane = UNFOLD.format(start=FOLDED, thing=THINGS["out of the way"])
    assert "TS428" not in serious(plane)
    box = "{shape: box, size: [1 m, 1 m, 300 mm], xyz: [0, 0, 150 mm]}"
    finding = found(UNFOLD.format(start=FOLDED, thing=box), "TS428")
    assert "at t = 0 s (run time 0 s), link 'link" in finding.message


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
    assert "TS428" not in serious(THIN.format(thick=thick, middle=320 - thick / 2, depth=depth))


def test_a_link_that_meets_the_side_is_told_though_the_tool_is_kept_out():
    """A wall beside the box: being kept on top does not take the links out of the wall."""
    text = THIN.format(thick=40, middle=300, depth=-28).replace(
        "frames:",
        "  wall: {shape: box, size: [50 mm, 800 mm, 1 m], xyz: [500 mm, 0, 950 mm]}\nframes:",
    )
    text = text.replace("world: {work: ", "world:\n  work: ").replace("30 deg]}}", "30 deg]}")
    finding = found(text, "TS428")
    assert "runs into 'wall'" in finding.message
    assert "run time 0 s" in finding.message
