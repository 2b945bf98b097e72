"""Linear least-squares steps on sparse Jacobians: LU where it is safe, minimum norm where it is not."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

Array = NDArray[np.float64]

# An estimated condition number above this marks a rank deficiency: a straight cable, or a cable that may turn freely about
# coaxial clamps. Regular cases stay well below it for every stiffness ratio up to 1e3 and every weight up to 1e6.
CONDITION_LIMIT = 1e13
RANK_TOLERANCE = 1e-11  # singular values below this fraction of the largest count as zero


@dataclass(frozen=True)
class Factor:
    """A factorised Jacobian.

    Args:
        jacobian: (m, n).
        lu: SuperLU object, or None for the minimum-norm route.
    """

    jacobian: sp.csc_array
    lu: Any

    @property
    def singular(self) -> bool:
        """True where the Jacobian is rank deficient to rounding, or not square."""
        return self.lu is None

    def solve(self, b: Array) -> Array:
        """Return y that solves J y = b (m,) or (m, k): exactly, or in least squares with minimum norm."""
        if self.lu is not None:
            return self.lu.solve(np.ascontiguousarray(b))
        return scipy.linalg.lstsq(
            self.jacobian.toarray(), b, cond=RANK_TOLERANCE, lapack_driver="gelsy", check_finite=False
        )[0]


def factorise(jacobian: sp.csc_array) -> Factor:
    """Factorise ``jacobian`` (m, n), CSC: sparse LU where square and regular, else prepare a minimum-norm solve."""
    rows, columns = jacobian.shape
    if rows != columns:
        return Factor(jacobian, None)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", spla.MatrixRankWarning)
        try:
            lu = spla.splu(jacobian)
        except RuntimeError:  # SuperLU: "Factor is exactly singular"
            return Factor(jacobian, None)
    return Factor(jacobian, lu if _condition(jacobian, lu) < CONDITION_LIMIT else None)


def _condition(jacobian: sp.csc_array, lu: Any) -> float:
    """Estimate the condition number by two inverse iterations on J^T J (Golub and Van Loan, section 3.5)."""
    v = np.cos(np.arange(jacobian.shape[0]))  # any vector that is orthogonal to nothing in particular
    growth = 0.0
    for _ in range(2):
        v = lu.solve(lu.solve(v / np.linalg.norm(v), "T"))
        growth = float(np.linalg.norm(v))
        if not np.isfinite(growth):
            return np.inf
    return float(np.sqrt(growth) * spla.norm(jacobian))
