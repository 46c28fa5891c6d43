"""Options of `taskspec replay`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

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
