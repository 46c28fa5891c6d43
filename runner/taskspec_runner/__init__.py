"""Execution of compiled tasks on a MuJoCo plant: `run` a task, or `read` a run that was made."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence
    from pathlib import Path

    from taskspec.spec import LoadedTask
    from taskspec_runner.link.robot import CommandedRobot
    from taskspec_runner.result import RunResult
    from taskspec_runner.runs import Run

__all__ = ["Run", "RunResult", "read", "run"]


def run(
    task: LoadedTask,
    out: str | os.PathLike[str] | None = None,
    *,
    seed: int = 0,
    world: int | None = None,
    report: bool = True,
    telemetry: str | None = None,
    force: bool = False,
    loop: Literal["native", "python"] | None = None,
    robot: str | CommandedRobot | None = None,
    lost: Literal["catch-up", "hold"] = "catch-up",
    stop_after: int = 20,
    live: Sequence[str] = (),
) -> RunResult:
    """Runs a task in simulation, as `taskspec run` does.

    Args:
        task: from `taskspec.load`.
        out: the run's folder; an earlier run in it is replaced. None for `runs/NAME`, with -2, -3,
            ... where that exists.
        seed: of everything random in the run.
        world: number of a random world of `vary`, from 0; None for the world as the file has it.
        report: whether to render `report.html`.
        telemetry: where to send signals while it runs, such as `udp://127.0.0.1:9870`.
        force: whether to run it in spite of errors behind which it still compiles.
        loop: what runs its ticks; the numbers are the same. None for machine code where there can
            be some: the interpreter in a short run, code of the task's own in a long one.
        robot: to run it on instead of in simulation: an address such as `udp://127.0.0.1:39017`, or
            a `taskspec_runner.link.robot.CommandedRobot`. What is judged then is what was measured;
            `seed` and `world` are not used.
        lost: what becomes of a sample of the robot that is lost; see docs/protocol.md.
        stop_after: how many in a row may be lost.
        live: when live params are set to what, such as `press = 8 N @ 1 s`, as `--live` has it;
            or an address with a token at which `LiveClient` sets them.

    Raises:
        SpecError: the task is refused, as `taskspec validate` finds it; it carries everything that
            was found.
        InputError: `telemetry` is no address, or there is no native loop though it is wanted; or
            the robot is not there, or not the task's.
        OutputError: the folder cannot be written.
        RunCrashedError: an internal error.
        KeyboardInterrupt: interrupted outside the simulation itself. Within it, the run ends as
            one that was stopped, and its result tells what there is.
    """
    from pathlib import Path

    from taskspec_runner.loop.telemetry import sending
    from taskspec_runner.session import execute

    folder = None if out is None else Path(out)
    if robot is not None:
        return _run_on(robot, task, folder, (lost, stop_after), telemetry, report, force, live)
    with sending(telemetry) as sink:
        return execute(
            task,
            folder,
            seed=seed,
            world=world,
            report=report,
            telemetry=sink,
            force=force,
            loop=loop,
            live=live,
        )


def _run_on(
    robot: str | CommandedRobot,
    task: LoadedTask,
    folder: Path | None,
    policy: tuple[str, int],
    telemetry: str | None,
    report: bool,
    force: bool,
    live: Sequence[str],
) -> RunResult:
    from taskspec.compiler import compile_task
    from taskspec_runner.link.found import open_robot
    from taskspec_runner.link.on_robot import LostPolicy, OnRobot
    from taskspec_runner.loop.live_requests import setting
    from taskspec_runner.loop.telemetry import sending
    from taskspec_runner.session import execute_program

    rule, program = LostPolicy(*policy), compile_task(task, force=force)
    found = open_robot(robot) if isinstance(robot, str) else robot
    link = OnRobot(found, rule, robot if isinstance(robot, str) else type(robot).__name__)
    try:
        link.check(program)
        with (
            setting(live, task.task, program.context.period) as hand,
            sending(telemetry) as sink,
        ):
            return execute_program(
                program, folder, report=report, telemetry=sink, link=link, hand=hand
            )
    finally:
        link.finish("the run was broken off")


def read(folder: str | os.PathLike[str]) -> RunResult:
    """Reads a run that was made; of one that was killed, what there is.

    Args:
        folder: of the run.

    Raises:
        InputError: it is not the folder of a run.
    """
    from pathlib import Path

    from taskspec_runner.result import RunResult

    return RunResult.load(Path(folder))


def __getattr__(name: str) -> object:
    # Without arrays and simulator until it is asked for.
    if name == "Run":
        from taskspec_runner.runs import Run

        return Run
    if name == "RunResult":
        from taskspec_runner.result import RunResult

        return RunResult
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
