"""How much margin a design needs for what is built to hold its limits: linearised margins over stated tolerances.

With margins m + G t, linear in the deviations t, the worst corner of a limit is m - |G| t_max (Taguchi's worst case; Du
and Chen, "Towards a better understanding of modeling feasibility robustness in engineering design", 2000, section 3),
and the share that holds all limits is that of samples of t. What the limits must be held with beyond zero is their
allowance; a redesign that asks for it, linearised anew at its end, is iterated until the allowances stand still.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from harness_opt.design.key_derivatives import Linear, linear
from harness_opt.files.quantities import quantities_of
from harness_opt.model.design import Robust
from harness_opt.model.limits import LimitId
from harness_opt.model.problem import Problem
from harness_opt.numerics.rotations import Array
from harness_opt.parts.scene import Scene

SAMPLES = 8192  # of the linearised margins: half a per cent of yield, in a tenth of a second
AT_ONCE = 512  # samples of which the margins are held in memory
MOST_CORNERED = 12  # quantities: 4,096 corners
BISECTIONS = 20  # of the level of quantiles: to one sample


@dataclass(frozen=True)
class Within:
    """How a design fares within tolerances, by linearised margins.

    Args:
        share: of what is built that holds all limits.
        corner: smallest margin at any corner of the tolerances, a share of its limit; below 0 is violated.
        by_limit: the share that holds each limit.
        nominal: by limit, the smallest margin of the nominal design, as a share of the limit.
        allowances: by limit, what that margin has to be at least.
    """

    share: float
    corner: float
    by_limit: Mapping[LimitId, float]
    nominal: Mapping[LimitId, float]
    allowances: Mapping[LimitId, float]

    def holds(self, robust: Robust, slack: float) -> bool:
        """Return whether the limits hold as ``robust`` asks, to within ``slack`` of a limit at corners."""
        return self.corner >= -slack if robust.hold == "corners" else self.share >= robust.share


@dataclass(frozen=True)
class Yield:
    """The share of simulated samples that hold all limits.

    Args:
        share: of the samples.
        samples: how many.
        error: standard error of the share.
        failures: samples that could not be simulated; they hold nothing.
        linear: the share of the same samples by linearised margins.
    """

    share: float
    samples: int
    error: float
    failures: int
    linear: float


@dataclass(frozen=True)
class Robustness:
    """What a redesign within tolerances found.

    Args:
        hold, asked: what was asked for: "quantile" and its share, or "corners" and 1.
        holds: whether it is so, by linearised margins.
        rounds: redesigns made, each with the allowances of the one before.
        before, after: the design given, and the one found; None where it could not be simulated.
        yield_before, yield_after: the same by simulated samples; None where none were asked for.
    """

    hold: str
    asked: float
    holds: bool
    rounds: int
    before: Within | None
    after: Within | None
    yield_before: Yield | None = None
    yield_after: Yield | None = None


def within(problem: Problem, scene: Scene, robust: Robust, frames: Array | None = None) -> Within:
    """Return how ``problem`` fares within the tolerances of ``robust``.

    Args:
        problem: the design.
        scene: its parts.
        robust: the tolerances, and what is asked.
        frames: motion values (P,); None takes the problem's own.

    Raises:
        ProblemError: a tolerance of what has no derivative.
        SolveError: the design cannot be simulated.
    """
    return judged(linear(quantities_of(problem), list(robust.tolerances), scene, frames), robust)


def judged(found: Linear, robust: Robust) -> Within:
    """Return how a linearised design fares within the tolerances of ``robust``; see :func:`within`."""
    spreads = [robust.tolerances[quantity.key] for quantity in found.quantities]
    half = np.array([spread.half(quantity.value) for spread, quantity in zip(spreads, found.quantities, strict=True)])
    points = np.random.default_rng(robust.seed).random((SAMPLES, len(spreads)))
    offsets = np.stack([spread.offsets(points[:, j]) for j, spread in enumerate(spreads)], axis=-1)
    worst = smallest(found, offsets * half)
    corners = _corners(found, half)
    nominal = _least(found, found.margin[:, None])[:, 0]
    drops = np.maximum(nominal[:, None] - worst, 0.0)
    allowances = nominal - corners if robust.hold == "corners" else _quantiles(drops, nominal, robust.share)
    held = worst >= 0
    return Within(
        float(np.mean(np.all(held, axis=0))),
        float(np.min(corners)),
        dict(zip(found.limits, np.mean(held, axis=1).tolist(), strict=True)),
        dict(zip(found.limits, nominal.tolist(), strict=True)),
        dict(zip(found.limits, allowances.tolist(), strict=True)),
    )


def _corners(found: Linear, half: Array) -> Array:
    """Return the smallest margin (limits,) of each limit at any corner of the tolerances ``half`` (k,).

    Of many quantities, where corners are too many, the worst corner of each row as if it were flat.
    """
    if len(half) > MOST_CORNERED:
        return _least(found, (found.margin - np.abs(found.rate) @ half)[:, None])[:, 0]
    signs = np.array(list(itertools.product((-1.0, 1.0), repeat=len(half))))
    result: Array = smallest(found, signs * half).min(axis=1)
    return result


def _least(found: Linear, margins: Array) -> Array:
    """Return the smallest of ``margins`` (m, n) of each limit, (limits, n)."""
    return np.stack([margins[found.limit == i].min(axis=0) for i in range(len(found.limits))])


def smallest(found: Linear, deviations: Array) -> Array:
    """Return the smallest margin of each limit, (limits, n), at ``deviations`` (n, k) from the nominal design."""
    parts = np.array_split(deviations, max(1, len(deviations) // AT_ONCE))
    return np.concatenate([_least(found, _margins(found, part)) for part in parts], axis=1)


def _margins(found: Linear, deviations: Array) -> Array:
    """Return all margins (m, n) at ``deviations`` (n, k)."""
    curved = np.flatnonzero(np.any(found.second, axis=(1, 2)))
    margins = found.margin[:, None] + found.rate @ deviations.T
    margins[curved] += 0.5 * np.einsum("mkn,nk->mn", found.second[curved] @ deviations.T, deviations)
    return margins


def _quantiles(drops: Array, nominal: Array, share: float) -> Array:
    """Return the smallest allowances, quantiles of ``drops`` (limits, n) of one level, with which all limits hold.

    A limit with more margin than that, ``nominal`` (limits,), loses nothing.
    """

    def together(level: float) -> tuple[Array, float]:
        asked = np.quantile(drops, level, axis=1)
        return asked, float(np.mean(np.all(drops <= np.maximum(asked, nominal)[:, None], axis=0)))

    low, high = share, 1.0
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if together(middle)[1] >= share else (middle, high)
    return together(high)[0]
