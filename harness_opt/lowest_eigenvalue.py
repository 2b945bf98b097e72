"""The lowest eigenvalue of a large second variation, and how many are below a number, without a dense matrix.

On the fields phi that leave the end where it is (C phi = 0), as many eigenvalues of Q against the mass M are below t as

    [Q - t M, C^T; C, -e]

has negative ones, less the rows of C (Sylvester's law of inertia; e is a little compliance of the end, which takes
directions that no field moves it to). The lowest is enclosed by counts, and found by inverse iteration from the lower
end. Parlett, "The Symmetric Eigenvalue Problem", sections 3.3 and 4.6.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import scipy.sparse as sp

from .element_pattern import pattern
from .rotations import Array
from .second_variation import SecondVariation

COMPLIANCE = 1e-10  # of the end, in that of the stiffest field that moves it
WIDER = 8.0  # factor by which an enclosure is looked for further away
CLOSE = 0.3  # relative width of the enclosure that inverse iteration begins from
SETTLED = 1e-10  # relative change of an eigenvalue that has been found
ITERATIONS = 60
EXTREME = 1e30  # in the unit of the search: nothing is found out there


class Pencil:
    """Q, M and C of one shape, as sparse matrices of one pattern.

    Args:
        variation: of one shape, symmetric.
    """

    def __init__(self, variation: SecondVariation):
        kind, closed = variation.kind, variation.closed
        self._pattern = pattern(len(variation.masses), kind.start_orientation, kind.end_orientation, closed)
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
        self._linear = ca.Linsol("inertia", "ldl", self._pattern.sparsity)

    def _summed(self, *entries: Array) -> Array:
        """Return the nonzeros of a bordered matrix with these entries and nothing on its diagonal."""
        weights = np.concatenate([*entries, np.zeros(self._size)])
        return np.asarray(np.bincount(self._pattern.places, weights, self._pattern.sparsity.nnz()), dtype=float)

    def _sparse(self, nonzeros: Array) -> sp.csc_array:
        """Return a matrix without its border."""
        rows, starts = np.array(self._pattern.sparsity.row()), np.array(self._pattern.sparsity.colind())
        return sp.csc_array((nonzeros, rows, starts))[: self._size, : self._size]

    @staticmethod
    def _compliance(variation: SecondVariation) -> float:
        diagonal = np.abs(np.diagonal(variation.blocks, axis1=-2, axis2=-1))
        moved = variation.ends**2 / np.maximum(diagonal, np.finfo(float).tiny)[:, None, :]
        return COMPLIANCE * float(np.max(np.sum(moved, axis=(0, 2))))

    def _factorised(self, at: float) -> ca.DM:
        """Factorise Q - ``at`` M, bordered, and return it."""
        matrix = ca.DM(self._pattern.sparsity, (self._q - at * self._m).tolist())
        self._linear.nfact(matrix)
        return matrix

    def below(self, at: float) -> int:
        """Return how many eigenvalues are below ``at``."""
        return int(self._linear.neig(self._factorised(at))) - self._border

    def lowest(self, unit: float) -> tuple[float, Array]:
        """Return the lowest eigenvalue and its field (D,); one well below ``unit`` counts as zero.

        Args:
            unit: where the search begins, above zero.
        """
        low, high = self._enclosed(unit)
        matrix = self._factorised(low)
        q, m = (
            ca.DM(self._pattern.sparsity, part.tolist()).sparse()[: self._size, : self._size]
            for part in (self._q, self._m)
        )
        field = np.cos(np.arange(self._size))  # orthogonal to nothing in particular
        value = high
        for _ in range(ITERATIONS):
            right = np.concatenate([m @ field, np.zeros(self._border)])
            field = np.asarray(self._linear.solve(matrix, ca.DM(right))).ravel()[: self._size]
            field /= np.sqrt(field @ (m @ field))
            before, value = value, float(field @ (q @ field))
            if abs(value - before) <= SETTLED * (abs(value) + unit):
                break
        return value, field

    def _enclosed(self, unit: float) -> tuple[float, float]:
        """Return two numbers, the lowest eigenvalue between them, close to each other in its own size or ``unit``."""
        low, high = -unit, unit
        while self.below(low) and low > -EXTREME * unit:
            low, high = WIDER * low, low
        while not self.below(high) and high < EXTREME * unit:
            low, high = high, WIDER * high
        while high - low > CLOSE * max(abs(low), abs(high), unit):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if self.below(middle) else (middle, high)
        return low, high
