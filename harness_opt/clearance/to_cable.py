"""The smallest clearances of a cable to another one, or to itself, and the points where they stand.

Arcs between stations are first compared by the balls that hold them; the pairs of arcs that remain, called
cells, by their chords and sags, and quartered until nothing smaller can hide in them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness_opt.clearance.centreline import Curve, balls, closest_on_segments, sag
from harness_opt.clearance.what_counts import Domain, least_gap
from harness_opt.clearance.witnesses import FAR_SHARE, Found, Task, Witnesses, local_minima
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices, lengths

PAIRS = 500_000  # pairs of stations looked at together, so that temporaries stay below 100 MB
FRAMES = 200  # that are looked at together, for the same reason
CELLS_PER_QUERY = 5  # cells of two curves are cheaper than queries to coal
TOUCHING = 1e-12  # of the cable's length: centrelines nearer to each other count as crossing


def against_cable(task: Task, curves: CurvePair) -> Found:
    """Return what is nearest between a cable and another one, or itself.

    Args:
        task: the cable.
        curves: its centreline and the other's, in the same coordinates.
    """
    far = curves.far_apart(task)
    if far is not None:
        return far
    places: list[tuple[Indices, Array, Array]] = []  # of the local minima
    left: list[tuple[Indices, Array, Array]] = []  # cells that may yet hold something smaller
    best = settled = math.inf
    for first in range(0, len(task.curve.position), FRAMES):
        some = curves.of_frames(slice(first, first + FRAMES))
        (frame, s, t, value), cells, rest = _minima(task, some)
        places.append((frame + first, s, t))
        best, settled = min(best, float(value.min())), min(settled, rest)
        hopeless = cells[2] >= best - task.tolerance
        settled = min(settled, float(cells[2][hopeless].min(initial=math.inf)))
        left.append((cells[0][~hopeless] + first, cells[1][~hopeless], cells[2][~hopeless]))
    found = _joined(places)
    worst, reached = _certify_cells(task, curves, _joined(left), best)
    # the cell search may have met something still closer
    samples = curves.witnesses(*_joined([found, worst]))
    return Found(samples, np.arange(len(found[0])), min(settled, reached))


def all_found(several: Sequence[Found]) -> Found:
    """Return what was found in several domains of one pair in one."""
    before = np.cumsum([0, *(len(found.samples.frame) for found in several[:-1])])
    minima = np.concatenate([found.minima + offset for found, offset in zip(several, before, strict=True)])
    return Found(Witnesses.joined([found.samples for found in several]), minima, min(found.bound for found in several))


def _every(stride: int, count: int) -> Indices:
    """Return every so many of ``count`` stations, the last one too."""
    return np.unique(np.append(np.arange(0, count, stride), count - 1))


def _joined(several: Sequence[tuple[Indices, Array, Array]]) -> tuple[Indices, Array, Array]:
    first, second, third = (np.concatenate(column) for column in zip(*several, strict=True))
    return first, second, third


def _minima(
    task: Task, curves: CurvePair
) -> tuple[tuple[Indices, Array, Array, Array], tuple[Indices, Array, Array], float]:
    """Return the local minima of some frames: frames, s, t and clearances (m,).

    And the cells that were looked at, with the bounds below their clearances, as :func:`_certify_cells` takes them, and
    a bound below all others, m.
    """
    frame, row, cell, settled = curves.candidates(task.horizon)
    s, t, value, bound = curves.closest(frame, cell)
    # the smallest clearance of every interval of the cable, then the local minima along it
    order = np.lexsort((value, row, frame))
    key = frame[order] * len(curves.one.s) + row[order]
    order = order[np.unique(key, return_index=True)[1]]
    table = np.full((len(curves.one.position), len(curves.one.s) - 1), np.inf)
    number = np.zeros(table.shape, dtype=np.int64)
    table[frame[order], row[order]], number[frame[order], row[order]] = value[order], order
    low = number[local_minima(table, task.horizon)]
    return (frame[low], *_shrink(curves, frame[low], s[low], t[low])), (frame, cell, bound), settled


@dataclass(frozen=True, eq=False)
class CurvePair:
    """Two centrelines, or one twice.

    A cell (a, b, c, d) is an arc [a, b] of the one and [c, d] of the other. Their distance is at least that
    of their chords less both sags.

    Args:
        one, other: in the same coordinates.
        radius, other_radius: of the cables, m.
        gap: only pairs of arc lengths s of the one and t of the other with ``t - s >= gap`` count, m; -inf
            where the two are different cables.
        domain: the arcs of both that count, from and to, m; of one cable against itself all of it.
    """

    one: Curve
    other: Curve
    radius: float
    other_radius: float
    gap: float
    domain: Domain

    @staticmethod
    def of(task: Task, other: Task, domain: Domain | None = None) -> CurvePair:
        """Return the pair of the cables of two tasks; with the limit of ``task`` where they are the same.

        Args:
            task, other: the two.
            domain: of arcs; None takes all.
        """
        gap = least_gap(task) if task.cable == other.cable else -math.inf
        whole = (0.0, float(task.curve.s[-1]), 0.0, float(other.curve.s[-1]))
        return CurvePair(task.curve, other.curve, task.radius, other.radius, gap, domain or whole)

    def of_frames(self, some: slice) -> CurvePair:
        """Return the same in some of the frames."""
        one, other = (Curve(c.s, c.position[some], c.tangent[some]) for c in (self.one, self.other))
        return replace(self, one=one, other=other)

    @property
    def radii(self) -> float:
        """Sum of both radii, m: a clearance is this much less than the distance of the centrelines."""
        return self.radius + self.other_radius

    def closest(self, frame: Indices, cell: Array) -> tuple[Array, Array, Array, Array]:
        """Return s, t, the clearance there and a bound below all clearances, (k,) each, of cells (k, 4)."""
        a, b, c, d = cell.T
        p, q = self.one.at(frame, a), self.other.at(frame, c)
        u, v = self.one.at(frame, b) - p, self.other.at(frame, d) - q
        x, y = closest_on_segments(p, u, q, v)
        s, t = a + x * (b - a), c + y * (d - c)
        near = np.flatnonzero(t - s < self.gap)
        if len(near):
            # the squared distance of the chords is convex in s and t, so where its minimum is left out, the
            # smallest that counts stands on the line t = s + gap
            start = np.maximum(a, c - self.gap)[near]
            span = np.minimum(b, d - self.gap)[near] - start
            # vectors between the chords where that line enters and leaves the cell
            w0, w1 = (
                p[near]
                + ((at - a[near]) / (b - a)[near])[:, None] * u[near]
                - q[near]
                - ((at + self.gap - c[near]) / (d - c)[near])[:, None] * v[near]
                for at in (start, start + span)
            )
            origin = np.zeros_like(w0)
            s[near] = start + span * closest_on_segments(w0, w1 - w0, origin, origin)[0]
            t[near] = s[near] + self.gap
            x, y = (s - a) / (b - a), (t - c) / (d - c)
        chords = lengths(p + x[:, None] * u - q - y[:, None] * v)
        sags = sag(b - a, lengths(u)) + sag(d - c, lengths(v))
        value = lengths(self.one.at(frame, s) - self.other.at(frame, t))
        return s, t, value - self.radii, chords - sags - self.radii

    def far_apart(self, task: Task) -> Found | None:
        """Return the nearest stations of two cables that are far apart in every frame, by every so many; else None.

        Boxes round both say so; as many stations are left out as the tolerance for what is far away allows.
        """
        (low, high), (other_low, other_high) = (
            (curve.position.min(axis=1), curve.position.max(axis=1)) for curve in (self.one, self.other)
        )
        between = np.maximum(np.maximum(low - other_high, other_low - high), 0.0)
        step = max(float(np.diff(curve.s).max()) for curve in (self.one, self.other))
        apart = float(lengths(between).min()) - step - self.radii  # cubics leave the box of their stations by less
        stride = int(FAR_SHARE * apart / step) if math.isfinite(task.far) and apart > task.far else 0
        if self.gap > 0 or stride < 1:
            return None
        rows, columns = (_every(stride, len(curve.s)) for curve in (self.one, self.other))
        frame = np.arange(len(self.one.position))
        chunk = max(1, PAIRS // (len(rows) * len(columns)))
        nearest = [
            np.sum((self.one.position[some][:, rows, None] - self.other.position[some][:, None, columns]) ** 2, axis=-1)
            .reshape(len(some), -1)
            .argmin(axis=1)
            for some in np.split(frame, range(chunk, len(frame), chunk))
        ]
        i, j = np.divmod(np.concatenate(nearest), len(columns))
        samples = self.witnesses(frame, self.one.s[rows[i]], self.other.s[columns[j]])
        none = np.zeros(0, dtype=np.int64)
        return Found(samples, none, float(samples.clearance.min()) - stride * step)

    def candidates(self, horizon: float) -> tuple[Indices, Indices, Array, float]:
        """Return the cells between stations that can hold a clearance that matters.

        That is the smallest of their frame, or one below ``horizon``, m.

        Returns:
            Frames (k,), intervals (k,) of the one, cells (k, 4), m, and a bound below the clearances in all
            other cells, m.
        """
        frames: list[Indices] = []
        rows: list[Indices] = []
        columns: list[Indices] = []
        rest = math.inf
        s, t = self.one.s, self.other.s
        first_s, last_s, first_t, last_t = self.domain
        allowed = t[None, 1:] - s[:-1, None] >= self.gap
        allowed &= ((s[1:] > first_s) & (s[:-1] < last_s))[:, None] & (t[1:] > first_t) & (t[:-1] < last_t)
        chunk = max(1, PAIRS // allowed.size)
        for first in range(0, len(self.one.position), chunk):
            some = slice(first, first + chunk)
            m, m_radius = balls(s, self.one.position[some])
            n, n_radius = balls(t, self.other.position[some])
            square = np.sum(m * m, -1)[:, :, None] + np.sum(n * n, -1)[:, None] - 2 * m @ n.swapaxes(1, 2)
            distance = np.where(allowed, np.sqrt(np.maximum(square, 0.0)) - self.radii, np.inf)
            reach = m_radius[:, :, None] + n_radius[:, None]
            upper = np.min((distance + reach).reshape(len(m), -1), axis=1)
            wanted = distance - reach < np.maximum(upper, horizon)[:, None, None]
            rest = min(rest, float(np.min((distance - reach)[~wanted], initial=math.inf)))
            frame, i, j = np.nonzero(wanted)
            frames.append(frame + first)
            rows.append(i)
            columns.append(j)
        i, j = np.concatenate(rows), np.concatenate(columns)
        cells = np.column_stack([*self.inside(s[i], s[i + 1], t[j], t[j + 1])])
        return np.concatenate(frames), i, cells, rest

    def inside(self, a: Array, b: Array, c: Array, d: Array) -> tuple[Array, Array, Array, Array]:
        """Return arcs [a, b] and [c, d] (k,) cut to what counts."""
        first_s, last_s, first_t, last_t = self.domain
        return np.maximum(a, first_s), np.minimum(b, last_s), np.maximum(c, first_t), np.minimum(d, last_t)

    def witnesses(self, frame: Indices, s: Array, t: Array) -> Witnesses:
        """Return the pairs of points at arc lengths s and t (k,), m, of frames (k,) as witnesses."""
        at = self.other.at(frame, t)
        offset = self.one.at(frame, s) - at
        distance = lengths(offset)
        # centrelines that meet are parted at right angles to both
        across = np.cross(self.one.slope(frame, s), self.other.slope(frame, t))
        touching = distance < TOUCHING * self.one.s[-1]
        if np.any(touching):
            along = self.one.slope(frame[touching], s[touching])
            least = np.eye(3)[np.argmin(np.abs(along), axis=-1)]  # never along the centreline
            parallel = lengths(across[touching]) < TOUCHING
            offset[touching] = np.where(parallel[:, None], np.cross(along, least), across[touching])
        normal = offset / lengths(offset)[:, None]
        return Witnesses(frame, s, distance - self.radii, normal, at + self.other_radius * normal, t)


def _shrink(curves: CurvePair, frame: Indices, s: Array, t: Array) -> tuple[Array, Array, Array]:
    """Return arc lengths (k,), (k,) and clearances (k,) of the nearest points round (s, t).

    They are found again on chords so short that these serve as curves: the sag falls with the square of their
    length.
    """
    best = np.full(len(s), np.inf)
    for part in (1 / 2, 1 / 4, 1 / 8, 1 / 16, 1 / 32):
        h, g = (part * np.max(np.diff(curve.s)) for curve in (curves.one, curves.other))
        cell = np.column_stack([*curves.inside(s - h, s + h, t - g, t + g)])
        u, v, value, _ = curves.closest(frame, cell)
        better = value < best
        s, t, best = np.where(better, u, s), np.where(better, v, t), np.where(better, value, best)
    return s, t, best


def _certify_cells(
    task: Task, curves: CurvePair, cells: tuple[Indices, Array, Array], best: float
) -> tuple[tuple[Indices, Array, Array], float]:
    """Quarter cells until none can hold a clearance ``tolerance`` below ``best``.

    Args:
        task: its tolerance and its budget.
        curves: the two centrelines.
        cells: frames (k,), cells (k, 4), m, and the bounds (k,) below their clearances, m.
        best: the smallest clearance known, m.

    Returns:
        Frames, s and t of what turned out to be below ``best``, if anything, and the bound reached, m.
    """
    frame, cell, bound = cells
    worst: tuple[Indices, Array, Array] = (frame[:0], bound[:0], bound[:0])
    settled, budget = math.inf, CELLS_PER_QUERY * task.most_queries
    while True:
        loose = np.flatnonzero(bound < best - task.tolerance)
        loose = loose[np.argsort(bound[loose], kind="stable")][:budget]
        rest = np.ones(len(bound), dtype=bool)
        rest[loose] = False
        settled = min(settled, float(bound[rest].min(initial=math.inf)))
        if not len(loose):
            return worst, min(settled, best)
        budget -= len(loose)
        a, b, c, d = cell[loose].T
        m, n = 0.5 * (a + b), 0.5 * (c + d)
        quarters = ((a, m, c, n), (a, m, n, d), (m, b, c, n), (m, b, n, d))
        cell = np.vstack([np.column_stack(quarter) for quarter in quarters])
        frame = np.tile(frame[loose], 4)
        allowed = cell[:, 3] - cell[:, 0] >= curves.gap
        frame, cell = frame[allowed], cell[allowed]
        s, t, value, bound = curves.closest(frame, cell)
        k = int(np.argmin(value))
        if value[k] < best:
            best, worst = float(value[k]), (frame[k : k + 1], s[k : k + 1], t[k : k + 1])
