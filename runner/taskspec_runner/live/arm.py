"""The arm of a run that goes on, as its page shows it."""

from __future__ import annotations

import json
from collections.abc import Mapping

import mujoco
import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from taskspec.geometry.axis import TRANSLATIONS
from taskspec.program.program import Program
from taskspec.spec import Task
from taskspec_runner.pages.document import button
from taskspec_runner.pages.html import element, joined
from taskspec_runner.record.bus import TRUE
from taskspec_runner.scene.bundle import packed, packed_bundle
from taskspec_runner.scene.model import model_scene, positions
from taskspec_runner.video.camera import frame_arm
from taskspec_runner.video.marks import kind_of
from taskspec_runner.video.world import DrawnWorld, coordinate_signals

Vector = NDArray[np.float64]

#: Shapes that are endless are drawn so far around the tool's place at the start [m].
_AROUND = 0.15 * np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])


class LiveArm:
    """The scene of a run, and its state by the numbers of a tick."""

    def __init__(self, program: Program, true: Task, slices: Mapping[str, slice]) -> None:
        """The scene of a run that has not begun.

        Args:
            program: that runs.
            true: the task with the true world.
            slices: where the bus has each of its fields.
        """
        self._program, self._slices = program, slices
        context = program.context
        self._joints = [f"joint.{i + 1}.position" for i in range(context.robot.n)]
        self._coordinates = coordinate_signals(true)
        self._world = DrawnWorld(context, true)
        self._world.settle(context.start_p + _AROUND)

    def values(self, row: Vector, columns: Mapping[str, float]) -> Vector:
        """State of the scene at a tick.

        Args:
            row: of the bus.
            columns: of the log, at the same tick.

        Returns:
            A row of positions, the control point (3,) [m], the quaternion of the stage's frame
            (4,) and the applied force (3,) [N], all in the world.
        """
        data = self._world.put(
            columns["clock"],
            np.array([columns[name] for name in self._joints]),
            [columns[name] for name in self._coordinates],
            self._field(row, "loose"),
        )
        turned = np.zeros(4)
        # Columns of the frame stand one after the other.
        mujoco.mju_mat2Quat(turned, self._field(row, "frame").reshape(3, 3).T.ravel())
        point = self._field(row, "tip") + self._field(row, "offset")
        return np.concatenate([positions(data), point, turned, -self._field(row, "wrench")[:3]])

    def _field(self, row: Vector, name: str) -> Vector:
        """A field of the bus as it truly is."""
        return row[self._slices.get(f"{TRUE}{name}", self._slices[name])]

    def figure(self) -> Markup:
        """The figure of the scene, with its data and the script that draws it."""
        context, model = self._program.context, self._world.model
        tip = model.body(context.robot.tip_body).id
        data = self._world.put(
            0.0, context.start, [0.0] * len(self._coordinates), np.zeros(7 * model.nbody)
        )
        scene = model_scene(model, frame_arm(model, data, tip), tip, links=self._world.links)
        kinds = [
            {name: kind_of(stage, name) for name in TRANSLATIONS if name in stage.plan.axes}
            for stage in self._program.stages
        ]
        buttons = (
            button("Follow tool", "follow", aria_pressed="false"),
            button("Reset view", "reset"),
        )
        caption = element("figcaption", element("h3", "The arm"))
        view = element("div", class_="view", role="img", aria_label="The arm in 3D")
        return joined(
            element(
                "figure", caption, view, element("div", *buttons, class_="player"),
                class_="still arm live",
            ),
            packed("live-scene", json.dumps({**scene, "kinds": kinds}, allow_nan=False)),
            packed_bundle(),
        )  # fmt: skip
