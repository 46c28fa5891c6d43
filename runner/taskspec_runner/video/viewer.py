"""MuJoCo's own viewer, in which a recorded run goes by in real time."""

from __future__ import annotations

import contextlib
import platform
import time
from collections.abc import Iterator
from typing import Any

import mujoco

from taskspec_runner.errors import InputError
from taskspec_runner.headless import has_screen
from taskspec_runner.video.camera import frame_run, seen_from
from taskspec_runner.video.film import Clip
from taskspec_runner.video.marks import Marks
from taskspec_runner.video.panel_force import panel_forces
from taskspec_runner.video.recording import Recording
from taskspec_runner.video.world import RecordedWorld

#: Of a window, about.
_ASPECT = 16 / 9
_PAUSE = 1 / 60
#: Opacity of what stands still in the world.
_SOLID = 0.45


def check_display() -> None:
    """Finds out whether a window can be opened.

    Raises:
        InputError: there is no screen; the message says what to do.
    """
    if not has_screen():
        raise InputError(
            "cannot open a window: there is no screen (neither DISPLAY nor WAYLAND_DISPLAY is "
            "set); taskspec replay RUN --web serves a page, --video out.mp4 writes a film"
        )


def view(recording: Recording, cut: Clip) -> None:
    """Shows a run in a window until that is closed; at the end it begins anew.

    Raises:
        InputError: there is no screen, or no window can be opened.
    """
    check_display()
    show = Show(recording, cut)
    with _window(show.world) as window:
        camera = show.camera()
        window.cam.azimuth, window.cam.elevation = camera.azimuth, camera.elevation
        window.cam.distance, window.cam.lookat[:] = camera.distance, camera.lookat
        began = time.monotonic()
        while window.is_running():
            row = show.row(time.monotonic() - began)
            with window.lock():
                show.put(window.user_scn, row)
            window.set_texts((None, None, *show.texts(row)))
            window.sync()
            time.sleep(_PAUSE)


@contextlib.contextmanager
def _window(world: RecordedWorld) -> Iterator[Any]:
    """MuJoCo's window on a world."""
    try:
        from mujoco import viewer

        window = viewer.launch_passive(
            world.model, world.data, show_left_ui=False, show_right_ui=False
        )
    # A Mac needs MuJoCo's own launcher; other machines miss a library or a driver.
    except (ImportError, RuntimeError) as error:
        how = ""
        if platform.system() == "Darwin":
            how = "; on macOS windows need mjpython: mjpython -m taskspec_runner replay RUN --view"
        raise InputError(f"cannot open a window: {error}{how}") from error
    with window:
        yield window


class Show:
    """The state of a window at a time.

    Attributes:
        world: of the run.
    """

    def __init__(self, recording: Recording, cut: Clip) -> None:
        self.world, self._recording, self._cut = RecordedWorld(recording), recording, cut
        self._marks, self._shown = Marks(self.world), panel_forces(recording)
        self._clocks = cut.clocks(recording)
        # A window cannot let hidden marks shine through, as pictures do.
        model = self.world.model
        solids = (model.geom_bodyid == 0) & (model.geom_matid < 0)
        model.geom_rgba[solids, 3] *= _SOLID

    def camera(self) -> mujoco.MjvCamera:
        """The camera at first."""
        found = frame_run(self.world).view(self.world.model, _ASPECT)
        if self._cut.camera is not None:
            found = seen_from(found, *self._cut.camera)
        return found.camera()

    def row(self, elapsed: float) -> int:
        """The row to show some time [s] after the window was opened."""
        length = len(self._clocks) / self._cut.fps
        return self._recording.row(self._clocks[0] + self._cut.speed * (elapsed % length))

    def put(self, scene: mujoco.MjvScene, row: int) -> None:
        """Puts the world at a row, and all marks into the window's own scene."""
        self.world.show(row)
        scene.ngeom = 0
        self._marks.draw_bodies(scene)
        self._marks.draw(scene, row)

    def texts(self, row: int) -> tuple[str, str]:
        """Two columns of text: names and values."""
        recording = self._recording
        visit = recording.visit(row)
        shown = self._shown[recording.visits.index(visit)]
        value = shown.text(row)
        return f"time\nstage\n{shown.name}", f"{recording.clock[row]:.2f} s\n{visit.stage}\n{value}"
