"""A task and its stages with all that is decided about them before any expression is built."""

from taskspec.program.plan.design import Design
from taskspec.program.plan.stage import StagePlan
from taskspec.program.plan.task import TaskPlan, Walk

__all__ = ["Design", "StagePlan", "TaskPlan", "Walk"]
