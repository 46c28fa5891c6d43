"""Which force a panel shows in each visit of a stage, and its reference."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES
from taskspec_runner.record.history import Visit
from taskspec_runner.video.recording import Recording

Vector = NDArray[np.float64]

#: A smaller set point [N, N m] keeps an axis free; it is not shown.
_SMALLEST_SET_POINT = 1e-3


@dataclass(frozen=True, slots=True)
class PanelForce:
    """One signal over a visit.

    Attributes:
        visit: where it holds.
        name: as in the log.
        unit: as it is written.
        values: (k,) over the rows of the visit.
        wanted: (k,) its reference; None without one.
    """

    visit: Visit
    name: str
    unit: str
    values: Vector
    wanted: Vector | None

    def text(self, row: int) -> str:
        """The value at a row of the log, against its reference where it has one."""
        i = row - self.visit.first
        of = ""
        if self.wanted is not None and math.isfinite(self.wanted[i]):
            of = f" of {self.wanted[i]:.2f}"
        return f"{self.values[i]:.2f}{of} {self.unit}"


def panel_forces(recording: Recording) -> tuple[PanelForce, ...]:
    """For each visit the force with the largest set point that is not zero.

    A visit without one shows that of the next visit with one in the same frame, or of the last;
    where there is none either, what the robot applies to the mechanism that it holds, or how large
    the force is.
    """
    visits = recording.visits
    wanted = [_largest(recording, visit) for visit in visits]
    frames = [recording.stage(visit).plan.frame.name for visit in visits]
    held, found = _held(recording), []
    for i, visit in enumerate(visits):
        others = [*range(i, len(visits)), *range(i - 1, -1, -1)]
        name = next((wanted[k] for k in others if wanted[k] and frames[k] == frames[i]), held)
        found.append(_shown(recording, visit, name, has_reference=bool(wanted[i])))
    return tuple(found)


def _shown(recording: Recording, visit: Visit, name: str, *, has_reference: bool) -> PanelForce:
    columns, rows = recording.history.columns, visit.rows
    if name and np.isfinite(columns[name][rows]).any():
        unit = recording.history.units.get(name, "N").replace("*", " ")
        wanted = columns[f"{name}.ref"][rows] if has_reference else None
        return PanelForce(visit, name, unit, columns[name][rows], wanted)
    return PanelForce(
        visit, "norm(force)", "N", np.linalg.norm(recording.force[rows], axis=1), None
    )


def _held(recording: Recording) -> str:
    """The signal of what acts on the mechanism that the robot holds; empty for none."""
    task = recording.program.context.loaded.task
    name = (task.robot.grasp or "").partition(".")[0]
    mechanism = task.mechanisms.get(name)
    if mechanism is None:
        return ""
    return f"{name}.{'torque' if mechanism.angular else 'force'}"


def _largest(recording: Recording, visit: Visit) -> str:
    """The signal with the largest set point in a visit; empty without any."""
    columns, best, name = recording.history.columns, _SMALLEST_SET_POINT, ""
    for each in _set_points(recording, visit):
        wanted = columns[f"{each}.ref"][visit.rows]
        good = np.isfinite(wanted)
        # A ramp from the touch to zero is not a set point to look at.
        size = float(np.median(np.abs(wanted[good]))) if good.any() else 0.0
        # Forces come first: 1 N m and 1 N do not compare.
        if size > best and not ("torque" in each and best > _SMALLEST_SET_POINT):
            best, name = size, each
    return name


def _set_points(recording: Recording, visit: Visit) -> Iterator[str]:
    """Signals that a stage gives a set point to: on axes, and of equations."""
    columns = recording.history.columns
    for axis in AXES:
        name = f"{'torque' if axis.startswith('r') else 'force'}.{axis}"
        if name in columns and f"{name}.ref" in columns:
            yield name
    stage = recording.stage(visit)
    for equation in stage.plan.active:
        for effort in ("force", "torque"):
            if f"{equation}.{effort}.ref" in columns:
                yield f"{equation}.{effort}"
