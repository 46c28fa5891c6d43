"""Options of commands, where several have them or one has many."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from taskspec_runner.cli import completions

TaskFile = Annotated[
    Path, typer.Argument(metavar="FILE", help="The task file; - is standard input.")
]
Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Override a value; may be repeated."),
]
Law = Annotated[
    str | None,
    typer.Option(
        help="Put every stage under this law, its gains designed.", autocompletion=completions.laws
    ),
]
NoCache = Annotated[
    bool,
    typer.Option("--no-cache", help="Examine anew, also what has not changed since the last time."),
]
Seed = Annotated[int, typer.Option(min=0, help="Of everything random.")]

# run
World = Annotated[
    str | None,
    typer.Option(
        metavar="N|TABLE:ROW",
        help="A random world of 'vary' by its number under the seed, or a row of a sweep's table.",
        show_default="the true one",
    ),
]
Telemetry = Annotated[
    str | None,
    typer.Option(
        metavar="udp://HOST:PORT",
        help="Send signals as JSON while it runs, 100 times a simulated second or ?rate=HZ.",
    ),
]
RunVideo = Annotated[
    Path | None,
    typer.Option(metavar="OUT.MP4", help="Draw the run as a video when it has ended."),
]
Force = Annotated[
    bool, typer.Option("--force", help="Run in spite of errors behind which the task compiles.")
]

On = Annotated[
    str | None,
    typer.Option(
        "--on",
        metavar="udp://HOST:PORT",
        help="Run on a robot, or on the plant that 'taskspec plant' serves; judged as measured.",
    ),
]
Lost = Annotated[
    str,
    typer.Option(
        metavar="catch-up|hold",
        help="With --on, of a lost sample: a tick on the one before, or the task's time stands.",
    ),
]
StopAfter = Annotated[
    int, typer.Option(min=0, help="At the wall clock, stop when more in a row are lost.")
]

# replay
Video = Annotated[
    Path | None, typer.Option(metavar="OUT.MP4", help="Write a video; no screen is needed.")
]
View = Annotated[bool, typer.Option("--view", help="Open a window, also the default.")]
Speed = Annotated[float, typer.Option(help="1 is real time, 2 twice as fast, 0.25 a quarter.")]
From = Annotated[
    float | None, typer.Option("--from", metavar="S", help="Begin at this run time in seconds.")
]
To = Annotated[
    float | None, typer.Option("--to", metavar="S", help="End at this run time in seconds.")
]
Size = Annotated[str, typer.Option(metavar="WxH", help="Of the video, in pixels.")]
Fps = Annotated[float, typer.Option(help="Frames in a second of the video.")]
Camera = Annotated[
    str | None,
    typer.Option(
        metavar="AZIMUTH,ELEVATION,DISTANCE",
        help="Look at the arm from here, in degrees and metres, such as 120,-20,1.2.",
        show_default="found for each run",
    ),
]
