"""Where the arm of a robot's file ends, and which of its joints move that end."""

from __future__ import annotations

import difflib

import numpy as np
import pinocchio as pin

from taskspec.deferred import mujoco
from taskspec.deferred_methods import dataclass
from taskspec.robot.bounds import MOST_JOINTS
from taskspec.robot.errors import RobotError
from taskspec.robot.poses import pose
from taskspec.text.codes import register

register(
    {
        "TS405": "a robot file that does not describe an arm",
        "TS406": "a flange that is unknown or cannot be told",
    }
)

FRAME_SITE = "taskspec:frame:"
"""What the names of the sites begin with that stand for MJCF's `<frame>` elements."""

# By the convention of ROS-Industrial z points out of `tool0`, and x out of a `flange` before it.
_USUAL = ("tool0", "flange", "attachment_site", "attachment")


@dataclass(frozen=True, slots=True)
class Chain:
    """The joints that move the flange, and the flange.

    Attributes:
        joints: MuJoCo's joint ids from the base to the flange.
        body: MuJoCo's id of the body that carries the tool.
        flange: The flange's pose in that body; z points where the tool goes.
        explicit: Whether the flange was given by a frame rather than taken to be a body's.
        label: The name by which the flange goes.
    """

    joints: tuple[int, ...]
    body: int
    flange: pin.SE3
    explicit: bool
    label: str


def find_chain(m: mujoco.MjModel, flange: str | None) -> Chain:
    """The chain that ends in `flange`, or in the one body that can be meant.

    Args:
        m: The robot's file, compiled.
        flange: Name of a body, a site or a frame; None to look for it.

    Raises:
        RobotError: TS406 when the flange is unknown or not unique; TS405 when no hinge or slide
            moves it, or when a free or ball joint does.
    """
    found = _named(m, flange) if flange is not None else _end(m)
    body = found[0]
    joints: list[int] = []
    while body:
        first = m.body_jntadr[body]
        joints[:0] = range(first, first + m.body_jntnum[body])
        body = m.body_parentid[body]
    label = found[3]
    if not joints:
        raise RobotError(
            "TS406" if flange else "TS405",
            f"no joint moves '{label}'" if flange else "the file has no hinge or slide joint",
            "name the body at the end of the arm as `flange`" if flange else "",
            ("flange",) if flange else ("model",),
        )
    if len(joints) > MOST_JOINTS:
        raise RobotError(
            "TS405",
            f"{len(joints)} joints move the end of the arm, more than {MOST_JOINTS}",
            "name the body at the end of one arm as `flange`",
            ("flange",) if flange else ("model",),
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
    return Chain(tuple(joints), *found)


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


def _end(m: mujoco.MjModel) -> tuple[int, pin.SE3, bool, str]:
    """The end of the longest chain of hinges and slides, where only one body can be it."""
    depth = np.zeros(m.nbody, dtype=int)
    for body in range(1, m.nbody):
        first = m.body_jntadr[body]
        kinds = m.jnt_type[first : first + m.body_jntnum[body]]
        depth[body] = depth[m.body_parentid[body]] + np.isin(kinds, _moving()).sum()
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
    parents = set(m.body_parentid[1:].tolist())
    leaves = [body for body in at_end if body not in parents]
    if len(leaves) == 1:
        return leaves[0], pin.SE3.Identity(), False, m.body(leaves[0]).name
    shared = _shared(m, leaves)
    candidates = ([shared] if shared else []) + leaves
    raise RobotError(
        "TS406",
        f"the robot ends in {len(leaves)} places",
        f"say which body carries the tool: flange: {_listed([m.body(i).name for i in candidates])}",
        ("model",),
    )


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
