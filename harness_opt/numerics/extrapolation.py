"""Predicting the next point of a path from the last ones: polynomials of the degree that would have predicted best.

Deuflhard, "Newton Methods for Nonlinear Problems", section 5.1, treats the tangent and the secant; the higher degrees
and their choice are those of the multistep methods (Hairer, Norsett, Wanner I, section III.7).
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from harness_opt.numerics.rotations import Array

MOST_DEGREE = 6  # beyond, what rounding and the solver leave in the points grows faster than the prediction gains


@dataclass(frozen=True, eq=False)
class Trail:
    """The last points of a path.

    Args:
        points: newest first, each (m,).
        steps: lengths of the steps that led to the points, newest first, in any one unit; one fewer than points.
        degree: of the polynomial for the next point, at least 0 and fewer than there are points.
    """

    points: tuple[Array, ...]
    steps: tuple[float, ...] = ()
    degree: int = 0

    def predictions(self, length: float) -> Array:
        """Return what each degree from 0 predicts a step of ``length`` further on, (degrees, m)."""
        return _extrapolation(self.steps, length) @ np.array(self.points)

    def extended(self, point: Array, length: float, predictions: Array) -> Trail:
        """Return the trail with ``point`` (m,), found ``length`` further on, where :meth:`predictions` were made."""
        best = int(np.abs(predictions - point).max(axis=1).argmin())
        kept = self.points[:MOST_DEGREE]
        # where the highest degree did best, one more may do better yet
        degree = max(1, best + 1 if best == len(self.points) - 1 else best)
        return Trail((point, *kept), (length, *self.steps[: len(kept) - 1]), min(degree, len(kept)))


@functools.lru_cache(maxsize=64)  # frames follow each other evenly
def _extrapolation(steps: tuple[float, ...], length: float) -> Array:
    """Return the weights of the points for each degree, (degrees, points): Lagrange's formula, ``length`` beyond the
    newest."""
    distances = [length]  # from the points to where is predicted
    for step in steps:
        distances.append(distances[-1] + step)
    row, rows = [1.0], [[1.0] + [0.0] * len(steps)]
    for degree, far in enumerate(distances[1:], 1):
        newest = 1.0
        for i, near in enumerate(distances[:degree]):
            row[i] *= far / (far - near)
            newest *= near / (near - far)
        row.append(newest)
        rows.append(row + [0.0] * (len(steps) - degree))
    return np.array(rows)
