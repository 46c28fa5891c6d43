"""Values as a file has them, of what the iterations go by."""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.rotation import from_rpy
from taskspec_runner.identify.estimate import Estimate
from taskspec_runner.identify.fit import Fit, LogProblem
from taskspec_runner.identify.parameters import FILTER, Parameter, owner_of
from taskspec_runner.identify.poses import origin_of, rpy_of, turned

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]

_STEP = 1e-7
_AXES = "xyz"
#: Probabilities below this are no numbers to go by.
_NOTHING = 1e-12


class Outside:
    """The values of a fit in the words of the file.

    An object is placed in the axes in which the file has it: displacements along them, and roll,
    pitch and yaw against them. What of these is not known stays as in the file.

    Attributes:
        inside: (count,) what iterations go by, with what is not known as in the file.
        values: (count,) the same as the file has them [SI].
        found: (count,) all as it was found, also what is not known by itself [SI].
        slopes: (count, count) their derivatives by what iterations go by.
        names: of each.
    """

    def __init__(self, problem: LogProblem, found: Fit, known: Mask) -> None:
        """Of a fit, of which some parameters are `known` (count,)."""
        self._problem, self._known, self._beyond = problem, known, found.beyond
        count = len(problem.continuous)
        values = found.values[:count].copy()
        self.inside = self._at_home(values)
        self.values = self._outside(self.inside)
        self.found = self._outside(values)
        self.slopes = np.zeros((count, count))
        for i in range(count):
            if not known[i]:
                continue
            step = _STEP * problem.scales[i]
            other = self.inside.copy()
            other[i] += step
            self.slopes[:, i] = (self._outside(self._at_home(other)) - self.values) / step
            # What is at its bound is known as well as it would be without.
            self.slopes[i, i] = self.slopes[i, i] if problem.continuous[i].moves else 1.0
        self.slopes[~known] = 0.0
        self.names = tuple(self._name(p) for p in problem.continuous)

    def _at_home(self, inside: Vector) -> Vector:
        """What is not known so that the file's values of it stay: of poses by Newton's steps."""
        made = inside.copy()
        for i, parameter in enumerate(self._problem.continuous):
            if not self._known[i] and not parameter.moves:
                made[i] = parameter.declared
        for name, rows in self._problem.moving.items():
            free = [row for row, number in rows.items() if not self._known[number]]
            for row in free:
                made[rows[row]] = 0.0
            if not free or len(free) == len(rows):
                continue
            for _ in range(6):
                here = self._pose(name, made)
                if np.abs(here[free]).max() < 1e-12:
                    break
                J = np.zeros((len(free), len(free)))
                for k, row in enumerate(free):
                    other = made.copy()
                    other[rows[row]] += 1e-6
                    J[:, k] = (self._pose(name, other) - here)[free] / 1e-6
                move = np.linalg.lstsq(J, -here[free], rcond=None)[0]
                for k, row in enumerate(free):
                    made[rows[row]] += move[k]
        return made

    def _pose(self, name: str, inside: Vector) -> Vector:
        """(6,) an object's displacement, and roll, pitch and yaw, in the axes of the file."""
        by = np.zeros(6)
        for row, number in self._problem.moving[name].items():
            by[row] = inside[number]
        shape = self._problem.program.context.loaded.task.shapes[name]
        own = from_rpy(shape.rpy)
        away = own.T @ (origin_of(shape, by) - np.array(shape.xyz))
        return np.concatenate([away, rpy_of(own.T @ turned(own, by[3:]), np.zeros(3))])

    def _aligned(self, parameter: Parameter) -> bool:
        shape = self._problem.program.context.loaded.task.shapes[owner_of(parameter)]
        return not any(shape.rpy)

    def _outside(self, inside: Vector) -> Vector:
        made = inside.copy()
        for name, rows in self._problem.moving.items():
            pose = self._pose(name, inside)
            shape = self._problem.program.context.loaded.task.shapes[name]
            if not any(shape.rpy):
                pose[:3] += shape.xyz
            for row, number in rows.items():
                made[number] = pose[row]
        for i, parameter in enumerate(self._problem.continuous):
            if parameter.path.endswith((".friction", ".damping")) or "joint_" in parameter.path:
                made[i] = max(made[i], 0.0)
        return made

    def _name(self, parameter: Parameter) -> str:
        along = self._along(parameter)
        return f"{parameter.path} {along}" if along else parameter.name

    def _along(self, parameter: Parameter) -> str:
        if not parameter.moves or self._aligned(parameter):
            return ""
        word = "along" if parameter.path.endswith(".xyz") else "about"
        return f"{word} its {_AXES[parameter.index or 0]}"

    def estimate(
        self, number: int, parameter: Parameter, noise: float, arithmetic: float, quantile: float
    ) -> Estimate:
        """One value with its interval.

        Args:
            number, parameter: which one.
            noise, arithmetic: deviations that noise alone and arithmetic alone leave [SI].
            quantile: of the normal distribution, for the interval's level.
        """
        deviation = math.hypot(noise, arithmetic)
        value, declared = float(self.values[number]), parameter.declared
        own = value if parameter.moves else float(self.inside[number] + self._beyond[number])
        ends = interval(own, deviation, quantile, parameter.least)
        along = self._along(parameter)
        if parameter.path == FILTER:
            inside = float(self.inside[number])
            ends = parameter.value(ends[1]), parameter.value(ends[0])
            value, declared = parameter.value(inside), parameter.value(declared)
            deviation = (min(ends[1], value) - ends[0]) / quantile
            if not math.isinf(ends[1]):
                deviation = (ends[1] - ends[0]) / (2 * quantile)
        elif parameter.moves and not along:
            shape = self._problem.program.context.loaded.task.shapes[owner_of(parameter)]
            of = shape.xyz if parameter.path.endswith(".xyz") else shape.rpy
            declared = float(of[parameter.index or 0])
        return Estimate(
            parameter.path, parameter.index, along, value, *ends, deviation,
            declared, parameter.dimension, noise <= arithmetic,
        )  # fmt: skip


def interval(own: float, deviation: float, quantile: float, least: float) -> tuple[float, float]:
    """The ends of an interval; from its bound on, if a value cannot be told from that.

    Then the likelihood counts for values that there may be, those from the bound on, and the
    interval is the part next to it that has the level.
    """
    low, high = own - quantile * deviation, own + quantile * deviation
    if low >= least or deviation <= 0:
        return max(low, least), max(high, least)
    normal = NormalDist()
    there = normal.cdf((own - least) / deviation)
    beyond = 2 * normal.cdf(-quantile)
    if there * beyond <= _NOTHING:
        # So far beyond that the likelihood falls like an exponential.
        return least, least + deviation**2 / max(least - own, deviation) * -math.log(beyond)
    return least, own - deviation * normal.inv_cdf(there * beyond)
