"""`truth`: true values of the world and the robot that differ from the nominal ones."""

from __future__ import annotations

from typing import Any

from pydantic import GetJsonSchemaHandler, ValidationError
from pydantic_core import CoreSchema

from taskspec.deferred_methods import dataclass
from taskspec.spec.fault import Fault
from taskspec.spec.field_type import FieldType
from taskspec.spec.parse_context import ParseContext, kind_of, span_of
from taskspec.spec.value_path import ValuePath
from taskspec.spec.varied import OBJECT, ROBOT
from taskspec.spec.vary import target_of
from taskspec.text import nodes
from taskspec.text.data import Items, Map
from taskspec.text.nodes import Mapping, Node
from taskspec.text.suggest import suggestion

#: Values of the robot that are given as a whole too.
_WHOLE = frozenset({"payload", "sensor.noise", "sensor.rate"})
_MOTION = "motion"
#: Matrices, which are given as a whole.
_MATRICES = frozenset({"stiffness", "damping"})
FAULTS = "faults"
"""The key of what happens while a run goes on."""


@dataclass(frozen=True)
class DeclaredTruth:
    """What is otherwise in truth.

    Attributes:
        paths: of values of `world` and `robot`, as `vary` has them.
        faults: what happens while a run goes on, in the order of the file.
    """

    paths: tuple[str, ...] = ()
    faults: tuple[Fault, ...] = ()

    def of(self, device: str) -> tuple[Fault, ...]:
        """The faults of one device."""
        return tuple(fault for fault in self.faults if fault.device == device)


@dataclass(frozen=True)
class Truths(FieldType):
    """Paths of values, each with what it really is.

    The values themselves are read in the places that the paths name: see `grafted`.
    """

    def read(self, value: object, context: ParseContext) -> DeclaredTruth:
        """The paths that name something."""
        if not isinstance(value, Map):
            message = f"'truth' is a mapping of paths to values, this is {kind_of(value)}"
            hint = "truth: {world.table.xyz: [0, 0, 302 mm]}"
            context.error("TS022", message, span_of(value), hint)
            return DeclaredTruth()
        paths = [path for path in value if path != FAULTS and _names_a_value(path, value, context)]
        return DeclaredTruth(
            tuple(paths), _faults(value[FAULTS], context) if FAULTS in value else ()
        )

    def json(self) -> dict[str, Any]:
        """Describes the mapping."""
        forms = [{"type": ["string", "number"]}, {"type": "array"}, {"type": "object"}]
        faults = {
            "title": "Faults",
            "description": "What happens to sensor, encoders and torques while a run goes on",
            "type": "array",
            "examples": [[{"sensor": "drops", "at": "2 s", "for": "15 ms"}]],
        }
        return {
            "type": "object",
            "properties": {FAULTS: faults},
            "additionalProperties": {"anyOf": forms},
        }

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        found = super().__get_pydantic_json_schema__(schema, handler)
        found["properties"][FAULTS]["items"] = handler(Fault.__pydantic_core_schema__)
        return found


def _faults(value: object, context: ParseContext) -> tuple[Fault, ...]:
    """The faults of a list, without those that are reported."""
    if not isinstance(value, Items):
        message = f"'{FAULTS}' is a list of faults, this is {kind_of(value)}"
        context.error("TS022", message, span_of(value), f"{FAULTS}: [{Fault.example}]")
        return ()
    found = []
    for entry in value:
        before = len(context.diagnostics)
        try:
            fault = Fault.model_validate(entry, context=context)
        except ValidationError:
            # No key of a fault is needed by itself, so whatever is wrong is reported.
            continue
        if len(context.diagnostics) == before:
            assert isinstance(entry, Map)
            fault.report_unfit(entry, context)
            found.append(fault)
    return tuple(found)


def _names_a_value(path: str, data: Map, context: ParseContext) -> bool:
    if path in ("fault", "sensor", "torque", "encoder"):
        hint = f"what happens while a run goes on is a list: {FAULTS}: [{Fault.example}]"
        context.error("TS710", f"'{path}' is no value", data.node.key_span(path), hint)
        return False
    of = ValuePath.of(path)
    if of.section == "robot" and of.key in _WHOLE:
        return True
    if of.first == _MOTION and context.objects.get(of.owner) == "shape":
        return True
    if of.key in _MATRICES and context.objects.get(of.owner) == "bushing":
        return True
    if of.section in ("robot", "world") and not (of.owner or of.key):
        known = ROBOT if of.section == "robot" else OBJECT["shape"]
        head = "robot" if of.section == "robot" else "world.NAME"
        hint = suggestion("", [f"{head}.{key}" for key in known], "paths")
        message = f"{of.section!r} is no value: a value is named by its path"
        context.error("TS710", message, data.node.key_span(path), hint)
        return False
    return target_of(path, data, context, "truth") is not None


def grafted(root: Mapping, truth: DeclaredTruth) -> Mapping:
    """The tree of a file as it would be if it said what is true.

    Each value keeps its place under `truth`, so that what is wrong with it is reported there.

    Args:
        root: the tree, which is not changed.
        truth: what is otherwise.
    """
    section = root.get("truth")
    assert isinstance(section, Mapping)
    for path in truth.paths:
        value = section.get(path)
        assert value is not None
        root = _put(root, path.split("."), section.entries[path][0], value)
    return root


def _put(owner: Node | None, steps: list[str], key: nodes.Scalar, value: Node) -> Mapping:
    """A copy of a mapping with one value below it replaced; a short form is replaced."""
    step, *rest = steps
    old = owner if isinstance(owner, Mapping) else Mapping(key.span, flow=True)
    entry = old.entries.get(step)
    below = value if not rest else _put(entry[1] if entry else None, rest, key, value)
    name = entry[0] if entry else nodes.Scalar(step, True, key.origin)
    # What the file writes by another key is replaced too.
    others = {k: e for k, e in old.entries.items() if k != old.written.get(step)}
    written = {k: other for k, other in old.written.items() if k != step}
    return Mapping(old.span, old.flow, {**others, step: (name, below)}, old.broken, written)
