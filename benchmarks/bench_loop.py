"""What control costs, side by side with bare physics, in one process.

Closed loops with recording, by machine code and by Python, as multiples of a bare `mj_step` of the
same scene in the same contact. Rounds alternate, so that a machine that slows down slows all of
them; the medians over the rounds are printed. `loop` is the processor time of the loop's thread,
`all` that of the process, with the thread that formats and writes the log.

    python benchmarks/bench_loop.py [CASE ...]

A CASE is a part of a case's name; those of the keys beside a law are the last eight, and the same
stage without its key is measured by other tasks: `closed form` is that of `hybrid`.
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np

from taskspec.compiler import compile_task
from taskspec.native.code import Compiling
from taskspec.spec import load_task
from taskspec_runner.loop.assembly import assemble
from taskspec_runner.loop.closed_loop import ClosedLoop
from taskspec_runner.loop.native.loop import NativeLoop
from taskspec_runner.loop.sensing import Sensing
from taskspec_runner.record.log import Log
from taskspec_runner.record.recorder import BATCH

TASKS = Path(__file__).resolve().parent.parent / "tasks"
#: Stage time at which a stage is measured [s].
AFTER = 1.2
#: Whole batches of the log.
ROUNDS, STEPS = 5, 2 * BATCH
#: Bare steps in a row before the state is put back.
UNCONTROLLED = 100


@dataclass(frozen=True)
class Case:
    """A stage of a task."""

    name: str
    task: str
    stage: str
    overrides: Mapping[str, str] = field(default_factory=dict)


QP, UR5E = {"law.solve": "qp"}, {"robot.model": "ur5e"}


def lasts(stage: str, **others: str) -> dict[str, str]:
    """Overrides with which a stage is not over before all rounds are; others of the stage."""
    return {f"stages.{stage}.{key}": value for key, value in {"time": "60 s", **others}.items()}


def flat(shape: str) -> dict[str, str]:
    """Overrides with which the tool wipes by a face that gives way to moments."""
    tool = f"{{shape: {shape}, length: 120 mm}}"
    return {
        "robot.tool": tool,
        **{f"stages.wipe.axes.{axis}": "{torque: 0}" for axis in ("rx", "ry")},
    }


WIPE, PRESS, SLIDE = lasts("wipe"), lasts("press"), lasts("slide")
CYLINDER = flat("cylinder, radius: 12 mm, thickness: 20 mm")
BOX = flat("box, size: [24 mm, 24 mm, 20 mm]")
BY_VELOCITY = {"robot.command": "velocity", "law": "force-velocity"}
BY_POSITION = {"robot.command": "position", "law": "admittance"}
SWAY = {"axes.x": "{position: 50 mm * (1 - cos(1 rad/s * t))}"}
CASES = (
    Case("closed form", "wipe-table", "wipe", WIPE),
    Case("program, no limit in the way", "wipe-table", "wipe", WIPE | QP),
    Case("every limit, none in the way", "press-qp", "slide", SLIDE),
    Case("program solved in every tick", "press-saturated", "press", PRESS),
    Case("equations (planar3)", "linkage", "right", lasts("right", **SWAY)),
    Case("six joints (ur5e)", "press-parallel", "slide", SLIDE | UR5E),
    Case("mechanism (crank)", "crank", "rotate", {"stages.rotate.until": "crank.angle > 9 turn"}),
    Case("sensor at the wrist", "wrist-sensor", "press", PRESS),
    Case("plant at 4 kHz", "wipe-table", "wipe", WIPE | {"control.plant_rate": "4 kHz"}),
    Case("velocities to a servo", "press-parallel", "slide", SLIDE | BY_VELOCITY),
    Case("positions to a servo", "press-parallel", "slide", SLIDE | BY_POSITION),
    Case("a cylinder's flat end", "wipe-table", "wipe", WIPE | CYLINDER),
    Case("a box's face", "wipe-table", "wipe", WIPE | BOX),
    Case("energy tank", "energy-tank", "press", PRESS),
    Case("adapting to a payload", "unknown-payload", "swing", lasts("swing")),
    Case("stiffness estimated", "press-unknown-pads", "on_soft", lasts("on_soft")),
    Case("velocity by an observer", "coarse-encoders", "press", PRESS),
    Case("friction compensated", "sticking-joints", "right", lasts("right")),
    Case("sliding term", "wipe-sliding", "wipe", WIPE),
    Case("disturbance observer", "wipe-observer", "wipe", WIPE),
    Case("body in the jaws, at 4 kHz", "pick-and-screw", "carry", lasts("carry")),
)


class Loop:
    """A stage's closed loop by machine code or by Python, and the bare step of its scene."""

    def __init__(self, case: Case, folder: Path, *, native: bool) -> None:
        """Runs to the stage."""
        folder.mkdir()
        program = compile_task(load_task(TASKS / f"{case.task}.yaml", case.overrides), force=True)
        self.parts = parts = assemble(program)
        self._period = program.context.period
        self._sensing = Sensing(parts.plant.arm, parts.plant.views.equations, parts.machine)
        self.recorder = parts.recorder(Log(folder / "log.arrow"))
        self._ticks, self._native = 0, None
        self._slots = [parts.bus.slices[name].start for name in ("clock", "t", "stage")]
        self._sensing.read()
        parts.machine.start()
        while parts.machine.stage.name != case.stage or parts.machine.t < AFTER:
            self._step()
        if native:
            closed = ClosedLoop(parts.machine, parts.plant, parts.bus, self._sensing, self.recorder)
            self._native = NativeLoop(closed, self.recorder.block)
            self.recorder.by_machine_code()
        self._state = np.zeros(mujoco.mj_stateSize(parts.plant.model, self._kind))
        self.run(2)

    _kind = mujoco.mjtState.mjSTATE_INTEGRATION

    def run(self, steps: int) -> None:
        """So many ticks with recording."""
        if self._native is None:
            for _ in range(steps):
                self._step()
            return
        left = steps
        while left > 0:
            done = self._native.run(self._ticks, min(left, self.recorder.left), Compiling.WAIT)
            self._ticks += done
            left -= done
            self.recorder.advance(done)
            if self._native.sensed:
                self._step(sensed=True)
                left -= 1

    def bare(self, steps: int) -> None:
        """So many steps of the scene without control."""
        model, data = self.parts.plant.model, self.parts.plant.data
        for _ in range(steps):
            mujoco.mj_step(model, data)

    def bare_step(self, steps: int) -> float:
        """Seconds of the thread for a bare step, of so many; the simulator's state is put back.

        Every so often, for under a torque that nothing controls the tool slides out of its contact.
        """
        model, data = self.parts.plant.model, self.parts.plant.data
        mujoco.mj_getState(model, data, self._state, self._kind)
        taken = 0.0
        for _ in range(steps // UNCONTROLLED):
            begin = time.thread_time()
            self.bare(UNCONTROLLED)
            taken += time.thread_time() - begin
            mujoco.mj_setState(model, data, self._state, self._kind)
            mujoco.mj_forward(model, data)
        return taken / steps

    def _step(self, *, sensed: bool = False) -> None:
        if not sensed:
            self._sensing.read()
        self.parts.machine.tick(self._ticks * self._period)
        array, machine = self.parts.bus.array, self.parts.machine
        clock, t, stage = self._slots
        array[clock], array[t], array[stage] = self._ticks * self._period, machine.t, machine.index
        self.parts.plant.step(machine.torque)
        self.recorder.add()
        self._ticks += 1


def measured(case: Case, folder: Path) -> dict[str, list[float]]:
    """Multiples of the bare step, by what was measured."""
    loops = {name: Loop(case, folder / name, native=name == "native") for name in NAMES}
    ratios: dict[str, list[float]] = {}
    substeps = loops["native"].parts.plant.substeps
    for _ in range(ROUNDS):
        for name, loop in loops.items():
            bare = loop.bare_step(STEPS) * substeps
            whole, own = time.process_time(), time.thread_time()
            loop.run(STEPS)
            own = time.thread_time() - own
            # As many batches as the round has begun: what the log's thread does counts whole.
            loop.recorder.settle()
            whole = time.process_time() - whole
            ratios.setdefault(name, []).append(own / STEPS / bare)
            ratios.setdefault(f"{name}, all", []).append(whole / STEPS / bare)
            ratios.setdefault("bare", []).append(bare * 1e6)
    for loop in loops.values():
        assert loop.parts.machine.stage.name == case.stage, f"{case.name}: its stage has ended"
        assert not loop.parts.machine.ended, f"{case.name}: its run has ended"
        loop.recorder.close()
    return ratios


NAMES = ("native", "python")


def main(wanted: list[str]) -> None:
    """Measures the cases, one after the other."""
    columns = [part for name in NAMES for part in (name, f"{name}, all")]
    print(f"{'x bare mj_step':30} {'bare':>9}" + "".join(f"{column:>13}" for column in columns))
    with tempfile.TemporaryDirectory() as folder:
        for number, case in enumerate(CASES):
            if wanted and not any(text in case.name for text in wanted):
                continue
            (Path(folder) / str(number)).mkdir()
            ratios = measured(case, Path(folder) / str(number))
            medians = {name: statistics.median(values) for name, values in ratios.items()}
            cells = "".join(f"{medians[column]:13.2f}" for column in columns)
            print(f"{case.name:30} {medians['bare']:6.2f} us{cells}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
