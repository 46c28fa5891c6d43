"""Which files are read, and what comes of spoiled ones."""

from __future__ import annotations

import os
import random
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from taskspec.robot import RobotError, RobotModel
from taskspec.text.codes import CODES

Load = Callable[..., RobotModel]


def test_paths_are_relative_to_the_task_file(load: Load, folder: Path) -> None:
    (folder / "robots").mkdir()
    shutil.copy(folder / "own.urdf", folder / "robots" / "arm.urdf")
    robot = load("robots/arm.urdf", folder, flange="palm")
    assert (robot.name, robot.source) == ("arm", "robots/arm.urdf")


def test_absent(load: Load, tmp_path: Path) -> None:
    with pytest.raises(RobotError, match=r"no file 'arm\.urdf'") as caught:
        load("arm.urdf", tmp_path)
    assert caught.value.code == "TS401"


@pytest.mark.parametrize("name", ["arm.txt", "arm.mjb", "robots/arm"])
def test_other_endings(load: Load, tmp_path: Path, name: str) -> None:
    with pytest.raises(RobotError, match="neither MJCF nor URDF by its ending") as caught:
        load(name, tmp_path)
    assert caught.value.code == "TS402"


def test_not_a_regular_file(load: Load, tmp_path: Path) -> None:
    (tmp_path / "arm.xml").mkdir()
    with pytest.raises(RobotError, match="not a regular file"):
        load("arm.xml", tmp_path)


def test_a_pipe_does_not_hang(load: Load, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "arm.xml")
    os.mkfifo(tmp_path / "part.xml")
    with pytest.raises(RobotError, match="not a regular file"):
        load("arm.xml", tmp_path)
    (tmp_path / "other.xml").write_text('<mujoco><include file="part.xml"/></mujoco>')
    with pytest.raises(RobotError, match="not there"):
        load("other.xml", tmp_path)


def test_too_large(load: Load, tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_bytes(b" " * (8 * 2**20 + 1))
    with pytest.raises(RobotError, match=r"8\.0 MiB, more than 8 MiB"):
        load("arm.xml", tmp_path)


def test_too_deep(load: Load, tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text("<mujoco>" + "<body>" * 5000 + "</body>" * 5000 + "</mujoco>")
    with pytest.raises(RobotError, match="nested deeper"):
        load("arm.xml", tmp_path)


def test_not_text(load: Load, tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_bytes(b"<mujoco>\xff</mujoco>")
    with pytest.raises(RobotError, match=r"not UTF-8 text \(byte 8\)"):
        load("arm.xml", tmp_path)


def test_links_do_not_lead_out(load: Load, folder: Path) -> None:
    secret = folder.parent / "secret.xml"
    secret.write_text("<mujoco/>")
    (folder / "defaults.xml").unlink()
    (folder / "defaults.xml").symlink_to(secret)
    with pytest.raises(RobotError, match="from outside of the task"):
        load("own.xml", folder, flange="grip")


def test_includes_that_are_deep_together(load: Load, tmp_path: Path) -> None:
    for i in range(20):
        inner = f'<include file="{i + 1}.xml"/>' if i < 19 else ""
        body = "<body>" * 150 + inner + "</body>" * 150
        (tmp_path / f"{i}.xml").write_text(f"<mujoco>{body}</mujoco>")
    with pytest.raises(RobotError, match="nested deeper"):
        load("0.xml", tmp_path)


def test_an_include_may_name_a_file_beside_itself(load: Load, folder: Path) -> None:
    (folder / "parts" / "two.xml").write_text(
        '<mujoco><custom><text name="note" data="deep"/></custom></mujoco>'
    )
    path = folder / "parts" / "actuators.xml"
    path.write_text(path.read_text().replace("<actuator>", '<include file="two.xml"/><actuator>'))
    assert load("own.xml", folder, flange="grip").home.size == 8


@pytest.mark.parametrize("uri", ["package://../{}", "{}", "file://{}"])
def test_meshes_from_outside_are_not_read(
    load: Load, folder: Path, tmp_path: Path, tetrahedron: bytes, uri: str
) -> None:
    outside = tmp_path / "elsewhere.stl"
    outside.write_bytes(tetrahedron)
    inside = folder / "inside.stl"
    inside.write_bytes(tetrahedron)
    text = (folder / "own.urdf").read_text()
    old = "package://arm_description/meshes/tetra.stl"
    (folder / "own.urdf").write_text(text.replace(old, uri.format(outside)))
    assert load("own.urdf", folder, flange="palm").model.nmesh == 0
    if not uri.startswith("package"):
        (folder / "own.urdf").write_text(text.replace(old, uri.format(inside)))
        assert load("own.urdf", folder, flange="palm").model.nmesh == 1


def test_spoiled_at_random(load: Load, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever a file says, it is a robot or a `RobotError`, and nothing is left behind."""
    monkeypatch.chdir(folder)
    before = sorted(folder.rglob("*"))
    texts = {"own.urdf": "palm", "own.xml": "grip"}
    words = ("nan", "inf", "-1", "0", "1e300", "", "a b", "../x", "1 2 3", "true")
    rng = random.Random(7)
    codes = set()
    for _ in range(200):
        name, flange = rng.choice(sorted(texts.items()))
        original = (folder / name).read_text()
        values = list(re.finditer(r'"[^"]*"', original))
        one, two = rng.choice(values), rng.choice(values)
        word = rng.choice((two.group(), f'"{rng.choice(words)}"'))
        (folder / name).write_text(original[: one.start()] + word + original[one.end() :])
        try:
            robot = load(name, folder, flange=flange)
            assert np.isfinite(robot.home).all()
        except RobotError as error:
            codes.add(error.code)
        (folder / name).write_text(original)
    assert {"TS404", "TS405"} <= codes <= CODES.keys()
    assert sorted(folder.rglob("*")) == before
