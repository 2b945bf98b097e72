"""Why no design holds all limits, and what giving way would do.

At the design of least violation the multipliers of the quadratic program tell how much of the violation each limit and
bound carries. For each that carries some, the least relaxation of it alone is searched for, the others held; what it
comes to is checked: the problem with that limit or bound has a design, verified as any other.
"""

from __future__ import annotations

import dataclasses
import math
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field

from harness_opt.design.evaluation import HELD, Evaluated, Evaluator
from harness_opt.design.limit_keys import LimitKey, is_between_cables, limit_keys
from harness_opt.design.objective import Beyond, Objective
from harness_opt.design.search import SEARCH_STRIDE
from harness_opt.design.sqp import Note, descend
from harness_opt.design.verification import verify
from harness_opt.model import design_variables
from harness_opt.model.design import Variable
from harness_opt.model.limits import LimitId, LimitKind
from harness_opt.model.problem import Problem
from harness_opt.numerics.quadratic_program import solve

CARRIES = 0.01  # of the violation: a limit or bound that carries less is not in the way
NEAR = 1e-2  # trust region, in ranges, in which the multipliers at the design of least violation are looked at
AT_BOUND = 1e-4  # of a variable's range: this near to a bound it stands at it
# how far bounds are passed: where that does not help, something else is wrong with the design
LONGER, FURTHER, TURNED = 0.5, 0.25, 90.0  # of the cable's length for lengths and positions, degrees
DIGITS = 3  # to which a value that would do is rounded, to the side that does
MOST = 8  # limits and bounds that are tried
TRIES = 3  # at the check of one: each gives way a little more
MORE = 1.02  # times the last relaxation


@dataclass(frozen=True)
class Relaxation:
    """What giving way in one limit or one bound alone would do.

    Args:
        key: in the problem file, as ``limits.bend_radius``, ``parts.housing.clearance`` or
            ``design.variables.lead.length``.
        kind: of the limit; "lower" or "upper" for a bound.
        part: whose own clearance limit it is; None for the others and for bounds.
        value: now, in SI units, of bounds in the unit of their key.
        share: of the violation that it carries at the design of least violation, from the multipliers.
        estimate: the value that would do, to first order from the multipliers.
        enough: a value that does, checked by a verified design; None where none was found.
        variables: that design, by name.
    """

    key: str
    kind: LimitKind | str
    part: str | None
    value: float
    share: float
    estimate: float
    enough: float | None
    variables: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class _Candidate:
    """A limit or a bound, with its share of the violation."""

    limit: LimitKey | None
    bound: Beyond | None
    share: float


def relaxations(evaluate: Evaluator, objective: Objective, least: Evaluated, note: Note) -> tuple[Relaxation, ...]:
    """Return what would do, the limits and bounds first that carry most of the violation.

    Args:
        evaluate: of the problem.
        objective: of its redesign.
        least: the design of least violation.
        note: told of every iteration.
    """
    violation = objective.least_violation().value(least)
    if violation <= HELD:
        return ()
    found = sorted(_candidates(evaluate.problem, objective, least), key=lambda c: -c.share)
    return tuple(_relaxation(evaluate, objective, least, candidate, note) for candidate in found[:MOST])


def _candidates(problem: Problem, objective: Objective, least: Evaluated) -> list[_Candidate]:
    program, limits = objective.least_violation().program(least, NEAR)
    answer = solve(program)
    carried: defaultdict[LimitId | None, float] = defaultdict(float)
    for limit, multiplier in zip(limits, answer.multipliers, strict=True):
        carried[limit] += float(multiplier)
    found = []
    for key in limit_keys(problem):
        shares = [share for limit, share in carried.items() if limit in key.sets]
        alone = key.part is None and key.kind is LimitKind.CLEARANCE and len([s for s in shares if s > CARRIES]) < 2
        if sum(shares) > CARRIES and not (alone and not _between_cables(carried, key)):
            found.append(_Candidate(key, None, sum(shares)))
    for number, multiplier in enumerate(answer.bounds):
        side = 1 if multiplier > 0 else -1
        bound = objective.upper[number] if side > 0 else objective.lower[number]
        at_bound = abs(least.values[number] - bound) < AT_BOUND * objective.range[number]
        if at_bound and abs(multiplier) > CARRIES:
            found.append(_Candidate(None, Beyond(number, side, _reach(problem, number)), abs(float(multiplier))))
    return found


def _reach(problem: Problem, number: int) -> float:
    """Return how far a bound is passed in the search for a relaxation, in the variable's unit."""
    variable = problem.design.variables[number]
    what = design_variables.target(variable.name)
    length = problem.cables[what.cable].cable.length
    least = {"length": LONGER * length, "position": FURTHER * length, "rotate": TURNED}[what.quantity]
    return max(variable.upper - variable.lower, least)


def _bound(candidate: _Candidate) -> tuple[int, int]:
    """Return the variable's number and the side of a candidate that is a bound."""
    if candidate.bound is None:
        raise ValueError("a limit has no side")
    return candidate.bound.number, candidate.bound.side


def _between_cables(carried: Mapping[LimitId | None, float], key: LimitKey) -> bool:
    """Return whether the general clearance limit is in the way of cables, which have no limits of their own."""
    return any(share > CARRIES and limit in key.sets and is_between_cables(limit) for limit, share in carried.items())


def _relaxation(
    evaluate: Evaluator, objective: Objective, least: Evaluated, candidate: _Candidate, note: Note
) -> Relaxation:
    """Search for the least relaxation of one candidate alone, and check it."""
    key, bound = candidate.limit, candidate.bound
    relaxing = objective.relaxing(frozenset() if key is None else key.sets, bound)
    end = descend(evaluate, relaxing, least, SEARCH_STRIDE, note)
    full = evaluate(end.values, end) if relaxing.held(end) else None
    end = end if full is None else descend(evaluate, relaxing, full, 1, note)
    first_order = objective.least_violation().value(least) / candidate.share
    amount = relaxing.value(end)
    tell = _describe(evaluate.problem, objective, least, candidate)
    result = dataclasses.replace(tell, estimate=_value(objective, least, candidate, first_order))
    if not relaxing.held(end):
        return result
    for _ in range(TRIES):
        value = _rounded(tell.value, _value(objective, end, candidate, amount))
        if key is not None and value < 0:
            return result
        relaxed = _relaxed(evaluate.problem, candidate, value)
        again = Evaluator(relaxed, evaluate.scene, evaluate.solver, evaluate.progress)
        trial = again(end.values, end)
        if trial is not None and verify(again, trial).holds(snaps=objective.snaps):
            names = [variable.name for variable in evaluate.problem.design.variables]
            return dataclasses.replace(
                result, enough=value, variables=dict(zip(names, end.values.tolist(), strict=True))
            )
        amount *= MORE
    return result


def _describe(problem: Problem, objective: Objective, least: Evaluated, candidate: _Candidate) -> Relaxation:
    if candidate.limit is not None:
        key = candidate.limit
        return Relaxation(key.name, key.kind, key.part, key.limit, candidate.share, math.nan, None)
    number, side = _bound(candidate)
    variable = problem.design.variables[number]
    bound = variable.upper if side > 0 else variable.lower
    kind = "upper" if side > 0 else "lower"
    return Relaxation(f"design.variables.{variable.name}", kind, None, bound, candidate.share, math.nan, None)


def _value(objective: Objective, trial: Evaluated, candidate: _Candidate, amount: float) -> float:
    """Return the limit or bound relaxed by ``amount``: scaled, or in the bound's range."""
    if candidate.limit is not None:
        rows = zip(trial.rows.scale, trial.rows.limit, strict=True)
        return candidate.limit.value(amount, float(max(s for s, limit in rows if limit in candidate.limit.sets)))
    number, side = _bound(candidate)
    bound = objective.upper[number] if side > 0 else objective.lower[number]
    return float(bound + side * amount * objective.range[number])


def _rounded(now: float, value: float) -> float:
    """Return ``value`` to DIGITS digits of its difference from ``now``, rounded away from that."""
    change = value - now
    if change == 0.0:
        return value
    unit = 10.0 ** (math.floor(math.log10(abs(change))) - DIGITS + 1)
    return float(f"{now + math.copysign(math.ceil(abs(change) / unit) * unit, change):.9g}")


def _relaxed(problem: Problem, candidate: _Candidate, value: float) -> Problem:
    if candidate.limit is not None:
        return candidate.limit.replaced(problem, value)
    number, side = _bound(candidate)
    variables = list(problem.design.variables)
    variable = variables[number]
    variables[number] = Variable(variable.name, *((variable.lower, value) if side > 0 else (value, variable.upper)))
    return dataclasses.replace(problem, design=dataclasses.replace(problem.design, variables=tuple(variables)))
