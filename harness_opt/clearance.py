"""Smallest clearances of cables over a motion, with the points that a redesign has to push apart.

A clearance is the distance of a cable's centreline to a part, less the cable's radius; to another cable or to
itself, the distance of the two centrelines, less both radii. Negative is penetration.

How they are found stands in ``part_clearance.py`` and ``cable_clearance.py``. Both make the smallest
clearance of the solved frames certain along the whole cable; what the curve between stations misses is
estimated from the curvatures and added to the tolerance. Between frames nothing is certain yet.

Near a clamp the cable leaves the very body that holds it: along ``2 (limit + radius)`` from that end, parts
of that body do not count. The result says how long these stretches are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from . import rotations
from .cable_clearance import CurvePair, against_cable, least_gap
from .centreline import Curve, cubic_error
from .clearance_search import Found, Task, Witnesses
from .part_clearance import against_part
from .problem import Problem
from .results import CableMotion, LimitResult
from .rotations import Array
from .scene import Scene

__all__ = ["ClearanceResult", "Curve", "Options", "PairClearance", "Witnesses", "measure"]


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
    still = not problem.moves
    poses = {part.body: problem.poses(part.body, motion) for part in scene.parts.values()}
    for number, own in enumerate(tasks):
        seen = {body: own.curve.seen_from(*pose) for body, pose in poses.items()}
        for name, geometry in scene.parts.items():
            task = replace(own, curve=seen[geometry.body], limit=problem.clearance_limit(name))
            excluded = _excluded(problem, task, geometry.body)
            if sum(excluded) >= task.curve.s[-1]:
                why = f"all of it lies within {sum(excluded):.3g} m of its clamps on {geometry.body}"
                left_out.append(f"clearance of {own.cable} to {name}: {why}")
                continue
            found = against_part(task, geometry, excluded)
            pair = _pair(task, name, found, still)
            pair = replace(pair, excluded=excluded, closed=geometry.closed)
            pairs.append(_in_world(pair, *poses[geometry.body]))
        if problem.limits.clearance is None:
            continue
        for other in tasks[number:]:
            # the cubics of both centrelines are off, those of a cable against itself twice
            task = replace(own, limit=problem.limits.clearance, error=own.error + other.error)
            curves = CurvePair.of(task, other)
            if curves.gap >= task.curve.s[-1]:
                left_out.append(f"clearance of {own.cable} to itself: too short to meet itself")
                continue
            pairs.append(_pair(task, f"cable:{other.cable}", against_cable(task, curves), still))
    return ClearanceResult(motion, tuple(pairs), tuple(left_out))


def _task(problem: Problem, name: str, shapes: CableMotion, options: Options) -> Task:
    """Return the search for cable ``name``, in the world and without a limit."""
    cable = problem.cables[name].cable
    return Task(
        cable=name,
        curve=Curve(shapes.s, shapes.position, rotations.tangent(shapes.quaternion)),
        radius=cable.radius,
        error=cubic_error(shapes),
        tolerance=0.01 * cable.diameter if options.tolerance is None else options.tolerance,
        reach=cable.diameter if options.reach is None else options.reach,
        most_queries=options.most_queries,
    )


def _excluded(problem: Problem, task: Task, body: str) -> tuple[float, float]:
    """Return the lengths from start and end that do not count against parts of ``body``, m."""
    run = problem.cables[task.cable]
    length = 2.0 * ((task.limit or 0.0) + task.radius)
    start, end = (length if end.position is not None and end.body == body else 0.0 for end in (run.start, run.end))
    return start, end


def _pair(task: Task, obstacle: str, found: Found, still: bool) -> PairClearance:
    """Return the result of a pair: what was found, sorted; ``still`` where nothing moves between frames."""
    samples = found.samples
    order = np.lexsort((samples.clearance, samples.frame))
    nearest = samples.take(order[np.unique(samples.frame[order], return_index=True)[1]])
    # a minimum within a station of its frame's smallest clearance is that same one, less well resolved
    spacing = float(np.max(np.diff(task.curve.s)))
    minima = found.minima[
        np.abs(samples.arc_length[found.minima] - nearest.arc_length[samples.frame[found.minima]]) > spacing
    ]
    witnesses = Witnesses.joined([nearest, samples.take(minima)])
    if obstacle == f"cable:{task.cable}":
        # pairs at the least arc apart are there because the cable is one piece, not because it meets itself
        gap = least_gap(task) * (1 + 1e-6)  # 1e-6: rounding, and far less than a station
        met = witnesses.other_arc_length - witnesses.arc_length > gap
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

    def turned(old: Witnesses) -> Witnesses:
        q, centre = quaternion[old.frame], position[old.frame]
        normal, point = rotations.rotate(q, old.normal), centre + rotations.rotate(q, old.point)
        return replace(old, normal=normal, point=point)

    return replace(pair, nearest=turned(pair.nearest), witnesses=turned(pair.witnesses))
