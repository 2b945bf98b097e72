"""Mistakes in problem files: every one is named by its key, all at once."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
import tomlkit
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from harness_opt.errors import ProblemError
from harness_opt.files.read import read_problem
from harness_opt.motion.simulate import simulate
from oracles.mistakes import BETWEEN, NUMBERS, STRUCTURE
from oracles.problem_files import CONTRACT, HINGE, MINIMAL, START, changed, mistakes, written


@pytest.mark.parametrize(("old", "new", "words"), [*NUMBERS, *STRUCTURE, *BETWEEN])
def test_mistake_is_named(folder: Path, old: str, new: str, words: str) -> None:
    lines = mistakes(written(folder, changed((old, new))))
    assert any(words in line for line in lines), lines
    if ": found" in words:
        assert any(line.startswith(words.partition(": found")[0]) for line in lines), lines


SIMPLE = [case for case in NUMBERS if case[0] != "axis = [0, 1, 0]"]


@pytest.mark.parametrize(("old", "new", "words"), SIMPLE)
def test_one_wrong_value_makes_one_line(folder: Path, old: str, new: str, words: str) -> None:
    assert len(mistakes(written(folder, changed((old, new))))) == 1


def test_all_mistakes_come_at_once(folder: Path) -> None:
    text = changed(
        ("length = 0.42 ", "length = -1"),
        ("gravity = [0, 0, -9.81]", "gravity = [0, 0]"),
        ('body = "arm"', 'body = "amr"'),
        ("axis = [0, 1, 0]", "axis = [0, 0, 0]"),
        ("housing.stl", "none.stl"),
        ("clearance = 0.004", "clearence = 0.004"),
        ("[0.40, 0.60]", "[0.60, 0.40]"),
        ("lead.end.rotate_x_deg", "lead.end.rotate_w_deg"),
        ("spatial_step = 0.004", "spatial_step = 0"),
    )
    keys = {line.partition(": ")[0] for line in mistakes(written(folder, text))}
    assert keys == {
        "cables.lead.length",
        "gravity",
        "cables.lead.end.body",
        "bodies.arm.motion.axis",
        "parts.housing.mesh",
        "limits.clearence",
        'design.variables."lead.length"',
        'design.variables."lead.end.rotate_w_deg"',
        "motion.spatial_step",
    }


def test_length_and_reach_name_the_worst_moment(folder: Path) -> None:
    slide = 'kind = "slide"\ndirection = [1, 0, 0]\nfrom = -0.03\nto = 0.97\n'
    text = changed(
        (HINGE, slide), (START, "{ position = [0, 0, 0.018] }"), ('"lead.start.position.z"', '"lead.start.position.x"')
    )
    words = "found 0.42, expected at least 1, the distance between its clamps at 970.0 mm, 100.0 %"
    fixed = re.sub(r"(?m)^\"lead\..*\n", "", text)
    assert mistakes(written(folder, fixed)) == [f"cables.lead.length: {words}"]
    # what a redesign may lengthen or move is for a simulation to refuse
    with pytest.raises(ProblemError) as caught:
        simulate(read_problem(written(folder, text)))
    assert caught.value.mistakes == (f"cables.lead.length: {words}",)


@pytest.mark.parametrize("free", ["{ force = [0, 0, 0] }", "{}"])
def test_a_cable_needs_one_position(folder: Path, free: str) -> None:
    text = re.sub("(start|end) = .*", rf"\1 = {free}", MINIMAL)
    words = "found no position at either end, expected one: the cable would fly away"
    assert mistakes(written(folder, text)) == [f"cables.lead.end.position: {words}"]


def test_no_cables(folder: Path) -> None:
    assert mistakes(written(folder, "schema = 1\n[cables]")) == [
        "cables: found an empty table, expected at least one cable"
    ]
    assert mistakes(written(folder, "schema = 1")) == ["cables: found nothing, expected a table"]


def test_absurd_numbers_are_refused_before_they_overflow(folder: Path) -> None:
    (line,) = mistakes(written(folder, MINIMAL.replace("diameter = 0.01", "diameter = 1e200\ndensity = 1")))
    assert line == "cables.lead.diameter: found 1e+200, expected a number above 0, at most 1e+100 in size"


def test_so_are_those_that_others_are_divided_by(folder: Path) -> None:
    (line,) = mistakes(written(folder, MINIMAL.replace("diameter = 0.01", "diameter = 1e-320")))
    assert line == "cables.lead.diameter: found 1e-320, expected a number above 0, at least 1e-100"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            CONTRACT.replace("clearance = 0.004", "clearance = "),
            'line 33, column 13: found "clearance =", expected TOML: invalid value',
        ),
        (CONTRACT.replace("[limits]", "[limits"), 'column 8: found "[limits", expected TOML'),
        (CONTRACT + "[limits]", 'column 8: found "[limits]", expected TOML: cannot declare'),
        ('a = """', "line 1: found the end of the file, expected TOML: "),
        ("a = " + "9" * 5000, "found a value that can't be read, expected TOML"),
        ("a = " + "[" * 5000, "found brackets nested too deeply"),
        (b"schema = 1\ntitle = '\xff'", "line 2: found bytes that are not UTF-8, expected a TOML text"),
        ("", "found an empty file, expected a problem file"),
    ],
)
def test_not_toml(folder: Path, text: str | bytes, words: str) -> None:
    (line,) = mistakes(written(folder, text))
    assert words in line


def test_no_file(folder: Path) -> None:
    written(folder, CONTRACT)
    assert mistakes(folder / "lft.toml") == ["found no such file (did you mean 'lift.toml'?), expected a problem file"]
    assert mistakes(folder) == ["found a folder, expected a problem file"]
    assert mistakes(folder / "lift.toml" / "x") == ["found no such file, expected a problem file"]
    assert mistakes(folder / ("x" * 300))[0].startswith("found a file that can't be opened")


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    junk=st.recursive(
        st.integers() | st.floats() | st.booleans() | st.text(max_size=3), lambda x: st.lists(x, max_size=3)
    )
)
def test_no_value_brings_the_reader_down(folder: Path, junk: object) -> None:
    """Any value in the place of any key gives messages, never another error."""
    tables = tomllib.loads(CONTRACT)
    for section in ("schema", "cables", "bodies", "motion", "parts", "limits", "design"):
        for broken in (
            {**tables, section: junk},
            {**tables, section: {"x": junk}},
            {**tables, section: {"lead": {"end": junk}}},
        ):
            try:
                text = tomlkit.dumps(broken)
                tomllib.loads(text)
            except ValueError:
                continue
            try:
                read_problem(written(folder, text))
            except ProblemError as error:
                assert error.mistakes
