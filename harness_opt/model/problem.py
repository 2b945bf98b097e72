"""What a user describes: cables, their ends, bodies that move, parts to stay clear of, limits, design variables.

SI units and radians. Poses take section or body coordinates to the world; quaternions are scalar first.
These classes check themselves: what cannot exist raises :class:`~harness_opt.errors.ProblemError`.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from harness_opt.errors import ProblemError
from harness_opt.model import checks
from harness_opt.model.bodies import BodyMotion, Rates
from harness_opt.model.checks import Quaternion, Vector
from harness_opt.model.tolerances import Tolerance
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array

WORLD = "world"
REACH_TOLERANCE = 1e-9  # share of the length by which rounding may set a straight cable's clamps further apart


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
            object.__setattr__(self, name, checks.positive(name, getattr(self, name)))
        object.__setattr__(self, "mass_per_length", checks.positive("mass_per_length", self.mass_per_length, zero=True))
        if np.ndim(self.bending_stiffness) == 0:
            bending = checks.positive("bending_stiffness", self.bending_stiffness)  # type: ignore[arg-type]
        else:
            bending = checks.numbers("bending_stiffness", self.bending_stiffness, 2)  # type: ignore[assignment]
            for value in bending:  # type: ignore[attr-defined]
                checks.positive("bending_stiffness", value)
        object.__setattr__(self, "bending_stiffness", bending)
        object.__setattr__(self, "rest_curvature", checks.numbers("rest_curvature", self.rest_curvature, 3))

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
                object.__setattr__(self, name, checks.numbers(name, getattr(self, name), 3))
        if self.quaternion is not None:
            object.__setattr__(self, "quaternion", checks.quaternion("quaternion", self.quaternion))
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
            object.__setattr__(self, "bow", checks.direction("bow", self.bow))
        if self.start.position is None and self.end.position is None:
            raise ProblemError("end.position: neither end has a position, so the cable would fly away")


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
        shell: whether a surface that is not closed will do: it has no inside, so a cable there goes unnoticed.
    """

    path: Path
    unit: str | None = None
    shell: bool = False


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
class Coupling:
    """A quantity that follows a design variable: ``factor`` times its value plus ``offset``.

    ``name`` and ``leader`` are names as those of variables; values are absolute, in the units of their keys.
    """

    name: str
    leader: str
    factor: float = 1.0
    offset: float = 0.0

    @property
    def words(self) -> str:
        """As a problem file has it, behind an equals sign."""
        factor = "" if self.factor == 1.0 else f"{float(self.factor)!r} * "
        offset = f" {'-' if self.offset < 0 else '+'} {abs(float(self.offset))!r}" if self.offset else ""
        return f"{factor}{self.leader}{offset}"


@dataclass(frozen=True)
class Design:
    """What a redesign may change and what it prefers.

    Args:
        minimise: "change" (least change from the given design) or "length" (of all cables together).
        variables: the design variables.
        couplings: quantities that follow them.
        weights: of the change of a variable, by name, 1 where left out; 0 changes it for nothing.
        maximise: "margin" asks for the largest worst margin instead, each as a share of its limit; None does not.
        snaps: whether the cables may snap on the way.
    """

    minimise: Literal["change", "length"] = "change"
    variables: tuple[Variable, ...] = ()
    couplings: tuple[Coupling, ...] = ()
    weights: Mapping[str, float] = field(default_factory=dict)
    maximise: Literal["margin"] | None = None
    snaps: bool = False


@dataclass(frozen=True)
class Robust:
    """What a redesign holds its limits against, beside the nominal design.

    Args:
        tolerances: by key of the problem file.
        hold: "quantile": all limits hold for ``share`` of what is built; "corners": at every corner of the tolerances.
        share: between 0 and 1.
        samples: of the Monte Carlo study that verifies it; 0 leaves it out.
        seed: of these samples.
    """

    tolerances: Mapping[str, Tolerance] = field(default_factory=dict)
    hold: Literal["quantile", "corners"] = "quantile"
    share: float = 0.99
    samples: int = 500
    seed: int = 0


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
    """

    cables: Mapping[str, CableRun]
    bodies: Mapping[str, Body] = field(default_factory=dict)
    parts: Mapping[str, Part] = field(default_factory=dict)
    gravity: Vector = (0.0, 0.0, 0.0)
    limits: Limits = Limits()
    design: Design = Design()
    robust: Robust | None = None
    duration: float = 1.0
    out_and_back: bool = False
    spatial_step: float | None = None
    title: str = ""
    file: Path | None = None
    sha256: str | None = None

    def __post_init__(self) -> None:
        checks.numbers("gravity", self.gravity, 3)
        checks.positive("duration", self.duration)
        if self.spatial_step is not None:
            checks.positive("spatial_step", self.spatial_step)

    def body(self, name: str) -> Body:
        """Return the body called ``name``; "world" stands still."""
        return Body() if name == WORLD else self.bodies[name]

    def poses(self, body: str, motion: ArrayLike) -> tuple[Array, Array]:
        """Return positions (P, 3) and quaternions (P, 4) of ``body`` at ``motion`` (P,) from 0 to 1, there and back."""
        at = np.asarray(motion, dtype=float)
        return self.body(body).poses(1.0 - np.abs(2.0 * at - 1.0) if self.out_and_back else at)

    def rates(self, body: str, first: Array, last: Array) -> Rates:
        """Return bounds on how fast ``body`` moves from motion value ``first`` (k,) to ``last`` (k,).

        A motion there and back turns round at 0.5; no stretch may hold that value within it.
        """
        moves = self.body(body).motion
        if moves is None:
            return Rates.steady(np.zeros(3), len(first))
        if not self.out_and_back:
            return moves.rates(first, last)
        there = np.sort(1.0 - np.abs(2.0 * np.stack([first, last]) - 1.0), axis=0)
        once = moves.rates(there[0], there[1])
        return Rates(once.centre, 2 * once.speed, 4 * once.acceleration, 2 * once.turning, 4 * once.turning_change)

    def ends(self, cable: str, motion: ArrayLike) -> list[tuple[End, End]]:
        """Return the start and end of ``cable`` in world coordinates at each ``motion`` (P,) from 0 to 1."""
        run = self.cables[cable]
        start_poses = zip(*self.poses(run.start.body, motion), strict=True)
        end_poses = zip(*self.poses(run.end.body, motion), strict=True)
        return [(run.start.placed(*a), run.end.placed(*b)) for a, b in zip(start_poses, end_poses, strict=True)]

    @property
    def moves(self) -> bool:
        """Whether any body has a motion."""
        return any(body.motion is not None for body in self.bodies.values())

    def clearance_limit(self, part: str) -> float | None:
        """Return the limit that holds for ``part``, m: its own, or the general one."""
        own = self.parts[part].clearance
        return self.limits.clearance if own is None else own
