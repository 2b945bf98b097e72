"""Linear least-squares steps on sparse Jacobians: LU where it is safe, minimum norm where it is not.

Rows and columns are eliminated in the order they come in, which along a cable leaves a band: half the time of an
ordering found by SuperLU on 64 elements.
"""

from __future__ import annotations

import functools
import warnings
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from harness_opt.numerics.machine_code import Buffered
from harness_opt.numerics.rotations import Array

# A condition number above the first marks a rank deficiency (a straight cable, a cable that may turn freely about
# coaxial clamps), if it stays above it with rows and columns scaled to the same size: heavy and stiff cables only
# look singular. So do taut ones, up to the second, for a slack of 1e-6 L: what stalls as singular is tried as regular,
# and large problems, whose elements a taut or sharply bent cable asked for, are regular up to there.
CONDITION_LIMIT, TAUT_LIMIT = 1e9, 1e15
# Below this one a factor serves for problems nearby too. Of a shape that may turn freely the Jacobian is singular at
# the solution alone: off it, and that is where it is mostly factorised, the condition number is anything from 5e4 up.
BENIGN = 1e6
MOST_DENSE = 1500  # unknowns up to which singular values are looked at: a second's work
LIGHT = 1e-4  # weight of a full row below a band


@dataclass(frozen=True)
class Factor:
    """A factorised Jacobian.

    Args:
        jacobian: (m, n).
        lu: solves with the Jacobian, or with the Jacobian bordered by its null vectors; None for a dense solve, or in a
            large problem an iterative one.
        bordered: which of the two.
        plain: estimate of the condition number of the matrix that ``lu`` factorises.
    """

    jacobian: sp.csc_array
    lu: Any
    bordered: bool = False
    plain: float = np.inf

    @functools.cached_property
    def condition(self) -> float:
        """The condition number; with rows and columns scaled, which takes time, where it is large as it stands."""
        if self.plain < BENIGN or self.bordered or self.lu is None:
            return self.plain
        return min(self.plain, _scaled_condition(self.jacobian))

    @property
    def singular(self) -> bool:
        """True where the Jacobian is rank deficient to rounding, or not square."""
        return self.lu is None or self.bordered

    @property
    def benign(self) -> bool:
        """True where what was factorised is far from singular, so that it serves for problems nearby."""
        return self.condition < BENIGN

    def solve(self, b: Array) -> Array:
        """Return y that solves J y = b (m,) or (m, k): exactly, or in least squares with minimum norm."""
        rank_tolerance = 1e-11  # singular values below this fraction of the largest count as zero
        y: Array
        if self.bordered:
            y = self.lu.solve(np.concatenate([b, np.zeros((1, *b.shape[1:]))]))[:-1]
            return y
        if self.lu is not None:
            y = self.lu.solve(np.ascontiguousarray(b))
            return y
        if self.jacobian.shape[1] > MOST_DENSE and self.jacobian.shape[0] == self.jacobian.shape[1]:
            return _iterated(self.jacobian, b)
        y = scipy.linalg.lstsq(
            self.jacobian.toarray(), b, cond=rank_tolerance, lapack_driver="gelsy", check_finite=False
        )[0]
        return y


def factorise(jacobian: sp.csc_array, limit: float = CONDITION_LIMIT) -> Factor:
    """Factorise ``jacobian`` (m, n), CSC; it counts as singular from a condition number of ``limit`` on.

    One of more than MOST_DENSE unknowns does so from TAUT_LIMIT on.

    Sparse LU where square and regular. Where one direction is lost, the matrix bordered by its null vectors is
    regular, and solving with it gives the least-squares solution of minimum norm (Govaerts, "Numerical Methods for
    Bifurcations of Dynamical Equilibria", section 3.2). Where more are lost, or the matrix is not square, a dense
    solve does, or in a large problem an iterative one.
    """
    rows, columns = jacobian.shape
    limit = TAUT_LIMIT if columns > MOST_DENSE else limit
    lu = _lu(jacobian) if rows == columns else None
    if lu is None:
        return Factor(jacobian, None)
    condition, right = _condition(jacobian, lu, "T", "N")
    regular = Factor(jacobian, lu, plain=condition)
    if condition < limit or regular.condition < limit:
        return regular
    if np.isfinite(condition):
        left = _condition(jacobian, lu, "N", "T")[1]
        size = spla.norm(jacobian) / np.sqrt(rows)  # keeps the border on the scale of the matrix
        border = bordered_matrix(jacobian, size * left, size * right)
        bordered = _lu(border)
        if bordered is not None and (scaled := _scaled_condition(border)) < limit:
            return Factor(jacobian, bordered, bordered=True, plain=scaled)
    return Factor(jacobian, None)


def _iterated(jacobian: sp.csc_array, b: Array) -> Array:
    """Return the least-squares solution for ``b`` (m,) or (m, k), of least norm in scaled unknowns, as far as it gets.

    LSMR (Fong and Saunders, SIAM J. Sci. Comput. 33, 2011): memory and time are bounded, and directions that are all
    but lost stay out.
    """
    most_iterations = 2000  # of the iteration that solves larger problems
    scaled, rows, columns = _equilibrated(jacobian)
    found = [
        columns * spla.lsmr(scaled, rows * column, atol=1e-14, btol=1e-14, conlim=0.0, maxiter=most_iterations)[0]
        for column in b.reshape(len(rows), -1).T
    ]
    return np.stack(found, axis=1).reshape(-1, *b.shape[1:])


def _lu(matrix: sp.csc_array, order: str = "NATURAL") -> Any:
    """Return SuperLU's factors, or None where it meets a pivot of exactly zero."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", spla.MatrixRankWarning)
        try:
            return spla.splu(matrix, permc_spec=order)
        except RuntimeError:  # SuperLU: "Factor is exactly singular"
            return None


def _equilibrated(matrix: sp.csc_array) -> tuple[sp.csc_array, Array, Array]:
    """Return ``matrix`` with its rows, then its columns, scaled to a largest entry of 1, and the scales."""
    rows = spla.norm(matrix, np.inf, axis=1)
    rows = 1.0 / np.where(rows > 0, rows, 1.0)
    scaled = sp.csc_array((matrix.data * rows[matrix.indices], matrix.indices, matrix.indptr), matrix.shape)
    columns = spla.norm(scaled, np.inf, axis=0)
    columns = 1.0 / np.where(columns > 0, columns, 1.0)
    scaled.data *= np.repeat(columns, np.diff(matrix.indptr))
    return scaled, rows, columns


def _scaled_condition(matrix: sp.csc_array) -> float:
    """Return the condition number of ``matrix`` with rows and columns scaled."""
    scaled = _equilibrated(matrix)[0]
    lu = _lu(scaled, "COLAMD")  # its pivots leave the band: a third of the fill
    return np.inf if lu is None else _condition(scaled, lu, "T", "N")[0]


def _condition(matrix: sp.csc_array, lu: Any, first: str, second: str) -> tuple[float, Array]:
    """Estimate the condition number, and the direction (n,) that the matrix (or its transpose) shrinks most.

    Two inverse iterations on J^T J (``first`` "T", ``second`` "N") or J J^T (Golub and Van Loan, section 3.5).
    """
    v = np.cos(np.arange(matrix.shape[0]))  # any vector that is orthogonal to nothing in particular
    growth = 0.0
    for _ in range(2):
        v = lu.solve(lu.solve(v / np.linalg.norm(v), first), second)
        growth = float(np.linalg.norm(v))
        if not np.isfinite(growth):
            return np.inf, v
    return float(np.sqrt(growth) * spla.norm(matrix)), v / growth


def bordered_matrix(jacobian: sp.csc_array, left: Array, right: Array) -> sp.csc_array:
    """Return [J, u; LIGHT v^T, 0] in CSC, of J (n, n), u (n,), v (n,): a heavier row is pivoted on, and fills in."""
    return sp.block_array([[jacobian, left[:, None]], [LIGHT * right[None, :], None]], format="csc")


def null_vectors(jacobian: sp.csc_array, like: tuple[Array, Array] | None = None) -> tuple[Array, Array] | None:
    """Return the unit vectors u (n,) and v (n,) for which u^T J and J v are smallest, of a square Jacobian J.

    Args:
        jacobian: J, (n, n).
        like: the same of a Jacobian nearby, whose signs they take.

    Returns:
        None where no factors of J can be had.
    """
    lu = _lu(jacobian)
    if lu is None:
        return None
    left, right = _condition(jacobian, lu, "N", "T")[1], _condition(jacobian, lu, "T", "N")[1]
    if not (np.all(np.isfinite(left)) and np.all(np.isfinite(right))):
        return None
    if like is not None:
        left, right = left * np.sign(left @ like[0]), right * np.sign(right @ like[1])
    return left, right


def damped_step(jacobian: sp.csc_array, residual: Array, damping: float) -> Array:
    """Return the step p (n,) that minimises |J p + r|^2 + damping |p|^2."""
    rows, columns = jacobian.shape
    step: Array = spla.splu(_damped(jacobian, damping)).solve(np.concatenate([-residual, np.zeros(columns)]))[rows:]
    return step


def _damped(jacobian: sp.csc_array, damping: float) -> sp.csc_array:
    """Return the augmented system [I J; J^T -damping I] of a damped step.

    It is sparse and without the squared condition number of the normal equations (Bjoerck, "Numerical Methods for
    Least Squares Problems", section 2.6).
    """
    rows, columns = jacobian.shape
    return sp.block_array(
        [[sp.eye_array(rows), jacobian], [jacobian.T, -damping * sp.eye_array(columns)]], format="csc"
    )


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
