"""What a tick of an exported controller costs, beside one by the machine code of the native loop.

Both get the samples of a run of the task, from its first tick to its last: the C that gcc makes at
-O2, and the controller's kernel with all its functions as LLVM compiles them for the native loop,
without plant and log. They take turns, each with an instance that begins; the processor time of the
thread counts, the least of all rounds. Their torques are the same to the bit, which is checked.

    python benchmarks/bench_exported.py [TASK ...]
"""

from __future__ import annotations

import ctypes
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from taskspec.control.qp.dual import dual_solver
from taskspec.native import quadratic
from taskspec.native.code import Compiling, kernel_engine
from taskspec.native.kernel import Vector
from taskspec.program import evaluation, ports
from taskspec.program.execution import controller, controller_memory, exits, pivots, stage_solver
from taskspec.program.execution.controller import begin, control, copy, leave, open_stage, start
from taskspec.program.execution.controller_memory import ControllerMemory, controller_memories
from taskspec.program.execution.exits import repeats
from taskspec.program.limits import relaxing
from taskspec.program.program import Program
from taskspec_runner.controller_c.source import controller_of

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests"))

import controller_samples  # noqa: E402

TASKS = ROOT / "tasks"
ROUNDS = 100
#: How many times the time of the native loop's code the C may take.
MOST = 1.1
Array = NDArray[np.float64]
_MODULES = (
    *(controller, controller_memory, evaluation, quadratic, pivots),
    *(exits, stage_solver, relaxing, ports),
)
#: Ticks in a row by the C, without a caller between them.
REPLAY = """\
#include "{name}.h"
int64_t replay(struct {name} *m, const struct {name}_input *in, double *torques, int64_t ticks)
{{
    struct {name}_output out;
    int64_t i;
    int j;
    {name}_start(m, in, &out);
    for (i = 0; i < ticks; i++) {{
        {name}_step(m, &in[i], &out);
        for (j = 0; j < {joints}; j++) torques[i * {joints} + j] = out.torque[j];
    }}
    return out.state;
}}
"""


def native(
    c: ControllerMemory,
    after: ControllerMemory,
    wrench: Vector,
    samples: Vector,
    torques: Vector,
    ticks: int,
    width: int,
) -> int:
    """So many ticks of a stage, or the first of the stage `after` it where there are to be none.

    How many there have been; -1 less their number where the stage has ended on the next one.
    """
    if ticks == 0:
        begin(c, after, int(repeats(c.exits, c.stage, int(c.outputs[0]))))
        open_stage(after)
        copy(after.torque, torques, after.n)
        after.ticks += 1
        return 1
    for i in range(ticks):
        _take(c, wrench, samples[width * i :])
        if c.ticks == 0:
            start(c)
        if control(c) != 0:
            copy(c.torque, torques[c.n * i :], c.n)
            return -1 - i
        copy(c.torque, torques[c.n * i :], c.n)
        c.ticks += 1
    return ticks


def _take(c: ControllerMemory, wrench: Vector, sample: Vector) -> None:
    n = c.n
    copy(sample, c.q, n)
    copy(sample[n:], c.v, n)
    copy(sample[2 * n :], wrench, 6)
    copy(sample[2 * n + 6 :], c.reactions, c.n_reactions)


class ByMachineCode:
    """The controller as the native loop has it."""

    def __init__(self, program: Program) -> None:
        self._program = program
        pointer, count = ctypes.c_void_p, ctypes.c_int64
        engine = kernel_engine(native, sys.modules[__name__], *_MODULES, compiling=Compiling.WAIT)
        self._code = engine.function("native", count, *[pointer] * 5, count, count)
        # What is compiled lives as long as a machine that has it.
        self._first = self._instance()

    def _instance(self) -> tuple[object, tuple[ControllerMemory, ...], int]:
        machine = self._program.machine(own=dual_solver)
        stages = controller_memories(machine)
        for stage in stages:
            stage.alone, stage.solves = 1, stage.has_program
            assert stage.load(Compiling.WAIT)
        wrench = machine.wrench if machine.sensor is None else machine.sensor.reading
        return machine, stages, wrench.ctypes.data

    def run(self, samples: Array, torques: Array) -> float:
        """Seconds of a whole run."""
        _machine, stages, wrench = self._instance()
        ticks, width = samples.shape
        at, first, c = 0, time.thread_time(), stages[0]
        while at < ticks:
            given, out = samples[at:].ctypes.data, torques[at:].ctypes.data
            done = self._code(c.address, c.address, wrench, given, out, ticks - at, width)
            if done >= 0:
                break
            at -= done + 1
            to = leave(c)
            if to < 0:
                break
            self._code(c.address, stages[to].address, wrench, given, torques[at:].ctypes.data, 0, 0)
            at, c = at + 1, stages[to]
        return time.thread_time() - first


class ByC:
    """The exported controller."""

    def __init__(self, program: Program, folder: Path) -> None:
        made = controller_of(program)
        _, source = made.write(folder)
        joints = program.context.robot.n
        replay = folder / "replay.c"
        replay.write_text(REPLAY.format(name=made.name, joints=joints), encoding="utf-8")
        flags = ("-std=c99", "-O2", "-march=native", "-shared", "-fPIC", str(source), str(replay))
        subprocess.run(["gcc", *flags, "-o", str(folder / "c.so"), "-lm"], check=True)
        library, pointer = ctypes.CDLL(str(folder / "c.so")), ctypes.c_void_p
        self._size, self._init = (getattr(library, f"{made.name}_{p}") for p in ("size", "init"))
        self._size.restype, self._init.restype = ctypes.c_uint64, pointer
        self._init.argtypes = [pointer]
        self._replay = library.replay
        self._replay.argtypes = [*[pointer] * 3, ctypes.c_int64]

    def run(self, samples: Array, torques: Array) -> float:
        """Seconds of a whole run."""
        memory = np.zeros(-(-self._size() // 8))
        instance = self._init(memory.ctypes.data)
        first = time.thread_time()
        self._replay(instance, samples.ctypes.data, torques.ctypes.data, len(samples))
        return time.thread_time() - first


def main(wanted: list[str]) -> int:
    """Measures the tasks; the exit code is 1 if the C takes too long for one."""
    ratios = []
    print(f"{'time of a tick':28} {'ticks':>7} {'native':>9} {'C':>9} {'ratio':>7}")
    for path in sorted(TASKS.glob("*.yaml")):
        if wanted and path.stem not in wanted:
            continue
        program = controller_samples.program(path.stem)
        samples, *_ = controller_samples.recorded(path.stem)
        with tempfile.TemporaryDirectory() as folder:
            both: tuple[ByMachineCode | ByC, ...] = (
                ByMachineCode(program),
                ByC(program, Path(folder)),
            )
            torques = np.zeros((2, len(samples), program.context.robot.n))
            rounds = [
                [each.run(samples, out) for each, out in zip(both, torques, strict=True)]
                for _ in range(ROUNDS)
            ]
        assert torques[0].tobytes() == torques[1].tobytes(), f"{path.stem}: torques differ"
        native, own = np.min(rounds, axis=0) / len(samples) * 1e6
        ratios.append(own / native)
        print(
            f"{path.stem:28} {len(samples):7} {native:6.2f} us {own:6.2f} us {ratios[-1]:7.2f}",
            flush=True,
        )
    print(f"{len(ratios)} tasks, median {np.median(ratios):.2f}, most {max(ratios):.2f}")
    return int(max(ratios) > MOST)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
