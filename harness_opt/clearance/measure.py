"""Smallest clearances of cables over a motion, with the points that a redesign has to push apart.

A clearance is the distance of a cable's centreline to a part, less the cable's radius; to another cable or to
itself, the distance of the two centrelines, less both radii. Negative is penetration.

How they are found stands in ``part_clearance.py`` and ``cable_clearance.py``. Both make the smallest
clearance of the solved frames certain along the whole cable; what the curve between stations misses is
estimated from the curvatures and added to the tolerance. ``part_certificate.py`` and ``cable_certificate.py``
make the smallest clearance certain between the frames too, for pairs that have a limit, where ``measure`` is told
how to solve more frames; ``moving_curve.py`` says what of that is proven and what is estimated.

Near a clamp the cable leaves the very body that holds it: along ``2 (limit + radius)`` from that end, parts
of that body do not count. The result says how long these stretches are.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from harness_opt.clearance.centreline import Curve, cubic_error
from harness_opt.clearance.certify_cable import CableSearch
from harness_opt.clearance.certify_part import PartSearch, Seen
from harness_opt.clearance.moving_centreline import MovingCurve
from harness_opt.clearance.pairs import Between, ClearanceResult, Options, PairClearance
from harness_opt.clearance.solved_frames import SolvedFrames
from harness_opt.clearance.to_cable import CurvePair, against_cable
from harness_opt.clearance.to_part import against_part, places
from harness_opt.clearance.what_counts import least_gap, let_off
from harness_opt.clearance.witnesses import LONG, Certificate, Found, Task, Witnesses, never
from harness_opt.model import checks
from harness_opt.model.bodies import WORLD, Body
from harness_opt.model.cable import End
from harness_opt.model.limits import Obstacle
from harness_opt.model.problem import Problem
from harness_opt.model.results import CableMotion, Motion
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.threads import one_at_a_time
from harness_opt.parts.geometry import Geometry
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

    A cable's clearance to itself counts pairs of its points that lie at least ``pi/2 (diameter + limit)``
    apart along it: so much arc lies between the limbs of a hairpin that stand just the limit apart.

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
    tasks = [_task(problem, name, cable, options or Options()) for name, cable in cables.items()]
    views = _Views(given, between) if between is not None and problem.moves and len(motion) > 1 else None
    pairs: list[PairClearance] = []
    left_out: list[str] = []
    give_up = (options or Options()).give_up or never
    poses = {part.body: problem.poses(part.body, motion) for part in scene.parts.values()}
    for number, own in enumerate(tasks):
        seen: dict[str, Curve] = {}
        for name, geometry in itertools.takewhile(lambda _: not give_up(), scene.parts.items()):
            if geometry.body not in seen:
                if len(seen) == MOST_VIEWS:
                    seen.clear()
                seen[geometry.body] = own.curve.seen_from(*poses[geometry.body])
            task = replace(own, curve=seen[geometry.body], limit=problem.clearance_limit(name))
            excluded = let_off(problem, task, geometry.body)
            if sum(excluded) >= task.curve.s[-1]:
                why = f"all of it lies within {sum(excluded):.3g} m of its clamps on {geometry.body}"
                left_out.append(f"clearance of {own.cable} to {name}: {why}")
                continue
            found = against_part(task, geometry, excluded)
            pair = _pair(given, task, Obstacle(name), found)
            pair = replace(pair, excluded=excluded, closed=geometry.closed)
            if views is not None and task.limit is not None and found.lower is not None:
                pair = _certified(pair, motion, _searched(views, task, geometry, pair, found.lower))
            pairs.append(_in_world(pair, problem, geometry.body, motion))
        if views is not None:
            views.forget(own.cable)
        if problem.limits.clearance is None:
            continue
        for other in itertools.takewhile(lambda _: not give_up(), tasks[number:]):
            # the cubics of both centrelines are off, those of a cable against itself twice
            task = replace(own, limit=problem.limits.clearance, error=own.error + other.error)
            both = CurvePair.of(task, other)
            if both.gap >= task.curve.s[-1]:
                left_out.append(f"clearance of {own.cable} to itself: too short to meet itself")
                continue
            pair = _pair(given, task, Obstacle(other.cable, is_cable=True), against_cable(task, both))
            if views is not None:
                curves = views.curve(own.cable), views.curve(other.cable)
                pair = _certified(pair, motion, CableSearch(task, other, curves, pair.start).certificate())
            pairs.append(pair)
    inserted = {} if views is None else {name: frames.inserted for name, frames in views.frames.items()}
    missing = _unmeasured(problem, scene, len(tasks), len(pairs) + len(left_out))
    return ClearanceResult(motion, tuple(pairs), (*left_out, *missing), inserted, whole=not missing)


def _unmeasured(problem: Problem, scene: Scene, cables: int, done: int) -> tuple[str, ...]:
    """Return a sentence where not all pairs were come to before the run was stopped."""
    others = 0 if problem.limits.clearance is None else cables * (cables + 1) // 2
    left = cables * len(scene.parts) + others - done
    return (f"clearances of {left} pairs: the run was stopped before they were measured",) if left else ()


class _Views:
    """The moving centrelines of all cables, each seen from the bodies that matter; made when first asked for."""

    def __init__(self, given: Motion, between: Between):
        self._problem, motion = given.problem, given.motion
        turns = np.array([0.5]) if given.problem.out_and_back else np.zeros(0)
        self.frames: dict[str, SolvedFrames] = {}
        self._curves: dict[tuple[str, str], MovingCurve] = {}
        for name, shapes in given.cables.items():
            frames = np.array([snap.frame for snap in between.snaps if snap.cable == name], dtype=np.int64)
            jumps = 0.5 * (motion[frames - 1] + motion[frames])
            solved = SolvedFrames(name, motion, shapes, between.solve, jumps=jumps, turns=turns)
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

    def seen(self, cable: str, body: str) -> Seen:
        """Return the centreline of ``cable`` from ``body``: in its coordinates where it carries an end."""
        problem, run = self._problem, self._problem.cables[cable]
        clamps = (self._clamp(run.start, body), self._clamp(run.end, body))
        if body in (run.start.body, run.end.body):
            still = Body().poses, functools.partial(problem.rates, WORLD)
            return Seen(self.curve(cable, body), *still, clamps)
        moving = functools.partial(problem.poses, body), functools.partial(problem.rates, body)
        return Seen(self.curve(cable), *moving, clamps)

    def _clamp(self, end: End, body: str) -> Callable[[Array], Array] | None:
        """Return the way of the clamp that holds ``end``, in the coordinates of ``body``; None where none does."""
        if end.position is None:
            return None
        held = np.asarray(end.position)

        def at(motion: Array) -> Array:
            (p, q), (c, turn) = (self._problem.poses(name, motion) for name in (end.body, body))
            return rotations.rotate(rotations.conjugate(turn), p + rotations.rotate(q, held) - c)

        return at


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


def _searched(views: _Views, task: Task, geometry: Geometry, pair: PairClearance, lower: Array) -> Certificate:
    """Return what a search of the whole motion finds of a pair of a cable and a part."""
    view, arcs = views.seen(task.cable, geometry.body), places(task.curve.s, pair.excluded)
    return PartSearch(task, view, geometry, arcs, pair.start, lower).certificate()


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


def _in_world(pair: PairClearance, problem: Problem, body: str, motion: Array) -> PairClearance:
    """Turn witnesses from the coordinates of ``body`` to the world."""

    def turned(old: Witnesses, at: Array) -> Witnesses:
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

    scene = load_scene(motion.problem) if scene is None else scene
    between = Between(BetweenFrames(motion), motion.snaps)
    return measure(
        motion.problem, scene, motion.motion, motion.cables, Options(tolerance, stop=stop, give_up=give_up), between
    )
