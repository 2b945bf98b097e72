"""Triangle meshes as geometry: distances by coal, inside or outside by winding numbers.

A ball of radius 0 against coal's tree of triangles is exact (1e-16 m measured), and so is a capsule of radius
0 that stays clear of the surface (7e-7 m with coal's own tolerance, 3e-15 with :data:`GJK`). Thicker capsules
are wrong where they penetrate, by 6e-4 m at a radius of 1 mm, or infinite in a triangle's plane: so only
centrelines are asked. coal sees a shell without an inside; the sign is that of the generalised winding
number. coal is imported when the first mesh is made.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from harness_opt.errors import ProblemError
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices, dots, lengths
from harness_opt.parts.geometry import Distances, Geometry
from harness_opt.parts.orientation import PAIRS_AT_A_TIME, winding_numbers

# height over longest edge below which a triangle has no area: coal returns 0 anywhere on its line
FLAT_TRIANGLE = 1e-9
# of the mesh's diagonal: largest difference between coal's answer and the exact one on its triangle
AGREE = 1e-9
# of the mesh's diagonal: nearer to the surface, the way to the nearest point is rounding and has no direction
NO_DIRECTION = 1e-12
GJK = 1e-9  # tolerance of coal's iteration between a segment and a triangle; its own is 1e-6
FEW_FACES = 5_000  # up to here a winding number is summed triangle by triangle
DIPOLE_FROM = 2.5  # radii of a cluster beyond which it is a dipole: wrong by 0.03 turns at most where measured
WHOLE = 0.2  # turns: a sum of dipoles this near to a whole number is taken for it, else every triangle is summed


@dataclass(frozen=True, eq=False)
class Mesh(Geometry):
    """A triangle mesh. Where closed pieces of it overlap, a depth is that below the nearest surface of any of them.

    Args:
        vertices: (k, 3), m, in the body's coordinates.
        faces: (m, 3), vertex numbers.
        areas: (m, 3), twice the area vectors, as the file turns its faces, m2.
        normals: (m, 3), unit, outward where the mesh is closed.
        query: coal's tree of the same triangles.
        clusters: of the triangles of a large closed mesh, else None.
    """

    vertices: Array
    faces: Indices
    areas: Array
    normals: Array
    query: _CoalQuery = field(repr=False)
    clusters: _Clusters | None = field(repr=False)

    @staticmethod
    def of(name: str, body: str, vertices: Array, faces: Indices, closed: bool) -> Mesh:
        """Return the mesh of the triangles that have an area.

        Args:
            name, body, closed: as for :class:`Geometry`.
            vertices: (k, 3), m, in the body's coordinates.
            faces: (m, 3), vertex numbers, turned alike where the mesh is closed.

        Raises:
            ProblemError: no triangle has an area.
        """
        a, b, c = vertices[faces].swapaxes(0, 1)
        areas = np.cross(b - a, c - a)
        longest = np.max([lengths(b - a), lengths(c - b), lengths(a - c)], axis=0)
        solid = lengths(areas) > FLAT_TRIANGLE * longest**2
        if not np.any(solid):
            raise ProblemError(f"parts.{name}.mesh: found only triangles without area, expected a surface")
        # the volume tells whether a closed mesh is inside out
        inside_out = closed and np.einsum("mi,mi->", a - a[0], np.cross(b - a[0], c - a[0])) < 0
        faces, areas = np.ascontiguousarray(faces[solid]), areas[solid]
        used = vertices[np.unique(faces)]
        return Mesh(
            name=name,
            body=body,
            lower=used.min(axis=0),
            upper=used.max(axis=0),
            closed=closed,
            vertices=vertices,
            faces=faces,
            areas=areas,
            normals=(-1.0 if inside_out else 1.0) * rotations.normalise(areas),
            query=_CoalQuery(vertices, faces),
            clusters=_Clusters.of(vertices[faces], areas) if closed and len(faces) > FEW_FACES else None,
        )

    def signed_distance(self, points: ArrayLike) -> Distances:
        """See :meth:`Geometry.signed_distance`."""
        points = np.atleast_2d(np.asarray(points, dtype=float))
        diagonal = float(np.linalg.norm(self.upper - self.lower))
        claimed, face = self.query(points)
        nearest = closest_on_triangles(points, *self.vertices[self.faces[face]].swapaxes(0, 1))
        offset = points - nearest
        distance = lengths(offset)
        # NaN compares false, so what is not surely right is asked again, of every triangle
        scale = diagonal + distance
        for i in np.flatnonzero(~(np.abs(claimed - distance) <= AGREE * scale)):
            nearest[i], face[i] = self._nearest_of_all(points[i])
            offset[i] = points[i] - nearest[i]
            distance[i] = np.linalg.norm(offset[i])
        sign = self._signs(points, distance)
        touching = distance <= NO_DIRECTION * scale
        gradient = offset * (sign / np.where(touching, 1.0, distance))[:, None]
        gradient[touching] = self.normals[face[touching]]
        return sign * distance, gradient, nearest

    def chord_bound(self, start: Array, end: Array, at_start: Array, at_end: Array) -> Array:
        """See :meth:`Geometry.chord_bound`.

        Exact for chords that two balls clear of the surface cover, else what follows from the ends alone.
        """
        length = lengths(end - start)
        bound = 0.5 * (at_start + at_end - length)
        outside = np.flatnonzero((at_start > 0) & (at_end > 0) & (bound > 0) & (length > 0))
        exact = self.query.chords(start[outside], end[outside])
        highest = np.minimum(at_start, at_end)[outside] + length[outside]  # what is above, or NaN, is absurd
        bound[outside] = np.where((exact > bound[outside]) & (exact <= highest), exact, bound[outside])
        return bound

    def hull_bound(self, corners: Array, middle: Array, at_middle: Array) -> Array:
        """See :meth:`Geometry.hull_bound`.

        Outside, the distance of a box round the hull, which is exact for a flat hull. Inside, no point is deeper
        than it is far from the one triangle that is nearest to the middle: that distance is convex, so it is
        largest at a corner.
        """
        reach = lengths(corners - middle[:, None]).max(axis=1)
        bound: Array = at_middle - reach
        outside = np.flatnonzero(at_middle > 0)
        boxed = self.query.boxes(corners[outside], middle[outside])
        boxed = boxed - AGREE * np.linalg.norm(self.upper - self.lower)  # 2e-11 m too much were measured
        sane = (boxed > 0) & (boxed <= at_middle[outside] * (1 + AGREE))  # what is above, or NaN, is absurd
        bound[outside] = np.where(sane, np.maximum(boxed, bound[outside]), bound[outside])
        if not self.closed:
            bound = np.maximum(bound, 0.0)
            return bound
        rest = np.flatnonzero(at_middle <= reach)
        face = self.query(middle[rest])[1]
        a, b, c = self.vertices[self.faces[face]].swapaxes(0, 1)
        deepest = np.zeros(len(rest))
        for corner in corners[rest].swapaxes(0, 1):
            deepest = np.maximum(deepest, lengths(corner - closest_on_triangles(corner, a, b, c)))
        bound[rest] = np.maximum(bound[rest], -deepest)
        return bound

    def winding_number(self, points: ArrayLike) -> Array:
        """Return the generalised winding numbers (n,) of ``points`` (n, 3): +-1 inside, 0 outside."""
        points = np.atleast_2d(np.asarray(points, dtype=float))
        return winding_numbers(points, self.vertices[self.faces], self.areas)

    def _holds(self, point: Array) -> bool:
        """Whether ``point`` (3,), off the surface, is inside the closed mesh.

        Large meshes are summed by clusters, the far ones as dipoles: Barill et al., "Fast winding numbers for
        soups and clouds", ACM Trans. Graph. 37 (2018), with one level of clusters. The true number is whole:
        so the sum itself shows whether that was good enough.
        """
        clusters = self.clusters
        if clusters is not None:
            offset = clusters.centre - point
            distance = lengths(offset)
            near = distance < DIPOLE_FROM * clusters.radius
            dipoles = dots(clusters.area, offset)[~near] / distance[~near] ** 3
            turns = np.sum(dipoles) / (4 * np.pi)
            faces = [clusters.members[k] for k in np.flatnonzero(near)]
            if faces:
                some = np.concatenate(faces)
                turns += winding_numbers(point[None], self.vertices[self.faces[some]], self.areas[some])[0]
            if abs(turns - round(turns)) < WHOLE:
                return round(turns) != 0
        return bool(abs(self.winding_number(point)[0]) > 0.5)

    def _signs(self, points: Array, distance: Array) -> Array:
        """Return +1.0 outside and -1.0 inside (n,) for points at unsigned ``distance`` (n,).

        A ball about an inside point that misses the surface lies in the part, hence in its box: it is no
        larger than half the shortest side. Two points whose balls overlap lie on the same side, so few need a
        winding number.
        """
        sign = np.ones(len(points))
        if not self.closed:
            return sign
        inside_box = np.all((points > self.lower) & (points < self.upper), axis=1)
        unsure = np.flatnonzero(inside_box & (distance <= 0.5 * np.min(self.upper - self.lower)))
        if not len(unsure):
            return sign
        # runs of points that follow each other, each standing for all of its own by its largest ball
        at, ball = points[unsure], distance[unsure]
        parted = lengths(np.diff(at, axis=0)) >= ball[1:] + ball[:-1]
        run = np.concatenate([[0], np.cumsum(parted)])
        order = np.lexsort((-ball, run))
        leader = order[np.unique(run[order], return_index=True)[1]]
        at, ball = at[leader], ball[leader]
        side = np.ones(len(leader))
        left = np.argsort(-ball, kind="stable")
        while len(left):
            seed, left = left[0], left[1:]
            side[seed] = -1.0 if self._holds(at[seed]) else 1.0
            queue = deque([seed])
            while queue and len(left):
                i = queue.popleft()
                same = lengths(at[left] - at[i]) < ball[left] + ball[i]
                side[left[same]] = side[seed]
                queue.extend(left[same])
                left = left[~same]
        sign[unsure] = side[run]
        return sign

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


@dataclass(frozen=True, eq=False)
class _Clusters:
    """Neighbouring triangles, k times: face numbers, area vectors (k, 3), m2, and balls about them."""

    members: tuple[Indices, ...]
    area: Array
    centre: Array
    radius: Array

    @staticmethod
    def of(corners: Array, areas: Array) -> _Clusters:
        """Split faces (m, 3, 3), (m, 3) at the median along the longest side, into about sqrt(m) clusters."""
        middle = corners.mean(axis=1)
        members = [np.arange(len(areas))]
        for _ in range(round(0.5 * math.log2(len(areas)))):
            along = [middle[group, np.argmax(np.ptp(middle[group], axis=0))] for group in members]
            members = [
                half
                for group, x in zip(members, along, strict=True)
                for half in np.array_split(group[np.argpartition(x, len(x) // 2)], 2)
            ]
        weights = lengths(areas)
        centre = np.array([np.average(middle[group], axis=0, weights=weights[group]) for group in members])
        radius = [lengths(corners[group] - at).max() for group, at in zip(members, centre, strict=True)]
        area = np.array([0.5 * areas[group].sum(axis=0) for group in members])
        return _Clusters(tuple(members), area, centre, np.array(radius))


class _CoalQuery:
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
