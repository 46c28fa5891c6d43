"""Hinges, slides and screws with their handles: one coordinate each, and what acts on it.

Damping, friction and stops are the joint's own. A detent is applied as a generalised force at the
coordinate of the step's beginning.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import casadi as ca
import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.program.bound import Wiring
from taskspec.spec import Mechanism
from taskspec_runner.plant.dry_friction import set_friction
from taskspec_runner.plant.names import KNOB, PREFIX, placed, weightless

Vector = NDArray[np.float64]

#: Of a free knob; its share of the mechanism's own inertia is negligible.
KNOB_MASS, KNOB_INERTIA = 1e-6, 1e-6
#: A body that only turns weighs this [kg], on its axis.
_TURNING_MASS = 1e-3
#: A stop turns a motion back within a few steps, almost as a rigid wall would.
_STOP_IMPEDANCE, _STOP_STEPS, _STOP_DAMPING = 0.99, 3.0, 2.0
#: The thread of a screw: as rigid as MuJoCo makes a constraint.
_THREAD_IMPEDANCE, _THREAD_STEPS = 0.9999, 2.0


def add_mechanism(spec: mujoco.MjSpec, name: str, declared: Mechanism, period: float) -> None:
    """Adds a mechanism as a body on the world, with a knob of its own where that is free.

    Args:
        spec: to add to.
        name: of the object.
        declared: as the file has it.
        period: step of the plant [s].
    """
    body = spec.worldbody.add_body(name=PREFIX + name, **placed(declared))
    inertia = getattr(declared, "inertia", 1.0)
    weightless(body, getattr(declared, "mass", _TURNING_MASS), inertia)
    kinds = {"hinge": ["turn"], "slide": ["shift"], "screw": ["shift", "turn"]}
    for kind in kinds[declared.mechanism]:
        _add_joint(body, f"{PREFIX}{name}/{kind}", slides=kind == "shift")
    coordinate = spec.joint(coordinate_joint(name, declared))
    coordinate.damping = [declared.damping, 0.0, 0.0]
    set_friction(coordinate, declared.friction, period)
    if declared.stop is not None:
        coordinate.limited = True
        coordinate.range = list(declared.stop)
        coordinate.solimp_limit = [_STOP_IMPEDANCE, _STOP_IMPEDANCE, 0.001, 0.5, 2.0]
        coordinate.solref_limit = [_STOP_STEPS * period, _STOP_DAMPING]
    if declared.knob == "free":
        knob = body.add_body(name=PREFIX + name + KNOB, pos=list(declared.handle))
        weightless(knob, KNOB_MASS, KNOB_INERTIA)
        _add_joint(knob, f"{PREFIX}{name}{KNOB}", slides=False)


def _add_joint(body: mujoco.MjsBody, name: str, *, slides: bool) -> None:
    kind = mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE
    body.add_joint(name=name, type=kind, axis=[0.0, 0.0, 1.0])


def add_thread(spec: mujoco.MjSpec, name: str, lead: float, period: float) -> None:
    """Couples a screw's travel to its angle: a tendon keeps travel less lead times angle.

    A tendon's constraint is as rigid as its true inverse weight makes it; that of two joints adds
    theirs as if the lead were 1.
    """
    tendon = spec.add_tendon(name=f"{PREFIX}{name}/thread")
    tendon.wrap_joint(f"{PREFIX}{name}/shift", 1.0)
    tendon.wrap_joint(f"{PREFIX}{name}/turn", -lead)
    thread = spec.add_equality(
        name=f"{PREFIX}{name}/thread",
        type=mujoco.mjtEq.mjEQ_TENDON,
        objtype=mujoco.mjtObj.mjOBJ_TENDON,
        name1=f"{PREFIX}{name}/thread",
    )
    thread.solimp = [_THREAD_IMPEDANCE, _THREAD_IMPEDANCE, 0.001, 0.5, 2.0]
    thread.solref = [_THREAD_STEPS * period, 1.0]


def coordinate_joint(name: str, declared: Mechanism) -> str:
    """The joint whose position is the mechanism's coordinate."""
    return f"{PREFIX}{name}/{'turn' if declared.angular else 'shift'}"


class Mechanisms:
    """Coordinates of all mechanisms of a scene, and the detents that act on them.

    Attributes:
        positions, dofs: where each coordinate is in `qpos`, its rate in `qvel`.
        detents: writes the forces of the detents, F sin(pi (s - at) / width) within the width of
            each; None where there are none.
        detent_forces: (detents,) [N m, N].
        detent_dofs: where each of them acts among the degrees of freedom.
    """

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, declared: Mapping[str, Mechanism]
    ) -> None:
        joints = [model.joint(coordinate_joint(n, m)).id for n, m in declared.items()]
        self._qpos, self._qvel = data.qpos, data.qvel
        self.positions = np.array(model.jnt_qposadr[joints], dtype=int)
        self.dofs = np.array(model.jnt_dofadr[joints], dtype=int)
        self._applied = data.qfrc_applied
        with_detent = [i for i, m in enumerate(declared.values()) if m.detent is not None]
        self.detent_dofs = self.dofs[with_detent]
        self.detent_forces: Vector = np.zeros(len(with_detent))
        self.detents = None
        if with_detent:
            wiring = Wiring()
            places = wiring.reads("qpos", data.qpos)[self.positions[with_detent].tolist()]
            found = [m.detent for m in declared.values() if m.detent is not None]
            at, width, force = (
                wiring.numbers(name, *(getattr(detent, name) for detent in found))
                for name in ("at", "width", "force")
            )
            away = (places - at) / width
            wiring.writes(
                ca.if_else(ca.fabs(away) < 1, force * ca.sin(math.pi * away), 0), self.detent_forces
            )
            self.detents = wiring.bound("detents")

    def read(self, positions: Vector, rates: Vector) -> None:
        """Writes all coordinates [rad, m] and their rates, in the order of the file."""
        positions[:] = self._qpos[self.positions]
        rates[:] = self._qvel[self.dofs]

    def apply(self) -> None:
        """Adds the forces of the detents."""
        if self.detents is not None:
            self.detents.evaluate()
            self._applied[self.detent_dofs] += self.detent_forces
