"""Whether cables reach from clamp to clamp through the whole motion."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from harness_opt.model.cable import REACH_TOLERANCE
from harness_opt.model.limits import quoted
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array

Problem = Any  # asks while it is made whether its cables reach
SAMPLES = 201  # moments at which the distance of a cable's clamps is compared with its length


def clamp_way(problem: Problem, cable: str, motion: ArrayLike) -> Array | None:
    """Return the way (P, 3) from the start of ``cable`` to its end, m, at ``motion`` (P,); None with a free end."""
    run, places = problem.cables[cable], []
    for end in (run.start, run.end):
        if end.position is None:
            return None
        origin, turn = problem.poses(end.body, motion)
        places.append(origin + rotations.rotate(turn, np.broadcast_to(np.asarray(end.position), origin.shape)))
    way: Array = places[1] - places[0]
    return way


def shortest(problem: Problem, cable: str) -> tuple[float, float]:
    """Return how long ``cable`` has to be at least to reach its clamps, m, and the motion value that asks for it."""
    motion = np.linspace(0.0, 1.0, SAMPLES)
    way = clamp_way(problem, cable, motion)
    if way is None:
        return 0.0, 0.0
    distance = np.linalg.norm(way, axis=1)
    worst = int(np.argmax(distance))
    return float(distance[worst]), float(motion[worst])


def too_short(problem: Problem, cables: Iterable[str]) -> dict[str, str]:
    """Return what is wrong with those of ``cables`` that are too short for their clamps at some moment, by name."""
    found = {}
    for name in cables:
        (distance, at), length = shortest(problem, name), problem.cables[name].cable.length
        if not distance <= length * (1 + REACH_TOLERANCE):
            words = f"expected at least {distance:.6g}, the distance between its clamps"
            found[name] = f"cables.{quoted(name)}.length: found {length:g}, {words} at {problem.moments.words(at)}"
    return found
