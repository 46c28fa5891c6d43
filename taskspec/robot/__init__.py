"""Robots: built-in arms and people's own MJCF and URDF files, as a model for either engine."""

from __future__ import annotations

from taskspec.robot.errors import RobotError
from taskspec.robot.library import builtin_names, builtin_robots
from taskspec.robot.load import load_robot
from taskspec.robot.operational import OperationalTerms, operational_terms
from taskspec.robot.start import check_joints, solve_start
from taskspec.robot.types import RobotModel, RobotSummary, ToolGeometry

__all__ = [
    "OperationalTerms",
    "RobotError",
    "RobotModel",
    "RobotSummary",
    "ToolGeometry",
    "builtin_names",
    "builtin_robots",
    "check_joints",
    "load_robot",
    "operational_terms",
    "solve_start",
]
