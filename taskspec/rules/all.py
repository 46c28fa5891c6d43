"""All rules of the language, by the modules that they stand in: importing this registers them.

Rules of one phase are asked in this order. A rule that is silent where others have reported stands
after them.
"""

# isort: off
from taskspec.rules import (
    axes,
    equations,
    expectations,
    faults,
    feasibility,
    frames,
    gains,
    guards,
    held_mechanism,
    joint_references,
    kept_forces,
    law,
    loose_bodies,
    objects,
    open_loop,
    passivity,
    planned_motion,
    protection,
    references,
    resistance,
    robot,
    searches,
    sensor,
    servo,
    set_points,
    signals,
    stability,
    variations,
    contacts,
    bushings,
)

# isort: on

__all__ = [
    "axes",
    "bushings",
    "contacts",
    "equations",
    "expectations",
    "faults",
    "feasibility",
    "frames",
    "gains",
    "guards",
    "held_mechanism",
    "joint_references",
    "kept_forces",
    "law",
    "loose_bodies",
    "objects",
    "open_loop",
    "passivity",
    "planned_motion",
    "protection",
    "references",
    "resistance",
    "robot",
    "searches",
    "sensor",
    "servo",
    "set_points",
    "signals",
    "stability",
    "variations",
]
