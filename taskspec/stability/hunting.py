"""Whether a stage hunts that compensates more friction than there is, by harmonic balance.

Of a swing of its argument with the amplitude a, the smooth sign passes on the share

    N(a) = 2/a <s(a sin t) sin t> = 1 at a = 0, and 4/(pi a) of a large one,

so that compensation is a spring of N(a) times that at the reference (Khalil, Nonlinear Systems,
7.2). A mode of the sampled loop with it that grows by sigma at the frequency w gains

    4 pi sigma/w  times  1/2 w^2 phi^H H phi

of energy in a period, phi being the amplitudes of the joints, while Coulomb's friction takes
4 tau_i |phi_i| of each joint. A swing goes on where it gains as much as friction takes. A small one
does not, as that goes by the square of the amplitude and friction by the amplitude; nor does a
large one if N(a) leaves too little of the spring. So what counts is the amplitude at which the gain
is the greatest part of what friction takes.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from taskspec.laws.friction import Compensation
from taskspec.stability.loop import Mode
from taskspec.stability.sampled_stage import SampledStage, analyse

Vector = NDArray[np.float64]

#: Amplitudes that are tried, in units of width times time: three in a decade.
_AMPLITUDES = tuple(10 ** (i / 3) for i in range(-3, 13))
#: How often shares of the spring and the mode that they give are brought together.
_TURNS = 3
#: Slower than this it is no swing [rad/s].
_SWINGS = 1.0
_POINTS = 64


def passed_on(amplitude: float) -> float:
    """N(a), which the smooth sign passes on of a swing of its argument."""
    sines = (math.sin(math.pi * (i + 0.5) / _POINTS) for i in range(_POINTS))
    return 2 * sum(s * s / math.sqrt(1 + (amplitude * s) ** 2) for s in sines) / _POINTS


def gained(sampled: SampledStage, friction: Compensation, least: Vector) -> float:
    """What a swing gains at most in a period, as a part of what friction takes of it.

    Args:
        sampled: the stage without its compensation.
        friction: what is compensated.
        least: (n,) tau, the least friction that joints may have [N m, N].

    Returns:
        inf where nothing rubs and a swing grows; 0 where none grows at any amplitude.

    Raises:
        UnfitError: the loop has too many states.
    """
    compensated = sampled.stage.compensated
    assert compensated is not None
    other = analyse(replace(sampled.stage, closed_form=compensated))
    if other is None:
        return 0.0
    H, found = sampled.context.start_inertia, 0.0
    for a in _AMPLITUDES:
        mode = _swing(sampled, other, a)
        if mode is None:
            continue
        phi = mode.shape / np.abs(mode.shape).max() * (a * friction.width * friction.time)
        w, moved = mode.s.imag, float(np.real(np.conj(phi) @ H @ phi))
        gain, taken = 2 * math.pi * mode.s.real * w * moved, 4 * float(least @ np.abs(phi))
        found = max(found, gain / taken if taken else math.inf)
    return found


def _swing(sampled: SampledStage, other: SampledStage, amplitude: float) -> Mode | None:
    """The mode that grows fastest under the shares of the spring that its own swing leaves."""
    without, whole = sampled.controller, other.controller
    spring, mode = whole.torque - without.torque, None
    shares = np.full(len(spring), passed_on(amplitude))
    for _ in range(_TURNS):
        held = replace(whole, torque=without.torque + shares[:, None] * spring)
        modes = replace(other, controller=held).modes()
        mode = next((each for each in modes if each.s.imag > _SWINGS), None)
        if mode is None or mode.s.real <= 0:
            return None
        sizes = amplitude * np.abs(mode.shape) / np.abs(mode.shape).max()
        shares = np.array([passed_on(size) for size in sizes])
    return mode
