"""Solving along a near-null direction: equations that determine all directions well but one, and that one hardly.

A loop moves along a cable, or a cable turns about its clamps, almost for nothing; Newton's steps along that direction
are then as long as their linearisation is wrong. So the direction is taken out (the Lyapunov-Schmidt reduction): with
the null vectors u and v of the Jacobian,

    R(x) + mu u = 0,    v . (x - x0) = t

is well conditioned and gives a curve x(t), the near-null curve, and mu(t), how steep the energy is along it. What
is left is one equation in one unknown, mu(t) = 0. Govaerts, "Numerical Methods for Bifurcations of Dynamical
Equilibria", sections 3.2 and 3.3. Where the energy is known, the curve is followed down it, past places where it is
nearly level: the slope alone does not tell these from a minimum nearby.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse.linalg as spla

from harness_opt.errors import Status
from harness_opt.numerics.interface import LeastSquares, Options, Solution, largest
from harness_opt.numerics.linear import LIGHT, bordered_matrix, null_vectors
from harness_opt.numerics.rotations import Array

STEPS, FEW = 120, 6  # along the near-null curve: as far as it goes, or nearby
ENERGY_NOISE = 1e-10  # relative: a change of the energy that the solver may have made by what it leaves


def solve(
    problem: LeastSquares,
    x: Array,
    options: Options,
    energy: Callable[[Array], float] | None = None,
    *,
    steps: int = STEPS,
) -> Solution:
    """Solve ``problem``, of as many equations as unknowns, from ``x`` (n,) near its near-null curve.

    It never raises for lack of convergence: the status says how it ended.

    Args:
        problem, x, options: as of every solver.
        energy: what solutions are stationary points of; None where there is none.
        steps: most that are taken along the curve.
    """
    first_growth, later_growth = 3.0, 1.25  # most that a step may grow: at first, and after one was too long
    first_step, least_step = 0.1, 1e-6  # of x
    most_rises = 4  # steps to where a slope of the same sign is steeper: one without a root rises past its least
    most_turn = 0.5  # rad, most that the near-null direction may turn in a step
    step, spent, rises, down, growth = 0.0, 0, 0, 0.0, first_growth
    steep: float | None = None
    level: float | None = None
    across = null_vectors(problem.linearise(x)[1])
    for _ in range(steps):
        if across is None:
            break
        found, used = _point_on_curve(problem, x, across, step, options.tolerance)
        spent += used
        beyond = None if found is None else null_vectors(problem.linearise(found[0])[1], across)
        if found is None or beyond is None or (step and np.linalg.norm(beyond[1] - across[1]) > most_turn):
            step, growth = 0.5 * step, later_growth
            if abs(step) < least_step:
                break
            continue
        (x, slope), across = found, beyond
        residual = largest(problem.residual(x))
        if residual <= options.tolerance:
            return Solution(x, Status.OK, residual, spent)
        if energy is not None and not down:
            above, level = level, energy(x)
            if above is not None and abs(level - above) > ENERGY_NOISE * (1.0 + abs(level)):
                down = float(np.sign(step * (above - level) * (steep or slope)))  # times the slope: which way is down
        rises += not down and steep is not None and slope * steep > 0.0 and abs(slope) > abs(steep)
        if rises > most_rises:
            break
        longest = growth * abs(step)
        if steep is None:
            step = first_step
        elif steep == slope:
            step *= growth
        else:
            step = float(np.clip(slope / (steep - slope) * step, -longest, longest))
        if down and step * down * slope < 0.0:  # away from where the slope would vanish, but on the way down
            step = float(np.copysign(longest, -step))
        steep = slope
    return Solution(x, Status.STALLED, largest(problem.residual(x)), spent)


def _point_on_curve(
    problem: LeastSquares, x: Array, across: tuple[Array, Array], step: float, tolerance: float
) -> tuple[tuple[Array, float] | None, int]:
    """Return the point of the near-null curve ``step`` on from ``x``, the slope there, and the iterations spent.

    None in place of the point where they do not converge.
    """
    diverged = 2.0  # times what was missed before: Newton's steps do not come back
    most_corrections = 8  # Newton steps back to the curve
    left, right = across
    there, slope, before = x + step * right, 0.0, np.inf
    for iteration in range(most_corrections + 1):
        residual, jacobian = problem.linearise(there)
        missed = np.append(residual + slope * left, LIGHT * (right @ (there - x) - step))
        size = largest(missed)
        if size <= tolerance:
            return (there, slope), iteration
        if iteration == most_corrections or size > diverged * before or not np.all(np.isfinite(jacobian.data)):
            break
        before = size
        change = spla.splu(bordered_matrix(jacobian, left, right), permc_spec="NATURAL").solve(-missed)
        there, slope = there + change[:-1], slope + float(change[-1])
    return None, iteration
