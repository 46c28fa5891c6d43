"""What a change of stage costs, as multiples of the median tick of its task.

Every task is run five times by each loop, in one process. A change is measured by the processor
time of the loop's thread, from the measurement of the tick on which a stage ends to the record of
that tick; with machine code from where that has stopped to the end of the tick that follows. Of
each change the best of the five runs counts, of each task the change that costs most.

    python benchmarks/bench_stages.py [TASK ...]
"""

from __future__ import annotations

import statistics
import sys
import time
from pathlib import Path

from taskspec.compiler import compile_task
from taskspec.native.code import Compiling
from taskspec.program.program import Program
from taskspec.spec import load_task
from taskspec_runner.loop.assembly import assemble
from taskspec_runner.loop.closed_loop import ClosedLoop
from taskspec_runner.loop.fixed_step import NATIVE, PYTHON
from taskspec_runner.loop.native.loop import NativeLoop
from taskspec_runner.loop.sensing import Sensing

TASKS = Path(__file__).resolve().parent.parent / "tasks"
RUNS, AT_ONCE = 5, 400
LOOPS = (NATIVE, PYTHON)


class Run:
    """A run of a task, to its end.

    Attributes:
        ticks: seconds of ticks on which nothing happens.
        changes: seconds of changes of stage, in their order.
    """

    def __init__(self, program: Program, *, native: bool) -> None:
        self.ticks: list[float] = []
        self.changes: list[float] = []
        self._parts = parts = assemble(program)
        machine, plant = parts.machine, parts.plant
        self._sensing = Sensing(plant.arm, plant.views.equations, machine)
        self._recorder = parts.recorder(None)
        closed = ClosedLoop(machine, plant, parts.bus, self._sensing, self._recorder)
        self._native = NativeLoop(closed, self._recorder.block) if native else None
        self._done = 0
        self._sensing.read()
        machine.start()
        if native:
            self._code(1)
        while not machine.ended:
            before, code = len(machine.transitions), self._native
            if code is not None:
                begin, runner = time.thread_time(), machine.runner
                knot = runner.tracks.next_knot
                done = self._code(AT_ONCE)
                if done == AT_ONCE and runner.tracks.next_knot == knot:
                    self.ticks.append((time.thread_time() - begin) / done)
                if not (code.sensed or code.ends):
                    continue
            begin = time.thread_time()
            if code is None or not code.ends:
                self._tick(code)
            if code is not None and (code.ends or len(machine.transitions) > before):
                self._follow(code)
            changed = len(machine.transitions) > before and not machine.ended
            taken = time.thread_time() - begin
            if changed:
                self.changes.append(taken)
            elif self._native is None:
                self.ticks.append(taken)
        self._recorder.close()

    def _follow(self, code: NativeLoop) -> None:
        """To the end of the tick after a stage's first one; what the code leaves is Python's."""
        machine = self._parts.machine
        while machine.stage_ticks < 2 or code.ends:
            self._code(2 - machine.stage_ticks if not code.ends else 2)
            if code.sensed or code.made:
                self._tick(code)
            if machine.ended:
                break

    def _code(self, most: int) -> int:
        assert self._native is not None
        done = self._native.run(self._done, most, Compiling.WAIT)
        self._recorder.advance(done)
        self._done += done
        return done

    def _tick(self, code: NativeLoop | None) -> None:
        machine, bus = self._parts.machine, self._parts.bus
        clock = self._done * machine.period
        if code is None or not code.made:
            if code is None or not code.sensed:
                self._sensing.read()
            machine.tick(clock)
        bus.view("clock")[0], bus.view("t")[0], bus.view("stage")[0] = (
            clock,
            machine.t,
            machine.index,
        )
        self._parts.plant.step(machine.torque)
        self._recorder.add()
        self._done += 1


def main(wanted: list[str]) -> None:
    """Measures tasks, one after the other."""
    columns = [f"{loop} {what}" for loop in LOOPS for what in ("tick", "change", "ratio")]
    print(f"{'':28} changes" + "".join(f"{column:>15}" for column in columns))
    for path in sorted(TASKS.glob("*.yaml")):
        if wanted and path.stem not in wanted:
            continue
        program = compile_task(load_task(path), force=True)
        cells, count = [], 0
        for loop in LOOPS:
            runs = [Run(program, native=loop == NATIVE) for _ in range(RUNS)]
            count = len(runs[0].changes)
            if not count:
                break
            tick = min(statistics.median(run.ticks) for run in runs)
            change = max(min(run.changes[i] for run in runs) for i in range(count))
            cells += [
                f"{tick * 1e6:12.1f} us",
                f"{change * 1e6:12.0f} us",
                f"{change / tick:15.1f}",
            ]
        if count:
            print(f"{path.stem:28} {count:7}" + "".join(cells), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
