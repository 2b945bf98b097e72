"""Cables that stay far apart are told apart by boxes: many cost as their number."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.clearance.certify_cable import CableSearch
from harness_opt.clearance.certify_part import Seen
from harness_opt.clearance.moving_centreline import MovingCurve
from harness_opt.clearance.pairs import PairClearance
from harness_opt.clearance.solved_frames import SolvedFrames
from harness_opt.clearance.witnesses import FAR_SHARE
from harness_opt.model.limits import Obstacle
from harness_opt.motion.between_frames import BetweenFrames
from harness_opt.numerics.vectors import lengths

LIMIT, RADIUS = 0.004, 0.0025


def row_of(count: int, apart: float) -> ho.Problem:
    """Return cables side by side between a wall and a flap that turns."""
    runs = {}
    for k in range(count):
        cable = ho.Cable(0.3, 2 * RADIUS, 2e-3, 1.5e-3, mass_per_length=0.05)
        start = ho.End(position=(0, apart * k, 0), quaternion=(1, 0, 0, 0))
        runs[f"c{k}"] = ho.CableRun(cable, start, ho.End((0.15, apart * k, 0), (0, 1, 0, 0), body="flap"))
    flap = ho.Body(ho.Hinge((0.2, 0, 0), (0, 1, 0), 0, 0.35))
    limits = ho.Limits(clearance=LIMIT)
    return ho.Problem(runs, {"flap": flap}, gravity=(0, 0, -9.81), limits=limits, spatial_step=0.01)


def between(motion: ho.Motion, **options: float) -> PairClearance:
    """Return the clearance of the first cable to the second one."""
    pairs = ho.clearances(motion, **options).pairs
    (pair,) = (p for p in pairs if (p.cable, p.obstacle) == ("c0", Obstacle("c1", is_cable=True)))
    return pair


@pytest.mark.parametrize("apart", [0.07, 0.2, 2.0])
def test_what_boxes_tell_is_true_and_as_near_as_allowed(apart):
    problem = row_of(2, apart)
    motion = ho.simulate(problem)
    pair = between(motion)
    finer = ho.simulate(problem, spatial_step=0.0005)
    a, b = (finer.cables[name].position for name in ("c0", "c1"))
    least = min(float(lengths(x[:, None] - y).min()) for x, y in zip(a, b, strict=True)) - 2 * RADIUS
    assert pair.certified and pair.certified_along_arc
    assert pair.lower_bound <= least
    assert pair.worst >= least - 1e-4  # which is at stations alone
    assert pair.worst <= least + FAR_SHARE * least
    assert pair.lower_bound > LIMIT


def test_boxes_are_not_asked_where_a_tolerance_is_asked_for():
    motion = ho.simulate(row_of(2, 0.2))
    pair = between(motion, tolerance=1e-5)
    assert pair.certified and pair.tolerance <= 1e-5 * (1 + 1e-6)


def test_the_cost_of_many_cables_grows_with_their_number(monkeypatch):
    searched: list[int] = []
    run = CableSearch._run
    monkeypatch.setattr(CableSearch, "_run", lambda self: searched.append(1) or run(self))
    counts = []
    for count in (4, 8, 16):
        searched.clear()
        result = ho.clearances(ho.simulate(row_of(count, 0.04)))
        assert len(result.pairs) == count * (count + 1) // 2 and all(pair.certified for pair in result.pairs)
        counts.append(len(searched))
    assert counts[2] - counts[1] < 2.2 * (counts[1] - counts[0])
    assert counts[2] < 5 * 16


def among_balls(count: int) -> ho.Problem:
    """Return a cable beside so many balls, of which the first two are near."""
    problem = row_of(1, 0.0)
    balls = {f"b{k}": ho.Part(ho.Sphere(0.01), position=(0.1, 0.05 + 0.03 * k, -0.05)) for k in range(count)}
    return dataclasses.replace(problem, parts=balls)


def test_what_is_far_is_told_by_what_the_cable_sweeps_which_is_found_once(monkeypatch):
    """For all parts of a body together, in place of once for each; and it is no less true."""
    found: list[int] = []
    find = Seen.acceleration
    monkeypatch.setattr(Seen, "acceleration", lambda self: found.append(1) or find(self))
    counts = []
    for count in (5, 50):
        found.clear()
        problem = among_balls(count)
        pairs = ho.clearances(ho.simulate(problem)).pairs
        counts.append(len(found))
    assert counts[0] == counts[1]
    finer = ho.simulate(problem, spatial_step=0.0005).cables["c0"].position
    for pair in pairs:
        if pair.obstacle.is_cable:
            continue
        ball = problem.parts[pair.obstacle.name]
        least = float(lengths(finer - np.asarray(ball.position)).min()) - ball.shape.radius - RADIUS
        assert pair.certified and pair.lower_bound <= least + 1e-9
        assert least - 1e-4 <= pair.worst <= (1 + FAR_SHARE) * least + 1e-4


def test_boxes_hold_what_is_between_the_frames():
    problem = row_of(1, 0.0)
    motion = ho.simulate(problem)
    none = np.zeros(0)
    solve = BetweenFrames(motion)
    curve = MovingCurve(SolvedFrames("c0", motion.motion, motion.cables["c0"], solve, jumps=none, turns=none))
    curve.complete()
    low, high = curve.boxes
    finer = ho.simulate(problem, spatial_step=0.0005)
    k = curve.interval(finer.motion)
    position = finer.cables["c0"].position
    assert np.all(position >= low[k][:, None] - 1e-9) and np.all(position <= high[k][:, None] + 1e-9)
