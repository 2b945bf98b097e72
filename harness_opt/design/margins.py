"""Every limit of a simulated design as scaled margins with their derivatives: what the quadratic program sees.

A margin is scaled so that 0 holds and -1 is far off: clearance by the limit plus the cable's radius, the others by
their limit. Clearances are linearised at their witnesses, where the rate is the normal times the rate of the
cable's point; bend radius, twist and clamp loads at the worst stations of every frame.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness_opt.clearance.centreline import Curve
from harness_opt.clearance.pairs import ClearanceResult, PairClearance
from harness_opt.clearance.what_counts import arc_apart
from harness_opt.clearance.witnesses import Witnesses
from harness_opt.model.design_variables import ClampRates
from harness_opt.model.limits import LimitId, LimitKind, Obstacle
from harness_opt.model.problem import Problem
from harness_opt.model.results import STATIONS, CableMotion, Motion
from harness_opt.model.spans import Span, clamp_way, joints, own_ends, whole
from harness_opt.motion.shape_rates import ShapeRates
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices
from harness_opt.parts.geometry import Geometry

TINY = 1e-12  # keeps the direction of a vanishing vector finite
NEARLY = 0.7  # of the worst in a frame: local maxima from here on are linearised too, as the worst may move there
AT_END = 1e-9  # of the length: a witness this near to the edge of what counts stands there
REACH = 0.1  # of the distance: over which its gradient is differenced, so that an edge is seen before it is nearest
LEAST_REACH = 1e-5  # m
STIFFEST = 1.0  # 1/m: the least that d2/ds2 of the distance is taken for; flatter places slide further than is linear


@dataclass(frozen=True)
class Rows:
    """Scaled margins (m,) that must be >= 0, their rates (m, k) per unit of the variables, which limits they are
    of (None where there is none), frames (m,), and what a scaled margin of 1 is in SI units, to first order, (m,).
    """

    margin: Array
    rate: Array
    limit: tuple[LimitId | None, ...]
    frame: Indices
    scale: Array

    def as_reported(self, asked: Mapping[LimitId, float]) -> Rows:
        """Return the rows with ``asked`` beyond each limit, and what violates a bend radius as a share of that radius.

        A margin of 1 - limit / radius is one of curvatures, and that of the radius (radius - limit) / limit.
        """
        bends = [limit is not None and limit.kind is LimitKind.BEND_RADIUS for limit in self.limit]
        over = 1.0 - np.where(bends, np.minimum(self.margin, 0.0), 0.0)
        more = np.array([0.0 if limit is None else asked[limit] for limit in self.limit])
        margin = np.where(over > 1.0, self.margin / over, self.margin) - more
        return dataclasses.replace(self, margin=margin, rate=self.rate / over[:, None] ** 2)

    def of_whole_cables(self, spans: Mapping[str, Span]) -> Rows:
        """Return the rows of spans as those of their whole cables."""
        limit = tuple(None if which is None else whole(spans, which) for which in self.limit)
        return dataclasses.replace(self, limit=limit)

    @staticmethod
    def joined(several: Sequence[Rows]) -> Rows:
        """Return the rows of all ``several`` in one."""
        return Rows(
            np.concatenate([rows.margin for rows in several]),
            np.concatenate([rows.rate for rows in several]),
            tuple(limit for rows in several for limit in rows.limit),
            np.concatenate([rows.frame for rows in several]),
            np.concatenate([rows.scale for rows in several]),
        )


class OfWholeCables(dict[LimitId, float]):
    """What is asked for beyond the limits of spans: what is of those of their whole cables.

    Args:
        asked: of whole cables; must know every limit.
        spans: by name.
    """

    def __init__(self, asked: Mapping[LimitId, float], spans: Mapping[str, Span]):
        super().__init__()
        self._asked, self._spans = asked, spans

    def __missing__(self, which: LimitId) -> float:
        return self._asked[whole(self._spans, which)]


def linearised(
    problem: Problem,
    motion: Motion,
    clearances: ClearanceResult,
    rates: Mapping[str, ShapeRates],
    asked: Mapping[LimitId, float],
    variables: int,
) -> Rows:
    """Return the rows of all limits.

    Args:
        problem: the design simulated, of cables without clips, or of spans.
        motion, clearances: of that design.
        rates: of its shapes, by cable; empty leaves the rates of the rows at zero.
        asked: what is asked for beyond each limit, in its scale; must know every limit.
        variables: k.
    """
    rows = [
        _clearance_rows(problem, pair, motion, rates, asked, variables)
        for pair in clearances.pairs
        if pair.limit is not None
    ]
    for name in motion.cables:
        rows += _cable_rows(problem, name, motion, rates.get(name), asked, variables)
    places = dict[str, Array]()  # rates of the arc lengths at clips, by the span behind each
    for joint in joints(problem):
        rows += _clip_rows(problem, joint, motion, rates, asked, variables)
        if rates:
            _, before, behind = joint
            longer = np.broadcast_to(rates[before].length, (len(motion.motion), variables))
            places[behind] = places.get(before, 0.0) + longer
        rows += _travel_rows(problem, joint, motion, places, asked, variables)
    rows += [
        _through_itself(problem, name, frame, asked, variables)
        for name, (frame, _) in motion.through_themselves.items()
        if problem.limits.clearance is not None
    ]
    if not rows:  # every pair was left out: nothing can be near its limit
        return Rows(np.ones(1), np.zeros((1, variables)), (None,), np.zeros(1, dtype=int), np.ones(1))
    return Rows.joined(rows)


def reach_rows(problem: Problem, cable: str, motion: Array, clamps: ClampRates, spare: float) -> Rows:
    """Return by how much ``cable`` is longer than its clamps are apart, as a share of its length, in each frame.

    Args:
        problem: the design.
        cable: name; without a row where an end of it is free.
        motion: (P,), of the frames.
        clamps: how the clamps move with the variables.
        spare: more than that distance, as a share of it, that is asked for.
    """
    way, length = clamp_way(problem, cable, motion), problem.lengths(cable, motion)
    if way is None:
        return Rows(np.zeros(0), np.zeros((0, clamps.length.shape[-1])), (), np.zeros(0, dtype=int), np.zeros(0))
    distance = np.linalg.norm(way, axis=1)
    apart = np.einsum("pc,pck->pk", way / np.maximum(distance, TINY)[:, None], clamps.end - clamps.start)
    margin = 1.0 - (1.0 + spare) * distance / length
    rate = (clamps.length * (distance / length)[:, None] - apart) * (1.0 + spare) / length[:, None]
    count = len(margin)
    return Rows(margin, rate, (None,) * count, np.arange(count), length)


def _clearance_rows(
    problem: Problem,
    pair: PairClearance,
    motion: Motion,
    rates: Mapping[str, ShapeRates],
    asked: Mapping[LimitId, float],
    variables: int,
) -> Rows:
    """Linearise a pair's clearance at its witnesses, and at the nearest point of every frame."""
    found = pair.witnesses
    missing = np.setdiff1d(pair.nearest.frame, found.frame)
    limit = pair.limit or 0.0
    scale = pair.id.kind.scale(limit, problem.cables[pair.cable].cable.radius)
    witnesses = Witnesses.joined([found, pair.nearest.take(missing)])
    slope = np.zeros((len(witnesses.frame), variables))
    if rates:
        slope = np.einsum("wc,wck->wk", witnesses.normal, _approach(problem, pair, motion, rates, witnesses))
        slope /= scale
    margin = (witnesses.clearance - limit) / scale - asked[pair.id]
    return Rows(margin, slope, (pair.id,) * len(margin), witnesses.frame, np.full(len(margin), scale))


def _through_itself(problem: Problem, cable: str, frame: int, asked: Mapping[LimitId, float], variables: int) -> Rows:
    """Return the row of a cable that goes through itself: a diameter too near, and nothing says what would help."""
    which = LimitId(LimitKind.CLEARANCE, cable, Obstacle(cable, is_cable=True))
    limit, own = problem.limits.clearance or 0.0, problem.cables[cable].cable
    scale = which.kind.scale(limit, own.radius)
    margin = np.array([(-own.diameter - limit) / scale - asked[which]])
    return Rows(margin, np.zeros((1, variables)), (which,), np.array([frame]), np.full(1, scale))


def _approach(
    problem: Problem, pair: PairClearance, motion: Motion, rates: Mapping[str, ShapeRates], witnesses: Witnesses
) -> Array:
    """Return the rates (W, 3, k) of the cable's points at ``witnesses``, less those of the points they are nearest to.

    Where the nearest point is the nearest of all, along the cable nothing changes to first order, and a point at a
    fixed share of the length will do. Where it stands at the edge of what counts, that edge stays at its distance from
    the end of the cable; and of two points of one cable that are the least arc apart that arc stays.
    """
    shapes, own, s = motion.cables[pair.cable], rates[pair.cable], witnesses.arc_length
    length = shapes.s[-1]
    moved = at_stations(own.position, shapes.s, witnesses.frame, s)
    if not pair.obstacle.is_cable:
        # points at a fixed share of a growing length run along the cable: those at the edges are called back
        at_start = np.abs(s - pair.excluded[0]) < AT_END * length
        at_end = np.abs(length - pair.excluded[1] - s) < AT_END * length
        excess = np.where(at_start, -s, np.where(at_end, length - s, 0.0)) / length
        return moved + _along(shapes, witnesses.frame, s, excess, own.length)
    other, t = pair.obstacle.name, witnesses.other_arc_length
    others = motion.cables[other]
    moved = moved - at_stations(rates[other].position, others.s, witnesses.frame, t)
    if other == pair.cable:
        gap = arc_apart(problem.cables[other].cable.radius, pair.limit)
        excess = np.where(np.abs(t - s - gap) < AT_END * length, gap / length, 0.0)
        moved = moved + _along(shapes, witnesses.frame, t, excess, own.length)
    return moved


def _along(shapes: CableMotion, frame: Indices, s: Array, excess: Array, length: Array) -> Array:
    """Return rates (W, 3, k) along the cable at ``s`` (W,), of ``excess`` (W,) for each of the length's rates.

    These are (k,), or (P, k) of a span that changes its length from frame to frame.
    """
    tangent = Curve(shapes.s, shapes.position, rotations.tangent(shapes.quaternion)).slope(frame, s)
    return (excess[:, None] * tangent)[:, :, None] * (length if length.ndim == 1 else length[frame][:, None])


def _cable_rows(
    problem: Problem,
    cable: str,
    motion: Motion,
    rates: ShapeRates | None,
    asked: Mapping[LimitId, float],
    variables: int,
) -> list[Rows]:
    """Linearise bend radius, twist and clamp loads at the worst stations of every frame."""
    shapes, rows = motion.cables[cable], []
    everywhere, clamps = np.arange(len(shapes.s)), np.arange(len(shapes.s))[own_ends(problem.cables[cable])]
    for kind, quantity, part, stations in (
        (LimitKind.BEND_RADIUS, "curvature", slice(0, 2), everywhere),
        (LimitKind.TWIST, "curvature", slice(2, 3), everywhere),
        (LimitKind.CLAMP_FORCE, "force", slice(0, 3), clamps),
        (LimitKind.CLAMP_MOMENT, "moment", slice(0, 3), clamps),
    ):
        limit = problem.cable_limit(kind, cable)
        if limit is None or not len(stations):
            continue
        limit = 1.0 / limit if kind is LimitKind.BEND_RADIUS else limit
        vector = getattr(shapes, quantity)[..., part]
        size = np.linalg.norm(vector, axis=-1)
        frame, at = np.nonzero(worst_places(size[:, stations]))
        station = stations[at]
        worst = size[frame, station]
        slope = np.zeros((len(frame), variables))
        if rates is not None:
            unit = vector[frame, station] / np.maximum(worst, TINY)[:, None]
            slope = -np.einsum("wc,wck->wk", unit, getattr(rates, quantity)[frame, station, part]) / limit
        which = LimitId(kind, cable)
        scale = np.full(len(frame), 1.0 / limit if kind is LimitKind.BEND_RADIUS else limit)
        rows.append(Rows(1.0 - worst / limit - asked[which], slope, (which,) * len(frame), frame, scale))
    return rows


def _clip_rows(
    problem: Problem,
    joint: tuple[str, str, str],
    motion: Motion,
    rates: Mapping[str, ShapeRates],
    asked: Mapping[LimitId, float],
    variables: int,
) -> list[Rows]:
    """Linearise what a clip applies to the cable: what force and moment inside it lose there, in every frame."""
    clip, before, behind = joint
    rows = []
    for kind, quantity in ((LimitKind.CLIP_FORCE, "force"), (LimitKind.CLIP_MOMENT, "moment")):
        limit = getattr(problem.limits, kind.value)
        if limit is None:
            continue
        load = getattr(motion.cables[before], quantity)[:, -1] - getattr(motion.cables[behind], quantity)[:, 0]
        size = np.linalg.norm(load, axis=-1)
        slope = np.zeros((len(size), variables))
        if rates:
            changes = getattr(rates[before], quantity)[:, -1] - getattr(rates[behind], quantity)[:, 0]
            slope = -np.einsum("pc,pck->pk", load / np.maximum(size, TINY)[:, None], changes) / limit
        which, count = LimitId(kind, before, clip=clip), len(size)
        margin = 1.0 - size / limit - asked[which]
        rows.append(Rows(margin, slope, (which,) * count, np.arange(count), np.full(count, limit)))
    return rows


def _travel_rows(
    problem: Problem,
    joint: tuple[str, str, str],
    motion: Motion,
    places: Mapping[str, Array],
    asked: Mapping[LimitId, float],
    variables: int,
) -> list[Rows]:
    """Linearise how far the cable slides through a clip; ``places`` has rates (P, k) there by the span behind it."""
    clip, before, behind = joint
    found, limit = problem.cables[before].end.found, problem.limits.travel
    if limit is None or found is None or found.places is None:
        return []
    at = found.arc_lengths(motion.motion)
    most, least = int(np.argmax(at)), int(np.argmin(at))
    slope = (places[behind][least] - places[behind][most])[None] / limit if places else np.zeros((1, variables))
    which = LimitId(LimitKind.TRAVEL, before, clip=clip)
    margin = np.array([1.0 - (at[most] - at[least]) / limit - asked[which]])
    return [Rows(margin, slope, (which,), np.array([most]), np.full(1, limit))]


def worst_places(size: Array) -> NDArray[np.bool_]:
    """Return where (P, N) each frame's largest ``size`` (P, N) stands, and its other local maxima near to that."""
    padded = np.pad(size, ((0, 0), (1, 1)), constant_values=-np.inf)
    peak = (size > padded[:, :-2]) & (size >= padded[:, 2:])
    found = peak & (size >= NEARLY * np.max(size, axis=1, keepdims=True))
    found[np.arange(len(size)), np.argmax(size, axis=1)] = True
    result: NDArray[np.bool_] = found
    return result


def at_stations(rates: Array, s: Array, frame: Indices, arc_length: Array) -> Array:
    """Return rates (W, 3, k) at ``arc_length`` (W,) of ``frame`` (W,) from those at stations (P, N, 3, k): cubic
    Lagrange interpolation on the four stations around."""
    first = np.clip(np.searchsorted(s, arc_length, side="right") - 2, 0, len(s) - 4)
    nodes = s[first[:, None] + np.arange(4)].T
    weights = np.ones((4, len(first)))
    for i in range(4):
        for j in range(4):
            if i != j:
                weights[i] *= (arc_length - nodes[j]) / (nodes[i] - nodes[j])
    found: Array = np.sum([weights[i][:, None, None] * rates[frame, first + i] for i in range(4)], axis=0)
    return found


# Of second order: a point of the cable that moves by u has the distance d + n.u + u.H.u / 2, with H the Hessian of the
# distance: zero over a flat face, round an edge or a corner of size 1 / d. The nearest point slides along the cable,
# by s, to where n.k s^2 / 2 + n.u' s + (T s + u).H.(T s + u) / 2 is least (T tangent, k curvature of the cable);
# at the end of a stretch that counts it stays. The movement u itself is taken as linear in what moves it.


@dataclass(frozen=True)
class Passing:
    """Points of a cable that pass a part, W of them, and how they move with k quantities.

    Args:
        found: the points, and what is nearest to them.
        moved: their rates relative to the part, (W, 3, k).
        rates: rates (P, N, 3, k) of the whole cable at its stations.
        still: (W,), whether a point stays where it is along the cable.
    """

    found: Witnesses
    moved: Array
    rates: Array
    still: NDArray[np.bool_]


def second_order(passing: Passing, shapes: CableMotion, geometry: Geometry, pose: tuple[Array, Array]) -> Array:
    """Return the second derivatives (W, k, k) of the clearances by the quantities, m.

    Args:
        passing: the points.
        shapes: of the cable.
        geometry: the part.
        pose: of the part's body at each point: (W, 3), (W, 4).
    """
    found, s = passing.found, shapes.s
    frame, arc, step = found.frame, found.arc_length, s[-1] / (STATIONS - 1)
    before, after = np.clip(arc - step, s[0], s[-1]), np.clip(arc + step, s[0], s[-1])
    width = after - before
    tangents = rotations.tangent(shapes.quaternion)[..., None]
    tangent = at_stations(tangents, s, frame, arc)[..., 0]
    turned = at_stations(tangents, s, frame, after) - at_stations(tangents, s, frame, before)
    bent = np.einsum("wc,wc->w", found.normal, turned[..., 0]) / width
    parted = at_stations(passing.rates, s, frame, after) - at_stations(passing.rates, s, frame, before)
    place = at_stations(shapes.position[..., None], s, frame, arc)[..., 0]
    hessian = _hessian(geometry, place, pose)
    pushed = hessian @ passing.moved
    pull = np.einsum("wc,wck->wk", tangent, pushed) + np.einsum("wc,wck->wk", found.normal, parted) / width[:, None]
    stiffness = np.maximum(np.einsum("wc,wcd,wd->w", tangent, hessian, tangent) + bent, STIFFEST)
    slid = pull[:, :, None] * pull[:, None, :] / stiffness[:, None, None]
    slid[passing.still] = 0.0
    result: Array = np.swapaxes(passing.moved, 1, 2) @ pushed - slid
    return result


def _hessian(geometry: Geometry, place: Array, pose: tuple[Array, Array]) -> Array:
    """Return the Hessians (W, 3, 3), world, of the distance to a part at ``place`` (W, 3), world."""
    position, quaternion = pose
    local = rotations.rotate(rotations.conjugate(quaternion), place - position)
    reach = np.maximum(REACH * np.abs(geometry.signed_distance(local)[0]), LEAST_REACH)[:, None]
    columns = [
        (geometry.signed_distance(local + reach * axis)[1] - geometry.signed_distance(local - reach * axis)[1])
        / (2.0 * reach)
        for axis in np.eye(3)
    ]
    hessian = np.stack(columns, axis=-1)
    frame = rotations.matrix(quaternion)
    return frame @ (0.5 * (hessian + np.swapaxes(hessian, 1, 2))) @ np.swapaxes(frame, 1, 2)
