"""Smallest clearances of cables over a motion, with the points that a redesign has to push apart.

A clearance is the distance of a cable's centreline to a part, less the cable's radius; to another cable or to
itself, the distance of the two centrelines, less both radii. Negative is penetration.

Between stations the centreline is the cubic through positions and tangents; what it misses is estimated from
the curvatures and added to the tolerance. Along it the clearance ``f(s)`` to a part changes by no more than
the arc length, because ``|r'| = 1``: on an arc from a to b

    f >= (f(a) + f(b) - (b - a)) / 2.

This bound says which stations need no query, and refining where it is loose (Shubert, "A sequential method
seeking the global maximum of a function", SIAM J. Numer. Anal. 9 (1972)) makes the smallest clearance of the
solved frames certain along the whole cable. Where a cable runs along a surface it would take thousands of
points; there the distance of an arc's chord, less the arc's sag, is a second bound, whose error falls with
the square of the length. Between frames nothing is certain yet.

A point of an arc of length h at the share x of it lies within ``sqrt(x (1 - x) (h^2 - chord^2))`` of the
chord's point at the same share: Stewart's theorem on the two balls, about the arc's ends, that hold it.

Near a clamp the cable leaves the very body that holds it: along ``2 (limit + radius)`` from that end, parts
of that body do not count. The result says how long these stretches are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import rotations
from .problem import Problem
from .results import CableMotion, LimitResult
from .rotations import Array
from .scene import Geometry, Scene

Indices = NDArray[np.int64]

STRIDES = (16, 8, 4, 2, 1)  # stations are asked from coarse to fine, so that far stretches are passed over
PAIRS = 500_000  # pairs of stations looked at together, so that temporaries stay below 100 MB
CELLS_PER_QUERY = 5  # cells of two curves are cheaper than queries to coal


@dataclass(frozen=True)
class Options:
    """How hard to look.

    Args:
        tolerance: to which the smallest clearance is wanted, m; None takes 1 % of the cable's diameter.
        reach: witnesses are kept up to this much above the limit, m; None takes the cable's diameter.
        most_queries: for the certificate of one pair; where they do not suffice, the tolerance reached is
            larger.
    """

    tolerance: float | None = None
    reach: float | None = None
    most_queries: int = 20_000


@dataclass(frozen=True, eq=False)
class Witnesses:
    """Points of a cable, each with what is nearest to it on an obstacle: W of them.

    Args:
        frame: (W,).
        arc_length: (W,), of the point on the cable, m.
        clearance: (W,), m.
        normal: (W, 3), world, unit, from the obstacle to the cable: the clearance grows along it.
        point: (W, 3), world, on the obstacle's surface, m.
        other_arc_length: (W,), of ``point`` along the other cable, m; NaN for parts.
    """

    frame: Indices
    arc_length: Array
    clearance: Array
    normal: Array
    point: Array
    other_arc_length: Array

    def take(self, index: ArrayLike) -> Witnesses:
        """Return those at ``index``."""
        return Witnesses(**{name: value[index] for name, value in vars(self).items()})


@dataclass(frozen=True, eq=False)
class PairClearance:
    """One cable against one obstacle, in P frames.

    Args:
        cable: its name.
        obstacle: name of the part, or "cable:NAME" of another cable or of the same one.
        limit: m, or None.
        nearest: the smallest clearance of each frame, P witnesses in order.
        witnesses: the local minima along the cable that lie less than ``reach`` above the limit, by frame.
        lower_bound: no point of the cable, at the solved frames, has a smaller clearance, m.
        certified_along_arc: whether that bound is as close to :attr:`worst` as was asked.
        certified: the same, and nothing moves between the frames.
        excluded: lengths from start and end that do not count, m.
        closed: False where the obstacle is a shell without an inside, so that a cable inside would go unseen.
    """

    cable: str
    obstacle: str
    limit: float | None
    nearest: Witnesses
    witnesses: Witnesses
    lower_bound: float
    certified_along_arc: bool
    certified: bool
    excluded: tuple[float, float]
    closed: bool

    @property
    def clearance(self) -> Array:
        """The smallest clearance of each frame, (P,), m."""
        return self.nearest.clearance

    @property
    def frame(self) -> int:
        """The frame with the smallest clearance."""
        return int(np.argmin(self.clearance))

    @property
    def worst(self) -> float:
        """The smallest clearance of all frames, m."""
        return float(self.clearance[self.frame])

    @property
    def tolerance(self) -> float:
        """By how much, at most, a point between stations can be worse than :attr:`worst`, m."""
        return self.worst - self.lower_bound


@dataclass(frozen=True, eq=False)
class ClearanceResult:
    """Clearances of all cables to all obstacles.

    Args:
        motion: (P,), 0 to 1, of the frames.
        pairs: one for each cable and obstacle.
        left_out: what was not measured and why, a sentence each.
    """

    motion: Array
    pairs: tuple[PairClearance, ...]
    left_out: tuple[str, ...] = ()

    @property
    def limits(self) -> tuple[LimitResult, ...]:
        """One row for each pair that has a limit."""
        return tuple(
            LimitResult(
                name="clearance",
                limit=pair.limit,
                worst=pair.worst,
                margin=pair.worst - pair.limit,
                cable=pair.cable,
                frame=pair.frame,
                motion=float(self.motion[pair.frame]),
                arc_length=float(pair.nearest.arc_length[pair.frame]),
                part=pair.obstacle,
                certified=pair.certified,
                tolerance=pair.tolerance,
            )
            for pair in self.pairs
            if pair.limit is not None
        )


@dataclass(frozen=True, eq=False)
class Curve:
    """Centrelines of one cable in P frames: cubics through N stations.

    Args:
        s: (N,), m.
        position: (P, N, 3), m.
        tangent: (P, N, 3), d3.
    """

    s: Array
    position: Array
    tangent: Array

    def at(self, frame: Indices, s: Array) -> Array:
        """Return the points (k, 3) of frames (k,) at arc lengths (k,): the Hermite cubic, fourth order, error
        ``h^4 / 384`` times the fourth derivative."""
        j, h, x = self._place(s)
        y = 1.0 - x
        p, q = self.position[frame, j], self.position[frame, j + 1]
        u, v = self.tangent[frame, j], self.tangent[frame, j + 1]
        ends = (y * y * (1 + 2 * x))[:, None] * p + (x * x * (1 + 2 * y))[:, None] * q
        return ends + (h * x * y)[:, None] * (y[:, None] * u - x[:, None] * v)

    def slope(self, frame: Indices, s: Array) -> Array:
        """Return the derivatives (k, 3) of :meth:`at` along the arc; unit vectors up to third order."""
        j, h, x = self._place(s)
        y = 1.0 - x
        step = (self.position[frame, j + 1] - self.position[frame, j]) / h[:, None]
        u, v = self.tangent[frame, j], self.tangent[frame, j + 1]
        return (6 * x * y)[:, None] * step + (y * (1 - 3 * x))[:, None] * u + (x * (1 - 3 * y))[:, None] * v

    def seen_from(self, position: Array, quaternion: Array) -> Curve:
        """Return the curve in the coordinates of a body that stands at poses (P, 3), (P, 4)."""
        back = rotations.conjugate(quaternion)[:, None]
        moved = self.position - position[:, None]
        return Curve(self.s, rotations.rotate(back, moved), rotations.rotate(back, self.tangent))

    def _place(self, s: Array) -> tuple[Indices, Array, Array]:
        j = np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, len(self.s) - 2)
        h = self.s[j + 1] - self.s[j]
        return j, h, (s - self.s[j]) / h


@dataclass(frozen=True, eq=False)
class _Task:
    """One cable, and what is asked about it; ``error`` is that of the cubics, m."""

    cable: str
    curve: Curve
    radius: float
    error: float
    tolerance: float
    reach: float
    most_queries: int
    limit: float | None = None

    @property
    def horizon(self) -> float:
        return (self.limit or 0.0) + self.reach


@dataclass(frozen=True, eq=False)
class _Found:
    """Everything evaluated for one pair, which of it are local minima, and the bound below it all."""

    samples: Witnesses
    minima: Indices
    bound: float


def measure(
    problem: Problem,
    scene: Scene,
    motion: ArrayLike,
    cables: Mapping[str, CableMotion],
    options: Options | None = None,
) -> ClearanceResult:
    """Return the clearances of ``cables`` to all parts and, where ``limits.clearance`` is given, to cables.

    A cable's clearance to itself counts pairs of its points that lie at least ``pi/2 (diameter + limit)``
    apart along it: so much arc lies between the limbs of a hairpin that stand just the limit apart.

    Args:
        problem: bodies, parts, limits, and which body holds which end.
        scene: its parts as geometry.
        motion: (P,), 0 to 1, of the frames.
        cables: the shapes in these frames, by name.
        options: how hard to look.
    """
    motion = np.atleast_1d(np.asarray(motion, dtype=float))
    if not len(motion):
        return ClearanceResult(motion, (), ("clearance: no frame was solved",))
    tasks = [_task(problem, name, cable, options or Options()) for name, cable in cables.items()]
    pairs: list[PairClearance] = []
    left_out: list[str] = []
    still = len(motion) == 1 or not problem.moves
    poses = {part.body: problem.body(part.body).poses(motion) for part in scene.parts.values()}
    for number, own in enumerate(tasks):
        seen = {body: own.curve.seen_from(*pose) for body, pose in poses.items()}
        for name, geometry in scene.parts.items():
            task = replace(own, curve=seen[geometry.body], limit=problem.clearance_limit(name))
            excluded = _excluded(problem, task, geometry.body)
            if sum(excluded) >= task.curve.s[-1]:
                why = f"all of it lies within {sum(excluded):.3g} m of its clamps on {geometry.body}"
                left_out.append(f"clearance of {own.cable} to {name}: {why}")
                continue
            found = _to_part(task, geometry, excluded)
            pair = _pair(task, name, found, still)
            pair = replace(pair, excluded=excluded, closed=geometry.closed)
            pairs.append(_in_world(pair, *poses[geometry.body]))
        if problem.limits.clearance is None:
            continue
        for other in tasks[number:]:
            task = replace(own, limit=problem.limits.clearance)
            curves = _CurvePair.of(task, other)
            if curves.gap >= task.curve.s[-1]:
                left_out.append(f"clearance of {own.cable} to itself: too short to meet itself")
                continue
            pairs.append(_pair(task, f"cable:{other.cable}", _to_cable(task, curves), still))
    return ClearanceResult(motion, tuple(pairs), tuple(left_out))


def _task(problem: Problem, name: str, shapes: CableMotion, options: Options) -> _Task:
    cable = problem.cables[name].cable
    return _Task(
        cable=name,
        curve=Curve(shapes.s, shapes.position, rotations.tangent(shapes.quaternion)),
        radius=cable.radius,
        error=_cubic_error(shapes),
        tolerance=0.01 * cable.diameter if options.tolerance is None else options.tolerance,
        reach=cable.diameter if options.reach is None else options.reach,
        most_queries=options.most_queries,
    )


def _cubic_error(shapes: CableMotion) -> float:
    """Return the largest error of the Hermite cubics, m.

    It stands at the middles of the intervals, and is estimated there against the quintics through positions,
    tangents and second derivatives ``r'' = R (omega x e3)``, which the curvatures give.
    """
    h = np.diff(shapes.s)[:, None]
    tangent = rotations.tangent(shapes.quaternion)
    across = np.stack(
        [shapes.curvature[..., 1], -shapes.curvature[..., 0], np.zeros(shapes.curvature.shape[:-1])], -1
    )
    second = rotations.rotate(shapes.quaternion, across)
    difference = h / 32 * (tangent[:, :-1] - tangent[:, 1:]) + h**2 / 64 * (second[:, :-1] + second[:, 1:])
    return float(np.max(np.linalg.norm(difference, axis=-1)))


def _excluded(problem: Problem, task: _Task, body: str) -> tuple[float, float]:
    """Return the lengths from start and end that do not count against parts of ``body``, m."""
    run = problem.cables[task.cable]
    length = 2.0 * ((task.limit or 0.0) + task.radius)
    start, end = (
        length if end.position is not None and end.body == body else 0.0 for end in (run.start, run.end)
    )
    return start, end


def _pair(task: _Task, obstacle: str, found: _Found, still: bool) -> PairClearance:
    """Sort what was found into the result of a pair."""
    samples = found.samples
    order = np.lexsort((samples.clearance, samples.frame))
    nearest = samples.take(order[np.unique(samples.frame[order], return_index=True)[1]])
    # a minimum within a station of its frame's smallest clearance is that same one, less well resolved
    spacing = float(np.max(np.diff(task.curve.s)))
    minima = found.minima[
        np.abs(samples.arc_length[found.minima] - nearest.arc_length[samples.frame[found.minima]]) > spacing
    ]
    both = [(value, getattr(samples, name)[minima]) for name, value in vars(nearest).items()]
    witnesses = Witnesses(*(np.concatenate(columns) for columns in both))
    if obstacle == f"cable:{task.cable}":
        # pairs at the least arc apart are there because the cable is one piece, not because it meets itself
        gap = _gap(task)
        met = witnesses.other_arc_length - witnesses.arc_length > gap * (1 + 1e-6)
        witnesses = witnesses.take(met | (witnesses.clearance < (task.limit or 0.0)))
    witnesses = witnesses.take(witnesses.clearance < task.horizon)
    sure = found.bound >= np.min(nearest.clearance) - task.tolerance * (1 + 1e-9)
    return PairClearance(
        cable=task.cable,
        obstacle=obstacle,
        limit=task.limit,
        nearest=nearest,
        witnesses=witnesses.take(np.lexsort((witnesses.arc_length, witnesses.frame))),
        lower_bound=found.bound - task.error,
        certified_along_arc=bool(sure),
        certified=bool(sure and still),
        excluded=(0.0, 0.0),
        closed=True,
    )


def _in_world(pair: PairClearance, position: Array, quaternion: Array) -> PairClearance:
    """Turn witnesses from the coordinates of a body with poses (P, 3), (P, 4) to the world."""

    def turn(old: Witnesses) -> Witnesses:
        q, centre = quaternion[old.frame], position[old.frame]
        normal, point = rotations.rotate(q, old.normal), centre + rotations.rotate(q, old.point)
        return replace(old, normal=normal, point=point)

    return replace(pair, nearest=turn(pair.nearest), witnesses=turn(pair.witnesses))


# --- a cable against a part ---


class _Samples:
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

    def chord_bound(self, frame: Indices, a: Array, b: Array, at_a: Array, at_b: Array) -> Array:
        """Return bounds (k,) below the clearances on arcs [a, b], from those at the ends and the chords."""
        p, q, r = self.curve.at(frame, a), self.curve.at(frame, b), self._radius
        return self._geometry.chord_bound(p, q, at_a + r, at_b + r) - _sag(b - a, _norm(q - p)) - r

    def slopes(self, samples: Witnesses) -> Array:
        """Return how the clearance of each sample (k,) changes with arc length."""
        along = self.curve.slope(samples.frame, samples.arc_length)
        return np.einsum("ki,ki->k", along, samples.normal)

    def all(self) -> Witnesses:
        """Return all samples, in the coordinates of the part's body."""
        columns = zip(*(vars(kept).values() for kept in self._kept), strict=True)
        return Witnesses(*(np.concatenate(column) for column in columns))


def _to_part(task: _Task, geometry: Geometry, excluded: tuple[float, float]) -> _Found:
    curve = task.curve
    first, last = excluded[0], curve.s[-1] - excluded[1]
    arcs = np.concatenate([[first], curve.s[(curve.s > first) & (curve.s < last)], [last]])
    samples = _Samples(curve, geometry, task.radius)
    frames = np.arange(len(curve.position))
    points = curve.at(np.repeat(frames, len(arcs)), np.tile(arcs, len(frames)))
    lower = geometry.lower_bound(points).reshape(len(frames), len(arcs)) - task.radius
    lower, index = _ask_stations(samples, arcs, lower, task.horizon)
    minima = _polish(samples, arcs, lower, index, task.horizon)
    bound = _certify(samples, arcs, lower, task)
    return _Found(samples.all(), minima, bound)


def _ask_stations(samples: _Samples, arcs: Array, lower: Array, horizon: float) -> tuple[Array, Indices]:
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


def _polish(samples: _Samples, arcs: Array, lower: Array, index: Indices, horizon: float) -> Indices:
    """Return the numbers of the smallest sample of each frame and of the local minima below ``horizon``.

    Each is improved between its station and the next one downhill, by three secant steps on the slope.
    """
    frame, j = _local_minima(np.where(index < 0, np.inf, lower), horizon)
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


def _local_minima(value: Array, horizon: float) -> tuple[Indices, Indices]:
    """Return frames and columns of each row's smallest entry (P, M) and of the local minima below horizon."""
    wall = np.full((len(value), 1), np.inf)
    low = (value < np.hstack([wall, value[:, :-1]])) & (value <= np.hstack([value[:, 1:], wall]))
    low &= value < horizon
    low[np.arange(len(value)), np.argmin(value, axis=1)] = True
    frame, column = np.nonzero(low)
    return frame, column


def _certify(samples: _Samples, arcs: Array, lower: Array, task: _Task) -> float:
    """Refine until no arc can hold a clearance ``tolerance`` below the best; return the bound reached, m."""
    frame = np.repeat(np.arange(len(lower)), len(arcs) - 1)
    a, b = (np.tile(ends, len(lower)) for ends in (arcs[:-1], arcs[1:]))
    at_a, at_b = lower[:, :-1].ravel(), lower[:, 1:].ravel()
    settled, budget = math.inf, task.most_queries
    while True:
        floor = samples.best - task.tolerance
        bound = 0.5 * (at_a + at_b - (b - a))
        loose = np.flatnonzero(bound < floor)
        loose = loose[np.argsort(bound[loose], kind="stable")][:budget]
        budget -= len(loose)
        chords = samples.chord_bound(frame[loose], a[loose], b[loose], at_a[loose], at_b[loose])
        bound[loose] = np.maximum(bound[loose], chords)
        open_ = np.zeros(len(bound), dtype=bool)
        open_[loose] = bound[loose] < floor
        settled = min(settled, float(bound[~open_].min(initial=math.inf)))
        if not np.any(open_):
            return min(settled, samples.best)
        frame, a, b, at_a, at_b = frame[open_], a[open_], b[open_], at_a[open_], at_b[open_]
        # near where the bound is lowest, but so that both halves shrink
        middle = 0.5 * (a + b + np.clip(at_a - at_b, -0.5 * (b - a), 0.5 * (b - a)))
        value = samples(frame, middle)[0]
        frame, a, b = np.tile(frame, 2), np.concatenate([a, middle]), np.concatenate([middle, b])
        at_a, at_b = np.concatenate([at_a, value]), np.concatenate([value, at_b])


# --- a cable against a cable, or against itself ---


def _gap(task: _Task) -> float:
    return 0.5 * math.pi * (2 * task.radius + (task.limit or 0.0))


@dataclass(frozen=True, eq=False)
class _CurvePair:
    """Two centrelines; where they are the same, ``t - s >= gap`` between arc lengths, else ``gap`` is -inf.

    A cell is an arc [a, b] of the one and [c, d] of the other. Their distance is at least that of their
    chords less both sags.
    """

    one: Curve
    other: Curve
    radii: float
    gap: float

    @staticmethod
    def of(task: _Task, other: _Task) -> _CurvePair:
        gap = _gap(task) if task.cable == other.cable else -math.inf
        return _CurvePair(task.curve, other.curve, task.radius + other.radius, gap)

    def closest(self, frame: Indices, cell: Array) -> tuple[Array, Array, Array, Array]:
        """Return s, t, the clearance there and a bound below all clearances, (k,) each, of cells (k, 4)."""
        a, b, c, d = cell.T
        p, q = self.one.at(frame, a), self.other.at(frame, c)
        u, v = self.one.at(frame, b) - p, self.other.at(frame, d) - q
        x, y = closest_on_segments(p, u, q, v)
        s, t = a + x * (b - a), c + y * (d - c)
        near = np.flatnonzero(t - s < self.gap)
        if len(near):
            # the squared distance is convex, so the nearest of those far enough apart stand at the gap
            first = np.maximum(a, c - self.gap)[near]
            span = np.minimum(b, d - self.gap)[near] - first
            xs = ((first[:, None] + span[:, None] * [0.0, 1.0]).T - a[near]) / (b - a)[near]
            ys = ((first[:, None] + span[:, None] * [0.0, 1.0]).T + self.gap - c[near]) / (d - c)[near]
            w0, w1 = (
                p[near] + i[:, None] * u[near] - q[near] - j[:, None] * v[near]
                for i, j in zip(xs, ys, strict=True)
            )
            s[near] = first + span * closest_on_segments(w0, w1 - w0, np.zeros_like(w0), np.zeros_like(w0))[0]
            t[near] = s[near] + self.gap
            x, y = (s - a) / (b - a), (t - c) / (d - c)
        chords = _norm(p + x[:, None] * u - q - y[:, None] * v)
        sags = _sag(b - a, _norm(u)) + _sag(d - c, _norm(v))
        value = _norm(self.one.at(frame, s) - self.other.at(frame, t))
        return s, t, value - self.radii, chords - sags - self.radii

    def candidates(self, horizon: float) -> tuple[Indices, Indices, Array, float]:
        """Return the cells between stations that can hold the smallest clearance of their frame or one below
        ``horizon``: frames (k,), stations (k,) of the one, cells (k, 4), and a bound below all others, m."""
        frames: list[Indices] = []
        rows: list[Indices] = []
        columns: list[Indices] = []
        rest = math.inf
        s, t = self.one.s, self.other.s
        allowed = t[None, 1:] - s[:-1, None] >= self.gap
        chunk = max(1, PAIRS // allowed.size)
        for first in range(0, len(self.one.position), chunk):
            (m, mr), (n, nr) = (
                _balls(curve.s, curve.position[first : first + chunk]) for curve in (self.one, self.other)
            )
            square = np.sum(m * m, -1)[:, :, None] + np.sum(n * n, -1)[:, None] - 2 * m @ n.swapaxes(1, 2)
            distance = np.where(allowed, np.sqrt(np.maximum(square, 0.0)) - self.radii, np.inf)
            reach = mr[:, :, None] + nr[:, None]
            upper = np.min((distance + reach).reshape(len(m), -1), axis=1)
            wanted = distance - reach < np.maximum(upper, horizon)[:, None, None]
            rest = min(rest, float(np.min((distance - reach)[~wanted], initial=math.inf)))
            frame, i, j = np.nonzero(wanted)
            frames.append(frame + first)
            rows.append(i)
            columns.append(j)
        i, j = np.concatenate(rows), np.concatenate(columns)
        return np.concatenate(frames), i, np.column_stack([s[i], s[i + 1], t[j], t[j + 1]]), rest

    def witnesses(self, frame: Indices, s: Array, t: Array, radius: float) -> Witnesses:
        """Return the pairs of points as witnesses; ``radius`` is that of the other cable."""
        at = self.other.at(frame, t)
        offset = self.one.at(frame, s) - at
        distance = _norm(offset)
        # centrelines that meet are parted at right angles to both
        across = np.cross(self.one.slope(frame, s), self.other.slope(frame, t))
        touching = distance < 1e-12 * self.one.s[-1]
        offset = np.where(touching[:, None], across + 1e-300, offset)
        normal = offset / np.maximum(_norm(offset), 1e-300)[:, None]
        return Witnesses(frame, s, distance - self.radii, normal, at + radius * normal, t)


def _to_cable(task: _Task, curves: _CurvePair) -> _Found:
    frame, row, cell, settled = curves.candidates(task.horizon)
    s, t, value, bound = curves.closest(frame, cell)
    # the smallest clearance of every interval of the cable, then the local minima along it
    order = np.lexsort((value, row, frame))
    key = frame[order] * len(task.curve.s) + row[order]
    order = order[np.unique(key, return_index=True)[1]]
    table = np.full((len(task.curve.position), len(task.curve.s) - 1), np.inf)
    number = np.zeros(table.shape, dtype=np.int64)
    table[frame[order], row[order]], number[frame[order], row[order]] = value[order], order
    low = number[_local_minima(table, task.horizon)]
    s, t, value = _shrink(curves, frame[low], s[low], t[low])
    worst, reached = _certify_cells(task, curves, (frame, cell, bound), float(value.min()))
    # the cell search may have met something still closer
    frame, s, t = (np.concatenate(places) for places in zip((frame[low], s, t), worst, strict=True))
    samples = curves.witnesses(frame, s, t, curves.radii - task.radius)
    return _Found(samples, np.arange(len(low)), min(settled, reached))


def _shrink(curves: _CurvePair, frame: Indices, s: Array, t: Array) -> tuple[Array, Array, Array]:
    """Return arc lengths (k,), (k,) and clearances (k,) of the nearest points round (s, t).

    They are found again on chords so short that these serve as curves: the sag falls with the square of their
    length.
    """
    best = np.full(len(s), np.inf)
    for part in (1 / 2, 1 / 4, 1 / 8, 1 / 16, 1 / 32):
        h, g = (part * np.max(np.diff(curve.s)) for curve in (curves.one, curves.other))
        ends = (curves.one.s[-1], curves.other.s[-1])
        cell = np.column_stack([np.maximum(s - h, 0), np.minimum(s + h, ends[0])])
        cell = np.column_stack([cell, np.maximum(t - g, 0), np.minimum(t + g, ends[1])])
        u, v, value, _ = curves.closest(frame, cell)
        better = value < best
        s, t, best = np.where(better, u, s), np.where(better, v, t), np.where(better, value, best)
    return s, t, best


def _certify_cells(
    task: _Task, curves: _CurvePair, cells: tuple[Indices, Array, Array], best: float
) -> tuple[tuple[Indices, Array, Array], float]:
    """Quarter cells until none can hold a clearance ``tolerance`` below ``best``.

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


def closest_on_segments(p: Array, u: Array, q: Array, v: Array) -> tuple[Array, Array]:
    """Return shares x, y (k,) in 0 to 1 so that ``p + x u`` and ``q + y v`` (k, 3) are nearest to each other.

    Ericson, Real-Time Collision Detection, 5.1.9; where segments are parallel one of many answers, and points
    (zero ``u`` or ``v``) are allowed.
    """
    w = p - q
    a, e, b, c, f = (np.einsum("ki,ki->k", i, j) for i, j in ((u, u), (v, v), (u, v), (u, w), (v, w)))
    determinant = a * e - b * b
    # relative: below this the cross product of u and v is rounding, and any x on the overlap is as good
    skew = determinant > 1e-14 * a * e
    x = np.where(skew, np.clip((b * f - c * e) / np.where(skew, determinant, 1.0), 0.0, 1.0), 0.0)
    y = (b * x + f) / np.where(e > 0, e, 1.0)
    clipped = np.clip(y, 0.0, 1.0)
    again = np.clip((b * clipped - c) / np.where(a > 0, a, 1.0), 0.0, 1.0)
    return np.where((clipped != y) | (e == 0), again, x), clipped


def _balls(s: Array, position: Array) -> tuple[Array, Array]:
    """Return centres (P, N-1, 3) and radii (P, N-1) of balls that hold the arcs between stations.

    From the mean of the two distances to the ends of an arc of length h, squared: ``h^2 / 2 - chord^2 / 4``.
    """
    h, chord = np.diff(s), _norm(np.diff(position, axis=1))
    centre = 0.5 * (position[:, 1:] + position[:, :-1])
    return centre, np.sqrt(np.maximum(0.5 * h * h - 0.25 * chord * chord, 0.25 * chord * chord))


def _sag(arc: Array, chord: Array) -> Array:
    return 0.5 * np.sqrt(np.maximum(arc * arc - chord * chord, 0.0))


def _norm(v: Array) -> Array:
    return np.sqrt(np.einsum("...i,...i->...", v, v))
