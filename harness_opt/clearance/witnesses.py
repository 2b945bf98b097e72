"""What a search for small clearances is asked, and what it finds; the same for parts and for cables."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from harness_opt.clearance.centreline import Curve
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices

FAR = 20.0  # radii of the cable beyond the horizon: from there on a part is far away
FAR_SHARE = 0.05  # of the clearance of what is far away: to this it is wanted
BEYOND_DOUBT = 0.1  # of a violation: to this it is wanted
DECIDES = 0.9  # of a margin below the usual tolerance: to this it is wanted, so that the margin is larger
FINEST = 0.02  # of the usual tolerance: the least to which a clearance is wanted
LONG = "the search was longer than allowed"
CROWDED = "more frames would have to be solved between the others than allowed"
ROUGH = "between frames the shapes stray further from smooth curves than was estimated"
STOPPED = "the run was stopped before the search had ended"


@dataclass(frozen=True, eq=False)
class Witnesses:
    """Points of a cable, each with what is nearest to it on an obstacle: W of them.

    Args:
        frame: (W,).
        arc_length: (W,), of the point on the cable, m.
        clearance: (W,), m.
        normal: (W, 3), world, unit, from the obstacle to the cable: the clearance grows along it.
        point: (W, 3), world, on the obstacle's surface, m.
        other_arc_length: (W,), of ``point`` along the other cable, m; NaN for parts.
    """

    frame: Indices
    arc_length: Array
    clearance: Array
    normal: Array
    point: Array
    other_arc_length: Array

    def take(self, index: Indices | NDArray[np.bool_]) -> Witnesses:
        """Return those at ``index``, numbers (k,) or a mask (W,)."""
        return Witnesses(*(column[index] for column in vars(self).values()))

    @staticmethod
    def joined(several: Sequence[Witnesses]) -> Witnesses:
        """Return the witnesses of all ``several`` in one."""
        columns = zip(*(vars(witnesses).values() for witnesses in several), strict=True)
        return Witnesses(*(np.concatenate(column) for column in columns))


def never() -> bool:
    """Return False: nobody asks for a stop."""
    return False


@dataclass(frozen=True, eq=False)
class Task:
    """One cable, and what is asked about it.

    Args:
        cable: its name.
        curve: its centreline, in the coordinates of the obstacle.
        radius: m.
        error: of the cubics of ``curve``, m.
        tolerance, reach, most_queries: as in :class:`harness_opt.clearance.pairs.Options`, m.
        limit: m, or None.
        strict: whether the tolerance holds for what is far away too.
        enough: share of a margin to which it suffices to know a clearance that is no nearer than its limit.
        stop: asked again and again while the motion is searched; True ends the search without a certificate.
    """

    cable: str
    curve: Curve
    radius: float
    error: float
    tolerance: float
    reach: float
    most_queries: int
    limit: float | None = None
    strict: bool = False
    enough: float = 0.0
    stop: Callable[[], bool] = never

    @property
    def horizon(self) -> float:
        """The clearance below which witnesses are wanted, m."""
        return (self.limit or 0.0) + self.reach

    @property
    def far(self) -> float:
        """The clearance beyond which a part is far away, m."""
        return math.inf if self.strict else self.horizon + FAR * self.radius

    def tolerance_at(self, clearance: float) -> float:
        """Return the tolerance to which a smallest clearance is wanted, m.

        Less than usual where that decides whether the limit holds, and more where it is violated beyond doubt, or what
        is measured is far away.
        """
        margin = clearance - (self.limit or 0.0)
        if clearance > self.far:
            return max(self.tolerance, FAR_SHARE * clearance)
        if self.limit is None or margin >= self.tolerance:
            return self.tolerance if self.strict else max(self.tolerance, self.enough * margin)
        if margin < 0:
            return self.tolerance if self.strict else max(self.tolerance, BEYOND_DOUBT * -margin)
        return max(DECIDES * margin, FINEST * self.tolerance)


@dataclass(frozen=True, eq=False)
class Found:
    """Everything evaluated for one pair.

    Args:
        samples: in no order.
        minima: (k,), the numbers of those that are local minima along the cable.
        bound: no point of the centreline has a smaller clearance, m.
        sides: the numbers of samples in the same places as minima, nearest to other points of the obstacle.
        left: what :func:`harness_opt.clearance.to_part.after_leaving` says of either end of a cable whose clamp the
            part holds; None where it does not.
        lower: of a part, bounds below the clearances (P, M) at the places looked at first, m; None for cables.
    """

    samples: Witnesses
    minima: Indices
    bound: float
    lower: Array | None = None
    sides: Indices = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    left: tuple[tuple[Witnesses, Array] | None, ...] = (None, None)


@dataclass(frozen=True, eq=False)
class Certificate:
    """The smallest clearance found in any solved frame, and how sure it is the smallest of the motion.

    Args:
        place: one witness, in the coordinates of the obstacle; its frame has no meaning.
        motion: where it stands, 0 to 1.
        bound: no clearance is below this, m.
        reason: why that is not so close to it as was asked, or not known everywhere; empty where it is.
    """

    place: Witnesses
    motion: float
    bound: float
    reason: str


def local_minima(value: Array, horizon: float) -> tuple[Indices, Indices]:
    """Return rows and columns (k,) of each row's smallest entry and of the local minima below ``horizon``.

    Args:
        value: (P, M), clearances of frames and places along the cable, m; infinite where not known.
        horizon: m.
    """
    wall = np.full((len(value), 1), np.inf)
    low = (value < np.hstack([wall, value[:, :-1]])) & (value <= np.hstack([value[:, 1:], wall]))
    low &= value < horizon
    low[np.arange(len(value)), np.argmin(value, axis=1)] = True
    frame, column = np.nonzero(low)
    return frame, column
