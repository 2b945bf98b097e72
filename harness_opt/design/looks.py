"""A look at many designs within the bounds, a few frames of each, for descents to begin from the best of them.

A descent ends in the valley that it began in: at the middle of a plate no slope tells where its slot is, and another
valley may hold with less change. Once a design holds, only such designs are looked at as could be better.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from harness_opt.design.evaluation import Evaluated, Evaluator
from harness_opt.design.objective import Objective
from harness_opt.numerics.rotations import Array

FRAMES = 5  # of the motion that a look solves
LOOKS = 32  # for each variable, where no design holds yet
LOOKS_BESIDE = 8  # for each variable, where one does, and another could only be better
APART = 0.1  # of the bounds' ranges: starts nearer to each other than that lead to one end
EXCUSED = 0.5  # of a limit's scale: a look that violates more will hardly lead to a better design than one that holds


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


def looks(evaluate: Evaluator, objective: Objective, best: Evaluated | None, number: int) -> list[Evaluated]:
    """Return what a look shows of designs within the bounds that could be better than ``best``, as many as can be.

    Args:
        evaluate: simulates designs.
        objective: what is sought.
        best: the best design so far; None where no design could be simulated yet.
        number: of this look: each is at other designs.
    """
    beside = best if best is not None and objective.held(best) else None
    count = (LOOKS if beside is None else LOOKS_BESIDE) * len(objective.range)
    lower, upper = objective.lower, objective.upper
    if beside is not None:
        lower, upper = objective.box_below(beside)
    places = lower + spread(number * count, count, len(lower), evaluate.problem.design.seed) * (upper - lower)
    if beside is not None:
        places = places[[objective.could_beat(beside, place) for place in places]]
    stride = math.ceil((len(evaluate.frames) - 1) / (FRAMES - 1)) or 1
    found = (evaluate(place, None, stride=stride, quick=True) for place in places)
    return [look for look in found if look is not None]


def promising(objective: Objective, seen: list[Evaluated], best: Evaluated | None, most: int) -> Iterator[Evaluated]:
    """Yield up to ``most`` of the looks ``seen`` that stand apart and may lead to better than ``best``, best first."""
    if best is not None and objective.held(best):
        seen = [look for look in seen if objective.violation(look) <= EXCUSED]
    taken: list[Evaluated] = []
    for look in sorted(seen, key=objective.merit):
        near = (np.max(np.abs(look.values - other.values) / objective.range) < APART for other in taken)
        if any(near):
            continue
        yield look
        taken.append(look)
        if len(taken) == most:
            return
