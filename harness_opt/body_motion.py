"""How a body moves: about a hinge, along a slide, or through tabulated poses. SI units; quaternions scalar first."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from . import checks, rotations
from .checks import Quaternion, Vector
from .errors import ProblemError
from .rotations import Array

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline
    from scipy.spatial.transform import RotationSpline


@dataclass(frozen=True)
class Hinge:
    """Turning about a fixed line; at angle 0 body coordinates are world coordinates.

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


@dataclass(frozen=True)
class Slide:
    """Straight motion without turning; at travel 0 body coordinates are world coordinates.

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

    @functools.cached_property
    def _splines(self) -> tuple[CubicSpline, RotationSpline]:
        from scipy.interpolate import CubicSpline
        from scipy.spatial.transform import Rotation, RotationSpline

        scalar_last = np.roll(np.asarray(self.quaternions), -1, axis=1)
        position = CubicSpline(self.times, np.asarray(self.positions))
        return position, RotationSpline(self.times, Rotation.from_quat(scalar_last))


BodyMotion = Hinge | Slide | Poses
