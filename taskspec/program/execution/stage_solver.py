"""Solves a stage's programs tick by tick, and holds a safe torque where that does not succeed."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from taskspec.control.qp import QuadraticProgram, Solution, Status, make_solver
from taskspec.control.qp.dual import by_code, sharing
from taskspec.deferred_methods import dataclass
from taskspec.native import quadratic
from taskspec.native.quadratic import INFEASIBLE, SOLVED
from taskspec.program.bound import BoundFunction
from taskspec.program.limits import holding, relaxing
from taskspec.program.limits.holding import hold
from taskspec.program.limits.relaxing import widen
from taskspec.program.limits.resolution import Resolution
from taskspec.program.ports import INTERNAL, fields, slices

if TYPE_CHECKING:
    from taskspec.control.qp.dual import DualSolver

_FIELDS = slices(INTERNAL)
_VIOLATION, _UNSETTLED = _FIELDS["violation"].start, _FIELDS["unsettled"].start
_LIMITS, _RESIDUAL = _FIELDS["limits"].start, _FIELDS["residual"].start
_CLAMPED = _FIELDS["clamped"].start

Vector = NDArray[np.float64]

#: An answer that is further from optimal than this is not used.
WORST_RESIDUAL = 1e-6
#: A torque that is held decays to gravity compensation within this many control periods.
HELD_TICKS = 10
#: A push that was clamped is at its bound but for rounding; so is a limit that just holds.
EXACT = 1e-12
#: A multiplier below this share of the largest one is rounding.
_ROUNDING = 1e-6


#: Makes the solver that is tried first on a problem, if there is one.
OwnSolver = Callable[[QuadraticProgram], "DualSolver | None"]


def no_own_solver(problem: QuadraticProgram) -> None:
    """None: the named solver is the first."""


@dataclass(slots=True)
class SolverCounts:
    """Counts of the solver in a run.

    Attributes:
        solved: ticks with a program to solve.
        relaxed: of them, with limits that collided.
        held: ticks on which no answer was good enough.
        worst: residual of an answer that was used.
    """

    solved: int = 0
    relaxed: int = 0
    held: int = 0
    worst: float = 0.0


class StageSolver:
    """The programs of one stage on the arrays of a machine.

    Before a tick is evaluated, call `remember`; after it, `resolve`, and `hold` where that has no
    answer.

    Attributes:
        status: of the last solve.
        counts: of all of them.
        own: the solver that is tried first; None where there is none.
        program: the problem, as kernels have it.
        relaxing, holding: what kernels work in where it has no answer.
        assemble: writes the program; accept: judges an answer, into `accepted`, `residual`,
            `binding` and `found_cut`.
        applied: (n,) torque of the tick before.
        nearest: the forces that contacts return; None where nothing is requested of them.
        unreachable: slot of what is left of them.
        limited, cut: slots of the stage's parameters that are written for the next tick.
        clamped_cut: (r,) what the tick itself has taken from pushes.
        clear: whether no limit was active in the last tick.
        paring: whether the last tick requested forces that contacts do not return.
    """

    def __init__(
        self,
        resolution: Resolution,
        slots: Mapping[str, slice],
        arguments: Sequence[Vector],
        parameters: Vector,
        handed_over: Vector,
        torque: Vector,
        outputs: Vector,
        own: OwnSolver,
    ) -> None:
        """Binds the programs.

        Args:
            resolution: of the stage.
            slots: of its parameters.
            arguments: arrays of the tick's arguments.
            parameters: the last of them.
            handed_over: what the tick hands over.
            torque: (n,) that it writes.
            outputs: of it.
            own: makes the solver that is tried first.
        """
        n, m, r = len(torque), len(resolution.rows), len(resolution.requested)
        self.resolution, self.counts = resolution, SolverCounts()
        self.status = Status.SOLVED
        self._torque, self._outputs = torque, outputs
        self._limited_now = outputs[slices(fields(0))["limited"]]
        nothing = np.zeros(0)
        self.limited = parameters[slots["limited"]]
        self.cut = parameters[slots["cut"]] if r else nothing
        self.unreachable = parameters[slots["unreachable"]] if r else nothing
        self.applied = np.zeros(n)
        self.clear, self.paring = True, False
        pieces, bounds = np.split(handed_over, [resolution.handed])
        lower, upper, self.clamped_cut = np.split(bounds, [m, 2 * m])
        self._problem = problem = QuadraticProgram(
            np.eye(n), np.zeros(n), np.zeros((m, n)), lower, upper
        )
        # OSQP is selected to be used.
        self.own = own(problem) if resolution.solver == "daqp" else None
        if self.own is None:
            self._x, self._dual = np.zeros(n), np.zeros(m)
        else:
            self._x, self._dual = self.own.x, self.own.dual
        self.accepted, self.found_cut = np.zeros(n), np.zeros(r)
        self.residual, self.binding = np.zeros(1), np.zeros(1)
        factor, requests = np.zeros(n * n), np.zeros(r * n)
        parts = (problem.flat_P, problem.flat_A, factor, requests)
        self.assemble = BoundFunction(resolution.assemble, (pieces,), parts)
        most = np.array(resolution.commands.most, dtype=np.float64)
        step = np.array(resolution.commands.step, dtype=np.float64)
        results = (self.accepted, self.residual, self.binding, self.found_cut)
        self.accept = BoundFunction(
            resolution.accept,
            (*parts, lower, upper, torque, self._x, self._dual, self.applied, most, step),
            results,
        )
        self._solver = make_solver(resolution.solver, n, m)
        self.program = sharing(problem) if self.own is None else self.own.workspace
        self.relaxing = relaxing.relaxing(n, [row.kind for row in resolution.rows])
        self.holding = holding.holding(resolution, factor, self.applied)
        self.nearest = (
            NearestForces(resolution, arguments, own) if resolution.look is not None else None
        )

    def group(self) -> None:
        """Groups the instructions of what each tick evaluates."""
        self.assemble.group()
        self.accept.group()

    def remember(self, applied: Vector) -> None:
        """Has the next tick change its torque from (n,) `applied` at the limited rate."""
        self.applied[:] = applied

    def resolve(self) -> bool:
        """Replaces the torque where it breaks a limit; whether there is one that may be used."""
        outputs = self._outputs
        if outputs[_VIOLATION] <= EXACT:
            if outputs[_CLAMPED]:
                self._report_cuts(self.clamped_cut, outputs[_CLAMPED])
            elif not self.clear:
                self.cut[:], self.limited[:], self.clear = 0.0, 0.0, True
        elif not self.solve():
            self.counts.held += 1
            return False
        if outputs[_UNSETTLED] or self.paring:
            self.settle()
        return True

    def settle(self) -> None:
        """Has the next tick take from the set points what contacts cannot return of them."""
        if self.nearest is None:
            return
        self.paring = bool(self._outputs[_UNSETTLED])
        left = self.nearest.find() if self.paring else 0.0
        if left is not None:
            self.unreachable[:] = left

    def returned_forces(self) -> ReturnedForces | None:
        """The forces that the last tick requests of contacts; None for none, or if unknown."""
        if self.nearest is None:
            return None
        left = self.nearest.find()
        if left is None:
            return None
        names, values = self.resolution.requested, self.nearest.values
        return ReturnedForces(
            dict(zip(names, values.tolist(), strict=True)),
            dict(zip(names, left.tolist(), strict=True)),
            self.nearest.because(),
        )

    def solve(self) -> bool:
        """Solves the program of the last tick, once, and takes its answer if it is good enough."""
        self.counts.solved += 1
        if not math.isfinite(self._outputs[_VIOLATION]):
            return self._take(Solution(self._x, self._dual, Status.NOT_FINITE, 0))
        self.assemble.evaluate()
        relaxed = False
        if self.own is not None:
            state = self.own.solve()
            if state == INFEASIBLE:
                relaxed = True
                if self._relax():
                    state = self.own.solve()
            if state == SOLVED and self._good():
                return True
        solution = self._solver.solve(self._problem, finite=True)
        if solution.status is Status.INFEASIBLE and not relaxed and self._relax():
            solution = self._solver.solve(self._problem)
        return self._take(solution)

    def _relax(self) -> bool:
        """Relaxes limits that collide; whether that succeeded."""
        self.counts.relaxed += 1
        return bool(by_code(widen, relaxing, quadratic)(self.relaxing, self.program))

    def hold(self, torque: Vector) -> None:
        """Takes the torque nearest to (n,) `torque` that keeps limits, on a tick without an answer.

        See `holding.hold`.
        """
        held: Any = self.holding
        held.law, held.wanted = self._torque, torque
        held.finite = math.isfinite(self._outputs[_VIOLATION])
        by_code(hold, holding, relaxing, quadratic)(held, self.program)
        self._torque[:] = held.near

    def _take(self, solution: Solution) -> bool:
        self.status = solution.status
        if solution.status is not Status.SOLVED:
            self._solver.rebuild()
            return False
        self._x[:], self._dual[:] = solution.x, solution.dual
        if self._good():
            return True
        self.status = Status.NOT_CONVERGED
        self._solver.rebuild()
        return False

    def _good(self) -> bool:
        """Takes the answer x, dual if it is certified; whether it is."""
        self.accept.evaluate()
        residual = float(self.residual[0])
        if not residual <= WORST_RESIDUAL:
            return False
        self.status = Status.SOLVED
        self.counts.worst = max(self.counts.worst, residual)
        self._torque[:] = self.accepted
        self._outputs[_RESIDUAL] = residual
        # A push that was clamped and binds in the program too is reported once.
        binding = int(self.binding[0]) | int(self._outputs[_CLAMPED])
        self._report_cuts(self.found_cut + self.clamped_cut, binding)
        return True

    def _report_cuts(self, cut: Vector, binding: float) -> None:
        self.cut[:], self.limited[:], self.clear = cut, 1.0, False
        self._limited_now[:], self._outputs[_LIMITS] = 1.0, binding


@dataclass(frozen=True, slots=True)
class ReturnedForces:
    """The forces that a stage requests of its contacts, and the part that they cannot return.

    Attributes:
        forces: (r,) as the robot would apply them, by name.
        left: (r,) that cannot be returned.
        because: the conditions that bind, in words.
    """

    forces: Mapping[str, float]
    left: Mapping[str, float]
    because: tuple[str, ...]


class NearestForces:
    """The program of the forces that contacts can return.

    Attributes:
        look: evaluates the program, and what is requested.
        own: the solver that is tried first; None where there is none.
        left: evaluates what is left of the requests, `left_over` (r,).
        values: (r,) what is requested.
    """

    def __init__(self, resolution: Resolution, inputs: Sequence[Vector], own: OwnSolver) -> None:
        assert resolution.look is not None
        assert resolution.left is not None
        g, r = resolution.generators, len(resolution.requested)
        m = len(resolution.conditions)
        self._problem = problem = QuadraticProgram.empty(g, m)
        self.values, self.left_over = np.zeros(r), np.zeros(r)
        effect = np.zeros(r * g)
        self._texts = resolution.conditions
        bounds = (problem.lower, problem.upper)
        parts = (problem.flat_P, problem.g, problem.flat_A, *bounds, effect, self.values)
        self.look = BoundFunction(resolution.look, inputs, parts)
        self._solver = make_solver(resolution.solver, g, m)
        self.own = own(problem) if resolution.solver == "daqp" else None
        if self.own is None:
            self._x, self._dual = np.zeros(g), np.zeros(m)
        else:
            self._x, self._dual = self.own.x, self.own.dual
        self.left = BoundFunction(
            resolution.left, (effect, self.values, self._x), (self.left_over,)
        )

    def find(self) -> Vector | None:
        """The part of the requests (r,) that is not returned; None without an answer."""
        self.look.evaluate()
        if self.own is None or self.own.solve() != SOLVED:
            solution = self._solver.solve(self._problem)
            if solution.status is not Status.SOLVED:
                self._solver.rebuild()
                return None
            self._x[:], self._dual[:] = solution.x, solution.dual
        self.left.evaluate()
        return self.left_over

    def because(self) -> tuple[str, ...]:
        """The conditions that bound the last answer, in words."""
        binding = np.abs(self._dual) > _ROUNDING * np.max(np.abs(self._dual), initial=1.0)
        return tuple(dict.fromkeys(t for t, b in zip(self._texts, binding, strict=True) if b))
