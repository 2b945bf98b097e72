"""The trade-off curve of two quantities: how little of the one, for each value of the other; every point a verified
design.

The epsilon-constraint method: one quantity is a limit, set to values between an easy one and the best that can be
reached, and the other is made as good as can be for each. Miettinen, "Nonlinear Multiobjective Optimization",
section 3.2.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from harness_opt.design.evaluation import Evaluated, Evaluator
from harness_opt.design.limit_keys import LimitKey, limit_keys
from harness_opt.design.objective import Objective, objective_of
from harness_opt.design.search import search, verified
from harness_opt.design.sqp import Note
from harness_opt.design.verification import Verified
from harness_opt.errors import ProblemError
from harness_opt.model.design import Design
from harness_opt.model.limits import LimitKind, Obstacle
from harness_opt.model.problem import Problem
from harness_opt.numerics.rotations import Array

LIMITS = tuple(kind.value for kind in LimitKind)
AIMS = ("length", "change")
FLOORS = tuple(kind.value for kind in LimitKind if kind.is_least)
EASY = 0.5  # of the limit: the easy end of the curve; of a limit from above, its inverse
SAME = 1e-3  # relative: points nearer to each other in both quantities are one
POINTS = 7


@dataclass(frozen=True)
class Point:
    """One design of the curve.

    Args:
        first, second: what it comes to, SI: of a limit the worst value over the motion, of "change" the root of the
            weighted mean square, in the bounds' ranges.
        asked: the limit that was set.
        values: of the design variables, by name.
        problem: the design.
        verified: whether every limit holds, on twice the frames and twice the elements.
    """

    first: float
    second: float
    asked: float
    values: Mapping[str, float]
    problem: Problem
    verified: bool


@dataclass(frozen=True)
class TradeOff:
    """The curve of ``first`` against ``second``, by growing demand on one of them.

    Args:
        first, second: as asked for.
        stepped: which of the two was set as a limit.
        points: verified or not.
    """

    first: str
    second: str
    stepped: str
    points: tuple[Point, ...]


def quantities(text: str) -> tuple[str, str]:
    """Return the two quantities of ``FIRST,SECOND``.

    Raises:
        ProblemError: others than can be traded, twice the same, or none that is a limit.
    """
    names = [name.strip().removesuffix("_deg_per_m") for name in text.split(",")]
    known = (*AIMS, *LIMITS)
    if len(names) != 2 or names[0] == names[1] or any(name not in known for name in names):
        raise ProblemError(f"--pareto: found {text!r}, expected two of {', '.join(known)}, such as length,clearance")
    if all(name in AIMS for name in names):
        raise ProblemError(f"--pareto: found {text!r}, expected a limit among the two: {', '.join(LIMITS)}")
    return names[0], names[1]


def check_pair(problem: Problem, pair: tuple[str, str]) -> None:
    """Raise ProblemError where ``problem`` does not give the limits that are to be traded."""
    general = {key.kind.value for key in limit_keys(problem) if key.general}
    missing = [name for name in pair if name in LIMITS and name not in general]
    if missing:
        raise ProblemError(f"limits.{name}: found none, expected one to trade in --pareto" for name in missing)


def trade_off(
    evaluate: Evaluator, begin: Mapping[str, float], pair: tuple[str, str], note: Note, points: int = POINTS
) -> TradeOff:
    """Return the trade-off curve of two quantities.

    Args:
        evaluate: of the problem.
        begin: values of a design to begin from, by name.
        pair: as :func:`quantities` gives it.
        note: told of every iteration.
        points: of the curve.

    Raises:
        KeyboardInterrupt: raised by the progress of ``evaluate``.
    """
    problem = evaluate.problem
    stepped, other = (pair[1], pair[0]) if pair[1] in LIMITS else (pair[0], pair[1])
    values = np.array([begin[variable.name] for variable in problem.design.variables])
    found: list[Point] = []
    near: Evaluated | None = None
    for level in _levels(evaluate, stepped, values, note, points):
        limits = dataclasses.replace(problem.limits, **{stepped: level})
        posed = dataclasses.replace(problem, limits=limits, design=_design(problem, other))
        again = Evaluator(posed, evaluate.scene, evaluate.solver, evaluate.progress)
        first = again(values, near)
        if first is None:
            continue
        end = verified(again, _goal(problem, posed, other), first, note)
        found.append(_point(end, posed, pair, level))
        near, values = end.trial, end.trial.values
    return TradeOff(*pair, stepped, _distinct(found))


def _levels(evaluate: Evaluator, stepped: str, values: Array, note: Note, points: int) -> Array:
    """Return the limits to set, the easy ones first: up to the best that can be reached."""
    limit = getattr(evaluate.problem.limits, stepped)
    easy = EASY * limit if stepped in FLOORS else limit / EASY
    key = _key(evaluate.problem, stepped)
    first = evaluate(values, None)
    if first is None:
        return np.linspace(easy, limit, points)
    best = search(evaluate, objective_of(evaluate.problem).margin(key.sets), first, note)
    # margins are scaled, and ask for a little more than the limit
    own = np.array([limit in key.sets for limit in best.rows.limit])
    shortfall, scale = float(np.max(-best.rows.margin[own])), float(np.max(best.rows.scale[own]))
    reached = key.value(shortfall, scale)
    better = reached > easy if stepped in FLOORS else reached < easy
    return np.linspace(easy, reached if better else limit, points)


def _key(problem: Problem, name: str) -> LimitKey:
    """Return the key of ``[limits]`` called ``name``."""
    return next(key for key in limit_keys(problem) if key.kind is LimitKind(name) and key.general)


def _design(problem: Problem, aim: str) -> Design:
    """Return the design table with ``aim`` for its objective, as far as it can be one."""
    if aim in AIMS:
        return dataclasses.replace(problem.design, minimise=aim, maximise=None)  # type: ignore[arg-type]
    return problem.design


def _goal(given: Problem, posed: Problem, aim: str) -> Objective:
    """Return the objective of making ``aim`` as good as can be; changes count from the design given."""
    objective = objective_of(posed)
    return objective if aim in AIMS else objective.margin(_key(given, aim).sets)


def _point(end: Verified, posed: Problem, pair: tuple[str, str], level: float) -> Point:
    names = [variable.name for variable in posed.design.variables]
    numbers = [_measured(end, posed, name) for name in pair]
    values = dict(zip(names, end.trial.values.tolist(), strict=True))
    holds = end.holds(snaps=posed.design.snaps)
    return Point(numbers[0], numbers[1], float(level), values, end.motion.problem, holds)


def _measured(end: Verified, posed: Problem, name: str) -> float:
    """Return what ``name`` comes to in a verified design, SI."""
    if name == "length":
        return sum(run.cable.length for run in end.motion.problem.cables.values())
    if name == "change":
        objective = objective_of(
            dataclasses.replace(posed, design=dataclasses.replace(posed.design, minimise="change", maximise=None))
        )
        return float(
            np.sqrt(2.0 * objective.preference(end.trial.values) / max(float(objective.weights.sum()), 1e-300))
        )
    own = {Obstacle(part) for part, solid in posed.parts.items() if solid.clearance is not None}
    worst = [row.worst for row in end.rows if row.name == name and row.id.obstacle not in own]
    return min(worst) if name in FLOORS else max(worst)


def _distinct(points: list[Point]) -> tuple[Point, ...]:
    """Return ``points`` without those that repeat the one before: there the limit that was set held nothing."""
    kept: list[Point] = []
    for point in points:
        last = kept[-1] if kept else None
        if last is not None and all(
            abs(getattr(point, side) - getattr(last, side)) <= SAME * abs(getattr(last, side))
            for side in ("first", "second")
        ):
            kept[-1] = point
        else:
            kept.append(point)
    return tuple(kept)
