"""Kernel functions, one for each construct of the language, run by both sides."""

from __future__ import annotations

import enum
import itertools
import math
from collections.abc import Callable

import buffers
import numpy as np

from taskspec.native.kernel import Counts, Record, Vector, Words, call, vector

_HALF, _MANY, _ON = 0.5, 7, True


class Colour(enum.IntEnum):
    RED = 3


class Motor(Record):
    turns: int
    heat: float


class Plant(Record):
    n: int
    gain: float
    state: Vector
    places: Counts
    words: Words
    steps: int
    motor: Motor


def arithmetic(out: Vector, x: float, y: float, i: int, j: int) -> None:
    """All operators of numbers."""
    out[0], out[1], out[2] = x + y, x - y, x * y
    if y != 0.0:
        out[3] = x / y
    out[4] = -x + 2 * y - 3 * i
    k = (i + j) * (i - j)
    out[5] = float(k)
    if j != 0:
        out[6], out[7] = float(i // j), float(i % j)
    out[8] = float((i & j) | (i ^ 5))
    out[9] = float((i << 3) >> 1)
    out[10] = float(-i)


def comparisons(out: Vector, x: float, y: float, i: int, j: int) -> None:
    flags = 0
    if x < y:
        flags += 1
    if x <= y:
        flags += 2
    if x > y:
        flags += 4
    if x >= y:
        flags += 8
    if x == y:
        flags += 16
    if x != y:
        flags += 32
    out[0] = float(flags)
    flags = int(i < j) | int(i <= j) << 1 | int(i > j) << 2 | int(i >= j) << 3
    flags |= int(i == j) << 4 | int(i != j) << 5
    out[1] = float(flags)
    out[2] = float((i < j) == (x < y))
    out[3] = float(x < 0)


def truth(out: Vector, x: float, y: float, i: int, j: int) -> None:
    """What is true, and that a second part is evaluated only where it is needed."""
    count = 0
    if x and y:
        count += 1
    if i or j:
        count += 2
    if not x:
        count += 4
    if not (i and not j) or (x > 0.0 and y > 0.0):
        count += 8
    if (j != 0 and i // j > 1) or (j == 0 and i > 1):
        count += 16
    both = x > 0.0 and y > 0.0
    either = x > 0.0 or y > 0.0 or i > 0
    out[0], out[1], out[2] = float(count), float(both), float(either)
    out[3] = x if both else (y if either else -1.5)
    out[4] = float(i if i > j else j)


def functions(out: Vector, x: float, y: float, i: int, j: int) -> None:
    out[0], out[1], out[2] = max(x, y), min(x, y), max(x, y, 0.25)
    out[3], out[4], out[5] = abs(x), float(abs(i)), float(min(i, j, 2))
    out[6], out[7] = math.fabs(y), math.copysign(x, y)
    out[8] = float(math.isfinite(x)) + 2.0 * float(math.isinf(x)) + 4.0 * float(math.isnan(x))
    if x >= 0.0:
        out[9] = math.sqrt(x)
    if abs(x) < 1e9:
        out[10] = float(int(x)) + float(math.floor(x)) * 2.0 + float(math.ceil(x)) * 4.0
        out[11], out[12], out[13] = math.sin(x), math.cos(x), math.tan(x)
    out[14], out[15] = math.atan(x), math.atan2(x, y)
    if abs(x) <= 1.0:
        out[16], out[17], out[18] = math.asin(x), math.acos(x), math.exp(x)
    if x > 0.0 and math.isfinite(x):
        out[19] = math.log(x)
    out[20], out[21], out[22] = math.pi, math.inf, float(Colour.RED)
    out[23], out[24], out[25] = _HALF, float(_MANY), float(_ON)
    out[26] = math.nan


def loops(out: Vector, x: float, y: float, i: int, j: int) -> None:
    total = 0
    for k in range(5):
        total += k
    for k in range(2, 9, 3):
        total = total * 10 + k
    for k in range(i, j, -2):
        total = total * 3 + k
        if total > 100000:
            break
    out[0] = float(total)
    loops_that_change(out)
    loops_that_leave(out)
    x, y = y, x
    out[6], out[7] = x, y
    a = b = 2.5
    a += b
    c: int = 4
    c -= 1
    c *= 5
    out[8], out[9] = a, float(c)
    if x > y:
        pass
    elif x < y:
        out[10] = 1.0
    else:
        out[10] = 2.0


def loops_that_change(out: Vector) -> None:
    """The count goes on as it was, whatever its name and its bound are given."""
    turns = 0
    for k in range(4):
        turns += 1
        k = 100
        if k == 3:
            continue
        turns += 10
    out[1] = float(turns)
    bound, steps = 4, 0
    for _ in range(bound):
        bound = 0
        steps += 1
    out[2] = float(steps)


def loops_that_leave(out: Vector) -> None:
    left = 10
    while left > 0:
        left -= 3
        if left == 4:
            continue
        if left == 1:
            break
    out[3] = float(left)
    while True:
        left += 1
        for k in range(10):
            if k == 3:
                break
            left += k
        if left > 20:
            break
    out[4] = float(left)
    for _ in range(0):
        left = 0
    out[5] = float(left)


def memory(out: Vector, x: float, y: float, i: int, j: int) -> None:
    rest = out[3:]
    rest[0], rest[1] = x, y
    rest[i] = 4.0
    rest[i] += x
    rest[i + 1] *= 0.0
    tail = rest[i:]
    tail[2] = rest[1]
    rest = tail[1:]
    out[0] = rest[j]
    out[1] = float(_fibonacci(i + 6))
    _swap(out, out[1:])
    out[2] = _mean(out[3:], 4) if _positive(x) else 0.0


def _fibonacci(k: int) -> int:
    if k < 2:
        return k
    before = _fibonacci(k - 1)
    return before + _fibonacci(k - 2)


def _swap(a: Vector, b: Vector) -> None:
    a[0], b[0] = b[0], a[0]


def _mean(v: Vector, n: int) -> float:
    total = 0.0
    for k in range(n):
        total += v[k]
    return total / float(n)


def _positive(x: float) -> bool:
    return x > 0.0


ALL = (arithmetic, comparisons, truth, functions, loops, memory)


def drive(c: Plant, step: int) -> int:
    """Fields of a record, read and written, and a native function by address."""
    while c.steps < c.n:
        if step != 0:
            call(step, c.state, c.n, c.gain)
        k = c.places[c.steps % 3]
        c.state[k] += c.gain
        c.places[0] = 3 - c.places[0]
        c.words[k] = (c.words[0] ^ (c.words[k] >> 7)) + 3 * k
        c.gain *= 1.5
        c.steps += 1
        _turn(c.motor, c.gain)
        c.motor.heat *= 0.75
        if not _enough(c):
            return -1
    return c.steps


def _turn(m: Motor, by: float) -> None:
    m.turns += int(by)
    m.heat += by


def _enough(c: Plant) -> bool:
    return c.gain < 100.0


def twice(x: float) -> float:
    """Two calls in one expression, which C may make in either order."""
    return _halved(x) + _halved(2.0 * x)


def _halved(x: float) -> float:
    return 0.5 * x


def mean_the_same(function: Callable[..., None], run: Callable[..., object]) -> None:
    """Holds a compiled function of these against Python's, for numbers of all kinds."""
    floats = [0.0, -0.0, 0.3, 1.0, -2.75, 3.5e8, 5e-324, np.inf, -np.inf, np.nan]
    ints = [0, 1, 2, 3, 5] if function is memory else [0, 1, -1, 3, -7, 20, 1234567890]
    for x, y, i, j in itertools.product(floats, floats, ints, ints):
        if function is loops and abs(i) + abs(j) > 100:
            continue
        ours, theirs = np.full(30, 0.125), np.full(30, 0.125)
        run(ours.ctypes.data, x, y, i, j)
        function(vector(theirs), x, y, i, j)
        assert buffers.bits(ours) == buffers.bits(theirs), (x, y, i, j)
