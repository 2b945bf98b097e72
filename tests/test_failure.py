"""Every way to fail is named: bad input by its key, no shape by its status, and no solver says yes where it is no."""

from __future__ import annotations

import dataclasses
import math

import casadi as ca
import numpy as np
import pytest
import scipy.sparse as sp

import harness_opt as ho
from harness_opt.numerics import rotations
from harness_opt.numerics.interface import LeastSquares, Options, Solution, largest
from harness_opt.numerics.linear import factorise
from harness_opt.statics import continuation
from harness_opt.statics import mesh as refinement
from harness_opt.statics.solve import SOLVER_OF

NAN = math.nan
CABLE = ho.Cable(length=1.0, diameter=0.01, bending_stiffness=1.0, torsional_stiffness=0.7, mass_per_length=0.5)
UP = (1.0, 0.0, 0.0, 0.0)
ALONG_X = tuple(rotations.from_tangent((1, 0, 0)).tolist())
START = ho.End(position=(0, 0, 0), quaternion=UP)
END = ho.End(position=(0.3, 0, 0.4), quaternion=UP)


# --- bad input ----------------------------------------------------------------------------------------------


def test_ends_further_apart_than_the_length():
    with pytest.raises(ho.ProblemError, match=r"length: found 1 m, expected at least 1\.2 m"):
        ho.equilibrium(CABLE, START, ho.End((0, 0, 1.2), UP))


def test_clamp_that_moves_further_than_the_length():
    run = ho.CableRun(CABLE, START, ho.End((0, 0, 0.9), UP, body="lift"))
    problem = ho.Problem({"lead": run}, {"lift": ho.Body(ho.Slide((0, 0, 1), 0.0, 0.3))})
    with pytest.raises(ho.ProblemError, match=r"length: .*expected at least"):
        ho.simulate(problem)


@pytest.mark.parametrize("end", [ho.End(), ho.End(force=(0, 0, 1)), ho.End(quaternion=UP, force=(0, 0, 1))])
def test_neither_end_has_a_position(end):
    with pytest.raises(ho.ProblemError, match="neither end has a position"):
        ho.equilibrium(CABLE, dataclasses.replace(START, position=None), end)
    with pytest.raises(ho.ProblemError, match="neither end has a position"):
        ho.CableRun(CABLE, dataclasses.replace(START, position=None), end)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"position": (0, 0, 0), "force": (0, 0, 1)}, "force: an end takes position or force, found both"),
        ({"quaternion": UP, "moment": (0, 0, 1)}, "moment: an end takes quaternion or moment, found both"),
        ({"quaternion": (1, 1, 0, 0)}, "quaternion: .*unit quaternion"),
        ({"quaternion": (0, 0, 0, 0)}, "quaternion: .*unit quaternion"),
        ({"position": (0, 0)}, "position: .*expected 3"),
        ({"position": "here"}, "position: .*expected 3"),
        ({"turns": 0.5}, "turns: .*whole number"),
        ({"turns": NAN}, "turns: .*whole number"),
        ({"turns": math.inf}, "turns: .*whole number"),
    ],
)
def test_an_end_that_cannot_be(given, words):
    with pytest.raises(ho.ProblemError, match=words):
        ho.End(**given)


@pytest.mark.parametrize("bad", [NAN, math.inf, -math.inf])
@pytest.mark.parametrize(("name", "count"), [("position", 3), ("quaternion", 4), ("force", 3), ("moment", 3)])
def test_an_end_that_is_not_finite(name, count, bad):
    for k in range(count):
        numbers = [0.0] * count
        numbers[k] = bad
        with pytest.raises(ho.ProblemError, match=f"{name}: .*finite"):
            ho.End(**{name: tuple(numbers)})


@pytest.mark.parametrize("bad", [NAN, math.inf, -1.0])
@pytest.mark.parametrize("name", ["length", "diameter", "bending_stiffness", "torsional_stiffness", "mass_per_length"])
def test_a_cable_that_cannot_be(name, bad):
    with pytest.raises(ho.ProblemError, match=f"{name}: .*expected a number"):
        dataclasses.replace(CABLE, **{name: bad})


@pytest.mark.parametrize(
    ("name", "bad"),
    [
        ("bending_stiffness", (1.0, NAN)),
        ("bending_stiffness", (1.0, 0.0)),
        ("bending_stiffness", (1.0, 1.0, 1.0)),
        ("rest_curvature", (0.0, NAN, 0.0)),
        ("length", 0.0),
        ("length", "long"),
        ("length", True),
    ],
)
def test_other_cables_that_cannot_be(name, bad):
    with pytest.raises(ho.ProblemError, match=f"{name}: found"):
        dataclasses.replace(CABLE, **{name: bad})


@pytest.mark.parametrize(
    "option",
    [
        {"gravity": (0, 0, NAN)},
        {"gravity": (0, 0, math.inf)},
        {"gravity": (0, 0)},
        {"bow": (0, NAN, 0)},
        {"bow": (0, 0, 0)},
        {"bow": (0, 0)},
        {"tolerance": NAN},
        {"tolerance": -1e-9},
        {"solver": "newton"},
        {"transcription": "shooting"},
    ],
    ids=str,
)
def test_options_that_cannot_be(option):
    name = next(iter(option))
    with pytest.raises(ho.ProblemError, match=f"{name}: .*expected"):
        ho.equilibrium(CABLE, START, END, **option)


def test_the_names_of_solvers_are_told():
    with pytest.raises(ho.ProblemError, match=r"'newton'.*'gauss-newton'.*'levenberg-marquardt'.*'ipopt'"):
        ho.equilibrium(CABLE, START, END, solver="newton")


MOVING = ho.CableRun(CABLE, START, ho.End((0.3, 0, 0.4), UP, body="arm"))


def moving(motion: object, **changes: object) -> ho.Problem:
    return dataclasses.replace(ho.Problem({"lead": MOVING}, {"arm": ho.Body(motion)}), **changes)


@pytest.mark.parametrize(
    "build",
    [
        lambda: moving(ho.Hinge((0, NAN, 0), (0, 0, 1), 0, 0.1)),
        lambda: moving(ho.Hinge((0, 0, 0), (0, 0, NAN), 0, 0.1)),
        lambda: moving(ho.Hinge((0, 0, 0), (0, 0, 0), 0, 0.1)),
        lambda: moving(ho.Hinge((0, 0, 0), (0, 0, 1), 0, NAN)),
        lambda: moving(ho.Slide((0, 0, NAN), 0, 0.1)),
        lambda: moving(ho.Slide((0, 0, 1), NAN, 0.1)),
        lambda: moving(ho.Poses((0.0, 1.0), ((0, 0, 0), (0, NAN, 0)), (UP, UP))),
        lambda: moving(ho.Poses((0.0, NAN), ((0, 0, 0), (0, 0, 0)), (UP, UP))),
        lambda: moving(ho.Poses((0.0, 1.0), ((0, 0, 0), (0, 0, 0)), (UP, (0, 0, 0, 0)))),
        lambda: moving(ho.Slide((0, 0, 1), 0, 0.1), gravity=(0, 0, NAN)),
        lambda: moving(ho.Slide((0, 0, 1), 0, 0.1), spatial_step=NAN),
        lambda: moving(ho.Slide((0, 0, 1), 0, 0.1), spatial_step=-1.0),
    ],
    ids=[
        "hinge point",
        "hinge axis",
        "hinge axis of no length",
        "hinge angle",
        "slide direction",
        "slide travel",
        "poses position",
        "poses times",
        "poses quaternion",
        "gravity",
        "spatial step",
        "negative spatial step",
    ],
)
def test_a_motion_that_cannot_be(build):
    with pytest.raises(ho.ProblemError):
        ho.simulate(build())


@pytest.mark.parametrize("step", [NAN, -0.1, 0.0, 0.11])
def test_a_spatial_step_that_cannot_be(step):
    with pytest.raises(ho.ProblemError, match=r"spatial_step: found .*, expected"):
        ho.simulate(moving(ho.Slide((0, 0, 1), 0, 0.1)), spatial_step=step)


def test_a_spatial_step_as_long_as_the_trail():
    assert len(ho.simulate(moving(ho.Slide((0, 0, 1), 0, 0.1)), spatial_step=0.1).motion) == 2


@pytest.mark.parametrize("frames", [[], [0.0, 0.0], [0.5, 0.2], [-0.1, 1.0], [0.0, 1.1], [0.0, NAN], [[0.0, 1.0]]])
def test_frames_that_cannot_be(frames):
    with pytest.raises(ho.ProblemError, match=r"frames: found .*, expected"):
        ho.simulate(moving(ho.Slide((0, 0, 1), 0, 0.1)), frames=frames)


def test_frames_as_given():
    motion = ho.simulate(moving(ho.Slide((0, 0, 1), 0, 0.1)), frames=[0.1, 0.5, 0.7])
    np.testing.assert_array_equal(motion.motion, [0.1, 0.5, 0.7])
    with pytest.raises(ho.ProblemError, match="spatial_step: found beside frames"):
        ho.simulate(motion.problem, frames=[0.1, 0.5], spatial_step=0.01)


# --- no shape -----------------------------------------------------------------------------------------------


def be_impatient(patch: pytest.MonkeyPatch) -> None:
    """Try only coarse meshes and long steps, so that giving up takes a second and not a minute."""
    patch.setattr(continuation, "LEAST_STEP", 0.25)
    patch.setattr(refinement, "ELEMENTS", (8, 12, 16))


@pytest.fixture
def impatient(monkeypatch):
    be_impatient(monkeypatch)


@pytest.fixture(scope="module")
def caught() -> ho.SolveError:
    """Return the error of a cable that is taut, and yet has to arrive across: there is no such shape."""
    with pytest.MonkeyPatch.context() as patch, pytest.raises(ho.SolveError, match="no shape was found: ") as error:
        be_impatient(patch)
        ho.equilibrium(CABLE, START, ho.End((0, 0, 1.0), ALONG_X))
    return error.value


def test_no_shape_raises_with_the_status(caught):
    assert isinstance(caught, ho.HarnessError)
    assert not caught.status.ok and caught.status.value in str(caught)


def test_what_no_shape_leaves_looks_like_none(caught):
    shape = caught.partial
    assert shape.status is caught.status and not shape.ok and not shape.stable
    assert shape.s.shape == (101,) and shape.position.shape == (101, 3) and shape.quaternion.shape == (101, 4)
    assert np.all(np.isnan(shape.position)) and np.isnan(shape.energy)


def test_a_shape_that_has_failed_is_no_guess(caught):
    with pytest.raises(ho.HarnessError):
        ho.equilibrium(CABLE, START, END, guess=caught.partial)


def test_accuracy_out_of_reach_is_not_certified(impatient):
    shape = ho.equilibrium(CABLE, START, END, (0, 0, -9.81), tolerance=1e-17, throw=False)
    assert shape.status is ho.Status.INACCURATE and not shape.ok
    assert 1e-17 < shape.estimated_error < 1e-8  # as good as it gets, and said so
    with pytest.raises(ho.SolveError, match=ho.Status.INACCURATE.value):
        ho.equilibrium(CABLE, START, END, (0, 0, -9.81), tolerance=1e-17)


def test_motion_out_of_reach_is_not_certified(impatient):
    problem = moving(ho.Slide((0, 0, 1), 0, 0.05), gravity=(0, 0, -9.81))
    found = ho.simulate(problem, tolerance=1e-17, throw=False)
    assert found.status is ho.Status.INACCURATE and not found.ok and "lead" in found.message
    with pytest.raises(ho.SolveError) as caught:
        ho.simulate(problem, tolerance=1e-17)
    assert caught.value.status is ho.Status.INACCURATE
    assert len(caught.value.partial.motion) == len(found.motion)


def test_no_place_off_the_cable():
    shape = ho.equilibrium(CABLE, START, END)
    for s in (-0.1, 1.1, [0.5, 2.0]):
        with pytest.raises(ValueError, match="off the cable"):
            shape.at(s)


def test_taut_cable_is_straight_and_no_failure():
    # the tension of an inextensible cable is undetermined there and the equations are singular
    shape = ho.equilibrium(CABLE, ho.End((0, 0, 0), UP), ho.End((0, 0, 1.0), UP))
    assert shape.ok
    straight = np.stack([0 * shape.s, 0 * shape.s, shape.s], axis=1)
    assert np.max(np.abs(shape.position - straight)) < 1e-8


def test_every_status_is_a_sentence():
    words = [status.value for status in ho.Status]
    assert len(set(words)) == len(words)
    assert all(word[0].islower() and len(word.split()) >= 4 for word in words)
    assert [status for status in ho.Status if status.ok] == [ho.Status.OK]


# --- solvers on problems that are no rods -------------------------------------------------------------------


def least_squares(count: int, residual) -> LeastSquares:
    """Return the problem of ``residual``, a function from a CasADi vector to a list of expressions."""
    x = ca.SX.sym("x", count)
    r = ca.vertcat(*residual(x))
    value, slope = ca.Function("r", [x], [r]), ca.Function("j", [x], [ca.densify(ca.jacobian(r, x))])

    def at(x: np.ndarray) -> np.ndarray:
        return np.asarray(value(x)).ravel()

    return LeastSquares(at, lambda x: (at(x), sp.csc_array(np.asarray(slope(x)))), lambda: (x, r))


def solve(name: str, problem: LeastSquares, start, **options) -> Solution:
    """Solve, and check that what the solution says of itself is true."""
    given = Options(**options)
    solution = SOLVER_OF[name](problem, np.asarray(start, dtype=float), given)
    reached = largest(problem.residual(solution.x))
    assert solution.residual == pytest.approx(reached, rel=1e-12) or not np.isfinite(reached)
    assert solution.status.ok == (reached <= given.tolerance)
    assert 0 <= solution.iterations <= given.iterations
    return solution


ROSENBROCK = least_squares(2, lambda x: [10 * (x[1] - x[0] ** 2), 1 - x[0]])
POWELL = least_squares(  # its Jacobian loses two ranks at the root
    4,
    lambda x: [
        x[0] + 10 * x[1],
        np.sqrt(5) * (x[2] - x[3]),
        (x[1] - 2 * x[2]) ** 2,
        np.sqrt(10) * (x[0] - x[3]) ** 2,
    ],
)
BY_SOLVER = pytest.mark.parametrize("name", SOLVER_OF)


@BY_SOLVER
@pytest.mark.parametrize("start", [(-1.2, 1.0), (5.0, -3.0), (1.0, 1.0)])
def test_rosenbrock(name, start):
    solution = solve(name, ROSENBROCK, start)
    assert solution.status is ho.Status.OK
    np.testing.assert_allclose(solution.x, [1, 1], atol=1e-9)


@BY_SOLVER
def test_powell_singular(name):
    solution = solve(name, POWELL, (3.0, -1.0, 0.0, 1.0), tolerance=1e-10, iterations=100)
    assert solution.status is ho.Status.OK
    assert np.max(np.abs(solution.x)) < 1e-4


@BY_SOLVER
def test_iteration_limit(name):
    solution = solve(name, ROSENBROCK, (-1.2, 1.0), iterations=1)
    assert solution.status is ho.Status.ITERATION_LIMIT
    assert solution.iterations == 1


@BY_SOLVER
@pytest.mark.parametrize(
    "residual",
    [
        lambda x: [x[0] ** 2 + 1, x[1]],
        lambda x: [x[0], x[0] - 1, x[1]],
        lambda x: [ca.cos(x[0]) + 2, x[1] - x[0]],
        lambda x: [x[0] * x[1] - 1, x[0] * x[1] + 1],
    ],
    ids=["square", "contradiction", "wave", "two hyperbolas"],
)
def test_no_root_is_never_ok(name, residual):
    solution = solve(name, least_squares(2, residual), (0.7, 0.4))
    assert solution.status in (ho.Status.STALLED, ho.Status.ITERATION_LIMIT)
    assert np.all(np.isfinite(solution.x)) and solution.residual >= 0.4


@BY_SOLVER
def test_stalled_at_the_least_squares_point(name):
    solution = solve(name, least_squares(2, lambda x: [x[0], x[0] - 1, x[1] - 2]), (3.0, 3.0))
    assert solution.status is ho.Status.STALLED
    np.testing.assert_allclose(solution.x, [0.5, 2.0], atol=1e-6)


@BY_SOLVER
def test_not_finite_from_the_start(name):
    solution = solve(name, least_squares(1, lambda x: [ca.log(x[0])]), [-1.0])
    assert solution.status is ho.Status.NOT_FINITE


@BY_SOLVER
def test_jacobian_that_is_not_finite(name):
    solution = solve(name, least_squares(2, lambda x: [ca.sqrt(x[0]) - 1, x[1] - 1]), [0.0, 0.0])
    assert solution.status is not ho.Status.OK
    assert np.all(np.isfinite(solution.x))


@pytest.mark.parametrize("name", [name for name in SOLVER_OF if name != "paper"])  # (26) takes every step
def test_steps_shorten_where_the_residual_ends(name):
    # a full Newton step from 1 lands at -4, where there is no logarithm
    solution = solve(name, least_squares(1, lambda x: [ca.log(x[0]) + 5]), [1.0])
    assert solution.status is ho.Status.OK
    assert solution.x[0] == pytest.approx(math.exp(-5), rel=1e-9)


@BY_SOLVER
def test_residual_that_becomes_not_a_number(name):
    # downhill leads to the edge of the domain, and there is no root before it
    solution = solve(name, least_squares(1, lambda x: [ca.sqrt(x[0]) + x[0] + 0.5]), [2.0])
    assert solution.status is not ho.Status.OK
    assert np.all(np.isfinite(solution.x)) and solution.residual >= 0.5


@pytest.mark.parametrize("name", ["gauss-newton", "levenberg-marquardt"])
@pytest.mark.parametrize("rows", [1, 2, 3])
def test_rank_deficient_problem_gets_the_nearest_root(name, rows):
    # roots: the plane x + y + z = 3; the nearest to the start is its foot
    start = np.array([4.0, 1.0, -5.0])
    problem = least_squares(3, lambda x: [(k + 1) * (x[0] + x[1] + x[2] - 3) for k in range(rows)])
    solution = solve(name, problem, start)
    assert solution.status is ho.Status.OK
    np.testing.assert_allclose(solution.x, start - (start.sum() - 3) / 3, atol=1e-9)


@pytest.mark.parametrize("lost", [0, 1, 2, 5])
@pytest.mark.parametrize("shape", [(12, 12), (15, 12), (10, 12)], ids=str)
def test_linear_steps_are_those_of_the_pseudoinverse(shape, lost):
    random = np.random.default_rng(3)
    rank = min(shape) - lost
    matrix = random.normal(size=(shape[0], rank)) @ random.normal(size=(rank, shape[1]))
    right = random.normal(size=(shape[0], 3))
    factor = factorise(sp.csc_array(matrix))
    expected = np.linalg.pinv(matrix, rcond=1e-10) @ right
    np.testing.assert_allclose(factor.solve(right), expected, atol=1e-8 * np.max(np.abs(expected)))
    np.testing.assert_allclose(factor.solve(right[:, 0]), expected[:, 0], atol=1e-8 * np.max(np.abs(expected)))
    assert factor.singular == (lost > 0 or shape[0] != shape[1])


def test_a_weight_beyond_all_numbers_is_refused_without_a_word_from_numpy():
    heavy = ho.Cable(1.0, 0.01, 1.0, 0.7, 1e200)
    shape = ho.equilibrium(heavy, START, END, (0, 0, -9.81), throw=False)
    assert not shape.ok and not shape.stable
