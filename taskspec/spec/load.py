"""From the text of a task file to a checked task."""

from __future__ import annotations

import errno
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from pathlib import Path
from typing import BinaryIO

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from taskspec.deferred_methods import dataclass
from taskspec.spec import overrides as overriding
from taskspec.spec.control import settle_rates
from taskspec.spec.include import Inclusion
from taskspec.spec.key_path import KeyPath, is_key, steps_of
from taskspec.spec.levels import level_of
from taskspec.spec.mesh_file import find_meshes
from taskspec.spec.model import REPORTED, mapping
from taskspec.spec.names import collect_names, unused, warn_unused
from taskspec.spec.params import evaluate_params, with_values
from taskspec.spec.parse_context import ParseContext
from taskspec.spec.robot import Robot
from taskspec.spec.robot_file import RobotFiles
from taskspec.spec.servo import settle_servo
from taskspec.spec.task import VERSION, Task
from taskspec.spec.templates import expand
from taskspec.spec.truth import grafted
from taskspec.text import nodes
from taskspec.text.characters import normal
from taskspec.text.codes import register
from taskspec.text.data import Map, to_data
from taskspec.text.diagnostic import Diagnostic, Diagnostics, SpecError
from taskspec.text.origin import Origin
from taskspec.text.source import OVERRIDES, Source, Span
from taskspec.text.yaml import MAX_BYTES, read

register({"TS021": "a missing key"})

_NAMED = {"world": "object", "frames": "frame", "stages": "stage"}
"""Sections whose entries have names of the file's own, and what an entry is."""

_EXAMPLES = {
    "taskspec": "begin the file with 'taskspec: 1'",
    "robot": "such as robot: {model: panda}",
    "stages": "such as stages: {wait: {time: 1 s}}",
}
_INNER_EXAMPLES: Mapping[str | tuple[str, str], str] = {
    "model": "such as model: panda",
    "pitch": "the way along z in one turn, such as pitch: 2 mm/turn",
    ("raster", "pitch"): "the distance of its lines, such as pitch: 8 mm",
    ("raster", "size"): "along the frame's two axes, such as size: [80 mm, 40 mm]",
    ("spiral", "pitch"): "the distance of its turns, such as pitch: 0.8 mm",
    ("spiral", "radius"): "out to which it winds, such as radius: 5 mm",
}


@dataclass(frozen=True, slots=True)
class LoadedTask:
    """A task and the text that it came from.

    Attributes:
        task: the checked task: the nominal one of the controller.
        true_task: the same with the world and the robot as they really are.
        source: the text of the file.
        path: of the file; None if there is none.
        base: the folder that relative paths in the task start from; None for the current one.
        overrides: dotted path to YAML text, as given.
        warnings: findings that do not keep the task from running.
        sources: every text that a place may refer to, by name.
        included: SHA-256 of every file that was included, by its absolute path.
    """

    task: Task
    true_task: Task
    source: Source
    path: Path | None
    base: Path | None
    overrides: Mapping[str, str]
    warnings: tuple[Diagnostic, ...]
    sources: Mapping[str, Source]
    included: Mapping[Path, str]
    root: nodes.Mapping = field(repr=False, compare=False)

    def span(self, path: KeyPath) -> Span:
        """The place of a path, or of its nearest ancestor that the file has.

        Args:
            path: such as `FILE.stages["wipe"].axes["z"]`; `key_of` it is the key itself.
        """
        return nodes.place(self.root, steps_of(path), key=is_key(path))

    def where(self, live: Mapping[str, float]) -> LoadedTask:
        """The task as if it declared other values of live params, by name [SI]."""
        nominal, true = (
            task.model_copy(update={"params": with_values(task.params, live)})
            for task in (self.task, self.true_task)
        )
        return replace(self, task=nominal, true_task=true)

    def has(self, path: KeyPath) -> bool:
        """Whether the file has a path as it is, without a short form that stands for it."""
        steps = steps_of(path)
        return nodes.find(self.root, steps)[1] == len(steps)


def _name_entries(root: nodes.Mapping, found: Diagnostics) -> None:
    """Reports sections that list what they should name, and reads them on as if they did so."""
    for section, (key, value) in root.entries.items():
        if section not in _NAMED or not isinstance(value, nodes.Sequence) or not value.items:
            continue
        entries = [each for each in value.items if isinstance(each, nodes.Mapping)]
        if len(entries) < len(value.items):
            continue
        noun = _NAMED[section]
        named = dict(_named(each, f"{noun}{number}") for number, each in enumerate(entries, 1))
        first = next(iter(named))
        hint = f"write each by its name: {section}: {{{first}: {{..}}}}"
        found.error("TS022", f"'{section}' is a mapping of names, this is a list", key.span, hint)
        root.entries[section] = (key, nodes.Mapping(value.span, value.flow, named, value.broken))


def _named(entry: nodes.Mapping, otherwise: str) -> tuple[str, tuple[nodes.Scalar, nodes.Node]]:
    """The name of an entry of a list, and the entry without it."""
    name = entry.get("name")
    if isinstance(name, nodes.Scalar) and name.value:
        rest = {key: e for key, e in entry.entries.items() if key != "name"}
        return name.value, (name, nodes.Mapping(entry.span, entry.flow, rest, entry.broken))
    if len(entry.entries) == 1:
        ((key, pair),) = entry.entries.items()
        if isinstance(pair[1], nodes.Mapping):
            return key, pair
    return otherwise, (nodes.Scalar("", True, Origin(nodes.pointer(entry), "", "")), entry)


class UnreadTaskError(SpecError):
    """A task file does not read as a task.

    Attributes:
        robot: a task of its robot alone, as far as that part reads, so that the robot itself and
            its start can be checked too; None where no part of it does.
    """

    robot: LoadedTask | None = None


def load_task(path: Path, overrides: Mapping[str, str] | None = None) -> LoadedTask:
    """Reads and checks a task file.

    Args:
        path: the file.
        overrides: dotted path, or the bare name of a param, to YAML text.

    Raises:
        SpecError: the task is wrong; it carries everything that was found.
        OSError: the file cannot be opened, or is a pipe.
        UnicodeDecodeError: it is not UTF-8.
    """
    if path.is_fifo() and not path.is_relative_to("/dev"):
        # Nothing may ever be written into it; a shell's own pipes have a writer.
        raise OSError(errno.EINVAL, "it is a pipe, not a regular file", str(path))
    with path.open("rb") as file:
        text = read_text(file)
    return _load(text, str(path), overrides or {}, path, path.parent)


def read_text(stream: BinaryIO) -> str:
    """The text that a stream brings; of one that is too long, enough to say so.

    Raises:
        UnicodeDecodeError: it is not UTF-8.
    """
    # Read no more than is needed to know that it is too much: the stream may be a device.
    content = stream.read(MAX_BYTES + 4)
    if len(content) > MAX_BYTES + 3:
        return content[: MAX_BYTES + 3].decode("utf-8", "ignore") + " "
    return content.decode("utf-8")


def load_text(
    text: str,
    name: str,
    overrides: Mapping[str, str] | None = None,
    base: Path | None = None,
) -> LoadedTask:
    """Reads and checks the text of a task.

    Args:
        text: the text.
        name: what to call it in diagnostics.
        overrides: dotted path, or the bare name of a param, to YAML text.
        base: the folder that relative paths in the task start from.

    Raises:
        SpecError: the task is wrong; it carries everything that was found.
    """
    return _load(text, name, overrides or {}, None, base)


def tree_of(text: str, name: str, base: Path | None) -> nodes.Mapping | None:
    """The tree of a task with what it includes and its templates; None where it cannot be read.

    What is wrong with it is found out when it is loaded.
    """
    found = Diagnostics(name)
    root = read(Source(name, normal(text)), found)
    if not isinstance(root, nodes.Mapping):
        return None
    Inclusion(name, base, {}, found).into(root)
    expand(root, found)
    return root


def _load(
    text: str, name: str, overrides: Mapping[str, str], path: Path | None, base: Path | None
) -> LoadedTask:
    source = Source(name, normal(text))
    found = Diagnostics(name)
    sources = {name: source}
    root = read(source, found)
    if not isinstance(root, nodes.Mapping):
        raise SpecError(found.sorted(), sources)
    inclusion = Inclusion(name, base, sources, found)
    inclusion.into(root)
    _name_entries(root, found)
    named = RobotFiles(base, sources, found, inclusion)
    if inclusion.missing or not named.into(root):
        raise SpecError(found.sorted(), sources)
    idle = unused(root)
    changes = overriding.Overrides(overrides, tuple(Task.model_fields), found)
    if overrides:
        sources[OVERRIDES] = changes.source
    # What a template is given is changed before it takes the place of a stage, a stage after that.
    changes.apply(root, templates=True)
    expand(root, found)
    changes.apply(root, templates=False)
    if not named.into(root):
        raise SpecError(found.sorted(), sources)
    find_meshes(root, base, inclusion, found)

    def loaded(task: Task, true_task: Task) -> LoadedTask:
        given = dict(overrides)
        return LoadedTask(
            task, true_task, source, path, base, given, found.sorted(), sources, inclusion.files,
            root,
        )  # fmt: skip

    def unread() -> UnreadTaskError:
        error = UnreadTaskError(found.sorted(), sources)
        if (robot := _robot_of(root)) is not None:
            alone = Task(taskspec=VERSION, robot=robot, stages={})
            error.robot = loaded(alone, alone)
        return error

    task = _validate(root, found, path or Path(name))
    if task is None or found.has_errors:
        raise unread()
    true_task: Task | None = task
    if task.truth.paths:
        true_task = _validate(grafted(root, task.truth), found, path or Path(name), truth=True)
    if true_task is None or found.has_errors:
        raise unread()
    # An override may use a name, or take the place of what used one.
    warn_unused(root, idle & unused(root), found)
    return loaded(task, true_task)


def reread(loaded: LoadedTask, root: nodes.Mapping) -> LoadedTask:
    """A loaded task with another tree.

    Args:
        loaded: the task.
        root: its tree with changes, `loaded.root` else.

    Raises:
        SpecError: what was changed is wrong.
    """
    found, path = Diagnostics(loaded.source.name), loaded.path or Path(loaded.source.name)
    task = _validate(root, found, path)
    true_task = task
    if task is not None and task.truth.paths:
        true_task = _validate(grafted(root, task.truth), found, path, truth=True)
    if task is None or true_task is None or found.has_errors:
        raise SpecError(found.sorted(), loaded.sources)
    return replace(loaded, task=task, true_task=true_task, root=root)


def _robot_of(root: nodes.Mapping) -> Robot | None:
    """The robot with those of its keys that read without an error; None without its model."""
    section = root.get("robot")
    if not isinstance(section, nodes.Mapping) or "model" not in section.entries:
        return None
    keys = [key for key in ("model", "flange", "base", "tool", "start") if key in section.entries]
    sound: list[str] = []
    for key in keys:
        if _robot_with((*sound, key), root, section) is not None:
            sound.append(key)
        elif key == "model":
            return None
    if "grasp" in section.entries or sound != keys:
        # Where the tip is to be follows from what does not read, or is not read here.
        sound = [key for key in sound if key != "start"]
    return _robot_with(sound, root, section)


def _robot_with(keys: Sequence[str], root: nodes.Mapping, section: nodes.Mapping) -> Robot | None:
    """The robot with some of its keys; None where one of them is wrong."""
    found = Diagnostics("")
    data = to_data(root, found)
    part = nodes.Mapping(section.span, section.flow, {key: section.entries[key] for key in keys})
    context = ParseContext(found, mapping(data))
    collect_names(context)
    evaluate_params(context)
    before = len(found)
    try:
        robot = Robot.model_validate(to_data(part, found), context=context)
    except ValidationError:
        return None
    return robot if len(found) == before else None


def _validate(
    root: nodes.Mapping, found: Diagnostics, path: Path, *, truth: bool = False
) -> Task | None:
    data = to_data(root, found)
    assert isinstance(data, Map)
    context = ParseContext(found, data, keys=_keys(root), truth=truth, level_of=level_of)
    collect_names(context)
    evaluate_params(context)
    try:
        task = Task.model_validate(data, context=context)
    except ValidationError as error:
        for detail in error.errors(include_url=False, include_context=False):
            _translate(detail, root, context)
        return None
    declared = mapping(mapping(data.get("robot")).get("servo"))
    served = task.robot.servo.rate if "rate" in declared else math.inf
    control = settle_rates(task.control, mapping(data.get("control")), context, served)
    filled: dict[str, object] = {"control": control}
    if not task.robot.takes_torques and not found.has_errors:
        servo = settle_servo(task.robot.servo, control, declared, context)
        filled["robot"] = task.robot.model_copy(update={"servo": servo})
    if "name" not in data:
        filled["name"] = _name_from(path)
    return task.model_copy(update=filled)


def _keys(root: nodes.Mapping) -> dict[int, Span]:
    """For each mapping the place to point at: its bracket, or the key that it hangs on."""
    places: dict[int, Span] = {}
    waiting: list[nodes.Node] = [root]
    while waiting:
        node = waiting.pop()
        if isinstance(node, nodes.Sequence):
            waiting.extend(node.items)
        elif isinstance(node, nodes.Mapping):
            for key, value in node.entries.values():
                waiting.append(value)
                if isinstance(value, nodes.Mapping):
                    places[id(value)] = key.span
    return places


def _example(loc: Sequence[str | int]) -> str:
    """What a key that is missing at a place is for, and how it is written."""
    key = str(loc[-1])
    if len(loc) == 1:
        return _EXAMPLES.get(key, "")
    return _INNER_EXAMPLES.get((str(loc[-2]), key)) or _INNER_EXAMPLES.get(key, "")


def _translate(detail: ErrorDetails, root: nodes.Mapping, context: ParseContext) -> None:
    """Reports an error of pydantic, unless it is already reported."""
    kind, loc = detail["type"], _in_file(detail["loc"])
    if kind in (REPORTED, "default_factory_not_called"):  # The latter follows from another error.
        return
    if kind == "missing":
        owner, depth = nodes.find(root, loc[:-1])
        quiet = isinstance(owner, nodes.Mapping) and owner.broken
        if quiet or id(owner) in context.quiet:
            return
        where = f"'{loc[-2]}'" if len(loc) > 1 else "the task"
        hint = _example(loc)
        span = nodes.place(root, loc[:depth])
        context.error("TS021", f"{where} needs the key '{loc[-1]}'", span, hint)
        return
    if kind == "dict_type":
        message, hint = f"'{loc[-1]}' is a mapping of names", "write 'name: ' before each entry"
    else:
        message, hint = f"this does not fit: {detail['msg']}", ""
    context.error("TS022", message, nodes.place(root, loc), hint)


def _in_file(loc: tuple[int | str, ...]) -> tuple[int | str, ...]:
    """A place of pydantic's as the file has it: without the kind that follows an object."""
    return (*loc[:2], *loc[3:]) if loc[:1] == ("world",) else tuple(loc)


def _name_from(path: Path) -> str:
    """A task's name made from that of its file."""
    words = re.sub(r"[^a-z0-9]+", "-", path.name.lower().split(".")[0]).strip("-")
    return words if words[:1].isalpha() else f"task-{words}".strip("-")
