"""The closed loop over one period: controller, sensor and plant as one matrix, and its modes."""

from __future__ import annotations

import math
from dataclasses import field
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.program.sensor import SensorModel
from taskspec.stability.controller import LinearController
from taskspec.stability.plant import LinearPlant

Matrix = NDArray[np.float64]
Poles = NDArray[np.complex128]

#: An eigenvalue nearer to 1 than this is one that rounding has moved off it.
_ROUNDING = 1e-9
#: How much of rounding, as its own sensitivity tells, may move an eigenvalue off 1, and how far:
#: a chain of three is off by the cube root of rounding.
_TRUSTED, FARTHEST = 1e3, 1e-4
#: An eigenvalue below this is gone after one tick.
_GONE = 1e-12
#: Less than this in a row or a column is nothing: what balances it has no finite size.
_NOTHING = 1e-200
#: Sweeps over all states while rows and columns are brought to like size.
_BALANCINGS = 4
#: More states than this are not looked at.
MOST_STATES = 200


class UnfitError(ValueError):
    """The closed loop cannot be looked at: it has too many states, or numbers without bounds."""


@dataclass(frozen=True, slots=True)
class Mode:
    """One eigenvalue of the closed loop.

    Attributes:
        z: over one period of control.
        s: ln(z)/T [1/s].
        shape: (n,) amplitudes of the joints.
        doubt: how far rounding may have moved s [1/s].
        reactions: (e,) amplitudes of what the robot applies along each equation, to the same scale.
    """

    z: complex
    s: complex
    shape: NDArray[np.complex128]
    doubt: float = 0.0
    reactions: NDArray[np.complex128] = field(default_factory=lambda: np.zeros(0, complex))

    @property
    def damping_ratio(self) -> float:
        """-Re s / |s|; 1 at the origin."""
        return -self.s.real / abs(self.s) if self.s else 1.0

    @property
    def frequency(self) -> float:
        """Of the oscillation [Hz]."""
        return abs(self.s.imag) / (2 * np.pi)


def one_step(
    controller: LinearController, plant: LinearPlant, sensor: SensorModel, *, samples: bool
) -> Matrix:
    """F of x[k+1] = F x[k] over one period of control.

    x holds the plant's states, the wrench of the plant's last step in the directions in
    which it can be (r), reactions (e), what the sensor remembers of the former, memory (m), and
    what the controller predicts of positions and velocities (2n), where it estimates the latter.

    Args:
        controller: the stage.
        plant: what it drives.
        sensor: between them.
        samples: whether a sensor that holds takes a new sample in this period.

    Raises:
        UnfitError: it would have more than `MOST_STATES` states.
    """
    A, B = plant.step()
    n, c, e, m = plant.n, plant.size, plant.equations, len(controller.slots)
    own = plant.states
    basis = _channels(controller, np.hstack([A[own : own + 6], B[own : own + 6]]))
    r = basis.shape[1]
    kept = r * sensor.order
    size = own + r + e + kept + m + controller.states
    if size > MOST_STATES:
        raise UnfitError(f"{size} states")
    at_w, at_e = own, own + r
    at_s, at_m, at_v = at_e + e, at_e + e + kept, at_e + e + kept + m

    update, reading = _sensor(sensor, r, samples)
    measured = np.zeros((r, size))
    measured[:, at_s:at_m], measured[:, at_w:at_e] = reading[:, :kept], reading[:, kept:]

    measured_rows = np.zeros((2 * n + 6 + e + m, size))
    measured_rows[:n, :n], measured_rows[n : 2 * n, c : c + n] = np.eye(n), np.eye(n)
    measured_rows[2 * n : 2 * n + 6] = basis @ measured
    measured_rows[2 * n + 6 : 2 * n + 6 + e, at_e:at_s] = np.eye(e)
    measured_rows[2 * n + 6 + e :, at_m:at_v] = np.eye(m)
    estimate = controller.velocity
    if estimate is not None:
        now = estimate.correct[:, 2 * n :] @ measured_rows[:n]
        now[:, at_v:] += estimate.correct[:, : 2 * n]
        measured_rows[n : 2 * n] = now[n:]

    torque = controller.torque @ measured_rows
    out = B @ torque
    out[:, :own] += A
    step = np.zeros((size, size))
    step[:own] = out[:own]
    step[at_w:at_e] = basis.T @ out[own : own + 6]
    step[at_e:at_s] = out[own + 6 :]
    step[at_s:at_m, at_s:at_m], step[at_s:at_m, at_w:at_e] = update[:, :kept], update[:, kept:]
    step[at_m:at_v] = controller.memory @ measured_rows
    if estimate is not None:
        wrench = measured_rows[2 * n : 2 * n + 6]
        step[at_v:] = estimate.predict @ np.vstack([now, torque, wrench])
    return step


def states(controller: LinearController, plant: LinearPlant, sensor: SensorModel) -> int:
    """How many states the closed loop has, at most six channels of the wrench."""
    channels = min(6, sum(len(row.G) for row in plant.rows))
    own = plant.states + plant.equations + len(controller.slots) + controller.states
    return own + channels * (1 + sensor.order)


def modes(
    controller: LinearController, plant: LinearPlant, sensor: SensorModel, period: float
) -> tuple[Mode, ...]:
    """All modes but the neutral ones, the least stable first.

    Neutral are eigenvalues 1, alone or in chains: references that are carried along, an arm's
    inner motion that nothing holds, coordinates that a force alone decides.

    Args:
        controller: the stage.
        plant: what it drives.
        sensor: between them.
        period: T [s].

    Raises:
        UnfitError: the loop is too large, or has numbers without bounds.
    """
    F = _between_samples(controller, plant, sensor)
    span = sensor.hold_ticks * period
    balanced, scale = _balance(F)
    values, right = np.linalg.eig(balanced)
    own = plant.states + plant.equations + len(controller.slots) + controller.states
    at_reactions = plant.states + (len(F) - own) // (1 + sensor.order)
    reactions = slice(at_reactions, at_reactions + plant.equations)
    uncertain = np.finfo(float).eps * np.linalg.norm(balanced) * _sensitivity(right)
    found = []
    for z, doubt, shape in zip(values, uncertain, (scale[:, None] * right).T, strict=True):
        moved = max(_ROUNDING, min(_TRUSTED * doubt, FARTHEST))
        if abs(z - 1) < moved or z.imag < 0 or abs(z) < _GONE:
            continue
        s = np.log(complex(z)) / span
        off = moved / (abs(z) * span)
        z = complex(np.exp(s * period))
        found.append(Mode(z, s, shape[: plant.n], float(off), shape[reactions]))
    return tuple(sorted(found, key=lambda mode: -mode.s.real))


def poles(
    controller: LinearController, plant: LinearPlant, sensor: SensorModel, period: float
) -> Poles:
    """ln(z)/T of all eigenvalues that are not 1 to rounding [1/s], neutral chains among them.

    It takes a fifth of the time of `modes`, which alone tells which of them are neutral.

    Args:
        controller: the stage.
        plant: what it drives.
        sensor: between them.
        period: T [s].

    Raises:
        UnfitError: the loop is too large, or has numbers without bounds.
    """
    z = np.linalg.eigvals(_between_samples(controller, plant, sensor)).astype(complex)
    z = z[(np.abs(z - 1) > _ROUNDING) & (np.abs(z) > _GONE)]
    return np.asarray(np.log(z) / (sensor.hold_ticks * period))


def _between_samples(
    controller: LinearController, plant: LinearPlant, sensor: SensorModel
) -> Matrix:
    """The map from one sample of the sensor to the next."""
    F = one_step(controller, plant, sensor, samples=True)
    if sensor.hold_ticks > 1:
        held = one_step(controller, plant, sensor, samples=False)
        F = np.linalg.matrix_power(held, sensor.hold_ticks - 1) @ F
    if not np.isfinite(F).all():
        raise UnfitError("numbers without bounds")
    return F


def _balance(F: Matrix) -> tuple[Matrix, Matrix]:
    """D^-1 F D with rows and columns of like size, and the diagonal of D (Osborne's iteration)."""
    sizes, scale = np.abs(F), np.ones(len(F))
    np.fill_diagonal(sizes, 0.0)
    for _ in range(_BALANCINGS):
        before = scale.copy()
        for i in range(len(F)):
            column, row = float(sizes[:, i].sum()), float(sizes[i].sum())
            if min(column, row) > _NOTHING:
                power = round(0.5 * (math.log2(row) - math.log2(column)))
                if power:
                    sizes[:, i] *= 2.0**power
                    sizes[i] *= 2.0**-power
                    scale[i] *= 2.0**power
        if np.array_equal(scale, before):
            break
    return F * scale / scale[:, None], scale


def _sensitivity(right: NDArray[np.complex128]) -> Matrix:
    """How far each eigenvalue moves per norm of a change, |l| |r| / |l.r|; huge in a chain."""
    U, sizes, Vh = np.linalg.svd(right)
    left = (Vh.conj().T / np.maximum(sizes, np.finfo(float).eps * sizes[0] / 16)) @ U.conj().T
    return np.asarray(np.linalg.norm(left, axis=1) * np.linalg.norm(right, axis=0))


def _channels(controller: LinearController, wrenches: Matrix) -> Matrix:
    """(6, r) orthonormal basis of the wrenches that can be and that the controller heeds."""
    n = len(controller.torque)
    first = 2 * n
    heeding = [part[:, first : first + 6] for part in (controller.torque, controller.memory)]
    if controller.velocity is not None:
        heeding.append(controller.velocity.predict[:, 3 * n :])
    heeded = _span(np.vstack(heeding).T)
    return heeded @ _span(heeded.T @ wrenches)


def _span(columns: Matrix) -> Matrix:
    """(d, r) orthonormal basis of the columns' span, to rounding."""
    U, sizes, _ = np.linalg.svd(columns / max(float(np.abs(columns).max(initial=0.0)), 1e-300))
    return U[:, : int(np.sum(sizes > 1e-12))]


@lru_cache(maxsize=64)
def _sensor(model: SensorModel, r: int, samples: bool) -> tuple[Matrix, Matrix]:
    """The sensor's update (r order, r order + r) and reading (r, r order + r) of r channels."""
    memory, wrench = ca.SX.sym("memory", r, model.order), ca.SX.sym("wrench", r)
    kept, value = model.update(memory, wrench, ca.SX(float(samples)))
    given = ca.vertcat(ca.vec(memory), wrench)
    both = ca.jacobian(ca.vertcat(ca.vec(kept), value), given)
    found = np.array(ca.evalf(both)).reshape(r * model.order + r, r * model.order + r)
    return found[: r * model.order], found[r * model.order :]
