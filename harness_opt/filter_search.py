"""From one design to the best one near it: sequential quadratic programming with a filter and a trust region.

At each design the whole motion is simulated, every limit near its bound is linearised, and a small quadratic program
gives the step. A trial is taken where no earlier design has both less violation and a lower objective, which lets the
iterates pass through slight violations on the way along a curved limit. Fletcher and Leyffer, "Nonlinear programming
without a penalty function", Math. Program. 91 (2002).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .goals import Goal
from .quadratic_program import solve
from .trials import HELD, Trial, Trials

ITERATIONS = 60
TRUST = 0.25  # first trust region, in the bounds' ranges
LEAST_TRUST = 1e-5
STEP_DONE = 1e-3  # a step below this, in the bounds' ranges, ends the search
GAIN_DONE = 2e-4  # of soft limits, in their scales: a step that promises less ends the search
MARGIN = 1e-3  # by how much a trial must improve on the designs met before
WORST = 0.5  # largest scaled violation that a lower objective can excuse


@dataclass(frozen=True)
class Step:
    """One iteration of a redesign.

    Args:
        aim: of the search, in words.
        objective: of the design tried.
        margin: its worst, scaled; >= 0 holds.
        limit: which one that is.
        amount: that margin in SI units, to first order.
        trust: radius of the trust region, in the bounds' ranges.
        step: largest change of a variable, in the bounds' ranges.
        accepted: whether the search went on from there.
    """

    aim: str
    objective: float
    margin: float
    limit: str
    amount: float
    trust: float
    step: float
    accepted: bool


Note = Callable[[Step, Trial], None]  # told of every iteration, and of the best design met so far


def descend(trials: Trials, goal: Goal, design: Trial, stride: int, note: Note) -> Trial:
    """Iterate from ``design`` until the step is small or the trust region is; return the best design met.

    Args:
        trials: simulates designs.
        goal: what is sought.
        design: where to begin, with its derivatives.
        stride: of the motion's frames that are solved.
        note: told of every iteration.

    Raises:
        KeyboardInterrupt: raised by the progress of ``trials``, or by ``note``.
    """
    trust, best = TRUST, design
    met = [(goal.violation(design), goal.objective(design))]
    for _ in range(ITERATIONS):
        step, gain = _step(goal, design, trust)
        size = float(np.max(np.abs(step)))
        if _done(goal, design, size, gain):
            break
        trial = trials(design.values + step * goal.range, design, stride=stride)
        accepted = trial is not None and _acceptable(goal.violation(trial), goal.objective(trial), met)
        if accepted and trial is not None:
            met.append((goal.violation(trial), goal.objective(trial)))
            trust = 2.0 * trust if size > 0.9 * trust else trust
            design = trial
            best = design if goal.better(design, best) else best
        else:
            trust = 0.35 * min(trust, size)
        note(_told(goal, trial or design, trust, size, accepted), best)
        if trust < LEAST_TRUST:
            break
    return best


def _step(goal: Goal, design: Trial, trust: float) -> tuple[np.ndarray, float]:
    """Return the step (k,) in ranges, and by how much it promises to lower the soft limits' shortfall."""
    program = goal.program(design, trust)[0]
    answer = solve(program)
    if not np.any(program.soft):
        return answer.step, np.inf
    return answer.step, max(float(np.max(-program.margin[program.soft])), program.floor) - answer.shortfall


def _done(goal: Goal, design: Trial, size: float, gain: float) -> bool:
    """Return whether a step of ``size`` that promises ``gain`` is not worth a simulation."""
    if not goal.held(design):
        return size < 1e-2 * STEP_DONE
    return size < STEP_DONE or gain < GAIN_DONE


def _acceptable(violation: float, objective: float, met: list[tuple[float, float]]) -> bool:
    """Return whether no design met has both less violation and a lower objective, by a margin."""
    return all(
        (violation <= max((1.0 - MARGIN) * v, HELD) and (violation < v or objective < o))
        or (objective <= o - MARGIN * violation and violation <= WORST)
        for v, o in met
    )


def _told(goal: Goal, design: Trial, trust: float, size: float, accepted: bool) -> Step:
    worst = design.worst
    margin = float(design.rows.margin[worst])
    amount = margin * float(design.rows.scale[worst])
    return Step(goal.aim, goal.objective(design), margin, design.rows.name[worst], amount, trust, size, accepted)
