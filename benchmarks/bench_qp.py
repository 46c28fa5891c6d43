"""What one quadratic program costs with either solver, as a multiple of bare `mj_step`.

The problems have the size of a tick's: joint accelerations and contact multipliers, torque, joint
and friction rows. Each solver gets the same sequence, in which the data drift by a thousandth from
tick to tick and the arrays are rewritten in place. Rounds alternate, so that a machine that slows
down slows all of them; the medians over the rounds are printed.

    python benchmarks/bench_qp.py
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np

from taskspec.compiler import compile_task
from taskspec.control.qp import SOLVERS, Problem, Status, make_solver
from taskspec.spec import load_task
from taskspec_runner.loop.assembly import assemble
from taskspec_runner.loop.sensing import Sensing

TASK = Path(__file__).resolve().parent.parent / "tasks" / "wipe-table.yaml"
SIZES = ((7, 20), (10, 30), (13, 40))
ROUNDS, STEPS = 15, 200


def main() -> None:
    """Prints a line per size, number of active rows and solver."""
    bare = _bare_step()
    cases = {
        (n, m, active, name): _ticks(name, n, m, active)
        for n, m in SIZES
        for active in (0, 2, n // 2 + 1)
        for name in SOLVERS
    }
    measured: dict[object, list[float]] = {}
    for _ in range(ROUNDS):
        measured.setdefault("bare", []).append(bare())
        for case, solves in cases.items():
            measured.setdefault(case, []).append(solves())
    steps = measured.pop("bare")
    print(f"bare mj_step in contact {statistics.median(steps) * 1e6:8.2f} us")
    for (n, m, active, name), times in zip(cases, measured.values(), strict=True):
        ratio = statistics.median(t / b for t, b in zip(times, steps, strict=True))
        print(
            f"{n:2} unknowns {m:2} rows {active:2} active  {name:5}"
            f"{statistics.median(times) * 1e6:8.2f} us {ratio:6.2f} x"
        )


def _ticks(name: str, n: int, m: int, active: int) -> Callable[[], float]:
    """A function that solves a drifting sequence of problems and says how long a solve took."""
    rng = np.random.default_rng(0)
    root = rng.normal(size=(n, n))
    P, A, wish = root @ root.T + np.eye(n), rng.normal(size=(m, n)), rng.normal(size=n)
    problem, solver = Problem.empty(n, m), make_solver(name, n, m)
    at = A @ wish
    problem.P[...] = P
    problem.lower[:], problem.upper[:] = at - 20.0, at + 20.0
    problem.upper[:active] = at[:active] - 1.0
    ticks = 0

    def solves() -> float:
        nonlocal ticks
        spent = 0.0
        for _ in range(STEPS):
            drift = 1.0 + 1e-3 * np.sin(1e-2 * ticks)
            np.multiply(A, drift, out=problem.A)
            np.multiply(P @ wish, -drift, out=problem.g)
            begin = time.perf_counter()
            found = solver.solve(problem)
            spent += time.perf_counter() - begin
            assert found.status is Status.SOLVED
            ticks += 1
        return spent / STEPS

    return solves


def _bare_step() -> Callable[[], float]:
    """`mj_step` of the wiping arm, half a second after contact."""
    program = compile_task(load_task(TASK))
    period = program.context.period
    parts = assemble(program)
    plant, machine = parts.plant, parts.machine
    sensing = Sensing(plant.arm, plant.views.equations, machine)
    sensing.read()
    machine.start()
    ticks = 0
    while machine.stage.name != "wipe" or machine.t < 0.5:
        sensing.read()
        machine.tick(ticks * period)
        plant.step(machine.torque)
        ticks += 1
    model, data = plant.model, plant.data
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.zeros(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, data, state, kind)

    def steps() -> float:
        mujoco.mj_setState(model, data, state, kind)
        begin = time.perf_counter()
        for _ in range(STEPS):
            mujoco.mj_step(model, data)
        return (time.perf_counter() - begin) / STEPS

    return steps


if __name__ == "__main__":
    main()
