"""The nearest of many triangles: asked of coal, and checked.

A ball of radius 0 against coal's tree of triangles is exact (1e-16 m measured), and so is a capsule of radius
0 that stays clear of the surface (7e-7 m with coal's own tolerance, 3e-15 with :data:`GJK`). Thicker capsules
are wrong where they penetrate, by 6e-4 m at a radius of 1 mm, or infinite in a triangle's plane: so only
centrelines are asked. coal sees a shell without an inside. It is imported when the first mesh is made.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices, dots, lengths
from harness_opt.parts.orientation import PAIRS_AT_A_TIME

# of the mesh's diagonal: largest difference between coal's answer and the exact one on its triangle
AGREE = 1e-9
GJK = 1e-9  # tolerance of coal's iteration between a segment and a triangle; its own is 1e-6


@dataclass(frozen=True, eq=False)
class Shell:
    """Triangles, and the one of them nearest to a point.

    Args:
        vertices: (k, 3), m.
        faces: (m, 3), vertex numbers; each face has an area.
        normals: (m, 3), unit, outward where the triangles have an inside.
        diagonal: of the box that holds them, m.
        query: coal's tree of the same triangles.
    """

    vertices: Array
    faces: Indices
    normals: Array
    diagonal: float
    query: CoalQuery = field(repr=False)

    @staticmethod
    def of(vertices: Array, faces: Indices, normals: Array) -> Shell:
        """Return the triangles with coal's tree; arguments as for the class."""
        faces = np.ascontiguousarray(faces)
        diagonal = float(np.linalg.norm(np.ptp(vertices[np.unique(faces)], axis=0)))
        return Shell(vertices, faces, normals, diagonal, CoalQuery(vertices, faces))

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
    """Distances of points and segments to a triangle shell; coal's request and result are made once."""

    def __init__(self, vertices: Array, faces: Indices):
        import coal

        self._coal = coal
        self._model = coal.BVHModelOBBRSS()
        self._model.beginModel(len(faces), len(vertices))
        self._model.addVertices(vertices)
        self._model.addTriangles(faces)
        self._model.endModel()
        self._still, self._moved = coal.Transform3s.Identity(), coal.Transform3s.Identity()
        self._request, self._result = coal.DistanceRequest(), coal.DistanceResult()
        self._request.gjk_tolerance = GJK

    def __call__(self, points: Array) -> tuple[Array, Indices]:
        """Return unsigned distances (n,) of points (n, 3) and nearest faces (n,); NaN and 0 where none."""
        claimed, face = np.empty(len(points)), np.empty(len(points), dtype=np.int64)
        ball, distance, moved, result = self._coal.Sphere(0.0), self._coal.distance, self._moved, self._result
        moved.setRotation(np.eye(3))
        for i, point in enumerate(points):
            moved.setTranslation(point)
            result.clear()
            claimed[i] = distance(ball, moved, self._model, self._still, self._request, result)
            face[i] = result.b1  # coal puts the mesh first, whatever the order of the arguments
        claimed[face < 0] = np.nan
        return claimed, np.maximum(face, 0)

    def chords(self, start: Array, end: Array) -> Array:
        """Return unsigned distances (k,) of segments (k, 3), (k, 3) that do not meet the shell."""
        exact = np.empty(len(start))
        if not len(start):
            return exact
        length = lengths(end - start)
        frames = rotations.matrix(rotations.shortest_arc([0.0, 0.0, 1.0], (end - start) / length[:, None]))
        distance, moved, result = self._coal.distance, self._moved, self._result
        for i, middle in enumerate(0.5 * (start + end)):
            needle = self._coal.Capsule(0.0, length[i])
            moved.setRotation(frames[i])
            moved.setTranslation(middle)
            result.clear()
            exact[i] = distance(needle, moved, self._model, self._still, self._request, result)
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
        distance, moved, result = self._coal.distance, self._moved, self._result
        for i, size in enumerate(high - low):
            box = self._coal.Box(*size)
            moved.setRotation(axes[i].T)
            moved.setTranslation(centres[i])
            result.clear()
            exact[i] = distance(box, moved, self._model, self._still, self._request, result)
        return exact


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
