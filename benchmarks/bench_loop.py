"""What control costs, side by side with bare physics, in one process.

Prints bare `mj_step` of the scene in contact, the tick, its parts, and the whole closed loop with
recording, each as a multiple of the bare step. Rounds alternate, so that a machine that slows down
slows all of them; the medians over the rounds are printed.

    python benchmarks/bench_loop.py [TASK] [STAGE]
"""

from __future__ import annotations

import statistics
import sys
import tempfile
from pathlib import Path

import mujoco
import numpy as np
from timed import seconds

from taskspec.compiler import compile_task
from taskspec.spec import load_task
from taskspec_runner.loop.assembly import assemble
from taskspec_runner.loop.sensing import Sensing
from taskspec_runner.record.log import Log

TASKS = Path(__file__).resolve().parent.parent / "tasks"
ROUNDS, STEPS = 15, 1000


def main(task: Path, stage: str) -> None:
    """Measures one stage of one task, half a second after it has begun."""
    loaded = load_task(task)
    program = compile_task(loaded)
    robot, period = program.context.robot, program.context.period
    parts = assemble(program)
    plant, machine = parts.plant, parts.machine
    sensing = Sensing(plant.arm, plant.views.equations, machine)
    sensing.read()
    machine.start()
    ticks = 0

    def closed_loop_step() -> None:
        nonlocal ticks
        sensing.read()
        machine.tick(ticks * period)
        plant.step(machine.torque)
        ticks += 1

    while machine.stage.name != stage or machine.t < 0.5:
        closed_loop_step()
    model, data = plant.model, plant.data
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.zeros(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, data, state, kind)
    with tempfile.TemporaryDirectory() as folder:
        recorder = parts.recorder(Log(Path(folder) / "log.arrow"))

        def whole() -> None:
            closed_loop_step()
            recorder.add()

        def tick() -> None:
            machine.tick(ticks * period)

        def terms() -> None:
            machine.update_terms()

        def bare() -> None:
            mujoco.mj_step(model, data)

        measured: dict[str, list[float]] = {}
        for _ in range(ROUNDS):
            for name, function, steps in (
                ("bare mj_step in contact", bare, 200),
                ("model terms", terms, STEPS),
                ("tick, model terms included", tick, 200),
                ("closed loop with recording", whole, STEPS),
            ):
                if name != "closed loop with recording":
                    mujoco.mj_setState(model, data, state, kind)
                    mujoco.mj_forward(model, data)
                    sensing.read()
                measured.setdefault(name, []).append(seconds(function, steps))
            mujoco.mj_setState(model, data, state, kind)
        recorder.close()
    bare_times = measured["bare mj_step in contact"]
    print(f"{task.stem}, stage {stage!r}, robot {robot.name}, {1 / period:g} Hz")
    for name, times in measured.items():
        ratio = statistics.median(t / b for t, b in zip(times, bare_times, strict=True))
        print(f"{name:30} {statistics.median(times) * 1e6:8.2f} us {ratio:6.2f} x")


if __name__ == "__main__":
    arguments = sys.argv[1:]
    name = arguments[0] if arguments else str(TASKS / "wipe-table.yaml")
    main(Path(name), arguments[1] if len(arguments) > 1 else "wipe")
