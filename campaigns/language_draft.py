"""The draft of one task file: sections of plain values, drawn, altered and written.

It knows the language by docs/language alone: keys, units and words.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

import yaml
from draws import Draws

#: A value of the file: text, a number, a list or a mapping.
Value = Any
Section = dict[str, Value]

LAWS = (
    "hybrid",
    "hybrid-multipliers",
    "hybrid-reaction",
    "parallel",
    "parallel-pid",
    "impedance",
    "impedance-natural",
    "pd",
    "pd-joint",
    "stiffness",
)
#: Laws that take a given force at an axis by a loop; the others take it open loop.
FORCE_LOOPS = LAWS[:5]
#: Laws with multipliers: no axis is soft, equations have set points.
MULTIPLIERS = LAWS[1:3]
#: How often each law is written: the default far more often than any other.
_LAW_SHARES = (6, 1.5, 1.5, 2, 1.5, 2, 1.5, 1.5, 1.5, 1)

#: Keys whose value is a time, and those whose value is a rate.
_TIMES, _RATES = {"time"}, {"speed", "velocity"}
#: Of a gain, not of a choice.
_GAINS = {"mass", "stiffness", "damping", "bandwidth", "damping_ratio", "force"}
#: Keys of `world` whose objects are pressed.
_TOUCHED = ("shape", "equation")
#: Of a stiffness, in the place of a number.
_WORDS = ("rigid", "exact")
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?")


def mm(*values: float) -> Value:
    """Lengths [mm]: one, or a list of several."""
    return _quantities(values, "mm")


def deg(*values: float) -> Value:
    """Angles [deg]: one, or a list of several."""
    return _quantities(values, "deg")


def newton(value: float) -> str:
    """A force [N]."""
    return f"{value:g} N"


def _quantities(values: tuple[float, ...], unit: str) -> Value:
    made = [0 if abs(value) < 1e-9 else f"{value:g} {unit}" for value in values]
    return made[0] if len(made) == 1 else made


def scaled(text: str, factor: float) -> str:
    """An expression whose first number is so many times as much."""
    return _NUMBER.sub(lambda found: f"{float(found[0]) * factor:g}", text, count=1)


class LanguageDraft(Draws):
    """A task file in the making.

    Attributes:
        kind: the scene that it is. slip: what is wrong on purpose, empty for nothing.
        law: of the file. model: the robot.
        gain_factor: by which written gains are multiplied.
        sections: of the file by name, in its order; `stages` is one of them.
    """

    def __init__(self, seed: int, number: int) -> None:
        super().__init__(seed, number, 40)
        self.seed, self.number = seed, number
        self.kind, self.slip, self.law, self.model = "", "", "hybrid", ""
        self.gain_factor = 1.0
        self.sections: Section = {
            "taskspec": 1,
            "name": f"task-{number}",
            "robot": {},
            "world": {},
            "params": {},
            "frames": {},
            "frame": "",
            "law": "",
            "limits": {},
            "templates": {},
            "stages": {},
            "expect": [],
            "vary": {},
            "truth": {},
            "sweep": {},
            "control": {},
        }

    def __getitem__(self, section: str) -> Value:
        return self.sections[section]

    def __setitem__(self, section: str, value: Value) -> None:
        self.sections[section] = value

    @property
    def stages(self) -> dict[str, Section]:
        """Stages by name, in the order of the file."""
        return self["stages"]  # type: ignore[no-any-return]

    # --- drawing -----------------------------------------------------------------------------

    def grid(self, low: float, high: float, step: float) -> float:
        """A round number: a whole multiple of a step."""
        count = round((high - low) / step)
        return round(low + step * float(self.rng.integers(0, count + 1)), 9)

    def nice(self, low: float, high: float) -> float:
        """A number of two digits as one writes them, uniform in the logarithm."""
        return float(
            f"{self.spread(low, high):.1e}" if self.chance(0.3) else self._rounder(low, high)
        )

    def _rounder(self, low: float, high: float) -> float:
        digits = [1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8]
        steps = [d * 10**e for e in range(-4, 6) for d in digits]
        value = self.spread(low, high)
        return round(min(steps, key=lambda step: abs(step - value)), 9)

    def pick(self, *values: Value) -> Value:
        """One of several values of any kind."""
        return values[int(self.rng.integers(len(values)))]

    def sign(self) -> int:
        return 1 if self.chance(0.5) else -1

    def param(self, name: str, text: str) -> str:
        """A quantity by its name, or as it stands."""
        if name in self["params"] or not self.chance(0.4):
            return text
        self["params"][name] = text
        return name

    def use_law(self, *among: str) -> str:
        """Draws the file's law of some, or of all."""
        laws = among or LAWS
        self.law = self.one_of(laws, [_LAW_SHARES[LAWS.index(law)] for law in laws])
        self["law"] = self.law
        return self.law

    # --- altering ----------------------------------------------------------------------------

    def places(self, *keys: str, of: Value = None) -> Iterator[tuple[Section, str]]:
        """Mappings of stages, and their keys, that have one of these names."""
        for mapping in _mappings(self.stages if of is None else of):
            yield from ((mapping, key) for key in list(mapping) if key in keys)

    def scale(self, mapping: Section, key: str, factor: float) -> None:
        """Makes a value so many times as much: its number, or the param that it names."""
        text = str(mapping[key])
        named = next((name for name in self["params"] if re.search(rf"\b{name}\b", text)), None)
        if named is not None:
            mapping, key = self["params"], named
        mapping[key] = scaled(str(mapping[key]), factor)

    def lengthen(self, stage: str, factor: float) -> None:
        """Makes a stage so many times as long: the same motion, more slowly."""
        self.stages[stage] = _slower(self.stages[stage], factor, "")

    def soften(self, factor: float) -> None:
        """Makes the contacts of all objects so many times as stiff."""
        for each in self["world"].values():
            if any(key in each for key in _TOUCHED) and each.get("stiffness") not in _WORDS:
                each["stiffness"] = f"({each.get('stiffness', '20 kN/m')})*{factor:g}"

    # --- writing -----------------------------------------------------------------------------

    def written(self) -> str:
        """The file's text."""
        made = {name: each for name, each in self.sections.items() if each or name == "expect"}
        if self.gain_factor != 1.0:
            made["law"] = _multiplied(made.get("law", ""), self.gain_factor)
            made["stages"] = {
                name: {
                    k: _multiplied(v, self.gain_factor) if k == "law" else v for k, v in s.items()
                }
                for name, s in self.stages.items()
            }
        return yaml.dump(made, Dumper=_Plain, sort_keys=False, width=1000, default_flow_style=None)


class _Plain(yaml.SafeDumper):
    """Without anchors, and with `on`, `y` and `no` as the words that they are in the language."""

    yaml_implicit_resolvers = {  # noqa: RUF012
        first: [
            (tag, pattern)
            for tag, pattern in known
            if not (tag == "tag:yaml.org,2002:bool" and first in "yYnNoO")
        ]
        for first, known in yaml.SafeDumper.yaml_implicit_resolvers.items()
    }

    def ignore_aliases(self, data: Value) -> bool:  # noqa: ARG002
        return True


def _mappings(value: Value) -> Iterator[Section]:
    """All mappings in a value, the outermost first."""
    if isinstance(value, dict):
        yield value
        for each in value.values():
            yield from _mappings(each)
    elif isinstance(value, list):
        for each in value:
            yield from _mappings(each)


def _slower(value: Value, factor: float, key: str) -> Value:
    """A part of a stage that goes so many times as slowly."""
    if isinstance(value, Mapping):
        made = {k: _slower(v, factor, k) for k, v in value.items()}
        if "move" in made and "speed" not in made:
            made["speed"] = (
                f"({'30 deg/s' if 'deg' in str(made['move']) else '50 mm/s'})/{factor:g}"
            )
        return made
    if isinstance(value, list) or key in ("until", "fail_if", "when"):
        return value
    if key in _TIMES or (key == "within" and isinstance(value, str)):
        return f"({value})*{factor:g}"
    if not isinstance(value, str):
        return value
    slow = re.sub(r"\bt\b", f"(t/{factor:g})", value)
    return f"({slow})/{factor:g}" if key in _RATES else slow


def _multiplied(law: Value, factor: float) -> Value:
    """A law whose written gains are so many times as much."""
    if not isinstance(law, Mapping):
        return law
    return {key: _times(each, factor) if key in _GAINS else each for key, each in law.items()}


def _times(value: Value, factor: float) -> Value:
    if isinstance(value, Mapping):
        return {key: _times(each, factor) for key, each in value.items()}
    if isinstance(value, list):
        return [_times(each, factor) for each in value]
    return f"({value})*{factor:g}" if isinstance(value, str) else value * factor
