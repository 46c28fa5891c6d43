"""A run that its owner steps has the ticks of any other, however many are run at once."""

from __future__ import annotations

import itertools
from contextlib import closing
from pathlib import Path

import pytest

from taskspec.compiler import compile_unchecked
from taskspec.program.program import Program
from taskspec.spec import load_task
from taskspec_runner.loop.assembly import assemble
from taskspec_runner.loop.fixed_step import NATIVE, Outcome, Steps
from taskspec_runner.record.log import Log

TASKS = Path(__file__).resolve().parents[2] / "tasks"
STOPPED = """
taskspec: 1
robot: {model: panda, start: {xyz: [500 mm, 0, 302 mm]}}
world: {table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 20 kN/m}}
stages:
  approach: {axes: {z: {velocity: -40 mm/s}}, until: force.z < -2 N, within: {time: 2 s}}
  press: {axes: {z: {force: -60 N}}, time: 1 s}
limits: {force: 20 N}
"""


def stepped(
    program: Program, folder: Path, loop: str, *numbers: int | None
) -> tuple[bytes, Outcome]:
    """What a run leaves whose ticks are run in these numbers at once, over and over."""
    folder.mkdir()
    path, parts = folder / "log.arrow", assemble(program)
    with closing(parts.recorder(Log(path))) as recorder:
        steps = Steps(
            parts.machine,
            parts.plant,
            parts.bus,
            recorder,
            program.context.period,
            seed=3,
            loop=loop,
        )
        for most in itertools.cycle(numbers):
            before = steps.ticks
            done = steps.advance(most)
            assert steps.ticks == before + done
            if steps.outcome is not None:
                break
            assert done == most
        assert steps.advance(5) == 0
        outcome = steps.finish(to_rest=True)
    return path.read_bytes() + repr(parts.machine.transitions).encode(), outcome


def the_same(program: Program, folder: Path) -> Outcome:
    """The outcome of a program that leaves the same bytes by any steps, in both loops."""
    whole, outcome = stepped(program, folder / "whole", NATIVE, None)
    odd, of_odd = stepped(program, folder / "odd", NATIVE, 20, 1, 7, 433)
    python, of_python = stepped(program, folder / "python", "python", 33, 2)
    assert outcome == of_odd
    assert (outcome.loop, of_python.loop) == (NATIVE, "python")
    assert whole == odd == python
    return outcome


@pytest.mark.parametrize("task", ["press-qp", "peg-in-hole", "wrist-sensor", "door-handle"])
def test_ticks_do_not_depend_on_how_many_are_run_at_once(task: str, tmp_path: Path) -> None:
    program = compile_unchecked(load_task(TASKS / f"{task}.yaml"))
    assert the_same(program, tmp_path).status == "done"


def test_a_stop_by_a_limit_comes_at_the_same_tick(tmp_path: Path) -> None:
    (tmp_path / "stopped.yaml").write_text(STOPPED)
    outcome = the_same(compile_unchecked(load_task(tmp_path / "stopped.yaml")), tmp_path)
    assert (outcome.status, outcome.reason) == ("stopped", "force")
