"""The rod's equations with every kind of ends, all their parameters generic."""

from __future__ import annotations

import itertools

import numpy as np

from harness_opt.numerics import rotations
from harness_opt.rod.boundary import Boundary, Kind
from harness_opt.rod.collocation import BoundCollocation, collocation
from harness_opt.rod.equations import Section

SWIVELS = [Kind(True, True, True, True, *swivel) for swivel in ((True, False), (False, True), (True, True))]
KINDS = [Kind(*given) for given in itertools.product([True, False], repeat=4) if given[0] or given[2]] + SWIVELS
ELEMENTS, STAGES = 3, 2


def named(kind: Kind) -> str:
    start = ("position" if kind.start_position else "force") + "+" + ("frame" if kind.start_orientation else "moment")
    end = ("position" if kind.end_position else "force") + "+" + ("frame" if kind.end_orientation else "moment")
    swivels = " swivel" * (kind.start_swivels + kind.end_swivels) + (" at the start" if kind.start_swivels else "")
    return f"{start}, {end}{swivels}"


def setup(kind: Kind, loaded: bool) -> tuple[dict, np.ndarray]:
    """Return parameters of a :class:`BoundCollocation`, all generic, and unknowns that are no solution."""
    random = np.random.default_rng(7)
    vectors = {name: random.normal(size=3) for name in ("start_force", "end_force", "start_moment", "end_moment")}
    boundary = Boundary(
        kind,
        0.3 * random.normal(size=3),
        rotations.normalise(random.normal(size=4)),
        rotations.normalise(random.normal(size=4)),
        **vectors,
    )
    section = Section(np.array([0.6, 1.7, 0.9]), random.normal(size=3))
    load = 3 * random.normal(size=3) if loaded else np.zeros(3)
    mesh = np.array([0.0, 0.3, 0.45, 1.0])
    x = random.normal(size=collocation(ELEMENTS, STAGES, loaded).size)
    return {"section": section, "load": load, "boundary": boundary, "mesh": mesh}, x


def bound(given: dict) -> BoundCollocation:
    return collocation(ELEMENTS, STAGES, bool(np.any(given["load"]))).bind(**given)
