"""`free`: an axis that yields to any force."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

from taskspec.deferred import ca
from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression
from taskspec.expression.tree import Number
from taskspec.modes.force import Force
from taskspec.modes.key import Misuse, ModeKey
from taskspec.modes.mode import (
    AxisMode,
    HandOver,
    OwnReference,
    ReferenceInputs,
    StageStart,
    from_start,
)
from taskspec.text.units import FORCE

if TYPE_CHECKING:
    from taskspec.geometry.axis import Axis

_BESIDE = {
    "force": "a free axis has the force 0: keep one of the two",
    "torque": "a free axis has the moment 0: keep one of the two",
    "stiffness": "a free axis has no spring: keep one of the two",
    "damping": "a free axis has the damping of its law; one of its own goes without 'free'",
}


@dataclass(frozen=True, slots=True)
class FreeAxis(AxisMode):
    """An axis on which the robot applies nothing: a force or moment of 0.

    Under laws without a force loop it has no stiffness, and the damping of the law.

    Attributes:
        free: always true.
    """

    free: bool = True

    name = "free"
    keys = (
        ModeKey(
            "free",
            "Free",
            switch=True,
            meaning="It yields: a force or moment of 0; no stiffness under laws without a "
            "force loop.",
            examples=(True,),
        ),
    )
    word: ClassVar[str] = "true"
    moves = False
    lets_go = True
    leads = False

    @classmethod
    def misuse(cls, data: Mapping[str, Any], *, rotation: bool) -> Misuse | None:  # noqa: ARG003
        """Nothing else decides about a free axis."""
        if not getattr(data["free"], "value", True):
            return Misuse("free", "an axis is not free by itself", "leave 'free' out")
        beside = next((key for key in _BESIDE if key in data), None)
        if beside is None:
            return None
        return Misuse(beside, f"a {beside} on a free axis", _BESIDE[beside])

    @property
    def set_point(self) -> Force:
        """A set point of 0 N, or 0 N m."""
        return Force(Expression("0", Number(0.0, FORCE), FORCE), None)

    def reference(self, at: ReferenceInputs) -> OwnReference:
        """r = r_0, r' = r'' = 0: what a damper brakes against, and the spring of a parallel law."""
        return OwnReference(at.start, ca.SX(0), ca.SX(0))

    def hand_over(self, at: StageStart) -> HandOver:
        """It is braked as a hold is."""
        return from_start(at)

    def constraint(self, axis: Axis, rate: str, *, turns: bool) -> str:  # noqa: ARG002
        """No motion: the force says it all."""
        return ""
