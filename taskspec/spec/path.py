"""`path`: a curve in the task frame, driven along at a speed or in a time."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field

from taskspec.spec.model import Model, complete
from taskspec.spec.parse_context import ParseContext
from taskspec.spec.quantities import Constant, Entries, QuantityList
from taskspec.spec.words import Free
from taskspec.text.codes import register
from taskspec.text.data import Items, Map
from taskspec.text.nodes import pointer
from taskspec.text.units import ANGLE, LENGTH, NUMBER, TIME, VELOCITY, alternatives

register({"TS606": "a path that is not one path"})

FORMS = ("to", "line", "arc", "lissajous", "file")
_PACE = {"speed", "time"}

Coordinates = Annotated[
    tuple[float, ...], Entries((LENGTH, LENGTH, LENGTH, ANGLE, ANGLE, ANGLE), fewest=1)
]


class Line(Model):
    """A straight line from where the stage begins; `by` holds x, y, z [m], rx, ry, rz [rad]."""

    noun = "a line"

    by: Coordinates = Field(title="How far", description="[x, y, z, rx, ry, rz], from the left")


class Arc(Model):
    """A circular arc in the frame's xy plane: `center` [m], and how many `turns` about it."""

    noun = "an arc"

    center: Annotated[tuple[float, float], Entries((LENGTH, LENGTH))] = Field(
        title="Center", description="[x, y] in the frame"
    )
    turns: Annotated[float, Constant(NUMBER)] = Field(
        title="Turns", description="Turns about the center; negative ones run clockwise"
    )


class Lissajous(Model):
    """Sines on several axes: `amplitude` [m] and `turns` on each, x first."""

    noun = "a Lissajous figure"

    amplitude: Annotated[tuple[float, ...], Entries((LENGTH,) * 3, fewest=1)] = Field(
        title="Amplitudes", description="[x, y, z], from the left"
    )
    turns: Annotated[tuple[float, ...], QuantityList(NUMBER)] = Field(
        title="Turns", description="Periods on each axis"
    )

    @classmethod
    def rules(cls, data: Map, context: ParseContext) -> None:
        """Asks for one number of turns for each amplitude."""
        amplitude, turns = data.get("amplitude"), data.get("turns")
        if isinstance(amplitude, Items) and isinstance(turns, Items):
            broken = amplitude.node.broken or turns.node.broken
            if len(amplitude) != len(turns) and not broken:
                message = f"{len(amplitude)} amplitudes, but {len(turns)} turns"
                context.error("TS023", message, pointer(turns.node))


class Path(Model):
    """A curve; it drives the axes that it has coordinates for and that `axes` does not name.

    Attributes:
        to: a point in the frame: x, y, z [m], rx, ry, rz [rad].
        line: a distance from where the stage begins.
        arc: a part of a circle.
        lissajous: sines on several axes.
        file: a CSV file relative to the task file, with columns such as `x [mm]`.
        speed: along the path [m/s].
        time: for the whole path [s].
    """

    noun = "a path"
    example = "path: {to: [60 mm, 0, 0], speed: 50 mm/s}"
    reserved = frozenset({"spiral"})
    advice: ClassVar = {"raster": "write its points to a CSV file and name that: file: raster.csv"}

    to: Coordinates | None = Field(None, title="Where to", description="[x, y, z, rx, ry, rz]")
    line: Line | None = Field(None, title="A straight line")
    arc: Arc | None = Field(None, title="An arc in the frame's xy plane")
    lissajous: Lissajous | None = Field(None, title="Sines on several axes")
    file: Annotated[str, Free(filled=True)] | None = Field(None, title="A CSV file of points")
    speed: Annotated[float, Constant(VELOCITY, above=0)] | None = Field(None, title="Speed")
    time: Annotated[float, Constant(TIME, above=0)] | None = Field(None, title="Duration")

    @classmethod
    def rules(cls, data: Map, context: ParseContext) -> None:
        """Asks for one form, and one of `speed` and `time`."""
        forms = [key for key in FORMS if key in data]
        if not forms and complete(data, context):
            hint = f"one of {alternatives(FORMS)}"
            context.error("TS606", "a path without a form", pointer(data.node), hint)
        if len(forms) > 1:
            context.error("TS606", f"'{forms[0]}' and '{forms[1]}' in one path",
                          data.node.key_span(forms[1]), "make two stages of it")  # fmt: skip
        if "speed" in data and "time" in data:
            context.error("TS606", "'speed' and 'time' in one path", data.node.key_span("time"),
                          "keep one of the two")  # fmt: skip
        elif forms and "file" not in forms and not data.keys() & _PACE and complete(data, context):
            context.error("TS606", "a path needs a 'speed' or a 'time'",
                          data.node.key_span(forms[0]), "such as speed: 50 mm/s")  # fmt: skip
