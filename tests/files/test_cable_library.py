"""Cables from a library, and bend limits in diameters."""

from __future__ import annotations

from pathlib import Path

import pytest

import harness_opt as ho
from harness_opt.cli.commands import main
from harness_opt.errors import ProblemError
from harness_opt.files.quantities import Quantities
from harness_opt.files.read import read_problem, toml_tables
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


def test_one_radius_for_cables_of_several_diameters_is_refused(here):
    second = FLAP[FLAP.index("[cables.lead]") : FLAP.index("[bodies.flap.motion]")].replace("lead", "thin")
    second = second.replace("diameter = 0.005", "diameter = 0.002")
    text = FLAP.replace("bend_radius = 0.01", "bend_radius_factor = 3") + second
    with pytest.raises(ProblemError, match=r"found several radii \(lead 15 mm, thin 6 mm\), expected one for all"):
        read_problem(put(text))


def test_a_redesign_and_a_study_know_the_library(here, capsys):
    file = put(using(HIT).replace("bend_radius = 0.01", 'bend_radius_factor = "fixed"'))
    assert main(["redesign", file, "-q", "-o", "out"]) == 0
    again = read_problem("out/redesigned.toml")
    assert again.limits.bend_radius == pytest.approx(0.02) and again.cables["lead"].cable.diameter == 0.005
    known = Quantities(toml_tables(Path(file).read_bytes(), Path(file)), Path(file).resolve())
    thicker = known.problem({"cables.lead.diameter": 0.006})
    assert thicker.limits.bend_radius == pytest.approx(0.024), "four of the new diameters"
    assert isinstance(thicker, ho.Problem)
