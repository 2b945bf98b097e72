"""How a body moves: about a hinge, along a slide, or through tabulated poses. SI units; quaternions scalar first.

A body that another one carries moves relative to that: its poses and its motion are in its parent's coordinates.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from harness_opt.errors import ProblemError
from harness_opt.model import checks
from harness_opt.model.checks import Quaternion, Vector
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline
    from scipy.spatial.transform import RotationSpline

WORLD = "world"
SHORTEST = 1e-9  # s between two rows of a table: no motion is told more finely, and speeds stay numbers
RATE_MARGIN = 1.1  # angular acceleration is not linear between those samples; sizes and angles there are


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


@dataclass(frozen=True)
class Hinge:
    """Turning about a line that its parent holds; at angle 0 body coordinates are the parent's.

    Args:
        point: a point on the line, m.
        axis: its direction, any length.
        start, stop: first and last angle, rad.
    """

    point: Vector
    axis: Vector
    start: float
    stop: float

    def __post_init__(self) -> None:
        checks.numbers("point", self.point, 3)
        checks.direction("axis", self.axis)
        checks.numbers("start, stop", (self.start, self.stop), 2)

    def poses(self, motion: ArrayLike) -> tuple[Array, Array]:
        """Return positions (P, 3) and quaternions (P, 4) of the body at ``motion`` (P,) from 0 to 1."""
        angle = self.start + np.atleast_1d(motion) * (self.stop - self.start)
        q = rotations.from_rotation_vector(angle[:, None] * rotations.normalise(self.axis))
        point = np.asarray(self.point)
        return point - rotations.rotate(q, point), q

    def rates(self, first: Array, last: Array) -> Rates:
        """Return the exact rates from ``first`` (k,) to ``last`` (k,), about the line that stands still."""
        return Rates.steady(self.point, len(first), turning=abs(self.stop - self.start))


@dataclass(frozen=True)
class Slide:
    """Straight motion without turning; at travel 0 body coordinates are the parent's.

    Args:
        direction: any length.
        start, stop: first and last travel along it, m.
    """

    direction: Vector
    start: float
    stop: float

    def __post_init__(self) -> None:
        checks.direction("direction", self.direction)
        checks.numbers("start, stop", (self.start, self.stop), 2)

    def poses(self, motion: ArrayLike) -> tuple[Array, Array]:
        """Return positions (P, 3) and quaternions (P, 4) of the body at ``motion`` (P,) from 0 to 1."""
        travel = self.start + np.atleast_1d(motion) * (self.stop - self.start)
        position = travel[:, None] * rotations.normalise(self.direction)
        return position, np.tile(rotations.IDENTITY, (len(travel), 1))

    def rates(self, first: Array, last: Array) -> Rates:
        """Return the exact rates from ``first`` (k,) to ``last`` (k,)."""
        steady = Rates.steady(np.zeros(3), len(first), speed=abs(self.stop - self.start))
        return replace(steady, centre=self.poses(0.5 * (first + last))[0])


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
        times = np.asarray(self.times, dtype=float)
        if times.ndim != 1 or len(times) < 2 or not np.all(np.diff(times) > 0):
            raise ProblemError("times: expected at least two increasing numbers")
        if not float(np.min(np.diff(times))) >= SHORTEST:
            raise ProblemError(f"times: expected at least {SHORTEST:g} s between two")
        if np.shape(self.positions) != (len(times), 3) or np.shape(self.quaternions) != (len(times), 4):
            raise ProblemError("positions, quaternions: expected one row a time")
        if not (np.all(np.isfinite(times)) and np.all(np.isfinite(self.positions))):
            raise ProblemError("times, positions: expected finite numbers")
        for q in self.quaternions:
            checks.quaternion("quaternions", q)

    def poses(self, motion: ArrayLike) -> tuple[Array, Array]:
        """Return positions (P, 3) and quaternions (P, 4) of the body at ``motion`` (P,) from 0 to 1."""
        at = self.times[0] + np.atleast_1d(motion) * (self.times[-1] - self.times[0])
        position, rotation = self._splines
        return position(at), np.roll(rotation(at).as_quat(), 1, axis=1)

    def rates(self, first: Array, last: Array) -> Rates:
        """Return bounds on the rates from ``first`` (k,) to ``last`` (k,), about the body's origin.

        The origin's acceleration is linear between the table's times, so it is largest at one of them; speeds are
        sampled, and raised by what they can grow between two samples. Angular acceleration alone is sampled and
        raised by RATE_MARGIN.
        """
        grid, values = self._sampled_rates
        # the samples around each stretch, one to either side of it
        low = np.maximum(np.searchsorted(grid, first, side="right") - 1, 0)
        high = np.minimum(np.searchsorted(grid, last), len(grid) - 1)
        most = [[float(v[i : j + 1].max()) for i, j in zip(low, high, strict=True)] for v in values]
        speed, acceleration, turning, change = np.array(most)
        gap = float(np.diff(grid).max())
        change = RATE_MARGIN * change
        return Rates(
            self.poses(0.5 * (first + last))[0],
            speed + 0.5 * gap * acceleration,
            acceleration,
            turning + 0.5 * gap * change,
            change,
        )

    @functools.cached_property
    def _sampled_rates(self) -> tuple[Array, Array]:
        """Motion values (n,), and there the origin's speed and acceleration, and the angular ones, (4, n)."""
        rate_samples = 2001  # of a tabulated motion, beside its own times, where its rates are looked up
        span = self.times[-1] - self.times[0]
        grid = np.union1d(np.linspace(0.0, 1.0, rate_samples), (np.asarray(self.times) - self.times[0]) / span)
        at = self.times[0] + grid * span
        position, rotation = self._splines
        rates = [position(at, 1), position(at, 2), rotation(at, 1), rotation(at, 2)]
        scales = [span, span**2, span, span**2]
        return grid, np.array([k * np.linalg.norm(rate, axis=1) for k, rate in zip(scales, rates, strict=True)])

    @functools.cached_property
    def _splines(self) -> tuple[CubicSpline, RotationSpline]:
        from scipy.interpolate import CubicSpline
        from scipy.spatial.transform import Rotation, RotationSpline

        scalar_last = np.roll(np.asarray(self.quaternions), -1, axis=1)
        position = CubicSpline(self.times, np.asarray(self.positions))
        return position, RotationSpline(self.times, Rotation.from_quat(scalar_last))


BodyMotion = Hinge | Slide | Poses


@dataclass(frozen=True)
class Body:
    """A rigid body.

    Args:
        motion: relative to its parent; without one it is fixed to it, its coordinates those of the parent.
        parent: the body that carries it.
    """

    motion: BodyMotion | None = None
    parent: str = WORLD

    def poses(self, motion: ArrayLike) -> tuple[Array, Array]:
        """Return positions (P, 3) and quaternions (P, 4) in its parent at ``motion`` (P,) from 0 to 1."""
        if self.motion is not None:
            return self.motion.poses(motion)
        count = len(np.atleast_1d(motion))
        return np.zeros((count, 3)), np.tile(rotations.IDENTITY, (count, 1))


def composed(outer: tuple[Array, Array], inner: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return the poses (P, 3), (P, 4) of what stands at ``inner`` in a body that itself stands at ``outer``."""
    return outer[0] + rotations.rotate(outer[1], inner[0]), rotations.multiply(outer[1], inner[1])


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
