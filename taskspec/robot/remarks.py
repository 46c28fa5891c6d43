"""What is worth saying of a robot's file that loads: its gripper, and where its flange points."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from taskspec.deferred import mujoco
from taskspec.robot.chain import Chain
from taskspec.robot.poses import pose
from taskspec.robot.types import FileRemark

if TYPE_CHECKING:
    import numpy.typing as npt

    Array = npt.NDArray[np.float64]

#: What is nearer to the last joint's axis than this does not say where the arm points [m].
_SHORTEST_OFFSET = 0.005
#: Cosine of 60 deg, beyond which z points elsewhere.
_AXIS_COSINE = 0.5
#: Turns that make z of a frame one of its other axes, as a task file writes them.
_TURNS = {
    (1, 0, 0): "[0, 90 deg, 0]",
    (-1, 0, 0): "[0, -90 deg, 0]",
    (0, 1, 0): "[-90 deg, 0, 0]",
    (0, -1, 0): "[90 deg, 0, 0]",
    (0, 0, -1): "[180 deg, 0, 0]",
}


def remarks(m: mujoco.MjModel, chain: Chain, home: Array) -> tuple[FileRemark, ...]:
    """What is worth saying of an arm that moves in space.

    Args:
        m: The robot's file, compiled.
        chain: Its arm.
        home: (nq,) configuration of the whole file.
    """
    return (*_gripper(chain), *_direction(m, chain, home))


def _gripper(chain: Chain) -> Iterator[FileRemark]:
    joints = ", ".join(f"'{name}'" for name in chain.gripping)
    if not chain.gripping:
        return
    one = len(chain.gripping) == 1
    if chain.named:
        yield FileRemark(
            "TS440",
            f"{'joint' if one else 'joints'} {joints} of the arm {'looks' if one else 'look'} like "
            "a gripper's: it opens and closes to move the tool",
            "name the body that carries the gripper as `flange`, if the arm ends there",
            ("flange",),
        )
    else:
        yield FileRemark(
            "TS440",
            f"the arm ends at '{chain.label}': {'joint' if one else 'joints'} {joints} behind it "
            f"{'is' if one else 'are'} taken for a gripper's and locked",
            "name the body that carries the tool as `flange`, if it is another",
            ("model",),
        )


def _direction(m: mujoco.MjModel, chain: Chain, home: Array) -> Iterator[FileRemark]:
    """Says it where the flange is a body's frame whose z is not where the arm goes on."""
    if chain.explicit:
        return
    outwards = _outwards(m, chain, home)
    if outwards is None:
        return
    cosine = float(outwards[2]) / math.sqrt(outwards @ outwards)
    if cosine >= _AXIS_COSINE:
        return
    nearest = np.zeros(3, dtype=int)
    i = int(np.abs(outwards).argmax())
    nearest[i] = int(np.sign(outwards[i]))
    turn = _TURNS[tuple(nearest.tolist())]
    axis = f"{'-' if nearest[i] < 0 else ''}{'xyz'[i]}"
    line = f"flange: {{body: {chain.label}, rpy: {turn}}}"
    yield FileRemark(
        "TS441",
        f"the tool goes along z of '{chain.label}', and the arm goes on along its {axis}: they are "
        f"{math.degrees(math.acos(cosine)):.0f} deg apart",
        f"{line} turns the tool there; a `flange` with an "
        "rpy of yours, or a site, is taken as it is",
        ("flange",) if chain.named else ("model",),
        line,
    )


def _outwards(m: mujoco.MjModel, chain: Chain, home: Array) -> Array | None:
    """Where the arm goes on from its last joint, in the flange's frame (3,); None if unclear.

    That is where the flange lies from the joint and, where it lies on it, where the masses or the
    shapes lie that the joint moves.
    """
    last = chain.joints[-1]
    if m.jnt_type[last] != mujoco.mjtJoint.mjJNT_HINGE:
        return None
    data = mujoco.MjData(m)
    data.qpos[:] = home
    mujoco.mj_kinematics(m, data)
    mujoco.mj_comPos(m, data)
    flange = pose(data.xpos[chain.body], data.xquat[chain.body]) * chain.flange
    moved = int(m.jnt_bodyid[last])
    middle = flange.translation
    if math.dist(middle, data.xanchor[last]) > _SHORTEST_OFFSET:
        pass
    elif m.body_subtreemass[moved] > 1e-6:
        middle = data.subtree_com[moved]
    else:
        centers = [data.geom_xpos[g] for g in range(m.ngeom) if _below(m, m.geom_bodyid[g], moved)]
        if not centers:
            return None
        middle = np.mean(centers, axis=0)
    found: Array = flange.rotation.T @ (middle - data.xanchor[last])
    size = math.sqrt(found @ found)
    # A drive that lies behind its own flange is usual, and so is a flange behind its joint's frame.
    return None if size < _SHORTEST_OFFSET or found[2] < -_AXIS_COSINE * size else found


def _below(m: mujoco.MjModel, body: int, above: int) -> bool:
    while body and body != above:
        body = int(m.body_parentid[body])
    return bool(body)
