"""Robots to test with."""

from __future__ import annotations

import shutil
import struct
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from taskspec.robot import RobotModel, load_robot

DATA = Path(__file__).parent / "data"


def section(model: str, **keys: Any) -> Any:
    """A task file's `robot` section; tool keys begin with `tool_`, those of its base with `base_`.

    `flange` is a body's name, `flange_xyz` and `flange_rpy` a pose in it.
    """
    tool: dict[str, Any] = {
        "shape": "sphere", "radius": None, "size": None, "thickness": None, "length": None,
        "mass": 0.3, "com": None, "inertia": None,
    }  # fmt: skip
    base: dict[str, Any] = {"xyz": (0.0, 0.0, 0.0), "rpy": (0.0, 0.0, 0.0)}
    zero = (0.0, 0.0, 0.0)
    flange = {
        "body": keys.get("flange"),
        "xyz": keys.get("flange_xyz", zero),
        "rpy": keys.get("flange_rpy", zero),
    }
    for key, value in keys.items():
        part, _, name = key.partition("_")
        if part in ("tool", "base"):
            (tool if part == "tool" else base)[name] = value
    return SimpleNamespace(
        model=model,
        flange=SimpleNamespace(**flange)
        if flange != {"body": None, "xyz": zero, "rpy": zero}
        else None,
        base=SimpleNamespace(**base),
        tool=SimpleNamespace(**tool),
        balanced=keys.get("balanced", False),
    )


@pytest.fixture
def load() -> Callable[..., RobotModel]:
    """Load a robot: `load("panda", tool_mass=0.1)`; files are looked for in `data/` or `folder`."""

    def loader(model: str, folder: Path = DATA, **keys: Any) -> RobotModel:
        return load_robot(section(model, **keys), folder)

    return loader


@pytest.fixture
def data() -> Path:
    """The folder with the robot files of the tests."""
    return DATA


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder of its own with those files, to be spoiled."""
    shutil.copytree(DATA, tmp_path / "task")
    return tmp_path / "task"


@pytest.fixture
def tetrahedron() -> bytes:
    """A mesh file (STL) of four triangles."""
    corners = 0.05 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
    body = b"\0" * 80 + struct.pack("<I", 4)
    for face in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)):
        body += struct.pack("<3f", 0, 0, 0)
        body += b"".join(struct.pack("<3f", *corners[i]) for i in face) + b"\0\0"
    return body
