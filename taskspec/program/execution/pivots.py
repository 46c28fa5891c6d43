"""The choice of columns by pivots, in the Python that becomes machine code.

Both loops make it of this source: under Python a stage is entered rarely, and in machine code it
takes no longer than the function that says what there is to choose from.
"""

from __future__ import annotations

from taskspec.native.kernel import Vector, Words

#: More exchanges than this are rounding.
_EXCHANGES = 50
#: In the place of a pivot of 0, where the constraints depend on each other.
_ZERO_PIVOT = 1e-300


def select(
    gradient: Vector, selection: Vector, rows: Vector, chosen: Words, left: Words, m: int, c: int
) -> None:
    """Writes the selection (m, c), row by row, of the m columns of a matrix whose minor is large.

    Elimination with the largest pivots gives a first choice; then columns are exchanged as long as
    that makes the minor larger. The rows hold the matrix by its chosen columns, B^-1 A, whose
    elements are what an exchange makes of the minor.

    Args:
        gradient: the matrix (m, c), column by column.
        selection: gets a 1 in each row, in the column that is chosen there.
        rows: (m, c) to work in.
        chosen: gets each row's column.
        left: (m,) to work in.
        m, c: rows and columns.
    """
    for i in range(m):
        for j in range(c):
            rows[c * i + j] = gradient[m * j + i]
            selection[c * i + j] = 0.0
        chosen[i], left[i] = 0, 1
    for _ in range(m):
        at = _largest(rows, left, m, c)
        i = at // c
        left[i], chosen[i] = 0, at - c * i
        _eliminate(rows, i, chosen[i], m, c)
    for i in range(m):
        left[i] = 1
    for _ in range(_EXCHANGES):
        at = _largest(rows, left, m, c)
        if not abs(rows[at]) >= 1 + 1e-6:
            break
        i = at // c
        chosen[i] = at - c * i
        _eliminate(rows, i, chosen[i], m, c)
    for i in range(m):
        selection[c * i + chosen[i]] = 1.0


def _largest(rows: Vector, among: Words, m: int, c: int) -> int:
    """Where the largest element of some rows is; in the first of them where none is a number."""
    at, most = -1, -1.0
    for i in range(m):
        if among[i] != 0:
            if at < 0:
                at = c * i
            for j in range(c):
                if abs(rows[c * i + j]) > most:
                    at, most = c * i + j, abs(rows[c * i + j])
    return at


def _eliminate(rows: Vector, i: int, j: int, m: int, c: int) -> None:
    """Makes column j a unit vector whose 1 is in row i."""
    own, pivot = rows[c * i :], rows[c * i + j]
    if pivot == 0.0:
        pivot = _ZERO_PIVOT
    for k in range(c):
        own[k] = own[k] / pivot
    for r in range(m):
        row, share = rows[c * r :], rows[c * r + j]
        if r != i and share != 0.0:
            for k in range(c):
                row[k] -= share * own[k]
