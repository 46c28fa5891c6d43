"""The picture of the arm in a page: live where the browser can draw it, else as it stands still."""

from __future__ import annotations

import json

from markupsafe import Markup

from taskspec.deferred_methods import dataclass
from taskspec_runner.pages.document import button
from taskspec_runner.pages.html import element, joined
from taskspec_runner.runs import Run
from taskspec_runner.scene.bundle import packed, packed_bundle
from taskspec_runner.scene.model import Json
from taskspec_runner.scene.recorded import recorded_scene
from taskspec_runner.video.canvas import backends
from taskspec_runner.video.recording import Recording, steadiest_contact
from taskspec_runner.video.still import still_of
from taskspec_runner.video.world import RecordedWorld

#: How many times as fast as the run a page can play it.
SPEEDS = (0.1, 0.25, 0.5, 1, 2, 4)


@dataclass(frozen=True, slots=True)
class Pictured:
    """What a page shows of the arm.

    Attributes:
        clock: run time of the picture, and of the scene at first [s].
        still: the picture as a `data:` address; empty where none can be drawn.
        scene: as `recorded_scene` has it.
    """

    clock: float
    still: str
    scene: Json


def pictured(run: Run) -> Pictured | None:
    """The arm of a run; None where there is nothing to show."""
    try:
        recording = Recording.of(run)
        world = RecordedWorld(recording)
        clock = float(recording.clock[steadiest_contact(recording)])
        return Pictured(clock, still_of(world, clock) if backends() else "", recorded_scene(world))
    # Whatever keeps it from being drawn: a report without a picture is still a report.
    except Exception:
        return None


def arm_figure(shown: Pictured, *, live: bool) -> Markup:
    """The figure of the arm, with the data of its scene if the page has a script for it."""
    title = element("h3", "The arm", element("small", f" at {shown.clock:.2f} s", class_="clock"))
    look = {"force": "force", "motion": "motion", "free": "free"}
    axes = Markup(", ").join(element("b", text, class_=name) for name, text in look.items())
    text = joined(
        element("b", "Arrow", class_="applied"), ": applied force. Axes: ", axes, ". Lines: ",
        element("b", "reference", class_="wanted"), ", ", element("b", "tool path"), ".",
    )  # fmt: skip
    picture = Markup("")
    if shown.still:
        about = f"The arm at {shown.clock:.2f} s, and its tool from near by"
        picture = element("img", src=shown.still, width=1120, height=490, alt=about)
    caption = element("figcaption", title, element("p", text, class_="note"))
    if not live:
        return element("figure", caption, picture, class_="still")
    content = {**shown.scene, "clock": shown.clock}
    return joined(
        element(
            "figure", caption, element("div", picture, class_="view"), _player(), class_="still arm"
        ),
        packed("scene-data", json.dumps(content, allow_nan=False)),
        packed_bundle(),
    )


def _player() -> Markup:
    """The buttons below a scene; they appear with it."""
    speeds = (element("option", f"{s:g} ×", value=s, selected=s == 1) for s in SPEEDS)
    return element(
        "div",
        button("Play", "play", aria_pressed="false", aria_keyshortcuts="Space"),
        element("input", type="range", class_="seek", aria_label="time", step="any"),
        element("select", *speeds, class_="speed", aria_label="speed"),
        button("Follow tool", "follow", aria_pressed="false", aria_keyshortcuts="F"),
        button("Reset view", "reset", aria_keyshortcuts="0"),
        class_="player", hidden=True,
    )  # fmt: skip
