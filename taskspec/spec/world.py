"""`world`: the objects that the robot may touch."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, cast

from pydantic import Field, PrivateAttr, create_model

from taskspec.expression import Expression, ScopeKind
from taskspec.expression.spelling import VALUE_WORDS
from taskspec.geometry.axis import AXES, ROTATIONS, Axis
from taskspec.shapes import BoundedSurface, SizeKey, all_shapes, size_keys
from taskspec.spec.alias import Diameter, Direction
from taskspec.spec.fields import MECHANISMS, RPY, XYZ, MechanismName
from taskspec.spec.model import Model, complete
from taskspec.spec.parse_context import ParseContext
from taskspec.spec.quantities import Constant, Entries, Formula
from taskspec.spec.sizes import check_sizes
from taskspec.spec.words import Free, Switch, Word
from taskspec.text.data import Map, Text
from taskspec.text.nodes import pointer
from taskspec.text.suggest import closest
from taskspec.text.units import ANGLE, DAMPING, LENGTH, MASS, NUMBER, STIFFNESS

_SHAPES = all_shapes(__name__)

KIND_KEYS = ("shape", "equation", "mechanism", "bushing")
"""The keys of which one says what an object is."""

MOTION = {axis: ANGLE if axis.is_rotation else LENGTH for axis in AXES}
"""How an object may move by itself, and what each axis measures."""


class Motion(Model):
    """How an object moves as the clock goes on, in its own axes as declared.

    Attributes:
        x, y, z: displacement of its origin [m].
        rx, ry, rz: rotation vector [rad]; at most one of the three.
    """

    noun = "a motion"
    example = "motion: {z: 2 mm * sin(2*pi*clock*2 Hz)}"

    x: Annotated[Expression, Formula(LENGTH, ScopeKind.WORLD)] | None = Field(None, title="Along x")
    y: Annotated[Expression, Formula(LENGTH, ScopeKind.WORLD)] | None = Field(None, title="Along y")
    z: Annotated[Expression, Formula(LENGTH, ScopeKind.WORLD)] | None = Field(None, title="Along z")
    rx: Annotated[Expression, Formula(ANGLE, ScopeKind.WORLD)] | None = Field(None, title="About x")
    ry: Annotated[Expression, Formula(ANGLE, ScopeKind.WORLD)] | None = Field(None, title="About y")
    rz: Annotated[Expression, Formula(ANGLE, ScopeKind.WORLD)] | None = Field(None, title="About z")

    @property
    def axes(self) -> dict[Axis, Expression]:
        """The axes that move."""
        return {axis: e for axis in MOTION if (e := getattr(self, axis)) is not None}

    @classmethod
    def rules(cls, data: Map, context: ParseContext) -> None:
        """Requires an axis, and no more than one rotation."""
        if not data and complete(data, context):
            context.error("TS021", "a motion needs an axis", pointer(data.node), cls.example)
        turns = [axis for axis in ROTATIONS if axis in data]
        if len(turns) > 1:
            message = "an object turns about one of its axes"
            context.error("TS026", message, data.node.key_span(turns[1]), "keep one of them")


class _PlacedShape(Model):
    """The keys of a shape that come before its sizes."""

    shape: Annotated[str, Word(tuple(_SHAPES), "shape")] = Field(title="Shape")
    xyz: XYZ = Field((0.0, 0.0, 0.0), title="Position in the world", description="[x, y, z]")
    rpy: RPY = Field((0.0, 0.0, 0.0), title="Orientation", description="[roll, pitch, yaw]")


def _field(key: SizeKey) -> tuple[Any, Any]:
    """A size as a field of a model: its type, and what is known of it."""
    if key.words:
        return Annotated[str, Word(key.words, key.name)] | None, Field(None, title=key.title)
    if key.text:
        return Annotated[str, Free(filled=True)] | None, Field(None, title=key.title)
    form: Any = Annotated[float, Constant(key.dimension, above=0, most=key.most)]
    if key.entries > 1:
        dimensions = (key.dimension,) * key.entries
        form = Annotated[tuple[float, ...], Entries(dimensions, above=0)]
    return form | None, Field(None, title=key.title)


if TYPE_CHECKING:
    from taskspec.spec.mechanism import Mechanism

    _SizedShape = _PlacedShape
else:
    _SizedShape = create_model(
        "_SizedShape",
        __base__=_PlacedShape,
        __module__=__name__,
        **{name: _field(key) for name, key in size_keys().items()},
    )


class Shape(_SizedShape):
    """An object: a shape at a place, with the contact that it makes.

    Its sizes are attributes too, by the names of their keys; None for those that it does not have.

    Attributes:
        shape: the name of its kind, one of `taskspec.shapes.SHAPES`.
        xyz: position in the world [m].
        rpy: orientation in the world [rad].
        stiffness: of the whole contact [N/m], or `rigid`.
        damping: of the whole contact [N*s/m]; None for 0.1 * 2 * sqrt(stiffness * 1 kg).
        friction: Coulomb's coefficient.
        motion: how it moves by itself; None where it stands still.
        free: it is a loose body.
        mass: of a loose body [kg].
        on: the mechanism that carries it; None for an object of its own. Its place is then in the
            mechanism's axes at coordinate 0, until `Task.shapes` has it in the world.
    """

    noun = "an object"
    example = "table: {shape: plane, xyz: [0, 0, 300 mm]}"
    aliases: ClassVar = {"diameter": Diameter(), "normal": Direction(), "axis": Direction()}

    stiffness: Annotated[
        float | Literal["rigid"], Constant(STIFFNESS, above=0, words=("rigid",))
    ] = Field(20e3, title="Stiffness of the whole contact")
    damping: Annotated[float, Constant(DAMPING, least=0)] | None = Field(
        None, title="Damping of the whole contact"
    )
    friction: Annotated[float, Constant(NUMBER, least=0)] = Field(
        0.0, title="Coefficient of friction"
    )
    motion: Motion | None = Field(None, title="Motion by itself")
    free: Annotated[bool, Switch()] = Field(False, title="A loose body")
    mass: Annotated[float, Constant(MASS, above=0)] | None = Field(
        None, title="Mass of a loose body"
    )
    on: MechanismName | None = Field(None, title="The mechanism that carries it")
    _carrier: Any = PrivateAttr(None)

    @property
    def carrier(self) -> Mechanism | None:
        """The mechanism that carries it, of a shape that is placed in the world."""
        return cast("Mechanism | None", self._carrier)

    @property
    def gives_way(self) -> bool:
        """Whether it may be pushed away: it is loose, or a mechanism carries it."""
        return self.free or self.on is not None

    def carried_by(self, mechanism: Mechanism) -> Shape:
        """The shape in the world, where the mechanism that carries it is at coordinate 0."""
        # To read a file no numerical library is needed.
        from taskspec.geometry.rotation import from_rpy, to_rpy

        R, own = from_rpy(mechanism.rpy), from_rpy(self.rpy)
        origin = R @ self.xyz + mechanism.xyz
        placed = self.model_copy(update={"xyz": tuple(origin.tolist()), "rpy": to_rpy(R @ own)})
        placed._carrier = mechanism
        return placed

    @property
    def kind(self) -> str:
        """The kind of its signals."""
        return "shape"

    @property
    def sizes(self) -> dict[str, Any]:
        """Its sizes by key [SI units], those that are left out not among them."""
        given = {key.name: getattr(self, key.name) for key in _SHAPES[self.shape].keys}
        return {name: value for name, value in given.items() if value is not None}

    @classmethod
    def expand(cls, data: object, context: ParseContext) -> object:
        """Reports an object of no kind, and reads no further."""
        if not isinstance(data, Map) or "shape" in data:
            return data
        return _of_no_kind(data, context, [*cls.model_fields, *cls.reserved])

    @classmethod
    def advice_on(cls, key: str, data: Map) -> str:
        """Which size of a shape its height is, and how a mesh is scaled."""
        if key in ("scale", "units") and str(data.get("shape")) == "mesh":
            return "say what its numbers are in: unit: mm, or m, cm, in"
        if key in ("height", "tall") and isinstance(data.get("shape"), str):
            return _HEIGHTS.get(str(data["shape"]), "")
        return ""

    @classmethod
    def rules(cls, data: Map, context: ParseContext) -> None:
        """Requires the sizes of the shape."""
        shape = data.get("shape")
        if isinstance(shape, str) and shape in _SHAPES:
            allowed = [key.name for key in _SHAPES[shape].keys]
            needed = [name for name in allowed if name not in _SHAPES[shape].optional]
            check_sizes(shape, needed, allowed, data, context)
            _check_wall(shape, data, context)
        _check_free(data, context)
        _check_carried(data, context)


def _check_wall(shape: str, data: Map, context: ParseContext) -> None:
    """Reports a thickness of what is solid."""
    if (
        "thickness" in data
        and any(k.name == "side" for k in _SHAPES[shape].keys)
        and data.get("side") != "inner"
    ):
        message = f"a {shape} that is touched from outside has no 'thickness': it is solid"
        hint = "it is of the wall of a bowl or tube: side: inner"
        context.error("TS302", message, data.node.key_span("thickness"), hint)


#: What the height of a shape is called.
_HEIGHTS = {
    "cylinder": "along its axis a cylinder has a 'length'",
    "box": "the height of a box is the third entry of its 'size'",
    "hole": "how far a hole goes down is its 'depth'",
    "slot": "how far a slot goes down is its 'depth'",
    "groove": "how far a groove goes down is its 'depth'",
}
#: What other systems call the key that says what an object is.
_OF_KIND = ("type", "kind", "geometry", "geom", "joint", "form")


def _of_no_kind(data: Map, context: ParseContext, keys: list[str]) -> Map:
    """Reports an object that none of these keys gives a kind; returns what can be checked."""
    kinds = dict.fromkeys(_SHAPES, "shape") | dict.fromkeys(MECHANISMS, "mechanism")
    slips: dict[str, str] = {}
    for key, value in data.items():
        kind = str(value) if isinstance(value, Text) else ""
        kind = VALUE_WORDS.get(kind.lower(), kind)
        if key in keys:
            continue
        if key in kinds:
            slips[key] = f"write {kinds[key]}: {key}, and its keys beside it"
        elif kind == "bushing" and key in _OF_KIND:
            slips[key] = "write bushing: tool"
        elif kind in kinds and key in _OF_KIND:
            slips[key] = f"write {kinds[kind]}: {kind}"
        elif near := closest(key, KIND_KEYS):
            slips[key] = f"did you mean '{near}'?"
    for key, hint in slips.items():
        context.error("TS020", f"unknown key '{key}' in an object", data.node.key_span(key), hint)
    if not slips and complete(data, context):
        message = "an object needs a 'shape', an 'equation', a 'mechanism' or a 'bushing'"
        context.error("TS021", message, pointer(data.node), f"such as {Shape.example}")
    context.quiet.add(id(data.node))
    rest = Map({key: value for key, value in data.items() if key in keys})
    rest.node = data.node
    return rest


def is_free(data: Map) -> bool:
    """Whether a raw object is a loose body, or is meant as one."""
    return "free" in data and bool(getattr(data["free"], "value", True))


def _check_free(data: Map, context: ParseContext) -> None:
    """Requires a mass of a loose body, and of a loose body alone."""
    sure, free = complete(data, context), is_free(data)
    shape = data.get("shape")
    kind = _SHAPES.get(shape) if isinstance(shape, str) else None
    if free and kind is not None and (reason := kind.fixed(data)):
        message = f"a {kind.name} is {reason} and cannot be loose"
        other = next(name for name, k in _SHAPES.items() if issubclass(k, BoundedSurface))
        context.error("TS302", message, data.node.key_span("free"), f"take a {other}")
    if free and "motion" in data:
        message, span = "a loose body has no 'motion' of its own", data.node.key_span("motion")
        context.error("TS026", message, span, "keep one of the two")
    if free and "mass" not in data and sure:
        message, span = "a loose body needs a 'mass'", data.node.key_span("free")
        context.error("TS301", message, span, "such as mass: 500 g")
    if "mass" in data and not free and sure:
        message, span = "'mass' belongs to a loose body", data.node.key_span("mass")
        context.error("TS026", message, span, "add 'free: true'")


def _check_carried(data: Map, context: ParseContext) -> None:
    """Reports what a shape on a mechanism cannot be."""
    if "on" not in data:
        return
    shape = data.get("shape")
    kind = _SHAPES.get(shape) if isinstance(shape, str) else None
    if kind is not None and (reason := kind.fixed(data)):
        message = f"a {kind.name} is {reason} and cannot ride on a mechanism"
        other = next(name for name, k in _SHAPES.items() if issubclass(k, BoundedSurface))
        context.error("TS302", message, data.node.key_span("on"), f"take a {other}")
    for key, what in (("motion", "its own 'motion'"), ("free", "'free'")):
        if key in data and (key != "free" or is_free(data)):
            message = f"a shape on a mechanism goes with that: {what} does not go with 'on'"
            context.error("TS026", message, data.node.key_span(key), "keep one of the two")
