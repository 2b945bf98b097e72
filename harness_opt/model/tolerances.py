"""How far a quantity may be from its nominal value, and how often: the spread of values in a study.

Every spread ends somewhere, at ``nominal - half`` and ``nominal + half``: what lies outside is not built. So a study
can say before it starts whether a value is possible at all, and corners are corners.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist
from typing import Literal

import numpy as np

from harness_opt.errors import ProblemError
from harness_opt.model import checks
from harness_opt.numerics.rotations import Array

Distribution = Literal["uniform", "normal", "triangular"]
DISTRIBUTIONS = ("uniform", "normal", "triangular")

STANDARD = NormalDist()


@dataclass(frozen=True)
class Tolerance:
    """The spread of one quantity.

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
