"""Which stretches of a cable count against what: near its clamps, near a clamp that cables share, against itself."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from harness_opt.clearance.witnesses import Task
from harness_opt.model.ends import Clip, End
from harness_opt.model.problem import Problem
from harness_opt.parts.geometry import Geometry


def least_gap(task: Task) -> float:
    """Return :func:`arc_apart` of the cable of ``task``, m."""
    return arc_apart(task.radius, task.limit)


def arc_apart(radius: float, limit: float | None) -> float:
    """Return the least arc, m, between two points of one cable that count against each other.

    It is that of a hairpin, a half circle, whose limbs stand just the limit apart.

    Args:
        radius: of the cable, m.
        limit: of its clearance, m; None is none.
    """
    return 0.5 * math.pi * (2 * radius + (limit or 0.0))


def holds(problem: Problem, end: End, radius: float, geometry: Geometry) -> bool:
    """Return whether a part is what a cable comes out of at ``end``: a holder of its clamp.

    Args:
        problem: the end is of.
        end: as the problem has it.
        radius: of the cable, m.
        geometry: the part.
    """
    if end.position is None or end.body != geometry.body:
        return False
    if end.holders is not None:
        return geometry.name in end.holders
    point = np.asarray(end.position, dtype=float)[None]
    if np.any((point < geometry.lower - radius) | (point > geometry.upper + radius)):  # as of most parts
        return False
    return bool(geometry.signed_distance(point)[0][0] < radius)


def let_off(problem: Problem, task: Task, geometry: Geometry) -> tuple[float, float]:
    """Return the lengths, m, from start and end over which the limit to a part does not count, as it holds the clamp.

    Over them :func:`harness_opt.clearance.certify_part.entered_between` looks whether the cable enters the part again.
    """
    run = problem.cables[task.cable]
    ends = (run.start, run.end)
    start, end = (
        let_off_length(end, task.radius, task.limit) if holds(problem, end, task.radius, geometry) else 0.0
        for end in ends
    )
    return start, end


def let_off_length(end: End, radius: float, limit: float | None) -> float:
    """Return the arc, m, over which a holder's limit does not count: given, or radius and limit, or two diameters."""
    return max(radius + (limit or 0.0), 4.0 * radius) if end.let_off is None else end.let_off


def let_off_rate(end: End, radius: float, limit: float | None) -> float:
    """Return the rate of :func:`let_off_length` with the cable's radius."""
    if end.let_off is not None:
        return 0.0
    return 1.0 if radius + (limit or 0.0) > 4.0 * radius else 4.0


@dataclass(frozen=True)
class SharedClamp:
    """Where two cables are held together: in a splice, a clip on the way, or a tie.

    Args:
        at_end, other_at_end: whether it is the end of the one, and of the other, or else the start.
        tie: name of the free body on which both are clipped; None where it is no tie.
    """

    at_end: bool
    other_at_end: bool
    tie: str | None


def shared_clamps(problem: Problem, one: str, other: str) -> list[SharedClamp]:
    """Return where two cables of a problem in spans are held together: they do not collide for it.

    That is where their clamps in one body stand nearer to each other than the cables are thick, and at every tie.
    """
    runs = (problem.cables[one], problem.cables[other])
    apart = runs[0].cable.radius + runs[1].cable.radius
    found = []
    for at_end, other_at_end in itertools.product((False, True), repeat=2):
        a = runs[0].end if at_end else runs[0].start
        b = runs[1].end if other_at_end else runs[1].start
        if a.position is None or b.position is None or a.body != b.body:
            continue
        clipped = isinstance(a, Clip) and isinstance(b, Clip) and a.body in problem.bodies
        tie = a.body if clipped and problem.bodies[a.body].free else None
        if tie is not None or math.dist(a.position, b.position) < apart:
            found.append(SharedClamp(at_end, other_at_end, tie))
    return found


Domain = tuple[float, float, float, float]  # arcs of the one, from and to, and of the other, m


def domains(problem: Problem, one: Task, other: Task) -> list[Domain]:
    """Return the rectangles of arcs in which two different cables of a problem in spans count against each other.

    All of both; but where they share a clamp not what lies within :func:`arc_apart` of it on either, and between two
    ties nothing: cables that are tied together lie side by side.
    """
    shared = shared_clamps(problem, one.cable, other.cable)
    if len({clamp.tie for clamp in shared} - {None}) > 1:
        return []
    length, other_length = float(one.curve.s[-1]), float(other.curve.s[-1])
    found = [(0.0, length, 0.0, other_length)]
    gap = arc_apart(0.5 * (one.radius + other.radius), one.limit)
    for clamp in shared:
        near = (length - gap, length) if clamp.at_end else (0.0, gap)
        other_near = (other_length - gap, other_length) if clamp.other_at_end else (0.0, gap)
        found = [part for domain in found for part in _without(domain, near, other_near)]
    return found


def _without(domain: Domain, near: tuple[float, float], other_near: tuple[float, float]) -> Iterator[Domain]:
    """Give what is left of ``domain`` without the corner where both arcs are near a clamp that they share."""
    a, b, c, d = domain
    for first, last in ((a, min(b, near[0])), (max(a, near[1]), b)):
        if last > first:
            yield first, last, c, d
    first, last = max(a, near[0]), min(b, near[1])
    for begin, end in ((c, min(d, other_near[0])), (max(c, other_near[1]), d)):
        if last > first and end > begin:
            yield first, last, begin, end
