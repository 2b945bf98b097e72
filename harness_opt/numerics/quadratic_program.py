"""The quadratic program of one step of a redesign: limits linearised, with one slack for those that must hold and one
for those whose shortfall is to be least.

    minimise    d'H d / 2 + g'd + PENALTY t + e
    subject to  margin + rate d + t >= 0  for the hard rows,   t >= 0,
                margin + rate d + e >= 0  for the soft rows,   e >= floor,
                lowest <= d <= highest.

The exact penalty of one elastic slack: Nocedal and Wright, "Numerical Optimization", section 18.5. Solved by CasADi's
primal-dual interior-point method: the active-set methods that come with CasADi give up on, or go round in, programs
whose rows are nearly the same, as those of neighbouring frames are. One of them, DAQP, stands in where it fails.
"""

from __future__ import annotations

import contextlib
import io
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from harness_opt.numerics.rotations import Array

PENALTY = 100.0  # of the hard rows' slack; above any multiplier of an objective of order one


@dataclass(frozen=True, eq=False)
class Program:
    """One quadratic program in k unknowns and m rows.

    Args:
        curvature: diagonal of H, (k,).
        gradient: (k,).
        margin: (m,), negative where a row is violated.
        rate: (m, k).
        soft: (m,), which rows are soft.
        floor: of e; -inf has the soft rows hold by as much as possible.
        lowest, highest: (k,).
    """

    curvature: Array
    gradient: Array
    margin: Array
    rate: Array
    soft: NDArray[np.bool_]
    floor: float
    lowest: Array
    highest: Array


@dataclass(frozen=True, eq=False)
class Answer:
    """Its solution.

    Args:
        step: d, (k,).
        slack: t, by how much a hard row stays short.
        shortfall: e, as far as the linearised soft rows tell; 0 without soft rows.
        multipliers: (m,), >= 0: how much the objective falls for each unit that a row's margin is raised.
        bounds: (k,), the same for the highest (positive) and the lowest (negative) values.
    """

    step: Array
    slack: float
    shortfall: float
    multipliers: Array
    bounds: Array


def solve(program: Program) -> Answer:
    """Return the solution of ``program``; it has one, whatever the rows are."""
    least_curvature = 1e-6  # curvature of the objective everywhere: keeps the step unique where the objective does not
    silent = {"print_iter": False, "print_header": False, "print_info": False}
    slack_curvature = 1e-6  # the same of the slacks, for the method that needs it
    k, m = len(program.gradient), len(program.margin)
    # without soft rows there is no e: an interior point needs room between the bounds of every unknown
    any_soft = int(np.any(program.soft))
    gradient = np.concatenate([program.gradient, [PENALTY, 1.0][: 1 + any_soft]])
    rows = np.hstack([program.rate, ~program.soft[:, None], program.soft[:, None]]).astype(float)[:, : k + 1 + any_soft]
    lower = np.concatenate([program.lowest, [0.0, program.floor][: 1 + any_soft]])
    upper = np.concatenate([program.highest, [np.inf] * (1 + any_soft)])
    given = {"g": gradient, "a": rows, "lba": -program.margin, "lbx": lower, "ubx": upper}
    shapes = {"h": ca.Sparsity.dense(len(gradient), len(gradient)), "a": ca.Sparsity.dense(m, len(gradient))}
    ways: tuple[tuple[float, str, dict[str, Any]], ...] = ((0.0, "ipqp", silent), (slack_curvature, "daqp", {}))
    for curvature, name, options in ways:
        given["h"] = np.diag(np.concatenate([program.curvature + least_curvature, [curvature] * (1 + any_soft)]))
        solver = ca.conic("step", name, shapes, {**options, "error_on_fail": False})
        with contextlib.redirect_stderr(io.StringIO()):  # what the first one warns of, the second one takes care of
            answer = solver(**given)
        if solver.stats()["success"] and np.all(np.isfinite(np.asarray(answer["x"]))):
            break
    x = np.asarray(answer["x"]).ravel()
    return Answer(
        np.clip(x[:k], program.lowest, program.highest),
        float(x[k]),
        float(x[k + 1]) if any_soft else 0.0,
        np.maximum(-np.asarray(answer["lam_a"]).ravel(), 0.0),
        np.asarray(answer["lam_x"]).ravel()[:k],
    )
