"""Cables as a user describes them, and how their ends are held.

SI units and radians; a pose takes section coordinates to those of its body; quaternions are scalar first.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from harness_opt.errors import ProblemError
from harness_opt.model import checks
from harness_opt.model.bodies import WORLD
from harness_opt.model.checks import Quaternion, Vector, shown
from harness_opt.model.courses import FoundPoses
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


Roll = Literal["untwisted", "free"]
ROLLS = get_args(Roll)
Side = Literal["start", "end"]
ENDS = ("start", "end")
ClipKind = Literal["fixed", "swivel", "pivot", "sleeve", "ring"]
CLIP_KINDS: tuple[ClipKind, ...] = get_args(ClipKind)
NO_CLIP = (*ENDS, "length")  # what no clip is called: their names stand beside these in design variables


@dataclass(frozen=True)
class End:
    """What holds one end of a cable: ``position`` or ``force``, and ``quaternion``, ``tangent`` or ``moment``.

    A tangent leaves the roll about it open. ``roll_deg`` turns the section from the body's x axis projected on it (its
    y axis where the tangent lies along x). "untwisted", which is meant where neither is said, takes the roll at which
    the cable carries no twisting moment at motion ``fitted_at`` of its :class:`CableRun`, plus ``turns``; from then on
    it is held. "free" is a swivel: the end turns about its tangent throughout.

    Args:
        position: of the centreline's end in the coordinates of ``body``, m.
        quaternion: section frame in the coordinates of ``body``; d3 points along growing arc length at both ends.
        force: dead load that the surroundings apply to the cable at this end, world, N.
        moment: the same for the moment, N m.
        turns: of an untwisted end, any number by which it is turned on from there about its tangent; else whole turns
            of twist added, at the end of the cable, to the smallest twist that joins the two clamps.
        body: name of the body that carries the clamp.
        holders: parts of that body that hold the cable here, by name: what it comes out of. None takes those that
            contain the clamp's point, or come nearer to it than the cable's radius.
        let_off: arc over which a holder's limit does not count, m: until the cable has left it, and near it after.
            None takes the radius and the limit, at least two diameters.
        tangent: d3 in the coordinates of ``body``, along growing arc length at both ends, of any length.
        roll: of an end with a tangent, "untwisted" or "free".
        roll_deg: of an end with a tangent, by hand, degrees.
        swivel: whether the end turns freely about d3 of its quaternion: what "free" is once the body is placed.
        found: frames in ``body`` over the motion of a clip that lets the cable turn, once they are found.

    A quantity that is given as neither is free: no force, or no moment.

    Raises:
        ProblemError: position and force together, two of quaternion, tangent and moment, a roll without a tangent,
            numbers that are not finite, a quaternion that is not a unit quaternion, turns that are not whole of an
            end that is not untwisted.
    """

    position: Vector | None = None
    quaternion: Quaternion | None = None
    force: Vector | None = None
    moment: Vector | None = None
    turns: float = 0
    body: str = WORLD
    holders: tuple[str, ...] | None = None
    let_off: float | None = None
    tangent: Vector | None = None
    roll: Roll | None = None
    roll_deg: float | None = None
    swivel: bool = False
    found: FoundPoses | None = None

    def __post_init__(self) -> None:
        found = checks.Gathered()
        if self.let_off is not None:
            with found:
                object.__setattr__(self, "let_off", checks.positive("let_off", self.let_off, zero=True))
        if self.holders is not None:
            object.__setattr__(self, "holders", tuple(self.holders))
        for given, load in (
            ("position", "force"),
            ("quaternion", "moment"),
            ("quaternion", "tangent"),
            ("tangent", "moment"),
            ("quaternion", "roll"),
            ("roll", "roll_deg"),
        ):
            if getattr(self, given) is not None and getattr(self, load) is not None:
                found.told.append(f"{load}: found {given} as well, expected {given} or {load}")
        for name in ("position", "force", "moment"):
            if getattr(self, name) is not None:
                with found:
                    object.__setattr__(self, name, checks.numbers(name, getattr(self, name), 3))
        if self.quaternion is not None:
            with found:
                object.__setattr__(self, "quaternion", checks.quaternion("quaternion", self.quaternion))
        with found:
            self._check_roll()
        found.raised()

    def _check_roll(self) -> None:
        """Check the tangent, what is said of the roll about it, and the turns."""
        if self.tangent is not None:
            object.__setattr__(self, "tangent", checks.direction("tangent", self.tangent))
        for name in ("roll", "roll_deg"):
            other = name == "roll" and self.quaternion is not None  # told already
            if getattr(self, name) is not None and self.tangent is None and not other:
                raise ProblemError(f"tangent: found nothing, expected a tangent for {name} to turn about")
        if self.roll is not None and self.roll not in ROLLS:
            raise ProblemError(f"roll: found {shown(self.roll)}, expected {checks.one_of(ROLLS, self.roll)}")
        if self.roll_deg is not None:
            object.__setattr__(self, "roll_deg", checks.numbers("roll_deg", [self.roll_deg], 1)[0])
        elif self.tangent is not None and self.roll is None:
            object.__setattr__(self, "roll", "untwisted")
        turns = self.turns
        if not isinstance(turns, (int, float)) or isinstance(turns, bool) or not math.isfinite(turns):
            raise ProblemError(f"turns: found {shown(turns)}, expected a number")
        if turns == int(turns):
            object.__setattr__(self, "turns", int(turns))
        elif self.roll != "untwisted":
            raise ProblemError(f"turns: found {shown(turns)}, expected a whole number: the roll is given")
        if turns and (self.roll == "free" or self.swivel):
            raise ProblemError(f"turns: found {shown(turns)}, expected 0, as it turns freely")

    @property
    def frame(self) -> Quaternion | None:
        """The section frame in the coordinates of ``body``; its roll is the projection's where it is open.

        None where the orientation is free.
        """
        if self.tangent is None:
            return self.quaternion
        return _tuple(rotations.from_tangent(self.tangent, math.radians(self.roll_deg or 0.0)))

    @property
    def has_open_roll(self) -> bool:
        """Whether the roll is to be found: once, or in every frame."""
        return self.roll is not None or self.swivel

    def held(self, quaternion: ArrayLike | None = None) -> End:
        """Return this end clamped in ``quaternion`` (4,), in the coordinates of ``body``; None takes its own frame."""
        frame = self.frame if quaternion is None else _tuple(np.asarray(quaternion, dtype=float))
        return dataclasses.replace(
            self,
            quaternion=frame,
            turns=0 if self.roll == "untwisted" else self.turns,
            tangent=None,
            roll=None,
            roll_deg=None,
            swivel=False,
        )

    def over(self, motion: ArrayLike) -> list[End]:
        """Return this end at each ``motion`` (P,), 0 to 1, in the frames that it was found in where it turns freely."""
        values = np.atleast_1d(np.asarray(motion, dtype=float))
        if self.found is None:
            return [self] * len(values)
        return [dataclasses.replace(self, quaternion=_tuple(q), found=None) for q in self.found.poses(values)[1]]

    def placed(self, position: ArrayLike, quaternion: ArrayLike) -> End:
        """Return this end in world coordinates, its body standing at ``position`` (3,) and ``quaternion`` (4,).

        A roll that is open turns freely; the frame there is the projection's.
        """
        end = self if self.tangent is None else self.held()
        moved: dict[str, object] = {"body": WORLD}
        if self.position is not None:
            moved["position"] = tuple(np.asarray(position) + rotations.rotate(quaternion, self.position))
        if end.quaternion is not None:
            moved["quaternion"] = tuple(rotations.multiply(quaternion, end.quaternion))
        if self.has_open_roll:
            moved |= {"swivel": True, "turns": 0}
        return dataclasses.replace(end, **moved)  # type: ignore[arg-type]


def _tuple(q: Array) -> Quaternion:
    found: Quaternion = tuple(q.tolist())
    return found


@dataclass(frozen=True, kw_only=True)
class Clip(End):
    """What holds a cable on its way, the cable going on beyond it.

    Args:
        name: of the clip, none other of the cable's.
        at: arc length at which the cable is clipped, m.
        kind: "fixed" clamps it like an end; in a "swivel" it turns freely about its tangent; a "pivot" holds its
            place alone; it slides through a "sleeve", which holds its tangent, and through a "ring", which does not. A
            sleeve that is given a quaternion or a roll guides a flat cable; in others it turns freely.

    Everything else is as of an :class:`End`. A fixed clip that leaves its roll open is fitted untwisted, outward from
    the start: the stretch that ends at it carries no twisting moment at ``fitted_at``. How the cable stands in a clip
    that lets it turn is found; a tangent given to a pivot is a first guess.

    Raises:
        ProblemError: as :class:`End`; a name or place that cannot be; a force, a moment, a roll that is free: a clip
            holds the cable; a roll or turns where it turns freely.
    """

    name: str
    at: float
    kind: ClipKind = "fixed"

    def __post_init__(self) -> None:
        found = checks.Gathered()
        with found:
            super().__post_init__()
        with found:
            object.__setattr__(self, "at", checks.positive("at", self.at))
        if self.name in NO_CLIP:
            found.told.append(f"name: found {self.name!r}, expected another than {', '.join(NO_CLIP)}")
        if self.kind not in CLIP_KINDS:
            found.told.append(f"kind: found {shown(self.kind)}, expected {checks.one_of(CLIP_KINDS, self.kind)}")
        for key in ("force", "moment"):
            if getattr(self, key) is not None:
                found.told.append(
                    f"{key}: found it at a clip, expected a position and a tangent: a clip holds the cable"
                )
        if self.roll == "free":
            found.told.append("roll: found 'free' at a clip, expected 'untwisted', or a roll that is given")
        if self.position is None:
            found.told.append("position: found nothing, expected where the clip stands")
        if self.kind not in ("pivot", "ring") and self.quaternion is None and self.tangent is None:
            found.told.append("tangent: found nothing, expected a tangent or a quaternion")
        if self.kind != "fixed":
            object.__setattr__(self, "roll", None)
            for key in ("turns", "roll_deg") if self.kind != "sleeve" else ("turns",):
                if getattr(self, key):
                    found.told.append(f"{key}: found {getattr(self, key)!r} at a {self.kind}, in which the cable turns")
        found.raised()

    @property
    def freedoms(self) -> int:
        """How many rotations of the cable it leaves free: none, that about its tangent, or all three."""
        guides = self.quaternion is not None or self.roll_deg is not None
        return {"fixed": 0, "swivel": 1, "pivot": 3, "sleeve": 0 if guides else 1, "ring": 3}[self.kind]

    @property
    def slides(self) -> bool:
        """Whether the cable slides through it."""
        return self.kind in ("sleeve", "ring")

    @property
    def is_free(self) -> bool:
        """Whether it lets the cable turn or slide."""
        return self.kind != "fixed" and bool(self.freedoms or self.slides)


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
