"""The search that makes a smallest clearance certain through a whole motion: conservative advancement over cells.

A cell is a stretch of the motion by an arc of the cable, or by an arc of each of two. Cells are split until a bound
below their clearances lies less than the tolerance below the smallest clearance of a solved frame. Where the
centreline between the frames is not known well enough for that, or comes nearer than in any solved frame, a frame
is solved there. How cells are bounded is up to :mod:`harness_opt.clearance.certify_part` and
:mod:`harness_opt.clearance.certify_cable`.
"""

from __future__ import annotations

import abc
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness_opt.clearance.moving_centreline import MovingCurve
from harness_opt.clearance.witnesses import CROWDED, LONG, ROUGH, STOPPED, Certificate, Task, Witnesses
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices

FINE = 0.125  # of the tolerance: a centreline known this well needs no frame to be known better
LOW = 0.25  # of the tolerance: what lies this much below the smallest clearance is looked at in a solved frame
CHECKS = 3  # intervals with the lowest bounds in which a frame is solved in any case, to check the estimate
ATTEMPTS = 4  # at a search, each after the estimate was found too small
MOST_INSERTED = 400  # frames for one pair
CELLS_PER_QUERY = 2  # that may wait at the same time
BLOCK = 20_000  # cells that are bounded at a time: each takes a few kilobytes meanwhile


class GaveUp(Exception):
    """A search that would take more memory or time than it may; the message is the reason."""


@dataclass(frozen=True, eq=False)
class Cells:
    """Stretches of the motion by arcs of one or two cables, k of them.

    Args:
        first, last: motion values (k,).
        arcs: (k, 2) from a to b, or (k, 4) from a to b and from c to d, m.
    """

    first: Array
    last: Array
    arcs: Array

    @property
    def middle(self) -> Array:
        """The motion values (k,) half-way."""
        return 0.5 * (self.first + self.last)

    def take(self, which: Indices | NDArray[np.bool_]) -> Cells:
        """Return those at ``which``, numbers (k,) or a mask."""
        return Cells(self.first[which], self.last[which], self.arcs[which])

    @staticmethod
    def joined(several: Sequence[Cells]) -> Cells:
        """Return the cells of all ``several`` in one."""
        columns = zip(*(vars(cells).values() for cells in several), strict=True)
        return Cells(*(np.concatenate(column) for column in columns))

    def halved(self, side: Indices) -> Cells:
        """Return both halves of each cell: parted in the motion where ``side`` (k,) is 0, else along arc 1 or 2."""
        one, other = (Cells(self.first.copy(), self.last.copy(), self.arcs.copy()) for _ in range(2))
        over = side == 0
        one.last[over] = other.first[over] = self.middle[over]
        for arc in range(self.arcs.shape[1] // 2):
            along = side == arc + 1
            a, b = self.arcs[along, 2 * arc], self.arcs[along, 2 * arc + 1]
            one.arcs[along, 2 * arc + 1] = other.arcs[along, 2 * arc] = 0.5 * (a + b)
        return Cells.joined([one, other])

    def cut(self, times: Array) -> Cells:
        """Return the cells parted at motion values ``times`` (n,), increasing, so that none holds one within."""
        cells = self
        while True:
            inside = times[np.minimum(np.searchsorted(times, cells.first, side="right"), len(times) - 1)]
            parted = (inside > cells.first) & (inside < cells.last)
            if not np.any(parted):
                return cells
            some, at = cells.take(parted), inside[parted]
            halves = [Cells(some.first, at, some.arcs), Cells(at, some.last, some.arcs)]
            cells = Cells.joined([cells.take(~parted), *halves])


class Bounds(NamedTuple):
    """What is known of k cells, m.

    Args:
        low: below their clearances, were the centrelines between the frames exact.
        doubt: how far these may be off.
        middle: clearances somewhere inside the cells, were they exact.
    """

    low: Array
    doubt: Array
    middle: Array


class Search(abc.ABC):
    """The search through the motion for one pair.

    Args:
        task: the cable.
        curves: the centrelines that count, one or two; frames may be added to them.
        start: the smallest clearance of the frames known so far.
    """

    def __init__(self, task: Task, curves: Sequence[MovingCurve], start: Certificate):
        self.task, self.curves = task, curves
        self._best, self._at = start.place, start.motion
        self._reason = LONG

    @abc.abstractmethod
    def first_cells(self) -> tuple[Cells, float]:
        """Return the cells that need a look, and a bound below the clearances in all others, m."""

    @abc.abstractmethod
    def bounds(self, cells: Cells) -> Bounds:
        """Return what is known of cells, none of which holds a frame within."""

    @abc.abstractmethod
    def longest(self, cells: Cells) -> Indices:
        """Return the side (k,) by which to halve each cell, as :meth:`Cells.halved` takes it."""

    @abc.abstractmethod
    def survey(self, values: Array) -> tuple[Witnesses, float]:
        """Return the smallest clearance found in solved frames at motion values (k,), and when it is."""

    @abc.abstractmethod
    def witness(self, at: float, arcs: Array) -> Witnesses:
        """Return the clearance in the middle of ``arcs`` (2,) or (4,), in the solved frame at motion value ``at``."""

    @abc.abstractmethod
    def reach(self, low: float, high: float) -> float:
        """Return a number below the clearances from motion value ``low`` to ``high``, whatever the shapes are, m."""

    @property
    def times(self) -> Array:
        """The motion values of all frames, of one cable or of two."""
        return np.unique(np.concatenate([curve.times for curve in self.curves]))

    @property
    def tolerance(self) -> float:
        """To which the smallest clearance is wanted, m."""
        return self.task.tolerance_at(float(self._best.clearance[0]))

    @property
    def floor(self) -> float:
        """What a bound has to reach, m."""
        return float(self._best.clearance[0]) - self.tolerance

    def known(self, at: Array) -> NDArray[np.bool_]:
        """Return whether the shapes are known around motion values (k,)."""
        found: NDArray[np.bool_] = ~np.any([curve.broken[curve.interval(at)] for curve in self.curves], axis=0)
        return found

    def certificate(self) -> Certificate:
        """Search, and return what was found."""
        for curve in self.curves:
            curve.complete()
        self._given = len(self.times)
        try:
            for _ in range(ATTEMPTS):
                bound = self._run()
                if bound is not None:
                    return self._finished(bound)
        except GaveUp as why:
            return self._finished(-math.inf, str(why))
        return self._finished(-math.inf, ROUGH)

    def afford(self, cells: int) -> None:
        """Raise GaveUp where the search is to stop, or so many ``cells`` are more than it may hold."""
        if self.task.stop():
            raise GaveUp(STOPPED)
        if cells > CELLS_PER_QUERY * self.task.most_queries:
            raise GaveUp(self._reason)

    def _all_bounds(self, cells: Cells) -> Bounds:
        """Return what is known of cells, asked for a block at a time: each takes memory while it is bounded."""
        if len(cells.first) <= BLOCK:
            return self.bounds(cells)
        blocks = np.array_split(np.arange(len(cells.first)), len(cells.first) // BLOCK + 1)
        return Bounds(*map(np.concatenate, zip(*(self.bounds(cells.take(block)) for block in blocks), strict=True)))

    def _finished(self, bound: float, why: str = "") -> Certificate:
        """Return what was found, with the reason why it is no certificate, if it is none."""
        reasons, reach = self._unknown()
        if why:
            reasons = [why]
        if not reasons:
            bound = min(bound, reach)
        best = float(self._best.clearance[0])
        if not reasons and bound < best - self.tolerance * (1 + 1e-9):
            reasons = [self._reason]
        return Certificate(self._best, self._at, min(bound, best), "; ".join(reasons))

    def _run(self) -> float | None:
        """Return a bound below all clearances where the shape is known; None where the estimate was too small."""
        cells, settled = self.first_cells()
        budget, raised = self.task.most_queries, False
        lowest: list[tuple[float, float, Array]] = []
        while len(cells.first) and budget > 0 and self._reason == LONG:
            self.afford(len(cells.first))
            budget -= len(cells.first)
            found = self._all_bounds(cells)
            sure = found.low - found.doubt
            done = sure >= self.floor
            settled = min(settled, float(sure[done].min(initial=math.inf)))
            low = np.argsort(np.where(done, sure, math.inf))[: min(CHECKS, int(done.sum()))]
            lowest += [(float(sure[i]), float(cells.middle[i]), cells.arcs[i]) for i in low]
            waiting = ~done & (found.low >= self.floor) & (found.doubt > FINE * self.tolerance)
            wanted = self._wanted(cells, found, ~done, waiting)
            split = cells.take(~done & ~waiting)
            cells = Cells.joined([cells.take(waiting), split.halved(self.longest(split))])
            if len(wanted.first):
                raised |= self._insert(wanted)
                cells = cells.cut(self.times)
                cells = cells.take(self.known(cells.middle))
        if raised:
            return None
        if len(cells.first):
            found = self._all_bounds(cells)
            return min(settled, float((found.low - found.doubt).min()))
        if self._best.clearance[0] > self.task.far:  # frames solved for what is near check the estimate
            return settled
        checks = self._unchecked(lowest)
        return None if len(checks.first) and self._insert(checks) else settled

    def _wanted(self, cells: Cells, found: Bounds, undone: NDArray[np.bool_], waiting: NDArray[np.bool_]) -> Cells:
        """Return cells in whose middles to solve frames: where cells wait for it, and where a clearance is lowest."""
        times = self.times
        k, first = np.unique(np.searchsorted(times, cells.middle[waiting]) - 1, return_index=True)
        wanted = Cells(times[k], times[k + 1], cells.arcs[waiting][first])
        best = float(self._best.clearance[0])
        low = np.where(undone & (found.middle < best - LOW * self.tolerance), found.middle, np.inf)
        if np.isfinite(low.min(initial=math.inf)):
            lowest = cells.take(np.array([np.argmin(low)]))
            other = k != np.searchsorted(times, lowest.middle) - 1
            wanted = Cells.joined([lowest, wanted.take(other)])
        room = MOST_INSERTED - (len(times) - self._given)
        if len(wanted.first) > room:
            self._reason = CROWDED
        return wanted.take(np.arange(len(wanted.first)) < room)

    def _insert(self, cells: Cells) -> bool:
        """Solve frames in the middles of ``cells``, and look for smaller clearances; return whether trust fell."""
        before = self.times
        raised = [curve.insert(cells.middle) for curve in dict.fromkeys(self.curves)]
        solved = ~np.isin(cells.middle, before) & self.solved(cells.middle)
        if np.any(solved):
            low, at = self.survey(cells.middle[solved])
            found = [(low, at)]
            found += [
                (self.witness(value, arcs), value)
                for value, arcs in zip(cells.middle[solved], cells.arcs[solved], strict=True)
            ]
            lowest, at = min(found, key=lambda pair: float(pair[0].clearance[0]))
            if lowest.clearance[0] < self._best.clearance[0]:
                self._best, self._at = lowest, float(at)
        return any(raised)

    def solved(self, values: Array) -> NDArray[np.bool_]:
        """Return at which motion values (k,) there is a frame of every cable."""
        found: NDArray[np.bool_] = np.all([np.isin(values, curve.times) for curve in self.curves], axis=0)
        return found

    def _unchecked(self, lowest: list[tuple[float, float, Array]]) -> Cells:
        """Return the intervals with the worst and with the lowest bounds, none of whose ends was solved in between."""
        times = self.times
        given = np.isin(times, self.curves[0].frames.given)
        place = self._best
        here = np.repeat([place.arc_length[0], place.other_arc_length[0]][: len(self.curves)], 2)
        chosen = {max(int(np.searchsorted(times, self._at)) - 1, 0): here}
        for _, at, arcs in sorted(lowest, key=lambda found: found[0]):
            chosen.setdefault(int(np.searchsorted(times, at)) - 1, arcs)
        k = np.array(list(chosen)[:CHECKS], dtype=np.int64)
        arcs = np.array([chosen[i] for i in k])
        cells = Cells(times[k], times[k + 1], arcs)
        return cells.take(given[k] & given[k + 1] & self.known(cells.middle))

    def _unknown(self) -> tuple[list[str], float]:
        """Return where shapes are not known and could come nearer than anything found, a sentence each.

        And the bound, m, that holds wherever they are not known.
        """
        reasons, lowest = [], math.inf
        for curve in self.curves:
            for k in np.flatnonzero(curve.broken):
                reach = self.reach(float(curve.times[k]), float(curve.times[k + 1]))
                lowest = min(lowest, reach)
                if reach < self.floor:
                    reasons.append(curve.frames.why_broken(int(k)))
        return list(dict.fromkeys(reasons)), lowest
