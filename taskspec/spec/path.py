"""`path`: a curve in the task frame, driven along at a speed or in a time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, cast

from pydantic import Field, create_model
from pydantic.json_schema import SkipJsonSchema

from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression, ScopeKind
from taskspec.expression.scope import CONSTANTS
from taskspec.expression.tree import Name, walk
from taskspec.motion.paths import PathForm, PathKey, all_paths
from taskspec.spec import values
from taskspec.spec.alias import Diameter
from taskspec.spec.joint_targets import JointTargets, goes_by_time
from taskspec.spec.model import Model, complete
from taskspec.spec.parse_context import ParseContext
from taskspec.spec.quantities import (
    Constant,
    Entries,
    Formula,
    QuantityList,
    QuantityLists,
    quantity_schema,
)
from taskspec.spec.words import Free, Word
from taskspec.text.codes import register
from taskspec.text.data import Items, Map, written
from taskspec.text.nodes import Node, pointer
from taskspec.text.nodes import Sequence as SequenceNode
from taskspec.text.units import ANGULAR_VELOCITY, TIME, VELOCITY, alternatives, describe

register({"TS606": "a path that is not one path"})

_PATHS = all_paths(__name__)
FORMS = tuple(_PATHS)
"""The keys of which one says what curve it is."""
_PACE = {"speed", "joint_speed", "time"}
_EXAMPLE = {False: "such as speed: 50 mm/s", True: "such as speed: 30 deg/s"}


@dataclass(frozen=True)
class Pace(Formula):
    """A speed: a constant, or an expression that signals decide."""

    def read(self, value: object, context: ParseContext) -> float | Expression:  # type: ignore[override]
        """SI units, or the checked expression."""
        node = values.parsed(value, "sum", context, describe(VELOCITY))
        if node is None:
            return 0.0
        fixed = {*context.still_params, *context.broken, *CONSTANTS}
        if all(str(name) in fixed for name in walk(node) if isinstance(name, Name)):
            return cast("float", Constant(VELOCITY, above=0).read(value, context))
        return Formula.read(self, value, context)

    def json(self) -> dict[str, Any]:
        """Describes it; that of a path of joints is a rate of turn."""
        return super().json() | quantity_schema(VELOCITY, ANGULAR_VELOCITY)


def _type_of(key: PathKey) -> Any:
    """What a field for a key holds."""
    if key.text:
        return Annotated[str, Free(filled=True)]
    if key.words:
        return Annotated[str, Word(key.words, key.choice)]
    if key.listed:
        return Annotated[tuple[float, ...], QuantityList(key.dimension)]
    if key.rows:
        one = Entries(key.entries, fewest=key.fewest)
        return Annotated[tuple[tuple[float, ...], ...], QuantityLists(one, key.rows)]
    if key.entries:
        return Annotated[tuple[float, ...], Entries(key.entries, fewest=key.fewest)]
    return Annotated[float, Constant(key.dimension, above=key.above, least=key.least)]


class _PathKeys(Model):
    """The keys of one kind of path."""

    @classmethod
    def kind(cls) -> type[PathForm]:
        """The class of its path form."""
        return _PATHS[cls.__name__.lower()]

    @classmethod
    def rules(cls, data: Map, context: ParseContext) -> None:
        """Checks whether the keys go together, where each could be read."""
        lists = [value for value in data.values() if isinstance(value, Items)]
        lists += [entry for value in lists for entry in value if isinstance(entry, Items)]
        whole = all(key.optional or key.name in data for key in cls.kind().keys)
        if not whole or any(each.node.broken for each in lists):
            return
        try:
            wrong = cls.kind().wrong(data)
        except TypeError:
            return  # What is no list is reported as such.
        if wrong is not None:
            node: Node = cast("Items", data[wrong.key]).node
            if wrong.row is not None and isinstance(node, SequenceNode):
                node = node.items[wrong.row]
            context.error(wrong.code, wrong.message, pointer(node), wrong.hint)


def _model_of(form: type[PathForm]) -> Any:
    """The model of a kind's mapping, or what its bare value holds."""
    if form.bare:
        return _type_of(form.keys[0])
    fields: dict[str, Any] = {}
    for key in form.keys:
        about = Field(
            key.default if key.optional else ...,
            title=key.title,
            description=key.description or None,
        )
        fields[key.name] = (_type_of(key), about)
    model = create_model(
        form.name.capitalize(), __base__=_PathKeys, __module__=__name__, __doc__=form.__doc__,
        **fields,
    )  # fmt: skip
    model.aliases = {"diameter": Diameter()} if Diameter.key in fields else {}
    model.noun, model.example = form.noun, f"such as {form.name}: {written(form.examples[0])}"
    return model


def _field(form: type[PathForm]) -> tuple[Any, Any]:
    description = (form.keys[0].description or None) if form.bare else None
    return _model_of(form) | None, Field(None, title=form.title, description=description)


if TYPE_CHECKING:

    class _Curve(Model):
        """The keys of all kinds of paths."""

        def __getattr__(self, name: str) -> Any: ...

else:
    _Curve = create_model(
        "_Curve",
        __base__=Model,
        __module__=__name__,
        **{name: _field(form) for name, form in _PATHS.items()},
    )


class Path(_Curve):
    """A curve; it drives the axes that it has coordinates for and that `axes` does not name.

    The keys of the kinds of paths are attributes too; None for those that are left out.

    Attributes:
        joints: of a path in joint space, the joint positions that it leads to [rad or m]; or one
            expression of time for each joint.
        speed: along the path [m/s]; an expression where signals slow it.
        joint_speed: what a file calls the `speed` of a path of joints [rad/s].
        time: for the whole path [s].
    """

    noun = "a path"
    example = "path: {to: [60 mm, 0, 0], speed: 50 mm/s}"

    speed: Annotated[float | Expression, Pace(VELOCITY, ScopeKind.REFERENCE)] | None = Field(
        None, title="Speed"
    )
    joints: (
        Annotated[tuple[tuple[float, ...], ...] | tuple[Expression, ...], JointTargets()] | None
    ) = Field(
        None,
        title="Joint positions",
        description="One for each joint; or a list of such lists, gone through with a rest in "
        "each; or expressions of t, one for each joint",
    )
    joint_speed: SkipJsonSchema[Annotated[float, Constant(ANGULAR_VELOCITY, above=0)] | None] = None
    time: Annotated[float, Constant(TIME, above=0)] | None = Field(None, title="Duration")

    @property
    def joint_targets(self) -> tuple[tuple[float, ...], ...]:
        """The joint positions that it leads to; empty where it leads to none."""
        return tuple(each for each in self.joints or () if isinstance(each, tuple))

    @property
    def joint_motion(self) -> tuple[Expression, ...]:
        """The joint positions as expressions of time; empty where they are not."""
        return tuple(each for each in self.joints or () if isinstance(each, Expression))

    @property
    def slowed(self) -> Expression | None:
        """Its speed where signals decide it."""
        return self.speed if isinstance(self.speed, Expression) else None

    @property
    def kind(self) -> str:
        """The key that says what curve it is."""
        return next(name for name in FORMS if getattr(self, name) is not None)

    @property
    def form(self) -> PathForm:
        """The curve."""
        value = getattr(self, self.kind)
        kind: Any = _PATHS[self.kind]
        if kind.bare:
            return cast("PathForm", kind(value))
        return cast("PathForm", kind(**{key.name: getattr(value, key.name) for key in kind.keys}))

    @classmethod
    def expand(cls, data: object, context: ParseContext) -> object:  # noqa: ARG003
        """Reads the speed of a path of joints as one of turning."""
        if not isinstance(data, Map) or "joints" not in data or "speed" not in data:
            return data
        renamed = Map({"joint_speed" if k == "speed" else k: v for k, v in data.items()})
        renamed.node = data.node
        return renamed

    @classmethod
    def rules(cls, data: Map, context: ParseContext) -> None:
        """Requires one form, and one of `speed` and `time`."""
        forms = [key for key in (*FORMS, "joints") if key in data]
        if "joint_speed" in data.node.entries:
            context.error("TS020", "unknown key 'joint_speed' in a path",
                          data.node.key_span("joint_speed"), "it is called 'speed'")  # fmt: skip
        if not forms and complete(data, context):
            hint = f"one of {alternatives((*FORMS, 'joints'))}"
            context.error("TS606", "a path without a form", pointer(data.node), hint)
        if len(forms) > 1:
            context.error("TS606", f"'{forms[0]}' and '{forms[1]}' in one path",
                          data.node.key_span(forms[1]), "make two stages of it")  # fmt: skip
        by_time = goes_by_time(data.get("joints"))
        if by_time and "joint_speed" in data:
            context.error("TS606", "a 'speed' of joints that go by time",
                          data.node.key_span("speed"),
                          "say how long the expressions are followed: time: 4 s")  # fmt: skip
        elif data.keys() & {"speed", "joint_speed"} and "time" in data:
            context.error("TS606", "'speed' and 'time' in one path", data.node.key_span("time"),
                          "keep one of the two")  # fmt: skip
        elif forms and "file" not in forms and not data.keys() & _PACE and complete(data, context):
            needs = "a 'time'" if by_time else "a 'speed' or a 'time'"
            example = "such as time: 4 s" if by_time else _EXAMPLE[forms[0] == "joints"]
            context.error("TS606", f"a path needs {needs}", data.node.key_span(forms[0]), example)
