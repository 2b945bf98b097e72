"""A bundle of two cables tied every 80 mm: not too near each other from tie to tie, and looked at outside them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import harness_opt as ho
from harness_opt.clearance.pairs import PairClearance
from harness_opt.clearance.what_counts import arc_apart

RADIUS, LENGTH, AT = 0.003, 0.42, (0.13, 0.21, 0.29)  # of the cables, and where they are tied, m
LIMIT = 0.004  # of their clearance, m


def bundle(clearance: float) -> ho.Problem:
    """Return two cables between clamps 60 mm apart, tied side by side between, their ends moving together."""
    cables = {}
    for name, side in (("left", 1.0), ("right", -1.0)):
        clips = tuple(
            ho.Clip(name=f"t{k}", at=at, position=(0, side * RADIUS, 0), tangent=(1, 0, 0), roll_deg=0, body=f"tie{k}")
            for k, at in enumerate(AT)
        )
        start, end = (
            ho.End((x, side * 0.03, 0), tangent=(1, 0, 0), roll_deg=0, body=body)
            for x, body in ((0, "world"), (0.4, "slide"))
        )
        cables[name] = ho.CableRun(ho.Cable(LENGTH, 2 * RADIUS, 0.01, 0.008, 0.08), start, end, clips=clips)
    ties = {f"tie{k}": ho.Body(position=(at - 0.005, 0, 0), free=True, mass=0.001) for k, at in enumerate(AT)}
    slide = ho.Body(ho.Slide((1, 0, 0.5), 0.0, -0.02))
    return ho.Problem(cables, {"slide": slide, **ties}, gravity=(0, 0, -9.81), limits=ho.Limits(clearance=clearance))


def between_the_two(motion: ho.Motion) -> PairClearance:
    """Return how near ``left`` and ``right`` come."""
    (pair,) = (pair for pair in ho.clearances(motion).pairs if {pair.cable, pair.obstacle.name} == {"left", "right"})
    return pair


@pytest.fixture(scope="module")
def motion() -> ho.Motion:
    return ho.simulate(bundle(LIMIT), frames=np.linspace(0, 1, 5))


def test_tied_cables_count_outside_their_ties_alone(motion):
    """Against many pairs of points before the first tie and behind the last, but those near to it on both."""
    pair = between_the_two(motion)
    gap, least = arc_apart(RADIUS, LIMIT), np.inf
    cables = (motion.cables["left"], motion.cables["right"])
    for frame, (here, there) in enumerate(zip(*(cable.position for cable in cables), strict=True)):
        apart = np.linalg.norm(here[:, None] - there[None], axis=2) - 2 * RADIUS
        assert apart.min() < 0.01 * RADIUS  # they touch at their ties
        for tie, away, free in ((AT[0], -1.0, 0.0), (AT[-1], 1.0, LENGTH)):
            arcs = np.concatenate([np.linspace(tie, tie + away * gap, 50), np.linspace(tie + away * gap, free, 400)])
            near = np.arange(len(arcs)) < 49
            places = []
            for cable in cables:
                stations, own = np.unique(cable.s, return_index=True)  # at a tie there are two
                own = own[away * (stations - tie) >= 0]
                places.append(CubicSpline(cable.s[own], cable.position[frame, own])(arcs))
            apart = np.linalg.norm(places[0][:, None] - places[1][None], axis=2) - 2 * RADIUS
            least = min(least, float(apart[~(near[:, None] & near[None])].min()))
    assert pair.certified
    assert pair.nearest.clearance.min() == pytest.approx(least, abs=1e-6)
    assert float(pair.place.clearance[0]) <= least + 1e-9


def test_branches_between_two_free_bodies_are_no_bundle():
    """Cables that end on the same two connectors, where no clip ties them, cross: that is seen."""
    ends = {"rear": (0.0, 0.0, 0.0), "front": (0.3, 0.0, 0.0)}
    held = {"roll_deg": 0.0}
    cables = {
        f"hold {name}": ho.CableRun(
            ho.Cable(0.25, 0.006, 0.01, 0.008, 0.08),
            ho.End((x + way * 0.22, 0, 0.05), tangent=(-way, 0, 0), **held),
            ho.End((way * 0.01, 0, 0), tangent=(-way, 0, 0), body=name, **held),
        )
        for name, (x, _, _), way in (("rear", ends["rear"], -1), ("front", ends["front"], 1))
    }
    for name, side in (("left", 1.0), ("right", -1.0)):
        start = ho.End((0, side * 0.01, 0), tangent=(1, 0, 0), body="rear", **held)
        end = ho.End((0, -side * 0.01, 0), tangent=(1, 0, 0), body="front", **held)
        cables[name] = ho.CableRun(ho.Cable(0.302, 0.006, 0.01, 0.008, 0.08), start, end)
    bodies = {name: ho.Body(position=place, free=True, mass=0.01) for name, place in ends.items()}
    problem = ho.Problem(cables, bodies, gravity=(0, 0, -9.81), limits=ho.Limits(clearance=0.004))
    assert float(between_the_two(ho.simulate(problem)).place.clearance[0]) < 0
