"""Where MuJoCo's functions and data are, for code that calls it by address."""

from __future__ import annotations

import ctypes
import mmap
import sys
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass

#: A clock that no simulation shows [s].
_MARK = -1.2345678901234567e-300
#: A body held by a spring of six rows, so that there are constraint forces.
_MODEL = """
<mujoco><worldbody><body name="a"><freejoint/><geom size="0.1"/></body></worldbody>
<equality><weld body1="a"/></equality></mujoco>
"""
_LIBRARIES = {"darwin": "libmujoco.*.dylib", "win32": "mujoco.dll"}


class LayoutError(Exception):
    """MuJoCo's data lie otherwise than expected."""


@dataclass(frozen=True, slots=True)
class DataLayout:
    """Words of 64 bit, from the beginning of an `mjData`.

    Attributes:
        time: the simulator's clock.
        efc_force: the address of the constraint forces, which changes from step to step.
        words: up to and including the last one that is known.
    """

    time: int
    efc_force: int

    @property
    def words(self) -> int:
        """Words up to and including the last one that is known."""
        return max(self.time, self.efc_force) + 1


@cache
def address(name: str) -> int:
    """Of a function of MuJoCo, or of `memcpy`.

    Raises:
        LayoutError: it is not there.
    """
    if name == "memcpy":
        return ctypes.cast(ctypes.memmove, ctypes.c_void_p).value or 0
    folder = Path(mujoco.__file__).parent
    found = sorted(folder.glob(_LIBRARIES.get(sys.platform, "libmujoco.so.*")))
    if not found:
        raise LayoutError(f"MuJoCo's library is not in {folder}")
    function = getattr(ctypes.CDLL(str(found[0])), name, None)
    if function is None:
        raise LayoutError(f"{found[0].name} has no {name}")
    return ctypes.cast(function, ctypes.c_void_p).value or 0


@cache
def data_layout() -> DataLayout:
    """Where the clock and the constraint forces are in every `mjData` of this MuJoCo.

    They are searched in data whose clock, and whose forces' address, are known.

    Raises:
        LayoutError: they are not there.
    """
    model = mujoco.MjModel.from_xml_string(_MODEL)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    data.time = _MARK
    mark = int(np.array([_MARK]).view(np.int64)[0])
    return DataLayout(word(data, mark), word(data, data.efc_force.ctypes.data))


def words(data: mujoco.MjData) -> NDArray[np.int64]:
    """The words of `data` that `data_layout` knows.

    Raises:
        LayoutError: the clock is not where it is expected.
    """
    layout = data_layout()
    found = _words(data, layout.words)
    if found[layout.time] != np.array([data.time]).view(np.int64)[0]:
        raise LayoutError("MuJoCo's clock is not where it was in other data")
    return found


def warnings(data: mujoco.MjData) -> NDArray[np.int64]:
    """The simulator's warnings: of each its number in the upper half of the word."""
    statistics = data.warning
    kind = ctypes.c_int64 * len(statistics.number)
    return np.ctypeslib.as_array(kind.from_address(statistics.lastinfo.ctypes.data))


def word(data: mujoco.MjData | mujoco.MjModel, value: int) -> int:
    """The first word that has a value, of which there is one.

    Only pages with a word of the data before the wanted one are read.
    """
    at, page = data._address, mmap.PAGESIZE
    end = at
    # Every data block ends with addresses of its arrays, the wanted one among them or before.
    for _ in range(256):
        end = (end // page + 1) * page
        found = np.flatnonzero(_words(data, (end - at) // 8) == value)
        if found.size:
            return int(found[0])
    raise LayoutError("MuJoCo's data are not as expected")


def _words(data: mujoco.MjData | mujoco.MjModel, count: int) -> NDArray[np.int64]:
    kind = ctypes.c_int64 * count
    return np.ctypeslib.as_array(kind.from_address(data._address))
