"""What a robot's file ties together: joints that follow others, tendons, and loops.

MuJoCo's `<equality>` of joints and of fixed tendons, and URDF's `<mimic>`, which MuJoCo reads as
one, are linear in the joints: C q = d. They are solved for the joints that follow, and the rest are
the arm's coordinates. What is not linear, and what closes a loop, is refused where it moves the
flange; elsewhere nothing has to be said, since joints that do not move it are locked.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import field
from typing import TYPE_CHECKING

import numpy as np

from taskspec.deferred import mujoco
from taskspec.deferred_methods import dataclass
from taskspec.robot.chain import Chain, carrying
from taskspec.robot.coupling import JointCoupling
from taskspec.robot.description import Description, driven_joints, torque_limit
from taskspec.robot.errors import RobotError
from taskspec.robot.types import FileRemark

if TYPE_CHECKING:
    import numpy.typing as npt

    Array = npt.NDArray[np.float64]

#: Ratios and offsets of a file that mean something stay below this.
_LARGEST = 1e6
#: Ratios and offsets of a row that rounding alone keeps from 0.
_ROUNDING = 1e-9
_OPEN = (
    "an arm is an open chain: give the joint that the loop moves a motor of its own, or the ratio "
    'by which it follows (<equality><joint>), and delete the constraint or give it active="false"'
)
_LINEAR = 'joints follow others by a ratio and an offset: polycoef="offset ratio 0 0 0"'


@dataclass(frozen=True, slots=True)
class _Row:
    """One linear equation between joints: the sum of ratio times position is `value`.

    Attributes:
        ratios: by MuJoCo's number of the joint.
        value: [rad or m].
        prefers: The joint that is said to follow; -1 for none.
        what: The constraint in words.
    """

    ratios: Mapping[int, float]
    value: float
    prefers: int
    what: str


@dataclass(frozen=True, slots=True)
class _Curve:
    """A constraint between joints that is no such equation: a loop, or a ratio that changes.

    Attributes:
        joints: By MuJoCo's number.
        follow: Those of them that are said to follow the others; all of a loop's.
        what: The constraint, and what is wrong with it, in words.
        hint: What to do about it.
    """

    joints: frozenset[int]
    follow: frozenset[int]
    what: str
    hint: str


@dataclass(slots=True)
class _Solved:
    """Joints by the others: each is the sum of ratio times position, and an offset."""

    ratios: dict[int, dict[int, float]] = field(default_factory=dict)
    offsets: dict[int, float] = field(default_factory=dict)

    def add(self, row: _Row, order: Mapping[int, float]) -> None:
        """Solves a further equation for one of its joints.

        Args:
            row: The equation.
            order: Of each joint how gladly it is a coordinate; the least follows.

        Raises:
            RobotError: TS405 when it contradicts those before.
        """
        left, value = dict[int, float](), row.value
        for j, ratio in row.ratios.items():
            for k, share in self.ratios.get(j, {j: 1.0}).items():
                left[k] = left.get(k, 0.0) + ratio * share
            value -= ratio * self.offsets.get(j, 0.0)
        most = max(map(abs, row.ratios.values()), default=1.0)
        left = {j: ratio for j, ratio in left.items() if abs(ratio) > _ROUNDING * most}
        if not left:
            if abs(value) > _ROUNDING * most:
                raise RobotError(
                    "TS405",
                    f"{row.what} contradicts the constraints before it",
                    "leave one of them out",
                )
            return
        follows = min(left, key=lambda j: (order[j] - 0.5 * (j == row.prefers), -j))
        pivot = left.pop(follows)
        found, offset = {j: -ratio / pivot for j, ratio in left.items()}, value / pivot
        for other, ratios in self.ratios.items():
            share = ratios.pop(follows, 0.0)
            if share:
                for j, ratio in found.items():
                    ratios[j] = ratios.get(j, 0.0) + share * ratio
                self.offsets[other] += share * offset
        self.ratios[follows], self.offsets[follows] = found, offset


@dataclass(frozen=True, slots=True)
class ArmCoordinates:
    """The coordinates of an arm, and what its file says of each of them.

    Attributes:
        coupling: Joints of the chain by the coordinates.
        home: (n,) [rad or m].
        lower, upper: (n,) limits, -inf and inf where there is none [rad or m].
        velocity: (n,) limits [rad/s or m/s].
        torque: (n,) limits [N·m or N].
        remarks: What follows, and what is left out.
    """

    coupling: JointCoupling
    home: Array
    lower: Array
    upper: Array
    velocity: Array
    torque: Array
    remarks: tuple[FileRemark, ...]


def coordinates(description: Description, chain: Chain, whole_home: Array) -> ArmCoordinates:
    """Solves what a robot's file ties together.

    Args:
        description: Its content.
        chain: The joints that move the flange.
        whole_home: (nq,) configuration of the whole file.

    Raises:
        RobotError: TS405 for a loop through the chain, for a coupling that is not linear, and for
            one that holds a joint out of its range.
    """
    m = description.model
    driven, at = driven_joints(m), {j: i for i, j in enumerate(chain.joints)}
    for j in chain.joints:
        if j in description.untied:
            raise RobotError(
                "TS405", description.untied[j], "name a joint that turns or slides, or remove it"
            )
    found = list(_constraints(description))
    rows = _touching([each for each in found if isinstance(each, _Row)], chain)
    tied = {*chain.joints, *(j for row in rows for j in row.ratios)}
    left_out = list(_curves(m, [each for each in found if isinstance(each, _Curve)], tied))
    # What does not move the flange follows first, then whoever has no motor, from the end on.
    order = {j: 1.0 + (j in driven) if j in at else 0.0 for j in range(m.njnt)}
    solved = _Solved()
    for row in rows:
        solved.add(row, order)
    free = [j for j in chain.joints if j not in solved.ratios]
    if not free:
        raise RobotError(
            "TS405",
            "the file's constraints leave no joint of the arm free",
            f"{rows[-1].what} is the last of them",
        )
    by_free = {
        j: np.array([solved.ratios.get(j, {j: 1.0}).get(k, 0.0) for k in free])
        for j in (*chain.joints, *(j for j in solved.ratios if j not in at))
    }
    joints = list(chain.joints)
    coupling = JointCoupling(
        tuple(m.joint(j).name for j in joints),
        tuple(bool(m.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE) for j in joints),
        tuple(at[j] for j in free),
        np.array([by_free[j] for j in joints]),
        np.array([solved.offsets.get(j, 0.0) for j in joints]),
    )
    lower, upper = _positions(m, chain, coupling)
    velocity = _velocities(description, chain, coupling)
    home = np.minimum(np.maximum(whole_home[m.jnt_qposadr[free]], lower), upper)
    torque = [_torque(m, j, by_free, driven, i) for i, j in enumerate(free)]
    left_out += _outside(m, solved, at)
    left_out += _undriven(m, free, by_free, driven)
    left_out += _not_mapped(description, chain, coupling, (lower, upper, velocity), driven)
    left_out += _tendons(m, chain)
    following = _following(coupling, rows, home, whole_home[m.jnt_qposadr[joints]])
    return ArmCoordinates(
        coupling, home, lower, upper, velocity, np.array(torque), (*following, *left_out)
    )


def _constraints(description: Description) -> Iterator[_Row | _Curve]:
    """What the file ties joints together by.

    Raises:
        RobotError: TS405 for numbers that mean nothing.
    """
    m = description.model
    for j, locked in description.locked.items():
        yield _Row({j: 1.0}, locked.value, j, locked.what)
    for i in range(m.neq):
        if not m.eq_active0[i]:
            continue
        kind, data = int(m.eq_type[i]), m.eq_data[i]
        what = description.constraints.get(i) or words(m, i)
        ids = [int(each) for each in (m.eq_obj1id[i], m.eq_obj2id[i])]
        if kind == mujoco.mjtEq.mjEQ_JOINT:
            sides = [{j: 1.0} if j >= 0 else {} for j in ids]
            zeros = [float(m.qpos0[m.jnt_qposadr[j]]) for j in ids]
        elif kind == mujoco.mjtEq.mjEQ_TENDON:
            if any(t >= 0 and not _is_fixed(m, t) for t in ids):
                moving = frozenset(j for t in ids if t >= 0 for j in _joints_of(m, t))
                yield _Curve(moving, moving, f"{what} is of a spatial tendon", _LINEAR)
                continue
            sides = [_fixed(m, t) if t >= 0 else {} for t in ids]
            zeros = [float(m.tendon_length0[t]) for t in ids]
        else:
            closes = frozenset(_between(m, i))
            yield _Curve(closes, closes, f"{what} closes a loop", _OPEN)
            continue
        if not np.isfinite(data[:5]).all() or np.abs(data[:5]).max() > _LARGEST:
            raise RobotError("TS405", f"{what} has numbers beyond {_LARGEST:g}")
        if sides[1] and np.any(data[2:5]):
            moving = frozenset((*sides[0], *sides[1]))
            text = f"{what} is not linear, polycoef={_numbers(data[:5])}"
            yield _Curve(moving, frozenset(sides[0]), text, _LINEAR)
            continue
        ratio = float(data[1]) if sides[1] else 0.0
        ratios = dict(sides[0])
        for j, share in sides[1].items():
            ratios[j] = ratios.get(j, 0.0) - ratio * share
        value = zeros[0] + float(data[0]) - (ratio * zeros[1] if sides[1] else 0.0)
        first = ids[0] if kind == mujoco.mjtEq.mjEQ_JOINT else -1
        yield _Row(ratios, value, first, what)


def _curves(m: mujoco.MjModel, curves: list[_Curve], tied: set[int]) -> Iterator[FileRemark]:
    """Refuses the constraints by which joints of the chain move otherwise than by themselves.

    What follows them by a curve and is tied to nothing else takes no freedom from them.

    Args:
        m: The robot's file, compiled.
        curves: Its constraints that are no equations of a row.
        tied: The chain's joints, and those that are tied to them.

    Raises:
        RobotError: TS405.
    """
    for curve in curves:
        moving = curve.joints & tied
        others = [each for each in curves if each is not curve and each.joints & curve.follow]
        if moving and (curve.follow & tied or others):
            names = ", ".join(f"'{m.joint(j).name}'" for j in sorted(moving))
            moves = "joint {} moves" if len(moving) == 1 else "joints {} move"
            raise RobotError(
                "TS405", f"{curve.what}, and {moves.format(names)} the flange", curve.hint
            )
        if moving:
            yield _locked(curve.what)


def _touching(rows: list[_Row], chain: Chain) -> list[_Row]:
    """Those of the rows that tie joints of the chain to others, at once or by further ones."""
    reached, found = set(chain.joints), list[_Row]()
    while True:
        more = [row for row in rows if row not in found and reached & set(row.ratios)]
        if not more:
            return [row for row in rows if row in found]
        found += more
        reached |= {j for row in more for j in row.ratios}


def words(m: mujoco.MjModel, i: int) -> str:
    """A constraint in words: its name, or else what it is of."""
    kind = mujoco.mjtEq(int(m.eq_type[i])).name.removeprefix("mjEQ_").lower()
    name = mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_EQUALITY, i)
    if name:
        return f"<{kind}> '{name}'"
    ids = [int(each) for each in (m.eq_obj1id[i], m.eq_obj2id[i])]
    of = {
        mujoco.mjtEq.mjEQ_JOINT: mujoco.mjtObj.mjOBJ_JOINT,
        mujoco.mjtEq.mjEQ_TENDON: mujoco.mjtObj.mjOBJ_TENDON,
    }.get(mujoco.mjtEq(int(m.eq_type[i])), mujoco.mjtObj(int(m.eq_objtype[i])))
    names = [mujoco.mj_id2name(m, of, each) or "?" for each in ids if each >= 0]
    return f"<{kind}> of {' and '.join(repr(each) for each in names)}"


def _numbers(values: Array) -> str:
    return f'"{" ".join(f"{value:g}" for value in values)}"'


def _between(m: mujoco.MjModel, i: int) -> set[int]:
    """The joints by which the two bodies of a connect or a weld move against each other."""
    ids = [max(int(each), 0) for each in (m.eq_obj1id[i], m.eq_obj2id[i])]
    if m.eq_objtype[i] == mujoco.mjtObj.mjOBJ_SITE:
        ids = [int(m.site_bodyid[each]) for each in ids]
    return carrying(m, ids[0]) ^ carrying(m, ids[1])


def _is_fixed(m: mujoco.MjModel, tendon: int) -> bool:
    """Whether a tendon is the sum of joint positions rather than a string in space."""
    return bool(m.wrap_type[m.tendon_adr[tendon]] == mujoco.mjtWrap.mjWRAP_JOINT)


def _wraps(m: mujoco.MjModel, tendon: int) -> range:
    first = int(m.tendon_adr[tendon])
    return range(first, first + int(m.tendon_num[tendon]))


def _fixed(m: mujoco.MjModel, tendon: int) -> dict[int, float]:
    """The ratios of a fixed tendon, by joint."""
    found: dict[int, float] = {}
    for w in _wraps(m, tendon):
        j = int(m.wrap_objid[w])
        found[j] = found.get(j, 0.0) + float(m.wrap_prm[w])
    return found


def _joints_of(m: mujoco.MjModel, tendon: int) -> set[int]:
    """The joints that change the length of a tendon."""
    if _is_fixed(m, tendon):
        return {j for j, ratio in _fixed(m, tendon).items() if ratio}
    owners = {
        int(mujoco.mjtWrap.mjWRAP_SITE): m.site_bodyid,
        int(mujoco.mjtWrap.mjWRAP_SPHERE): m.geom_bodyid,
        int(mujoco.mjtWrap.mjWRAP_CYLINDER): m.geom_bodyid,
    }
    found, before = set[int](), None
    for w in _wraps(m, tendon):
        owner = owners.get(int(m.wrap_type[w]))
        if owner is None:
            # Behind a pulley another string begins.
            before = None
            continue
        joints = carrying(m, int(owner[m.wrap_objid[w]]))
        found |= set() if before is None else joints ^ before
        before = joints
    return found


def _single(ratios: Array) -> int | None:
    """The one coordinate that a joint follows; None where it is none or several."""
    moved = np.flatnonzero(ratios)
    return int(moved[0]) if len(moved) == 1 else None


def _positions(m: mujoco.MjModel, chain: Chain, coupling: JointCoupling) -> tuple[Array, Array]:
    """(n,), (n,) the coordinates' limits, by those of all joints that follow one of them."""
    lower, upper = np.full(coupling.n, -np.inf), np.full(coupling.n, np.inf)
    for j, ratios, offset in zip(chain.joints, coupling.ratios, coupling.offsets, strict=True):
        if not m.jnt_limited[j]:
            continue
        low, high = (float(bound) for bound in m.jnt_range[j])
        i = _single(ratios)
        if i is not None:
            ends = sorted(((low - offset) / ratios[i], (high - offset) / ratios[i]))
            lower[i], upper[i] = max(lower[i], ends[0]), min(upper[i], ends[1])
        held = (i is None and not ratios.any() and not low <= offset <= high) or (
            i is not None and lower[i] > upper[i]
        )
        if held:
            raise RobotError(
                "TS405",
                f"the range of joint '{m.joint(j).name}', {low:g} to {high:g}, leaves it no place: "
                "the file's constraints hold it elsewhere",
                "give joints that follow each other ranges that overlap",
            )
    return lower, upper


def _velocities(description: Description, chain: Chain, coupling: JointCoupling) -> Array:
    """(n,) the coordinates' velocity limits, by those of all joints that follow one of them."""
    found = np.full(coupling.n, np.inf)
    for j, ratios in zip(chain.joints, coupling.ratios, strict=True):
        i = _single(ratios)
        if i is not None:
            most = description.velocity.get(j, np.inf) / abs(ratios[i])
            found[i] = min(found[i], most)
    return found


def _torque(
    m: mujoco.MjModel, joint: int, by_free: Mapping[int, Array], driven: frozenset[int], i: int
) -> float:
    """The torque limit of coordinate i, joint `joint`: of all motors that move it alone."""
    motors = {j: abs(float(row[i])) for j, row in by_free.items() if _single(row) == i}
    found = [ratio * torque_limit(m, j) for j, ratio in motors.items() if j in driven]
    return sum(found) if found else torque_limit(m, joint)


def _following(
    coupling: JointCoupling, rows: list[_Row], home: Array, file_home: Array
) -> Iterator[FileRemark]:
    """Which joints follow, and where that puts them at home."""
    if not coupling.couples:
        return
    at = coupling.joints(home)
    moved = [
        f"'{coupling.names[j]}' is at {at[j]:g} at home, not at {file_home[j]:g}"
        for j in coupling.followers
        if abs(at[j] - file_home[j]) > 1e-6
    ]
    names = ", ".join(coupling.names[j] for j in coupling.free)
    relations = ", ".join(coupling.relation(j) for j in coupling.followers)
    yield FileRemark(
        "TS446",
        f"{coupling.n} joints move by themselves, the others follow: {relations}"
        + "".join(f"; {each}" for each in moved),
        f"values for joints in a task file, and joint.1 to joint.{coupling.n}, are those of "
        f"{names}; given by {', '.join(row.what for row in rows)}",
        ("model",),
    )


def _locked(what: str) -> FileRemark:
    """Of what follows the chain beside it."""
    return FileRemark(
        "TS447",
        f"{what}, and does not move the flange: what follows is locked as it is at home, and what "
        "it carries moves with the link before it",
        "its part in the arm's inertia is that of this one pose",
        ("model",),
    )


def _outside(m: mujoco.MjModel, solved: _Solved, at: Mapping[int, int]) -> Iterator[FileRemark]:
    """Joints beside the chain that follow its joints."""
    for j, ratios in solved.ratios.items():
        masters = [m.joint(k).name for k in ratios if k in at]
        if j not in at and masters:
            yield _locked(f"joint '{m.joint(j).name}' follows {', '.join(masters)}")


def _undriven(
    m: mujoco.MjModel, free: list[int], by_free: Mapping[int, Array], driven: frozenset[int]
) -> Iterator[FileRemark]:
    """Coordinates that no motor of a file with motors moves."""
    moved = sum((np.abs(by_free[j]) for j in driven if j in by_free), np.zeros(len(free)))
    pulled = {j for t in _pulled(m) for j in _joints_of(m, t)}
    left = [j for j, by in zip(free, moved, strict=True) if not by and j not in pulled]
    if left and moved.any():
        names = ", ".join(f"'{m.joint(j).name}'" for j in left)
        one = len(left) == 1
        yield FileRemark(
            "TS447",
            f"{'joint' if one else 'joints'} {names} {'has' if one else 'have'} no motor in the "
            "file, as the others have: here every joint that moves by itself is driven",
            "give it the motor that it has, or say what it follows (<equality><joint>)",
            ("model",),
        )


def _pulled(m: mujoco.MjModel) -> frozenset[int]:
    """The tendons that a motor pulls."""
    return frozenset(
        int(m.actuator_trnid[i, 0])
        for i in range(m.nu)
        if m.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_TENDON
    )


def _not_mapped(
    description: Description,
    chain: Chain,
    coupling: JointCoupling,
    bounds: tuple[Array, Array, Array],
    driven: frozenset[int],
) -> Iterator[FileRemark]:
    """What a file says of joints that follow several others: no bound on one of these says it."""
    m, (lower, upper, velocity) = description.model, bounds
    for j in coupling.followers:
        ratios, joint = coupling.ratios[j], chain.joints[j]
        if _single(ratios) is not None or not ratios.any():
            continue
        moved = np.flatnonzero(ratios)
        ends = np.sort(ratios[moved] * np.array((lower[moved], upper[moved])), axis=0).sum(axis=1)
        ends += coupling.offsets[j]
        low, high = m.jnt_range[joint]
        fastest = float(np.abs(ratios[moved]) @ velocity[moved])
        left = []
        if m.jnt_limited[joint] and not (low <= ends[0] and ends[1] <= high):
            left.append(f"its range, {low:g} to {high:g}")
        if description.velocity.get(joint, np.inf) < fastest:
            left.append("its limit of speed")
        if joint in driven:
            left.append("its motor")
        if left:
            yield FileRemark(
                "TS447",
                f"joint '{coupling.names[j]}' follows several joints, {coupling.relation(j)}: "
                f"{' and '.join(left)} is left out of the limits that stop a run",
                "limit the joints that it follows such that it keeps its own limits",
                ("model",),
            )


def _tendons(m: mujoco.MjModel, chain: Chain) -> Iterator[FileRemark]:
    """Tendons at the chain's joints: what they do beside coupling is left out."""
    pulled = _pulled(m)
    for t in range(m.ntendon):
        joints = _joints_of(m, t) & set(chain.joints)
        has = {
            "range": m.tendon_limited[t],
            "spring": m.tendon_stiffness[t],
            "damping": m.tendon_damping[t],
            "friction": m.tendon_frictionloss[t],
            "armature": m.tendon_armature[t],
            "motor": t in pulled,
        }
        left = [f"its {what}" for what, there in has.items() if np.any(there)]
        if joints and left:
            name = mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_TENDON, t) or str(t + 1)
            names = ", ".join(m.joint(j).name for j in sorted(joints))
            yield FileRemark(
                "TS447",
                f"tendon '{name}' acts on {names}: {', '.join(left)} "
                f"{'is' if len(left) == 1 else 'are'} left out",
                "joints have motors and limits of their own here: give them those of the tendon"
                if left != ["its motor"]
                else "every joint is driven by itself here: give it the torque that the tendon "
                "brings it, as actuatorfrcrange of its <joint>",
                ("model",),
            )
