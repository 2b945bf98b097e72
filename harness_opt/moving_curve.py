"""A cable's centreline between solved frames, and how far off it can be.

Between two frames every station moves along the cubic through four frames of the same stretch of the motion;
along the cable it is the cubic of :class:`harness_opt.centreline.Curve`. What lies between frames is known this
well:

* proven: everything about these cubics themselves, so that bounds on them need no sampling;
* estimated: :attr:`MovingCurve.deviation`, by how much the true shapes can differ from the cubics. It is what the
  fourth frame changes in the parabola through the other three, of one order lower than the cubic's own error
  (the usual estimate of embedded formulas: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I,
  section II.4). Where that is more than the way between the two frames, as where a cable starts to lean out of a
  plane, a straight line takes the cubic's place and that way is the estimate. Every frame solved between two others
  is compared with what was expected there; where one is further off than estimated, all estimates are raised.

Where the cable snaps, or no shape is found, nothing is known between the two frames: the interval is broken.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from . import rotations
from .centreline import cubic_error, hermite
from .results import CableMotion
from .rotations import Array
from .vectors import Indices, lengths

NODES = 4  # frames that a cubic goes through
SHORTEST = 2.0**-20  # of the motion, between two frames: below this a shape is said to jump
TRUST = 2.0  # times the largest difference met over the one estimated, where it was more than estimated
STRETCH = 2.0  # times what is seen half-way between two frames
PIECES = 4  # of an interval, between which a cubic is bounded by interpolation
ROUNDING = 1e-12  # of the cable's length: differences of positions below this are rounding

# cable and motion values (k,) to positions (k, N, 3), m, quaternions (k, N, 4), and which of them were found (k,)
Solve = Callable[[str, Array], tuple[Array, Array, NDArray[np.bool_]]]


class MovingCurve:
    """The centreline of one cable over its motion, to which solved frames can be added.

    Args:
        cable: its name.
        motion: (P,), of the frames, increasing.
        shapes: of the cable in them.
        solve: finds shapes between them.
        jumps: motion values inside the intervals in which the cable snaps.
        turns: motion values at which bodies turn round, so that nothing is smooth across them.
    """

    def __init__(
        self,
        cable: str,
        motion: Array,
        shapes: CableMotion,
        solve: Solve,
        *,
        jumps: Array,
        turns: Array,
    ):
        self.cable, self._solve, self._jumps, self._turns = cable, solve, jumps, turns
        self.s, self.times = shapes.s, motion
        self.position, self.tangent = shapes.position, rotations.tangent(shapes.quaternion)
        own = float(np.nan_to_num(np.max(shapes.estimated_error)))
        self.error = cubic_error(shapes) + own * shapes.s[-1]  # of the frames themselves, m
        self.given = motion
        self.lost = np.zeros(0)  # motion values at which no shape was found
        self.trust = 1.0
        self._prepare()

    @property
    def inserted(self) -> int:
        """How many frames were added."""
        return len(self.times) - len(self.given)

    def interval(self, at: Array) -> Indices:
        """Return the intervals (k,) between frames that hold motion values ``at`` (k,)."""
        return np.clip(np.searchsorted(self.times, at, side="right") - 1, 0, len(self.times) - 2)

    def arc(self, s: Array) -> Indices:
        """Return the intervals (k,) between stations that hold arc lengths ``s`` (k,)."""
        return np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, len(self.s) - 2)

    def at(self, interval: Indices, at: Array, s: Array) -> Array:
        """Return points (k, 3), m, at motion values ``at`` (k,) within intervals (k,) and arc lengths ``s`` (k,)."""
        share = (at - self.times[interval]) / (self.times[interval + 1] - self.times[interval])
        powers = share[:, None] ** np.arange(NODES)
        j = self.arc(s)

        def now(coefficients: Array, station: Indices) -> Array:
            return np.einsum("kp,kpc->kc", powers, coefficients[interval, :, station])

        h = self.s[j + 1] - self.s[j]
        ends = (now(values, station) for values in (self._r, self._u) for station in (j, j + 1))
        return hermite(h, (s - self.s[j]) / h, *ends)

    def bent(self, interval: int, low: float, high: float) -> Array:
        """Return the most of |r_ss| on the arcs between stations (N - 1,), from share ``low`` to ``high``, 1/m."""
        return np.max([self._most(end[interval : interval + 1], low, high)[0] for end in self._bends], axis=0)

    def insert(self, values: Array) -> bool:
        """Solve frames at motion values (k,), each inside an interval; return whether :attr:`trust` was raised."""
        gap = np.min(np.abs(values[:, None] - self.times), axis=1, initial=math.inf)
        values = np.unique(values[gap > SHORTEST])
        if not len(values):
            return False
        where = self.interval(values)
        position, quaternion, found = self._solve(self.cable, values)
        self.lost = np.union1d(self.lost, values[~found])
        values, where = values[found], where[found]
        position, tangent = position[found], rotations.tangent(quaternion[found])
        expected = np.array(
            [self.at(np.full(len(self.s), k), np.full(len(self.s), t), self.s)
             for k, t in zip(where, values, strict=True)]
        ).reshape(position.shape)  # fmt: skip
        off = lengths(position - expected).max(axis=1, initial=0.0)
        estimated = self.deviation[where]
        wrong = np.isfinite(estimated) & (off > estimated) & ~self.broken[where]
        raised = bool(np.any(wrong))
        if raised:
            self.trust *= TRUST * float(np.max(off[wrong] / estimated[wrong]))
        order = np.argsort(np.concatenate([self.times, values]), kind="stable")
        self.times = np.concatenate([self.times, values])[order]
        self.position = np.concatenate([self.position, position])[order]
        self.tangent = np.concatenate([self.tangent, tangent])[order]
        self._prepare()
        return raised

    def complete(self) -> None:
        """Solve as many frames as a cubic needs on every stretch without a break."""
        for _ in range(NODES):
            missing = [
                np.linspace(self.times[first], self.times[last], NODES)[1:-1]
                for first, last in self._stretches()
                if first < last < first + NODES - 1
            ]
            if not missing:
                return
            self.insert(np.concatenate(missing))

    def why_broken(self, interval: int) -> str:
        """Return why nothing is known within an interval: a sentence for the user."""
        low, high = self.times[interval], self.times[interval + 1]
        frame = int(np.clip(np.searchsorted(self.given, 0.5 * (low + high)) - 1, 0, len(self.given) - 2))
        where = f"between frames {frame} and {frame + 1} (motion {low:.6f} to {high:.6f})"
        if np.any((self._jumps > low) & (self._jumps < high)):
            return f"{self.cable} snaps {where}, and what it meets on the way is not known"
        if high - low < SHORTEST:
            return f"{self.cable} jumps {where}"
        return f"no shape of {self.cable} was found {where}"

    def _stretches(self) -> list[tuple[int, int]]:
        """Return the first and last frame of each run of frames across which the motion is smooth."""
        kinks = np.flatnonzero(np.isin(self.times, self._turns))
        cuts = {0, len(self.times) - 1, *kinks}
        for k in np.flatnonzero(self.broken):
            cuts |= {int(k), int(k) + 1}
        edges = sorted(int(cut) for cut in cuts)
        return [(a, b) for a, b in itertools.pairwise(edges) if not (b == a + 1 and self.broken[a])]

    def _prepare(self) -> None:
        """Find the cubics of all intervals and their bounds."""
        count = len(self.times) - 1
        step = np.diff(self.times)
        self.broken = np.zeros(count, dtype=bool)
        for values in (self._jumps, self.lost):
            self.broken[self.interval(values)] = len(self.times) > 1
        self.broken |= step < SHORTEST
        self._nodes = np.zeros((count, NODES), dtype=np.int64)
        known = np.zeros(count, dtype=bool)
        for first, last in self._stretches():
            inside = np.arange(first, last)
            begin = np.clip(inside - 1, first, max(first, last - NODES + 1))
            self._nodes[inside] = np.minimum(begin[:, None] + np.arange(NODES), last)
            known[inside] = last - first + 1 >= NODES
        known &= ~self.broken
        self._basis = np.zeros((count, NODES, NODES))
        self._places = (self.times[self._nodes] - self.times[:-1, None]) / step[:, None]
        self._basis[known] = np.linalg.inv(self._places[known][:, :, None] ** np.arange(NODES))
        self._straighten(~known)
        self._bounds()
        way = lengths(np.diff(self.position, axis=0)).max(axis=1)
        rough = known & (self.deviation > self.trust * way) & (way > ROUNDING * self.s[-1])
        if np.any(rough):
            self._straighten(rough)
            self._bounds()
        tilt = lengths(np.diff(self.tangent, axis=0)).max(axis=1)
        self.deviation[rough], self.turn_deviation[rough] = self.trust * way[rough], self.trust * tilt[rough]
        unknown = self.broken | ~known
        self.deviation[unknown] = self.turn_deviation[unknown] = np.inf

    def _straighten(self, which: NDArray[np.bool_]) -> None:
        """Put straight lines in place of the cubics of intervals (P - 1,)."""
        line = np.flatnonzero(which)
        self._nodes[line] = line[:, None] + [0, 1, 1, 1]
        self._places[line] = [0.0, 1.0, 1.0, 1.0]
        self._basis[line] = 0.0
        self._basis[line, 0, 0], self._basis[line, 1, 0], self._basis[line, 1, 1] = 1.0, -1.0, 1.0

    @staticmethod
    def _most(c: Array, low: float = 0.0, high: float = 1.0) -> Array:
        """Return the most of |x| over intervals (k, n), of cubics with coefficients (k, 4, n, 3).

        That is from share ``low`` to ``high``. Between samples it is above a line by no more than linear
        interpolation's error.
        """
        share = np.linspace(low, high, PIECES + 1)
        values = [lengths(np.einsum("p,kpnc->knc", x ** np.arange(NODES), c)) for x in share]
        curved = 2 * lengths(c[:, 2]) + 6 * high * lengths(c[:, 3])
        return np.max(values, axis=0) + 0.125 * ((high - low) / PIECES) ** 2 * curved

    def _bounds(self) -> None:
        """Bound the cubics' derivatives over intervals and arcs, and estimate how far off they are.

        Sets ``speed`` and ``acceleration``, m per interval and per interval squared, ``bend``, 1/m, all
        (P - 1, N - 1), and ``turn_acceleration``, that of ``r_s``; ``deviation``, m, ``turn_deviation``, that of
        ``r_s``, and ``stretch``, by how much ``|r_s|`` differs from 1, (P - 1,).
        """
        h = np.diff(self.s)
        nodes = self._nodes

        def coefficients(values: Array) -> Array:
            return np.einsum("kpi,kinc->kpnc", self._basis, values[nodes])

        def largest(r: Array, u: Array) -> Array:
            """Return the most of |r| on the arcs between stations, of cubics with values r and slopes u."""
            r, u = lengths(r), lengths(u)
            return np.maximum(r[:, 1:], r[:, :-1]) + 0.25 * h * np.maximum(u[:, 1:], u[:, :-1])

        def steepest(r: Array, u: Array) -> Array:
            """Return the most of |r_s| on the arcs: of the line through the slopes, and of what is added to it."""
            bulge = np.diff(r, axis=1) / h[:, None] - 0.5 * (u[:, 1:] + u[:, :-1])
            return np.maximum(lengths(u[:, 1:]), lengths(u[:, :-1])) + 1.5 * lengths(bulge)

        r, u = coefficients(self.position), coefficients(self.tangent)
        # a cubic's second derivative is linear, so largest at an end; its first is off a line by an eighth
        ends = [[2 * x[:, 2], 2 * x[:, 2] + 6 * x[:, 3]] for x in (r, u)]
        self.acceleration = np.maximum(*(largest(a, b) for a, b in zip(*ends, strict=True)))
        self.turn_acceleration = np.maximum(*(steepest(a, b) for a, b in zip(*ends, strict=True)))
        ends = [[x[:, 1], x[:, 1] + 2 * x[:, 2] + 3 * x[:, 3]] for x in (r, u)]
        third = largest(6 * r[:, 3], 6 * u[:, 3])
        self.speed = np.maximum(*(largest(a, b) for a, b in zip(*ends, strict=True))) + 0.125 * third
        # the second derivative of a frame's cubic along the arc is linear between stations too
        step = (self.position[:, 1:] - self.position[:, :-1]) / h[:, None]
        before, after = self.tangent[:, :-1], self.tangent[:, 1:]
        ends_of_arc = [6 * step - 4 * before - 2 * after, 2 * before + 4 * after - 6 * step]
        self._r, self._u = r, u
        self._bends = [coefficients(end) / h[:, None] for end in ends_of_arc]
        self.bend = np.maximum(*(self._most(end) for end in self._bends))
        halfway = 0.5 ** np.arange(NODES)
        self.stretch = STRETCH * np.abs(1.0 - lengths(np.einsum("p,kpnc->knc", halfway, u))).max(axis=1)
        gaps = np.abs(np.linspace(0.0, 1.0, 33)[None, :, None] - self._places[:, None])
        outer = (self._places < -1e-9) | (self._places > 1 + 1e-9)
        change = np.zeros(len(nodes))
        for left_out in range(NODES):
            others = np.delete(gaps, left_out, axis=2).prod(axis=2).max(axis=1)
            change = np.maximum(change, np.where(outer[:, left_out], others, 0.0))
        third, turn = largest(r[:, 3], u[:, 3]).max(axis=1), steepest(r[:, 3], u[:, 3]).max(axis=1)
        self.deviation = self.trust * np.maximum(third * change, ROUNDING * self.s[-1])
        self.turn_deviation = self.trust * np.maximum(turn * change, ROUNDING)
