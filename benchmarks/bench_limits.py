"""What keeping limits costs: closed loops side by side with bare `mj_step`, in one process.

A wipe on its plant, recording included, as a multiple of a bare step in contact: by
the closed form, by the program where no limit is in the way, and with the program solved in every
tick, as where one binds, by both solvers. Rounds alternate, so that a machine that slows down slows
all of them.

    python benchmarks/bench_limits.py
"""

from __future__ import annotations

import statistics
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from timed import seconds

from taskspec.compiler import compile_task
from taskspec.program.execution.stage_solver import Resolver
from taskspec.spec import load_task
from taskspec_runner.loop.assembly import assemble
from taskspec_runner.loop.sensing import Sensing
from taskspec_runner.record.log import Log

TASKS = Path(__file__).resolve().parent.parent / "tasks"
AFTER = 0.5
ROUNDS, STEPS = 10, 300


@dataclass(frozen=True, eq=False)
class Case:
    """A way to the torques of a stage of a task, and whether its program is always solved."""

    name: str
    task: str
    stage: str
    overrides: Mapping[str, str]
    always: bool = False


QP, OSQP = {"law.solve": "qp"}, {"law.solve": "qp", "law.solver": "osqp"}
CASES = (
    Case("closed form", "wipe-table", "wipe", {}),
    Case("program, no limit in the way", "wipe-table", "wipe", QP),
    Case("the same with every limit there is", "press-qp", "slide", {}),
    Case("program solved in every tick, DAQP", "wipe-table", "wipe", QP, always=True),
    Case("program solved in every tick, OSQP", "wipe-table", "wipe", OSQP, always=True),
)


class Loop:
    """The closed loop of a task, and the bare step of its scene."""

    def __init__(self, case: Case, folder: Path) -> None:
        program = compile_task(load_task(TASKS / f"{case.task}.yaml", case.overrides))
        self._parts = assemble(program)
        self._period = program.context.period
        plant = self._parts.plant
        self._sensing = Sensing(plant.arm, plant.views.equations, self._parts.machine)
        self._recorder = self._parts.recorder(Log(folder / f"{case.name}.arrow"))
        self._resolver: Resolver | None = None
        self._sensing.read()
        machine = self._parts.machine
        machine.start()
        self._ticks = 0
        while machine.stage.name != case.stage or machine.t < AFTER:
            self.step()
        if case.always:
            self._resolver = machine.solver
        plant = self._parts.plant
        self._model, self._data = plant.model, plant.data
        self._kind = mujoco.mjtState.mjSTATE_INTEGRATION
        self._state = np.zeros(mujoco.mj_stateSize(self._model, self._kind))

    def step(self) -> None:
        """One control period."""
        parts = self._parts
        self._sensing.read()
        parts.machine.tick(self._ticks * self._period)
        if self._resolver is not None:
            # Where no limit is in the way this gives the same torque again.
            self._resolver.solve()
        parts.plant.step(parts.machine.torque)
        self._recorder.add()
        self._ticks += 1

    def bare(self, steps: int) -> float:
        """Seconds of a step without control; the state is put back."""
        mujoco.mj_getState(self._model, self._data, self._state, self._kind)
        taken = seconds(lambda: mujoco.mj_step(self._model, self._data), steps)
        mujoco.mj_setState(self._model, self._data, self._state, self._kind)
        mujoco.mj_forward(self._model, self._data)
        return taken


def main() -> None:
    """Measures all cases in turns and prints the medians."""
    with tempfile.TemporaryDirectory() as folder:
        loops = {case: Loop(case, Path(folder)) for case in CASES}
        measured: dict[Case, list[tuple[float, float]]] = {case: [] for case in CASES}
        for _ in range(ROUNDS):
            for case, loop in loops.items():
                measured[case].append((loop.bare(200), seconds(loop.step, STEPS)))
    for case, pairs in measured.items():
        ratio = statistics.median(whole / bare for bare, whole in pairs)
        whole = statistics.median(whole for _, whole in pairs)
        print(f"{case.name:36} {whole * 1e6:8.2f} us {ratio:6.2f} x bare mj_step")


if __name__ == "__main__":
    main()
