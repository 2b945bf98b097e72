"""What a search is told of a part that a cable goes through: how far back it is, or how far aside.

The distance to the nearest face of a thin part says next to nothing there: no point is deeper than half the thickness,
and beyond the middle the nearest face is the far one. Where a cable goes through a part and comes back by the side
that it came in by, what lies between is measured past the faces there, so that the design slopes back whatever the
thickness; some of it may be outside the part, on its far side. A cable that does not come back has to pass beside the
part, or through a slot of it: there it is measured how far aside that is.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping

import numpy as np

from harness_opt.clearance.pairs import ClearanceResult, PairClearance
from harness_opt.clearance.witnesses import Witnesses
from harness_opt.model.problem import Problem
from harness_opt.model.results import CableMotion
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.parts.geometry import Geometry
from harness_opt.parts.scene import Scene

WAYS = 16  # aside that are looked along, all round a cable
TOUCHING = 0.02  # radii, to which a clearance is known: a shell has no inside, and what is that near to it goes through


def past_sides(
    problem: Problem, scene: Scene, cables: Mapping[str, CableMotion], found: ClearanceResult
) -> ClearanceResult:
    """Return ``found`` with what goes through a part measured past the side that it came in by.

    Args:
        problem: the design.
        scene: its parts.
        cables: its shapes, by cable.
        found: their clearances.
    """

    def pair(given: PairClearance) -> PairClearance:
        radius = problem.cables[given.cable].cable.radius
        if given.obstacle.is_cable or given.limit is None or given.worst > (TOUCHING - 1.0) * radius:
            return given
        geometry = scene.parts[given.obstacle.name]
        poses = problem.poses(geometry.body, found.motion)
        return _past_sides(given, radius, geometry, poses, cables[given.cable])

    return dataclasses.replace(found, pairs=tuple(pair(given) for given in found.pairs))


def _past_sides(
    pair: PairClearance, radius: float, geometry: Geometry, poses: tuple[Array, Array], shapes: CableMotion
) -> PairClearance:
    """Return a pair whose centreline touches the part somewhere; ``poses`` (P, 3), (P, 4) are those of the part."""
    known = Witnesses.joined([pair.nearest, pair.witnesses])
    kept, back, through = np.ones(len(known.frame), dtype=bool), [], []
    counts = (shapes.s >= pair.excluded[0]) & (shapes.s <= shapes.s[-1] - pair.excluded[1])
    for frame in np.flatnonzero(pair.clearance <= (TOUCHING - 1.0) * radius).tolist():
        own = known.frame == frame
        stations = _stations(frame, shapes, counts, geometry, (poses[0][frame], poses[1][frame]), radius)
        along = Witnesses.joined([stations, known.take(own)])
        for stretch, faces, returns in _stretches(along.take(np.argsort(along.arc_length)), radius):
            between = own & (known.arc_length >= stretch.arc_length[0]) & (known.arc_length <= stretch.arc_length[-1])
            if returns:
                kept &= ~(between & (known.normal @ faces.normal.sum(axis=0) < 0.0))
                back.append(_deepest(stretch, faces, radius))
            else:
                kept &= ~between
                through.append(_middle(stretch, faces, radius))
    if through:
        back.append(_aside(Witnesses.joined(through), geometry, poses, radius, (pair.limit or 0.0) + radius))
    if not back:
        return pair
    every = Witnesses.joined([known.take(kept), *back])
    order = np.lexsort((every.clearance, every.frame))
    nearest = every.take(order[np.unique(every.frame[order], return_index=True)[1]])
    return dataclasses.replace(pair, nearest=nearest, witnesses=every)


def _stations(
    frame: int, shapes: CableMotion, counts: Array, geometry: Geometry, pose: tuple[Array, Array], radius: float
) -> Witnesses:
    """Return what is nearest to the stations of ``frame`` that count, in the world."""
    origin, turn = pose
    local = rotations.rotate(rotations.conjugate(turn), shapes.position[frame, counts] - origin)
    distance, normal, point = geometry.signed_distance(local)
    return Witnesses(
        np.full(len(distance), frame),
        shapes.s[counts],
        distance - radius,
        rotations.rotate(turn, normal),
        origin + rotations.rotate(turn, point),
        np.full(len(distance), np.nan),
    )


def _stretches(along: Witnesses, radius: float) -> Iterator[tuple[Witnesses, Witnesses, bool]]:
    """Yield the stretches of a cable that go through the part, to another side or there and back.

    Args:
        along: places along one cable in one frame, in order, and what is nearest to them.
        radius: of the cable, m.

    Yields:
        The places of a stretch, the two outside before and after it, and whether the cable came back by the side that
        it came in by.
    """
    inside = along.clearance <= (TOUCHING - 1.0) * radius
    change = np.flatnonzero(np.diff(inside.astype(int)))
    before = change[~inside[change]]
    after = change[inside[change]] + 1
    if len(before):  # a cable that begins or ends inside came in by no side
        after = after[after > before[0]]
    first, count = 0, min(len(before), len(after))
    while first < count:
        same = [k for k in range(first, count) if along.normal[after[k]] @ along.normal[before[first]] > 0.0]
        last = same[-1] if same else first
        ends = np.array([before[first], after[last]])
        stretch, faces = along.take(np.arange(ends[0] + 1, ends[1])), along.take(ends)
        # else the nearest faces are those of the side that it came in by
        if not same or np.any(stretch.normal @ faces.normal.sum(axis=0) < 0.0):
            yield stretch, faces, bool(same)
        first = last + 1


def _middle(stretch: Witnesses, faces: Witnesses, radius: float) -> Witnesses:
    """Return the innermost place of a stretch that goes through to another side, for :func:`_aside` to begin at.

    Its normal is the way through, and its point the place itself, in the world.
    """
    through = faces.normal[1] - faces.normal[0]
    at = stretch.take(np.array([int(np.argmin(stretch.clearance))]))
    place = at.point + (at.clearance + radius)[:, None] * at.normal
    return dataclasses.replace(at, normal=through[None] / np.linalg.norm(through), point=place)


def _aside(through: Witnesses, geometry: Geometry, poses: tuple[Array, Array], radius: float, room: float) -> Witnesses:
    """Return how far aside there is room for the cable, the shortest of the ways round it, as a clearance.

    The distance to the part grows by no more than what a point moves, so steps by what it lacks pass over no room.

    Args:
        through: innermost places (n,), and the ways through for their normals.
        geometry: the part.
        poses: of it, (P, 3), (P, 4).
        radius: of the cable, m.
        room: what the centreline needs to the part, m.
    """
    origin, turn = (column[through.frame] for column in poses)
    place = rotations.rotate(rotations.conjugate(turn), through.point - origin)
    axis = rotations.rotate(rotations.conjugate(turn), through.normal)
    first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis), axis=1)])
    first /= np.linalg.norm(first, axis=1)[:, None]
    angle = np.linspace(0.0, 2.0 * np.pi, WAYS, endpoint=False)[:, None]
    ways = np.cos(angle) * first[:, None] + np.sin(angle) * np.cross(axis, first)[:, None]  # (n, WAYS, 3)
    size = float(np.linalg.norm(geometry.upper - geometry.lower)) + room
    gone = np.zeros(ways.shape[:2])
    open_ones = np.ones(ways.shape[:2], dtype=bool)
    while np.any(open_ones):
        which, way = np.nonzero(open_ones)
        at = place[which] + gone[which, way, None] * ways[which, way]
        lacking = room - geometry.signed_distance(at)[0]
        gone[which, way] += np.maximum(lacking, 0.0)
        shortest = gone.min(axis=1, where=~open_ones, initial=size)
        open_ones[which, way] = (lacking > TOUCHING * radius) & (gone[which, way] < shortest[which])
    best = np.argmin(gone, axis=1)
    each = np.arange(len(best))
    normal = rotations.rotate(turn, ways[each, best])
    return dataclasses.replace(through, clearance=room - radius - gone[each, best], normal=normal)


def _deepest(stretch: Witnesses, faces: Witnesses, radius: float) -> Witnesses:
    """Return the place of a stretch that is deepest past both of two faces, measured past the nearer of them."""
    place = stretch.point + (stretch.clearance + radius)[:, None] * stretch.normal
    height = np.einsum("nfc,fc->nf", place[:, None] - faces.point, faces.normal)
    depth = height.max(axis=1)
    at = int(np.argmin(depth))
    face = int(np.argmax(height[at]))
    return dataclasses.replace(
        stretch.take(np.array([at])),
        clearance=depth[[at]] - radius,
        normal=faces.normal[[face]],
        point=faces.point[[face]],
    )
