"""What an editor shows of a key beyond what the models say: a description, examples."""

from __future__ import annotations

from typing import Any

from taskspec.geometry.axis import PAIRS, Axis
from taskspec.spec.schema_meanings import MEANINGS

_NAME = "A name given elsewhere in the file"
_WORDS = "One of a few words"
_ENTRIES = "Named by you; each has keys of its own"
_CONDITION = "force.z < -2 N for 10 ms"

#: By model and key: what it is, where the model has a title alone, and examples.
NOTES: dict[str, tuple[str, tuple[Any, ...]]] = {
    "Task.taskspec": ("Always 1, the version of the language", (1,)),
    "Task.name": ("Small letters, digits and '-'; the file's own name without it", ("wipe-table",)),
    "Task.about": ("One or two sentences for people", ("Wipe a table with 15 N.",)),
    "Task.world": (_ENTRIES, ({"table": {"shape": "plane"}},)),
    "Task.params": ("Values by name, for use in expressions", ({"press": "15 N"},)),
    "Task.frames": (_ENTRIES, ({"task": {"surface": "table"}},)),
    "Task.frame": ("", ("task",)),
    "Task.stages": (
        "In order; " + _ENTRIES[0].lower() + _ENTRIES[1:],
        ({"wait": {"time": "1 s"}},),
    ),
    "Task.expect": (
        "Conditions that a run is judged by: a list, or a mapping of names to them",
        (["max(norm(force)) < 40 N"], {"soft-touch": "max(norm(force)) < 40 N"}),
    ),
    "Task.vary": (
        "The path of a value, and an interval for each component",
        ({"world.table.stiffness": "5..20 kN/m"},),
    ),
    "Task.truth": (
        "The path of a value, and what it really is; nothing of it reaches the controller",
        (
            {"world.table.xyz": [0, 0, "302 mm"]},
            {"faults": [{"sensor": "sticks", "at": "2 s", "for": "50 ms"}]},
        ),
    ),
    "Task.sweep": (
        "How many random worlds are run, and how often they are to succeed",
        ({"worlds": 1000, "expect": "success >= 99 %"},),
    ),
    "Task.reward": (
        "In a second, of true signals, and at the end of a run",
        ({"rate": "-abs(force.z + 12 N)/(5 N)", "passed": 10},),
    ),
    "Robot.joint_friction": (
        "Of the real joints; the controller knows of what control.friction has it compensate",
        ("0.5 N*m",),
    ),
    "Robot.encoder": (
        "What the joints' positions are measured with; by default exactly",
        ("0.1 mrad", {"resolution": "0.1 mrad"}),
    ),
    "JointEncoder.resolution": (
        "From line to line: one for all joints, or one for each",
        ("0.1 mrad",),
    ),
    "Control.velocity": (
        "measured, differences of positions, their low-pass, or an observer",
        ("differences", {"filter": "50 Hz"}, {"observer": "30 Hz"}),
    ),
    "Control.friction": (
        "Compensation of the friction and damping that the robot declares of its joints",
        ("80 %", {"share": "80 %", "width": "10 mrad/s"}),
    ),
    "VelocitySource.filter": ("", ("50 Hz",)),
    "VelocitySource.observer": ("", ("30 Hz",)),
    "FrictionCompensation.share": ("Of friction and damping, up to 100 %", ("80 %",)),
    "FrictionCompensation.width": (
        "Speed of the reference at which 71 % of the share is reached; 10 mrad/s by default",
        ("10 mrad/s",),
    ),
    "FrictionCompensation.time": (
        "Time in which the reference would take an error away; 0.1 s by default",
        ("0.1 s",),
    ),
    "Robot.payload": ("What the tool carries in truth", ("300 g",)),
    "Control.plant_rate": ("", ("2 kHz",)),
    "EquationObject.frame": ("", ("task",)),
    "ForceGains.proportional": ("", (0.5, {"z": 0.5})),
    "Frame.parent": ("", ("world",)),
    "Frame.surface": ("", ("table",)),
    "Frame.heading": ("", ([1, 0, 0],)),
    "Frame.rpy": ("Roll, pitch and yaw about fixed axes", (["0 deg", "0 deg", "90 deg"],)),
    "Frame.estimate": ("", ("normal",)),
    "Hinge.mechanism": ("Always this word", ()),
    "JointEquation.frame": ("", ("task",)),
    "RotationEquation.frame": ("", ("task",)),
    "Law.kind": (_WORDS, ()),
    "Law.orientation": (_WORDS, ()),
    "Law.null_space": ("One of a few words, or a list of them", ("posture", ["joint-limits"])),
    "Law.solve": (_WORDS, ()),
    "Law.solver": (_WORDS, ()),
    "Law.damping_ratio": ("", (0.7, {"z": 1})),
    "Robot.model": ("", ("robots/arm.urdf", "example-robot-data:ur5")),
    "Robot.flange": ("", ("tool0", {"body": "wrist", "rpy": [0, "90 deg", 0]})),
    "Flange.body": ("", ("tool0",)),
    "Robot.protection": (
        "",
        ("panda", "protection.yaml", {"source": "data sheet", "reflex": {"force": "40 N"}}),
    ),
    "Robot.command": (_WORDS, ()),
    "Robot.servo": ("", ("ur5e-speedj", "servo.yaml", {"bandwidth": "20 Hz", "delay": "4 ms"})),
    "Servo.about": ("A few words for people", ("bench 2",)),
    "Servo.sources": ("", ({"delay": "measured in May"},)),
    "Protection.about": ("A few words for people", ("bench 2",)),
    "Protection.source": ("", ("data sheet of 2024",)),
    "Protection.joints": ("Bounds on each joint", ({"speed": "2 rad/s"},)),
    "Protection.tip": ("", ({"speed": "1.7 m/s"},)),
    "Protection.turn": ("", ({"speed": "2.5 rad/s"},)),
    "Protection.reflex": ("", ({"force": "40 N"},)),
    "Protection.sensor": ("", ({"force": "100 N", "torque": "10 N*m"},)),
    **{
        f"{group}.source": ("", ("data sheet of 2024",))
        for group in ("ProtectedJoints", "ProtectedTip", "ProtectedTurn", "Reflex", "SensorRange")
    },
    "Robot.balanced": ("", (True,)),
    "Robot.xacro": ("", ({"name": "ur5e"},)),
    "Robot.grasp": ("", ("door.handle",)),
    "Screw.mechanism": ("Always this word", ()),
    "Shape.shape": (_WORDS, ()),
    "Shape.free": ("true or false", (True,)),
    "Shape.friction": ("", (0.3,)),
    "Shape.on": ("", ("door",)),
    "Slide.mechanism": ("Always this word", ()),
    "Stage.constraints": (
        "Set points of equations, by their names",
        ({"rail": {"force": "20 N"}},),
    ),
    "Stage.attempts": ("A whole number from 1 on", (3,)),
    "Stage.repeat": ("A whole number from 1 on", (5,)),
    "Stage.use": ("", ("press",)),
    "Stage.with": ("By name", ({"level": "12 N"},)),
    "Branch.when": ("", ("knock.visits < 5",)),
    "Branch.to": ("", ("knock",)),
    "Task.include": ("YAML files, relative to the task file", (["cell.yaml"],)),
    "Task.templates": (
        _ENTRIES,
        (
            {
                "press": {
                    "params": {"level": "12 N"},
                    "axes": {"z": {"force": "-level"}},
                    "time": "2 s",
                }
            },
        ),
    ),
    "Stage.until": ("", (_CONDITION,)),
    "Stage.fail_if": ("", ("norm(force) > 60 N",)),
    "Stage.next": ("", ("lift",)),
    "Stage.on_fail": ("", ("retreat",)),
    "Stage.frame": ("", ("task",)),
    "Stage.tare": ("", (True,)),
    "Tool.shape": (_WORDS, ()),
    "Tool.size": ("Full edges; the third is along the tool axis", (["40 mm", "40 mm", "10 mm"],)),
}

_GROUPS = {"linear": "All translations", "angular": "All rotations"}


def annotate(model: str, form: dict[str, Any]) -> None:
    """Adds to each key of a model's JSON Schema what its notes say, in place."""
    for name, field in form.get("properties", {}).items():
        description, examples = NOTES.get(f"{model}.{name}", ("", ()))
        if description:
            field.setdefault("description", description)
        field.setdefault("title", name.replace("_", " ").capitalize())
        meaning, shown = MEANINGS.get(model, {}).get(name, ("", ()))
        if meaning:
            form_of_it = field.get("description", "")
            field["description"] = f"{meaning} {form_of_it}".strip()
        if examples or shown:
            field.setdefault("examples", [*examples, *shown])
        for choice in field.get("anyOf", ()):
            for key, entry in choice.get("properties", {}).items():
                if "title" not in entry:
                    entry["title"] = _GROUPS.get(key) or _axis(key)
    for choice in form.get("anyOf", ()):
        annotate(model, choice)


def _axis(name: str) -> str:
    if name in PAIRS:
        return f"Between {' and '.join(PAIRS[name])}"
    return f"About {name[1:]}" if Axis(name).is_rotation else f"Along {name}"
