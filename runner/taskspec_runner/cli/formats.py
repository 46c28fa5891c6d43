"""The forms in which commands print."""

from __future__ import annotations

from enum import StrEnum


class RunFormat(StrEnum):
    """How a run tells its outcome."""

    TEXT = "text"
    JSON = "json"


class FindingFormat(StrEnum):
    """How findings about task files are told."""

    FULL = "full"
    CONCISE = "concise"
    JSON = "json"
    GITHUB = "github"
    SARIF = "sarif"
    JUNIT = "junit"
