"""What holds the two ends of a rod, without dimensions: the conditions that close the balance laws.

At each end position or force, and orientation or moment: eq. (24) of Liu et al. and every combination beside it.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from harness_opt.errors import ProblemError
from harness_opt.model.cable import REACH_TOLERANCE, Cable
from harness_opt.model.ends import End
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import IDENTITY, Array
from harness_opt.rod import equations as rod
from harness_opt.rod.equations import Section, Units

HELD = 3  # small rotations of a section that a clamp holds; a swivel holds two


class Kind(NamedTuple):
    """Which quantities are given: what decides the structure of the equations, and nothing else.

    A swivel has its orientation given but for the roll: it turns about its tangent, along which no moment acts.
    """

    start_position: bool
    start_orientation: bool
    end_position: bool
    end_orientation: bool
    start_swivels: bool = False
    end_swivels: bool = False

    @property
    def start_held(self) -> int:
        """How many of the small rotations of the first section about its own axes are held: 0, 3, or x and y."""
        return _held(self.start_orientation, self.start_swivels)

    @property
    def end_held(self) -> int:
        """The same of the last section."""
        return _held(self.end_orientation, self.end_swivels)


def _held(oriented: bool, swivels: bool) -> int:
    return 0 if not oriented else HELD - 1 if swivels else HELD


CLAMPED = Kind(True, True, True, True)  # at both ends


@dataclass(frozen=True)
class Boundary:
    """The conditions at both ends; entries that ``kind`` does not use are zero (or the identity).

    Args:
        kind: which of them are used.
        gap: vector from the start to the end, (3,), in lengths of the cable.
        start_quaternion, end_quaternion: (4,).
        start_force, end_force, start_moment, end_moment: loads on the cable, world, (3,), in B/L^2 and B/L.
    """

    kind: Kind
    gap: Array
    start_quaternion: Array
    end_quaternion: Array
    start_force: Array
    end_force: Array
    start_moment: Array
    end_moment: Array

    def blend(self, other: Boundary, fraction: float) -> Boundary:
        """Return the conditions ``fraction`` of the way to ``other``, which must be of the same kind.

        Quaternions go along the shorter great circle, the rest along straight lines.
        """
        changed = {}
        for field in dataclasses.fields(self):
            if field.name == "kind":
                continue
            a, b = getattr(self, field.name), getattr(other, field.name)
            value = a + fraction * (b - a)
            if field.name.endswith("quaternion"):
                value = rotations.slerp(a, b, fraction)
            changed[field.name] = value
        return dataclasses.replace(self, **changed)


def boundary(start: End, end: End, units: Units) -> Boundary:
    """Return the dimensionless conditions of two ends in world coordinates.

    Raises:
        ProblemError: neither end has a position; or the ends are further apart than the cable is long.
    """
    kind = Kind(
        start.position is not None,
        start.quaternion is not None,
        end.position is not None,
        end.quaternion is not None,
        start.swivel,
        end.swivel,
    )
    if not (kind.start_position or kind.end_position):
        raise ProblemError("end.position: neither end has a position, so the cable would fly away")
    gap = np.zeros(3)
    if kind.start_position and kind.end_position:
        gap = (np.asarray(end.position) - np.asarray(start.position)) / units.length
        distance = float(np.linalg.norm(gap))
        if distance > 1.0 + REACH_TOLERANCE:
            raise ProblemError(
                f"length: found {units.length:.6g} m, expected at least {units.length * distance:.6g} m, "
                "the distance between its ends"
            )
        gap = gap / max(distance, 1.0)

    def load(value: tuple[float, ...] | None, unit: float) -> Array:
        return np.zeros(3) if value is None else np.asarray(value) / unit

    return Boundary(
        kind,
        gap,
        np.asarray(start.quaternion or IDENTITY, dtype=float),
        np.asarray(end.quaternion or IDENTITY, dtype=float),
        load(start.force, units.force),
        load(end.force, units.force),
        load(start.moment, units.moment),
        load(end.moment, units.moment),
    )


@dataclass(frozen=True)
class Case:
    """One equilibrium to find, dimensionless: cable, load and ends.

    Args:
        section: the cable.
        load: f, (3,), world.
        boundary: the ends.
    """

    section: Section
    load: Array
    boundary: Boundary

    def signed_like(self, start: Array, end: Array) -> Case:
        """Return the case with the clamps' quaternions of the signs nearest to ``start`` and ``end`` (4,).

        q and -q are one orientation; along a cable and a motion the sign carries the parity of the whole turns.
        """
        first, last = self.boundary.start_quaternion, self.boundary.end_quaternion
        if first @ start >= 0 and last @ end >= 0:
            return self
        boundary = dataclasses.replace(
            self.boundary,
            start_quaternion=first if first @ start >= 0 else -first,
            end_quaternion=last if last @ end >= 0 else -last,
        )
        return dataclasses.replace(self, boundary=boundary)

    def blend(self, other: Case, fraction: float) -> Case:
        """Return the case ``fraction`` of the way to ``other``; stiffness ratios and a growing load change
        geometrically.
        """
        stiffness = self.section.stiffness ** (1.0 - fraction) * other.section.stiffness**fraction
        rest = self.section.rest_curvature
        return Case(
            Section(stiffness, rest + fraction * (other.section.rest_curvature - rest)),
            _blend_load(self.load, other.load, fraction),
            self.boundary.blend(other.boundary, fraction),
        )


def _blend_load(a: Array, b: Array, fraction: float) -> Array:
    """Blend two loads: their size geometrically where they point the same way, for a cable feels ratios; else
    linearly.
    """
    size_a, size_b = float(np.linalg.norm(a)), float(np.linalg.norm(b))
    if a @ b < (1.0 - 1e-12) * size_a * size_b or size_a == 0.0 or size_b == 0.0:
        return a + fraction * (b - a)
    blended: Array = b * (size_a / size_b) ** (1.0 - fraction)
    return blended


def case(cable: Cable, start: End, end: End, gravity: Array) -> Case:
    """Return the dimensionless case of ``cable`` between two ends in world coordinates, in ``gravity`` (3,), m/s2.

    Raises:
        ProblemError: as :func:`boundary`.
    """
    section, units = rod.scale(cable)
    return Case(section, rod.weight(cable, gravity), boundary(start, end, units))


def relative_matrix(clamp: Array) -> Array:
    """Return the matrix (3, 4) that takes q to the vector part of conj(``clamp``) q."""
    a, b, c, d = clamp.tolist()
    return np.array([[-b, a, d, -c], [-c, -d, a, b], [-d, c, -b, a]])


def swivel_rates(clamp: Array, turn: Array, x: Array) -> Array:
    """Return the rates (3, k) of the equations of a swivel at its node's quaternion and moment ``x`` (7,), fixed.

    Args:
        clamp: frame of the swivel, (4,).
        turn: small rotations of it about its own axes, (3, k), rad.
        x: as above.
    """
    relative = rotations.multiply(rotations.conjugate(clamp), x[:4])
    tilt = -0.5 * rotations.multiply(np.pad(turn.T, ((0, 0), (1, 0))), relative).T[1:3]
    along = rotations.rotate(clamp, rotations.cross(turn.T, np.array([0.0, 0.0, 1.0])))
    return np.vstack([tilt, x[4:] @ along.T])


# Where the derivatives of the equations at the ends stand, by how many rotations are held: rows, and columns among a
# node's quaternion and moment. Free: the norm and the moment; a swivel: (the norm,) two tilts, the moment about d3.
_QUATERNION, _MOMENT = [0, 1, 2, 3], [4, 5, 6]
START_ENTRIES = {
    0: ([0] * 4 + [1, 2, 3], _QUATERNION + _MOMENT),
    2: ([0] * 4 + [1] * 4 + [2] * 4 + [3] * 3, 3 * _QUATERNION + _MOMENT),
    3: ([0, 1, 2, 3], _QUATERNION),
}
END_ENTRIES = {
    0: ([0, 1, 2], _MOMENT),
    2: ([0] * 4 + [1] * 4 + [2] * 3, 2 * _QUATERNION + _MOMENT),
    3: ([0] * 4 + [1] * 4 + [2] * 4, 3 * _QUATERNION),
}
