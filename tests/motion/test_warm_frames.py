"""Frames along a path: few Jacobians, few evaluations (counted, not timed), and an error estimate to be trusted."""

from __future__ import annotations

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.motion.cases import CableCases
from harness_opt.motion.follower import CableFollower
from harness_opt.numerics import rotations
from harness_opt.numerics.linear import BENIGN, factorise
from harness_opt.rod.boundary import case
from harness_opt.rod.collocation import BoundCollocation
from harness_opt.statics.continuation import follow
from harness_opt.statics.solve import error_estimate, resample, solve_on
from oracles.flap import FLAP
from oracles.reference import CASES, G, cable, ends, table

DOWN = np.array([0.0, 0.0, -G])


@pytest.fixture
def counted(monkeypatch) -> dict[str, int]:
    """Count residuals and Jacobians of the collocation."""
    counts = {"residual": 0, "linearise": 0}

    def count(name: str) -> None:
        original = getattr(BoundCollocation, name)

        def counting(self, x):
            counts[name] += 1
            return original(self, x)

        monkeypatch.setattr(BoundCollocation, name, counting)

    for name in counts:
        count(name)
    return counts


def swung(weight: float) -> ho.Problem:
    """Return the motion that leads to the 3-D reference shape, under ``weight`` (w L^3 / B)."""
    start, end = ends("clamped_3d")
    turned = rotations.normalise(rotations.multiply(end.quaternion, rotations.conjugate(start.quaternion)))
    motion = ho.Poses((0.0, 1.0), ((0.9, 0, 0), end.position), ((1, 0, 0, 0), tuple(turned)))
    run = ho.CableRun(
        ho.Cable(1.0, 0.01, 1.0, 0.7, weight / G),
        start,
        ho.End((0, 0, 0), start.quaternion, body="gripper"),
        bow=(0, 0, 1),
    )
    return ho.Problem({"lead": run}, {"gripper": ho.Body(motion)}, gravity=tuple(DOWN))


def test_a_frame_takes_two_steps_and_seldom_a_jacobian(counted):
    follower = CableFollower(CableCases(swung(30.0), "lead", "gauss-newton"), np.linspace(0.0, 1.0, 101), 0, None)
    follower._append(follower._start(None, None))
    counted.update(residual=0, linearise=0)
    for _ in range(100):
        follower._append(follower._advance(None))
    assert counted["linearise"] <= 25
    assert counted["residual"] <= 400
    last = follower.frames[-1]
    expected = table("clamped_3d_weight_30")
    assert np.max(np.linalg.norm(last.rod.sample(expected.s).r - expected.position, axis=1)) < 1e-8
    # what the looser residual of a path leaves is far below the error of the mesh
    polished = solve_on(last.case, last.bound.mesh, last.solution.x, "gauss-newton")
    assert np.max(np.abs(last.rod.r - polished.rod.r)) < 1e-9


def test_the_factor_of_a_cable_that_may_turn_freely_leaves_the_turn_out():
    start, end = ends("clamped_elastica_060")
    shape = ho.equilibrium(cable("clamped_elastica_060"), start, end, bow=(0, 0, 1))
    posed = case(cable("clamped_elastica_060"), start, end, DOWN).signed_like(shape.rod.q[0], shape.rod.q[-1])
    solved = solve_on(posed, shape.rod.mesh, resample(shape.rod, shape.rod.mesh), "gauss-newton")
    factor = factorise(solved.bound.linearise(solved.solution.x)[1])
    assert factor.singular and factor.benign
    assert solved.lasting is not None and solved.lasting.condition < BENIGN
    # the turn about the chord is a null direction of J: what the factor returns has no part along it
    null = np.linalg.svd(factor.jacobian.toarray())[2][-1]
    step = factor.solve(np.random.default_rng(0).normal(size=len(null)))
    assert abs(null @ step) < 1e-8 * np.linalg.norm(step)


@pytest.mark.parametrize(
    ("name", "elements"),
    [
        *[("clamped_3d", n) for n in (3, 6, 8)],
        *[("clamped_3d_weight_30", n) for n in (3, 4, 6)],
        *[("clamped_elastica_060", n) for n in (3, 6, 8)],
        *[("twist_rig_080_180deg", n) for n in (3, 4, 6, 8, 12)],
    ],
)
def test_estimated_errors_are_neither_too_small_nor_four_times_too_large(name, elements):
    start, end = ends(name)
    bow = (0, 1, 0) if "3d" in name else (0, 0, 1)
    gravity = tuple(DOWN) if CASES[name]["weight_per_length"] else (0, 0, 0)
    shape = ho.equilibrium(cable(name), start, end, gravity, bow=bow)
    posed = case(cable(name), start, end, np.array(gravity)).signed_like(shape.rod.q[0], shape.rod.q[-1])
    mesh = np.linspace(0.0, 1.0, elements + 1)
    solved = solve_on(posed, mesh, resample(shape.rod, mesh), "gauss-newton")
    fine = np.linspace(0.0, 1.0, 8 * elements + 1)
    reference = solve_on(posed, fine, resample(shape.rod, fine), "gauss-newton")
    everywhere = np.linspace(0.0, 1.0, 1001)  # between the nodes too
    found, expected = (one.rod.sample(everywhere).r for one in (solved, reference))
    if "elastica" in name:  # it may turn freely about its chord, x
        found, expected = (np.stack([r[:, 0], np.hypot(r[:, 1], r[:, 2])], axis=1) for r in (found, expected))
    error = np.max(np.linalg.norm(found - expected, axis=1))
    assert error > 1e-11
    assert 0.8 < error_estimate(solved)[0] / error < 4.0


def test_a_path_may_end_where_it_began():
    start, end = ends("clamped_3d")
    first = ho.equilibrium(cable("clamped_3d"), start, end, bow=(0, 1, 0))
    here = case(cable("clamped_3d"), start, end, DOWN).signed_like(first.rod.q[0], first.rod.q[-1])
    heavy = case(ho.Cable(1.0, 0.01, 1.0, 0.7, 30 / G), start, end, DOWN).signed_like(first.rod.q[0], first.rod.q[-1])
    solved = solve_on(here, first.rod.mesh, resample(first.rod, first.rod.mesh), "gauss-newton")

    def there_and_back(t: float):
        return here.blend(heavy, 1.0 - abs(2.0 * t - 1.0))

    back, reached = follow(there_and_back, solved, 0.0, 1.0, "gauss-newton")
    assert reached == 1.0
    assert np.max(np.abs(back.rod.sample(solved.rod.mesh).r - solved.rod.r)) < 1e-8


def test_frames_between_frames_are_found_from_these_alone(tmp_path, monkeypatch):
    """An untwisted end was fitted for the motion: a certificate needs no second first shape."""
    (tmp_path / "flap.toml").write_text(FLAP.replace("tangent = [0, 0, 1]", 'tangent = [0, 0, 1], roll = "untwisted"'))
    motion = ho.simulate(ho.read_problem(tmp_path / "flap.toml"))
    assert motion.problem.cables["lead"].untwisted is not None

    def never(*_: object, **__: object) -> None:
        raise AssertionError("a first shape was looked for")

    for where in ("harness_opt.motion.cases.fit", "harness_opt.motion.cases.cold_start"):
        monkeypatch.setattr(where, never)
    found = ho.clearances(motion)
    assert sum(found.inserted.values()) > 0 and all(pair.certified for pair in found.pairs)
