"""A robot that is known by its content is the one that its files give, and no other."""

from __future__ import annotations

import json
import os
import pickle
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import fields
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from taskspec.robot import RobotError, RobotModel, load, rigid_body
from taskspec.robot import arm as arms
from taskspec.store import VARIABLE, Store

Load = Callable[..., RobotModel]

CASES = {
    "panda": {},
    "planar3": {},
    "own.urdf": {"flange": "palm"},
    "alone.xml": {},
}


@pytest.fixture
def folder(folder: Path) -> Path:
    """The robot files of the tests, and an MJCF file that names no other."""
    shutil.copy(Path(load.__file__).parent / "models" / "ur5e.xml", folder / "alone.xml")
    return folder


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty folder for robots, with none in this process's memory."""
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    load._built_in.cache_clear()
    yield tmp_path / "cache" / "robots"
    load._built_in.cache_clear()


@pytest.fixture
def compiled(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The names of the robots that MuJoCo has compiled since."""
    names = []
    original = load._compiled

    def noting(section, description):
        names.append(description.name)
        return original(section, description)

    monkeypatch.setattr(load, "_compiled", noting)
    return names


def plain(value: object) -> object:
    """A value by its bits, to be compared."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if hasattr(value, "homogeneous"):
        return plain(value.homogeneous)
    if hasattr(value, "__dataclass_fields__"):
        return {f.name: plain(getattr(value, f.name)) for f in fields(value)}
    return value


def all_of(robot: RobotModel) -> dict[str, object]:
    """Everything of a robot, MuJoCo's arrays included."""
    found = {f.name: plain(getattr(robot, f.name)) for f in fields(robot)}
    del found["simulated"], found["pin"]
    found["pin"] = robot.pin.saveToString()
    m = robot.model
    for name in dir(m):
        if isinstance(value := getattr(m, name), np.ndarray):
            found[f"model.{name}"] = plain(value)
    return found


def again(load_robot: Load, model: str, *folder: Path, **keys: object) -> RobotModel:
    """A robot as the next process loads it."""
    load._built_in.cache_clear()
    return load_robot(model, *folder, **keys)


@pytest.mark.parametrize("model", CASES)
def test_a_kept_robot_is_the_one_that_its_files_give(load, cache, compiled, folder, model):
    new = load(model, folder, **CASES[model])
    assert len(compiled) == 1
    (file,) = cache.iterdir()
    kept = again(load, model, folder, **CASES[model])
    assert len(compiled) == 1
    assert all_of(kept) == all_of(new)
    # For MuJoCo's arrays its files were compiled after all.
    assert len(compiled) == 2
    assert list(cache.iterdir()) == [file]


@pytest.mark.usefixtures("cache")
@pytest.mark.parametrize(
    "keys",
    [
        {"flange": "left_finger"},
        {"tool_mass": 0.4},
        {"tool_length": 0.2},
        {"base_xyz": (0.1, 0.0, 0.0)},
        {"balanced": True},
    ],
    ids=str,
)
def test_another_section_is_another_robot(load, compiled, monkeypatch, keys):
    load("own.urdf", flange="palm")
    other = {"flange": "palm", **keys}
    asked = all_of(load("own.urdf", **other))
    assert len(compiled) == 2
    monkeypatch.setenv(VARIABLE, "")
    assert all_of(load("own.urdf", **other)) == asked


@pytest.mark.usefixtures("cache")
def test_a_changed_file_is_another_robot(load, compiled, folder):
    first = load("own.urdf", folder, flange="palm")
    path = folder / "own.urdf"
    text = path.read_text()
    path.write_text(text.replace("2.5", "2.4"))
    changed = load("own.urdf", folder, flange="palm")
    assert changed.velocity_limit[0] == 2.4 != first.velocity_limit[0]
    path.write_text(text)
    assert load("own.urdf", folder, flange="palm").velocity_limit[0] == 2.5
    assert len(compiled) == 2


@pytest.mark.usefixtures("cache")
def test_a_mesh_that_comes_is_another_robot(load, compiled, folder, tetrahedron):
    bare = load("own.urdf", folder, flange="palm")
    (folder / "meshes").mkdir()
    (folder / "meshes" / "tetra.stl").write_bytes(tetrahedron)
    drawn = load("own.urdf", folder, flange="palm")
    assert (bare.model.nmesh, drawn.model.nmesh) == (0, 1)
    assert any("tetra.stl" in note for note in bare.notes)
    assert not any("tetra.stl" in note for note in drawn.notes)
    assert len(drawn.files) == len(bare.files) + 1
    kept = load("own.urdf", folder, flange="palm")
    assert len(compiled) == 2
    assert kept.files == drawn.files


def test_mjcf_that_names_files_is_read_anew(load, cache, compiled, folder, tetrahedron):
    absent = load("own.xml", folder, flange="grip")
    (folder / "meshes").mkdir()
    (folder / "meshes" / "absent_too.stl").write_bytes(tetrahedron)
    there = load("own.xml", folder, flange="grip")
    assert (absent.model.nmesh, there.model.nmesh) == (0, 1)
    assert len(there.files) == len(absent.files) + 1
    assert len(compiled) == 2
    assert not cache.exists()


@pytest.mark.parametrize("at", [0, 20, 60, -200])
def test_a_spoiled_file_is_made_anew(load, cache, compiled, at):
    new = all_of(load("panda"))
    (file,) = cache.iterdir()
    data = bytearray(file.read_bytes())
    data[at] ^= 1
    file.write_bytes(data)
    assert all_of(again(load, "panda")) == new
    assert len(compiled) == 2
    again(load, "panda")
    assert len(compiled) == 2


@pytest.mark.parametrize(
    "data", [b"", b"no arm", b'{"kind": "KnownArm"}', b'{"kind": "Path"}', pickle.dumps("no arm")]
)
def test_what_is_no_arm_is_made_anew(load, cache, compiled, monkeypatch, data):
    keys = []
    get = Store.get
    monkeypatch.setattr(Store, "get", lambda self, key: keys.append(key) or get(self, key))
    new = all_of(load("panda"))
    Store(cache).put(keys[0], data)
    assert all_of(again(load, "panda")) == new
    assert len(compiled) == 2


def test_what_other_programs_made_is_not_found(load, cache, compiled, monkeypatch):
    load("panda")
    for other in ("another MuJoCo", "another processor"):
        monkeypatch.setattr(arms, "_makers", lambda other=other: other)
        again(load, "panda")
    assert len(compiled) == 3
    assert len(list(cache.iterdir())) == 3


@pytest.mark.usefixtures("cache")
def test_a_refused_robot_is_refused_again(load, compiled):
    for _ in range(2):
        with pytest.raises(RobotError, match="no robot 'no'"):
            load("no")
        with pytest.raises(RobotError, match="no body, site or frame"):
            load("own.urdf", flange="nothing")
    assert len(compiled) == 2


def instructions(function):
    """What a function evaluates, step by step."""
    return [
        (
            function.instruction_id(k),
            tuple(function.instruction_input(k)),
            tuple(function.instruction_output(k)),
            function.instruction_constant(k) if function.instruction_id(k) == ca.OP_CONST else 0.0,
        )
        for k in range(function.n_instructions())
    ]


@pytest.mark.parametrize("spoil", [None, lambda data: data[:-9], lambda _: b"no function"])
@pytest.mark.parametrize("model", ["panda", "planar3", "own.urdf"])
def test_kept_model_terms_are_those_of_the_arm(load, cache, monkeypatch, model, spoil):
    body = rigid_body.RigidBody(load(model, **CASES[model]))
    new = rigid_body._written(body)
    written = []
    monkeypatch.setattr(rigid_body, "_written", lambda body: written.append(body) or new)
    for _ in range(3):
        rigid_body._function.cache_clear()
        found = body.function
        assert instructions(found) == instructions(new)
        (file,) = (cache.parent / "terms").iterdir()
        if spoil is not None:
            file.write_bytes(spoil(file.read_bytes()))
    assert len(written) == (1 if spoil is None else 3)
    rigid_body._function.cache_clear()


def test_model_terms_that_casadi_does_not_read_are_made_anew(load, cache, monkeypatch):
    body = rigid_body.RigidBody(load("panda"))
    keys = []
    get = Store.get
    monkeypatch.setattr(Store, "get", lambda self, key: keys.append(key) or get(self, key))
    rigid_body._function.cache_clear()
    new = instructions(body.function)
    Store(cache.parent / "terms").put(keys[-1], b"no function")
    rigid_body._function.cache_clear()
    assert instructions(body.function) == new


def test_rules_are_asked_about_a_known_robot_without_mujoco(tmp_path):
    task = Path(__file__).parents[2] / "tasks" / "wipe-table.yaml"
    program = (
        "import sys; from taskspec_runner.cli.entry import run\n"
        f"sys.argv = ['taskspec', 'validate', '--static', '--no-cache', {str(task)!r}]\n"
        "try: run()\n"
        "except SystemExit: pass\n"
        "print('mujoco' in sys.modules)"
    )
    environment = {**os.environ, VARIABLE: str(tmp_path)}
    said = [
        subprocess.run(
            [sys.executable, "-c", program],
            env=environment, capture_output=True, text=True, check=True,
        ).stdout
        for _ in range(2)
    ]  # fmt: skip
    assert [text.split()[-1] for text in said] == ["True", "False"]
    assert said[0].replace("True", "False") == said[1]


def test_what_is_kept_is_data(load, cache, tmp_path, monkeypatch):
    """A pickle would run what it says; this one would leave a mark."""

    class Marks:
        def __reduce__(self):
            return Path.touch, (tmp_path / "mark",)

    keys = []
    get = Store.get
    monkeypatch.setattr(Store, "get", lambda self, key: keys.append(key) or get(self, key))
    load("panda")
    data = get(Store(cache), keys[0])
    assert json.loads(data)["kind"] == "KnownArm"
    Store(cache).put(keys[0], pickle.dumps(Marks()))
    again(load, "panda")
    assert not (tmp_path / "mark").exists()
    pickle.loads(pickle.dumps(Marks()))
    assert (tmp_path / "mark").exists()
