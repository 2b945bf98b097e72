"""The lowest eigenvalue of a large second variation, and how many are below a number, without a dense matrix.

On the fields phi that leave the end where it is (C phi = 0), as many eigenvalues of Q against the mass M are below t as

    [Q - t M, C^T; C, -e]

has negative ones, less the rows of C (Sylvester's law of inertia; e is a little compliance of the end, which takes
directions that no field moves it to). The lowest is bounded from below by counts, and found from there by Lanczos's
method on the inverse. Parlett, "The Symmetric Eigenvalue Problem", sections 3.3, 13.1 and 15.6.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from harness_opt.numerics.linear import symmetric
from harness_opt.numerics.rotations import Array
from harness_opt.rod.element_pattern import pattern
from harness_opt.rod.second_variation import SecondVariation


class Pencil:
    """Q, M and C of one shape, as sparse matrices of one pattern.

    Args:
        variation: of one shape, symmetric.
    """

    def __init__(self, variation: SecondVariation):
        kind, closed = variation.kind, variation.closed
        self._pattern = pattern(len(variation.masses), kind.start_held, kind.end_held, closed)
        self._border = 3 if closed else 0
        self._size = variation.size
        stiffness, mass = variation.blocks[self._pattern.blocks], variation.masses[self._pattern.blocks]
        if self._pattern.chords is None:
            self._q, self._m = self._summed(stiffness), self._summed(mass)
        else:
            border = variation.ends[self._pattern.chords]
            corner = np.full(3, -self._compliance(variation))
            self._q = self._summed(stiffness, border, border, corner)
            self._m = self._summed(mass, np.zeros(2 * len(border) + 3))
        self._linear = symmetric(self._pattern.sparsity)

    def _summed(self, *entries: Array) -> Array:
        """Return the nonzeros of a bordered matrix with these entries and nothing on its diagonal."""
        weights = np.concatenate([*entries, np.zeros(self._size)])
        return np.asarray(np.bincount(self._pattern.places, weights, self._pattern.sparsity.nnz()), dtype=float)

    @staticmethod
    def _compliance(variation: SecondVariation) -> float:
        compliance = 1e-10  # of the end, in that of the stiffest field that moves it
        diagonal = np.abs(np.diagonal(variation.blocks, axis1=-2, axis2=-1))
        moved = variation.ends**2 / np.maximum(diagonal, np.finfo(float).tiny)[:, None, :]
        return compliance * float(np.max(np.sum(moved, axis=(0, 2))))

    def below(self, at: float) -> int:
        """Return how many eigenvalues are below ``at``."""
        return self._linear.negative(self._q - at * self._m) - self._border

    def lowest(self, unit: float) -> tuple[float, Array, int]:
        """Return the lowest eigenvalue, its field (D,), and how many eigenvalues are below zero.

        Args:
            unit: what counts as zero.
        """
        converged, least_steps = 1e-10, 2  # relative change of a found eigenvalue, and steps after which it may be
        most_steps = 60
        low, index = self._bound(unit)
        matrix, (places, rows, starts) = self._q - low * self._m, self._pattern.inner
        mass, border = sp.csc_array((self._m[places], rows, starts)), np.zeros(self._border)

        def inverse(right: Array) -> Array:
            return self._linear.solve(matrix, np.concatenate([right, border]))[: self._size]

        basis, dual = np.empty((2, most_steps, self._size))  # fields orthonormal in the mass, their products with it
        projected = np.zeros((most_steps, most_steps))
        field = inverse(mass @ np.cos(np.arange(self._size)))  # of one that is orthogonal to nothing in particular
        value = np.inf
        for k in range(most_steps):
            product = mass @ field
            size = np.sqrt(field @ product)
            if k:
                projected[k, k - 1] = projected[k - 1, k] = size
            basis[k], dual[k] = field / size, product / size
            field = inverse(dual[k])
            along = dual[: k + 1] @ field
            projected[k, k] = along[k]
            field -= along @ basis[: k + 1]
            field -= (dual[: k + 1] @ field) @ basis[: k + 1]  # twice: once leaves rounding
            if k < least_steps:
                continue
            values, vectors = np.linalg.eigh(projected[: k + 1, : k + 1])
            before, value = value, low + 1.0 / float(values[-1])
            if abs(value - before) <= converged * (abs(value) + unit):
                break
        return value, vectors[:, -1] @ basis[: k + 1], index

    def _bound(self, unit: float) -> tuple[float, int]:
        """Return a number below the lowest eigenvalue, and close to one below zero in its own size; and their count."""
        extreme = 1e30  # in what counts as zero: nothing is found out there
        near_zero = 1e-4  # part of what counts as zero: Lanczos's method from there tells apart what is far smaller
        relative_width = 0.3  # relative width of the enclosure whose lower end that is
        widening = 8.0  # factor by which an enclosure is looked for further away
        if not self.below(-near_zero * unit):
            return -near_zero * unit, 0
        index = self.below(-unit)
        if not index:
            return -unit, 0
        low, high = -widening * unit, -unit
        while self.below(low) and low > -extreme * unit:
            low, high = widening * low, low
        while high - low > relative_width * abs(low):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if self.below(middle) else (middle, high)
        return low, index
