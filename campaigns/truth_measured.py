"""What the run of a file did of what was announced: a sentence for each finding, by its code.

A finding names a stage, and its code tells what of that stage's ticks it is about: a force, a
speed, a joint, an oscillation, a contact, a time. That is measured in the run's log, and set beside
its bound. `SEEN` begins a sentence of a run that did come to what was said, or so near to it that
nothing but luck was left; `NOT_SEEN` one of a run that did not.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.axis import AXES, ROTATIONS, TRANSLATIONS
from taskspec_runner.verdict.oscillation import LEAST_FORCE, LEAST_MOMENT, LEAST_SPEED

Vector = NDArray[np.float64]

SEEN, NOT_SEEN, ELSEWHERE = "seen", "not seen in the run", "of what the run does not show"
#: A run has come near to a bound where it takes this share of it.
NEAR = 0.9
#: An oscillation is seen from this share of what a verdict takes for one on.
_FELT = 0.1
#: Periods that an amplitude is measured over, and where about a predicted frequency it is sought.
_PERIODS, _ABOUT = 4, np.linspace(0.75, 1.3, 12)
#: What runs away is seen from so far on [mm].
_FAR = 1.0
#: So long before a touch the tool has the rate that it comes with [s].
_BEFORE = 0.02
#: A stage that ends sooner ends as it begins [s].
_AT_ONCE = 0.05
#: Amplitudes that a verdict takes for an oscillation of an axis' effort.
_LEAST = {True: (LEAST_MOMENT, "N m"), False: (LEAST_FORCE, "N")}


class Measured:
    """A run, asked by codes.

    Args:
        run: that came to its end.
    """

    def __init__(self, run: Any) -> None:
        self._run, self._columns = run, run.columns
        self._robot = run.program.context.robot

    def of(self, said: Mapping[str, str]) -> str:
        """What came of a finding, in a sentence; empty where nothing measures its code."""
        ask = _BY_CODE.get(said["code"])
        return "" if ask is None else ask(self, said["stage"], said["text"])

    # --- ticks ---------------------------------------------------------------------------------

    def _ticks(self, stage: str) -> NDArray[np.bool_]:
        """Of a stage, in all its visits; of all the run for none."""
        clock = self._columns["clock"]
        chosen = np.zeros(len(clock), dtype=bool)
        for visit in self._visits(stage):
            chosen |= self._run.rows(visit)
        return chosen if chosen.any() else np.ones(len(clock), dtype=bool)

    def _during(self, name: str, stage: str) -> Vector:
        values = np.asarray(self._columns[name])[self._ticks(stage)]
        return values[np.isfinite(values)]

    def _most(self, name: str, stage: str) -> float:
        return float(np.abs(self._during(name, stage)).max(initial=0.0))

    def _stage_limit(self, name: str, stage: str) -> float:
        names = [stage] if stage else self._run.stages
        bounds = [self._run.limit(name, each) for each in names]
        return min((b for b in bounds if b is not None), default=math.inf)

    # --- by what is measured ---------------------------------------------------------------------

    def force(self, stage: str, text: str) -> str:
        """The largest force against its limit, also of the next stage, which has its blow."""
        stages = [stage, *self._after(stage)] if stage else [""]
        shares = []
        for name in stages:
            every = [f"force.{axis}" for axis in TRANSLATIONS]
            axes = [self._during(each, name) for each in every if each in self._columns]
            peak = float(np.linalg.norm(axes, axis=0).max(initial=0.0))
            shares.append((peak / self._stage_limit("force", name), peak, name))
        share, peak, name = max(shares)
        if not math.isfinite(share) or share == 0.0:
            return f"{NOT_SEEN}: the force came to {peak:.3g} N, and no limit is near"
        most = peak / share
        came = self._came_with(stage) if "meets" in text and share < NEAR else ""
        far = f"{came}the force came to {peak:.3g} N of {most:.3g} N in {name!r}"
        return f"{_word(share)}: {far}{self._how_it_ended(stage, share)}"

    def _came_with(self, stage: str) -> str:
        """How fast the tool was before its touch ended a stage."""
        for visit in self._visits(stage):
            speed = np.asarray(self._columns["speed"])[self._run.rows(visit)]
            last = speed[-math.ceil(_BEFORE / self._run.period) :]
            if len(last):
                return f"it came with {1e3 * float(np.nanmax(last)):.3g} mm/s, "
        return ""

    def speed(self, stage: str, text: str) -> str:
        """What takes most of its bound: the tool's speed, or a joint, if a finding names one."""
        found = {"speed": self._tool(stage)} | {
            f"joint {i}": self._joint(stage, i) for i in range(1, len(self._robot.lower) + 1)
        }
        share, sentence = max([v for k, v in found.items() if k in text] or found.values())
        return f"{_word(share)}: {sentence}{self._how_it_ended(stage, share)}"

    def _how_it_ended(self, stage: str, share: float) -> str:
        """What ended a stage before it came near to its bound."""
        visits = self._visits(stage)
        if share >= NEAR or not visits:
            return ""
        last = visits[-1]
        how, lasted = last.ended_by["name"], last.end - last.start
        return f"; the stage ended by {how!r} after {lasted:.3g} s"

    def _tool(self, stage: str) -> tuple[float, str]:
        """The share of its limit that the speed takes, and a sentence."""
        bound, peak = self._stage_limit("speed", stage), self._most("speed", stage)
        of = f" of {1e3 * bound:.4g} mm/s" if math.isfinite(bound) else ""
        return peak / bound, f"the speed came to {1e3 * peak:.4g} mm/s{of}"

    def _joint(self, stage: str, number: int) -> tuple[float, str]:
        """The same of the bound of a joint that it comes nearest to."""
        robot, i = self._robot, number - 1
        names = [f"joint.{number}.{what}" for what in ("velocity", "torque", "position")]
        v, tau = (self._most(name, stage) for name in names[:2])
        q = np.degrees(self._during(names[2], stage))
        bounds = robot.lower, robot.upper, robot.velocity_limit
        low, high, most = (float(np.degrees(of[i])) for of in bounds)
        middle, half = (low + high) / 2, (high - low) / 2
        far = float(np.abs(q - middle).max(initial=0.0))
        words = f"joint {number} came to"
        strong, rate = float(robot.torque_limit[i]), float(np.degrees(v))
        found = [
            (rate / most, f"{words} {rate:.3g} deg/s of {most:.3g} deg/s"),
            (tau / strong, f"{words} {tau:.3g} N m of {strong:.3g} N m"),
        ]
        if math.isfinite(half):
            within = f"within {half - far:.3g} deg of its limit"
            found.append((far / half, f"{words} {within}"))
        return max((float(share), sentence) for share, sentence in found)

    def ring(self, stage: str, text: str) -> str:
        """How much swung at the frequency that was predicted, at its most and at last."""
        frequency = _number(text, r"at ([\d.e+]+) Hz")
        axis = _text(text, r"axis '(\w+)'")
        if "flip from tick to tick" in text:
            frequency = 0.5 / self._run.period
        if axis not in AXES:
            return ""
        if frequency is None:
            return self._drift(stage, axis)
        turns = axis in ROTATIONS
        kind = "torque" if turns else "force"
        unit = "deg/s" if turns else "mm/s"
        scale = math.degrees(1.0) if turns else 1e3
        least_effort, effort_unit = _LEAST[turns]
        least_rate = LEAST_SPEED / 0.3 if turns else LEAST_SPEED
        found = []
        for name, least, factor, of in (
            (f"{kind}.{axis}", least_effort, 1.0, effort_unit),
            (f"velocity.{axis}", least_rate, scale, unit),
        ):
            swings = self._swings(name, stage, frequency) if name in self._columns else None
            if swings is not None:
                most, last = swings
                found.append((most / least, factor * most, factor * last, of))
        if not found:
            cycles = frequency * max((v.end - v.start for v in self._visits(stage)), default=0.0)
            short = f"{cycles:.2g} periods of {frequency:.3g} Hz"
            return f"{NOT_SEEN}: too short to swing, the stage lasts {short}"
        share, most, last, of = max(found)
        if share < _FELT:
            no_more = f"no more than {most:.2g} {of} at {frequency:.3g} Hz in {axis!r}"
            return f"{NOT_SEEN}: nothing excites it, {no_more}"
        swings = f"{axis!r} swings by {most:.2g} {of} at {frequency:.3g} Hz"
        return f"{SEEN}: {swings}, by {last:.2g} {of} at last"

    def _drift(self, stage: str, axis: str) -> str:
        """How far a tool goes that was to run away."""
        name = f"position.{axis}"
        if axis in ROTATIONS or name not in self._columns:
            return ""
        values = self._during(name, stage)
        far = 1e3 * float(np.ptp(values)) if len(values) else 0.0
        word = SEEN if far > _FAR else NOT_SEEN
        return f"{word}: {axis!r} moves by {far:.3g} mm"

    def _swings(self, name: str, stage: str, frequency: float) -> tuple[float, float] | None:
        """The largest and the last amplitude about a frequency; None in stages too short for it."""
        found: list[float] = []
        column, period = np.asarray(self._columns[name]), self._run.period
        for visit in self._visits(stage):
            values = column[self._run.rows(visit)]
            values = values[np.isfinite(values)]
            size = max(16, math.ceil(_PERIODS / (frequency * period)))
            if len(values) < size:
                continue
            # What the beginning of a stage has is its step, and no swing of its own yet.
            found += [
                _amplitude(values[at : at + size], frequency, period)
                for at in range(size // 2, len(values) - size + 1, max(1, size // 2))
            ]
        return (max(found), found[-1]) if found else None

    def _visits(self, stage: str) -> list[Any]:
        return [visit for visit in self._run.visits if stage in ("", visit.stage)]

    def stiffness(self, stage: str, text: str) -> str:  # noqa: ARG002
        """How many of the plant's steps a swing of the contact takes."""
        contact = self._run.program.context.compliances.get(_text(text, r"'(\w+)'"))
        if contact is None:
            return ""
        return f"{ELSEWHERE}: a swing on the contact takes {2 * math.pi / contact.phase:.2g} steps"

    def begins(self, stage: str, text: str) -> str:  # noqa: ARG002
        """How soon a stage ended."""
        lasted = min((v.end - v.start for v in self._visits(stage)), default=math.inf)
        word = SEEN if lasted < _AT_ONCE else NOT_SEEN
        return f"{word}: the stage ended after {lasted:.3g} s"

    def time(self, stage: str, text: str) -> str:  # noqa: ARG002
        """How much of its bounds a stage took, or how it ended."""
        visits = [v for v in self._run.visits if v.stage == stage]
        if not visits:
            return f"{NOT_SEEN}: the stage was not entered"
        spec = self._run.program.context.loaded.task.stages[stage]
        lasted = max(v.end - v.start for v in visits)
        how = f"it ended by {visits[-1].ended_by['name']!r} after {lasted:.3g} s"
        within = spec.within
        shares = []
        if within is not None and within.time is not None:
            shares.append((lasted / within.time, f"{lasted:.3g} s of {within.time:.3g} s"))
        if within is not None and within.travel is not None:
            travel = self._most("travel", stage)
            shares.append(
                (travel / within.travel, f"{1e3 * travel:.3g} mm of {1e3 * within.travel:.3g} mm")
            )
        if not shares:
            return f"{ELSEWHERE}: {how}"
        share, of = max(shares)
        return f"{_word(share)}: {how}, {of}"

    def effort(self, stage: str, text: str) -> str:  # noqa: ARG002
        """What a mechanism bore, and whether it was at its stop."""
        task = self._run.program.context.loaded.task
        name = (task.robot.grasp or "").removesuffix(".handle")
        held = task.mechanisms.get(name)
        if held is None or held.stop is None:
            return ""
        word, of, factor, unit = ("angle", "torque", math.degrees(1.0), "deg")
        if f"{name}.angle" not in self._columns:
            word, of, factor, unit = ("travel", "force", 1e3, "mm")
        place = self._during(f"{name}.{word}", stage)
        share = max(place.max() / held.stop[1], place.min() / held.stop[0])
        far, most = factor * place.max(), factor * held.stop[1]
        sentence = f"the mechanism came to {far:.4g} {unit} of {most:.4g} {unit}"
        bears = self._columns.get(f"{name}.{of}")
        if bears is not None:
            bore = self._most(f"{name}.{of}", stage)
            sentence += f" and bore {bore:.3g} {'N m' if of == 'torque' else 'N'}"
        return f"{SEEN if share > 1 - 1e-2 else NOT_SEEN}: {sentence}"

    def expected(self, stage: str, text: str) -> str:  # noqa: ARG002
        """What is left of the expectation that keeps least of its tolerance."""
        margins = [m for e in self._run.expectations for m in e.margins if m.left is not None]
        if not margins:
            return ""
        least = min(margins, key=lambda m: m.left)
        return (
            f"{_word(1 - least.left)}: {least.name} keeps {100 * least.left:.2g} % of its tolerance"
        )

    def pressed(self, stage: str, text: str) -> str:
        """What force there was where no object was predicted."""
        along = _text(text, r"along '(\w+)'")
        name = f"force.{along}"
        if name not in self._columns:
            return ""
        most = self._most(name, stage)
        return f"{NOT_SEEN if most > _FELT else SEEN}: {name} came to {most:.2g} N"

    def other(self, stage: str, text: str) -> str:  # noqa: ARG002
        """Of another world than that of the run, or of parts that a run has no contacts of."""
        return f"{ELSEWHERE}: it is about another world, or about links"

    def samples(self, stage: str, text: str) -> str:  # noqa: ARG002
        """Of a sensor whose rate is another than the file has; its run is that of the other one."""
        return f"{ELSEWHERE}: it is one of the rate that is told"

    def _after(self, stage: str) -> list[str]:
        """The stage that followed one, if any did."""
        pairs = pairwise(visit.stage for visit in self._run.visits)
        return [then for now, then in pairs if now == stage and then != stage][:1]


def _word(share: float) -> str:
    return SEEN if share >= NEAR else NOT_SEEN


def _amplitude(values: Vector, frequency: float, period: float) -> float:
    """The largest amplitude about a frequency, of values less their straight line, windowed."""
    n = len(values)
    t = np.arange(n)
    flat = values - np.polyval(np.polyfit(t, values, 1), t)
    window = np.hanning(n)
    waves = np.exp(-2j * np.pi * np.minimum(_ABOUT * frequency, 0.5 / period)[:, None] * period * t)
    return float(np.abs(waves @ (flat * window)).max() * 2 / window.sum())


def _number(text: str, pattern: str) -> float | None:
    found = re.search(pattern, text)
    return None if found is None else float(found[1])


def _text(text: str, pattern: str) -> str:
    found = re.search(pattern, text)
    return "" if found is None else found[1]


_BY_CODE: dict[str, Callable[[Measured, str, str], str]] = {
    **dict.fromkeys(("TS610", "TS616", "TS444"), Measured.force),
    **dict.fromkeys(("TS420", "TS421", "TS424", "TS426", "TS443"), Measured.speed),
    **dict.fromkeys(("TS501", "TS502", "TS505", "TS506", "TS507", "TS430"), Measured.ring),
    "TS307": Measured.stiffness,
    **dict.fromkeys(("TS611", "TS612", "TS617", "TS618", "TS619"), Measured.time),
    "TS327": Measured.pressed,
    "TS613": Measured.begins,
    **dict.fromkeys(("TS322",), Measured.effort),
    **dict.fromkeys(("TS720", "TS722", "TS723", "TS724", "TS725", "TS726"), Measured.expected),
    **dict.fromkeys(("TS304", "TS428", "TS503", "TS504"), Measured.other),
    "TS431": Measured.samples,
}
