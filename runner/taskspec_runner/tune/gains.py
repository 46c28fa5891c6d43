"""The gains of a task that may be moved, and how a file says them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression
from taskspec.geometry.axis import AXES, PAIRS, ROTATIONS, Axis, entry_dimension, is_mixed
from taskspec.laws.gains import DEAD_BAND, JOINT_DAMPING, Gain, LawGain
from taskspec.program.plan import StagePlan
from taskspec.program.program import Program
from taskspec.spec.law import Law
from taskspec.stability.sampled_stage import control_of
from taskspec.text import nodes
from taskspec.text.units import show

Values = Mapping[str, float]
"""A gain by entry: axis, pair of axes or joint [SI]."""
Setting = tuple[Values | None, ...]
"""Of each knob its values; None where the gain stays as the file has it, or as it is designed."""

#: Digits that a gain is written with.
_DIGITS = 3
#: How far a gain is moved, either way: of a motion, which others than the expectations may rely on,
#: less far than that of a force.
_MOST, _MOST_OF_MOTION = 16.0, 4.0
_OF_MOTION = ("bandwidth", "damping_ratio")
_ROUNDING = 1e-9
#: Axes of a knob that are named one by one, at most.
_NAMED = 3
_GAINS_OF_LAWS = ("mass", "stiffness", "damping", "bandwidth", "damping_ratio", "dead_band")


@dataclass(frozen=True, slots=True)
class Knob:
    """One factor on a gain: of a law in the stages that share their control.

    Attributes:
        stages: these stages, in the order of the file.
        gain: the gain.
        values: as the file has it, or as it is designed.
        written: entries of the same gain that the file gives and that do not move.
        given: whether the file gives any of `values`.
    """

    stages: tuple[str, ...]
    gain: LawGain
    values: Values
    written: Values
    given: bool

    @property
    def key(self) -> str:
        """The gain as a law in a file has it."""
        return "damping" if self.gain is JOINT_DAMPING else self.gain.name

    @property
    def name(self) -> str:
        """What to call it, such as `press force.integral (z)`."""
        return f"{', '.join(self.stages)} {self.key} ({_axes(self.values)})"

    def reaches(self, values: Values | None, factor: float) -> bool:
        """Whether a factor leads no farther from the file's values than it should."""
        on, start = next(iter(self.values.items()))
        total = self.times(values, factor)[on] / start
        most = _MOST_OF_MOTION if self.key in _OF_MOTION else _MOST
        return 1 / most <= total * (1 + _ROUNDING) and total <= most * (1 + _ROUNDING)

    def times(self, values: Values | None, factor: float) -> Values:
        """Its values times a factor."""
        return {on: value * factor for on, value in (values or self.values).items()}

    def text(self, values: Values) -> str:
        """Its values as a file has them, such as `{z: 12 1/s}`."""
        if self.gain is JOINT_DAMPING:
            return f"[{', '.join(self._one(value, 'rx') for value in values.values())}]"
        parts = {on: self._one(value, on) for on, value in values.items()}
        return f"{{{', '.join(f'{on}: {text}' for on, text in _grouped(parts).items())}}}"

    def _one(self, value: float, entry: str) -> str:
        if is_mixed(entry):
            return show(value, entry_dimension(self.gain.dimension, entry), _DIGITS)
        return self.gain.setting(value, angular=entry in ROTATIONS or entry in _TURNING)


_TURNING = tuple(pair for pair in PAIRS if pair.startswith("r") and not is_mixed(pair))


def _axes(entries: Values) -> str:
    whole = [*entries]
    if len(whole) > _NAMED and all(each in AXES for each in whole):
        return ", ".join((whole[0], "...", whole[-1]))
    return ", ".join(whole)


def _grouped(parts: Mapping[str, str]) -> Mapping[str, str]:
    """Entries by `linear` and `angular` where all translations, and all rotations, are alike."""
    if any(on not in AXES for on in parts) or len(parts) <= 1:
        return parts
    found = {}
    for word, axes in (("linear", AXES[:3]), ("angular", AXES[3:])):
        texts = {parts[axis] for axis in axes if axis in parts}
        if len(texts) > 1:
            return parts
        if texts:
            found[word] = texts.pop()
    return found if len(found) < len(parts) else parts


def knobs_of(program: Program, only: Sequence[str] = ()) -> list[Knob]:
    """The gains of a task's laws that are numbers or designed, each with its axes of one kind.

    Axes that press and axes that move have knobs of their own; a matrix that couples axes is one.
    A stiffness of an axis itself, a dead band, gains that vary, and those along equations stay.

    Args:
        program: the task.
        only: names of gains; all of them where it is empty.
    """
    groups: dict[str, list[StagePlan]] = {}
    for stage in program.stages:
        if stage.plan.joint_path is None:
            groups.setdefault(control_of(stage.plan), []).append(stage.plan)
    return [
        knob
        for stages in groups.values()
        for knob in _of_stage(stages[0], tuple(each.name for each in stages))
        if not only or knob.key in only
    ]


def _of_stage(plan: StagePlan, names: tuple[str, ...]) -> Iterator[Knob]:
    law, varying = plan.law, {name for name, _ in plan.law.varying}
    for declared in law.control_law.gains:
        joints = declared.name == "damping" and law.control_law.damps_joints
        gain = JOINT_DAMPING if joints else declared
        found = plan.gains.get(gain.name, {})
        if declared is DEAD_BAND or declared.name in varying or not found:
            continue
        for part in _parts(plan, gain, found):
            given = {
                on: float(value)
                for on, value in law.by_entry.get(gain.name, {}).items()
                if on in found and on not in part and not isinstance(value, Expression)
            }
            values = {on: gain.value for on, gain in part.items()}
            in_file = any(each.origin == "file" for each in part.values())
            yield Knob(names, gain, values, given, in_file)


def _parts(
    plan: StagePlan, gain: LawGain, found: Mapping[str, Gain]
) -> Iterator[Mapping[str, Gain]]:
    """Entries of a gain that move together."""
    if gain is JOINT_DAMPING:
        yield found
        return
    own = {"stiffness": "stiffness", "damping": "damping"}.get(gain.name)
    moved = {
        on: each
        for on, each in found.items()
        if (on in PAIRS or on in AXES) and each.value != 0 and not _has_own(plan, on, own)
    }
    if any(on in PAIRS for on in moved):
        yield moved
        return
    forced = {str(axis) for axis, entry in plan.spec.axes.items() if entry.has_force}
    pressing = {on: each for on, each in moved.items() if on in forced}
    moving = {on: each for on, each in moved.items() if on not in pressing}
    yield from (part for part in (pressing, moving) if part)


def _has_own(plan: StagePlan, on: str, key: str | None) -> bool:
    """Whether an axis itself has the stiffness or damping."""
    if key is None or on not in AXES:
        return False
    entry = plan.spec.axes.get(Axis(on))
    return entry is not None and getattr(entry, key) is not None


def overrides(
    program: Program, knobs: Sequence[Knob], setting: Setting, *, bare: bool = False
) -> dict[str, str]:
    """A setting as overrides of the file, in the order in which they apply.

    Args:
        program: of the file as it is.
        knobs: of it.
        setting: of them.
        bare: whether gains of the file are left out where the setting has none.
    """
    root, task = program.context.loaded.root, program.context.loaded.task
    found: dict[str, str] = {}
    for stage in dict.fromkeys(name for knob in knobs for name in knob.stages):
        own = [(k, v) for k, v in zip(knobs, setting, strict=True) if stage in k.stages]
        moved = {knob.key: knob for knob, values in own if values is not None}
        if not moved and not bare:
            continue
        node, depth = nodes.find(root, ("stages", stage, "law"))
        named = depth == len(("stages", stage, "law"))
        # What a template or an included file gives is written out here.
        if bare or not named or node.span.via or node.span.source:
            shared = node if named else root.get("law")
            law = task.stages[stage].law or task.law
            found[f"stages.{stage}.law"] = _law(shared, law, without_gains=bare)
        for key, knob in moved.items():
            entries: dict[str, float] = {} if bare else dict(knob.written)
            for each, values in own:
                if each.key == key and values is not None:
                    entries |= values
            for each, values in own:
                if each.key == key and values is None and each.given and not bare:
                    entries |= each.values
            found[f"stages.{stage}.law.{key}"] = knob.text(_sorted(entries))
    return found


def _sorted(entries: Values) -> Values:
    order = [*AXES, *PAIRS]
    return dict(sorted(entries.items(), key=lambda e: order.index(e[0]) if e[0] in order else -1))


def _law(shared: nodes.Node | None, law: Law, *, without_gains: bool) -> str:
    """A law in one line, as the file has it; with its kind alone where it has none."""
    keys = {"kind": law.kind}
    if isinstance(shared, nodes.Mapping):
        for key, (_, value) in shared.entries.items():
            if not (without_gains and key in (*_GAINS_OF_LAWS, "force")):
                keys[key] = nodes.in_one_line(value)
    return f"{{{', '.join(f'{key}: {text}' for key, text in keys.items())}}}"
