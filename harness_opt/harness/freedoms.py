"""What is free in a harness: bodies that hang on their cables, and clips that let the cable turn; and its spans' ends.

A step of it is, for each free body, the way of its origin and a small rotation about that, both in the world; for each
clip, a small rotation: about its tangent, or all three. What a body carries goes along.
"""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from harness_opt.model.bodies import WORLD, composed, seen_from
from harness_opt.model.cable import Clip, End
from harness_opt.model.courses import FoundPoses
from harness_opt.model.problem import Problem
from harness_opt.model.spans import clip_key, spans_of
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array

BODY = 6  # freedoms of a body


@dataclass(frozen=True)
class SpanEnd:
    """One end of a span.

    Args:
        carrier: number of the free body that carries it; None where none does.
        clip: number of the clip whose turning is free; None where none is.
    """

    carrier: int | None
    clip: int | None


@dataclass(frozen=True)
class FreeClip:
    """A clip that lets the cable turn.

    Args:
        key: see :func:`~harness_opt.model.spans.clip_key`.
        clip: as described.
        carrier: as of a :class:`SpanEnd`.
    """

    key: str
    clip: Clip
    carrier: int | None


@dataclass(frozen=True)
class Pose:
    """Where the free bodies stand, and how the cable stands in the free clips, as their bodies see it.

    Args:
        positions, quaternions: of the bodies in the world, (b, 3), m, and (b, 4).
        frames: of the section in the clips, in the coordinates of each clip's body, (c, 4).
    """

    positions: Array
    quaternions: Array
    frames: Array

    def ahead(self, before: Pose, ratio: float) -> Pose:
        """Return where steps like that from ``before`` lead: ``ratio`` times as far on."""

        def on(now: Array, then: Array) -> Array:
            step = rotations.small_rotation_vector(rotations.multiply(now, rotations.conjugate(then)))
            return rotations.multiply(rotations.from_rotation_vector(ratio * step), now)

        positions = self.positions + ratio * (self.positions - before.positions)
        return Pose(positions, on(self.quaternions, before.quaternions), on(self.frames, before.frames))


@dataclass(frozen=True)
class PlacedEnds:
    """The ends of all spans in the world.

    Args:
        positions, frames: (S, 2, 3), m, and (S, 2, 4); NaN where an end has none.
        clips: frames of the free clips in the world, (c, 4).
    """

    positions: Array
    frames: Array
    clips: Array


class Freedoms:
    """The freedoms of one harness: spans that free bodies and clips couple.

    Args:
        apart: the problem in spans.
        whole: the same of whole cables.
        spans: names of those that are coupled.
    """

    def __init__(self, apart: Problem, whole: Problem, spans: Sequence[str]):
        self.problem, self.spans = apart, tuple(spans)
        known, clips = spans_of(whole), dict[str, FreeClip]()
        self.bodies = tuple(dict.fromkeys(name for span in spans for name in _free_bodies(apart, span)))
        rows = []
        for span in spans:
            run, ends = apart.cables[span], []
            for end, name in zip((run.start, run.end), known[span].clamps, strict=True):
                root = root_of(apart, end.body)
                carrier = self.bodies.index(root) if root in self.bodies else None
                clip = whole.cables[known[span].cable].clamps[name]
                key = clip_key(known[span].cable, name)
                if isinstance(clip, Clip) and clip.freedoms:
                    clips.setdefault(key, FreeClip(key, clip, carrier))
                ends.append(SpanEnd(carrier, list(clips).index(key) if key in clips else None))
            rows.append((ends[0], ends[1]))
        self.ends: tuple[tuple[SpanEnd, SpanEnd], ...] = tuple(rows)
        self.clips = tuple(clips.values())
        counts = [BODY] * len(self.bodies) + [clip.clip.freedoms for clip in self.clips]
        self.places = np.concatenate([[0], np.cumsum(counts)]).astype(int)  # of their first freedom

    def of(self, apart: Problem) -> Freedoms:
        """Return the same freedoms of another problem in spans, with other rolls."""
        other = copy.copy(self)
        other.problem = apart
        return other

    @property
    def size(self) -> int:
        """How many freedoms there are."""
        return int(self.places[-1])

    def lengths(self) -> Array:
        """Return the lengths of the spans, (S,), m."""
        return np.array([self.problem.cables[span].cable.length for span in self.spans])

    def of_body(self, body: int) -> slice:
        """Return which freedoms are a body's, by its number."""
        return slice(self.places[body], self.places[body] + BODY)

    def of_clip(self, clip: int) -> slice:
        """Return which freedoms are a clip's, by its number."""
        number = len(self.bodies) + clip
        return slice(self.places[number], self.places[number + 1])

    def placed(self, pose: Pose, at: float) -> PlacedEnds:
        """Return the ends of the spans at ``pose`` and motion value ``at``."""
        positions, frames = np.full((len(self.spans), 2, 3), np.nan), np.full((len(self.spans), 2, 4), np.nan)
        clips = np.zeros((len(self.clips), 4))
        for k, (span, ends) in enumerate(zip(self.spans, self.ends, strict=True)):
            run = self.problem.cables[span]
            for side, (described, end) in enumerate(zip((run.start, run.end), ends, strict=True)):
                stands = self._stands(described, end.carrier, pose, at)
                if described.position is not None:
                    positions[k, side] = stands[0] + rotations.rotate(stands[1], described.position)
                if end.clip is not None:
                    clips[end.clip] = frames[k, side] = rotations.multiply(stands[1], pose.frames[end.clip])
                elif described.frame is not None:
                    frames[k, side] = rotations.multiply(stands[1], described.frame)
        return PlacedEnds(positions, frames, clips)

    def _stands(self, end: End, carrier: int | None, pose: Pose, at: float) -> tuple[Array, Array]:
        """Return the position (3,) and the quaternion (4,) of the body that carries an end."""
        stands = tuple(array[0] for array in self.problem.poses(end.body, [at]))
        if carrier is None:
            return stands[0], stands[1]
        root = self.problem.body(self.bodies[carrier]).poses([at])
        inside = seen_from(root, (stands[0][None], stands[1][None]))
        here = pose.positions[carrier][None], pose.quaternions[carrier][None]
        position, quaternion = composed(here, inside)
        return position[0], quaternion[0]

    def moved(self, pose: Pose, step: Array, placed: PlacedEnds) -> Pose:
        """Return ``pose``, whose ends are ``placed``, after a ``step`` (n,) in all freedoms."""
        positions, quaternions, frames = (array.copy() for array in (pose.positions, pose.quaternions, pose.frames))
        for body in range(len(self.bodies)):
            own = step[self.of_body(body)]
            positions[body] += own[:3]
            turn = rotations.from_rotation_vector(own[3:])
            quaternions[body] = rotations.normalise(rotations.multiply(turn, quaternions[body]))
        for number, clip in enumerate(self.clips):
            own = step[self.of_clip(number)]
            world = placed.clips[number]
            turn = own if clip.clip.freedoms > 1 else own[0] * rotations.tangent(world)
            carried = rotations.multiply(world, rotations.conjugate(pose.frames[number]))  # the body's own frame
            turned = rotations.multiply(rotations.from_rotation_vector(turn), world)
            frames[number] = rotations.normalise(rotations.multiply(rotations.conjugate(carried), turned))
        return Pose(positions, quaternions, frames)

    def found(self, motion: Array, poses: Sequence[Pose], jumps: Sequence[int] = ()) -> dict[str, FoundPoses]:
        """Return where everything was found over ``motion`` (P,), as :func:`~harness_opt.model.spans.in_spans` asks."""
        kept, found = tuple(jumps), dict[str, FoundPoses]()
        for number, name in enumerate(self.bodies):
            positions = np.array([pose.positions[number] for pose in poses])
            quaternions = np.array([pose.quaternions[number] for pose in poses])
            found[name] = FoundPoses(motion, positions, quaternions, kept)
        for number, clip in enumerate(self.clips):
            frames = np.array([pose.frames[number] for pose in poses])
            still = np.tile(np.asarray(clip.clip.position, dtype=float), (len(poses), 1))
            found[clip.key] = FoundPoses(motion, still, frames, kept)
        return found


def root_of(problem: Problem, body: str) -> str:
    """Return the body that carries ``body`` at last: itself where none does."""
    while body != WORLD and problem.bodies[body].parent != WORLD:
        body = problem.bodies[body].parent
    return body


def _free_bodies(apart: Problem, span: str) -> list[str]:
    """Return the free bodies that carry the ends of a span."""
    run = apart.cables[span]
    roots = [root_of(apart, end.body) for end in (run.start, run.end)]
    return [root for root in roots if root != WORLD and apart.bodies[root].free]


def harnesses(apart: Problem, whole: Problem) -> list[Freedoms]:
    """Return the harnesses of a problem: its spans in groups that free bodies and clips couple, those alone left out.

    Args:
        apart: in spans.
        whole: of whole cables.
    """
    joints = {span: _joints(apart, whole, span) for span in spans_of(whole)}
    parent = {span: span for span, own in joints.items() if own}

    def first(span: str) -> str:
        while parent[span] != span:
            span = parent[span]
        return span

    holders = dict[str, str]()
    for span in parent:
        for joint in joints[span]:
            parent[first(span)] = first(holders.setdefault(joint, span))
    found = dict[str, list[str]]()
    for span in parent:
        found.setdefault(first(span), []).append(span)
    return [Freedoms(apart, whole, spans) for spans in found.values()]


def _joints(apart: Problem, whole: Problem, span: str) -> list[str]:
    """Return what couples a span to others: free bodies that carry its ends, and clips that let the cable turn."""
    known = spans_of(whole)[span]
    clamps = whole.cables[known.cable].clamps
    keys = [(clamps[name], clip_key(known.cable, name)) for name in known.clamps]
    return [*_free_bodies(apart, span), *(key for clamp, key in keys if isinstance(clamp, Clip) and clamp.freedoms)]


def drawn(freedoms: Freedoms) -> Pose:
    """Return the pose that the problem describes: bodies at their guesses, the cable in its clips as drawn."""
    bodies = [freedoms.problem.body(name) for name in freedoms.bodies]
    frames = [np.asarray(clip.clip.frame or rotations.IDENTITY, dtype=float) for clip in freedoms.clips]
    return Pose(
        np.array([body.position for body in bodies], dtype=float).reshape(-1, 3),
        np.array([body.quaternion for body in bodies], dtype=float).reshape(-1, 4),
        np.array(frames).reshape(-1, 4),
    )


def with_found(freedoms: Freedoms, problem: Problem, found: Mapping[str, FoundPoses]) -> Problem:
    """Return the problem in spans with everything where it was ``found``."""
    runs = dict(problem.cables)
    for span, ends in zip(freedoms.spans, freedoms.ends, strict=True):
        held = {
            side: dataclasses.replace(getattr(runs[span], side), found=found[freedoms.clips[end.clip].key])
            for side, end in zip(("start", "end"), ends, strict=True)
            if end.clip is not None
        }
        runs[span] = dataclasses.replace(runs[span], **held)
    bodies = {name: dataclasses.replace(problem.bodies[name], found=found[name]) for name in freedoms.bodies}
    return problem.changed(cables=runs, bodies={**problem.bodies, **bodies})
