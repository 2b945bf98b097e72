"""Clearances through the whole motion, between its frames too, against dense sampling of what really happens there."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import trimesh

import harness_opt as ho
from harness_opt.clearance.measure import measure
from harness_opt.clearance.moving_centreline import MovingCurve
from harness_opt.clearance.pairs import Between, Options
from harness_opt.clearance.solved_frames import SolvedFrames
from harness_opt.model.bodies import Body, Hinge, Poses, Slide
from harness_opt.model.cable import Cable, CableRun, End
from harness_opt.model.design import Limits
from harness_opt.model.parts import Box, MeshFile, Part, Sphere
from harness_opt.model.problem import Problem
from harness_opt.model.results import Snap
from harness_opt.motion.between_frames import BetweenFrames
from harness_opt.numerics import rotations
from harness_opt.parts.scene import load_scene
from oracles.curves import DIAMETER, LENGTH, helix, runs, shapes
from oracles.scenes import MESHES, POSE, SHAPES, load_mesh, problem_with

TOLERANCE = 0.01 * DIAMETER


class Story:
    """A cable that bends, turns and wanders over a motion, in closed form.

    It starts from random helices and returns, as smoothly as clamps on hinges do; asked for frames in between, it
    counts them.
    """

    def __init__(self, rng, swing=0.04):
        self.bow, self.pitch = rng.uniform(0.03, 0.06), rng.uniform(0.1, 0.3)
        self.grow, self.phase = rng.uniform(0.1, 0.4), rng.uniform(0, 6)
        self.turn = rotations.normalise(rng.normal(size=4))
        self.axis = rotations.normalise(rng.normal(size=3))
        self.angle, self.swing = rng.uniform(0.3, 1.2), rng.uniform(-swing, swing, (2, 3))
        self.asked: list[float] = []

    def curve(self, t: float):
        spin = rotations.from_rotation_vector(self.angle * np.sin(1.5 * t) * self.axis)
        radius = self.bow * (1 + self.grow * np.sin(2 * t + self.phase))
        centre = self.swing[0] * t + self.swing[1] * np.sin(3 * t)
        return helix(radius, self.pitch, rotations.multiply(spin, self.turn), centre)

    def shapes(self, motion):
        return shapes([self.curve(t) for t in motion], LENGTH)

    def solve(self, cable, values):
        self.asked += list(values)
        found = self.shapes(values)
        return found.position, found.quaternion, np.ones(len(values), dtype=bool)

    def points(self, t, s):
        return self.curve(t)(s)[0]


def moving(*frames) -> MovingCurve:
    """The moving curve of frames without a snap; arguments as for SolvedFrames."""
    return MovingCurve(SolvedFrames(*frames, jumps=np.zeros(0), turns=np.zeros(0)))


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
        found = measure(problem, scene, motion, {"lead": story.shapes(motion)}, between=Between(story.solve))
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
        found = measure(problem, load_scene(problem), motion, given, between=Between(solve))
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
            assert pair.lower_bound <= least[pair.obstacle]
            assert pair.worst <= least[pair.obstacle] + pair.tolerance + 1e-9
            at = [stories[name].points(pair.motion, np.array([place])) for name, place in
                  ((pair.cable, pair.arc_length), (pair.obstacle[6:], pair.place.other_arc_length[0]))]  # fmt: skip
            assert np.linalg.norm(at[0] - at[1]) - DIAMETER == pytest.approx(pair.worst, abs=1e-6)


def lift(parts, **changes):
    """A cable between the world and an arm that swings it round by 90 degrees."""
    run = CableRun(
        Cable(0.3, DIAMETER, 2e-3, 1.5e-3, 0.05),
        End(position=(0, 0, 0), quaternion=(1, 0, 0, 0)),
        End(position=(0.16, 0, 0.02), quaternion=(0, 0, 1, 0), body="arm"),
    )
    arm = {"arm": Body(Hinge((0, 0, 0), (0, 0, 1), 0.0, np.pi / 2))}
    given = {"gravity": (0, 0, -9.81), **changes}
    return Problem({"lead": run}, {**arm, **given.pop("bodies", {})}, parts, **given)


@pytest.fixture(scope="module")
def coarse():
    """The motion of :func:`lift` in five frames, over four more clamp ways of 63 mm."""
    motion = ho.simulate(lift({}), frames=np.linspace(0, 1, 5))
    fine = ho.simulate(lift({}), frames=np.linspace(0, 1, 401))
    return motion, fine


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
        pair = ho.clearances(crossed, scene).pairs[0]
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
        pair = ho.clearances(dataclasses.replace(motion, problem=problem)).pairs[0]
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


def test_shapes_that_are_not_found_are_admitted(rng):
    story, motion = Story(rng), np.linspace(0, 1, 5)
    problem = problem_with(
        Part(Sphere(0.03), "arm"), bodies={"arm": Body(Slide((1, 0, 0), 0.0, 0.1))}, limits=Limits(clearance=0.004)
    )

    def stubborn(cable, values):
        position, quaternion, found = story.solve(cable, values)
        return np.where(found[:, None, None], position, np.nan), quaternion, ~found

    found = measure(problem, load_scene(problem), motion, {"lead": story.shapes(motion)}, between=Between(stubborn))
    assert not found.pairs[0].certified
    assert "no shape of lead was found between frames" in found.pairs[0].reason


def test_motion_that_is_rougher_than_estimated_is_noticed(rng):
    """Between smooth frames the cable makes a detour: the frames solved there raise the estimate, or it is refused."""
    story, motion = Story(rng, swing=0.0), np.linspace(0, 1, 9)
    smooth, detour = story.solve, 0.003

    def rough(cable, values):
        position, quaternion, found = smooth(cable, values)
        return position + detour * np.sin(8 * np.pi * values)[:, None, None] ** 2, quaternion, found

    curve = moving("lead", motion, story.shapes(motion), rough)
    before = curve.deviation.max()
    assert before < 0.1 * detour
    middles = 0.5 * (motion[1:] + motion[:-1])
    assert curve.insert(middles[3:4])
    assert curve.raised > 10
    part = Part(Sphere(0.01), position=tuple(story.points(0.5, np.array([0.5 * LENGTH]))[0] + [0.0, 0.02, 0.0]))
    problem = problem_with(part, bodies={"arm": Body(Slide((1, 0, 0), 0.0, 0.1))}, limits=Limits(clearance=0.004))
    scene = load_scene(problem)
    pair = measure(problem, scene, motion, {"lead": story.shapes(motion)}, between=Between(rough)).pairs[0]
    s, least = np.linspace(0, LENGTH, 301), np.inf
    for t in np.linspace(0, 1, 801):
        points = story.points(t, s) + detour * np.sin(8 * np.pi * t) ** 2
        least = min(least, scene.parts["part"].signed_distance(points)[0].min() - DIAMETER / 2)
    assert not pair.certified or pair.lower_bound <= least


def test_deviation_estimated_is_above_the_true_one(coarse):
    """At every frame solved between, on steps of 63, 31 and 8 mm."""
    for count in (5, 9, 33):
        motion = ho.simulate(lift({}), frames=np.linspace(0, 1, count))
        curve = moving("lead", motion.motion, motion.cables["lead"], BetweenFrames(motion))
        fine = coarse[1]
        k = curve.interval(fine.motion)
        s = fine.cables["lead"].s
        off = [
            np.linalg.norm(curve.at(np.full(len(s), i), np.full(len(s), t), s) - p, axis=1).max()
            for i, t, p in zip(k, fine.motion, fine.cables["lead"].position, strict=True)
        ]
        assert np.all(np.array(off) <= curve.deviation[k].max(axis=1) + 1e-8)
        assert curve.deviation.max() < 0.1 * 0.25 / (count - 1)  # and of use: far less than the clamp's way


def test_frames_between_are_those_of_a_motion_through_them(coarse):
    motion, fine = coarse
    values = fine.motion[30::60]
    position, quaternion, found = BetweenFrames(motion)("lead", values)
    assert np.all(found)
    np.testing.assert_allclose(position, fine.cables["lead"].position[30::60], atol=1e-7)
    turned = np.abs(np.sum(quaternion * fine.cables["lead"].quaternion[30::60], axis=-1))
    np.testing.assert_allclose(turned, 1.0, atol=1e-9)


def test_bounds_on_the_curve_between_frames_hold(rng):
    story, motion = Story(rng), np.linspace(0, 1, 6)
    curve = moving("lead", motion, story.shapes(motion), story.solve)
    h, dt = 1e-5, 1e-4
    for k in range(5):
        for share in np.linspace(0.01, 0.99, 9):
            t = motion[k] + share * 0.2
            s = np.sort(rng.uniform(h, LENGTH - h, 200))
            j = curve.arc(s)
            inside = (s - curve.s[j] > h) & (curve.s[j + 1] - s > h)
            s, j = s[inside], j[inside]

            def at(t, s, k=k):
                return curve.at(np.full(len(s), k), np.full(len(s), t), s)

            middle = at(t, s)
            bend = np.linalg.norm(at(t, s + h) + at(t, s - h) - 2 * middle, axis=1) / h**2
            assert np.all(bend <= curve.bend[k, j] + 1e-3)
            speed = np.linalg.norm(at(t + dt, s) - at(t - dt, s), axis=1) / (2 * dt) * 0.2
            assert np.all(speed <= curve.speed[k, j] + 1e-9)
            acceleration = np.linalg.norm(at(t + dt, s) + at(t - dt, s) - 2 * middle, axis=1) / dt**2 * 0.04
            assert np.all(acceleration <= curve.acceleration[k, j] + 1e-7)


@pytest.mark.parametrize("back", [False, True])
def test_rates_of_bodies_are_above_differences(back, rng):
    """Positions, and turns, of a point of the body: speeds and accelerations by differences stay below the bounds."""
    times = np.array([0.0, 0.3, 0.35, 1.0, 2.0])
    positions = tuple(map(tuple, rng.uniform(-0.1, 0.1, (5, 3))))
    quaternions = rotations.normalise(np.array([1.0, 0, 0, 0]) + 0.4 * rng.normal(size=(5, 4)))
    bodies = {
        "poses": Body(Poses(tuple(times), positions, tuple(map(tuple, quaternions)))),
        "hinge": Body(Hinge((0.1, 0.2, 0), (1, 0, 1), 0.2, 1.4)),
        "slide": Body(Slide((1, 2, 2), 0.0, 0.3)),
    }
    problem = dataclasses.replace(lift({}, bodies=bodies), out_and_back=back)
    first = np.array([0.0, 0.05, 0.1, 0.31, 0.5, 0.72])
    last = np.array([0.05, 0.1, 0.31, 0.5, 0.72, 1.0])
    h = 1e-4
    for name in (*bodies, "world"):
        rates = problem.rates(name, first, last)
        for i, (low, high) in enumerate(zip(first, last, strict=True)):
            t = np.linspace(low + 2 * h, high - 2 * h, 400)
            before, here, after = (problem.poses(name, t + d) for d in (-h, 0.0, h))
            middle = problem.poses(name, [0.5 * (low + high)])
            fixed = rotations.rotate(rotations.conjugate(middle[1]), rates.centre[i] - middle[0])
            way = [p + rotations.rotate(q, fixed) for p, q in (before, here, after)]
            speed = np.linalg.norm(way[2] - way[0], axis=1).max() / (2 * h)
            acceleration = np.linalg.norm(way[2] - 2 * way[1] + way[0], axis=1).max() / h**2
            turns = [
                2 * rotations.multiply(two[1], rotations.conjugate(one[1]))[:, 1:] / h
                for one, two in ((before, here), (here, after))
            ]
            assert speed <= rates.speed[i] * (1 + 1e-6) + 1e-8
            assert acceleration <= rates.acceleration[i] * (1 + 1e-4) + 1e-6
            assert np.linalg.norm(turns, axis=-1).max() <= rates.turning[i] * (1 + 1e-6) + 1e-6
            change = np.linalg.norm(turns[1] - turns[0], axis=-1).max() / h
            assert change <= rates.turning_change[i] * (1 + 1e-3) + 1e-3


@pytest.mark.parametrize("name", ["box mesh", "annulus mesh", "cavity mesh", "open mesh", *SHAPES])
def test_hull_bounds_hold_and_are_tight(name, tmp_path, rng):
    if name.endswith("mesh"):
        geometry = load_mesh(MESHES[name.split()[0]], tmp_path)
    else:
        geometry = load_scene(problem_with(Part(SHAPES[name]))).parts["part"]
    middle = rng.uniform(-0.06, 0.06, (300, 1, 3))
    u = rng.normal(size=(300, 1, 3)) * rng.choice([1e-4, 1e-3, 5e-3], (300, 1, 1))
    v = rng.normal(size=(300, 1, 3)) * rng.choice([0, 1e-4, 3e-3], (300, 1, 1))
    u[:60, :, 2] = v[:60, :, 2] = 0.0  # along triangles' planes too
    middle[:30, :, 2] = 0.01
    corners = np.concatenate([middle - u - v, middle - u + v, middle + u - v, middle + u + v], axis=1)
    centre = corners.mean(axis=1)
    bound = geometry.hull_bound(corners, centre, geometry.signed_distance(centre)[0])
    weights = np.concatenate([rng.dirichlet(np.full(4, 0.5), (300, 60)), np.tile(np.eye(4), (300, 1, 1))], axis=1)
    points = np.einsum("kwc,kci->kwi", weights, corners)
    least = geometry.signed_distance(points.reshape(-1, 3))[0].reshape(300, -1).min(axis=1)
    assert np.all(bound <= least + 1e-12)
    size = np.linalg.norm(corners - centre[:, None], axis=2).max(axis=1)
    assert np.mean(least - bound) < 0.2 * np.mean(size)


def test_budget_between_frames_is_admitted(rng):
    story, motion = Story(rng), np.linspace(0, 1, 7)
    problem = problem_with(
        Part(SHAPES["box"], "arm"), bodies={"arm": Body(Slide((1, 0, 0), 0.0, 0.1))}, limits=Limits(clearance=0.004)
    )
    poor, rich = (
        measure(
            problem, load_scene(problem), motion, {"lead": story.shapes(motion)}, Options(most_queries=most),
            between=Between(story.solve),
        ).pairs[0]
        for most in (10, 20_000)
    )  # fmt: skip
    assert rich.certified
    assert not poor.certified
    assert "longer than allowed" in poor.reason
    assert poor.lower_bound <= rich.lower_bound


def test_absurd_answers_about_boxes_are_not_believed(tmp_path, rng, monkeypatch):
    """NaN, the largest numbers and distances beyond that of the middle: the bound has to hold without them."""
    geometry = load_mesh(MESHES["annulus"], tmp_path)
    corners = rng.uniform(-0.06, 0.06, (60, 1, 3)) + rng.normal(size=(60, 4, 3)) * 0.002
    middle = corners.mean(axis=1)
    at_middle = geometry.signed_distance(middle)[0]

    def lying(self, corners, middle):
        return np.resize([np.nan, -1.8e308, 1.8e308, 1.0, -1.0], len(corners))

    monkeypatch.setattr(type(geometry.query), "boxes", lying)
    bound = geometry.hull_bound(corners, middle, at_middle)
    points = np.einsum("kwc,kci->kwi", rng.dirichlet(np.ones(4), (60, 40)), corners)
    least = geometry.signed_distance(points.reshape(-1, 3))[0].reshape(60, -1).min(axis=1)
    assert np.all(bound <= least)


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
