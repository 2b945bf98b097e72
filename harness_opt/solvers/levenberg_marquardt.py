"""Levenberg-Marquardt with gain control: slower than Gauss-Newton, further-reaching.

Eq. (26) of Liu et al. with the damping of Nielsen (report IMM-REP-1999-05, DTU) in place of its fixed rule
mu = |J^T F|, and More's scale matrix D ("The Levenberg-Marquardt algorithm", LNM 630, 1978).
"""

from __future__ import annotations

import numpy as np
import scipy.linalg

from ..errors import Status
from .interface import Array, LeastSquares, Options, Solution, largest

START = 1e-3  # first damping, relative to the scaled problem
STEP_LIMIT = 1e-15  # a relative step below this is rounding


def solve(problem: LeastSquares, x: Array, options: Options) -> Solution:
    """Solve ``problem`` from ``x`` (n,); never raises for lack of convergence, the status says how it ended."""
    residual, jacobian = problem.linearise(x)
    if not np.all(np.isfinite(residual)):
        return Solution(x, Status.NOT_FINITE, np.inf, 0)
    scale = np.zeros_like(x)
    damping, growth = START, 2.0
    for iteration in range(options.iterations):
        if largest(residual) <= options.tolerance:
            return Solution(x, Status.OK, largest(residual), iteration)
        dense = jacobian.toarray()
        scale = np.maximum(scale, np.linalg.norm(dense, axis=0))
        weights = np.where(scale > 0, scale, 1.0)
        # the normal equations would square the condition number: solve the stacked system by QR instead
        stacked = np.vstack([dense / weights, np.sqrt(damping) * np.eye(len(x))])
        target = np.concatenate([-residual, np.zeros(len(x))])
        scaled_step = scipy.linalg.lstsq(stacked, target, lapack_driver="gelsy", check_finite=False)[0]
        step = scaled_step / weights
        trial = problem.residual(x + step)
        cost = residual @ residual
        predicted = scaled_step @ (damping * scaled_step - (dense / weights).T @ residual)
        gain = (cost - trial @ trial) / predicted if predicted > 0 and np.all(np.isfinite(trial)) else -1.0
        if gain > 0:
            x = x + step
            residual, jacobian = problem.linearise(x)
            damping *= max(1.0 / 3.0, 1.0 - (2.0 * gain - 1.0) ** 3)
            growth = 2.0
        else:
            damping *= growth
            growth *= 2.0
            if np.linalg.norm(scaled_step) <= STEP_LIMIT * (1.0 + np.linalg.norm(weights * x)):
                return Solution(x, Status.STALLED, largest(residual), iteration + 1)
    status = Status.OK if largest(residual) <= options.tolerance else Status.ITERATION_LIMIT
    return Solution(x, status, largest(residual), options.iterations)
