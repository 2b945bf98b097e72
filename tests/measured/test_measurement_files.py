"""Files of measurements: read, refused in words, and what the command writes and prints."""

from __future__ import annotations

import json
import math

import pytest

import harness_opt as ho
from harness_opt.cli.commands import main
from harness_opt.measured.measurements_file import WiresTable, construction_band
from oracles.clipped import arm
from oracles.measured import LOOPS, photographed


@pytest.fixture
def file(tmp_path, monkeypatch):
    """Return a file of measurements of one photographed loop, beside it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "white0.csv").write_bytes((LOOPS / "white0.csv").read_bytes())
    text = photographed("white")
    first = text.index("[[measurements]]", text.index("white0.csv"))
    (tmp_path / "white.toml").write_text(text[:first], encoding="utf-8")
    return tmp_path / "white.toml"


WRONG = [
    ('unit = "m"', 'unit = "mm"', "measurements.0.file: found a way of 0.0014"),
    ("length = 1.5", "length = 0.5", "measurements.0.file: found a way of 1.4"),
    ("length = 1.5\n", "", "measurements.0.length: found nothing, here or in cable, expected a number above 0"),
    ('file = "white0.csv"', 'file = "white9.csv"', 'measurements.0.file: found "white9.csv", no such file'),
    ('file = "white0.csv"', 'file = "../x.csv"', "a file outside the problem's folder"),
    ('unit = "m"', "", "measurements.0.unit: found nothing, expected a unit, or a scale"),
    ('unit = "m"', 'unit = "m"\nscale = 2.0', "measurements.0.unit: found scale as well, expected a unit, or a scale"),
    ('kind = "loop"', 'kind = "sag"', "measurements.0.file: found an unknown key, expected one of"),
    ('find = ["bending_stiffness"]', 'find = ["stiffness"]', 'find: found "stiffness", expected one of'),
    ('find = ["bending_stiffness"]', 'find = ["bending_stiffness", "bending_stiffness"]', "expected each name once"),
    ("[end]\ntangent = [1, 0, 0]\n", "", "measurements.0.end: found nothing, here or for all, expected what holds"),
    ("diameter = 3e-3", "diameter = -3", "cable.diameter: found -3, expected a number above 0"),
    ("mass_per_length", "density = 900\nmass_per_length", "cable.density: found mass_per_length as well"),
]


@pytest.mark.parametrize(("given", "typed", "words"), WRONG, ids=[words[:45] for *_, words in WRONG])
def test_mistakes_are_named_by_their_keys(file, given, typed, words):
    text = file.read_text(encoding="utf-8")
    assert given in text
    file.write_text(text.replace(given, typed, 1), encoding="utf-8")
    with pytest.raises(ho.ProblemError) as caught:
        ho.read_measurements(file)
    assert any(words in line for line in caught.value.mistakes), caught.value.mistakes


def rewritten(file, change) -> None:
    table = file.parent / "white0.csv"
    lines = table.read_text(encoding="utf-8").splitlines()
    table.write_text("\n".join(change(lines)) + "\n", encoding="utf-8")


TABLES = [
    (lambda lines: [lines[0], *lines[1::2], *lines[2::2]], "the points in their order along it"),
    (lambda lines: [lines[0], *(row for two in zip(lines[1:26], lines[26:51], strict=True) for row in two)], "order"),
    (lambda lines: ["a,b", *lines[1:]], 'found the header "a,b", expected x,z or x,y,z'),
    (lambda lines: [*lines[:3], "1,2,3", *lines[3:]], 'line 4: found "1,2,3", expected 2 numbers'),
    (lambda lines: [*lines[:3], "1,nan", *lines[3:]], "found what is not finite, expected numbers"),
    (lambda lines: lines[:3], "found 2 points, expected at least 5"),
    (lambda _: [], "expected x,z or x,y,z"),
]


@pytest.mark.parametrize(("change", "words"), TABLES, ids=[words[:40] for _, words in TABLES])
def test_mistakes_in_tables(file, change, words):
    rewritten(file, change)
    with pytest.raises(ho.ProblemError) as caught:
        ho.read_measurements(file)
    assert words in str(caught.value), caught.value.mistakes


def test_arc_lengths_have_to_grow(file):
    rewritten(file, lambda lines: ["s,x,z", *(f"{1.4 - 0.01 * k},{line}" for k, line in enumerate(lines[1:]))])
    with pytest.raises(ho.ProblemError, match=r"found arc lengths that do not grow from 0 to 1\.5 m"):
        ho.read_measurements(file)


def test_the_command_prints_and_writes(file, capsys):
    assert main(["identify", str(file)]) == 0
    printed = capsys.readouterr().out
    assert "bending_stiffness" in printed and "0.2" in printed
    folder = file.parent / "results" / "white_identified"
    found = json.loads((folder / "identified.json").read_text(encoding="utf-8"))
    value = found["estimates"]["bending_stiffness"]["value"]
    assert found["known"] and 7e-5 < value < 1e-4
    assert "<polyline" in (folder / "shapes.svg").read_text(encoding="utf-8")
    # the written table is one of a library that a problem can take its cable from
    library = folder / "cable.toml"
    (file.parent / "lead.toml").write_text(
        f"""schema = 1
[cables.lead]
from = "{library.relative_to(file.parent)}#white"
length = 0.3
start = {{ position = [0, 0, 0], tangent = [0, 0, 1] }}
end = {{ position = [0.1, 0, 0.2], tangent = [1, 0, 0] }}
""",
        encoding="utf-8",
    )
    assert ho.read_problem(file.parent / "lead.toml").cables["lead"].cable.bending_stiffness == value


def test_what_is_not_known_is_exit_code_1(file, capsys):
    text = file.read_text(encoding="utf-8")
    file.write_text(
        text.replace('["bending_stiffness"]', '["bending_stiffness", "torsional_stiffness"]'), encoding="utf-8"
    )
    assert main(["identify", str(file), "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert not found["known"] and not found["estimates"]["torsional_stiffness"]["known"]
    assert "twist at which a loop leaves its plane" in found["advice"]


@pytest.mark.parametrize("name", ["absent.toml", "white0.csv"])
def test_files_that_are_none(file, name, capsys):
    assert main(["identify", name]) == 2
    assert name in capsys.readouterr().err


def test_one_file_is_not_taken_for_another(file, tmp_path, capsys):
    with pytest.raises(ho.ProblemError, match="found measurements, expected a problem file"):
        ho.read_problem(file)
    problem = ho.write_problem(arm(), tmp_path / "arm.toml")
    assert main(["identify", str(problem)]) == 2
    assert "found a problem file, expected measurements" in capsys.readouterr().err


def test_the_schema_can_be_had(capsys):
    assert main(["schema", "--measurements"]) == 0
    assert json.loads(capsys.readouterr().out)["title"] == "Measurements of a cable for harness-opt"


def test_bounds_by_construction_are_those_of_seven_wires():
    """One wire in the middle and six round it: by hand, with the parallel axes of each."""
    d, e = 0.4e-3, 1.1e11
    wires = [
        WiresTable(diameter=d, modulus=e),
        WiresTable(count=6, diameter=d, ring_diameter=2 * d, modulus=e),
    ]
    own, area = math.pi * d**4 / 64, math.pi * d**2 / 4
    apart = sum((d * math.sin(math.radians(60 * k))) ** 2 for k in range(6))
    slipping, sticking = construction_band(wires)
    assert slipping == pytest.approx(e * 7 * own)
    assert sticking == pytest.approx(e * (7 * own + area * apart))


def test_the_band_is_told(file, capsys):
    text = file.read_text(encoding="utf-8")
    wires = "\n[[cable.wires]]\ncount = 7\ndiameter = 0.3e-3\nring_diameter = 0.6e-3\nmodulus = 1.1e11\n[start]\n"
    file.write_text(text.replace("\n[start]\n", wires, 1), encoding="utf-8")
    assert main(["identify", str(file)]) == 0
    assert "By its construction between 0.000306 N m2, all wires slipping" in capsys.readouterr().out
