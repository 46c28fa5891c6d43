"""`truth.faults`: what happens to sensor, encoders and torques while a run goes on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, create_model

from taskspec.deferred_methods import dataclass
from taskspec.expression import ExpressionError, Problem, ScopeKind, infer, parse
from taskspec.faults import DEVICES, ENCODER, KINDS, SENSOR, TORQUE, FaultKind, kinds_of
from taskspec.geometry.axis import AXES, Axis
from taskspec.spec import values
from taskspec.spec.field_type import FieldType
from taskspec.spec.model import Model
from taskspec.spec.parse_context import ParseContext, kind_of, span_of
from taskspec.spec.quantities import Constant
from taskspec.spec.servo import command_of
from taskspec.spec.words import NameReference, Word, Words
from taskspec.text.codes import register
from taskspec.text.data import Items, Map, Real, Text, Whole
from taskspec.text.suggest import suggestion
from taskspec.text.units import (
    ANGLE,
    ANGULAR_VELOCITY,
    FORCE,
    LENGTH,
    MOMENT,
    NUMBER,
    TIME,
    VELOCITY,
    Quantity,
    alternatives,
    describe,
    in_si,
    noun,
)

register({"TS713": "a fault that cannot happen"})

#: Quantities of slides, and of joints that turn.
_LINEAR = {ENCODER: (LENGTH, VELOCITY), TORQUE: (FORCE, FORCE / TIME)}
_ANGULAR = {ENCODER: (ANGLE, ANGULAR_VELOCITY), TORQUE: (MOMENT, MOMENT / TIME)}
_NO_SIZE = Quantity(0.0, NUMBER)
#: What else people call a kind.
_MEANT = {
    "dropout": "drops",
    "stuck": "sticks",
    "freezes": "sticks",
    "frozen": "sticks",
    "holds": "sticks",
    "swap": "swaps",
    "offset": "bias",
    "shifts": "bias",
    "drift": "drifts",
    "delay": "late",
    "delayed": "late",
    "scale": "gain",
    "scaled": "gain",
    "inverted": "flips",
    "sign": "flips",
    "zero": "lost",
    "dead": "lost",
    "off": "lost",
    "spike": "spikes",
    "saturates": "clips",
    "limited": "clips",
    "nan": "drops",
}


@dataclass(frozen=True, slots=True)
class Effect:
    """What a fault does.

    Attributes:
        word: of its kind.
        size: the quantity that follows the word; of no meaning where none does.
        text: as written.
    """

    word: str
    size: Quantity
    text: str

    @property
    def kind(self) -> type[FaultKind]:
        """The fault kind of its word."""
        return KINDS[self.word]


@dataclass(frozen=True)
class Effects(FieldType):
    """The word of a kind, with a quantity where it needs one: `sticks`, `bias 3 N`.

    Attributes:
        device: what it happens to.
    """

    device: str

    def read(self, value: object, context: ParseContext) -> Effect | None:
        """The effect, or None after reporting why there is none."""
        known = kinds_of(self.device)
        if isinstance(value, Whole | Real) or not isinstance(value, Text):
            message = f"what the {self.device} does is needed here, this is {kind_of(value)}"
            factor = f"gain {value:g}" if isinstance(value, Whole | Real) else ""
            hint = f"did you mean '{factor}'?" if factor else f"one of: {', '.join(self._forms)}"
            context.error("TS022", message, span_of(value), hint)
            return None
        word, _, rest = str(value).strip().partition(" ")
        kind = known.get(word)
        if kind is None:
            self._unknown(value, word, context)
            return None
        sizes = kind.sizes[self.device]
        if not sizes:
            if rest.strip():
                message = f"'{word}' is all that is written of it, and '{rest.strip()}' follows"
                hint = "channels are named by 'axis' or 'joint', times by 'at' and 'for'"
                context.error("TS713", message, span_of(value), hint)
                return None
            return Effect(word, _NO_SIZE, str(value))
        if not rest.strip():
            message = f"'{word}' needs a quantity: {alternatives([noun(d) for d in sizes])}"
            hint = f"such as {word} {kind.examples[self.device]}"
            context.error("TS713", message, span_of(value), hint)
            return None
        size = self._size(value, word, context)
        return None if size is None else Effect(word, size, str(value))

    @property
    def _forms(self) -> list[str]:
        known = kinds_of(self.device).items()
        return [f"{word} {kind.examples.get(self.device, '')}".rstrip() for word, kind in known]

    def _unknown(self, value: Text, word: str, context: ParseContext) -> None:
        known = kinds_of(self.device)
        meant = _MEANT.get(word.lower().rstrip(":"), "")
        hint = f"did you mean '{meant}'?" if meant in known else ""
        if not hint and word[:1] in "+-.0123456789":
            hint = "a factor is 'gain 0.8', a constant that is added 'bias', with its unit"
        if word in KINDS:
            hint = f"what a fault of the {self.device} does: {', '.join(known)}"
            others = [device for device in DEVICES if device in KINDS[word].sizes]
            message = f"'{word}' happens to {alternatives(others)}, not to the {self.device}"
        else:
            message = f"unknown fault '{word}' of the {self.device}"
            if word[:1] in "+-.0123456789":
                message = f"what the {self.device} does is a word, and '{value}' has none"
            hint = hint or suggestion(word, known, f"what a fault of the {self.device} does")
        context.error("TS025", message, span_of(value), hint)

    def _size(self, value: Text, word: str, context: ParseContext) -> Quantity | None:
        kind = kinds_of(self.device)[word]
        sizes = kind.sizes[self.device]
        # Spaces in place of the word keep the columns of what follows.
        padded = str(value).replace(word, " " * len(word), 1)
        try:
            node = parse(padded, "sum")
        except ExpressionError as error:
            context.problems(value, error.problems)
            return None
        found, problems = infer(node, context.scope(ScopeKind.CONSTANT))
        if not problems and found.dimension is not None and found.dimension not in sizes:
            needed = alternatives([noun(dimension) for dimension in sizes])
            message = f"{needed} is needed here, this is {describe(found.dimension)}"
            hint = f"such as {word} {kind.examples[self.device]}"
            problems = (Problem("TS112", message, node.start, node.end, hint),)
        context.problems(value, problems)
        if problems or found.kind != "number":
            return None
        size = values.number(value, node, context)
        if size is None:
            return None
        dimension = found.dimension or sizes[0]
        bound, relation = None, ""
        if kind.least is not None and size < kind.least:
            bound, relation = kind.least, "at least"
        elif kind.most is not None and size > kind.most:
            bound, relation = kind.most, "at most"
        if bound is not None:
            limit = in_si(bound, dimension) if bound else "0"
            message = f"this has to be {relation} {limit}"
            context.problems(value, (Problem("TS118", message, node.start, node.end),))
            return None
        return Quantity(size, dimension)

    def json(self) -> dict[str, Any]:
        """Describes the words."""
        words = "|".join(kinds_of(self.device))
        return {
            "type": "string",
            "pattern": f"^\\s*({words})(\\s|$)",
            "examples": self._forms,
        }


@dataclass(frozen=True)
class Joints(FieldType):
    """Numbers of joints, counted from 1: one, or a list."""

    def read(self, value: object, context: ParseContext) -> tuple[int, ...]:
        """The numbers in the order of the file."""
        entries = value if isinstance(value, Items) else [value]
        if isinstance(value, Items) and not value and not value.node.broken:
            context.error("TS023", "this list is empty", span_of(value))
        found: list[int] = []
        for entry in entries:
            if not isinstance(entry, Whole) or entry < 1:
                message = "the number of a joint is needed here, counted from 1"
                context.error("TS022", message, span_of(entry), "such as joint: 3, or [2, 3]")
            elif int(entry) in found:
                context.error("TS023", f"{entry} stands in this list twice", span_of(entry))
            else:
                found.append(int(entry))
        return tuple(found)

    def json(self) -> dict[str, Any]:
        """Describes both forms."""
        one = {"type": "integer", "minimum": 1}
        return {"anyOf": [one, {"type": "array", "minItems": 1, "items": one}]}


_DURATION = Annotated[float, Constant(TIME, above=0)]

if TYPE_CHECKING:
    _Lasting = Model
else:
    # `for` is no name of Python's.
    _Lasting = create_model(
        "_Lasting",
        __base__=Model,
        **{
            "for": (
                _DURATION | None,
                Field(None, title="How long it lasts", description="By default to the end"),
            )
        },
    )


class Fault(_Lasting):
    """Something that happens to what is measured or exerted, from a time on.

    Attributes:
        sensor, torque, encoder: what the device does; one of them is given.
        axis: channels of the sensor, in the tool's axes; all that fit without.
        joint: whose torque or encoder, counted from 1; all that fit without.
        stage: `at` counts from when it is first entered; None for the start of the run.
        at: when it begins [s].
        every: of what comes again and again, from one time to the next [s].
    """

    noun = "a fault"
    example = "{sensor: sticks, at: 2 s, for: 50 ms}"
    advice = {  # noqa: RUF012
        "until": "a fault lasts 'for' a time",
        "to": "a fault lasts 'for' a time",
        "duration": "did you mean 'for'?",
        "from": "did you mean 'at'?",
        "time": "did you mean 'at'?",
        "after": "did you mean 'at'?",
        "in": "did you mean 'stage'?",
        "axes": "did you mean 'axis'? It takes one axis, or a list",
        "joints": "did you mean 'joint'? It takes one number, or a list",
        "motor": "did you mean 'torque'?",
        "force": "did you mean 'sensor'?",
    }

    sensor: Annotated[Effect | None, Effects(SENSOR)] = Field(
        None, title="What the force sensor does"
    )
    torque: Annotated[Effect | None, Effects(TORQUE)] = Field(
        None, title="What a joint's torque does"
    )
    encoder: Annotated[Effect | None, Effects(ENCODER)] = Field(
        None, title="What a joint's encoder does"
    )
    axis: Annotated[tuple[str, ...], Words(Word(tuple(AXES), "axis"))] = Field(
        (), title="Channels of the sensor", description="In the tool's axes; by default all"
    )
    joint: Annotated[tuple[int, ...], Joints()] = Field(
        (), title="Number of the joint", description="Counted from 1; by default all"
    )
    stage: Annotated[str, NameReference(lambda r: r.stages, "stage", "TS124")] | None = Field(
        None, title="In which stage", description="'at' counts from its first start"
    )
    at: Annotated[float, Constant(TIME, least=0)] = Field(0.0, title="When it begins")
    every: Annotated[float, Constant(TIME, above=0)] = Field(
        0.1, title="From one time to the next", description="Of spikes"
    )

    @property
    def device(self) -> str:
        """The device that fails: sensor, torque or encoder."""
        return next(device for device in DEVICES if getattr(self, device) is not None)

    @property
    def effect(self) -> Effect:
        """The effect on the device."""
        found = getattr(self, self.device)
        assert isinstance(found, Effect)
        return found

    @property
    def lasts(self) -> float | None:
        """How long [s]; None to the end."""
        found: float | None = getattr(self, "for")
        return found

    def channels(self, hinges: Sequence[bool]) -> tuple[int, ...]:
        """Rows of a sensor's reading, or joints from 0 on: those that are named, or all that fit.

        Args:
            hinges: whether each joint turns; else it slides.
        """
        if self.device == SENSOR:
            return tuple(Axis(axis).row for axis in self.axis) or _fitting(self.effect)
        if self.joint:
            return tuple(number - 1 for number in self.joint)
        return tuple(i for i, turns in enumerate(hinges) if self.fits(turns=turns))

    def fits(self, *, turns: bool) -> bool:
        """Whether its quantity may be one of a joint that turns, or else slides."""
        dimension = self.effect.size.dimension
        linear, angular = _LINEAR[self.device], _ANGULAR[self.device]
        return dimension not in (linear if turns else angular)

    @property
    def text(self) -> str:
        """It in words: `sensor: sticks`, `torque of joint 3: gain 0.8`."""
        where = f" {', '.join(self.axis)}" if self.axis else ""
        if self.joint:
            of = "joint" if len(self.joint) == 1 else "joints"
            where = f" of {of} {', '.join(map(str, self.joint))}"
        return f"{self.device}{where}: {self.effect.text}"

    @classmethod
    def rules(cls, data: Map, context: ParseContext) -> None:
        """One thing happens to one device, on channels that it has."""
        given = [device for device in DEVICES if device in data]
        if not given:
            if id(data.node) not in context.quiet and not data.node.broken:
                context.error("TS021", f"a fault needs one of the keys {alternatives(DEVICES)}",
                              span_of(data), f"such as {cls.example}")  # fmt: skip
            return
        if len(given) > 1:
            message = f"a fault happens to one thing, this names {' and '.join(given)}"
            context.error("TS026", message, data.node.key_span(given[1]), "write two faults")
            return
        device = given[0]
        command = command_of(context.data)
        if device == TORQUE and command != TORQUE:
            context.error(
                "TS026",
                f"joints that are commanded a {command} have no faults of torques",
                data.node.key_span(device),
                "what its servo does otherwise stands in truth, such as "
                "truth: {robot.servo.bandwidth: 10 Hz}",
            )
        wrong, right = ("joint", "axis") if device == SENSOR else ("axis", "joint")
        if wrong in data:
            message = f"a fault of the {device} has no '{wrong}'"
            context.error("TS026", message, data.node.key_span(wrong), f"name the '{right}'")
        text = data[device]
        word = str(text).split()[0] if isinstance(text, Text) and str(text).strip() else ""
        kind = kinds_of(device).get(word)
        if kind is None:
            return
        if "every" in data and not kind.recurs:
            recurring = [w for w, k in kinds_of(device).items() if k.recurs]
            message = f"'{word}' does not come again and again"
            hint = f"'every' belongs to {alternatives(recurring)}"
            context.error("TS026", message, data.node.key_span("every"), hint)
        if kind.channels is not None:
            named = data.get(right)
            count = len(named) if isinstance(named, Items) else int(right in data)
            if count != kind.channels:
                example = "axis: [x, y]" if device == SENSOR else "joint: [2, 3]"
                message = f"'{word}' needs {kind.channels} channels, this names {count}"
                place = span_of(named) if right in data else span_of(text)
                context.error("TS713", message, place, f"such as {example}")

    def report_unfit(self, data: Map, context: ParseContext) -> None:
        """Reports a quantity that is none of the channels': a force about an axis."""
        named, effect = data.get("axis"), getattr(self, SENSOR)
        # An effect that is not one, or an axis that is none, has been reported.
        if named is None or not isinstance(effect, Effect):
            return
        fitting = _fitting(effect)
        for entry in named if isinstance(named, Items) else [named]:
            if str(entry) in AXES and Axis(str(entry)).row not in fitting:
                right = ", ".join(axis for axis in AXES if axis.row in fitting)
                size = effect.text.partition(" ")[2].strip()
                message = f"'{entry}' of the sensor does not measure {size}"
                context.error("TS713", message, span_of(entry), f"axes that do: {right}")


def _fitting(effect: Effect) -> tuple[int, ...]:
    """Rows of a sensor's reading that an effect may act on."""
    sizes = effect.kind.sizes[SENSOR]
    if len(sizes) != 2:  # a factor, a time, or nothing
        return tuple(axis.row for axis in AXES)
    about = effect.size.dimension == sizes[1]
    return tuple(axis.row for axis in AXES if axis.is_rotation == about)
