"""Paths of clamps: in closed form, driving a motion, and what a list of poses has to be."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import harness_opt as ho
from oracles.hinged import (
    CLAMP,
    POINTS,
    PROBLEM,
    STEP,
    TURNS,
    UP,
    hinged,
    problem_of,
)


def test_the_path_of_a_hinged_clamp_is_a_circle():
    path = ho.disperse(PROBLEM, "lead")
    position, rotation = hinged(np.linspace(0.2, 1.2, len(path)), CLAMP)
    np.testing.assert_allclose(path.position, position, atol=1e-14)
    np.testing.assert_allclose(path.rotation, rotation, atol=1e-14)
    steps = np.linalg.norm(np.diff(path.position, axis=0), axis=1)
    assert np.all(steps <= STEP) and np.all(steps > 0.7 * STEP)


def test_the_path_is_where_the_motion_is_solved(motion):
    path, last = ho.disperse(PROBLEM, "lead"), [profile.position[-1] for profile in ho.profiles(motion, "lead")]
    np.testing.assert_allclose(path.position, last, atol=1e-10)


def test_a_spatial_step_disperses_the_path():
    assert len(ho.disperse(PROBLEM, "lead", STEP / 4)) == pytest.approx(4 * len(ho.disperse(PROBLEM, "lead")), abs=4)


def test_the_path_of_the_fixed_point_stands_still():
    path = ho.disperse(PROBLEM, "lead", clamp="start")
    assert np.all(path.position == 0.0) and np.all(path.rotation == np.eye(3))


def test_a_path_drives_a_motion(motion):
    """The paper's list of positions and rotation matrices is all that a simulation needs to know of the clamp."""
    path = ho.disperse(PROBLEM, "lead")
    driven = problem_of(PROBLEM.cables["lead"].start, ho.End((0, 0, 0), UP, body="arm"))
    driven = dataclasses.replace(driven, bodies={"arm": ho.Body(path.poses(duration=2.0))})
    again = ho.simulate(driven, frames=np.linspace(0, 1, len(path)))
    assert driven.bodies["arm"].motion.times[-1] == 2.0
    difference = again.cables["lead"].position - motion.cables["lead"].position
    assert np.max(np.abs(difference)) < 1e-6


def test_a_path_that_turns_on_the_spot_and_past_half_a_turn():
    angle = np.linspace(0.0, 2.0 * math.pi, 9)
    path = ho.Path(np.zeros((9, 3)), Rotation.from_rotvec(np.outer(angle, [0, 0, 1])).as_matrix())
    poses = path.poses(duration=4.0)
    np.testing.assert_allclose(poses.times, np.linspace(0, 4, 9))
    assert np.all(np.sum(np.multiply(poses.quaternions[1:], poses.quaternions[:-1]), axis=1) > 0.9)  # no sign jumps
    _, between_points = poses.poses([1 / 16])
    np.testing.assert_allclose(
        np.abs(between_points[0]), [math.cos(math.pi / 16), 0, 0, math.sin(math.pi / 16)], atol=1e-12
    )


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: ho.disperse(PROBLEM, "power"), r"cable: found 'power', expected one of 'lead'"),
        (lambda: ho.disperse(PROBLEM, "lead", clamp="middle"), r"clamp: found 'middle', expected 'start' or 'end'"),
        (lambda: ho.disperse(PROBLEM, "lead", 0.0), "spatial_step: found 0.0, expected"),
        (lambda: ho.disperse(PROBLEM, "lead", math.nan), "spatial_step: found nan, expected"),
        (lambda: ho.disperse(PROBLEM, "lead", 5.0), "spatial_step: found 5 m, expected at most .* the whole trail"),
        (lambda: ho.disperse(dataclasses.replace(PROBLEM, bodies={"arm": ho.Body()}), "lead"), "bodies: .*no path"),
        (lambda: ho.disperse(PROBLEM, "lead").poses(0.0), "duration: found 0.0, expected"),
    ],
)
def test_paths_that_cannot_be_dispersed(call, words):
    with pytest.raises(ho.ProblemError, match=words):
        call()


@pytest.mark.parametrize("free", [("position",), ("quaternion",), ("position", "quaternion")])
def test_a_free_end_has_no_path(free):
    loose = problem_of(PROBLEM.cables["lead"].start, dataclasses.replace(CLAMP, **dict.fromkeys(free)))
    words = rf"cables\.lead\.end: found an end without {' and '.join(free)}, expected both"
    with pytest.raises(ho.ProblemError, match=words):
        ho.disperse(loose, "lead")


KINDS = pytest.mark.parametrize(("kind", "point"), [(ho.Path, "path point"), (ho.Profile, "node")])


def spoiled(array: np.ndarray, at: object, value: object) -> np.ndarray:
    changed = array.copy()
    changed[at] = value
    return changed


@KINDS
@pytest.mark.parametrize(
    ("position", "rotation", "words"),
    [
        (POINTS, spoiled(TURNS, (2, slice(None), 0), -TURNS[2, :, 0]), "rotation: found .* determinant -1 at POINT 2"),
        (
            POINTS,
            spoiled(TURNS, (1, 0, 0), TURNS[1, 0, 0] + 1e-8),
            "rotation: .* at POINT 1 .*differs from the identity by",
        ),
        (
            POINTS,
            spoiled(TURNS, 3, np.sqrt(1.3) * TURNS[3]),
            "at POINT 3 whose A.T A differs from the identity by 0.3,",
        ),
        (POINTS, spoiled(TURNS, 0, 1e300), "at POINT 0 whose A.T A differs from the identity by inf,"),
        (POINTS, spoiled(TURNS, (1, 1, 1), math.nan), "rotation: found .*nan.* at POINT 1, expected finite"),
        (spoiled(POINTS, (3, 0), math.inf), TURNS, r"position: found \[inf, 10.0, 11.0\] at POINT 3, expected finite"),
        (POINTS[:, :2], TURNS, r"position: found an array of shape \(4, 2\), expected \(M, 3\)"),
        (POINTS, TURNS[0], r"rotation: found an array of shape \(3, 3\), expected \(M, 3, 3\)"),
        (POINTS[:3], TURNS, "rotation: found 4 matrices, expected one a POINT, 3"),
        (POINTS[:1], TURNS[:1], r"position: found an array of shape \(1, 3\), expected .* at least two POINTs"),
        (1.0, TURNS, r"position: found an array of shape \(\)"),
        ([[0, 0, 0], [1]], TURNS, "position: found rows of different lengths"),
        (POINTS.astype(complex), TURNS, "position: found an array of complex128, expected real"),
        (POINTS, None, "rotation: found an array of object, expected real"),
    ],
)
def test_poses_that_cannot_be(kind, point, position, rotation, words):
    with pytest.raises(ho.ProblemError, match=words.replace("POINT", point)):
        kind(position, rotation)


def test_every_mistake_is_told_at_once():
    with pytest.raises(ho.ProblemError) as caught:
        ho.Path(spoiled(POINTS, 0, math.nan), -TURNS)
    assert [line.split(":")[0] for line in caught.value.mistakes] == ["position", "rotation"]


@KINDS
def test_poses_do_not_change_behind_the_back(kind, point):
    mine = POINTS.copy()
    made = kind(mine, TURNS)
    mine[0] = 7.0
    np.testing.assert_array_equal(made.position, POINTS)
    with pytest.raises(ValueError, match="read-only"):
        made.rotation[0] = 0.0
