"""A tool on springs over a hole, a slot, a groove, a plate or a solid: contact without an arm."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.shapes import overlap, patches
from taskspec_runner.plant.whole import collision, contacts

Vector = NDArray[np.float64]

IMPEDANCE = 0.02
_AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1", "b": "0 1 0"}
_NOTHING: Mapping[str, float] = {}


class Rig:
    """A tool whose tip is the origin of its joints.

    Attributes:
        model, data: MuJoCo's.
    """

    def __init__(
        self,
        kind: int,
        sizes: Sequence[float],
        tool: tuple[int, tuple[float, float, float]],
        *,
        joints: str = "xzb",
        stiffness: float = 200e3,
        friction: float = 0.0,
        springs: Mapping[str, float] = _NOTHING,
        dampers: Mapping[str, float] = _NOTHING,
        tilt: float = 0.0,
        height: float = 0.0,
        mass: float = 0.5,
        rounding: float = 2e-6,
        at: tuple[float, float, float] = (0.0, 0.0, 0.0),
        lying: bool = False,
        damped: bool = True,
    ) -> None:
        """A tool over a shape.

        Args:
            kind, sizes, tool: as `patches` has them.
            joints: of the tool, slides along x, y, z and a hinge b about y.
            stiffness, friction: of the contact.
            springs, dampers: of the joints.
            tilt: of the tool about y [rad].
            height: of its tip [m].
            mass: of it [kg].
            rounding: of it [m].
            at: where the shape is [m].
            lying: whether the shape's z is along y.
            damped: whether the contact is.
        """
        lines = "".join(
            f"<joint name='{c}' type='{'hinge' if c == 'b' else 'slide'}' axis='{_AXES[c]}' "
            f"stiffness='{springs.get(c, 0)}' damping='{dampers.get(c, 0)}'/>"
            for c in joints
        )
        up = tool[1][2]
        self.model = mujoco.MjModel.from_xml_string(f"""
            <mujoco><compiler angle='radian'/><size nuser_geom='{contacts.DATA}'/>
            <option timestep='0.001' gravity='0 0 0' cone='elliptic' impratio='10000'
              tolerance='1e-14' integrator='Euler'/>
            <worldbody><geom name='shape' type='ellipsoid' size='1 1 1' contype='0'
              conaffinity='0' pos='{at[0]} {at[1]} {at[2]}' euler='{lying * math.pi / 2} 0 0'/>
            <body pos='0 0 {height}'>{lines}
            <inertial pos='0 0 0' mass='{mass}' diaginertia='5e-4 5e-4 5e-4'/>
            <geom name='tool' type='ellipsoid' size='1 1 1' contype='0' conaffinity='0'
              pos='{up * math.sin(tilt)} 0 {up * math.cos(tilt)}'
              euler='{math.pi} {-tilt} 0'/></body></worldbody>
            <contact><pair geom1='shape' geom2='tool' condim='3'/></contact></mujoco>""")
        mobility = float(self.model.body_invweight0[1, 0])
        damping = 0.2 * math.sqrt(stiffness * mass) if damped else 0.0
        settling = min(damping * (1 - IMPEDANCE) * mobility / IMPEDANCE, 500.0)
        shape, geom = (self.model.geom(name).id for name in ("shape", "tool"))
        contact = [stiffness, damping, friction, mobility, settling, IMPEDANCE]
        padded = [*sizes, *([0.0] * (6 - len(sizes)))]
        self.model.geom_user[shape, :14] = [contacts.SHAPE, kind, *padded, *contact]
        self.model.geom_user[geom, :6] = [contacts.TOOL, tool[0], *tool[1], rounding]
        for geom_id in (shape, geom):
            collision.connect(self.model, geom_id, geom_id)
        collision.install()
        self.data = mujoco.MjData(self.model)

    def step(self, count: int) -> None:
        """Makes steps of 1 ms."""
        mujoco.mj_step(self.model, self.data, count)

    def forces(self) -> list[tuple[Vector, Vector, Vector]]:
        """Of each contact its place, its normal, and the force on the tool (3,) [N], world."""
        found = []
        for number, contact in enumerate(self.data.contact):
            force = np.zeros(6)
            mujoco.mj_contactForce(self.model, self.data, number, force)
            axes = contact.frame.reshape(3, 3)
            found.append((contact.pos.copy(), axes[0].copy(), axes.T @ force[:3]))
        return found

    def force(self) -> Vector:
        """(3,) sum of all forces on the tool [N]."""
        return np.sum([f for _, _, f in self.forces()], axis=0) if self.data.ncon else np.zeros(3)


R, PEG = 0.010, 0.0099
#: Solids whose highest point, face or line is at z = 0 where they are `at` its last number.
SOLIDS = {
    "box": (overlap.BOX, (0.05, 0.04, 0.02), (0.0, 0.0, -0.02), False),
    "cylinder": (overlap.CYLINDER, (0.03, 0.03, 0.05), (0.0, 0.0, -0.05), False),
    "lying": (overlap.CYLINDER, (0.03, 0.03, 0.05), (0.0, 0.0, -0.03), True),
    "sphere": (overlap.BALL, (0.04, 0.04, 0.04), (0.0, 0.0, -0.04), False),
}
PEGS = {
    "cylinder": (overlap.CYLINDER, (0.0099, 0.0099, 0.03)),
    "box": (overlap.BOX, (0.0095, 0.0099, 0.03)),
    "sphere": (overlap.BALL, (0.0099, 0.0099, 0.0099)),
}


def press(
    kind: int,
    sizes: Sequence[float],
    tool: str,
    stiffness: float,
    tilt: float,
    at: tuple[float, float, float] = (0.0, 0.0, 0.0),
    lying: bool = False,
) -> float:
    """Measured over declared stiffness of a press along z, between 20 N and 40 N."""
    rig = Rig(
        kind, sizes, PEGS[tool], joints="z", stiffness=stiffness, tilt=tilt, height=0.03,
        dampers={"z": 400.0}, at=at, lying=lying,
    )  # fmt: skip
    depths = []
    for force in (20.0, 40.0):
        rig.data.qfrc_applied[:] = -force
        rig.step(6000)
        depths.append(float(rig.data.qpos[0]))
    return 20.0 / (depths[0] - depths[1]) / stiffness


def press_on(solid: str, tool: str, stiffness: float, tilt: float, aside: float = 0.0) -> float:
    """The same on a solid of `SOLIDS`, whose highest point is under the lowest of the tool.

    Args:
        solid, tool: names.
        stiffness: of the contact.
        tilt: of the tool about y [rad].
        aside: how much farther along x the solid is [m].
    """
    kind, sizes, at, lying = SOLIDS[solid]
    half = PEGS[tool][1]
    lowest = 0.0 if tilt == 0 or tool == "sphere" else half[0] * math.cos(tilt)
    if tool == "sphere":
        lowest = half[2] * math.sin(tilt)
    elif math.isclose(tilt, math.pi / 2):
        lowest = half[2]
    place = (lowest + aside, 0.0, at[2])
    return press(kind, (*sizes, 5e-6), tool, stiffness, tilt, place, lying)


def thrown(solid: str, tool: str, seed: int) -> float:
    """Kinetic energy of a tool after it has bounced off a solid, over that before.

    Neither friction nor damping; steps of 0.1 ms.
    """
    kind, sizes, at, lying = SOLIDS[solid]
    rng = np.random.default_rng(seed)
    rig = Rig(
        kind, (*sizes, 5e-6), PEGS[tool], stiffness=20e3, height=0.008, at=at, lying=lying,
        damped=False, tilt=rng.uniform(-0.5, 0.5),
    )  # fmt: skip
    rig.model.opt.timestep = 1e-4
    rig.data.qvel[:] = [rng.uniform(-0.1, 0.1), -0.2, rng.uniform(-5.0, 5.0)]

    def energy() -> float:
        moved = np.zeros(3)
        mujoco.mj_forward(rig.model, rig.data)
        mujoco.mj_mulM(rig.model, rig.data, moved, rig.data.qvel)
        return 0.5 * float(rig.data.qvel @ moved)

    before, touched = energy(), False
    for _ in range(5000):
        rig.step(1)
        touched = touched or rig.data.ncon > 0
        if touched and rig.data.ncon == 0 and rig.data.qvel[1] > 0:
            return energy() / before
    raise AssertionError("it never came off")


def two_points(
    friction: float, depth: float, moment: float, side: float
) -> tuple[float, float, float]:
    """A tilted peg that is pushed in slowly, touching at two points.

    Args:
        friction: Coulomb's coefficient.
        depth: of insertion [m].
        moment: about y at the tip [N m].
        side: force along x at the tip [N].

    Returns:
        The axial force [N]; the one of statics at its pose; the one of Whitney's diagram.
    """
    tool = (overlap.CYLINDER, (PEG, PEG, 0.06))
    rig = Rig(
        patches.HOLE, (R, 0.09, 0.0), tool, friction=friction, springs={"z": 1e6},
        dampers={"x": 20.0, "z": 500.0, "b": 0.05}, height=0.0005 - depth,
    )  # fmt: skip
    found = []
    for i in range(1200):
        load = min(1.0, i / 300)
        rig.data.qfrc_applied[0], rig.data.qfrc_applied[2] = side * load, moment * load
        rig.model.qpos_spring[1] = -1e-6 * i
        rig.step(1)
        if i >= 1000:
            found.append((rig.force()[2], *_predicted(rig, friction, moment, side)))
    measured, statics, whitney = np.mean(found, axis=0)
    return float(measured), float(statics), float(whitney)


def _predicted(rig: Rig, mu: float, moment: float, side: float) -> tuple[float, float]:
    tip = np.array([rig.data.qpos[0], 0.0, rig.data.geom_xpos[1][2] - 0.06 * math.cos(
        float(rig.data.qpos[2]))])  # fmt: skip
    ways, depth = [], 0.0
    for place, normal, _ in rig.forces():
        # Both points of the peg slide down: friction pushes them up, across the normal.
        up = np.array([-normal[2], 0.0, normal[0]])
        up = up if up[2] > 0 else -up
        force = normal + mu * up
        arm = place - tip
        ways.append((force[0], arm[2] * force[0] - arm[0] * force[2], force[2]))
        depth = max(depth, -float(place[2]))
    A = np.array(ways)
    pushes = np.linalg.solve(A[:, :2].T, -np.array([side, moment]))
    lam = depth / (2 * PEG * mu)
    return float(A[:, 2] @ pushes), (abs(moment) / PEG - mu * (1 + lam) * side) / lam


def wedged(friction: float, ratio: float) -> float:
    """Share of the forces across a tilted peg that stays when its moment is taken away.

    Args:
        friction: Coulomb's coefficient.
        ratio: depth of insertion over friction times diameter.
    """
    depth, force = 2 * R * friction * ratio, 20.0
    rig = Rig(
        patches.HOLE, (R, 0.09, 0.0), (overlap.CYLINDER, (PEG, PEG, 0.06)), friction=friction,
        dampers={"x": 20.0, "z": 20.0, "b": 0.02}, height=-depth,
    )  # fmt: skip
    for i in range(1500):
        rig.data.qfrc_applied[2] = force * depth * min(1.0, i / 500)
        rig.step(1)
    before = sum(float(np.linalg.norm(f)) for _, _, f in rig.forces())
    for i in range(500):
        rig.data.qfrc_applied[2] = force * depth * (1 - i / 500)
        rig.step(1)
    rig.data.qfrc_applied[:] = 0.0
    rig.step(1500)
    return sum(float(np.linalg.norm(f)) for _, _, f in rig.forces()) / before


def chamfer(friction: float, stiffness: float, depth: float) -> tuple[Vector, Vector]:
    """Force on a peg, held by a spring of 1 kN/m along x, that slides down a chamfer.

    Returns:
        (2,) along x and z: measured, and in closed form.
    """
    spring, offset, cut = 1000.0, 0.0025, 0.003
    rig = Rig(
        patches.HOLE, (R, 0.09, cut), (overlap.CYLINDER, (PEG, PEG, 0.06)), joints="xz",
        stiffness=stiffness, friction=friction, springs={"x": spring, "z": 1e6},
        dampers={"x": 2.0, "z": 2000.0},
    )  # fmt: skip
    rig.model.qpos_spring[0] = rig.data.qpos[0] = offset
    for i in range(4000):
        rig.model.qpos_spring[1] = -depth * i / 4000
        rig.step(1)
    way = offset + PEG - R - cut - float(rig.data.qpos[1])
    # The contact's own yielding is along its normal, at 45 degrees.
    push = spring * way / ((1 - friction) / math.sqrt(2) + math.sqrt(2) * spring / stiffness)
    expected = push / math.sqrt(2) * np.array([-(1 - friction), 1 + friction])
    return rig.force()[[0, 2]], expected
