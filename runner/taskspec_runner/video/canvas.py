"""Drawing without a window: an OpenGL context of EGL or OSMesa, and MuJoCo's renderer in it.

MuJoCo picks its context when it is imported, and on a Linux machine without a screen it picks one
that needs a screen. Here the first that works is taken: the one that MUJOCO_GL names, else EGL,
else OSMesa.
"""

from __future__ import annotations

import importlib
import os
import platform
import sys
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec_runner import headless
from taskspec_runner.errors import InputError

Image = NDArray[np.uint8]

_OFF = ("disable", "disabled", "off", "false", "0")
_HEADLESS = ("egl", "osmesa")
_NAMES = {"": "OpenGL", "egl": "EGL", "osmesa": "OSMesa"}
_HELP = (
    "install a headless OpenGL: EGL (on Debian and Ubuntu apt-get install libegl1 "
    "libgl1-mesa-dri) or OSMesa (libosmesa6)"
)
#: Names of renderers that need no graphics card.
_SOFTWARE = (b"llvmpipe", b"softpipe", b"swrast", b"software")
_PLATFORM = "PYOPENGL_PLATFORM"
#: Geoms that a scene holds at most.
MOST_GEOMS = 8000
_BACKGROUND = (mujoco.mjtRndFlag.mjRND_SKYBOX, mujoco.mjtRndFlag.mjRND_SHADOW)


class NoCanvasError(InputError):
    """There is no OpenGL to draw with; the message says what was tried and what to install."""


def backends() -> tuple[str, ...]:
    """Names of the kinds of context to try, in order; empty if MUJOCO_GL switches drawing off."""
    wanted = headless.wanted_library()
    if wanted in _OFF:
        return ()
    if platform.system() != "Linux":
        return ("",)
    return (wanted,) if wanted in _HEADLESS else _HEADLESS


def new_context(width: int, height: int) -> Any:
    """An OpenGL context, made current.

    Raises:
        NoCanvasError: none of the kinds works.
    """
    tried = []
    for name in (names := backends()):
        before = os.environ.get(_PLATFORM), set(sys.modules)
        try:
            context = _context_class(name)(width, height)
            context.make_current()
        # Missing libraries show as whatever their first call raises.
        except Exception as error:
            tried.append(f"{_NAMES[name]}: {_why(error)}")
            _forget(*before)
        else:
            return context
    if not names:
        raise NoCanvasError("cannot draw: MUJOCO_GL switches drawing off; unset it")
    raise NoCanvasError(f"cannot draw without a screen ({'; '.join(tried)}); {_HELP}")


def _in_software() -> bool:
    """Whether processors draw what is drawn in the current context, as Mesa's do."""
    try:
        from OpenGL import GL

        words = GL.glGetString(GL.GL_RENDERER)
    # MuJoCo draws without it, too.
    except Exception:
        return False
    return any(each in (words or b"").lower() for each in _SOFTWARE)


def _context_class(name: str) -> Any:
    if not name:
        return mujoco.GLContext
    return importlib.import_module(f"mujoco.{name}").GLContext


def _why(error: Exception) -> str:
    # PyOpenGL finds no library and goes on without one.
    if isinstance(error, AttributeError):
        return "its library is not there"
    return (str(error).strip().splitlines() or [type(error).__name__])[0]


def _forget(platform_before: str | None, modules_before: set[str]) -> None:
    """Undoes what the modules of a context have set on import, so that another can be tried."""
    os.environ.pop(_PLATFORM, None)
    if platform_before is not None:
        os.environ[_PLATFORM] = platform_before
    for name in set(sys.modules) - modules_before:
        if name.partition(".")[0] == "OpenGL" or name.startswith("mujoco."):
            del sys.modules[name]


class Canvas:
    """Pictures of one size of a model.

    Attributes:
        width, height: [px].
        scene: what is drawn; geoms may be added to it after `update`.
    """

    def __init__(
        self, model: mujoco.MjModel, width: int, height: int, *, many: bool = False
    ) -> None:
        """Prepares drawing.

        Args:
            model: of the scene; what its pictures are to be like is changed.
            width, height: [px].
            many: whether so many pictures are drawn that each has to be quick: without a graphics
                card their edges are not smoothed, which takes half of the time there.

        Raises:
            NoCanvasError: there is nothing to draw with.
        """
        self.width, self.height = width, height
        self._model = model
        model.vis.global_.offwidth = max(width, model.vis.global_.offwidth)
        model.vis.global_.offheight = max(height, model.vis.global_.offheight)
        self._context = new_context(width, height)
        if many and _in_software():
            model.vis.quality.offsamples = 0
        self._renderer = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._renderer)
        self.scene = mujoco.MjvScene(model, maxgeom=MOST_GEOMS)
        self._options = mujoco.MjvOption()

    def __enter__(self) -> Canvas:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Gives the context back."""
        if self._context is not None:
            self._context.make_current()
            self._renderer.free()
            self._context.free()
            self._context = None

    def update(self, data: mujoco.MjData, camera: mujoco.MjvCamera) -> None:
        """Puts the model as `data` has it into the scene, and nothing else."""
        self._flag(_BACKGROUND, 1)
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(
            self._model, data, self._options, None, camera, everything, self.scene
        )

    def clear(self) -> None:
        """Takes everything but the camera out of the scene, sky and shadows too."""
        self.scene.ngeom = 0
        self._flag(_BACKGROUND, 0)

    def _flag(self, flags: tuple[mujoco.mjtRndFlag, ...], value: int) -> None:
        for flag in flags:
            self.scene.flags[flag] = value

    def render(self, width: int | None = None, height: int | None = None) -> Image:
        """(height, width, 3) the scene as it is now, of the canvas's size or smaller."""
        width, height = width or self.width, height or self.height
        self._context.make_current()
        rectangle = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(rectangle, self.scene, self._renderer)
        pixels = np.empty((height, width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(pixels, None, rectangle, self._renderer)
        return np.ascontiguousarray(pixels[::-1])
