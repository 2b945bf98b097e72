"""What must hold, what a redesign may change, what is sought, and how far what is built may be off."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from statistics import NormalDist
from typing import Literal

import numpy as np

from harness_opt.errors import ProblemError
from harness_opt.model import checks
from harness_opt.numerics.rotations import Array

Minimise = Literal["change", "length", "clips"]
Distribution = Literal["uniform", "normal", "triangular"]
DISTRIBUTIONS = ("uniform", "normal", "triangular")

STANDARD = NormalDist()


@dataclass(frozen=True)
class Limits:
    """What must hold at every moment; None leaves a limit out.

    Args:
        clearance: between the cable's surface and parts, other cables, itself, m.
        bend_radius: smallest radius of the centreline, m.
        twist: largest twist per length, rad/m.
        clamp_force: of the clamps at both ends of a cable, N.
        clamp_moment: N m.
        clip_force: of every clip between them, N.
        clip_moment: N m.
        travel: how far the cable slides back and forth through each sleeve and ring, m.
    """

    clearance: float | None = None
    bend_radius: float | None = None
    twist: float | None = None
    clamp_force: float | None = None
    clamp_moment: float | None = None
    clip_force: float | None = None
    clip_moment: float | None = None
    travel: float | None = None


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
        minimise: "change" (least change from the given design), "length" (of all cables together), or "clips" (the
            fewest of those that are optional, then the least change).
        variables: the design variables.
        couplings: quantities that follow them.
        weights: of the change of a variable, by name, 1 where left out; 0 changes it for nothing.
        maximise: "margin" asks for the largest worst margin instead, each as a share of its limit; None does not.
        snaps: whether the cables may snap on the way.
        round_length, round_deg: to multiples of which a redesign rounds the variables that it moves and nothing else
            follows, m and degrees; 0 rounds nothing.
        seed: of the designs that it looks at.
    """

    minimise: Minimise = "change"
    variables: tuple[Variable, ...] = ()
    couplings: tuple[Coupling, ...] = ()
    weights: Mapping[str, float] = field(default_factory=dict)
    maximise: Literal["margin"] | None = None
    snaps: bool = False
    round_length: float = 1e-4
    round_deg: float = 0.1
    seed: int = 0


@dataclass(frozen=True)
class Tolerance:
    """How far a quantity may be from its nominal value, and how often: its spread in a study.

    Every spread ends somewhere, at ``nominal - half`` and ``nominal + half``: what lies outside is not built. So a
    study can say before it starts whether a value is possible at all, and corners are corners.

    Args:
        plus_minus: half of the tolerance, in the unit of the key; above 0.
        percent: whether ``plus_minus``, and ``deviation``, are in percent of the nominal value instead.
        distribution: "uniform", "normal" (cut off at the tolerance) or "triangular".
        deviation: standard deviation of "normal", before it is cut; None takes a third of ``plus_minus``.
        nominal: the middle, in the unit of the key; None takes the problem's own value.

    Raises:
        ProblemError: a number that is not finite and above 0; a deviation of another distribution than "normal".
    """

    plus_minus: float
    percent: bool = False
    distribution: Distribution = "uniform"
    deviation: float | None = None
    nominal: float | None = None

    def __post_init__(self) -> None:
        checks.positive("plus_minus", self.plus_minus)
        if self.distribution not in DISTRIBUTIONS:
            known = ", ".join(repr(name) for name in DISTRIBUTIONS)
            raise ProblemError(f"distribution: found {self.distribution!r}, expected one of {known}")
        if self.deviation is not None:
            checks.positive("deviation", self.deviation)
            if self.distribution != "normal":
                raise ProblemError(f'deviation: found one of a {self.distribution} distribution, expected "normal"')
        if self.nominal is not None and not math.isfinite(self.nominal):
            raise ProblemError(f"nominal: found {self.nominal!r}, expected a finite number")

    @classmethod
    def normal(cls, deviation: float, *, percent: bool = False, nominal: float | None = None) -> Tolerance:
        """Return a normal distribution of standard ``deviation``, cut off at four of them."""
        normal_cut = 4.0  # standard deviations at which one that states no tolerance ends: one value in 16,000
        return cls(normal_cut * deviation, percent, "normal", deviation, nominal)

    @classmethod
    def between(cls, lower: float, upper: float) -> Tolerance:
        """Return a uniform distribution from ``lower`` to ``upper``; raises ProblemError unless ``lower`` is less."""
        if not lower < upper:
            raise ProblemError(f"from, to: found {lower!r} and {upper!r}, expected the first below the second")
        return cls(0.5 * (upper - lower), nominal=0.5 * (lower + upper))

    @property
    def _deviation(self) -> float:
        """Standard deviation of the normal distribution before it is cut, in half tolerances."""
        stated_deviations = 3.0  # standard deviations in the tolerance where none is stated: one value in 370 is lost
        return 1.0 / stated_deviations if self.deviation is None else self.deviation / self.plus_minus

    def offsets(self, probability: Array) -> Array:
        """Return the values, -1 to 1 half tolerances from the nominal one, below which ``probability`` (...) lies."""
        p = np.asarray(probability, dtype=float)
        if self.distribution == "uniform":
            return 2.0 * p - 1.0
        if self.distribution == "triangular":  # its distribution function is (1 + t)^2 / 2 up to the middle
            return np.where(p < 0.5, np.sqrt(2.0 * p) - 1.0, 1.0 - np.sqrt(2.0 * (1.0 - p)))
        low = STANDARD.cdf(-1.0 / self._deviation)
        inside = np.clip(low + p * (1.0 - 2.0 * low), 1e-300, 1.0 - 1e-16)
        found = [self._deviation * STANDARD.inv_cdf(float(share)) for share in inside.ravel()]
        offsets: Array = np.clip(np.reshape(found, p.shape), -1.0, 1.0)
        return offsets

    def half(self, nominal: float) -> float:
        """Return half the tolerance around ``nominal``, in the unit of the key."""
        return self.plus_minus * abs(nominal) / 100.0 if self.percent else self.plus_minus


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
