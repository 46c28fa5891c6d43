"""Faults that `truth` declares, in every shipped task: how each ends, what its verdict is worth.

    python campaigns/declared_faults.py --jobs 2 --rows rows.jsonl --table docs/faults.md
    python campaigns/declared_faults.py --rows rows.jsonl --table docs/faults.md --again crank

Each fault begins halfway through the task. A run ends in one of four ways: success, a missed
expectation, a branch that leads to `fail`, or a stop with a name. Beside the log stands what
MuJoCo itself has: joint positions, and the sum of contact forces. By these a run that passed is
judged once more. The exit code is 1 if a run ends otherwise, or passes what is not so.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
import traceback
from collections import Counter, defaultdict
from collections.abc import Collection, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from pathlib import Path

os.environ.setdefault("MUJOCO_GL", "disable")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import mujoco
import numpy as np

from taskspec.compiler import compile_task
from taskspec.faults import ENCODER, SENSOR
from taskspec.program.program import Program
from taskspec.program.worlds import true_world
from taskspec.robot.description import listening
from taskspec.spec import LoadedTask, Task, load_task
from taskspec_runner.exit_codes import WELL
from taskspec_runner.loop import fixed_step
from taskspec_runner.loop.assembly import Assembly, assemble
from taskspec_runner.plant.plant import Plant
from taskspec_runner.record.history import History
from taskspec_runner.record.layout import LogLayout
from taskspec_runner.record.rows import RowKeeper
from taskspec_runner.verdict.findings import findings
from taskspec_runner.verdict.judge import judge_run
from taskspec_runner.verdict.replay import Replay
from taskspec_runner.verdict.summary import exit_code

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "faults.md"
MARK = "<!-- table: declared faults -->"

#: In the file's words; J is the number of a joint in the middle of the arm, AT half of the task.
FAULTS = (
    "{sensor: drops, at: AT, for: 10 ms}",
    "{sensor: drops, at: AT}",
    "{sensor: sticks, at: AT, for: 200 ms}",
    "{sensor: sticks, at: AT}",
    "{sensor: lost, at: AT, for: 50 ms}",
    "{sensor: lost, at: AT}",
    "{sensor: swaps, axis: [x, z], at: AT}",
    "{sensor: flips, at: AT}",
    "{sensor: bias 3 N, axis: z, at: AT}",
    "{sensor: drifts 2 N/s, at: AT}",
    "{sensor: gain 0.5, at: AT}",
    "{sensor: gain 2, at: AT}",
    "{sensor: noise 2 N, at: AT}",
    "{sensor: spikes 30 N, axis: z, at: AT}",
    "{sensor: late 10 ms, at: AT}",
    "{sensor: clips 5 N, at: AT}",
    "{torque: lost, joint: J, at: AT, for: 20 ms}",
    "{torque: lost, joint: J, at: AT}",
    "{torque: gain 0.8, joint: J, at: AT}",
    "{torque: late 2 ms, at: AT}",
    "{torque: bias 2 N*m, joint: J, at: AT}",
    "{torque: flips, joint: J, at: AT, for: 10 ms}",
    "{encoder: drops, at: AT, for: 10 ms}",
    "{encoder: sticks, joint: J, at: AT}",
    "{encoder: bias 0.5 deg, joint: J, at: AT}",
    "{encoder: drifts 0.5 deg/s, joint: J, at: AT}",
    "{encoder: noise 0.01 deg, at: AT}",
    "{encoder: late 3 ms, at: AT}",
    "{encoder: spikes 1 deg, joint: J, at: AT}",
    "{encoder: gain 1.02, joint: J, at: AT}",
)

SUCCESS, MISSED, FAILED, STOPPED, WRONG = "success", "missed", "fail branch", "stop", "WRONG"
#: What MuJoCo's own numbers and the log may differ by: sums of the same numbers in another order.
FORCE_ROUNDING, LENGTH_ROUNDING = 1e-6, 1e-9


@dataclass(frozen=True)
class Ended:
    """How a task ended under a fault.

    Attributes:
        task, fault: of the run.
        kind: success, missed, fail branch, stop, or WRONG.
        reason: of a stop, or what is wrong.
        compared: what the verdict was held against, beside the log.
    """

    task: str
    fault: str
    kind: str
    reason: str = ""
    compared: str = ""


class Witness:
    """Keeps every tick, and beside it what MuJoCo has: positions before, contacts after the step.

    Attributes:
        q: (n,) of each tick [rad, m].
        force: (3,) of each tick, on the tool by all it touches, world axes [N].
    """

    def __init__(self, parts: Assembly) -> None:
        self.keeper = RowKeeper(parts.bus)
        self._plant = parts.plant
        self._before = parts.plant.arm.q.copy()
        self.q: list[np.ndarray] = []
        self.force: list[np.ndarray] = []

    def add(self) -> None:
        """Takes a tick."""
        self.keeper.add()
        self.q.append(self._before)
        self._before = self._plant.arm.q.copy()
        self.force.append(contact_force(self._plant))


def contact_force(plant: Plant) -> np.ndarray:
    """(3,) sum of MuJoCo's contacts on the tool, world axes [N]."""
    model, data = plant.model, plant.data
    tip = plant.scene.arm.places(model).tip
    total, found = np.zeros(3), np.zeros(6)
    for i in range(data.ncon):
        contact = data.contact[i]
        bodies = [int(model.geom_bodyid[geom]) for geom in contact.geom]
        if (bodies[0] == tip) == (bodies[1] == tip):
            continue
        mujoco.mj_contactForce(model, data, i, found)
        force = contact.frame.reshape(3, 3).T @ found[:3]
        total += force if bodies[1] == tip else -force
    return total


def with_fault(file: Path, fault: str, at: float, joint: int) -> LoadedTask:
    """A task with a fault at a run time [s] of a joint, counted from 1."""
    text = fault.replace("AT", f"{at:.3f} s").replace("J", str(joint))
    return load_task(file, {"truth.faults": f"[{text}]"})


def ended(program: Program, task: Task, fault: str) -> Ended:
    """Runs a program in a true world and says how it ends; what goes wrong within is WRONG."""
    name = task.name
    try:
        return _ended(program, task, fault)
    except Exception as error:
        trace = traceback.extract_tb(error.__traceback__)[-1]
        why = f"{type(error).__name__}: {error} ({Path(trace.filename).name}:{trace.lineno})"
        return Ended(name, fault, WRONG, why)


def _ended(program: Program, task: Task, fault: str) -> Ended:
    context = program.context
    world = replace(true_world(context), task=task)
    parts = assemble(program, world)
    witness = Witness(parts)
    with listening([]):
        outcome = fixed_step.run(
            parts.machine,
            parts.plant,
            parts.bus,
            witness,
            context.period,
            loop=fixed_step.PYTHON,
            faults=parts.faults,
        )
    history = witness.keeper.history(LogLayout.of(program, task), program.stages)
    judged = judge_run(program, history)
    found = findings(program, history, task)
    if not all(np.isfinite(parts.plant.data.qpos)):
        return Ended(task.name, fault, WRONG, "the plant is not finite")
    if outcome.status == fixed_step.STOPPED:
        named = outcome.reason and outcome.text
        return Ended(task.name, fault, STOPPED if named else WRONG, outcome.reason)
    if outcome.status == fixed_step.FAILED:
        return Ended(task.name, fault, FAILED, outcome.reason)
    good = exit_code(outcome, judged, 0, found) == WELL
    if not good:
        return Ended(task.name, fault, MISSED)
    wrong, compared = _witnessed(program, task, history, witness)
    return Ended(task.name, fault, WRONG if wrong else SUCCESS, wrong, compared)


def _witnessed(program: Program, task: Task, history: History, witness: Witness) -> tuple[str, str]:
    """What of a success is not so by MuJoCo's own numbers, and what it was held against."""
    context, columns = program.context, dict(history.columns)
    q, force = np.array(witness.q), np.array(witness.force)
    for i in range(q.shape[1]):
        apart = np.abs(columns[f"joint.{i + 1}.position"] - q[:, i]).max()
        if apart > LENGTH_ROUNDING:
            return f"joint {i + 1} is logged {apart:g} from where it is", ""
        columns[f"joint.{i + 1}.position"] = q[:, i]
    replay = Replay(
        context.robot,
        context.frames,
        program.stages,
        History(columns, history.stages, history.units),
        context.moving_bases,
    )
    for visit in history.visits():
        stage = next(s for s in program.stages if s.name == visit.stage)
        frame, rows = stage.plan.frame, visit.rows
        if frame.still and frame.kind != "estimated":
            # The place of the control point, of the tip's pose by Pinocchio.
            own = replay._place(frame)
            for axis in (a for a in stage.plan.axes if not a.is_rotation):
                apart = np.abs(columns[f"position.{axis}"][rows] - own[rows, axis.column]).max()
                if apart > LENGTH_ROUNDING:
                    return f"position.{axis} of {visit.stage} is logged {apart:g} m off", ""
    compared = "positions"
    if task.robot.grasp is None and not task.equations:
        for visit in history.visits():
            stage = next(s for s in program.stages if s.name == visit.stage)
            _, R = replay.pose(stage.plan.frame)
            rows = visit.rows
            applied = -np.einsum("kji,kj->ki", R[rows], force[rows])
            for axis in (a for a in stage.plan.axes if not a.is_rotation):
                logged = columns[f"force.{axis}"][rows]
                own = applied[:, axis.column]
                apart = np.abs(logged - own).max()
                if not apart <= FORCE_ROUNDING * max(1.0, np.abs(force).max()):
                    return f"force.{axis} of {visit.stage} is logged {apart:g} N off", ""
                changed = columns[f"force.{axis}"].copy()
                changed[rows] = own
                columns[f"force.{axis}"] = changed
        compared += ", forces"
    # Nothing that the controller measured is left to judge by, but where a frame turned by it.
    frames = [stage.plan.frame for stage in program.stages]
    turned = any(frame.tracking is not None or frame.estimated_in for frame in frames)
    true = {
        name: values
        for name, values in columns.items()
        if not name.endswith(".measured") or (turned and name.startswith("force."))
    }
    judged = judge_run(program, History(true, history.stages, history.units))
    broken = [each.text for each in judged if each.passed is not True]
    return (f"not so: {broken[0]}" if broken else ""), compared


def run_task(file: Path, faults: Sequence[str] = FAULTS) -> list[Ended]:
    """A shipped task under every fault."""
    plain = compile_task(load_task(file))
    parts = assemble(plain)

    class Nowhere:
        block = None
        left = 1000

        def add(self) -> None:
            """Keeps nothing."""

        def advance(self, ticks: int) -> None:
            """Keeps nothing."""

        def by_machine_code(self) -> None:
            """Has no signals."""

    with listening([]):
        outcome = fixed_step.run(
            parts.machine, parts.plant, parts.bus, Nowhere(), plain.context.period
        )
    at, joint = outcome.clock / 2, plain.context.robot.pin.nv // 2 + 1
    programs: dict[str, Program] = {}
    found = []
    for fault in faults:
        loaded = with_fault(file, fault, at, joint)
        device = loaded.task.truth.faults[0].device
        # A program depends on whether encoders fail, and on nothing else of a fault.
        kind = ENCODER if device == ENCODER else SENSOR
        if kind not in programs:
            programs[kind] = compile_task(loaded)
        found.append(ended(programs[kind], loaded.true_task, fault))
    return found


def table(found: Sequence[Ended]) -> str:
    """How the tasks ended, by fault."""
    rows = [
        "| fault | success | missed | fail branch | named stop | stops by name |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    by_fault: dict[str, list[Ended]] = defaultdict(list)
    for each in found:
        by_fault[each.fault].append(each)
    for fault in FAULTS:
        kinds = Counter(each.kind for each in by_fault[fault])
        stops = Counter(each.reason for each in by_fault[fault] if each.kind == STOPPED)
        names = ", ".join(f"{name} {n}" for name, n in stops.most_common()) or "-"
        shown = fault.strip("{}").replace(", at: AT", "").replace("J", "j")
        counts = " | ".join(str(kinds[kind]) for kind in (SUCCESS, MISSED, FAILED, STOPPED))
        rows.append(f"| `{shown}` | {counts} | {names} |")
    kinds = Counter(each.kind for each in found)
    counts = " | ".join(str(kinds[kind]) for kind in (SUCCESS, MISSED, FAILED, STOPPED))
    tasks = len({each.task for each in found})
    rows.append(f"| all: {len(found)} runs of {tasks} tasks | {counts} | - |")
    return "\n".join(rows)


def write_table(path: Path, found: Sequence[Ended]) -> None:
    """Puts the table between its marks."""
    before, _, after = path.read_text(encoding="utf-8").split(MARK)
    path.write_text(f"{before}{MARK}\n{table(found)}\n{MARK}{after}", encoding="utf-8")


def kept(rows: Path, tasks: Collection[str]) -> list[Ended]:
    """What earlier campaigns found of some tasks; nothing where there is no file."""
    if not rows.exists():
        return []
    lines = rows.read_text(encoding="utf-8").splitlines()
    found = [Ended(**json.loads(line)) for line in lines]
    return [each for each in found if each.task in tasks]


def keep(rows: Path, found: Sequence[Ended]) -> None:
    """Keeps all that was found, in the place of what was there."""
    rows.parent.mkdir(parents=True, exist_ok=True)
    beside = rows.with_suffix(".new")
    beside.write_text("".join(json.dumps(asdict(e)) + "\n" for e in found), encoding="utf-8")
    beside.replace(rows)


def main() -> int:
    """Runs all; the exit code is 1 if anything is WRONG."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--only", nargs="*", default=[], help="names of tasks; all without")
    parser.add_argument("--again", nargs="*", default=[], help="tasks whose kept rows are old")
    parser.add_argument("--table", type=Path, help="a page that keeps the table")
    parser.add_argument("--rows", type=Path, help="a file of every run, which goes on from there")
    given = parser.parse_args()
    shipped = {load_task(file).task.name: file for file in sorted((ROOT / "tasks").glob("*.yaml"))}
    unknown = sorted({*given.only, *given.again} - set(shipped))
    if unknown:
        parser.error(f"no shipped task is called {', '.join(unknown)}")
    found = [] if given.rows is None else kept(given.rows, set(shipped) - set(given.again))
    done_before = {each.task for each in found}
    wanted = set(given.only or shipped) - done_before
    files = [file for name, file in shipped.items() if name in wanted]
    began = time.perf_counter()
    with ProcessPoolExecutor(given.jobs) as pool:
        waiting = {pool.submit(run_task, file): file for file in files}
        for done in as_completed(waiting):
            found += done.result()
            if given.rows is not None:
                keep(given.rows, found)
            kinds = dict(Counter(each.kind for each in done.result()))
            clock = time.perf_counter() - began
            sys.stdout.write(f"{clock:6.0f} s  {waiting[done].stem}: {kinds}\n")
            sys.stdout.flush()
    wrong = [each for each in found if each.kind == WRONG]
    for each in wrong:
        sys.stdout.write(f"WRONG {each.task} {each.fault}: {each.reason}\n")
    if given.table is not None:
        write_table(given.table, found)
    compared = Counter(each.compared for each in found if each.kind == SUCCESS)
    kinds = dict(Counter(each.kind for each in found))
    sys.stdout.write(f"{len(found)} runs: {kinds}; successes held against {dict(compared)}\n")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
