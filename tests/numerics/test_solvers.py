"""Solvers on problems that are no rods: none says yes where it is no, and each says why."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest
import scipy.sparse as sp

import harness_opt as ho
from harness_opt.numerics.interface import LeastSquares, Options, Solution, largest
from harness_opt.numerics.linear import factorise
from harness_opt.statics.solve import SOLVER_OF


def least_squares(count: int, residual) -> LeastSquares:
    """Return the problem of ``residual``, a function from a CasADi vector to a list of expressions."""
    x = ca.SX.sym("x", count)
    r = ca.vertcat(*residual(x))
    value, slope = ca.Function("r", [x], [r]), ca.Function("j", [x], [ca.densify(ca.jacobian(r, x))])

    def at(x: np.ndarray) -> np.ndarray:
        return np.asarray(value(x)).ravel()

    return LeastSquares(at, lambda x: (at(x), sp.csc_array(np.asarray(slope(x)))), lambda: (x, r))


def solve(name: str, problem: LeastSquares, start, **options) -> Solution:
    """Solve, and check that what the solution says of itself is true."""
    given = Options(**options)
    solution = SOLVER_OF[name](problem, np.asarray(start, dtype=float), given)
    reached = largest(problem.residual(solution.x))
    assert solution.residual == pytest.approx(reached, rel=1e-12) or not np.isfinite(reached)
    assert solution.status.ok == (reached <= given.tolerance)
    assert 0 <= solution.iterations <= given.iterations
    return solution


ROSENBROCK = least_squares(2, lambda x: [10 * (x[1] - x[0] ** 2), 1 - x[0]])
POWELL = least_squares(  # its Jacobian loses two ranks at the root
    4,
    lambda x: [
        x[0] + 10 * x[1],
        np.sqrt(5) * (x[2] - x[3]),
        (x[1] - 2 * x[2]) ** 2,
        np.sqrt(10) * (x[0] - x[3]) ** 2,
    ],
)
BY_SOLVER = pytest.mark.parametrize("name", SOLVER_OF)


@BY_SOLVER
@pytest.mark.parametrize("start", [(-1.2, 1.0), (5.0, -3.0), (1.0, 1.0)])
def test_rosenbrock(name, start):
    solution = solve(name, ROSENBROCK, start)
    assert solution.status is ho.Status.OK
    np.testing.assert_allclose(solution.x, [1, 1], atol=1e-9)


@BY_SOLVER
def test_powell_singular(name):
    solution = solve(name, POWELL, (3.0, -1.0, 0.0, 1.0), tolerance=1e-10, iterations=100)
    assert solution.status is ho.Status.OK
    assert np.max(np.abs(solution.x)) < 1e-4


@BY_SOLVER
def test_iteration_limit(name):
    solution = solve(name, ROSENBROCK, (-1.2, 1.0), iterations=1)
    assert solution.status is ho.Status.ITERATION_LIMIT
    assert solution.iterations == 1


@BY_SOLVER
@pytest.mark.parametrize(
    "residual",
    [
        lambda x: [x[0] ** 2 + 1, x[1]],
        lambda x: [x[0], x[0] - 1, x[1]],
        lambda x: [ca.cos(x[0]) + 2, x[1] - x[0]],
        lambda x: [x[0] * x[1] - 1, x[0] * x[1] + 1],
    ],
    ids=["square", "contradiction", "wave", "two hyperbolas"],
)
def test_no_root_is_never_ok(name, residual):
    solution = solve(name, least_squares(2, residual), (0.7, 0.4))
    assert solution.status in (ho.Status.STALLED, ho.Status.ITERATION_LIMIT)
    assert np.all(np.isfinite(solution.x)) and solution.residual >= 0.4


@BY_SOLVER
def test_stalled_at_the_least_squares_point(name):
    solution = solve(name, least_squares(2, lambda x: [x[0], x[0] - 1, x[1] - 2]), (3.0, 3.0))
    assert solution.status is ho.Status.STALLED
    np.testing.assert_allclose(solution.x, [0.5, 2.0], atol=1e-6)


@BY_SOLVER
def test_not_finite_from_the_start(name):
    solution = solve(name, least_squares(1, lambda x: [ca.log(x[0])]), [-1.0])
    assert solution.status is ho.Status.NOT_FINITE


@BY_SOLVER
def test_jacobian_that_is_not_finite(name):
    solution = solve(name, least_squares(2, lambda x: [ca.sqrt(x[0]) - 1, x[1] - 1]), [0.0, 0.0])
    assert solution.status is not ho.Status.OK
    assert np.all(np.isfinite(solution.x))


@pytest.mark.parametrize("name", [name for name in SOLVER_OF if name != "paper"])  # (26) takes every step
def test_steps_shorten_where_the_residual_ends(name):
    # a full Newton step from 1 lands at -4, where there is no logarithm
    solution = solve(name, least_squares(1, lambda x: [ca.log(x[0]) + 5]), [1.0])
    assert solution.status is ho.Status.OK
    assert solution.x[0] == pytest.approx(math.exp(-5), rel=1e-9)


@BY_SOLVER
def test_residual_that_becomes_not_a_number(name):
    # downhill leads to the edge of the domain, and there is no root before it
    solution = solve(name, least_squares(1, lambda x: [ca.sqrt(x[0]) + x[0] + 0.5]), [2.0])
    assert solution.status is not ho.Status.OK
    assert np.all(np.isfinite(solution.x)) and solution.residual >= 0.5


@pytest.mark.parametrize("name", ["gauss-newton", "levenberg-marquardt"])
@pytest.mark.parametrize("rows", [1, 2, 3])
def test_rank_deficient_problem_gets_the_nearest_root(name, rows):
    # roots: the plane x + y + z = 3; the nearest to the start is its foot
    start = np.array([4.0, 1.0, -5.0])
    problem = least_squares(3, lambda x: [(k + 1) * (x[0] + x[1] + x[2] - 3) for k in range(rows)])
    solution = solve(name, problem, start)
    assert solution.status is ho.Status.OK
    np.testing.assert_allclose(solution.x, start - (start.sum() - 3) / 3, atol=1e-9)


@pytest.mark.parametrize("lost", [0, 1, 2, 5])
@pytest.mark.parametrize("shape", [(12, 12), (15, 12), (10, 12)], ids=str)
def test_linear_steps_are_those_of_the_pseudoinverse(shape, lost):
    random = np.random.default_rng(3)
    rank = min(shape) - lost
    matrix = random.normal(size=(shape[0], rank)) @ random.normal(size=(rank, shape[1]))
    right = random.normal(size=(shape[0], 3))
    factor = factorise(sp.csc_array(matrix))
    expected = np.linalg.pinv(matrix, rcond=1e-10) @ right
    np.testing.assert_allclose(factor.solve(right), expected, atol=1e-8 * np.max(np.abs(expected)))
    np.testing.assert_allclose(factor.solve(right[:, 0]), expected[:, 0], atol=1e-8 * np.max(np.abs(expected)))
    assert factor.singular == (lost > 0 or shape[0] != shape[1])
