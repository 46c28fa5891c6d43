"""The torque at a change of stage: it goes on where it was, and fades as the equation says."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from taskspec.compiler import compile_unchecked
from taskspec.program.drives import TORQUE_FADING as FADING
from taskspec.spec import load_text
from taskspec_runner.loop.assembly import assemble
from taskspec_runner.loop.sensing import Sensing

#: Torques of some 10 N m are equal but for rounding.
EXACT = 5e-13
TEXT = """\
taskspec: 1
name: tap
robot: {model: panda, start: {xyz: [500 mm, 0, 301 mm]}}
world: {table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 20 kN/m}}
law: {kind: hybridPROGRAM}
control: {rate: RATE}
stages:
  approach: {axes: {z: {velocity: -30 mm/s}}, END, within: {time: 1 s}LEAD}
  press: {law: LAW, axes: {z: {force: -10 N}}, time: 0.3 s}
"""
UNTIL = "until: force.z < -2 N"


def text(law="{kind: parallel}", program="", end=UNTIL, lead="", rate="1 kHz"):
    changes = {"PROGRAM": program, "END": end, "LEAD": lead, "LAW": law, "RATE": rate}
    made = TEXT
    for mark, value in changes.items():
        made = made.replace(mark, value)
    return made


class Tick:
    """One tick of a run: where, its torque, what its law asked for, what the last one would make.

    Attributes:
        index, t: stage and its time.
        torque: (n,) that was applied.
        asked: (n,) by the law's closed form; None in the first tick of a stage, whose memory is
            that of its entry.
        old: (n,) the torque of the stage before, in the tick of a change; None in any other.
    """

    def __init__(self, index, t, torque, asked, old):
        self.index, self.t, self.torque, self.asked, self.old = index, t, torque, asked, old


def run(task: str) -> tuple[list[Tick], float, list]:
    """The ticks of a run, the controller's period [s], and its transitions."""
    parts = assemble(compile_unchecked(load_text(task, "task.yaml")))
    machine, plant = parts.machine, parts.plant
    sensing = Sensing(plant.arm, plant.views.equations, machine, 0)
    sensing.read()
    machine.start()
    ticks: list[Tick] = []
    for k in itertools.count():
        sensing.read()
        runner = machine.runners[machine.index]
        memory, parameters = runner.memory.copy(), runner.parameters.copy()
        machine.tick(k * machine.period)
        if machine.ended:
            return ticks, machine.period, machine.transitions
        now, *measured = (array.copy() for array in machine._inputs)
        asked = old = None
        if machine.runners[machine.index] is runner:
            asked = np.array(runner.stage.tick(now, *measured, memory, parameters)[4]).ravel()
        else:
            now[0] = ticks[-1].t + machine.period
            old = np.array(runner.stage.tick(now, *measured, memory, parameters)[0]).ravel()
        ticks.append(Tick(machine.index, machine.t, machine.torque.copy(), asked, old))
        plant.step(machine.torque)
    raise AssertionError


def change(ticks: list[Tick], index: int) -> int:
    """The row of the first tick of a stage."""
    return next(k for k, tick in enumerate(ticks) if tick.index == index)


@pytest.mark.parametrize("rate", ["1 kHz", "500 Hz"])
@pytest.mark.parametrize("law", ["parallel", "hybrid", "hybrid-multipliers", "impedance", "pd"])
def test_the_torque_goes_on_and_fades_by_its_equation(law, rate):
    """u(0) is the old law's; then u = u_law + D max(0, 1 - t/T_f), T_f = max|D_j| / (1000 N m/s).

    D is had from the second tick alone, where max|D (1 - h/T_f)| = max|D| - 1000 h.
    """
    ticks, h, transitions = run(text(f"{{kind: {law}}}", rate=rate))
    k = change(ticks, 1)
    assert np.max(np.abs(ticks[k].torque - ticks[k].old)) < EXACT
    assert transitions[0].torque_step < EXACT
    left = ticks[k + 1].torque - ticks[k + 1].asked
    most = np.max(np.abs(left)) + FADING * h
    assert most > 3.0, "the laws ask for much the same"
    step = left * most / (most - FADING * h)
    worst = 0.0
    for tick in ticks[k + 1 :]:
        share = max(0.0, 1 - tick.t * FADING / most)
        worst = max(worst, np.max(np.abs(tick.torque - tick.asked - step * share)))
    assert worst < EXACT
    # Some of that is after it has faded, where the torque is the law's own.
    assert ticks[-1].t > most / FADING


def test_under_a_program_the_step_is_that_of_the_closed_form():
    """What limits do not change goes on as without a program."""
    ticks, _, transitions = run(text(program=", solve: qp", law="{kind: parallel, solve: qp}"))
    k = change(ticks, 1)
    assert np.max(np.abs(ticks[k].torque - ticks[k].old)) < EXACT
    assert transitions[0].torque_step < EXACT


def test_the_first_stage_begins_with_its_own_torque():
    ticks, _, _ = run(text())
    whole = np.array([np.max(np.abs(t.torque - t.asked)) for t in ticks[1 : change(ticks, 1)]])
    assert whole.max() == 0.0


def test_what_failed_is_not_carried_on():
    """A stage that `fail_if` ended leads to another, which begins with its own torque."""
    end = "until: force.z < -9 N, fail_if: force.z < -2 N"
    ticks, _, transitions = run(text(end=end, lead=", on_fail: press"))
    k = change(ticks, 1)
    assert transitions[0].kind == "fail_if"
    assert np.max(np.abs(ticks[k].torque - ticks[k].old)) > 0.5
    assert transitions[0].torque_step == np.max(np.abs(ticks[k].torque - ticks[k].old))
    assert all(np.array_equal(t.torque, t.asked) for t in ticks[k + 1 :])


@pytest.mark.xdist_group("shipped")
@pytest.mark.parametrize("task", ["conveyor", "corner", "drawer", "press-qp", "trace-points"])
def test_no_change_of_a_shipped_task_steps_the_torque(simulate, task):
    """docs/torque-steps.md has all; without the hand-over these step by 1.7 to 20 N m."""
    transitions = simulate(task).transitions
    assert max(t.torque_step for t in transitions) < 0.5
    assert max(t.torque_carried for t in transitions) > 1.5
