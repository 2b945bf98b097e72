"""Tables and moves that a hinge or a slide follows: values, exact speeds, and what is told of them."""

from __future__ import annotations

import math

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.files.summary import moments_of, path_entry
from harness_opt.model.courses import polyline
from oracles.chains import random_course
from oracles.problems import shipped

OUT_AND_BACK = ho.Moves(0.0, (ho.Move(math.radians(60), 2.0, 1.0), ho.Move(0.0, 1.0)))


def test_moves_are_where_they_say_at_rest_and_half_way():
    at = np.array([0.0, 1.0, 2.0, 2.5, 3.0, 3.5, 4.0]) / OUT_AND_BACK.seconds
    assert OUT_AND_BACK.seconds == 4.0
    np.testing.assert_allclose(np.degrees(OUT_AND_BACK.values(at)), [0, 30, 60, 60, 60, 30, 0], atol=1e-12)
    rest = np.array([0.0, 2.0, 2.5, 3.0, 4.0]) / 4.0
    for order in (1, 2):
        np.testing.assert_allclose(OUT_AND_BACK.derivative(rest, order), 0.0, atol=1e-12)


def test_largest_speed_and_acceleration_of_a_move_are_those_of_the_books():
    """15/8 of the mean speed, and 10/sqrt(3) of the way over the time squared."""
    speed, acceleration = ho.Moves(0.2, (ho.Move(1.2, 3.0),)).rates(np.zeros(1), np.ones(1))
    assert speed[0] == pytest.approx(15 / 8, rel=1e-11)
    assert acceleration[0] == pytest.approx(10 / math.sqrt(3), rel=1e-11)


def test_a_table_of_a_cubic_is_that_cubic(rng):
    times = np.sort(rng.uniform(1.0, 5.0, 9))
    cubic = np.polynomial.Polynomial(rng.normal(size=4))
    table = ho.ValueTable(tuple(times.tolist()), tuple(cubic(times).tolist()))
    at = np.linspace(0, 1, 101)
    span = times[-1] - times[0]
    for order in (0, 1, 2):
        expected = cubic.deriv(order)(times[0] + span * at) * span**order
        np.testing.assert_allclose(table.derivative(at, order), expected, atol=1e-8)


def test_rates_are_the_most_of_dense_samples(rng):
    """And no more than samples may miss: of an acceleration, which has corners, one sample's way."""
    for _ in range(60):
        course = random_course(rng)
        cuts = np.sort(np.concatenate([[0, 1], rng.uniform(0, 1, 6), rng.choice(course.turns, 2)]))
        first, last = cuts[:-1], cuts[1:]
        inside = first + np.linspace(0, 1, 4001)[:, None] * (last - first)
        for order, bound in zip((1, 2), course.rates(first, last), strict=True):
            most = np.abs(course.derivative(inside.ravel(), order).reshape(inside.shape)).max(axis=0)
            whole = np.abs(course.derivative(np.linspace(0, 1, 4001), order)).max()
            assert np.all(most <= bound + 1e-12 * whole)
            assert np.all(bound <= most + {1: 1e-5, 2: 1e-3}[order] * whole + 1e-9)


def test_derivatives_are_those_of_the_values(rng):
    at, h = np.linspace(0.01, 0.99, 301), 1e-5
    for _ in range(20):
        course = random_course(rng)
        for order in (0, 1):
            slope = (course.derivative(at + h, order) - course.derivative(at - h, order)) / (2 * h)
            scale = np.abs(course.derivative(at, order + 1)).max() + 1.0
            # where an acceleration has a corner, a difference across it is off by its step
            np.testing.assert_allclose(slope, course.derivative(at, order + 1), atol=1e-3 * scale)


def test_a_hinge_takes_its_ends_from_what_it_follows():
    hinge = ho.Hinge((0, 0, 0), (0, 0, 1), follows=OUT_AND_BACK)
    assert (hinge.start, hinge.stop) == (0.0, 0.0)
    for motion in (lambda: ho.Hinge((0, 0, 0), (0, 0, 1)), lambda: ho.Slide((0, 0, 1), 0.0)):
        with pytest.raises(ho.ProblemError, match="start, stop: found"):
            motion()
    with pytest.raises(ho.ProblemError, match="follows: found list, expected a ValueTable or Moves"):
        ho.Hinge((0, 0, 0), (0, 0, 1), follows=[1, 2])


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (lambda: ho.Move(1.0, 0.0), "seconds: found 0.0, expected a number above 0"),
        (lambda: ho.Move(1.0, 1.0, -1.0), "dwell: found -1.0, expected a number of at least 0"),
        (lambda: ho.Move(math.nan, 1.0), "to: found"),
        (lambda: ho.Moves(0.0, ()), "moves: found none, expected at least one"),
        (lambda: ho.ValueTable((0.0, 0.0), (1.0, 2.0)), "times: expected at least two increasing numbers"),
        (lambda: ho.ValueTable((0.0, 1.0), (1.0,)), "entries: expected one finite number a time"),
        (lambda: ho.ValueTable((0.0, math.inf), (1.0, 2.0)), "times: expected finite numbers"),
    ],
)
def test_courses_that_cannot_be(made, words):
    with pytest.raises(ho.ProblemError) as error:
        made()
    assert str(error.value).startswith(words)


# --- what is told ---------------------------------------------------------------------------------------


def test_straight_lines_between_what_is_told_are_close(rng):
    at = np.linspace(0, 1, 5001)
    for _ in range(20):
        course = random_course(rng)
        shares, values = polyline(course, 1e-3)
        assert np.abs(np.interp(at, shares, values) - course.values(at)).max() < 1.2e-3
        assert len(shares) < 400


def test_moments_of_moves_are_told_in_degrees():
    bodies = {"lid": ho.Body(ho.Hinge((0, 0, 0), (0, 1, 0), follows=OUT_AND_BACK))}
    found = shipped("lift_arm").changed(bodies=bodies, duration=4.0).moments
    words = [found.words(at) for at in (0.0, 0.25, 0.6, 0.875, 1.0)]
    assert words == ["0.0 deg, 0.0 %", "30.0 deg, 25.0 %", "60.0 deg, 60.0 %", "30.0 deg, 87.5 %", "0.0 deg, 100.0 %"]


def doubted(**bodies: ho.Body) -> list[str]:
    return [line for line in ho.doubts(shipped("lift_arm").changed(bodies=bodies)) if line.startswith("bodies.")]


def test_what_is_hardly_meant():
    slide, hinge = ((1, 0, 0),), ((0, 0, 0), (0, 0, 1))
    steps = ho.ValueTable((0.0, 1.0, 2.0, 3.0), (0.0, 0.0, 0.1, 0.1))
    assert doubted(arm=ho.Body(ho.Hinge(*hinge, follows=OUT_AND_BACK))) == []
    (words,) = doubted(arm=ho.Body(ho.Slide(*slide, follows=steps)))
    assert words == (
        "bodies.arm.motion.file: found rows so far apart that a smooth curve through them goes "
        "25.2 mm beyond their values; give more rows, or moves"
    )
    still = ho.Moves(0.1, (ho.Move(0.1, 4.0),))
    assert doubted(arm=ho.Body(ho.Slide(*slide, follows=still)))[0].endswith("so the body stands still")
    (words,) = doubted(
        arm=ho.Body(ho.Slide(*slide, follows=still)), lid=ho.Body(ho.Slide(*slide, 0.0, 0.1)),
        tray=ho.Body(ho.Slide(*slide, follows=ho.Moves(0.0, (ho.Move(0.1, 1.5),)))),
    )[1:]  # fmt: skip
    assert words == (
        "bodies.tray.motion: found 1.5 s, where that of arm takes 4 s; each is gone through over the whole motion"
    )


def test_a_summary_tells_moves_alone():
    body = ho.Body(ho.Hinge((0, 0, 0), (0, 1, 0), follows=OUT_AND_BACK))
    moments = shipped("lift_arm").changed(bodies={"lid": body}, duration=4.0).moments
    again = moments_of({"path": path_entry(moments)})
    assert [again.words(at) for at in (0.25, 0.6)] == ["30.0 deg, 25.0 %", "60.0 deg, 60.0 %"]
