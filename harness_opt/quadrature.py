"""Gauss-Legendre collocation tableaux on the unit interval.

Hairer, Norsett, Wanner, "Solving Ordinary Differential Equations I", section II.7: the s-stage Gauss method has order
2s at the end of a step and conserves quadratic invariants, so that unit quaternions stay unit quaternions.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from .rotations import Array


@dataclass(frozen=True)
class GaussTableau:
    """Butcher tableau of a Gauss method.

    Args:
        nodes: c, (s,), in (0, 1).
        weights: b, (s,), integrals of the Lagrange polynomials over (0, 1).
        matrix: A, (s, s), ``A[j, k]`` the integral of polynomial k over (0, c[j]).
    """

    nodes: Array
    weights: Array
    matrix: Array


@functools.cache
def gauss(stages: int) -> GaussTableau:
    """Return the Gauss tableau with ``stages`` >= 1 stages."""
    x, w = np.polynomial.legendre.leggauss(stages)
    nodes = 0.5 * (x + 1.0)
    return GaussTableau(nodes, 0.5 * w, integrals(nodes, nodes))


def integrals(nodes: Array, upper: Array) -> Array:
    """Integrate the Lagrange polynomials of ``nodes`` (s,) from 0 to each of ``upper`` (m,); returns (m, s).

    Uses Legendre polynomials on (-1, 1): int P_k = (P_{k+1} - P_{k-1}) / (2k + 1), well conditioned at any s.
    """
    count = len(nodes)
    legendre = np.polynomial.legendre
    vandermonde = legendre.legvander(2.0 * nodes - 1.0, count - 1)
    antiderivatives = np.stack(
        [
            0.5 * legendre.legval(2.0 * upper - 1.0, legendre.legint(row, lbnd=-1))
            for row in np.eye(count)
        ],
        axis=-1,
    )
    return np.linalg.solve(vandermonde.T, antiderivatives.T).T
