"""Levenberg-Marquardt as eq. (26) of Liu et al. prints it: damping mu = |J^T F|, every step taken, until mu < err.

No gain control: a step that makes matters worse is taken too, so from afar the iteration may wander or end in a
minimum of |F| that is no root. :mod:`~harness_opt.numerics.levenberg_marquardt` is the safeguarded method.

The paper leaves its scale matrix D open. Here D is Marquardt's (SIAM J. 11, 1963): column norms of the first
Jacobian. mu is an absolute number, so the size of D decides how strongly the last steps are damped: with D = 1, or
with the norms themselves, the differential quadrature's systems take thousands of steps or diverge.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from harness_opt.errors import Status
from harness_opt.numerics.interface import LeastSquares, Options, Solution, largest
from harness_opt.numerics.linear import damped_step
from harness_opt.numerics.rotations import Array

LARGEST_SCALE = 0.03  # of D; measured: from 3e-4 to 0.03 the systems on 31 to 61 points end within 20 steps


def solve(problem: LeastSquares, x: Array, options: Options) -> Solution:
    """Solve ``problem`` from ``x`` (n,); never raises for lack of convergence, the status says how it ended."""
    stalled_mu = 1e-15  # mu below which nothing moves any more
    last_mu = 5e-16  # of the largest squared column norm: mu at the end; rounding allows hardly less
    residual, jacobian = problem.linearise(x)
    if not _finite(residual, jacobian):
        return Solution(x, Status.NOT_FINITE, largest(residual), 0)
    norms = spla.norm(jacobian, axis=0)
    longest = float(np.max(norms))
    scale = LARGEST_SCALE * np.where(norms > 0, norms, longest) / longest
    for iteration in range(options.iterations):
        damping = float(np.linalg.norm(jacobian.T @ residual))
        still = damping < stalled_mu
        ended = still or (
            iteration > 0 and damping < last_mu * longest**2
        )  # a start may lie below, and gain by one step
        if ended and (options.stationary or largest(residual) <= options.tolerance):
            return Solution(x, Status.OK, largest(residual), iteration)
        if still:
            return Solution(x, Status.STALLED, largest(residual), iteration)
        scaled = sp.csc_array(jacobian @ sp.diags_array(1.0 / scale))
        further = x + damped_step(scaled, residual, damping) / scale
        residual, jacobian = problem.linearise(further)
        if not _finite(residual, jacobian):
            return Solution(x, Status.NOT_FINITE, largest(problem.residual(x)), iteration)
        x = further
    return Solution(x, Status.ITERATION_LIMIT, largest(residual), options.iterations)


def _finite(residual: Array, jacobian: sp.csc_array) -> bool:
    return bool(np.all(np.isfinite(residual)) and np.all(np.isfinite(jacobian.data)))
