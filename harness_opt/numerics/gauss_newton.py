"""Gauss-Newton with a line search: the fast method near a solution.

Nocedal and Wright, "Numerical Optimization", sections 10.3 (the step) and 3.1 (backtracking). Where the Jacobian is
square and regular the step is Newton's; where it is rank deficient it is the least-squares step of minimum norm.
The factorised Jacobian is kept while it contracts well (Deuflhard, "Newton Methods for Nonlinear Problems", section
2.1.3).
"""

from __future__ import annotations

import numpy as np

from harness_opt.errors import Status
from harness_opt.numerics.interface import STATIONARY_STEP, LeastSquares, Options, Solution, largest
from harness_opt.numerics.linear import CONDITION_LIMIT, TAUT_LIMIT, Factor, factorise
from harness_opt.numerics.rotations import Array


def solve(problem: LeastSquares, x: Array, options: Options) -> Solution:
    """Solve ``problem`` from ``x`` (n,); never raises for lack of convergence, the status says how it ended."""
    most_polishing = 2  # most steps once the residual is small, which is not enough where conditions are bad
    nothing_to_gain = 10.0  # largest entry of the next step, in tolerances, that leaves nothing to gain
    nearly_stationary = 1e-5  # largest entry of a step that cannot lower |R|, at a minimum that rounding hides
    most_contraction = 0.2  # while |R| and steps fall so, the Jacobian is kept: it costs ten times a chord step
    factor, size, ahead, polished = options.factor, np.inf, np.inf, 0
    stale, limit = factor is None, CONDITION_LIMIT
    status = Status.ITERATION_LIMIT
    residual = problem.residual(x)
    best = largest(residual)
    for iteration in range(options.iterations + 1):
        if best == np.inf:
            status = Status.NOT_FINITE
            break
        if best <= options.tolerance:
            status = Status.OK
            if ahead <= nothing_to_gain * options.tolerance or polished == most_polishing or best == 0.0:
                break
            polished += 1
        if iteration == options.iterations:
            break
        fresh = stale
        if fresh or factor is None:
            jacobian = problem.linearise(x)[1]
            if not np.all(np.isfinite(jacobian.data)):
                status = Status.NOT_FINITE
                break
            factor = factorise(jacobian, limit)
        step = -factor.solve(residual)
        reach = largest(step)
        if options.stationary and reach <= STATIONARY_STEP:
            status = Status.OK
            break
        length, there, trial = _search(problem, x, step, residual, factor if fresh else None)
        if length == 0.0:
            if status.ok or (fresh and options.stationary and reach <= nearly_stationary):
                status = Status.OK
                break
            taut = factor.singular and limit < TAUT_LIMIT and not options.stationary
            if fresh and not taut:
                return Solution(x, Status.STALLED, best, iteration, factor)
            # an old Jacobian gave no descent: take the step again with a new one; or one of a cable that looks singular
            stale, limit = True, TAUT_LIMIT if fresh else limit
            continue
        # steps shrink as residuals do; a badly conditioned problem shows in one of the two alone what is left of it
        left = largest(trial)
        contraction = max(left / best, length * reach / size if size > 0.0 else np.inf)
        size = length * reach
        ahead = contraction * size
        x, residual, best = there, trial, left
        stale = length < 1.0 or contraction > most_contraction
    return Solution(x, status, best, iteration, factor)


def _search(
    problem: LeastSquares, x: Array, step: Array, residual: Array, factor: Factor | None
) -> tuple[float, Array, Array]:
    """Return the accepted fraction of ``step``, where it leads, and the residual there; the fraction is 0 for none.

    A step is taken where the residual falls, or where the next step with the same Jacobian is shorter (the natural
    level function, Deuflhard, section 3.3): along a near-null direction, flat to rounding while steep in all
    others, the first alone allows only short ones. ``factor`` is None for an old Jacobian: all of the step or nothing.
    """
    least_judged = 1.0 / 16.0  # shortest fraction of a step that is judged by the next one
    least_fraction = 1e-4  # a shorter fraction of the step makes no progress worth the work
    sufficient = 1e-4  # Armijo's constant
    cost, length, reach = residual @ residual, 1.0, largest(step)
    while length >= (1.0 if factor is None else least_fraction):
        there = x + length * step
        trial = problem.residual(there)
        if trial @ trial <= (1.0 - 2.0 * sufficient * length) * cost:  # false where an entry is not a number
            return length, there, trial
        if factor is not None and length >= least_judged and _shorter(factor, trial, (1.0 - 0.5 * length) * reach):
            return length, there, trial
        length *= 0.5
    return 0.0, x, residual


def _shorter(factor: Factor, residual: Array, reach: float) -> bool:
    """Return whether the step that ``factor`` makes of ``residual`` is known, and no longer than ``reach``."""
    return not factor.singular and bool(np.all(np.isfinite(residual))) and largest(factor.solve(residual)) <= reach
