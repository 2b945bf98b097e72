"""Cables as a user describes them, with what holds them.

SI units and radians; a pose takes section coordinates to those of its body; quaternions are scalar first.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np

from harness_opt.errors import ProblemError
from harness_opt.model import checks
from harness_opt.model.checks import Vector, shown
from harness_opt.model.courses import FoundPoses
from harness_opt.model.ends import ENDS, Clip, End, Side
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
        found = checks.Gathered()
        for name in ("length", "diameter", "torsional_stiffness", "mass_per_length"):
            with found:
                value = checks.positive(name, getattr(self, name), zero=name == "mass_per_length")
                object.__setattr__(self, name, value)
        with found:
            object.__setattr__(self, "bending_stiffness", self._bending())
        with found:
            object.__setattr__(self, "rest_curvature", checks.numbers("rest_curvature", self.rest_curvature, 3))
        found.raised()

    def _bending(self) -> float | tuple[float, float]:
        """Return the bending stiffness, checked."""
        given: Any = self.bending_stiffness
        try:
            if isinstance(given, (bool, str)) or np.ndim(given) == 0:
                return checks.positive("", given)
            first, second = (checks.positive("", value) for value in given)
        except (ProblemError, ValueError):
            wanted = checks.sized("a number above 0, or [kx, ky], two numbers above 0", given)
            raise ProblemError(f"bending_stiffness: found {shown(given)}, expected {wanted}") from None
        return first, second

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

    @property
    def rolls_freely(self) -> bool:
        """Whether turning its section about its own centreline costs nothing: it is round, and made straight."""
        kx, ky, _ = self.stiffness
        return bool(kx == ky) and not any(self.rest_curvature)


@dataclass(frozen=True)
class Slid:
    """The length of a span between clips that its cable slides through.

    Args:
        drawn: as the clips are drawn, m.
        first, last: of the clips at its start and end: how the cable was found to stand there; None where it is held.
        places: arc lengths of both as drawn, m.
    """

    drawn: float
    first: FoundPoses | None
    last: FoundPoses | None
    places: tuple[float, float]

    def lengths(self, motion: Array) -> Array:
        """Return the length (P,), m, at ``motion`` (P,)."""
        found = np.full(len(motion), self.drawn)
        for clip, place, sign in zip((self.first, self.last), self.places, (-1.0, 1.0), strict=True):
            if clip is not None and clip.places is not None:
                found += sign * (clip.arc_lengths(motion) - place)
        return found

    @property
    def longest(self) -> float:
        """A length, m, that it never exceeds: between where it was found, by no more than it changes from one to the
        next.
        """
        at = np.unique(np.concatenate([clip.motion for clip in (self.first, self.last) if clip is not None]))
        found = self.lengths(at)
        return float(found.max() + np.max(np.abs(np.diff(found)), initial=0.0))


@dataclass(frozen=True)
class CableRun:
    """A cable with what holds its two ends.

    Args:
        cable: the cable.
        start, end: what holds it at arc length 0 and at its full length.
        bow: world direction to which the cable bows between its ends in the starting shape; None leaves it to
            gravity, or to the clamps.
        fitted_at: motion value, 0 to 1, at which an untwisted end is clamped.
        clips: what holds the cable on its way, in the order of their arc lengths.
        bend_radius: the cable's own limit of the bend radius, m; None takes that of the problem.
        slid: of a span between clips that the cable slides through, how long it is over the motion; the length of
            ``cable`` is then one that it never exceeds.

    Raises:
        ProblemError: no position at either end; clips of one name, or whose arc lengths do not increase within the
            cable.
    """

    cable: Cable
    start: End
    end: End
    bow: Vector | None = None
    fitted_at: float = 0.0
    clips: tuple[Clip, ...] = ()
    bend_radius: float | None = None
    slid: Slid | None = None

    def __post_init__(self) -> None:
        at = self.fitted_at
        if self.bend_radius is not None:
            checks.positive("bend_radius", self.bend_radius)
        if not isinstance(at, (int, float)) or isinstance(at, bool) or not 0.0 <= at <= 1.0:
            raise ProblemError(f"fitted_at: found {shown(at)}, expected a number from 0 to 1")
        if self.bow is not None:
            object.__setattr__(self, "bow", checks.direction("bow", self.bow))
        object.__setattr__(self, "clips", tuple(self.clips))
        if self.start.position is None and self.end.position is None and not self.clips:
            words = "found no position at either end, expected one: the cable would fly away"
            raise ProblemError(f"end.position: {words}")

    @property
    def clamps(self) -> dict[str, End]:
        """What holds the cable, by name, along it: its start, the clips, its end."""
        return {"start": self.start, **{clip.name: clip for clip in self.clips}, "end": self.end}

    def found_in(self, first: FoundPoses | None, last: FoundPoses | None) -> CableRun:
        """Return this span with the cable as it was found in the clips at its start and end; None where it is held."""
        clips = (self.start, first), (self.end, last)
        start, end = (end if found is None else dataclasses.replace(end, found=found) for end, found in clips)
        if not any(found is not None and found.places is not None for found in (first, last)):
            return dataclasses.replace(self, start=start, end=end)
        drawn = self.cable.length if self.slid is None else self.slid.drawn
        places = [end.at if isinstance(end, Clip) else 0.0 for end in (start, end)]
        slid = Slid(drawn, first, last, (places[0], places[1]))
        cable = dataclasses.replace(self.cable, length=slid.longest)
        return dataclasses.replace(self, cable=cable, start=start, end=end, slid=slid)

    def with_clamp(self, name: str, clamp: End) -> CableRun:
        """Return this run with ``clamp`` in the place of that called ``name``."""
        if name in ENDS:
            return dataclasses.replace(self, **{name: clamp})  # type: ignore[arg-type]
        clips = tuple(clamp if clip.name == name else clip for clip in self.clips)
        return dataclasses.replace(self, clips=clips)  # type: ignore[arg-type]

    @property
    def untwisted(self) -> Side | None:
        """The end whose roll is to be found: the end, or the start where the end has its roll; None where neither is.

        Nothing is to be found where no other end holds the roll of a round cable made straight: any does.
        """
        sides: dict[Side, End] = {"end": self.end, "start": self.start}
        open_sides = [side for side, end in sides.items() if end.roll == "untwisted"]
        if not open_sides:
            return None
        other = self.start if open_sides[0] == "end" else self.end
        loose = other.frame is None or other.roll == "free" or other.swivel
        return None if loose and self.cable.rolls_freely else open_sides[0]

    @property
    def to_fit(self) -> CableRun:
        """This run as it is fitted: the untwisted end turns freely, every other that is not free is held."""
        changed = {
            side: end.held()
            for side, end in (("start", self.start), ("end", self.end))
            if end.frame is not None and end.roll != "free" and not end.swivel and side != self.untwisted
        }
        return dataclasses.replace(self, **changed)  # type: ignore[arg-type]

    @property
    def turned_in(self) -> float:
        """Turns of twist that the ends are turned by after the cable was fitted."""
        return sum(sign * end.turns for sign, end in ((-1, self.start), (1, self.end)) if end.roll != "free")
