"""Going down an energy whose minima are known."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from harness_opt.numerics.descent import Ended, descend
from harness_opt.numerics.interface import Expansion


class Sphere:
    """Height over the unit sphere, a . q + q . H q / 2 with |q| = 1 as the constraint: everything is known."""

    constraints = 1

    def __init__(self, slope, curvature):
        self.slope, self.curvature = np.asarray(slope, dtype=float), np.diag(curvature).astype(float)
        self.sparsity = ca.Sparsity.dense(4, 4)

    def energy(self, q):
        return float(self.slope @ q + 0.5 * q @ self.curvature @ q), np.array([0.5 * (q @ q - 1.0)])

    def expand(self, q, multipliers):
        matrix = np.zeros((4, 4))
        matrix[:3, :3] = self.curvature - multipliers[0] * np.eye(3)
        matrix[3, :3] = matrix[:3, 3] = q
        order = np.concatenate([np.flatnonzero(np.pad(np.ones((3, 3)), (0, 1)).ravel()), [3, 7, 11, 12, 13, 14, 15]])
        places = np.concatenate([order, [0, 5, 10]])
        gradient = self.slope + self.curvature @ q - multipliers[0] * q
        return Expansion(gradient, self.energy(q)[1], matrix.ravel()[order], 9, places, self.sparsity, np.ones(3))

    def size(self, step):
        return float(np.linalg.norm(step))

    def move(self, q, step):
        return q + step

    def too_coarse(self, q):
        return False


@pytest.mark.parametrize("start", [(1e-3, 0.0, 1.0), (1.0, 1.0, 1.0), (0.1, -3.0, 0.2), (1e-6, 1.0, 1e-6)])
def test_a_minimum_is_found_and_not_a_saddle(start):
    # without a slope minimum, saddle and maximum are the axes
    found = descend(Sphere((0.0, 0.0, 1e-3), (-3.0, -1.0, 2.0)), np.array(start), np.zeros(1), longest=0.3, steps=300)
    assert found.ended is Ended.AT_MINIMUM
    np.testing.assert_allclose(np.abs(found.q), [1.0, 0.0, 1e-3 / 5.0], atol=1e-6)
    assert found.multipliers[0] == pytest.approx(-3.0, abs=1e-6)


def test_a_descent_out_of_steps_says_so():
    found = descend(Sphere((0, 0, 0.1), (-3, -1, 2)), np.array([0.0, 0.1, 1.0]), np.zeros(1), longest=0.01, steps=5)
    assert found.ended is Ended.UNFINISHED and found.steps == 5
