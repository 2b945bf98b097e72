"""Minimising an energy under a few constraints, in steps short enough to reach the minimum next to the initial guess.

Newton's method with a shift, on the manifold that the constraints leave: a step solves

    [H + shift W, A^T; A, 0] [step; -change of multipliers] = [-gradient; -constraint],

is taken only where H + shift W is positive on what the constraints leave, which the inertia of the bordered matrix
tells (Nocedal and Wright, "Numerical Optimization", theorem 16.3), where it is short, and where the energy falls as
it should. A long shift makes it a step of implicit Euler through a viscous medium, none makes it Newton's; so the end
is a minimum, and a saddle only where the initial guess was one. Steps go back onto the constraints by the same matrix
(second-order correction, section 18.3).
"""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np

from harness_opt.numerics.interface import Expansion, Landscape
from harness_opt.numerics.linear import symmetric
from harness_opt.numerics.rotations import Array

FIRST_SHIFT = 10.0  # in the metric of the landscape: a step through a stiff medium
LEAST_SHIFT, MOST_SHIFT = 1e-13, 1e13
NEWTON_SHIFT = 3e-7  # a shift below this, in the multipliers' size, hides no direction of descent
SMALL_STEP, NO_GAIN = 1e-2, 1e-10  # rad; of the energy: a last step is shorter, and what it gains less
SUFFICIENT, GOOD, POOR = 0.05, 0.7, 0.25  # parts of the predicted fall of the energy
CORRECTIONS, MOST_RETURNS = 8, 30  # steps back onto the constraints: from a step, from a first guess


class Ended(enum.Enum):
    """How a descent ended."""

    AT_MINIMUM = enum.auto()
    TOO_COARSE = enum.auto()  # go on from here on a finer landscape
    UNFINISHED = enum.auto()
    STUCK = enum.auto()


@dataclass(frozen=True)
class Descent:
    """Where a descent ended: the point, the multipliers (c,), how, after how many steps, and with which shift."""

    q: Array
    multipliers: Array
    ended: Ended
    steps: int
    shift: float


class _Minimiser:
    """A descent under way; arguments as :func:`descend`."""

    def __init__(self, landscape: Landscape, q: Array, multipliers: Array, shift: float, longest: float, room: float):
        room_share = 1e-5
        constraint_tolerance = 1e-6  # constraints are held to this, or to room_share of the least room that they leave
        self.landscape, self.q, self.multipliers = landscape, q, multipliers
        self.shift, self.longest = shift, longest
        self.level: tuple[float, Array] | None = None  # energy at ``q``, and what is missed of the constraints
        self.coarse_steps = self.idle = 0
        self.room, self.tolerance = room, min(constraint_tolerance, room_share * room)
        self.linear = symmetric(landscape.sparsity)
        self.here: Expansion | None = None  # about ``q``, where it is known already
        self.last_shift: float | None = None  # the shift to go back to, where one far smaller is tried

    def solve(self, upper: Array, lower: Array) -> tuple[Array, Array]:
        x = self.linear.solve(self.matrix, np.concatenate([upper, lower]))
        return x[: len(upper)], x[len(upper) :]

    def shortened(self, step: Array) -> Array:
        largest = float(np.max(np.abs(step), initial=0.0))
        return step if largest <= self.longest else step * (self.longest / largest)

    def return_to_constraints(self) -> bool:
        """Bring a first guess near the constraints, by the shortest way in the metric."""
        for _ in range(MOST_RETURNS):
            here = self.landscape.expand(self.q, self.multipliers)
            if not np.all(np.isfinite(here.constraint)):
                return False
            if np.linalg.norm(here.constraint) <= self.allowed_miss(self.longest):
                self.here = here
                return True
            self.matrix = here.bordered(1.0, flat=True)
            step, _ = self.solve(np.zeros_like(here.gradient), -here.constraint)
            if not np.all(np.isfinite(step)):
                return False
            self.q = self.landscape.move(
                self.q, step * min(1.0, self.longest / max(float(np.max(np.abs(step))), 1e-300))
            )
        return False

    def allowed_miss(self, size: float) -> float:
        """Return how much of the constraints a step of this size (rad) may leave to the next one."""
        square_left = 0.1  # of the square of a step, up to which they may be missed after it: what is left to the next
        return max(self.tolerance, square_left * self.room * size**2)

    def corrected(self, q: Array, size: float) -> tuple[Array, float, Array] | None:
        """Return ``q`` brought back onto the constraints by the step's own matrix, its energy and what it still misses.

        That is little beside the square of the step's ``size``; None where it gets no nearer.
        """
        missed, tolerance = np.inf, self.allowed_miss(size)
        for _ in range(CORRECTIONS):
            energy, constraint = self.landscape.energy(q)
            left = float(np.linalg.norm(constraint))
            if left <= tolerance:
                return q, energy, constraint
            if not left < 0.7 * missed:
                return None
            missed = left
            step, _ = self.solve(np.zeros(self.landscape.sparsity.size1() - len(constraint)), -constraint)
            if not np.all(np.isfinite(step)):
                return None
            q = self.landscape.move(q, self.shortened(step))
        return None

    def advance(self) -> Ended | None:
        """Take one step, with as much of a shift as it needs; return how the descent ended, or None to go on."""
        most_coarse = 3  # steps that may be shortened because they would strain the landscape, until it is given back
        most_idle = 5  # steps in a row that small show a saddle that was begun at, or that rounding hides what is left
        last_step = 5e-3  # rad: of one of Newton's own that is shorter its square is left
        here, self.here = self.here or self.landscape.expand(self.q, self.multipliers), None
        energy, missed = self.level or self.landscape.energy(self.q)
        positive = False  # once it is, a longer shift leaves it so
        while self.shift <= MOST_SHIFT:
            self.matrix = here.bordered(self.shift)
            positive = positive or self.linear.negative(self.matrix) == self.landscape.constraints
            if not positive:
                self._raise_shift(4.0)
                continue
            step, change = self.solve(-here.gradient, -here.constraint)
            size = self.landscape.size(step)
            if not np.isfinite(size):
                self._raise_shift(4.0)
                continue
            if size > self.longest:
                self._raise_shift(float(np.clip(size / self.longest, 1.5, 8.0)))
                continue
            multipliers = self.multipliers - change
            predicted = 0.5 * float(-here.gradient @ step + self.shift * (here.weights @ step**2))
            gain = abs(predicted) / (1.0 + abs(energy))
            slight = self.shift <= NEWTON_SHIFT * (1.0 + float(np.linalg.norm(multipliers)))
            idle = size < SMALL_STEP and gain < NO_GAIN
            there = self.landscape.move(self.q, step)
            if (slight and (idle or size < last_step)) or (idle and self.idle >= most_idle):
                back = self.corrected(there, 0.0)
                self.q, self.multipliers = there if back is None else back[0], multipliers
                return Ended.AT_MINIMUM
            trial = self.corrected(there, size)
            if trial is not None and self.landscape.too_coarse(trial[0]):
                self.coarse_steps += 1
                if self.coarse_steps > most_coarse:
                    return Ended.TOO_COARSE
                trial = None
            if trial is not None:
                reached, level, left = trial
                # the multipliers take what is left of the constraints out of both
                fall = float((energy - multipliers @ missed) - (level - multipliers @ left))
                rounding = 1e-13 * (1.0 + abs(energy) + float(np.linalg.norm(multipliers)))
                if fall >= SUFFICIENT * predicted - rounding:
                    self.q, self.multipliers, self.level = reached, multipliers, (level, left)
                    self.idle = self.idle + 1 if idle else 0
                    self._lower_shift(1.0 if abs(fall - predicted) <= rounding else fall / predicted, size)
                    return None
            self._raise_shift(4.0)
        return Ended.STUCK

    def _raise_shift(self, factor: float) -> None:
        self.shift = max(factor * self.shift, 1e-8) if self.last_shift is None else self.last_shift
        self.last_shift = None

    def _lower_shift(self, ratio: float, size: float) -> None:
        near_minimum = 0.3  # of the longest step: after a good one that is shorter, one without a shift is tried
        self.last_shift = None
        if ratio < POOR:
            self.shift *= 3.0
        elif ratio > GOOD:
            self.shift *= 0.5 if size > 0.5 * self.longest else 0.15 if size > SMALL_STEP else 0.02
            if size < near_minimum * self.longest and self.shift > NEWTON_SHIFT:
                self.last_shift, self.shift = self.shift, NEWTON_SHIFT
        self.shift = max(self.shift, LEAST_SHIFT)


def descend(
    landscape: Landscape,
    q: Array,
    multipliers: Array,
    *,
    longest: float,
    steps: int,
    shift: float = FIRST_SHIFT,
    room: float = 1.0,
) -> Descent:
    """Go down to a minimum of the energy; never raises for lack of convergence.

    Args:
        landscape: the energy and its constraints.
        q, multipliers: the first guess; it is brought onto the constraints first.
        longest: largest part (of three entries) of a step.
        steps: limit.
        shift: of the first step, in the metric.
        room: how little the constraints leave free; they are held to a small part of it.
    """
    minimiser = _Minimiser(landscape, q, multipliers, shift, longest, room)
    if not minimiser.return_to_constraints():
        return Descent(minimiser.q, minimiser.multipliers, Ended.STUCK, 0, shift)
    for taken in range(1, steps + 1):
        ended = minimiser.advance()
        if ended is not None:
            return Descent(minimiser.q, minimiser.multipliers, ended, taken, minimiser.shift)
    return Descent(minimiser.q, minimiser.multipliers, Ended.UNFINISHED, steps, minimiser.shift)
