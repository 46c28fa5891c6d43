"""Dataclasses whose methods are written when something first asks for them.

`dataclasses.dataclass` has Python compile half a dozen methods of a class while its module is
loaded, most of which nobody calls: a sixth of the time that a command takes which reads one
file. Here a class has its fields and slots at once, and each method from its first use on, the
same as the standard library writes.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable, Mapping, Sequence
from reprlib import recursive_repr
from typing import TYPE_CHECKING, Any

__all__ = ["dataclass"]

if TYPE_CHECKING:
    from dataclasses import dataclass
else:

    def dataclass(cls=None, /, *, frozen=False, slots=False, eq=True):
        """`dataclasses.dataclass`, as far as its options are used here; no `InitVar`."""
        if cls is None:
            return lambda cls: _made(cls, frozen=frozen, slots=slots, eq=eq)
        return _made(cls, frozen=frozen, slots=slots, eq=eq)


class _Method:
    """A method that is not written yet: what looks it up has it written, and find its place."""

    __slots__ = ("_name", "_owner", "_write")

    def __init__(self, owner: type, name: str, write: Callable[[type], Any]) -> None:
        self._owner, self._name, self._write = owner, name, write

    def __get__(self, instance: object, owner: type | None = None) -> Any:
        method = self._write(self._owner)
        method.__qualname__ = f"{self._owner.__qualname__}.{self._name}"
        # Two threads may both write it: either is as good.
        if self._owner.__dict__.get(self._name) is self:
            setattr(self._owner, self._name, method)
        return method.__get__(instance, owner)


def _made(cls: type, *, frozen: bool, slots: bool, eq: bool) -> Any:
    own = dict(cls.__dict__)
    if cls.__doc__ is None:
        # Else the standard library makes one of the signature, for which it has to be written.
        cls.__doc__ = cls.__name__
    bases = [base for base in cls.__mro__[1:] if dataclasses.is_dataclass(base)]
    inherits = any(_options(base).frozen for base in bases)
    # A class refuses changes by methods; they are inherited if there is a base that has them.
    if bases and frozen != inherits:
        frozen_or_not = ("non-frozen", "frozen") if inherits else ("frozen", "non-frozen")
        raise TypeError("cannot inherit {} dataclass from a {} one".format(*frozen_or_not))
    made: Any = dataclasses.dataclass(
        init=False, repr=False, eq=False, slots=slots, frozen=frozen and inherits
    )(cls)
    options = _options(made)
    options.init, options.repr, options.eq, options.frozen = True, True, eq, frozen
    methods = {"__init__": _init, "__repr__": _repr} | ({"__eq__": _eq} if eq else {})
    for name, write in methods.items():
        if name not in own:
            setattr(made, name, _Method(made, name, write))
    if eq and own.get("__hash__") is None:
        made.__hash__ = _Method(made, "__hash__", _hash) if frozen else None
    if frozen and not inherits:
        _freeze(made)
    if frozen and slots and "__getstate__" not in own:
        made.__getstate__, made.__setstate__ = _state, _restore
    return made


def _options(cls: Any) -> Any:
    """What a dataclass was made with."""
    return cls.__dataclass_params__


def _init(cls: type) -> Any:
    """`__init__` of a class."""
    frozen = _options(cls).frozen
    scope: dict[str, Any] = {"_set": object.__setattr__, "_absent": _ABSENT}
    heads: list[str] = ["self"]
    named: list[str] = []
    body: list[str] = []
    for each in dataclasses.fields(cls):
        name = value = each.name
        head = name
        if each.default_factory is not dataclasses.MISSING:
            scope[f"_new_{name}"] = each.default_factory
            head, value = f"{name}=_absent", f"_new_{name}()"
            if each.init:
                value += f" if {name} is _absent else {name}"
        elif each.default is not dataclasses.MISSING:
            scope[f"_default_{name}"] = each.default
            head = f"{name}=_default_{name}"
            value = name if each.init else f"_default_{name}"
        elif not each.init:
            continue
        if each.init:
            (named if each.kw_only else heads).append(head)
        body.append(f"_set(self, {name!r}, {value})" if frozen else f"self.{name} = {value}")
    if hasattr(cls, "__post_init__"):
        body.append("self.__post_init__()")
    init = _function(cls, "__init__", [*heads, *(["*"] if named else []), *named], body, scope)
    init.__annotations__ = {f.name: f.type for f in dataclasses.fields(cls) if f.init}
    init.__annotations__["return"] = None
    return init


def _repr(cls: type) -> Any:
    """`__repr__` of a class."""
    shown = ", ".join(f"{f.name}={{self.{f.name}!r}}" for f in dataclasses.fields(cls) if f.repr)
    body = [f'return f"{{self.__class__.__qualname__}}({shown})"']
    return recursive_repr()(_function(cls, "__repr__", ["self"], body, {}))


def _eq(cls: type) -> Any:
    """`__eq__` of a class."""
    names = [f.name for f in dataclasses.fields(cls) if f.compare]
    body = [
        "if other.__class__ is self.__class__:",
        f"    return {_tuple('self', names)} == {_tuple('other', names)}",
        "return NotImplemented",
    ]
    return _function(cls, "__eq__", ["self", "other"], body, {})


def _hash(cls: type) -> Any:
    """`__hash__` of a class."""
    names = [f.name for f in dataclasses.fields(cls) if (f.compare if f.hash is None else f.hash)]
    body = [f"return _hash({_tuple('self', names)})"]
    return _function(cls, "__hash__", ["self"], body, {"_hash": hash})


def _tuple(of: str, names: Sequence[str]) -> str:
    return f"({''.join(f'{of}.{name}, ' for name in names)})"


def _function(
    cls: type, name: str, heads: Sequence[str], body: Sequence[str], scope: Mapping[str, Any]
) -> Any:
    """A function of the class's module; names of `scope` mean the values there."""
    lines = [
        f"def _written({', '.join(scope)}):",
        f"    def {name}({', '.join(heads)}):",
        *(f"        {line}" for line in body or ["pass"]),
        f"    return {name}",
    ]
    module = sys.modules.get(cls.__module__)
    found: dict[str, Any] = {}
    exec("\n".join(lines), {} if module is None else module.__dict__, found)
    return found["_written"](**scope)


def _freeze(cls: Any) -> None:
    """Has a class refuse changes of its instances."""
    names = frozenset(cls.__dataclass_fields__)

    def __setattr__(self: object, name: str, value: object) -> None:  # noqa: N807
        if type(self) is cls or name in names:
            raise dataclasses.FrozenInstanceError(f"cannot assign to field {name!r}")
        super(cls, self).__setattr__(name, value)

    def __delattr__(self: object, name: str) -> None:  # noqa: N807
        if type(self) is cls or name in names:
            raise dataclasses.FrozenInstanceError(f"cannot delete field {name!r}")
        super(cls, self).__delattr__(name)

    cls.__setattr__, cls.__delattr__ = __setattr__, __delattr__


def _state(self: Any) -> list[Any]:
    """What an instance with slots is pickled and copied by."""
    return [getattr(self, field.name) for field in dataclasses.fields(self)]


def _restore(self: Any, state: Sequence[Any]) -> None:
    for field, value in zip(dataclasses.fields(self), state, strict=True):
        object.__setattr__(self, field.name, value)


class _Absent:
    """Stands for a value that was not given."""

    def __repr__(self) -> str:
        return "<factory>"


_ABSENT = _Absent()
