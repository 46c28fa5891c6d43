"""Robot files under suspicion: each is a robot or refused, quickly, and opens nothing outside."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from attacked import MEMORY, Victim
from hostile_models import MODELS, Model, arm, write

from taskspec.robot import load_robot
from taskspec.spec import load_task


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "task"
    made.mkdir()
    return made


@pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)
def test_hostile_models(model: Model, folder: Path, victim: Victim) -> None:
    before = {"t.yaml", "pipe.xml", "pipe.stl", "link.xml", f"arm{model.suffix}", *model.files}
    answer = victim.validate(write(model, folder))
    assert answer.broken == answer.unreadable == ()
    assert len(answer.errors) == bool(model.codes)
    assert answer.errors <= set(model.codes)
    assert not victim.slow(answer)
    assert answer.memory < MEMORY
    assert all(c == "\n" or c.isprintable() for c in answer.text)
    assert not any(line.startswith("::error::owned") for line in answer.text.splitlines())
    assert {p.name for p in folder.iterdir()} == before


@pytest.mark.parametrize("step", ["0", "-1", "1e300"])
def test_a_time_step_of_a_robot_file_does_not_reach_the_plant(folder: Path, step: str) -> None:
    path = write(Model(arm(head=f'<option timestep="{step}"/>')), folder)
    loaded = load_task(path)
    robot = load_robot(loaded.task.robot, loaded.base)
    assert 1e-5 <= robot.model.opt.timestep <= 0.02


def test_a_link_may_not_change_the_kind_of_a_file(folder: Path, victim: Victim) -> None:
    write(Model(""), folder)
    (folder / "arm.xml").unlink()
    (folder / "arm.xml").symlink_to("/etc/passwd")
    answer = victim.validate(folder / "t.yaml")
    assert answer.errors == {"TS402"}
    assert "by its ending" in answer.text
