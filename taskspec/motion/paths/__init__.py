"""The kinds of paths: one class each, which says all that depends on the kind.

To add one, derive it from `PathForm`, or from `LaidPath` where it is known when the task is
compiled, and `register` it before the language is imported.
"""

from taskspec.motion.paths.arc import Arc
from taskspec.motion.paths.form import PathForm
from taskspec.motion.paths.key import PathKey, WrongPath
from taskspec.motion.paths.laid import LaidPath, Route
from taskspec.motion.paths.lissajous import Lissajous
from taskspec.motion.paths.raster import Raster
from taskspec.motion.paths.registry import PATHS, all_paths, register
from taskspec.motion.paths.spiral import Spiral
from taskspec.motion.paths.straight import Line, To
from taskspec.motion.paths.table_file import TableFile
from taskspec.motion.paths.waypoints import Waypoints

for _form in (To, Line, Arc, Lissajous, Raster, Spiral, Waypoints, TableFile):
    register(_form)

__all__ = [
    "PATHS",
    "Arc",
    "LaidPath",
    "Line",
    "Lissajous",
    "PathForm",
    "PathKey",
    "Raster",
    "Route",
    "Spiral",
    "TableFile",
    "To",
    "Waypoints",
    "WrongPath",
    "all_paths",
    "register",
]
