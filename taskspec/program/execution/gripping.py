"""The gripper of a run: what it is commanded, and the mass that goes to the arm's model.

A kernel: Python's machine, machine code and exported C have it by this source.

A stage with `grip` commands a force as it begins, one with `release` none; what was commanded
holds in all other stages, whichever way they are entered. The mass m of the body is handed to the
model as far as the gripper reports that it presses:

    load = m min(1, N / N_full),

N_full what was commanded as it was gripped, or less where the same body has been gripped more
softly since. So the torque that carries it rises as the jaws close, and goes as they open, or close
on nothing because the body has slipped out. It is known as a point at the tip.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.native.kernel import Record, Vector, Words
from taskspec.spec import Task

#: What a stage does with the gripper as it begins.
KEEPS, GRIPS, RELEASES = 0, 1, 2


class GripTable(Record):
    """The gripper of a run.

    Attributes:
        used: 1 in a task that grips, else nothing else of it counts.
        actions: of each stage, one of the three.
        forces: of each stage, what each jaw is commanded to press with [N].
        masses: of each stage, of the body that it grips [kg].
        mass: (1,) of the body that was gripped last [kg].
        full: (1,) what the jaws press with where all of it is handed over [N].
        command: (1,) what each jaw is commanded now [N]; 0 opens the gripper.
        load: (1,) mass that the model has at the tip [kg].
        reported: (2,) what each jaw presses with [N], how far the body has slipped [m].
    """

    used: int
    actions: Words
    forces: Vector
    masses: Vector
    mass: Vector
    full: Vector
    command: Vector
    load: Vector
    reported: Vector


def begin_stage(c: GripTable, stage: int) -> None:
    """Commands what a stage begins with."""
    if c.used == 0:
        return
    command, mass, full = c.command, c.mass, c.full
    if c.actions[stage] == GRIPS:
        command[0] = c.forces[stage]
        again = c.load[0] > 0.0 and mass[0] == c.masses[stage]
        full[0] = min(full[0], c.forces[stage]) if again else c.forces[stage]
        mass[0] = c.masses[stage]
    elif c.actions[stage] == RELEASES:
        command[0] = 0.0


def hand_load(c: GripTable) -> None:
    """Hands the model what the gripper holds; a tick that is made twice finds the same."""
    if c.used == 0:
        return
    load = c.load
    if c.full[0] > 0.0:
        load[0] = c.mass[0] * max(0.0, min(1.0, c.reported[0] / c.full[0]))


def grip_table(task: Task, now: NDArray[np.float64], reported: NDArray[np.float64]) -> GripTable:
    """The gripper of a run that begins, open.

    Args:
        task: as the controller has it.
        now: a tick's input, whose last two numbers are command and load in a task that grips.
        reported: a tick's input, whose last two are what the gripper reports.
    """
    stages, used = task.stages.values(), bool(task.gripped)
    grips = [stage.grip for stage in stages]
    actions = [
        GRIPS if stage.grip is not None else RELEASES if stage.release is not None else KEEPS
        for stage in stages
    ]
    masses = [0.0 if grip is None else task.shapes[grip.object].mass or 0.0 for grip in grips]
    return GripTable(
        used=int(used),
        actions=np.array(actions, dtype=np.int64),
        forces=np.array([0.0 if grip is None else grip.force for grip in grips]),
        masses=np.array(masses),
        mass=np.zeros(1),
        full=np.zeros(1),
        command=now[-2:-1] if used else np.zeros(1),
        load=now[-1:] if used else np.zeros(1),
        reported=reported[-2:] if used else np.zeros(2),
    )
