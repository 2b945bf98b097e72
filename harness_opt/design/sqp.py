"""From one design to the best one near it: sequential quadratic programming with a filter and a trust region.

At each design the whole motion is simulated, every limit near its bound is linearised, and a small quadratic program
gives the step. A trial is taken where no earlier design has both less violation and a lower objective, which lets the
iterates pass through slight violations on the way along a curved limit. Fletcher and Leyffer, "Nonlinear programming
without a penalty function", Math. Program. 91 (2002). From a trial that just misses that, it goes on for one step
all the same, and back if that does not help: a watchdog (Nocedal and Wright, "Numerical Optimization", section 15.6),
for in a curved valley every long step misses the linearised limits. What a failed trial taught of the limits stays in
the next program.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from harness_opt.design.evaluation import HELD, Evaluated, Evaluator
from harness_opt.design.objective import Objective
from harness_opt.model.limits import LimitId
from harness_opt.numerics.quadratic_program import solve
from harness_opt.numerics.rotations import Array

ITERATIONS = 60
TRUST = 0.25  # first trust region, in the bounds' ranges
LEAST_TRUST = 1e-5
STEP_DONE = 1e-3  # a step below this, in the bounds' ranges, ends the search
PROMISE = 1e-3  # of a violation or shortfall: a step that promises to take away less ends the search
WORTH = 8.0  # times an objective of change or length: by a thousandth of that it may be missed
LEAST_WORTH = 1e-9  # of such an objective counts as none
LEAST_SHORT = 0.2  # in scales: of a smaller shortfall that share is taken of this
SMALL = 1e-2  # of the bounds' ranges: a step over which linearised limits are as good as the limits
MARGIN = 1e-3  # by how much a trial must improve on the designs met before
FAILURES = 3  # in a row, where a limit is violated by more than WORST: other starts promise more
SHRINK = 0.35  # of the step that failed: the next trust region
TAUGHT, NEAR = 4, 3.0  # failed designs that are remembered, and within how many trust regions
ASTRAY = 0.1  # largest scaled violation of a design that the search goes on from for one step though it is no better
WORST = 0.5  # largest scaled violation that a lower objective can excuse


@dataclass(frozen=True)
class Step:
    """One iteration of a redesign.

    Args:
        aim: of the search, in words.
        objective: of the design tried.
        margin: its worst, scaled; >= 0 holds.
        limit: which one that is; None where there is none.
        amount: that margin in SI units, to first order.
        trust: radius of the trust region, in the bounds' ranges.
        step: largest change of a variable, in the bounds' ranges.
        accepted: whether the search went on from there.
    """

    aim: str
    objective: float
    margin: float
    limit: LimitId | None
    amount: float
    trust: float
    step: float
    accepted: bool


Note = Callable[[Step, Evaluated], None]  # told of every iteration, and of the best design met so far


def descend(evaluate: Evaluator, objective: Objective, design: Evaluated, stride: int, note: Note) -> Evaluated:
    """Iterate from ``design`` until the step is small or the trust region is; return the best design met.

    Args:
        evaluate: simulates designs.
        objective: what is sought.
        design: where to begin, with its derivatives.
        stride: of the motion's frames that are solved.
        note: told of every iteration.

    Raises:
        KeyboardInterrupt: raised by the progress of ``evaluate``, or by ``note``.
    """
    trust, best = TRUST, design
    met = [(objective.violation(design), objective.value(design))]
    tried: list[Evaluated] = []
    home: Evaluated | None = None  # to return to, where the search has gone on from a design that was not acceptable
    failures = 0
    for _ in range(ITERATIONS):
        step, promise = _step(objective, design, trust, _near(objective, design, tried, trust))
        size = float(np.max(np.abs(step)))
        if _done(objective, design, size, promise):
            if home is None:
                break
            design, home, trust = home, None, SHRINK * trust
            continue
        trial = evaluate(design.values + step * objective.range, design, stride=stride)
        accepted = trial is not None and _acceptable(objective.violation(trial), objective.value(trial), met)
        if accepted and trial is not None:
            met.append((objective.violation(trial), objective.value(trial)))
            trust = 2.0 * trust if size > 0.9 * trust else trust
            design, home = trial, None
            best = design if objective.better(design, best) else best
        elif home is None and trial is not None and objective.violation(trial) <= ASTRAY:
            design, home = trial, design
            trust = min(trust, size)
        else:
            trust = SHRINK * min(trust, size)
            design, home = home or design, None
        if not accepted and trial is not None and objective.violation(trial) <= WORST:
            tried = [*tried, trial][-TAUGHT:]
        note(_told(objective, trial or design, trust, size, accepted), best)
        failures = 0 if accepted else failures + 1
        if trust < LEAST_TRUST or (failures >= FAILURES and objective.violation(design) > WORST):
            break
    return best


def stationary(objective: Objective, design: Evaluated) -> bool:
    """Return whether the limits hold at ``design`` and no small step promises better: to first order it is the best."""
    return objective.held(design) and _step(objective, design, SMALL, [])[1] < PROMISE


def _near(objective: Objective, design: Evaluated, tried: list[Evaluated], trust: float) -> list[Evaluated]:
    """Return those of ``tried`` that stand near enough to ``design`` for their linearised limits to hold there."""
    reach = NEAR * trust
    return [t for t in tried if 0.0 < float(np.max(np.abs(t.values - design.values) / objective.range)) <= reach]


def _step(objective: Objective, design: Evaluated, trust: float, tried: list[Evaluated]) -> tuple[Array, float]:
    """Return the step (k,) in ranges, and what it promises of what it is after, as a share: violation, shortfall, or a
    few times the objective.
    """
    program = objective.program(design, trust, tried)[0]
    answer = solve(program)
    if not objective.held(design):
        short = float(np.max(-program.margin[~program.soft], initial=0.0))
        return answer.step, (short - answer.slack) / short if short > 0.0 else np.inf
    if not np.any(program.soft):
        gain = -float(program.gradient @ answer.step + 0.5 * program.curvature @ answer.step**2)
        return answer.step, gain / (WORTH * objective.value(design) + LEAST_WORTH)
    short = float(np.max(-program.margin[program.soft]))
    return answer.step, (max(short, program.floor) - answer.shortfall) / max(abs(short), LEAST_SHORT)


def _done(objective: Objective, design: Evaluated, size: float, promise: float) -> bool:
    """Return whether a step of ``size`` with such a promise is not worth a simulation."""
    return promise < PROMISE or size < (STEP_DONE if objective.held(design) else 1e-2 * STEP_DONE)


def _acceptable(violation: float, objective: float, met: list[tuple[float, float]]) -> bool:
    """Return whether no design met has both less violation and a lower objective, by a margin."""
    return all(
        (violation <= max((1.0 - MARGIN) * v, HELD) and (violation < v or objective < o))
        or (objective <= o - MARGIN * violation and violation <= WORST)
        for v, o in met
    )


def _told(objective: Objective, design: Evaluated, trust: float, size: float, accepted: bool) -> Step:
    worst = design.worst
    margin = float(design.rows.margin[worst])
    amount = margin * float(design.rows.scale[worst])
    return Step(objective.aim, objective.value(design), margin, design.rows.limit[worst], amount, trust, size, accepted)
