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
    guards,
    held_mechanism,
    impact,
    kept_forces,
    law,
    loose_bodies,
    noise,
    objects,
    open_loop,
    passages,
    planned_motion,
    protection,
    references,
    resistance,
    robot,
    sensor,
    set_points,
    signals,
    singularity,
    stability,
    foreseen_forces,
    rehearsed,
    variations,
    contacts,
)

# isort: on

__all__ = [
    "axes",
    "contacts",
    "equations",
    "expectations",
    "faults",
    "feasibility",
    "foreseen_forces",
    "frames",
    "guards",
    "held_mechanism",
    "impact",
    "kept_forces",
    "law",
    "loose_bodies",
    "noise",
    "objects",
    "open_loop",
    "passages",
    "planned_motion",
    "protection",
    "references",
    "rehearsed",
    "resistance",
    "robot",
    "sensor",
    "set_points",
    "signals",
    "singularity",
    "stability",
    "variations",
]
