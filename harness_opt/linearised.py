"""Every limit of a simulated design as scaled margins with their derivatives: what the quadratic program sees.

A margin is scaled so that 0 holds and -1 is far off: clearance by the limit plus the cable's radius, the others by
their limit. Clearances are linearised at their witnesses, where the rate is the normal times the rate of the
cable's point; bend radius, twist and clamp loads at the worst station of every frame.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .clearance import ClearanceResult, PairClearance
from .limits import limit_label
from .problem import Problem
from .results import Motion
from .rotations import Array
from .sensitivity import ShapeRates

TINY = 1e-12  # keeps the direction of a vanishing vector finite


@dataclass(frozen=True)
class Rows:
    """Scaled margins (m,) that must be >= 0, their rates (m, k) per unit of the variables, and their limits' names."""

    margin: Array
    rate: Array
    name: tuple[str, ...]


def linearised(
    problem: Problem,
    motion: Motion,
    clearances: ClearanceResult,
    rates: Mapping[str, ShapeRates],
    asked: Mapping[str, float],
    variables: int,
) -> Rows:
    """Return the rows of all limits.

    Args:
        problem: the design simulated.
        motion, clearances: of that design.
        rates: of its shapes, by cable; empty leaves the rates of the rows at zero.
        asked: what is asked for beyond each limit, in its scale; must know every limit's name.
        variables: k.
    """
    rows = [
        _clearance_rows(problem, pair, motion, rates, asked, variables)
        for pair in clearances.pairs
        if pair.limit is not None
    ]
    for name in motion.cables:
        rows += _cable_rows(problem, name, motion, rates.get(name), asked, variables)
    if not rows:  # every pair was left out: nothing can be near its limit
        return Rows(np.ones(1), np.zeros((1, variables)), ("no limit",))
    return Rows(
        np.concatenate([row.margin for row in rows]),
        np.concatenate([row.rate for row in rows]),
        tuple(name for row in rows for name in row.name),
    )


def _clearance_rows(
    problem: Problem,
    pair: PairClearance,
    motion: Motion,
    rates: Mapping[str, ShapeRates],
    asked: Mapping[str, float],
    variables: int,
) -> Rows:
    """Linearise a pair's clearance at its witnesses, and at the nearest point of every frame."""
    found = pair.witnesses
    missing = np.setdiff1d(pair.nearest.frame, found.frame)
    name = limit_label("clearance", pair.cable, pair.obstacle)
    limit = pair.limit or 0.0
    scale = limit + problem.cables[pair.cable].cable.radius
    margins, slopes = [], []
    for witnesses in (found, pair.nearest.take(missing)):
        slope = np.zeros((len(witnesses.frame), variables))
        if rates:
            s = motion.cables[pair.cable].s
            moved: Array = at_stations(rates[pair.cable].position, s, witnesses.frame, witnesses.arc_length)
            if pair.obstacle.startswith("cable:"):
                other = pair.obstacle.removeprefix("cable:")
                s = motion.cables[other].s
                moved = moved - at_stations(rates[other].position, s, witnesses.frame, witnesses.other_arc_length)
            slope = np.einsum("wc,wck->wk", witnesses.normal, moved) / scale
        slopes.append(slope)
        margins.append((witnesses.clearance - limit) / scale - asked[name])
    margin = np.concatenate(margins)
    return Rows(margin, np.concatenate(slopes), (name,) * len(margin))


def _cable_rows(
    problem: Problem,
    cable: str,
    motion: Motion,
    rates: ShapeRates | None,
    asked: Mapping[str, float],
    variables: int,
) -> list[Rows]:
    """Linearise bend radius, twist and clamp loads at the worst station of every frame."""
    limits, shapes, rows = problem.limits, motion.cables[cable], []
    frame = np.arange(len(shapes.position))
    everywhere, clamps = np.arange(len(shapes.s)), np.array([0, len(shapes.s) - 1])
    bend = None if limits.bend_radius is None else 1.0 / limits.bend_radius
    for quantity, limit, part, stations, label in (
        ("curvature", bend, slice(0, 2), everywhere, "bend_radius"),
        ("curvature", limits.twist, slice(2, 3), everywhere, "twist"),
        ("force", limits.clamp_force, slice(0, 3), clamps, "clamp_force"),
        ("moment", limits.clamp_moment, slice(0, 3), clamps, "clamp_moment"),
    ):
        if limit is None:
            continue
        vector = getattr(shapes, quantity)[..., part]
        size = np.linalg.norm(vector, axis=-1)
        station = stations[np.argmax(size[:, stations], axis=1)]
        worst = size[frame, station]
        slope = np.zeros((len(frame), variables))
        if rates is not None:
            unit = vector[frame, station] / np.maximum(worst, TINY)[:, None]
            slope = -np.einsum("pc,pck->pk", unit, getattr(rates, quantity)[frame, station, part]) / limit
        name = limit_label(label, cable, None)
        rows.append(Rows(1.0 - worst / limit - asked[name], slope, (name,) * len(frame)))
    return rows


def at_stations(rates: Array, s: Array, frame: NDArray[np.integer[Any]], arc_length: Array) -> Array:
    """Return rates (W, 3, k) at ``arc_length`` (W,) of ``frame`` (W,) from those at stations (P, N, 3, k): cubic
    Lagrange interpolation on the four stations around."""
    spacing = s[1] - s[0]
    first = np.clip((arc_length / spacing).astype(int) - 1, 0, len(s) - 4)
    t = arc_length / spacing - first
    weights = np.stack(
        [
            (1 - t) * (2 - t) * (3 - t) / 6,
            t * (2 - t) * (3 - t) / 2,
            t * (t - 1) * (3 - t) / 2,
            t * (t - 1) * (t - 2) / 6,
        ]
    )
    return np.sum([weights[i][:, None, None] * rates[frame, first + i] for i in range(4)], axis=0)
