"""One run from a loaded task to its folder: compile, simulate, record, judge, write."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from taskspec.compiler import compile_task
from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES
from taskspec.missing import require
from taskspec.program.context import Context
from taskspec.program.execution.machine import Machine
from taskspec.program.program import Program
from taskspec.program.worlds import World, draws_of, random_world, true_world
from taskspec.robot.description import listening
from taskspec.spec import LoadedTask
from taskspec_runner.errors import InputError, OutputError, RunCrashedError
from taskspec_runner.link.link import Link, link_summary
from taskspec_runner.loop.assembly import Assembly, assemble
from taskspec_runner.loop.driven import Driven, TickSink
from taskspec_runner.loop.fixed_step import PYTHON, STOPPED, Outcome, loop_wanted
from taskspec_runner.loop.fixed_step import run as simulate
from taskspec_runner.loop.hand import Hand
from taskspec_runner.loop.interrupt import BY_SIGNAL, Interrupt, Termination, signal_of
from taskspec_runner.loop.live_requests import setting
from taskspec_runner.loop.tap import Spectator, Tap, ticks_between
from taskspec_runner.loop.telemetry import Telemetry
from taskspec_runner.record import manifest
from taskspec_runner.record.folder import RunFolder, open_folder
from taskspec_runner.record.log import Log
from taskspec_runner.record.names import TASK
from taskspec_runner.record.recorder import Recorder
from taskspec_runner.result import RunResult
from taskspec_runner.verdict.judge import judge_run
from taskspec_runner.verdict.performance import solver_counts
from taskspec_runner.verdict.stopping import stopping
from taskspec_runner.verdict.summary import Simulated, reason_of, summarise


@dataclass(frozen=True, slots=True)
class Glimpse:
    """A run as it goes on.

    Attributes:
        clock: simulated time [s].
        stage: the current one.
        axis: the first axis with a force set point, empty if there is none; force, reference:
            measured and wanted on it, as the robot applies them [N, N m].
        real_time_factor: simulated seconds in a second.
    """

    clock: float
    stage: str
    axis: str
    force: float
    reference: float
    real_time_factor: float


#: Called from time to time, at least after every 400 ticks; the glimpse is made when it is asked
#: for.
Progress = Callable[[Callable[[], Glimpse]], None]


def execute(
    loaded: LoadedTask,
    out: Path | None = None,
    *,
    seed: int = 0,
    world: int | None = None,
    progress: Progress | None = None,
    report: bool = True,
    telemetry: Telemetry | None = None,
    force: bool = False,
    loop: str | None = None,
    link: Link | None = None,
    live: Sequence[str] = (),
) -> RunResult:
    """Compiles a task, runs it and leaves the run's folder; see `execute_program`.

    Args:
        world: number of a random world of `vary` under the seed; None for the true one.
        force: whether findings are lifted behind which a program still compiles.
        loop, link: as in `execute_program`.
        live: when live params are set to what, as `--live` has it.

    Raises:
        SpecError: the task is refused; no folder is made.
    """
    program = compile_task(loaded, force=force)
    chosen = world_numbered(program.context, seed, world)
    with setting(live, loaded.task, program.context.period) as hand:
        return execute_program(
            program,
            out,
            world=chosen,
            progress=progress,
            report=report,
            telemetry=telemetry,
            loop=loop,
            link=link,
            hand=hand,
        )


def world_numbered(context: Context, seed: int, number: int | None) -> World:
    """A random world of a task, or with no number the true one.

    Raises:
        InputError: nothing varies, and the world has another number than 0.
    """
    if number is None:
        return true_world(context, seed)
    if number and not draws_of(context):
        raise InputError(
            "nothing varies in this task, so that all its worlds are alike; "
            "give it a 'vary', or leave out the number of a world"
        )
    return random_world(context, seed, number)


def execute_program(
    program: Program,
    out: Path | None = None,
    *,
    world: World | None = None,
    progress: Progress | None = None,
    report: bool = True,
    telemetry: Telemetry | None = None,
    spectator: Spectator | None = None,
    loop: str | None = None,
    link: Link | None = None,
    hand: Hand | None = None,
) -> RunResult:
    """Runs a compiled task and leaves the run's folder.

    Args:
        program: the task.
        out: the folder; None for `runs/NAME`, with -2, -3, ... where that exists.
        world: that the plant is, and the seed of everything random in the run; None for the true
            one.
        progress: called now and then during the simulation.
        report: whether to render `report.html`.
        telemetry: gets the signals as the run goes on.
        spectator: looks on as the run goes on; its log is the same.
        loop: `native` or `python`, which give the same; None for what `TASKSPEC_LOOP` names, else
            for machine code where there can be some.
        link: the robot that it runs on, or what serves its plant, for which Python runs all ticks;
            None for a plant in this process.
        hand: sets live params while it goes on; None where nobody does.

    Raises:
        InputError: there is no native loop, and no other is wanted; or what the link is to is not
            what the task is for.
        MissingLibraryError: there is nothing that writes a log.
        OutputError: the folder cannot be written.
        RunCrashedError: an internal error; the log holds every tick up to it.
        KeyboardInterrupt: interrupted outside the simulation itself; `Terminated` unless by SIGINT.
    """
    wanted = loop_wanted(loop) if link is None else PYTHON
    require("pyarrow", "the log of a run")
    with Termination():
        if link is not None and link.measured:
            # Nobody knows what is true of it.
            world = World(program.context.loaded.task)
        world = true_world(program.context) if world is None else world
        manner = _Manner(world, progress, report, telemetry, spectator, wanted, link, hand)
        try:
            return _execute(program, out, manner)
        finally:
            if link is not None:
                link.finish("the run was broken off")


@dataclass(frozen=True, slots=True)
class _Manner:
    """How a program is run, as `execute_program` has it."""

    world: World
    progress: Progress | None
    report: bool
    telemetry: Telemetry | None
    spectator: Spectator | None
    loop: str | None
    link: Link | None = None
    hand: Hand | None = None


def _execute(program: Program, out: Path | None, manner: _Manner) -> RunResult:
    loaded = program.context.loaded
    content = manifest.task_bytes(loaded)
    with open_folder(out, loaded.task.name) as folder:
        return _kept(program, folder, content, manner)


def _kept(program: Program, folder: RunFolder, content: bytes, manner: _Manner) -> RunResult:
    """Makes a run in its folder; whatever happens, the manifest says it."""
    try:
        with folder.failures_noted():
            opening, link = manifest.opening(program, content, manner.world), manner.link
            if link is not None:
                opening["link"] = {"measured": link.measured, "lock_step": link.lock_step}
                opening["seed"] = None if link.measured else opening["seed"]
            folder.note(**opening)
            folder.write(TASK, content)
            return _run(program, folder, content, manner)
    except KeyboardInterrupt as error:
        # Once a run has been judged its outcome stands, even if its report does not.
        if folder.goes_on:
            number = signal_of(error)
            folder.end(STOPPED, reason_of(number), exit_code=BY_SIGNAL + number)
        raise
    except InputError as error:
        folder.end("crashed", str(error))
        raise
    except OutputError:
        raise
    except Exception as error:
        trace, reason = folder.crash(error), f"{type(error).__name__}: {error}"
        if program.forced:
            reason = f"{reason} (run in spite of {', '.join(program.forced)})"
        folder.end("crashed", reason)
        raise RunCrashedError(folder.path, trace, reason) from error


def _run(program: Program, folder: RunFolder, content: bytes, manner: _Manner) -> RunResult:
    began = time.perf_counter()
    simulated, log = _simulate(program, folder, manner)
    wall = time.perf_counter() - began
    history = log.history()
    if simulated.by_signal:
        simulated = simulated.as_logged(history, program.context.period)
    outcome, judged = simulated.outcome, judge_run(program, history, manner.world.task)
    made = summarise(program, simulated, history, judged, manner.world)
    made |= stopping(outcome, history, program.context.period)
    if manner.link is not None:
        made["link"] = link_summary(manner.link, history)
        made["seed"] = None if manner.link.measured else made["seed"]
    summary = folder.keep_summary(made, log)
    folder.end(
        outcome.status,
        outcome.reason,
        exit_code=summary["exit_code"],
        wall_seconds=wall,
        real_time_factor=outcome.clock / wall,
        loop=outcome.loop,
        why_python=outcome.why_python or None,
        **({} if manner.hand is None else {"live": manner.hand.lines}),
    )
    run = RunResult.written(folder, program, content, summary, history)
    if manner.report:  # It needs what a run does not.
        from taskspec_runner.report import write_report

        write_report(run)
    return run


def _simulate(program: Program, folder: RunFolder, manner: _Manner) -> tuple[Simulated, Log]:
    context, link = program.context, manner.link
    if link is not None and manner.world.task.truth.faults:
        message = "the faults of 'truth' happen to a plant that is simulated here, not over a link"
        raise InputError(f"{message}: --set 'truth.faults=[]' leaves them out")
    parts: Assembly[Driven] = (
        assemble(program, manner.world) if link is None else link.assemble(program, manner.world)
    )
    log = Log(folder.log, run=manifest.run_mark(folder.manifest))
    machine, recorder = parts.machine, parts.recorder(log)
    rows = _tapped(recorder, parts, folder.path, manner)
    # What MuJoCo warns of it also counts, which is a stop of its own.
    with contextlib.closing(recorder), listening([]), Interrupt() as interrupt:
        watch, by_signal = _watch(interrupt, manner.progress), 0
        try:
            outcome = simulate(
                machine,
                parts.plant,
                parts.bus,
                rows,
                context.period,
                watch,
                manner.world.noise_seed,
                manner.loop,
                parts.sensing,
                parts.faults,
                manner.hand,
                to_rest=True,
            )
        except KeyboardInterrupt as error:
            by_signal = signal_of(error)
            text, reason = str(error) or "interrupted by the user", reason_of(by_signal)
            outcome = Outcome(STOPPED, reason, text, machine.stage.name, 0.0, 0)
        finally:
            if link is not None:
                link.finish(_last_words(machine))
            if manner.spectator is not None:
                manner.spectator.finish()
    faults = () if parts.faults is None else parts.faults.times()
    counts = solver_counts(machine)
    return Simulated(outcome, machine.transitions, counts, by_signal, faults), log


def _tapped(recorder: Recorder, parts: Assembly[Driven], folder: Path, manner: _Manner) -> TickSink:
    """The recorder, with those between it and the loop who look on."""
    rows: Recorder | Tap = recorder
    period, telemetry, spectator = parts.program.context.period, manner.telemetry, manner.spectator
    if telemetry is not None:
        every = ticks_between(telemetry.address.rate, period)
        rows = Tap(rows, every, lambda: telemetry.send(recorder.latest()))
    if spectator is not None:
        spectator.begin(parts, recorder, folder)
        every = ticks_between(spectator.rate, period)
        rows = Tap(rows, every, spectator.look, lambda: spectator.looks)
    return rows


def _last_words(machine: Machine) -> str:
    """Why a run has ended, for who is at the other end."""
    if not machine.transitions:
        return "the run was broken off"
    last = machine.transitions[-1]
    where = f"stage {last.stage!r}"
    return f"{where} led to {last.to}: {last.text}" if last.to else f"in {where}: {last.text}"


def _watch(interrupt: Interrupt, progress: Progress | None) -> Callable[[Machine, float], None]:
    began = time.perf_counter()

    def watch(machine: Machine, clock: float) -> None:
        interrupt.check()
        if progress is not None:
            progress(lambda: _glimpse(machine, clock, time.perf_counter() - began))

    return watch


def _glimpse(machine: Machine, clock: float, wall: float) -> Glimpse:
    plans = machine.stage.plan.plans
    axis = next((a for a, plan in plans.items() if plan.set_point), "")
    force = reference = 0.0
    if axis:
        outputs = machine.named_outputs()
        number = AXES.index(axis)
        force, reference = (float(outputs[k][number]) for k in ("force", "force_ref"))
    return Glimpse(clock, machine.stage.name, axis, force, reference, clock / wall)
