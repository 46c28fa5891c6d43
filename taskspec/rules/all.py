"""All rules of the language, by the modules that they stand in: importing this registers them.

Rules of one phase are asked in this order.
"""

from taskspec.rules import (
    axes,
    contacts,
    expectations,
    frames,
    held_mechanism,
    impact,
    law,
    objects,
    references,
    resistance,
    robot,
    signals,
    variations,
)

__all__ = [
    "axes",
    "contacts",
    "expectations",
    "frames",
    "held_mechanism",
    "impact",
    "law",
    "objects",
    "references",
    "resistance",
    "robot",
    "signals",
    "variations",
]
