"""Tables and moves of hinges and slides in problem files: read, refused by their keys, written back."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path

import jsonschema
import numpy as np
import pytest

import harness_opt as ho
from harness_opt.files.schema import schema
from oracles.problem_files import CONTRACT, changed, mistakes, same, written

HINGE = "from_deg = 0\nto_deg = 110\n"
MOVES = """\
[[bodies.arm.motion.moves]]
to_deg = 110
seconds = 2
dwell = 0.5
[[bodies.arm.motion.moves]]
to_deg = 0
seconds = 1.5
"""
SLIDE = 'kind = "slide"\ndirection = [0, 0, 1]\n'
ROWS = "t,angle\n0,0\n1,30\n2,50  # a remark\n\n3,110\n"
NO_DURATION = ("duration = 2.0\n", "")


def moved(motion: str, *more: tuple[str, str]) -> str:
    return changed((HINGE, motion), *more)


def sliding(motion: str) -> str:
    start = CONTRACT.index('kind = "hinge"')
    return CONTRACT[:start] + SLIDE + motion + CONTRACT[CONTRACT.index("[motion]") :]


def arm(problem: ho.Problem) -> ho.Hinge | ho.Slide:
    return problem.bodies["arm"].motion


def test_moves_take_the_duration_from_their_seconds(folder: Path) -> None:
    problem = ho.read_problem(written(folder, moved("from_deg = 10\n" + MOVES, NO_DURATION)))
    assert problem.duration == 4.0
    expected = ho.Moves(math.radians(10), (ho.Move(math.radians(110), 2.0, 0.5), ho.Move(0.0, 1.5)))
    assert arm(problem) == ho.Hinge((0, 0, 0.1), (0, 1, 0), follows=expected)
    begun = ho.read_problem(written(folder, moved(MOVES, NO_DURATION)))
    assert arm(begun).start == 0.0, "where left out"


def test_moves_that_end_first_rest_until_the_others_have_ended(folder: Path) -> None:
    hand = "[bodies.hand]\nparent = 'arm'\n[bodies.hand.motion]\n" + SLIDE + (
        "[[bodies.hand.motion.moves]]\nto = 0.01\nseconds = 1\n[motion]"
    )  # fmt: skip
    problem = ho.read_problem(written(folder, moved(MOVES, NO_DURATION, ("[motion]", hand))))
    told = problem.bodies["hand"].motion.follows
    assert (told.seconds, told.moves[0].dwell) == (4.0, 3.0)
    np.testing.assert_allclose(told.values([0.125, 0.25, 1.0]), [0.005, 0.01, 0.01], atol=1e-15)
    again = ho.read_problem(ho.write_problem(problem, folder / "out" / "again.toml"))
    assert same(again, problem)
    longer = ho.read_problem(written(folder, moved(MOVES, ("duration = 2.0", "duration = 10"))))
    assert longer.duration == arm(longer).follows.seconds == 10.0
    back = ho.read_problem(written(folder, moved(MOVES, ("duration = 2.0", "out_and_back = true"))))
    assert (back.duration, arm(back).follows.seconds) == (8.0, 4.0)


@pytest.mark.parametrize(
    ("text", "values", "unit"),
    [
        (moved('file = "tilt.csv"\nunit = "deg"\n'), np.radians([0, 30, 50, 110]), "deg"),
        (moved('file = "tilt.csv"\n'), [0, 30, 50, 110], "rad"),
        (sliding('file = "tilt.csv"\n'), [0, 30, 50, 110], "m"),
        (sliding('file = "tilt.csv"\nunit = "mm"\n'), [0, 0.03, 0.05, 0.11], "mm"),
    ],
)
def test_tables_are_read_in_their_unit_and_stay_where_they_are(folder: Path, text, values, unit) -> None:
    (folder / "tilt.csv").write_text(ROWS)
    file = written(folder, text.replace("length = 0.42", "length = 142"))
    problem = ho.read_problem(file)
    table = arm(problem).follows
    assert table.times == (0, 1, 2, 3) and table.unit == unit
    np.testing.assert_allclose(table.entries, values, rtol=1e-15)
    assert problem.duration == 2.0, "as given, for playback"
    target = ho.write_problem(problem, folder / "deep" / "b.toml")
    assert sorted(entry.name for entry in target.parent.iterdir()) == ["b.toml"]
    assert same(ho.read_problem(target), problem)
    assert ho.write_problem(ho.read_problem(target), target).read_text() == target.read_text()


def test_a_table_in_no_file_is_written_beside(folder: Path) -> None:
    problem = ho.read_problem(written(folder, CONTRACT))
    table = ho.ValueTable((0.0, 0.3, 1.0), (0.1, 1 / 3, 0.2))
    hinge = ho.Hinge((0, 0, 0.1), (0, 1, 0), follows=table)
    target = ho.write_problem(problem.changed(bodies={"arm": ho.Body(hinge)}), folder / "b.toml")
    again = ho.read_problem(target)
    assert (folder / "b_arm.csv").read_text() == "# s, rad\nt,value\n0.0,0.1\n0.3,0.3333333333333333\n1.0,0.2\n"
    assert arm(again).follows.entries == table.entries
    (folder / "b_arm.csv").write_text("t,value\n0,1\n1,2\n")
    moved_on = ho.read_problem(ho.write_problem(again, folder / "c.toml"))
    assert arm(moved_on).follows.entries == table.entries, "not what the file holds by now"


def test_moves_and_round_numbers_stay_as_typed(folder: Path) -> None:
    problem = ho.read_problem(written(folder, moved("from_deg = 12.3\n" + MOVES, NO_DURATION)))
    motion = tomllib.loads(ho.write_problem(problem, folder / "b.toml").read_text())["bodies"]["arm"]["motion"]
    assert motion["from_deg"] == 12.3
    assert motion["moves"] == [{"to_deg": 110, "seconds": 2, "dwell": 0.5}, {"to_deg": 0, "seconds": 1.5}]


WRONG = [
    (moved("from_deg = 0\nto_deg = 9\n" + MOVES), "bodies.arm.motion.to_deg: found moves as well, expected moves or"),
    (moved('to_deg = 9\nfile = "tilt.csv"\n'), "bodies.arm.motion.to_deg: found file as well, expected file or to_deg"),
    (moved('file = "tilt.csv"\n' + MOVES), "bodies.arm.motion.moves: found file as well, expected file or moves"),
    (moved('unit = "deg"\n' + HINGE), "bodies.arm.motion.unit: found a unit without a file, expected it beside file"),
    (moved('unit = "mm"\nfile = "tilt.csv"\n'), "bodies.arm.motion.unit: found \"mm\", expected one of 'rad', 'deg'"),
    (moved("from_deg = 0\n"), "bodies.arm.motion.to_deg: found nothing, expected a number"),
    (sliding("to = 0.1\n"), "bodies.arm.motion.from: found nothing, expected a number"),
    (moved("moves = []\n"), "bodies.arm.motion.moves: found [], expected at least one table"),
    (moved("moves = 3\n"), "bodies.arm.motion.moves: found 3, expected"),
    (
        moved(MOVES.replace("seconds = 1.5", "seconds = 0")),
        "bodies.arm.motion.moves.1.seconds: found 0, expected a num",
    ),
    (moved(MOVES.replace("seconds = 1.5", "")), "bodies.arm.motion.moves.1.seconds: found nothing, expected a number"),
    (
        moved(MOVES.replace("to_deg = 0", "to_deg = 0\nto = 0")),
        "bodies.arm.motion.moves.1.to: found an unknown key, expected one of",
    ),
    (moved(MOVES.replace("dwell", "dwel")), "bodies.arm.motion.moves.0.dwel: found an unknown key, expected one of"),
    (moved(MOVES), "motion.duration: found 2.0, expected at least 4, the seconds of the moves of arm"),
    (
        moved('file = "tlit.csv"\n'),
        "bodies.arm.motion.file: found \"tlit.csv\", no such file (did you mean 'tilt.csv'?)",
    ),
    (
        moved('file = "../tilt.csv"\n'),
        'bodies.arm.motion.file: found "../tilt.csv", a file outside the problem\'s folder',
    ),
]


@pytest.mark.parametrize(("text", "words"), WRONG)
def test_mistakes_name_their_key(folder: Path, text: str, words: str) -> None:
    (folder / "tilt.csv").write_text(ROWS)
    told = mistakes(written(folder, text))
    assert any(words in line for line in told), told
    assert len(told) == 1


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ("t,x,y\n0,0,0\n1,1,1\n", 'tilt.csv, line 1: found "t,x,y", expected the header t,value'),
        ("0,1\n1,2\n", 'tilt.csv, line 1: found "0,1", expected the header t,value'),
        ("t,value\n0,a\n", 'tilt.csv, line 2: found "a" as value, expected a number'),
        ("t,value\n0,1\n1\n", "tilt.csv, line 3: found 1 values, expected 2 numbers (t,value)"),
        ("t,value\n0,1\n0,2\n", "tilt.csv, line 3: found t = 0 after 0, expected increasing times"),
        ("t,value\n0,1\n", "tilt.csv: found 1 row, expected at least two"),
        ("", "found an empty file")
        if False
        else ("\n", "tilt.csv, line 1: found nothing, expected the header t,value"),
    ],
)
def test_mistakes_in_tables_name_their_line(folder: Path, rows: str, words: str) -> None:
    (folder / "tilt.csv").write_text(rows)
    (told,) = mistakes(written(folder, moved('file = "tilt.csv"\n')))
    assert words in told


@pytest.mark.parametrize(
    ("text", "fits"),
    [
        (CONTRACT, True),
        (moved(MOVES), True),
        (moved('file = "tilt.csv"\nunit = "deg"\n'), True),
        (moved("from_deg = 0\n"), False),
        (moved("to_deg = 1\n" + MOVES), False),
        (moved('from_deg = 1\nfile = "tilt.csv"\n'), False),
        (moved('unit = "deg"\n' + HINGE), False),
    ],
)
def test_editors_are_told_the_same(text: str, fits: bool) -> None:
    valid = jsonschema.Draft202012Validator(schema()).is_valid(tomllib.loads(text))
    assert valid == fits
