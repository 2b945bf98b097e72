"""Parts as geometry that answers distances of points.

Everything is in the coordinates of the part's body, in metres. Distances are positive outside and negative inside.
"""

from __future__ import annotations

import abc
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import lengths

Distances = tuple[Array, Array, Array]


@dataclass(frozen=True, eq=False)
class Geometry(abc.ABC):
    """One part in the coordinates of its body.

    Args:
        name, body: as in the problem.
        lower, upper: corners of the box along the body's axes that holds the part, m, (3,).
        closed: False for an open mesh, a shell without an inside, whose distances are never negative.
    """

    name: str
    body: str
    lower: Array
    upper: Array
    closed: bool

    @abc.abstractmethod
    def signed_distance(self, points: ArrayLike) -> Distances:
        """Return distance (n,), gradient (n, 3) and nearest surface point (n, 3) of ``points`` (n, 3), m.

        The gradient is the unit vector along which the distance grows; on the surface the outward normal.
        """

    def lower_bound(self, points: ArrayLike) -> Array:
        """Return numbers (...) that :meth:`signed_distance` of ``points`` (..., 3) is never below, m; cheap.

        The part lies in its box, so its signed distance is at least that of the box, inside the box too.
        """
        half = 0.5 * (self.upper - self.lower)
        beyond = np.abs(np.asarray(points) - 0.5 * (self.upper + self.lower)) - half
        bound = lengths(np.maximum(beyond, 0.0)) + np.minimum(beyond.max(axis=-1), 0.0)
        capped: Array = bound if self.closed else np.maximum(bound, 0.0)
        return capped

    @abc.abstractmethod
    def chord_bound(self, start: Array, end: Array, at_start: Array, at_end: Array) -> Array:
        """Return numbers (k,) that the signed distance is never below along straight chords, m.

        Args:
            start, end: (k, 3), m.
            at_start, at_end: (k,), bounds below the signed distances there, m.
        """

    @abc.abstractmethod
    def hull_bound(self, corners: Array, middle: Array, at_middle: Array) -> Array:
        """Return numbers (k,) that the signed distance is never below in convex hulls, m.

        Args:
            corners: (k, c, 3), of each hull, m.
            middle: (k, 3), points inside the hulls, m.
            at_middle: (k,), their signed distances, m.
        """
