"""Where descents begin: at the drawn design, or the nearest one that has shapes; and at the best of many looked at.

A descent ends in the valley that it began in: at the middle of a plate no slope tells where its slot is, and another
valley may hold with less change. A look solves a few frames of each design; once a design holds, only such designs are
looked at as could be better.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from harness_opt.clearance.limits import all_limits
from harness_opt.clearance.measure import measure
from harness_opt.design.evaluation import SEARCH_STRIDE, SPARE, Evaluated, Evaluator
from harness_opt.design.margins import Rows, reach_rows
from harness_opt.design.objective import CLOSE, Objective
from harness_opt.design.sqp import SMALL, TRUST
from harness_opt.errors import ProblemError
from harness_opt.model import design_variables
from harness_opt.model.results import LimitResult, Motion
from harness_opt.model.spans import in_spans, too_short
from harness_opt.motion.simulate import simulate
from harness_opt.numerics.quadratic_program import Program, solve
from harness_opt.numerics.rotations import Array

CONVERGED = 1e-6  # of a cable's length
ROUNDS = 3  # of looks for a design that can be simulated
FRAMES = 5  # of the motion that a look solves
LOOKS = 32  # for each variable, where no design holds yet
LOOKS_BESIDE = 8  # for each variable, where one does, and another could only be better
APART = 0.1  # of the bounds' ranges: starts nearer to each other than that lead to one end


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
            raise ProblemError(f"{one.message}, which no design within the bounds gives it" for one in short)
        first = evaluate(joined, None) if np.any(joined != values) else None
    for number in range(ROUNDS):
        seen = [] if first is not None else looks(evaluate, objective, None, number)
        for look in sorted(seen, key=lambda one: objective.preference(one.values)):
            first = first or evaluate(look.values, None)
    if short:
        by = {one.spans[0]: one.by for one in short}
        return Beginning(first, Motion(problem, np.zeros(0), {}), None, by)
    if first is not None and np.array_equal(first.values, design_variables.values(problem)):
        return Beginning(first, first.motion, all_limits(problem, first.motion, first.clearances))
    drawn = simulate(problem, solver=evaluate.solver, progress=evaluate.progress, throw=False)
    if not len(drawn.motion):
        return Beginning(first, drawn, None)
    found = measure(drawn.problem, evaluate.scene, drawn.motion, drawn.cables)
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
    changed = in_spans(design_variables.apply(problem, values))
    rates = {name: design_variables.clamp_rates(problem, name, values, motion) for name in changed.cables}
    return Rows.joined([reach_rows(changed, name, motion, rates[name], evaluate.spare[name]) for name in rates])


def spread(first: int, count: int, dimensions: int, seed: int) -> Array:
    """Return points ``first`` to ``first + count`` (count, dimensions) of a sequence that fills the unit cube evenly.

    The additive recurrence whose steps are powers of the root of x^(d + 1) = x + 1 (Roberts, "The unreasonable
    effectiveness of quasirandom sequences", 2018), shifted at random by ``seed`` (Cranley and Patterson, "Randomization
    of number theoretic methods for multiple integration", SIAM J. Numer. Anal. 13 (1976)); scipy.stats has others, at
    a third of a second of import.
    """
    root = 1.5
    for _ in range(60):  # a contraction by at least a half each time
        root = (1.0 + root) ** (1.0 / (dimensions + 1))
    steps = root ** -np.arange(1.0, dimensions + 1)
    shift = np.random.default_rng(seed).random(dimensions)
    return (shift + np.outer(np.arange(first + 1, first + count + 1), steps)) % 1.0


def coarse_stride(evaluate: Evaluator) -> int:
    """Return of how many frames of the motion a look solves one: a multiple of what the search does, to share them."""
    return SEARCH_STRIDE * math.ceil((len(evaluate.frames) - 1) / (SEARCH_STRIDE * (FRAMES - 1))) or 1


def looks(
    evaluate: Evaluator, objective: Objective, best: Evaluated | None, number: int, known: Sequence[Evaluated] = ()
) -> list[Evaluated]:
    """Return what a look shows of designs within the bounds that could be better than ``best``.

    Args:
        evaluate: simulates designs.
        objective: what is sought.
        best: the best design so far; None where no design could be simulated yet.
        number: of this look: each is at other designs.
        known: designs whose shapes a look near to one of them starts from.
    """
    beside = best if best is not None and objective.held(best) else None
    count = (LOOKS if beside is None else LOOKS_BESIDE) * len(objective.range)
    lower, upper = objective.lower, objective.upper
    if beside is not None:
        lower, upper = objective.box_below(beside)
    places = lower + spread(number * count, count, len(lower), evaluate.problem.design.seed) * (upper - lower)
    if beside is not None:
        places = places[[objective.could_beat(beside, place) for place in places]]
    places = places[np.argsort([objective.preference(place) for place in places], kind="stable")]
    found: list[Evaluated] = []
    if beside is None:
        for look in evaluate.looks(places, coarse_stride(evaluate)):
            if look is not None:
                found.append(look)
                if objective.held(look):  # then those are looked at that could be better
                    break
        return found
    for place in places:
        near = nearest(objective, place, [*known, *found])
        look = evaluate(place, near, stride=coarse_stride(evaluate), quick=True)
        if look is not None:
            found.append(look)
    return found


def nearest(objective: Objective, place: Array, known: Sequence[Evaluated]) -> Evaluated | None:
    """Return the one of ``known`` nearest to ``place`` (k,); None where none is as near as a descent's first step."""
    away = [float(np.max(np.abs(one.values - place) / objective.range)) for one in known]
    return known[int(np.argmin(away))] if min(away, default=np.inf) <= TRUST else None


def promising(objective: Objective, seen: list[Evaluated], best: Evaluated | None, most: int) -> Iterator[Evaluated]:
    """Yield up to ``most`` of the looks ``seen`` that stand apart and may lead to better than ``best``, best first."""
    if best is not None and objective.held(best):
        # in one valley the objective and what the violation costs at its bottom are nowhere less than there
        program = objective.program(best, SMALL)[0]
        cost = float(solve(program).multipliers[~program.soft].sum())
        below = objective.value(best) - CLOSE * abs(objective.value(best))
        seen = [look for look in seen if objective.value(look) + cost * objective.violation(look) < below]
    taken: list[Evaluated] = []
    for look in sorted(seen, key=objective.merit):
        near = (np.max(np.abs(look.values - other.values) / objective.range) < APART for other in taken)
        if any(near):
            continue
        yield look
        taken.append(look)
        if len(taken) == most:
            return
