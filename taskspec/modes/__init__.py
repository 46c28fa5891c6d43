"""Modes of an axis in a stage: one class for each, with all that depends on it.

To add one, derive it from `AxisMode`, and `register` it before the language is imported. Reading a
file needs no numerical library, so a mode's module imports none before its first use.
"""

from taskspec.modes.coupling import Coupling, UncoupledError
from taskspec.modes.follows import Follows
from taskspec.modes.follows_axes import FollowsAxes
from taskspec.modes.force import DEFAULT_RAMP, Force
from taskspec.modes.free import FreeAxis
from taskspec.modes.hold import Hold
from taskspec.modes.key import Misuse, ModeKey
from taskspec.modes.mode import (
    MOVE_SPEED,
    AxisMode,
    Blending,
    Displacement,
    HandOver,
    Known,
    OwnReference,
    ReferenceInputs,
    StageStart,
    from_start,
    move_speed,
    to_coordinate,
)
from taskspec.modes.move import Move
from taskspec.modes.on_path import OnPath
from taskspec.modes.open_loop import OpenLoop
from taskspec.modes.position import Position
from taskspec.modes.registry import (
    MODES,
    all_modes,
    axis_keys,
    companions,
    force_given,
    force_keys,
    mode_given,
    register,
)
from taskspec.modes.velocity import Velocity

for _mode in (Hold, FreeAxis, Position, Velocity, Move, Follows):
    register(_mode)

__all__ = [
    "DEFAULT_RAMP",
    "MODES",
    "MOVE_SPEED",
    "AxisMode",
    "Blending",
    "Coupling",
    "Displacement",
    "Follows",
    "FollowsAxes",
    "Force",
    "FreeAxis",
    "HandOver",
    "Hold",
    "Known",
    "Misuse",
    "ModeKey",
    "Move",
    "OnPath",
    "OpenLoop",
    "OwnReference",
    "Position",
    "ReferenceInputs",
    "StageStart",
    "UncoupledError",
    "Velocity",
    "all_modes",
    "axis_keys",
    "companions",
    "force_given",
    "force_keys",
    "from_start",
    "mode_given",
    "move_speed",
    "register",
    "to_coordinate",
]
