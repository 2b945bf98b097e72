"""The programs of a redesign's steps: against closed forms, linear programs of another solver, and differences."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.optimize

from harness_opt.numerics.quadratic_program import PENALTY, Program, solve


def program(margin, rate, soft, floor=0.0, curvature=1.0, gradient=0.0, reach=1.0) -> Program:
    rate = np.asarray(rate, dtype=float)
    k = rate.shape[1]
    return Program(
        np.full(k, curvature),
        np.full(k, gradient),
        np.asarray(margin, dtype=float),
        rate,
        np.broadcast_to(soft, len(rate)),
        floor,
        np.full(k, -reach),
        np.full(k, reach),
    )


def test_projection_on_a_half_space():
    # the nearest point to the origin with a.d >= 1/2 is a / (2 |a|^2), and its multiplier 1 / (2 |a|^2)
    a = np.array([1.0, 2.0])
    answer = solve(program([-0.5], [a], False))
    np.testing.assert_allclose(answer.step, 0.5 * a / (a @ a), rtol=1e-5)
    np.testing.assert_allclose(answer.multipliers, [0.5 / (a @ a)], rtol=1e-5)
    assert abs(answer.slack) < 1e-9


def test_what_cannot_hold_is_short_by_the_least():
    answer = solve(program([-3.0, 1.0], [[1.0], [-0.5]], False))
    np.testing.assert_allclose(answer.step, [1.0])
    assert answer.slack == pytest.approx(2.0)
    assert answer.bounds[0] > 0  # more room above would help


def test_two_limits_share_what_both_lack():
    # d >= 1 - e and d <= -1 + e: half-way, and each carries half
    answer = solve(program([-1.0, -1.0], [[1.0], [-1.0]], True, curvature=0.0))
    assert answer.shortfall == pytest.approx(1.0)
    np.testing.assert_allclose(answer.step, [0.0], atol=1e-6)
    np.testing.assert_allclose(answer.multipliers, [0.5, 0.5], atol=1e-6)


@pytest.mark.parametrize("seed", range(40))
def test_against_linear_programs(seed):
    random = np.random.default_rng(seed)
    k, m = int(random.integers(1, 11)), int(random.integers(5, 300))
    # many rows are nearly the same, as those of neighbouring frames are
    rate = random.normal(size=(3, k))[random.integers(3, size=m)] * (1 + 1e-3 * random.normal(size=(m, 1)))
    margin = 0.3 * random.normal(size=m) + random.choice([0.2, -0.5, 3.0])
    soft = random.random(m) < random.choice([0.3, 1.0])
    floor = 0.0 if random.random() < 0.5 else -np.inf
    reach = float(random.choice([0.25, 1e-2, 1e-4]))
    given = dataclasses.replace(program(margin, rate, soft, floor, 0.0, 0.0, reach))
    answer = solve(given)
    columns = np.hstack([rate, ~soft[:, None], soft[:, None]]).astype(float)
    costs = np.concatenate([np.zeros(k), [PENALTY, float(soft.any())]])
    bounds = [(-reach, reach)] * k + [(0, None), (None if np.isinf(floor) and soft.any() else 0.0, None)]
    exact = scipy.optimize.linprog(costs, A_ub=-columns, b_ub=margin, bounds=bounds)
    assert exact.success
    left = margin + rate @ answer.step
    short = max(0.0, float(np.max(-left[~soft], initial=0.0)))
    least = max(floor, float(np.max(-left[soft]))) if soft.any() else 0.0
    assert PENALTY * short + least == pytest.approx(exact.fun, rel=1e-4, abs=1e-4)


def test_multipliers_are_rates_of_the_objective():
    random = np.random.default_rng(3)
    rate, margin = random.normal(size=(6, 3)), random.normal(size=6) - 0.6
    base = program(margin, rate, False)

    def objective(row: int, change: float) -> float:
        moved = dataclasses.replace(base, margin=margin + change * np.eye(6)[row])
        answer = solve(moved)
        return 0.5 * float(answer.step @ answer.step) + PENALTY * answer.slack

    found = solve(base).multipliers
    for row in range(6):
        exact = (objective(row, -1e-4) - objective(row, 1e-4)) / 2e-4
        assert found[row] == pytest.approx(exact, rel=1e-3, abs=1e-3)
