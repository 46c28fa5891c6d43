"""What a picture is drawn on: an SVG with the scene as an image in it, or pixels."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from typing import Protocol
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Images
from PIL import ImageDraw

from taskspec_runner.video.lettering import Color, font

Vector = NDArray[np.float64]
Image = NDArray[np.uint8]

_FACES = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif"
#: Colours of a scene in an SVG: more would be twice its bytes.
_PALETTE = 128
#: Pixels are drawn this many times as fine as they come out.
_FINER = 2


class DrawingSheet(Protocol):
    """Lengths in units of the picture, y down.

    Attributes:
        fineness: pixels of an image to a unit.
    """

    fineness: float

    def image(self, left: float, top: float, width: float, height: float, pixels: Image) -> None:
        """An image (h, w, 3) in a rectangle."""

    def polygon(self, points: Vector, color: Color, opacity: float = 1.0) -> None:
        """A filled polygon (n, 2)."""

    def line(self, points: Vector, color: Color, width: float) -> None:
        """A line through points (n, 2) with round joints."""

    def disc(self, middle: Vector, radius: float, color: Color) -> None:
        """A disc about a place (2,)."""

    def text(
        self,
        at: Sequence[float] | Vector,
        text: str,
        size: float,
        color: Color,
        *,
        anchor: str = "l",
        bold: bool = False,
        halo: Color | None = None,
    ) -> None:
        """Text with its left end, middle or right end (anchor l, m, r) at a place (2,)."""

    def finish(self) -> bytes:
        """The file."""


def _hex(color: Color) -> str:
    return "#{:02x}{:02x}{:02x}".format(*color)


def _places(points: Vector) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in points)


class SvgSheet:
    """An SVG that is as wide as its place allows."""

    def __init__(self, width: float, height: float, name: str, fineness: float) -> None:
        self.fineness = fineness
        title = escape(name)
        self._parts = [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" '
            f'width="{width:g}" height="{height:g}" role="img" aria-label="{title}" '
            f'font-family="{_FACES}"><title>{title}</title>'
        ]

    def image(self, left: float, top: float, width: float, height: float, pixels: Image) -> None:
        """An image (h, w, 3) in a rectangle."""
        file = io.BytesIO()
        picture = Images.fromarray(pixels)
        picture.quantize(_PALETTE, dither=Images.Dither.NONE).save(file, "png", optimize=True)
        data = base64.b64encode(file.getvalue()).decode()
        self._parts.append(
            f'<image x="{left:g}" y="{top:g}" width="{width:g}" height="{height:g}" '
            f'preserveAspectRatio="none" href="data:image/png;base64,{data}"/>'
        )

    def polygon(self, points: Vector, color: Color, opacity: float = 1.0) -> None:
        """A filled polygon (n, 2)."""
        self._parts.append(
            f'<polygon points="{_places(points)}" fill="{_hex(color)}" fill-opacity="{opacity:g}"/>'
        )

    def line(self, points: Vector, color: Color, width: float) -> None:
        """A line through points (n, 2) with round joints."""
        self._parts.append(
            f'<polyline points="{_places(points)}" fill="none" stroke="{_hex(color)}" '
            f'stroke-width="{width:g}" stroke-linecap="round" stroke-linejoin="round"/>'
        )

    def disc(self, middle: Vector, radius: float, color: Color) -> None:
        """A disc about a place (2,)."""
        x, y = middle
        self._parts.append(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:g}" fill="{_hex(color)}"/>'
        )

    def text(
        self,
        at: Sequence[float] | Vector,
        text: str,
        size: float,
        color: Color,
        *,
        anchor: str = "l",
        bold: bool = False,
        halo: Color | None = None,
    ) -> None:
        """Text at a place."""
        around = ""
        if halo is not None:
            around = (
                f' stroke="{_hex(halo)}" stroke-width="{size / 4.5:.1f}" stroke-linejoin="round" '
                'paint-order="stroke"'
            )
        weight = ' font-weight="600"' if bold else ""
        where = {"l": "start", "m": "middle", "r": "end"}[anchor]
        # Of letters without descenders the middle is 0.35 of their size above the baseline.
        self._parts.append(
            f'<text x="{at[0]:.1f}" y="{at[1] + 0.35 * size:.1f}" font-size="{size:g}" '
            f'fill="{_hex(color)}" text-anchor="{where}"{weight}'
            f"{around}>{escape(text)}</text>"
        )

    def finish(self) -> bytes:
        """The file."""
        return "\n".join([*self._parts, "</svg>\n"]).encode()


class PixelSheet:
    """Pixels, that are drawn finer than they come out."""

    def __init__(self, width: float, height: float, fineness: float) -> None:
        self.fineness = fineness
        self._scale = _FINER * fineness
        size = round(width * self._scale), round(height * self._scale)
        self._image = Images.new("RGB", size, "white")
        self._pen = ImageDraw.Draw(self._image)

    def image(self, left: float, top: float, width: float, height: float, pixels: Image) -> None:
        """An image (h, w, 3) in a rectangle."""
        size = round(width * self._scale), round(height * self._scale)
        place = round(left * self._scale), round(top * self._scale)
        self._image.paste(Images.fromarray(pixels).resize(size), place)

    def polygon(self, points: Vector, color: Color, opacity: float = 1.0) -> None:
        """A filled polygon (n, 2)."""
        mask = Images.new("L", self._image.size, 0)
        ImageDraw.Draw(mask).polygon(self._scaled(points), fill=round(255 * opacity))
        self._image.paste(Images.new("RGB", self._image.size, color), mask=mask)

    def line(self, points: Vector, color: Color, width: float) -> None:
        """A line through points (n, 2) with round joints."""
        self._pen.line(self._scaled(points), color, round(width * self._scale), joint="curve")
        for end in (points[0], points[-1]):
            self.disc(end, width / 2, color)

    def disc(self, middle: Vector, radius: float, color: Color) -> None:
        """A disc about a place (2,)."""
        self._pen.ellipse(self._scaled(np.array([middle - radius, middle + radius])), color)

    def text(
        self,
        at: Sequence[float] | Vector,
        text: str,
        size: float,
        color: Color,
        *,
        anchor: str = "l",
        bold: bool = False,
        halo: Color | None = None,
    ) -> None:
        """Text at a place."""
        letters = font(round(size * self._scale))
        place = at[0] * self._scale, at[1] * self._scale
        stroke = round(size * self._scale / 9) if halo is not None else 0
        own = round(size * self._scale / 50) if bold and not stroke else 0
        self._pen.text(
            place, text, color, letters, f"{anchor}m", stroke_width=stroke or own,
            stroke_fill=color if halo is None else halo,
        )  # fmt: skip

    def finish(self) -> bytes:
        """The file."""
        size = [round(edge / _FINER) for edge in self._image.size]
        file = io.BytesIO()
        self._image.resize((size[0], size[1]), Images.Resampling.LANCZOS).save(
            file, "png", optimize=True
        )
        return file.getvalue()

    def _scaled(self, points: Vector) -> list[tuple[float, float]]:
        return [(float(x), float(y)) for x, y in points * self._scale]
