"""What can be wrong with a robot, as an exception that carries its stable code."""

from __future__ import annotations

from taskspec.text.codes import register

register(
    {
        "TS401": "an unknown robot",
        "TS402": "a robot file that cannot be read",
        "TS403": "something in a robot file that is refused",
        "TS404": "a robot file that does not compile",
        "TS405": "a robot file that does not describe an arm",
        "TS406": "a flange that is unknown or cannot be told",
        "TS407": "a tool that is not complete or not possible",
        "TS408": "a tool tip that cannot move along the world's axes",
        "TS409": "a file outside of the task's project",
        "TS411": "joint positions that do not fit the robot",
        "TS412": "a start out of reach",
        "TS413": "an orientation that the robot cannot take at its start",
    }
)


class RobotError(Exception):
    """A robot, its tool or its start that cannot be used.

    Attributes:
        code: One of those above: TS401 to TS409 for robots, TS411 to TS413 for starts.
        message: What is wrong, without a full stop.
        hint: What to do about it, or empty.
        field: Where in a task file's `robot` section the cause stands, such as `("start", "xyz")`.
    """

    def __init__(
        self, code: str, message: str, hint: str = "", field: tuple[str, ...] = ("model",)
    ) -> None:
        super().__init__(message)
        self.code = code
        self.message = message
        self.hint = hint
        self.field = field
