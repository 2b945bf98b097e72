"""The smallest clearance of a cable to a part through the whole motion, between its frames too.

The centreline sweeps a surface ``y(s, t)`` in the part's own coordinates. On a cell, an arc [a, b] and a stretch
[t0, t1] of the motion, y strays from the bilinear patch through its four corners by at most ``(b - a)^2 / 8`` times
the most of ``|y_ss|`` and ``(t1 - t0)^2 / 8`` times that of ``|y_tt|`` (the error of linear interpolation, once along
each side), and the patch lies in the convex hull of the corners. So

    clearance >= distance of the hull - both errors - how far the centreline may be off - radius.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from harness_opt.clearance.centreline import Curve, in_blocks
from harness_opt.clearance.certify import Bounds, Cells, Search
from harness_opt.clearance.moving_centreline import MovingCurve, Poses
from harness_opt.clearance.to_part import after_leaving, places, survey
from harness_opt.clearance.witnesses import Certificate, Task, Witnesses
from harness_opt.model.bodies import Rates
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices, lengths
from harness_opt.parts.geometry import Geometry

CLAMP_SAMPLES = 65  # of the clamps' ways across an interval in which the shape is not known
BENT = 1.1  # most that a clamp's way between two such samples is longer than its chord


@dataclass(eq=False)
class Seen:
    """A moving centreline, and the body it is seen from; the same for all parts of the body.

    Args:
        curve: in the world, or in the body's coordinates; then the body stands still.
        poses: motion values (k,) to the body's positions (k, 3) and quaternions (k, 4).
        rates: motion values (k,), (k,) to how fast the body moves between them.
        clamps: of start and end, motion values (k,) to places (k, 3), m, in the body's coordinates; None where no
            clamp holds the end in place.
    """

    curve: MovingCurve
    poses: Poses
    rates: Callable[[Array, Array], Rates]
    clamps: tuple[Callable[[Array], Array] | None, Callable[[Array], Array] | None]

    def __post_init__(self) -> None:
        self._swept: tuple[Array, Array, tuple[Array, Array, Array]] | None = None  # what it was made of, and it

    def swept(self, arcs: Array) -> tuple[Array, Array, Array]:
        """Return the places at ``arcs`` (M,) in all frames, (P, M, 3), m, and how far what is between is from them.

        That is half the ways from one place to the next (P - 1,), m, and how far it strays from these (P - 1,), m.
        """
        curve = self.curve
        made = self._swept
        # bounds are found anew with every frame that is added, and where estimates are raised
        if made is None or made[0] is not curve.acceleration or not np.array_equal(made[1], arcs):
            y = np.concatenate([self.frames(some).grid(arcs) for some in in_blocks(np.arange(len(curve.times)))])
            step = np.diff(curve.times)
            ways = 0.5 * lengths(np.diff(y, axis=0)).max(axis=1)
            along = np.diff(arcs).max() ** 2 * curve.bend.max(axis=1)
            strays = 0.125 * (step**2 * self.acceleration().max(axis=1) + along)
            self._swept = made = curve.acceleration, arcs, (y, ways, strays)
        return made[2]

    def points(self, at: Array, world: Array) -> Array:
        """Return points ``world`` (k, 3), m, in the body's coordinates at motion values (k,)."""
        position, quaternion = self.poses(at)
        return rotations.rotate(rotations.conjugate(quaternion), world - position)

    def frames(self, which: Indices) -> Curve:
        """Return frames (k,) of the curve, solved ones, in the body's coordinates."""
        curve = self.curve
        own = Curve(curve.s, curve.position[which], curve.tangent[which])
        return own.seen_from(*self.poses(curve.times[which]))

    def acceleration(self) -> Array:
        """Return bounds on |y_tt| over intervals and arcs (P - 1, N - 1), m per motion squared.

        From ``y = R^T (r - c)``: the acceleration in a frame that turns with ``omega`` about a moving c.
        """
        curve = self.curve
        step = np.diff(curve.times)[:, None]
        rates = self.rates(curve.times[:-1], curve.times[1:])
        way = lengths(curve.position[:-1] - rates.centre[:, None])
        way = np.maximum(way[:, 1:], way[:, :-1]) + np.diff(curve.s) + curve.speed
        way = way + 0.5 * step * rates.speed[:, None]
        turning = rates.turning[:, None]
        return (
            curve.acceleration / step**2
            + rates.acceleration[:, None]
            + 2 * turning * (curve.speed / step + rates.speed[:, None])
            + (turning**2 + rates.turning_change[:, None]) * way
        )

    def reach(self, geometry: Geometry, low: float, high: float, first: float, last: float) -> float:
        """Return a number that no distance is below, m, at arc lengths ``first`` to ``last``.

        That is from motion value ``low`` to ``high``, whatever the cable does there: a point of it is no further
        from a clamp than along the cable.
        """
        curve = self.curve
        at = np.linspace(low, high, CLAMP_SAMPLES)
        nearest = []
        for clamp in self.clamps:
            if clamp is None:
                nearest.append(-math.inf)
                continue
            points = clamp(at)
            step = BENT * lengths(np.diff(points, axis=0)).max()
            nearest.append(float(geometry.signed_distance(points)[0].min()) - 0.5 * step)
        from_start, from_end = nearest
        length = curve.s[-1]
        if min(nearest) == -math.inf:
            found: float = max(from_start - last, from_end - (length - first))
            return found
        # both fall along the cable, towards each other: lowest where they meet
        meeting = np.clip(0.5 * (from_start - from_end + length), first, last)
        value: float = max(from_start - float(meeting), from_end - (length - float(meeting)))
        return value


class PartSearch(Search):
    """The search of one cable against one part.

    Args:
        task: the cable.
        seen: its centreline over the motion, from the part's body.
        geometry: the part.
        arcs: (M,), between which the cable counts, m, as in :func:`harness_opt.clearance.to_part.places`.
        start: the smallest clearance of the frames known so far, in the part's coordinates.
        lower: bounds (P, M) below the clearances at ``arcs`` in the frames of the simulation, m.
    """

    def __init__(self, task: Task, seen: Seen, geometry: Geometry, arcs: Array, start: Certificate, lower: Array):
        super().__init__(task, (seen.curve,), start)
        self._seen, self._geometry, self._arcs, self._curve = seen, geometry, arcs, seen.curve
        self._lower = lower

    def first_cells(self) -> tuple[Cells, float]:
        """See :meth:`Search.first_cells`: between stations and frames, by balls round the four corners."""
        curve, arcs = self._curve, self._arcs
        lower = self._lower
        if curve.frames.inserted:
            given = np.isin(curve.times, curve.frames.given)
            lower = np.empty((len(given), len(arcs)))
            lower[given] = self._lower
            new = np.flatnonzero(~given)
            lower[new] = survey(self.task, self._seen.frames(new), self._geometry, arcs, -math.inf)[1]
        # whole intervals first: nothing in one is further from a place that was looked at than half the ways
        y, ways, off = self._seen.swept(arcs)
        ways = ways + 0.5 * np.diff(arcs).max()
        all_of = np.minimum(lower[1:], lower[:-1]).min(axis=1) - ways - off - curve.error - curve.deviation.max(axis=1)
        near = ~curve.broken & (all_of < self.floor)
        settled = float(all_of[~curve.broken & ~near].min(initial=math.inf))
        if not np.any(near):
            return Cells(np.zeros(0), np.zeros(0), np.zeros((0, 2))), settled
        interval, arc = np.nonzero(near[:, None] & np.ones(len(arcs) - 1, dtype=bool))
        both = np.column_stack([arcs[arc], arcs[arc + 1]])
        cells = Cells(curve.times[interval], curve.times[interval + 1], both)
        corners = [(interval + i, arc + j) for i in (0, 1) for j in (0, 1)]
        middle = np.mean([y[corner] for corner in corners], axis=0)
        to_middle = [lengths(y[corner] - middle) for corner in corners]
        at_middle = np.max([lower[corner] - way for corner, way in zip(corners, to_middle, strict=True)], axis=0)
        off = self._strays(cells) + curve.error + self._doubt(cells)
        bound = at_middle - np.max(to_middle, axis=0) - off
        loose = bound < self.floor
        return cells.take(loose), min(settled, float(bound[~loose].min(initial=math.inf)))

    def bounds(self, cells: Cells) -> Bounds:
        """See :meth:`Search.bounds`."""
        corners = self._corners(cells)
        centre = corners.mean(axis=1)
        distance = self._geometry.signed_distance(centre)[0]
        doubt = self._doubt(cells)
        off = self._strays(cells) + self.task.radius + self._curve.error
        low = distance - lengths(corners - centre[:, None]).max(axis=1) - off
        near = np.flatnonzero(low - doubt < self.floor)
        hull = self._geometry.hull_bound(corners[near], centre[near], distance[near])
        low[near] = np.maximum(low[near], hull - off[near])
        return Bounds(low, doubt, distance - self.task.radius)

    def longest(self, cells: Cells) -> Indices:
        """See :meth:`Search.longest`."""
        corners = self._corners(cells)
        along = lengths(corners[:, 1::2] - corners[:, ::2]).max(axis=1)
        over = lengths(corners[:, 2:] - corners[:, :2]).max(axis=1)
        return np.where(over > along, 0, 1)

    def survey(self, values: Array) -> tuple[Witnesses, float]:
        """See :meth:`Search.survey`."""
        frames = np.flatnonzero(np.isin(self._curve.times, values))
        seen = self._seen.frames(frames)
        found = survey(self.task, seen, self._geometry, self._arcs, -math.inf)[0].all()
        i = int(np.argmin(found.clearance))
        return found.take(np.array([i])), float(self._curve.times[frames[found.frame[i]]])

    def witness(self, at: float, arcs: Array) -> Witnesses:
        """See :meth:`Search.witness`."""
        none, s = np.zeros(1, dtype=np.int64), np.array([arcs.mean()])
        curve = self._seen.frames(np.searchsorted(self._curve.times, [at]))
        distance, normal, point = self._geometry.signed_distance(curve.at(none, s))
        return Witnesses(none, s, distance - self.task.radius, normal, point, np.full(1, np.nan))

    def reach(self, low: float, high: float) -> float:
        """See :meth:`Search.reach`."""
        return self._seen.reach(self._geometry, low, high, self._arcs[0], self._arcs[-1]) - self.task.radius

    def _doubt(self, cells: Cells) -> Array:
        """Return how far the shapes may be from the surface on cells (k,), m."""
        found: Array = self._curve.deviation[
            self._curve.interval(cells.middle), self._curve.arc(cells.arcs.mean(axis=1))
        ]
        return found

    def _strays(self, cells: Cells) -> Array:
        """Return how far the surface strays from the patches of cells (k,), m."""
        a, b = cells.arcs.T
        k, j = self._curve.interval(cells.middle), self._curve.arc(0.5 * (a + b))
        along = 0.125 * (b - a) ** 2 * self._curve.bend[k, j]
        found: Array = along + 0.125 * (cells.last - cells.first) ** 2 * self._seen.acceleration()[k, j]
        return found

    def _corners(self, cells: Cells) -> Array:
        """Return the corners (k, 4, 3) of cells, m: start and end of the arc, first at the start of the stretch."""
        k = self._curve.interval(cells.middle)
        corners = [
            self._seen.points(at, self._curve.at(k, at, s)) for at in (cells.first, cells.last) for s in cells.arcs.T
        ]
        return np.stack(corners, axis=1)


class HolderSearch(PartSearch):
    """The search of a cable against what holds its clamp, where the limit to it does not count: is it entered again?

    Between two frames the cable is looked at from where it has left the part in both.

    Args:
        task: the cable; its limit is the depth that passes for touching.
        seen: its centreline over the motion, from the part's body.
        geometry: the part.
        length: over which the limit to it does not count, m.
        from_end: whether from the cable's end.
        start: the smallest clearance, once left, of the frames known so far.
    """

    def __init__(
        self, task: Task, seen: Seen, geometry: Geometry, length: float, start: Certificate, *, from_end: bool
    ):
        whole = float(seen.curve.s[-1])
        arcs = places(seen.curve.s, (whole - length, 0.0) if from_end else (0.0, whole - length))
        super().__init__(task, seen, geometry, arcs, start, np.zeros(0))
        self._length, self._from_end = length, from_end

    def first_cells(self) -> tuple[Cells, float]:
        """See :meth:`Search.first_cells`: all arcs between stations, from where the cable has left the part."""
        curve, arcs = self._curve, self._arcs
        left = np.concatenate([self._after(some)[1] for some in in_blocks(np.arange(len(curve.times)))])
        later = np.maximum(left[1:], left[:-1])
        count = len(arcs) - 1
        interval = np.repeat(np.flatnonzero(~curve.broken & np.isfinite(later)), count)
        a, b = (np.tile(ends, len(interval) // count) for ends in (arcs[:-1], arcs[1:]))
        if self._from_end:
            b = np.minimum(b, curve.s[-1] - later[interval])
        else:
            a = np.maximum(a, later[interval])
        cells = Cells(curve.times[interval], curve.times[interval + 1], np.column_stack([a, b]))
        return cells.take(b > a), math.inf

    def survey(self, values: Array) -> tuple[Witnesses, float]:
        """See :meth:`Search.survey`."""
        frames = np.flatnonzero(np.isin(self._curve.times, values))
        found = self._after(frames)[0]
        if not len(found.frame):
            return self._best, self._at
        i = int(np.argmin(found.clearance))
        return found.take(np.array([i])), float(self._curve.times[frames[found.frame[i]]])

    def _after(self, frames: Indices) -> tuple[Witnesses, Array]:
        curve = self._seen.frames(frames)
        return after_leaving(self.task, curve, self._geometry, self._length, from_end=self._from_end)


def entered_between(task: Task, seen: Seen, geometry: Geometry, lengths_off: tuple[float, float]) -> list[Certificate]:
    """Return how near a cable comes to what holds its clamps once it has left it, one for each end that it holds.

    Through the whole motion, over the lengths (m) from start and end where the limit does not count; certain where it
    is no deeper than the tolerance.
    """
    found = []
    touching = replace(task, limit=-task.tolerance)
    for length, from_end in zip(lengths_off, (False, True), strict=True):
        if length <= 0:
            continue
        nearest = after_leaving(touching, task.curve, geometry, length, from_end=from_end)[0]
        if len(nearest.frame):
            least = nearest.take(np.array([int(np.argmin(nearest.clearance))]))
            at = float(seen.curve.frames.given[least.frame[0]])
            start = Certificate(least, at, float(least.clearance[0]), "")
            found.append(HolderSearch(touching, seen, geometry, length, start, from_end=from_end).certificate())
    return found
