"""The nearest of many triangles: asked of coal, and checked.

A ball of radius 0 against coal's tree of triangles is exact (1e-16 m measured), and so is a capsule of radius
0 that stays clear of the surface (7e-7 m with coal's own tolerance, 3e-15 with :data:`GJK`). Thicker capsules
are wrong where they penetrate, by 6e-4 m at a radius of 1 mm, or infinite in a triangle's plane: so only
centrelines are asked. coal sees a shell without an inside. It is imported when the first mesh is asked.

coal's tree takes 0.55 kB and 2 us a triangle. So a large mesh has many trees, of a bundle of neighbouring triangles
each, and those are made that something comes near to: of a car the few parts round a cable.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices, dots, lengths
from harness_opt.parts.box_pairs import bundles
from harness_opt.parts.orientation import PAIRS_AT_A_TIME

# of the mesh's diagonal: largest difference between coal's answer and the exact one on its triangle
AGREE = 1e-9
GJK = 1e-9  # tolerance of coal's iteration between a segment and a triangle; its own is 1e-6
ONE_TREE = 200_000  # triangles: up to here one tree holds them all, made within half a second
BLOCK = 64  # points whose near trees are looked for together


@dataclass(frozen=True, eq=False)
class Shell:
    """Triangles, and the one of them nearest to a point.

    Args:
        vertices: (k, 3), m.
        faces: (m, 3), vertex numbers; each face has an area.
        normals: (m, 3), unit, outward where the triangles have an inside.
        lower, upper: corners of the box that holds the triangles, (3,), m.
    """

    vertices: Array
    faces: Indices
    normals: Array
    lower: Array
    upper: Array

    @staticmethod
    def of(vertices: Array, faces: Indices, normals: Array) -> Shell:
        """Return the triangles and the box that holds them; arguments as for the class."""
        used = np.zeros(len(vertices), dtype=bool)
        used[faces] = True
        corners = vertices[used]
        return Shell(vertices, np.ascontiguousarray(faces), normals, corners.min(axis=0), corners.max(axis=0))

    @cached_property
    def diagonal(self) -> float:
        """Of the box that holds the triangles, m."""
        return float(np.linalg.norm(self.upper - self.lower))

    @cached_property
    def bundles(self) -> list[Indices]:
        """The triangles in bundles of neighbours: their numbers."""
        return bundles(self.vertices, self.faces)

    @cached_property
    def query(self) -> CoalQuery:
        """What coal answers about the same triangles."""
        whole = [np.arange(len(self.faces))]
        return CoalQuery(self.vertices, self.faces, self.bundles if len(self.faces) > ONE_TREE else whole)

    def nearest(self, points: Array) -> tuple[Array, Array, Indices]:
        """Return unsigned distances (n,), nearest points (n, 3), m, and their faces (n,) for ``points`` (n, 3), m."""
        claimed, face = self.query(points)
        nearest = closest_on_triangles(points, *self.vertices[self.faces[face]].swapaxes(0, 1))
        distance = lengths(points - nearest)
        # NaN compares false, so what is not surely right is asked again, of every triangle
        for i in np.flatnonzero(~(np.abs(claimed - distance) <= AGREE * (self.diagonal + distance))):
            nearest[i], face[i] = self._nearest_of_all(points[i])
            distance[i] = np.linalg.norm(points[i] - nearest[i])
        return distance, nearest, face

    def _nearest_of_all(self, point: Array) -> tuple[Array, int]:
        """Return the nearest point (3,) on the mesh and its face, by looking at every triangle."""
        best, winner, nearest = math.inf, 0, point
        for first in range(0, len(self.faces), PAIRS_AT_A_TIME):
            corners = self.vertices[self.faces[first : first + PAIRS_AT_A_TIME]].swapaxes(0, 1)
            candidates = closest_on_triangles(np.broadcast_to(point, corners[0].shape), *corners)
            distance = lengths(candidates - point)
            k = int(np.argmin(distance))
            if distance[k] < best:
                best, winner, nearest = float(distance[k]), first + k, candidates[k]
        return nearest, winner


class CoalQuery:
    """Distances of points, segments and boxes to a triangle shell; coal's request and result are made once.

    Args:
        vertices, faces: as for :class:`Shell`.
        bundles: numbers of faces, that a tree is made of each.
    """

    def __init__(self, vertices: Array, faces: Indices, bundles: Sequence[Indices]):
        import coal

        self._coal = coal
        self._vertices, self._faces, self._bundles = vertices, faces, bundles
        self._trees: list[Any] = [None] * len(bundles)
        boxes = [_box(vertices[faces[own]].reshape(-1, 3)) for own in bundles]
        self._lower, self._upper = np.array([low for low, _ in boxes]), np.array([high for _, high in boxes])
        self._still, self._moved = coal.Transform3s.Identity(), coal.Transform3s.Identity()
        self._request, self._result = coal.DistanceRequest(), coal.DistanceResult()
        self._request.gjk_tolerance = GJK

    def __call__(self, points: Array) -> tuple[Array, Indices]:
        """Return unsigned distances (n,) of points (n, 3) and nearest faces (n,); NaN and 0 where none is known."""
        claimed, face = np.empty(len(points)), np.empty(len(points), dtype=np.int64)
        ball, moved = self._coal.Sphere(0.0), self._moved
        moved.setRotation(np.eye(3))
        for i, near in enumerate(self._near(points, points)):
            moved.setTranslation(points[i])
            claimed[i], face[i] = self._nearest(ball, near)
        return claimed, np.maximum(face, 0)

    def chords(self, start: Array, end: Array) -> Array:
        """Return unsigned distances (k,) of segments (k, 3), (k, 3) that do not meet the shell."""
        exact = np.empty(len(start))
        if not len(start):
            return exact
        length = lengths(end - start)
        frames = rotations.matrix(rotations.shortest_arc([0.0, 0.0, 1.0], (end - start) / length[:, None]))
        middle, moved = 0.5 * (start + end), self._moved
        for i, near in enumerate(self._near(np.minimum(start, end), np.maximum(start, end))):
            moved.setRotation(frames[i])
            moved.setTranslation(middle[i])
            exact[i] = self._nearest(self._coal.Capsule(0.0, length[i]), near)[0]
        return exact

    def boxes(self, corners: Array, middle: Array) -> Array:
        """Return unsigned distances (k,) of boxes round points (k, c, 3) that do not meet the shell, else 0 or less.

        Args:
            corners, middle: of each box; its axes are the principal ones of the corners.
        """
        exact = np.empty(len(corners))
        if not len(corners):
            return exact
        offset = corners - corners.mean(axis=1, keepdims=True)
        axes = np.linalg.svd(np.einsum("kci,kcj->kij", offset, offset))[2]
        axes[:, 2] = rotations.cross(axes[:, 0], axes[:, 1])  # a frame, not its mirror image
        along = np.einsum("kij,kcj->kci", axes, np.concatenate([corners, middle[:, None]], axis=1))
        low, high = along.min(axis=1), along.max(axis=1)
        centres = np.einsum("kji,kj->ki", axes, 0.5 * (low + high))
        reach = 0.5 * np.einsum("kji,kj->ki", np.abs(axes), high - low)
        sizes, moved = high - low, self._moved
        for i, near in enumerate(self._near(centres - reach, centres + reach)):
            moved.setRotation(axes[i].T)
            moved.setTranslation(centres[i])
            exact[i] = self._nearest(self._coal.Box(*sizes[i]), near)[0]
        return exact

    def _near(self, lower: Array, upper: Array) -> Iterator[list[tuple[float, int]]]:
        """Yield for each of n boxes which bundles may hold what is nearest to it, and how near it is at most.

        None is nearer than its box; and what is nearest overall is no further than the furthest corner of any.

        Args:
            lower, upper: corners of the boxes, (n, 3), m.
        """
        if len(self._bundles) == 1:
            yield from [[(0.0, 0)]] * len(lower)
            return
        for first in range(0, len(lower), BLOCK):
            low, high = lower[first : first + BLOCK], upper[first : first + BLOCK]
            some = np.arange(len(self._bundles))
            # those near the box round them all, and of these those near each: what is asked in a row lies together
            for below, above in ((low.min(axis=0)[None], high.max(axis=0)[None]), (low, high)):
                gap = np.maximum(self._lower[some] - above[:, None], below[:, None] - self._upper[some])
                span = np.maximum(self._upper[some] - below[:, None], above[:, None] - self._lower[some])
                least, most = lengths(np.maximum(gap, 0.0)), lengths(span).min(axis=1)
                near = least <= most[:, None]
                kept = near.any(axis=0)
                some, least, near = some[kept], least[:, kept], near[:, kept]
            for distance, own in zip(least, near, strict=True):
                order = np.argsort(np.where(own, distance, np.inf), kind="stable")[: np.count_nonzero(own)]
                yield list(zip(distance[order].tolist(), some[order].tolist(), strict=True))

    def _nearest(self, shape: Any, near: list[tuple[float, int]]) -> tuple[float, int]:
        """Return the distance, m, of a coal shape, where it was moved to, and the nearest face; NaN and -1 where none.

        Args:
            shape: its box was asked of :meth:`_near`.
            near: what that found.
        """
        distance, result = self._coal.distance, self._result
        best, face = math.inf, -1
        for least, k in near:
            if least > best:
                break
            result.clear()
            found = distance(shape, self._moved, self._tree(k), self._still, self._request, result)
            at = result.b1  # coal puts the mesh first, whatever the order of the arguments
            if at < 0 or math.isnan(found):
                return math.nan, -1
            if found < best:
                best, face = found, int(self._bundles[k][at])
        return best, face

    def _tree(self, k: int) -> Any:
        """Return coal's tree of a bundle, made when it is first asked."""
        if self._trees[k] is None:
            corners, faces = np.unique(self._faces[self._bundles[k]], return_inverse=True)
            model = self._coal.BVHModelOBBRSS()
            model.beginModel(len(faces), len(corners))
            model.addVertices(self._vertices[corners])
            model.addTriangles(faces.reshape(-1, 3))
            model.endModel()
            self._trees[k] = model
        return self._trees[k]


def _box(corners: Array) -> tuple[Array, Array]:
    """Return the lower and upper corner (3,), (3,) of the box round points (n, 3), m."""
    return corners.min(axis=0), corners.max(axis=0)


def closest_on_triangles(p: Array, a: Array, b: Array, c: Array) -> Array:
    """Return the point (n, 3) of each triangle ``a, b, c`` (n, 3) that is nearest to ``p`` (n, 3).

    The nearest of the feet on the three edges and, where it falls inside, on the plane. Every candidate is a
    convex combination of the corners, so slivers cannot lead it off the triangle. Ericson, Real-Time
    Collision Detection, 5.1.2 and 5.1.5.
    """
    u, v, w = b - a, c - a, p - a
    uu, uv, vv, wu, wv = (dots(x, y) for x, y in ((u, u), (u, v), (v, v), (w, u), (w, v)))
    determinant = uu * vv - uv * uv
    safe = np.where(determinant > 0, determinant, 1.0)
    beta, gamma = (vv * wu - uv * wv) / safe, (uu * wv - uv * wu) / safe
    best = a + beta[:, None] * u + gamma[:, None] * v
    inside = (determinant > 0) & (beta >= 0) & (gamma >= 0) & (beta + gamma <= 1)
    least = np.where(inside, lengths(best - p), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        edge = end - start
        square = dots(edge, edge)
        along = dots(p - start, edge) / np.where(square > 0, square, 1.0)
        foot = start + np.clip(along, 0.0, 1.0)[:, None] * edge
        distance = lengths(foot - p)
        best = np.where((distance < least)[:, None], foot, best)
        least = np.minimum(least, distance)
    return best
