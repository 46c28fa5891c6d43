"""`taskspec run`: a task in simulation, from its file to an exit code."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import typer

from taskspec.deferred_methods import dataclass
from taskspec.text.diagnostic import SpecError
from taskspec_runner.cli.diagnostics import record, show_diagnostics
from taskspec_runner.cli.formats import OutcomeFormat
from taskspec_runner.cli.loading import load
from taskspec_runner.cli.options import (
    RecordOptions,
    RobotOptions,
    TaskOptions,
    WatchOptions,
    WorldOptions,
)
from taskspec_runner.errors import InputError
from taskspec_runner.exit_codes import WRONG
from taskspec_runner.loop.interrupt import BY_SIGNAL
from taskspec_runner.record.folder import check_folder, check_unlocked

if TYPE_CHECKING:
    from taskspec.examined import Examination
    from taskspec.program.program import Program
    from taskspec.program.worlds import World
    from taskspec_runner.cli.testing.outcome import FileOutcome
    from taskspec_runner.link.link import Link
    from taskspec_runner.link.on_robot import LostPolicy
    from taskspec_runner.live.watched_run import WatchedRun
    from taskspec_runner.runs import Run


def run_task(
    file: Path,
    given: WorldOptions,
    kept: RecordOptions,
    *,
    video: Path | None = None,
    force: bool = False,
    loop: str | None = None,
    on: Connects | None = None,
    live: Sequence[str] = (),
    watched: WatchOptions | None = None,
) -> int:
    """Runs a task file and reports how it went; afterwards draws it as a video.

    With a page that shows it, the command ends when nobody watches that any more.
    """
    from taskspec_runner.cli.outcome import show_outcome
    from taskspec_runner.cli.progress import progress_line
    from taskspec_runner.cli.testing.outcome import outcome_of, refused_by
    from taskspec_runner.loop.live_requests import setting
    from taskspec_runner.loop.telemetry import sending
    from taskspec_runner.session import execute_program
    from taskspec_runner.sweep.chosen import chosen_world

    form, quiet = kept.form, kept.quiet
    as_text, began = form is OutcomeFormat.TEXT, time.perf_counter()
    watched = watched or WatchOptions()
    # Before anything is read or compiled.
    _ = watched.place
    if on is not None:
        on.check(
            {
                "--seed": given.seed,
                "--world": given.world,
                "--loop native": loop == "native",
                "--video": video,
                "--watch": watched.watch,
            }
        )
    _check(kept.telemetry, kept.out, video)
    try:
        program = admitted(file, given, force=force)
    except SpecError as error:
        if as_text:
            raise
        if form is OutcomeFormat.JSON:
            _print({"exit_code": WRONG, "diagnostics": [record(d) for d in error.diagnostics]})
        else:
            _report(form, refused_by(file, error))
        return WRONG
    if program.findings and not quiet:
        show_diagnostics(program.findings, program.context.loaded.sources, err=True)
    chosen = chosen_world(program.context, given.seed, given.world)
    link = None if on is None else on.link(program, None if quiet else _say)
    watching = _page(program, chosen, watched) if watched.watch else nullcontext()
    with watching as page:
        with (
            setting(live, program.context.loaded.task, program.context.period, _say) as hand,
            sending(kept.telemetry, _say) as sink,
            progress_line(shown=not quiet and sys.stderr.isatty()) as progress,
        ):
            run = execute_program(
                program,
                kept.out,
                world=chosen,
                progress=progress,
                telemetry=sink,
                spectator=page,
                loop=loop,
                link=link,
                hand=hand,
            )
        if page is not None:
            page.end(run)
        # Who breaks off a run waits neither for its video nor for a page.
        broken_off = run.exit_code >= BY_SIGNAL
        if video is not None and not broken_off:
            from taskspec_runner.cli.replay import film

            film(run, video, quiet=quiet)
        if as_text:
            show_outcome(run, quiet=quiet)
            if video is not None and not quiet and video.is_file():
                typer.echo(f"video: {video}")
        elif form is OutcomeFormat.JSON:
            _print(_as_data(run, program, video))
        else:
            _report(form, outcome_of(run, file, time.perf_counter() - began, str(run.report)))
        if page is not None and not broken_off:
            page.server.wait()
    return run.exit_code


def _page(program: Program, world: World | None, watched: WatchOptions) -> WatchedRun:
    from taskspec.program.worlds import true_world
    from taskspec_runner.live.server import announce
    from taskspec_runner.live.watched_run import WatchedRun

    page = WatchedRun(program, world or true_world(program.context), watched.place)
    if announce(page.server.url):
        page.expect()
    return page


def _check(telemetry: str | None, out: Path | None, video: Path | None) -> None:
    """Checks that what is to be written or sent can be."""
    if telemetry is not None:
        from taskspec_runner.loop.telemetry import read_address

        read_address(telemetry)
    if out is not None:
        check_unlocked(out)
        check_folder(out)
    if video is not None:
        from taskspec_runner.video.film import check_video

        check_video(video)


class Connects(Protocol):
    """Factory of the link of a run, as a command line has it."""

    def check(self, simulated: Mapping[str, object]) -> None:
        """Finds out what can be known before anything is read.

        Args:
            simulated: options of a simulated plant, and what each is given as.

        Raises:
            InputError: something of it cannot be used.
        """

    def link(self, program: Program, say: Callable[[str], None] | None) -> Link:
        """Waits for the other end; `say` reports that it is waited for.

        Raises:
            InputError: it is not there, or not what the program is for.
        """


#: What the addresses of exported controllers begin with.
LIBRARY, FMU = "lib:", "fmu:"


@dataclass(frozen=True, slots=True)
class Connection:
    """The robot that a run is to be on.

    Attributes:
        url: where it is.
        robot: the options, which say what becomes of lost samples.
    """

    url: str
    robot: RobotOptions

    def check(self, simulated: Mapping[str, object]) -> None:
        """Finds out what can be known before anything is read.

        Args:
            simulated: options of a simulated plant, and what each is given as.

        Raises:
            InputError: the address or the policy is none, or an option is of a simulated plant.
        """
        from taskspec_runner.link.address import read_endpoint

        if self.url.startswith((LIBRARY, FMU)):
            return
        if "://" not in self.url or self.url.startswith("udp:"):
            read_endpoint(self.url, "--on")
        self._policy()
        for option, given in simulated.items():
            if given:
                raise InputError(f"{option} is of a simulated plant; leave it out with --on")

    def _policy(self) -> LostPolicy:
        from taskspec_runner.link.on_robot import LostPolicy

        return LostPolicy(self.robot.lost, self.robot.stop_after)

    def link(self, program: Program, say: Callable[[str], None] | None) -> Link:
        """Connects, and finds out whether it is the program's robot.

        Raises:
            InputError: it is not there, or another one.
        """
        from taskspec_runner.link.found import open_robot
        from taskspec_runner.link.on_robot import OnRobot

        if self.url.startswith(LIBRARY):
            from taskspec_runner.link.library import InLibrary

            return InLibrary(Path(self.url.removeprefix(LIBRARY)), program)
        if self.url.startswith(FMU):
            from taskspec_runner.link.fmu import InFmu

            return InFmu(Path(self.url.removeprefix(FMU)), program)
        robot = open_robot(self.url, say)
        link = OnRobot(robot, self._policy(), self.url)
        try:
            link.check(program)
        except InputError as error:
            robot.stop(str(error))
            raise
        return link


def _as_data(run: Run, program: Program, video: Path | None) -> dict[str, Any]:
    where = {
        "folder": str(run.folder),
        "report": str(run.report),
        "wall_seconds": run.manifest["wall_seconds"],
        "real_time_factor": run.manifest["real_time_factor"],
        "diagnostics": [record(d) for d in program.findings],
    }
    return {**run.summary, **where, **({} if video is None else {"video": str(video)})}


def _report(form: OutcomeFormat, outcome: FileOutcome) -> None:
    from taskspec_runner.cli.testing import github, junit

    reporter = junit if form is OutcomeFormat.JUNIT else github
    if text := reporter.report([outcome]):
        typer.echo(text)


def admitted(file: Path, given: TaskOptions, *, force: bool) -> Program:
    """The program of a task file.

    Args:
        file: the task file.
        given: what it is changed by.
        force: whether findings are lifted behind which a program still compiles.

    Raises:
        SpecError: the task is refused; where `force` would lift that, this is said.
    """
    from taskspec.compiler import admit

    examined = _examined(file, given)
    try:
        return admit(examined, force=force)
    except SpecError:
        if not force and _compiles(examined):
            _say("not run; --force runs it all the same")
        raise


def _examined(file: Path, given: TaskOptions) -> Examination:
    """The file with what its rules find; how its run ends the run itself will show."""
    from taskspec.examination import examine
    from taskspec.program.program import refusals
    from taskspec.rules import predicted
    from taskspec.text.diagnostic import Severity

    examined = examine(load(file, given.sets, given.law))
    if refusals(examined.findings):
        return examined
    findings = [
        found
        for found in examined.findings
        if found.severity is Severity.ERROR or not predicted(found.code)
    ]
    return replace(examined, findings=tuple(findings))


def _compiles(examined: Examination) -> bool:
    from taskspec.compiler import admit

    try:
        admit(examined, force=True)
    except SpecError:
        return False
    return True


def _say(text: str) -> None:
    typer.echo(f"taskspec: {text}", err=True)


def _print(data: dict[str, Any]) -> None:
    typer.echo(json.dumps(data, indent=2, ensure_ascii=False))
