"""What the limits and bounds that hold a design where it is cost, to first order.

The multipliers of the quadratic program at the best design are the rates of the objective with each limit and bound;
and the rates of the limits' margins with the design variables tell what each variable buys. Nocedal and Wright,
"Numerical Optimization", section 12.8.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from harness_opt.design.evaluation import Evaluated
from harness_opt.design.limit_keys import is_between_cables, limit_keys
from harness_opt.design.objective import Objective
from harness_opt.model.limits import LimitId, LimitKind
from harness_opt.model.problem import Problem
from harness_opt.numerics.quadratic_program import solve

NEAR = 1e-2  # trust region, in ranges, in which the multipliers are looked at
AT_BOUND = 1e-4  # of a variable's range: this near to a bound it stands at it
LEAST = 1e-6  # of the objective, for a whole limit or range: what costs less costs nothing


@dataclass(frozen=True)
class Price:
    """What one limit or bound costs.

    Args:
        key: in the problem file, as ``limits.bend_radius``, ``parts.housing.clearance`` or
            ``design.variables.lead.length``.
        kind: of the limit; "lower" or "upper" for a bound.
        part: whose own clearance limit it is; None for the others and for bounds.
        value: now, in SI units, of bounds in the unit of their key.
        saves: what giving way by one of those units would save: of the change, as a share of it; of the length of
            all cables, m; of the largest worst margin, what it would add, as a share of the limits.
        of: "change", "length" or "margin".
        buys: for a limit, by variable: how its worst margin grows with that variable, in SI units a unit.
    """

    key: str
    kind: LimitKind | str
    part: str | None
    value: float
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
            found.append(Price(key.name, key.kind, key.part, key.limit, worth * multiplier / unit, of, buys))
    for number, multiplier in enumerate(answer.bounds):
        variable, side = problem.design.variables[number], 1 if multiplier > 0 else -1
        bound = variable.upper if side > 0 else variable.lower
        at_bound = abs(best.values[number] - bound) < AT_BOUND * objective.range[number]
        if at_bound and abs(multiplier) * worth > LEAST:
            saves = worth * abs(float(multiplier)) / objective.range[number]
            kind = "upper" if side > 0 else "lower"
            found.append(Price(f"design.variables.{variable.name}", kind, None, bound, float(saves), of, {}))
    return tuple(found)


def _tightest(trial: Evaluated, limits: frozenset[LimitId]) -> int:
    """Return the number of the row with the smallest margin among those of ``limits``."""
    own = [number for number, limit in enumerate(trial.rows.limit) if limit in limits]
    return min(own, key=lambda number: float(trial.rows.margin[number]))
