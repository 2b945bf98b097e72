"""The limits of a problem, held against a simulated motion: worst value, margin and where, for each."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from harness_opt.clearance.pairs import ClearanceResult, rows_of_whole_cables
from harness_opt.model.cable import REACH_TOLERANCE
from harness_opt.model.ends import ENDS
from harness_opt.model.limits import CABLE_KINDS, CLAMP_LOADS, CLIP_LOADS, FORCES, LimitId, LimitKind, Obstacle
from harness_opt.model.problem import Problem
from harness_opt.model.results import Holds, LimitResult, Motion, Quantities, at_clip, split
from harness_opt.model.spans import Span, clip_key, in_spans, joints, own_ends, slack, spans_of
from harness_opt.numerics.rotations import Array

LOOKED_AT = "only the stations of the solved frames were looked at"
TENSION = "is just as long as its clamps are apart, so any tension keeps it straight"
FOUND = 1e-7  # lengths of a cable, by which its places in clips may be off between the frames
STRAIGHT = 1e-9  # 1/m; below this curvature the bend radius is given as that of a straight cable


def bending(cable: Quantities) -> Array:
    """Return the curvature of the centreline (P, N), 1/m: the length of the Darboux vector's bending part."""
    found: Array = np.linalg.norm(cable.curvature[..., :2], axis=-1)
    return found


def between_stations(value: Array) -> Array:
    """Return how much a smooth quantity (P, N) may exceed its samples: an eighth of its second differences, (P,)."""
    found: Array = 0.125 * np.max(np.abs(np.diff(value, n=2, axis=1)), axis=1)
    return found


def cable_limits(problem: Problem, motion: Motion) -> tuple[LimitResult, ...]:
    """Return the rows of all limits but clearance: bend radius, twist, clamp force and clamp moment of every cable.

    The rows are not certified: between the stations a value may be worse by ``tolerance``, estimated from second
    differences, and between the frames nothing is known.
    """
    held = problem.changed(found=motion.problem.found)  # other limits, the same places
    apart, rows = split(replace(motion, problem=held)), []
    for which, limit, ends in asked(apart):
        shapes: Quantities = apart.cables[which.cable]
        if which.clip is not None:
            shapes = at_clip(shapes, apart.cables[next(b for _, a, b in joints(apart.problem) if a == which.cable)])
        rows.append(_row(which, limit, shapes, motion.motion, ends))
    return rows_of_whole_cables(spans_of(held), rows)


def asked(motion: Motion) -> Iterator[tuple[LimitId, float, list[int]]]:
    """Yield the limits but clearance of a motion of spans: which, its value, SI, and the ends whose loads it limits."""
    problem = motion.problem
    for name in motion.cables:
        ends = own_ends(problem.cables[name])
        for kind in CABLE_KINDS:
            limit = problem.cable_limit(kind, name)
            if limit is not None and (ends or kind not in CLAMP_LOADS):
                yield LimitId(kind, name), limit, ends
    for clip, before, behind in joints(problem):
        for kind in CLIP_LOADS:
            limit = getattr(problem.limits, kind.value)
            if limit is not None and before in motion.cables and behind in motion.cables:
                yield LimitId(kind, before, clip=clip), limit, [0]


def _row(which: LimitId, limit: float, shapes: Quantities, motion: Array, ends: Sequence[int]) -> LimitResult:
    """Return the row of a limit of one cable, looked at in the stations of the frames ``motion`` (P,) alone."""
    value = _value(which.kind, shapes, ends)
    frame, station = np.unravel_index(int(np.argmax(value)), value.shape)
    worst = float(value[frame, station])
    loads = (*CLAMP_LOADS, *CLIP_LOADS)
    tolerance = 0.0 if which.kind in loads else float(np.max(between_stations(value)))
    if which.kind is LimitKind.BEND_RADIUS:
        worst = 1.0 / max(worst, STRAIGHT)
        tolerance *= worst**2
    return LimitResult(
        id=which,
        limit=limit,
        worst=worst,
        margin=worst - limit if which.kind.is_least else limit - worst,
        frame=int(frame),
        motion=float(motion[frame]),
        arc_length=float(shapes.s[station]),
        certified=False,
        tolerance=tolerance,
        reason=LOOKED_AT,
    )


def _value(kind: LimitKind, shapes: Quantities, ends: Sequence[int]) -> Array:
    """Return what a limit of ``kind`` is about, (P, N), large where it is bad: of a bend radius the curvature."""
    if kind is LimitKind.BEND_RADIUS:
        return bending(shapes)
    if kind is LimitKind.TWIST:
        return np.abs(shapes.curvature[..., 2])
    load = shapes.force if kind in FORCES else shapes.moment
    at_ends = np.zeros(load.shape[:2])
    at_ends[:, list(ends)] = np.linalg.norm(load[:, list(ends)], axis=-1)
    return at_ends


def all_limits(problem: Problem, motion: Motion, clearances: ClearanceResult) -> tuple[LimitResult, ...]:
    """Return the rows of every limit of ``problem``, certain between the frames where ``clearances`` are."""
    others = clearances.cable_limits
    rows = through_themselves(problem, motion, clearances.limits)
    others = cable_limits(problem, motion) if others is None else others
    return (*rows, *_known_tensions(motion, others), *_travels(problem, motion))


def _travels(problem: Problem, motion: Motion) -> Iterator[LimitResult]:
    """Yield how far cables slide back and forth through their clips, certain but where one jumps.

    Where a cable stands in a clip is known between the frames as well as in them, as a spline.
    """
    limit, between = problem.limits.travel, 8  # places looked at from one known place to the next
    if limit is None or not len(motion.motion):
        return
    for cable, clip in [(name, clip) for name, run in problem.cables.items() for clip in run.clips if clip.slides]:
        found = motion.problem.found[clip_key(cable, clip.name)]
        knots = found.motion
        steps = np.linspace(knots[:-1], knots[1:], between, axis=1).ravel() if len(knots) > 1 else knots
        at = np.union1d(steps, knots)
        places = found.arc_lengths(at)
        worst, frame = float(np.ptp(places)), int(np.argmax(places))
        # a cubic strays from its samples by an eighth of their second difference
        bend = float(np.max(np.abs(np.diff(places, 2)), initial=0.0)) / 8.0
        yield LimitResult(
            id=LimitId(LimitKind.TRAVEL, cable, clip=clip.name),
            limit=limit,
            worst=worst,
            margin=limit - worst,
            frame=int(np.argmin(np.abs(motion.motion - at[frame]))),
            motion=float(at[frame]),
            arc_length=float(places[frame]),
            certified=not found.jumps,
            tolerance=2.0 * bend + FOUND * problem.cables[cable].cable.length,
            reason=f"{cable} jumps in clip {clip.name}" if found.jumps else "",
        )


def _known_tensions(motion: Motion, rows: Iterable[LimitResult]) -> Iterator[LimitResult]:
    """Yield ``rows``, those of forces that a straight span pulls with not certified: any tension keeps it straight."""
    straight: dict[LimitId, Span] = {}
    apart = in_spans(motion.problem)
    for span in spans_of(motion.problem).values():
        spare = slack(apart, span, motion.motion)
        if spare is None or np.min(spare, initial=np.inf) > REACH_TOLERANCE * (span.last - span.first):
            continue
        for clamp in span.clamps:
            kind = LimitKind.CLAMP_FORCE if clamp in ENDS else LimitKind.CLIP_FORCE
            straight[LimitId(kind, span.cable, clip=None if clamp in ENDS else clamp)] = span
    for row in rows:
        taut = straight.get(row.id)
        yield row if taut is None else replace(row, certified=False, reason=f"{taut.name} {TENSION}")


def through_themselves(problem: Problem, motion: Motion, rows: Sequence[LimitResult]) -> tuple[LimitResult, ...]:
    """Return the rows of clearances, those of cables to themselves as bad as can be where a cable goes through itself.

    Its turns tell, whatever the frames show: where two stretches of it pass through each other their centrelines
    meet, a diameter too near, and no frame needs to be there to be certain.
    """
    limit, found = problem.limits.clearance, {row.id: row for row in rows}
    for name, (frame, at) in motion.through_themselves.items():
        itself = LimitId(LimitKind.CLEARANCE, name, Obstacle(name, is_cable=True))
        worst = -problem.cables[name].cable.diameter
        if limit is not None:
            found[itself] = LimitResult(
                id=itself,
                limit=limit,
                worst=worst,
                margin=worst - limit,
                frame=frame,
                motion=at,
                arc_length=0.5 * problem.cables[name].cable.length,
                certified=True,
                tolerance=0.0,
            )
    return tuple(found.values())


def all_hold(rows: Iterable[LimitResult]) -> Holds:
    """Return whether every limit holds; a "no" outranks an "uncertain"."""
    answers = {row.holds for row in rows}
    return "no" if "no" in answers else "uncertain" if "uncertain" in answers else "yes"


def most_urgent(problem: Problem, rows: Sequence[LimitResult]) -> LimitResult:
    """Return the row that people look at first.

    A violated limit comes before one that holds, clearance before bend radius before the rest, and then the smallest
    margin.

    Args:
        problem: whose limits they are.
        rows: at least one.
    """
    order = {LimitKind.CLEARANCE: 0, LimitKind.BEND_RADIUS: 1}

    def urgency(row: LimitResult) -> tuple[bool, int, float]:
        scale = row.limit + problem.cables[row.cable].cable.radius
        return row.margin >= 0, order.get(row.id.kind, 2), row.margin / scale

    return min(rows, key=urgency)
