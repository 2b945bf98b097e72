"""The paper's own transcription (differential quadrature, overdetermined) against exact and independent shapes.

Exact: the clamped elastica by elliptic integrals. Independent: the reference shapes in ``reference/``.
"""

import numpy as np
import pytest
from test_analytic import ALONG_X, elastica_error, unit_cable
from test_reference import G, cable, ends, table

import harness_opt as ho
from harness_opt import rod
from harness_opt.quadrature import differential_quadrature


def by_the_paper(points: int, **options: object) -> float:
    shape = ho.equilibrium(
        unit_cable(), ho.End((0, 0, 0), ALONG_X), ho.End((0.6, 0, 0), ALONG_X), bow=(0, 0, 1), transcription="dqm",
        points=points, throw=False, **options,
    )  # fmt: skip
    return elastica_error(shape.position, shape.s, 0.6, np.array([0.0, 0.0, 1.0]))


@pytest.mark.parametrize("count", [5, 20, 60, 200])
def test_weights(count):
    rule = differential_quadrature(count)
    # (22) as printed, where its products neither over- nor underflow
    if count <= 20:
        gap = rule.nodes[:, None] - rule.nodes
        np.fill_diagonal(gap, 1.0)
        products = gap.prod(axis=1)
        printed = products[:, None] / products / gap
        np.fill_diagonal(printed, (1.0 / gap).sum(axis=1) - 1.0)
        np.testing.assert_allclose(rule.first, printed, rtol=1e-9, atol=1e-9 * count**2)
    power = min(count - 1, 12)
    value, slope = rule.nodes**power, power * rule.nodes ** (power - 1)
    assert np.max(np.abs(rule.first @ value - slope)) < 1e-13 * count**2 * power
    assert np.max(np.abs(rule.second @ value - power * (power - 1) * rule.nodes ** (power - 2))) < 1e-14 * count**4
    assert np.max(np.abs(rule.integral @ value - rule.nodes ** (power + 1) / (power + 1))) < 1e-13


def test_error_falls_spectrally_and_closure_puts_a_floor_under_it():
    free = [by_the_paper(points) for points in (21, 31, 41)]
    # each ten points win more than two decades, as a power of 1/N never does for long
    assert free[1] < 1e-2 * free[0] and free[2] < 2e-2 * free[1] and free[2] < 1e-8
    closed = [by_the_paper(points, closure=True) for points in (31, 61)]
    # the chords of (25) are shorter than the arc by a part that falls as 1 / N^2: the floor falls with it
    assert 4e-6 < closed[1] < closed[0] < 1e-4
    assert np.log(closed[0] / closed[1]) / np.log(60 / 30) > 1.5


@pytest.mark.parametrize("solver", ["gauss-newton", "levenberg-marquardt", "ipopt"])
@pytest.mark.parametrize("name", ["clamped_3d", "twist_rig_080_180deg"])
def test_references(name, solver):
    gravity, bow = ((0, 0, -G), None) if "rig" in name else ((0, 0, 0), (0, 1, 0))
    shape = ho.equilibrium(
        cable(name), *ends(name), gravity, bow=bow, transcription="dqm", solver=solver, tolerance=1e-6
    )
    error = np.max(np.linalg.norm(shape.position - table(name).position, axis=1))
    assert shape.ok and shape.stable and error < 1e-6
    assert error < 2 * shape.estimated_error + 1e-11


def test_too_few_points_are_never_called_good():
    name = "twist_rig_080_180deg"
    shape = ho.equilibrium(cable(name), *ends(name), (0, 0, -G), transcription="dqm", points=15, throw=False)
    assert not shape.ok
    assert np.max(np.linalg.norm(shape.position - table(name).position, axis=1)) > 1e-3


@pytest.mark.parametrize("points", [4, 201, 20.5])
def test_points_that_cannot_be(points):
    with pytest.raises(ho.ProblemError, match=r"points: .*5 to 200"):
        by_the_paper(points)


def test_a_mechanical_end():
    # two mechanical groups and the position: a cantilever held at its start, with force and moment at its free end
    units = rod.scale(unit_cable())[1]
    free = ho.End(force=(0, 0, -3.0 * units.force), moment=(0, 0.5 * units.moment, 0))
    start = ho.End((0, 0, 0), ALONG_X)
    ours = ho.equilibrium(unit_cable(), start, free)
    paper = ho.equilibrium(unit_cable(), start, free, transcription="dqm", tolerance=1e-8)
    assert np.max(np.linalg.norm(ours.position - paper.position, axis=1)) < 1e-8
