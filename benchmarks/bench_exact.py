"""What a step of the plant costs with exact equations, beside the same scene with stiff springs.

Plants of one task, its equations `exact` and `rigid`, step in turns without control, as the native
loop has them step: by machine code. The medians of the rounds are printed, and of the time that
`mj_step` alone takes.

    python benchmarks/bench_exact.py
"""

from __future__ import annotations

import ctypes
import statistics
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import mujoco
import numpy as np

from taskspec.compiler import compile_unchecked
from taskspec.native.code import Compiling, kernel_engine
from taskspec.spec import load_task
from taskspec_runner.loop.assembly import assemble
from taskspec_runner.loop.closed_loop import ClosedLoop
from taskspec_runner.loop.native import loop
from taskspec_runner.loop.native.loop import NativeLoop
from taskspec_runner.loop.native.tick_memory import TickMemory
from taskspec_runner.loop.native.ticks import _step
from taskspec_runner.loop.sensing import Sensing

TASKS = Path(__file__).resolve().parent.parent / "tasks"
#: Steps in a row before the state is put back; how often, in a round; rounds.
STEPS, REPEATED, ROUNDS = 100, 20, 41
RING = {"rim": "x^2 + y^2 = (90 mm)^2", "level": "z = 0"}
#: A task with its equations.
CASES: Mapping[str, tuple[str, Mapping[str, str]]] = {
    "two on the tip (panda)": ("ring", RING),
    "one on joints (planar3)": ("linkage", {"bars": "q1 + q2 + q3 = 0"}),
}
_KIND = mujoco.mjtState.mjSTATE_INTEGRATION


def step(c: TickMemory, count: int) -> int:
    """So many periods of the plant, under a torque that is held."""
    for _ in range(count):
        _step(c)
    return count


class Stepped:
    """A plant at its start, its weight borne, as machine code steps it."""

    def __init__(self, task: str, equations: Mapping[str, str], stiffness: str) -> None:
        """Of a task whose equations have a stiffness."""
        frame = ", frame: rail" if task == "ring" else ""
        overrides = {
            f"world.{name}": f'{{equation: "{text}"{frame}, stiffness: {stiffness}}}'
            for name, text in equations.items()
        }
        program = compile_unchecked(load_task(TASKS / f"{task}.yaml", overrides))
        self._parts = parts = assemble(program)
        self._plant = plant = parts.plant
        sensing = Sensing(plant.arm, plant.views.equations, parts.machine)
        sensing.read()
        parts.machine.start()
        closed = ClosedLoop(parts.machine, plant, parts.bus, sensing, parts.recorder(None))
        self._native = NativeLoop(closed, None)
        self._native.ready(Compiling.WAIT)
        self._record = self._native._stages[0]
        modules = (sys.modules[__name__], *loop._MODULES)
        engine = kernel_engine(step, *modules, compiling=Compiling.WAIT)
        self._step = engine.function("step", ctypes.c_int64, ctypes.c_void_p, ctypes.c_int64)
        parts.machine.torque[:] = plant.data.qfrc_bias[plant.arm.velocities]
        self._state = np.zeros(mujoco.mj_stateSize(plant.model, _KIND))
        mujoco.mj_getState(plant.model, plant.data, self._state, _KIND)

    def step(self) -> float:
        """Seconds for a step with what keeps the equations."""
        return self._taken(lambda: self._step(self._record.address, STEPS))

    def bare(self) -> float:
        """Seconds for a step of MuJoCo alone."""
        return self._taken(lambda: mujoco.mj_step(self._plant.model, self._plant.data, STEPS))

    def _taken(self, steps: Callable[[], object]) -> float:
        model, data = self._plant.model, self._plant.data
        total = 0.0
        for _ in range(REPEATED):
            mujoco.mj_setState(model, data, self._state, _KIND)
            mujoco.mj_forward(model, data)
            begin = time.thread_time()
            steps()
            total += time.thread_time() - begin
        return total / REPEATED / STEPS


def main() -> None:
    """Measures the cases, one after the other."""
    print(f"{'plant step':26}{'mj_step':>11}{'rigid':>11}{'exact':>11}{'exact / rigid':>16}")
    for name, (task, equations) in CASES.items():
        exact, rigid = (Stepped(task, equations, stiffness) for stiffness in ("exact", "rigid"))
        found = [(rigid.bare(), rigid.step(), exact.step()) for _ in range(ROUNDS)]
        cells = "".join(
            f"{1e6 * statistics.median(each):8.2f} us" for each in zip(*found, strict=True)
        )
        ratio = statistics.median(exact / rigid for _, rigid, exact in found)
        print(f"{name:26}{cells}{ratio:16.2f}", flush=True)


if __name__ == "__main__":
    main()
