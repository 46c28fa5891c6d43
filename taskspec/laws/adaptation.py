"""Adaptation to a payload: base parameters estimated from what the model of the arm leaves open.

A payload of mass m at c in the tool's axes acts on the arm by its base parameters

    theta = (m, h),    h = m c,

its mass and first moments (`robot.base_parameters`), in which the wrench that it exerts on the tip
is linear (Slotine and Li 1987). In world axes, with the tip's acceleration a against free fall, its
angular velocity w and acceleration w', and the tool's axes R,

    w_p = Y theta,    Y = [ -a   -([w']_x + [w]_x [w]_x) R ]
                          [  0    [a]_x R                  ].

At rest a = -g, and Y theta is the weight, m g at c.

What the model leaves open is the prediction error of Slotine and Li's composite adaptation (1989):
the arm with H, C q' + g and the torques u of the period accelerates by q'' (the change of q' over
it) under the measured contact wrench f and the payload alone where

    y = A theta,    y = N_u (H q'' + C q' + g - u) - N f,    A = N Y,
    N_u = (J H^-1 J^T + mu)^-1 J H^-1,    N = N_u J^T,

with J on the axes that the arm moves. N is 1 but near singular poses, where mu keeps it small.
Both sides go through the same low-pass, so that y_f = A_f theta as well, and

    theta' = w / |g|^2  A_f^T dz(y_f - A_f theta),    w = 2 pi bandwidth,

each component less the dead zone, then within its bounds. Moments count over a length l there, as
forces, and so do first moments, as masses: else an angular acceleration would have the force of a
mass that is not known yet move the centre more than its moments do.

Stability. Whatever law moves the arm, and whatever it is disturbed by, as long as each component of
the disturbance stays within the dead zone: V = 1/2 |theta - theta*|^2, with first moments over l,
never rises. An error e and its dz(e) have the same sign, and that of A_f (theta* - theta) where dz
is not 0; nor does the projection raise V, as theta* is within the bounds. Nothing of theta that A_f
does not show drifts.
Directions that it shows fall exponentially while the Gramian, the mean of A_f^T A_f / |g|^2 over a
window, has an eigenvalue lambda > 0 there: as exp(-lambda w t). At rest that is 1 for the mass and
for moments across gravity, and 0 for that along it, which no weight shows. So at rest

    |m - m*| <= z / |g| + (|m_0 - m*| - (1 - c) z / |g|) exp(-w tau(t)),
    tau(t) = t - 2 (1 - exp(-F w t)) / (F w) + (1 - exp(-2 F w t)) / (2 F w),

with the dead zone z and the filter's corner at F w. Its start a = 1 - exp(-F w t) costs 1.5 / (F w)
of time, tau being the integral of a^2. It shrinks the error before the dead zone, too, which is
z / a then: c = F / ((F - 1) (2 F - 1)) is the integral of w (a - a^2) exp(w t).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from taskspec.control import linear
from taskspec.deferred import ca
from taskspec.deferred_methods import dataclass
from taskspec.text.units import FORCE, LENGTH, TIME, grams, scaled, show

Matrix = NDArray[np.float64]

#: Base parameters: mass, and first moments along the tool's axes.
PARAMETERS = ("mass", "x", "y", "z")
#: Corner of the low-pass over the bandwidth of the estimate.
FILTER = 5.0
#: Of the dead zone's mass, what the start of the low-pass leaves for longer.
_FIRST = FILTER / ((FILTER - 1) * (2 * FILTER - 1))
#: The length l: moments over it count as forces, first moments over it as masses [m].
LEVER = 0.1
#: A mobility [1/kg, 1/(kg m^2)] that is small beside that of an arm which is not singular.
_DAMPED = 1e-4
#: What a parameter is that counts as 1 kg [kg, kg m].
SCALES = (1.0, LEVER, LEVER, LEVER)
#: Of a parameter of whose error less than this share is gone, nothing is known.
SHOWN = 0.5
#: A Gramian with less than this in one direction says nothing of what lies in it.
_SINGULAR = 1e-6
#: Forces and moments on the tip that a payload shows in.
_COMPONENTS = 6
#: An eigenvalue of a Gramian below this is none.
_ROUNDING = 1e-12
#: Below this mass a payload has no centre [kg].
_LIGHT = 1e-3


class ArmTerms(Protocol):
    """The model terms of an arm, as `robot.model_terms.TermSymbols` has them."""

    @property
    def H(self) -> ca.SX:  # noqa: N802
        """(n, n) joint inertia."""

    @property
    def bias(self) -> ca.SX:
        """(n,) C q' + g."""

    @property
    def R(self) -> ca.SX:  # noqa: N802
        """(3, 3) axes of the tip in the world."""

    @property
    def J(self) -> ca.SX:  # noqa: N802
        """(6, n) Jacobian of the tip, world axes."""

    @property
    def drift(self) -> ca.SX:
        """(6,) J' q'."""

    @property
    def twist(self) -> ca.SX:
        """(6,) J q'."""


class PointLoad(NamedTuple):
    """A payload as a point: its mass [kg], and its place in the tool's axes (3,) [m]."""

    mass: ca.SX
    centre: ca.SX


@dataclass(frozen=True, slots=True)
class Adaptation:
    """How an arm adapts to a payload.

    Attributes:
        low, high: bounds of its mass [kg].
        reach: bound of its centre along each axis [m].
        w: of the estimate [rad/s].
        dead_zone: of forces [N].
        inertia: whether its inertia joins the model, or its weight alone.
        gravity: (3,) of the world [m/s^2].
        period: of control [s].
    """

    low: float
    high: float
    reach: float
    w: float
    dead_zone: float
    inertia: bool
    gravity: tuple[float, float, float]
    period: float

    @property
    def g(self) -> float:
        """|g| [m/s^2]."""
        return math.sqrt(sum(x * x for x in self.gravity))

    @property
    def start(self) -> tuple[float, ...]:
        """The estimate that a run begins with: as light as may be, at the tip."""
        return (self.low, 0.0, 0.0, 0.0)

    def but(self, w: float) -> Adaptation:
        """The same with another w [rad/s]."""
        return replace(self, w=w)

    # The model

    def model(self, theta: ca.SX) -> PointLoad:
        """The payload that base parameters (4,) stand for, its centre within reach."""
        centre = theta[1:] / ca.fmax(theta[0], _LIGHT)
        return PointLoad(theta[0], ca.fmin(ca.fmax(centre, -self.reach), self.reach))

    @staticmethod
    def weight(load: PointLoad, down: ca.SX) -> ca.SX:
        """(6,) of the payload about the tip under gravity `down` (3,), in the tool's axes."""
        force = load.mass * down
        return ca.vertcat(force, ca.cross(load.centre, force))

    # The estimate

    def regression(
        self, terms: ArmTerms, rows: list[int], acceleration: ca.SX, torque: ca.SX, wrench: ca.SX
    ) -> tuple[ca.SX, ca.SX]:
        """y (k,), A (k, 4) of the k axes that the arm moves.

        Args:
            terms: without the payload.
            rows: numbers of these axes among the six of the world.
            acceleration: (n,) q'' of the period before.
            torque: (n,) that were commanded in it.
            wrench: (6,) by the contact on the tip, world axes [N, N m].
        """
        L, J = linear.cholesky(terms.H), terms.J[rows, :]
        X, left = linear.forward(L, terms.J.T), terms.H @ acceleration + terms.bias - torque
        mobility = X[:, rows].T @ X[:, rows] + _DAMPED * ca.SX.eye(len(rows))
        by_mobility = linear.cholesky(mobility)
        N = linear.solve(by_mobility, X[:, rows].T @ X)
        open_ = linear.solve(by_mobility, J @ linear.solve(L, left))
        tip = terms.J @ acceleration + terms.drift
        Y = regressor(tip[:3] - ca.DM(self.gravity), terms.twist[3:], tip[3:], terms.R)
        return open_ - N @ wrench, N @ Y

    def step(self, theta: ca.SX, y: ca.SX, A: ca.SX, rows: list[int]) -> ca.SX:
        """theta (4,) a period later, by the filtered y (k,) and A (k, 4)."""
        W, S = ca.DM(counted(rows)), ca.DM(SCALES)
        zone = self.dead_zone
        error = W * (y - A @ theta)
        beyond = error - ca.fmin(ca.fmax(error, -zone), zone)
        moved = S * (S * (A.T @ (W * beyond)))
        share = -math.expm1(-self.w * self.period) / self.g**2
        most = self.high * self.reach
        high = ca.DM([self.high, most, most, most])
        low = ca.DM([self.low, -most, -most, -most])
        return ca.fmin(ca.fmax(theta + share * moved, low), high)

    @property
    def passed(self) -> float:
        """The share of a new value that the low-pass takes in a period."""
        return -math.expm1(-FILTER * self.w * self.period)

    # What it promises

    def elapsed(self, t: Matrix) -> Matrix:
        """(k,) tau(t): times t [s] less what the start of the filter costs."""
        corner = FILTER * self.w
        begun = np.expm1(-corner * t)
        return np.asarray(t + 2 * begun / corner - np.expm1(-2 * corner * t) / (2 * corner))

    def bound(self, t: Matrix, error: float) -> Matrix:
        """(k,) bound of an error of the mass at rest [kg], t [s] after it was `error`."""
        left, begun = self.dead_zone / self.g, max(abs(error), self.dead_zone / self.g)
        falling = (begun - (1 - _FIRST) * left) * np.exp(-self.w * self.elapsed(t))
        return np.minimum(begun, left + falling)

    def time_to(self, error: float, start: float) -> float:
        """Time in which an error of the mass [kg] at rest falls to another [s]; inf for never."""
        left = self.dead_zone / self.g
        if abs(start) <= error:
            return 0.0
        if error <= left:
            return math.inf
        begun = abs(start) - (1 - _FIRST) * left
        return (math.log(begun / (error - left)) + 1.5 / FILTER) / self.w

    def shown(self, gramian: Matrix, time: float) -> Matrix:
        """(4,) the share of an error of each parameter alone that is gone after a time.

        Along an eigenvector of the Gramian with the eigenvalue lambda, exp(-lambda w t) of an error
        is left: 1 - [exp(-w t G)]_ii.

        Args:
            gramian: (4, 4) G, the mean of A^T A / |g|^2 over the time, by `gramian`.
            time: t [s].
        """
        values, vectors = np.linalg.eigh(gramian)
        # What rounding makes of 0 is no excitation, however long it lasts.
        values = np.where(values > _ROUNDING, values, 0.0)
        with np.errstate(invalid="ignore"):
            left = np.where(values > 0, np.exp(-self.w * time * values), 1.0)
        return np.asarray(1 - np.diag((vectors * left) @ vectors.T))

    def within(self, shows: Matrix, known: Sequence[float]) -> tuple[float, ...] | None:
        """What the dead zone may leave of mass and centre [kg, m]; None where it may be all of it.

        Where all components of A theta~, m of them, are within z, theta~^T G theta~ <=
        m (z / |g|)^2, so that of one parameter sqrt(m [G^-1]_ii) z / |g| is left. What disturbs
        more leaves more. A centre has the share of its first moment and that of the mass.

        Args:
            shows: (4, 4) the Gramian G, see `gramian`.
            known: mass and centre.
        """
        values, vectors = np.linalg.eigh(shows)
        mass, *centre = known
        if values[0] < _SINGULAR or mass < _LIGHT:
            return None
        spread = np.sqrt(_COMPONENTS * np.diag((vectors / values) @ vectors.T))
        of_mass, *moments = (spread * np.asarray(SCALES) * self.dead_zone / self.g).tolist()
        of_centre = [(h + abs(c) * of_mass) / mass for c, h in zip(centre, moments, strict=True)]
        return (of_mass, *of_centre)

    def rows(self) -> Iterator[tuple[str, str]]:
        """What it adapts to, and how fast."""
        low, high = grams(self.low), grams(self.high)
        what = "a payload" if self.inertia else "the weight of a payload"
        reach = scaled(self.reach, LENGTH, 3)
        yield "adapts", f"to {what} of {low} to {high}, its centre within {reach} of the tip"
        corner, fade = show(self.w / (2 * math.pi), "Hz", 3), scaled(1 / self.w, TIME, 3)
        yield (
            "estimate",
            f"begins with {low}; its errors fall as exp(-t/{fade}), {corner}, and at rest "
            f"the mass comes within {grams(self.dead_zone / self.g)}, by the "
            f"dead zone of {scaled(self.dead_zone, FORCE, 3)}",
        )

    def growth(self, delay: int, pole: float) -> float:
        """Spectral radius of the sampled estimate on a stiff contact whose force comes late.

        What the estimate carries, the contact does not: its force changes by as much, at once. Of a
        sensor of pole b and delay d the controller sees F(z) of that, F = z^-d (1 - b)/(1 - b/z).
        The estimate takes the difference for payload, so that the error goes by

            z - 1 + s (1 - L (1 - F)) = 0,    s = 1 - exp(-w T),

        with the low-pass L. At least 1 is unstable: adaptation is too fast for the sensor.

        Args:
            delay: of the sensor, in periods, beside the period that every one takes.
            pole: of its low-pass; 0 for none.
        """
        share, passed = -math.expm1(-self.w * self.period), self.passed
        size = 3 + delay  # theta, the low-pass L, the sensor's, and its line of delays
        step = np.zeros((size, size))
        for i in range(size):
            state = np.eye(size)[i]
            theta, filtered, reading, line = state[0], state[1], state[2], [*state[3:]]
            reading = pole * reading + (1 - pole) * theta
            line.append(reading)
            filtered += passed * (theta - line[0] - filtered)
            step[:, i] = [theta + share * (filtered - theta), filtered, reading, *line[1:]]
        return float(np.max(np.abs(np.linalg.eigvals(step))))


def counted(rows: list[int]) -> list[float]:
    """Weights of forces and moments, by their numbers among the six of a wrench."""
    return [1.0 if row < 3 else 1.0 / LEVER for row in rows]


def regressor(a: ca.SX, turning: ca.SX, turned: ca.SX, R: ca.SX) -> ca.SX:
    """Y (6, 4) of a payload on a tip that moves, world axes.

    Args:
        a: (3,) acceleration of the tip against free fall.
        turning: (3,) its angular velocity.
        turned: (3,) its angular acceleration.
        R: (3, 3) the tool's axes.
    """
    spin = ca.skew(turned) + ca.skew(turning) @ ca.skew(turning)
    force = ca.horzcat(-a, -spin @ R)
    moment = ca.horzcat(ca.SX.zeros(3), ca.skew(a) @ R)
    return ca.vertcat(force, moment)


def gramian(a: ca.SX, turning: ca.SX, turned: ca.SX, R: ca.SX, rows: list[int], g: float) -> ca.SX:
    """(4, 4) A^T A / |g|^2 of an instant, of a tip that moves as `regressor` has it.

    Args:
        a: (3,) acceleration of the tip against free fall.
        turning, turned: (3,) its angular velocity and acceleration.
        R: (3, 3) the tool's axes.
        rows: numbers of the axes that the arm moves among the six of the world.
        g: |g| [m/s^2].
    """
    Y = regressor(a, turning, turned, R)
    Y = ca.diag(ca.DM(counted(rows))) @ Y[rows, :] @ ca.diag(ca.DM(SCALES))
    return Y.T @ Y / g**2


def described(parameters: Sequence[str]) -> str:
    """Parameters in words: `mass`, `centre along x and z`."""
    axes = [name for name in parameters if name in "xyz"]
    named = " and ".join([", ".join(axes[:-1]), *axes[-1:]] if axes[1:] else axes)
    centre = [f"centre along {named}"] if axes else []
    return " and ".join([*(["mass"] if "mass" in parameters else []), *centre])
