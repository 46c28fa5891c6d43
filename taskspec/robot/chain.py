"""The flange of the arm in a robot's file, and the joints that move it."""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection, Sequence

import numpy as np
import pinocchio as pin

from taskspec.deferred import mujoco
from taskspec.deferred_methods import dataclass
from taskspec.robot.bounds import MOST_JOINTS
from taskspec.robot.errors import RobotError
from taskspec.robot.poses import pose, pose_of_rpy
from taskspec.robot.types import FlangeLike
from taskspec.text.codes import register

register(
    {
        "TS405": "a robot file that does not describe an arm",
        "TS406": "a flange that is unknown or ambiguous",
    }
)

FRAME_SITE = "taskspec:frame:"
"""What the names of the sites begin with that stand for MJCF's `<frame>` elements."""

# By the convention of ROS-Industrial z points out of `tool0`, and x out of a `flange` before it.
_USUAL = ("tool0", "flange", "attachment_site", "attachment")
_GRIPPING = re.compile(r"grip|finger|jaw|thumb|knuckle|claw|pinch", re.IGNORECASE)
#: Parts that branch off with so many joints, and with no fewer than carry them, are arms.
_ARM = 3


@dataclass(frozen=True, slots=True)
class Chain:
    """The joints that move the flange, and the flange.

    Attributes:
        joints: MuJoCo's joint ids from the base to the flange.
        body: MuJoCo's id of the body that carries the tool.
        flange: The flange's pose in that body; z points where the tool goes.
        explicit: Whether the flange was given by a frame rather than taken to be a body's.
        label: The name by which the flange goes.
        gripping: Names of a gripper's joints: beyond a flange that was searched, or among the
            chain's own where it was named.
        named: Whether the file named the flange.
    """

    joints: tuple[int, ...]
    body: int
    flange: pin.SE3
    explicit: bool
    label: str
    gripping: tuple[str, ...] = ()
    named: bool = False


def find_chain(m: mujoco.MjModel, flange: FlangeLike | None, coupled: Sequence[str] = ()) -> Chain:
    """The chain that ends in `flange`, or in the one body that can be meant.

    Joints at the end that by their names, or coupled to another one, are a gripper's are no joints
    of an arm whose flange is searched.

    Args:
        m: The robot's file, compiled.
        flange: A body, a site or a frame with a pose in it; without a name it is searched.
        coupled: Names of joints that follow another one, or that another one follows.

    Raises:
        RobotError: TS406 when the flange is unknown or not unique; TS405 when no hinge or slide
            moves it, or when a free or ball joint does.
    """
    name = None if flange is None else flange.body
    gripping = _gripping(m, coupled)
    body, pose_in_it, explicit, label = _named(m, name) if name else _end(m, gripping)
    if flange is not None and (any(flange.xyz) or any(flange.rpy)):
        pose_in_it = pose_in_it * pose_of_rpy(flange.xyz, flange.rpy)
        explicit = True
    joints: list[int] = []
    above = body
    while above:
        first = m.body_jntadr[above]
        joints[:0] = range(first, first + m.body_jntnum[above])
        above = m.body_parentid[above]
    field = ("flange",) if name else ("model",)
    if not joints:
        raise RobotError(
            "TS406" if name else "TS405",
            f"no joint moves '{label}'" if name else "the file has no hinge or slide joint",
            "name the body at the end of the arm as `flange`" if name else "",
            field,
        )
    if len(joints) > MOST_JOINTS:
        raise RobotError(
            "TS405",
            f"{len(joints)} joints move the end of the arm, more than {MOST_JOINTS}",
            "name the body at the end of one arm as `flange`",
            field,
        )
    for j in joints:
        if m.jnt_type[j] not in _moving():
            kind = "free" if m.jnt_type[j] == mujoco.mjtJoint.mjJNT_FREE else "ball"
            raise RobotError(
                "TS405",
                f"joint '{m.joint(j).name}' between the base and '{label}' is a {kind} joint",
                "an arm stands on a fixed base and has hinges and slides: remove the free joint"
                if kind == "free"
                else "replace the ball joint by three hinges",
            )
    if name:
        grip = [m.joint(j).name for j in joints if j in gripping]
    else:
        grip = [m.joint(j).name for j in sorted(gripping) if _moves(m, joints[-1], j)]
    return Chain(tuple(joints), body, pose_in_it, explicit, label, tuple(grip), bool(name))


def _gripping(m: mujoco.MjModel, coupled: Sequence[str]) -> frozenset[int]:
    """The joints that are a gripper's: by name or coupled to another, with all behind."""
    found: set[int] = set()
    arms: set[int] = set()  # Bodies behind which a joint that is none of a gripper moves something.
    for body in range(m.nbody - 1, 0, -1):
        first = m.body_jntadr[body]
        for j in range(first + m.body_jntnum[body] - 1, first - 1, -1):
            name = m.joint(j).name
            if body not in arms and (name in coupled or _GRIPPING.search(name)):
                found.add(j)
            else:
                arms.add(body)
        if body in arms:
            arms.add(int(m.body_parentid[body]))
    return frozenset(found)


def _moves(m: mujoco.MjModel, joint: int, other: int) -> bool:
    """Whether the body of a joint moves that of another one."""
    body = int(m.jnt_bodyid[other])
    while body and body != m.jnt_bodyid[joint]:
        body = int(m.body_parentid[body])
    return body > 0


def carrying(m: mujoco.MjModel, body: int) -> set[int]:
    """The joints that move a body."""
    found: set[int] = set()
    while body:
        first = int(m.body_jntadr[body])
        found.update(range(first, first + int(m.body_jntnum[body])))
        body = int(m.body_parentid[body])
    return found


def moves(m: mujoco.MjModel, chain: Chain, link: str) -> bool:
    """Whether a chain moves a link."""
    return bool(carrying(m, m.body(link).id) & set(chain.joints))


def _moving() -> tuple[int, int]:
    """The types of joints that an arm may have."""
    return int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)


def _named(m: mujoco.MjModel, name: str) -> tuple[int, pin.SE3, bool, str]:
    for site_name in (name, FRAME_SITE + name):
        site = mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_SITE, site_name)
        if site >= 0:
            return int(m.site_bodyid[site]), _site_pose(m, site), True, name
    body = mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_BODY, name)
    if body > 0:
        return body, pin.SE3.Identity(), False, name
    names = [m.body(i).name for i in range(1, m.nbody)]
    names += [m.site(i).name.removeprefix(FRAME_SITE) for i in range(m.nsite)]
    close = difflib.get_close_matches(name, names, 1)
    raise RobotError(
        "TS406",
        f"the robot has no body, site or frame '{name}'",
        f"did you mean '{close[0]}'?" if close else f"there are: {_listed(names)}",
        ("flange",),
    )


def _end(m: mujoco.MjModel, gripping: Collection[int]) -> tuple[int, pin.SE3, bool, str]:
    """The end of the longest chain of hinges and slides, where only one body can be it."""
    depth = np.zeros(m.nbody, dtype=int)
    beyond = np.zeros(m.nbody, dtype=bool)
    for body in range(1, m.nbody):
        first, parent = m.body_jntadr[body], m.body_parentid[body]
        joints = range(first, first + m.body_jntnum[body])
        beyond[body] = beyond[parent] or any(j in gripping for j in joints)
        depth[body] = depth[parent] + np.isin(m.jnt_type[list(joints)], _moving()).sum()
    depth[beyond] = 0
    longest = int(depth.max())
    at_end = [body for body in range(1, m.nbody) if depth[body] == longest]
    if not longest:
        return 0, pin.SE3.Identity(), False, "world"
    for name in _USUAL:
        sites = [s for s in range(m.nsite) if m.site(s).name == name]
        if sites and m.site_bodyid[sites[0]] in at_end:
            return int(m.site_bodyid[sites[0]]), _site_pose(m, sites[0]), True, name
        bodies = [body for body in at_end if m.body(body).name == name]
        if bodies:
            return bodies[0], pin.SE3.Identity(), False, name
    parents = {int(m.body_parentid[body]) for body in range(1, m.nbody) if not beyond[body]}
    leaves = [body for body in at_end if body not in parents]
    if len(leaves) == 1:
        return leaves[0], pin.SE3.Identity(), False, m.body(leaves[0]).name
    shared = _shared(m, leaves)
    own = int(longest - depth[shared])
    if own >= max(_ARM, depth[shared]) and len(arms := _branches(m, leaves, shared)) > 1:
        names = _listed([m.body(arm).name for arm in arms])
        raise RobotError(
            "TS406",
            f"the robot has {len(arms)} arms of {longest} joints",
            f"say which of them works, by the body that carries the tool: flange: {names}",
            ("model",),
        )
    candidates = ([shared] if shared else []) + leaves
    raise RobotError(
        "TS406",
        f"the robot ends in {len(leaves)} places",
        f"say which body carries the tool: flange: {_listed([m.body(i).name for i in candidates])}",
        ("model",),
    )


def _branches(m: mujoco.MjModel, leaves: list[int], shared: int) -> list[int]:
    """Of each part that branches off behind `shared`, the body through which its leaves go."""
    parts: dict[int, list[int]] = {}
    for leaf in leaves:
        body = leaf
        while m.body_parentid[body] != shared:
            body = int(m.body_parentid[body])
        parts.setdefault(body, []).append(leaf)
    return [_shared(m, part) for part in parts.values()]


def _shared(m: mujoco.MjModel, bodies: list[int]) -> int:
    """The last body through which all chains to `bodies` go; 0 is the world."""
    paths = []
    for body in bodies:
        path = [body]
        while path[-1]:
            path.append(int(m.body_parentid[path[-1]]))
        paths.append(path)
    return max(set(paths[0]).intersection(*paths[1:]))


def _site_pose(m: mujoco.MjModel, site: int) -> pin.SE3:
    return pose(m.site_pos[site], m.site_quat[site])


def _listed(names: list[str]) -> str:
    shown = [name for name in names if name][:12]
    return ", ".join(shown) + (", …" if len(names) > 12 else "")
