"""IPOPT on the least-squares problem, posed with one slack per residual.

Minimise |y|^2 / 2 subject to R(x) = y. The slack form keeps the conditioning of R where |R|^2 would square it, and the
Hessian handed over is Gauss-Newton's (the identity on the slacks), so IPOPT adds its filter line search and its
regularisation to Gauss-Newton's steps. Waechter and Biegler, Math. Program. 106 (2006).
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from ..errors import Status
from .interface import QUIET, Array, LeastSquares, Options, Solution, largest

FINAL = 1e-3  # of the tolerance: where the problem is badly conditioned, a residual just below it is not enough


def solve(problem: LeastSquares, x: Array, options: Options) -> Solution:
    """Solve ``problem`` from ``x`` (n,); never raises for lack of convergence, the status says how it ended."""
    unknowns, residual = problem.symbolic()
    slack = ca.SX.sym("slack", residual.numel())
    both = ca.vertcat(unknowns, slack)
    count, parameter = unknowns.numel(), ca.SX.sym("p", 0)
    multipliers = ca.SX.sym("lam_g", residual.numel())
    factor = ca.SX.sym("lam_f")
    slack_part = ca.diagcat(ca.SX(count, count), factor * ca.SX.eye(residual.numel()))
    hessian = ca.Function(
        "nlp_hess_l",
        [both, parameter, factor, multipliers],
        [ca.triu(slack_part)],
        ["x", "p", "lam_f", "lam_g"],
        ["hess"],
    )
    nlp = {"x": both, "f": 0.5 * ca.sumsqr(slack), "g": residual - slack}
    settings: dict[str, Any] = {
        **QUIET,
        "hess_lag": hessian,
        "ipopt.max_iter": options.iterations,
        "ipopt.tol": FINAL * options.tolerance,
    }
    solver = ca.nlpsol("least_squares", "ipopt", nlp, settings)
    start = np.concatenate([x, problem.residual(x)])
    answer = solver(x0=start, lbg=0.0, ubg=0.0)
    x = np.asarray(answer["x"]).ravel()[:count]
    final = largest(problem.residual(x))
    iterations = int(solver.stats()["iter_count"])
    if final <= options.tolerance or (options.stationary and solver.stats()["success"]):
        status = Status.OK
    elif not np.isfinite(final):
        status = Status.NOT_FINITE
    else:
        status = Status.ITERATION_LIMIT if iterations >= options.iterations else Status.STALLED
    return Solution(x, status, final, iterations)
