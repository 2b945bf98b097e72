"""Clearances through the whole motion, between its frames too, against dense sampling of what really happens there."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import trimesh

import harness_opt as ho
from harness_opt.clearance.measure import measure
from harness_opt.clearance.pairs import Between, Options
from harness_opt.model.bodies import Body, Hinge, Poses, Slide
from harness_opt.model.cable import Cable, CableRun
from harness_opt.model.design import Limits
from harness_opt.model.ends import End
from harness_opt.model.parts import Box, MeshFile, Part, Sphere
from harness_opt.model.problem import Problem
from harness_opt.model.results import Snap
from harness_opt.motion.between_frames import BetweenFrames
from harness_opt.numerics import rotations
from harness_opt.parts.scene import load_scene
from oracles.curves import DIAMETER, LENGTH, runs
from oracles.scenes import MESHES, POSE, SHAPES
from oracles.stories import Story, lift, moving

TOLERANCE = 0.01 * DIAMETER


def _dense(problem, scene, story, part, first=0.0, last=LENGTH, moments=401):
    """The smallest clearance of a dense sampling, and how much smaller the true one can be, both in m."""
    s, times = np.linspace(first, last, 301), np.linspace(0, 1, moments)
    position, quaternion = problem.poses(scene.parts[part].body, times)
    least, way, before = np.inf, 0.0, None
    for t, p, q in zip(times, position, quaternion, strict=True):
        seen = rotations.rotate(rotations.conjugate(q), story.points(t, s) - p)
        if before is not None:
            way = max(way, np.linalg.norm(seen - before, axis=1).max())
        before = seen
        least = min(least, scene.parts[part].signed_distance(seen)[0].min())
    return least - DIAMETER / 2, 0.5 * way + 0.5 * (s[1] - s[0])


KINDS = ["box", "cylinder", "sphere", "capsule", "mesh box", "mesh annulus", "mesh cavity", "mesh icosphere"]


@pytest.mark.parametrize("kind", KINDS)
def test_worst_of_the_motion_against_dense_sampling(kind, tmp_path, rng):
    """Seven frames of a cable and of a body that both move: nothing between them is missed."""
    if kind.startswith("mesh"):
        MESHES[kind[5:]].export(tmp_path / "part.stl")
        shape = MeshFile(tmp_path / "part.stl", "mm")
    else:
        shape = SHAPES[kind]
    motion = np.linspace(0, 1, 7)
    for number in range(4):
        story = Story(rng)
        part = Part(shape, "arm", **{**POSE, "position": tuple(rng.uniform(-0.05, 0.05, 3))}, clearance=0.004)
        arm = Body(Hinge(tuple(rng.uniform(-0.1, 0.1, 3)), (1, 1, 0.3), 0.0, 1.5))
        problem = Problem(runs(), {"arm": arm}, {"part": part})
        scene = load_scene(problem)
        asked = Options(tolerance=TOLERANCE)  # also of what is violated beyond doubt
        given = {"lead": story.shapes(motion)}
        found = measure(problem, scene, motion, given, asked, between=Between(story.solve))
        pair = found.pairs[0]
        dense, slack = _dense(problem, scene, story, "part")
        assert pair.certified, (number, pair.reason)
        assert pair.tolerance <= TOLERANCE * (1 + 1e-6)
        assert pair.lower_bound <= dense
        assert pair.worst >= dense - slack
        # a sample between two of the dense ones may be lower, but not by more than the certificate says
        assert pair.worst <= dense + pair.tolerance + 1e-9
        assert found.inserted["lead"] == len(set(story.asked))
        # where it says it is, it is
        at = story.curve(pair.motion)(np.array([pair.arc_length]))[0][0]
        expected = (pair.worst + DIAMETER / 2) * pair.place.normal[0]
        np.testing.assert_allclose(at - pair.place.point[0], expected, atol=2e-6)
        row = found.limits[0]
        assert (row.certified, row.motion, row.reason) == (True, pair.motion, "")
        assert abs(motion[row.frame] - row.motion) <= 1 / 12 + 1e-12


def test_two_cables_and_one_with_itself_against_dense_sampling(rng):
    motion, limit = np.linspace(0, 1, 7), 0.002
    arm = {"arm": Body(Hinge((0, 0, 0), (0, 0, 1), 0.0, 1.0))}
    problem = Problem(runs("one", "two"), arm, limits=Limits(clearance=limit))
    s, gap = np.linspace(0, LENGTH, 201), np.pi / 2 * (DIAMETER + limit)
    apart = s - s[:, None] >= gap
    for _ in range(2):
        stories = {"one": Story(rng), "two": Story(rng)}

        def solve(cable, values, stories=stories):
            return stories[cable].solve(cable, values)

        given = {name: story.shapes(motion) for name, story in stories.items()}
        asked = Options(tolerance=TOLERANCE)
        found = measure(problem, load_scene(problem), motion, given, asked, between=Between(solve))
        least = {"cable:one": np.inf, "cable:two": np.inf}
        for t in np.linspace(0, 1, 201):
            one, two = (story.points(t, s) for story in stories.values())
            itself = np.where(apart, np.linalg.norm(one[:, None] - one, axis=-1), np.inf).min()
            other = np.linalg.norm(one[:, None] - two, axis=-1).min()
            for name, value in (("cable:one", itself), ("cable:two", other)):
                least[name] = min(least[name], value - DIAMETER)
        for pair in found.pairs[:2]:
            assert pair.certified, pair.reason
            assert pair.tolerance <= TOLERANCE * (1 + 1e-6)
            assert pair.lower_bound <= least[pair.obstacle.key]
            if np.isinf(pair.worst):  # it never comes near itself: the least is the chord of the arc left out
                assert pair.is_to_itself and least[pair.obstacle.key] >= limit
                continue
            assert pair.worst <= least[pair.obstacle.key] + pair.tolerance + 1e-9
            at = [stories[name].points(pair.motion, np.array([place])) for name, place in
                  ((pair.cable, pair.arc_length), (pair.obstacle.name, pair.place.other_arc_length[0]))]  # fmt: skip
            assert np.linalg.norm(at[0] - at[1]) - DIAMETER == pytest.approx(pair.worst, abs=1e-6)


@pytest.mark.parametrize("kind", ["box", "mesh"])
def test_thin_plate_between_two_frames_is_always_found(kind, coarse, tmp_path, rng):
    """A plate of 1 mm that the cable crosses between two frames, none of which is near it."""
    motion, fine = coarse
    side = 0.006
    trimesh.creation.box((1e3 * side, 1, 1e3 * side)).export(tmp_path / "plate.stl")
    shape = Box((side, 0.001, side)) if kind == "box" else MeshFile(tmp_path / "plate.stl", "mm")
    for _ in range(12):
        moment, station = rng.integers(20, 380), rng.integers(30, 70)
        at, ahead = fine.cables["lead"].position[[moment, moment + 1], station]
        # its face looks the way the cable goes there
        turn = rotations.shortest_arc([0.0, 1.0, 0.0], rotations.normalise(ahead - at))
        problem = lift({"plate": Part(shape, "world", tuple(at), tuple(turn), clearance=0.004)})
        scene = load_scene(problem)
        crossed = dataclasses.replace(motion, problem=problem)
        pair = ho.clearances(crossed, scene, tolerance=TOLERANCE).pairs[0]
        dense = measure(problem, scene, fine.motion, fine.cables).pairs[0]
        assert pair.worst <= -DIAMETER / 2 + TOLERANCE
        assert pair.certified, pair.reason
        assert pair.lower_bound <= dense.worst
        assert pair.worst <= dense.worst + pair.tolerance


def test_needle_between_frames_and_between_stations_is_found(coarse, tmp_path):
    """A needle of 0.1 mm, its point where the cable's axis passes half-way between frames and stations."""
    motion, fine = coarse
    needle = trimesh.creation.cone(0.05, 20.0)
    needle.apply_translation((0, 0, -20.0))  # its point at the origin, downwards the shaft
    needle.export(tmp_path / "needle.stl")
    shape = MeshFile(tmp_path / "needle.stl", "mm")
    curve = moving("lead", fine.motion, fine.cables["lead"], BetweenFrames(fine))
    for moment, station in ((0.37, 48.5), (0.11, 61.5), (0.88, 33.5)):
        s = station / 100 * 0.3
        at = curve.at(curve.interval(np.array([moment])), np.array([moment]), np.array([s]))[0]
        problem = lift({"needle": Part(shape, "world", tuple(at), clearance=0.004)})
        pair = ho.clearances(dataclasses.replace(motion, problem=problem), tolerance=TOLERANCE).pairs[0]
        assert pair.worst <= -DIAMETER / 2 + TOLERANCE
        assert pair.certified, pair.reason


def test_body_that_moves_alone_is_watched(rng):
    """No clamp moves, so there are two frames; a blade sweeps past the cable between them."""
    blade = Part(Box((0.3, 0.002, 0.05)), "rotor", position=(0.15, 0, 0), clearance=0.004)
    for kind in ("hinge", "poses"):
        turns = np.linspace(-2.0, 2.0, 9)
        if kind == "hinge":
            rotor = Hinge((0, 0, 0), (0, 0, 1), -2.0, 2.0)
        else:
            quaternions = rotations.from_rotation_vector(turns[:, None] * [0, 0, 1.0])
            rotor = Poses(tuple(np.arange(9.0)), ((0.0, 0.0, 0.0),) * 9, tuple(map(tuple, quaternions)))
        run = CableRun(
            Cable(0.1, DIAMETER, 1e-3, 1e-3),
            End(position=(0.1, 0, -0.05), quaternion=(1, 0, 0, 0)),
            End(position=(0.1, 0, 0.04), quaternion=(1, 0, 0, 0)),
        )
        problem = Problem({"lead": run}, {"rotor": Body(rotor)}, {"blade": blade})
        motion = ho.simulate(problem)
        assert len(motion.motion) == 2
        frames = measure(problem, load_scene(problem), motion.motion, motion.cables).pairs[0]
        assert frames.worst > 0.04
        assert not frames.certified
        pair = ho.clearances(motion).pairs[0]
        assert pair.worst < -DIAMETER / 2
        assert pair.certified
        assert 0.3 < pair.motion < 0.7


def test_a_snap_is_no_certificate_unless_the_part_is_out_of_reach(rng):
    story, motion = Story(rng), np.linspace(0, 1, 9)
    run = CableRun(Cable(LENGTH, DIAMETER, 1e-3, 1e-3), End(position=(0, 0, 0)), End(position=(0, 0, 0.1), body="arm"))
    arm = {"arm": Body(Slide((0, 0, 1), 0.0, 0.1))}
    parts = {"near": Part(Sphere(0.02)), "far": Part(Sphere(0.02), position=(0, 4.0, 0))}
    problem = Problem({"lead": run}, arm, parts, limits=Limits(clearance=0.004))
    between = Between(story.solve, (Snap("lead", 4, 0.4),))
    near, far, itself = measure(
        problem, load_scene(problem), motion, {"lead": story.shapes(motion)}, between=between
    ).pairs
    for pair in (near, itself):
        assert not pair.certified
        assert "snaps between frames 3 and 4" in pair.reason
    # from the other side of the room no cable of this length gets there, however it jumps
    assert far.certified
    reach = 0.5 * (4.0 + np.hypot(4.0, 0.1375) - LENGTH) - 0.02 - DIAMETER / 2  # to both clamps, when it snaps
    assert far.lower_bound <= reach + 1e-9
    assert not any(0.375 < t < 0.5 for t in story.asked)


def test_what_is_far_away_is_certain_to_a_share_of_its_clearance(rng):
    """Unless a tolerance is given; then that holds however far it is."""
    story, motion = Story(rng), np.linspace(0, 1, 7)
    part = Part(SHAPES["box"], "arm", position=(0.6, 0.1, 0.2), clearance=0.004)
    problem = Problem(runs(), {"arm": Body(Hinge((0, 0, 0), (0, 0, 1), 0.0, 1.0))}, {"part": part})
    scene, given = load_scene(problem), {"lead": story.shapes(motion)}
    dense, _ = _dense(problem, scene, story, "part")
    coarse, strict = (
        measure(problem, scene, motion, given, options, between=Between(story.solve)).pairs[0]
        for options in (None, Options(tolerance=TOLERANCE))
    )
    for pair, tolerance in ((coarse, 0.05 * coarse.worst), (strict, TOLERANCE)):
        assert pair.certified
        assert pair.lower_bound <= dense <= pair.worst + 1e-3
        assert pair.tolerance <= tolerance * (1 + 1e-6)
    assert coarse.tolerance > strict.tolerance


def test_there_and_back_turns_round_in_a_frame(coarse):
    """At the turning point nothing is smooth: a frame stands there, whatever the steps."""
    part = Part(
        Sphere(0.01), position=tuple(coarse[1].cables["lead"].position[-1, 50] + [0, 0.02, 0.0]), clearance=0.004
    )
    problem = lift({"ball": part}, out_and_back=True)
    motion = ho.simulate(problem, frames=np.linspace(0, 1, 8))  # 0.5 is none of them
    pair = ho.clearances(motion).pairs[0]
    there = measure(lift({"ball": part}), load_scene(problem), coarse[1].motion, coarse[1].cables).pairs[0]
    assert pair.certified, pair.reason
    assert pair.lower_bound <= there.worst
    assert pair.worst <= there.worst + pair.tolerance
    assert pair.motion == pytest.approx(0.5 * there.motion, abs=0.01) or pair.motion == pytest.approx(
        1 - 0.5 * there.motion, abs=0.01
    )
