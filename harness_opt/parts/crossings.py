"""Where the triangles of a mesh cross each other, or come so near that they count as touching.

Each triangle is asked for what crosses it and what crosses its copies a small step off along its normal: the side
walls of a body that stands on it cross the copy, whatever the triangles of the two faces that touch. So faces in one
plane need no case of their own, and neither do gaps that rounding left.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices, dots, lengths
from harness_opt.parts.box_pairs import meeting_boxes

MARGIN = 0.3  # of the step: what comes that near to a triangle's edge from outside touches it; rounding leaves less
AT_HINGE = 100.0  # steps: two triangles that share a corner or an edge are let alone that near to it
STEEP = 0.1  # sine of the angle from which on what crosses a triangle crosses its copies in the same place


@dataclass(frozen=True, eq=False)
class Planes:
    """Triangles, each with axes of its own: the first corner is the origin, the first edge x, the normal z.

    Args:
        corners: (m, 3, 3), m.
        axes: (m, 3, 3), unit rows.
        flat: (m, 3, 2), the corners in these axes, m, counterclockwise.
    """

    corners: Array
    axes: Array
    flat: Array

    @staticmethod
    def of(corners: Array) -> Planes:
        """Return the axes of triangles (m, 3, 3), m, that have an area."""
        edge = corners[:, 1] - corners[:, 0]
        x = edge / lengths(edge)[:, None]
        normal = np.cross(edge, corners[:, 2] - corners[:, 0])
        z = normal / lengths(normal)[:, None]
        axes = np.stack([x, np.cross(z, x), z], axis=1)
        flat = np.einsum("mij,mcj->mci", axes[:, :2], corners - corners[:, :1])
        return Planes(corners, axes, flat)


@dataclass(frozen=True, eq=False)
class Crossings:
    """Segments (k) along which triangles are crossed or touched.

    Args:
        face: (k,), the triangle.
        start, end: (k, 2), in its axes, m.
    """

    face: Indices
    start: Array
    end: Array


def crossings(planes: Planes, faces: Indices, step: float) -> Crossings:
    """Return where triangles are crossed by others, or would be if they were moved by ``step``, m, along their normal.

    Args:
        planes: the triangles, m of them.
        faces: (m, 3), their vertex numbers: what shares one is let alone near it.
        step: m.
    """
    lower, upper = planes.corners.min(axis=1) - step, planes.corners.max(axis=1) + step
    found = [
        some
        for pair in meeting_boxes(lower, upper)
        for i, j in [_folded(planes, faces, *pair)]
        for one, other in ((i, j), (j, i))
        for some in _crossings(planes, faces, step, one, other)
    ]
    none = np.zeros((0, 2))
    if not found:
        return Crossings(np.zeros(0, dtype=np.int64), none, none)
    return Crossings(
        np.concatenate([some.face for some in found]),
        np.concatenate([some.start for some in found]),
        np.concatenate([some.end for some in found]),
    )


def _folded(planes: Planes, faces: Indices, i: Indices, j: Indices) -> tuple[Indices, Indices]:
    """Return the pairs (k,), (k,) but for those that only share an edge, at more than a right angle: most pairs do."""
    equal = faces[i][:, :, None] == faces[j][:, None, :]
    shared, theirs = equal.any(axis=2), equal.any(axis=1)
    hinge = np.flatnonzero(shared.sum(axis=1) == 2)
    one, other = i[hinge], j[hinge]
    free = np.argmin(shared[hinge], axis=1)
    start, end = planes.corners[one, (free + 1) % 3], planes.corners[one, (free + 2) % 3]
    u = planes.corners[one, free] - start
    v = planes.corners[other, np.argmin(theirs[hinge], axis=1)] - start
    edge = end - start
    away = dots(u, v) * dots(edge, edge) < dots(u, edge) * dots(v, edge)  # on two sides of the edge, seen along it
    kept = np.ones(len(i), dtype=bool)
    kept[hinge[away]] = False
    return i[kept], j[kept]


def _crossings(planes: Planes, faces: Indices, step: float, one: Indices, other: Indices) -> Iterator[Crossings]:
    """Yield what crosses triangles ``one`` (k,) of the triangles ``other`` (k,)."""
    height = np.stack(
        [dots(planes.corners[other, c] - planes.corners[one, 0], planes.axes[one, 2]) for c in range(3)], axis=1
    )
    low, high = height.min(axis=1), height.max(axis=1)
    near = np.flatnonzero((low < step) & (high > -step) & ((high > step) | (low < -step)))
    one, other, height, low, high = one[near], other[near], height[near], low[near], high[near]
    steep = np.abs(dots(planes.axes[one, 2], planes.axes[other, 2])) < np.sqrt(1 - STEEP**2)
    once = steep & (low < -step) & (high > step)
    for level, asked in (
        (0.0, once),
        (step, ~once & (low < step) & (high > step)),
        (-step, ~once & (low < -step) & (high > -step)),
    ):
        yield _at_level(planes, faces, step, one[asked], other[asked], height[asked] - level)


def _at_level(planes: Planes, faces: Indices, step: float, one: Indices, other: Indices, height: Array) -> Crossings:
    """Return the segments of triangles ``other`` (k,) in planes along ``one`` (k,), heights (k, 3) above these, m."""
    row = np.arange(len(one))
    above = height > 0
    # one corner is on a side of its own, and the segment runs between its two edges
    lone = np.argmax(above == (above.sum(axis=1) == 1)[:, None], axis=1)
    corners = planes.corners[other]
    ends = []
    for shift in (1, 2):
        next_one = (lone + shift) % 3
        share = height[row, lone] / (height[row, lone] - height[row, next_one])
        at = corners[row, lone] + share[:, None] * (corners[row, next_one] - corners[row, lone])
        ends.append(np.einsum("kij,kj->ki", planes.axes[one, :2], at - planes.corners[one, 0]))
    start, end = ends
    inward = _inward(planes.flat[one], np.stack([start, end], axis=1))
    low, high = _within(inward, MARGIN * step)
    meets = low <= high
    clipped = [start + share[:, None] * (end - start) for share in (low, high)]
    keeps = meets & ~_at_hinge(planes, faces, AT_HINGE * step, one, other, np.stack(clipped, axis=1))
    return Crossings(one[keeps], start[keeps], end[keeps])


def _inward(flat: Array, points: Array) -> Array:
    """Return how far points (k, n, 2) are inside each edge of flat triangles (k, 3, 2): (k, n, 3), m."""
    sides = []
    for c in range(3):
        edge = flat[:, (c + 1) % 3] - flat[:, c]
        way = points - flat[:, None, c]
        turned = edge[:, None, 0] * way[..., 1] - edge[:, None, 1] * way[..., 0]
        sides.append(turned / np.sqrt(np.einsum("ki,ki->k", edge, edge))[:, None])
    return np.stack(sides, axis=2)


def _within(inward: Array, margin: float) -> tuple[Array, Array]:
    """Return the shares (k,), (k,) of segments between which they are in their triangles; the first larger if nowhere.

    Liang and Barsky, "A new concept and method for line clipping", ACM Trans. Graph. 3 (1984).

    Args:
        inward: (k, 2, 3), how far the two ends are inside the three edges, m.
        margin: how far outside is still in, m.
    """
    at_start, at_end = inward[:, 0] + margin, inward[:, 1] + margin
    change = at_end - at_start
    share = -at_start / np.where(change == 0, 1.0, change)
    low = np.where((at_start < 0) & (at_end >= 0), share, 0.0).max(axis=1)
    high = np.where((at_start >= 0) & (at_end < 0), share, 1.0).min(axis=1)
    outside = np.any((at_start < 0) & (at_end < 0), axis=1)
    return np.where(outside, 1.0, low), np.where(outside, 0.0, high)


def _at_hinge(
    planes: Planes, faces: Indices, reach: float, one: Indices, other: Indices, ends: Array
) -> NDArray[np.bool_]:
    """Return whether segments (k, 2, 2) lie within ``reach`` of the corner or edge that both triangles share, (k,)."""
    shared = np.any(faces[one][:, :, None] == faces[other][:, None, :], axis=2)
    count = shared.sum(axis=1)
    found: NDArray[np.bool_] = count == 3  # the same triangle twice
    corner = np.flatnonzero(count == 1)
    at = planes.flat[one[corner], np.argmax(shared[corner], axis=1)]
    way = ends[corner] - at[:, None]
    found[corner] = np.einsum("kei,kei->ke", way, way).max(axis=1) <= reach**2
    edge = np.flatnonzero(count == 2)
    # that between corners c and c + 1, of which neither is the one that is not shared
    first = (np.argmin(shared[edge], axis=1) + 1) % 3
    off = _inward(planes.flat[one[edge]], ends[edge])[np.arange(len(edge)), :, first]
    found[edge] = np.abs(off).max(axis=1) <= reach
    return found
