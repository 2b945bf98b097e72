"""Symmetric sparse matrices of one pattern: solving with them, and counting their negative eigenvalues."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import casadi as ca

from harness_opt.numerics.interface import Array
from harness_opt.numerics.machine_code import Buffered


class Symmetric:
    """Solves and counts by L D L^T in the order that rows and columns come in.

    Args:
        sparsity: of the matrices, both triangles.
    """

    def __init__(self, sparsity: ca.Sparsity):
        self.sparsity, self._inertia = sparsity, ca.Linsol("inertia", "ldl", sparsity)
        right, entries = ca.MX.sym("right", sparsity.size1()), ca.MX.sym("entries", sparsity.nnz())
        solution = ca.solve(ca.MX(sparsity, entries), right, "ldl")
        self._solution = Buffered(ca.Function("solution", [right, entries], [solution]))

    def solve(self, entries: Array, right: Array) -> Array:
        """Return x (n,) with A x = ``right`` (n,), of the nonzeros of A; they must not be changed afterwards.

        A is factorised anew every time, and faster than by ``Linsol.solve``, whose arguments cost more than that.
        """
        return self._solution(right, entries).copy()

    def negative(self, entries: Array) -> int:
        """Return the number of negative eigenvalues of the matrix with these nonzeros."""
        matrix = ca.DM(self.sparsity, entries.tolist())  # of a list: twice as fast as of an array
        self._inertia.nfact(matrix)
        return int(self._inertia.neig(matrix))


@dataclass(frozen=True)
class _Key:
    """A sparsity that can be looked up; casadi keeps one object for all that are equal."""

    sparsity: ca.Sparsity

    def __hash__(self) -> int:
        return int(ca.SharedObject.__hash__(self.sparsity))


@functools.lru_cache(maxsize=64)
def _kept(key: _Key) -> Symmetric:
    return Symmetric(key.sparsity)


def symmetric(sparsity: ca.Sparsity) -> Symmetric:
    """Return what solves with matrices of this sparsity, built once."""
    return _kept(_Key(sparsity))
