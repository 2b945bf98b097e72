"""Random stiff and extreme cables: each ends in a certified, stable shape, or in an honest refusal, never in between.

They are those of ``scripts/benchmarks/stiff_and_extreme.py``. The check of a shape, ``extreme_check.py`` beside it, is
written from the rod equations and sees nothing of the solvers.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.errors import Status
from harness_opt.statics.equilibrium import SHAPE_TOLERANCE, refined_shape
from harness_opt.statics.fitting import posed_run
from oracles.scripts import script

extreme, cases, check = script("stiff_and_extreme"), script("extreme_cases"), script("extreme_check")

COUNT, JOBS = 200, 2  # random cases, processes
LIMIT = 90.0  # s, of one case; what takes longer is no refusal, but no shape either
REFUSED = 0.03  # most that may end without a shape, but for those whose turns would need contact
BUCKLING = 8.9868 / (
    2.0 * np.pi
)  # n kz/B of a clamped straight cable without tension when twist buckles it (Greenhill)
LONG = (31, 476, 577, 625, 653)  # whose elements are longer than power series span, or nearly
CURLED = (248,)  # found by beginning with curls, and sliding them
PASSING = (58, 659, 91)  # coiling or curled, all of whose shapes found have lost turns: they would need contact
BASE = cases.BASE.posed()
HONEST = (
    "stable",
    "unstable",
    extreme.CONTACT,
    "refused",
    extreme.TIMEOUT,
)  # unstable: an equilibrium, checked, and called so


@pytest.mark.slow
def test_random_cables_are_certified_or_refused_for_a_reason():
    """In one test: spread over processes, each of them would solve all cables."""
    jobs = [(cases.numbered_case(cases.SEED, k), *extreme.METHODS[0]) for k in range(COUNT)]
    rows = list(extreme.run(jobs, JOBS, LIMIT, compare=False))
    assert len({row.case.name for row in rows}) == COUNT
    # none is called what it is not
    wrong = [(row.case.name, row.outcome, row.complaints) for row in rows if row.outcome not in HONEST]
    assert wrong == []
    # few are refused, but for their turns
    assert np.mean([row.outcome not in ("stable", extreme.CONTACT) for row in rows]) <= REFUSED
    # and only what twist can buckle is said to need contact
    passing = [row.case for row in rows if row.outcome == extreme.CONTACT]
    assert passing
    assert min(abs(case.turns) * case.kz_kx * case.kx_ky for case in passing) > BUCKLING


@pytest.mark.slow
@pytest.mark.parametrize("number", LONG + CURLED)
def test_cables_with_long_elements_or_that_curl_up_have_a_shape(number):
    row = extreme.solve(cases.numbered_case(cases.SEED, number), *extreme.METHODS[0], compare=False)
    assert (row.outcome, row.complaints) == ("stable", "")


@pytest.mark.slow
@pytest.mark.parametrize("number", PASSING)
def test_a_cable_that_coils_is_solved_and_refused_for_its_turns_alone(number):
    cable, start, end, gravity = posed = cases.numbered_case(cases.SEED, number).posed()
    assert ho.equilibrium(*posed, throw=False).status is Status.NOT_WITHOUT_CONTACT
    run = posed_run(ho.CableRun(cable, start, end), np.asarray(gravity), "gauss-newton")
    found = run.cold_start("gauss-newton")
    shape = refined_shape(cable, run.ends, found, SHAPE_TOLERANCE, "gauss-newton", 101)
    assert found.passed and shape.ok and shape.stable
    assert check.verify(*posed, shape, extreme.RESIDUAL) == []


def test_turns_that_a_thrown_loop_takes_are_given_back():
    # soft in torsion: twist is far from buckling it, but the loop that it hangs in is thrown over on the way
    row = extreme.solve(cases.numbered_case(cases.SEED, 155), *extreme.METHODS[0], compare=False)
    assert (row.outcome, row.complaints) == ("stable", "")


@pytest.mark.parametrize("solver", extreme.SOLVERS)
def test_every_solver_comes_to_the_stable_shape_of_a_cable_soft_in_torsion(solver):
    # let go straight on, it rests in its plane; the stable one is twisted
    row = extreme.solve(cases.varied(kz_kx=1e-3), "collocation", solver, compare=False)
    assert (row.outcome, row.complaints) == ("stable", "")


def test_a_case_is_the_same_whatever_was_drawn_before():
    assert cases.numbered_case(3, 5) == cases.numbered_case(3, 5) != cases.numbered_case(3, 6)


@pytest.mark.parametrize("clamps", cases.CLAMPS)
def test_drawn_cases_are_within_their_ranges(clamps):
    drawn = [cases.numbered_case(1, k) for k in range(200)]
    for case in drawn:
        assert 1e-3 <= case.kz_kx <= 1e3 and 1 <= case.kx_ky <= 1e3 and 0 <= case.weight <= 1e6
        assert 1e-6 <= case.distance <= 1 - 1e-6 and abs(case.turns) <= 10 and 1e-3 <= case.length <= 1e3
        assert abs(np.linalg.norm(case.gap) - 1) < 1e-12
    assert sum(case.clamps == clamps for case in drawn) > 20


# --- the check itself -----------------------------------------------------------------------------------


class Bent:
    """A shape whose samples at arc lengths are changed by a function."""

    def __init__(self, shape, change, **fields):
        self.shape, self.change, self.fields = shape, change, fields

    def __getattr__(self, name):
        return self.fields.get(name, getattr(self.shape, name))

    def at(self, s):
        return self.change(self.shape.at(s))


def changed(name, size):
    """Return a change that adds a smooth ``size`` to one quantity, nothing at the ends."""

    def change(at):
        bump = size * np.sin(np.pi * at.s)[:, None] ** 2
        return dataclasses.replace(at, **{name: getattr(at, name) + bump})

    return change


@pytest.fixture(scope="module")
def ordinary():
    return ho.equilibrium(*BASE)


def test_an_ordinary_shape_passes(ordinary):
    assert check.verify(*BASE, ordinary) == []


@pytest.mark.parametrize(
    ("name", "complaint"),
    [
        ("position", "length and place"),
        ("quaternion", "unit quaternions"),
        ("curvature", "constitutive law"),
        ("force", "balance of forces"),
        ("moment", "balance of moments"),
    ],
)
def test_a_wrong_quantity_is_noticed(ordinary, name, complaint):
    found = check.verify(*BASE, Bent(ordinary, changed(name, 1e-3)))
    assert any(line.startswith(complaint) for line in found), found


def test_a_wrong_end_is_noticed(ordinary):
    cable, start, end, gravity = BASE
    moved = dataclasses.replace(end, position=(*end.position[:2], end.position[2] + 1e-5))
    assert [line for line in check.verify(cable, start, moved, gravity, ordinary) if line.startswith("place of end 1")]
    rolled = dataclasses.replace(end, quaternion=start.quaternion)
    assert [line for line in check.verify(cable, start, rolled, gravity, ordinary) if line.startswith("frame of end 1")]


@pytest.mark.parametrize(
    ("fields", "complaint"),
    [({"residual": 1e-3}, "residual"), ({"stability_margin": -1.0}, "stable with"), ({"ok": False}, "ok is False")],
)
def test_a_wrong_word_is_noticed(ordinary, fields, complaint):
    found = check.verify(*BASE, Bent(ordinary, lambda at: at, **fields))
    assert any(line.startswith(complaint) for line in found), found
