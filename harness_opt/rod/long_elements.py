"""Within elements that the power series from their nodes do not span: the long ones of a taut or much twisted cable.

Solutions near a straight, taut one grow with exp(sqrt(F / B) s) from either node, so what rounding leaves there of the
growing one swamps the series. Their first terms are good, and both nodes together fix the shape between them well: what
sections turn besides an even turn from node to node, positions and the Darboux vector are the Hermite polynomials that
have as many of these terms at both nodes as rounding leaves.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness_opt.numerics import rotations
from harness_opt.numerics.quadrature import gauss
from harness_opt.numerics.rotations import Array

# derivatives of the frames at a node, and up to how many growth lengths of an element they are good: each further one
# has its rounding, and what the collocation misses, times half of these lengths
DERIVATIVES = ((3, 30.0), (2, 1000.0), (1, np.inf))
TERMS = 1 + DERIVATIVES[0][0]  # of a power series that are used


def derivatives(lengths: Array) -> NDArray[np.intp]:
    """Return how many derivatives of the frames elements of so many growth ``lengths`` (n,) take from their nodes."""
    counts, most = zip(*DERIVATIVES, strict=True)
    return np.asarray(counts)[np.searchsorted(most, lengths)]


@dataclass(frozen=True)
class LongElements:
    """Some elements of one or many rods, dimensionless; leading axes (...) count the rods.

    Args:
        step: their lengths, (n,).
        order: how many derivatives of the frames count, 1 to TERMS - 1, (n,).
        r, q, omega: the first TERMS coefficients of the power series of positions, quaternions and Darboux vectors
            (section frame) about their first and last nodes, (2, TERMS, ..., n, 3 or 4).
    """

    step: Array
    order: NDArray[np.intp]
    r: Array
    q: Array
    omega: Array

    @functools.cached_property
    def _turn(self) -> Array:
        """Rotation vectors from node to node, section frame, (..., n, 3)."""
        first, last = self.q[:, 0]
        return rotations.rotation_vector(rotations.multiply(rotations.conjugate(first), last))

    @functools.cached_property
    def _besides(self) -> Array:
        """The coefficients, by parts of an element, of what frames turn besides evenly, (2, TERMS, ..., n, 4)."""
        own = self._by_parts(rotations.multiply(rotations.conjugate(self.q[:, :1]), self.q))
        back = np.concatenate([np.zeros_like(self._turn[..., :1]), -0.5 * self._turn], axis=-1)
        even = [np.broadcast_to(rotations.IDENTITY, back.shape)]
        for k in range(1, TERMS):
            even.append(rotations.multiply(even[-1], back) / k)
        products = [sum(rotations.multiply(even[j], own[:, k - j]) for j in range(k + 1)) for k in range(TERMS)]
        return np.stack(products, axis=1)

    def _by_parts(self, coefficients: Array) -> Array:
        """Return coefficients (2, TERMS, ..., n, c) of powers of arc length as those of powers of parts of elements."""
        powers = self.step ** np.arange(TERMS)[:, None]
        return coefficients * powers.reshape(TERMS, *(1,) * (coefficients.ndim - 4), len(self.step), 1)

    def sample(self, element: NDArray[np.integer], part: Array) -> tuple[Array, Array, Array]:
        """Return positions (..., N, 3), quaternions (..., N, 4) and Darboux vectors (..., N, 3).

        Args:
            element: which element, (N,).
            part: how far along it, 0 to 1, (N,).
        """
        order = self.order[element]
        weights, fewer = _weights(part, order), _weights(part, order - 1)

        def between(coefficients: Array, weights: Array) -> Array:
            values: Array = np.einsum("ekN,ek...Nc->...Nc", weights, coefficients[..., element, :])
            return values

        even = rotations.from_rotation_vector(part[:, None] * self._turn[..., element, :])
        besides = rotations.normalise(between(self._besides, weights))
        return (
            between(self._by_parts(self.r), weights),
            rotations.multiply(rotations.multiply(self.q[0, 0][..., element, :], even), besides),
            between(self._by_parts(self.omega), fewer),
        )

    def defects(self) -> tuple[Array, Array, Array]:
        """Return by how much quaternions (..., n, 4) and positions (..., n, 3) of a sampled element miss the rod's.

        Along parts of the element, what frames turn less what their Darboux vectors give, and the same of positions
        and tangents; the largest of the turnings, times the parts, and all displacements.

        And the moment of the tangents about the element's middle, int (s - middle) d3 ds, (..., n, 3).
        """
        parts = 4  # of an element, whose defects do not make up for each other
        gauss_points = 5  # Gauss points in each: exact beyond the polynomials' own degree
        count, rule = len(self.step), gauss(gauss_points)
        edges = np.arange(parts + 1) / parts
        places = np.concatenate([edges, (edges[:-1, None] + rule.nodes / parts).ravel()])
        r, q, omega = self.sample(np.repeat(np.arange(count), len(places)), np.tile(places, count))
        split = (*q.shape[:-2], count, len(places))
        r, q, omega = r.reshape(*split, 3), q.reshape(*split, 4), omega.reshape(*split, 3)
        share = self.step[:, None, None] / parts

        def inner(values: Array) -> Array:
            return values[..., parts + 1 :, :].reshape(*split[:-1], parts, gauss_points, -1)

        def integral(rate: Array) -> Array:
            return np.asarray(share * np.einsum("g,...gc->...c", rule.weights, rate))

        begin = rotations.conjugate(q[..., :parts, :])
        spin = np.concatenate([np.zeros_like(inner(omega)[..., :1]), 0.5 * inner(omega)], axis=-1)
        turned = integral(rotations.multiply(rotations.multiply(begin[..., None, :], inner(q)), spin))
        missed = rotations.multiply(begin, q[..., 1 : parts + 1, :]) - rotations.IDENTITY - turned
        worst = np.argmax(np.linalg.norm(missed, axis=-1), axis=-1)[..., None, None]
        jump = parts * np.take_along_axis(missed, worst, axis=-2)[..., 0, :]
        tangent = rotations.tangent(inner(q))
        arm = self.step[:, None, None, None] * (places[parts + 1 :].reshape(parts, gauss_points, 1) - 0.5)
        moved = r[..., parts, :] - r[..., 0, :] - integral(tangent).sum(axis=-2)
        return rotations.multiply(q[..., parts // 2, :], jump), moved, integral(arm * tangent).sum(axis=-2)


def _weights(part: Array, order: NDArray[np.intp]) -> Array:
    """Return what the coefficients at both nodes count at ``part`` (N,), (2, TERMS, N): two-point Hermite polynomials.

    Those up to ``order`` (N,) count: Davis, "Interpolation and Approximation", section 2.5.
    """
    weights = np.zeros((2, TERMS, len(part)))
    for most in np.unique(order):
        those = np.flatnonzero(order == most)
        for end, t in enumerate((part[those], 1.0 - part[those])):
            for k in range(most + 1):
                rest = sum(math.comb(most + i, i) * t**i for i in range(most - k + 1))
                weights[end, k, those] = (-1.0) ** (end * k) * (1.0 - t) ** (most + 1) * t**k * rest
    return weights
