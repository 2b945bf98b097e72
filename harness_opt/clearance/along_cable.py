"""What cables are coloured by: at each of their points how near anything is, and whether a limit is broken there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness_opt.clearance.pairs import PairClearance
from harness_opt.clearance.what_counts import arc_apart
from harness_opt.model.limits import LimitKind, Obstacle
from harness_opt.model.problem import Problem
from harness_opt.model.results import Motion
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices, lengths
from harness_opt.parts.scene import Scene

FAR = 4.0  # limits, or diameters: a clearance beyond has the colour of what is far away
FINE, SHORT, TOUCHES = 0, 1, 2  # states of a point: limits hold, one does not, something is touched


def far(problem: Problem) -> float:
    """Return the clearance from which on all has the colour of what is far away, m."""
    limits = [problem.clearance_limit(part) or 0.0 for part in problem.parts]
    allowed = max([*limits, problem.limits.clearance or 0.0])
    return FAR * (allowed or max(run.cable.diameter for run in problem.cables.values()))


@dataclass(frozen=True, eq=False)
class Points:
    """Points of a cable in some frames.

    Args:
        cable: its name.
        frames: of the motion, (k,).
        s: arc lengths, m, (n,).
        position: world, m, (k, n, 3).
    """

    cable: str
    frames: Indices
    s: Array
    position: Array


def clearance_along(motion: Motion, scene: Scene, pair: PairClearance, points: Points, reach: float) -> Array:
    """Return the clearances (k, n) in ``pair`` of points of one of its cables, m.

    What lies farther than ``reach`` from a part is only told to lie farther: by some number above ``reach``.

    Args:
        motion, scene: what is looked at.
        pair: a cable and an obstacle.
        points: on one of the cables of ``pair``.
        reach: m.
    """
    problem, name = motion.problem, points.cable
    own = problem.cables[name].cable
    if not pair.obstacle.is_cable:
        part = scene.parts[pair.obstacle.name]
        position, q = problem.poses(part.body, motion.motion[points.frames])
        local = rotations.rotate(rotations.conjugate(q)[:, None], points.position - position[:, None]).reshape(-1, 3)
        clearance = part.lower_bound(local) - own.radius
        near = clearance <= reach
        if np.any(near):
            clearance[near] = part.signed_distance(local[near])[0] - own.radius
        return clearance.reshape(points.position.shape[:2])
    other = pair.obstacle.name if pair.cable == name else pair.cable
    shapes = motion.cables[other]
    # what is near along the cable is near, as `clearance.measure` says
    gap = arc_apart(own.radius, problem.limits.clearance) if other == name else 0.0
    along = np.abs(points.s[:, None] - shapes.s) < gap
    found = np.empty(points.position.shape[:2])
    for row, frame in enumerate(points.frames):  # one at a time: all pairs of points of all frames are many
        apart = lengths(points.position[row][:, None] - shapes.position[frame])
        found[row] = np.where(along, np.inf, apart).min(axis=1)
    return found - own.radius - problem.cables[other].cable.radius


def states(
    motion: Motion, scene: Scene, pairs: Sequence[PairClearance], points: Points, reach: float
) -> tuple[Array, Array]:
    """Return the smallest clearance (k, n), m, and the state (k, n) of points of a cable.

    What lies in a stretch near a clamp that does not count is infinitely far. A state is :data:`TOUCHES` where
    the cable touches something, :data:`SHORT` where a clearance, the bend radius or the twist breaks its limit.

    Args:
        motion, scene: what is looked at.
        pairs: clearances that were measured of it.
        points: of a cable.
        reach: as for :func:`clearance_along`, m; at least all limits.
    """
    shapes, name, s = motion.cables[points.cable], points.cable, points.s
    darboux = shapes.curvature[points.frames]
    curvature = _interpolated(s, shapes.s, np.linalg.norm(darboux[..., :2], axis=-1))
    twist = _interpolated(s, shapes.s, np.abs(darboux[..., 2]))
    radius, turn = (motion.problem.cable_limit(kind, name) for kind in (LimitKind.BEND_RADIUS, LimitKind.TWIST))
    short = (curvature * (radius or 0.0) > 1.0) | (twist > (turn or math.inf))
    nearest = np.full(short.shape, np.inf)
    for pair in pairs:
        if name != pair.cable and pair.obstacle != Obstacle(name, is_cable=True):
            continue
        counts = (s >= pair.excluded[0]) & (s <= s[-1] - pair.excluded[1])
        for first, last in pair.at_clips:
            counts &= (s < first) | (s > last)
        clearance = np.where(counts, clearance_along(motion, scene, pair, points, reach), np.inf)
        nearest = np.minimum(nearest, clearance)
        short |= clearance < (pair.limit or 0.0)
    return nearest, np.where(nearest < 0, TOUCHES, np.where(short, SHORT, FINE))


def _interpolated(s: Array, stations: Array, values: Array) -> Array:
    """Return ``values`` (k, N) at ``stations`` (N,), read at ``s`` (n,), (k, n)."""
    if s is stations:
        return values
    return np.stack([np.interp(s, stations, row) for row in values])
