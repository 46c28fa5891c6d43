"""Admittance control: the arm moves as a mass, spring and damper would by the measured force."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

from taskspec.control.command import Command
from taskspec.deferred import ca
from taskspec.laws import design, energy
from taskspec.laws.gains import (
    BANDWIDTH,
    DAMPING,
    DEAD_BAND,
    K_V,
    MASS,
    STIFFNESS,
    AxisDesign,
    Gain,
)
from taskspec.laws.law import ControlLaw, register

if TYPE_CHECKING:
    from taskspec.geometry.axis import Axis
    from taskspec.laws.case import Case
    from taskspec.laws.energy import Energy


@register
class Admittance(ControlLaw):
    """The dual of impedance, for an arm that takes velocities or positions.

    Force and soft axes:  M x'' + D x' + K (x - x_d) = f - f_d, K = 0 on a force axis, integrated
        once a period with damper and spring taken at its end; x' is against the reference.
    Motion axes:          x' = x'_d + w e, w = 2 pi bandwidth.

    With a dead band b, f - f_d counts by what it exceeds b: a sensor's bias below b moves nothing.
    The spring is that of the measured position, so that it comes to rest where K e = f_d - f
    whatever the servo has lost.
    """

    kind = "admittance"
    title = "admittance control"
    equations = "M x'' + D x' + K x = f - f_d"
    gains = (BANDWIDTH, MASS, DAMPING, DEAD_BAND)
    derived = (K_V, STIFFNESS)
    commands = "velocity"
    dual = "hybrid"
    following: ClassVar[Mapping[str, Mapping[str, float]]] = {"damping": {"mass": 1}}
    force_loop = True
    follows = ("mass", "damping")
    selects = True
    rest = "K e of the soft axis"
    storage = "1/2 e'^T M e' + 1/2 e^T K e of force and soft axes"

    def design(self, axis: AxisDesign) -> dict[str, Gain]:
        """M, D and K of a force axis or a soft one; the bandwidth of others."""
        return design.admittance(self, axis)

    def command(self, case: Case) -> Command:
        """The velocity of each axis, and the memory of those that have a mass."""
        state, reference = case.state, case.reference
        velocity = reference.velocity + case.diagonal("K_V") * reference.error
        kept: dict[str, ca.SX] = {}
        for axis in (*case.force, *case.soft):
            i = state.axes.index(axis)
            rate = case.kept(axis, case.remembered(slot(axis)))
            kept[slot(axis)] = moved = self._rate(case, axis, rate)
            velocity[i] = reference.velocity[i] + moved
        return Command(wrench=0 * state.f, velocity=velocity, memory=kept)

    def _rate(self, case: Case, axis: Axis, rate: ca.SX) -> ca.SX:
        """x' against the reference after one more period."""
        state, reference, T = case.state, case.reference, case.period
        M, D = case.gain("mass", axis), case.gain("damping", axis)
        K = case.gain("stiffness", axis)
        pull = _pull(case, axis) + K * reference.error[state.axes.index(axis)]
        return (M * rate + T * pull) / (M + T * D + T**2 * K)

    def energy(self, case: Case) -> Energy:
        """Of the masses and springs that it has the arm move as."""
        axes = (*case.force, *case.soft)
        added = 0 * case.state.f
        for axis in axes:
            i = case.state.axes.index(axis)
            added[i] = case.state.f[i] - _pull(case, axis)
        return energy.of_a_mass(case, axes, added)

    def unreturned(self, gains: Mapping[str, float]) -> float:  # noqa: ARG002
        """Of the set point alone: it has no integral."""
        return 1.0

    def loop_damping(self, gains: Mapping[str, float]) -> float:
        """D of the axis [N s/m]."""
        return gains.get("damping", 0.0)


def _pull(case: Case, axis: Axis) -> ca.SX:
    """f - f_d by what it exceeds the dead band [N, N m]."""
    i = case.state.axes.index(axis)
    wanted = case.reference.force if axis in case.force else case.reference.released
    return beyond(case.state.f[i] - wanted[i], case.gains.get("dead_band", {}).get(axis))


def beyond(force: ca.SX, band: Gain | None) -> ca.SX:
    """By how much a force exceeds a dead band; all of it where there is none [N, N m]."""
    if band is None:
        return force
    return ca.if_else(ca.fabs(force) < band.value, 0, force - ca.sign(force) * band.value)


def slot(axis: Axis) -> str:
    """The slot of the memory with the velocity of an axis against its reference."""
    return f"admitted.{axis}"
