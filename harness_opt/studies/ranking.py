"""Which quantity moves a limit most: derivatives per millimetre, degree and percent, and over tolerances, ranked."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from harness_opt.clearance.limits import STRAIGHT
from harness_opt.design.key_derivatives import Linear
from harness_opt.files.quantity_keys import Quantity
from harness_opt.model.design import Tolerance
from harness_opt.model.limits import LimitId, LimitKind

MM = 1e-3  # of a metre
PERCENT = 1e-2
LENGTHS = ("length", "diameter", "position", "point", "from", "to")  # keys in metres, where they stand last but for x


@dataclass(frozen=True)
class Effect:
    """What one quantity does to one limit.

    Args:
        key: of the quantity.
        step: "mm", "deg" or "%": what ``per_step`` is per.
        per_step: change of the margin by one step, in the limit's own unit.
        tolerance: half of it, in steps; None where none was stated.
    """

    key: str
    step: str
    per_step: float
    tolerance: float | None = None

    @property
    def size(self) -> float:
        """How much the margin changes: over half the tolerance, or by one step."""
        return abs(self.per_step) * (1.0 if self.tolerance is None else self.tolerance)


def step_of(quantity: Quantity) -> tuple[str, float]:
    """Return the step that people think in, and how much of the key it is."""
    if quantity.unit:
        return ("deg", 1.0) if quantity.unit == "deg" else ("%", 1.0)
    if quantity.path[-1] in LENGTHS:
        return "mm", MM
    return "%", PERCENT * abs(quantity.value)


def tightest(found: Linear) -> LimitId:
    """Return the clearance with the smallest margin; without clearances, any limit's.

    What a cable never comes near, itself above all, is none: its margin is as large as it has been looked for.
    """
    far = {pair.id for pair in found.clearances.pairs if not math.isfinite(pair.worst)}
    limits = [limit for limit in found.limits if limit.kind is LimitKind.CLEARANCE and limit not in far]
    limits = limits or [limit for limit in found.limits if limit not in far] or list(found.limits)
    return min(limits, key=lambda limit: found.margin[found.worst(limit)])


def worst_margin(found: Linear, limit: LimitId) -> float:
    """Return the smallest margin of a limit, in the unit that the file has for it."""
    return float(found.margin[found.worst(limit)] * _unit(found, limit))


def _unit(found: Linear, limit: LimitId) -> float:
    """Return what a scaled margin of a limit is multiplied by: to be in the file's unit, at its worst place."""
    scale = float(found.scales[found.limits.index(limit)])
    if limit.kind is LimitKind.BEND_RADIUS:
        return scale / _bent(found, limit)
    return scale * limit.kind.from_si


def _bent(found: Linear, limit: LimitId) -> float:
    """Return limit x curvature where a bend radius is smallest; of a straight cable as the limits give it."""
    scale = float(found.scales[found.limits.index(limit)])  # the limit; the scaled margin is 1 - limit x curvature
    return max(1.0 - float(found.margin[found.worst(limit)]), scale * STRAIGHT)


def ranked(found: Linear, limit: LimitId, tolerances: Mapping[str, Tolerance] | None = None) -> list[Effect]:
    """Return what every quantity does to the worst of a limit, the largest effect first.

    Args:
        found: the problem, linearised.
        limit: of the problem.
        tolerances: by key, where they are known: effects are then those of half of them.
    """
    row, effects = found.worst(limit), []
    unit = _unit(found, limit)
    if limit.kind is LimitKind.BEND_RADIUS:  # d(1 / curvature) = radius x (scaled change) / (what is left of 1)
        unit /= _bent(found, limit)
    for quantity, rate in zip(found.quantities, found.rate[row], strict=True):
        step, amount = step_of(quantity)
        spread = (tolerances or {}).get(quantity.key)
        half = None if spread is None or not amount else spread.half(quantity.value) / amount
        effects.append(Effect(quantity.key, step, float(rate * amount * unit), half))
    order = np.argsort([-effect.size for effect in effects], kind="stable")
    return [effects[i] for i in order]
