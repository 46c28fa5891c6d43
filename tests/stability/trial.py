"""One case of the grid: what the sampled model predicts, and what becomes of a small push."""

from __future__ import annotations

import math
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from stability.cases import FACTORS, Family
from taskspec.compiler import compile_unchecked
from taskspec.examination import examine
from taskspec.program.plan import StagePlan
from taskspec.program.prepare import prepare
from taskspec.program.stages.stage import compile_stage
from taskspec.spec import load_text
from taskspec.stability.loop import Mode
from taskspec.stability.margin import Search
from taskspec.stability.sampled_stage import SampledStage, analyse
from taskspec_runner.loop import fixed_step as loop
from taskspec_runner.loop.assembly import Assembly, assemble

#: A run lasts so many predicted time constants, and at most so long [s].
CONSTANTS, LONGEST = 10.0, 60.0
#: A brief one: what settles has come to a 400th of itself, what grows has long become large.
BRIEF = 6.0
#: Where that is too short for the factors next to the boundary, these take their place.
WIDER = {0.975: 0.95, 1.025: 1.05}
#: At least so many ticks are looked at.
FEWEST = 60
#: The push makes about so much force along the normal [N] of the 10 N, and so much joint velocity.
PUSH, SHAKE = 0.2, 1e-5
SEED = 7
#: What is left of a motion is rounding: as part of its first third, and in rad/s.
NOTHING, ROUNDING = 1e-5, 1e-10
#: A motion has grown if it becomes so many times as large as right after the push. Torque limits
#: may hold it there: then it grows no more.
LARGE = 10.0


@dataclass(frozen=True)
class Boundary:
    """The critical value of a family's gain.

    Attributes:
        value: [SI]. upper: the loop is stable below it. settled: a value that is well inside.
        settling: time that the loop takes to come to rest there [s].
    """

    value: float
    upper: bool
    settled: float
    settling: float


@dataclass(frozen=True)
class Case:
    """A case of the grid.

    Attributes:
        family: law, arm, contact. boundary: of its gain. factor: of the critical value, above 1
            on the unstable side.
    """

    family: Family
    boundary: Boundary
    factor: float

    @property
    def gain(self) -> float:
        factor = self.factor if self.boundary.upper else 1 / self.factor
        return self.boundary.value * factor


@dataclass(frozen=True)
class Verdict:
    """What was predicted for a case, and what came.

    Attributes:
        case: which. mode: the least stable one that is predicted. seconds: of the run.
        growth: of the motion, measured [1/s]. rings: whether it grew.
    """

    case: Case
    mode: Mode
    seconds: float
    growth: float
    rings: bool

    @property
    def told(self) -> str:
        """What `validate` says of it."""
        return told(self.case)

    @property
    def holds(self) -> bool:
        """Whether the run did what the case's side of the boundary says."""
        return self.rings == (self.case.factor > 1) == (self.mode.s.real > 0)


def analysed(family: Family, value: float) -> SampledStage:
    text = family.task(value, value, 1.0, 1.0)
    found = analyse(compile_stage(StagePlan(prepare(load_text(text, "grid.yaml")), "try")))
    assert found is not None
    return found


#: Where the search for a boundary sets out.
BEGIN = {
    "force.integral": 2.0,
    "force.proportional": 0.5,
    "damping": 30.0,
    "mass": 4.0,
    "bandwidth": 5.0,
    "joint_damping": 1.0,
    "stiffness": 1e5,
}


def boundary(family: Family) -> Boundary:
    """The critical value of the family's gain, on the sampled model."""
    sampled = analysed(family, BEGIN[family.swept])
    joints = sampled.stage.plan.gains.get("joint_damping", {})
    on = [*joints] if family.swept == "joint_damping" else [family.on]
    limit = Search(prepare(sampled.context.loaded), sampled).gain(family.swept, on)
    assert limit is not None, family
    for part in (0.3, 0.5, 0.15, 0.7, 0.05):
        settled = limit.value * (part if limit.upper else 1 / part)
        modes = analysed(family, settled).modes()
        if modes[0].s.real < -0.5:
            return Boundary(limit.value, limit.upper, settled, min(0.3 + 16 / -modes[0].s.real, 12))
    raise AssertionError(f"{family}: nothing settles")


def cases(family: Family, factors: Iterable[float] = FACTORS) -> list[Case]:
    found = boundary(family)
    return [Case(family, found, _told(family, found, factor)) for factor in factors]


def _told(family: Family, found: Boundary, factor: float) -> float:
    """The factor, or the wider one where runs would be too short."""
    if factor not in WIDER:
        return factor
    case = Case(family, found, factor)
    slow = abs(analysed(family, case.gain).modes()[0].s.real)
    return factor if CONSTANTS / slow <= LONGEST else WIDER[factor]


def judge(case: Case, *, brief: bool = False) -> Verdict:
    """Runs a case; a brief run ends once the motion is large, and its growth is a rough one."""
    mode = analysed(case.family, case.gain).modes()[0]
    constants = BRIEF if brief else CONSTANTS
    seconds = min(max(constants / abs(mode.s.real), FEWEST * 1e-3), LONGEST)
    settling = case.boundary.settling
    text = case.family.task(case.boundary.settled, case.gain, settling, seconds + 0.02)
    parts = assemble(compile_unchecked(load_text(text, "grid.yaml")))
    joint = int(np.argmax(np.abs(mode.shape)))
    kept = Kept(parts, round(settling * 1e3) + 10, joint if brief else None)
    with suppress(LargeMotionError):
        loop.run(parts.machine, parts.plant, parts.bus, kept, parts.program.context.period)
    growth, rings = kept.growth(joint, round(seconds * 1e3))
    return Verdict(case, mode, seconds, growth, rings)


def told(case: Case) -> str:
    """The gravest of what `validate` says of a case's stability, as `TS501 error`; or `-`."""
    text = case.family.task(case.boundary.settled, case.gain, 1.0, 1.0)
    found = examine(load_text(text, "grid.yaml")).findings
    about = [each for each in found if each.code in ("TS501", "TS502")]
    about = sorted(about, key=lambda each: each.code)
    return f"{about[0].code} {about[0].severity}" if about else "-"


class LargeMotionError(Exception):
    """A motion has become so large that no more of the run is needed."""


class Kept:
    """In a recorder's place: keeps joint velocities and forces, and pushes the arm once."""

    def __init__(self, parts: Assembly, when: int, until_large: int | None = None) -> None:
        """Of a run that is pushed in tick `when`.

        Args:
            until_large: the joint whose motion ends the run by `LargeMotionError`; None to go on.
        """
        self.parts, self.when, self.until_large = parts, when, until_large
        self.velocities: list[np.ndarray] = []
        self.forces: list[np.ndarray] = []
        self._arm = parts.plant.arm

    def add(self) -> None:
        tick = len(self.velocities)
        if tick == self.when:
            self._push()
        v = self._arm.v.copy()
        self.velocities.append(v)
        self.forces.append(self._arm.wrench[:3].copy())
        if self.until_large is not None and tick > self.when + FEWEST:
            self._look(self.until_large)

    def _look(self, joint: int) -> None:
        first = max(abs(v[joint]) for v in self.velocities[self.when + 1 : self.when + 3])
        if abs(self.velocities[-1][joint]) > LARGE * first:
            raise LargeMotionError

    @property
    def lost(self) -> bool:
        """Whether the tool has left the surface since the push."""
        return not np.all(np.any(self.forces[self.when :], axis=1))

    def _push(self) -> None:
        """A small velocity along the normal of the contact, and a smaller one of every joint."""
        context = self.parts.program.context
        name = next(iter(context.compliances))
        J = context.start_normals[name] @ context.start_jacobian[:3]
        along = np.linalg.solve(context.start_inertia, J)
        felt = 1 / float(J @ along)
        speed = PUSH / math.sqrt(context.compliances[name].stiffness * felt)
        shake = np.random.default_rng(SEED).uniform(-SHAKE, SHAKE, len(J))
        self.parts.plant.arm.v[:] += -along * felt * speed + shake

    def growth(self, joint: int, ticks: int) -> tuple[float, bool]:
        """Rate [1/s] at which a joint's motion grows, and whether it does.

        The last third of the run is held against the third before, each through a Hann window; of
        a run in which the motion becomes large, what comes before that. A run that was stopped, or
        in which the tool has left the surface, has grown. Where next to nothing is left of the
        motion, it has settled, and its rate is not a number.
        """
        sampled = np.array(self.velocities)[self.when + 1 :, joint]
        stopped = len(sampled) < 0.9 * ticks
        large, lost = np.abs(sampled).max() > LARGE * np.abs(sampled[:2]).max(), self.lost
        end = _first_large(sampled) if large or lost else len(sampled)
        third = max(end // 3, 2)
        window = np.hanning(third + 2)[1:-1]
        parts = (
            sampled[end - third : end],
            sampled[end - 2 * third : end - third],
            sampled[:third],
        )
        last, before, first = (float(np.sqrt(np.mean(window * part**2))) for part in parts)
        if last < max(NOTHING * first, ROUNDING) and not (stopped or lost):
            return math.nan, False
        growth = math.log(last / before) / (third * 1e-3)
        return growth, growth > 0 or large or stopped or lost


def _first_large(sampled: np.ndarray) -> int:
    """Where a motion has come to a third of its largest: before that it is linear."""
    large = np.abs(sampled) > np.abs(sampled).max() / 3
    return max(int(np.argmax(large)), 6)
