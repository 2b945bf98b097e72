"""Gauss-Newton with a line search: the fast method near a solution.

Nocedal and Wright, "Numerical Optimization", sections 10.3 (the step) and 3.1 (backtracking). Where the Jacobian is
square and regular the step is Newton's; where it is rank deficient it is the least-squares step of minimum norm.
The factorised Jacobian is kept while it contracts well (Deuflhard, "Newton Methods for Nonlinear Problems", section
2.1.3).
"""

from __future__ import annotations

import numpy as np

from ..errors import Status
from .interface import STILL, Array, LeastSquares, Options, Solution, largest
from .linear import factorise

SUFFICIENT = 1e-4  # Armijo's constant
SMALLEST_STEP = 1e-4  # a shorter fraction of the step makes no progress worth the work
CONTRACTION = (
    0.1  # while |R| falls by this factor a step, the Jacobian is kept: a chord step costs a tenth of a full one
)
NEAR_MINIMUM = (
    1e-5  # largest entry of a step that cannot lower |R|: rounding hides what is left to a least-squares minimum
)
SMALL = 1e-10  # largest entry of a last step that leaves nothing to gain
POLISH = 2  # most steps once the residual is small: where the problem is badly conditioned, that is not enough


def solve(problem: LeastSquares, x: Array, options: Options) -> Solution:
    """Solve ``problem`` from ``x`` (n,); never raises for lack of convergence, the status says how it ended."""
    factor, stale, size = None, True, np.inf
    status = Status.ITERATION_LIMIT
    residual = problem.residual(x)
    best, polished = largest(residual), 0
    for iteration in range(options.iterations + 1):
        if not np.isfinite(best):
            status = Status.NOT_FINITE
            break
        if best <= options.tolerance:
            status = Status.OK
            if size <= SMALL or polished == POLISH:
                break
            polished += 1
        if iteration == options.iterations:
            break
        if stale:
            jacobian = problem.linearise(x)[1]
            if not np.all(np.isfinite(jacobian.data)):
                status = Status.NOT_FINITE
                break
            factor = factorise(jacobian)
        step = -factor.solve(residual)  # type: ignore[union-attr]
        if options.stationary and largest(step) <= STILL:
            status = Status.OK
            break
        length, trial = _search(problem, x, step, residual)
        if length == 0.0:
            if status.ok:
                break
            if stale and options.stationary and largest(step) <= NEAR_MINIMUM:
                status = Status.OK
                break
            if stale:
                return Solution(x, Status.STALLED, best, iteration, factor)
            stale = True  # the old Jacobian gave no descent: take the step again with a new one
            continue
        x, size = x + length * step, length * largest(step)
        stale = length < 1.0 or largest(trial) > CONTRACTION * best
        residual, best = trial, largest(trial)
    return Solution(x, status, best, iteration, factor)


def _search(problem: LeastSquares, x: Array, step: Array, residual: Array) -> tuple[float, Array]:
    """Return the accepted fraction of ``step`` and the residual there; fraction 0 where none descends."""
    cost, length = residual @ residual, 1.0
    while length >= SMALLEST_STEP:
        trial = problem.residual(x + length * step)
        if np.all(np.isfinite(trial)) and trial @ trial <= (1.0 - 2.0 * SUFFICIENT * length) * cost:
            return length, trial
        length *= 0.5
    return 0.0, residual
