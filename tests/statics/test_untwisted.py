"""Rolls that are found: an end without one is clamped as the cable comes, a free one turns about its tangent."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.numerics import rotations

ROUND = ho.Cable(0.42, 6.2e-3, 2.1e-3, 1.6e-3, 0.168)
FLAT = ho.Cable(0.42, 6.2e-3, (2.1e-3, 6e-3), 1.6e-3, 0.168, rest_curvature=(0.5, 1.0, 2.0))
START, END = ((0.0, 0.055, 0.12), (0.0, 0.0, 1.0)), ((0.1, 0.02, 0.2), (1.0, 0.3, 0.2))
GRAVITY = np.array([0.0, 0.0, -9.81])
SMALL = 1e-6  # of the moments in the cable
ANGLES = (10, 45, 90, 135)  # degrees


def shape(cable: ho.Cable = ROUND, start: dict | None = None, end: dict | None = None) -> ho.Shape:
    ends = [ho.End(place, tangent=tangent, **(words or {})) for (place, tangent), words in ((START, start), (END, end))]
    return ho.equilibrium(cable, *ends, gravity=GRAVITY)


def twisting(found: ho.Shape, station: int) -> float:
    """Return the twisting moment at a station, in the largest moment there is."""
    along = float(found.moment[station] @ rotations.tangent(found.quaternion[station]))
    return along / float(np.max(np.linalg.norm(found.moment, axis=1)))


@pytest.mark.parametrize("cable", [ROUND, FLAT], ids=["round", "flat"])
@pytest.mark.parametrize(
    ("start", "end", "node"), [({}, {}, -1), ({}, {"roll_deg": 50}, 0), ({"roll_deg": -20}, {"roll": "free"}, -1)]
)
def test_an_open_roll_carries_no_twisting_moment(cable, start, end, node):
    found = shape(cable, start, end)
    assert found.ok and found.stable
    assert abs(twisting(found, node)) < SMALL
    if cable is ROUND:
        assert np.max(np.abs(found.curvature[:, 2])) < 1e-5  # 1/m


def test_a_start_without_a_roll_is_projected():
    found = shape()
    np.testing.assert_allclose(rotations.matrix(found.quaternion[0])[:, 0], [1, 0, 0], atol=1e-9)


@pytest.mark.parametrize("turns", [0.25, -0.4])
def test_turns_are_added_to_the_untwisted_roll(turns):
    none, some = shape(), shape(end={"turns": turns})
    left = rotations.multiply(rotations.conjugate(none.quaternion[-1]), some.quaternion[-1])
    assert rotations.small_rotation_vector(left)[2] == pytest.approx(2.0 * math.pi * turns, abs=1e-6)
    assert np.sign(some.curvature[50, 2]) == np.sign(turns)


def test_turns_at_an_untwisted_start_count_the_other_way():
    np.testing.assert_allclose(
        shape(start={"turns": 0.25}).curvature[:, 2], shape(end={"turns": -0.25}).curvature[:, 2], atol=1e-5
    )


@pytest.mark.parametrize("turns", [0, 0.25])
@pytest.mark.parametrize("mirrored", [False, True], ids=["turned", "mirrored"])
def test_a_scene_turned_mirrored_and_moved_gives_the_same_shape(turns, mirrored):
    first, shift = shape(end={"turns": turns}), np.array([1.0, -2.0, 3.0])
    for axis, angle in itertools.product(range(3), ANGLES):
        flip = np.where((np.arange(3) == axis) & mirrored, -1.0, 1.0)
        turn = rotations.from_rotation_vector(math.radians(angle) * np.eye(3)[axis])
        ends = [
            ho.End(
                tuple(rotations.rotate(turn, flip * place) + shift),
                tangent=tuple(rotations.rotate(turn, flip * tangent)),
                turns=own,
            )
            for (place, tangent), own in ((START, 0), (END, -turns if mirrored else turns))
        ]
        found = ho.equilibrium(ROUND, *ends, gravity=rotations.rotate(turn, flip * GRAVITY))
        back = flip * rotations.rotate(rotations.conjugate(turn), found.position - shift)
        assert np.max(np.abs(back - first.position)) < 1e-7 * ROUND.length
        twist = -found.curvature[:, 2] if mirrored else found.curvature[:, 2]
        assert np.max(np.abs(twist - first.curvature[:, 2])) < 1e-5


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"quaternion": (1, 0, 0, 0), "roll": "free"}, "roll: "),
        (
            {"tangent": (0, 0, 1), "roll": "free", "roll_deg": 3},
            "roll_deg: found roll as well",
        ),
        (
            {"tangent": (0, 0, 1), "quaternion": (1, 0, 0, 0)},
            "tangent: found quaternion as well",
        ),
        ({"tangent": (0, 0, 1), "roll_deg": 3, "turns": 0.5}, "turns: found 0.5, expected a whole number"),
        ({"tangent": (0, 0, 1), "roll": "free", "turns": 1}, "turns: found 1, expected 0"),
        ({"tangent": (0, 0, 1), "roll": "loose"}, 'roll: found "loose", expected one of'),
        ({"roll_deg": 3}, "tangent: found nothing, expected a tangent for roll_deg"),
        ({"tangent": (0, 0, 0)}, "tangent: "),
    ],
)
def test_an_end_that_cannot_be(given, words):
    with pytest.raises(ho.ProblemError, match=words):
        ho.End((0, 0, 0), **given)


@pytest.mark.parametrize("at", [-0.1, 1.5, math.nan])
def test_a_cable_is_fitted_within_the_motion(at):
    with pytest.raises(ho.ProblemError, match="fitted_at: found"):
        ho.CableRun(ROUND, ho.End((0, 0, 0)), ho.End(), fitted_at=at)
