"""Following a path of cases with step control.

A shape is carried from case to case by extrapolation of the last ones and the solver's corrections, which begin with
the Jacobian factorised for the last shape. A step is taken only where the corrected shape stays near the predicted one
and the end keeps its sign, that is its number of whole turns; otherwise it is halved. Deuflhard, "Newton Methods for
Nonlinear Problems", chapter 5.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from harness_opt.numerics.extrapolation import Trail
from harness_opt.numerics.rotations import Array
from harness_opt.rod.boundary import Case
from harness_opt.statics.mesh import RESOLVED, ROUGH, elements_for, refine
from harness_opt.statics.solve import RESIDUAL, Solved, error_estimate, solve_on

STEP_ITERATIONS = 12  # a corrector that needs more has lost its predictor
MOST_TURNING = 0.35  # largest turning between the predicted and the corrected shape of a step, rad
LEAST_STEP = 2.0**-12  # of a path step


def _trail(here: Solved, before: Solved | None) -> Trail:
    """Return the points to extrapolate from: all that led ``here``, where ``before`` is the last of them.

    Two where the shape may turn freely, or it is not known whether: no solve corrects what a higher degree would make
    of the rounding in that direction.
    """
    x, factor = here.solution.x, here.solution.factor
    if before is None or not np.array_equal(before.bound.mesh, here.bound.mesh):
        return Trail((x,))
    trail, regular = here.trail, factor is not None and factor.benign and not factor.singular
    if trail is not None and len(trail.points) > 1 and trail.points[1] is before.solution.x and regular:
        return trail
    return Trail((x, before.solution.x), (1.0,), 1)


def turning(a: Array, b: Array) -> float:
    """Return the largest turning, rad, between quaternions (n, 4) of two shapes at the same places."""
    apart, across = (np.einsum("ni,ni->n", x, x) for x in (a - b, a + b))
    return 2.0 * math.sqrt(float(np.minimum(apart, across).max()))


def step(case: Case, here: Solved, before: Solved | None, ratio: float, solver: str) -> Solved | None:
    """Go from ``here`` to the near ``case`` in one step; None where the step is too long to be trusted.

    Args:
        case: where to.
        here, before: the last two solves; ``before`` may be None.
        ratio: this step's length over the last one's, for the predictor.
        solver: name.
    """
    path_residual = 1e-10  # on a path: 2e-10 L off a solve to the last digit, over the motions of the reference cases
    trail = _trail(here, before)
    length = ratio * trail.steps[0] if trail.steps else 1.0
    predictions = trail.predictions(length)
    guess = predictions[trail.degree]
    residual = RESIDUAL if before is None else path_residual
    solved = solve_on(case, here.bound.mesh, guess, solver, STEP_ITERATIONS, here, residual)
    if not solved.ok or solved.turned:
        return None
    x, quaternions = solved.solution.x, solved.bound.quaternions
    if turning(quaternions(guess), quaternions(x)) > MOST_TURNING:
        return None
    return dataclasses.replace(solved, trail=trail.extended(x, length, predictions))


def follow(
    path: Callable[[float], Case],
    start: Solved,
    first: float,
    last: float,
    solver: str,
    smallest: float | None = None,
) -> tuple[Solved, float]:
    """Follow ``path`` from parameter ``first``, where ``start`` was solved, towards ``last``.

    Args:
        path: parameter to case.
        start, first, last: as above.
        solver: name.
        smallest: step at which it is given up, in parts of the whole; None takes LEAST_STEP.

    Returns:
        The last solve and its parameter: ``last`` where the path could be followed to its end.
    """
    few_iterations = 3  # corrector iterations up to which the next step may double
    most_steps = 300  # tried on one path, taken or not: a path that needs more is given up
    here, before, at = start, None, first
    shortest = abs(last - first) * (LEAST_STEP if smallest is None else smallest)
    length, previous = last - first, 1.0
    for _ in range(most_steps):
        if at == last:
            break
        target = last if abs(last - at) <= abs(length) * (1.0 + 1e-9) else at + length
        solved = step(path(target), here, before, (target - at) / previous if before else 0.0, solver)
        if solved is None:
            length *= 0.5
            if abs(length) < shortest:
                break
            continue
        previous = target - at
        here, before, at = solved, here, target
        most = elements_for(len(here.bound.mesh) - 1, *error_estimate(here))
        if most:
            here, error, _ = refine(here, RESOLVED, solver, most)
            before = None
            if not error <= ROUGH:
                break
        if solved.solution.iterations <= few_iterations:
            length *= 2.0
    return here, at
