"""An instant of a trial: what was measured, what was true, and what the tool touched."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.axis import TRANSLATIONS, Axis
from taskspec.program.plan import StagePlan
from taskspec.spec import Task
from taskspec.text.units import show
from taskspec_runner.record.history import Visit
from taskspec_runner.trial.trial import Trial

Vector = NDArray[np.float64]

#: Ticks on either side over which a velocity is differentiated.
DIFFERENCED_TICKS = 3


class Moment:
    """A tick of a visit of a stage.

    Attributes:
        trial: that it belongs to.
        visit: of the stage.
        row: of the tick in the trial's history.
    """

    def __init__(self, trial: Trial, visit: Visit, row: int | None = None) -> None:
        """The last tick of a visit, or that of a row."""
        self.trial, self.visit = trial, visit
        self.row = visit.last if row is None else row

    @cached_property
    def stage(self) -> StagePlan:
        """The plan of its stage."""
        return next(s.plan for s in self.trial.program.stages if s.name == self.visit.stage)

    @property
    def nominal(self) -> Task:
        """The task as the controller has it."""
        return self.trial.program.context.loaded.task

    @property
    def true(self) -> Task:
        """The task with the true world and robot."""
        return self.trial.world.task

    @property
    def when(self) -> str:
        """Stage time and run time, in words."""
        t, clock = self.value("t"), self.value("clock")
        return f"at t = {show(t, 's', 3)} (run time {show(clock, 's', 4)})"

    def has(self, name: str) -> bool:
        """Whether there is a column of a name."""
        return name in self.trial.history.columns

    def value(self, name: str, row: int | None = None) -> float:
        """The value of a column here, or in another row [SI]; NaN where there is none."""
        if not self.has(name):
            return float("nan")
        return float(self.trial.history.columns[name][self.row if row is None else row])

    def stretch(self, name: str) -> Vector:
        """(k,) a column in the visit, up to here [SI]."""
        return np.asarray(self.trial.history.columns[name][self.visit.first : self.row + 1])

    @property
    def axes(self) -> list[Axis]:
        """The translations of the stage's frame that have a force."""
        return [a for a in TRANSLATIONS if self.has(f"force.{a}")]

    def force(self, *, measured: bool = False) -> Vector:
        """(3,) force that the robot applies, axes of the stage's frame [N]."""
        end = ".measured" if measured else ""
        return np.array([self.value(f"force.{a}{end}") for a in self.axes])

    @property
    def error(self) -> Vector:
        """(3,) measured less true force, axes of the stage's frame [N]."""
        return np.nan_to_num(self.force(measured=True) - self.force())

    @property
    def touches(self) -> bool:
        """Whether the tool truly touches anything."""
        return self.value("touching") > 0 or bool(self.stage.context.held)

    @cached_property
    def acceleration(self) -> Vector:
        """(3,) of the tip, axes of the stage's frame [m/s^2]."""
        first = max(self.visit.first, self.row - DIFFERENCED_TICKS)
        last = min(self.visit.last, self.row + DIFFERENCED_TICKS)
        time = (last - first) * self.stage.context.period
        change = [
            self.value(f"velocity.{a}", last) - self.value(f"velocity.{a}", first)
            for a in self.axes
        ]
        found: Vector = np.nan_to_num(np.array(change)) / max(time, self.stage.context.period)
        return found

    @cached_property
    def pressed(self) -> str:
        """The object that bears most of the force; empty for none."""
        return self.pressed_at(self.row)

    def pressed_at(self, row: int) -> str:
        """The same in another row. What the arm carries moves with it, and bears nothing of it."""
        objects = [name for name in self.nominal.shapes if name not in self.nominal.carried]
        borne = {name: abs(self.value(f"{name}.force", row)) for name in objects}
        borne = {name: force for name, force in borne.items() if force > 0}
        return max(borne, key=lambda name: borne[name], default="")

    def tares_before(self) -> Iterator[str]:
        """Names of the stages with `tare` that ended before this one."""
        for visit in self.trial.history.visits():
            if visit.first >= self.visit.first:
                return
            if self.nominal.stages[visit.stage].tare:
                yield visit.stage

    @cached_property
    def first_touch(self) -> int | None:
        """The row in which the touch began that lasts until here; None where nothing touches."""
        touching = self.trial.history.columns["touching"][: self.row + 1]
        if not touching[-1] > 0:
            return None
        apart = np.flatnonzero(~(np.asarray(touching) > 0))
        return int(apart[-1]) + 1 if len(apart) else 0
