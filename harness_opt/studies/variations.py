"""The variants of a study: grids, lists, Latin hypercubes and Monte Carlo samples of a problem's quantities."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from harness_opt.errors import ProblemError
from harness_opt.files.quantities import Quantities
from harness_opt.files.quantity_keys import Quantity
from harness_opt.model.checks import dotted, one_of, shown
from harness_opt.model.design import Tolerance
from harness_opt.numerics.rotations import Array

Method = Literal["grid", "list", "latin hypercube", "monte carlo"]
Values = dict[str, Any]  # of the varied quantities, by key

METHODS = ("grid", "list", "latin hypercube", "monte carlo")
SAMPLED = ("latin hypercube", "monte carlo")
INNER = 0.314  # half tolerances from the middle: shows a key that takes whole numbers only
FEW = 100  # values of one key that are all looked at
MOST_VARIANTS = 1_000_000  # each takes a second or so: more is a slip of the keyboard


@dataclass(frozen=True)
class Variations:
    """What a study varies, and how.

    Args:
        method: "grid" (all combinations of listed values), "list" (the variants as given), "latin hypercube" or
            "monte carlo".
        vary: by key of the problem: the values of a grid; or a :class:`~harness_opt.model.design.Tolerance` to
            sample, or values of which each is as likely.
        samples: how many variants to sample.
        seed: of the samples; the same gives the same.
        variants: of a list: the values by key, of each.

    Raises:
        ProblemError: an unknown method, or what does not go with it.
    """

    method: Method
    vary: Mapping[str, Tolerance | Sequence[Any]] = field(default_factory=dict)
    samples: int = 0
    seed: int = 0
    variants: Sequence[Mapping[str, Any]] = ()

    def __post_init__(self) -> None:
        mistakes = []
        if self.method not in METHODS:
            raise ProblemError(f"method: found {shown(self.method)}, expected {one_of(METHODS, self.method)}")
        if self.method == "list":
            if not self.variants or self.vary:
                mistakes.append("variants: expected the variants of a list, at least one, and nothing in vary")
        elif not self.vary or self.variants:
            mistakes.append(f"vary: expected at least one key to vary by {self.method}, and no variants")
        whole = isinstance(self.samples, int) and isinstance(self.seed, int)
        if self.method in SAMPLED and not (whole and 0 < self.samples <= MOST_VARIANTS and self.seed >= 0):
            words = f"expected 1 to {MOST_VARIANTS} samples and a seed of at least 0"
            mistakes.append(f"samples: found {shown(self.samples)} with seed {shown(self.seed)}, {words}")
        if self.method not in SAMPLED and self.samples:
            mistakes.append(f"samples: found {shown(self.samples)}, expected none for a {self.method}")
        if mistakes:
            raise ProblemError(mistakes)

    @property
    def keys(self) -> list[str]:
        """The varied keys."""
        return list(dict.fromkeys((*self.vary, *(key for variant in self.variants for key in variant))))


def expand(quantities: Quantities, variations: Variations) -> list[Values]:
    """Return the values of every variant, in order.

    Args:
        quantities: of the problem.
        variations: what to vary, and how.

    Raises:
        ProblemError: an unknown key; a value, or the end of a distribution, that the problem's file would be refused
            for; keys of which one holds another; too many variants. Every mistake is named.
    """
    mistakes = [*_unknown(quantities, variations.keys), *_overlapping(quantities, variations.keys)]
    count = math.prod(len(spread) for spread in variations.vary.values() if not isinstance(spread, Tolerance))
    if variations.method == "grid" and count > MOST_VARIANTS:  # before each of them is looked at
        mistakes.append(f"vary: found a grid of {count:,} variants, expected at most {MOST_VARIANTS:,}")
    if mistakes:
        raise ProblemError(mistakes)
    if variations.method == "list":
        mistakes = [
            f"variants, number {number}: {line}"
            for number, variant in enumerate(variations.variants)
            for line in quantities.mistakes(variant)
        ]
    else:
        mistakes = [
            f"{dotted(('vary', key))}: {line}"
            for key, spread in variations.vary.items()
            for line in _impossible(quantities, key, spread, variations.method)
        ]
    if mistakes:
        raise ProblemError(mistakes)
    return list(_expanded(quantities, variations))


def _expanded(quantities: Quantities, variations: Variations) -> Iterator[Values]:
    keys, spreads = list(variations.vary), list(variations.vary.values())
    if variations.method == "list":
        yield from (dict(variant) for variant in variations.variants)
    elif variations.method == "grid":
        for values in itertools.product(*spreads):  # type: ignore[arg-type]
            yield dict(zip(keys, values, strict=True))
    else:
        points = _points(variations)
        columns = [sampled(quantities[key], spreads[j], points[:, j]) for j, key in enumerate(keys)]
        for values in zip(*columns, strict=True):
            yield dict(zip(keys, values, strict=True))


def _points(variations: Variations) -> Array:
    """Return points (samples, keys) of the unit cube."""
    count = len(variations.vary)
    if variations.method == "monte carlo":  # row by row: more samples begin with the same ones
        return np.random.default_rng(variations.seed).random((variations.samples, count))
    from scipy.stats import qmc

    found: Array = qmc.LatinHypercube(count, rng=variations.seed).random(variations.samples)
    return found


def sampled(quantity: Quantity, spread: Tolerance | Sequence[Any], points: Array) -> list[Any]:
    """Return the values that a spread has at ``points`` (n,) of its distribution function, 0 to 1."""
    if not isinstance(spread, Tolerance):
        return [spread[min(int(point * len(spread)), len(spread) - 1)] for point in points]
    return [_moved(quantity, spread, offset) for offset in spread.offsets(points).tolist()]


def _moved(quantity: Quantity, spread: Tolerance, offset: float) -> Any:
    """Return the value that is ``offset`` half tolerances from the middle; lists are scaled."""
    middle = quantity.value if spread.nominal is None else spread.nominal
    if isinstance(middle, (tuple, list)):
        return [entry + offset * spread.half(entry) for entry in middle]
    return float(middle + offset * spread.half(middle))


# --- mistakes ------------------------------------------------------------------------------------------


def _unknown(quantities: Quantities, keys: Sequence[str]) -> Iterator[str]:
    for key in keys:
        try:
            quantities[key]
        except ProblemError as error:
            yield from error.mistakes


def _overlapping(quantities: Quantities, keys: Sequence[str]) -> Iterator[str]:
    """Yield the keys that hold another one: which of the two would count?"""
    known = [quantities[key] for key in keys if key in quantities and not quantities[key].change]
    for outer, inner in itertools.permutations(known, 2):
        if outer.component is None and outer.path == inner.path[: len(outer.path)]:
            yield f"{outer.key}: found {inner.key} as well, which is in it, expected one of the two"


def _telling(values: Sequence[Any]) -> Sequence[Any]:
    """Return the values that tell whether all of them are possible.

    Of many numbers the smallest and the largest, the one nearest to 0 on either side, and one that is not whole: what
    a number of the file may be is an interval, whole or not, with 0 in it or without.
    """
    numbers = all(type(value) in (int, float) and math.isfinite(value) for value in values)
    if len(values) <= FEW or not numbers:
        return values
    found = [min(values), max(values)]
    found += [f(side) for f, side in ((max, [v for v in values if v < 0]), (min, [v for v in values if v > 0])) if side]
    found += [value for value in values if value == 0 or value != int(value)][:1]
    return list(dict.fromkeys(found))


def _impossible(quantities: Quantities, key: str, spread: Tolerance | Sequence[Any], method: str) -> Iterator[str]:
    """Yield what is wrong with a spread, or with the values that it reaches."""
    if not isinstance(spread, Tolerance):
        if isinstance(spread, str) or not len(spread):
            yield f"found {shown(spread)}, expected a list of values"
            return
        for value in _telling(spread):
            yield from quantities.mistakes({key: value})
        return
    if method == "grid":
        yield "found a distribution, expected values, or from, to and count, for a grid"
        return
    quantity = quantities[key]
    middle = quantity.value if spread.nominal is None else spread.nominal
    entries = middle if isinstance(middle, (tuple, list)) else [middle]
    if not all(isinstance(entry, (int, float)) and not isinstance(entry, bool) for entry in entries):
        yield f"found a distribution around {shown(middle)}, expected a nominal number, or a list of values"
    elif isinstance(middle, (tuple, list)) and not spread.percent:
        yield f"found a distribution around {shown(middle)}, expected one in percent, or one for each component"
    elif spread.percent and not any(entries):
        yield "found a distribution in percent of 0, expected plus_minus or deviation in the key's own unit"
    else:
        low, high, inner = (_moved(quantity, spread, offset) for offset in (-1.0, 1.0, INNER))
        for value in (low, high, inner):
            for line in quantities.mistakes({key: value}):
                yield f"found a {spread.distribution} distribution from {shown(low)} to {shown(high)}; {line}"
