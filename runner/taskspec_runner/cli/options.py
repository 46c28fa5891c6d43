"""Options of commands: those of several, and dataclasses of those that belong together.

A field's `help` says what it is, its default is that of the option: see `command.flattened`.
"""

from __future__ import annotations

from dataclasses import field
from pathlib import Path
from typing import Annotated

import typer

from taskspec.deferred_methods import dataclass
from taskspec_runner.cli import completions
from taskspec_runner.cli.formats import Equal, OutcomeFormat, RunFormat
from taskspec_runner.errors import InputError

TaskFile = Annotated[
    Path, typer.Argument(metavar="FILE", help="The task file; - is standard input.")
]
RunFolder = Annotated[Path, typer.Argument(metavar="RUN", help="The folder of a run.")]
Sets = Annotated[
    list[str],
    typer.Option("--set", metavar="KEY=VALUE", help="Override a value; may be repeated."),
]
NoCache = Annotated[
    bool,
    typer.Option(
        "--no-cache", help="Examine files again that have not changed since the last time."
    ),
]
Seed = Annotated[int, typer.Option(min=0, help="The seed of all random numbers.")]
StopAfter = Annotated[
    int, typer.Option(min=0, help="At the wall clock, stop when more samples in a row are lost.")
]
Force = Annotated[
    bool, typer.Option("--force", help="Run in spite of errors behind which the task compiles.")
]
Port = Annotated[
    int | None,
    typer.Option(min=0, max=65535, help="The port of the page.", show_default="any that is free"),
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print only what failed.")]
Outcome = Annotated[RunFormat, typer.Option("--format", help="The format of the outcome.")]
From = Annotated[
    float | None, typer.Option("--from", metavar="S", help="Begin at this run time in seconds.")
]
To = Annotated[
    float | None, typer.Option("--to", metavar="S", help="End at this run time in seconds.")
]


@dataclass(frozen=True)
class OverrideOptions:
    """What a task file is changed by, as `KEY=VALUE`."""

    sets: Sets = field(default_factory=list)


@dataclass(frozen=True)
class TaskOptions(OverrideOptions):
    """The same, and a law for every stage."""

    law: Annotated[
        str | None,
        typer.Option(
            help="Put every stage under this law, its gains designed.",
            autocompletion=completions.laws,
        ),
    ] = None


@dataclass(frozen=True)
class SeededOptions(TaskOptions):
    """The same with the seed of its runs."""

    seed: Seed = 0


@dataclass(frozen=True)
class WorldOptions(SeededOptions):
    """The same in one of its worlds."""

    world: Annotated[
        str | None,
        typer.Option(
            metavar="N|TABLE:ROW",
            help="Run in a random world of 'vary', by its number under the seed, or in a row of "
            "a sweep's table.",
            show_default="the true one",
        ),
    ] = None


@dataclass(frozen=True)
class ValidateOptions(WorldOptions):
    """How files are validated."""

    static: Annotated[
        bool, typer.Option("--static", help="Apply the rules alone, without a trial.")
    ] = False
    worlds: Annotated[
        int, typer.Option(min=0, metavar="N", help="Try N random worlds of `vary` as well.")
    ] = 0


@dataclass(frozen=True)
class RecordOptions:
    """What a run leaves, and what is reported of it."""

    out: Annotated[
        Path | None,
        typer.Option(
            help="The run's folder; an earlier run in it is replaced.", show_default="runs/NAME"
        ),
    ] = None
    telemetry: Annotated[
        str | None,
        typer.Option(
            metavar="udp://HOST:PORT",
            help="Send signals as JSON while it runs, 100 times a simulated second or ?rate=HZ.",
        ),
    ] = None
    quiet: Quiet = False
    form: Annotated[OutcomeFormat, typer.Option("--format", help="The format of the outcome.")] = (
        OutcomeFormat.TEXT
    )


@dataclass(frozen=True)
class LiveOptions:
    """What is set while a run goes on."""

    moves: Annotated[
        list[str],
        typer.Option(
            "--live",
            metavar="'NAME = VALUE @ TIME'",
            help="Set a live param at a run time, such as 'press = 8 N @ 1 s'; or the folder of a "
            "run, as there; or an address, such as udp://127.0.0.1:0, at which other programs set "
            "them. May be repeated.",
        ),
    ] = field(default_factory=list)


@dataclass(frozen=True)
class WatchOptions:
    """The page that shows what goes on."""

    watch: Annotated[
        bool,
        typer.Option(
            "--watch", help="Serve a page that shows it live, for this machine, until Ctrl-C."
        ),
    ] = False
    port: Port = None

    @property
    def place(self) -> int:
        """The port of the page, 0 for any that is free.

        Raises:
            InputError: a port is given, and no page is to be served.
        """
        if self.port is not None and not self.watch:
            raise InputError("--port is that of the page; give --watch, too")
        return self.port or 0


@dataclass(frozen=True)
class RobotOptions:
    """The robot that a run is to be on, where there is one."""

    on: Annotated[
        str | None,
        typer.Option(
            "--on",
            metavar="udp://HOST:PORT|lib:PATH|fmu:PATH",
            help="Run on a robot, or on the plant that 'taskspec plant' serves, judged as "
            "measured; or have an exported controller drive the simulated plant.",
        ),
    ] = None
    lost: Annotated[
        str,
        typer.Option(
            metavar="catch-up|hold",
            help="With --on, what a lost sample means: a tick on the one before, or the task's "
            "time stands.",
        ),
    ] = "catch-up"
    stop_after: StopAfter = 20


@dataclass(frozen=True)
class PlantOptions:
    """How a plant is served."""

    listen: Annotated[
        str,
        typer.Option(
            metavar="udp://HOST:PORT", help="The address to listen at; port 0 is any that is free."
        ),
    ] = "udp://127.0.0.1:39017"
    free_running: Annotated[
        bool,
        typer.Option(
            "--free-running", help="Run at the wall clock instead of waiting for each answer."
        ),
    ] = False
    stop_after: StopAfter = 20
    wait: Annotated[
        float, typer.Option(min=0, metavar="S", help="The longest wait for a controller.")
    ] = 600.0
    answer: Annotated[
        float,
        typer.Option(min=0.1, metavar="S", help="The longest wait for an answer, in lock-step."),
    ] = 2.0
    open: Annotated[
        bool, typer.Option("--open", help="Listen at an address that other machines reach.")
    ] = False


@dataclass(frozen=True)
class SweepOptions:
    """Which worlds a sweep runs, by whom, and what it leaves."""

    worlds: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="The number of random worlds of 'vary'.",
            show_default="the file's, else 100",
        ),
    ] = None
    corners: Annotated[
        bool, typer.Option("--corners", help="Run every combination of the ends of what varies.")
    ] = False
    grid: Annotated[
        int | None,
        typer.Option(
            min=2, metavar="N", help="Run a grid with N values of each entry that varies."
        ),
    ] = None
    sets: Sets = field(default_factory=list)
    seed: Seed = 0
    jobs: Annotated[
        int | None,
        typer.Option(
            "--jobs",
            "-j",
            min=1,
            help="The number of worlds at once.",
            show_default="the processors",
        ),
    ] = None
    executor: Annotated[
        str | None,
        typer.Option(
            metavar="dask[:tcp://HOST:PORT]",
            help="Run on a cluster of Dask: one of this machine, or that of a scheduler.",
            show_default="processes",
        ),
    ] = None
    shard: Annotated[
        str | None, typer.Option(metavar="I/N", help="Run one share of the worlds, I of N.")
    ] = None
    merge: Annotated[bool, typer.Option("--merge", help="Put folders of shares together.")] = False
    keep: Annotated[
        str,
        typer.Option(
            metavar="none|worst|failed|all|N,N", help="The worlds whose log and report are kept."
        ),
    ] = "worst"
    out: Annotated[
        Path | None,
        typer.Option(
            help="The sweep's folder; the same sweep in it is continued.",
            show_default="runs/NAME-sweep",
        ),
    ] = None
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print only the verdict.")] = False
    form: Outcome = RunFormat.TEXT
    force: Force = False


@dataclass(frozen=True)
class TuneOptions(OverrideOptions):
    """Which gains are moved, in which worlds, and how long they are looked for."""

    vary: Annotated[
        list[str],
        typer.Option(
            metavar="PATH=INTERVAL",
            help="Let a value vary, such as 'world.table.stiffness=8..90 N/mm'; may be repeated.",
        ),
    ] = field(default_factory=list)
    only: Annotated[
        list[str],
        typer.Option(
            metavar="GAIN,...",
            help="Move these gains alone, such as force.integral,bandwidth; may be repeated.",
            show_default="all gains of the laws",
        ),
    ] = field(default_factory=list)
    worlds: Annotated[
        int,
        typer.Option(min=0, help="The number of random worlds of the search, beside the corners."),
    ] = 8
    verify: Annotated[
        int, typer.Option(min=0, help="The number of fresh worlds that the result is verified in.")
    ] = 50
    budget: Annotated[
        int,
        typer.Option(
            min=1, help="The number of settings after which no round of the search begins."
        ),
    ] = 100
    patch: Annotated[
        Path | None,
        typer.Option(
            metavar="PATH",
            help="Write the task file with the gains found in it; comments and layout stay.",
        ),
    ] = None
    seed: Seed = 0
    jobs: Annotated[
        int | None,
        typer.Option(
            "--jobs",
            "-j",
            min=1,
            help="The number of settings at once.",
            show_default="the processors",
        ),
    ] = None
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print only the verdict.")] = False
    form: Outcome = RunFormat.TEXT

    @property
    def gains(self) -> tuple[str, ...]:
        """The gains that are named."""
        return tuple(name.strip() for text in self.only for name in text.split(",") if name.strip())

    @property
    def changes(self) -> list[str]:
        """All overrides, those that let a value vary among them."""
        return [*self.sets, *(f"vary.{text}" for text in self.vary)]


@dataclass(frozen=True)
class IdentifyOptions(OverrideOptions):
    """What is identified, and from what."""

    what: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PATH,...",
            help="Identify these values alone, such as world.table.stiffness,robot.payload; may "
            "be repeated.",
            show_default="all that the logs show",
        ),
    ] = None
    level: Annotated[
        float,
        typer.Option(min=50.0, max=99.9, metavar="PERCENT", help="The level of the intervals."),
    ] = 90.0
    columns: Annotated[
        Path | None,
        typer.Option(
            metavar="MAP",
            help="The map of a recorded log's columns to signals and units: a file (YAML), or the "
            "name of a ready map.",
        ),
    ] = None
    held_out: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="LOG",
            help="A log that nothing is identified from, of which it is predicted what it reads; "
            "may be repeated.",
        ),
    ] = None
    form: Annotated[RunFormat, typer.Option("--format", help="The format of the result.")] = (
        RunFormat.TEXT
    )

    patch: Annotated[
        Path | None,
        typer.Option(
            metavar="OUT.YAML",
            help="Write the task file with the identified values, and their intervals in 'vary'.",
        ),
    ] = None
    write: Annotated[bool, typer.Option("--write", help="The same, into the task file itself.")] = (
        False
    )
    page: Annotated[
        Path | None,
        typer.Option(
            metavar="OUT.HTML",
            help="Write a page: values, intervals, and each log beside what is predicted of it.",
        ),
    ] = None
    design: Annotated[
        Path | None,
        typer.Option(
            metavar="PATH",
            help="Write a task to this file that would tell what the logs do not: presses, slides "
            "and turns within the file's limits.",
        ),
    ] = None
    width: Annotated[
        float,
        typer.Option(
            min=0.01,
            max=100.0,
            metavar="PERCENT",
            help="With --design: half of an interval at most, of the value.",
        ),
    ] = 5.0

    @property
    def paths(self) -> list[str] | None:
        """The paths that are wanted; None for all."""
        if self.what is None:
            return None
        return [path.strip() for text in self.what for path in text.split(",") if path.strip()]


@dataclass(frozen=True)
class CompareOptions:
    """Which laws are compared, and what that leaves."""

    law: Annotated[
        list[str] | None,
        typer.Option(
            help="A law to compare, its gains designed; may be repeated.",
            show_default="every law",
            autocompletion=completions.laws,
        ),
    ] = None
    equal: Annotated[
        Equal | None,
        typer.Option(
            help="What all laws have in common: motion axes of equal closed-loop bandwidth.",
            show_default="designed gains",
        ),
    ] = None
    sets: Sets = field(default_factory=list)
    seed: Seed = 0
    out: Annotated[
        Path | None,
        typer.Option(
            help="The comparison's folder; an earlier one in it is replaced.",
            show_default="runs/NAME-compare",
        ),
    ] = None
    quiet: Quiet = False
    form: Outcome = RunFormat.TEXT


@dataclass(frozen=True)
class ChoiceOptions:
    """Which files are tested, and in which order."""

    words: Annotated[
        str | None,
        typer.Option(
            "-k",
            metavar="WORDS",
            help="Test the files whose paths have these: 'press and not (qp or pd)'.",
        ),
    ] = None
    jobs: Annotated[
        int,
        typer.Option(
            "--jobs",
            "-j",
            min=0,
            help="The number of processes.",
            show_default="one for each processor",
        ),
    ] = 0
    last_failed: Annotated[
        bool,
        typer.Option(
            "--last-failed", "--lf", help="Test only the files that failed the last time."
        ),
    ] = False
    failed_first: Annotated[
        bool,
        typer.Option(
            "--failed-first", "--ff", help="Test the files that failed the last time first."
        ),
    ] = False
    exit_first: Annotated[
        bool, typer.Option("--exitfirst", "-x", help="End at the first one that fails.")
    ] = False


@dataclass(frozen=True)
class ReportOptions:
    """How outcomes of tests are reported, and what is kept of them."""

    durations: Annotated[
        int, typer.Option(min=0, metavar="N", help="Name the N slowest files.")
    ] = 0
    junit: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the outcomes as JUnit XML too.")
    ] = None
    form: Annotated[OutcomeFormat, typer.Option("--format", help="The format of the outcomes.")] = (
        OutcomeFormat.TEXT
    )
    out: Annotated[Path, typer.Option(help="The folder of the runs that failed.")] = Path(
        "runs/tests"
    )
    keep: Annotated[
        bool, typer.Option("--keep", help="Keep the runs that passed, too, with their reports.")
    ] = False
    quiet: Quiet = False


@dataclass(frozen=True)
class CutOptions:
    """What of a run a video or a window shows, and how."""

    speed: Annotated[
        float, typer.Option(help="The speed: 1 is real time, 2 twice as fast, 0.25 a quarter.")
    ] = 1.0
    start: From = None
    end: To = None
    size: Annotated[str, typer.Option(metavar="WxH", help="The size of the video, in pixels.")] = (
        "1280x720"
    )
    fps: Annotated[float, typer.Option(help="The number of frames in a second of the video.")] = (
        25.0
    )
    camera: Annotated[
        str | None,
        typer.Option(
            metavar="AZIMUTH,ELEVATION,DISTANCE",
            help="Look at the arm from here, in degrees and metres, such as 120,-20,1.2.",
            show_default="found for each run",
        ),
    ] = None


@dataclass(frozen=True)
class DatasetOptions:
    """What a dataset of runs holds."""

    lerobot: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Write runs as a LeRobot dataset, an episode each, those of a sweep among them: a "
            "folder that is new or empty.",
        ),
    ] = None
    fps: Annotated[
        int | None,
        typer.Option(min=1, help="The frames of a second of it.", show_default="30"),
    ] = None
    camera: Annotated[
        str | None,
        typer.Option(
            metavar="auto|AZIMUTH,ELEVATION,DISTANCE",
            help="Film the runs for it: from where all of the first run is visible, or from here, "
            "in degrees and metres.",
        ),
    ] = None
    size: Annotated[
        str | None,
        typer.Option(
            metavar="WxH", help="The size of its pictures, in pixels.", show_default="320x240"
        ),
    ] = None


@dataclass(frozen=True)
class ReplayOptions:
    """Where a recorded run is shown, if not as a video."""

    view: Annotated[bool, typer.Option("--view", help="Open a window; this is the default.")] = (
        False
    )
    web: Annotated[
        bool,
        typer.Option(
            "--web",
            help="Serve its report to a browser of this machine, with the arm in motion, until "
            "Ctrl-C.",
        ),
    ] = False
    port: Port = None
