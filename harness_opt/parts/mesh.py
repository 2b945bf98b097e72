"""Triangle meshes as geometry: distances by coal, inside or outside by winding numbers.

coal sees a shell without an inside; the sign is that of the generalised winding number. What lies inside is as deep
as it is far from the outer surface of all closed pieces together; triangles within their union are no surface.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from harness_opt.errors import ProblemError
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices, lengths
from harness_opt.parts.geometry import Distances, Geometry
from harness_opt.parts.nearest import AGREE, Shell, closest_on_triangles
from harness_opt.parts.outer_surface import CLOSED_GAP, outer_surface
from harness_opt.parts.winding import FEW_FACES, Winding

# height over longest edge below which a triangle has no area: coal returns 0 anywhere on its line
FLAT_TRIANGLE = 1e-9
# of the mesh's diagonal: nearer to the surface, the way to the nearest point is rounding and has no direction
NO_DIRECTION = 1e-12


@dataclass(frozen=True, eq=False)
class Mesh(Geometry):
    """A triangle mesh.

    Args:
        shell: the triangles that have an area.
        gap: between closed pieces, below which they are one, m: files hold rounded corners.
    """

    shell: Shell
    gap: float

    @staticmethod
    def of(name: str, body: str, vertices: Array, faces: Indices, closed: bool, gap: float | None = None) -> Mesh:
        """Return the mesh of the triangles that have an area.

        Args:
            name, body, closed: as for :class:`Geometry`.
            vertices: (k, 3), m, in the body's coordinates.
            faces: (m, 3), vertex numbers, turned alike where the mesh is closed.
            gap: as for the class; what the size of ``vertices`` suggests where left out.

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
        normals = (-1.0 if inside_out else 1.0) * rotations.normalise(areas[solid])
        shell = Shell.of(vertices, faces[solid], normals)
        if gap is None:
            gap = CLOSED_GAP * float(np.abs([shell.lower, shell.upper]).max())
        return Mesh(name, body, shell.lower, shell.upper, closed, shell, gap)

    @property
    def vertices(self) -> Array:
        """The corners of the triangles, (k, 3), m, in the body's coordinates."""
        return self.shell.vertices

    @property
    def faces(self) -> Indices:
        """The triangles that have an area, (m, 3), vertex numbers."""
        return self.shell.faces

    @cached_property
    def winding(self) -> Winding:
        """What tells inside from outside where the mesh is closed: made when a point may be inside."""
        many = len(self.faces) > FEW_FACES
        return Winding.of(self.vertices, self.faces, self.shell.bundles if many else None)

    @cached_property
    def outer(self) -> Shell:
        """The triangles that depths are measured to: found when the first point turns out to be inside."""
        if not self.closed:
            return self.shell
        found = outer_surface(self.shell, self.gap)
        return self.shell if found is None else found

    def signed_distance(self, points: ArrayLike) -> Distances:
        """See :meth:`Geometry.signed_distance`."""
        points = np.atleast_2d(np.asarray(points, dtype=float))
        distance, nearest, face = self.shell.nearest(points)
        sign = self._signs(points, distance)
        normals = self.shell.normals[face]
        within = np.flatnonzero((sign < 0) | self._in_gap(points, distance))
        if len(within) and self.outer is not self.shell:
            depth, way_out, face = self.outer.nearest(points[within])
            # what is outside, but nearer to triangles that are no surface, is in a gap that counts as closed
            deep = (sign[within] < 0) | (depth > distance[within] + 2 * self.gap)
            inside = within[deep]
            sign[inside], distance[inside], nearest[inside] = -1.0, depth[deep], way_out[deep]
            normals[inside] = self.outer.normals[face[deep]]
        touching = distance <= NO_DIRECTION * (self.shell.diagonal + distance)
        gradient = (points - nearest) * (sign / np.where(touching, 1.0, distance))[:, None]
        gradient[touching] = normals[touching]
        return sign * distance, gradient, nearest

    def chord_bound(self, start: Array, end: Array, at_start: Array, at_end: Array) -> Array:
        """See :meth:`Geometry.chord_bound`.

        Exact for chords that two balls clear of the surface cover, else what follows from the ends alone.
        """
        length = lengths(end - start)
        bound = 0.5 * (at_start + at_end - length)
        outside = np.flatnonzero((at_start > 0) & (at_end > 0) & (bound > 0) & (length > 0))
        exact = self.shell.query.chords(start[outside], end[outside])
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
        boxed = self.shell.query.boxes(corners[outside], middle[outside])
        boxed = boxed - AGREE * self.shell.diagonal  # 2e-11 m too much were measured
        sane = (boxed > 0) & (boxed <= at_middle[outside] * (1 + AGREE))  # what is above, or NaN, is absurd
        bound[outside] = np.where(sane, np.maximum(boxed, bound[outside]), bound[outside])
        if not self.closed:
            bound = np.maximum(bound, 0.0)
            return bound
        rest = np.flatnonzero(at_middle <= reach)
        outer = self.outer if len(rest) else self.shell
        a, b, c = outer.vertices[outer.faces[outer.query(middle[rest])[1]]].swapaxes(0, 1)
        deepest = np.zeros(len(rest))
        for corner in corners[rest].swapaxes(0, 1):
            deepest = np.maximum(deepest, lengths(corner - closest_on_triangles(corner, a, b, c)))
        bound[rest] = np.maximum(bound[rest], -deepest)
        return bound

    def winding_number(self, points: ArrayLike) -> Array:
        """Return the generalised winding numbers (n,) of ``points`` (n, 3): +-1 inside, 0 outside."""
        return self.winding.exact(np.atleast_2d(np.asarray(points, dtype=float)))

    def _in_gap(self, points: Array, distance: Array) -> NDArray[np.bool_]:
        """Return whether points (n, 3) at unsigned ``distance`` (n,) may lie between two pieces that touch, (n,)."""
        if not self.closed:
            return np.zeros(len(points), dtype=bool)
        in_box: NDArray[np.bool_] = np.all((points > self.lower) & (points < self.upper), axis=1)
        return in_box & (distance <= self.gap)

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
            side[seed] = -1.0 if self.winding.holds(at[seed][None])[0] else 1.0
            queue = deque([seed])
            while queue and len(left):
                i = queue.popleft()
                same = lengths(at[left] - at[i]) < ball[left] + ball[i]
                side[left[same]] = side[seed]
                queue.extend(left[same])
                left = left[~same]
        sign[unsure] = side[run]
        return sign
