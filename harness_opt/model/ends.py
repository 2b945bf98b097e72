"""What holds a cable: its ends, and the clips on its way.

SI units and radians; a pose takes section coordinates to those of its body; quaternions are scalar first.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from harness_opt.errors import ProblemError
from harness_opt.model import checks
from harness_opt.model.bodies import WORLD
from harness_opt.model.checks import Quaternion, Vector, shown
from harness_opt.model.courses import FoundPoses
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array

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
        optional: whether a redesign that asks for the fewest clips may do without it.

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
    optional: bool = False

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
