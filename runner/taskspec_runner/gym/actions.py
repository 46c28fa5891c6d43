"""Actions: live params of the file, and bounded residuals of named axes, each from -1 to 1."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from collections.abc import Mapping as MappingOf
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis, as_axis
from taskspec.spec import LoadedTask, Task
from taskspec.spec.params import LiveParam
from taskspec.spec.residual import RESIDUAL_KEYS, Residual, with_residuals
from taskspec.text.nodes import Mapping, Node, has_word, scalars
from taskspec.text.suggest import suggestion
from taskspec.text.units import alternatives, scaled
from taskspec_runner.errors import InputError

Vector = NDArray[np.float64]
#: What may be acted on: names of live params, or a mapping of them and of axes.
Act = Sequence[str] | MappingOf[str, Any]

_FORM = "such as act={'z': 'force +- 5 N'}"
#: `force +- 5 N`, or with what it may change by in a second: `force +- 5 N at 50 N/s`.
_RESIDUAL = re.compile(r"\s*(\w+)\s*(?:\+-|±)\s*(.+?)(?:\s+at\s+(.+?))?\s*\Z")


@dataclass(frozen=True, slots=True)
class ActionChannel:
    """One number of an action.

    Attributes:
        name: of the live param, or the axis and what is added to it, as `z.force`.
        param: the live param that it sets.
        value: which 0 sets [SI].
        low, high: which -1 and 1 set [SI].
        stages: in which it has an effect.
    """

    name: str
    param: str
    value: float
    low: float
    high: float
    stages: frozenset[str]


class Actions:
    """What an agent does at every step.

    Attributes:
        loaded: the task, with its residuals.
        channels: in the order of the action.
        space: from -1 to 1 each.
        params: all live params of the task, in the order of `requested`.
    """

    def __init__(self, loaded: LoadedTask, act: Act | None) -> None:
        """Finds what may be acted on.

        Args:
            loaded: the task.
            act: names of live params, or a mapping: of such a name to True; of the name of an axis
                to residuals as `force +- 5 N`, one, a list, or a mapping as `{"force": "+- 5 N"}`.
                None for all live params.

        Raises:
            InputError: there is no such param or axis, or no stage has what would be added to.
            SpecError: an interval does not fit what it is added to.
        """
        given = _given(loaded.task, act)
        residuals = [
            each for name, what in given.items() for each in _residuals(loaded.task, name, what)
        ]
        self.loaded = with_residuals(loaded, residuals) if residuals else loaded
        found = [_of_param(self.loaded, name) for name, what in given.items() if what is True]
        found += [_of_residual(loaded.task, self.loaded.task, each) for each in residuals]
        self.channels = tuple(found)
        _check_different(self.channels)
        self.params = tuple(self.loaded.task.live)
        self._at = np.array(
            [self.params.index(each.param) for each in self.channels], dtype=np.intp
        )
        self._value, self._low, self._high = (
            np.array([getattr(each, key) for each in self.channels])
            for key in ("value", "low", "high")
        )
        self._start = np.array([each.value for each in self.loaded.task.live.values()])
        self.space = spaces.Box(-1.0, 1.0, (len(self.channels),), np.float32)

    def requested(self, action: NDArray[Any]) -> Vector:
        """(live params,) what they are requested to be, of an action (channels,).

        From the file's value, at 0, it goes evenly to either end of the interval; what is beyond
        an end is at it.

        Raises:
            InputError: it is of another size, or has a number that is none.
        """
        try:
            given = np.asarray(action, dtype=np.float64)
        except (TypeError, ValueError) as error:
            message = f"an action has {len(self.channels)} numbers: {self.words}"
            raise InputError(f"{message}; not {action!r}") from error
        if given.shape != self._at.shape:
            message = f"an action has {len(self.channels)} numbers: {self.words}"
            raise InputError(f"{message}; this one has the shape {given.shape}")
        if np.isnan(given).any():
            raise InputError(f"an action has a number that is none: {given.tolist()}")
        value = self._value
        side = np.where(given > 0, self._high - value, value - self._low)
        found = self._start.copy()
        found[self._at] = np.clip(value + given * side, self._low, self._high)
        return found

    @property
    def words(self) -> str:
        """What the numbers of an action are."""
        return ", ".join(each.name for each in self.channels)

    def idle(self, stage: str) -> tuple[str, ...]:
        """The channels that have no effect in a stage."""
        return tuple(each.name for each in self.channels if stage not in each.stages)


def _given(task: Task, act: Act | None) -> dict[str, Any]:
    if isinstance(act, str) or not isinstance(act, Iterable | None):
        raise InputError(f"act is a list or a mapping, {_FORM}, not {act!r}")
    if act is None:
        given: dict[str, Any] = dict.fromkeys(task.live, True)
    else:
        given = dict(act) if isinstance(act, MappingOf) else dict.fromkeys(act, True)
    if not given and task.live:
        raise InputError(f"act names nothing; leave it out for all live params: {_listed(task)}")
    if not given:
        message = "there is nothing to act on: the task has no live params"
        form = "params: {press: {value: 12 N, live: 5..20 N}}"
        raise InputError(f"{message} ({form}), and no residuals are given, {_FORM}")
    for name in given:
        if not isinstance(name, str):
            raise InputError(f"act: {name!r} is no name of a live param or an axis, {_FORM}")
    return given


def _listed(task: Task) -> str:
    return ", ".join(task.live)


def _residuals(task: Task, name: str, what: Any) -> Iterator[Residual]:
    """The residuals of an axis; none of a live param."""
    if what is True:
        return
    if name in task.live:
        instead = f"act={{{name!r}: True}}"
        raise InputError(f"act: {name!r} is a live param, whose interval is the file's: {instead}")
    axis = as_axis(name)
    if axis is None:
        hint = suggestion(name, list(map(str, Axis)), "axes")
        raise InputError(f"act: {name!r} is no axis, to which {what!r} could be added; {hint}")
    if isinstance(what, MappingOf):
        what = [f"{key} {interval}" for key, interval in what.items()]
    texts = list(what) if isinstance(what, Iterable) and not isinstance(what, str) else [what]
    if not texts:
        raise InputError(f"act: nothing is added to {name!r}: {_FORM}")
    for text in texts:
        matched = _RESIDUAL.match(str(text))
        if matched is None or matched.group(1) not in RESIDUAL_KEYS:
            keys = alternatives(RESIDUAL_KEYS)
            raise InputError(f"act: {text!r} is no residual of {name!r}: {keys}, {_FORM}")
        key, half, rate = matched.groups()
        yield Residual(axis, key, f"+- {half}", rate or "")


def _of_param(loaded: LoadedTask, name: str) -> ActionChannel:
    task = loaded.task
    live = task.live
    if name not in live:
        if as_axis(name) is not None:
            raise InputError(f"act: what is added to the axis {name!r}? {_FORM}")
        if name in task.params:
            found = task.params[name]
            form = f"{{value: {scaled(found.value, found.dimension)}, live: ..}}"
            raise InputError(f"act: the param {name!r} is not live: declare {name}: {form}")
        raise InputError(
            f"act: there is no param {name!r}; {suggestion(name, live, 'live params')}"
        )
    return _channel(name, name, live[name], _stages_using(loaded, name))


def _stages_using(loaded: LoadedTask, name: str) -> Iterator[str]:
    """The stages in which a param stands, by its own name or that of one that follows from it."""
    params, names = loaded.root.get("params"), {name}
    while isinstance(params, Mapping):
        more = {key for key, (_, each) in params.entries.items() if _names(each, names)} - names
        if not more:
            break
        names |= more
    sections = (loaded.root.get(key) for key in ("law", "frames", "limits"))
    everywhere = any(each is not None and _names(each, names) for each in sections)
    stages = loaded.root.get("stages")
    assert isinstance(stages, Mapping)
    for stage, (_, node) in stages.entries.items():
        if everywhere or _names(node, names):
            yield stage


def _names(node: Node, names: set[str]) -> bool:
    return any(has_word(scalar, name) for scalar in scalars(node) for name in names)


def _of_residual(before: Task, task: Task, residual: Residual) -> ActionChannel:
    stages = residual.stages_of(before)
    if not stages:
        named = f"{residual.key} on {residual.axis}"
        raise InputError(f"act: no stage has a {named}, to which a residual could be added")
    param = residual.param_of(before)
    name = f"{residual.axis}.{residual.key}"
    return _channel(name, param, task.live[param], frozenset(stages))


def _channel(name: str, param: str, found: LiveParam, stages: Iterable[str]) -> ActionChannel:
    return ActionChannel(name, param, found.value, found.low, found.high, frozenset(stages))


def _check_different(channels: Sequence[ActionChannel]) -> None:
    names = [each.name for each in channels]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"act: {twice} stands there twice")
