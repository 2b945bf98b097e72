"""What a search over designs is after: least change, least length, the largest margin, the least violation, or the
least relaxation of one limit or bound.

Every objective is a quadratic function of the design in the bounds' ranges plus, where it has soft limits, the worst
shortfall of those; all other limits are hard.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness_opt.design.evaluation import HELD, SNAP_COST, Evaluated
from harness_opt.design.margins import Rows
from harness_opt.model import design_variables
from harness_opt.model.limits import LimitId
from harness_opt.model.problem import Problem
from harness_opt.numerics.quadratic_program import PENALTY, Program
from harness_opt.numerics.rotations import Array

Limits = tuple[LimitId | None, ...]

CLOSE = 0.01  # of an objective: a design that is better by less is not worth a descent
ROWS = 400  # most linearised limits in a quadratic program, the tightest first


@dataclass(frozen=True)
class Beyond:
    """A bound that may be passed.

    Args:
        number: of the variable.
        side: -1 lower, 1 upper.
        reach: how far, in the variable's unit.
    """

    number: int
    side: int
    reach: float


@dataclass(frozen=True, eq=False)
class Objective:
    """An objective over k variables.

    Args:
        weights: of squared changes, in ranges, (k,).
        centre: design from which changes count, (k,).
        gradient: of the linear part, per range, (k,).
        lower, upper: bounds, (k,).
        range: unit of the variables' changes, (k,).
        soft: the limits whose worst shortfall counts in the objective; None is all of them.
        floor: the least that their shortfall counts for: 0 is content where they hold, -inf asks for margin.
        snaps: whether snaps are allowed.
        aim: in words.
        beyond: bounds that may be passed at the cost of the excess in ranges.
    """

    weights: Array
    centre: Array
    gradient: Array
    lower: Array
    upper: Array
    range: Array
    soft: frozenset[LimitId] | None = frozenset()
    floor: float = 0.0
    snaps: bool = False
    beyond: tuple[Beyond, ...] = ()
    aim: str = "least change"

    def limits(self) -> tuple[Array, Array]:
        """Return the bounds (k,) that no step passes: one that may be passed is further out."""
        lower, upper = self.lower.copy(), self.upper.copy()
        for bound in self.beyond:
            (upper if bound.side > 0 else lower)[bound.number] += bound.side * bound.reach
        return lower, upper

    def excess(self, values: Array) -> float:
        """Return by how much ``values`` (k,) pass the bounds that may be passed, in ranges; below 0 inside."""
        return max((self._past(bound, values) for bound in self.beyond), default=-np.inf)

    def _past(self, bound: Beyond, values: Array) -> float:
        number, side = bound.number, bound.side
        edge = self.upper[number] if side > 0 else self.lower[number]
        return float(side * (values[number] - edge) / self.range[number])

    def preference(self, values: Array) -> float:
        """Return the part of the objective that ``values`` (k,) alone decide."""
        change = (values - self.centre) / self.range
        return 0.5 * float(self.weights @ change**2) + float(self.gradient @ ((values - self.lower) / self.range))

    def _is_soft(self, rows: Rows) -> NDArray[np.bool_]:
        is_soft = (limit is not None and (self.soft is None or limit in self.soft) for limit in rows.limit)
        return np.fromiter(is_soft, dtype=bool, count=len(rows.limit))

    def value(self, trial: Evaluated, values: Array | None = None) -> float:
        """Return the objective of ``trial``, of order one; to first order of ``values`` (k,) near it, where given."""
        at, margin = _near(trial, values)
        smooth = self.preference(at)
        soft = self._is_soft(trial.rows)
        if not np.any(soft) and not self.beyond:
            return smooth
        shortfall = max(float(np.max(-margin[soft], initial=-np.inf)), self.excess(at))
        return smooth + max(shortfall, self.floor)

    def violation(self, trial: Evaluated, values: Array | None = None) -> float:
        """Return by how much, in scales of a limit, the worst hard limit misses what is asked for; snaps on top.

        To first order of ``values`` (k,) near ``trial``, where given.
        """
        hard = ~self._is_soft(trial.rows)
        worst = float(np.max(-_near(trial, values)[1][hard], initial=0.0))
        return worst + (0.0 if self.snaps else SNAP_COST * len(trial.motion.snaps))

    def merit(self, trial: Evaluated, values: Array | None = None) -> float:
        """Return what is the less the better: the objective, and far more than that the violation."""
        return self.value(trial, values) + PENALTY * self.violation(trial, values)

    def could_beat(self, best: Evaluated, values: Array) -> bool:
        """Return whether the part of the objective that ``values`` (k,) alone decide leaves room below ``best``."""
        return bool(np.any(self._is_soft(best.rows))) or self.preference(values) < (1.0 - CLOSE) * self.value(best)

    def box_below(self, best: Evaluated) -> tuple[Array, Array]:
        """Return the corners (k,), (k,) of a box within the bounds with every design in it that changes less."""
        most = np.full(len(self.range), np.inf)
        changing = (self.weights > 0.0) & (not np.any(self.gradient)) & (not np.any(self._is_soft(best.rows)))
        most[changing] = np.sqrt(2.0 * self.value(best) / self.weights[changing]) * self.range[changing]
        return np.maximum(self.lower, self.centre - most), np.minimum(self.upper, self.centre + most)

    def held(self, trial: Evaluated) -> bool:
        """Return whether the hard limits hold."""
        return self.violation(trial) <= HELD

    def better(self, a: Evaluated, b: Evaluated) -> bool:
        """Return whether ``a`` is to be preferred to ``b``: less violation, then the lower objective."""
        if self.held(a) and self.held(b):
            return self.value(a) < self.value(b)
        return self.violation(a) < self.violation(b)

    def program(self, trial: Evaluated, trust: float, tried: Sequence[Evaluated] = ()) -> tuple[Program, Limits]:
        """Return the quadratic program at ``trial`` for a step in ranges of at most ``trust``, and which limits
        its rows are of, None for a bound.

        Args:
            trial: where the step begins.
            trust: its largest entry.
            tried: designs nearby that were tried in vain: what they taught of the limits counts as well.
        """
        taught = [
            dataclasses.replace(t.rows, margin=t.rows.margin + t.rows.rate @ (trial.values - t.values)) for t in tried
        ]
        rows = Rows.joined([trial.rows, *taught])
        tightest = np.argsort(rows.margin, kind="stable")[:ROWS]
        margin, rate, soft = rows.margin[tightest], rows.rate[tightest] * self.range, self._is_soft(rows)[tightest]
        limits = tuple(rows.limit[i] for i in tightest)
        for bound in self.beyond:
            margin = np.append(margin, -self._past(bound, trial.values))
            rate = np.vstack([rate, -bound.side * np.eye(len(self.range))[bound.number]])
            soft, limits = np.append(soft, True), (*limits, None)
        lower, upper = self.limits()
        lowest = np.maximum((lower - trial.values) / self.range, -trust)
        highest = np.minimum((upper - trial.values) / self.range, trust)
        gradient = self.gradient + self.weights * (trial.values - self.centre) / self.range
        return Program(self.weights, gradient, margin, rate, soft, self.floor, lowest, highest), limits

    def least_violation(self) -> Objective:
        """Return the objective of violating all limits as little as can be; nothing more is asked where they hold."""
        none = np.zeros_like(self.weights)
        return dataclasses.replace(
            self,
            weights=none,
            gradient=none,
            soft=None,
            floor=0.0,
            beyond=(),
            aim="least violation",
        )

    def relaxing(self, limits: frozenset[LimitId] = frozenset(), bounds: tuple[Beyond, ...] = ()) -> Objective:
        """Return the objective of passing ``limits`` and ``bounds`` as little as can be; all others hold."""
        none = np.zeros_like(self.weights)
        return dataclasses.replace(
            self, weights=none, gradient=none, soft=limits, floor=0.0, beyond=bounds, aim="least relaxation"
        )

    def margin(self, limits: frozenset[LimitId] | None) -> Objective:
        """Return the objective of the largest worst margin of ``limits``, None for all; all others hold."""
        none = np.zeros_like(self.weights)
        return dataclasses.replace(
            self, weights=none, gradient=none, soft=limits, floor=-np.inf, beyond=(), aim="largest margin"
        )


def _near(trial: Evaluated, values: Array | None) -> tuple[Array, Array]:
    """Return ``values`` (k,), None for those of ``trial``, and to first order the margins (m,) there."""
    if values is None:
        return trial.values, trial.rows.margin
    return values, trial.rows.margin + trial.rows.rate @ (values - trial.values)


def objective_of(problem: Problem) -> Objective:
    """Return what the redesign of ``problem`` asks for."""
    lower, upper = design_variables.bounds(problem)
    design = problem.design
    width = upper - lower
    none = np.zeros(len(width))
    start = np.clip(design_variables.values(problem), lower, upper)
    base = Objective(none, start, none, lower, upper, width, snaps=design.snaps)
    if design.maximise == "margin":
        return base.margin(None)
    if design.minimise == "length":
        whole = sum(run.cable.length for run in problem.cables.values())
        return dataclasses.replace(base, gradient=design_variables.lengths(problem) * width / whole, aim="least length")
    return dataclasses.replace(base, weights=np.array([design.weights.get(v.name, 1.0) for v in design.variables]))
