"""A cable's centreline between solved frames, and how far off it can be.

Between two frames every station moves along the cubic through four frames of the same stretch of the motion;
along the cable it is the cubic of :class:`harness_opt.clearance.centreline.Curve`. Where a body carries an end of
the cable, that is done in its coordinates, in which the cable moves least. What lies between frames is known this
well:

* proven: everything about these cubics themselves, so that bounds on them need no sampling;
* estimated: :attr:`MovingCurve.deviation`, by how much the true shapes can differ from the cubics. It is what the
  fourth frame changes in the parabola through the other three, of one order lower than the cubic's own error (the
  usual estimate of embedded formulas: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, section
  II.4), taken where it is largest among neighbours. Where that is more than the way between the two frames, as
  where a cable starts to lean out of a plane, a straight line takes the cubic's place and that way is the estimate.
  Every frame solved between two others is compared with what was expected there; where one is further off than
  estimated, the estimates around it are raised.

Where the cable snaps, or no shape is found, nothing is known between the two frames: the interval is broken.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness_opt.clearance.centreline import hermite
from harness_opt.clearance.solved_frames import NODES, SolvedFrames
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices, lengths

RAISE = 1.5  # times the largest difference met over the one estimated, where it was more than estimated
LEAST = 0.1  # of the largest estimate along the cable: near a clamp it can vanish by chance
STRETCH = 2.0  # times what is seen half-way between two frames
PIECES = 4  # of an interval, between which a cubic is bounded by interpolation
BLOCK = 256  # intervals that are bounded at a time: each takes some 100 kB meanwhile
ROUNDING = 1e-12  # of the cable's length: differences of positions below this are rounding

Poses = Callable[[Array], tuple[Array, Array]]  # motion values (k,) to positions (k, 3), m, and quaternions (k, 4)


class MovingCurve:
    """The centreline of one cable over its motion, in the world or in the coordinates of a body.

    Args:
        frames: solved.
        poses: of the body; None stays in the world.
    """

    def __init__(self, frames: SolvedFrames, poses: Poses | None = None):
        self.frames, self._poses = frames, poses
        self.s, self.error = frames.s, frames.error
        # what the estimates are multiplied by, between the frames of the simulation
        self._raised = np.ones(max(len(frames.given) - 1, 1))
        self._complete: Array | None = None  # the frames that were found to be enough
        self._boxed: tuple[Array, Array, Array] | None = None  # the frames that boxes were made of, and these
        self._take()

    @property
    def cable(self) -> str:
        """The cable's name."""
        return self.frames.cable

    @property
    def raised(self) -> float:
        """What the estimate was multiplied by where frames solved in between showed most that it was too small."""
        return float(self._raised.max())

    def interval(self, at: Array) -> Indices:
        """Return the intervals (k,) between frames that hold motion values ``at`` (k,)."""
        return np.clip(np.searchsorted(self.times, at, side="right") - 1, 0, len(self.times) - 2)

    def arc(self, s: Array) -> Indices:
        """Return the intervals (k,) between stations that hold arc lengths ``s`` (k,)."""
        return np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, len(self.s) - 2)

    def at(self, interval: Indices, at: Array, s: Array) -> Array:
        """Return points (k, 3), m, at motion values ``at`` (k,) within intervals (k,) and arc lengths ``s`` (k,)."""
        share = (at - self.times[interval]) / (self.times[interval + 1] - self.times[interval])
        powers = np.stack([np.ones_like(share), share, share * share, share**3], axis=-1)
        weights, j = np.einsum("kp,kpi->ki", powers, self._basis[interval]), self.arc(s)
        # by one number for frame and station: half the time of two
        places = self._nodes[interval] * len(self.s) + j[:, None]

        def now(values: Array, after: int) -> Array:
            found: Array = np.einsum("ki,kic->kc", weights, values.reshape(-1, 3).take(places + after, axis=0))
            return found

        h = self.s[j + 1] - self.s[j]
        ends = (now(values, after) for values in (self.position, self.tangent) for after in (0, 1))
        return hermite(h, (s - self.s[j]) / h, *ends)

    def bent(self, interval: int, low: float, high: float) -> Array:
        """Return the most of |r_ss| on the arcs between stations (N - 1,), from share ``low`` to ``high``, 1/m."""
        nodes = self._nodes[interval : interval + 1]
        ends = _bends(self.s, self._basis[interval : interval + 1], self.position[nodes], self.tangent[nodes])
        found: Array = np.max([_most(end, low, high)[0] for end in ends], axis=0)
        return found

    def insert(self, values: Array) -> bool:
        """Solve frames at motion values (k,), each inside an interval; return whether estimates were raised for it."""
        self.frames.insert(values)
        return self.update()

    def update(self) -> bool:
        """Take up frames that were solved since, and return whether estimates were raised for them."""
        if self.frames.times is self.times:  # each attempt to solve some makes a new array
            return False
        new = np.flatnonzero(~np.isin(self.frames.times, self.times))
        if not len(new) and np.array_equal(self.broken, self.frames.broken):
            return False
        values = self.frames.times[new]
        where, count = self.interval(values), len(self.s)
        at = (np.repeat(where, count), np.repeat(values, count), np.tile(self.s, len(new)))
        expected = self.at(*at).reshape(len(new), count, 3)
        estimated = self.error + np.maximum(
            np.pad(self.deviation, ((0, 0), (0, 1)), mode="edge"), np.pad(self.deviation, ((0, 0), (1, 0)), mode="edge")
        )
        self._take()
        over = np.max(lengths(self.position[new] - expected) / estimated[where], axis=1, initial=0.0)
        wrong = over > 1.0
        if np.any(wrong):
            # around it too: what is rough is so on both sides of a frame
            for near in (-1, 0, 1):
                k = self._given(values[wrong]) + near
                inside = (k >= 0) & (k < len(self._raised))
                np.maximum.at(self._raised, k[inside], (RAISE * over[wrong] * self._trust[where[wrong]])[inside])
            self._prepare()
        return bool(np.any(wrong))

    def _given(self, at: Array) -> Indices:
        """Return the intervals (k,) between frames of the simulation that hold motion values ``at`` (k,)."""
        return np.clip(np.searchsorted(self.frames.given, at, side="right") - 1, 0, len(self._raised) - 1)

    @property
    def boxes(self) -> tuple[Array, Array]:
        """Lower and upper corners (P - 1, 3), m, of boxes that hold the true centreline between two frames each.

        Corners of arcs and stretches, and how far it strays from linear between them and may be off; all space where
        nothing is known.
        """
        if self._boxed is None or self._boxed[0] is not self.times:
            strays = 0.125 * np.diff(self.s) ** 2 * self.bend + 0.125 * self.acceleration + self.deviation
            reach = np.where(self.broken, np.inf, strays.max(axis=1) + self.error)[:, None]
            low, high = self.position.min(axis=1), self.position.max(axis=1)
            boxes = np.minimum(low[1:], low[:-1]) - reach, np.maximum(high[1:], high[:-1]) + reach
            self._boxed = self.times, *boxes
        return self._boxed[1:]

    def complete(self) -> None:
        """Solve as many frames as a cubic needs on every stretch without a break."""
        if self._complete is not self.frames.times:
            self.frames.complete()
            self.update()
            self._complete = self.frames.times

    def _take(self) -> None:
        """Copy the frames, into the body's coordinates, and find their cubics."""
        self.times, self.position, self.tangent = self.frames.times, self.frames.position, self.frames.tangent
        if self._poses is not None:
            position, quaternion = self._poses(self.times)
            back = rotations.conjugate(quaternion)[:, None]
            self.position = rotations.rotate(back, self.position - position[:, None])
            self.tangent = rotations.rotate(back, self.tangent)
        self._prepare()

    def _prepare(self) -> None:
        """Find the cubics of all intervals and their bounds."""
        count = len(self.times) - 1
        step = np.diff(self.times)
        self.broken = self.frames.broken
        self._trust = self._raised[self._given(0.5 * (self.times[1:] + self.times[:-1]))]
        self._nodes = np.zeros((count, NODES), dtype=np.int64)
        known = np.zeros(count, dtype=bool)
        for first, last in self.frames.stretches():
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
        way, tilt = (lengths(np.diff(values, axis=0)) for values in (self.position, self.tangent))
        way, tilt = np.maximum(way[:, 1:], way[:, :-1]), np.maximum(tilt[:, 1:], tilt[:, :-1])
        trust = self._trust[:, None]
        most = trust[:, 0] * np.maximum(way.max(axis=1), ROUNDING * self.s[-1])
        rough = known & (self.deviation.max(axis=1) > most)
        if np.any(rough):
            self._straighten(rough)
            self._bounds()
            self.deviation[rough], self.turn_deviation[rough] = (trust * way)[rough], (trust * tilt)[rough]
        unknown = self.broken | ~known
        self.deviation[unknown] = self.turn_deviation[unknown] = np.inf

    def _straighten(self, which: NDArray[np.bool_]) -> None:
        """Put straight lines in place of the cubics of intervals (P - 1,)."""
        line = np.flatnonzero(which)
        self._nodes[line] = line[:, None] + [0, 1, 1, 1]
        self._places[line] = [0.0, 1.0, 1.0, 1.0]
        self._basis[line] = 0.0
        self._basis[line, 0, 0], self._basis[line, 1, 0], self._basis[line, 1, 1] = 1.0, -1.0, 1.0

    def _bounds(self) -> None:
        """Bound the cubics' derivatives over intervals and arcs, and estimate how far off they are.

        Sets ``speed`` and ``acceleration``, m per interval and per interval squared, ``bend``, 1/m, all
        (P - 1, N - 1), and ``turn_acceleration``, that of ``r_s``; ``deviation``, m, and ``turn_deviation``, that of
        ``r_s``, too; and ``stretch``, by how much ``|r_s|`` differs from 1, (P - 1,).
        """
        some = (slice(first, first + BLOCK) for first in range(0, len(self._nodes), BLOCK))
        found = [
            _Bounds.of(self.s, self._basis[k], self.position[self._nodes[k]], self.tangent[self._nodes[k]])
            for k in some
        ]
        bounds = _Bounds(*map(np.concatenate, zip(*found, strict=True)))
        self.speed, self.acceleration, self.bend = bounds.speed, bounds.acceleration, bounds.bend
        self.turn_acceleration, self.stretch = bounds.turn_acceleration, bounds.stretch
        gaps = np.abs(np.linspace(0.0, 1.0, 33)[None, :, None] - self._places[:, None])
        outer = (self._places < -1e-9) | (self._places > 1 + 1e-9)
        change = np.zeros(len(self._nodes))
        for left_out in range(NODES):
            others = np.delete(gaps, left_out, axis=2).prod(axis=2).max(axis=1)
            change = np.maximum(change, np.where(outer[:, left_out], others, 0.0))
        cubes = np.diff(self.times)[:, None] ** 3
        third, turn = (
            _neighbours(values / cubes) * cubes * change[:, None] for values in (bounds.third, bounds.turn_third)
        )
        trust = self._trust[:, None]
        self.deviation = trust * np.maximum(
            third, np.maximum(LEAST * third.max(axis=1), ROUNDING * self.s[-1])[:, None]
        )
        self.turn_deviation = trust * np.maximum(turn, ROUNDING)


class _Bounds(NamedTuple):
    """Bounds on the derivatives of cubics in the motion, over k intervals and the arcs between N stations.

    Args:
        speed, acceleration, third: of the first three by the motion, m per interval, its square and cube, (k, N - 1).
        turn_acceleration, turn_third: of those of ``r_s``.
        bend: of ``|r_ss|``, 1/m, (k, N - 1).
        stretch: by how much ``|r_s|`` differs from 1, (k,).
    """

    speed: Array
    acceleration: Array
    third: Array
    turn_acceleration: Array
    turn_third: Array
    bend: Array
    stretch: Array

    @classmethod
    def of(cls, s: Array, basis: Array, position: Array, tangent: Array) -> _Bounds:
        """Return the bounds of the cubics that go through ``position`` and ``tangent`` (k, 4, N, 3) by ``basis``."""
        h = np.diff(s)

        def largest(r: Array, u: Array) -> Array:
            """Return the most of |r| on the arcs between stations, of cubics with values r and slopes u."""
            r, u = lengths(r), lengths(u)
            return np.maximum(r[:, 1:], r[:, :-1]) + 0.25 * h * np.maximum(u[:, 1:], u[:, :-1])

        def steepest(r: Array, u: Array) -> Array:
            """Return the most of |r_s| on the arcs: of the line through the slopes, and of what is added to it."""
            bulge = np.diff(r, axis=1) / h[:, None] - 0.5 * (u[:, 1:] + u[:, :-1])
            return np.maximum(lengths(u[:, 1:]), lengths(u[:, :-1])) + 1.5 * lengths(bulge)

        r, u = _coefficients(basis, position), _coefficients(basis, tangent)
        # a cubic's second derivative is linear, so largest at an end; its first is off a line by an eighth
        ends = [[2 * x[:, 2], 2 * x[:, 2] + 6 * x[:, 3]] for x in (r, u)]
        acceleration = np.maximum(*(largest(a, b) for a, b in zip(*ends, strict=True)))
        turn_acceleration = np.maximum(*(steepest(a, b) for a, b in zip(*ends, strict=True)))
        ends = [[x[:, 1], x[:, 1] + 2 * x[:, 2] + 3 * x[:, 3]] for x in (r, u)]
        speed = np.maximum(*(largest(a, b) for a, b in zip(*ends, strict=True)))
        speed = speed + 0.125 * largest(6 * r[:, 3], 6 * u[:, 3])
        bend = np.maximum(*(_most(end) for end in _bends(s, basis, position, tangent)))
        halfway = np.einsum("p,kpnc->knc", 0.5 ** np.arange(NODES), u)
        stretch = STRETCH * np.abs(1.0 - lengths(halfway)).max(axis=1)
        third, turn_third = largest(r[:, 3], u[:, 3]), steepest(r[:, 3], u[:, 3])
        return cls(speed, acceleration, third, turn_acceleration, turn_third, bend, stretch)


def _coefficients(basis: Array, values: Array) -> Array:
    """Return the coefficients (k, 4, n, 3) of the cubics through ``values`` (k, 4, n, 3), by powers of the share."""
    found: Array = np.einsum("kpi,kinc->kpnc", basis, values)
    return found


def _bends(s: Array, basis: Array, position: Array, tangent: Array) -> list[Array]:
    """Return the coefficients (k, 4, N - 1, 3) of ``r_ss`` at the start and the end of every arc.

    The second derivative of a frame's cubic along the arc is linear between stations.
    """
    h = np.diff(s)[:, None]
    step = (position[:, :, 1:] - position[:, :, :-1]) / h
    before, after = tangent[:, :, :-1], tangent[:, :, 1:]
    ends = [6 * step - 4 * before - 2 * after, 2 * before + 4 * after - 6 * step]
    return [_coefficients(basis, end) / h for end in ends]


def _most(c: Array, low: float = 0.0, high: float = 1.0) -> Array:
    """Return the most of |x| over intervals (k, n), of cubics with coefficients (k, 4, n, 3).

    That is from share ``low`` to ``high``. Between samples it is above a line by no more than linear interpolation's
    error.
    """
    share = np.linspace(low, high, PIECES + 1)
    values = [lengths(np.einsum("p,kpnc->knc", x ** np.arange(NODES), c)) for x in share]
    curved = 2 * lengths(c[:, 2]) + 6 * high * lengths(c[:, 3])
    found: Array = np.max(values, axis=0) + 0.125 * ((high - low) / PIECES) ** 2 * curved
    return found


def _neighbours(values: Array) -> Array:
    """Return the largest of each row's and its neighbours' values (k, n): one alone can vanish by chance."""
    padded = np.pad(values, ((1, 1), (0, 0)), mode="edge")
    return np.maximum(np.maximum(padded[:-2], padded[2:]), values)
