"""Libraries that are loaded where something asks for them, as modules.

A file is read, and its schema written, without CasADi and NumPy, a robot that is known already is
taken without MuJoCo, and a run begins before Arrow is there to write its log; they take longer to
load than that takes.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__all__ = ["ca", "mujoco", "np", "pa"]


class _Deferred:
    """A module that is imported when something in it is first asked for."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, name: str) -> Any:
        value = getattr(import_module(self._name), name)
        setattr(self, name, value)
        return value


if TYPE_CHECKING:
    import casadi as ca
    import mujoco
    import numpy as np
    import pyarrow as pa
else:
    ca, mujoco, np = _Deferred("casadi"), _Deferred("mujoco"), _Deferred("numpy")
    pa = _Deferred("pyarrow")
