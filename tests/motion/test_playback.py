"""What is shown between frames: closed forms, independent integration, solved shapes, and its order."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import harness_opt as ho
from harness_opt.motion.playback import between
from oracles.hinged import (
    ALONG_X,
    CLAMP,
    HINGE,
    PROBLEM,
    STEP,
    UP,
    halves,
    hinged,
    integrated,
    polygon,
    problem_of,
    turns,
)

BOTH = pytest.mark.parametrize("how", ["linear", "exact"])


@BOTH
@pytest.mark.parametrize(("step", "count"), [(0.02, 101), (0.3, 8), (2.0, 2), (1.999999999, 3)])
def test_moments_run_from_the_first_to_the_last(motion, how, step, count):
    times, shown = ho.display(motion, "lead", step, how)
    assert times[0] == 0.0 and times[-1] == 2.0 and len(times) == len(shown) == count
    np.testing.assert_allclose(np.diff(times)[:-1], step, rtol=1e-12)
    assert 0 < times[-1] - times[-2] <= step * (1 + 1e-12)


@BOTH
def test_at_a_frame_its_own_profile_is_shown(motion, how):
    step = 2.0 / (len(motion.motion) - 1) / 3  # two moments between every two frames
    _, shown = ho.display(motion, "lead", step, how)
    for profile, solved in zip(shown[::3], ho.profiles(motion, "lead"), strict=True):
        np.testing.assert_array_equal(profile.position, solved.position)
        np.testing.assert_array_equal(profile.rotation, solved.rotation)


@BOTH
def test_beside_a_frame_the_shape_is_the_frame_to_rounding(motion, how):
    beside = 1e-11
    for offset, frames in ((beside, motion.motion[:-1]), (-beside, motion.motion[1:])):
        position, _ = between(motion, "lead", frames + offset, how)
        kept = slice(0, -1) if offset > 0 else slice(1, None)
        assert np.max(np.abs(position - motion.cables["lead"].position[kept])) < 100 * beside


def test_exact_keeps_the_length(motion):
    s = motion.cables["lead"].s
    for profile in ho.display(motion, "lead", 0.017)[1]:
        # the solved frames themselves are so good, see the stations' distance and the motion's tolerance
        assert np.max(np.abs(integrated(s, profile) - profile.position)) < 2e-8
    shortened = [abs(polygon(profile.position) - 1.0) for profile in ho.display(motion, "lead", 0.017, "linear")[1]]
    assert max(shortened) > 1e-4


def test_exact_meets_the_clamps_at_any_moment(motion):
    times, shown = ho.display(motion, "lead", 0.013)
    position, rotation = hinged(0.2 + times / 2.0, CLAMP)
    for k, profile in enumerate(shown):
        np.testing.assert_allclose(profile.position[[0, -1]], [(0, 0, 0), position[k]], atol=2e-12)
        np.testing.assert_allclose(profile.rotation[[0, -1]], [np.eye(3), rotation[k]], atol=2e-12)


def test_a_cable_carried_along_turns_as_one():
    """Both clamps on one body: exact turns the cable, linear cuts the circle, which shortens it by its chord."""
    carried = problem_of(ho.End((0, 0, 0), UP, body="arm"), CLAMP, gravity=(0, 0, 0))
    moved = ho.simulate(carried, spatial_step=0.2)
    half = 0.5 / (len(moved.motion) - 1)  # angle between neighbours: 1 rad in all
    position, rotation = between(moved, "lead", halves(moved), "exact")
    first = ho.profiles(moved, "lead")[0]
    axis = np.array(HINGE.axis) / np.linalg.norm(HINGE.axis)
    for k, at in enumerate(halves(moved)):
        turn = Rotation.from_rotvec(at * axis)
        np.testing.assert_allclose(position[k], HINGE.point + turn.apply(first.position - HINGE.point), atol=2e-7)
        np.testing.assert_allclose(rotation[k], turn.as_matrix() @ first.rotation, atol=2e-6)
    cut, turned = between(moved, "lead", halves(moved), "linear")
    along = (position - HINGE.point) @ axis
    foot = HINGE.point + along[..., None] * axis
    np.testing.assert_allclose(cut, foot + math.cos(half) * (position - foot), atol=2e-7)
    np.testing.assert_allclose(turned, rotation, atol=2e-6)
    assert np.all(polygon(cut) < polygon(position))


def test_a_free_end_hangs_as_it_is_carried():
    hanging = problem_of(ho.End((0, 0, 0), ALONG_X, body="arm"), ho.End())
    hanging = dataclasses.replace(hanging, bodies={"arm": ho.Body(ho.Slide((1, 2, 3), 0.0, 0.5))})
    moved = ho.simulate(hanging, spatial_step=0.25)
    still = moved.cables["lead"].position[0]
    for how, at in itertools.product(["exact", "linear"], [0.1, 0.6]):
        position, _ = between(moved, "lead", np.array([at]), how)
        np.testing.assert_allclose(position[0], still + at * 0.5 * np.array([1, 2, 3]) / math.sqrt(14), atol=2e-7)


GIVEN = [(), ("position",), ("quaternion",), ("position", "quaternion")]


@pytest.mark.parametrize(
    ("start", "end"), [(a, b) for a, b in itertools.product(GIVEN, GIVEN) if "position" in (*a, *b)], ids=str
)
def test_what_the_ends_are_given_is_met_and_no_more_is_bent(motion, start, end):
    """Shapes between clamps are as good as any to interpolate between; so the ends may be loosened afterwards."""
    run = PROBLEM.cables["lead"]
    loose = [
        dataclasses.replace(clamp, **{name: None for name in ("position", "quaternion") if name not in given})
        for clamp, given in ((run.start, start), (run.end, end))
    ]
    problem = problem_of(*loose)
    values = halves(motion)
    position, rotation = between(dataclasses.replace(motion, problem=problem), "lead", values, "exact")
    target, target_frame = hinged(0.2 + values, CLAMP)
    goals = {("start", "position"): (position[:, 0], 0.0), ("start", "quaternion"): (rotation[:, 0], np.eye(3))}
    goals |= {("end", "position"): (position[:, -1], target), ("end", "quaternion"): (rotation[:, -1], target_frame)}
    for (name, quantity), (found, goal) in goals.items():
        if quantity in {"start": start, "end": end}[name]:
            np.testing.assert_allclose(found, np.broadcast_to(goal, found.shape), atol=2e-12)
    s = motion.cables["lead"].s
    for k in range(len(values)):
        profile = ho.Profile(position[k], rotation[k])
        assert np.max(np.abs(integrated(s, profile) - profile.position)) < 2e-8
    solved = turns(Rotation.from_quat(motion.cables["lead"].quaternion.reshape(-1, 4), scalar_first=True).as_matrix())
    change = turns(rotation) - 0.5 * (solved[1:] + solved[:-1])
    size = np.linalg.norm(change, axis=-1).max(axis=0)
    if set(start).isdisjoint(end):
        assert size.max() < 1e-12  # placing the whole is enough, and the curvature is the plain mean
    else:
        assert size.max() > 1e-8
        # an end free to turn bears no moment: at half a piece from it, the change is next to nothing
        assert size[0] < 0.03 * size.max() or "quaternion" in start
        assert size[-1] < 0.03 * size.max() or "quaternion" in end


def test_far_from_the_origin_nothing_is_lost():
    away = np.array([3e4, -2e4, 1e4])
    moved = dataclasses.replace(HINGE, point=tuple(away + HINGE.point))
    end = dataclasses.replace(CLAMP, position=tuple(away + CLAMP.position))
    run = dataclasses.replace(PROBLEM.cables["lead"], start=ho.End(tuple(away), UP), end=end)
    far = dataclasses.replace(PROBLEM, cables={"lead": run}, bodies={"arm": ho.Body(moved)})
    found = ho.simulate(far, frames=[0.0, 0.1])
    near = ho.simulate(PROBLEM, frames=[0.0, 0.1])
    shown, expected = (between(m, "lead", np.array([0.05]), "exact")[0] for m in (found, near))
    np.testing.assert_allclose(shown - away, expected, atol=1e-7)


def test_second_order_in_the_spatial_step():
    steps = [STEP, 2 * STEP, 4 * STEP]
    motions = [ho.simulate(PROBLEM, spatial_step=step) for step in steps]
    errors = [ho.display_error(found, "lead") for found in motions]
    widths = np.log([1.0 / (len(found.motion) - 1) for found in motions])
    for how, quantities in {"linear": ("node", "length", "clamp"), "exact": ("node",)}.items():
        for quantity in quantities:
            order = np.polyfit(widths, np.log([getattr(error[how], quantity) for error in errors]), 1)[0]
            assert order == pytest.approx(2.0, abs=0.2), (how, quantity)
    for error in errors:
        assert error["exact"].node < error["linear"].node
        assert error["exact"].length < 1e-4 * error["linear"].length
        assert error["exact"].clamp < 1e-10 and error["exact"].clamp_turn < 1e-10


def test_the_errors_are_those_of_the_profiles_shown(motion):
    errors = ho.display_error(motion, "lead", 0.9)
    solved = ho.simulate(PROBLEM, frames=np.union1d(motion.motion, [0.45, 0.9]))
    for how, error in errors.items():
        times, shown = ho.display(motion, "lead", 0.9, how)
        np.testing.assert_allclose(times, [0.0, 0.9, 1.8, 2.0])
        truth = [solved.cables["lead"].position[np.searchsorted(solved.motion, at)] for at in (0.45, 0.9)]
        distance = np.linalg.norm(np.array([p.position for p in shown[1:3]]) - truth, axis=-1)
        assert error.node == pytest.approx(distance.max(), rel=1e-6)
        assert error.time == pytest.approx([0.9, 1.8][distance.max(axis=1).argmax()])
        lengths = [polygon(p.position) / polygon(r) - 1.0 for p, r in zip(shown[1:3], truth, strict=True)]
        assert error.length == pytest.approx(np.abs(lengths).max(), rel=1e-6)


def test_no_error_where_all_moments_are_frames(motion):
    errors = ho.display_error(motion, "lead", 2.0)
    assert all(dataclasses.astuple(error) == (0.0,) * 5 for error in errors.values())
