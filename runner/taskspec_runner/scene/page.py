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
from taskspec_runner.scene.recorded import recorded_scene, track
from taskspec_runner.video.canvas import NoCanvasError, backends
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
        return Pictured(clock, _still(world, clock), recorded_scene(world))
    # Whatever keeps it from being drawn: a report without a picture is still a report.
    except Exception:
        return None


def _still(world: RecordedWorld, clock: float) -> str:
    """The picture; empty where there is nothing to draw with."""
    if not backends():
        return ""
    try:
        return still_of(world, clock)
    except NoCanvasError:
        return ""


def beside(run: Run, name: str, role: str, begin: float) -> Json | None:
    """A second run in the same scene, as `arm_figure` takes it; None where it cannot be drawn.

    Args:
        run: of the same arm in the same world.
        name: of it on the page.
        role: what its colour means.
        begin: time of the page at which its clock is zero [s].
    """
    try:
        rows = track(RecordedWorld(Recording.of(run)))
    # As of a picture.
    except Exception:
        return None
    return {"name": name, "role": role, "begin": begin, "track": rows}


def arm_figure(
    shown: Pictured,
    *,
    title: str = "The arm",
    live: bool = True,
    begin: float = 0.0,
    other: Json | None = None,
) -> Markup:
    """The figure of an arm.

    Args:
        shown: of a run.
        title: of the figure.
        live: whether the page has the script of the scene.
        begin: time of the page at which the run's clock is zero [s].
        other: a second run, translucent in its colour, as `beside` has it.
    """
    heading = element("h3", title, element("small", f" at {shown.clock:.2f} s", class_="clock"))
    look = {"force": "force", "motion": "motion", "free": "free"}
    axes = Markup(", ").join(element("b", text, class_=name) for name, text in look.items())
    second = None
    if other:
        name = element("b", other["name"], style=f"color: var(--{other['role']})")
        second = joined("Translucent: ", name, ". ")
    text = joined(
        second,
        element("b", "Arrow", class_="applied"), ": applied force. Axes: ", axes, ". Lines: ",
        element("b", "reference", class_="wanted"), ", ", element("b", "tool path"), ".",
    )  # fmt: skip
    picture = Markup("")
    if shown.still:
        about = f"{title} at {shown.clock:.2f} s, and its tool from near by"
        picture = element("img", src=shown.still, width=1120, height=490, alt=about)
    caption = element("figcaption", heading, element("p", text, class_="note"))
    if not live:
        return element("figure", caption, picture, class_="still")
    content = {**shown.scene, "clock": shown.clock, "begin": begin, "other": other}
    return joined(
        element("figure", caption, element("div", picture, class_="view"), _player(),
                class_="still arm", hidden=not shown.still),
        packed("scene-data", json.dumps(content, allow_nan=False)),
        packed_bundle(),
    )  # fmt: skip


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
