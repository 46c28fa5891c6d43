"""Every press, on every arm that can do it: a change of robot is a change of one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from taskspec.spec import load_task
from taskspec_runner.session import execute

TASKS = Path(__file__).resolve().parents[2] / "tasks"
#: What is beyond the motors of one arm may be easy for another; two pads are not one wall.
FOR_ONE_ARM = {"press-saturated", "press-unknown-pads"}
PRESSES = sorted({path.stem for path in TASKS.glob("press-*.yaml")} - FOR_ONE_ARM)
#: The light planar arm is overdamped by joint damping that suits the others: it needs longer.
LONGER = {"press-pd-joint": "12 s", "press-stiffness": "20 s"}


def on_the_plane(task):
    """The table as a wall in the plane of a planar arm, its x along the wall."""
    above = task.robot.start.xyz[2] - task.world["table"].xyz[2]
    return {
        "robot.start": f"{{xyz: [{0.4 - above} m, 250 mm, 0], rpy: [0, 0, 0]}}",
        "world.table.xyz": "[400 mm, 0, 0]",
        "world.table.rpy": "[90 deg, 0, -90 deg]",
    }


@pytest.mark.parametrize("robot", ["panda", "ur5e", "planar3"])
@pytest.mark.parametrize("press", PRESSES)
def test_press(press, robot, tmp_path):
    path = TASKS / f"{press}.yaml"
    overrides = {"robot.model": robot}
    if robot == "planar3":
        overrides |= on_the_plane(load_task(path).task)
        if press in LONGER:
            overrides["stages.press.time"] = LONGER[press]
    result = execute(load_task(path, overrides), tmp_path / "run", report=False)
    assert [judged.text for judged in result.expectations if not judged.passed] == []
    assert result.exit_code == 0
