"""What people write in expressions that the language spells otherwise."""

from __future__ import annotations

from collections.abc import Collection

CHARACTERS = {
    "°": "write 'deg' for degrees",
    "µ": "write 'um' for micrometres",
    "μ": "write 'um' for micrometres",
    "·": "write '*'",
    "×": "write '*'",
    "÷": "write '/'",
    "−": "write '-' (this is another character that looks like it)",
    "–": "write '-' (this is another character that looks like it)",
    "²": "write '^2'",
    "³": "write '^3'",
    "≤": "write '<='",
    "≥": "write '>='",
    "π": "write 'pi'",
    "&": "write 'and'",
    "|": "write 'or', or abs(x) for an absolute value",
    "!": "write 'not'",
    ":": "a time is written with its unit, such as 90 s",
    ".": "write a digit before the point, such as 0.5",
    "[": "an expression is one number; there are no lists in it",
    "{": "there are no braces in expressions; use ( )",
    "'": "there are no quotes in expressions",
    '"': "there are no quotes in expressions",
    "#": "a comment needs a space before '#'",
    "_": "a name begins with a letter",
    "$": "a param is written by its bare name, such as press",
    "“": "write plain quotes, or leave them out",
    "”": "write plain quotes, or leave them out",
    "’": "write plain quotes, or leave them out",
}
"""What to write for signs that no expression contains."""

UNIT_WORDS = {
    "newton": "N", "newtons": "N", "meter": "m", "meters": "m", "metre": "m", "metres": "m",
    "millimeter": "mm", "millimeters": "mm", "millimetre": "mm", "millimetres": "mm",
    "ns": "N*s", "nms": "N*m*s",
    "sec": "s", "secs": "s", "second": "s", "seconds": "s", "msec": "ms",
    "degree": "deg", "degrees": "deg", "radian": "rad",
    "radians": "rad", "rads": "rad", "gram": "g", "grams": "g", "kilogram": "kg", "hertz": "Hz",
    "rev": "turn", "revs": "turn", "turns": "turn", "percent": "%", "watt": "W", "joule": "J",
}  # fmt: skip
"""What people write for a unit, and the unit."""

ELSEWHERE = {
    "min": "there is no unit for minutes; write seconds: 60 s for each",
    "mins": "there is no unit for minutes; write seconds: 60 s for each",
    "minute": "there is no unit for minutes; write seconds: 60 s for each",
    "minutes": "there is no unit for minutes; write seconds: 60 s for each",
    "h": "there is no unit for hours; write seconds: 3600 s for each",
    "km": "there is no unit for kilometres; write 1000 m for each, as km/h 0.2778 m/s",
    "in": "there is no unit for inches; write millimetres: 25.4 mm for each",
    "inch": "there is no unit for inches; write millimetres: 25.4 mm for each",
    "inches": "there is no unit for inches; write millimetres: 25.4 mm for each",
    "lb": "there is no unit for pounds; write 0.4536 kg, as a force 4.448 N, for each",
    "lbs": "there is no unit for pounds; write 0.4536 kg, as a force 4.448 N, for each",
    "lbf": "there is no unit for pounds of force; write 4.448 N for each",
    "kgf": "there is no unit for kilograms of force; write 9.807 N for each",
    "kp": "there is no unit for kiloponds; write 9.807 N for each",
}
"""What to write for units that people use and the table has not."""

FUNCTION_WORDS = {
    "peak": "max", "maximum": "max", "minimum": "min", "avg": "mean", "average": "mean",
    "final": "last", "end": "last", "magnitude": "norm", "hypot": "norm", "length": "norm",
    "ln": "log", "pow": "^", "square": "^", "arcsin": "asin", "arccos": "acos", "arctan": "atan",
    "arctan2": "atan2", "stddev": "std", "fabs": "abs", "saturate": "clamp", "smoothstep": "smooth",
}  # fmt: skip
"""What other languages call a function, and its name here."""

KEY_WORDS = {
    "circle": "arc", "goto": "to", "csv": "file", "pos": "xyz", "position": "xyz", "origin": "xyz",
    "location": "xyz", "translation": "xyz", "z": "xyz", "height": "xyz size", "width": "size",
    "spacing": "pitch", "stepover": "pitch", "line_distance": "pitch", "rotation": "rpy",
    "orientation": "rpy", "euler": "rpy", "diameter": "radius", "k": "stiffness",
    "spring": "stiffness", "mu": "friction", "weight": "mass", "type": "kind", "name": "kind",
    "duration": "time", "timeout": "within", "max_time": "within", "when": "until",
    "condition": "until", "stop_when": "until", "abort_if": "fail_if", "retries": "attempts",
    "loop": "attempts", "on_error": "on_fail", "cutoff": "filter", "lowpass": "filter",
    "frequency": "rate", "distance": "move", "goal": "position", "target": "position",
    "pose": "start", "home": "start", "joint": "joints", "q": "joints", "steps": "stages",
    "phases": "stages", "states": "stages", "objects": "world", "environment": "world",
    "scene": "world", "parameters": "params", "variables": "params", "constants": "params",
    "gains": "law", "tcp": "tool", "gripper": "tool", "end_effector": "tool",
    "ft_sensor": "sensor", "force_sensor": "sensor", "checks": "expect",
    "success": "expect", "expectations": "expect", "controller": "law",
}  # fmt: skip
"""What other systems call a key, and its names here, the first that the mapping has."""

VALUE_WORDS = {
    "cube": "box", "cuboid": "box", "block": "box", "ball": "sphere", "rod": "cylinder",
    "disc": "cylinder", "disk": "cylinder",
    "floor": "plane", "wall": "plane", "table": "plane", "flat": "plane", "bore": "hole",
    "revolute": "hinge", "rotary": "hinge", "prismatic": "slide", "slider": "slide",
    "linear": "slide", "helical": "screw", "thread": "screw",
}  # fmt: skip
"""What other systems call a shape or a mechanism, and its name here."""

PARTS = {
    "bushing": "a bushing is no shape: write bushing: tool",
    "bowl": "its inside is a sphere with side: inner, which opens towards its z",
    "dish": "its inside is a sphere with side: inner, which opens towards its z",
    "tube": "its inside is a cylinder with side: inner, its outside a cylinder",
    "pipe": "its inside is a cylinder with side: inner, its outside a cylinder",
    "trough": "its inside is a cylinder with side: inner and an arc, which opens towards its x",
    "dome": "it is a sphere with an arc, such as arc: 60 deg, about its z",
    "cap": "it is a sphere with an arc, such as arc: 60 deg, about its z",
    "panel": "it is a sphere with an arc about its z, or a cylinder with one about its x",
    "stl": "it is a mesh with a file and its unit: shape: mesh, file: part.stl, unit: mm",
    "obj": "it is a mesh with a file and its unit: shape: mesh, file: part.obj, unit: mm",
}
"""Shapes that are a part of another one, or a form of it, and how they are written."""

_CHANGED = {
    ("diameter", "radius"): "half of the diameter",
    ("height", "xyz"): "a list whose third entry is the height",
    ("z", "xyz"): "a list whose third entry is the height",
    ("width", "size"): "a list of all sides",
    ("height", "size"): "a list of all sides",
    ("weight", "mass"): "in kg or g, not in N",
}
"""What becomes of the quantity where the other key is another one."""


def other_word(key: str, keys: Collection[str]) -> str:
    """A hint about a key that other systems use: its name here, if that is among some keys."""
    meant = next((each for each in KEY_WORDS.get(key.lower(), "").split() if each in keys), "")
    if not meant:
        return ""
    changed = _CHANGED.get((key.lower(), meant))
    return f"did you mean '{meant}'?" + (f" It is {changed}" if changed else "")
