"""Whether there is a screen, and which OpenGL the user wants, kept until a picture is drawn.

MuJoCo loads the library that MUJOCO_GL names, or GLFW, as soon as it is imported. That takes longer
than many a check, and where the library is not there the import fails, though no picture may be
wanted. On Linux, where pictures are drawn without a screen, it is told to load none.
"""

from __future__ import annotations

import os
import platform

_OURS, _THEIRS = "TASKSPEC_GL", "MUJOCO_GL"


def set_aside() -> None:
    """Hides what MUJOCO_GL says from MuJoCo; to be called before that is imported."""
    if platform.system() == "Linux":
        os.environ.setdefault(_OURS, os.environ.get(_THEIRS, ""))
        os.environ[_THEIRS] = "disable"


def wanted_library() -> str:
    """What the user has asked for; empty for nothing."""
    return os.environ.get(_OURS, os.environ.get(_THEIRS, "")).lower().strip()


def has_screen() -> bool:
    """Whether a window can be opened."""
    named = any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
    return named or platform.system() != "Linux"
