"""One pose by the paper's own transcription, certified by the collocation.

The paper's equations are solved on more and more points until the shape agrees with a collocation solve that starts
from it. Their own residual cannot tell: an overdetermined system keeps one, and without enough points its
least-squares minimum is no shape of the cable.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness_opt.errors import ProblemError, Status
from harness_opt.numerics.interface import Options
from harness_opt.rod.boundary import Case
from harness_opt.rod.differential_quadrature import FEWEST, MOST, Dqm
from harness_opt.rod.states import Rod
from harness_opt.statics.mesh import ELEMENTS, refine
from harness_opt.statics.solve import SOLVER_OF, resample, solve_on

START_SOLVER = "gauss-newton"  # of the collocation, where the first shape and the certificate come from


@dataclass(frozen=True)
class QuadratureSolve:
    """How a solve by differential quadrature ended.

    Args:
        rod: the shape, on the Chebyshev points as mesh.
        points: N.
        residual: largest residual of the overdetermined system.
        iterations: of the solver.
        error: distance to the collocation's shape, in L.
        status: OK where the error is at most the tolerance.
    """

    rod: Rod
    points: int
    residual: float
    iterations: int
    error: float
    status: Status


@dataclass(frozen=True)
class Quadrature:
    """How to solve by differential quadrature.

    Args:
        points: N, 5 to 200; None takes more until the tolerance holds.
        closure: whether the length closure (25) is among the equations; it limits the accuracy to about 1 / N^2.
        solver: name.
        tolerance: of the centreline, in L.

    Raises:
        ProblemError: a number of points that the method cannot have.
    """

    points: int | None
    closure: bool
    solver: str
    tolerance: float

    def __post_init__(self) -> None:
        n = self.points
        if n is not None and not (isinstance(n, int) and FEWEST <= n <= MOST):
            raise ProblemError(f"points: found {n!r}, expected a whole number from {FEWEST} to {MOST}")


def solve_by_quadrature(case: Case, start: Rod, options: Quadrature) -> QuadratureSolve:
    """Solve ``case`` by the paper's equations from the shape ``start``, whose signs its quaternions have."""
    points_tried = (21, 31, 45, 61, 81)  # tried in turn where the number is left open
    for count in (options.points,) if options.points is not None else points_tried:
        answer = _solve(case, start, count, options)
        if answer.status.ok:
            break
    return answer


def _solve(case: Case, start: Rod, points: int, options: Quadrature) -> QuadratureSolve:
    # the tail of (26) is long
    most_iterations = {"gauss-newton": 60, "levenberg-marquardt": 500, "ipopt": 200, "paper": 500}
    method = Dqm(case, points, options.closure)
    nodes = method.rule.nodes
    at = start.sample(nodes)
    limits = Options(iterations=most_iterations[options.solver], stationary=True)
    solution = SOLVER_OF[options.solver](method.least_squares(), method.pack(at.q, at.force), limits)
    q, moment, force = method.states(solution.x, nodes)
    rod = Rod(case.section, case.load, nodes, q, method.centreline(solution.x, nodes), force, moment)
    status, error = solution.status, np.inf
    if status.ok:
        error = _distance(case, rod, options.tolerance)
        status = Status.OK if error <= options.tolerance else Status.INACCURATE
    return QuadratureSolve(rod, points, solution.residual, solution.iterations, error, status)


def _distance(case: Case, rod: Rod, tolerance: float) -> float:
    """Return how far ``rod`` is from the collocation's shape next to it, in L; infinite where there is none."""
    most_apart = 0.05  # in L; a collocation solve that ends further away found another shape
    mesh = np.linspace(0.0, 1.0, 2 * ELEMENTS[0] + 1)
    solved = solve_on(case, mesh, resample(rod, mesh), START_SOLVER)
    if not solved.ok or solved.turned:
        return np.inf
    solved, _, status = refine(solved, 0.1 * tolerance, START_SOLVER)
    distance = float(np.max(np.linalg.norm(solved.rod.sample(rod.mesh).r - rod.r, axis=-1)))
    return distance if status.ok and distance < most_apart else np.inf
