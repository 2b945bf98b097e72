"""Bend radius, twist and clamp loads through a whole motion: how much worse they can be than in any solved frame.

Between stations and between frames a quantity runs along the cubic through four of them, and is looked at on a grid of
places in between. How far the true quantity can be from that is estimated as for centrelines
(:mod:`harness_opt.clearance.moving_centreline`): by what the outermost of the four changes in the parabola through the
other three, one order lower than the cubic's own error (Hairer, Norsett, Wanner, Solving Ordinary Differential
Equations I, section II.4). Every frame solved between two others is compared with what was expected there, and raises
the estimate where that was too small.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness_opt.clearance.limits import STRAIGHT, asked
from harness_opt.clearance.solved_frames import NODES, Solve, SolvedFrames
from harness_opt.clearance.witnesses import CROWDED, STOPPED
from harness_opt.model.limits import CLAMP_LOADS, CLIP_LOADS, FORCES, LimitId, LimitKind
from harness_opt.model.results import CableMotion, LimitResult, Motion, Quantities, at_clip
from harness_opt.model.spans import joints
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices

AT_ONCE = 16  # frames that are solved at a time, where the bounds are highest
MOST_INSERTED = 400  # frames for one limit
RAISE = 1.5  # times what a solved frame was found to be beyond the estimate, for the frames around


@dataclass(frozen=True, eq=False)
class Cubics:
    """Cubics through four neighbours of n places, a piece for each interval between two of them.

    Args:
        nodes: the numbers of the four, (n - 1, 4).
        weights: of the four at m shares of the interval, its ends included, (n - 1, m, 4).
        third: weights of the four in their third divided difference, (n - 1, 4).
        doubts: how many of these leaving out an outer one changes, at most, at the shares, (n - 1, m): what is left of
            the cubic is the parabola through the other three, and the difference is theirs times the product of the
            ways to these three (Newton's form).
    """

    nodes: Indices
    weights: Array
    third: Array
    doubts: Array

    @staticmethod
    def of(x: Array, stretches: Sequence[tuple[int, int]], count: int) -> Cubics:
        """Return the cubics through places ``x`` (n,), seen at ``count`` shares of each interval.

        Args:
            x: increasing.
            stretches: first and last number of each run of at least four places across which all is smooth.
            count: of shares.
        """
        pieces = len(x) - 1
        if len(x) < NODES:  # no piece is known
            none = np.zeros((pieces, NODES), dtype=np.int64)
            return Cubics(none, np.zeros((pieces, count, NODES)), np.zeros(none.shape), np.zeros((pieces, count)))
        nodes = np.clip(np.arange(pieces) - 1, 0, len(x) - NODES)[:, None] + np.arange(NODES)
        for first, last in stretches:
            inside = np.arange(first, last)
            nodes[inside] = np.clip(inside - 1, first, last - NODES + 1)[:, None] + np.arange(NODES)
        at = x[:-1, None] + np.diff(x)[:, None] * np.linspace(0.0, 1.0, count)
        places = x[nodes]
        outer = (places < x[:-1, None]) | (places > x[1:, None])
        third, doubts = np.empty(nodes.shape), np.zeros(at.shape)
        for left_out in range(NODES):
            others = np.delete(places, left_out, axis=1)
            third[:, left_out] = 1.0 / np.prod(places[:, left_out, None] - others, axis=1)
            ways = np.abs(np.prod(at[:, :, None] - others[:, None], axis=2))
            doubts = np.maximum(doubts, np.where(outer[:, left_out, None], ways, 0.0))
        return Cubics(nodes, _lagrange(places, at), third, doubts)

    def some(self, which: slice) -> Cubics:
        """Return the pieces of some intervals."""
        return Cubics(*(column[which] for column in vars(self).values()))

    def values(self, v: Array) -> Array:
        """Return what quantities ``v`` (n, ...) are at the shares of all intervals, (n - 1, m, ...)."""
        found: Array = np.einsum("kmi,ki...->km...", self.weights, v[self.nodes])
        return found

    def doubt(self, v: Array) -> Array:
        """Return how far quantities ``v`` (n, ..., c) can be from the cubics at the shares, (n - 1, m, ...)."""
        change = np.linalg.norm(np.einsum("ki,ki...->k...", self.third, v[self.nodes]), axis=-1)
        found: Array = np.einsum("km,k...->km...", self.doubts, change)
        return found


def _lagrange(nodes: Array, at: Array) -> Array:
    """Return Lagrange's weights (k, m, j) of ``nodes`` (k, j) at places ``at`` (k, m)."""
    weights = np.ones((*at.shape, nodes.shape[1]))
    for i in range(nodes.shape[1]):
        for j in range(nodes.shape[1]):
            if i != j:
                weights[:, :, i] *= (at - nodes[:, j, None]) / (nodes[:, i] - nodes[:, j])[:, None]
    return weights


def _peaks(v: Array) -> Array:
    """Return the most (...) of smooth functions of which values (..., m) at even steps are known.

    With second differences of D at most, one is above the straight line between two values by ``D/2 x (1 - x)``: no
    more than the larger of them, where they are D/2 apart.
    """
    rise = np.abs(np.diff(v, axis=-1))
    bent = np.abs(np.diff(v, n=2, axis=-1)).max(axis=-1, keepdims=True, initial=0.0)
    over = np.maximum(0.5 * bent - rise, 0.0) ** 2 / np.where(bent > 0, 2.0 * bent, 1.0)
    found: Array = np.max(np.maximum(v[..., 1:], v[..., :-1]) + over, axis=-1, initial=-math.inf)
    return found


def quantity(kind: LimitKind, shapes: CableMotion | SolvedFrames, ends: Sequence[int]) -> Array:
    """Return the vectors whose length a limit is about, (P, N, c), or (P, k, 3) at k ``ends`` of the cable."""
    if kind in (*CLAMP_LOADS, *CLIP_LOADS):
        return (shapes.force if kind in FORCES else shapes.moment)[:, list(ends)]
    return shapes.curvature[..., :2] if kind is LimitKind.BEND_RADIUS else shapes.curvature[..., 2:]


def certified_limits(
    given: Motion, frames: Mapping[str, SolvedFrames], solve: Solve | None, stop: Callable[[], bool]
) -> tuple[LimitResult, ...]:
    """Return the rows of bend radius, twist and loads of clamps and clips, certain through the whole motion.

    Args:
        given: motion of cables without clips, or of spans.
        frames: of its cables, and those solved between them; more are added.
        solve: finds shapes between them; None where nothing moves.
        stop: asked again and again; True ends the search without a certificate.
    """
    behind, rows = {before: after for _, before, after in joints(given.problem)}, []
    for which, limit, ends in asked(given):
        own = frames[which.cable]
        if which.clip is not None:
            own = _at_clip(given, own, frames[behind[which.cable]], solve)
        rows.append(certified_limit(which, limit, own, ends, stop))
    return tuple(rows)


def _at_clip(given: Motion, before: SolvedFrames, behind: SolvedFrames, solve: Solve | None) -> SolvedFrames:
    """Return what a clip does to the cable in all frames, from the spans that meet there: both are solved for more."""

    def both(cable: str, values: Array) -> tuple[Quantities, tuple[str, ...]]:
        assert solve is not None  # nothing is asked for between the frames of a scene at rest
        (first, why), (last, other_why) = solve(cable, values), solve(behind.cable, values)
        reasons = tuple("; ".join(dict.fromkeys(filter(None, pair))) for pair in zip(why, other_why, strict=True))
        found = [
            shapes.at_frames(np.flatnonzero([not reasons[k] for k in range(len(values)) if not own[k]]))
            for shapes, own in ((first, why), (last, other_why))
        ]
        return at_clip(*found), reasons

    shapes = [given.cables[one.cable].frames(slice(len(one.given))) for one in (before, behind)]
    there = replace(shapes[0], **vars(at_clip(*shapes)))
    jumps = np.concatenate([before.jumps, behind.jumps])
    return SolvedFrames(
        before.cable, before.given, there, both, jumps=jumps, turns=before.turns, moments=before.moments
    )


def certified_limit(
    which: LimitId, limit: float, frames: SolvedFrames, ends: Sequence[int], stop: Callable[[], bool]
) -> LimitResult:
    """Return the row of a limit of one cable, certain through the whole motion where that can be had.

    Args:
        which: a limit of a cable alone.
        limit: SI.
        frames: those of the motion, and those solved between them; more are added.
        ends: of the cable whose loads are limited, 0 and -1.
        stop: asked again and again; True ends the search without a certificate.
    """
    frames.complete()
    search = _Search(which.kind, 1.0 / limit if which.kind is LimitKind.BEND_RADIUS else limit, frames, ends)
    why = search.run(stop)
    at, arc, worst, bound = search.worst_time, search.worst_arc, search.worst, search.bound
    if which.kind is LimitKind.BEND_RADIUS:
        worst, bound = 1.0 / max(worst, STRAIGHT), 1.0 / max(bound, STRAIGHT)
    return LimitResult(
        id=which,
        limit=limit,
        worst=worst,
        margin=worst - limit if which.kind.is_least else limit - worst,
        frame=int(np.argmin(np.abs(frames.given - at))),
        motion=at,
        arc_length=arc,
        certified=not why,
        tolerance=abs(bound - worst),
        reason=why,
    )


class _Search:
    """Solves frames between those of a motion until a quantity is known well enough: values where large is bad."""

    def __init__(self, kind: LimitKind, limit: float, frames: SolvedFrames, ends: Sequence[int]):
        self._kind, self._limit, self._frames, self._ends = kind, limit, frames, ends
        along = kind in (LimitKind.BEND_RADIUS, LimitKind.TWIST)
        self._places = frames.s if along else frames.s[list(ends)]
        self._arcs = Cubics.of(frames.s, [(0, len(frames.s) - 1)], 5) if along else None
        self._trust = np.ones(max(len(frames.given) - 1, 1))
        self._look()

    @property
    def _target(self) -> float:
        """What the bound has to come down to: a hundredth of the limit, or half of what is to spare, above the largest.

        Above the largest that the frames themselves leave open between their stations, which no other frame makes less.
        Less where that decides; more where the limit is violated beyond doubt.
        """
        usual, least, spare = 1e-2 * self._limit, 1e-4 * self._limit, self._limit - self._own
        if self.worst > self._limit:
            return self._own + max(usual, 0.1 * (self.worst - self._limit))
        if spare < least:  # not to be decided
            return self._own + usual
        return self._own + (max(usual, 0.5 * spare) if spare > usual else spare)

    def run(self, stop: Callable[[], bool]) -> str:
        """Solve frames where the bound is too high; return why it stays so, or nothing."""
        frames, inserted, broken = self._frames, 0, self._frames.broken
        while True:
            high = np.flatnonzero(self._bounds > self._target)
            high = high[np.argsort(-self._bounds[high], kind="stable")][:AT_ONCE]
            if not len(high):
                break
            if stop():
                return STOPPED
            if inserted + len(high) > MOST_INSERTED:
                return CROWDED
            inserted += len(high)
            count = len(frames.times)
            self._insert(0.5 * (frames.times[high] + frames.times[high + 1]))
            if len(frames.times) == count:  # nothing can be solved there
                break
        broken = frames.broken
        return "; ".join(dict.fromkeys(frames.why_broken(int(k)) for k in np.flatnonzero(broken)))

    def _given(self, at: Array) -> Indices:
        """Return the intervals (k,) between frames of the simulation that hold motion values ``at`` (k,)."""
        return np.clip(np.searchsorted(self._frames.given, at, side="right") - 1, 0, len(self._trust) - 1)

    def _insert(self, values: Array) -> None:
        """Solve frames at ``values`` (k,), and raise the estimates around those that lie beyond them."""
        frames, before, bounds = self._frames, self._frames.times, self._bounds
        frames.insert(values)
        new = np.flatnonzero(~np.isin(frames.times, before))
        if not len(new):
            self._look()
            return
        found = np.linalg.norm(quantity(self._kind, frames, self._ends)[new], axis=-1).max(axis=1)
        where = np.clip(np.searchsorted(before, frames.times[new], side="right") - 1, 0, len(before) - 2)
        room = np.maximum(self._doubts[where], 1e-12 * self._limit)
        over = 1.0 + np.maximum(found - bounds[where], 0.0) / room
        for near in (-1, 0, 1):
            k = self._given(frames.times[new]) + near
            inside = (k >= 0) & (k < len(self._trust)) & (over > 1.0)
            np.maximum.at(self._trust, k[inside], RAISE * over[inside])
        self._look()

    def _look(self) -> None:
        """Find the largest value of all frames, and bounds (P - 1,) between them."""
        frames = self._frames
        vectors = quantity(self._kind, frames, self._ends)
        size = np.linalg.norm(vectors, axis=-1)
        frame, place = np.unravel_index(int(np.argmax(size)), size.shape)
        self.worst, self.worst_time = float(size[frame, place]), float(frames.times[frame])
        self.worst_arc = float(self._places[place])
        fine, open_ = (
            vectors[:, :, None],
            np.zeros(size.shape),
        )  # (P, arcs, places on each, c), and what each leaves open
        if self._arcs is not None:
            across = np.moveaxis(vectors, 1, 0)
            fine, doubt = (np.moveaxis(found, 2, 0) for found in (self._arcs.values(across), self._arcs.doubt(across)))
            along = np.linalg.norm(fine, axis=-1)
            open_ = _peaks(along + doubt) - along.max(axis=-1)
        self._own = float((np.linalg.norm(fine, axis=-1).max(axis=-1) + open_).max())
        self._bounds, self._doubts, self.bound = np.zeros(0), np.zeros(0), self._own
        if len(frames.times) < 2:
            return
        broken = frames.broken
        stretches = [(a, b) for a, b in frames.stretches() if b - a + 1 >= NODES]
        times = Cubics.of(frames.times, stretches, 9)
        known = np.zeros(len(broken), dtype=bool)
        for a, b in stretches:
            known[a:b] = True
        self._bounds, self._doubts = np.full(len(broken), -math.inf), np.zeros(len(broken))
        trust = self._trust[self._given(0.5 * (frames.times[1:] + frames.times[:-1]))]
        block = 64  # intervals at a time: each takes some megabytes meanwhile
        for first in range(0, len(broken), block):
            some = slice(first, first + block)
            part = times.some(some)
            level = np.linalg.norm(part.values(fine), axis=-1)
            unsure = trust[some, None, None, None] * part.doubt(fine)
            most = np.moveaxis(level + unsure, 1, -1)
            over = _peaks(most).max(axis=-1) + np.maximum(open_[:-1], open_[1:])[some]
            self._bounds[some] = over.max(axis=-1)
            self._doubts[some] = self._bounds[some] - level.max(axis=(1, 2, 3))
        self._bounds[~known | broken] = -math.inf
        self.bound = float(max(self._own, self._bounds.max(initial=-math.inf)))
