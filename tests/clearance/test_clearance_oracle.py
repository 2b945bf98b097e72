"""Clearances of cables against brute force: dense sampling, every pair of points, closed forms."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from harness_opt.clearance.centreline import closest_on_segments, sag
from harness_opt.clearance.measure import measure
from harness_opt.clearance.pairs import Options
from harness_opt.model.bodies import Body, Hinge
from harness_opt.model.cable import Cable, CableRun
from harness_opt.model.design import Limits
from harness_opt.model.ends import End
from harness_opt.model.parts import Box, MeshFile, Part, Sphere
from harness_opt.model.problem import Problem
from harness_opt.numerics import rotations
from harness_opt.parts.scene import load_scene
from oracles.curves import DIAMETER, LENGTH, helix, line, random_helices, runs, shapes
from oracles.scenes import MESHES, POSE, SHAPES, problem_with


@pytest.mark.parametrize("kind", ["annulus", "icosphere", "inverted", *SHAPES])
def test_worst_against_dense_sampling(kind, tmp_path, rng):
    """A part that moves: the worst, its place and the bounds, against ten times the points."""
    if kind in MESHES:
        MESHES[kind].export(tmp_path / "part.stl")
        shape = MeshFile(tmp_path / "part.stl", "mm")
    else:
        shape = SHAPES[kind]
    arm = Body(Hinge((0.01, 0.02, 0.0), (1, 1, 0), 0.0, 1.5))
    problem = Problem(runs(), {"arm": arm}, {"part": Part(shape, "arm", **POSE)}, limits=Limits(clearance=0.004))
    curves, motion = random_helices(rng, 12), np.linspace(0, 1, 12)
    cables = {"lead": shapes(curves, LENGTH)}
    scene = load_scene(problem)
    asked = Options(tolerance=0.01 * DIAMETER)  # also of what is violated beyond doubt
    pair = measure(problem, scene, motion, cables, asked).pairs[0]
    dense = np.linspace(0, LENGTH, 1001)
    position, quaternion = arm.poses(motion)
    brute = []
    for frame, curve in enumerate(curves):
        back = rotations.conjugate(quaternion[frame])
        local = rotations.rotate(back, curve(dense)[0] - position[frame])
        brute.append(scene.parts["part"].signed_distance(local)[0] - DIAMETER / 2)
    brute = np.array(brute)
    assert pair.certified_along_arc
    assert not pair.certified  # nothing is known between frames
    assert pair.tolerance <= 0.0101 * DIAMETER + 1e-6
    assert pair.lower_bound <= brute.min() <= pair.worst + 1e-4
    # each frame is good to the stations' spacing at once, and to far less where the clearance is smooth
    assert np.all(pair.clearance <= brute.min(axis=1) + 0.5 * LENGTH / 100)
    assert np.median(np.abs(pair.clearance - brute.min(axis=1))) < 2e-6
    # each witness is a point of its curve, at the distance it says, along the normal it says
    for found in (pair.nearest, pair.witnesses):
        for i, frame in enumerate(found.frame):
            at = curves[frame](found.arc_length[i : i + 1])[0][0]
            along = at - found.point[i]
            expected = (found.clearance[i] + DIAMETER / 2) * found.normal[i]
            np.testing.assert_allclose(along, expected, atol=1e-6)
    assert np.all(pair.witnesses.clearance < 0.004 + DIAMETER)
    assert np.all(np.isnan(pair.nearest.other_arc_length))
    # every local minimum of the dense curve that lies below the horizon has a witness beside it
    for frame, row in enumerate(brute):
        low = np.flatnonzero((row[1:-1] < row[:-2]) & (row[1:-1] <= row[2:]) & (row[1:-1] < 0.0085)) + 1
        mine = pair.witnesses.arc_length[pair.witnesses.frame == frame]
        for k in low:
            depth = min(row[max(k - 30, 0) : k].max(), row[k : k + 31].max()) - row[k]
            assert depth < 1e-3 or np.min(np.abs(mine - dense[k])) < 2 * LENGTH / 100
    row = measure(problem, scene, motion, cables, asked).limits[0]
    assert (row.name, row.part, row.worst, row.frame) == ("clearance", "part", pair.worst, pair.frame)
    assert row.margin == pytest.approx(pair.worst - 0.004)


def test_needle_between_two_stations_is_found(tmp_path):
    """A needle of 0.1 mm stands where no station sees it: it is met between them."""
    needle = trimesh.creation.box((0.1, 0.1, 20))
    wall = trimesh.creation.box((200, 1, 200)).apply_translation((0, 14.5, 0))
    needle.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0)))
    needle.apply_translation((0.5 * 1e3 * LENGTH / 100, 14, 0))  # half way between stations, tip at y = 4 mm
    trimesh.util.concatenate([wall, needle]).export(tmp_path / "needle.stl")
    problem = Problem(
        runs(),
        parts={"needle": Part(MeshFile(tmp_path / "needle.stl", "mm"))},
        limits=Limits(clearance=0.004),
    )
    cables = {"lead": shapes([line([-0.15, 0, 0], [1, 0, 0])], LENGTH)}
    pair = measure(problem, load_scene(problem), [0.0], cables).pairs[0]
    assert pair.worst == pytest.approx(0.004 - DIAMETER / 2, abs=1e-5)
    assert pair.nearest.arc_length[0] == pytest.approx(0.1515, abs=1e-4)
    assert pair.certified
    assert pair.tolerance < 6e-5


def test_cable_inside_a_part_is_negative_with_a_way_out(tmp_path):
    MESHES["box"].export(tmp_path / "box.stl")
    for shape in (MeshFile(tmp_path / "box.stl", "mm"), Box((0.06, 0.04, 0.02))):
        problem = problem_with(Part(shape, clearance=0.002))
        cables = {"lead": shapes([line([-0.15, 0, 0.004], [1, 0, 0])], LENGTH)}
        pair = measure(problem, load_scene(problem), [0.0], cables).pairs[0]
        assert pair.worst == pytest.approx(-0.006 - DIAMETER / 2, abs=1e-4)
        np.testing.assert_allclose(pair.nearest.normal[0], [0, 0, 1], atol=1e-6)
        assert pair.limit == 0.002
        # the middle has no single way out, and still a normal
        cables = {"lead": shapes([line([-0.15, 0, 0], [1, 0, 0])], LENGTH)}
        pair = measure(problem, load_scene(problem), [0.0], cables).pairs[0]
        assert np.all(np.isfinite(pair.nearest.normal))


def test_cable_along_a_surface_is_certain(tmp_path):
    """Parallel to a plate every point is as near as any other, which Lipschitz bounds alone cannot settle."""
    plate = trimesh.creation.box((400, 400, 2)).subdivide().subdivide().subdivide()
    plate.export(tmp_path / "plate.stl")
    problem = problem_with(Part(MeshFile(tmp_path / "plate.stl", "mm")), limits=Limits(clearance=0.001))
    lines = [line([-0.15, 0.01 * i, 0.01], [1, 0, 1e-3 * i]) for i in range(5)]
    pair = measure(problem, load_scene(problem), np.linspace(0, 1, 5), {"lead": shapes(lines, LENGTH)}).pairs[0]
    assert pair.certified_along_arc
    assert pair.worst == pytest.approx(0.009 - DIAMETER / 2, abs=1e-7)


def test_between_two_walls_there_is_a_witness_for_each(tmp_path):
    """Where two points of a part are as near, each has a normal to move away by; inside, one way out is enough."""
    walls = [trimesh.creation.box((200, 2, 40)).apply_translation((0, y, 0)) for y in (-5, 5)]
    trimesh.util.concatenate(walls).export(tmp_path / "slot.stl")
    trimesh.creation.box((400, 8, 80)).export(tmp_path / "plate.stl")
    # a hair off the middle, as cables are
    cables = {"lead": shapes([line([-0.15, 1e-6, 0], [1, 0, 0])], LENGTH)}
    found = {}
    for name in ("slot", "plate"):
        problem = problem_with(Part(MeshFile(tmp_path / f"{name}.stl", "mm"), clearance=0.002))
        found[name] = measure(problem, load_scene(problem), [0.0], cables).pairs[0].witnesses
    slot = found["slot"]
    for side in (1, -1):
        alike = slot.normal[:, 1] * side > 0.999
        assert np.any(alike)
        np.testing.assert_allclose(slot.clearance[alike], 0.004 - DIAMETER / 2, atol=2e-6)
    along = slot.point + (slot.clearance + DIAMETER / 2)[:, None] * slot.normal
    np.testing.assert_allclose(along[:, 1:], np.tile([1e-6, 0], (len(along), 1)), atol=1e-9)
    assert np.all(found["plate"].normal[:, 1] > 0.999)


def test_open_part_is_told(tmp_path):
    MESHES["open"].export(tmp_path / "open.stl")
    problem = problem_with(Part(MeshFile(tmp_path / "open.stl", "mm", shell=True)))
    cables = {"lead": shapes([helix(0.03, 0.1)], LENGTH)}
    assert not measure(problem, load_scene(problem), [0.0], cables).pairs[0].closed


def test_budget_is_admitted(tmp_path, rng):
    MESHES["annulus"].export(tmp_path / "part.stl")
    problem = problem_with(Part(MeshFile(tmp_path / "part.stl", "mm")))
    cables = {"lead": shapes([helix(0.05, 0.03, centre=(0, 0, -0.015))], LENGTH)}
    poor = measure(problem, load_scene(problem), [0.0], cables, Options(most_queries=3)).pairs[0]
    rich = measure(problem, load_scene(problem), [0.0], cables).pairs[0]
    assert not poor.certified_along_arc
    assert poor.lower_bound <= rich.lower_bound
    assert poor.tolerance > rich.tolerance
    assert rich.limit is None
    assert measure(problem, load_scene(problem), [0.0], cables).limits == ()


def test_a_part_that_holds_the_clamp_does_not_count_near_it():
    """Both ends in blocks: each counts, but for the stretch near the clamp that it holds."""
    limit = 0.003
    reach = 2 * DIAMETER  # more than the radius and the limit
    block, still = Part(Box((0.02, 0.02, 0.02)), position=(0, 0, -0.01)), np.array([0.0, 1.0])
    far = Part(Box((0.02, 0.02, 0.02)), "arm", position=(0, 0, LENGTH + 0.01))
    arm = Body(Hinge((0, 0, 0), (0, 0, 1), 0.0, 0.3))
    cables = {"lead": shapes([line([0, 0, 0], [0, 0, 1])] * 2, LENGTH)}
    worst = {}
    for ends in (("world", "arm"), ("arm", "world"), ("world", "world")):
        problem = Problem(runs(bodies=ends), {"arm": arm}, {"block": block, "far": far}, limits=Limits(clearance=limit))
        for pair in measure(problem, load_scene(problem), still, cables).pairs[:2]:
            worst[ends, pair.obstacle.key] = pair.worst, pair.excluded
    away, touching = pytest.approx(reach - DIAMETER / 2), pytest.approx(-DIAMETER / 2)
    assert worst[("world", "arm"), "block"] == (away, (reach, 0.0))
    assert worst[("world", "arm"), "far"] == (away, (0.0, reach))
    # of one body with a clamp, but not what holds it
    assert worst[("arm", "world"), "block"] == (touching, (0.0, 0.0))
    assert worst[("arm", "world"), "far"] == (touching, (0.0, 0.0))
    assert worst[("world", "world"), "block"] == (away, (reach, 0.0))
    assert worst[("world", "world"), "far"] == (touching, (0.0, 0.0))


def test_cable_to_cable_against_every_pair(rng):
    problem = Problem(runs("one", "two"), limits=Limits(clearance=0.002))
    ones, twos = random_helices(rng, 10), random_helices(rng, 10)
    cables = {"one": shapes(ones, LENGTH), "two": shapes(twos, LENGTH)}
    result = measure(problem, load_scene(problem), np.linspace(0, 1, 10), cables)
    assert [(pair.cable, pair.obstacle.key) for pair in result.pairs] == [
        ("one", "cable:one"),
        ("one", "cable:two"),
        ("two", "cable:two"),
    ]
    pair = result.pairs[1]
    dense = np.linspace(0, LENGTH, 1001)
    brute = np.array(
        [
            np.linalg.norm(one(dense)[0][:, None] - two(dense)[0], axis=-1).min()
            for one, two in zip(ones, twos, strict=True)
        ]
    )
    assert pair.certified_along_arc
    assert np.all(np.abs(pair.clearance + DIAMETER - brute) < 2e-4)
    # dense points overestimate: by less than half their spacing squared over the distance
    assert np.all(pair.clearance + DIAMETER <= brute + 1e-7)
    assert pair.lower_bound <= pair.worst <= pair.lower_bound + 6e-5
    for i, frame in enumerate(pair.nearest.frame):
        at = ones[frame](pair.nearest.arc_length[i : i + 1])[0][0]
        other = twos[frame](pair.nearest.other_arc_length[i : i + 1])[0][0]
        normal = pair.nearest.normal[i]
        np.testing.assert_allclose(at - other, (pair.clearance[i] + DIAMETER) * normal, atol=1e-6)
        np.testing.assert_allclose(pair.nearest.point[i], other + DIAMETER / 2 * normal, atol=1e-6)


@pytest.mark.parametrize(("radius", "pitch"), [(0.012, 0.008), (0.02, 0.009), (0.03, 0.2), (10.0, 1.0)])
def test_self_clearance_against_every_pair(radius, pitch):
    limit = 0.002
    problem = Problem(runs(), limits=Limits(clearance=limit))
    curves = [helix(radius, pitch * (1 + 0.1 * i)) for i in range(3)]
    pair = measure(problem, load_scene(problem), np.linspace(0, 1, 3), {"lead": shapes(curves, LENGTH, 201)}).pairs[0]
    gap = np.pi / 2 * (DIAMETER + limit)
    dense = np.linspace(0, LENGTH, 2001)
    allowed = dense[None] - dense[:, None] >= gap
    for frame, curve in enumerate(curves):
        r = curve(dense)[0]
        brute = np.where(allowed, np.linalg.norm(r[:, None] - r, axis=-1), np.inf).min()
        # points at the least arc apart may lie up to one step of the dense sampling nearer than it says
        assert pair.clearance[frame] + DIAMETER <= brute + 1e-7
        assert pair.clearance[frame] + DIAMETER >= brute - LENGTH / 2000
    assert pair.certified_along_arc
    assert np.all(pair.nearest.other_arc_length - pair.nearest.arc_length >= gap * (1 - 1e-12))
    if radius > 1:
        # a straight cable has nothing to push apart
        assert len(pair.witnesses.frame) == 0


def test_hairpin_at_the_limit_just_passes():
    """Limbs the limit apart: the rule that leaves neighbours out sees them at exactly the limit."""
    limit = 0.004
    half = 0.5 * (DIAMETER + limit)
    problem = Problem(runs(), limits=Limits(clearance=limit))
    arc = np.pi * half
    leg = 0.5 * (LENGTH - arc)

    def hairpin(s):
        a = np.clip((s - leg) / half, 0, np.pi)
        before, after = np.minimum(s, leg), np.maximum(s - leg - arc, 0.0)
        zero = np.zeros_like(s)
        r = np.stack([-half * np.cos(a), zero, before + half * np.sin(a) - after], -1)
        t = np.stack([np.sin(a), zero, np.cos(a)], -1)
        bend = ((s > leg) & (s < leg + arc)) / half
        return r, t, np.stack([np.cos(a) * bend, zero, -np.sin(a) * bend], -1)

    pair = measure(problem, load_scene(problem), [0.0], {"lead": shapes([hairpin], LENGTH, 401)}).pairs[0]
    assert pair.worst == pytest.approx(limit, abs=1e-5)


def test_crossing_cables_have_a_normal():
    problem = Problem(runs("one", "two"), limits=Limits(clearance=0.002))
    cables = {
        "one": shapes([line([-0.15, 0, 0], [1, 0, 0])], LENGTH),
        "two": shapes([line([0, -0.15, 0], [0, 1, 0])], LENGTH),
    }
    pair = measure(problem, load_scene(problem), [0.0], cables).pairs[1]
    assert pair.worst == pytest.approx(-DIAMETER)
    np.testing.assert_allclose(np.abs(pair.nearest.normal[0]), [0, 0, 1], atol=1e-9)


@pytest.mark.parametrize("radius", [0.003, 0.01, 1.0])
def test_sag_bounds_the_way_from_chord_to_arc(radius):
    curve = helix(radius, 0.01)
    for length in np.geomspace(1e-4, 0.02, 12):
        s = np.linspace(0.02, 0.02 + length, 201)
        r = curve(s)[0]
        way = np.linalg.norm(r - r[0] - np.linspace(0, 1, 201)[:, None] * (r[-1] - r[0]), axis=1).max()
        most = sag(length, np.linalg.norm(r[-1] - r[0]))
        assert way <= most + 1e-9
        if length < 0.5 * radius and most > 1e-9:
            assert most < 1.25 * way  # sqrt(4/3) for short arcs


def test_segments_against_sampling(rng):
    p, u, q, v = rng.normal(size=(4, 300, 3))
    v[:60] = u[:60] * rng.normal(size=(60, 1))  # parallel
    u[60:70], v[70:80] = 0.0, 0.0
    x, y = closest_on_segments(p, u, q, v)
    found = np.linalg.norm(p + x[:, None] * u - q - y[:, None] * v, axis=1)
    share = np.linspace(0, 1, 201)
    # for a point of the one segment the nearest of the other is a projection
    points = p + share[:, None, None] * u - q
    square = np.maximum(np.einsum("ki,ki->k", v, v), 1e-300)
    along = np.clip(np.einsum("nki,ki->nk", points, v) / square, 0, 1)
    sampled = np.linalg.norm(points - along[..., None] * v, axis=-1).min(axis=0)
    assert np.all(found <= sampled + 1e-12)
    assert np.all(found >= sampled - 0.005 * np.linalg.norm(u, axis=1) - 1e-12)


def test_same_question_same_answer(tmp_path, rng):
    MESHES["annulus"].export(tmp_path / "part.stl")
    problem = problem_with(Part(MeshFile(tmp_path / "part.stl", "mm")), limits=Limits(clearance=0.01))
    cables = {"lead": shapes(random_helices(rng, 4), LENGTH)}
    answers = [measure(problem, load_scene(problem), np.linspace(0, 1, 4), cables) for _ in range(2)]
    for one, two in zip(*(answer.pairs for answer in answers), strict=True):
        assert one.lower_bound == two.lower_bound
        for name, values in vars(one.witnesses).items():
            assert np.array_equal(values, getattr(two.witnesses, name), equal_nan=True)


def test_short_cables_are_measured_where_they_are_and_meet_nothing_of_their_own():
    short = CableRun(Cable(0.01, 0.005, 1e-3, 1e-3), End(position=(0, 0, 0)), End(position=(0, 0, 0.01)))
    problem = Problem({"stub": short}, parts={"ball": Part(Sphere(0.1))}, limits=Limits(clearance=0.01))
    cables = {"stub": shapes([line([0, 0, 0], [0, 0, 1])], 0.01, 11)}
    result = measure(problem, load_scene(problem), [0.0], cables)
    ball, itself = result.pairs
    assert ball.worst == pytest.approx(-0.1 + 0.0049 - 0.0025, abs=1e-4), "half-way: the ball holds the clamp"
    assert itself.worst == np.inf and itself.certified
