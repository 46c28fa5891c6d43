"""The sampled model: one law, one linear contact and one period, written as they run.

Everything is a deviation from the equilibrium, in the theory's sign (f by the environment on the
tool). Within a period the torque is held. The plant makes N semi-implicit Euler steps,

    Lambda x'' = p + f,   x'[j+1] = x'[j] + T_p x''[j],   x[j+1] = x[j] + T_p x'[j+1],

against a contact along one axis with the virtual mass that MuJoCo adds, f = -(k x + b x' + m x'').
The controller sees the force of the last step of the period before.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

#: (x, x', f, integral of f_d - f) on the m axes -> force (m,) that the held torque puts on them.
SampledLaw = Callable[[Vector, Vector, Vector, Vector], Vector]


@dataclass(frozen=True, slots=True)
class Loop:
    """An arm in contact, and when it is sampled.

    Attributes:
        inertia: (m, m) Lambda = (J H^-1 J^T)^-1 on the task axes [kg, kg m^2].
        normal: which of the m axes the contact acts on.
        k, b, virtual: the contact's stiffness [N/m], damping [N s/m] and virtual mass [kg].
        period: of the controller, T [s]. steps: plant steps in it, N.
    """

    inertia: Vector
    normal: int
    k: float
    b: float
    virtual: float
    period: float = 1e-3
    steps: int = 1

    @property
    def felt(self) -> float:
        """Lambda_n = 1/(a^T J H^-1 J^T a) [kg]."""
        return float(1.0 / np.linalg.inv(self.inertia)[self.normal, self.normal])

    def core(self) -> Loop:
        """The same as the inverse-dynamics core leaves it: the normal axis by itself, Lambda_n."""
        return replace(self, inertia=np.array([[self.felt]]), normal=0)

    def towards_continuous(self, period: float = 1e-6) -> Loop:
        """The same without the simulator's virtual mass, sampled so fast that it is continuous."""
        return replace(self, virtual=0.0, period=period, steps=1)

    def matrix(self, law: SampledLaw) -> Vector:
        """Square map of (x, x', f_n, integral) over one period; no integral if the law has none."""
        size = 2 * len(self.inertia) + 2
        A = np.column_stack([self._advance(law, unit) for unit in np.eye(size)])
        return A if np.any(A[:-1, -1]) else A[:-1, :-1]

    def poles(self, law: SampledLaw) -> Vector:
        """Eigenvalues as s = ln(z)/T [1/s], slowest first."""
        z = np.linalg.eigvals(self.matrix(law)).astype(complex)
        s = np.log(z[np.abs(z) > 1e-9]) / self.period
        return s[np.argsort(-s.real)]

    def radius(self, law: SampledLaw) -> float:
        """Largest magnitude of the eigenvalues: below 1 the loop is stable."""
        return float(np.max(np.abs(np.linalg.eigvals(self.matrix(law)))))

    def _advance(self, law: SampledLaw, state: Vector) -> Vector:
        m, n = len(self.inertia), self.normal
        x, v = state[:m].copy(), state[m : 2 * m].copy()
        f, s = np.zeros(m), np.zeros(m)
        f[n], s[n] = state[2 * m :]
        s = s - self.period * f
        p = law(x, v, f, s)
        along = np.eye(m)[n]
        mass = self.inertia + self.virtual * np.outer(along, along)
        step = self.period / self.steps
        for _ in range(self.steps):
            spring = self.k * x[n] + self.b * v[n]
            a = np.linalg.solve(mass, p - along * spring)
            f = -along * (spring + self.virtual * a[n])
            v = v + step * a
            x = x + step * v
        return np.concatenate([x, v, [f[n], s[n]]])


def impedance(loop: Loop, mass: float, damping: float, stiffness: float) -> SampledLaw:
    """(4.16), (4.17) on the normal axis, for `loop.core()`."""
    return parallel(loop, mass, damping, stiffness, 1.0, 0.0)


def parallel(
    loop: Loop,
    mass: float,
    damping: float,
    stiffness: float,
    proportional: float,
    integral: float,
) -> SampledLaw:
    """(4.36)-(4.38) on the normal axis, for `loop.core()`."""

    def law(x: Vector, v: Vector, f: Vector, s: Vector) -> Vector:
        motion = -damping * v - stiffness * x
        force = -proportional * f + integral * s
        return loop.felt * (motion - force) / mass - f

    return law


def hybrid(p: float, i: float, d: float) -> SampledLaw:
    """A force axis of section 4.3.3: u = f_d + p (f_d - f) + i int (f_d - f) dt - d v."""

    def law(x: Vector, v: Vector, f: Vector, s: Vector) -> Vector:  # noqa: ARG001
        return p * f - i * s - d * v

    return law


def motion(loop: Loop, K_P: float, K_D: float) -> SampledLaw:
    """A motion axis of section 4.3.3, x'' = K_P e + K_D e', for `loop.core()`."""

    def law(x: Vector, v: Vector, f: Vector, s: Vector) -> Vector:  # noqa: ARG001
        return loop.felt * (-K_P * x - K_D * v)

    return law


def springs(stiffness: Vector, damping: Vector) -> SampledLaw:
    """(4.20) and (4.21) about an equilibrium: u = J^T (K_m e - D_m x')."""
    return parallel_pid(stiffness, damping, 0.0, 0.0)


def parallel_pid(
    stiffness: Vector, damping: Vector, proportional: float, integral: float
) -> SampledLaw:
    """(4.50) about its equilibrium."""

    def law(x: Vector, v: Vector, f: Vector, s: Vector) -> Vector:
        return -stiffness * x - damping * v + proportional * f - integral * s

    return law


def omega_zeta(poles: Vector) -> tuple[float, float]:
    """Frequency [rad/s] and damping ratio of the slowest oscillating pair."""
    pair = next(s for s in poles if s.imag > 1e-6 * abs(s))
    return float(abs(pair)), float(-pair.real / abs(pair))


def bisected(stable: Callable[[float], bool], predicted: float) -> float:
    """Where runs change from stable to not, to 2e-3, looked for within 1 % of the prediction.

    That is twice the tolerance of 5e-3 to which it has to be there.

    Raises:
        ValueError: it is not there.
    """
    return critical(stable, 0.99 * predicted, 1.01 * predicted, 2e-3)


def critical(stable: Callable[[float], bool], low: float, high: float, digits: float) -> float:
    """Where `stable` changes between `low` and `high`, to the relative width `digits`.

    Raises:
        ValueError: it does not change between the two.
    """
    at_low = stable(low)
    if stable(high) == at_low:
        raise ValueError(f"stable={at_low} at both {low:g} and {high:g}")
    while high / low - 1 > digits:
        middle = (low * high) ** 0.5
        if stable(middle) == at_low:
            low = middle
        else:
            high = middle
    return (low * high) ** 0.5
