"""The smallest clearance of a cable to another one, or to itself, through the whole motion.

On a cell, an arc of each cable and a stretch of the motion, the way from the one to the other is linear in both arc
lengths and in the motion, but for the errors of linear interpolation (as in :mod:`harness_opt.clearance.certify_part`).
So it lies in the convex hull of its values at the corners, and for any unit vector n

    clearance >= min over corners of n . way - errors - how far the centrelines may be off - radii.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from harness_opt.clearance.centreline import Curve
from harness_opt.clearance.certify import Bounds, Cells, Search
from harness_opt.clearance.moving_centreline import MovingCurve
from harness_opt.clearance.to_cable import CurvePair, against_cable, all_found
from harness_opt.clearance.what_counts import Domain
from harness_opt.clearance.witnesses import Certificate, Task, Witnesses
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices, dots, lengths

STRAIGHT = 1e-9  # over the cable's length: the least curvature that chords are compared with
MANY = 30  # cells of one stretch of the motion, above which it is halved
DEEPEST = 6  # times that it is halved
CELLS_PER_QUERY = 5  # cells of two curves are cheaper than queries to coal


class CableSearch(Search):
    """The search of one cable against another, or against itself.

    Args:
        task, other: the two cables; the same twice for one against itself.
        curves: their centrelines over the motion.
        start: the smallest clearance of the frames known so far.
        domains: of arcs that count.
    """

    def __init__(
        self,
        task: Task,
        other: Task,
        curves: tuple[MovingCurve, MovingCurve],
        start: Certificate,
        domains: Sequence[Domain],
    ):
        super().__init__(replace(task, most_queries=CELLS_PER_QUERY * task.most_queries), curves, start)
        self._other, self._domains = other, domains
        pair = CurvePair.of(task, other)
        self._gap, self._radii = pair.gap, pair.radii
        self._error = sum(curve.error for curve in curves)

    def certificate(self) -> Certificate:
        """See :meth:`Search.certificate`; boxes tell of cables that stay far apart, and of most pairs of many."""
        for curve in self.curves:
            curve.complete()
        best = float(self._best.clearance[0])
        if self._gap <= 0 and best > self.task.far and (bound := self._apart_in_boxes()) >= self.task.horizon:
            return Certificate(self._best, self._at, min(bound, best), "")
        return super().certificate()

    def _apart_in_boxes(self) -> float:
        """Return a bound below all clearances, by the boxes that the cables sweep between two frames, m."""
        times = self.times
        middle = 0.5 * (times[1:] + times[:-1])
        (low, high), (other_low, other_high) = (
            tuple(corner[curve.interval(middle)] for corner in curve.boxes) for curve in self.curves
        )
        between = np.maximum(np.maximum(low - other_high, other_low - high), 0.0)
        return float(lengths(between).min()) - self._radii

    def first_cells(self) -> tuple[Cells, float]:
        """See :meth:`Search.first_cells`: between stations and frames, by balls round the corners of each arc.

        A cable is nearly as close to itself everywhere along it as where it bends most: there the stretch of the
        motion is halved before it comes to cells.
        """
        settled, found = math.inf, []
        s, t = (curve.s for curve in self.curves)
        allowed = t[None, 1:] - s[:-1, None] >= self._gap
        allowed &= np.any([_touched(s, a, b)[:, None] & _touched(t, c, d) for a, b, c, d in self._domains], axis=0)
        stretches = [(low, high, 0) for low, high in itertools.pairwise(self.times)]
        count = 0
        while stretches:
            self.afford(count)
            low, high, depth = stretches.pop()
            if not self.known(np.array([0.5 * (low + high)]))[0]:
                continue
            distance = self._distances(low, high) - self._radii - self._error
            doubt = self._most_doubt(low, high)
            i, j = np.nonzero(allowed & (distance < self.floor + doubt))
            arcs = np.column_stack([s[i], s[i + 1], t[j], t[j + 1]])
            cells = Cells(np.full(len(i), low), np.full(len(i), high), arcs)
            bound = distance[i, j] - self._doubt(cells)
            loose = bound < self.floor
            if self._gap > 0 and depth < DEEPEST and np.sum(loose) > MANY:
                middle = 0.5 * (low + high)
                stretches += [(low, middle, depth + 1), (middle, high, depth + 1)]
                continue
            distance[i, j] = math.inf
            settled = min(settled, float((distance - doubt)[allowed].min()), float(bound[~loose].min(initial=math.inf)))
            found.append(cells.take(loose))
            count += int(np.sum(loose))
        empty = Cells(np.zeros(0), np.zeros(0), np.zeros((0, 4)))
        cells = Cells.joined([empty, *found])
        return Cells.joined([_cut(cells, domain) for domain in self._domains]), settled

    def _distances(self, low: float, high: float) -> Array:
        """Return bounds below the distances of arcs (N - 1, N - 1) over a stretch between frames, m."""
        (m, m_radius), (n, n_radius) = (self._balls(curve, low, high) for curve in self.curves)
        distance = lengths(m[:, None] - n) - m_radius[:, None] - n_radius
        return np.maximum(distance, self._chords(low, high)) if self._gap > 0 else distance

    def _chords(self, low: float, high: float) -> Array:
        """Return bounds (N - 1, N - 1) below the chords between arcs of one cable that lie near along it, m.

        Where the curvature is at most k, an arc of length x has a chord of at least ``2 / k sin(k x / 2)``, up to
        ``k x = pi``: Schur's comparison theorem (Chern, Curves and Surfaces in Euclidean Space, section 5). The
        interpolated centreline is not quite as long as the cable, which makes the arc shorter, and k larger.
        """
        curve = self.curves[0]
        k = int(curve.interval(np.array([0.5 * (low + high)]))[0])
        first, last = (np.array([low, high]) - curve.times[k]) / (curve.times[k + 1] - curve.times[k])
        s, shrunk = curve.s, 1.0 - float(curve.stretch[k])
        if shrunk <= 0:
            return np.full((len(s) - 1, len(s) - 1), -np.inf)
        bend = curve.bent(k, first, last) / shrunk**2 + STRAIGHT / s[-1]
        onward = np.triu(np.tile(bend, (len(bend), 1)))
        bend = np.maximum(np.maximum.accumulate(onward, axis=1), bend.min())
        least = shrunk * np.maximum(s[None, :-1] - s[1:, None], self._gap)
        most = s[None, 1:] - s[:-1, None]
        return np.where(bend * most < np.pi, 2.0 / bend * np.sin(0.5 * bend * least), -np.inf)

    def _balls(self, curve: MovingCurve, low: float, high: float) -> tuple[Array, Array]:
        """Return centres (N - 1, 3) and radii (N - 1,) of balls that hold what the arcs sweep between two frames."""
        count = len(curve.s)
        k = np.full(count, curve.interval(np.array([0.5 * (low + high)]))[0])
        ends = [curve.at(k, np.full(count, at), curve.s) for at in (low, high)]
        corners = np.stack([end[side] for end in ends for side in (slice(None, -1), slice(1, None))])
        centre = corners.mean(axis=0)
        arcs = np.column_stack([curve.s[:-1], curve.s[1:]])
        cells = Cells(np.full(count - 1, low), np.full(count - 1, high), arcs)
        return centre, lengths(corners - centre).max(axis=0) + sum(_strays(curve, cells, arcs))

    def bounds(self, cells: Cells) -> Bounds:
        """See :meth:`Search.bounds`."""
        s, t = self._corner_arcs(cells)
        ways = np.concatenate([self._ways(cells, at, s, t) for at in (cells.first, cells.last)], axis=1)
        off = self._radii + self._error
        off = off + self._strays_of_ways(cells)
        # the shortest corner, their mean, and the shortest of the mean ways, point nearly across
        mean = ways.mean(axis=1)
        over = 0.5 * (ways[:, :5] + ways[:, 5:])
        rows = np.arange(len(ways))
        shortest = ways[rows, np.argmin(lengths(ways), axis=1)]
        nearest = self._nearest(over)
        low = np.full(len(ways), -np.inf)
        for across in (mean, shortest, nearest):
            length = lengths(across)
            unit = across / np.where(length > 0, length, 1.0)[:, None]
            low = np.maximum(low, np.einsum("kci,ki->kc", ways, unit).min(axis=1))
        inside = self._ways(cells, cells.middle, s.mean(axis=1)[:, None], t.mean(axis=1)[:, None])[:, 0]
        return Bounds(low - off, self._doubt(cells), lengths(inside) - self._radii)

    def longest(self, cells: Cells) -> Indices:
        """See :meth:`Search.longest`."""
        s, t = self._corner_arcs(cells)
        over = lengths(self._ways(cells, cells.last, s, t) - self._ways(cells, cells.first, s, t)).max(axis=1)
        a, b, c, d = cells.arcs.T
        found: Indices = np.argmax([over, b - a, d - c], axis=0)
        return found

    def survey(self, values: Array) -> tuple[Witnesses, float]:
        """See :meth:`Search.survey`."""
        pair = self._frames(values)
        task = replace(self.task, curve=pair.one, reach=-math.inf)
        found = all_found([against_cable(task, replace(pair, domain=domain)) for domain in self._domains]).samples
        i = int(np.argmin(found.clearance))
        return found.take(np.array([i])), float(values[found.frame[i]])

    def witness(self, at: float, arcs: Array) -> Witnesses:
        """See :meth:`Search.witness`."""
        now = np.array([at])
        s, t = self._corner_arcs(Cells(now, now, arcs[None]))
        return self._frames(now).witnesses(np.zeros(1, dtype=np.int64), s.mean(axis=1), t.mean(axis=1))

    def _frames(self, values: Array) -> CurvePair:
        """Return solved frames of both cables at motion values (k,)."""

        def solved(curve: MovingCurve) -> Curve:
            which = np.searchsorted(curve.times, values)
            return Curve(curve.s, curve.position[which], curve.tangent[which])

        one, other = (solved(curve) for curve in self.curves)
        return CurvePair(one, other, self.task.radius, self._other.radius, self._gap, self._domains[0])

    def reach(self, low: float, high: float) -> float:
        """See :meth:`Search.reach`: nothing is known of two cables of which one jumps."""
        return -math.inf

    def _ways(self, cells: Cells, at: Array, s: Array, t: Array) -> Array:
        """Return the ways (k, c, 3) from points of the other to points of the one, at arc lengths (k, c), m."""
        points = []
        for curve, arc in zip(self.curves, (s, t), strict=True):
            k, width = curve.interval(cells.middle), arc.shape[1]
            points.append(curve.at(np.repeat(k, width), np.repeat(at, width), arc.ravel()))
        return (points[0] - points[1]).reshape(*s.shape, 3)

    def _corner_arcs(self, cells: Cells) -> tuple[Array, Array]:
        """Return the corners (k, 5), (k, 5), m, of the part of each cell in which ``t - s >= gap``."""
        a, b, c, d = cells.arcs.T
        gap = self._gap
        s = [a, a, np.minimum(b, d - gap), np.clip(c - gap, a, b), np.minimum(b, d - gap)]
        t = [d, np.maximum(c, a + gap), d, np.maximum(c, a + gap), np.clip(b + gap, c, d)]
        return np.column_stack(s), np.column_stack(t)

    def _apart(self, cells: Cells) -> Array:
        """Return how much arc of the one cable, at most, lies between points of cells (k,), m."""
        return cells.arcs[:, 3] - cells.arcs[:, 0]

    def _most_doubt(self, low: float, high: float) -> float:
        """Return how far the two centrelines may be off over a stretch between frames, together, m."""
        at = np.array([0.5 * (low + high)])
        return float(sum(curve.deviation[curve.interval(at)[0]].max() for curve in self.curves))

    def _doubt(self, cells: Cells) -> Array:
        """Return how far the ways in cells may be off (k,), m: neighbours on one cable are off alike."""
        off = np.zeros(len(cells.first))
        for side, curve in enumerate(self.curves):
            middle = cells.arcs[:, 2 * side : 2 * side + 2].mean(axis=1)
            off = off + curve.deviation[curve.interval(cells.middle), curve.arc(middle)]
        if self._gap <= 0:
            return off
        turn = self.curves[0].turn_deviation.max(axis=1)
        found: Array = np.minimum(off, self._apart(cells) * turn[self.curves[0].interval(cells.middle)])
        return found

    def _strays_of_ways(self, cells: Cells) -> Array:
        """Return how far the ways in cells stray from linear ones (k,), m: neighbours on one cable move alike."""
        along, over = (
            np.sum(parts, axis=0)
            for parts in zip(
                *(_strays(curve, cells, cells.arcs[:, 2 * i : 2 * i + 2]) for i, curve in enumerate(self.curves)),
                strict=True,
            )
        )
        if self._gap > 0:
            curve = self.curves[0]
            k, share = _stretch(curve, cells)
            turn = curve.turn_acceleration[k].max(axis=1)
            over = np.minimum(over, 0.125 * share**2 * self._apart(cells) * turn)
        found: Array = along + over
        return found

    @staticmethod
    def _nearest(corners: Array) -> Array:
        """Return short vectors (k, 3) of the hulls of ``corners`` (k, c, 3): a few steps of Frank and Wolfe."""
        at = corners.mean(axis=1)
        rows = np.arange(len(corners))
        for _ in range(6):
            toward = corners[rows, np.argmin(np.einsum("kci,ki->kc", corners, at), axis=1)] - at
            square = dots(toward, toward)
            share = np.clip(-dots(at, toward) / np.where(square > 0, square, 1.0), 0.0, 1.0)
            at = at + share[:, None] * toward
        found: Array = at
        return found


def _touched(s: Array, first: float, last: float) -> NDArray[np.bool_]:
    """Return which intervals between stations ``s`` (N,) share an arc with [first, last]."""
    return (s[1:] > first) & (s[:-1] < last)


def _cut(cells: Cells, domain: Domain) -> Cells:
    """Return the parts of cells that lie in ``domain``."""
    low, high = np.array(domain)[[0, 2]], np.array(domain)[[1, 3]]
    arcs = cells.arcs.reshape(-1, 2, 2)
    arcs = np.stack([np.maximum(arcs[..., 0], low), np.minimum(arcs[..., 1], high)], axis=-1)
    inside = np.all(arcs[..., 1] > arcs[..., 0], axis=1)
    return replace(cells, arcs=arcs.reshape(-1, 4)).take(inside)


def _stretch(curve: MovingCurve, cells: Cells) -> tuple[Indices, Array]:
    """Return the intervals (k,) of a centreline that hold cells, and which shares of these the cells take (k,)."""
    k = curve.interval(cells.middle)
    return k, (cells.last - cells.first) / (curve.times[k + 1] - curve.times[k])


def _strays(curve: MovingCurve, cells: Cells, arcs: Array) -> tuple[Array, Array]:
    """Return how far a centreline strays from the bilinear patches over stretches and ``arcs`` (k, 2), m.

    Along the cable (k,), and over the motion (k,).
    """
    a, b = arcs.T
    k, share = _stretch(curve, cells)
    j = curve.arc(0.5 * (a + b))
    return 0.125 * (b - a) ** 2 * curve.bend[k, j], 0.125 * share**2 * curve.acceleration[k, j]
