"""Where a redesign begins: at the drawn design, or at the nearest one within the bounds whose cables have a shape."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from harness_opt.clearance.limits import all_limits
from harness_opt.clearance.measure import measure
from harness_opt.design.evaluation import SPARE, Evaluated, Evaluator
from harness_opt.design.looks import looks
from harness_opt.design.margins import Rows, reach_rows
from harness_opt.design.objective import Objective
from harness_opt.errors import ProblemError
from harness_opt.model import design_variables
from harness_opt.model.reach import shortest, too_short
from harness_opt.model.results import LimitResult, Motion
from harness_opt.motion.simulate import simulate
from harness_opt.numerics.quadratic_program import Program, solve
from harness_opt.numerics.rotations import Array

CONVERGED = 1e-6  # of a cable's length
ROUNDS = 3  # of looks for a design that can be simulated


@dataclass(frozen=True)
class Beginning:
    """The first design, and the drawn one beside it.

    Args:
        first: simulated; None where none within the bounds could be.
        motion: of the drawn design; without frames where no shape joins its clamps.
        limits: of that motion; None where there is none.
        short: by how much cables were drawn too short for their clamps, m, by name.
    """

    first: Evaluated | None
    motion: Motion
    limits: tuple[LimitResult, ...] | None
    short: Mapping[str, float] = field(default_factory=dict)


def beginning(evaluate: Evaluator, objective: Objective, values: Array) -> Beginning:
    """Return where a redesign begins that would begin at ``values`` (k,) if it could.

    Raises:
        ProblemError: cables that are too short for their clamps within all bounds.
    """
    problem = evaluate.problem
    first = evaluate(values, None)
    short = too_short(problem, problem.cables)
    if first is None:
        joined = joinable(evaluate, objective, values)
        if np.min(_reach(evaluate, joined).margin, initial=np.inf) < -SPARE:
            raise ProblemError(f"{line}, which no design within the bounds gives it" for line in short.values())
        first = evaluate(joined, None) if np.any(joined != values) else None
    for number in range(ROUNDS):
        seen = [] if first is not None else looks(evaluate, objective, None, number)
        for look in sorted(seen, key=lambda one: objective.preference(one.values)):
            first = first or evaluate(look.values, look)
    if short:
        by = {name: shortest(problem, name)[0] - problem.cables[name].cable.length for name in short}
        return Beginning(first, Motion(problem, np.zeros(0), {}), None, by)
    if first is not None and np.array_equal(first.values, design_variables.values(problem)):
        return Beginning(first, first.motion, all_limits(problem, first.motion, first.clearances))
    drawn = simulate(problem, solver=evaluate.solver, progress=evaluate.progress, throw=False)
    if not len(drawn.motion):
        return Beginning(first, drawn, None)
    found = measure(problem, evaluate.scene, drawn.motion, drawn.cables)
    return Beginning(first, drawn, all_limits(problem, drawn, found))


def joinable(evaluate: Evaluator, objective: Objective, values: Array) -> Array:
    """Return the values (k,) nearest to ``values`` (k,) with which no cable is too short.

    Distances of clamps are convex in where they stand, and those stand where the variables put them: a few quadratic
    programs find the nearest design, or the least short one where all are too short.

    Args:
        evaluate: of the problem, in whose frames the clamps have to be reached.
        objective: with the bounds, and the weights of changes.
        values: where to begin.
    """
    weights = np.maximum(objective.weights, 1e-3)  # what changes for nothing is not changed for nothing either
    at = values
    for _ in range(20):  # quadratic convergence: 3 to 5 do
        rows = _reach(evaluate, at)
        if np.min(rows.margin, initial=np.inf) >= -CONVERGED:
            break
        change = (at - values) / objective.range
        lowest, highest = ((bound - at) / objective.range for bound in (objective.lower, objective.upper))
        hard, rate = np.zeros(len(rows.margin), dtype=bool), rows.rate * objective.range
        program = Program(weights, weights * change, rows.margin, rate, hard, 0.0, lowest, highest)
        step = solve(program).step
        at = np.clip(at + step * objective.range, objective.lower, objective.upper)
    return at


def _reach(evaluate: Evaluator, values: Array) -> Rows:
    """Return by how much the cables are long enough in all frames, at the design ``values`` (k,)."""
    problem, motion = evaluate.problem, evaluate.frames
    changed = design_variables.apply(problem, values)
    rates = {name: design_variables.clamp_rates(problem, name, values, motion) for name in changed.cables}
    return Rows.joined([reach_rows(changed, name, motion, rates[name], evaluate.spare[name]) for name in rates])
