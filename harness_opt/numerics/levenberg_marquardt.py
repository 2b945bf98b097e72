"""Levenberg-Marquardt with gain control: slower than Gauss-Newton, further-reaching.

Eq. (26) of Liu et al. with the damping of Nielsen (report IMM-REP-1999-05, DTU) in place of its fixed rule
mu = |J^T F|, and More's scale matrix D ("The Levenberg-Marquardt algorithm", LNM 630, 1978).
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from harness_opt.errors import Status
from harness_opt.numerics.interface import STATIONARY_STEP, LeastSquares, Options, Solution, largest
from harness_opt.numerics.linear import damped_step
from harness_opt.numerics.rotations import Array


def solve(problem: LeastSquares, x: Array, options: Options) -> Solution:
    """Solve ``problem`` from ``x`` (n,); never raises for lack of convergence, the status says how it ended."""
    last_damping = 1e-14  # damping of a last, polishing step; keeps a rank-deficient system regular
    first_damping = 1e-3  # first damping, relative to the scaled problem
    least_step = 1e-15  # a relative step below this is rounding
    residual, jacobian = problem.linearise(x)
    if not (np.all(np.isfinite(residual)) and np.all(np.isfinite(jacobian.data))):
        return Solution(x, Status.NOT_FINITE, largest(residual), 0)
    scale = np.zeros_like(x)
    damping, growth, small = first_damping, 2.0, False
    for iteration in range(options.iterations):
        if largest(residual) <= options.tolerance:
            if small:
                return Solution(x, Status.OK, largest(residual), iteration)
            small, damping = True, last_damping  # one last step: where the problem is badly conditioned, it counts
        scale = np.maximum(scale, spla.norm(jacobian, axis=0))
        weights = np.where(scale > 0, scale, 1.0)
        scaled = jacobian @ sp.diags_array(1.0 / weights)
        scaled_step = damped_step(sp.csc_array(scaled), residual, damping)
        if options.stationary and damping <= first_damping and largest(scaled_step / weights) <= STATIONARY_STEP:
            return Solution(x, Status.OK, largest(residual), iteration)
        trial = problem.residual(x + scaled_step / weights)
        cost = residual @ residual
        predicted = scaled_step @ (damping * scaled_step - scaled.T @ residual)
        gain = (cost - trial @ trial) / predicted if predicted > 0 and np.all(np.isfinite(trial)) else -1.0
        if gain > 0:
            x = x + scaled_step / weights
            residual, jacobian = problem.linearise(x)
            if not np.all(np.isfinite(jacobian.data)):
                return Solution(x, Status.NOT_FINITE, largest(residual), iteration + 1)
            damping *= max(1.0 / 3.0, 1.0 - (2.0 * gain - 1.0) ** 3)
            growth = 2.0
        elif small:
            break
        else:
            damping *= growth
            growth *= 2.0
            if np.linalg.norm(scaled_step) <= least_step * (1.0 + np.linalg.norm(weights * x)):
                return Solution(x, Status.STALLED, largest(residual), iteration + 1)
    status = Status.OK if largest(residual) <= options.tolerance else Status.ITERATION_LIMIT
    return Solution(x, status, largest(residual), options.iterations)
