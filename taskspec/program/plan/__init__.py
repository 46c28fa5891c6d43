"""A task and its stages with all that is decided about them before any expression is built."""

from taskspec.program.plan.stage import Design, StagePlan, TaskPlan, Walk

__all__ = ["Design", "StagePlan", "TaskPlan", "Walk"]
