"""All colours of pages, pictures and charts; how numbers along a cable become colours, and the key that says which."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness_opt.clearance import along_cable as colouring
from harness_opt.clearance.limits import bending
from harness_opt.clearance.pairs import ClearanceResult
from harness_opt.model.limits import LimitKind
from harness_opt.model.results import Motion
from harness_opt.numerics.rotations import Array

# far from the two of trouble; the same before and after
CABLES = ("#1f6fb4", "#2a9d5c", "#8a4fbf", "#0e8f9c", "#6b4e2e", "#5b6770")
TOUCHES, SHORT = "#e0141e", "#f28e1c"  # of a point of a cable that touches something, and that breaks a limit
STILL_PART, MOVING_PART, HIT_PART = "#c9cdd2", "#a9b4c2", "#f0a8a4"
EDGE, INK = "#3c434b", "#1e2328"  # of parts, and of words
AXES = ("#d62728", "#2ca02c", "#1f5fd0")  # d1, d2, d3
SLEEVE = "#4a525b"  # of a clamp
VERIFIED, VIOLATED = "#1f6fb4", "#b2182b"  # points of a trade-off curve
LESS, MORE = "#c0504d", "#4f81bd"  # what a quantity below and above its nominal value does
# of what is far from any limit (0) to what is worst (1)
RAMP = ((0.0, "#2c6fa6"), (0.35, "#4fae9b"), (0.6, "#dcc94c"), (0.8, "#e8872c"), (1.0, "#d01c1f"))
LIMIT_ROOM = 0.2  # of a key: other ticks keep so far from the limit's
TICKS = 5


@dataclass(frozen=True)
class Key:
    """The key of one way to colour cables.

    Args:
        title: of the quantity.
        most: curvature (1/m) or twist (deg/m) that has the last colour, or clearance (m) that has the first.
        ticks: place on the ramp, 0 to 1, words, and whether it is the limit.
    """

    title: str
    most: float
    ticks: tuple[tuple[float, str, bool], ...]


def keys(results: Sequence[tuple[Motion, ClearanceResult]]) -> dict[str, Key]:
    """Return the keys of "bend", "twist" and "clearance" that serve several motions of one scene.

    Args:
        results: motions and their clearances; the limits are those of the last.
    """
    problem = results[-1][0].problem
    limits = problem.limits
    radii = {radius for name in problem.cables if (radius := problem.cable_limit(LimitKind.BEND_RADIUS, name))}
    radius = next(iter(radii)) if len(radii) == 1 else None  # of several none is the limit of a colour
    bend = max(float(np.max(bending(cable))) for motion, _ in results for cable in motion.cables.values())
    bend = max([bend, *(1.0 / one for one in radii)])
    twists = [float(np.max(np.abs(c.curvature[..., 2]))) for motion, _ in results for c in motion.cables.values()]
    twist = math.degrees(max([*twists, limits.twist or 0.0]))
    allowed = min((pair.limit for _, found in results for pair in found.pairs if pair.limit), default=None)
    far = colouring.far(problem)
    steps = [k / (TICKS - 1) for k in range(TICKS)]
    bends = [(t, f"{1e3 / (t * bend):.0f} mm" if t * bend > 0 else "straight") for t in steps]
    turns = [(t, f"{t * twist:.0f} deg/m") for t in steps]
    gaps = [(1 - t, f"{1e3 * t * far:.3g} mm" + (" and more" if t == 1 else "")) for t in steps]
    turn = None if limits.twist is None else math.degrees(limits.twist)
    return {
        "bend": _key(
            "Bend radius", bend, bends, (1 / radius / bend, f"limit {1e3 * radius:.3g} mm") if radius else None
        ),
        "twist": _key("Twist", twist, turns, (turn / twist, f"limit {turn:.0f} deg/m") if turn else None),
        "clearance": _key(
            "Clearance", far, gaps, (1 - allowed / far, f"limit {1e3 * allowed:.3g} mm") if allowed else None
        ),
    }


def _key(title: str, most: float, ticks: list[tuple[float, str]], limit: tuple[float, str] | None) -> Key:
    """Return one key; the limit's tick comes before those it stands too near to."""
    words = [(*tick, False) for tick in ticks if not limit or abs(tick[0] - limit[0]) > LIMIT_ROOM]
    return Key(title, most or 1.0, (*words, (*limit, True)) if limit else tuple(words))


def ramp(at: Array) -> Array:
    """Return the colours (n, 3), 0 to 255, of places ``at`` (n,) on the ramp."""
    stops = np.array([stop for stop, _ in RAMP])
    parts = np.array([rgb(name) for _, name in RAMP])
    return np.column_stack([np.interp(at, stops, part) for part in parts.T])


def rgb(colour: str) -> Array:
    """Return red, green and blue (3,), 0 to 255, of a colour such as "#1f6fb4"."""
    return np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)], dtype=float)
