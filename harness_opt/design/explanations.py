"""Why a design is not better: what stands in the way of all limits and what giving way would do, or what limits cost.

At the best design the multipliers of the quadratic program are the rates of the objective with each limit and bound
(Nocedal and Wright, "Numerical Optimization", section 12.8). Where no design holds all limits, they tell how much of
the violation each carries. For each that carries some, the least relaxation of it alone is searched for, the others
held, and where none alone would do that of two together, each by as much of its scale; what it comes to is checked: the
problem with those limits or bounds has a design, verified as any other.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from harness_opt.design.evaluation import HELD, SEARCH_STRIDE, Evaluated, Evaluator
from harness_opt.design.limit_keys import LimitKey, is_between_cables, limit_keys
from harness_opt.design.objective import Beyond, Objective
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
MOST = 8  # limits and bounds that are tried alone
IN_PAIRS = 3  # of them, those that carry most, that are tried two together
TRIES = 3  # at the check of one: each gives way a little more
LEAST = 1e-6  # of the objective, for a whole limit or range: what costs less costs nothing
MORE = 1.02  # times the last relaxation


@dataclass(frozen=True)
class Key:
    """A limit or a bound of the problem file.

    Args:
        key: as ``limits.bend_radius``, ``parts.housing.clearance`` or ``design.variables.lead.length``.
        kind: of the limit; "lower" or "upper" for a bound.
        part: whose own clearance limit it is; None for the others and for bounds.
        cable: whose own bend radius it is; None for the others and for bounds.
        value: now, in SI units, of bounds in the unit of their key.
    """

    key: str
    kind: LimitKind | str
    part: str | None
    cable: str | None
    value: float


@dataclass(frozen=True)
class Relaxation(Key):
    """What giving way in one limit or one bound would do.

    Args:
        share: of the violation that it carries at the design of least violation, from the multipliers.
        estimate: the value that would do, to first order from the multipliers.
        enough: a value that does, checked by a verified design; None where none was found.
        variables: that design, by name.
    """

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


@dataclass(frozen=True)
class WaysOut:
    """What giving way would do, where no design holds all limits.

    Args:
        alone: in one limit or bound, those first that carry most of the violation.
        together: in two, where none alone would do.
    """

    alone: tuple[Relaxation, ...] = ()
    together: tuple[tuple[Relaxation, Relaxation], ...] = ()


def ways_out(evaluate: Evaluator, objective: Objective, least: Evaluated, note: Note) -> WaysOut:
    """Return what would do.

    Args:
        evaluate: of the problem.
        objective: of its redesign.
        least: the design of least violation.
        note: told of every iteration.
    """
    violation = objective.least_violation().value(least)
    if violation <= HELD:
        return WaysOut()
    found = sorted(_candidates(evaluate.problem, objective, least), key=lambda c: -c.share)
    alone = tuple(_relaxed_by(evaluate, objective, least, (one,), note)[0] for one in found[:MOST])
    if any(way.enough is not None for way in alone):
        return WaysOut(alone)
    pairs = [_relaxed_by(evaluate, objective, least, two, note) for two in itertools.combinations(found[:IN_PAIRS], 2)]
    return WaysOut(alone, tuple((a, b) for a, b in pairs if a.enough is not None))


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


def _relaxed_by(
    evaluate: Evaluator, objective: Objective, least: Evaluated, candidates: tuple[_Candidate, ...], note: Note
) -> list[Relaxation]:
    """Search for the least relaxation of ``candidates`` together, each by as much of its scale, and check it."""
    keys = [c.limit for c in candidates if c.limit is not None]
    bounds = tuple(c.bound for c in candidates if c.bound is not None)
    relaxing = objective.relaxing(frozenset[LimitId]().union(*(key.sets for key in keys)), bounds)
    end = descend(evaluate, relaxing, least, SEARCH_STRIDE, note)
    full = evaluate(end.values, end) if relaxing.held(end) else None
    end = end if full is None else descend(evaluate, relaxing, full, 1, note)
    first_order = objective.least_violation().value(least) / sum(c.share for c in candidates)
    amount = relaxing.value(end)
    told = [_describe(evaluate.problem, objective, least, c) for c in candidates]
    result = [
        dataclasses.replace(tell, estimate=_value(objective, least, c, first_order))
        for tell, c in zip(told, candidates, strict=True)
    ]
    if not relaxing.held(end):
        return result
    names = [variable.name for variable in evaluate.problem.design.variables]
    for _ in range(TRIES):
        values = [
            _rounded(tell.value, _value(objective, end, c, amount)) for tell, c in zip(told, candidates, strict=True)
        ]
        if any(value < 0 for value, c in zip(values, candidates, strict=True) if c.limit is not None):
            return result
        relaxed = evaluate.problem
        for value, c in zip(values, candidates, strict=True):
            relaxed = _relaxed(relaxed, c, value)
        again = Evaluator(relaxed, evaluate.scene, evaluate.solver, evaluate.progress)
        trial = again(end.values, end)
        if trial is not None and verify(again, trial).holds(snaps=objective.snaps):
            design = dict(zip(names, end.values.tolist(), strict=True))
            return [
                dataclasses.replace(way, enough=value, variables=design)
                for way, value in zip(result, values, strict=True)
            ]
        amount *= MORE
    return result


def _describe(problem: Problem, objective: Objective, least: Evaluated, candidate: _Candidate) -> Relaxation:
    if candidate.limit is not None:
        key = candidate.limit
        return Relaxation(key.name, key.kind, key.part, key.cable, key.limit, candidate.share, math.nan, None)
    number, side = _bound(candidate)
    variable = problem.design.variables[number]
    bound = variable.upper if side > 0 else variable.lower
    kind = "upper" if side > 0 else "lower"
    return Relaxation(f"design.variables.{variable.name}", kind, None, None, bound, candidate.share, math.nan, None)


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


@dataclass(frozen=True)
class Price(Key):
    """What one limit or bound costs.

    Args:
        saves: what giving way by one of those units would save: of the change, as a share of it; of the length of
            all cables, m; of the largest worst margin, what it would add, as a share of the limits.
        of: "change", "length" or "margin".
        buys: for a limit, by variable: how its worst margin grows with that variable, in SI units a unit.
    """

    saves: float
    of: str
    buys: Mapping[str, float]


def prices(problem: Problem, objective: Objective, best: Evaluated) -> tuple[Price, ...]:
    """Return what costs something at the best design: limits, then bounds.

    Args:
        problem: whose keys they are.
        objective: of its redesign.
        best: where that ended.
    """
    program, limits = objective.program(best, NEAR)
    answer = solve(program)
    of = problem.design.maximise or problem.design.minimise
    reached = objective.value(best)
    if of == "change" and reached <= 0.0:
        return ()
    whole = sum(run.cable.length for run in problem.cables.values())
    worth = {"change": 0.5 / reached if reached else 0.0, "length": whole, "margin": 1.0}[of]
    found = []
    for key in limit_keys(problem):
        # one key a limit: a part's own clearance where there is one, the general limit for cables
        general = key.part is None and key.kind is LimitKind.CLEARANCE
        own = [limit in key.sets and not (general and not is_between_cables(limit)) for limit in limits]
        multiplier = float(answer.multipliers[np.array(own)].sum())
        if multiplier * worth > LEAST:
            number = _tightest(best, key.sets)
            scale = float(best.rows.scale[number])
            # a scaled margin falls by 1 where a limit grows by its scale; of bend radii, by the limit itself
            unit = key.limit if key.kind is LimitKind.BEND_RADIUS else scale
            buys = dict(zip((v.name for v in problem.design.variables), scale * best.rows.rate[number], strict=True))
            price = worth * multiplier / unit
            found.append(Price(key.name, key.kind, key.part, key.cable, key.limit, price, of, buys))
    for number, multiplier in enumerate(answer.bounds):
        variable, side = problem.design.variables[number], 1 if multiplier > 0 else -1
        bound = variable.upper if side > 0 else variable.lower
        at_bound = abs(best.values[number] - bound) < AT_BOUND * objective.range[number]
        if at_bound and abs(multiplier) * worth > LEAST:
            saves = worth * abs(float(multiplier)) / objective.range[number]
            kind = "upper" if side > 0 else "lower"
            found.append(Price(f"design.variables.{variable.name}", kind, None, None, bound, float(saves), of, {}))
    return tuple(found)


def _tightest(trial: Evaluated, limits: frozenset[LimitId]) -> int:
    """Return the number of the row with the smallest margin among those of ``limits``."""
    own = [number for number, limit in enumerate(trial.rows.limit) if limit in limits]
    return min(own, key=lambda number: float(trial.rows.margin[number]))
