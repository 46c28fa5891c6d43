"""The scene of a run as markers of ROS, which RViz and Foxglove draw.

Solids are sent once, in the frames that move them; arrows are sent at every row of the scene.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskspec_runner.export.cdr import MessageForm
from taskspec_runner.export.scene import ARROWS, WORLD, RunScene, ScenePiece
from taskspec_runner.video.marks import WANTED

#: Types of a marker, and what is done with it.
_ARROW, _CUBE, _SPHERE, _CYLINDER, _LINES, _TRIANGLES = 0, 1, 2, 3, 5, 11
_ADD, _DELETE = 0, 2
_SOLIDS = {"box": _CUBE, "sphere": _SPHERE, "cylinder": _CYLINDER}
#: Of the lines of a path, and of shaft and head of the force's arrow and of a frame's axis [m].
_PATH_WIDTH = 0.003
_SHAFTS = {"force": (0.012, 0.026)}
_AXIS_SHAFT = (0.006, 0.013)
_NOWHERE = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


def world_markers(scene: RunScene) -> tuple[MessageForm, int]:
    """The world of a run and the path of the reference, and how many stamps the form has."""
    pieces = scene.pieces_of_arm(arm=False)
    form = MessageForm().count(len(pieces) + 1)
    for number, piece in enumerate(pieces):
        _solid(form, piece, number)
    _begun(form, WORLD, "path", 0).integer(_LINES).integer(_ADD)
    form.constant(_NOWHERE).constant(np.array([_PATH_WIDTH, 0.0, 0.0]))
    form.constant(np.array(WANTED, dtype=np.float32))
    _ended(form, scene.path.reshape(-1, 3))
    return form, len(pieces) + 1


def arrow_markers() -> MessageForm:
    """The arrows at a row; each has slots for a stamp, an action, a color, and both ends."""
    form = MessageForm().count(len(ARROWS))
    for name in ARROWS:
        _begun(form, WORLD, name, 0).integer(_ARROW).integers(1)
        shaft, head = _SHAFTS.get(name, _AXIS_SHAFT)
        form.constant(_NOWHERE).constant(np.array([shaft, head, 0.0])).floats(4)
        _lasting(form).count(2).numbers(6)
        _plain(form)
    return form


def arrow_slots(scene: RunScene, rows: slice, now: NDArray[np.uint32]) -> Sequence[NDArray[Any]]:
    """What fills the arrows at some rows, stamped `now` (k, 2)."""
    slots = list[NDArray[Any]]()
    for name in ARROWS:
        track = scene.arrows[name]
        actions = np.where(track.shown[rows], _ADD, _DELETE).astype("<i4")
        ends = np.hstack([track.starts[rows], track.ends[rows]])
        slots += [now, actions, track.colors[rows].astype("<f4"), ends]
    return slots


def _solid(form: MessageForm, piece: ScenePiece, number: int) -> None:
    kind = _SOLIDS.get(piece.kind, _TRIANGLES)
    _begun(form, piece.frame, piece.owner, number).integer(kind).integer(_ADD)
    form.constant(piece.pose).constant(piece.size)
    form.constant(np.array(piece.color, dtype=np.float32))
    corners = np.zeros((0, 3))
    if piece.vertices is not None:
        corners = piece.vertices[piece.faces].reshape(-1, 3)
    _ended(form, corners)


def _begun(form: MessageForm, frame: str, name: str, number: int) -> MessageForm:
    return form.header(frame).text(name).integer(number)


def _ended(form: MessageForm, points: NDArray[np.float64]) -> None:
    _lasting(form).count(len(points)).constant(points)
    _plain(form)


def _lasting(form: MessageForm) -> MessageForm:
    """Stays until it is replaced, and goes along with its frame."""
    return form.integer(0).integer(0).byte(1)


def _plain(form: MessageForm) -> None:
    """No colors of its points, no texture, no text and no mesh's file."""
    form.count(0).text("")
    form.integer(0).integer(0).text("").text("").count(0)
    form.count(0).text("").text("").text("").count(0).byte(0)
