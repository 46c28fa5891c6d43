"""Tasks that read without an error: every section, all laws, all modes of an axis, all objects."""

from __future__ import annotations

from hypothesis import strategies as st

from taskspec.laws import LAWS

Text = st.SearchStrategy[str]
#: A file that some of them include, from the folder of the shipped tasks.
HABITS = "../tests/fuzz/habits.yaml"
_ROBOTS = ("panda", "ur5e", "robots/arm.urdf", "example-robot-data:iiwa14")


def _one(*words: str) -> Text:
    return st.sampled_from(words)


def _number(low: float, high: float, unit: str) -> Text:
    return st.floats(low, high, allow_nan=False).map(lambda x: f"{x:.4g} {unit}".strip())


def _mapping(required: dict[str, Text], optional: dict[str, Text]) -> Text:
    def written(pairs: dict[str, str]) -> str:
        return "{" + ", ".join(f"{key}: {value}" for key, value in pairs.items()) + "}"

    return st.fixed_dictionaries(required, optional=optional).map(written)


def _list(*entries: Text) -> Text:
    return st.tuples(*entries).map(lambda found: f"[{', '.join(found)}]")


_LENGTH = _number(-200, 200, "mm")
_SIZE = _number(20, 400, "mm")
_ANGLE = _number(-180, 180, "deg")
_PLACE = _list(_number(300, 600, "mm"), _number(-300, 300, "mm"), _number(0, 500, "mm"))
_TURN = _list(_ANGLE, _ANGLE, _ANGLE)
_TIME = _number(0.1, 10, "s")

_TOOL = _mapping(
    {},
    {"radius": _number(2, 40, "mm"), "length": _number(50, 200, "mm"), "mass": _number(0, 2, "kg")},
)
_ROBOT = _mapping({"model": _one(*_ROBOTS)}, {"tool": _TOOL})
_CONTACT = {
    "stiffness": _number(1, 100, "kN/m") | st.just("rigid"),
    "damping": _number(1, 90, "N*s/m"),
    "friction": _number(0, 1, ""),
}
_PLACED = {"xyz": _PLACE, "rpy": _TURN}
_OBJECT = st.one_of(
    _mapping({"shape": st.just("plane")}, _PLACED | _CONTACT),
    _mapping({"shape": st.just("box"), "size": _list(_SIZE, _SIZE, _SIZE)}, _PLACED | _CONTACT),
    _mapping({"shape": st.just("sphere"), "radius": _SIZE}, {"xyz": _PLACE} | _CONTACT),
    _mapping({"shape": st.just("cylinder"), "radius": _SIZE, "length": _SIZE}, _PLACED | _CONTACT),
    _mapping(
        {"shape": st.just("hole"), "radius": _SIZE, "depth": _SIZE},
        {"chamfer": _SIZE, "size": _list(_SIZE, _SIZE, _SIZE)} | _PLACED | _CONTACT,
    ),
    _mapping(
        {"shape": st.just("slot"), "width": _SIZE, "depth": _SIZE},
        {"chamfer": _SIZE, "length": _SIZE} | _PLACED | _CONTACT,
    ),
    _mapping(
        {"shape": st.just("groove"), "angle": _number(20, 160, "deg"), "depth": _SIZE},
        {"length": _SIZE} | _PLACED | _CONTACT,
    ),
)
_SIX = st.lists(_number(0, 9, "kN/m"), min_size=3, max_size=3).flatmap(
    lambda along: st.lists(_number(0, 60, "N*m/rad"), min_size=3, max_size=3).map(
        lambda about: f"[{', '.join(along + about)}]"
    )
)
_BUSHING = _mapping(
    {"bushing": st.just("tool"), "xyz": _PLACE, "stiffness": _SIX},
    {"rpy": _TURN, "damping": st.just("[1 N*s/m, 1 N*s/m, 1 N*s/m, 0, 0, 0]")},
)
_TURNED = _mapping(
    {
        "equation": _one(
            "'rx = 3 deg'", "'rz + 2 rad/m * x >= 1 rad'", "'angle(tool.z, -world.z) <= 20 deg'"
        )
    },
    {},
)
_STOP = {"stop": _one("-5..40 mm", "0 .. 6 mm")}
_DETENT = _mapping(
    {"at": _number(1, 20, "mm"), "force": _number(1, 20, "N"), "width": _number(1, 9, "mm")}, {}
)
_MECHANISM = st.one_of(
    _mapping(
        {"mechanism": st.just("slide"), "mass": _number(0.02, 5, "kg")},
        {
            **_PLACED,
            **_STOP,
            "damping": _number(1, 60, "N*s/m"),
            "friction": _number(0, 20, "N"),
            "detent": _DETENT,
        },
    ),
    _mapping(
        {"mechanism": st.just("hinge"), "inertia": _number(0.01, 2, "kg*m^2")},
        {**_PLACED, "stop": _one("-10..90 deg", "0..45 deg"), "friction": _number(0, 2, "N*m")},
    ),
    _mapping(
        {
            "mechanism": st.just("screw"),
            "pitch": _number(1, 8, "mm/turn"),
            "inertia": _number(0.001, 0.02, "kg*m^2"),
            "mass": _number(0.1, 1, "kg"),
        },
        dict(_PLACED),
    ),
)
_RIDER = st.one_of(
    _mapping(
        {"shape": st.just("box"), "on": st.just("door"), "size": _list(_SIZE, _SIZE, _SIZE)},
        _PLACED | _CONTACT,
    ),
    _mapping(
        {"shape": st.just("sphere"), "on": st.just("door"), "radius": _SIZE},
        {"xyz": _PLACE} | _CONTACT,
    ),
    _mapping(
        {"shape": st.just("cylinder"), "on": st.just("door"), "radius": _SIZE, "length": _SIZE},
        _PLACED | _CONTACT,
    ),
)
_WAY = _one("[1, 0, 0]", "[0, 1, 0.2]", "[0, 0, -3]")
_TRACKING = {
    "filter": _number(0.1, 20, "Hz"),
    "turn": _number(1, 300, "deg/s"),
    "heading": _WAY,
}
_FRAME = st.one_of(
    st.just("{surface: table}"),
    _mapping({"track": st.just("force")}, _TRACKING | {"floor": _number(0.1, 5, "N")}),
    _mapping(
        {"track": st.just("velocity")},
        _TRACKING | {"floor": _number(0.1, 20, "mm/s"), "normal": _WAY},
    ),
)
_FOLLOWED = ("{follows: 2 * x}", "{follows: 5 mm/rad * rz}")
_MOTION = st.one_of(
    _one("hold", "{hold: start}", "{hold: force}", "{follows: x^2 / (1 m) - 3 mm}", *_FOLLOWED),
    _mapping({"velocity": _number(-50, 50, "mm/s")}, {}),
    _mapping({"move": _LENGTH}, {"speed": _number(1, 100, "mm/s")}),
    _mapping({"position": _LENGTH | _one("20 mm * sin(2*pi*t/(2 s))", "reach - 3 mm")}, {}),
)
_TURNING = st.one_of(
    _one("hold", "{follows: 2 rad/m * x}"),
    _mapping({"velocity": _number(-20, 20, "deg/s")}, {}),
    _mapping({"move": _number(-20, 20, "deg")}, {}),
)
_FORCE = _mapping({"force": _number(-40, 40, "N") | st.just("-press")}, {"ramp": _TIME})
_TORQUE = _mapping({"torque": _number(-2, 2, "N*m")}, {})
_AXES = _mapping(
    {},
    dict.fromkeys("xyz", _MOTION | _FORCE) | dict.fromkeys(("rx", "ry", "rz"), _TURNING | _TORQUE),
)
_LIMITS = _mapping(
    {},
    {
        "force": _number(20, 200, "N") | _one("{max: 60 N, then: end}", "{max: 60 N, then: fail}"),
        "torque": _number(5, 50, "N*m"),
        "speed": _number(50, 500, "mm/s"),
    },
)
_PATH = st.one_of(
    _mapping({"line": _mapping({"by": _list(_LENGTH, _LENGTH)}, {}), "time": _TIME}, {}),
    _mapping(
        {"arc": _mapping({"center": _list(_LENGTH, _SIZE), "turns": _number(0.1, 2, "")}, {}),
         "speed": _number(5, 90, "mm/s")},
        {},
    ),
    _mapping(
        {
            "raster": _mapping(
                {"size": _list(_SIZE, _SIZE), "pitch": _number(1, 20, "mm")},
                {"along": _one("x", "y")},
            ),
            "speed": _number(5, 90, "mm/s"),
        },
        {},
    ),
    _mapping(
        {
            "spiral": _mapping(
                {"pitch": _number(0.5, 5, "mm"), "radius": _number(5, 20, "mm")}, {}
            ),
            "time": _TIME,
        },
        {},
    ),
    _mapping(
        {
            "waypoints": _mapping(
                {"points": _list(*[_list(_LENGTH, _LENGTH, _LENGTH)] * 3)},
                {"radius": _number(0, 30, "mm")},
            ),
            "speed": _number(5, 90, "mm/s"),
        },
        {},
    ),
)  # fmt: skip
_JOINTS = _mapping(
    {"joints": st.lists(_number(-170, 170, "deg"), min_size=6, max_size=7).map(
        lambda entries: f"[{', '.join(entries)}]"), "speed": _number(1, 90, "deg/s")},
    {},
)  # fmt: skip
_STAGE = st.one_of(
    _mapping({"path": _JOINTS}, {}),
    _mapping({"use": st.just("push")}, {"with": _mapping({}, {"level": _number(1, 40, "N")})}),
    _mapping(
        {"axes": _AXES, "time": _TIME},
        {
            "repeat": _one("1", "3"),
            "next": _one("end", "[{when: s0.visits < 3, to: s0}, end]", "[{to: fail}]"),
        },
    ),
    _mapping({"axes": _AXES, "time": _TIME}, {"limits": _LIMITS}),
    _mapping({"path": _PATH}, {"axes": _mapping({"z": _FORCE}, {})}),
    _mapping(
        {
            "path": _mapping(
                {
                    "line": _mapping({"by": _list(_LENGTH, _LENGTH)}, {}),
                    "speed": _one(
                        '"20 mm/s * clamp(1 - norm(force)/(9 N), 0, 1)"',
                        '"20 mm/s * smooth(t/(1 s))"',
                    ),
                },
                {},
            ),
            "within": _mapping({"time": _TIME}, {}),
        },
        {},
    ),
    _mapping(
        {
            "axes": _mapping({"z": _mapping({"velocity": _number(-30, -1, "mm/s")}, {})}, {}),
            "until": _one('"force.z < -2 N"', '"force.z < -press / 2 for 10 ms"'),
            "within": _mapping({"time": _TIME}, {"travel": _SIZE}),
        },
        {},
    ),
)
_PAUSE = _mapping({"use": st.just("pause")}, {"with": _mapping({}, {"lasts": _TIME})})
_CONDITION = _one(
    '"max(norm(force)) < 90 N"',
    '"s0.force.z within -press +- 5 N for 50 %"',
    '"max(abs(s0.error.x)) < reach"',
)
_EXPECTED = st.one_of(
    st.lists(_CONDITION, max_size=2, unique=True).map(lambda found: f"[{', '.join(found)}]"),
    _mapping({}, {"soft-touch": _CONDITION, "on_track": _CONDITION, "2nd": _CONDITION}),
)


#: Laws with full matrices of gains, and with gains that vary.
_MATRICES = (
    "{kind: impedance, mass: {linear: 3 kg, xz: 500 g}, stiffness: {x: 1 kN/m, zrx: 9 N/rad}}",
    "{kind: pd, stiffness: {z: 1 kN/m + 100 N/m * sin(2*pi*t/(1 s)), xz: 100 N/m}}",
    '{kind: parallel, stiffness: {z: "max(1 kN/m - 20 N/m * force.z / press, 90 N/m)"}}',
)


@st.composite
def tasks(draw: st.DrawFn) -> str:
    """The text of a task that is read without an error, whatever its checks make of it."""
    law = draw(_one(*LAWS, *_MATRICES))
    world = [f"table: {draw(_OBJECT)}"]
    if draw(st.booleans()):
        world += [f"door: {draw(_MECHANISM)}", f"leaf: {draw(_RIDER)}"]
    if draw(st.booleans()):
        world += [f"mount: {draw(_BUSHING)}", f"turned: {draw(_TURNED)}"]
    included = draw(st.booleans())
    robot = draw(_ROBOT)
    if law in LAWS and LAWS[law].commands == "velocity":
        robot = robot.replace("{", f"{{command: {draw(_one('velocity', 'position'))}, ", 1)
    lines = [
        "taskspec: 1",
        f"robot: {robot}",
        f"params: {{press: {draw(_number(1, 40, 'N'))}, reach: {draw(_number(1, 50, 'mm'))}}}",
        f"world: {{{', '.join(world)}}}",
        f"frames: {{task: {draw(_FRAME)}}}" if draw(st.booleans()) else "frames: {}",
        f"law: {law}",
        "templates: {push: {params: {level: 5 N}, axes: {z: {force: -level}}, time: 1 s}}",
    ]
    if lines[4] != "frames: {}":
        lines.append("frame: task")
    if included:
        lines.append(f"include: {draw(_one(HABITS, f'[{HABITS}]'))}")
    if draw(st.booleans()):
        lines.append(f"limits: {draw(_LIMITS)}")
    stages = draw(st.lists(_STAGE | _PAUSE if included else _STAGE, min_size=1, max_size=3))
    lines.append("stages:")
    lines += [f"  s{i}: {stage}" for i, stage in enumerate(stages)]
    lines.append(f"expect: {draw(_EXPECTED)}")
    return "\n".join(lines) + "\n"
