"""What a task file may say: one model per noun, and the steps from text to a checked task."""

from taskspec.spec.adapt import Adapt
from taskspec.spec.axis import AxisEntry
from taskspec.spec.bushing import Bushing
from taskspec.spec.control import Control
from taskspec.spec.equation import Constraint, EquationObject, JointEquation
from taskspec.spec.expectation import Expectation
from taskspec.spec.frame import Frame
from taskspec.spec.gains import AxisValues
from taskspec.spec.key_path import FILE, KeyPath, below, key_of
from taskspec.spec.law import JOINT_LAWS, ForceGains, Law, joint_law
from taskspec.spec.limits import Limits
from taskspec.spec.load import (
    LoadedTask,
    UnreadTaskError,
    load_task,
    load_text,
    read_text,
    tree_of,
)
from taskspec.spec.mechanism import Hinge, Mechanism, Screw, Slide
from taskspec.spec.objects import Object
from taskspec.spec.path import Path
from taskspec.spec.robot import Pose, Robot, Sensor, Start, Tool
from taskspec.spec.set_point import SetPoint
from taskspec.spec.stage import Stage, Within
from taskspec.spec.task import Task
from taskspec.spec.vary import Variation
from taskspec.spec.world import Motion, Shape

__all__ = [
    "FILE",
    "JOINT_LAWS",
    "Adapt",
    "AxisEntry",
    "AxisValues",
    "Bushing",
    "Constraint",
    "Control",
    "EquationObject",
    "Expectation",
    "ForceGains",
    "Frame",
    "Hinge",
    "JointEquation",
    "KeyPath",
    "Law",
    "Limits",
    "LoadedTask",
    "Mechanism",
    "Motion",
    "Object",
    "Path",
    "Pose",
    "Robot",
    "Screw",
    "Sensor",
    "SetPoint",
    "Shape",
    "Slide",
    "Stage",
    "Start",
    "Task",
    "Tool",
    "UnreadTaskError",
    "Variation",
    "Within",
    "below",
    "joint_law",
    "key_of",
    "load_task",
    "load_text",
    "read_text",
    "tree_of",
]
