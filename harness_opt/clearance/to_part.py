"""The smallest clearances of a cable to a part, and the points where they stand.

Along the cable the clearance ``f(s)`` to a part changes by no more than the arc length, because
``|r'| = 1``: on an arc from a to b

    f >= (f(a) + f(b) - (b - a)) / 2.

This bound says which stations need no query, and refining where it is loose (Shubert, "A sequential method
seeking the global maximum of a function", SIAM J. Numer. Anal. 9 (1972)) makes the smallest clearance of the
solved frames certain along the whole cable. Where a cable runs along a surface it would take thousands of
points; there the distance of an arc's chord, less the arc's sag, is a second bound, whose error falls with
the square of the length.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from harness_opt.clearance.centreline import Curve, sag
from harness_opt.clearance.witnesses import Found, Task, Witnesses, local_minima
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices, dots, lengths
from harness_opt.parts.geometry import Geometry

PROBE = 0.25  # of the reach: how far to look away from a witness for others
SAME = 0.1  # 1 - cosine between normals: below, two witnesses are one
STRIDES = (16, 8, 4, 2, 1)  # stations are asked from coarse to fine, so that far stretches are passed over


def against_part(task: Task, geometry: Geometry, excluded: tuple[float, float]) -> Found:
    """Return what is nearest between a cable and a part.

    Args:
        task: the cable, seen from the part's body.
        geometry: the part.
        excluded: lengths from start and end that do not count, m; less than the cable's together.
    """
    arcs = places(task.curve.s, excluded)
    samples, lower, minima = survey(task, task.curve, geometry, arcs, task.horizon)
    bound = _certify(samples, arcs, lower, task)
    sides = _other_sides(samples, minima, task)
    again = entered_again(task, geometry, excluded)
    if not len(again.frame):
        return Found(samples.all(), minima, bound, lower, sides)
    every = Witnesses.joined([samples.all(), again])
    minima = np.concatenate([minima, np.arange(len(every.frame) - len(again.frame), len(every.frame))])
    return Found(every, minima, min(bound, float(again.clearance.min())), lower, sides)


def entered_again(task: Task, geometry: Geometry, lengths_off: tuple[float, float]) -> Witnesses:
    """Return where a cable is deepest in a part that holds its clamp, after it has left it once, in each such frame.

    Over ``lengths_off`` from start and end, m, the part's limit does not count: the cable may be in it until it first
    leaves it, and near it after. What is less deep than the tolerance passes for touching.
    """
    sides = [
        after_leaving(task, task.curve, geometry, length, from_end=from_end)[0]
        for length, from_end in zip(lengths_off, (False, True), strict=True)
    ]
    found = Witnesses.joined(sides)
    return found.take(found.clearance < -task.tolerance)


def after_leaving(
    task: Task, curve: Curve, geometry: Geometry, length: float, *, from_end: bool
) -> tuple[Witnesses, Array]:
    """Return where a cable is nearest to what holds its clamp after it has left it once, in each frame in which it has.

    And at which arc from that end it has left it, m, (P,); infinite where it does not. It is looked at a quarter of its
    radius apart.

    Args:
        task: the cable.
        curve: its centreline in P frames, seen from the part's body.
        geometry: the part.
        length: of the stretch that is looked at, m.
        from_end: whether that begins at the cable's end.
    """
    way = np.linspace(0.0, length, math.ceil(4.0 * length / task.radius) + 1)
    s = curve.s[-1] - way if from_end else way
    points = curve.grid(s)
    clearance = geometry.signed_distance(points.reshape(-1, 3))[0].reshape(points.shape[:2]) - task.radius
    outside = clearance >= 0.0
    at = np.where(np.any(outside, axis=1), way[np.argmax(outside, axis=1)], np.inf)
    frame = np.flatnonzero(np.isfinite(at)) if length > 0 else np.zeros(0, dtype=np.int64)
    nearest = s[np.argmin(np.where(np.maximum.accumulate(outside, axis=1), clearance, np.inf), axis=1)[frame]]
    distance, normal, point = geometry.signed_distance(curve.at(frame, nearest))
    none = np.full(len(frame), np.nan)
    return Witnesses(frame, nearest, distance - task.radius, normal, point, none), at


def places(s: Array, excluded: tuple[float, float]) -> Array:
    """Return the stations ``s`` (N,), m, that count, and the ends of the stretches that do not, (M,)."""
    first, last = excluded[0], s[-1] - excluded[1]
    return np.concatenate([[first], s[(s > first) & (s < last)], [last]])


def survey(task: Task, curve: Curve, geometry: Geometry, arcs: Array, horizon: float) -> tuple[Samples, Array, Indices]:
    """Return what is nearest in each frame of ``curve``, and what lies below ``horizon``.

    Of a part whose box is far away from all frames, one place a frame is asked, that nearest to the box.

    Args:
        task: the cable.
        curve: its centreline in P frames, seen from the part's body.
        geometry: the part.
        arcs: (M,), where it is asked first, m.
        horizon: m.

    Returns:
        All samples, bounds (P, M) below the clearances at ``arcs``, m, and the numbers of the local minima.
    """
    samples = Samples(curve, geometry, task.radius)
    frames = np.arange(len(curve.position))
    lower = geometry.lower_bound(curve.grid(arcs).reshape(-1, 3)).reshape(len(frames), len(arcs)) - task.radius
    if lower.min() > task.far:  # one place a frame will do
        nearest = np.argmin(lower, axis=1)
        lower[frames, nearest], minima = samples(frames, arcs[nearest])
        return samples, lower, minima
    lower, index = _ask_stations(samples, arcs, lower, horizon)
    return samples, lower, _polish(samples, arcs, lower, index, horizon)


class Samples:
    """Clearances of one cable to one part, each kept as it is evaluated."""

    def __init__(self, curve: Curve, geometry: Geometry, radius: float):
        self.curve, self._geometry, self._radius = curve, geometry, radius
        self._kept: list[Witnesses] = []
        self.count = 0
        self.best = math.inf

    def __call__(self, frame: Indices, s: Array) -> tuple[Array, Indices]:
        """Return clearances (k,) at frames (k,) and arc lengths (k,), and their places in :meth:`all`."""
        distance, normal, point = self._geometry.signed_distance(self.curve.at(frame, s))
        value = distance - self._radius
        self._kept.append(Witnesses(frame, s, value, normal, point, np.full(len(s), np.nan)))
        first, self.count = self.count, self.count + len(s)
        self.best = min(self.best, float(value.min(initial=math.inf)))
        return value, np.arange(first, self.count)

    def beside(self, seen: Witnesses, probes: Array) -> tuple[Indices, Array]:
        """Return samples outside, at the places of ``seen``, of what is nearest from ``probes`` beside them (k, 3), m.

        Each as its place in :meth:`all` (k,) and its normal (k, 3); the distance is that of the place itself.
        """
        at = self.curve.at(seen.frame, seen.arc_length)
        point = self._geometry.signed_distance(at + probes)[2]
        offset = at - point
        distance = lengths(offset)
        normal = np.where(distance[:, None] > 0, offset / np.where(distance > 0, distance, 1.0)[:, None], seen.normal)
        value = distance - self._radius
        none = np.full(len(at), np.nan)
        self._kept.append(Witnesses(seen.frame, seen.arc_length, value, normal, point, none))
        first, self.count = self.count, self.count + len(at)
        return np.arange(first, self.count), normal

    def chord_bound(self, frame: Indices, a: Array, b: Array, at_a: Array, at_b: Array) -> Array:
        """Return bounds (k,) below the clearances on arcs [a, b], from those at the ends and the chords."""
        p, q, r = self.curve.at(frame, a), self.curve.at(frame, b), self._radius
        return self._geometry.chord_bound(p, q, at_a + r, at_b + r) - sag(b - a, lengths(q - p)) - r

    def slopes(self, samples: Witnesses) -> Array:
        """Return how the clearance of each sample (k,) changes with arc length."""
        along = self.curve.slope(samples.frame, samples.arc_length)
        return dots(along, samples.normal)

    def all(self) -> Witnesses:
        """Return all samples, in the coordinates of the part's body."""
        return Witnesses.joined(self._kept)


def _ask_stations(samples: Samples, arcs: Array, lower: Array, horizon: float) -> tuple[Array, Indices]:
    """Ask for all clearances that can be the smallest of their frame, or lie below ``horizon``.

    Args:
        arcs: (M,), m.
        lower: (P, M), bounds below the clearances, m.

    Returns:
        The bounds, sharpened, with equality where asked, and the numbers (P, M) of the samples, -1 where
        none.
    """
    index = np.full(lower.shape, -1)
    best = np.full(len(lower), np.inf)

    def ask(wanted: NDArray[np.bool_]) -> Array:
        frame, j = np.nonzero(wanted)
        if len(frame):
            lower[frame, j], index[frame, j] = samples(frame, arcs[j])
            np.minimum.at(best, frame, lower[frame, j])
        # |f(s) - f(t)| <= |s - t|, from every station to every other in two sweeps
        onward = np.maximum.accumulate(lower + arcs, axis=1) - arcs
        back = np.maximum.accumulate((lower - arcs)[:, ::-1], axis=1)[:, ::-1] + arcs
        return np.where(index < 0, np.maximum(onward, back), lower)

    nearest = np.zeros(lower.shape, dtype=bool)
    nearest[np.arange(len(lower)), np.argmin(lower, axis=1)] = True
    lower = ask(nearest)
    for stride in STRIDES:
        wanted = (index < 0) & (lower < np.maximum(best, horizon)[:, None])
        wanted[:, np.arange(len(arcs)) % stride > 0] = False
        lower = ask(wanted)
    return lower, index


def _polish(samples: Samples, arcs: Array, lower: Array, index: Indices, horizon: float) -> Indices:
    """Return the numbers of the smallest sample of each frame and of the local minima below ``horizon``.

    Each is improved between its station and the next one downhill, by three secant steps on the slope.
    """
    frame, j = local_minima(np.where(index < 0, np.inf, lower), horizon)
    start = index[frame, j]
    slope = samples.slopes(samples.all().take(start))
    other = j - np.sign(slope).astype(np.int64)
    inside = (other >= 0) & (other < len(arcs))
    frame, low, high, chosen = frame[inside], arcs[j[inside]], arcs[other[inside]], start[inside].copy()
    slope, beyond, best = slope[inside], np.full(len(frame), np.nan), lower[frame, j[inside]]
    for _ in range(3):
        crossing = slope * beyond < 0  # false for the NaN of a slope not known yet
        share = np.where(crossing, slope / np.where(crossing, slope - beyond, 1.0), 0.5)
        s = low + (high - low) * np.clip(share, 0.05, 0.95)
        value, number = samples(frame, s)
        tilt = samples.slopes(samples.all().take(number))
        short = tilt * slope > 0  # still downhill: the minimum is further on
        low, slope = np.where(short, s, low), np.where(short, tilt, slope)
        high, beyond = np.where(short, high, s), np.where(short, beyond, tilt)
        better = value < best
        best, chosen = np.where(better, value, best), np.where(better, number, chosen)
    start[inside] = chosen
    return start


def _other_sides(samples: Samples, minima: Indices, task: Task) -> Indices:
    """Return the numbers of samples at the same places as ``minima`` whose nearest point is a different one.

    Between two walls a point of each is as near, with a normal of its own; who moves away from one alone runs into
    the other. A step away from the nearest one shows it: what was further by less than twice the step is nearest
    there. Inside a part there is no need: one way out is enough.
    """
    seen = samples.all().take(minima)
    seen = seen.take((seen.clearance < task.horizon) & (seen.clearance + task.radius > 0))
    if not len(seen.frame):
        return np.zeros(0, dtype=np.int64)
    number, normal = samples.beside(seen, PROBE * task.reach * seen.normal)
    return number[dots(normal, seen.normal) < 1.0 - SAME]


def _certify(samples: Samples, arcs: Array, lower: Array, task: Task) -> float:
    """Refine until no arc can hold a clearance ``tolerance`` below the best; return the bound reached, m."""
    bound = 0.5 * (lower[:, :-1] + lower[:, 1:] - np.diff(arcs))
    if bound.min() >= samples.best - task.tolerance_at(samples.best):  # as of what is far away
        return min(float(bound.min()), samples.best)
    frame = np.repeat(np.arange(len(lower)), len(arcs) - 1)
    a, b = (np.tile(ends, len(lower)) for ends in (arcs[:-1], arcs[1:]))
    at_a, at_b = lower[:, :-1].ravel(), lower[:, 1:].ravel()
    settled, budget = math.inf, task.most_queries
    while True:
        floor = samples.best - task.tolerance_at(samples.best)
        bound = 0.5 * (at_a + at_b - (b - a))
        loose = np.flatnonzero(bound < floor)
        loose = loose[np.argsort(bound[loose], kind="stable")][:budget]
        budget -= len(loose)
        chords = samples.chord_bound(frame[loose], a[loose], b[loose], at_a[loose], at_b[loose])
        bound[loose] = np.maximum(bound[loose], chords)
        unsettled = np.zeros(len(bound), dtype=bool)
        unsettled[loose] = bound[loose] < floor
        settled = min(settled, float(bound[~unsettled].min(initial=math.inf)))
        if not np.any(unsettled):
            return min(settled, samples.best)
        frame, a, b, at_a, at_b = (
            frame[unsettled],
            a[unsettled],
            b[unsettled],
            at_a[unsettled],
            at_b[unsettled],
        )
        # near where the bound is lowest, but so that both halves shrink
        middle = 0.5 * (a + b + np.clip(at_a - at_b, -0.5 * (b - a), 0.5 * (b - a)))
        value = samples(frame, middle)[0]
        frame, a, b = np.tile(frame, 2), np.concatenate([a, middle]), np.concatenate([middle, b])
        at_a, at_b = np.concatenate([at_a, value]), np.concatenate([value, at_b])
