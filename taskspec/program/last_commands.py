"""What joints were commanded in the two ticks before, as parameters of a stage's tick."""

from __future__ import annotations

import casadi as ca

from taskspec.program.context import Context
from taskspec.program.slots import Slots

#: The parameters with the commands of the tick before, and of the one before that.
LAST_COMMAND, EARLIER_COMMAND = "last_torque", "earlier_torque"


def last_command(context: Context, parameters: Slots) -> ca.SX:
    """The command (n,) of the tick before."""
    return _slot(context, parameters, LAST_COMMAND)


def last_velocity(context: Context, parameters: Slots) -> ca.SX:
    """The velocity (n,) that was commanded in the tick before [rad/s, m/s].

    Of an arm that takes positions that is by how much they changed.
    """
    last = last_command(context, parameters)
    if not context.drives.positions:
        return last
    return (last - _slot(context, parameters, EARLIER_COMMAND)) / context.period


def _slot(context: Context, parameters: Slots, name: str) -> ca.SX:
    return parameters.once(name, context.robot.n)
