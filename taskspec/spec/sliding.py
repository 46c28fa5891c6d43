"""`sliding` of a law: a sliding term on its motion axes, and the bounds that it is to hold."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field

from taskspec.geometry.axis import AXES
from taskspec.laws.uncertainty import Uncertainty
from taskspec.spec.gains import AxisValues, GainField
from taskspec.spec.model import Model
from taskspec.spec.parse_context import ParseContext
from taskspec.spec.quantities import Constant, ForJoints
from taskspec.text.data import Map
from taskspec.text.units import FORCE, LINEAR_ACCELERATION, MASS, MOMENT, NUMBER, VELOCITY

_BOUNDS = ("disturbance", "payload", "joint_torque", "uncertainty")


class Sliding(Model):
    """A sliding term; see `laws.sliding`.

    Attributes:
        layer: within which it is linear [m/s, rad/s]; an axis without one does not slide.
        gain: the most that it adds [m/s^2, rad/s^2]; by default what the bounds below need.
        disturbance: bound of an unknown wrench at the control point [N, N m].
        payload: bound of an unknown mass at the control point [kg].
        joint_torque: bound of unknown torques of the joints, such as friction [N m, N].
        uncertainty: by which part the arm's inertia, and what carries it, may be wrong.
    """

    noun = "a sliding term"
    example: ClassVar = "sliding: {layer: 5 mm/s, payload: 500 g}"

    layer: Annotated[AxisValues, GainField(VELOCITY, above=0)] = Field(title="Boundary layer")
    gain: Annotated[AxisValues, GainField(LINEAR_ACCELERATION, above=0)] | None = Field(
        None, title="Switching gain"
    )
    disturbance: Annotated[AxisValues, GainField(FORCE, least=0)] | None = Field(
        None, title="Bound of an unknown wrench"
    )
    payload: Annotated[float, Constant(MASS, least=0)] = Field(
        0.0, title="Bound of an unknown payload"
    )
    joint_torque: Annotated[tuple[float, ...], ForJoints(MOMENT)] = Field(
        (), title="Bound of unknown torques of the joints"
    )
    uncertainty: Annotated[float, Constant(NUMBER, least=0, most=0.9)] = Field(
        0.0, title="Relative error of the arm's model"
    )

    @property
    def bounds(self) -> Uncertainty:
        """What the file states of what the model lacks."""
        given = {} if self.disturbance is None else self.disturbance.entries
        wrench = {axis: value for axis in AXES if isinstance(value := given.get(axis), float)}
        return Uncertainty(wrench, self.joint_torque, self.payload, self.uncertainty)

    @classmethod
    def rules(cls, data: Map, context: ParseContext) -> None:
        """Requires a gain, or bounds that give one."""
        if "layer" in data and not any(key in data for key in ("gain", *_BOUNDS)):
            context.error(
                "TS021",
                "a sliding term needs its gain, or bounds of what it is to hold against",
                data.node.key_span("layer"),
                "state one of them: payload: 500 g, disturbance: 10 N, joint_torque: 1 N*m, "
                "uncertainty: 10 %; or gain: 2 m/s^2",
            )
