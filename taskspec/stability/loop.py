"""The closed loop over one period: controller, sensor and plant as one matrix, and its modes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
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
#: A loop that has grown to this is not followed any farther [N, N m].
_WITHOUT_BOUNDS = 1e6


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
    """

    z: complex
    s: complex
    shape: NDArray[np.complex128]
    doubt: float = 0.0

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

    x holds coordinates and rates (2c), the wrench of the plant's last step in the directions in
    which it can be (r), reactions (e), what the sensor remembers of the former, and memory (m).

    Args:
        controller: the stage.
        plant: what it drives.
        sensor: between them.
        samples: whether a sensor that holds takes a new sample in this period.

    Raises:
        UnfitError: it would have more than `MOST_STATES` states.
    """
    return driven_step(controller, plant, sensor, samples=samples).F


@dataclass(frozen=True, slots=True)
class DrivenStep:
    """x[k+1] = F x[k] + E u[k]; the wrench of the environment on the tip in that is C x + D u.

    Attributes:
        F: (size, size) see `one_step`.
        E: (size, k) from the inputs.
        C, D: (6, size), (6, k) world axes [N, N m].
    """

    F: Matrix
    E: Matrix
    C: Matrix
    D: Matrix


@dataclass(frozen=True, slots=True)
class Drive:
    """What drives a loop from outside, beside what it measures.

    Attributes:
        moves: an object that moves; its inputs are where it has moved to, towards the tool, and how
            fast [m, m/s]. Empty for none.
        control: (n + m, k) what each further input adds to torque and memory.
    """

    moves: str = ""
    control: Matrix | None = None


_UNDRIVEN = Drive()


def response(
    controller: LinearController,
    plant: LinearPlant,
    sensor: SensorModel,
    drive: Drive,
    inputs: Matrix,
    rates: Matrix | None = None,
) -> Matrix:
    """(N, 6) what the wrench of the environment on the tip changes by, world axes [N, N m].

    Args:
        controller: the stage.
        plant: what it drives.
        sensor: between them.
        drive: what the inputs are.
        inputs: (N, k) at each tick.
        rates: (n,) of the joints before the first tick; None for rest.

    Raises:
        UnfitError: the loop would have more than `MOST_STATES` states, or grows without bounds.
    """
    # A sensor that holds takes a sample in the first of so many ticks.
    steps = [
        driven_step(controller, plant, sensor, drive, samples=first)
        for first in (True, False)[: min(sensor.hold_ticks, 2)]
    ]
    start = np.zeros(len(steps[0].F))
    if rates is not None:
        start[plant.size : plant.size + plant.n] = rates
    taken = slice(None, None, sensor.hold_ticks)
    pushes = inputs @ steps[-1].E.T
    pushes[taken] = inputs[taken] @ steps[0].E.T
    wrenches = inputs @ steps[-1].D.T
    wrenches[taken] = inputs[taken] @ steps[0].D.T
    # What grows without bounds overflows, and is refused below.
    with np.errstate(over="ignore", invalid="ignore"):
        wrenches += _followed(steps, sensor.hold_ticks, start, pushes)
    if not np.abs(wrenches).max(initial=0.0) <= _WITHOUT_BOUNDS:
        raise UnfitError("numbers without bounds")
    return wrenches


def _followed(steps: Sequence[DrivenStep], hold: int, start: Matrix, pushes: Matrix) -> Matrix:
    """(N, 6) C x[k] of x[k+1] = F x[k] + p[k].

    By blocks of ticks, all at once: each from rest, and what it begins with on top of that. That
    takes some sqrt(N) products of matrices instead of N with vectors.

    Args:
        steps: those of every tick that `hold` divides, then those of the others, if there are any.
        hold: in ticks.
        start: (size,) x[0].
        pushes: (N, size) p.
    """
    N, size = pushes.shape
    # The powers of F cost size**3 each.
    length = max(round(min(math.sqrt(N), N / size) / hold), 1) * hold
    count = max(-(-N // length), 1)
    padded = np.zeros((count * length, size))
    padded[:N] = pushes
    of_tick = padded.reshape(count, length, size)
    wrenches = np.empty((count, length, 6))
    x, power, seen = np.zeros((count, size)), np.eye(size), []
    for k in range(length):
        step = steps[min(k % hold, len(steps) - 1)]
        wrenches[:, k] = x @ step.C.T
        seen.append(step.C @ power)
        x = x @ step.F.T + of_tick[:, k]
        power = step.F @ power
    starts = np.empty((count, size))
    starts[0] = start
    for before, after, driven in zip(starts[:-1], starts[1:], x, strict=False):
        after[:] = power @ before + driven
    wrenches += (starts @ np.vstack(seen).T).reshape(count, length, 6)
    return wrenches.reshape(count * length, 6)[:N]


def driven_step(
    controller: LinearController,
    plant: LinearPlant,
    sensor: SensorModel,
    drive: Drive = _UNDRIVEN,
    *,
    samples: bool,
) -> DrivenStep:
    """One period of control of a loop that is driven from outside.

    Args:
        controller: the stage.
        plant: what it drives.
        sensor: between them.
        drive: what the inputs are.
        samples: whether a sensor that holds takes a new sample in this period.

    Raises:
        UnfitError: it would have more than `MOST_STATES` states.
    """
    A, B, moved = plant.moved_step(drive.moves)
    n, c, e, m = plant.n, plant.size, plant.equations, len(controller.slots)
    basis = _channels(controller, np.hstack([A[2 * c : 2 * c + 6], B[2 * c : 2 * c + 6]]))
    r = basis.shape[1]
    kept = r * sensor.order
    size = 2 * c + r + e + kept + m
    if size > MOST_STATES:
        raise UnfitError(f"{size} states")
    at_w, at_e = 2 * c, 2 * c + r
    at_s, at_m = at_e + e, at_e + e + kept

    update, reading = _sensor(sensor, r, samples)
    measured = np.zeros((r, size))
    measured[:, at_s:at_m], measured[:, at_w:at_e] = reading[:, :kept], reading[:, kept:]

    measured_rows = np.zeros((2 * n + 6 + e + m, size))
    measured_rows[:n, :n], measured_rows[n : 2 * n, c : c + n] = np.eye(n), np.eye(n)
    measured_rows[2 * n : 2 * n + 6] = basis @ measured
    measured_rows[2 * n + 6 : 2 * n + 6 + e, at_e:at_s] = np.eye(e)
    measured_rows[2 * n + 6 + e :, at_m:] = np.eye(m)

    torque = controller.torque @ measured_rows
    out = B @ torque
    out[:, : 2 * c] += A
    control = np.zeros((n + m, 0)) if drive.control is None else drive.control
    step = np.zeros((size, size + moved.shape[1] + control.shape[1]))
    driven = np.hstack([out, moved, B @ control[:n]])
    step[: 2 * c] = driven[: 2 * c]
    step[at_w:at_e] = basis.T @ driven[2 * c : 2 * c + 6]
    step[at_e:at_s] = driven[2 * c + 6 :]
    step[at_s:at_m, at_s:at_m], step[at_s:at_m, at_w:at_e] = update[:, :kept], update[:, kept:]
    step[at_m:, :size] = controller.memory @ measured_rows
    step[at_m:, size + moved.shape[1] :] = control[n:]
    F, E = step[:, :size], step[:, size:]
    if not E.shape[1]:
        return DrivenStep(F, E, driven[2 * c : 2 * c + 6, :size], E[:6])
    # The wrench of the environment, whatever a sensor at the wrist adds to it.
    A, B, moved = replace(plant, tool=None).moved_step(drive.moves)
    rows = slice(2 * c, 2 * c + 6)
    C = B[rows] @ torque
    C[:, : 2 * c] += A[rows]
    return DrivenStep(F, E, C, np.hstack([moved[rows], B[rows] @ control[:n]]))


def states(controller: LinearController, plant: LinearPlant, sensor: SensorModel) -> int:
    """How many states the closed loop has, at most six channels of the wrench."""
    channels = min(6, sum(len(row.G) for row in plant.rows))
    own = 2 * plant.size + plant.equations + len(controller.slots)
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
    uncertain = np.finfo(float).eps * np.linalg.norm(balanced) * _sensitivity(right)
    found = []
    for z, doubt, shape in zip(values, uncertain, (scale[:, None] * right).T, strict=True):
        moved = max(_ROUNDING, min(_TRUSTED * doubt, FARTHEST))
        if abs(z - 1) < moved or z.imag < 0 or abs(z) < _GONE:
            continue
        s = np.log(complex(z)) / span
        off = moved / (abs(z) * span)
        found.append(Mode(complex(np.exp(s * period)), s, shape[: plant.n], float(off)))
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
    heeded = _span(np.vstack([controller.torque, controller.memory])[:, first : first + 6].T)
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
