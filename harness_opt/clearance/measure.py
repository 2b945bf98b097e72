"""Smallest clearances of cables over a motion, with the points that a redesign has to push apart.

A clearance is the distance of a cable's centreline to a part, less the cable's radius; to another cable or to itself,
the distance of the two centrelines, less both radii. Negative is penetration.

``to_part.py`` and ``to_cable.py`` make the smallest clearance of the solved frames certain along the whole cable; what
the curve between stations misses is estimated from the curvatures and added to the tolerance. ``certify_part.py`` and
``certify_cable.py`` make it certain between the frames too, for pairs that have a limit, where ``measure`` is told how
to solve more frames; ``moving_centreline.py`` says what of that is proven and what is estimated.

Over a stretch from a clamp, which the result names, its holder's limit does not count (``what_counts.py``).
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from harness_opt.clearance.centreline import Curve
from harness_opt.clearance.certify_cable import CableSearch
from harness_opt.clearance.certify_limits import certified_limits
from harness_opt.clearance.certify_part import PartSearch, Seen, entered_between
from harness_opt.clearance.moving_centreline import MovingCurve
from harness_opt.clearance.pairs import (
    Between,
    ClearanceResult,
    Options,
    PairClearance,
    met_itself,
    of_whole_cables,
    pairs_asked,
)
from harness_opt.clearance.solved_frames import SolvedFrames, at_rest
from harness_opt.clearance.to_cable import CurvePair, against_cable, all_found
from harness_opt.clearance.to_part import against_part, places
from harness_opt.clearance.what_counts import domains, least_gap, let_off
from harness_opt.clearance.witnesses import DECIDES, LONG, Certificate, Found, Task, Witnesses, never
from harness_opt.model import checks
from harness_opt.model.bodies import WORLD
from harness_opt.model.ends import End
from harness_opt.model.limits import Obstacle
from harness_opt.model.problem import Problem
from harness_opt.model.results import CableMotion, Motion, cubic_errors, split
from harness_opt.model.spans import has_clips
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.threads import one_at_a_time
from harness_opt.parts.scene import Scene, load_scene

__all__ = ["Between", "ClearanceResult", "Curve", "Options", "PairClearance", "Witnesses", "measure"]

MOST_VIEWS = 4  # of one cable from bodies that are kept at a time: each takes as much memory as the frames


def measure(
    problem: Problem,
    scene: Scene,
    motion: ArrayLike,
    cables: Mapping[str, CableMotion],
    options: Options | None = None,
    between: Between | None = None,
) -> ClearanceResult:
    """Return the clearances of ``cables`` to all parts and, where ``limits.clearance`` is given, to cables.

    A cable's clearance to itself counts points at least ``pi/2 (diameter + limit)`` apart along it, as much as is
    between the limbs of a hairpin that stand just the limit apart.

    Args:
        problem: bodies, parts, limits, and which body holds which end.
        scene: its parts as geometry.
        motion: (P,), 0 to 1, of the frames.
        cables: the shapes in these frames, by name.
        options: how hard to look.
        between: to be certain between the frames; None looks at the frames alone.
    """
    motion = np.atleast_1d(np.asarray(motion, dtype=float))
    if not len(motion):
        return ClearanceResult(motion, (), ("clearance: no frame was solved",))
    given = Motion(problem, motion, cables)
    if has_clips(problem):
        apart = split(given)
        found = of_whole_cables(problem, measure(apart.problem, scene, motion, apart.cables, options, between))
        return found if found.whole else replace(found, left_out=_unmeasured(given, scene, len(found.pairs)))
    tasks = [_task(problem, motion, name, cable, options or Options()) for name, cable in cables.items()]
    views = _Views(given, between) if between is not None and problem.moves and len(motion) > 1 else None
    give_up = (options or Options()).give_up or never
    poses = {part.body: problem.poses(part.body, motion) for part in scene.parts.values()}
    pairs: list[PairClearance] = []
    for number, own in enumerate(tasks):
        against_parts = _against_parts(given, own, scene, poses, views)
        pairs += itertools.takewhile(lambda _: not give_up(), against_parts)
        if views is not None:
            views.forget(own.cable)
        if problem.limits.clearance is not None:
            others = itertools.takewhile(lambda _: not give_up(), tasks[number:])
            pairs += [_against_cable(given, own, other, views) for other in others]
    missing = _unmeasured(given, scene, len(pairs))
    if missing or (views is None and problem.moves):
        return ClearanceResult(motion, tuple(pairs), missing, whole=not missing)
    frames = at_rest(given) if views is None else views.frames
    rows = certified_limits(given, frames, None if between is None else between.solve, tasks[0].stop)
    inserted = {} if views is None else {name: solved.inserted for name, solved in frames.items()}
    return ClearanceResult(motion, tuple(pairs), inserted=inserted, cable_limits=rows)


def _unmeasured(motion: Motion, scene: Scene, done: int) -> tuple[str, ...]:
    """Return a sentence where not all pairs were come to before the run was stopped, or a cable was not solved."""
    left, solved = pairs_asked(motion.problem, scene) - done, len(motion.cables) == len(motion.problem.cables)
    why = "the run was stopped before they were measured" if solved else "not every cable was solved"
    return (f"clearances of {left} pairs: {why}",) if left else ()


def _against_parts(
    given: Motion, own: Task, scene: Scene, poses: Mapping[str, tuple[Array, Array]], views: _Views | None
) -> Iterator[PairClearance]:
    """Give the clearances of one cable to all parts; ``poses`` (P, 3), (P, 4) of the frames, by body."""
    problem, motion = given.problem, given.motion
    seen: dict[str, Curve] = {}
    for name, geometry in scene.parts.items():
        if geometry.body not in seen:
            if len(seen) == MOST_VIEWS:
                seen.clear()
            seen[geometry.body] = own.curve.seen_from(*poses[geometry.body])
        task = replace(own, curve=seen[geometry.body], limit=problem.clearance_limit(name))
        held = let_off(problem, task, geometry)
        length = float(task.curve.s[-1])
        if sum(held) >= length:  # of a cable that short a stretch in the middle counts all the same
            held = min(held[0], 0.49 * length), min(held[1], 0.49 * length)
        found = against_part(task, geometry, held)
        pair = _pair(given, task, Obstacle(name), found)
        pair = replace(pair, excluded=held, closed=geometry.closed)
        if views is not None and task.limit is not None and found.lower is not None:
            view, arcs = views.seen(task.cable, geometry.body), places(task.curve.s, pair.excluded)
            search = PartSearch(task, view, geometry, arcs, pair.start, found.lower)
            pair = _certified(pair, motion, search.certificate())
            for again in entered_between(task, view, geometry, held, found):
                pair = _entered(pair, motion, again, task.tolerance)
        yield _in_world(pair, problem, geometry.body, motion)


def _against_cable(given: Motion, own: Task, other: Task, views: _Views | None) -> PairClearance:
    """Return the clearance of one cable to another, or to itself."""
    itself = own.cable == other.cable
    # A cable is nearly as near to itself all along where it bends evenly: whether it keeps its limit is what is asked.
    enough = DECIDES if itself else 0.0
    # the cubics of both centrelines are off, those of a cable against itself twice
    task = replace(own, limit=given.problem.limits.clearance, error=own.error + other.error, enough=enough)
    obstacle = Obstacle(other.cable, is_cable=True)
    if itself and least_gap(task) >= task.curve.s[-1]:
        return _never_near(given, task, obstacle)
    parts = [CurvePair.of(task, other).domain] if itself else domains(given.problem, task, other)
    if not parts:
        return _never_near(given, task, obstacle)
    found = all_found([against_cable(task, CurvePair.of(task, other, domain)) for domain in parts])
    pair = _pair(given, task, obstacle, found)
    if views is not None:
        curves = views.curve(own.cable), views.curve(other.cable)
        pair = _certified(pair, given.motion, CableSearch(task, other, curves, pair.start, parts).certificate())
    return met_itself(pair, task.radius, given.motion) if itself else pair


def _never_near(given: Motion, task: Task, obstacle: Obstacle) -> PairClearance:
    """Return the pair of a cable with what it cannot come near: too short, tied to it, or all at a shared clamp."""
    place = Witnesses(
        frame=np.zeros(1, dtype=np.int64),
        arc_length=np.zeros(1),
        clearance=np.array([math.inf]),
        normal=np.array([[0.0, 0.0, 1.0]]),
        point=task.curve.position[:1, 0],
        other_arc_length=np.zeros(1),
    )
    count = len(given.motion)
    nearest = replace(place.take(np.zeros(count, dtype=np.int64)), frame=np.arange(count))
    return PairClearance(
        cable=task.cable,
        obstacle=obstacle,
        limit=task.limit,
        nearest=nearest,
        witnesses=place.take(np.zeros(0, dtype=np.int64)),
        place=place,
        motion=0.0,
        lower_bound=math.inf,
        certified_along_arc=True,
        certified=True,
        reason="",
        excluded=(0.0, 0.0),
        closed=True,
    )


class _Views:
    """The moving centrelines of all cables, each seen from the bodies that matter; made when first asked for."""

    def __init__(self, given: Motion, between: Between):
        self._problem, motion, moments = given.problem, given.motion, given.problem.moments
        turns = np.array([0.5]) if given.problem.out_and_back else np.zeros(0)
        self.frames: dict[str, SolvedFrames] = {}
        self._curves: dict[tuple[str, str], MovingCurve] = {}
        self._seen: dict[tuple[str, str], Seen] = {}
        for name, shapes in given.cables.items():
            frames = np.array([snap.frame for snap in between.snaps if snap.cable == name], dtype=np.int64)
            jumps = 0.5 * (motion[frames - 1] + motion[frames])
            slides = given.problem.cables[name].slid is not None
            stretch = functools.partial(_stretch, given.problem, name) if slides else None
            solved = SolvedFrames(
                name, motion, shapes, between.solve, jumps=jumps, turns=turns, moments=moments, stretch=stretch
            )
            solved.insert(turns[(turns > motion[0]) & (turns < motion[-1])])
            self.frames[name] = solved

    def curve(self, cable: str, body: str = WORLD) -> MovingCurve:
        """Return the centreline of ``cable`` in the coordinates of ``body``."""
        if (cable, body) not in self._curves:
            poses = None if body == WORLD else functools.partial(self._problem.poses, body)
            self._curves[cable, body] = MovingCurve(self.frames[cable], poses)
        return self._curves[cable, body]

    def forget(self, cable: str) -> None:
        """Let go of how bodies see ``cable``: each view takes several times the memory of the frames."""
        self._curves = {key: curve for key, curve in self._curves.items() if key[0] != cable or key[1] == WORLD}
        self._seen.clear()

    def seen(self, cable: str, body: str) -> Seen:
        """Return ``cable`` from ``body``, in the world or on a body of its ends: where ``body`` moves least."""
        if (cable, body) in self._seen:
            return self._seen[cable, body]
        if len(self._seen) == MOST_VIEWS:
            self._seen.clear()
        problem, run = self._problem, self._problem.cables[cable]
        own = min((WORLD, run.start.body, run.end.body), key=functools.partial(problem.joints_between, body))
        poses = functools.partial(problem.poses_from, own, body)
        rates = functools.partial(problem.rates, body, view=own)
        clamps = (self._clamp(run.start, body), self._clamp(run.end, body))
        view = self._seen[cable, body] = Seen(self.curve(cable, own), poses, rates, clamps)
        return view

    def _clamp(self, end: End, body: str) -> Callable[[Array], Array] | None:
        """Return the way of the clamp that holds ``end``, in the coordinates of ``body``; None where none does."""
        if end.position is None:
            return None
        held = np.asarray(end.position)

        def at(motion: Array) -> Array:
            (p, q), (c, turn) = (self._problem.poses(name, motion) for name in (end.body, body))
            return rotations.rotate(rotations.conjugate(turn), p + rotations.rotate(q, held) - c)

        return at


def _stretch(problem: Problem, cable: str, motion: Array) -> Array:
    """Return the share (P,) of the length that is counted along ``cable`` which it has at ``motion`` (P,)."""
    return problem.lengths(cable, motion) / problem.cables[cable].cable.length


def _task(problem: Problem, motion: Array, name: str, shapes: CableMotion, options: Options) -> Task:
    """Return the search for cable ``name``, in the world and without a limit."""
    cable, error = problem.cables[name].cable, float(cubic_errors(shapes).max())
    tolerance = 0.01 * cable.diameter if options.tolerance is None else options.tolerance
    if not problem.moves:  # then the frame is all there is, and what the cubics miss of it comes on top
        tolerance -= min(error, 0.5 * tolerance)
    slopes = _stretch(problem, name, motion)[:, None, None] * rotations.tangent(shapes.quaternion)
    return Task(
        cable=name,
        curve=Curve(shapes.s, shapes.position, slopes),
        radius=cable.radius,
        error=error,
        tolerance=tolerance,
        reach=cable.diameter if options.reach is None else options.reach,
        strict=options.tolerance is not None,
        most_queries=options.most_queries,
        stop=options.stop or never,
    )


def _pair(given: Motion, task: Task, obstacle: Obstacle, found: Found) -> PairClearance:
    """Return the result of a pair in the frames alone: what was found, sorted."""
    samples = found.samples
    order = np.lexsort((samples.clearance, samples.frame))
    nearest = samples.take(order[np.unique(samples.frame[order], return_index=True)[1]])
    # a minimum within a station of its frame's smallest clearance is that same one, less well resolved
    spacing = float(np.max(np.diff(task.curve.s)))
    minima = found.minima[
        np.abs(samples.arc_length[found.minima] - nearest.arc_length[samples.frame[found.minima]]) > spacing
    ]
    witnesses = Witnesses.joined([nearest, samples.take(minima), samples.take(found.sides)])
    if obstacle == Obstacle(task.cable, is_cable=True):
        # pairs at the least arc apart are there because the cable is one piece, not because it meets itself
        gap = least_gap(task) * (1 + 1e-6)  # 1e-6: rounding, and far less than a station
        met = witnesses.other_arc_length - witnesses.arc_length > gap
        witnesses = witnesses.take(met | (witnesses.clearance < (task.limit or 0.0)))
    witnesses = witnesses.take(witnesses.clearance < task.horizon)
    least = float(np.min(nearest.clearance))
    sure = found.bound >= least - task.tolerance_at(least) * (1 + 1e-9)
    frame = int(np.argmin(nearest.clearance))
    still = not given.problem.moves
    return PairClearance(
        cable=task.cable,
        obstacle=obstacle,
        limit=task.limit,
        nearest=nearest,
        witnesses=witnesses.take(np.lexsort((witnesses.arc_length, witnesses.frame))),
        place=nearest.take(np.array([frame])),
        motion=float(given.motion[frame]),
        lower_bound=found.bound - task.error,
        certified_along_arc=sure,
        certified=sure and still,
        reason="" if sure and still else LONG if still else "the motion between the frames was not looked at",
        excluded=(0.0, 0.0),
        closed=True,
    )


def _certified(pair: PairClearance, motion: Array, found: Certificate) -> PairClearance:
    """Return a pair with what was found through the motion."""
    nearest = int(np.argmin(np.abs(motion - found.motion)))
    return replace(
        pair,
        place=replace(found.place, frame=np.array([nearest])),
        motion=found.motion,
        lower_bound=found.bound,
        certified=not found.reason,
        reason=found.reason,
    )


def _entered(pair: PairClearance, motion: Array, again: Certificate, touching: float) -> PairClearance:
    """Return a pair with what was found where the cable leaves what holds its clamp: nothing unless it enters again."""
    depth = float(again.place.clearance[0])
    bound = pair.lower_bound
    if depth < -touching:
        bound = min(bound, again.bound)
        pair = pair if pair.worst <= depth else _certified(pair, motion, again)
    reasons = list(dict.fromkeys(reason for reason in (pair.reason, again.reason) if reason))
    return replace(pair, lower_bound=bound, certified=not reasons, reason="; ".join(reasons))


def _in_world(pair: PairClearance, problem: Problem, body: str, motion: Array) -> PairClearance:
    """Turn witnesses from the coordinates of ``body`` to the world."""

    def turned(old: Witnesses, at: Array) -> Witnesses:
        if body == WORLD:
            return replace(old, normal=old.normal + 0.0, point=old.point + 0.0)  # zeros without a sign, as below
        position, quaternion = problem.poses(body, at)
        normal, point = rotations.rotate(quaternion, old.normal), position + rotations.rotate(quaternion, old.point)
        return replace(old, normal=normal, point=point)

    return replace(
        pair,
        nearest=turned(pair.nearest, motion[pair.nearest.frame]),
        witnesses=turned(pair.witnesses, motion[pair.witnesses.frame]),
        place=turned(pair.place, np.array([pair.motion])),
    )


@one_at_a_time
def clearances(
    motion: Motion,
    scene: Scene | None = None,
    *,
    tolerance: float | None = None,
    stop: Callable[[], bool] | None = None,
    give_up: Callable[[], bool] | None = None,
) -> ClearanceResult:
    """Return the clearances of a motion: all cables to all parts and, where a limit asks for it, to cables.

    Where there is a limit, frames are solved between those of the motion until the smallest clearance of the whole
    motion is certain; they are not added to it.

    Args:
        motion: simulated; what was solved of it is measured.
        scene: the parts as geometry; None loads them.
        tolerance: to which the smallest clearances are wanted, m; None takes 1 % of the cable's diameter.
        stop: asked while the motion is searched between its frames; once True, the rest is left uncertain.
        give_up: asked before each pair; once True, the rest is not measured at all.

    Raises:
        ProblemError: a mesh that cannot be used; a tolerance that is not above 0.
    """
    if tolerance is not None:
        checks.positive("tolerance", tolerance)
    if not motion.cables:
        return ClearanceResult(motion.motion, ())
    from harness_opt.motion.between_frames import BetweenFrames

    scene, apart = load_scene(motion.problem) if scene is None else scene, split(motion)
    between = Between(BetweenFrames(apart), apart.snaps)
    asked = Options(tolerance, stop=stop, give_up=give_up)
    return measure(motion.problem, scene, motion.motion, motion.cables, asked, between)
