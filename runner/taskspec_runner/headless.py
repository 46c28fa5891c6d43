"""Which OpenGL the user wants, kept from MuJoCo until a picture is drawn.

MuJoCo loads the library that MUJOCO_GL names as soon as it is imported, and where that library is
not there the import fails, though no picture may be wanted.
"""

from __future__ import annotations

import os

_OURS, _THEIRS = "TASKSPEC_GL", "MUJOCO_GL"
_LOADED_AT_ONCE = ("egl", "osmesa")


def set_aside() -> None:
    """Hides MUJOCO_GL from MuJoCo; to be called before that is imported."""
    if os.environ.get(_THEIRS, "").lower().strip() in _LOADED_AT_ONCE:
        os.environ[_OURS] = os.environ.pop(_THEIRS)


def asked() -> str:
    """What was set aside; empty for nothing."""
    return os.environ.get(_OURS, "")
