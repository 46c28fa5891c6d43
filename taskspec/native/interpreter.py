"""An interpreter of CasADi's instructions in machine code: made once, and there for every function.

Each operation is a piece of code that goes through a run of instructions, computes one number by
each, and jumps to the operation of the next run, whose address stands there (threaded code). Its
lines are those that `expression_ir` has for it, so that both give the bits of CasADi's virtual
machine.

A function is prepared for it once. Each value gets a place of its own in the work vector, so that a
result lies behind the one before, and constants lie there from the beginning. Instructions are in
the order of how deep their operands are computed, and among those of one depth by operation, so
that runs are long: a processor that has guessed another operation than comes loses more time than
an addition takes.
"""

from __future__ import annotations

from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.native.engine import Engine
from taskspec.native.expressions import (
    OPERATIONS,
    Lines,
    UnsupportedOperationError,
    declaration,
    has_bits_of_casadi,
    operands_of,
)
from taskspec.native.instructions import Instructions, instructions

#: What calls the first operation, in the convention of CasADi's functions.
INTERPRET = "interpret"

Numbers = NDArray[np.int64]

_END = "operation.end"
#: Where the run is and where its first result goes, the work vector, arguments and results.
_STATE = "ptr %run, ptr %begin, ptr %w, ptr %arg, ptr %res"


def interpreter_ir() -> str:
    """LLVM IR of the interpreter.

    `int interpret(const double **arg, double **res, long long *iw, double *w, int mem)` returns 0.
    It takes the runs in `iw` and the work vector in `w` as `Interpreted` has them, and uses no
    `mem`. An argument of NULL is zeros, a result of NULL is left out. Everything is read before
    anything is written.

    A run is words of 64 bits: the address of the operation, how many instructions there are, and
    these. An instruction is a word with two numbers of 32 bits, of a result two words.
    """
    operations, called = [], set()
    for operation in filter(has_bits_of_casadi, OPERATIONS):
        lines = Lines()
        operands = [_operand(lines, k) for k in range(operands_of(operation))]
        lines.lines.append(f"store double {OPERATIONS[operation](lines, *operands)}, ptr %to")
        operations.append(_operation(_name(operation), lines))
        called |= lines.called
    return "\n".join(
        [
            "@zero = internal constant double 0.0",
            f"define i32 @{INTERPRET}(ptr %arg, ptr %res, ptr %iw, ptr %w, i32 %mem) nounwind {{",
            "%first = load ptr, ptr %iw",
            "call void %first(ptr %iw, ptr %w, ptr %w, ptr %arg, ptr %res)",
            "ret i32 0",
            "}",
            *operations,
            _operation(_name(ca.OP_INPUT), _reading()),
            _operation(_name(ca.OP_OUTPUT), _writing(), words=2, results=0),
            f'define void @"{_END}"({_STATE}) nounwind {{',
            "ret void",
            "}",
            *(declaration(name) for name in sorted(called)),
            "",
        ]
    )


def _name(operation: int) -> str:
    return f"operation.{operation}"


def _operation(name: str, lines: Lines, *, words: int = 1, results: int = 1) -> str:
    """The code of an operation: its lines for each instruction, and the jump to the next run."""
    return "\n".join(
        [
            f'define void @"{name}"({_STATE}) nounwind {{',
            "%number = getelementptr i64, ptr %run, i64 1",
            "%count = load i64, ptr %number",
            "%first = getelementptr i64, ptr %run, i64 2",
            f"%end = getelementptr [{words} x i64], ptr %first, i64 %count",
            "br label %each",
            "each:",
            "%at = phi ptr [ %first, %0 ], [ %next, %each ]",
            "%to = phi ptr [ %begin, %0 ], [ %further, %each ]",
            *lines.lines,
            f"%next = getelementptr i64, ptr %at, i64 {words}",
            f"%further = getelementptr double, ptr %to, i64 {results}",
            "%done = icmp eq ptr %next, %end",
            "br i1 %done, label %jump, label %each",
            "jump:",
            "%code = load ptr, ptr %end",
            "musttail call void %code(ptr %end, ptr %further, ptr %w, ptr %arg, ptr %res)",
            "ret void",
            "}",
        ]
    )


def _number(lines: Lines, k: int) -> str:
    """The k-th number of the instruction."""
    place = lines.new(f"getelementptr i32, ptr %at, i64 {k}")
    return lines.new(f"zext i32 {lines.new(f'load i32, ptr {place}')} to i64")


def _operand(lines: Lines, k: int) -> str:
    """What lies in the work vector where the k-th number says."""
    place = lines.new(f"getelementptr double, ptr %w, i64 {_number(lines, k)}")
    return lines.new(f"load double, ptr {place}")


def _place(lines: Lines, vectors: str, k: int, otherwise: str) -> str:
    """The place that numbers k and k + 1 name: of a vector, in it; otherwise without that."""
    vector = lines.new(f"getelementptr ptr, ptr {vectors}, i64 {_number(lines, k)}")
    vector = lines.new(f"load ptr, ptr {vector}")
    place = lines.new(f"getelementptr double, ptr {vector}, i64 {_number(lines, k + 1)}")
    missing = lines.new(f"icmp eq ptr {vector}, null")
    return lines.new(f"select i1 {missing}, ptr {otherwise}, ptr {place}")


def _reading() -> Lines:
    """An argument's number into the work vector."""
    lines = Lines()
    read = lines.new(f"load double, ptr {_place(lines, '%arg', 0, '@zero')}")
    lines.lines.append(f"store double {read}, ptr %to")
    return lines


def _writing() -> Lines:
    """A number of the work vector into a result; behind all that is used where that is left out."""
    lines = Lines()
    value = _operand(lines, 0)
    lines.lines.append(f"store double {value}, ptr {_place(lines, '%res', 1, '%to')}")
    return lines


@dataclass(frozen=True)
class Interpreted:
    """A function as the interpreter takes it.

    Attributes:
        engine: of the interpreter; the runs have addresses in it.
        runs: (m,) one after the other, and the address of the end.
        work: (k,) what the work vector begins as. Each who evaluates the function needs a copy.
    """

    engine: Engine
    runs: Numbers
    work: NDArray[np.float64]


#: Those of the functions that this process has.
_PREPARED: WeakKeyDictionary[ca.Function, Interpreted] = WeakKeyDictionary()


def interpreted(function: ca.Function, engine: Engine) -> Interpreted:
    """A function of SX, prepared for the interpreter; once in a process.

    Raises:
        UnsupportedOperationError: it has an operation that the interpreter lacks.
    """
    prepared = _PREPARED.get(function)
    if prepared is None or prepared.engine is not engine:
        prepared = _PREPARED[function] = _prepared(function, engine)
    return prepared


def _prepared(function: ca.Function, engine: Engine) -> Interpreted:
    rows = instructions(function)
    kind = rows[:, 0]
    results, inputs, constants = (
        np.flatnonzero(kind == operation) for operation in (ca.OP_OUTPUT, ca.OP_INPUT, ca.OP_CONST)
    )
    computed = np.delete(np.arange(len(rows)), np.concatenate([results, inputs, constants]))
    codes = _codes(engine)
    lacking = kind[computed][codes[kind[computed]] == 0]
    if lacking.size:
        raise UnsupportedOperationError(function.name(), int(lacking[0]))
    operands = np.stack([_writers(rows, computed, 2), _writers(rows, computed, 3)])
    operands[1] = np.where(_HAS_TWO[kind[computed]], operands[1], operands[0])
    order = np.lexsort((kind[computed], _depths(len(rows), computed, operands)))
    computed, operands = computed[order], operands[:, order]

    # The work vector: inputs, what is computed, a place that nobody reads, constants.
    first, spare = len(inputs), len(inputs) + len(computed)
    work = np.zeros(spare + 1 + len(constants))
    work[spare + 1 :] = rows[constants, 2:].copy().view(np.float64).ravel()
    place = np.zeros(len(rows), dtype=np.int64)
    place[inputs], place[computed] = np.arange(first), np.arange(first, spare)
    place[constants] = np.arange(spare + 1, len(work))

    source = place[_writers(rows, results, 2)]
    numbers = np.concatenate(
        [
            np.pad(rows[inputs, 2:], [(0, 0), (0, 1)]),
            np.pad(place[operands].T, [(0, 0), (0, 1)]),
            np.stack([source, *rows[results][:, [1, 3]].T], axis=1),
        ]
    )
    order = np.concatenate([inputs, computed, results])
    return Interpreted(engine, _runs(kind[order], numbers, codes, engine.address(_END)), work)


def _runs(kinds: Instructions, numbers: Numbers, codes: Numbers, end: int) -> Numbers:
    """Instructions as the interpreter takes them.

    Args:
        kinds: (n,) the operation of each, in their order.
        numbers: (n, 3) two for the first word of each, one for the second word of a result.
        codes: the addresses of operations.
        end: the address of what comes last.
    """
    words = np.where(kinds == ca.OP_OUTPUT, 2, 1)
    begins = np.flatnonzero(np.diff(kinds, prepend=-1))
    heads = np.zeros(len(kinds), dtype=np.int64)
    heads[begins] = 2
    places = np.cumsum(heads + words) - words
    runs = np.zeros(heads.sum() + words.sum() + 1, dtype=np.int64)
    runs[places[begins] - 2] = codes[kinds[begins]]
    runs[places[begins] - 1] = np.diff(begins, append=len(kinds))
    runs[places] = numbers[:, 0] | numbers[:, 1] << 32
    runs[places[words == 2] + 1] = numbers[words == 2, 2]
    runs[-1] = end
    return runs


def _codes(engine: Engine) -> Numbers:
    """The addresses of operations by CasADi's number, 0 for what there is no code of."""
    codes = np.zeros(_OPERATIONS_OF_CASADI, dtype=np.int64)
    names = frozenset(engine.names)
    for operation in (ca.OP_INPUT, ca.OP_OUTPUT, *OPERATIONS):
        if _name(operation) in names:
            codes[operation] = engine.address(_name(operation))
    return codes


def _writers(rows: Instructions, readers: Numbers, column: int) -> Numbers:
    """The instructions that wrote last what others read in their work vector.

    Args:
        rows: all instructions.
        readers: numbers of those that read.
        column: where rows have the place that is read.
    """
    count = len(rows)
    writers = np.flatnonzero(rows[:, 0] != ca.OP_OUTPUT)
    # By places, in the order in which they are written.
    written = np.sort(rows[writers, 1].astype(np.int64) * count + writers)
    read = rows[readers, column].astype(np.int64) * count + readers
    found: Numbers = written[np.searchsorted(written, read) - 1] % max(count, 1)
    return found


def _depths(count: int, computed: Numbers, operands: Numbers) -> Numbers:
    """How many instructions follow on each other, at most, up to each of those that compute."""
    depths = [0] * count
    for k, a, b in zip(computed.tolist(), *operands.tolist(), strict=True):
        x, y = depths[a], depths[b]
        depths[k] = 1 + (x if x > y else y)
    return np.array(depths, dtype=np.int64)[computed]


_OPERATIONS_OF_CASADI = 1 + max(getattr(ca, name) for name in dir(ca) if name.startswith("OP_"))
_HAS_TWO = np.array([k in OPERATIONS and operands_of(k) == 2 for k in range(_OPERATIONS_OF_CASADI)])
