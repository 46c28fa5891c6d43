"""What each key means, in a sentence that an editor shows: with its default, and an example."""

from __future__ import annotations

from typing import Any

from taskspec.modes import axis_keys
from taskspec.motion.paths import PATHS
from taskspec.shapes import SHAPES, size_keys, with_size
from taskspec.text.units import alternatives

Meaning = tuple[str, tuple[Any, ...]]

_PLACED = {
    "xyz": ("Position of its origin in the world; by default the world's.", (["500 mm", 0, 0],)),
    "rpy": ("Orientation in the world: turns about the fixed x, then y, then z.",
            ([0, "-90 deg", 0],)),
}  # fmt: skip
_MECHANISM = _PLACED | {
    "mechanism": ("Which motion it allows.", ()),
    "handle": ("Where a robot holds it, in its own axes at coordinate 0.", (["100 mm", 0, 0],)),
    "knob": ("Whether what is held turns on the handle (free) or with it (fixed).", ()),
    "damping": ("Viscous resistance to its motion; by default none.", ()),
    "friction": ("Coulomb friction of its joint; by default none.", ()),
    "stop": ("Least and greatest coordinate, with 0 between them; by default none.", ()),
    "detent": ("A snap along its travel; by default none.", ()),
    "inertia": ("Moment of inertia about its axis.", ("0.02 kg*m^2",)),
    "mass": ("What moves with it.", ("1 kg",)),
}  # fmt: skip
_DETENT: dict[str, Meaning] = {
    "at": ("Coordinate of the snap.", ()),
    "force": ("Greatest resistance before the snap, and pull after it.", ()),
    "width": ("How far the snap reaches to either side.", ()),
}
_SOFT = {
    "stiffness": ("Makes a motion axis soft: what it yields to forces with.", ()),
    "damping": ("Damping of a soft motion axis; by default designed.", ()),
    "contact": ("What it presses on or runs into; by default the object ahead.", ("table",)),
}  # fmt: skip


def _of_axes(*, rotation: bool) -> dict[str, Meaning]:
    keys = (key for key in axis_keys() if key.exists(rotation=rotation))
    return {key.name: (key.meaning, key.examples) for key in keys} | _SOFT


_EQUATION = {
    "equation": ("The constraint. In both directions with =, in one with <= or >=.", ()),
    "frame": ("The frame in which x, y, z, rx, ry and rz count; by default the world.", ()),
    "stiffness": ("How stiffly the world keeps it, along the unit gradient.", ()),
    "damping": ("Damping along the unit gradient.", ()),
}


def _with_examples(meanings: dict[str, Meaning], **examples: Any) -> dict[str, Meaning]:
    """The same with an example for some keys: the unit of one depends on the model."""
    return meanings | {key: (meanings[key][0], (shown,)) for key, shown in examples.items()}


_ANGULAR = _with_examples(_EQUATION, stiffness="2000 N*m/rad", damping="5 N*m*s/rad")
_TURNED_BY = {"at": "20 deg", "force": "1 N*m", "width": "5 deg"}
_MOVED_BY = {"at": "20 mm", "force": "10 N", "width": "5 mm"}


def _size(name: str) -> Meaning:
    key = size_keys()[name]
    owners = alternatives([f"a {owner}" for owner in with_size(name)])
    return key.description or f"Of {owners}{key.extent}.", key.shown


_GAIN = "; a value for all, {linear, angular}, or one for each axis. Left out, it is designed."

MEANINGS: dict[str, dict[str, Meaning]] = {
    "Task": {
        "robot": ("The arm, its tool, and where the run begins.", ({"model": "panda"},)),
        "include": ("Files that bring robot, world, params, frames and templates.", ()),
        "templates": ("Stages with params, for stages to use.", ()),
        "frame": ("The frame of every stage that names none; by default the world.", ()),
        "law": ("Control law of every stage that names none; by default hybrid.",
                ("hybrid", {"kind": "parallel", "force": {"integral": "12 /s"}})),
        "limits": ("What stops the run, in all stages.", ({"force": "60 N", "speed": "250 mm/s"},)),
        "control": ("Rates of controller and plant; by default 1 kHz.", ({"rate": "2 kHz"},)),
    },
    "ProtectedJoints": {
        "speed": ("Greatest of each joint; a run that exceeds it ends.", ("2 rad/s",)),
        "acceleration": ("Greatest of each joint's reference.", ("10 rad/s^2",)),
        "jerk": ("Greatest of each joint's reference.", ("5000 rad/s^3",)),
        "torque_rate": ("Greatest of each joint; kept under solve: qp.", ("1000 N*m/s",)),
    },
    "ProtectedTip": {
        "speed": ("Greatest of the tip; a run that exceeds it ends.", ("1.7 m/s",)),
        "acceleration": ("Greatest of the tip's reference.", ("13 m/s^2",)),
        "jerk": ("Greatest of the tip's reference.", ("6500 m/s^3",)),
    },
    "ProtectedTurn": {
        "speed": ("Greatest of the tool; a run that exceeds it ends.", ("2.5 rad/s",)),
        "acceleration": ("Greatest of the tool's reference.", ("25 rad/s^2",)),
        "jerk": ("Greatest of the tool's reference.", ("12000 rad/s^3",)),
    },
    "Reflex": {
        "force": ("Of the contact, at which the robot's own controller stops; ends a run.",
                  ("40 N",)),
        "torque": ("Of the contact, at which the robot's own controller stops; ends a run.",
                   ("8 N*m",)),
    },
    "SensorRange": {
        "force": ("The greatest that the sensor measures; beyond it a run ends.", ("100 N",)),
        "torque": ("The greatest that the sensor measures; beyond it a run ends.", ("10 N*m",)),
    },
    "Flange": {
        "xyz": ("Where the tool is mounted in that body's frame; by default at its origin.",
                ([0, 0, "40 mm"],)),
        "rpy": ("How the mount is turned in that frame; the tool goes along its z.",
                ([0, "90 deg", 0],)),
    },
    "Payload": {
        "mass": ("Of a point mass that the tool carries in truth.", ("300 g",)),
        "xyz": ("Where it is in the tool's axes, from the tip; by default at the tip.",
                ([0, 0, "20 mm"],)),
    },
    "Sweep": {
        "worlds": ("How many random worlds 'taskspec sweep' runs; by default 100.", (1000,)),
        "expect": ("How often what is to hold, at 95 % confidence.", ("success >= 99 %",)),
    },
    "Adapt": {
        "payload": ("Its weight and inertia join the model of the arm.", ({"mass": "0..2 kg"},)),
        "gravity": ("Its weight alone does.", ({"mass": "0..2 kg"},)),
    },
    "PayloadAdaptation": {
        "mass": ("The estimate begins at the lower one; 0..1 kg by default.", ("0..2 kg",)),
        "reach": ("Along each axis of the tool; 200 mm by default.", ("300 mm",)),
        "bandwidth": ("Errors vanish as exp(-2 pi bandwidth t); 0.5 Hz by default.", ("1 Hz",)),
        "dead_zone": ("Force below which nothing adapts; 0.1 N by default.", ("0.5 N",)),
    },
    "Reward": {
        "rate": ("Plain number in a second, of true signals; or one for each stage by its name.",
                 ("-abs(force.z + 12 N)/(5 N)", {"press": "-norm(error)/(1 mm)"})),
        "passed": ("At the end of a run that did what is expected; by default 0.", (10,)),
        "missed": ("At the end of one that missed an expectation; by default 0.", (-1,)),
        "failed": ("At the end of one that came to fail; by default 0.", (-5,)),
        "stopped": ("At the end of one that a limit stopped; by default 0.", (-10,)),
    },
    "Branch": {
        "when": ("Taken if this holds as the stage ends well; the last branch has none.", ()),
        "to": ("The stage that follows, end or fail.", ()),
    },
    "Fault": {
        "sensor": ("A fault of the force sensor.", ()),
        "torque": ("A fault of what the joints' motors exert.", ()),
        "encoder": ("A fault of what the joints' encoders show.", ()),
        "axis": ("In the tool's axes: one, or a list; by default all that the quantity fits.",
                 ("z", ["x", "z"])),
        "joint": ("Which joints; by default all that the quantity fits.", (3, [2, 3])),
        "stage": ("The stage from whose first start 'at' counts; by default the run.", ("press",)),
        "at": ("When it begins; by default at once.", ("2 s",)),
        "for": ("How long it lasts; by default to the end.", ("50 ms",)),
        "every": ("From one spike to the next; by default 100 ms.", ("100 ms",)),
    },
    "Control": {
        "rate": ("How often the controller acts, 20 Hz to 100 kHz; by default 1 kHz.",
                 ("1 kHz",)),
        "timeout": ("How long it goes on without a reading, and then stops; by default 20 ms.",
                    ("20 ms",)),
    },
    "AxesForm": {
        **{a: (f"What the tool does along {a} of the frame; by default it holds.",
               ({"velocity": "-20 mm/s"}, {"force": "-15 N"})) for a in "xyz"},
        **{f"r{a}": (f"What the tool does about {a} of the frame; by default it holds.",
                     ({"move": "20 deg"}, {"torque": 0})) for a in "xyz"},
    },
    "AngularDetent": _DETENT, "LinearDetent": _DETENT,
    "EquationObject": _with_examples(_EQUATION, stiffness="50 kN/m", damping="50 N*s/m"),
    "JointEquation": _ANGULAR, "RotationEquation": _ANGULAR,
    "Bushing": {
        "bushing": ("The tool: what the spring holds.", ()),
        "xyz": ("Where the tip is at rest, in the world.", (["500 mm", 0, "300 mm"],)),
        "rpy": ("The tip's orientation at rest, in the world; by default pointing down.",
                (["180 deg", 0, 0],)),
        "stiffness": ("Along and about x y z of the rest pose: a diagonal, or 6 rows of 6.",
                      (["2 kN/m", "2 kN/m", "5 kN/m", *["20 N*m/rad"] * 3],)),
        "damping": ("The same of its damper; by default a tenth of critical.",
                    ([*["60 N*s/m"] * 3, *["1 N*m*s/rad"] * 3],)),
    },
    "Hinge": _with_examples(_MECHANISM, detent=_TURNED_BY),
    "Slide": _with_examples(_MECHANISM, detent=_MOVED_BY),
    "Screw": _with_examples(_MECHANISM, detent=_TURNED_BY)
    | {
        "pitch": ("Travel along its axis per angle about it.", ("2 mm/turn",)),
        "takes": ("The loose body that it catches as that comes to its origin.", ("cap",)),
    },
    "Gripper": {
        "axis": ("Of the tool; by default y.", ()),
        "stroke": ("Distance between the open jaws; 80 mm by default.", ("80 mm",)),
        "speed": ("At which it changes; 100 mm/s by default.", ("100 mm/s",)),
        "force": ("The most that each jaw presses with; 70 N by default.", ("70 N",)),
        "pad": ("Radius of the round pads; 8 mm by default.", ("8 mm",)),
    },
    "GripCommand": {
        "object": ("The loose body that the jaws close on.", ("cap",)),
        "force": ("What each jaw presses with.", ("20 N",)),
    },
    "ForceGains": {
        "proportional": (f"Share of the force error that is added at once{_GAIN}", ()),
        "integral": (f"How fast the force error is summed up{_GAIN}", ("12 /s",)),
        "damping": (f"Damping of the motion along force axes{_GAIN}", ("300 N*s/m",)),
    },
    "Frame": {
        "parent": ("The frame in which it is placed; by default the world.", ()),
        "xyz": ("Position of its origin in the parent.", (["400 mm", 0, "300 mm"],)),
        "point": ("origin: the control point is this frame's origin instead of the tool tip.", ()),
        "track": ("While a stage is on, force: z is kept against the contact force; "
                  "velocity: x is kept along the motion.", ()),
        "filter": ("Cutoff of the filter of what is tracked; by default 2 Hz.", ("2 Hz",)),
        "floor": ("Up to this filtered force or speed the frame keeps its direction; by default "
                  "1 N or 2 mm/s.", ("1 N", "2 mm/s")),
        "normal": ("Laid across a tracked velocity as z; by default the world's z.",
                   ([0, 0, 1],)),
        "turn": ("How fast a frame that tracks turns at most; by default 30 deg/s.",
                 ("60 deg/s",)),
    },
    "Law": {
        "kind": ("The equation that turns errors into torques.", ()),
        "mass": (f"Mass that the arm shows to forces{_GAIN}", ("5 kg",)),
        "stiffness": (f"Spring between reference and tool{_GAIN}", ("500 N/m",)),
        "damping": (f"Damper between reference and tool{_GAIN}", ("80 N*s/m",)),
        "bandwidth": ("How fast motion errors vanish; 5 Hz by default.", ("4 Hz",)),
        "damping_ratio": ("Of motion errors; 1, the default, does not overshoot.", ()),
        "dead_band": ("Force error below which admittance stays; none by default.", ("2 N",)),
        "force": ("Gains of the force loop; else they are designed.", ({"integral": "12 /s"},)),
        "sliding": ("Holds motion axes against what the arm's model lacks.",
                    ({"layer": "20 mm/s", "payload": "500 g"},)),
        "disturbance_observer": ("Takes off what pushes the arm beside the measured force.",
                                 ("20 Hz",)),
        "tank": ("What the law may put into the arm beyond what its dampers take.",
                 ("2 J", {"energy": "2 J", "start": "1 J", "power": "5 W"})),
        "estimate": ("Estimates the contact's stiffness as it presses; designed gains follow.",
                     ("2..200 kN/m", {"stiffness": "2..200 kN/m", "memory": "200 ms"})),
        "orientation": ("How orientation errors are measured; so3 has no singularity.", ()),
        "solve": ("closed-form: torques saturate, limits stop. qp: limits are kept.", ()),
        "solver": ("Of the quadratic program; daqp by default.", ()),
        "adapt": ("What the law finds out about the arm; nothing by default.", ("payload",)),
    },
    "Sliding": {
        "layer": ("Within which s = ė + Λ e is met gently; thinner holds closer, and chatters. "
                  "One for translations, {linear, angular}, or one for each axis.",
                  ("20 mm/s",)),
        "gain": ("The most acceleration that it adds; by default what the bounds need.",
                 ("2 m/s^2",)),
        "disturbance": ("Greatest unknown force at the control point, along each axis.",
                        ("10 N", {"linear": "10 N", "angular": "1 N*m"})),
        "payload": ("Greatest unknown mass at the control point.", ("500 g",)),
        "joint_torque": ("Greatest unknown torque of a joint, such as its friction.",
                         ("1 N*m",)),
        "uncertainty": ("By which part the arm's inertia and weight may be wrong.", ("10 %",)),
    },
    "DisturbanceObserver": {
        "bandwidth": ("How fast it follows a disturbance.", ("20 Hz",)),
        "torque": ("The most that it takes off a joint; by default a quarter of its limit.",
                   ("10 N*m",)),
    },
    "StiffnessEstimate": {
        "stiffness": ("From the softest to the stiffest that the contact may be.",
                      ("2..200 kN/m",)),
        "memory": ("Time constant of forgetting while the force changes; by default 200 ms.",
                   ("200 ms",)),
        "dead_zone": ("Smaller changes of the force tell nothing; by default 5 sigma, or 200 mN.",
                      ("300 mN",)),
        "rate": ("How fast gains follow, by the stiffness's logarithm; by default 50 /s.",
                 ("20 /s",)),
    },
    "Limits": {
        "force": ("Greatest contact force; it stops the run, or leads to a stage.",
                  ("60 N", {"max": "40 N", "then": "retreat"})),
        "torque": ("Greatest contact moment about the control point.", ("8 N*m",)),
        "speed": ("Greatest speed of the tool tip.", ("250 mm/s",)),
        "deviation": ("Greatest distance of the control point from its reference on motion axes.",
                      ("20 mm",)),
        "torque_rate": ("Greatest rate of the joints' torques, under solve: qp.", ("1000 N*m/s",)),
    },
    "Motion": {
        **{a: (f"Displacement along its {a}, as an expression of clock.",
               ("2 mm * sin(2*pi*clock*2 Hz)",)) for a in "xyz"},
        **{f"r{a}": (f"Rotation about its {a}, as an expression of clock.",
                     ("5 deg * sin(2*pi*clock*1 Hz)",)) for a in "xyz"},
    },
    "Noise": {"force": ("Standard deviation of each force.", ("0.1 N",)),
              "torque": ("Standard deviation of each moment.", ("0.01 N*m",))},
    "Path": {
        **{name: (form.meaning, form.examples) for name, form in PATHS.items()},
        "joints": (
            "In joint space to these joint positions; or through each of a list of such.",
            (["0 deg", "30 deg", 0],),
        ),
        "speed": ("Greatest speed along it, or of its joints; this or a time.",
                  ("50 mm/s", "30 deg/s")),
        "time": ("For all of it, from rest to rest; this or a speed.", ("4 s",)),
    },
    **{
        name.capitalize(): {key.name: (key.meaning, key.examples) for key in form.keys}
        for name, form in PATHS.items()
        if not form.bare
    },
    "Pose": {"xyz": ("Position in the world; by default its origin.", (["500 mm", 0, 0],)),
             "rpy": _PLACED["rpy"]},
    "Robot": {
        "base": ("Where its base is; by default at the world's origin.", ({"xyz": [0, 0, "1 m"]},)),
        "tool": ("What is mounted on the flange; by default a massless ball of radius 10 mm.",
                 ({"shape": "sphere", "radius": "10 mm", "length": "100 mm"},)),
        "start": ("Where the run begins; by default at the model's home.",
                  ({"xyz": ["500 mm", 0, "340 mm"]},)),
        "posture": ("What a redundant arm stays near; by default its start.",
                    (["0 deg", "-30 deg", "0 deg", "-120 deg", "0 deg", "90 deg", "45 deg"],)),
        "joint_damping": ("Of the real joints, unknown to the controller; by default none.",
                          ("0.5 N*m*s/rad",)),
        "gripper": ("The jaws at the tip that stages close and open.", ({"force": "70 N"},)),
        "sensor": ("What the controller sees of the contact; by default all, one tick late.",
                   ({"noise": "0.1 N", "filter": "60 Hz"},)),
        "command": ("By default torques; velocities and positions are followed by its servo.", ()),
    },
    "Servo": {
        "bandwidth": ("Of the reference that it makes of commands; 20 Hz by default.", ("20 Hz",)),
        "damping": ("Ratio of that reference and of the joints behind it; 1 by default.", (1,)),
        "delay": ("From the controller's output to the servo; 4 ms by default.", ("4 ms",)),
        "rate": ("Of the servo, in whole multiples of the controller's.", ("1 kHz",)),
        "velocity": ("Greatest of its reference; by default that of the robot's file.",
                     ("180 deg/s",)),
        "acceleration": ("Greatest of its reference; by default none.", ("40 rad/s^2",)),
        "jerk": ("Greatest of its reference; by default none.", ("5000 rad/s^3",)),
        "stiffness": ("Torque of a joint that is off its reference; by default as the bandwidth "
                      "makes it of the arm's inertia.", ("2000 N*m/rad",)),
    },
    "Rotation": _of_axes(rotation=True), "Translation": _of_axes(rotation=False),
    "Sensor": {
        "rate": ("Of its samples; by default the controller's.", ("500 Hz",)),
        "delay": ("Beyond the one tick that every sensor is late.", ("2 ms",)),
        "noise": ("Standard deviation of its readings; by default none.", ("0.1 N",)),
        "bias": ("What it shows where there is nothing; by default nothing.",
                 ([0, 0, "2 N", 0, 0, 0],)),
        "filter": ("Corner frequency of its first-order low-pass; by default none.", ("60 Hz",)),
    },
    "Shape": _PLACED | {
        **{name: _size(name) for name in size_keys()},
        "shape": ("; ".join(("What it is", *(s.remark for s in SHAPES.values() if s.remark))) + ".",
                  ()),
        "stiffness": ("Of the whole contact; 20 kN/m by default. A press deforms it by f/k.",
                      ("20 kN/m", "rigid")),
        "damping": ("Of the whole contact; by default a tenth of the critical one of 1 kg.",
                    ("30 N*s/m",)),
        "friction": ("Coulomb's coefficient; 0, the default, is exactly frictionless.", ()),
        "motion": ("How it moves by itself, known to the controller; by default it stands still.",
                   ({"z": "2 mm * sin(2*pi*clock*2 Hz)"},)),
        "free": ("Makes it a loose body, which falls and can be held.", ()),
        "mass": ("Of a loose body.", ("200 g",)),
        "on": ("The mechanism that carries it, in whose axes it is then placed, at coordinate 0.",
               ("door",)),
    },
    "Stage": {
        "grip": ("Closes the gripper on a loose body as the stage begins.",
                 ({"object": "cap", "force": "20 N"},)),
        "release": ("Opens the gripper as the stage begins: true, or the body's name.", (True,)),
        "contact": ("What its axes press on; by default its frame's surface, else what is ahead.",
                    ("table",)),
        "axes": ("What each axis of the frame does; those that are not named hold.",
                 ({"z": {"force": "-15 N"}},)),
        "path": ("A curve for the axes that axes does not name.",
                 ({"line": {"by": ["60 mm"]}, "speed": "50 mm/s"},)),
        "until": ("Ends the stage well when it holds; needs within.", ()),
        "within": ("Ends the stage as a failure where until has not held by then.",
                   ({"time": "5 s", "travel": "50 mm"},)),
        "fail_if": ("Ends the stage as a failure when it holds.", ()),
        "time": ("How long it lasts; not beside until.", ("4 s",)),
        "next": ("Where to go after ending well; by default the following stage.", ()),
        "on_fail": ("Where to go after a failure; by default the run fails.", ()),
        "repeat": ("How often it is done in a row before what follows; by default once.", ()),
        "use": ("The template that the stage is; its own keys go before those of it.", ()),
        "with": ("What the params of the template are here; else their defaults.", ()),
        "attempts": ("Entering it once more than that fails the run; a cycle needs one.", ()),
        "frame": ("Its task frame; by default that of the file.", ()),
        "law": ("Its control law, in place of the file's.", ("hybrid",)),
        "limits": ("Put over the file's limits, key by key.", ({"force": "20 N"},)),
        "allow": ("What a run may do in it and pass: oscillate without end, saturate.",
                  (["oscillation"],)),
    },
    "Start": {
        "xyz": ("Where the tool tip is in the world.", (["500 mm", 0, "340 mm"],)),
        "rpy": ("Orientation of the tip; [180 deg, 0, 0] points straight down, as by default.",
                (["180 deg", 0, 0],)),
        "joints": ("Joint positions instead of a pose.", (["0 deg", "90 deg"],)),
    },
    "Tool": {
        "shape": ("Of its end; a sphere, the default, touches in one point.", ()),
        "radius": ("Of a sphere, 10 mm by default, or of a cylinder.", ("10 mm",)),
        "thickness": ("Of a cylinder, along the tool's axis; by default its whole length.",
                      ("40 mm",)),
        "length": ("From the flange to the tip; by default 100 mm, on planar arms 0.", ("100 mm",)),
        "mass": ("Known to the controller too; by default none.", ("300 g",)),
        "com": ("Centre of mass from the flange, in the tool's axes; by default that of its shape.",
                (["0", "15 mm", "60 mm"],)),
        "inertia": ("About the centre of mass, xx, yy, zz and then xy, xz, yz; by default that of "
                    "its shape.", (["2e-3 kg*m^2", "2e-3 kg*m^2", "1e-3 kg*m^2"],)),
    },
    "Within": {"time": ("Since the stage began.", ("5 s",)),
               "travel": ("Straight distance of the tip from where the stage began.", ("50 mm",))},
}  # fmt: skip
"""By model and key: the meaning, and examples that say more than those of its unit."""
