"""Machine code of a run's functions: made once in a process, and kept for the next one.

A function has two tiers: the interpreter, which is there for all functions once it has been made,
and code of its own, which is faster and takes some hundred milliseconds to compile.
"""

from __future__ import annotations

import enum
import hashlib
from collections import OrderedDict
from collections.abc import Callable, Hashable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cache, cached_property
from threading import Lock
from types import ModuleType
from typing import Any
from weakref import WeakValueDictionary

import casadi as ca

from taskspec.deferred_methods import dataclass
from taskspec.native import interpreter
from taskspec.native.engine import Engine, NotKeptError
from taskspec.native.expressions import expression_ir
from taskspec.native.instructions import instructions
from taskspec.native.interpreter import INTERPRET, interpreter_ir
from taskspec.native.kernel_ir import kernel_ir, kernel_source

#: What a function of CasADi's is called in its engine.
CODE = "f"
#: Functions whose code a process finds again: those of some tasks with many stages.
_MOST = 256


class NotReadyError(Exception):
    """There is no machine code yet."""


class Compiling(enum.Enum):
    """What becomes of code that is neither here nor kept.

    Attributes:
        WAIT: it is compiled.
        BESIDE: it is compiled by a thread of its own, and there is none until it has been.
        NOT_YET: there is none.
        NEVER: there is none even if it is here or kept: the interpreter evaluates all functions.
    """

    WAIT = "wait"
    BESIDE = "beside"
    NOT_YET = "not yet"
    NEVER = "never"


@dataclass(frozen=True)
class _Source:
    """What an engine is made of.

    Attributes:
        key: by which this process finds it.
        holds: what has to live as long as the key is to mean this.
        written: what its IR follows from.
        ir: makes that.
        level: LLVM's optimisation.
    """

    key: Hashable
    holds: Any
    written: Callable[[], bytes]
    ir: Callable[[], str]
    level: int

    @cached_property
    def text(self) -> bytes:
        """What its IR follows from."""
        return self.written()

    def engine(self, *, compiles: bool) -> Engine:
        """The engine; a NotKeptError where none is kept and none is to be compiled."""
        return Engine(lambda: [self.ir()], level=self.level, source=self.text, compiles=compiles)

    @property
    def content(self) -> bytes:
        """By which it is found that another source is made of the same."""
        return hashlib.sha256(b"%d " % self.level + self.text).digest()


class _Engines:
    """The engines that this process has, and those that are being made."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._made: OrderedDict[Hashable, tuple[Any, Engine]] = OrderedDict()
        # Worlds of a sweep have functions of their own that are alike: nothing is kept of them.
        self._alike: WeakValueDictionary[bytes, Engine] = WeakValueDictionary()
        # By key and by content: an alike source is found while its first is still being compiled.
        self._under_way: dict[Hashable, tuple[_Source, Future[Engine]]] = {}
        self._alike_under_way: dict[bytes, Future[Engine]] = {}

    def of(self, source: _Source, compiling: Compiling) -> Engine:
        """The engine of a source; see `expression_engine`."""
        with self._lock:
            if source.key in self._made:
                self._made.move_to_end(source.key)
                return self._made[source.key][1]
            # With what holds what the key is of for as long as the key is here.
            _, under_way = self._under_way.get(source.key, (None, None))
        if under_way is None:
            with self._lock:
                alike = self._alike.get(source.content)
                under_way = self._alike_under_way.get(source.content)
            if alike is not None:
                return alike
        if under_way is None:
            try:
                return self._keep(source, source.engine(compiles=compiling is Compiling.WAIT))
            except NotKeptError:
                if compiling is Compiling.NOT_YET:
                    raise NotReadyError from None
                with self._lock:
                    under_way = self._alike_under_way.get(source.content)
                    if under_way is None:
                        under_way = _compiler().submit(self._compile, source)
                        self._under_way[source.key] = source, under_way
                        self._alike_under_way[source.content] = under_way
        if not (compiling is Compiling.WAIT or under_way.done()):
            raise NotReadyError
        return under_way.result()

    def _compile(self, source: _Source) -> Engine:
        """What the thread does; one that fails stays, to say so to whoever asks."""
        engine = self._keep(source, source.engine(compiles=True))
        with self._lock:
            del self._under_way[source.key], self._alike_under_way[source.content]
        return engine

    def _keep(self, source: _Source, engine: Engine) -> Engine:
        with self._lock:
            self._made[source.key] = source.holds, engine
            self._alike[source.content] = engine
            while len(self._made) > _MOST:
                self._made.popitem(last=False)
        return engine


_ENGINES = _Engines()


def expression_engine(function: ca.Function, compiling: Compiling) -> Engine:
    """The machine code of a function, as `CODE`: what there is, what is kept, or a new one.

    Args:
        function: of SX.
        compiling: whether it is compiled if there is none.

    Raises:
        EngineError: there is no machine code here.
        UnsupportedOperationError: it has an operation that machine code lacks.
        NotReadyError: there is none yet.
    """
    if compiling is Compiling.NEVER:
        raise NotReadyError

    def text() -> bytes:
        inputs = [function.nnz_in(k) for k in range(function.n_in())]
        outputs = [function.nnz_out(k) for k in range(function.n_out())]
        written: bytes = instructions(function).tobytes()
        return _package() + f"{ca.CasadiMeta.version()} {inputs} {outputs} ".encode() + written

    # A function's hash is where it lies.
    source = _Source(
        function.__hash__(), function, text, lambda: expression_ir(function, CODE), level=1
    )
    return _ENGINES.of(source, compiling)


def interpreter_engine() -> Engine:
    """The machine code of the interpreter, which is compiled if it is not kept.

    Raises:
        EngineError: there is no machine code here.
    """

    def text() -> bytes:
        return kernel_source(interpreter) + f"{ca.CasadiMeta.version()}".encode()

    source = _Source(INTERPRET, None, text, interpreter_ir, level=1)
    return _ENGINES.of(source, Compiling.WAIT)


def kernel_engine(
    function: Callable[..., Any], *modules: ModuleType, compiling: Compiling
) -> Engine:
    """The machine code of a kernel, by its name.

    Args:
        function: the kernel.
        modules: as in `kernel_source`.
        compiling: whether it is compiled if there is none.

    Raises:
        EngineError: there is no machine code here.
        NotReadyError: there is none yet.
    """
    source = _Source(
        function, None, lambda: kernel_source(*modules), lambda: kernel_ir(function), level=2
    )
    return _ENGINES.of(source, compiling)


@cache
def _package() -> bytes:
    """Stands for the text of this package, by which the code of all functions goes."""
    return hashlib.sha256(kernel_source()).digest()


@cache
def _compiler() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(1, "compiler")
