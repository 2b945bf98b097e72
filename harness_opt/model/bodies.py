"""How a body moves: about a hinge, along a slide, or through tabulated poses. SI units; quaternions scalar first.

A body that another one carries moves relative to that: its poses and its motion are in its parent's coordinates.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from harness_opt.errors import ProblemError
from harness_opt.model import checks
from harness_opt.model.checks import Quaternion, Vector
from harness_opt.model.courses import Course, FoundPoses, PoseSpline, ValueTable, increasing
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array

WORLD = "world"


@dataclass(frozen=True, eq=False)
class Rates:
    """Bounds on how fast a body moves over k stretches of its motion, per unit of ``motion``.

    Args:
        centre: (k, 3), world or parent, m, of one and the same point of the body, in the middle of the stretch.
        speed, acceleration: of that point, (k,), m and m per motion squared.
        turning, turning_change: angular speed and acceleration, (k,), rad and rad per motion squared.
    """

    centre: Array
    speed: Array
    acceleration: Array
    turning: Array
    turning_change: Array

    @staticmethod
    def steady(centre: ArrayLike, count: int, speed: float = 0.0, turning: float = 0.0) -> Rates:
        """Return the rates of ``count`` stretches of a motion that neither speeds up nor turns its axis."""
        none = np.zeros(count)
        return Rates(np.tile(np.asarray(centre, dtype=float), (count, 1)), none + speed, none, none + turning, none)

    def carried(self, parent: Rates, pose: tuple[Array, Array], long: Array) -> Rates:
        """Return these rates, relative to a parent that itself moves, as rates in the coordinates of that one's parent.

        With d from the parent's point to this body's, and what the body does relative to the parent turned along
        (Goldstein, Classical Mechanics, sections 4.9 and 4.10),

            x' = x_p' + w_p x d + d',    x'' = x_p'' + w_p' x d + w_p x (w_p x d) + 2 w_p x d' + d'',
            w = w_p + w_r,    w' = w_p' + w_p x w_r + w_r',

        of which every term is at most the product of the lengths in it.

        Args:
            parent: its rates over the same stretches.
            pose: of the parent in the middle of each stretch, (k, 3), (k, 4).
            long: of the stretches, (k,).
        """
        centre = pose[0] + rotations.rotate(pose[1], self.centre)
        # seen from the parent, its own point stands still and this one is never further from its middle than this
        arm = np.linalg.norm(centre - parent.centre, axis=1) + 0.5 * long * self.speed
        return Rates(
            centre,
            parent.speed + parent.turning * arm + self.speed,
            parent.acceleration
            + (parent.turning_change + parent.turning**2) * arm
            + 2.0 * parent.turning * self.speed
            + self.acceleration,
            parent.turning + self.turning,
            parent.turning_change + parent.turning * self.turning + self.turning_change,
        )

    def inverse(self, pose: tuple[Array, Array], long: Array) -> Rates:
        """Return how fast the parent moves as this body sees it, over the same stretches.

        That is bounds on the parent's point X that this body's point y is at in the middle of the stretch, as
        ``R^T (X - y)`` with a way ``X - y`` of at most half a stretch's; what turns the body turns the parent as fast.

        Args:
            pose: of the body in the parent in the middle of each stretch, (k, 3), (k, 4).
            long: of the stretches, (k,).
        """
        away = 0.5 * long * self.speed
        return Rates(
            rotations.rotate(rotations.conjugate(pose[1]), self.centre - pose[0]),
            self.speed + self.turning * away,
            self.acceleration + 2.0 * self.turning * self.speed + (self.turning_change + self.turning**2) * away,
            self.turning,
            self.turning_change,
        )


@dataclass(frozen=True)
class Hinge:
    """Turning about a line that its parent holds; at angle 0 body coordinates are the parent's.

    Args:
        point: a point on the line, m.
        axis: its direction, any length.
        start, stop: first and last angle, rad; where it follows a course, they are that one's.
        follows: a course of the angle; None goes evenly from first to last.
    """

    point: Vector
    axis: Vector
    start: float = math.nan
    stop: float = math.nan
    follows: Course | None = None

    def __post_init__(self) -> None:
        checks.numbers("point", self.point, 3)
        checks.direction("axis", self.axis)
        _set_ends(self)

    def poses(self, motion: ArrayLike) -> tuple[Array, Array]:
        """Return positions (P, 3) and quaternions (P, 4) of the body at ``motion`` (P,) from 0 to 1."""
        angle = _values(self, motion)
        q = rotations.from_rotation_vector(angle[:, None] * rotations.normalise(self.axis))
        point = np.asarray(self.point)
        return point - rotations.rotate(q, point), q

    def rates(self, first: Array, last: Array) -> Rates:
        """Return the exact rates from ``first`` (k,) to ``last`` (k,), about the line that stands still."""
        turning, change = _value_rates(self, first, last)
        return replace(Rates.steady(self.point, len(first)), turning=turning, turning_change=change)


@dataclass(frozen=True)
class Slide:
    """Straight motion without turning; at travel 0 body coordinates are the parent's.

    Args:
        direction: any length.
        start, stop: first and last travel along it, m; where it follows a course, they are that one's.
        follows: a course of the travel; None goes evenly from first to last.
    """

    direction: Vector
    start: float = math.nan
    stop: float = math.nan
    follows: Course | None = None

    def __post_init__(self) -> None:
        checks.direction("direction", self.direction)
        _set_ends(self)

    def poses(self, motion: ArrayLike) -> tuple[Array, Array]:
        """Return positions (P, 3) and quaternions (P, 4) of the body at ``motion`` (P,) from 0 to 1."""
        travel = _values(self, motion)
        position = travel[:, None] * rotations.normalise(self.direction)
        return position, np.tile(rotations.IDENTITY, (len(travel), 1))

    def rates(self, first: Array, last: Array) -> Rates:
        """Return the exact rates from ``first`` (k,) to ``last`` (k,)."""
        speed, change = _value_rates(self, first, last)
        middle = self.poses(0.5 * (first + last))[0]
        return replace(Rates.steady(np.zeros(3), len(first)), centre=middle, speed=speed, acceleration=change)


def _set_ends(motion: Hinge | Slide) -> None:
    """Take the first and the last value of a course that is followed; refuse those that are no numbers."""
    if motion.follows is not None:
        if not isinstance(motion.follows, Course):
            found = type(motion.follows).__name__
            raise ProblemError(f"follows: found {found}, expected a ValueTable or Moves")
        for name, value in zip(("start", "stop"), motion.follows.values([0.0, 1.0]), strict=True):
            object.__setattr__(motion, name, float(value))
    checks.numbers("start, stop", (motion.start, motion.stop), 2)


def _values(moved: Hinge | Slide, motion: ArrayLike) -> Array:
    """Return the angles or travels (P,) at ``motion`` (P,) from 0 to 1."""
    if moved.follows is not None:
        return moved.follows.values(motion)
    even: Array = moved.start + np.atleast_1d(motion) * (moved.stop - moved.start)
    return even


def _value_rates(moved: Hinge | Slide, first: Array, last: Array) -> tuple[Array, Array]:
    """Return the most of speed and acceleration (k,) of the angle or the travel over stretches (k,)."""
    if moved.follows is not None:
        return moved.follows.rates(first, last)
    return np.full(len(first), abs(moved.stop - moved.start)), np.zeros(len(first))


@dataclass(frozen=True)
class Poses:
    """A tabulated motion, interpolated smoothly: positions by a cubic spline, rotations by one on the sphere.

    Args:
        times: (n,) increasing, s; ``motion`` 0 to 1 maps onto them linearly.
        positions: (n, 3), m.
        quaternions: (n, 4), unit.
        file: where the table was read from, or None.
    """

    times: tuple[float, ...]
    positions: tuple[Vector, ...]
    quaternions: tuple[Quaternion, ...]
    file: Path | None = None

    def __post_init__(self) -> None:
        times = increasing(self.times)
        if np.shape(self.positions) != (len(times), 3) or np.shape(self.quaternions) != (len(times), 4):
            raise ProblemError("positions, quaternions: expected one row a time")
        if not np.all(np.isfinite(self.positions)):
            raise ProblemError("positions: expected finite numbers")
        for q in self.quaternions:
            checks.quaternion("quaternions", q)

    def poses(self, motion: ArrayLike) -> tuple[Array, Array]:
        """Return positions (P, 3) and quaternions (P, 4) of the body at ``motion`` (P,) from 0 to 1."""
        return self._spline.poses(np.atleast_1d(np.asarray(motion, dtype=float)))

    def rates(self, first: Array, last: Array) -> Rates:
        """Return bounds on the rates from ``first`` (k,) to ``last`` (k,), about the body's origin."""
        return Rates(self.poses(0.5 * (first + last))[0], *self._spline.rates(first, last))

    @functools.cached_property
    def _spline(self) -> PoseSpline:
        times = np.asarray(self.times)
        share = (times - times[0]) / (times[-1] - times[0])
        return PoseSpline(share, np.asarray(self.positions), np.asarray(self.quaternions))


BodyMotion = Hinge | Slide | Poses


@dataclass(frozen=True)
class Body:
    """A rigid body.

    Args:
        motion: in the parent's coordinates; without one it is fixed to it.
        parent: the body that carries it.
        position, quaternion: where it stands in the parent when its motion is at 0; left out, at the parent's origin.
            Of a free body a first guess, where they are given.
        free: whether it hangs on its cables, as a splice or a connector does, and stands where these balance.
        mass: of a free body, kg; its centre is the body's origin.

    Raises:
        ProblemError: a free body with a motion or a parent; a mass below 0, or of a body that is not free.
    """

    motion: BodyMotion | None = None
    parent: str = WORLD
    position: Vector = (0.0, 0.0, 0.0)
    quaternion: Quaternion = rotations.IDENTITY
    free: bool = False
    mass: float = 0.0

    def __post_init__(self) -> None:
        found = checks.Gathered()
        with found:
            checks.positive("mass", self.mass, zero=True)
        if self.free and self.motion is not None:
            found.told.append("motion: found one, expected none: a free body goes where its cables let it")
        if self.free and self.parent != WORLD:
            found.told.append(f"parent: found {self.parent!r}, expected none: a free body hangs on its cables alone")
        if self.mass and not self.free:
            found.told.append(f"mass: found {self.mass:g}, expected free = true beside it: other bodies' is not felt")
        found.raised()

    @property
    def moves(self) -> bool:
        """Whether it moves relative to its parent."""
        return self.motion is not None or self.free

    @property
    def table(self) -> Path | None:
        """The file of the table that its motion was read from."""
        found = _told_by(self.motion)
        return None if found is None else found.file

    @property
    def without_file(self) -> Body:
        """The same body, its table in no file."""
        found = _told_by(self.motion)
        if found is None:
            return self
        told = replace(found, file=None)
        return replace(self, motion=told if isinstance(told, Poses) else replace(self.motion, follows=told))  # type: ignore[type-var]

    def poses(self, motion: ArrayLike) -> tuple[Array, Array]:
        """Return positions (P, 3) and quaternions (P, 4) in its parent at ``motion`` (P,) from 0 to 1."""
        count = len(np.atleast_1d(motion))
        placed = np.tile(self.position, (count, 1)).astype(float), np.tile(self.quaternion, (count, 1)).astype(float)
        if self.motion is None:
            return placed
        return composed(self.motion.poses(motion), placed) if self.is_placed else self.motion.poses(motion)

    @property
    def is_placed(self) -> bool:
        """Whether it stands elsewhere in its parent than at its origin."""
        return any(self.position) or tuple(self.quaternion) != rotations.IDENTITY


def _told_by(motion: BodyMotion | None) -> Poses | ValueTable | None:
    """Return the table that tells a motion."""
    told = motion.follows if isinstance(motion, (Hinge, Slide)) else motion
    return told if isinstance(told, (Poses, ValueTable)) else None


def seconds_of(motion: BodyMotion | None) -> float | None:
    """Return the seconds that a motion is told in, a table's or those of moves; None where it goes evenly."""
    if isinstance(motion, Poses):
        return motion.times[-1] - motion.times[0]
    return None if motion is None or motion.follows is None else motion.follows.seconds


def composed(outer: tuple[Array, Array], inner: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return the poses (P, 3), (P, 4) of what stands at ``inner`` in a body that itself stands at ``outer``."""
    return outer[0] + rotations.rotate(outer[1], inner[0]), rotations.multiply(outer[1], inner[1])


def seen_from(outer: tuple[Array, Array], pose: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return the poses (P, 3), (P, 4) in a body that stands at ``outer`` of what stands at ``pose``."""
    back = rotations.conjugate(outer[1])
    return rotations.rotate(back, pose[0] - outer[0]), rotations.multiply(back, pose[1])


def chain(bodies: Mapping[str, Body], name: str) -> list[Body]:
    """Return the body called ``name`` and those that carry it, the outermost first, the world left out.

    Args:
        bodies: by name; parents that are there, without a circle.
        name: of one of them, or "world".
    """
    found: list[Body] = []
    while name != WORLD:
        found.append(bodies[name])
        name = found[-1].parent
    return found[::-1]


@dataclass(frozen=True)
class Stretch:
    """Stretches (k,) of the motion over which bodies move.

    Args:
        first, last: on the way there.
        began, ended: of the motion itself, which goes there and back.
        faster: times that is as fast as the way there.
        found: of the free body that carries what is followed; None where none does, or it is not found.
    """

    first: Array
    last: Array
    began: Array
    ended: Array
    faster: float
    found: FoundPoses | None

    @property
    def long(self) -> Array:
        """How long they are, on the way there, (k,)."""
        return self.last - self.first

    def followed(self, body: Body, rates: Rates, pose: tuple[Array, Array]) -> tuple[Rates, tuple[Array, Array]]:
        """Return rates and pose of ``body`` from those of its parent; what is fixed to that moves as it does."""
        if body.free and self.found is not None:
            speed, acceleration, turning, change = self.found.rates(self.began, self.ended)
            middle = self.found.poses(0.5 * (self.began + self.ended))
            fast = self.faster
            return Rates(middle[0], speed / fast, acceleration / fast**2, turning / fast, change / fast**2), middle
        if body.motion is not None:
            rates = body.motion.rates(self.first, self.last).carried(rates, pose, self.long)
        return rates, composed(pose, body.poses(0.5 * (self.first + self.last)))
