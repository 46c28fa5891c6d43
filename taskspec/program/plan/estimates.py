"""The contact stiffness that a stage estimates along its force axes, and the gains for it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cached_property, partial

from taskspec.geometry.axis import Axis
from taskspec.laws.contact_stiffness import ContactStiffness, Schedule, knots, schedules
from taskspec.laws.gains import Gains
from taskspec.laws.law import gain_named
from taskspec.program.context import Context
from taskspec.program.plan.contacts import StageContacts
from taskspec.program.plan.design import DesignRules
from taskspec.program.plan.environment import StageEnvironment
from taskspec.program.reference.axis_plan import AxisPlan
from taskspec.program.world.frames import FrameModel
from taskspec.spec import Law
from taskspec.text.units import TIME, scaled

#: A change of the force is one beyond so many standard deviations of a reading.
DEAD_ZONE = 5.0
#: The least dead zone that is taken where the file states none [N].
_LEAST = 0.2


class StageEstimates:
    """What a stage estimates, as far as it can."""

    def __init__(
        self,
        context: Context,
        law: Law,
        frame: FrameModel,
        contacts: StageContacts,
        environment: StageEnvironment,
        rules: DesignRules,
        plans: Mapping[Axis, AxisPlan],
    ) -> None:
        """Of a stage.

        Args:
            context: sensor, objects and period of the task.
            law: of the stage.
            frame: of it.
            contacts: what it presses on.
            environment: what that returns.
            rules: of its law's gains.
            plans: who controls each of its axes.
        """
        self._context, self._law, self._frame = context, law, frame
        self._contacts, self._environment = contacts, environment
        self._rules, self._plans = rules, plans

    @cached_property
    def named(self) -> dict[Axis, tuple[str, ...]]:
        """Force axes with the designed gains that are to follow what is estimated there."""
        found = {a: self._law.following(plan.axis, a) for a, plan in self._plans.items()}
        return {axis: names for axis, names in found.items() if names and self._plans[axis].force}

    def refused(self, axis: Axis) -> str:
        """Why the stiffness along a force axis cannot be estimated; empty where it can."""
        name = self._contacts.of(axis)
        if self._contacts.gripped:
            return "what the robot holds returns the force, through its grip"
        if self._law.matrices:
            return "gains of its law couple axes, or vary by themselves"
        if self._frame.tracking is not None:
            return f"frame {self._frame.name!r} turns with what it tracks, and the axis with it"
        if name is None or name not in self._context.surfaces:
            return "no object of the world returns its force"
        if self._environment.springs(axis):
            return "a bushing returns a part of its force"
        return ""

    @cached_property
    def axes(self) -> dict[Axis, ContactStiffness]:
        """The estimate along each axis that has one."""
        estimate = self._law.estimate
        if estimate is None:
            return {}
        context, found = self._context, {}
        noise = context.loaded.task.robot.sensor.noise
        sigma = 0.0 if noise is None else noise.force
        dead_zone = estimate.dead_zone or max(DEAD_ZONE * sigma, _LEAST)
        low, high = estimate.stiffness
        for axis in self.named:
            if self.refused(axis):
                continue
            contact = self._environment.returns(axis)
            found[axis] = ContactStiffness(
                low=low,
                high=high,
                declared=min(max(contact.k, low), high),
                damping=contact.d,
                noise=dead_zone / DEAD_ZONE,
                dead_zone=dead_zone,
                memory=estimate.memory,
                rate=estimate.rate,
                period=context.period,
            )
        return found

    def numbered(self, axis: Axis) -> float:
        """The number of the object that an axis presses on, from 1 on; 0 for none."""
        names, name = list(self._context.loaded.task.world), self._contacts.of(axis)
        return float(names.index(name) + 1) if name in names else 0.0

    @cached_property
    def schedules(self) -> dict[Axis, dict[str, Schedule]]:
        """How the gains of an axis follow the stiffness there."""
        return {
            axis: schedules(
                partial(self._designed, axis),
                knots(each.low, each.high, [each.declared]),
                self.named[axis],
            )
            for axis, each in self.axes.items()
        }

    def gains(self, gains: Gains, stiffness: Mapping[Axis, float]) -> Gains:
        """Gains of the stage with those in them that follow other stiffnesses [N/m]."""
        found = {name: {**by_axis} for name, by_axis in gains.items()}
        for axis in self.axes.keys() & stiffness.keys():
            each = self.axes[axis]
            k = min(max(stiffness[axis], each.low), each.high)
            for name, schedule in self.schedules[axis].items():
                found[name][axis] = replace(found[name][axis], value=schedule.value(k))
        return found

    def rows(self) -> Iterator[tuple[str, str]]:
        """What it estimates along each axis, and the gains that follow."""
        for axis, each in self.axes.items():
            yield f"estimates {axis}", each.words
            ends = {
                name: [
                    gain_named(name).text(value, angular=axis.is_rotation)
                    for value in sorted({schedule.value(each.low), schedule.value(each.high)})
                ]
                for name, schedule in self.schedules[axis].items()
            }
            follow = ", ".join(f"{name} {' to '.join(values)}" for name, values in ends.items())
            at_once = f"there {scaled(each.settling, TIME, 3)} after it is found at the latest"
            yield f"follow {axis}", f"{follow or 'no gains'}; {at_once}"

    def _designed(self, axis: Axis, stiffness: float) -> dict[str, float]:
        return {name: gain.value for name, gain in self._rules.along(axis, stiffness).items()}
