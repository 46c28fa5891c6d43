"""Errors of a robot, as an exception that carries its stable code."""

from __future__ import annotations


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
