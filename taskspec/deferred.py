"""CasADi and NumPy for modules that the language imports: loaded where something asks for them.

A file is read, and its schema written, without either; they take longer to load than that takes.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__all__ = ["ca", "np"]


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
    import numpy as np
else:
    ca, np = _Deferred("casadi"), _Deferred("numpy")
