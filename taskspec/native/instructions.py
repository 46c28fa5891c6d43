"""CasADi's instructions of a function of SX, all of them at once, as an array of numbers."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Instructions = NDArray[np.int32]

#: Letters of one instruction where CasADi writes a function as text: two for each byte.
_LETTERS = 32
#: Those of functions that this process has.
_KNOWN: WeakKeyDictionary[ca.Function, Instructions] = WeakKeyDictionary()


def instructions(function: ca.Function) -> Instructions:
    """(n, 4) instructions in CasADi's order: operation, then three numbers that depend on it.

    - an input: place in the work vector that is written, argument, which of its nonzeros
    - an output: result, place that is read, which of the result's nonzeros
    - a constant: place that is written, then its 8 bytes
    - others: place that is written, one or two that are read

    Args:
        function: of SX.

    Raises:
        TypeError: it is no function of SX.
    """
    if not function.is_a("SXFunction"):
        raise TypeError(f"{function.name()} is no function of SX: `expand()` makes one of it")
    known = _KNOWN.get(function)
    if known is None:
        known = _written(function)
        if known is None:
            rows = [_instruction(function, k) for k in range(function.n_instructions())]
            known = np.array(rows, dtype=np.int32).reshape(-1, 4)
        known.flags.writeable = False
        _KNOWN[function] = known
    return known


def _written(function: ca.Function) -> Instructions | None:
    """Those in the text that CasADi writes of a function; None where they are not found in it.

    One by one they take three times as long. The place of their list depends on CasADi's version:
    it is where the first one and the last one are.
    """
    count = function.n_instructions()
    if not count:
        return None
    text: str = function.serialize()
    first, last = (_letters(_instruction(function, k)) for k in (0, count - 1))
    begin = text.find(first)
    while begin >= 0:
        end = begin + _LETTERS * count
        if text[end - _LETTERS : end] == last:
            letters = np.frombuffer(text[begin:end].encode(), dtype=np.uint8) - ord("a")
            return (letters[::2] | letters[1::2] << 4).view("<i4").reshape(count, 4)
        begin = text.find(first, begin + 1)
    return None


def _instruction(function: ca.Function, k: int) -> tuple[int, ...]:
    operation = function.instruction_id(k)
    read, written = function.instruction_input(k), function.instruction_output(k)
    if operation == ca.OP_CONST:
        constant = np.array([function.instruction_constant(k)], dtype="<f8")
        return operation, written[0], *constant.view("<i4").tolist()
    if operation == ca.OP_OUTPUT:
        return operation, written[0], read[0], written[1]
    # What reads one place has it twice; a call of a function has any number.
    return operation, *(*written, 0)[:1], *(*read, *read, 0, 0)[:2]


def _letters(instruction: tuple[int, ...]) -> str:
    """An instruction as CasADi writes it: of each byte the lower half first, as a letter from a."""
    data = np.array(instruction, dtype="<i4").tobytes()
    return "".join(chr(97 + half) for byte in data for half in (byte & 15, byte >> 4))
