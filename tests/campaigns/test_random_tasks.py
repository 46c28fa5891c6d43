from __future__ import annotations

from pathlib import Path

from random_tasks import LAWS, random_task, write_tasks

import taskspec
import taskspec_runner


def test_a_task_is_its_number() -> None:
    assert random_task(3) == random_task(3)
    assert random_task(3) != random_task(4)


def test_the_tasks_know_the_whole_language() -> None:
    text = "\n".join(random_task(number) for number in range(200))
    words = [f"law: {law}\n" for law in LAWS] + [f"kind: {law}" for law in LAWS]
    words += [f"model: {arm}" for arm in ("planar2", "planar3", "ur5e", "panda")]
    words += [f"shape: {shape}" for shape in ("plane", "box", "cylinder", "sphere")]
    words += [f"mechanism: {kind}" for kind in ("hinge", "slide", "screw")]
    words += ["equation:", "constraints:", "grasp:", "free: true", "motion:", "solve: qp"]
    words += ["sensor:", "at: wrist", "noise:", "bias:", "filter:", "delay:", "tare: true"]
    words += ["path:", "line:", "arc:", "lissajous:", "raster:", "spiral:", "waypoints:", "file:"]
    words += ["follows:", "estimate:", "vary:"]
    words += ["attempts:", "fail_if:", "on_fail:", "rate: 250 Hz", "rate: 2 kHz", "rigid"]
    assert [word for word in words if word not in text] == []


def test_tasks_read_without_an_error_and_run_to_their_end(tmp_path: Path) -> None:
    paths = write_tasks(tmp_path, range(6))
    loaded = [taskspec.load(path) for path in paths]
    assert [each.task.name for each in loaded] == [f"random-{number}" for number in range(6)]
    made = taskspec_runner.run(loaded[5], tmp_path / "run", report=False)
    assert made.verdict in ("passed", "missed")
