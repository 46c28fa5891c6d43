"""Dataclasses whose methods are written late are those of the standard library."""

from __future__ import annotations

import copy
import dataclasses
import inspect
import pickle
import threading
from functools import cached_property
from typing import ClassVar, get_type_hints

import pytest

from taskspec.deferred_methods import dataclass

VARIANTS = [
    {"frozen": True, "slots": True},
    {"frozen": True, "slots": True, "eq": False},
    {"frozen": True, "eq": False},
    {"frozen": True},
    {"slots": True},
    {},
]


def pair(decorator, **options):
    """A class and one that inherits from it, as a decorator makes them."""

    @decorator(**options)
    class Base:
        count: ClassVar[int] = 3
        x: float
        named: dict[str, int] = dataclasses.field(default_factory=dict, compare=False)
        hidden: int = dataclasses.field(default=7, repr=False, kw_only=True)
        sum: float = dataclasses.field(init=False, default=0.5)

        def __post_init__(self) -> None:
            object.__setattr__(self, "sum", self.x + self.hidden)

    @decorator(**options)
    class Heir(Base):
        y: str = "y"

    return Base, Heir


def value_of(do):
    """What a call gives, or the type of what it raises; of an object its own name is left out."""
    try:
        return do()
    except Exception as error:
        return type(error)


@pytest.mark.parametrize("options", VARIANTS, ids=str)
@pytest.mark.parametrize("which", [0, 1])
def test_methods_do_what_those_of_the_standard_library_do(options, which):
    late, usual = (
        pair(decorator, **options)[which] for decorator in (dataclass, dataclasses.dataclass)
    )
    for ask in (
        lambda c: repr(c(1.0)).replace(c.__qualname__, "C"),
        lambda c: repr(c(x=2.0, named={"a": 1}, hidden=3)).replace(c.__qualname__, "C"),
        lambda c: c(),
        lambda c: c(1.0, {}, "y", 2),
        lambda c: c(1.0, sum=2),
        lambda c: c(1.0) == c(1.0),
        lambda c: c(1.0) == c(2.0),
        lambda c: c(1.0) == c(1.0, named={"b": 2}),
        lambda c: c(1.0) == 1.0,
        lambda c: c(1.0) < c(2.0),
        lambda c: c(1.0).named is c(1.0).named,
        lambda c: (c.__hash__ is None, c.__hash__ is object.__hash__),
        lambda c: len({c(1.0), c(1.0), c(1.0, named={"b": 2}), c(3.0)}),
        lambda c: setattr(c(1.0), "x", 2.0),
        lambda c: delattr(c(1.0), "x"),
        lambda c: repr(dataclasses.replace(c(1.0), x=4.0)).replace(c.__qualname__, "C"),
        lambda c: dataclasses.asdict(c(1.0)),
        lambda c: (copy.copy(c(1.0)).sum, copy.deepcopy(c(1.0, hidden=2)).sum),
        lambda c: c.__match_args__,
        lambda c: c.__dict__.get("__slots__"),
        lambda c: str(inspect.signature(c)),
        lambda c: get_type_hints(c.__init__),
        lambda c: [(f.name, f.type, f.default, f.kw_only) for f in dataclasses.fields(c)],
    ):
        assert value_of(lambda: ask(late)) == value_of(lambda: ask(usual))  # noqa: B023


@dataclass(frozen=True, slots=True)
class Sent:
    """Of a module, as whatever is pickled has to be."""

    x: float
    inner: Sent | None = None


def test_instances_are_pickled():
    sent = Sent(1.0, Sent(2.0))
    assert pickle.loads(pickle.dumps(sent)) == sent
    assert hash(sent) == hash(copy.deepcopy(sent))


def test_what_a_class_writes_itself_is_kept():
    @dataclass(frozen=True)
    class Own:
        x: int

        def __repr__(self) -> str:
            return "own"

        def __eq__(self, other: object) -> bool:
            return True

        def __hash__(self) -> int:
            return 5

    assert (repr(Own(1)), Own(1) == 2, hash(Own(1))) == ("own", True, 5)


def test_frozen_and_others_do_not_inherit_from_each_other():
    @dataclass(frozen=True)
    class Frozen:
        x: int

    @dataclass
    class Open:
        x: int

    for decorator in (dataclass, dataclasses.dataclass):
        with pytest.raises(TypeError, match="non-frozen"):

            @decorator
            class Opened(Frozen):
                y: int

        with pytest.raises(TypeError, match="non-frozen"):

            @decorator(frozen=True)
            class Closed(Open):
                y: int

    @dataclasses.dataclass(frozen=True)
    class Heir(Frozen):
        y: int

    assert repr(Heir(1, 2)).endswith("Heir(x=1, y=2)")


def test_a_frozen_class_keeps_what_it_computes():
    @dataclass(frozen=True)
    class Computes:
        x: int

        @cached_property
        def double(self) -> int:
            return 2 * self.x

    made = Computes(2)
    assert (made.double, made.double) == (4, 4)
    with pytest.raises(dataclasses.FrozenInstanceError):
        made.other = 1


def test_a_default_that_follows_none_is_refused_at_the_first_use():
    @dataclass
    class Wrong:
        x: int = 1
        y: int

    with pytest.raises(SyntaxError):
        Wrong(1, 2)


def test_names_of_fields_may_be_those_that_a_method_uses():
    @dataclass(frozen=True, slots=True)
    class Names:
        hash: int
        object: int = 2
        NotImplemented: int = 3

    assert Names(1) == Names(1)
    assert hash(Names(1)) == hash(Names(1))
    assert "hash=1, object=2" in repr(Names(1))


def test_threads_may_be_first_together():
    for _ in range(50):

        @dataclass(frozen=True, slots=True)
        class Shared:
            x: int

        begin, made = threading.Barrier(4), []

        def use(Shared=Shared, begin=begin, made=made) -> None:
            begin.wait()
            made.append(Shared(3))

        threads = [threading.Thread(target=use) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert made == [Shared(3)] * 4
