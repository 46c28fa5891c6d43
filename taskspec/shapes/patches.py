"""Contact of a tool with a shape by its whole surface: one resultant contact for each patch.

A kernel (`taskspec.native.kernel`): compiled where there is llvmlite, else run by Python, with the
same bits. All lengths in metres.

A tool is convex. With its support function h(u) = max x.u its depth in a half-space is h(-n) + d,
and its depth in a convex body is the least of h(-n) + h_body(n) over the unit normals n. A contact
of the stiffness k at the support point has the energy k D^2/2, so that faces, edges and points
bear k alike. |x| in h is rounded to sqrt(x^2 + psi^2): flat faces bulge by a few micrometres, and
the centre of pressure moves without a jump.

A tool `t` is 17 numbers as a solid of `overlap` has them, in the axes of the shape. A patch is ten
numbers: point, outward normal, depth, share of the declared stiffness, lever of spinning friction,
and one spare.
"""

from __future__ import annotations

import math

from taskspec.native.kernel import Vector
from taskspec.shapes import overlap
from taskspec.shapes.overlap import BALL, BOX, CAP, CYLINDER, SEGMENT, SOLID, across, bulge, support

#: Kinds of shapes other than the solids of `overlap`.
PLATE, HOLE, SLOT, GROOVE, BOWL, TUBE = 10, 11, 12, 13, 14, 15
#: Numbers of a patch, and how many there are at most.
PATCH, MOST = 10, 8
#: Doubles that `find` works with: points on a tool, patches, another solid, `overlap`'s own; where
#: the patches begin among them.
POINTS = 24
WORK = POINTS + PATCH * MOST + SOLID + overlap.WORK
#: From this angle apart on, 1 - cos, what touches on two sides is two patches.
APART = 0.12


def find(t: Vector, shape: Vector, work: Vector) -> int:
    """Number of patches of a tool and a shape; they are in `work` from POINTS on.

    Args:
        t: the tool.
        shape: (7,) kind and sizes: half sizes and rounding of a solid; radius, depth, chamfer
            and block of a hole; width, depth, chamfer and length of a slot; angle, depth and length
            of a groove; radius, half angle, thickness and length of a bowl or tube.
        work: (WORK,) memory of this call.
    """
    at, patches = work, work[POINTS:]
    # What an earlier call has left there does not count.
    for i in range(POINTS):
        at[i] = 0.0
    kind = int(shape[0])
    s = shape[1:]
    if kind == HOLE:
        n = _outside(t, s[0] + s[2], s[3], s[4], s[5], at, patches) if s[3] > 0.0 else -1
        if n < 0:
            n = _hole(t, s[0], s[1], s[2], at, patches)
        return n
    if kind == SLOT:
        return _slot(t, s[0], s[1], s[2], s[3], at, patches)
    if kind == GROOVE:
        return _groove(t, s[0], s[1], s[2], at, patches)
    if kind == BOWL:
        return _shell(t, kind, s[0], s[1], s[2], 0.0, at, patches)
    if kind == TUBE:
        return _shell(t, kind, s[0], s[1], s[2], 0.5 * s[3], at, patches)
    if kind == PLATE:
        # Of a plane the face that lies flat is where it is drawn.
        return _floor(t, -bulge(t), at, patches, 0)
    return _solid(t, kind, s, at, patches)


def _put(
    patches: Vector, n: int, at: Vector, nx: float, ny: float, nz: float, depth: float, share: float
) -> int:
    """Adds a patch at a tool's support point, half its depth out of the shape."""
    p = patches[PATCH * n :]
    h = 0.5 * depth
    p[0], p[1], p[2] = at[0] + h * nx, at[1] + h * ny, at[2] + h * nz
    p[3], p[4], p[5] = nx, ny, nz
    p[6], p[7], p[8] = depth, share, at[3]
    return n + 1


def _floor(t: Vector, height: float, at: Vector, patches: Vector, n: int) -> int:
    """The half-space below z = height."""
    depth = support(t, 0.0, 0.0, -1.0, at) + height
    return _put(patches, n, at, 0.0, 0.0, 1.0, depth, 1.0) if depth > 0.0 else n


def _shell(
    t: Vector, kind: int, R: float, half: float, thick: float, length: float, at: Vector,
    patches: Vector,
) -> int:  # fmt: skip
    """A ball and the inside, outside or edge of a bowl about -z, or of a tube about z and -x.

    All is in the plane through the centre of the ball and the axis of the bowl, or across that of
    the tube, whose ends are `length` from the origin.
    """
    u, v, beyond = -t[2], math.sqrt(t[0] * t[0] + t[1] * t[1]), -1.0
    if kind == TUBE:
        u, v, beyond = -t[0], abs(t[1]), abs(t[2]) - length
    s = math.sqrt(u * u + v * v)
    if u >= s * math.cos(half):
        sign = -1.0 if s <= R + 0.5 * thick else 1.0
        gap = R - s if sign < 0.0 else s - R - thick
        nu, nv = sign * u / (s + 1e-30), sign * v / (s + 1e-30)
    else:
        c, q = math.cos(half), math.sin(half)
        along = min(max(u * c + v * q, R), R + thick)
        nu, nv = u - along * c, v - along * q
        gap = math.sqrt(nu * nu + nv * nv) + 1e-30
        nu, nv = nu / gap, nv / gap
    nx, ny, nz = 0.0, 0.0, -nu
    if kind == TUBE:
        nx, ny, nz = -nu, nv if t[1] >= 0.0 else -nv, 0.0
        end = 1.0 if t[2] >= 0.0 else -1.0
        if beyond > 0.0 and gap > 0.0:
            far = math.sqrt(gap * gap + beyond * beyond)
            nx, ny, nz, gap = nx * gap / far, ny * gap / far, end * beyond / far, far
        elif beyond > gap:
            nx, ny, nz, gap = 0.0, 0.0, end, beyond
    elif v > 1e-15:
        nx, ny = nv * t[0] / v, nv * t[1] / v
    r = t[13]
    at[0], at[1], at[2], at[3] = t[0] - r * nx, t[1] - r * ny, t[2] - r * nz, 0.0
    return _put(patches, 0, at, nx, ny, nz, r - gap, 1.0) if r > gap else 0


def _solid(t: Vector, kind: int, s: Vector, at: Vector, patches: Vector) -> int:
    """A ball, a cylinder or a box about the origin: both are convex, and touch in one patch.

    Where both are flat they bear a moment about the normal with the lever of what they share.
    """
    b = patches[PATCH * MOST :]
    for i in range(12):
        b[i] = 0.0
    b[3], b[7], b[11] = 1.0, 1.0, 1.0
    b[12] = float(kind)
    for i in range(3):
        b[13 + i] = s[i]
    b[16] = s[3]
    found = b[SOLID:]
    depth = overlap.overlap(t, b, 0.0, found)
    if depth <= 0.0:
        return 0
    nx, ny, nz = found[0], found[1], found[2]
    # The point is between both surfaces, which bulge.
    support(b, nx, ny, nz, at)
    across(found, found[3:])
    _flatness(t, -nx, -ny, -nz, found[3:], found[12:])
    _flatness(b, nx, ny, nz, found[3:], found[15:])
    n = _put(patches, 0, at, nx, ny, nz, -depth, 1.0)
    patches[6], patches[8] = depth, _shared(found[12:], found[15:])
    return n


def _flatness(t: Vector, x: float, y: float, z: float, tangents: Vector, q: Vector) -> None:
    """Squares of levers of a solid's flat part across u: aa, ab, bb along two tangents (6,)."""
    q[0], q[1], q[2] = 0.0, 0.0, 0.0
    if t[12] == BALL or t[12] == CAP:
        return
    eps = t[16]
    for k in range(2 if t[12] == SEGMENT else 0, 3):
        ax, ay, az, half = t[3 + 3 * k], t[4 + 3 * k], t[5 + 3 * k], t[13 + k]
        along = x * ax + y * ay + z * az
        square = 0.25 * half * half
        if t[12] == CYLINDER and k < 2:
            # The disc: 2/3 of its radius in all, where its axis is along u.
            along = x * t[9] + y * t[10] + z * t[11]
            along = math.sqrt(max(1.0 - along * along, 0.0))
            square = half * half * 2.0 / 9.0
        w = eps * eps / (half * half)
        square *= w / (along * along + w)
        a = tangents[0] * ax + tangents[1] * ay + tangents[2] * az
        b = tangents[3] * ax + tangents[4] * ay + tangents[5] * az
        q[0] += square * a * a
        q[1] += square * a * b
        q[2] += square * b * b


def _shared(p: Vector, q: Vector) -> float:
    """The lever that two flat parts share, P (P + Q)^-1 Q: lines that cross share none."""
    a, b, c = p[0] + q[0], p[1] + q[1], p[2] + q[2]
    det = a * c - b * b
    if det <= 1e-30:
        return 0.0
    # trace(P (P + Q)^-1 Q)
    x = c * q[0] - b * q[1]
    y = c * q[1] - b * q[2]
    z = a * q[1] - b * q[0]
    u = a * q[2] - b * q[1]
    return math.sqrt(max((p[0] * x + p[1] * y + p[1] * z + p[2] * u) / det, 0.0))


# --- the round hole ---------------------------------------------------------------------------


def _hole(t: Vector, R: float, depth: float, chamfer: float, at: Vector, patches: Vector) -> int:
    """A plate below z = 0 with a bore of radius R along z, its edge cut at 45 degrees."""
    if support(t, 0.0, 0.0, -1.0, at) <= 0.0:
        return 0
    inside = t[0] * t[0] + t[1] * t[1] < R * R
    if t[12] == BALL:
        n = _ball_in_hole(t, R, chamfer, at, patches)
    elif abs(t[11]) < 0.5:
        # A tool that lies on its side does not touch the bore.
        return _floor(t, 0.0, at, patches, 0)
    else:
        if t[12] == BOX:
            n = _box_in_hole(t, R, chamfer, at, patches)
        else:
            n = _peg_in_hole(t, R, chamfer, at, patches)
        s = t[15] if t[11] < 0.0 else -t[15]
        x, y = t[0] + s * t[9], t[1] + s * t[10]
        inside = x * x + y * y < R * R
    return _floor(t, -depth, at, patches, n) if inside else n


def _box_in_hole(t: Vector, R: float, chamfer: float, at: Vector, patches: Vector) -> int:
    """A box against wall, chamfer and plate: each of the edges along its axis is a patch.

    It meets the wall where it is farthest from the bore's axis, at its lower end or at the bore's
    edge. All that is beyond the wall's tangent there, with the plate above, is a convex body.
    """
    s = -t[15] if t[11] > 0.0 else t[15]
    n = 0
    for edge in range(4):
        one = t[13] if edge < 2 else -t[13]
        two = t[14] if edge % 2 == 0 else -t[14]
        x = t[0] + one * t[3] + two * t[6] + s * t[9]
        y = t[1] + one * t[4] + two * t[7] + s * t[10]
        z = t[2] + one * t[5] + two * t[8] + s * t[11]
        far = math.sqrt(x * x + y * y)
        if z < -chamfer:
            # Where the edge passes the bore's own, if it is that long.
            up = min((-chamfer - z) / abs(t[11]), 2.0 * t[15])
            turn = 1.0 if t[11] > 0.0 else -1.0
            px, py = x + up * turn * t[9], y + up * turn * t[10]
            over = math.sqrt(px * px + py * py)
            if over > far:
                x, y, far = px, py, over
        if far > 1e-9:
            n = _bank(t, x / far, y / far, R, chamfer, 0.0, at, patches, n)
    _share_the_top(patches, n)
    return n


def _ball_in_hole(t: Vector, R: float, chamfer: float, at: Vector, patches: Vector) -> int:
    """A ball against the wall, the chamfer, the plate, and the edges between them."""
    rho = math.sqrt(t[0] * t[0] + t[1] * t[1])
    x, z, r = rho - R, t[2], t[13]
    cut = math.sqrt(0.5)
    # Distances from the faces, and where along the chamfer the centre is above.
    wall, cone = -x, (z + chamfer - x) * cut
    along = (x + z + chamfer) * cut
    if x <= 0.0 and z < -chamfer:
        gap, nr, nz = wall, -1.0, 0.0
    elif chamfer > 0.0 and cone >= 0.0 and along > 0.0 and along < chamfer / cut:
        gap, nr, nz = cone, -cut, cut
    elif x >= chamfer and z >= 0.0:
        gap, nr, nz = z, 0.0, 1.0
    elif cone >= 0.0 or (chamfer == 0.0 and (x <= 0.0 or z >= 0.0)):
        # An edge of the chamfer, the nearer one.
        ex, ez = 0.0, -chamfer
        if along >= 0.5 * chamfer / cut:
            ex, ez = chamfer, 0.0
        gap = math.sqrt((x - ex) * (x - ex) + (z - ez) * (z - ez)) + 1e-15
        nr, nz = (x - ex) / gap, (z - ez) / gap
    else:
        gap, nr, nz = wall, -1.0, 0.0
        if cone > gap and chamfer > 0.0:
            gap, nr, nz = cone, -cut, cut
        if z > gap:
            gap, nr, nz = z, 0.0, 1.0
    if r - gap <= 0.0:
        return 0
    nx, ny = nr, 0.0
    if rho > 1e-15:
        nx, ny = nr * t[0] / rho, nr * t[1] / rho
    at[0], at[1], at[2], at[3] = t[0] - r * nx, t[1] - r * ny, t[2] - r * nz, 0.0
    return _put(patches, 0, at, nx, ny, nz, r - gap, 1.0)


def _peg_in_hole(t: Vector, R: float, chamfer: float, at: Vector, patches: Vector) -> int:
    """A cylinder against wall, chamfer and plate.

    Its rim meets them at the point B that is farthest from the bore's axis, and the bore's edge
    meets its side at the point A that is nearest to the cylinder's axis. On one side of the bore
    both are ends of one patch, on opposite sides they are two.
    """
    eps, r = t[16], t[13]
    s = t[15] if t[11] < 0.0 else -t[15]
    # The end that is below, and the unit vector from there into the tool.
    px, py, pz = t[0] + s * t[9], t[1] + s * t[10], t[2] + s * t[11]
    turn = -1.0 if s > 0.0 else 1.0
    ax, ay, az = turn * t[9], turn * t[10], turn * t[11]
    off = math.sqrt(px * px + py * py)
    fx, fy = 1.0, 0.0
    if off > 1e-12:
        fx, fy = px / off, py / off
    cx, cy = fx, fy
    bx, by, bz, far = px, py, pz, 0.0
    for _ in range(4):
        along = fx * ax + fy * ay
        gx, gy, gz = fx - along * ax, fy - along * ay, -along * az
        size = r / math.sqrt(gx * gx + gy * gy + gz * gz)
        bx, by, bz = px + size * gx, py + size * gy, pz + size * gz
        far = math.sqrt(bx * bx + by * by)
        fx, fy = bx / far, by / far
    # What the rim is in: the least of wall, chamfer and plate, and the share of each.
    cut = math.sqrt(0.5)
    deep = far - R
    wall, cone, top = 1.0, 0.0, 0.0
    if chamfer > 0.0:
        other = (far - R - bz - chamfer) * cut
        wall = _lesser(deep, other, eps)
        cone = 1.0 - wall
        deep = _least(deep, other, eps)
    if far > R + chamfer:
        _plate(t, R + chamfer, max(off, 1e-9), cx, cy, at)
        top = 1.0 - _lesser(deep, at[4], eps)
        deep = _least(deep, at[4], eps)
    wall, cone = (1.0 - top) * wall, (1.0 - top) * cone
    # Its direction, and where it acts.
    outward = wall + cone * cut
    bnx, bny = -outward * fx + top * at[5], -outward * fy + top * at[6]
    bnz = cone * cut + top * at[7]
    bsize = math.sqrt(bnx * bnx + bny * bny + bnz * bnz)
    for i in range(4):
        at[i] = top * at[i]
    at[0] += (1.0 - top) * bx
    at[1] += (1.0 - top) * by
    at[2] += (1.0 - top) * bz
    edge_at = at[12:]
    edge = _edge_in_side(t, R, chamfer, px, py, pz, ax, ay, az, edge_at)
    # One patch of both where they are on one side.
    two, one, first = 0.0, deep, 0.0
    if edge > -1.0:
        y = min(max((1.0 - (edge_at[0] * fx + edge_at[1] * fy) / R) / APART, 0.0), 1.0)
        two = y * y * (3.0 - 2.0 * y)
        one, first = -_least(-edge, -deep, eps), _lesser(-edge, -deep, eps)
    # On the plate the bore's edge is under the end's face, which B stands for on its side.
    first = (1.0 - top) * first
    one = max(one, 0.0)
    n = 0
    share = (two if deep > 0.0 else 0.0) + (1.0 - two) * (1.0 - first)
    force = two * max(deep, 0.0) + (1.0 - two) * (1.0 - first) * one
    if force > 0.0 and share > 1e-6 and bsize > 1e-9:
        n = _put(
            patches, n, at, bnx / bsize, bny / bsize, bnz / bsize, force / share, share * bsize
        )
    share = (two if edge > 0.0 else 0.0) + (1.0 - two) * first
    force = two * max(edge, 0.0) + (1.0 - two) * first * one
    x, y, z = edge_at[2], edge_at[3], edge_at[4]
    size = math.sqrt(x * x + y * y + z * z)
    if force > 0.0 and share > 1e-6 and size > 1e-9:
        # The point is the shape's: `_put` takes the tool's, a depth below it.
        depth = force / share
        x, y, z = x / size, y / size, z / size
        at[0], at[1] = edge_at[0] - depth * x, edge_at[1] - depth * y
        at[2], at[3] = -chamfer - depth * z, 0.0
        n = _put(patches, n, at, x, y, z, depth, share * size)
    return n


def _edge_in_side(
    t: Vector, R: float, chamfer: float, px: float, py: float, pz: float,
    ax: float, ay: float, az: float, out: Vector,
) -> float:  # fmt: skip
    """Depth of the bore's edge in the side of a cylinder; -1 where it is beside its length.

    Args:
        t: the tool.
        R: radius of the bore.
        chamfer: above the edge.
        px, py, pz: the end of the cylinder that is below.
        ax, ay, az: unit vector from there into it.
        out: (5,) x and y of the point of the edge, and the direction of the force; then memory.
    """
    for i in range(5):
        out[i] = 0.0
    lean = math.sqrt(ax * ax + ay * ay)
    up = (-chamfer - pz) / az
    lowest, highest = pz - t[13] * lean, pz + t[13] * lean
    if not (lowest < -chamfer and up < 2.0 * t[15]):
        return -1.0
    # From where the cylinder's axis goes through the edge's plane.
    gx, gy = px + up * ax, py + up * ay
    size = math.sqrt(gx * gx + gy * gy)
    if size > 1e-12:
        gx, gy = gx / size, gy / size
    else:
        gx, gy = 1.0, 0.0
    depth = _edge_near(t, R, -chamfer, px, py, pz, ax, ay, az, gx, gy, out)
    if highest > -chamfer and lean > 1e-12:
        # A part of the end is above the edge: the side that leans over it may be deeper in.
        other = out[5:]
        over = _edge_near(t, R, -chamfer, px, py, pz, ax, ay, az, ax / lean, ay / lean, other)
        if over > depth:
            depth = over
            for i in range(5):
                out[i] = other[i]
    return depth


def _edge_near(
    t: Vector, R: float, height: float, px: float, py: float, pz: float,
    ax: float, ay: float, az: float, gx: float, gy: float, out: Vector,
) -> float:  # fmt: skip
    """Depth of that point of an edge at `height` which is nearest to a cylinder's axis.

    By Newton's method in the angle, from the direction (gx, gy) on; the other arguments are those
    of `_edge_in_side`.
    """
    eps, r = t[16], t[13]
    wx, wy, wz, along = 0.0, 0.0, 0.0, 0.0
    for i in range(5):
        dx, dy, dz = R * gx - px, R * gy - py, height - pz
        along = dx * ax + dy * ay + dz * az
        wx, wy, wz = dx - along * ax, dy - along * ay, dz - along * az
        if i < 4:
            slope = R * (wy * gx - wx * gy)
            lean = ay * gx - ax * gy
            bend = R * R * (1.0 - lean * lean) - R * (wx * gx + wy * gy)
            step = -slope / bend if bend > 1e-12 else 0.0
            step = min(max(step, -0.3), 0.3)
            c, s = math.cos(step), math.sin(step)
            gx, gy = c * gx - s * gy, s * gx + c * gy
    size = math.sqrt(wx * wx + wy * wy + wz * wz)
    side = _lesser(r - size, along, eps)
    out[0], out[1] = R * gx, R * gy
    out[2], out[3], out[4] = (1.0 - side) * ax, (1.0 - side) * ay, (1.0 - side) * az
    if size > 1e-12:
        out[2] -= side * wx / size
        out[3] -= side * wy / size
        out[4] -= side * wz / size
    return _least(r - size, along, eps)


def _plate(t: Vector, R: float, off: float, cx: float, cy: float, at: Vector) -> None:
    """The tool on the plate around a bore of radius R, its end `off` from the axis along (cx, cy).

    The end's disc less the bore is a lune. A plane lies on its convex hull, which is the disc
    beyond the chord through the lune's tips: h of that is the least of h(u + s c) - s x, s >= 0,
    x how far the chord is from the axis. Writes support point, lever, depth (4), and the direction
    of its force (5..7).
    """
    r, eps = t[13], t[16]
    chord = 0.5 * (off * off + R * R - r * r) / off
    along = t[9] * cx + t[10] * cy
    alpha = 1.0 - along * along
    middle = along * t[11] / alpha
    # |u - (u.a) a|^2 = alpha (s - s0)^2 + beta of u = -z + s c, a the tool's axis.
    middle = -middle
    beta = max(1.0 - t[11] * t[11] - alpha * middle * middle, 0.0) + eps * eps / (r * r)
    m = (off - chord) / (r * math.sqrt(alpha))
    s = 0.0
    if m < 1.0:
        m = max(m, -0.9999)
        s = max(middle - m * math.sqrt(beta / (alpha * (1.0 - m * m))), 0.0)
    depth = support(t, s * cx, s * cy, -1.0, at) - s * chord
    aside = at[1] * cx - at[0] * cy
    at[4] = depth
    x, y = -s * chord / off, -s * aside / off
    # Where the lune has hardly begun its tips run away: a tip is no steeper than 45 degrees.
    size = math.sqrt(x * x + y * y)
    if size > 1.0:
        x, y = x / size, y / size
    at[5], at[6], at[7] = x * cx - y * cy, x * cy + y * cx, 1.0


def _least(x: float, y: float, eps: float) -> float:
    """The lesser of two, rounded where they differ by less than 4 eps."""
    w = 4.0 * eps
    h = abs(x - y)
    least = min(x, y)
    return least - 0.25 * (w - h) * (w - h) / w if h < w else least


def _lesser(x: float, y: float, eps: float) -> float:
    """Its slope against x: how far x is the lesser one."""
    w = 4.0 * eps
    return min(max(0.5 * (1.0 - (x - y) / w), 0.0), 1.0)


# --- what is straight -------------------------------------------------------------------------


def _slot(
    t: Vector, width: float, depth: float, chamfer: float, length: float, at: Vector,
    patches: Vector,
) -> int:  # fmt: skip
    """A plate below z = 0 with a slot along x, endless where its length is 0."""
    if support(t, 0.0, 0.0, -1.0, at) <= 0.0:
        return 0
    n = 0
    for side in range(2):
        sign = 1.0 if side == 0 else -1.0
        n = _bank(t, 0.0, sign, 0.5 * width, chamfer, 0.0, at, patches, n)
    n = _ends(t, length, chamfer, at, patches, n)
    _share_the_top(patches, n)
    if abs(t[1]) < 0.5 * width and (length == 0.0 or abs(t[0]) < 0.5 * length):
        n = _floor(t, -depth, at, patches, n)
    return n


def _groove(
    t: Vector, angle: float, depth: float, length: float, at: Vector, patches: Vector
) -> int:
    """A plate below z = 0 with a groove of two flanks along x, endless where its length is 0."""
    if support(t, 0.0, 0.0, -1.0, at) <= 0.0:
        return 0
    half = 0.5 * angle
    edge = depth * math.tan(half)
    n = 0
    for side in range(2):
        sign = 1.0 if side == 0 else -1.0
        n = _bank(t, 0.0, sign, edge, 0.0, half, at, patches, n)
    n = _ends(t, length, 0.0, at, patches, n)
    _share_the_top(patches, n)
    return n


def _ends(t: Vector, length: float, chamfer: float, at: Vector, patches: Vector, n: int) -> int:
    """Upright walls across x at both ends of a cut, with the plate beyond; none of length 0."""
    if length == 0.0:
        return n
    for side in range(2):
        sign = 1.0 if side == 0 else -1.0
        n = _bank(t, sign, 0.0, 0.5 * length, chamfer, 0.0, at, patches, n)
    return n


def _outside(
    t: Vector, bore: float, a: float, b: float, c: float, at: Vector, patches: Vector
) -> int:
    """A block a by b by c below z = 0 from outside; -1 where its top or its bore is touched.

    Of its upper and upright edges, each with both faces as a convex body, that counts in which the
    tool is least deep: a displacement out of one leads out of the block. A tool whose end is over
    the bore is in there.
    """
    depth = support(t, 0.0, 0.0, -1.0, at)
    if depth <= 0.0:
        return 0
    # What is farther from each side than it is deep is on the top: n (corner - p) is at least the
    # depth then, for all normals n of an edge and the deepest point p.
    if 0.5 * a - abs(at[0]) >= depth and 0.5 * b - abs(at[1]) >= depth:
        return -1
    under = support(t, 0.0, 0.0, 1.0, at) + c
    if under <= 0.0:
        return 0
    low = t[15] if t[11] < 0.0 else -t[15]
    if t[12] == BALL:
        low = 0.0
    x, y = t[0] + low * t[9], t[1] + low * t[10]
    if x * x + y * y < bore * bore:
        return -1
    n = _least_edge(t, a, b, at, patches)
    if n > 0 and under < patches[6]:
        under = support(t, 0.0, 0.0, 1.0, at) + c
        return _put(patches, 0, at, 0.0, 0.0, -1.0, under, 1.0)
    return -1 if n > 0 and patches[9] == 1.0 else n


def _least_edge(t: Vector, a: float, b: float, at: Vector, patches: Vector) -> int:
    """The edge of a block in which a tool is least deep, as the first patch; 0 for none."""
    best = 1e300
    for edge in range(8):
        sign = 1.0 if edge % 2 == 0 else -1.0
        dx, dy, half = sign, 0.0, 0.5 * a
        vx, vy, vz, top = 0.0, 0.0, 1.0, 0.0
        if edge == 2 or edge == 3:
            dx, dy, half = 0.0, sign, 0.5 * b
        if edge > 3:
            vx, vy, vz, top = 0.0, 1.0 if edge > 5 else -1.0, 0.0, 0.5 * b
        found = _edge(t, dx, dy, vx, vy, vz, top, -half, 0.0, 0.0, at, patches[PATCH:], 0)
        if found == 0:
            return 0
        if patches[PATCH + 6] < best:
            best = patches[PATCH + 6]
            for i in range(PATCH):
                patches[i] = patches[PATCH + i]
    return 1


def _bank(
    t: Vector, dx: float, dy: float, edge: float, chamfer: float, lean: float, at: Vector,
    patches: Vector, n: int,
) -> int:  # fmt: skip
    """A wall that stands away from z by `lean`, with the plate above: a convex body.

    It is beyond `edge` along the unit vector (dx, dy).
    """
    return _edge(t, dx, dy, 0.0, 0.0, 1.0, 0.0, edge, chamfer, lean, at, patches, n)


def _edge(
    t: Vector, dx: float, dy: float, vx: float, vy: float, vz: float, top: float, edge: float,
    chamfer: float, lean: float, at: Vector, patches: Vector, n: int,
) -> int:  # fmt: skip
    """The edge of two faces, all that is behind both: a convex body.

    One is beyond `edge` along the unit vector (dx, dy, 0), the other up to `top` along v, which is
    across it. Its normals are -cos(a) d + sin(a) v from a = lean to 90 degrees.
    """
    quarter = 0.5 * math.pi
    low, high, best = lean, quarter, 1e300
    count = 12
    for i in range(count + 1):
        a = lean + (quarter - lean) * float(i) / float(count)
        depth = _over(t, dx, dy, vx, vy, vz, top, edge, chamfer, a, at)
        if depth < best:
            best = depth
            low = lean + (quarter - lean) * float(max(i - 1, 0)) / float(count)
            high = lean + (quarter - lean) * float(min(i + 1, count)) / float(count)
        if depth <= 0.0:
            return n
    ratio = 0.5 * (math.sqrt(5.0) - 1.0)
    b, c = high - ratio * (high - low), low + ratio * (high - low)
    fb, fc = (
        _over(t, dx, dy, vx, vy, vz, top, edge, chamfer, b, at),
        _over(t, dx, dy, vx, vy, vz, top, edge, chamfer, c, at),
    )
    for _ in range(44):
        if fb < fc:
            high, c, fc = c, b, fb
            b = high - ratio * (high - low)
            fb = _over(t, dx, dy, vx, vy, vz, top, edge, chamfer, b, at)
        else:
            low, b, fb = b, c, fc
            c = low + ratio * (high - low)
            fc = _over(t, dx, dy, vx, vy, vz, top, edge, chamfer, c, at)
    a = 0.5 * (low + high)
    # The ends of the range are faces: exactly them where they are the least.
    for i in range(2):
        end = lean if i == 0 else quarter
        if _over(t, dx, dy, vx, vy, vz, top, edge, chamfer, end, at) <= _over(
            t, dx, dy, vx, vy, vz, top, edge, chamfer, a, at
        ):
            a = end
    depth = _over(t, dx, dy, vx, vy, vz, top, edge, chamfer, a, at)
    if depth <= 0.0:
        return n
    c, s = math.cos(a), math.sin(a)
    n = _put(patches, n, at, s * vx - c * dx, s * vy - c * dy, s * vz, depth, 1.0)
    p = patches[PATCH * (n - 1) :]
    p[9] = s * vz
    return n


def _over(
    t: Vector, dx: float, dy: float, vx: float, vy: float, vz: float, top: float, edge: float,
    chamfer: float, a: float, at: Vector,
) -> float:  # fmt: skip
    """Overlap of a tool and an edge along the normal of an angle a; the tool's point."""
    c, s = math.cos(a), math.sin(a)
    lower, upper = -c * edge - s * chamfer, -c * (edge + chamfer)
    reach = support(t, c * dx - s * vx, c * dy - s * vy, -s * vz, at)
    return reach + max(lower, upper) + s * top


def _share_the_top(patches: Vector, n: int) -> None:
    """The plate is one patch, whatever is cut into it: what stands on it shares the stiffness."""
    total = 0.0
    for i in range(n):
        total += _stands(patches[PATCH * i + 9]) * patches[PATCH * i + 6]
    if total <= 0.0:
        return
    for i in range(n):
        p = patches[PATCH * i :]
        up = _stands(p[9])
        p[7] = 1.0 - up * (1.0 - up * p[6] / total)


def _stands(sine: float) -> float:
    """How far a normal of this slope is the plate's: from 60 degrees on, all at 85."""
    y = min(max((sine - 0.866) / 0.13, 0.0), 1.0)
    return y * y * (3.0 - 2.0 * y)
