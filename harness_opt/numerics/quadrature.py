"""Gauss-Legendre collocation tableaux on the unit interval.

Hairer, Norsett, Wanner, "Solving Ordinary Differential Equations I", section II.7: the s-stage Gauss method has order
2s at the end of a step and conserves quadratic invariants, so that unit quaternions stay unit quaternions.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from harness_opt.numerics.rotations import Array


@dataclass(frozen=True)
class GaussTableau:
    """Butcher tableau of a Gauss method.

    Args:
        nodes: c, (s,), in (0, 1).
        weights: b, (s,), integrals of the Lagrange polynomials over (0, 1).
        matrix: A, (s, s), ``A[j, k]`` the integral of polynomial k over (0, c[j]).
        running: A with the weights as a last row, (s + 1, s): integrals to every stage and to the end.
    """

    nodes: Array
    weights: Array
    matrix: Array
    running: Array


@functools.cache
def gauss(stages: int) -> GaussTableau:
    """Return the Gauss tableau with ``stages`` >= 1 stages."""
    x, w = np.polynomial.legendre.leggauss(stages)
    nodes = 0.5 * (x + 1.0)
    matrix = _integrals(nodes)
    return GaussTableau(nodes, 0.5 * w, matrix, np.vstack([matrix, 0.5 * w]))


def _integrals(nodes: Array) -> Array:
    """Integrate the Lagrange polynomials of ``nodes`` (s,) from 0 to each node; returns (s, s).

    Uses Legendre polynomials on (-1, 1): int P_k = (P_{k+1} - P_{k-1}) / (2k + 1), well conditioned at any s.
    """
    count = len(nodes)
    legendre = np.polynomial.legendre
    vandermonde = legendre.legvander(2.0 * nodes - 1.0, count - 1)
    antiderivatives = np.stack(
        [0.5 * legendre.legval(2.0 * nodes - 1.0, legendre.legint(row, lbnd=-1)) for row in np.eye(count)],
        axis=-1,
    )
    return np.asarray(np.linalg.solve(vandermonde.T, antiderivatives.T).T, dtype=float)


@dataclass(frozen=True)
class DifferentialQuadrature:
    """Differentiation and integration on the Chebyshev points of the unit interval.

    Args:
        nodes: s_i = (1 - cos((i - 1) pi / (N - 1))) / 2, (N,): eq. (23) of Liu et al. with a = 1.
        first: A^(1), (N, N): eqs. (18), (19), (22).
        second: A^(2) = A^(1) A^(1), (N, N): eqs. (20), (21).
        integral: (N, N), integrals of the Lagrange polynomials from 0 to each node, for eq. (17).
    """

    nodes: Array
    first: Array
    second: Array
    integral: Array

    def interpolate(self, s: Array) -> Array:
        """Return the matrix (m, N) that takes values at the nodes to values at ``s`` (m,), barycentric."""
        weights = _barycentric_weights(len(self.nodes))
        gap = s[:, None] - self.nodes
        hit = gap == 0
        terms = weights / np.where(hit, 1.0, gap)
        matrix = terms / terms.sum(axis=1, keepdims=True)
        rows = np.any(hit, axis=1)
        matrix[rows] = hit[rows]
        return np.asarray(matrix, dtype=float)


def _barycentric_weights(count: int) -> Array:
    """Return the weights of Chebyshev points of the second kind: alternating signs, halved at the ends.

    Berrut and Trefethen, "Barycentric Lagrange interpolation", SIAM Review 46 (2004), eq. (5.4).
    """
    weights = np.asarray((-1.0) ** np.arange(count), dtype=float)
    weights[[0, -1]] *= 0.5
    return weights


@functools.cache
def differential_quadrature(count: int) -> DifferentialQuadrature:
    """Return the rules on ``count`` >= 2 points.

    The products of (22) over- and underflow and cancel beyond a few dozen points; the same matrix follows stably from
    barycentric weights, its diagonal from the row sums being zero (Berrut and Trefethen, section 9.3).
    """
    angle = np.pi * np.arange(count) / (count - 1)
    nodes = np.sin(0.5 * angle) ** 2  # (1 - cos) / 2 without cancellation
    weights = _barycentric_weights(count)
    # s_i - s_j = sin((a_i + a_j) / 2) sin((a_i - a_j) / 2), again without cancellation
    gap = np.sin(0.5 * (angle[:, None] + angle)) * np.sin(0.5 * (angle[:, None] - angle))
    np.fill_diagonal(gap, 1.0)
    first = weights / weights[:, None] / gap
    np.fill_diagonal(first, 0.0)
    np.fill_diagonal(first, -first.sum(axis=1))
    chebyshev = np.polynomial.chebyshev
    x = -np.cos(angle)
    vandermonde = chebyshev.chebvander(x, count - 1)
    antiderivatives = np.stack(
        [0.5 * chebyshev.chebval(x, chebyshev.chebint(row, lbnd=-1)) for row in np.eye(count)], axis=-1
    )
    integral = np.asarray(np.linalg.solve(vandermonde.T, antiderivatives.T).T, dtype=float)
    return DifferentialQuadrature(nodes, first, first @ first, integral)
