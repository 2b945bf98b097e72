"""What a user describes: cables, their ends, bodies that move, parts to stay clear of, limits, design variables.

SI units and radians. Poses take section or body coordinates to the world; quaternions are scalar first.
These classes check themselves: what cannot exist raises :class:`~harness_opt.errors.ProblemError`.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from . import rotations
from .errors import ProblemError
from .rotations import Array

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline
    from scipy.spatial.transform import RotationSpline

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

WORLD = "world"
UNIT_TOLERANCE = 1e-6  # largest | |q| - 1 | that is taken as rounding of a typed unit quaternion


def _numbers(name: str, value: ArrayLike, count: int) -> tuple[float, ...]:
    """Return ``value`` as ``count`` finite floats, or raise ProblemError naming ``name``."""
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        raise ProblemError(f"{name}: found {value!r}, expected {count} numbers") from None
    if array.shape != (count,) or not np.all(np.isfinite(array)):
        raise ProblemError(f"{name}: found {value!r}, expected {count} finite numbers")
    return tuple(array.tolist())


def _quaternion(name: str, value: ArrayLike) -> Quaternion:
    q = _numbers(name, value, 4)
    if abs(math.hypot(*q) - 1.0) > UNIT_TOLERANCE:
        raise ProblemError(f"{name}: found a quaternion of length {math.hypot(*q):.6g}, expected a unit quaternion")
    return tuple(rotations.unit(q).tolist())


def _positive(name: str, value: float, *, zero: bool = False) -> float:
    wanted = "a number of at least 0" if zero else "a number above 0"
    if not isinstance(value, (int, float, np.floating, np.integer)) or isinstance(value, bool):
        raise ProblemError(f"{name}: found {value!r}, expected {wanted}")
    if not math.isfinite(value) or value < 0 or (value == 0 and not zero):
        raise ProblemError(f"{name}: found {value!r}, expected {wanted}")
    return float(value)


def _direction(name: str, value: ArrayLike) -> Vector:
    vector = _numbers(name, value, 3)
    if not any(vector):
        raise ProblemError(f"{name}: found {value!r}, expected a direction, not a zero vector")
    return vector  # type: ignore[return-value]


@dataclass(frozen=True)
class Cable:
    """A homogeneous, inextensible, unshearable, linearly elastic cable (assumptions of section 2 of the paper).

    Args:
        length: m.
        diameter: outer diameter, m.
        bending_stiffness: N m2; one number, or (kx, ky) about d1 and d2 for a flat section.
        torsional_stiffness: kz, N m2.
        mass_per_length: kg/m.
        rest_curvature: Darboux vector of the unloaded cable in the section frame, 1/m.

    Raises:
        ProblemError: a length, diameter or stiffness that is not a finite positive number.
    """

    length: float
    diameter: float
    bending_stiffness: float | tuple[float, float]
    torsional_stiffness: float
    mass_per_length: float = 0.0
    rest_curvature: Vector = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("length", "diameter", "torsional_stiffness"):
            object.__setattr__(self, name, _positive(name, getattr(self, name)))
        object.__setattr__(self, "mass_per_length", _positive("mass_per_length", self.mass_per_length, zero=True))
        if np.ndim(self.bending_stiffness) == 0:
            bending = _positive("bending_stiffness", self.bending_stiffness)  # type: ignore[arg-type]
        else:
            bending = _numbers("bending_stiffness", self.bending_stiffness, 2)  # type: ignore[assignment]
            for value in bending:  # type: ignore[attr-defined]
                _positive("bending_stiffness", value)
        object.__setattr__(self, "bending_stiffness", bending)
        object.__setattr__(self, "rest_curvature", _numbers("rest_curvature", self.rest_curvature, 3))

    @property
    def stiffness(self) -> Array:
        """(kx, ky, kz), N m2."""
        bending = self.bending_stiffness
        kx, ky = bending if isinstance(bending, tuple) else (bending, bending)
        return np.array([kx, ky, self.torsional_stiffness])

    @property
    def radius(self) -> float:
        """Half the diameter, m."""
        return 0.5 * self.diameter


@dataclass(frozen=True)
class End:
    """What holds one end of a cable: ``position`` or ``force``, and ``quaternion`` or ``moment``.

    Args:
        position: of the centreline's end in the coordinates of ``body``, m.
        quaternion: section frame in the coordinates of ``body``; d3 points along growing arc length at both ends.
        force: dead load that the surroundings apply to the cable at this end, world, N.
        moment: the same for the moment, N m.
        turns: whole turns of twist added, at the end of the cable, to the smallest twist that joins the two clamps.
        body: name of the body that carries the clamp.

    A quantity that is given as neither is free: no force, or no moment.

    Raises:
        ProblemError: position and force together, quaternion and moment together, numbers that are not finite,
            a quaternion that is not a unit quaternion, turns that are not whole.
    """

    position: Vector | None = None
    quaternion: Quaternion | None = None
    force: Vector | None = None
    moment: Vector | None = None
    turns: int = 0
    body: str = WORLD

    def __post_init__(self) -> None:
        for given, load in (("position", "force"), ("quaternion", "moment")):
            if getattr(self, given) is not None and getattr(self, load) is not None:
                raise ProblemError(f"{load}: an end takes {given} or {load}, found both")
        for name in ("position", "force", "moment"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, _numbers(name, getattr(self, name), 3))
        if self.quaternion is not None:
            object.__setattr__(self, "quaternion", _quaternion("quaternion", self.quaternion))
        whole = isinstance(self.turns, (int, float)) and not isinstance(self.turns, bool)
        if not whole or not math.isfinite(self.turns) or self.turns != int(self.turns):
            raise ProblemError(f"turns: found {self.turns!r}, expected a whole number")
        object.__setattr__(self, "turns", int(self.turns))

    def placed(self, position: ArrayLike, quaternion: ArrayLike) -> End:
        """Return this end in world coordinates, its body standing at ``position`` (3,) and ``quaternion`` (4,)."""
        moved: dict[str, object] = {"body": WORLD}
        if self.position is not None:
            moved["position"] = tuple(np.asarray(position) + rotations.rotate(quaternion, self.position))
        if self.quaternion is not None:
            moved["quaternion"] = tuple(rotations.multiply(quaternion, self.quaternion))
        return dataclasses.replace(self, **moved)  # type: ignore[arg-type]


@dataclass(frozen=True)
class CableRun:
    """A cable with what holds its two ends.

    Args:
        cable: the cable.
        start, end: what holds it at arc length 0 and at its full length.
        bow: world direction to which the cable bows between its ends in the starting shape; None leaves it to
            gravity, or to the clamps.
    """

    cable: Cable
    start: End
    end: End
    bow: Vector | None = None

    def __post_init__(self) -> None:
        if self.bow is not None:
            object.__setattr__(self, "bow", _direction("bow", self.bow))
        if self.start.position is None and self.end.position is None:
            raise ProblemError("end.position: neither end has a position, so the cable would fly away")


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
        _numbers("point", self.point, 3)
        _direction("axis", self.axis)
        _numbers("start, stop", (self.start, self.stop), 2)

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
        _direction("direction", self.direction)
        _numbers("start, stop", (self.start, self.stop), 2)

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
            _quaternion("quaternions", q)

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


@dataclass(frozen=True)
class Body:
    """A rigid body; without ``motion`` it stands still, its coordinates those of the world."""

    motion: BodyMotion | None = None

    def poses(self, motion: ArrayLike) -> tuple[Array, Array]:
        """Return positions (P, 3) and quaternions (P, 4) at ``motion`` (P,) from 0 to 1."""
        if self.motion is not None:
            return self.motion.poses(motion)
        count = len(np.atleast_1d(motion))
        return np.zeros((count, 3)), np.tile(rotations.IDENTITY, (count, 1))


@dataclass(frozen=True)
class MeshFile:
    """A triangle mesh on disk.

    Args:
        path: absolute path of the file.
        unit: of its coordinates: "m", "cm", "mm", "in"; None where the format carries its own (GLB: metres).
    """

    path: Path
    unit: str | None = None


@dataclass(frozen=True)
class Box:
    """A box centred on its origin; ``size`` is its full extent, m."""

    size: Vector


@dataclass(frozen=True)
class Sphere:
    """A ball centred on its origin; m."""

    radius: float


@dataclass(frozen=True)
class Cylinder:
    """A cylinder along z, centred on its origin; ``length`` is its full height, m."""

    radius: float
    length: float


@dataclass(frozen=True)
class Capsule:
    """A cylinder along z with half balls on both ends; ``length`` is that of the cylinder alone, m."""

    radius: float
    length: float


Shape = MeshFile | Box | Sphere | Cylinder | Capsule


@dataclass(frozen=True)
class Part:
    """A solid to stay clear of.

    Args:
        shape: mesh file or primitive.
        body: name of the body it belongs to.
        position, quaternion: pose of the shape in the coordinates of the body.
        clearance: this part's own limit, m, or None for the general one.
    """

    shape: Shape
    body: str = WORLD
    position: Vector = (0.0, 0.0, 0.0)
    quaternion: Quaternion = rotations.IDENTITY
    clearance: float | None = None


@dataclass(frozen=True)
class Limits:
    """What must hold at every moment; None leaves a limit out.

    Args:
        clearance: between the cable's surface and parts, other cables, itself, m.
        bend_radius: smallest radius of the centreline, m.
        twist: largest twist per length, rad/m.
        clamp_force: N.
        clamp_moment: N m.
    """

    clearance: float | None = None
    bend_radius: float | None = None
    twist: float | None = None
    clamp_force: float | None = None
    clamp_moment: float | None = None


@dataclass(frozen=True)
class Variable:
    """A design variable with its bounds, absolute, in the unit of its key (m, or degrees for ``rotate_*_deg``).

    ``name`` is ``CABLE.length``, ``CABLE.start.position.x`` or ``CABLE.end.rotate_z_deg`` and the like.
    """

    name: str
    lower: float
    upper: float


@dataclass(frozen=True)
class Design:
    """What a redesign may change and what it prefers.

    Args:
        minimise: "change" (least change from the given design) or "length".
        variables: the design variables.
    """

    minimise: Literal["change", "length"] = "change"
    variables: tuple[Variable, ...] = ()


@dataclass(frozen=True)
class Problem:
    """A whole problem, as one problem file holds it.

    Args:
        cables: by name.
        bodies: by name, without "world", which always exists.
        parts: by name.
        gravity: m/s2.
        limits, design: as their classes say.
        duration: of the motion, s.
        spatial_step: most that a clamp moves between two solved frames, m; None takes a hundredth of the longest cable.
        title: one line for people.
        file: where the problem was read from, or None.
        sha256: of that file's bytes, or None.
    """

    cables: Mapping[str, CableRun]
    bodies: Mapping[str, Body] = field(default_factory=dict)
    parts: Mapping[str, Part] = field(default_factory=dict)
    gravity: Vector = (0.0, 0.0, 0.0)
    limits: Limits = Limits()
    design: Design = Design()
    duration: float = 1.0
    spatial_step: float | None = None
    title: str = ""
    file: Path | None = None
    sha256: str | None = None

    def __post_init__(self) -> None:
        _numbers("gravity", self.gravity, 3)
        _positive("duration", self.duration)
        if self.spatial_step is not None:
            _positive("spatial_step", self.spatial_step)

    def body(self, name: str) -> Body:
        """Return the body called ``name``; "world" stands still."""
        return Body() if name == WORLD else self.bodies[name]

    def ends(self, cable: str, motion: ArrayLike) -> list[tuple[End, End]]:
        """Return the start and end of ``cable`` in world coordinates at each ``motion`` (P,) from 0 to 1."""
        run = self.cables[cable]
        start_poses = zip(*self.body(run.start.body).poses(motion), strict=True)
        end_poses = zip(*self.body(run.end.body).poses(motion), strict=True)
        return [(run.start.placed(*a), run.end.placed(*b)) for a, b in zip(start_poses, end_poses, strict=True)]

    @property
    def moves(self) -> bool:
        """Whether any body has a motion."""
        return any(body.motion is not None for body in self.bodies.values())

    def clearance_limit(self, part: str) -> float | None:
        """Return the limit that holds for ``part``, m: its own, or the general one."""
        own = self.parts[part].clearance
        return self.limits.clearance if own is None else own
