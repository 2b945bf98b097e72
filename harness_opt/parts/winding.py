"""Whether points lie inside a closed triangle mesh: generalised winding numbers, of large meshes by clusters."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices, dots, lengths
from harness_opt.parts.orientation import winding_numbers

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
    def of(vertices: Array, faces: Indices, areas: Array) -> Winding:
        """Return the winding numbers of triangles, arguments as for the class."""
        return Winding(vertices, faces, areas, Clusters.of(vertices[faces], areas) if len(faces) > FEW_FACES else None)

    def exact(self, points: Array) -> Array:
        """Return the winding numbers (n,) of ``points`` (n, 3), m, every triangle summed."""
        return winding_numbers(points, self.vertices[self.faces], self.areas)

    def turns(self, points: Array) -> Array:
        """Return the winding numbers (n,) of ``points`` (n, 3), m, which lie off the surface; whole numbers."""
        if self.clusters is None:
            return np.rint(self.exact(points))
        return np.array([self._turns(self.clusters, point) for point in points])

    def holds(self, points: Array) -> NDArray[np.bool_]:
        """Return whether ``points`` (n, 3), m, off the surface, are inside (n,): whether their number is not 0."""
        held: NDArray[np.bool_] = self.turns(points) != 0
        return held

    def _turns(self, clusters: Clusters, point: Array) -> float:
        """Return the winding number of one point (3,), m."""
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
            return float(round(turns))
        return float(np.rint(self.exact(point[None])[0]))


@dataclass(frozen=True, eq=False)
class Clusters:
    """Neighbouring triangles, k times: face numbers, area vectors (k, 3), m2, and balls about them."""

    members: tuple[Indices, ...]
    area: Array
    centre: Array
    radius: Array

    @staticmethod
    def of(corners: Array, areas: Array) -> Clusters:
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
        return Clusters(tuple(members), area, centre, np.array(radius))
