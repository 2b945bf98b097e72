"""What a user describes: cables, their ends, bodies that move, parts to stay clear of, limits, design variables.

SI units and radians. Poses take section or body coordinates to the world; quaternions are scalar first.
These classes check themselves: what cannot exist raises :class:`~harness_opt.errors.ProblemError`.
"""

from __future__ import annotations

import copy
import functools
import itertools
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from harness_opt.errors import ProblemError
from harness_opt.model.between import mistakes_of
from harness_opt.model.bodies import WORLD, Body, Hinge, Poses, Rates, Slide, Stretch, chain, composed, seen_from
from harness_opt.model.cable import CableRun
from harness_opt.model.checks import Vector
from harness_opt.model.courses import FoundPoses, polyline
from harness_opt.model.design import Design, Limits, Robust
from harness_opt.model.ends import End
from harness_opt.model.limits import LimitKind
from harness_opt.model.parts import MeshFile, Part, Robot
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array

MOST_TOLD = 2  # bodies that are told one by one; of more, the time of the motion is
DIGITS = {"deg": 1, "mm": 1, "s": 2}


@dataclass(frozen=True)
class Problem:
    """A whole problem, as one problem file holds it.

    Args:
        cables: by name.
        bodies: by name, without "world", which always exists.
        parts: by name.
        gravity: m/s2.
        limits, design: as their classes say.
        robust: None holds the limits for the nominal design alone.
        duration: of the motion, s.
        out_and_back: whether all bodies go through their motions until half-way and then back: a cable that snapped
            on the way out may come back another way.
        spatial_step: most that a clamp moves between two solved frames, m; None takes a hundredth of the longest cable.
        title: one line for people.
        file: where the problem was read from, or None.
        sha256: of that file's bytes, or None.
        libraries: files that cables of it were taken from.
        robots: by name, where bodies and parts come from that stand among the others.
        found: where free bodies stand over the motion, and how cables stand in clips that let them turn or slide, by
            :func:`~harness_opt.model.spans.clip_key`: known of a problem that was simulated, empty before.
    """

    cables: Mapping[str, CableRun]
    bodies: Mapping[str, Body] = field(default_factory=dict)
    parts: Mapping[str, Part] = field(default_factory=dict)
    gravity: Vector = (0.0, 0.0, 0.0)
    limits: Limits = field(default_factory=Limits)
    design: Design = field(default_factory=Design)
    robust: Robust | None = None
    duration: float = 1.0
    out_and_back: bool = False
    spatial_step: float | None = None
    title: str = ""
    file: Path | None = None
    sha256: str | None = None
    libraries: tuple[Path, ...] = ()
    robots: Mapping[str, Robot] = field(default_factory=dict)
    found: Mapping[str, FoundPoses] = field(default_factory=dict)

    def __post_init__(self) -> None:
        mistakes = mistakes_of(self)
        if mistakes:
            raise ProblemError(mistakes)

    def __repr__(self) -> str:
        """Return one line."""
        names = ", ".join(self.cables)
        moving = ", ".join(name for name, body in self.bodies.items() if body.motion is not None) or "none"
        title = f"{self.title!r}, " if self.title else ""
        return f"<Problem: {title}cables {names}; moving bodies {moving}; {len(self.parts)} parts>"

    def changed(self, **parts: Any) -> Problem:
        """Return a copy with ``parts`` in the place of what they are called, not checked again: for inner loops."""
        other = copy.copy(self)
        for name, value in parts.items():
            object.__setattr__(other, name, value)
        return other

    def body(self, name: str) -> Body:
        """Return the body called ``name``; "world" stands still."""
        return Body() if name == WORLD else self.bodies[name]

    def poses(self, body: str, motion: ArrayLike) -> tuple[Array, Array]:
        """Return positions (P, 3) and quaternions (P, 4) of ``body`` at ``motion`` (P,) from 0 to 1, there and back."""
        carried = chain(self.bodies, body)
        if not carried:
            return Body().poses(motion)
        at = np.asarray(motion, dtype=float)
        there, found = self._there(at), self.found.get(self.root(body))
        poses = [one.poses(there) for one in carried]
        if found is not None:  # a free body need not come back as it went
            poses[0] = found.poses(np.atleast_1d(at))
        return functools.reduce(composed, poses)

    def root(self, body: str) -> str:
        """Return the body that carries ``body`` at last: itself where none does."""
        while body != WORLD and self.bodies[body].parent != WORLD:
            body = self.bodies[body].parent
        return body

    def _there(self, motion: Array) -> Array:
        """Return how far the motion is on its way there, 0 to 1, at ``motion`` (...) there and back."""
        return 1.0 - np.abs(2.0 * motion - 1.0) if self.out_and_back else motion

    def poses_from(self, view: str, body: str, motion: ArrayLike) -> tuple[Array, Array]:
        """Return the poses of ``body`` in the coordinates of the body ``view``, as :meth:`poses`."""
        if view == WORLD:
            return self.poses(body, motion)
        if view == body:
            return Body().poses(motion)
        return seen_from(self.poses(view, motion), self.poses(body, motion))

    def rates(self, body: str, first: Array, last: Array, view: str = WORLD) -> Rates:
        """Return bounds on how fast ``body`` moves from motion value ``first`` (k,) to ``last`` (k,).

        That is in the world, or as another body, ``view``, sees it: what carries both does not count then. A motion
        there and back turns round at 0.5; no stretch may hold that value within it.
        """
        there = np.sort(self._there(np.stack([first, last])), axis=0)
        faster = 2.0 if self.out_and_back else 1.0
        found = [self.found.get(self.root(name)) for name in (body, view)]
        stretch, other_stretch = (Stretch(there[0], there[1], first, last, faster, one) for one in found)
        own, other = chain(self.bodies, body), chain(self.bodies, view)
        both = sum(1 for _ in itertools.takewhile(lambda pair: pair[0] is pair[1], zip(own, other, strict=False)))
        rates, pose = Rates.steady(np.zeros(3), len(first)), Body().poses(first)
        for one in other[both:]:
            rates, pose = other_stretch.followed(one, rates, pose)
        if both < len(other):
            rates, pose = rates.inverse(pose, stretch.long), seen_from(pose, Body().poses(first))
        for one in own[both:]:
            rates, pose = stretch.followed(one, rates, pose)
        fast = stretch.faster
        return Rates(
            rates.centre, fast * rates.speed, fast**2 * rates.acceleration, fast * rates.turning,
            fast**2 * rates.turning_change,
        )  # fmt: skip

    def joints_between(self, body: str, other: str) -> int:
        """Return how many motions lie between two bodies: those that carry one of them and not the other."""
        chains = [chain(self.bodies, name) for name in (body, other)]
        both = sum(1 for _ in itertools.takewhile(lambda pair: pair[0] is pair[1], zip(*chains, strict=False)))
        return sum(one.moves for carried in chains for one in carried[both:])

    def ends(self, cable: str, motion: ArrayLike) -> list[tuple[End, End]]:
        """Return the start and end of ``cable`` in world coordinates at each ``motion`` (P,) from 0 to 1."""
        placed = []
        for end in (self.cables[cable].start, self.cables[cable].end):
            poses = zip(*self.poses(end.body, motion), strict=True)
            placed.append([one.placed(*pose) for one, pose in zip(end.over(motion), poses, strict=True)])
        return list(zip(*placed, strict=True))

    def lengths(self, cable: str, motion: ArrayLike) -> Array:
        """Return how long ``cable`` is at ``motion`` (P,), m: a span between clips that it slides through changes."""
        run, at = self.cables[cable], np.atleast_1d(np.asarray(motion, dtype=float))
        return np.full(len(at), run.cable.length) if run.slid is None else run.slid.lengths(at)

    def is_moved(self, body: str) -> bool:
        """Return whether ``body`` moves, by itself or with one that carries it."""
        return any(one.moves for one in chain(self.bodies, body))

    def is_placed(self, body: str) -> bool:
        """Return whether it is known where ``body`` stands: it hangs on no free body that is still to be found."""
        root = self.root(body)
        return root == WORLD or not self.bodies[root].free or root in self.found

    @property
    def moments(self) -> Moments:
        """What tells the moments of the motion."""
        return Moments(travels(self), self.duration, self.out_and_back)

    @property
    def has_limits(self) -> bool:
        """Whether there is anything to hold, and so to be certain of between the frames."""
        own = [part.clearance for part in self.parts.values()] + [run.bend_radius for run in self.cables.values()]
        return any(limit is not None for limit in (*vars(self.limits).values(), *own))

    @property
    def moves(self) -> bool:
        """Whether any body has a motion."""
        return any(body.motion is not None for body in self.bodies.values())

    def cable_limit(self, kind: LimitKind, cable: str) -> float | None:
        """Return the limit of a ``kind`` but clearance that holds for ``cable``, SI: its own, or the general one."""
        own = self.cables[cable].bend_radius if kind is LimitKind.BEND_RADIUS else None
        general: float | None = getattr(self.limits, kind.value)
        return general if own is None else own

    def clearance_limit(self, part: str) -> float | None:
        """Return the limit that holds for ``part``, m: its own, or the general one."""
        own = self.parts[part].clearance
        return self.limits.clearance if own is None else own


def given_problem(problem: object) -> Problem:
    """Return ``problem``, or say what else it is.

    Raises:
        ProblemError: something else, such as the path of a file.
    """
    if isinstance(problem, Problem):
        return problem
    if isinstance(problem, (str, os.PathLike)):
        path = os.fspath(problem)
        raise ProblemError(f"problem: found the path {path!r}, expected a Problem: harness_opt.read_problem({path!r})")
    raise ProblemError(f"problem: found {type(problem).__name__}, expected a Problem")


def held_as(problem: Problem, cable: str, at: float, frames: Sequence[Array]) -> Problem:
    """Return ``problem`` with the ends of ``cable`` whose rolls were to be found clamped in ``frames``.

    Args:
        problem, cable: as above.
        at: motion value, 0 to 1, of the frames.
        frames: section frames (4,) of both ends there, in the world.
    """
    run, held = problem.cables[cable], dict[str, End]()
    for side, frame in zip(("start", "end"), frames, strict=True):
        end: End = getattr(run, side)
        if end.roll == "untwisted":
            body = problem.poses(end.body, [at])[1][0]
            held[side] = end.held(rotations.multiply(rotations.conjugate(body), rotations.normalise(frame)))
    if not held:
        return problem
    return problem.changed(cables={**problem.cables, cable: replace(run, **held)})  # type: ignore[arg-type]


def input_files(problem: Problem) -> list[Path]:
    """Return the files that ``problem`` was read from and still needs."""
    files = [part.shape.path for part in problem.parts.values() if isinstance(part.shape, MeshFile)]
    files += [body.table for body in problem.bodies.values() if body.table is not None]
    files += [file for robot in problem.robots.values() for file, _ in robot.files]
    return [*files, *problem.libraries, *([problem.file] if problem.file else [])]


def left_out(problem: Problem) -> tuple[str, ...]:
    """Return the words for what this scene did not need."""
    words = []
    if not any(problem.gravity) or not any(run.cable.mass_per_length for run in problem.cables.values()):
        words.append("weight")
    if not problem.parts:
        words.append("parts")
    if problem.limits.clearance is None:
        words.append("clearance of cables to each other and to themselves")
    if len(problem.cables) == 1:
        words.append("other cables")
    if not problem.moves:
        words.append("motion")
    words += [
        f"where {name} bows to: its shape is one of a family, free to turn about the line through its clamps"
        for name in problem.cables
        if turns_about_its_clamps(problem, name)
    ]
    return tuple(words)


def turns_about_its_clamps(problem: Problem, cable: str) -> bool:
    """Whether the shapes of a slack cable are each one of a family, alike but for a turn about a fixed line.

    A round cable made straight, without weight, whose clamps point along the line through them at some moment: its
    shape turned about that line is as good a shape, of the same energy.
    """
    samples, along = 101, 1e-9  # moments looked at; sine of the angle up to which two directions are one
    run = problem.cables[cable]
    weight = run.cable.mass_per_length and any(problem.gravity)
    ends = (run.start, run.end)
    if weight or not run.cable.rolls_freely or any(end.position is None or end.frame is None for end in ends):
        return False
    at = np.linspace(0.0, 1.0, samples)
    placed = [problem.poses(end.body, at) for end in ends]
    moved = [r + rotations.rotate(q, np.asarray(end.position)) for (r, q), end in zip(placed, ends, strict=True)]
    gap: Array = moved[1] - moved[0]
    distance = np.linalg.norm(gap, axis=1)
    coaxial = distance < run.cable.length * (1.0 - along)
    start, end = (
        rotations.tangent(rotations.multiply(q, one.frame))  # type: ignore[arg-type]
        for (_, q), one in zip(placed, ends, strict=True)
    )
    coaxial &= np.linalg.norm(np.cross(start, gap), axis=1) <= along * run.cable.length
    coaxial &= np.linalg.norm(end - start, axis=1) <= along
    return bool(np.any(coaxial))


# --- what a motion is told in: degrees of a hinge, millimetres of a slide, seconds of a table of poses -----


@dataclass(frozen=True)
class Travel:
    """The way of one body, which goes evenly with the motion value, or through places of its own.

    Args:
        body: its name; empty for the time of the whole motion.
        unit: "deg", "mm" or "s".
        start, stop: where it begins and ends, in that unit.
        shares, values: motion values and where it is there, straight between; empty where it goes evenly.
    """

    body: str
    unit: str
    start: float
    stop: float
    shares: Sequence[float] = ()
    values: Sequence[float] = ()

    def at(self, share: float) -> str:
        """Return where it is at ``share`` of the motion, 0 to 1, in words: ``55.0 deg``."""
        value = self.start + share * (self.stop - self.start)
        if self.shares:
            value = float(np.interp(share, self.shares, self.values))
        return f"{value:.{DIGITS[self.unit]}f} {self.unit}".replace("-0.0 ", "0.0 ")


def travels(problem: Problem) -> tuple[Travel, ...]:
    """Return the ways of the bodies that move."""
    found = []
    for name, body in problem.bodies.items():
        motion = body.motion
        if isinstance(motion, Hinge):
            found.append(_travel(name, "deg", motion))
        elif isinstance(motion, Slide):
            found.append(_travel(name, "mm", motion))
        elif isinstance(motion, Poses):
            found.append(Travel(name, "s", motion.times[0], motion.times[-1]))
    return tuple(found)


def _travel(name: str, unit: str, motion: Hinge | Slide) -> Travel:
    """Return the way of a body on a hinge or a slide: to half of the last digit that is told of it."""
    start, stop = (math.degrees(end) if unit == "deg" else 1e3 * end for end in (motion.start, motion.stop))
    if motion.follows is None:
        return Travel(name, unit, start, stop)
    factor = {"deg": math.degrees(1.0), "mm": 1e3}[unit]
    at, values = polyline(motion.follows, 0.5 * 10.0 ** -DIGITS[unit] / factor)
    return Travel(
        name, unit, start, stop, tuple(np.round(at, 6).tolist()), tuple(np.round(factor * values, 4).tolist())
    )


@dataclass(frozen=True)
class Moments:
    """Tells moments of a motion.

    Args:
        ways: of the bodies that move.
        duration: of the motion, s.
        out_and_back: whether it goes there and back.
    """

    ways: Sequence[Travel]
    duration: float
    out_and_back: bool = False

    def short(self, motion: float) -> str:
        """Return a moment, 0 to 1, in one unit: ``55.0 deg``; nothing where nothing moves."""
        if not self.ways:
            return ""
        if len(self.ways) > 1:
            return Travel("", "s", 0.0, self.duration).at(motion)
        return self.ways[0].at(self._share(motion))

    def words(self, motion: float) -> str:
        """Return a moment, 0 to 1, in words: ``55.0 deg, 50.0 %``, with the bodies' names where two move."""
        told = self.short(motion)
        if 1 < len(self.ways) <= MOST_TOLD:
            told = ", ".join(f"{way.body} {way.at(self._share(motion))}" for way in self.ways)
        back = " on the way back" if self.out_and_back and motion > 0.5 else ""
        share = f"{100 * motion:.1f} %"
        return f"{told}{back}, {share}" if told else share

    def _share(self, motion: float) -> float:
        return 1.0 - abs(2.0 * motion - 1.0) if self.out_and_back else motion


SHARES = Moments((), 0.0)  # tells shares of the motion alone
