"""The patches of a tool and a shape as MuJoCo's contacts.

A kernel (`taskspec.native.kernel`), as `taskspec.shapes.patches` is, which says where they touch.
"""

from __future__ import annotations

from taskspec.native.kernel import Counts, Vector
from taskspec.shapes import patches
from taskspec.shapes.overlap import LEAST_FRICTION, LEAST_ROLLING, ROLLING, SOLID, across
from taskspec.shapes.patches import PATCH

#: Marks of the geoms that carry data, as MuJoCo's user data has them.
TOOL, SHAPE = 271828182.0, 314159265.0
#: Doubles of a contact of MuJoCo, and 32 bit words.
CONTACT, CONTACT_WORDS = 76, 152
#: Doubles that a call works with: a tool, and what is found.
WORK = SOLID + patches.WORK
#: Numbers of a marker's data.
DATA = 24


def touch(
    place: Vector, axes: Vector, data: Vector, width: int, first: int, second: int,
    contacts: Vector, words: Counts, work: Vector,
) -> int:  # fmt: skip
    """Writes the contacts of two geoms, and returns their number; -1 if they are not marked.

    Args:
        place: (3 geoms,) positions of geoms, world.
        axes: (9 geoms,) their rotations, row by row.
        data: (width geoms,) their user data.
        width: numbers of user data of a geom.
        first: a geom.
        second: the other one.
        contacts: where contacts of MuJoCo are written.
        words: the same memory.
        work: (WORK,) memory of this call.
    """
    if width < DATA:
        return -1
    tool, shape = first, second
    if data[width * tool] != TOOL:
        tool, shape = second, first
    if data[width * tool] != TOOL or data[width * shape] != SHAPE:
        return -1
    d, w = data[width * tool :], data[width * shape :]
    o, R = place[3 * shape :], axes[9 * shape :]
    _place(o, R, place[3 * tool :], axes[9 * tool :], d, work)
    n = patches.find(work, w[1:], work[SOLID:])
    found = work[SOLID + patches.POINTS :]
    for i in range(n):
        _contact(
            found[PATCH * i :], w, o, R, int(d[6]), contacts[CONTACT * i :],
            words[CONTACT_WORDS * i :],
        )  # fmt: skip
    return n


def _place(o: Vector, R: Vector, c: Vector, T: Vector, d: Vector, t: Vector) -> None:
    """A tool, of a marker's place, axes and data, in the axes R of a shape at o."""
    for i in range(3):
        t[i] = R[i] * (c[0] - o[0]) + R[3 + i] * (c[1] - o[1]) + R[6 + i] * (c[2] - o[2])
        for j in range(3):
            t[3 + 3 * j + i] = R[i] * T[j] + R[3 + i] * T[3 + j] + R[6 + i] * T[6 + j]
    t[12] = d[1]
    for i in range(3):
        t[13 + i] = d[2 + i]
    t[16] = d[5]


def _contact(
    p: Vector, w: Vector, o: Vector, R: Vector, tool: int, contact: Vector, words: Counts
) -> None:
    """A patch as MuJoCo's contact.

    Its share of the stiffness has as much of damping and of the virtual mass d/((1 - d) A).
    """
    k, b, mu, A, settling, impedance = w[8], w[9], w[10], w[11], w[12], w[13]
    share = p[7]
    g = share * impedance / (1.0 - impedance)
    d = g / (1.0 + g)
    scale = (1.0 - d) * A
    for i in range(CONTACT):
        contact[i] = 0.0
    contact[0] = -p[6]
    for i in range(3):
        contact[1 + i] = o[i] + R[3 * i] * p[0] + R[3 * i + 1] * p[1] + R[3 * i + 2] * p[2]
        contact[4 + i] = R[3 * i] * p[3] + R[3 * i + 1] * p[4] + R[3 * i + 2] * p[5]
    across(contact[4:], contact[7:])
    rubs = max(mu, LEAST_FRICTION)
    lever = p[8]
    contact[14] = rubs
    contact[15] = rubs
    contact[16] = max(mu * lever, 1e-6)
    contact[17] = max(ROLLING * max(mu, LEAST_ROLLING) * lever, 1e-6)
    contact[18] = contact[17]
    contact[19] = -k * share * scale
    contact[20] = -b * share * scale
    contact[21] = -1e-9
    contact[22] = -d * settling
    contact[23] = d
    contact[24] = d
    contact[25] = 0.001
    contact[26] = 0.5
    contact[27] = 2.0
    words[138] = 6 if lever > 1e-5 else (1 if mu == 0.0 else 3)
    words[139] = int(w[14])
    words[140] = tool
    words[141] = words[139]
    words[142] = tool
    for i in range(143, 149):
        words[i] = -1
    words[149] = 0
    words[150] = -1
