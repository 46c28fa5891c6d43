"""What is wrong with a file that does not read, its robot and its start included."""

from __future__ import annotations

from taskspec.spec import UnreadTaskError
from taskspec.text.diagnostic import SpecError, in_order


def with_robot(error: SpecError) -> SpecError:
    """The same error with what is wrong with the robot, which nothing else in the file may hide.

    Where a numerical library cannot be imported, the robot is left out.

    Args:
        error: of reading a file.
    """
    rest = error.robot if isinstance(error, UnreadTaskError) else None
    if rest is None:
        return error
    try:
        from taskspec.program.prepare import robot_faults

        faults = robot_faults(rest)
    except ImportError:
        return error
    return SpecError(in_order((*error.diagnostics, *faults)), error.sources)
