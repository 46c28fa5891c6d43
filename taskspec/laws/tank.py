"""The energy tank: what a law may put into the arm beyond a spring that stays and its dampers.

With e = x_d - x, K the stiffness and D the damping of the law, u its torque and g gravity,

    u_tank = g + r J^T K e - J^T D x' + s u_a,        u_a = u - g - J^T K e + J^T D x'

with shares r and s of 0 to 1. With both at 1 that is u; what stays of it is PD control (4.21).

Arm, spring and tank store V = 1/2 q'^T H q' + r 1/2 e^T K e + T. In port-Hamiltonian form the arm
gets from the tank, through a transformer of ratio s u_a, what it loses in nothing else:

    d/dt (1/2 q'^T H q' + r 1/2 e^T K e) = f.x' - x'^T D x' + P,    T' = x'^T D x' - P

P is the power of all that is not passive: a reference that moves and gains that vary stretch the
spring, set points and errors of forces, their integrals, feed-forward, an apparent mass other than
the arm's, a goal in the null space are s u_a.q'. So V' <= f.x' whatever these are: the arm is
passive at its contact, and no more than V(0) leaves there (Ferraguti, Secchi and Fantuzzi 2013;
Schindlbeck and Haddadin 2015). T is full at its capacity; what dampers take then is lost.

In ticks of a period h the torque is held, and the account is made of what was (Franken et al.
2011): with W = h (u - g).(q'[k-1] + q'[k])/2 of the torque that was commanded,

    E = T[k-1] + r[k-1] U[k-1] - W,    U = 1/2 e^T K e,    r = min(1, E / U),    T[k] = E - r U

so that sampling, limits and what a stage carries on are paid for, too. The shares r and s make
r U <= E, s u_a.q' <= T / 20 ms, and s <= T / (0.05 C) at a capacity C: the valve closes before the
tank is empty.

A limit on the power keeps P <= P_max: r U <= r[k-1] U[k-1] - W_a + h P_max, and s u_a.q' <= P_max
beside what stretches the spring. Led by a force along one axis against its damper d, an arm that
starts from rest then has v <= sqrt(P_max / d).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from taskspec.deferred import ca
from taskspec.deferred_methods import dataclass

if TYPE_CHECKING:
    from taskspec.laws.case import Case
    from taskspec.laws.law import ControlLaw

#: Time in which what the law asks for may empty the tank [s]: at that rate its valve begins to
#: close.
_CLOSING = 0.02
#: Below this share of its capacity the valve closes, whether power goes out or comes in: else
#: what is refused one way and let through the other would rattle.
_LOW = 0.05
#: Less is nothing [J, W].
_NOTHING = 1e-300

#: What a tick of it gives, in this order; see `TankStep.outputs`.
OUTPUTS = ("energy", "power", "filled", "spring", "share", "refused", "stretched")
#: Slots of the memory.
ENERGY, STATE, SHARE = "tank.energy", "tank.state", "tank.share"
_SPRING, _HELD, _GIVEN = "tank.stretched", "tank.spring", "tank.given"
_VELOCITY, _GRAVITY, _DAMPER = "tank.velocity", "tank.gravity", "tank.damper"
_PUSHED = "tank.pushed"
#: What `STATE` says: it begins with its own start, with what is handed on, or it goes on.
FRESH, HANDED_ON, RUNNING = 0.0, 1.0, 2.0


def misfit(law: ControlLaw) -> str:
    """Why a law takes no tank; empty where it takes one."""
    if law.commands != "torque":
        return "it commands velocities, and what the drives put in to reach them is not known"
    if law.bare:
        return "it damps nothing, so that nothing fills a tank"
    if not law.storage or law.selects:
        return "it has no spring and no damper, which stay when a tank is empty"
    return ""


@dataclass(frozen=True, slots=True)
class TankStep:
    """One tick of a tank.

    Attributes:
        torque: (n,) that it lets through [N m].
        outputs: (7,) what is in it [J], the power that left it over the last period for what is
            not passive, and that dampers gave it [W], the shares r and s, what is refused of the
            one of which that is more, and r U [J].
        memory: of the tick after, by slot.
    """

    torque: ca.SX
    outputs: ca.SX
    memory: Mapping[str, ca.SX]

    def named(self) -> dict[str, ca.SX]:
        """Its signals by name."""
        return {f"tank.{name}": self.outputs[i] for i, name in enumerate(OUTPUTS)}


@dataclass(frozen=True, slots=True)
class EnergyTank:
    """A tank of a stage's law.

    Attributes:
        capacity: the most that it holds [J].
        power: the most that leaves it [W]; infinite without a limit.
    """

    capacity: float
    power: float = math.inf

    def step(
        self,
        case: Case,
        torque: ca.SX,
        gravity: ca.SX,
        last: ca.SX,
        remembered: Callable[[str, int], ca.SX],
        law: ControlLaw,
    ) -> TankStep:
        """One tick.

        Args:
            case: the stage.
            torque: (n,) u of the law, with what it carries on [N m].
            gravity: (n,) g [N m].
            last: (n,) what was commanded in the tick before [N m].
            remembered: a slot of the memory, by name and length.
            law: of the stage.
        """
        # Loaded here: it needs CasADi, which a file that is only read does not.
        from taskspec.control import linear

        n, h, v = torque.shape[0], case.period, case.joint_velocity
        before, state = remembered(ENERGY, 1), remembered(STATE, 1)
        stretched, held_before, given = (remembered(s, 1) for s in (_SPRING, _HELD, _GIVEN))
        v_before, g_before, damped, before_it = (
            remembered(slot, n) for slot in (_VELOCITY, _GRAVITY, _DAMPER, _PUSHED)
        )
        runs = ca.if_else(state > HANDED_ON, 1.0, 0.0)
        pull = case.times("stiffness", case.reference.error)
        spring, damper = case.state.J.T @ pull, _damper(case, law)
        active = torque - gravity - spring - damper

        # What the commanded torque did over the last period, and what of it the damper took.
        over = runs * h * (v_before + v) / 2
        work = ca.dot(last - (g_before + gravity) / 2, over)
        dissipated = -ca.dot(damped, over)
        U = ca.dot(pull, case.reference.error) / 2
        first = before + ca.if_else(state < HANDED_ON, U, 0.0)
        there = ca.if_else(state > HANDED_ON, before + stretched - work, first)
        # The spring as it would be, had neither its reference moved nor its stiffness changed.
        left = stretched - work - dissipated
        allowed = ca.fmax(there, 0)
        if math.isfinite(self.power):
            rise = ca.fmax(left + h * self.power, 0)
            allowed = ca.if_else(state > HANDED_ON, ca.fmin(allowed, rise), allowed)
        granted = ca.fmin(U, allowed)
        held = ca.if_else(allowed < U, allowed / ca.fmax(U, _NOTHING), 1.0)
        energy = ca.fmin(there - granted, self.capacity)
        left_it = runs * (before + dissipated - (there - granted)) / h

        # u_a' = s u_a does s (b + c s) over the next period: without it, the arm would go on as it
        # did without the last one.
        pushed = linear.forward(case.state.H_factor, active)
        requested = (
            ca.dot(active, v + runs * (v - v_before) / 2) - h * ca.dot(pushed, before_it) / 2
        )
        own, free = h * ca.sumsqr(pushed) / 2, ca.fmax(energy, 0)
        share = ca.fmin(1, free / (_LOW * self.capacity))
        share = ca.fmin(share, _within(free / _CLOSING, requested, own))
        if math.isfinite(self.power):
            pulled = runs * ca.fmax(held_before * U - left - given, 0) / h
            share = ca.fmin(share, _within(ca.SX(self.power), requested + pulled, own))
        return TankStep(
            torque=gravity + held * spring + damper + share * active,
            outputs=ca.vertcat(
                *(energy, left_it, dissipated / h, held, share, 1 - ca.fmin(held, share), granted)
            ),
            memory={
                ENERGY: energy,
                STATE: ca.SX(RUNNING),
                _SPRING: granted,
                _HELD: held,
                SHARE: share,
                _GIVEN: h * share * (requested + own * share),
                _PUSHED: share * pushed,
                _VELOCITY: v,
                _GRAVITY: gravity,
                _DAMPER: damper,
            },
        )

    def first_contact(self, damping: float, mass: float, stiffness: float, damper: float) -> float:
        """The most power that a surface takes at the first contact along an axis [W].

        An arm that starts from rest meets it with m v^2 / 2 <= m P / (2 d). Over the quarter of an
        oscillation w = sqrt(k / m) after that, tool and surface store at most P pi / (2 w) more,
        and a mass m and a spring k that share S exchange at most w S:

            -f.x' <= w (m P / (2 d) + P pi / (2 w)) + d_e P / d
                   = P ((sqrt(k m) / 2 + d_e) / d + pi / 2)

        Args:
            damping: d of the law along the axis [N s/m].
            mass: m of the arm along it [kg].
            stiffness, damper: k [N/m] and d_e [N s/m] of the surface.
        """
        meeting = (math.sqrt(stiffness * mass) / 2 + damper) / damping
        return self.power * (meeting + math.pi / 2)

    def speed(self, damping: float) -> float:
        """sqrt(P / d): the most that an arm comes to from rest along an axis [m/s]."""
        return math.sqrt(self.power / damping)


def _within(power: ca.SX, requested: ca.SX, own: ca.SX) -> ca.SX:
    """The greatest s with s (requested + own s) <= power, own not negative [W]."""
    root = ca.sqrt(requested**2 + 4 * own * power)
    return 2 * power / ca.fmax(requested + root, _NOTHING)


def _damper(case: Case, law: ControlLaw) -> ca.SX:
    """(n,) the torque of the law's dampers against the arm's own velocity [N m].

    That of a law with an apparent mass may be more than the arm's own bears in a period: it is
    (D^-1 + h Lambda^-1)^-1 = D - D (D + Lambda / h)^-1 D, which takes energy at any period.
    """
    if law.damps_joints:
        return -case.of_joints("joint_damping") * case.joint_velocity
    state = case.state
    velocity = state.velocity if case.carried is None else state.J @ case.joint_velocity
    push = case.times("damping", velocity)
    if not law.natural:
        from taskspec.control import linear

        m = len(state.axes)
        inertia = linear.solve(linear.cholesky(state.mobility), ca.SX.eye(m))
        whole = linear.cholesky(case.matrix("damping") + inertia / case.period)
        push -= case.times("damping", linear.solve(whole, push))
    return -state.J.T @ push
