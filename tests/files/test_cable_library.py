"""Cables from a library, and bend limits in diameters."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.clearance.limits import all_limits
from harness_opt.cli.commands import main
from harness_opt.design.limit_keys import limit_keys
from harness_opt.errors import ProblemError
from harness_opt.files.quantities import Quantities
from harness_opt.files.read import read_problem, toml_tables
from harness_opt.report.redesign_words import redesign_words
from harness_opt.report.summary import summary
from oracles.flap import FLAP, HIT, put

GIVEN = "diameter = 0.005\nbending_stiffness = 2e-3\ntorsional_stiffness = 1.5e-3\nmass_per_length = 0.05\n"
LIBRARY = (
    f"[power]\n{GIVEN}bend_radius_factors = {{ fixed = 4, flexing = 7.5, chain = 10 }}\n\n[thin]\ndiameter = 2e-3\n"
)
FROM = 'from = "my_cables.toml#power"\n'


def using(text: str, reference: str = FROM, library: str = LIBRARY) -> str:
    assert GIVEN in text
    Path("my_cables.toml").write_text(library)
    return text.replace(GIVEN, reference)


def test_a_cable_from_a_library_is_the_same_as_one_written_out(here):
    plain, taken = read_problem(put(FLAP)), read_problem(put(using(FLAP), "taken.toml"))
    assert taken.cables == plain.cables


def test_what_the_cable_says_itself_counts(here):
    problem = read_problem(put(using(FLAP, f"{FROM}diameter = 0.007\ndensity = 1000\n")))
    cable = problem.cables["lead"].cable
    assert cable.diameter == 0.007 and cable.bending_stiffness == 2e-3
    assert cable.mass_per_length == pytest.approx(1000 * 3.14159265 / 4 * 0.007**2), "not both masses"


@pytest.mark.parametrize(("factor", "radius"), [("7.5", 0.0375), ('"chain"', 0.05), ('"fixed"', 0.02)])
def test_the_bend_limit_in_diameters(here, factor, radius):
    problem = read_problem(put(using(FLAP).replace("bend_radius = 0.01", f"bend_radius_factor = {factor}")))
    assert problem.limits.bend_radius == pytest.approx(radius, rel=1e-15)


def test_a_factor_needs_no_library(here):
    problem = read_problem(put(FLAP.replace("bend_radius = 0.01", "bend_radius_factor = 3")))
    assert problem.limits.bend_radius == pytest.approx(0.015)


THIN = "[cables.thin]\nbend_radius = 0.004\n"
OWN = "[cables.lead]\nbend_radius = 0.067\n"

WRONG = [
    (
        'from = "my_cables.toml#pover"\n',
        "found \"my_cables.toml#pover\", expected one of 'power', 'thin'; did you mean",
    ),
    ('from = "my_cables.toml"\n', 'expected a file and a cable, such as "my_cables.toml#power"'),
    ('from = "none.toml#power"\n', 'cables.lead.from: found "none.toml", '),
    ('from = "../my_cables.toml#power"\n', "a file outside the problem's folder"),
    ('from = "/etc/passwd#power"\n', "a file outside the problem's folder"),
    ('from = "flap.toml#cables"\n', "the problem file itself, expected a library of cables"),
    ('from = "my_cables.toml#thin"\n', "cables.lead.bending_stiffness: found nothing, here or in my_cables.toml#thin"),
    ("from = 3\n", "cables.lead.from: found 3, expected text in quotes"),
]


@pytest.mark.parametrize(("reference", "words"), WRONG, ids=[reference.strip() for reference, _ in WRONG])
def test_references_that_lead_nowhere(here, reference, words):
    with pytest.raises(ProblemError) as error:
        read_problem(put(using(FLAP, reference)))
    assert any(words in line and line.startswith("flap.toml: cables.lead.") for line in error.value.mistakes)


@pytest.mark.parametrize(
    ("library", "words"),
    [
        ('[power]\nfrom = "my_cables.toml#power"\n', "which refers to another cable itself"),
        ("[power\n", "which can't be read ("),
        (f"[power]\n{GIVEN}stiffness = 3\n", 'found "stiffness" in my_cables.toml#power, expected one of'),
        ("power = 3\n", "expected a table for each cable in it"),
        (
            LIBRARY.replace("2e-3\ntors", "-2e-3\ntors"),
            "cables.lead.bending_stiffness: found -0.002, expected a number above",
        ),
    ],
)
def test_libraries_with_mistakes(here, library, words):
    with pytest.raises(ProblemError, match=r"flap\.toml: cables\.lead\.") as error:
        read_problem(put(using(FLAP, library=library)))
    assert any(words in line for line in error.value.mistakes)


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ("bend_radius = 0.01\nbend_radius_factor = 3", "found bend_radius as well, expected one of the two"),
        (
            'bend_radius_factor = "flexing"',
            'found "flexing", expected it in cables.lead.bend_radius_factors, or in the',
        ),
        ('bend_radius_factor = "often"', "found \"often\", expected a number above 0, or one of 'fixed', 'flexing'"),
        ("bend_radius_factor = -1", "found -1, expected a number above 0, or one of"),
    ],
)
def test_factors_that_cannot_be(here, limits, words):
    with pytest.raises(ProblemError) as error:
        read_problem(put(FLAP.replace("bend_radius = 0.01", limits)))
    assert any(f"limits.bend_radius_factor: {words}" in line for line in error.value.mistakes)


def two_thicknesses(limit: str) -> str:
    """Return a problem of a cable of 5 mm and one of 2 mm."""
    second = FLAP[FLAP.index("[cables.lead]") : FLAP.index("[bodies.flap.motion]")].replace("lead", "thin")
    second = second.replace("diameter = 0.005", "diameter = 0.002")
    return FLAP.replace("bend_radius = 0.01", limit).replace("clearance = 0.002\n", "") + second


def test_cables_of_several_diameters_have_a_limit_each(here):
    problem = read_problem(put(two_thicknesses("bend_radius_factor = 3")))
    radii = {"lead": 0.015, "thin": 0.006}
    assert {name: run.bend_radius for name, run in problem.cables.items()} == pytest.approx(radii)
    assert problem.limits.bend_radius is None
    again = read_problem(ho.write_problem(problem, "again.toml"))
    assert again.cables == problem.cables and again.limits == problem.limits
    motion = ho.simulate(problem)
    rows = {row.cable: row for row in all_limits(problem, motion, ho.clearances(motion)) if row.name == "bend_radius"}
    for name, radius in radii.items():
        sharpest = 1.0 / np.linalg.norm(motion.cables[name].curvature[..., :2], axis=-1).max()
        assert rows[name].limit == pytest.approx(radius)
        assert rows[name].margin == pytest.approx(sharpest - radius, abs=2e-3 * sharpest)
    keys = {key.name: key for key in limit_keys(problem)}
    assert keys["cables.thin.bend_radius"].replaced(problem, 0.004).cables["thin"].bend_radius == 0.004


def test_a_cable_s_own_limit_counts_before_the_general_one(here):
    problem = read_problem(put(two_thicknesses("bend_radius = 0.015").replace("[cables.thin]\n", THIN)))
    sets = {key.name: {limit.cable for limit in key.sets} for key in limit_keys(problem) if "bend" in key.name}
    assert sets == {"limits.bend_radius": {"lead"}, "cables.thin.bend_radius": {"thin"}}
    with pytest.raises(ProblemError, match=r"cables.thin.bend_radius: found 0.0004, expected at least 0.001, half"):
        read_problem(put(two_thicknesses("").replace("[cables.thin]\n", THIN.replace("0.004", "0.0004"))))
    with pytest.raises(ProblemError, match=r"limits.bend_radius_factor: found cables.thin.bend_radius as well"):
        read_problem(put(two_thicknesses("bend_radius_factor = 3").replace("[cables.thin]\n", THIN)))


def test_a_redesign_is_the_same_for_a_cable_s_own_limit(here):
    general = read_problem(put(HIT.replace("bend_radius = 0.01", "bend_radius = 0.067")))
    own = read_problem(put(HIT.replace("bend_radius = 0.01\n", "").replace("[cables.lead]\n", OWN)))
    found, same = ho.redesign(general), ho.redesign(own)
    assert found.feasible and same.feasible
    assert found.variables == same.variables
    assert [price.key for price in found.prices] == ["limits.bend_radius"]
    assert [(price.key, price.saves) for price in same.prices] == [("cables.lead.bend_radius", found.prices[0].saves)]
    assert "less bend radius of lead would save" in " ".join(redesign_words(summary(same)))


def test_results_do_not_take_the_place_of_a_library(here, capsys):
    Path("mine").mkdir()
    assert main(["simulate", put(FLAP), "-q", "-o", "mine"]) == 0
    file = put(using(FLAP, 'from = "mine/my_cables.toml#power"\n'))
    Path("my_cables.toml").rename("mine/my_cables.toml")
    assert main(["simulate", file, "-q", "-o", "mine"]) == 2
    assert "my_cables.toml in it, which this problem needs" in capsys.readouterr().err
    assert Path("mine/my_cables.toml").read_text() == LIBRARY


def test_a_redesign_and_a_study_know_the_library(here, capsys):
    file = put(using(HIT).replace("bend_radius = 0.01", 'bend_radius_factor = "fixed"'))
    assert main(["redesign", file, "-q", "-o", "out"]) == 0
    again = read_problem("out/redesigned.toml")
    assert again.limits.bend_radius == pytest.approx(0.02) and again.cables["lead"].cable.diameter == 0.005
    known = Quantities(toml_tables(Path(file).read_bytes(), Path(file)), Path(file).resolve())
    thicker = known.problem({"cables.lead.diameter": 0.006})
    assert thicker.limits.bend_radius == pytest.approx(0.024), "four of the new diameters"
    assert isinstance(thicker, ho.Problem)
