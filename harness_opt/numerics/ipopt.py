"""IPOPT on the least-squares problem, posed with one slack per residual.

Minimise |y|^2 / 2 subject to R(x) = y. The slack form keeps the conditioning of R where |R|^2 would square it, and the
Hessian handed over is Gauss-Newton's (the identity on the slacks), so IPOPT adds its filter line search and its
regularisation to Gauss-Newton's steps. Waechter and Biegler, Math. Program. 106 (2006).
"""

from __future__ import annotations

import functools
from typing import Any

import casadi as ca
import numpy as np

from harness_opt.errors import Status
from harness_opt.numerics.interface import Equations, LeastSquares, Options, Solution, largest
from harness_opt.numerics.rotations import Array


@functools.lru_cache(maxsize=16)
def _program(equations: Equations, iterations: int, tolerance: float) -> ca.Function:
    """Return IPOPT on ``equations``, built once for each kind of problem."""
    final_share = 1e-3  # of the tolerance: where conditions are bad, a residual just below it is not enough
    proximal = 1e-9  # on the diagonal of the unknowns: a direction that the equations leave open is not moved along
    unknowns, parameters, residual = equations.unknowns, equations.parameters, equations.residual
    slack, multipliers = ca.SX.sym("slack", residual.numel()), ca.SX.sym("lam_g", residual.numel())
    both, factor = ca.vertcat(unknowns, slack), ca.SX.sym("lam_f")
    slack_part = ca.diagcat(proximal * ca.SX.eye(unknowns.numel()), factor * ca.SX.eye(residual.numel()))
    hessian = ca.Function(
        "nlp_hess_l",
        [both, parameters, factor, multipliers],
        [ca.triu(slack_part)],
        ["x", "p", "lam_f", "lam_g"],
        ["hess"],
    )
    nlp = {"x": both, "p": parameters, "f": 0.5 * ca.sumsqr(slack), "g": residual - slack}
    settings: dict[str, Any] = {
        "print_time": False,
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",  # keeps IPOPT off stdout
        "hess_lag": hessian,
        "ipopt.max_iter": iterations,
        "ipopt.tol": final_share * tolerance,
    }
    return ca.nlpsol("least_squares", "ipopt", nlp, settings)


def solve(problem: LeastSquares, x: Array, options: Options) -> Solution:
    """Solve ``problem`` from ``x`` (n,); never raises for lack of convergence, the status says how it ended."""
    if problem.parametric is not None:
        equations, values = problem.parametric()
    else:
        unknowns, residual = problem.symbolic()
        equations, values = Equations(unknowns, ca.SX.sym("p", 0), residual), np.zeros(0)
    # the tolerance follows the loads; in whole decades, few programs are built
    decade = 10.0 ** np.ceil(np.log10(options.tolerance))
    solver = _program(equations, options.iterations, decade)
    start = np.concatenate([x, problem.residual(x)])
    answer = solver(x0=start, p=values, lbg=0.0, ubg=0.0)
    x = np.asarray(answer["x"]).ravel()[: len(x)]
    final = largest(problem.residual(x))
    iterations = int(solver.stats()["iter_count"])
    if final <= options.tolerance or (options.stationary and solver.stats()["success"]):
        status = Status.OK
    elif not np.isfinite(final):
        status = Status.NOT_FINITE
    else:
        status = Status.ITERATION_LIMIT if iterations >= options.iterations else Status.STALLED
    return Solution(x, status, final, iterations)
