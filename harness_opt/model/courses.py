"""How an angle or a travel goes over the motion, by a table or by moves; smooth ways through poses.

A course is gone through once over the whole motion, from 0 to 1. Its value, its speed and its acceleration are
continuous, and the largest of either over a stretch is exact: found where it turns, and at the stretch's ends.
"""

from __future__ import annotations

import functools
import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from harness_opt.errors import ProblemError
from harness_opt.model import checks
from harness_opt.numerics.rotations import Array

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline
    from scipy.spatial.transform import RotationSpline

SHORTEST = 1e-9  # s between two rows of a table: no motion is told more finely, and speeds stay numbers
RATE_MARGIN = 1.1  # angular acceleration is not linear between samples of it; sizes and angles are
ROUNDING = 1e-12  # of a largest speed or acceleration, by which its place and its value are off


class Course(ABC):
    """A number that goes its way over the motion: rad of a hinge, m of a slide."""

    @property
    @abstractmethod
    def seconds(self) -> float:
        """How long it takes, s."""

    @abstractmethod
    def derivative(self, motion: Array, order: int) -> Array:
        """Return the value (P,) at ``motion`` (P,), 0 to 1, or its derivative of ``order`` 1 or 2 by the motion."""

    @property
    @abstractmethod
    def turns(self) -> Array:
        """Motion values (n,), increasing, from 0 to 1: where the value, its speed or its acceleration turns."""

    def values(self, motion: ArrayLike) -> Array:
        """Return the values (P,) at ``motion`` (P,) from 0 to 1."""
        return self.derivative(np.atleast_1d(np.asarray(motion, dtype=float)), 0)

    def rates(self, first: Array, last: Array) -> tuple[Array, Array]:
        """Return the most of speed and acceleration (k,) from ``first`` (k,) to ``last`` (k,), per unit of motion."""
        # the turns inside of each stretch, as the places of a maximum over slices; a pad, for slices that end there
        slices = np.column_stack([np.searchsorted(self.turns, first), np.searchsorted(self.turns, last, side="right")])
        found = []
        for order, sizes in zip((1, 2), self._most, strict=True):
            ends = np.maximum(*(np.abs(self.derivative(at, order)) for at in (first, last)))
            inside = np.maximum.reduceat(sizes, slices.ravel())[::2]
            most = np.maximum(ends, np.where(slices[:, 0] < slices[:, 1], inside, 0.0))
            found.append((1.0 + ROUNDING) * most)
        return found[0], found[1]

    @property
    def range(self) -> tuple[float, float]:
        """The least and the largest value of the whole way."""
        values = self.values(self.turns)
        return float(values.min()), float(values.max())

    @functools.cached_property
    def _most(self) -> tuple[Array, Array]:
        """Speeds and accelerations (n + 1,) where they turn, and a zero behind."""
        return tuple(np.append(np.abs(self.derivative(self.turns, order)), 0.0) for order in (1, 2))  # type: ignore[return-value]


@dataclass(frozen=True)
class ValueTable(Course):
    """The rows of a table, with a cubic spline through them; ``motion`` 0 to 1 maps onto its times linearly.

    Args:
        times: (n,) increasing, s.
        entries: (n,), rad of a hinge, m of a slide.
        file: where the table was read from, or None.
        unit: of the values in the file: "rad" or "deg", "m" or "mm".
    """

    times: tuple[float, ...]
    entries: tuple[float, ...]
    file: Path | None = None
    unit: str = ""

    def __post_init__(self) -> None:
        times = increasing(self.times)
        if np.shape(self.entries) != times.shape or not np.all(np.isfinite(self.entries)):
            raise ProblemError("entries: expected one finite number a time")

    @property
    def seconds(self) -> float:
        """See :attr:`Course.seconds`."""
        return self.times[-1] - self.times[0]

    def derivative(self, motion: Array, order: int) -> Array:
        """See :meth:`Course.derivative`."""
        found: Array = self.seconds**order * self._spline(self.times[0] + motion * self.seconds, order)
        return found

    @functools.cached_property
    def turns(self) -> Array:
        """See :attr:`Course.turns`: at the rows, and where a piece's derivatives vanish between them."""
        spline = self._spline
        roots = [spline.derivative(order).roots(discontinuity=False, extrapolate=False) for order in (1, 2)]
        at = np.unique(np.concatenate([self.times, *(root[np.isfinite(root)] for root in roots)]))
        return np.clip((at - self.times[0]) / self.seconds, 0.0, 1.0)

    @property
    def beyond(self) -> float:
        """How far the spline goes beyond the table's own values, in their unit."""
        low, high = self.range
        return max(min(self.entries) - low, high - max(self.entries), 0.0)

    @functools.cached_property
    def _spline(self) -> CubicSpline:
        from scipy.interpolate import CubicSpline

        return CubicSpline(self.times, self.entries)


@dataclass(frozen=True)
class Move:
    """One move, at rest before and after.

    Args:
        to: where it ends, rad of a hinge, m of a slide.
        seconds: that it takes, above 0.
        dwell: how long it then stands still, s.
    """

    to: float
    seconds: float
    dwell: float = 0.0

    def __post_init__(self) -> None:
        checks.numbers("to", (self.to,), 1)
        checks.positive("seconds", self.seconds)
        checks.positive("dwell", self.dwell, zero=True)


@dataclass(frozen=True)
class Moves(Course):
    """Moves one after the other, each eased so that it begins and ends at rest, without a jerk.

    A share u of its time takes a move ``10 u^3 - 15 u^4 + 6 u^5`` of its way: the polynomial of least degree whose
    speed and acceleration vanish at both ends (Flash and Hogan, The coordination of arm movements, J. Neurosci. 5
    (1985), of least jerk). Its speed is largest half-way, 15/8 of the mean one, and its acceleration, 10/sqrt(3), at
    shares of 1/2 -+ sqrt(3)/6.

    Args:
        begin: the first value, rad of a hinge, m of a slide.
        moves: one or more.
    """

    begin: float
    moves: tuple[Move, ...]

    def __post_init__(self) -> None:
        checks.numbers("begin", (self.begin,), 1)
        if not self.moves:
            raise ProblemError("moves: found none, expected at least one")

    @property
    def seconds(self) -> float:
        """See :attr:`Course.seconds`."""
        return math.fsum(second for move in self.moves for second in (move.seconds, move.dwell))

    def derivative(self, motion: Array, order: int) -> Array:
        """See :meth:`Course.derivative`."""
        starts, took, origins, ways = self._pieces
        at = motion * self.seconds
        k = np.clip(np.searchsorted(starts, at, side="right") - 1, 0, len(starts) - 1)
        u = np.clip((at - starts[k]) / took[k], 0.0, 1.0)  # 1 while it dwells
        if order == 0:
            found: Array = origins[k] + ways[k] * (u * u * u * (10.0 - u * (15.0 - 6.0 * u)))
            return found
        rest = u * (1.0 - u)
        shape = 30.0 * rest**2 if order == 1 else 60.0 * rest * (1.0 - 2.0 * u)
        found = ways[k] * (self.seconds / took[k]) ** order * shape
        return found

    @functools.cached_property
    def turns(self) -> Array:
        """See :attr:`Course.turns`."""
        starts, took, _, _ = self._pieces
        shares = np.array([0.0, 0.5 - math.sqrt(3.0) / 6.0, 0.5, 0.5 + math.sqrt(3.0) / 6.0, 1.0])
        at = (starts[:, None] + took[:, None] * shares) / self.seconds
        return np.unique(np.clip(np.append(at.ravel(), 1.0), 0.0, 1.0))

    @functools.cached_property
    def _pieces(self) -> tuple[Array, Array, Array, Array]:
        """Of each move: when it starts and how long it takes, s; where it starts, and its way."""
        took = np.array([move.seconds for move in self.moves])
        whole = took + [move.dwell for move in self.moves]
        values = np.array([self.begin, *(move.to for move in self.moves)])
        return np.concatenate([[0.0], np.cumsum(whole)[:-1]]), took, values[:-1], np.diff(values)


# --- poses ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class PoseSpline:
    """A smooth way through poses: positions by a cubic spline, rotations by one on the sphere.

    Args:
        motion: (n,), increasing, n > 1.
        positions: (n, 3), m.
        quaternions: (n, 4), unit.
    """

    motion: Array
    positions: Array
    quaternions: Array

    def poses(self, at: Array) -> tuple[Array, Array]:
        """Return positions (P, 3) and quaternions (P, 4) at motion values ``at`` (P,)."""
        position, rotation = self._splines
        return position(at), np.roll(rotation(at).as_quat(), 1, axis=1)

    def rates(self, first: Array, last: Array) -> tuple[Array, Array, Array, Array]:
        """Return bounds on speed, acceleration, angular speed and its change from ``first`` (k,) to ``last`` (k,).

        The origin's acceleration is linear between the poses, so it is largest at one of them; speeds are sampled, and
        raised by what they can grow between two samples. Angular acceleration alone is sampled and raised by
        RATE_MARGIN.
        """
        grid, values = self._sampled_rates
        # the samples around each stretch, one to either side of it
        low = np.maximum(np.searchsorted(grid, first, side="right") - 1, 0)
        high = np.minimum(np.searchsorted(grid, last), len(grid) - 1)
        most = [[float(v[i : j + 1].max()) for i, j in zip(low, high, strict=True)] for v in values]
        speed, acceleration, turning, change = np.array(most).reshape(4, -1)
        gap = float(np.diff(grid).max())
        change = RATE_MARGIN * change
        return speed + 0.5 * gap * acceleration, acceleration, turning + 0.5 * gap * change, change

    @functools.cached_property
    def _sampled_rates(self) -> tuple[Array, Array]:
        """Motion values (n,), and there the origin's speed and acceleration, and the angular ones, (4, n)."""
        rate_samples = 2001  # beside the poses themselves, where rates are looked up
        grid = np.union1d(np.linspace(self.motion[0], self.motion[-1], rate_samples), self.motion)
        position, rotation = self._splines
        rates = [position(grid, 1), position(grid, 2), rotation(grid, 1), rotation(grid, 2)]
        return grid, np.array([np.linalg.norm(rate, axis=1) for rate in rates])

    @functools.cached_property
    def _splines(self) -> tuple[CubicSpline, RotationSpline]:
        from scipy.interpolate import CubicSpline
        from scipy.spatial.transform import Rotation, RotationSpline

        position = CubicSpline(self.motion, self.positions)
        return position, RotationSpline(self.motion, Rotation.from_quat(np.roll(self.quaternions, -1, axis=1)))


@dataclass(frozen=True, eq=False)
class FoundPoses:
    """Where something was found to stand over the motion: smooth, but for jumps.

    Args:
        motion: values (n,) at which it was found, increasing.
        positions, quaternions: (n, 3), m, and (n, 4).
        jumps: numbers (k,) of those places that it comes to by a jump, increasing.
        kinks: numbers (k,) of those at which it turns sharply.
        places: arc lengths (n,), m, at which a cable stands in a clip that it slides through; None elsewhere.
    """

    motion: Array
    positions: Array
    quaternions: Array
    jumps: tuple[int, ...] = ()
    kinks: tuple[int, ...] = ()
    places: Array | None = None

    def poses(self, at: Array) -> tuple[Array, Array]:
        """Return positions (P, 3) and quaternions (P, 4) at motion values ``at`` (P,); across a jump, straight on."""
        position, quaternion = np.empty((len(at), 3)), np.empty((len(at), 4))
        for which, spline in self._over(at):
            position[which], quaternion[which] = spline.poses(at[which])
        return position, quaternion

    def rates(self, first: Array, last: Array) -> tuple[Array, Array, Array, Array]:
        """Return bounds as :meth:`PoseSpline.rates` does, over stretches that hold no place of a jump within."""
        found = np.zeros((4, len(first)))
        for which, spline in self._over(0.5 * (first + last)):
            found[:, which] = spline.rates(first[which], last[which])
        return found[0], found[1], found[2], found[3]

    def arc_lengths(self, at: Array) -> Array:
        """Return the arc lengths (P,), m, in a clip that the cable slides through at motion values ``at`` (P,)."""
        from scipy.interpolate import CubicSpline

        assert self.places is not None
        found = np.empty(len(at))
        for which, (first, last) in self._edges(at):
            own = slice(first, last + 1)
            still = last == first
            found[which] = self.places[first] if still else CubicSpline(self.motion[own], self.places[own])(at[which])
        return found

    def _over(self, at: Array) -> Iterator[tuple[NDArray[np.intp], PoseSpline]]:
        """Yield the smooth stretches that motion values ``at`` (P,) lie in, and which of these."""
        for which, (first, last) in self._edges(at):
            yield which, self._stretch(first, last)

    def _edges(self, at: Array) -> Iterator[tuple[NDArray[np.intp], tuple[int, int]]]:
        """Yield which of motion values ``at`` (P,) lie in one smooth stretch, and its first and last place."""
        if len(self.motion) == 1:
            yield np.arange(len(at)), (0, 0)
            return
        inner = [edge for jump in self.jumps for edge in (jump - 1, jump)]
        edges = sorted({0, *inner, *self.kinks, len(self.motion) - 1})
        stretch = np.clip(np.searchsorted(self.motion[edges], at, side="right") - 1, 0, len(edges) - 2)
        for k in np.unique(stretch).tolist():
            yield np.flatnonzero(stretch == k), (edges[k], edges[k + 1])

    @functools.cached_property
    def _stretches(self) -> dict[tuple[int, int], PoseSpline]:
        return {}

    def _stretch(self, first: int, last: int) -> PoseSpline:
        """Return the spline through the places from ``first`` to ``last``."""
        if (first, last) not in self._stretches:
            own = slice(first, last + 1)
            spline = PoseSpline(self.motion[own], self.positions[own], self.quaternions[own])
            if first == last:  # found at one moment alone
                both = np.repeat([first], 2)
                spline = PoseSpline(np.array([0.0, 1.0]), self.positions[both], self.quaternions[both])
            self._stretches[first, last] = spline
        return self._stretches[first, last]


def increasing(given: tuple[float, ...]) -> Array:
    """Return the times of a table, s.

    Raises:
        ProblemError: not two or more finite numbers, each at least SHORTEST after the one before.
    """
    times = np.asarray(given, dtype=float)
    if times.ndim != 1 or len(times) < 2 or not np.all(np.diff(times) > 0):
        raise ProblemError("times: expected at least two increasing numbers")
    if not np.all(np.isfinite(times)):
        raise ProblemError("times: expected finite numbers")
    if not float(np.min(np.diff(times))) >= SHORTEST:
        raise ProblemError(f"times: expected at least {SHORTEST:g} s between two")
    return times


def polyline(course: Course, tolerance: float) -> tuple[Array, Array]:
    """Return motion values (n,) and values (n,) between which straight lines are off by at most about ``tolerance``.

    Douglas and Peucker, Cartographica 10 (1973), with distances along the value.
    """
    samples = 1001  # of the motion, beside the course's own turns
    at = np.union1d(np.linspace(0.0, 1.0, samples), course.turns)
    values = course.values(at)
    kept, pieces = {0, len(at) - 1}, [(0, len(at) - 1)]
    while pieces:
        first, last = pieces.pop()
        line = np.interp(at[first : last + 1], at[[first, last]], values[[first, last]])
        off = np.abs(values[first : last + 1] - line)
        worst = first + int(np.argmax(off))
        if off[worst - first] > tolerance:
            kept.add(worst)
            pieces += [(first, worst), (worst, last)]
    chosen = sorted(kept)
    return at[chosen], values[chosen]
