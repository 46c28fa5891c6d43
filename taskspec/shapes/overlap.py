"""Depth or distance of two convex solids, by support functions.

A kernel (`taskspec.native.kernel`): compiled where there is llvmlite, else run by Python, with the
same bits. All lengths in metres.

With the support functions h(u) = max x.u of a tool and of a body, the depth of one in the other
along a unit normal n out of the body is h_tool(-n) + h_body(n). The depth is the least of that,
    D = min h_tool(-n) + h_body(n),    dD = n.(dx_body - dx_tool),
x the support points. D is a distance, negative, where they are apart. |x| in h is rounded to
sqrt(x^2 + psi^2), so that h has curvatures, and the support point on a flat face moves without a
jump: flat faces bulge by `rounding`.

In memory a solid has its centre (0..2), its axes x, y, z (3..5, 6..8, 9..11), its kind (12), half
sizes (13..15) and rounding (16).
"""

from __future__ import annotations

import math

from taskspec.native.kernel import Vector

#: Kinds of solids.
BALL, CYLINDER, BOX = 1, 2, 3
#: What a plane cuts off a ball, towards its z, or off a cylinder, towards its x: sizes (13..15)
#: are the radius, the angle from the middle of its round side to an edge, and half its length.
CAP, SEGMENT = 4, 5
#: How many numbers are set aside for a solid.
SOLID = 24
#: How many numbers `overlap` works with.
WORK = 44
#: The face of a tool is rounded by this share of its half width, but by no less than so much [m],
#: as that of a shape is: with the force F it resists being tilted by F r^2 / rounding, which one
#: step of the plant has to resolve.
ROUNDED, LEAST_ROUNDING = 1.0 / 4000.0, 5e-6
#: Rolling friction, which lets a rocking face settle, as a share of the spinning one; a face
#: without friction settles as one of the second coefficient.
ROLLING, LEAST_ROLLING = 0.05, 0.2
#: A friction of exactly zero would leave the simulator's elliptic cone without a size.
LEAST_FRICTION = 1e-5
_MOST_STEPS, _MOST_TRIES = 60, 25
#: Support points that are apart by less, across the normal, are above each other [m].
_ABOVE = 1e-10
#: A step that changes the depth by less is of its last digits [m].
_NOISE = 1e-17


def across(n: Vector, t: Vector) -> None:
    """Two unit vectors (6,) across a unit vector (3,)."""
    x, y, z = n[0], n[1], n[2]
    if abs(x) < 0.6:
        t[0], t[1], t[2] = 1.0 - x * x, -x * y, -x * z
    else:
        t[0], t[1], t[2] = -y * x, 1.0 - y * y, -y * z
    size = math.sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2])
    for i in range(3):
        t[i] /= size
    t[3] = y * t[2] - z * t[1]
    t[4] = z * t[0] - x * t[2]
    t[5] = x * t[1] - y * t[0]


def support(t: Vector, x: float, y: float, z: float, at: Vector) -> float:
    """h(u) of a solid; its support point, and the lever of spinning friction there, into `at`."""
    u = x * t[0] + y * t[1] + z * t[2]
    eps = t[16]
    along = x * t[9] + y * t[10] + z * t[11]
    if t[12] == BALL:
        size = math.sqrt(x * x + y * y + z * z)
        r = t[13] / size
        at[0], at[1], at[2] = t[0] + r * x, t[1] + r * y, t[2] + r * z
        at[3] = 0.0
        return u + t[13] * size
    if t[12] == CAP:
        return u + _cap(t, x, y, z, at)
    if t[12] == SEGMENT:
        return u + _segment(t, x, y, z, at)
    half = t[15]
    end = eps / half
    ends = math.sqrt(along * along + end * end)
    f = half * along / ends
    if t[12] == CYLINDER:
        r = t[13]
        round_ = eps / r
        ox, oy, oz = x - along * t[9], y - along * t[10], z - along * t[11]
        off = math.sqrt(ox * ox + oy * oy + oz * oz + round_ * round_)
        s = r / off
        at[0] = t[0] + s * ox + f * t[9]
        at[1] = t[1] + s * oy + f * t[10]
        at[2] = t[2] + s * oz + f * t[11]
        at[3] = 2.0 / 3.0 * r * round_ / off + 0.5 * half * end / ends
        return u + r * off + half * ends
    one = x * t[3] + y * t[4] + z * t[5]
    two = x * t[6] + y * t[7] + z * t[8]
    e1, e2 = eps / t[13], eps / t[14]
    w1, w2 = math.sqrt(one * one + e1 * e1), math.sqrt(two * two + e2 * e2)
    f1, f2 = t[13] * one / w1, t[14] * two / w2
    for i in range(3):
        at[i] = t[i] + f1 * t[3 + i] + f2 * t[6 + i] + f * t[9 + i]
    l1, l2, l3 = t[13] * e1 / w1, t[14] * e2 / w2, half * end / ends
    at[3] = 0.5 * math.sqrt(l1 * l1 + l2 * l2 + l3 * l3)
    return u + t[13] * w1 + t[14] * w2 + half * ends


def _cap(t: Vector, x: float, y: float, z: float, at: Vector) -> float:
    """h(u) of a cap about its centre; its support point and no lever into `at`.

    It is on the round side where u is nearer to its z than the rim is, else on the rim; the flat
    side bulges as that of a cylinder does.
    """
    along = x * t[9] + y * t[10] + z * t[11]
    size = math.sqrt(x * x + y * y + z * z)
    at[3] = 0.0
    if along >= size * math.cos(t[14]):
        r = t[13] / size
        at[0], at[1], at[2] = t[0] + r * x, t[1] + r * y, t[2] + r * z
        return t[13] * size
    low, wide = t[13] * math.cos(t[14]), t[13] * math.sin(t[14])
    ox, oy, oz = x - along * t[9], y - along * t[10], z - along * t[11]
    back = size * t[16] / wide
    off = math.sqrt(ox * ox + oy * oy + oz * oz + back * back)
    s = wide / off
    at[0] = t[0] + s * ox + low * t[9]
    at[1] = t[1] + s * oy + low * t[10]
    at[2] = t[2] + s * oz + low * t[11]
    return s * off * off + low * along


def _segment(t: Vector, x: float, y: float, z: float, at: Vector) -> float:
    """The same of a segment, whose ends are rounded as those of a cylinder."""
    one = x * t[3] + y * t[4] + z * t[5]
    two = x * t[6] + y * t[7] + z * t[8]
    along = x * t[9] + y * t[10] + z * t[11]
    half, end = t[15], t[16] / t[15]
    ends = math.sqrt(along * along + end * end)
    f = half * along / ends
    off = math.sqrt(one * one + two * two)
    p, wide = t[13] * math.cos(t[14]), t[13] * math.sin(t[14])
    back = t[16] / wide
    q = wide * two / math.sqrt(two * two + back * back)
    flat = wide * back * back / math.sqrt(two * two + back * back)
    if off > 0.0 and one >= off * math.cos(t[14]):
        p, q, flat = t[13] * one / off, t[13] * two / off, 0.0
    for i in range(3):
        at[i] = t[i] + p * t[3 + i] + q * t[6 + i] + f * t[9 + i]
    at[3] = 0.5 * half * end / ends
    return p * one + q * two + flat + half * ends


def _curved_cap(t: Vector, sign: float, x: float, y: float, z: float, g: Vector) -> float:
    """h(u) of a cap about its centre, and what `curved` adds to `g`."""
    along = x * t[9] + y * t[10] + z * t[11]
    if along >= math.cos(t[14]):
        r = t[13]
        g[0] += sign * r * x
        g[1] += sign * r * y
        g[2] += sign * r * z
        _add(g, r, 1.0, 0.0, 0.0)
        _add(g, r, 0.0, 1.0, 0.0)
        _add(g, r, 0.0, 0.0, 1.0)
        _add(g, -r, x, y, z)
        return r
    low, wide = t[13] * math.cos(t[14]), t[13] * math.sin(t[14])
    ox, oy, oz = x - along * t[9], y - along * t[10], z - along * t[11]
    back = t[16] / wide
    off = math.sqrt(ox * ox + oy * oy + oz * oz + back * back)
    s = wide / off
    g[0] += sign * (s * ox + low * t[9])
    g[1] += sign * (s * oy + low * t[10])
    g[2] += sign * (s * oz + low * t[11])
    _add(g, s, 1.0, 0.0, 0.0)
    _add(g, s, 0.0, 1.0, 0.0)
    _add(g, s, 0.0, 0.0, 1.0)
    _add(g, -s, t[9], t[10], t[11])
    _add(g, -s / (off * off), ox, oy, oz)
    return s * off * off + low * along


def _curved_segment(t: Vector, sign: float, x: float, y: float, z: float, g: Vector) -> float:
    """The same of a segment."""
    one = x * t[3] + y * t[4] + z * t[5]
    two = x * t[6] + y * t[7] + z * t[8]
    along = x * t[9] + y * t[10] + z * t[11]
    half, end = t[15], t[16] / t[15]
    ends = math.sqrt(along * along + end * end)
    f = half * along / ends
    off = math.sqrt(one * one + two * two)
    p, wide = t[13] * math.cos(t[14]), t[13] * math.sin(t[14])
    back = t[16] / wide
    w = math.sqrt(two * two + back * back)
    q, flat = wide * two / w, wide * back * back / w
    if off > 0.0 and one >= off * math.cos(t[14]):
        p, q, flat = t[13] * one / off, t[13] * two / off, 0.0
        r = t[13] / (off * off * off)
        bx, by = one * t[6] - two * t[3], one * t[7] - two * t[4]
        _add(g, r, bx, by, one * t[8] - two * t[5])
    else:
        _add(g, wide * back * back / (w * w * w), t[6], t[7], t[8])
    for i in range(3):
        g[i] += sign * (p * t[3 + i] + q * t[6 + i] + f * t[9 + i])
    _add(g, half * end * end / (ends * ends * ends), t[9], t[10], t[11])
    return p * one + q * two + flat + half * ends


def bulge(t: Vector) -> float:
    """Distance [m] by which faces of a solid, and sides of a cylinder, bulge."""
    if t[12] == BALL or t[12] == CAP:
        return 0.0
    return 2.0 * t[16] if t[12] == BOX else t[16]


def curved(t: Vector, sign: float, n: Vector, g: Vector) -> float:
    """h(sign n); adds sign x (3,), x the support point, and the second derivative to `g`.

    Args:
        t: the solid.
        sign: 1 or -1.
        n: (3,) a unit vector.
        g: (9,) what the support points add up to; xx, xy, xz, yy, yz, zz of the derivative.
    """
    x, y, z = sign * n[0], sign * n[1], sign * n[2]
    u = x * t[0] + y * t[1] + z * t[2]
    for i in range(3):
        g[i] += sign * t[i]
    if t[12] == BALL:
        r = t[13]
        for i in range(3):
            g[i] += r * n[i]
        _add(g, r, 1.0, 0.0, 0.0)
        _add(g, r, 0.0, 1.0, 0.0)
        _add(g, r, 0.0, 0.0, 1.0)
        _add(g, -r, x, y, z)
        return u + r
    if t[12] == CAP:
        return u + _curved_cap(t, sign, x, y, z, g)
    if t[12] == SEGMENT:
        return u + _curved_segment(t, sign, x, y, z, g)
    eps = t[16]
    if t[12] == CYLINDER:
        r, half = t[13], t[15]
        along = x * t[9] + y * t[10] + z * t[11]
        end, round_ = eps / half, eps / r
        ends = math.sqrt(along * along + end * end)
        ox, oy, oz = x - along * t[9], y - along * t[10], z - along * t[11]
        off = math.sqrt(ox * ox + oy * oy + oz * oz + round_ * round_)
        s, f = sign * r / off, sign * half * along / ends
        g[0] += s * ox + f * t[9]
        g[1] += s * oy + f * t[10]
        g[2] += s * oz + f * t[11]
        _add(g, r / off, 1.0, 0.0, 0.0)
        _add(g, r / off, 0.0, 1.0, 0.0)
        _add(g, r / off, 0.0, 0.0, 1.0)
        _add(g, -r / (off * off * off), ox, oy, oz)
        _add(g, half * end * end / (ends * ends * ends) - r / off, t[9], t[10], t[11])
        return u + r * off + half * ends
    for k in range(3):
        ax, ay, az, half = t[3 + 3 * k], t[4 + 3 * k], t[5 + 3 * k], t[13 + k]
        part, edge = x * ax + y * ay + z * az, eps / half
        w = math.sqrt(part * part + edge * edge)
        f = sign * half * part / w
        g[0] += f * ax
        g[1] += f * ay
        g[2] += f * az
        _add(g, half * edge * edge / (w * w * w), ax, ay, az)
        u += half * w
    return u


def _add(g: Vector, a: float, x: float, y: float, z: float) -> None:
    g[3] += a * x * x
    g[4] += a * x * y
    g[5] += a * x * z
    g[6] += a * y * y
    g[7] += a * y * z
    g[8] += a * z * z


def overlap(t: Vector, b: Vector, near: float, work: Vector) -> float:
    """Depth of a tool in a body [m]; negative is a distance, exact down to -near.

    Into `work` go the normal out of the body (0..2), and the sum of both second derivatives of h
    there (6..11: xx, xy, xz, yy, yz, zz).

    Args:
        t: the tool.
        b: the body.
        near: beyond this distance [m] any lower bound of it will do.
        work: (WORK,) memory of this call.
    """
    best, m = work[40:], work[12:]
    best[0] = 1e300
    shift = bulge(t) + bulge(b)
    dx, dy, dz = t[0] - b[0], t[1] - b[1], t[2] - b[2]
    _consider(t, b, dx, dy, dz, m, best)
    if best[0] - shift >= -near:
        _across_faces(t, b, t, dx, dy, dz, m, best)
        _across_faces(t, b, b, dx, dy, dz, m, best)
    if best[0] - shift >= -near and t[12] != BALL and b[12] != BALL and b[12] != CAP:
        _across_edges(t, b, m, best)
    depth = best[0]
    if depth - shift >= -near:
        for i in range(3):
            work[i] = best[1 + i]
        depth = _least(t, b, work)
    return depth - shift


def _across_faces(
    t: Vector, b: Vector, s: Vector, dx: float, dy: float, dz: float, m: Vector, best: Vector
) -> None:
    """Considers directions along the axes of one of both solids, and across that of a cylinder."""
    if s[12] == CYLINDER or s[12] == SEGMENT:
        along = dx * s[9] + dy * s[10] + dz * s[11]
        _consider(t, b, dx - along * s[9], dy - along * s[10], dz - along * s[11], m, best)
    first = 3 if s[12] == BALL else (2 if s[12] == CYLINDER or s[12] == CAP else 0)
    for k in range(first, 3):
        x, y, z = s[3 + 3 * k], s[4 + 3 * k], s[5 + 3 * k]
        _consider(t, b, x, y, z, m, best)
        _consider(t, b, -x, -y, -z, m, best)


def _across_edges(t: Vector, b: Vector, m: Vector, best: Vector) -> None:
    """Considers directions across an axis of each solid."""
    for k in range(2 if t[12] == CYLINDER else 0, 3):
        for j in range(0 if b[12] == BOX else 2, 3):
            p, q = t[3 + 3 * k :], b[3 + 3 * j :]
            x, y = p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2]
            z = p[0] * q[1] - p[1] * q[0]
            _consider(t, b, x, y, z, m, best)
            _consider(t, b, -x, -y, -z, m, best)


def _consider(t: Vector, b: Vector, x: float, y: float, z: float, m: Vector, best: Vector) -> None:
    """Keeps a direction, and the depth along it, that is less than that of the best (4,)."""
    size = math.sqrt(x * x + y * y + z * z)
    if size < 1e-6:
        return
    x, y, z = x / size, y / size, z / size
    depth = support(t, -x, -y, -z, m) + support(b, x, y, z, m)
    if depth < best[0]:
        best[0], best[1], best[2], best[3] = depth, x, y, z


def _least(t: Vector, b: Vector, work: Vector) -> float:
    """The least depth about a unit normal (0..2): Newton's method on the sphere, damped.

    Its gradient is how far the support points are apart, g (3..5); its second derivative, across
    the normal, is H - g.n.
    """
    n, g, m, other, tangents = work, work[3:], work[12:], work[15:], work[24:]
    depth = _along(t, b, n, g)
    damping = 1e-4
    for _ in range(_MOST_STEPS):
        across(n, tangents)
        b0 = tangents[0] * g[0] + tangents[1] * g[1] + tangents[2] * g[2]
        b1 = tangents[3] * g[0] + tangents[4] * g[1] + tangents[5] * g[2]
        if abs(b0) + abs(b1) < _ABOVE:
            break
        h = g[3:]
        h00 = _bent(h, tangents, tangents) - depth
        h01 = _bent(h, tangents, tangents[3:])
        h11 = _bent(h, tangents[3:], tangents[3:]) - depth
        moved, last, now = False, False, depth
        for _ in range(_MOST_TRIES):
            a, c = h00 + damping, h11 + damping
            det = a * c - h01 * h01
            if a > 0.0 and det > 0.0:
                d0, d1 = -(c * b0 - h01 * b1) / det, -(a * b1 - h01 * b0) / det
                _turn(n, tangents, d0, d1, m)
                now = _along(t, b, m, other)
                last = -(b0 * d0 + b1 * d1) < _NOISE
                if now < depth or last:
                    moved = True
                    break
            damping = 4.0 * damping + 1e-7
        if not moved:
            break
        # Normal and derivatives go from where they were tried to where they stay.
        for i in range(12):
            n[i] = m[i]
        depth = now
        damping *= 0.1
        if last:
            break
    return depth


def _along(t: Vector, b: Vector, n: Vector, g: Vector) -> float:
    """Depth along a unit normal (3,); the sum of both solids' derivatives (9,) into `g`."""
    for i in range(9):
        g[i] = 0.0
    return curved(t, -1.0, n, g) + curved(b, 1.0, n, g)


def _turn(n: Vector, tangents: Vector, d0: float, d1: float, m: Vector) -> None:
    """The unit vector `m` (3,) that is off another one by d0 and d1 along two tangents (6,)."""
    for i in range(3):
        m[i] = n[i] + d0 * tangents[i] + d1 * tangents[3 + i]
    size = math.sqrt(m[0] * m[0] + m[1] * m[1] + m[2] * m[2])
    for i in range(3):
        m[i] /= size


def _bent(h: Vector, a: Vector, b: Vector) -> float:
    """a.H b of a symmetric H."""
    x = h[0] * b[0] + h[1] * b[1] + h[2] * b[2]
    y = h[1] * b[0] + h[3] * b[1] + h[4] * b[2]
    z = h[2] * b[0] + h[4] * b[1] + h[5] * b[2]
    return a[0] * x + a[1] * y + a[2] * z
