"""`limits`: what stops a run, and what a quadratic program keeps."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from taskspec.spec.model import Model
from taskspec.spec.quantities import Constant
from taskspec.text.units import FORCE, LENGTH, MOMENT, POWER, VELOCITY


class Limits(Model):
    """Limits on what is measured; reaching one stops the run. None means no limit.

    Under `solve: qp` they are constraints as well.

    Attributes:
        force: of the contact force [N].
        torque: of the contact moment [N*m].
        speed: of the control point [m/s].
        deviation: of the control point from the reference of the motion axes [m].
        torque_rate: of every joint's torque [N*m/s], kept under `solve: qp` alone.
    """

    noun = "'limits'"
    example = "limits: {force: 60 N}"

    force: Annotated[float, Constant(FORCE, above=0)] | None = Field(None, title="Contact force")
    torque: Annotated[float, Constant(MOMENT, above=0)] | None = Field(None, title="Contact moment")
    speed: Annotated[float, Constant(VELOCITY, above=0)] | None = Field(None, title="Speed")
    deviation: Annotated[float, Constant(LENGTH, above=0)] | None = Field(
        None, title="Deviation of motion axes from their reference"
    )
    torque_rate: Annotated[float, Constant(POWER, above=0)] | None = Field(
        None, title="Rate of the joint torques"
    )
