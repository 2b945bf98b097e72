"""Last corrections of a solved shape, down to what rounding leaves."""

from __future__ import annotations

import dataclasses

from harness_opt.numerics import near_null
from harness_opt.numerics.interface import Options, Solution, largest
from harness_opt.numerics.linear import CONDITION_LIMIT, Factor
from harness_opt.rod.collocation import BoundCollocation
from harness_opt.statics.solve import RESIDUAL, Solved


def solve_along_near_null(solved: Solved) -> Solved:
    """Return a solve carried on along its near-null direction until rounding hides the rest; unchanged without one.

    Where one direction is all but flat, a residual small enough for any other shape still leaves far to go there.
    """
    # part of the residual that following the near-null curve is to leave, and how often
    part_left, most_repeats = 0.3, 12
    if solved.factor.condition < CONDITION_LIMIT:
        return solved
    problem, best = solved.bound.least_squares(), solved.solution
    for _ in range(most_repeats):
        followed = near_null.solve(problem, best.x, Options(part_left * best.residual, 0))
        if not followed.status.ok:
            break
        best = followed
    found = Solved(solved.case, solved.bound, best)
    return solved if best is solved.solution or found.turned else found


def correct_to_rounding(solved: Solved) -> Solved:
    """Return a solve corrected until rounding is left, with the Jacobian that it ended with.

    What counts as solved grows with the loads, and long elements show what is left: their curvatures are the small
    differences of large moments.
    """
    best = solved.solution
    if best.factor is not None and not best.factor.singular:
        best = _corrected(solved.bound, best, best.factor)
    if best is solved.solution and best.residual > RESIDUAL and not solved.factor.singular:
        best = _corrected(solved.bound, best, solved.factor)
    return solved if best is solved.solution else dataclasses.replace(solved, solution=best)


def _corrected(bound: BoundCollocation, best: Solution, factor: Factor) -> Solution:
    """Return ``best`` after corrections with one Jacobian, as long as they leave less."""
    # part of the residual that a last correction is to leave, and how many there are
    most_left, most_corrections = 0.5, 4
    for _ in range(most_corrections):
        x = best.x - factor.solve(bound.residual(best.x))
        left = largest(bound.residual(x))
        if not left < most_left * best.residual:
            break
        best = dataclasses.replace(best, x=x, residual=left)
    return best
