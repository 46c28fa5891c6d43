"""The arm is looked at where a motion that turns back is farthest."""

from __future__ import annotations

import math

import pytest

from taskspec.geometry.axis import Axis
from taskspec.program.trajectory import SAMPLES, Course


def test_a_peak_between_the_samples_is_looked_at():
    """A narrow excursion at a fifth of the way, where no sample is."""
    peak, width = 0.2, 0.02
    assert all(abs(share - peak) > 3 * width for share in SAMPLES)
    way = {Axis.X: lambda t: math.exp(-(((t - peak) / width) ** 2)), Axis.Y: lambda t: t}
    times = Course(1.0, way, bends=True).instants()
    assert min(abs(t - peak) for t in times) <= 1 / 200
    # Straight on, the last sample is the farthest place.
    straight = Course(1.0, {Axis.Y: lambda t: t}, bends=False).instants()
    assert straight[-1] == pytest.approx(1.0)
    assert len(straight) <= len(SAMPLES) + 1
