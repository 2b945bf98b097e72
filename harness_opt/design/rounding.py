"""A design with values that can be cut and drilled: the variables that moved, rounded so that the limits still hold."""

from __future__ import annotations

import itertools
import math

import numpy as np

from harness_opt.design.evaluation import Evaluated
from harness_opt.design.objective import Objective
from harness_opt.model.problem import Problem
from harness_opt.numerics.rotations import Array

MOST_WAYS = 10  # variables of which both neighbours are tried, 1,024 designs at most; of further ones the nearest


def rounded(problem: Problem, objective: Objective, best: Evaluated) -> Array:
    """Return the values (k,) of ``best``, rounded as the problem asks, inside the bounds.

    What moved by less than half of that goes back to where it was drawn. Of the neighbours up and down, those are taken
    that hold the linearised limits best, and then have the lower objective. What others follow stays as it is.

    Args:
        problem: with the design's variables.
        objective: what was sought.
        best: the design, with its derivatives.
    """
    choices = [_choices(problem, objective, best, number) for number in range(len(best.values))]
    open_ones = [number for number, values in enumerate(choices) if len(values) > 1]
    for number in open_ones[MOST_WAYS:]:
        choices[number] = [min(choices[number], key=lambda value, n=number: abs(value - best.values[n]))]  # type: ignore[misc]
    ways = (np.array(values) for values in itertools.product(*choices))
    return min(ways, key=lambda values: objective.merit(best, values))


def _choices(problem: Problem, objective: Objective, best: Evaluated, number: int) -> list[float]:
    """Return what the variable with this ``number`` may be rounded to."""
    design, value = problem.design, float(best.values[number])
    name, drawn = design.variables[number].name, float(objective.centre[number])
    unit = design.round_deg if name.endswith("_deg") else design.round_length
    if value == drawn or any(coupling.leader == name for coupling in design.couplings):
        return [value]
    if abs(value - drawn) <= 0.5 * unit:
        return [drawn]
    if unit == 0.0:
        return [value]
    below = math.floor(value / unit)
    lower, upper = objective.lower[number], objective.upper[number]
    inside = [n * unit for n in (below, below + 1) if lower <= n * unit <= upper]
    return [float(f"{n:.12g}") for n in inside] or [value]
