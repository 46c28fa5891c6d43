"""The contact stiffness that a stage estimates, in its memory, its outputs and its hand-over."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from taskspec.geometry.axis import AXES, Axis
from taskspec.laws.contact_stiffness import STATE
from taskspec.program.operators import choice
from taskspec.program.plan import StagePlan
from taskspec.program.ports import ESTIMATE, ESTIMATED
from taskspec.program.reference.measurement import Measurement
from taskspec.program.sensor import SensorModel
from taskspec.program.signals import applied

#: The parameters that carry what earlier stages have estimated through one that does not.
_CARRIED = tuple(name for name, _ in ESTIMATE)


def estimate_slot(name: str, axis: Axis) -> str:
    """The slot of the memory with a part of the state of an axis."""
    return f"estimate.{name}.{axis}"


class EstimatedStiffness:
    """The estimates of a stage as expressions; their slots join its memory and its parameters."""

    def __init__(self, plan: StagePlan, measurement: Measurement) -> None:
        """Of a stage, before its references are known."""
        self._plan, self._measurement = plan, measurement
        self._task = plan.context.loaded.task
        sensor = SensorModel.of(self._task.robot.sensor, plan.context.period)
        self._holds = sensor.hold_ticks > 1
        # A held reading is used as it comes, and is then as old as its delay.
        self._line = SensorModel(sensor.delay_ticks, 1, sensor.pole)
        memory = measurement.memory
        self._state = {
            axis: {
                name: memory.add(estimate_slot(name, axis), size) for name, size in STATE.items()
            }
            for axis in plan.estimates.axes
        }
        for axis in self._state:
            if self._line.order:
                memory.add(estimate_slot("line", axis), 2 * self._line.order)
            if self._holds:
                memory.add(estimate_slot("read", axis))
        if self._task.estimates:
            for name in _CARRIED:
                measurement.parameters.add(f"carried.{name}", 6)
        measurement.table.situation.estimates = {
            "stiffness": {a: state["found"] for a, state in self._state.items()},
            "deviation": {a: state["deviation"] for a, state in self._state.items()},
            "followed": {a: ca.exp(state["followed"]) for a, state in self._state.items()},
        }

    @property
    def axes(self) -> tuple[Axis, ...]:
        """Axes along which the stage estimates."""
        return tuple(self._state)

    def followed(self, axis: Axis) -> ca.SX:
        """ln k that the gains of an axis are designed for in this tick."""
        return self._state[axis]["followed"]

    def updates(self, frozen: ca.SX | None) -> dict[str, ca.SX]:
        """The memory after this tick, once the coordinates of its axes are known.

        Args:
            frozen: whether gains are to stay as they are; None in a stage without estimates.
        """
        updates: dict[str, ca.SX] = {}
        if frozen is None:
            return updates
        at, memory = self._measurement, self._measurement.memory
        position, velocity = at.table.situation.position, at.state.velocity
        first = at.clock.t < self._plan.context.period / 2
        step = 1.0 / self._task.control.plant_rate
        for axis, state in self._state.items():
            force, rate = at.table[applied(axis)], velocity[at.state.axes.index(axis)]
            # A reading is of the plant's step before, where x was x - x' step.
            taken = ca.vertcat(position[axis] - step * rate, rate)
            found = {}
            if self._line.order:
                line = ca.reshape(memory.symbol(estimate_slot("line", axis)), 2, self._line.order)
                # It begins with what is there at the first tick.
                begun = ca.repmat(taken, 1, self._line.order)
                line = ca.if_else(first, begun, line)
                kept, taken = self._line.update(line, taken, ca.SX(1))
                found["line"] = ca.vec(kept)
            fresh = ca.SX(1)
            if self._holds:
                fresh = force != memory.symbol(estimate_slot("read", axis))
                found["read"] = force
            estimate = self._plan.estimates.axes[axis]
            found |= estimate.step(state, force, taken[0], taken[1], first=first, fresh=fresh)
            for name, value in found.items():
                before = memory.symbol(estimate_slot(name, axis))
                updates[estimate_slot(name, axis)] = ca.vertcat(
                    *(
                        choice(frozen, old, new)
                        for old, new in zip(
                            ca.vertsplit(before), ca.vertsplit(ca.SX(value)), strict=True
                        )
                    )
                )
        return updates

    def rescaled(self, integrals: Mapping[str, ca.SX], updates: Mapping[str, ca.SX],
                 gains: Mapping[Axis, ca.SX]) -> dict[str, ca.SX]:  # fmt: skip
        """Integrals of the errors of forces whose gains follow, after this tick.

        K_I times the integral stays what it is while K_I changes: each is divided by what its gain
        changes by, so that the sum K_I e T goes on.

        Args:
            integrals: by slot of the memory, as they are without this.
            updates: of the estimates; see `updates`.
            gains: K_I by axis, as an expression of `followed`.
        """
        found = {}
        for axis, gain in gains.items():
            name, followed = f"integral.{axis}", estimate_slot("followed", axis)
            if name in integrals:
                after = ca.substitute(gain, self.followed(axis), updates[followed])
                found[name] = integrals[name] * gain / after
        return found

    def outputs(self) -> ca.SX:
        """The numbers of `ports.ESTIMATE`; none in a task that estimates nothing."""
        if not self._task.estimates:
            return ca.SX(0, 1)
        parameters, rows = self._measurement.parameters, {}
        for name in _CARRIED:
            rows[name] = ca.SX(parameters.symbol(f"carried.{name}"))
        nobody = rows["stiffness_of"] == 0
        for name in ESTIMATED.values():
            rows[name] = ca.if_else(nobody, ca.SX.nan(6), rows[name])
        for axis, state in self._state.items():
            i = AXES.index(axis)
            rows["stiffness"][i] = state["found"]
            rows["stiffness_deviation"][i] = state["deviation"]
            rows["stiffness_followed"][i] = ca.exp(state["followed"])
            rows["stiffness_of"][i] = self._plan.estimates.numbered(axis)
        return ca.vertcat(*rows.values())

    def begun(self, handed: Mapping[str, ca.SX]) -> tuple[dict[str, ca.SX], dict[str, ca.SX]]:
        """Memory and parameters as the stage begins, by slot.

        An axis goes on with what was estimated on the same object, within the bounds of this
        stage; else it begins with what the file declares.

        Args:
            handed: the numbers of `ports.handed_of`.
        """
        memory: dict[str, ca.SX] = {}
        for axis, each in self._plan.estimates.axes.items():
            i, number = AXES.index(axis), self._plan.estimates.numbered(axis)
            same = handed["stiffness_of"][i] == number
            found, followed = (
                choice(same, ca.fmin(ca.fmax(handed[name][i], each.low), each.high),
                       ca.SX(each.declared))
                for name in ("stiffness", "stiffness_followed")
            )  # fmt: skip
            deviation = choice(same, handed["stiffness_deviation"][i], ca.SX(each.undecided))
            state = each.begun(found, deviation, followed)
            memory |= {estimate_slot(name, axis): value for name, value in state.items()}
        if not self._task.estimates:
            return {}, {}
        return memory, {f"carried.{name}": handed[name] for name in _CARRIED}
