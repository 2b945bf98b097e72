"""What certificates rest on: bounds on curves, bodies and hulls hold, and where they cannot that is admitted."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.clearance.measure import measure
from harness_opt.clearance.pairs import Between, Options
from harness_opt.model.bodies import Body, Hinge, Poses, Slide
from harness_opt.model.design import Limits
from harness_opt.model.parts import Part, Sphere
from harness_opt.motion.between_frames import BetweenFrames
from harness_opt.numerics import rotations
from harness_opt.parts.scene import load_scene
from oracles.curves import DIAMETER, LENGTH
from oracles.scenes import MESHES, SHAPES, load_mesh, problem_with
from oracles.stories import Story, lift, moving


def test_shapes_that_are_not_found_are_admitted(rng):
    story, motion = Story(rng), np.linspace(0, 1, 5)
    problem = problem_with(
        Part(Sphere(0.03), "arm"), bodies={"arm": Body(Slide((1, 0, 0), 0.0, 0.1))}, limits=Limits(clearance=0.004)
    )

    def stubborn(cable, values):
        return story.shapes(values[:0]), ("nobody knows",) * len(values)

    found = measure(problem, load_scene(problem), motion, {"lead": story.shapes(motion)}, between=Between(stubborn))
    assert not found.pairs[0].certified
    assert found.pairs[0].reason.startswith("lead between frames") and "nobody knows" in found.pairs[0].reason


def test_motion_that_is_rougher_than_estimated_is_noticed(rng):
    """Between smooth frames the cable makes a detour: the frames solved there raise the estimate, or it is refused."""
    story, motion = Story(rng, swing=0.0), np.linspace(0, 1, 9)
    smooth, detour = story.solve, 0.003

    def rough(cable, values):
        shapes, why = smooth(cable, values)
        off = detour * np.sin(8 * np.pi * values)[:, None, None] ** 2
        return dataclasses.replace(shapes, position=shapes.position + off), why

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
    found, why = BetweenFrames(motion)("lead", values)
    assert not any(why)
    np.testing.assert_allclose(found.position, fine.cables["lead"].position[30::60], atol=1e-7)
    turned = np.abs(np.sum(found.quaternion * fine.cables["lead"].quaternion[30::60], axis=-1))
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

    monkeypatch.setattr(type(geometry.shell.query), "boxes", lying)
    bound = geometry.hull_bound(corners, middle, at_middle)
    points = np.einsum("kwc,kci->kwi", rng.dirichlet(np.ones(4), (60, 40)), corners)
    least = geometry.signed_distance(points.reshape(-1, 3))[0].reshape(60, -1).min(axis=1)
    assert np.all(bound <= least)
