"""Which quantity moves a limit most: derivatives per millimetre, degree and percent, and over tolerances, ranked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from harness_opt.clearance.limits import STRAIGHT, limit_label
from harness_opt.design.key_derivatives import Linear
from harness_opt.files.quantity_keys import Quantity
from harness_opt.model.tolerances import Tolerance
from harness_opt.report.summary import FILE_WORDS

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


def tightest(found: Linear) -> str:
    """Return the name of the clearance with the smallest margin; without clearances, of any limit."""
    names = [name for name in found.names if name.startswith("clearance")] or list(found.names)
    return min(names, key=lambda name: found.margin[found.worst(name)])


def worst_margin(found: Linear, name: str) -> float:
    """Return the smallest margin of a limit, in the unit that the file has for it."""
    return float(found.margin[found.worst(name)] * _unit(found, name))


def _unit(found: Linear, name: str) -> float:
    """Return what a scaled margin of a limit is multiplied by: to be in the file's unit, at its worst place."""
    scale = float(found.scales[found.names.index(name)])
    kind = name.partition(" of ")[0].replace(" ", "_")
    if kind == "bend_radius":
        return scale / _bent(found, name)
    return scale * FILE_WORDS.get(kind, ("", 1.0))[1]


def _bent(found: Linear, name: str) -> float:
    """Return limit x curvature where a bend radius is smallest; of a straight cable as the limits give it."""
    scale = float(found.scales[found.names.index(name)])  # the limit; the scaled margin is 1 - limit x curvature
    return max(1.0 - float(found.margin[found.worst(name)]), scale * STRAIGHT)


def ranked(found: Linear, name: str, tolerances: Mapping[str, Tolerance] | None = None) -> list[Effect]:
    """Return what every quantity does to the worst of a limit, the largest effect first.

    Args:
        found: the problem, linearised.
        name: of the limit.
        tolerances: by key, where they are known: effects are then those of half of them.
    """
    row, effects = found.worst(name), []
    unit = _unit(found, name)
    if name.startswith("bend radius"):  # d(1 / curvature) = radius x (scaled change) / (what is left of 1)
        unit /= _bent(found, name)
    for quantity, rate in zip(found.quantities, found.rate[row], strict=True):
        step, amount = step_of(quantity)
        spread = (tolerances or {}).get(quantity.key)
        half = None if spread is None or not amount else spread.half(quantity.value) / amount
        effects.append(Effect(quantity.key, step, float(rate * amount * unit), half))
    order = np.argsort([-effect.size for effect in effects], kind="stable")
    return [effects[i] for i in order]


def by_limit(found: Linear) -> dict[str, str]:
    """Return the limits' names in tables, such as "clearance.lead.bracket", by those in words."""
    words = {}
    for pair in found.clearances.pairs:
        words[limit_label("clearance", pair.cable, pair.obstacle)] = f"clearance.{pair.cable}.{pair.obstacle}"
    for cable in found.motion.cables:
        for kind in ("bend_radius", "twist", "clamp_force", "clamp_moment"):
            words[limit_label(kind, cable, None)] = f"{FILE_WORDS.get(kind, (kind, 1.0))[0]}.{cable}"
    return {name: words[name] for name in found.names}
