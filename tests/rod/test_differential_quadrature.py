"""The paper's own transcription (differential quadrature, overdetermined) against exact and independent shapes.

Exact: the clamped elastica by elliptic integrals. Independent: the reference shapes in ``reference/``.
"""

import dataclasses
import itertools

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.numerics import paper_levenberg_marquardt as paper
from harness_opt.numerics.interface import Options
from harness_opt.numerics.quadrature import differential_quadrature
from harness_opt.rod import equations as rod
from harness_opt.rod.boundary import case
from harness_opt.rod.differential_quadrature import Dqm
from oracles.elastica import ALONG_X, elastica_error, unit_cable
from oracles.problems import PROBLEMS
from oracles.reference import G, cable, ends, table


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


@pytest.mark.parametrize("solver", ["gauss-newton", "levenberg-marquardt", "ipopt", "paper"])
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


FLAT = ho.Cable(1.0, 0.01, (1.0, 1.7), 0.8, 5.0 / G, rest_curvature=(0.3, -0.2, 0.4))
HELD = {"position": ((0, 0, 0), (0.5, 0.2, 0.4)), "force": ((0.4, 0, 0.3), (0.5, -0.2, 0.6))}
TURNED = {"quaternion": ((1, 0, 0, 0), (0.8, 0.6, 0, 0)), "moment": ((0.1, 0.2, 0), (0.3, -0.1, 0.2))}


@pytest.mark.parametrize(
    ("first", "second", "third", "fourth"),
    [kinds for kinds in itertools.product(HELD, TURNED, HELD, TURNED) if "position" in kinds],
)
def test_every_combination_of_conditions(first, second, third, fourth):
    # the paper's five groups in threes and twos, and what lies between: one end at least has a position
    start = ho.End(**{first: HELD[first][0], second: TURNED[second][0]})
    end = ho.End(**{third: HELD[third][1], fourth: TURNED[fourth][1]})
    if (second, fourth) == ("moment", "moment") and first != third:  # hangs from a pin: nothing would hold moments up
        start, end = (dataclasses.replace(held, moment=None) for held in (start, end))
    ours = ho.equilibrium(FLAT, start, end, (0, 0, -G))
    paper_s = ho.equilibrium(FLAT, start, end, (0, 0, -G), transcription="dqm", tolerance=1e-6, guess=ours)
    assert ours.stable and paper_s.stable
    assert np.max(np.linalg.norm(ours.position - paper_s.position, axis=1)) < 1e-6


def test_equations_hold_on_an_independent_shape():
    # (9)-(17), (24) and (25) with flat sections, at the shape that the collocation finds to 1e-11
    start, end = ho.End((0, 0, 0), (1, 0, 0, 0)), ho.End((0.3, 0.2, 0.5), (0.8, 0.6, 0, 0))
    shape = ho.equilibrium(FLAT, start, end, (0, 0, -G), tolerance=1e-11)
    posed = case(FLAT, start, end, np.array([0.0, 0.0, -G])).signed_like(shape.quaternion[0], shape.quaternion[-1])
    method = Dqm(posed, 61, True)
    at = shape.at(method.rule.nodes)
    units = rod.scale(FLAT)[1]
    residual = method.residual(method.pack(at.quaternion, at.force / units.force))
    assert np.max(np.abs(residual[:-1])) < 1e-5  # second derivatives on 61 points cost 1e-15 * 61^4
    chords = np.sum(np.linalg.norm(np.diff(at.position, axis=0), axis=1))
    assert residual[-1] == pytest.approx(1.0 - chords, rel=1e-6)
    assert residual[-1] > 1e-5  # what (25) asks for and no shape of the cable has


def test_the_paper_s_step_is_eq_26():
    method = Dqm(case(unit_cable(), ho.End((0, 0, 0), ALONG_X), ho.End((0.6, 0, 0), ALONG_X), np.zeros(3)), 11, True)
    x = method.pack(np.tile(ALONG_X, (11, 1)) + 0.01 * np.sin(np.arange(44.0)).reshape(11, 4), np.ones((11, 3)))
    residual, jacobian = method.linearise(x)
    j = jacobian.toarray()
    norms = np.linalg.norm(j, axis=0)
    scale = paper.LARGEST_SCALE * norms / norms.max()
    damping = np.linalg.norm(j.T @ residual)
    step = -np.linalg.solve(j.T @ j + damping * np.diag(scale**2), j.T @ residual)
    taken = paper.solve(method.least_squares(), x, Options(iterations=1, stationary=True)).x - x
    np.testing.assert_allclose(taken, step, atol=1e-9 * np.max(np.abs(step)))


@pytest.mark.parametrize("solver", ["levenberg-marquardt", "paper"])
def test_a_motion_by_the_paper_s_method(solver):
    run = ho.CableRun(
        unit_cable(), ho.End((0, 0, 0), ALONG_X), ho.End((0, 0, 0), ALONG_X, body="slider"), bow=(0, 0, 1)
    )
    problem = ho.Problem({"lead": run}, {"slider": ho.Body(ho.Slide((-1, 0, 0), -0.8, -0.6))}, spatial_step=0.05)
    theirs = ho.simulate(problem, transcription="dqm", points=31, solver=solver, tolerance=1e-5)
    assert theirs.ok and len(theirs.motion) == 5
    for shape, distance in zip(theirs.cables["lead"].position, (0.8, 0.75, 0.7, 0.65, 0.6), strict=True):
        assert elastica_error(shape, theirs.cables["lead"].s, distance, np.array([0.0, 0.0, 1.0])) < 1e-5


def test_on_the_rig_the_two_methods_agree_or_the_paper_s_says_that_it_failed():
    problem = ho.read_problem(PROBLEMS / "twist_rig" / "twist_rig.toml")
    frames = np.linspace(0.3, 1.0, 8)
    run, solved = problem.cables["cable"], 0
    for start, end in problem.ends("cable", frames):
        begin = ho.equilibrium(run.cable, start, end, problem.gravity)
        theirs = ho.equilibrium(
            run.cable, start, end, problem.gravity, transcription="dqm", points=61, guess=begin, tolerance=1e-5,
            throw=False,
        )  # fmt: skip
        distance = np.max(np.linalg.norm(theirs.position - begin.position, axis=1)) / run.cable.length
        assert theirs.ok == (distance < 1e-5)
        solved += theirs.ok
    assert solved >= 4


def test_a_motion_on_too_few_points_ends_with_the_reason():
    problem = ho.read_problem(PROBLEMS / "twist_rig" / "twist_rig.toml")
    with pytest.raises(ho.SolveError, match=r"frame 0 of 3 .*differential quadrature on 15 points") as caught:
        ho.simulate(problem, frames=[0.5, 0.6, 0.7], transcription="dqm", points=15)
    assert len(caught.value.partial.motion) == 0
