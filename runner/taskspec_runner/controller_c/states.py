"""The states of an exported controller: why a task has ended, or that it goes on."""

from __future__ import annotations

#: By their numbers, from 0 on: the name, and what it means.
STATES = (
    ("RUNNING", "the task goes on"),
    ("DONE", "it reached its end"),
    ("FAILED", "it reached 'fail'"),
    ("STOPPED", "a limit of the task"),
    ("ATTEMPTS", "a stage has been entered as often as it may be"),
    ("UNKNOWN", "a stage cannot begin: its frame has not been estimated"),
    ("UNANSWERED", "the program that keeps the limits has had no answer for too long"),
    ("DIVERGED", "state or command is no longer finite"),
    ("BAD_SAMPLE", "a number of a sample is not finite"),
    ("BAD_STAMP", "a stamp of the robot's clock stands still, runs back, or is no time of a run"),
    ("LOST", "too many samples in a row have been lost: does the host step at the task's rate?"),
    ("NOT_STARTED", "the task has not been started"),
)
#: Lost samples in a row that are borne at first.
BEARS = 20
