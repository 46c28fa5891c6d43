"""Letters and colours of what is written on pictures."""

from __future__ import annotations

import functools

from PIL import ImageFont

from taskspec.deferred_methods import dataclass

Color = tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class Pen:
    """Lengths of a design in the pixels of a picture that is `scale` times as large."""

    scale: float

    def __call__(self, length: float) -> int:
        """A length [px], rounded."""
        return round(length * self.scale)


@functools.lru_cache(maxsize=32)
def font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Pillow's own font, so that letters are the same everywhere."""
    return ImageFont.load_default(max(size, 6))


def rgb(color: tuple[float, ...]) -> Color:
    """A colour of MuJoCo as Pillow takes it."""
    red, green, blue = (round(255 * value) for value in color[:3])
    return red, green, blue


def dark(color: tuple[float, ...]) -> Color:
    """A darker shade that can be read on white."""
    return rgb(tuple(0.72 * value for value in color[:3]))
