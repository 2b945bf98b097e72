"""Within elements that the power series from their nodes do not span: the long, nearly straight ones of a taut cable.

Solutions near a straight, taut one grow with exp(sqrt(F / B) s) from either node, so what rounding leaves there of the
growing one swamps the series. Both nodes together fix the shape between them well: sections turn evenly, but for a
cubic correction that gives them their curvature at the nodes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from . import rotations
from .rotations import Array


@dataclass(frozen=True)
class LongElements:
    """Some elements of one or many rods, dimensionless; leading axes (...) count the rods.

    Args:
        step: their lengths, (n,).
        r: positions of their nodes, (2, ..., n, 3).
        q: quaternions there, (2, ..., n, 4).
        omega, omega_rate: Darboux vectors there, section frame, and their derivatives by arc length, (2, ..., n, 3).
    """

    step: Array
    r: Array
    q: Array
    omega: Array
    omega_rate: Array

    @property
    def _turn(self) -> Array:
        """Rotation vectors from node to node, section frame, (..., n, 3)."""
        return rotations.rotation_vector(rotations.multiply(rotations.conjugate(self.q[0]), self.q[1]))

    def sample(self, element: NDArray[np.integer], part: Array) -> tuple[Array, Array, Array]:
        """Return positions (..., N, 3), quaternions (..., N, 4) and Darboux vectors (..., N, 3).

        Args:
            element: which element, (N,).
            part: how far along it, 0 to 1, (N,).
        """
        t, h = part[:, None], self.step[element, None]
        r, q, omega, rate = (of[..., element, :] for of in (self.r, self.q, self.omega, self.omega_rate))
        turn = self._turn[..., element, :]
        bent = _cubic(t, np.zeros_like(turn), np.zeros_like(turn), h * omega[0] - turn, h * omega[1] - turn)
        even = rotations.multiply(q[0], rotations.from_rotation_vector(t * turn))
        tangent = rotations.tangent(q)
        return (
            _cubic(t, r[0], r[1], h * tangent[0], h * tangent[1]),
            rotations.multiply(even, rotations.from_rotation_vector(bent)),
            _cubic(t, omega[0], omega[1], h * rate[0], h * rate[1]),
        )

    def defects(self) -> tuple[Array, Array]:
        """Return by how much quaternions (..., n, 4) and positions (..., n, 3) of a sampled element miss the rod's.

        Simpson's rule along the element: the turning that its curvature gives less the one between its nodes, and the
            same of the displacement that its tangents give.
        """
        count = len(self.step)
        _, q, omega = self.sample(np.arange(count), np.full(count, 0.5))
        h = self.step[:, None]
        missed = self._turn - h / 6.0 * (self.omega[0] + 4.0 * omega + self.omega[1])
        tangent = rotations.tangent(self.q)
        moved = h / 6.0 * (tangent[0] + 4.0 * rotations.tangent(q) + tangent[1])
        jump = np.concatenate([np.zeros_like(missed[..., :1]), 0.5 * missed], axis=-1)
        return rotations.multiply(q, jump), self.r[1] - self.r[0] - moved


def _cubic(t: Array, first: Array, last: Array, first_slope: Array, last_slope: Array) -> Array:
    """Return the cubic Hermite polynomial at ``t`` in [0, 1]; slopes are by t."""
    u = 1.0 - t
    return u * u * ((1.0 + 2.0 * t) * first + t * first_slope) + t * t * ((1.0 + 2.0 * u) * last - u * last_slope)
