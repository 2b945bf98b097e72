"""Certificates against parts that chains of bodies carry, against dense sampling of what really happens."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.clearance.measure import measure
from harness_opt.clearance.pairs import Between, Options
from harness_opt.numerics import rotations
from harness_opt.parts.scene import load_scene
from oracles.chains import PAN_TILT
from oracles.curves import DIAMETER, LENGTH, runs
from oracles.flap import put
from oracles.scenes import SHAPES
from oracles.stories import Story

TOLERANCE = 0.01 * DIAMETER


def hinge(rng, reach: float = 0.1) -> ho.Hinge:
    return ho.Hinge(tuple(rng.uniform(-reach, reach, 3)), tuple(rng.normal(size=3)), *rng.uniform(-0.8, 0.8, 2))


def moves(rng) -> ho.Hinge:
    """A hinge that turns, rests and turns back."""
    steps = (ho.Move(rng.uniform(0.3, 0.9), 1.0, 0.3), ho.Move(rng.uniform(-0.9, 0.0), 1.5))
    return ho.Hinge(tuple(rng.uniform(-0.1, 0.1, 3)), tuple(rng.normal(size=3)), follows=ho.Moves(0.0, steps))


@pytest.mark.parametrize("last", [hinge, moves])
@pytest.mark.parametrize(("clamp", "carrier"), [("world", "c"), ("a", "c"), ("c", "a")])
def test_a_part_three_bodies_out_is_certain_between_seven_frames(clamp, carrier, last, rng):
    """The clamps in the world, or on one of the bodies in the row, so that others are seen from there."""
    motion, s, times = np.linspace(0, 1, 7), np.linspace(0, LENGTH, 201), np.linspace(0, 1, 401)
    for kind in ("box", "capsule", "cylinder"):
        story = Story(rng)
        slide = ho.Slide(tuple(rng.normal(size=3)), -0.03, 0.04)
        bodies = {"a": ho.Body(hinge(rng)), "b": ho.Body(slide, "a"), "c": ho.Body(last(rng), "b")}
        parts = {"part": ho.Part(SHAPES[kind], carrier, position=tuple(rng.uniform(-0.05, 0.05, 3)), clearance=0.004)}
        own = runs(bodies=(clamp, clamp))
        problem = ho.Problem(own, bodies, parts)
        scene, given = load_scene(problem), {"lead": story.shapes(motion)}
        found = measure(problem, scene, motion, given, Options(tolerance=TOLERANCE), between=Between(story.solve))
        pair = found.pairs[0]
        assert pair.certified, pair.reason
        position, quaternion = problem.poses(carrier, times)
        seen = np.array(
            [
                rotations.rotate(rotations.conjugate(q), story.points(t, s) - p)
                for t, p, q in zip(times, position, quaternion, strict=True)
            ]
        )
        way = np.linalg.norm(np.diff(seen, axis=0), axis=2).max()
        least = scene.parts["part"].signed_distance(seen.reshape(-1, 3))[0].min() - DIAMETER / 2
        assert pair.lower_bound <= least
        assert pair.worst >= least - 0.5 * way - 0.5 * (s[1] - s[0])
        assert pair.worst <= least + TOLERANCE * (1 + 1e-6)


def test_a_pan_tilt_s_verdict_is_that_of_four_hundred_frames(here):
    problem = ho.read_problem(put(PAN_TILT))
    coarse, fine = ho.simulate(problem), ho.simulate(problem, frames=np.linspace(0, 1, 401))
    dense = measure(problem, load_scene(problem), fine.motion, fine.cables)
    assert {pair.obstacle.name for pair in dense.pairs} == {"mast", "head", "lead"}
    for found, true in zip(ho.clearances(coarse, tolerance=TOLERANCE).pairs, dense.pairs, strict=True):
        assert found.certified, found.reason
        assert found.lower_bound <= true.worst
        if np.isfinite(true.worst):
            assert found.worst <= true.worst + found.tolerance + 1e-9


def test_one_chain_given_as_one_table_gives_the_same(here):
    """What the chain's outermost body does, told as a table of many poses of the world."""
    problem = ho.read_problem(put(PAN_TILT))
    at = np.linspace(0, 1, 401)
    position, quaternion = problem.poses("tilt", at)
    table = ho.Poses(tuple(at), tuple(map(tuple, position)), tuple(map(tuple, quaternion)))
    told = dataclasses.replace(problem, bodies={**problem.bodies, "tilt": ho.Body(table)})
    frames = np.linspace(0, 1, 9)
    one, other = (ho.simulate(each, frames=frames).cables["lead"].position for each in (problem, told))
    assert np.abs(one - other).max() < 1e-7
