"""Spans: the stretches of a cable between two of its clamps, each a cable of its own, and whether they reach.

A clip holds position and section frame, so what lies on one side of it does not feel the other: the spans are solved,
measured and linearised one by one, as cables without clips are.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from harness_opt.model.cable import REACH_TOLERANCE, CableRun
from harness_opt.model.ends import Clip, End
from harness_opt.model.limits import LimitId, Obstacle, quoted
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array

Problem = Any  # asks while it is made whether its cables reach
SAMPLES = 201  # moments at which the distance of a cable's clamps is compared with its length


@dataclass(frozen=True)
class Span:
    """A stretch of a cable between two of its clamps.

    Args:
        name: of the cable that it is on its own, in :func:`in_spans`.
        cable: name of the whole cable.
        clamps: names of what holds it, such as ``("start", "elbow")``.
        first, last: arc lengths of these along the whole cable, m.
    """

    name: str
    cable: str
    clamps: tuple[str, str]
    first: float
    last: float


def spans_of(problem: Problem) -> dict[str, Span]:
    """Return the spans of all cables, along each, by name; a cable without clips is one span, of its own name.

    Where the cable slides through a clip, they are those of the first frame, once it is known.
    """
    found = {}
    for cable, run in problem.cables.items():
        names = list(run.clamps)
        places = [0.0, *(_place(problem, cable, clip) for clip in run.clips), run.cable.length]
        for k in range(len(names) - 1):
            name = f"{cable}, {names[k]} to {names[k + 1]}" if run.clips else cable
            found[name] = Span(name, cable, (names[k], names[k + 1]), places[k], places[k + 1])
    return found


def _place(problem: Problem, cable: str, clip: Clip) -> float:
    """Return the arc length at which ``cable`` stands in a clip, m: in the first frame, where it slides through it."""
    found = problem.found.get(clip_key(cable, clip.name))
    return clip.at if found is None or found.places is None else float(found.places[0])


def has_clips(problem: Problem) -> bool:
    """Whether any cable is clipped on its way."""
    return any(run.clips for run in problem.cables.values())


def in_spans(problem: Problem) -> Problem:
    """Return the problem whose cables are the spans of those of ``problem``; itself where no cable has clips.

    The roll of a clip that is fitted untwisted is found with the span before it: see :func:`carried`.
    """
    if not has_clips(problem):
        return problem
    runs = {}
    for span in spans_of(problem).values():
        run = problem.cables[span.cable]
        start, end = (
            dataclasses.replace(clamp, at=place) if isinstance(clamp, Clip) else clamp
            for clamp, place in zip((run.clamps[name] for name in span.clamps), (span.first, span.last), strict=True)
        )
        cable = dataclasses.replace(run.cable, length=span.last - span.first)
        if isinstance(start, Clip):
            start = dataclasses.replace(start.held(), turns=0)
        if isinstance(end, Clip) and end.kind != "fixed":
            end = end.held()
        start, end = (
            clamp.held(rotations.IDENTITY) if isinstance(clamp, Clip) and clamp.frame is None else clamp
            for clamp in (start, end)
        )
        own = CableRun(cable, start, end, run.bow, run.fitted_at, bend_radius=run.bend_radius)
        found = (problem.found.get(clip_key(span.cable, name)) for name in span.clamps)
        runs[span.name] = own.found_in(*found)
    return problem.changed(cables=runs)


def clip_key(cable: str, clip: str) -> str:
    """Return what the frames of a clip that lets the cable turn are called: no body is, for the comma."""
    return f"{cable}, {clip}"


def own_ends(run: CableRun) -> list[int]:
    """Return which ends of a span are its cable's own, and no clip: 0 for its start, -1 for its end."""
    return [number for number, end in ((0, run.start), (-1, run.end)) if not isinstance(end, Clip)]


def joints(problem: Problem) -> Iterator[tuple[str, str, str]]:
    """Yield the clips of a problem of :func:`in_spans`: name, span before, span behind; those of spans follow each
    other.
    """
    for before, behind in itertools.pairwise(problem.cables):
        clip = problem.cables[before].end
        if isinstance(clip, Clip):
            yield clip.name, before, behind


def whole(spans: Mapping[str, Span], which: LimitId) -> LimitId:
    """Return the limit of a whole cable that a limit of one of its ``spans`` is."""
    obstacle = which.obstacle
    if obstacle is not None and obstacle.is_cable:
        obstacle = Obstacle(spans[obstacle.name].cable, is_cable=True)
    return dataclasses.replace(which, cable=spans[which.cable].cable, obstacle=obstacle)


def carried(
    problem: Problem, spans: Mapping[str, Span], name: str, at: float, frame: Array, clamp: End | None = None
) -> Problem:
    """Return a problem of spans with the roll of a clip as it was found, for the span behind it.

    Args:
        problem: of :func:`in_spans`.
        spans: of the whole problem.
        name: of the span that ends at the clip; nothing is to be done where it ends at none, or at one whose roll is
            given.
        at: motion value, 0 to 1.
        frame: section frame (4,) at its end there, in the world.
        clamp: that end as described; None takes that of the problem, which is held already in a harness.
    """
    here, run = spans[name], problem.cables[name]
    behind = [span for span in spans.values() if span.cable == here.cable and span.clamps[0] == here.clamps[1]]
    if not behind or (clamp or run.end).roll != "untwisted":
        return problem
    body = problem.poses(run.end.body, [at])[1][0]
    own = rotations.multiply(rotations.conjugate(body), rotations.normalise(frame))
    there = problem.cables[behind[0].name]
    there = dataclasses.replace(there, start=there.start.held(own))
    return problem.changed(cables={**problem.cables, behind[0].name: there})


def clamp_way(problem: Problem, cable: str, motion: ArrayLike) -> Array | None:
    """Return the way (P, 3) from the start of ``cable`` to its end, m, at ``motion`` (P,).

    None with a free end, or one on a free body that is not found yet.
    """
    run, places = problem.cables[cable], []
    for end in (run.start, run.end):
        if end.position is None or not problem.is_placed(end.body):
            return None
        origin, turn = problem.poses(end.body, motion)
        places.append(origin + rotations.rotate(turn, np.broadcast_to(np.asarray(end.position), origin.shape)))
    way: Array = places[1] - places[0]
    return way


def shortest(problem: Problem, cable: str) -> tuple[float, float]:
    """Return how long ``cable`` has to be at least to reach its clamps, m, and the motion value that asks for it."""
    motion = np.linspace(0.0, 1.0, SAMPLES)
    way = clamp_way(problem, cable, motion)
    if way is None:
        return 0.0, 0.0
    distance = np.linalg.norm(way, axis=1)
    worst = int(np.argmax(distance))
    return float(distance[worst]), float(motion[worst])


def slack(problem: Problem, span: Span, motion: Array) -> Array | None:
    """Return by how much a span of ``problem``, which is in spans, is longer than its clamps are apart, (P,), m."""
    way = clamp_way(problem, span.name, motion)
    return None if way is None else np.asarray(problem.lengths(span.name, motion) - np.linalg.norm(way, axis=1))


@dataclass(frozen=True)
class TooShort:
    """A stretch of a cable that is too short for its clamps, with the clips between them that it slides through.

    Args:
        spans: of the stretch, by name.
        message: what is wrong, for the user.
        by: how much is missing, m.
    """

    spans: tuple[str, ...]
    message: str
    by: float


def too_short(problem: Problem, cables: Iterable[str]) -> list[TooShort]:
    """Return the stretches of ``cables`` that are too short for their clamps at some moment, along each."""
    found, names, apart, row = list[TooShort](), set(cables), in_spans(problem), list[Span]()
    motion = np.linspace(0.0, 1.0, SAMPLES)
    for span in spans_of(problem).values():
        row.append(span)
        clamp = problem.cables[span.cable].clamps[span.clamps[1]]
        if isinstance(clamp, Clip) and clamp.slides:
            continue
        ways = [clamp_way(apart, one.name, motion) for one in row]
        distance = np.sum([np.linalg.norm(way, axis=1) for way in ways if way is not None], axis=0) + np.zeros(SAMPLES)
        worst, length = int(np.argmax(distance)), span.last - row[0].first
        if span.cable in names and not distance[worst] <= length * (1 + REACH_TOLERANCE):
            key, between, whose = f"cables.{quoted(span.cable)}.length", "", "its clamps"
            if span.name != span.cable:
                between, whose = f" from {row[0].clamps[0]} to {span.clamps[1]}", "the two"
            through = "" if len(row) == 1 else f" through {', '.join(one.clamps[1] for one in row[:-1])}"
            words = f"expected at least {distance[worst]:.6g}, the distance between {whose}{through}"
            when = problem.moments.words(float(motion[worst]))
            message = f"{key}: found {length:g}{between}, {words} at {when}"
            found.append(TooShort(tuple(one.name for one in row), message, float(distance[worst]) - length))
        row = []
    return found
