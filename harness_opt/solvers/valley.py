"""Solving along a valley: equations that determine all directions but one well, and that one hardly at all.

A loop slides along a cable, or a cable about its clamps, almost for nothing; Newton's steps along that direction are
then as long as their linearisation is wrong. So the direction is taken out (the Lyapunov-Schmidt reduction): with the
null vectors u and v of the Jacobian,

    R(x) + mu u = 0,    v . (x - x0) = t

is well conditioned and gives a curve x(t), the floor of the valley, and mu(t), how steep it is there. What is left is
one equation in one unknown, mu(t) = 0. Govaerts, "Numerical Methods for Bifurcations of Dynamical Equilibria",
sections 3.2 and 3.3.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse.linalg as spla

from ..errors import Status
from .interface import Array, LeastSquares, Options, Solution, largest
from .linear import LIGHT, bordered_matrix, null_vectors

STEPS = 80  # along the valley
RISES = 4  # steps to where a slope of the same sign is steeper: one that has no root is least somewhere, and rises
CORRECTIONS = 8  # Newton steps back to its floor
FIRST_STEP = 0.1  # of x
GROWTH = 3.0  # most that a step may be longer than the last one
BEND = 0.5  # rad, most that the valley may turn in a step
SMALLEST_STEP = 1e-6


def solve(problem: LeastSquares, x: Array, options: Options) -> Solution:
    """Solve ``problem``, of as many equations as unknowns, from ``x`` (n,) near the floor of a valley.

    It never raises for lack of convergence: the status says how it ended.
    """
    step, spent, rises = 0.0, 0, 0
    steep: float | None = None
    across = null_vectors(problem.linearise(x)[1])
    for _ in range(STEPS):
        if across is None:
            break
        found, used = _floor(problem, x, across, step, options.tolerance)
        spent += used
        beyond = None if found is None else null_vectors(problem.linearise(found[0])[1], across)
        if found is None or beyond is None or (step and np.linalg.norm(beyond[1] - across[1]) > BEND):
            step *= 0.5
            if abs(step) < SMALLEST_STEP:
                break
            continue
        (x, slope), across = found, beyond
        residual = largest(problem.residual(x))
        if residual <= options.tolerance:
            return Solution(x, Status.OK, residual, spent)
        rises += steep is not None and slope * steep > 0.0 and abs(slope) > abs(steep)
        if rises > RISES:
            break
        longest = GROWTH * abs(step)
        if steep is None:
            step = FIRST_STEP
        elif steep == slope:
            step *= GROWTH
        else:
            step = float(np.clip(slope / (steep - slope) * step, -longest, longest))
        steep = slope
    return Solution(x, Status.STALLED, largest(problem.residual(x)), spent)


def _floor(
    problem: LeastSquares, x: Array, across: tuple[Array, Array], step: float, tolerance: float
) -> tuple[tuple[Array, float] | None, int]:
    """Return the point of the floor ``step`` along the valley from ``x``, its steepness, and the iterations spent.

    None in place of the point where they do not converge.
    """
    left, right = across
    there, slope = x + step * right, 0.0
    for iteration in range(CORRECTIONS + 1):
        residual, jacobian = problem.linearise(there)
        missed = np.append(residual + slope * left, LIGHT * (right @ (there - x) - step))
        if largest(missed) <= tolerance:
            return (there, slope), iteration
        if iteration == CORRECTIONS or not np.all(np.isfinite(jacobian.data)):
            break
        change = spla.splu(bordered_matrix(jacobian, left, right), permc_spec="NATURAL").solve(-missed)
        there, slope = there + change[:-1], slope + float(change[-1])
    return None, CORRECTIONS
