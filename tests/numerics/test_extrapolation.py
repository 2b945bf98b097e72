"""What a path is predicted by: exact on polynomials of its degree, and no higher a degree than pays."""

from __future__ import annotations

import numpy as np
import pytest

from harness_opt.numerics.extrapolation import MOST_DEGREE, Trail

PLACES = np.array([0.0, 0.3, 0.4, 0.9, 1.3, 1.45, 2.0, 2.2, 2.5])  # uneven on purpose


def walked(points: np.ndarray, places: np.ndarray) -> Trail:
    """Return the trail of a walk over ``points`` (n, m) at ``places`` (n,)."""
    trail = Trail((points[0],))
    for point, length in zip(points[1:], np.diff(places), strict=True):
        trail = trail.extended(point, length, trail.predictions(length))
    return trail


@pytest.mark.parametrize("degree", range(MOST_DEGREE + 1))
def test_a_polynomial_is_predicted_exactly(degree):
    coefficients = np.random.default_rng(degree).normal(size=(degree + 1, 4))
    points = np.vander(PLACES, degree + 1, increasing=True) @ coefficients
    trail = walked(points, PLACES)
    there = np.vander([2.9], degree + 1, increasing=True)[0] @ coefficients
    predictions = trail.predictions(2.9 - PLACES[-1])
    np.testing.assert_allclose(predictions[degree], there, rtol=0, atol=1e-9 * np.abs(coefficients).max())
    if degree:
        assert np.max(np.abs(predictions[degree - 1] - there)) > 1e-4


def test_no_more_points_are_kept_than_serve():
    trail = walked(np.cos(PLACES)[:, None], PLACES)
    assert len(trail.points) == MOST_DEGREE + 1 == len(trail.steps) + 1


def test_after_a_kink_the_degree_falls_and_on_a_smooth_path_it_rises():
    places = np.linspace(0.0, 3.0, 61)
    smooth = walked(np.sin(places)[:, None], places)
    assert smooth.degree >= 4
    kinked = walked(np.abs(places - 2.975)[:, None], places)  # the kink lies under the last step
    assert kinked.degree == 1
