"""What every solver takes and gives: a nonlinear least-squares problem and a solution with its status; an energy."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import casadi as ca
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from harness_opt.errors import Status
from harness_opt.numerics.linear import Factor
from harness_opt.numerics.rotations import Array


@dataclass(frozen=True, eq=False)
class Equations:
    """R(x, p) in symbols, one object for each kind of problem: what a solver builds on it can be kept.

    Args:
        unknowns, parameters, residual: x, p and R as CasADi expressions.
    """

    unknowns: ca.SX
    parameters: ca.SX
    residual: ca.SX


@dataclass(frozen=True)
class LeastSquares:
    """Find x such that the residual R(x) vanishes, or its sum of squares is least.

    Args:
        residual: x (n,) -> R (m,), scaled so that its entries are comparable.
        linearise: x (n,) -> (R (m,), Jacobian (m, n), sparse, CSC).
        symbolic: () -> (x, R) as CasADi expressions with the parameters filled in.
        parametric: () -> (equations, values of their parameters), where there are others of the same kind; or None.
    """

    residual: Callable[[Array], Array]
    linearise: Callable[[Array], tuple[Array, sp.csc_array]]
    symbolic: Callable[[], tuple[ca.SX, ca.SX]]
    parametric: Callable[[], tuple[Equations, Array]] | None = None


@dataclass(frozen=True)
class Options:
    """When to stop.

    Args:
        tolerance: largest entry of |R| that counts as solved.
        iterations: limit.
        stationary: take a least-squares minimum for a solution, whatever residual is left: for overdetermined problems.
        factor: what solves J y = b for a like problem at a like point, or None: a method may begin with it.
    """

    tolerance: float = 1e-11
    iterations: int = 60
    stationary: bool = False
    factor: Factor | None = None


@dataclass(frozen=True)
class Solution:
    """How a solve ended.

    Args:
        x: (n,), the best iterate.
        status: see :class:`~harness_opt.errors.Status`.
        residual: largest entry of |R(x)|.
        iterations: steps taken.
        factor: what solves J y = b with the last Jacobian, or None where none was kept.
    """

    x: Array
    status: Status
    residual: float
    iterations: int
    factor: Factor | None = None


@dataclass(frozen=True)
class Expansion:
    """An energy to second order about a point.

    Args:
        gradient: (n,), of the energy less the multipliers' work.
        constraint: (c,), what is missed.
        entries: of [H A^T; A 0], to be summed at ``places`` with the diagonal's behind them.
        curved: how many of them belong to H.
        places: among the nonzeros.
        sparsity: of the bordered matrix.
        weights: (n,), diagonal of the metric W.
    """

    gradient: Array
    constraint: Array
    entries: Array
    curved: int
    places: NDArray[np.integer]
    sparsity: ca.Sparsity
    weights: Array

    def bordered(self, shift: float, *, flat: bool = False) -> Array:
        """Return the nonzeros of [H + shift W, A^T; A, 0]; ``flat`` leaves H out."""
        entries = self.entries
        if flat:
            entries = np.concatenate([np.zeros(self.curved), entries[self.curved :]])
        entries = np.concatenate([entries, shift * self.weights])
        return np.bincount(self.places, entries, self.sparsity.nnz()).astype(float, copy=False)


class Landscape(Protocol):
    """An energy on a manifold of points ``q``, moved by steps of its tangent space."""

    @property
    def constraints(self) -> int:
        """Number of constraints."""
        ...

    @property
    def sparsity(self) -> ca.Sparsity:
        """Of the bordered Hessian."""
        ...

    def energy(self, q: Array) -> tuple[float, Array]:
        """Return the energy at a point, and what is missed of the constraints."""
        ...

    def expand(self, q: Array, multipliers: Array) -> Expansion:
        """Return the energy less the multipliers' work to second order."""
        ...

    def size(self, step: Array) -> float:
        """Return how long a step is, as a descent limits it."""
        ...

    def move(self, q: Array, step: Array) -> Array:
        """Return the point a step further."""
        ...

    def too_coarse(self, q: Array) -> bool:
        """Return whether the landscape is too coarse for a point."""
        ...


STATIONARY_STEP = 1e-9  # largest entry of a step at a least-squares minimum


class Solver(Protocol):
    """A method: one call, no state, the failure returned and not raised."""

    def __call__(self, problem: LeastSquares, x: Array, options: Options) -> Solution:
        """Solve ``problem`` from ``x`` (n,)."""
        ...


def largest(residual: Array) -> float:
    """Return max |R|, infinite where an entry is not a number."""
    value = float(np.maximum.reduce(np.abs(residual), axis=None)) if residual.size else 0.0
    return value if math.isfinite(value) else np.inf
