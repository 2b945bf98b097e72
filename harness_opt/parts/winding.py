"""Whether points lie inside a closed triangle mesh: generalised winding numbers, of large meshes by clusters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices, dots, lengths
from harness_opt.parts.orientation import PAIRS_AT_A_TIME, winding_numbers

FEW_FACES = 5_000  # up to here a winding number is summed triangle by triangle
DIPOLE_FROM = 2.5  # radii of a cluster beyond which it is a dipole: wrong by 0.03 turns at most where measured
WHOLE = 0.2  # turns: a sum of dipoles this near to a whole number is taken for it, else every triangle is summed


@dataclass(frozen=True, eq=False)
class Winding:
    """The winding numbers of closed triangles.

    Large meshes are summed by clusters, the far ones as dipoles: Barill et al., "Fast winding numbers for soups and
    clouds", ACM Trans. Graph. 37 (2018), with one level of clusters. The true number is whole: so the sum itself
    shows whether that was good enough.

    Args:
        vertices: (k, 3), m.
        faces: (m, 3), vertex numbers; every edge is run through as often one way as the other.
        areas: (m, 3), twice the area vectors, m2.
        clusters: of the triangles where there are many, else None.
    """

    vertices: Array
    faces: Indices
    areas: Array
    clusters: Clusters | None = field(repr=False)

    @staticmethod
    def of(vertices: Array, faces: Indices, members: Sequence[Indices] | None = None) -> Winding:
        """Return the winding numbers of triangles, by clusters where ``members`` are given; others as the class."""
        a, b, c = (vertices[faces[:, k]] for k in range(3))
        areas = np.cross(b - a, c - a)
        clusters = None if members is None else Clusters.of(vertices, faces, areas, members)
        return Winding(vertices, faces, areas, clusters)

    def exact(self, points: Array) -> Array:
        """Return the winding numbers (n,) of ``points`` (n, 3), m, every triangle summed."""
        turns = np.zeros(len(points))
        for first in range(0, len(self.faces), PAIRS_AT_A_TIME):
            some = slice(first, first + PAIRS_AT_A_TIME)
            turns += winding_numbers(points, self.vertices[self.faces[some]], self.areas[some])
        return turns

    def turns(self, points: Array) -> Array:
        """Return the winding numbers (n,) of ``points`` (n, 3), m, which lie off the surface; whole numbers."""
        if self.clusters is None:
            return np.rint(self.exact(points))
        step = max(1, PAIRS_AT_A_TIME // len(self.clusters.members))
        blocks = [self._turns(self.clusters, points[first : first + step]) for first in range(0, len(points), step)]
        return np.concatenate([np.zeros(0), *blocks])

    def holds(self, points: Array) -> NDArray[np.bool_]:
        """Return whether ``points`` (n, 3), m, off the surface, are inside (n,): whether their number is not 0."""
        held: NDArray[np.bool_] = self.turns(points) != 0
        return held

    def _turns(self, clusters: Clusters, points: Array) -> Array:
        """Return the winding numbers (n,) of ``points`` (n, 3), m, not many at once."""
        offset = clusters.centre - points[:, None]
        distance = lengths(offset)
        near = distance < DIPOLE_FROM * clusters.radius
        dipoles = dots(clusters.area, offset) / np.where(near, np.inf, distance) ** 3
        turns = dipoles.sum(axis=1) / (4 * np.pi)
        if len(points) == 1:  # all near clusters in one
            groups = [np.concatenate([clusters.members[k] for k in np.flatnonzero(near[0])])] if np.any(near) else []
            asked = [np.zeros(1, dtype=np.int64)] * len(groups)
        else:
            groups = list(clusters.members)
            asked = [np.flatnonzero(column) for column in near.T]
        for some, who in zip(groups, asked, strict=True):
            if len(who):
                turns[who] += winding_numbers(points[who], self.vertices[self.faces[some]], self.areas[some])
        doubtful = np.abs(turns - np.rint(turns)) >= WHOLE
        if np.any(doubtful):
            turns[doubtful] = self.exact(points[doubtful])
        whole: Array = np.rint(turns)
        return whole


@dataclass(frozen=True, eq=False)
class Clusters:
    """Neighbouring triangles, k times: face numbers, area vectors (k, 3), m2, and balls about them."""

    members: tuple[Indices, ...]
    area: Array
    centre: Array
    radius: Array

    @staticmethod
    def of(vertices: Array, faces: Indices, areas: Array, members: Sequence[Indices]) -> Clusters:
        """Return clusters of faces (m, 3) with ``areas`` (m, 3), m2; others as the class."""
        balls = [_ball(vertices[faces[group]], lengths(areas[group])) for group in members]
        area = np.array([0.5 * areas[group].sum(axis=0) for group in members])
        return Clusters(tuple(members), area, np.array([at for at, _ in balls]), np.array([r for _, r in balls]))


def _ball(corners: Array, weights: Array) -> tuple[Array, float]:
    """Return the centroid (3,) of triangles (k, 3, 3), m, with such areas, and the radius about it that holds them."""
    centre = np.average(corners.mean(axis=1), axis=0, weights=weights)
    return centre, float(lengths(corners - centre).max())
