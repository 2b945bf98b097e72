"""How often a cable is wound about itself: twist Tw, writhe Wr, and the link Tw + Wr that only passing through changes.

Of a closed ribbon the linking number of its two edges is whole, and Lk = Tw + Wr (Calugareanu 1959, White 1969), with

    Tw = 1/(2 pi) int omega_3 ds,    Wr = 1/(4 pi) int int (r'(s) x r'(t)) . (r(s) - r(t)) / |r(s) - r(t)|^3 ds dt.

Bending and twisting change Tw and Wr against each other; Lk jumps by 2 where the cable goes through itself, and does
not change otherwise (Fuller, "Decomposition of the linking number of a closed ribbon", PNAS 75, 1978). The writhe of a
polygon is exact: a pair of its sides contributes the solid angle under which it is seen as crossing (Klenin and
Langowski, "Computation of writhe in modeling of supercoiled DNA", Biopolymers 54, 2000, method 1a).

A cable between two clamps is no closed curve. It is closed by two straight rays, one from either clamp, fixed in it:
behind the start and ahead of the end, to so far away that nothing there is wound about anything. While the clamps
stand, the closure stands, so that Tw + Wr of cable and rays changes only where the cable goes through itself or through
a ray. A loop thrown over a clamp goes through its ray, without touching the cable; but not through all rays of a bundle
that spreads from the clamp, unless it is pulled over the clamp itself, which is fixed to something. So the link has
changed between two shapes where it has for every ray of such a bundle.
"""

from __future__ import annotations

import math

import numpy as np

from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.rod.boundary import HELD, Kind
from harness_opt.rod.states import Rod

FAR = 1e4  # lengths of the cable: how long the rays are
SPREAD = 0.7  # rad, between the rays of a bundle and the clamp's tangent
TURNING = 0.15  # rad, most that the centreline turns by between two points of the polygon
PAIRS = 10_000  # of sides looked at together: few enough to stay in the processor's cache
POINTS = (60, 1500)  # of the polygon, at least and at most


def twist(q: Array) -> float:
    """Return the twist, in turns, along frames ``q`` (N, 4), each less than half a turn from the next."""
    spin = rotations.small_rotation_vector(rotations.multiply(rotations.conjugate(q[:-1]), q[1:]))
    return float(np.sum(spin[:, 2])) / (2.0 * math.pi)


def writhe(points: Array, *, closed: bool = False) -> float:
    """Return the writhe, in turns, of a polygon (N, 3); ``closed`` has a side from the last point to the first."""
    ends = np.vstack([points[1:], points[:1]]) if closed else points[1:]
    begins = points if closed else points[:-1]
    one, other = np.triu_indices(len(begins), 2)
    if closed:
        apart = other - one < len(begins) - 1  # not neighbours round the end
        one, other = one[apart], other[apart]
    some = (slice(first, first + PAIRS) for first in range(0, len(one), PAIRS))
    pairs = ((one[k], other[k]) for k in some)
    return 2.0 * math.fsum(float(np.sum(_crossings(begins[i], ends[i], begins[j], ends[j]))) for i, j in pairs)


def _crossings(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Return what sides from ``c`` to ``d`` (n, 3) contribute to the writhe with those from ``a`` to ``b``, (n,).

    ``a`` and ``b`` are (n, 3), or (3,) of one side against all. Klenin and Langowski's Omega / (4 pi): the solid angle
    of the quadrangle of directions from one side to the other.
    """
    tiny = np.finfo(float).tiny
    ac, ad, bc, bd = c - a, d - a, c - b, d - b
    normals = np.stack([rotations.cross(p, q) for p, q in ((ac, ad), (ad, bd), (bd, bc), (bc, ac))])
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), tiny)
    cosines = np.sum(normals * np.roll(normals, -1, axis=0), axis=-1)
    angle = np.sum(np.arcsin(np.clip(cosines, -1.0, 1.0)), axis=0)
    side = np.sign(np.sum(rotations.cross(d - c, np.broadcast_to(b - a, c.shape)) * ac, axis=-1))
    return np.asarray(angle * side / (4.0 * math.pi))


def links(s: Array, q: Array, points: Array) -> Array:
    """Return Tw + Wr, in turns, of a cable closed by each ray of the bundles, (5,); the first are the tangents' own.

    Args:
        s: arc lengths of the stations, (N,).
        q: section frames there, (N, 4), neighbours less than half a turn apart.
        points: of the centreline there, (N, 3).
    """
    own = twist(q)
    length = float(s[-1] - s[0])
    behind, ahead = (_bundle(q[node], sign) for node, sign in ((0, -1.0), (-1, 1.0)))
    body = writhe(points)
    begins, ends = points[:-1], points[1:]
    found = []
    for back, forth in zip(behind, ahead, strict=True):
        first, last = points[0] + FAR * length * back, points[-1] + FAR * length * forth
        with_start = np.sum(_crossings(first, points[0], begins[1:], ends[1:]))
        with_end = np.sum(_crossings(points[-1], last, begins[:-1], ends[:-1]))
        both = _crossings(first, points[0], points[-1:], last[None])[0]
        found.append(own + body + 2.0 * float(with_start + with_end + both))
    return np.array(found)


def _bundle(q: Array, sign: float) -> Array:
    """Return the directions (5, 3) of rays from a clamp with frame ``q`` (4,), along ``sign`` its tangent and about."""
    aside = np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
    local = np.column_stack([math.sin(SPREAD) * aside, math.cos(SPREAD) * np.ones(5)])
    local[0] = (0.0, 0.0, 1.0)
    return rotations.rotate(np.tile(q, (5, 1)), sign * local)


def keeps_turns(kind: Kind) -> bool:
    """Whether both ends are held, so that turns cannot come and go there."""
    return kind.start_held == kind.end_held == HELD


def turns_lost(kind: Kind, before: Array, after: Array) -> int:
    """Return by how many turns the link has changed between two shapes, from what :func:`links` returns of each.

    The least over the rays, an even number: each time that a cable goes through itself, two turns are lost or won.
    Clamps that turn or move a little between the two change it by less than one. Where an end turns freely, turns come
    and go there, and none is counted as lost.
    """
    if not keeps_turns(kind):
        return 0
    change = 2 * np.rint(0.5 * (after - before)).astype(int)
    return int(change[np.argmin(np.abs(change))])


def links_of(rod: Rod) -> Array:
    """Return :func:`links` of one solved shape, at stations that follow its turning."""
    fine = np.linspace(0.0, 1.0, 8 * (len(rod.mesh) - 1) + 1)
    fine = np.interp(fine * (len(rod.mesh) - 1), np.arange(len(rod.mesh)), rod.mesh)
    turning = np.linalg.norm(rod.sample(fine).omega, axis=-1)
    s = _places(fine, np.diff(fine) * 0.5 * (turning[1:] + turning[:-1]))
    samples = rod.sample(s)
    return links(s, samples.q, samples.r)


def links_of_curve(s: Array, q: Array, points: Array) -> Array:
    """Return :func:`links` of a curve at as many of its stations as its turning asks for; arguments as there."""
    turned = rotations.small_rotation_vector(rotations.multiply(rotations.conjugate(q[:-1]), q[1:]))
    which = np.unique(np.searchsorted(s, _places(s, np.linalg.norm(turned, axis=-1))))
    return links(s[which], q[which], points[which])


def _places(s: Array, turned: Array) -> Array:
    """Return places (n,) along stations ``s`` (N,), denser where more is turned by between these, (N - 1,), rad."""
    needed = np.concatenate([[0.0], np.cumsum(turned)]) / TURNING + POINTS[0] * (s - s[0]) / (s[-1] - s[0])
    count = int(np.clip(math.ceil(needed[-1]), *POINTS))
    found = np.interp(np.linspace(0.0, needed[-1], count + 1), needed, s)
    found[0], found[-1] = s[0], s[-1]
    return found
