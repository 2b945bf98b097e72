"""Where no design holds every limit: the least violation, and among equals the least change.

The violation is the largest shortfall of a limit over its scale, as it is reported. First that of the worst limits is
made as small as can be, then that of the others; then, with every shortfall kept at what it came to, the design goes as
near to the drawn one as that allows, so that what has nothing to do with the violation stays as drawn.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from harness_opt.design.evaluation import HELD, Evaluated, Evaluator
from harness_opt.design.objective import Objective
from harness_opt.design.sqp import Note, descend
from harness_opt.model.limits import LimitId

TRIED = 3  # designs met, the least violated ones, that are simulated on all frames
WORST = 0.95  # of the largest shortfall: limits with that much are the worst ones


def least_violation(evaluate: Evaluator, objective: Objective, met: Sequence[Evaluated], note: Note) -> Evaluated:
    """Return the design of least violation.

    Args:
        evaluate: simulates designs.
        objective: what was sought.
        met: designs, to begin from the best of them.
        note: told of every iteration.
    """
    reporting = evaluate.reporting({})
    begun = [reporting(one.values, one) for one in sorted(met, key=lambda one: one.violation)[:TRIED]]
    known = [one for one in begun if one is not None]
    if not known:
        return met[0]
    best = descend(reporting, objective.least_violation(), _least(objective, known), 1, note)
    best = _least(objective, [best, *known])
    short = {limit: shortfall for limit, shortfall in best.shortfalls.items() if shortfall > HELD}
    worst = {limit: shortfall for limit, shortfall in short.items() if shortfall >= WORST * best.violation}
    if len(worst) < len(short):
        best = _kept(evaluate, objective.relaxing(frozenset(short) - frozenset(worst)), best, worst, note)
    best = _kept(evaluate, objective, best, best.shortfalls, note)
    return evaluate(best.values, best) or best  # with what is asked for, and not what is allowed, in its margins


def _kept(
    evaluate: Evaluator, objective: Objective, best: Evaluated, shortfalls: Mapping[LimitId, float], note: Note
) -> Evaluated:
    """Return the best design for ``objective`` that is no more violated than ``best``, with ``shortfalls`` allowed."""
    keeping = evaluate.reporting(shortfalls)
    begin = keeping(best.values, best)
    if begin is None:
        return best
    end = descend(keeping, objective, begin, 1, note)
    return _least(objective, [end, best])


def _least(objective: Objective, designs: Sequence[Evaluated]) -> Evaluated:
    """Return the least violated of ``designs``; among equals that with the least objective."""
    least = min(one.violation for one in designs)
    equals = [one for one in designs if one.violation <= least + HELD]
    return min(equals, key=lambda one: objective.preference(one.values))
