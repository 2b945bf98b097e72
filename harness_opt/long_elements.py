"""Within elements that the power series from their nodes do not span: the long, nearly straight ones of a taut cable.

Solutions near a straight, taut one grow with exp(sqrt(F / B) s) from either node, so what rounding leaves there of the
growing one swamps the series, and the derivatives of all curvatures too. Both nodes together fix the shape between
them well: curvatures go evenly from one to the other, and sections turn evenly, but for a cubic correction that gives
them their curvature at the nodes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from . import rotations
from .rotations import Array

PARTS = 4  # of an element, whose defects do not make up for each other


@dataclass(frozen=True)
class LongElements:
    """Some elements of one or many rods, dimensionless; leading axes (...) count the rods.

    Args:
        step: their lengths, (n,).
        r: positions of their nodes, (2, ..., n, 3).
        q: quaternions there, (2, ..., n, 4).
        omega: Darboux vectors there, section frame, (2, ..., n, 3).
    """

    step: Array
    r: Array
    q: Array
    omega: Array

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
        r, q, omega = (of[..., element, :] for of in (self.r, self.q, self.omega))
        turn = self._turn[..., element, :]
        bent = _cubic(t, np.zeros_like(turn), np.zeros_like(turn), h * omega[0] - turn, h * omega[1] - turn)
        even = rotations.multiply(q[0], rotations.from_rotation_vector(t * turn))
        tangent = rotations.tangent(q)
        return (
            _cubic(t, r[0], r[1], h * tangent[0], h * tangent[1]),
            rotations.multiply(even, rotations.from_rotation_vector(bent)),
            omega[0] + t * (omega[1] - omega[0]),
        )

    def defects(self) -> tuple[Array, Array]:
        """Return by how much quaternions (..., n, 4) and positions (..., n, 3) of a sampled element miss the rod's.

        Simpson's rule along parts of the element: the turning that its curvature gives less the one of its frames, and
            the same of the displacement that its tangents give; the largest of the turnings, times the parts.
        """
        count = len(self.step)
        places = np.linspace(0.0, 1.0, 2 * PARTS + 1)
        r, q, omega = self.sample(np.repeat(np.arange(count), len(places)), np.tile(places, count))
        split = (*q.shape[:-2], count, len(places))
        r, q, omega = r.reshape(*split, 3), q.reshape(*split, 4), omega.reshape(*split, 3)
        share = self.step[:, None, None] / (6.0 * PARTS)

        def integral(rate: Array) -> Array:
            return np.asarray(share * (rate[..., :-1:2, :] + 4.0 * rate[..., 1::2, :] + rate[..., 2::2, :]))

        turn = rotations.rotation_vector(rotations.multiply(rotations.conjugate(q[..., :-1:2, :]), q[..., 2::2, :]))
        missed = turn - integral(omega)
        worst = np.argmax(np.linalg.norm(missed, axis=-1), axis=-1)[..., None, None]
        missed = PARTS * np.take_along_axis(missed, worst, axis=-2)[..., 0, :]
        moved = np.diff(r[..., ::2, :], axis=-2) - integral(rotations.tangent(q))
        jump = np.concatenate([np.zeros_like(missed[..., :1]), 0.5 * missed], axis=-1)
        return rotations.multiply(q[..., PARTS, :], jump), moved.sum(axis=-2)


def _cubic(t: Array, first: Array, last: Array, first_slope: Array, last_slope: Array) -> Array:
    """Return the cubic Hermite polynomial at ``t`` in [0, 1]; slopes are by t."""
    u = 1.0 - t
    return u * u * ((1.0 + 2.0 * t) * first + t * first_slope) + t * t * ((1.0 + 2.0 * u) * last - u * last_slope)
