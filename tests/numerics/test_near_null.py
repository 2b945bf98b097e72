"""Walking along valleys: closed forms whose floor is known, and valleys without a lowest place."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from harness_opt.errors import Status
from harness_opt.numerics import near_null
from harness_opt.numerics.interface import LeastSquares, Options


def problem(residual, jacobian):
    return LeastSquares(
        lambda x: np.array(residual(*x)),
        lambda x: (np.array(residual(*x)), sp.csc_array(np.array(jacobian(*x), dtype=float))),
        lambda: pytest.fail("nothing symbolic is asked for"),
    )


def wave(flat, slope, rate):
    """The valley y = 2 sin x, on which flat * slope(x) is to vanish."""
    return problem(
        lambda x, y: (y - 2.0 * np.sin(x), flat * slope(x)),
        lambda x, y: ((-2.0 * np.cos(x), 1.0), (flat * rate(x), 0.0)),
    )


@pytest.mark.parametrize("flat", [1e-6, 1e-9, 1e-10])
@pytest.mark.parametrize("start", [(0.0, 0.1), (2.0, 1.0), (9.0, 0.0)])
def test_the_lowest_place_of_a_curved_valley_is_found(flat, start):
    found = near_null.solve(wave(flat, lambda x: x - 3.0, lambda x: 1.0), np.array(start), Options(1e-14))
    assert found.status is Status.OK and found.residual <= 1e-14
    assert found.x == pytest.approx([3.0, 2.0 * np.sin(3.0)], abs=1e-13 / flat)


def test_a_closed_valley_is_gone_around():
    circle = problem(
        lambda x, y: (x * x + y * y - 1.0, 1e-9 * (y - 0.5)), lambda x, y: ((2.0 * x, 2.0 * y), (0.0, 1e-9))
    )
    found = near_null.solve(circle, np.array([np.cos(-1.0), np.sin(-1.0)]), Options(1e-14))
    assert found.status is Status.OK
    assert found.x == pytest.approx([np.sqrt(0.75), 0.5], abs=1e-4)


@pytest.mark.parametrize("start", [0.0, 0.9, 1.1, 4.5])
def test_the_walk_goes_down_past_a_nearly_level_place(start):
    # the floor is nearly level at 1, and lowest at 3
    def energy(x):
        return 1e-4 * (x**4 / 4 - 5 * x**3 / 3 + 3.505 * x**2 - 3.03 * x)

    floor = wave(1e-4, lambda x: (x - 3.0) * ((x - 1.0) ** 2 + 0.01), lambda x: 3 * x * x - 10 * x + 7.01)
    begun = np.array([start, 2.0 * np.sin(start)])
    found = near_null.solve(floor, begun, Options(1e-14), lambda x: energy(x[0]))
    assert found.status is Status.OK
    assert found.x[0] == pytest.approx(3.0, abs=1e-9)


def test_a_valley_without_a_lowest_place_is_not_solved():
    endless = wave(1e-9, lambda x: 1.0 + x * x, lambda x: 2.0 * x)
    found = near_null.solve(endless, np.array([0.5, 1.0]), Options(1e-14))
    assert found.status is Status.STALLED
    assert found.residual == pytest.approx(np.max(np.abs(endless.residual(found.x)))) and found.residual >= 1e-9
