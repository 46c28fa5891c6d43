"""Joints that follow others, as fixed ratios have it, and the coordinates that are left of an arm.

An arm with k joints of which some follow others, q = A x + b, has n < k coordinates x. By the
principle of virtual work (Featherstone, Rigid Body Dynamics Algorithms, 2008, section 3.5) what
acts on them are the torques A^T u, so that with H, C q' + g and J of all joints

    A^T H A x'' + A^T (C q' + g) = A^T u,    tip velocity J A x',    J' q' as it is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class JointCoupling:
    """q = A x + b, for the joints from the base to the flange.

    Attributes:
        names: (k,) of the joints.
        hinges: (k,) whether each turns; else it slides.
        free: (n,) the joints that are coordinates: q of these is x.
        ratios: (k, n) A [of two hinges 1, of a hinge that follows a slide rad/m, ...].
        offsets: (k,) b [rad or m].
    """

    names: tuple[str, ...]
    hinges: tuple[bool, ...]
    free: tuple[int, ...]
    ratios: Array
    offsets: Array

    @property
    def couples(self) -> bool:
        """Whether any joint follows others."""
        return len(self.free) < len(self.names)

    @property
    def n(self) -> int:
        """Coordinates."""
        return len(self.free)

    def joints(self, x: Array) -> Array:
        """(k,) positions of the joints at coordinates x (n,) [rad or m]."""
        return self.ratios @ x + self.offsets if self.couples else x

    def rates(self, v: Array) -> Array:
        """(k,) velocities, or accelerations, of the joints at those of the coordinates (n,)."""
        return self.ratios @ v if self.couples else v

    def on_coordinates(self, torques: Array) -> Array:
        """(n,) what torques of the joints (k,) do to the coordinates; of a (k, m) each column."""
        return self.ratios.T @ torques if self.couples else torques

    def by_coordinates(self, J: Array) -> Array:
        """(m, n) a Jacobian of the coordinates, of one of the joints (m, k)."""
        return J @ self.ratios if self.couples else J

    @property
    def turns(self) -> NDArray[np.bool_]:
        """(n,) whether a whole turn of a coordinate leaves the arm's pose as it is."""
        moved = self.ratios != 0.0
        whole = np.array(self.hinges)[:, None] & (self.ratios == np.round(self.ratios))
        found: NDArray[np.bool_] = (whole | ~moved).all(axis=0)
        return found

    def relation(self, joint: int) -> str:
        """How a joint follows, such as `j3 = -j2 + 0.5`."""
        text = ""
        for i, ratio in zip(self.free, self.ratios[joint], strict=True):
            if ratio != 0.0:
                size = "" if abs(ratio) == 1.0 else f"{abs(ratio):g} * "
                sign = (" - " if ratio < 0 else " + ") if text else ("-" if ratio < 0 else "")
                text += f"{sign}{size}{self.names[i]}"
        offset = float(self.offsets[joint])
        if not text:
            text = f"{offset:g}"
        elif offset:
            text += f" {'-' if offset < 0 else '+'} {abs(offset):g}"
        return f"{self.names[joint]} = {text}"

    @property
    def followers(self) -> tuple[int, ...]:
        """The joints that are no coordinates."""
        return tuple(j for j in range(len(self.names)) if j not in self.free)

    @property
    def content(self) -> bytes:
        """Its numbers: arms that agree in them are coupled alike."""
        return b"".join(
            (np.array(self.free).tobytes(), self.ratios.tobytes(), self.offsets.tobytes())
        )
