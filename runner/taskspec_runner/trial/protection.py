"""What of a trial the robot's own controller would stop at, and a run does not watch.

A run watches speeds and wrenches at each tick. Accelerations and jerks of references, and rates of
torques, are differences of ticks: they are read off the trial.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.axis import AXES
from taskspec.robot.inverse_kinematics import turns_at
from taskspec.rules.finding import Finding, warning
from taskspec.rules.places import motion_of
from taskspec.spec import FILE
from taskspec.spec.protection import Protected, ProtectedTip, Protection
from taskspec.text.units import Dimension, show
from taskspec_runner.record.history import Visit
from taskspec_runner.trial.moment import Moment
from taskspec_runner.trial.trial import Trial

Vector = NDArray[np.float64]

_SLOWER = {
    "acceleration": "move more slowly, so that the speed is reached and left more gently",
    "jerk": "move more slowly, or begin and end where the reference rests",
}
#: Ticks of a visit, those with the greatest changes, at which joints are worked out.
_WORKED_OUT = 200


def fast_motions(trial: Trial) -> Iterator[Finding]:
    """References whose accelerations or jerks the robot's own controller does not let pass."""
    protection = trial.program.context.loaded.task.robot.protection
    if protection is None:
        return
    for visit in trial.history.visits():
        references = _References(trial, visit)
        finding = references.of_tip(protection) or references.of_joints(protection)
        if finding is not None:
            yield finding


class _References:
    """Accelerations and jerks of a visit's references, as differences from tick to tick."""

    def __init__(self, trial: Trial, visit: Visit) -> None:
        self._trial, self._visit, self._first = trial, visit, Moment(trial, visit, visit.first)
        period = trial.program.context.period
        columns = [self._column(f"velocity.{axis}.ref") for axis in AXES]
        rates = np.stack(columns, axis=1)
        acceleration = np.diff(rates, axis=0) / period
        #: (k, 6) in the frame's axes, by key [m, rad, s].
        self._tip = {
            "acceleration": acceleration,
            "jerk": np.diff(acceleration, axis=0) / period,
        }

    def of_tip(self, protection: Protection) -> Finding | None:
        """The first bound on the tip, or on how the tool turns, that is passed."""
        for group, part, what in (
            (protection.tip, slice(0, 3), "the tip's {}"),
            (protection.turn, slice(3, 6), "the {} of the tool's turn"),
        ):
            for key, values in self._tip.items():
                most = None if group is None else getattr(group, key)
                sizes = np.linalg.norm(values[:, part], axis=1)
                if group is None or most is None or not len(sizes):
                    continue
                row = int(np.argmax(sizes))
                if sizes[row] > most:
                    dimension = type(group).dimension_of(key)
                    return self._finding(
                        row, protection, group, what.format(key), key, sizes[row], most, dimension
                    )
        return None

    def of_joints(self, protection: Protection) -> Finding | None:
        """The first bound on a joint that is passed."""
        joints, robot = protection.joints, self._trial.program.context.robot
        if joints is None:
            return None
        for key in self._tip:
            given = getattr(joints, key)
            if given is None or len(given) not in (1, robot.n):
                continue
            bounds = np.broadcast_to(np.asarray(given), (robot.n,))
            rows, values = self._of_joints(key)
            if not len(rows):
                continue
            at, i = np.unravel_index(int(np.argmax(np.abs(values) / bounds)), values.shape)
            if abs(values[at, i]) > bounds[i]:
                dimension = (type(joints) if turns_at(robot, int(i)) else ProtectedTip).dimension_of
                what = f"the {key} of joint {i + 1}"
                return self._finding(
                    int(rows[at]), protection, joints, what, key, abs(values[at, i]), bounds[i],
                    dimension(key),
                )  # fmt: skip
        return None

    def _of_joints(self, key: str) -> tuple[NDArray[np.int64], Vector]:
        """Ticks (k,) of the visit and derivatives (k, n) of the joints' references there.

        q'' = J^+ x'', q''' = J^+ x''' in a frame that stands still; on a path of joints, of the
        joints themselves. Of other frames nothing is worked out.
        """
        stage, robot = self._first.stage, self._trial.program.context.robot
        n = robot.n
        if stage.joint_path is not None:
            period = self._trial.program.context.period
            rates = np.stack([self._column(f"joint.{i + 1}.velocity") for i in range(n)], axis=1)
            order = 1 if key == "acceleration" else 2
            derived = np.diff(rates, n=order, axis=0) / period**order
            return np.arange(len(derived)), derived
        values = self._tip[key]
        if not stage.frame.still or not len(values):
            return np.zeros(0, np.int64), np.zeros((0, n))
        rows = np.argsort(-np.linalg.norm(values, axis=1), kind="stable")[:_WORKED_OUT]
        turned = np.kron(np.eye(2), stage.rotation)
        used = [axis.row for axis in AXES if axis in robot.axes]
        turned_rates = []
        for row in rows:
            q = [
                self._trial.history.columns[f"joint.{i + 1}.position"][self._visit.first + row]
                for i in range(n)
            ]
            J = robot.twin().resolved_jacobian(np.array(q))
            turned_rates.append(np.linalg.pinv(J[used]) @ (turned @ values[row])[used])
        return rows, np.array(turned_rates)

    def _column(self, name: str) -> Vector:
        """(k,) a column of the visit; zeros where it has no value."""
        if not self._first.has(name):
            return np.zeros(self._visit.last + 1 - self._visit.first)
        return np.nan_to_num(np.asarray(self._trial.history.columns[name][self._visit.rows]))

    def _finding(
        self,
        row: int,
        protection: Protection,
        group: Protected,
        what: str,
        key: str,
        value: float,
        most: float,
        dimension: Dimension,
    ) -> Finding:
        moment = Moment(self._trial, self._visit, self._visit.first + row + 1)
        return warning(
            "TS443",
            f"in the trial, in stage {self._visit.stage!r} {moment.when}, {what} is to be "
            f"{show(float(value), dimension, 3)}, and the robot's protection has "
            f"{show(float(most), dimension, 5)} ({protection.source_of(group)}): its own "
            "controller stops there",
            motion_of(moment.stage),
            _SLOWER[key],
        )


def fast_torques(trial: Trial) -> Iterator[Finding]:
    """The torque that changes most beyond the rate that the robot's own controller lets pass."""
    context = trial.program.context
    protection, robot = context.loaded.task.robot.protection, context.robot
    rates = None if protection is None else protection.joints
    if protection is None or rates is None or rates.torque_rate is None or len(trial.history) < 2:
        return
    if not context.drives.torques:
        return
    bounds = np.broadcast_to(np.asarray(rates.torque_rate), (robot.n,))
    names = [f"joint.{i + 1}.torque" for i in range(robot.n)]
    torques = np.stack([trial.history.columns[name] for name in names], axis=1)
    sizes = np.abs(np.diff(torques, axis=0)) / context.period
    row, joint = np.unravel_index(int(np.nanargmax(sizes / bounds)), sizes.shape)
    if sizes[row, joint] <= bounds[joint]:
        return
    visit = next(v for v in trial.history.visits() if v.first <= row + 1 <= v.last)
    moment = Moment(trial, visit, int(row) + 1)
    unit = "N*m/s" if turns_at(robot, int(joint)) else "N/s"
    begins = int(row) + 1 == visit.first
    stage = moment.stage
    yield warning(
        "TS445",
        f"in the trial, the torque of joint {joint + 1} changes by "
        f"{float(sizes[row, joint]):.3g} {unit} {'as' if begins else 'in'} "
        f"stage {visit.stage!r} {'begins' if begins else moment.when}, "
        f"and the robot's protection has {float(bounds[joint]):g} {unit} "
        f"({protection.source_of(rates)})",
        motion_of(stage) if stage.spec.axes or stage.spec.path else FILE.stages[visit.stage],
        "approach more slowly, press more softly, or keep the rate: solve: qp",
    )
