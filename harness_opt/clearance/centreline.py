"""Centrelines between their stations, and how near arcs of them can come.

Between stations the centreline is the cubic through positions and tangents. What is known of an arc beyond
its ends is its length: it bounds the ball that holds it (:func:`balls`) and how far it strays from its chord
(:func:`sag`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices, dots, lengths

FRAMES = 500  # that are looked at as a whole at a time: each takes some 30 kB meanwhile


@dataclass(frozen=True, eq=False)
class Curve:
    """Centrelines of one cable in P frames: cubics through N stations.

    Args:
        s: (N,), m.
        position: (P, N, 3), m.
        tangent: (P, N, 3), d3.
    """

    s: Array
    position: Array
    tangent: Array

    def at(self, frame: Indices, s: Array) -> Array:
        """Return the points (k, 3), m, of frames (k,) at arc lengths (k,), m, on the Hermite cubic.

        Its error between stations h apart is ``(h / 2)^4 / 4!`` times the fourth derivative at most.
        """
        j, h, x = self._place(s)
        p, q = self.position[frame, j], self.position[frame, j + 1]
        return hermite(h, x, p, q, self.tangent[frame, j], self.tangent[frame, j + 1])

    def grid(self, s: Array) -> Array:
        """Return the points (P, M, 3), m, of all frames at arc lengths (M,), m; not to be written to."""
        if np.array_equal(s, self.s):
            return self.position
        points = np.empty((len(self.position), len(s), 3))
        for some in in_blocks(np.arange(len(points))):
            points[some] = self.at(np.repeat(some, len(s)), np.tile(s, len(some))).reshape(len(some), len(s), 3)
        return points

    def slope(self, frame: Indices, s: Array) -> Array:
        """Return the derivatives (k, 3) of :meth:`at` along the arc; unit vectors up to third order."""
        j, h, x = self._place(s)
        y = 1.0 - x
        step = (self.position[frame, j + 1] - self.position[frame, j]) / h[:, None]
        u, v = self.tangent[frame, j], self.tangent[frame, j + 1]
        return (6 * x * y)[:, None] * step + (y * (1 - 3 * x))[:, None] * u + (x * (1 - 3 * y))[:, None] * v

    def seen_from(self, position: Array, quaternion: Array) -> Curve:
        """Return the curve in the coordinates of a body that stands at poses (P, 3), (P, 4)."""
        seen = Curve(self.s, np.empty_like(self.position), np.empty_like(self.tangent))
        for some in in_blocks(np.arange(len(self.position))):
            back = rotations.conjugate(quaternion[some])[:, None]
            seen.position[some] = rotations.rotate(back, self.position[some] - position[some, None])
            seen.tangent[some] = rotations.rotate(back, self.tangent[some])
        return seen

    def _place(self, s: Array) -> tuple[Indices, Array, Array]:
        """Return the intervals (k,) that hold ``s`` (k,), their lengths, m, and the shares before ``s``."""
        j = np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, len(self.s) - 2)
        h = self.s[j + 1] - self.s[j]
        return j, h, (s - self.s[j]) / h


def in_blocks(frames: Indices) -> Iterator[Indices]:
    """Yield frames (k,) some at a time, so that what is worked on together takes bounded memory."""
    for first in range(0, len(frames), FRAMES):
        yield frames[first : first + FRAMES]


def hermite(h: Array, x: Array, p: Array, q: Array, u: Array, v: Array) -> Array:
    """Return points (k, 3) at shares ``x`` (k,) of cubics from p to q (k, 3) with slopes u and v over ``h`` (k,)."""
    y = 1.0 - x
    ends = (y * y * (1 + 2 * x))[:, None] * p + (x * x * (1 + 2 * y))[:, None] * q
    return ends + (h * x * y)[:, None] * (y[:, None] * u - x[:, None] * v)


def closest_on_segments(p: Array, u: Array, q: Array, v: Array) -> tuple[Array, Array]:
    """Return shares x, y (k,) in 0 to 1 so that ``p + x u`` and ``q + y v`` (k, 3) are nearest to each other.

    Ericson, Real-Time Collision Detection, 5.1.9; where segments are parallel one of many answers, and points
    (zero ``u`` or ``v``) are allowed.
    """
    w = p - q
    a, e, b, c, f = (dots(i, j) for i, j in ((u, u), (v, v), (u, v), (u, w), (v, w)))
    determinant = a * e - b * b
    # relative: below this the cross product of u and v is rounding, and any x on the overlap is as good
    skew = determinant > 1e-14 * a * e
    x = np.where(skew, np.clip((b * f - c * e) / np.where(skew, determinant, 1.0), 0.0, 1.0), 0.0)
    y = (b * x + f) / np.where(e > 0, e, 1.0)
    clipped = np.clip(y, 0.0, 1.0)
    again = np.clip((b * clipped - c) / np.where(a > 0, a, 1.0), 0.0, 1.0)
    return np.where((clipped != y) | (e == 0), again, x), clipped


def balls(s: Array, position: Array) -> tuple[Array, Array]:
    """Return centres (P, N-1, 3) and radii (P, N-1) of balls that hold the arcs between stations.

    From the mean of the two distances to the ends of an arc of length h, squared: ``h^2 / 2 - chord^2 / 4``.
    """
    h, chord = np.diff(s), lengths(np.diff(position, axis=1))
    centre = 0.5 * (position[:, 1:] + position[:, :-1])
    return centre, np.sqrt(np.maximum(0.5 * h * h - 0.25 * chord * chord, 0.25 * chord * chord))


def sag(arc: ArrayLike, chord: ArrayLike) -> Array:
    """Return how far (k,), m, an arc of length ``arc`` (k,) strays at most from its ``chord`` (k,), m.

    A point of the arc at the share x of it lies within ``sqrt(x (1 - x) (arc^2 - chord^2))`` of the chord's
    point at the same share: Stewart's theorem on the two balls, about the arc's ends, that hold it.
    """
    arc, chord = np.asarray(arc), np.asarray(chord)
    found: Array = 0.5 * np.sqrt(np.maximum(arc * arc - chord * chord, 0.0))
    return found
