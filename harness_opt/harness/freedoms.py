"""What is free in a harness: bodies that hang on their cables, and clips that let the cable turn; and its spans' ends.

A step of it is, for each free body, the way of its origin and a small rotation about that, both in the world; for each
clip, a small rotation, about its tangent or all three, and by how much the cable slides on in it. What a body carries
goes along.
"""

from __future__ import annotations

import copy
import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness_opt.model.bodies import WORLD, seen_from
from harness_opt.model.courses import FoundPoses
from harness_opt.model.ends import Clip, End
from harness_opt.model.problem import Problem
from harness_opt.model.spans import clip_key, spans_of
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices

BODY = 6  # freedoms of a body


@dataclass(frozen=True)
class SpanEnd:
    """One end of a span.

    Args:
        carrier: number of the free body that carries it; None where none does.
        clip: number of the clip that leaves the cable free there; None where none does.
    """

    carrier: int | None
    clip: int | None


@dataclass(frozen=True)
class FreeClip:
    """A clip that lets the cable turn or slide.

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
        places: arc lengths of the cables in the clips, (c,), m.
    """

    positions: Array
    quaternions: Array
    frames: Array
    places: Array

    @staticmethod
    def weighted(poses: Sequence[Pose], weights: Array) -> Pose:
        """Return the sum of ``poses`` by ``weights`` (k,), which sum up to 1; turns are taken from the last of them."""
        last = poses[-1]

        def turned(quaternions: Sequence[Array]) -> Array:
            ways = [
                rotations.small_rotation_vector(rotations.multiply(q, rotations.conjugate(quaternions[-1])))
                for q in quaternions
            ]
            turn = np.einsum("k,kbi->bi", weights, np.array(ways))
            return rotations.multiply(rotations.from_rotation_vector(turn), quaternions[-1])

        return Pose(
            np.einsum("k,kbi->bi", weights, np.array([pose.positions for pose in poses])),
            turned([pose.quaternions for pose in poses]) if len(last.quaternions) else last.quaternions,
            turned([pose.frames for pose in poses]) if len(last.frames) else last.frames,
            weights @ np.array([pose.places for pose in poses]),
        )


@dataclass(frozen=True)
class PlacedEnds:
    """The ends of all spans in the world.

    Args:
        positions, frames: (S, 2, 3), m, and (S, 2, 4); NaN where an end has none.
        lengths: of the spans, (S,), m.
        clips: frames of the free clips in the world, (c, 4).
    """

    positions: Array
    frames: Array
    lengths: Array
    clips: Array


@dataclass(frozen=True)
class HeldEnds:
    """What holds the ends of all spans, as arrays.

    Args:
        names: of the bodies that carry any, u of them.
        carriers: number of the free body that each hangs on; None where it does on none.
        bodies: of the ends, by their number, (S, 2).
        positions, frames: in the coordinates of these, (S, 2, 3), m, and (S, 2, 4); NaN where an end has none.
    """

    names: Sequence[str]
    carriers: Sequence[int | None]
    bodies: Indices
    positions: Array
    frames: Array


class Freedoms:
    """The freedoms of one harness: spans that free bodies and clips couple.

    Args:
        apart: the problem in spans.
        whole: the same of whole cables.
        spans: names of those that are coupled.
    """

    def __init__(self, apart: Problem, whole: Problem, spans: Sequence[str]):
        self.problem, self.spans = apart, tuple(spans)
        self._stood: tuple[float, Array, Array] | None = None  # where bodies stand at the motion value last asked for
        known, clips = spans_of(whole), dict[str, FreeClip]()
        self.bodies = tuple(dict.fromkeys(name for span in spans for name in _free_bodies(apart, span)))
        rows = []
        for span in spans:
            run, ends = apart.cables[span], []
            for end, name in zip((run.start, run.end), known[span].clamps, strict=True):
                root = apart.root(end.body)
                carrier = self.bodies.index(root) if root in self.bodies else None
                clip = whole.cables[known[span].cable].clamps[name]
                key = clip_key(known[span].cable, name)
                if isinstance(clip, Clip) and clip.is_free:
                    clips.setdefault(key, FreeClip(key, clip, carrier))
                ends.append(SpanEnd(carrier, list(clips).index(key) if key in clips else None))
            rows.append((ends[0], ends[1]))
        self.ends: tuple[tuple[SpanEnd, SpanEnd], ...] = tuple(rows)
        self.clips = tuple(clips.values())
        counts = [BODY] * len(self.bodies) + [clip.clip.freedoms + clip.clip.slides for clip in self.clips]
        self.places = np.concatenate([[0], np.cumsum(counts)]).astype(int)  # of their first freedom

    def of(self, apart: Problem) -> Freedoms:
        """Return the same freedoms of another problem in spans, with other rolls."""
        other = copy.copy(self)
        other.problem, other._stood = apart, None
        vars(other).pop("_held", None)
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
        """Return which freedoms are a clip's rotations, by its number."""
        first = self.places[len(self.bodies) + clip]
        return slice(first, first + self.clips[clip].clip.freedoms)

    def slide_of(self, clip: int) -> int | None:
        """Return which freedom is the cable's sliding in a clip, by its number; None where it is held."""
        return int(self.of_clip(clip).stop) if self.clips[clip].clip.slides else None

    def placed(self, pose: Pose, at: float) -> PlacedEnds:
        """Return the ends of the spans at ``pose`` and motion value ``at``."""
        held, (stood, turned) = self._held, self._standing(at)
        for body, number in enumerate(held.carriers):
            if number is not None:
                carrier = pose.positions[number], pose.quaternions[number]
                stood[body] = carrier[0] + rotations.rotate(carrier[1], stood[body])
                turned[body] = rotations.multiply(carrier[1], turned[body])
        positions = stood[held.bodies] + rotations.rotate(turned[held.bodies], held.positions)
        frames = rotations.multiply(turned[held.bodies], held.frames)
        clips, lengths = np.zeros((len(self.clips), 4)), self.lengths()
        for span, ends in enumerate(self.ends):
            for side, end in enumerate(ends):
                if end.clip is not None:
                    clips[end.clip] = rotations.multiply(turned[held.bodies[span, side]], pose.frames[end.clip])
                    frames[span, side] = clips[end.clip]
                    clip = self.clips[end.clip].clip
                    slid = pose.places[end.clip] - clip.at if clip.slides else 0.0
                    lengths[span] += slid if side else -slid
        return PlacedEnds(positions, frames, lengths, clips)

    def _standing(self, at: float) -> tuple[Array, Array]:
        """Return where the bodies of :class:`HeldEnds` stand, as what carries them sees it, (u, 3), (u, 4)."""
        if self._stood is None or self._stood[0] != at:
            poses = []
            for name, carrier in zip(self._held.names, self._held.carriers, strict=True):
                stands = self.problem.poses(name, [at])
                if carrier is not None:
                    stands = seen_from(self.problem.body(self.bodies[carrier]).poses([at]), stands)
                poses.append(stands)
            self._stood = at, np.concatenate([pose[0] for pose in poses]), np.concatenate([pose[1] for pose in poses])
        return self._stood[1].copy(), self._stood[2].copy()

    @functools.cached_property
    def _held(self) -> HeldEnds:
        names = list(dict.fromkeys(end.body for span in self.spans for end in self._both(span)))
        roots = [self.problem.root(name) for name in names]
        ends = [self._both(span) for span in self.spans]
        none = np.full(4, np.nan)
        return HeldEnds(
            names,
            [self.bodies.index(root) if root in self.bodies else None for root in roots],
            np.array([[names.index(end.body) for end in both] for both in ends]),
            np.array([[none[:3] if end.position is None else end.position for end in both] for both in ends]),
            np.array([[none if end.frame is None else end.frame for end in both] for both in ends]),
        )

    def _both(self, span: str) -> tuple[End, End]:
        run = self.problem.cables[span]
        return run.start, run.end

    def moved(self, pose: Pose, step: Array, placed: PlacedEnds) -> Pose:
        """Return ``pose``, whose ends are ``placed``, after a ``step`` (n,) in all freedoms."""
        positions, quaternions, frames, places = (array.copy() for array in vars(pose).values())
        for body in range(len(self.bodies)):
            own = step[self.of_body(body)]
            positions[body] += own[:3]
            turn = rotations.from_rotation_vector(own[3:])
            quaternions[body] = rotations.normalise(rotations.multiply(turn, quaternions[body]))
        for number, clip in enumerate(self.clips):
            own, slide = step[self.of_clip(number)], self.slide_of(number)
            if slide is not None:
                places[number] += step[slide]
            if not len(own):
                continue
            world = placed.clips[number]
            turn = own if clip.clip.freedoms > 1 else own[0] * rotations.tangent(world)
            carried = rotations.multiply(world, rotations.conjugate(pose.frames[number]))  # the body's own frame
            turned = rotations.multiply(rotations.from_rotation_vector(turn), world)
            frames[number] = rotations.normalise(rotations.multiply(rotations.conjugate(carried), turned))
        return Pose(positions, quaternions, frames, places)

    def adapted(self, pose: Pose) -> Pose:
        """Return a ``pose`` of a like harness with the cable along the tangents that this one's clips hold."""
        frames = pose.frames.copy()
        for number, clip in enumerate(self.clips):
            drawn = clip.clip.frame
            if drawn is None or clip.clip.freedoms > 1:
                continue
            turn = rotations.shortest_arc(rotations.tangent(frames[number]), rotations.tangent(drawn))
            frames[number] = drawn if not clip.clip.freedoms else rotations.multiply(turn, frames[number])
        return replace(pose, frames=frames)

    def found(
        self, motion: Array, poses: Sequence[Pose], jumps: tuple[int, ...] = (), kinks: tuple[int, ...] = ()
    ) -> dict[str, FoundPoses]:
        """Return where everything was found over ``motion`` (P,), by name; arguments as of :class:`FoundPoses`."""
        found = dict[str, FoundPoses]()
        for number, name in enumerate(self.bodies):
            positions = np.array([pose.positions[number] for pose in poses])
            quaternions = np.array([pose.quaternions[number] for pose in poses])
            found[name] = FoundPoses(motion, positions, quaternions, jumps, kinks)
        for number, clip in enumerate(self.clips):
            frames = np.array([pose.frames[number] for pose in poses])
            still = np.tile(np.asarray(clip.clip.position, dtype=float), (len(poses), 1))
            places = np.array([pose.places[number] for pose in poses]) if clip.clip.slides else None
            found[clip.key] = FoundPoses(motion, still, frames, jumps, kinks, places)
        return found


def _free_bodies(apart: Problem, span: str) -> list[str]:
    """Return the free bodies that carry the ends of a span."""
    run = apart.cables[span]
    roots = [apart.root(end.body) for end in (run.start, run.end)]
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
    return [*_free_bodies(apart, span), *(key for clamp, key in keys if isinstance(clamp, Clip) and clamp.is_free)]


def drawn(freedoms: Freedoms) -> Pose:
    """Return the pose that the problem describes: bodies at their guesses, the cable in its clips as drawn."""
    bodies = [freedoms.problem.body(name) for name in freedoms.bodies]
    frames = [np.asarray(clip.clip.frame or rotations.IDENTITY, dtype=float) for clip in freedoms.clips]
    return Pose(
        np.array([body.position for body in bodies], dtype=float).reshape(-1, 3),
        np.array([body.quaternion for body in bodies], dtype=float).reshape(-1, 4),
        np.array(frames).reshape(-1, 4),
        np.array([clip.clip.at for clip in freedoms.clips]),
    )


def with_found(freedoms: Freedoms, problem: Problem, found: Mapping[str, FoundPoses]) -> Problem:
    """Return the problem in spans with everything where it was ``found``."""
    runs = dict(problem.cables)
    for span, ends in zip(freedoms.spans, freedoms.ends, strict=True):
        clips = (None if end.clip is None else found[freedoms.clips[end.clip].key] for end in ends)
        runs[span] = runs[span].found_in(*clips)
    return problem.changed(cables=runs, found={**problem.found, **found})
