"""No shape is told by its status, and what is not accurate is not called so."""

from __future__ import annotations

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.statics import continuation
from harness_opt.statics import mesh as refinement
from oracles.held import ALONG_X, CABLE, END, START, UP, moving


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


def test_a_weight_beyond_all_numbers_is_refused_without_a_word_from_numpy():
    with pytest.raises(ho.ProblemError, match=r"mass_per_length: found 1e\+200, expected .*, at most 1e\+100 in size"):
        ho.Cable(1.0, 0.01, 1.0, 0.7, 1e200)
    heavy = ho.Cable(1.0, 0.01, 1.0, 0.7, 1e100)
    shape = ho.equilibrium(heavy, START, END, (0, 0, -9.81), throw=False)
    assert not shape.ok and not shape.stable
