"""The collocation's error falls at the order that Gauss's method promises; its estimate tells the truth."""

from __future__ import annotations

import functools

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.numerics import gauss_newton, rotations
from harness_opt.numerics.interface import Options
from harness_opt.rod.boundary import case
from harness_opt.rod.collocation import collocation, pack, stations
from harness_opt.rod.states import Rod
from harness_opt.statics.solve import STAGES, error_estimate, solve_on

FINE, FINE_STAGES = 96, 6  # elements and stages of the solve that stands for the truth
FORCE_ROUNDING = 1e-12  # true errors below this are not measured
DOWN = np.array([0.0, 0.0, -1.0])
ALONG_X = tuple(rotations.from_tangent((1, 0, 0)).tolist())
TILTED = tuple(rotations.normalise([0.3, 0.2, -0.1, 0.9]).tolist())
CLAMP = ho.End((0, 0, 0), ALONG_X)
# unit length and bending stiffness: SI and dimensionless quantities are the same
CASES = {
    "clamped, heavy": (ho.Cable(1, 0.01, 1, 0.7, 20.0), CLAMP, ho.End((0.5, 0.2, 0.1), TILTED)),
    "clamped, weightless, flat, precurved": (
        ho.Cable(1, 0.01, (0.5, 2.0), 1.5, rest_curvature=(2.0, 1.0, 3.0)),
        CLAMP,
        ho.End((0.3, -0.2, 0.4), TILTED),
    ),
    "free, heavy, precurved": (
        ho.Cable(1, 0.01, 1, 0.7, 12.0, rest_curvature=(0.0, 4.0, 2.0)),
        CLAMP,
        ho.End(force=(3.0, 5.0, 2.0), moment=(0.5, 0.0, -1.0)),
    ),
    "pinned, heavy": (ho.Cable(1, 0.01, 1, 2.0, 40.0), CLAMP, ho.End((0.7, 0.1, -0.3), moment=(0, 1.0, 0))),
}


@functools.cache
def shape(name: str) -> ho.Shape:
    return ho.equilibrium(*CASES[name], DOWN, tolerance=1e-12)


def guess(name: str, mesh: np.ndarray, stages: int) -> np.ndarray:
    at = shape(name).at(stations(mesh, stages))
    return pack(at.quaternion, at.moment, at.force[0], stages)


@functools.cache
def solve(name: str, elements: int, stages: int) -> Rod:
    """Solve on a uniform mesh by the transcription itself."""
    posed, mesh = case(*CASES[name], DOWN), np.linspace(0, 1, elements + 1)
    bound = collocation(elements, stages, bool(np.any(posed.load))).bind(
        posed.section, posed.load, posed.boundary, mesh
    )
    solution = gauss_newton.solve(bound.least_squares(), guess(name, mesh, stages), Options(1e-12, 60))
    assert solution.status.ok
    return bound.rod(solution.x)


def truth(name: str) -> Rod:
    return solve(name, FINE, FINE_STAGES)


@pytest.mark.parametrize("name", CASES)
def test_truth_is_converged(name):
    a, b = solve(name, FINE // 2, FINE_STAGES), truth(name)
    assert np.max(np.abs(a.r - b.r[::2])) < 1e-13
    assert np.max(np.abs(a.moment - b.moment[::2])) < 1e-11


@pytest.mark.parametrize("quantity", ["r", "q", "moment", "force"])
@pytest.mark.parametrize(("stages", "meshes"), [(2, (24, 32, 48)), (3, (16, 24, 48)), (4, (12, 16, 24))])
@pytest.mark.parametrize("name", CASES)
def test_order_at_the_nodes_is_twice_the_stages(name, stages, meshes, quantity):
    exact = getattr(truth(name), quantity)
    errors = [np.max(np.abs(getattr(solve(name, n, stages), quantity) - exact[:: FINE // n])) for n in meshes]
    if quantity == "force" and "free" in name:  # the force at a free end is given
        assert max(errors) < 1e-14
        return
    assert min(errors) > 10 * np.finfo(float).eps  # else there would be no order to see
    order = -np.polyfit(np.log(meshes), np.log(errors), 1)[0]
    assert order == pytest.approx(2 * stages, abs=0.4)


@pytest.mark.parametrize("elements", [3, 4, 6, 8])
@pytest.mark.parametrize("name", CASES)
def test_estimate_on_uniform_meshes(name, elements):
    mesh = np.linspace(0, 1, elements + 1)
    solved = solve_on(case(*CASES[name], DOWN), mesh, guess(name, mesh, STAGES), "gauss-newton")
    true = np.max(np.linalg.norm(solved.rod.r - truth(name).r[:: FINE // elements], axis=1))
    estimate = error_estimate(solved)[0]
    assert true > FORCE_ROUNDING
    assert estimate > 0.1 * true
    if elements >= 6:  # the series behind the estimate is cut: on coarser meshes it errs on the safe side
        assert estimate < 10 * true


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("name", CASES)
def test_estimate_that_the_user_sees(name, tolerance):
    found = ho.equilibrium(*CASES[name], DOWN, tolerance=tolerance)
    exact = shape(name).at(np.linspace(0, 1, 101)).position
    true = np.max(np.linalg.norm(found.position - exact, axis=1))
    assert found.ok and found.estimated_error <= tolerance
    assert true <= tolerance
    assert 0.1 * true < found.estimated_error < max(10 * true, 10 * FORCE_ROUNDING)
