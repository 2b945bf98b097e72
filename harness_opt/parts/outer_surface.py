"""The outer surface of closed pieces that overlap, touch or lie within each other: what a depth is measured to.

A triangle with the inside on both its sides is no surface. It has one where its winding number a small step off along
the normal is not 0 on either side; the number changes only where the triangle, moved by the step, crosses others. So
what is crossed is cut along these lines, and each piece is asked once. The step closes gaps that rounding left
between faces that touch: no point of the surface returned is further than the step from the outside, and what is
missing of the true surface borders on gaps narrower than that.

Written pieces are convex: each line cuts all across the piece that it enters, as in a binary space partition (Fuchs,
Kedem and Naylor, "On visible surface generation by a priori tree structures", SIGGRAPH 1980).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices, lengths
from harness_opt.parts.box_pairs import bundles
from harness_opt.parts.crossings import Crossings, Planes, crossings
from harness_opt.parts.nearest import Shell
from harness_opt.parts.orientation import Edges, joined
from harness_opt.parts.winding import Winding

# of the largest coordinate in the file: gaps narrower than that count as closed. Corners in single precision are off
# by 6e-8 of it along each axis, so that two faces in one plane come apart by 2e-7 of it at most.
CLOSED_GAP = 5e-7
FEW_FACES = 200  # of a body, up to which all are summed for the sides of its pieces, which are many
FINEST = 1e-3  # of the gap: nothing narrower is cut off, it is rounding
NARROW = 3.0  # gaps: a piece that narrow is left out, it may be the bottom of a gap that counts as closed
FLAT_PIECE = 1e-9  # height over longest edge below which a triangle of a piece is left out: coal needs an area

Point = tuple[float, float]
Polygon = list[Point]  # convex, counterclockwise


def outer_surface(shell: Shell, gap: float) -> Shell | None:
    """Return the triangles of ``shell``, which close, that border on the outside; None where all do.

    Args:
        shell: closed pieces, each turned outward, cavities inward.
        gap: between pieces, below which they touch, m.
    """
    distinct = _distinct(shell.faces)
    faces = shell.faces[distinct]
    if not len(faces):
        return None
    planes = Planes.of(shell.vertices[faces])
    cuts = crossings(planes, faces, gap)
    patch = _patches(faces, np.unique(cuts.face))
    if len(distinct) == len(shell.faces) and patch.max() == 0:
        return None
    pieces = _pieces(planes, cuts, patch, gap)
    side = _outer_sides(shell, planes, pieces, gap)
    whole = np.zeros(len(faces))  # +-1 where the outside is along or against the normal of the whole triangle
    uncut = ~np.isin(np.arange(len(faces)), pieces.crossed)
    of_patch = np.zeros(patch.max() + 1)
    of_patch[patch[pieces.face[~pieces.cut]]] = side[~pieces.cut]
    whole[uncut] = of_patch[patch[uncut]]
    for way in (1.0, -1.0):  # what was cut for nothing stays whole
        agree = np.bincount(pieces.face[pieces.cut], weights=side[pieces.cut] == way, minlength=len(faces))
        count = np.bincount(pieces.face[pieces.cut], minlength=len(faces))
        whole[(count > 0) & (agree == count)] = way
    if np.all(whole) and len(distinct) == len(shell.faces):
        return None
    return _joined(shell, faces, planes, whole, pieces, side)


def _distinct(faces: Indices) -> Indices:
    """Return the numbers (k,) of ``faces`` (m, 3) without doubles; two that face each other are both left out."""
    turned = np.sort(faces, axis=1)
    order = np.lexsort(turned.T)
    differs = np.any(np.diff(turned[order], axis=0) != 0, axis=1)
    if np.all(differs):
        return np.arange(len(faces))
    group = np.empty(len(faces), dtype=np.int64)
    group[order] = np.concatenate([[0], np.cumsum(differs)])
    # an even permutation of the sorted corners turns as they do
    lowest = np.argmin(faces, axis=1)
    row = np.arange(len(faces))
    even = faces[row, (lowest + 1) % 3] < faces[row, (lowest + 2) % 3]
    balance = np.bincount(group, weights=np.where(even, 1.0, -1.0))
    kept = np.flatnonzero(balance[group] * np.where(even, 1.0, -1.0) > 0)
    return np.asarray(kept[np.unique(group[kept], return_index=True)[1]])


def _patches(faces: Indices, touched: Indices) -> Indices:
    """Return the number (m,) of the patch of each face: of those next to each other that nothing touches."""
    alone = np.zeros(len(faces), dtype=bool)
    alone[touched] = True
    pairs = Edges.of(faces).pairs
    return joined(pairs[~np.any(alone[pairs], axis=1)], len(faces))


# --- pieces --------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Pieces:
    """What is asked for its sides, n of them: parts of triangles that are cut, and one triangle of each patch.

    Args:
        crossed: (c,), the triangles that are cut.
        face: (n,), the triangle.
        cut: (n,), whether it is a part of it.
        polygons: n, in the axes of the triangle, m; empty for whole triangles.
        middle: (n, 3), a point in each, m.
    """

    crossed: Indices
    face: Indices
    cut: NDArray[np.bool_]
    polygons: list[Polygon]
    middle: Array


def _pieces(planes: Planes, cuts: Crossings, patch: Indices, gap: float) -> _Pieces:
    """Return the pieces of what is cut by ``cuts``, and the largest triangle of each patch of the rest."""
    faces: list[int] = []
    polygons: list[Polygon] = []
    crossed: list[int] = []
    order = np.argsort(cuts.face, kind="stable")
    start, end = cuts.start[order].tolist(), cuts.end[order].tolist()
    face, first = np.unique(cuts.face[order], return_index=True)
    for one, low, high in zip(face.tolist(), first.tolist(), np.append(first, len(order))[1:].tolist(), strict=True):
        whole = [(x, y) for x, y in planes.flat[one].tolist()]
        parts = _cut(whole, zip(start[low:high], end[low:high], strict=True), FINEST * gap)
        if len(parts) > 1:
            parts = [part for part in parts if _width(part) > NARROW * gap]
            faces += [one] * len(parts)
            polygons += parts
            crossed.append(one)
    size = lengths(np.cross(planes.corners[:, 1] - planes.corners[:, 0], planes.corners[:, 2] - planes.corners[:, 0]))
    largest = np.lexsort((-size, patch))
    largest = largest[np.unique(patch[largest], return_index=True)[1]]
    largest = largest[~np.isin(largest, crossed)]
    at = np.array([_middle(polygon) for polygon in polygons]).reshape(-1, 2)
    own = np.array(faces, dtype=np.int64)
    middle = planes.corners[own, 0] + np.einsum("ni,nij->nj", at, planes.axes[own, :2])
    return _Pieces(
        crossed=np.array(crossed, dtype=np.int64),
        face=np.concatenate([own, largest]),
        cut=np.arange(len(own) + len(largest)) < len(own),
        polygons=polygons + [[]] * len(largest),
        middle=np.concatenate([middle, planes.corners[largest].mean(axis=1)]),
    )


def _cut(polygon: Polygon, segments: Iterable[tuple[list[float], list[float]]], finest: float) -> list[Polygon]:
    """Return the pieces of a convex polygon, cut along ``segments``; nothing narrower than ``finest`` is cut off."""
    pieces = [polygon]
    for (px, py), (qx, qy) in segments:
        long = math.hypot(qx - px, qy - py)
        if long <= finest:
            continue
        x, y = (qx - px) / long, (qy - py) / long
        after = []
        for piece in pieces:
            off = [x * (v - py) - y * (u - px) for u, v in piece]
            if max(off) <= finest or min(off) >= -finest:
                after.append(piece)
                continue
            left, right, doors = _halves(piece, off)
            along = sorted(x * (u - px) + y * (v - py) for u, v in doors)
            enters = min(along[-1], long) - max(along[0], 0.0) > finest
            after += [left, right] if enters else [piece]
        pieces = after
    return pieces


def _halves(piece: Polygon, off: list[float]) -> tuple[Polygon, Polygon, Polygon]:
    """Return a polygon's parts left and right of a line, from which its corners are ``off``, and those on the line."""
    left, right, doors = [], [], []
    for k, (corner, here) in enumerate(zip(piece, off, strict=True)):
        following, there = piece[(k + 1) % len(piece)], off[(k + 1) % len(piece)]
        if here >= 0:
            left.append(corner)
        if here <= 0:
            right.append(corner)
        if here == 0:
            doors.append(corner)
        if here * there < 0:
            share = here / (here - there)
            door = (corner[0] + share * (following[0] - corner[0]), corner[1] + share * (following[1] - corner[1]))
            left.append(door)
            right.append(door)
            doors.append(door)
    return left, right, doors


def _width(polygon: Polygon) -> float:
    """Return about how wide a convex polygon is, m: its area over its longest reach from a corner."""
    (ax, ay), area, reach = polygon[0], 0.0, 0.0
    for (bx, by), (cx, cy) in pairwise(polygon[1:]):
        area += (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        reach = max(reach, math.hypot(bx - ax, by - ay), math.hypot(cx - ax, cy - ay))
    return area / reach if reach > 0 else 0.0


def _middle(polygon: Polygon) -> Point:
    """Return the centroid of a convex polygon that has an area."""
    (ax, ay), total, u, v = polygon[0], 0.0, 0.0, 0.0
    for (bx, by), (cx, cy) in pairwise(polygon[1:]):
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        total, u, v = total + area, u + area * (ax + bx + cx), v + area * (ay + by + cy)
    return u / (3 * total), v / (3 * total)


# --- sides ---------------------------------------------------------------------------------------------


def _outer_sides(shell: Shell, planes: Planes, pieces: _Pieces, step: float) -> Array:
    """Return on which side of each piece the outside is, (n,): +1 along the normal, -1 against it, 0 on neither."""
    normal = step * planes.axes[pieces.face, 2]
    bodies = _bodies(shell)
    side = np.where(_holds(bodies, pieces.middle + normal), 0.0, 1.0)
    unsure = np.flatnonzero(side == 0)
    side[unsure] = np.where(_holds(bodies, pieces.middle[unsure] - normal[unsure]), 0.0, -1.0)
    return side


def _bodies(shell: Shell) -> list[tuple[Array, Array, Winding]]:
    """Return the bodies of ``shell``, which have no corner in common: lower and upper corner, winding numbers."""
    vertices, faces = shell.vertices, shell.faces
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]])
    label = joined(ends, len(vertices))[faces[:, 0]]
    order = np.argsort(label, kind="stable")
    bodies = []
    for group in np.split(order, np.flatnonzero(np.diff(label[order])) + 1):
        own = faces[group]
        corners = vertices[own]
        lower, upper = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
        members = bundles(vertices, own) if len(own) > FEW_FACES else None
        bodies.append((lower, upper, Winding.of(vertices, own, members)))
    return bodies


def _holds(bodies: list[tuple[Array, Array, Winding]], points: Array) -> NDArray[np.bool_]:
    """Return whether ``points`` (n, 3) have a winding number, (n,): that of a body is 0 beyond its box."""
    turns = np.zeros(len(points))
    for lower, upper, winding in bodies:
        inside = np.flatnonzero(np.all((points > lower) & (points < upper), axis=1))
        if len(inside):
            turns[inside] += winding.turns(points[inside])
    held: NDArray[np.bool_] = turns != 0
    return held


# --- result --------------------------------------------------------------------------------------------


def _joined(shell: Shell, faces: Indices, planes: Planes, whole: Array, pieces: _Pieces, side: Array) -> Shell | None:
    """Return the triangles that are surface, whole ones and parts; None where there are none."""
    kept = np.flatnonzero(whole)
    own, sides, fans = [], [], []
    for k in np.flatnonzero(pieces.cut & (side != 0) & (whole[pieces.face] == 0)).tolist():
        polygon = pieces.polygons[k]
        fans += [(polygon[0], *edge) for edge in pairwise(polygon[1:])]
        own += [pieces.face[k]] * (len(polygon) - 2)
        sides += [side[k]] * (len(polygon) - 2)
    face, flat = np.array(own, dtype=np.int64), np.array(fans).reshape(-1, 3, 2)
    parts = planes.corners[face, :1] + np.einsum("nci,nij->ncj", flat, planes.axes[face, :2])
    edges = parts[:, [1, 2, 0]] - parts
    solid = lengths(np.cross(edges[:, 0], edges[:, 1])) > FLAT_PIECE * lengths(edges).max(axis=1) ** 2
    parts, outward = parts[solid], (planes.axes[face, 2] * np.array(sides).reshape(-1, 1))[solid]
    if not len(kept) + len(parts):
        return None
    return Shell.of(
        np.concatenate([shell.vertices, parts.reshape(-1, 3)]),
        np.concatenate([faces[kept], np.arange(3 * len(parts)).reshape(-1, 3) + len(shell.vertices)]),
        np.concatenate([planes.axes[kept, 2] * whole[kept, None], outward]),
    )
