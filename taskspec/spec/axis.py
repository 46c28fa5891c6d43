"""`axes`: what each axis of the task frame does during a stage."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from pydantic import Field, GetCoreSchemaHandler, PrivateAttr, create_model
from pydantic_core import CoreSchema, core_schema

from taskspec.expression import Expression
from taskspec.geometry.axis import AXES, Axis
from taskspec.modes import (
    AxisMode,
    Force,
    Hold,
    ModeKey,
    all_modes,
    axis_keys,
    companions,
    force_given,
    force_keys,
    mode_given,
)
from taskspec.motion.paths import all_paths
from taskspec.spec.fields import ContactName
from taskspec.spec.followed import Followed
from taskspec.spec.linear_ramp import RampedFormula
from taskspec.spec.model import Model, complete, short_form
from taskspec.spec.parse_context import ParseContext
from taskspec.spec.quantities import Constant, Formula
from taskspec.spec.words import Switch, Word
from taskspec.text.codes import register
from taskspec.text.data import Map, Text, TruthValue
from taskspec.text.nodes import pointer
from taskspec.text.units import (
    ANGULAR_DAMPING,
    ANGULAR_STIFFNESS,
    DAMPING,
    STIFFNESS,
    TIME,
    alternatives,
)

register(
    {
        "TS201": "an axis without a mode",
        "TS202": "two motions on one axis",
        "TS204": "a key that does not belong to the axis's mode",
        "TS205": "a force on a rotation, or a torque on a translation",
    }
)

_MODES = all_modes(__name__)
MOTIONS = tuple(_MODES)
"""The keys of which one gives a mode."""
FORCES = force_keys()
"""The keys of which one gives a force set point."""
SHORT = {name: mode.word for name, mode in _MODES.items() if mode.word}
"""Modes that a file may give by their name alone, and the value that their key then has."""
_STIFF = ("stiffness", "damping")
_COMPANIONS = tuple(companions())
_CURVES = {
    name: f"a curve stands beside 'axes': path: {{{name}: .., time: 4 s}}; it drives the axes that "
    "'axes' does not name"
    for name in (*all_paths(__name__), "circle")
}
_CURVES["circle"] = _CURVES["circle"].replace("circle", "arc")
"""What to write in place of a path under an axis."""

Ramp = Annotated[float, Constant(TIME, least=0)]


def _type_of(key: ModeKey, *, rotation: bool) -> Any:
    """What a field for a key holds."""
    if key.words:
        return Annotated[str, Word(key.words, key.name)]
    if key.switch:
        return Annotated[bool, Switch()]
    dimension = key.dimension.on(rotation=rotation)
    if key.mechanism and key.scope is not None:
        return Annotated[str | Expression, Followed(Formula(dimension, key.scope))]
    if key.scope is not None:
        formula = RampedFormula if key.ramped else Formula
        return Annotated[Expression, formula(dimension, key.scope)]
    return Annotated[float, Constant(dimension, above=key.above, least=key.least)]


def _field(key: ModeKey, *, rotation: bool) -> tuple[Any, Any]:
    """A key as a field of a model: its type, and what is known of it."""
    if not key.exists(rotation=rotation):
        return None, Field(None, exclude=True)
    title = (rotation and key.about) or key.title
    description = key.description or None
    return _type_of(key, rotation=rotation) | None, Field(
        None, title=title, description=description
    )


if TYPE_CHECKING:

    class _AxisKeys(Model):
        """The keys of all modes, of forces, and of soft axes."""

        def __getattr__(self, name: str) -> Any: ...

else:
    _AxisKeys = create_model(
        "_AxisKeys",
        __base__=Model,
        __module__=__name__,
        **{key.name: (Any, None) for key in axis_keys()},
    )


def _short(name: Text) -> Text | TruthValue:
    """The value that the key of a mode has where a file gives its name alone."""
    if any(key.name == name and key.switch for key in _MODES[name].keys):
        return TruthValue(True, name.node)
    value = Text(SHORT[name])
    value.node = name.node
    return value


class AxisEntry(_AxisKeys):
    """One axis: one motion or one force; both only under a parallel law.

    The keys of the modes and of `Force` are attributes too; None for those that are left out.

    Attributes:
        stiffness: of a soft motion axis [N/m, N*m/rad].
        damping: of a soft motion axis [N*s/m, N*m*s/rad].
        contact: the object that it presses on, or runs into; None for the one ahead.
    """

    noun = "an axis"
    example = "such as {hold: start} or {force: -15 N}"
    short: ClassVar = {"const": next(iter(SHORT))} if len(SHORT) == 1 else {"enum": list(SHORT)}
    rotation: ClassVar[bool] = False
    advice: ClassVar = _CURVES | dict.fromkeys(
        ("sine", "sin", "sinus", "oscillate", "wave"),
        "a sine is an expression: position: 20 mm * sin(2*pi*t*1 Hz)",
    )

    stiffness: float | None = None
    damping: float | None = None
    contact: ContactName | None = Field(None, title="Object that the axis presses on")
    _kept: Expression | None = PrivateAttr(None)

    @property
    def given(self) -> AxisMode | None:
        """The mode that it gives; None where it has a force alone."""
        return mode_given(self, rotation=self.rotation)

    @property
    def mode(self) -> AxisMode:
        """What decides its motion; a hold where nothing else is given."""
        return self.given or Hold(self.rotation)

    @property
    def set_point(self) -> Force | None:
        """Its force or torque set point."""
        point = force_given(self) or self.mode.set_point
        if point is None or not point.kept or self._kept is None:
            return point
        return replace(point, wanted=self._kept)

    def keeping(self, wanted: Expression | None) -> AxisEntry:
        """The same axis, whose kept force is known."""
        other = self.model_copy()
        other._kept = wanted
        return other

    def expressions(self) -> Iterator[tuple[Expression, bool]]:
        """Its expressions, and whether each is a position, of which rates are taken."""
        if self.given is not None:
            yield from self.given.expressions()
        if self.set_point is not None and not self.set_point.kept:
            yield self.set_point.wanted, False

    @property
    def has_force(self) -> bool:
        """Whether it has a force or torque set point."""
        return self.set_point is not None

    @property
    def is_soft(self) -> bool:
        """Whether it is a motion axis with a stiffness or damping of its own."""
        return self.stiffness is not None or self.damping is not None

    @classmethod
    def expand(cls, data: object, context: ParseContext) -> object:
        """Read the bare name of a mode, such as `hold`; report the force of the other axes."""
        if isinstance(data, Text) and data in SHORT:
            return short_form(_short(data), str(data))
        other, own = (
            next(k.name for k in Force.keys if k.only and k.exists(rotation=turns))
            for turns in (not cls.rotation, cls.rotation)
        )
        if not (isinstance(data, Map) and other in data):
            return data
        kind = "rotation" if cls.rotation else "translation"
        span = data.node.key_span(other)
        context.error("TS205", f"a {other} on a {kind}", span, f"write '{own}'")
        context.quiet.add(id(data.node))
        rest = Map({key: value for key, value in data.items() if key != other})
        rest.node = data.node
        return rest

    @classmethod
    def rules(cls, data: Map, context: ParseContext) -> None:
        """Require one mode, and keys that belong to it; a soft axis without one holds."""
        motions = [key for key in MOTIONS if key in data]
        forces = [key for key in FORCES if key in data]
        for key in motions:
            misuse = _MODES[key].misuse(data, rotation=cls.rotation)
            if misuse is not None:
                span = data.node.entries[misuse.key][1].span
                context.error("TS204", misuse.message, span, misuse.hint)
        soft = any(key in data for key in _STIFF)
        if not (motions or forces or soft) and complete(data, context):
            modes = alternatives((*MOTIONS, *FORCES))
            context.error("TS201", "an axis needs a mode", pointer(data.node), modes)
            return
        if len(motions) > 1:
            context.error(
                "TS202",
                f"'{motions[0]}' and '{motions[1]}' on one axis",
                data.node.key_span(motions[1]),
                "keep one of the two",
            )
        for companion, owners in _COMPANIONS:
            key = companion.name
            if key in data and not data.keys() & set(owners) and complete(data, context):
                context.error("TS204", f"'{key}' without {' or '.join(owners)}",
                              data.node.key_span(key), companion.companion)  # fmt: skip
        for key in _STIFF:
            if key in data and forces and not motions:
                hint = "a soft axis is a motion axis; a law's gains stand under 'law'"
                context.error("TS204", f"'{key}' on a force axis", data.node.key_span(key), hint)


if TYPE_CHECKING:

    class _TranslationKeys(AxisEntry): ...

    class _RotationKeys(AxisEntry): ...
else:
    _TranslationKeys, _RotationKeys = (
        create_model(
            name,
            __base__=AxisEntry,
            __module__=__name__,
            **{key.name: _field(key, rotation=turns) for key in axis_keys()},
        )
        for name, turns in (("_TranslationKeys", False), ("_RotationKeys", True))
    )


class Translation(_TranslationKeys):
    """A translation: lengths and forces."""

    stiffness: Annotated[float, Constant(STIFFNESS, above=0)] | None = Field(
        None, title="Stiffness of a soft axis"
    )
    damping: Annotated[float, Constant(DAMPING, least=0)] | None = Field(
        None, title="Damping of a soft axis"
    )


class Rotation(_RotationKeys):
    """A rotation: angles and moments."""

    rotation: ClassVar[bool] = True

    stiffness: Annotated[float, Constant(ANGULAR_STIFFNESS, above=0)] | None = Field(
        None, title="Stiffness of a soft axis"
    )
    damping: Annotated[float, Constant(ANGULAR_DAMPING, least=0)] | None = Field(
        None, title="Damping of a soft axis"
    )


class AxesForm(Model):
    """The six axes of the task frame; those not named hold."""

    noun = "axes"
    advice: ClassVar = _CURVES | dict.fromkeys(
        ("xy", "xz", "yz", "xyz", "rxy", "rxyz", "rpy"), "a key for each axis: x: hold, y: hold"
    )

    x: Translation | None = Field(None, title="Translation along x")
    y: Translation | None = Field(None, title="Translation along y")
    z: Translation | None = Field(None, title="Translation along z")
    rx: Rotation | None = Field(None, title="Rotation about x")
    ry: Rotation | None = Field(None, title="Rotation about y")
    rz: Rotation | None = Field(None, title="Rotation about z")


class ByName:
    """Reads the form with six fields and yields a dict of the axes that are named."""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        form = handler.generate_schema(AxesForm)
        named = core_schema.no_info_after_validator_function(_named, form)
        # A dict that is made in Python passes as it is.
        return core_schema.with_info_wrap_validator_function(_unless_final, named)


def _named(form: AxesForm) -> dict[Axis, AxisEntry]:
    return {name: entry for name in AXES if (entry := getattr(form, name))}


def _unless_final(
    value: Any, handler: core_schema.ValidatorFunctionWrapHandler, info: core_schema.ValidationInfo
) -> Any:
    return value if info.context is None else handler(value)
