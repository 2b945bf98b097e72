"""Cables as a user describes them, and how their ends are held.

SI units and radians; a pose takes section coordinates to those of its body; quaternions are scalar first.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from harness_opt.errors import ProblemError
from harness_opt.model import checks
from harness_opt.model.bodies import WORLD
from harness_opt.model.checks import Quaternion, Vector
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array

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
        holders: parts of that body that hold the cable here, by name: what it comes out of. None takes those that
            contain the clamp's point, or come nearer to it than the cable's radius.
        let_off: arc over which a holder's limit does not count, m: until the cable has left it, and near it after.
            None takes the radius and the limit, at least two diameters.

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
    holders: tuple[str, ...] | None = None
    let_off: float | None = None

    def __post_init__(self) -> None:
        if self.let_off is not None:
            object.__setattr__(self, "let_off", checks.positive("let_off", self.let_off, zero=True))
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
