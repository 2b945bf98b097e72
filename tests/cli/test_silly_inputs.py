"""Whatever is put in the place of what is expected: exit code 2, one clear message that names it, nothing written."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from harness_opt.cli.commands import main
from oracles.flap import FLAP

MESHED = FLAP.replace("sphere = { radius = 0.02 }", 'mesh = "NAME"\nmesh_unit = "mm"')
STUDY = 'schema = 1\nproblem = "flap.toml"\nmethod = "grid"\n[vary]\n"cables.lead.length" = [0.3, 0.4]\n'
HINGE = FLAP[FLAP.index('kind = "hinge"') : FLAP.index("[motion]\nspatial_step")]
FILES: dict[str, str | bytes] = {
    "flap.toml": FLAP,
    "empty.toml": b"",
    "binary.toml": bytes(range(256)),
    "utf16.toml": FLAP.encode("utf-16"),
    "json.toml": '{"schema": 1}',
    "folder.toml/x": "",
    "study.toml": STUDY,
    "text.toml": FLAP.replace("length = 0.3", 'length = "0.3"'),
    "nan.toml": FLAP.replace("length = 0.3", "length = nan"),
    "digits.toml": FLAP.replace("length = 0.3", f"length = {'9' * 5000}"),
    "date.toml": FLAP.replace("length = 0.3", "length = 2020-01-01"),
    "list.toml": "schema = 1\ncables = [1, 2]\n",
    "twice.toml": f"{FLAP}\n[limits]\n",
    "long.toml": FLAP.replace("lead", "x" * 300),
    "steps.toml": FLAP.replace("spatial_step = 0.01", "spatial_step = 1e-12"),
    "itself.toml": FLAP.replace("diameter = 0.005\n", 'from = "itself.toml#cables"\n'),
    "few.stl": "hello",
    "few.toml": MESHED.replace("NAME", "few.stl"),
    "noise.stl": bytes(range(256)) * 8,
    "noise.toml": MESHED.replace("NAME", "noise.stl"),
    "a.csv": "a,b\n1,2\n",
    "poses.toml": FLAP.replace(HINGE, 'kind = "poses"\nfile = "a.csv"\n\n'),
    "a file": "mine",
    "others/note.txt": "mine",
}
SILLY = [
    ("check none.toml", "none.toml: found no such file"),
    ("check folder.toml", "folder.toml: found a folder, expected a problem file"),
    ("check empty.toml", "empty.toml: found an empty file, expected a problem file"),
    ("check binary.toml", "binary.toml: line 2: found bytes that are not UTF-8, expected a TOML text"),
    ("check utf16.toml", "utf16.toml: line 1: found bytes that are not UTF-8, expected a TOML text"),
    ("check json.toml", "json.toml: line 1, column 1: found "),
    ("check text.toml", 'text.toml: cables.lead.length: found "0.3", expected a number above 0'),
    ("check nan.toml", "nan.toml: cables.lead.length: found nan, expected a number above 0"),
    ("check digits.toml", "digits.toml: found a value that can't be read, expected TOML: exceeds the limit"),
    ("check date.toml", "date.toml: cables.lead.length: found 2020-01-01, expected a number above 0"),
    ("check list.toml", "list.toml: cables: found [1, 2], expected a table"),
    ("check twice.toml", "twice.toml: line 35, column 8: found "),
    ("check long.toml", "found a longer name, expected 100 letters at most"),
    ("simulate steps.toml", "steps.toml: motion.spatial_step: found 1e-12 m, which asks for "),
    ("check itself.toml", "itself.toml: cables.lead.from: found "),
    ("check few.toml", "few.toml: parts.ball.mesh: found 5 bytes, too few for an STL file"),
    ("check noise.toml", "noise.toml: parts.ball.mesh: found a file cut short: "),
    ("check poses.toml", "poses.toml: bodies.flap.motion.file: a.csv, line 1: found "),
    ("simulate study.toml", "study.toml: found a study, expected a problem file; a study is run by: harness-opt study"),
    ("study flap.toml", "flap.toml: found a problem file, expected a study; a problem is run by: harness-opt simulate"),
    ("simulate flap.toml -o A", "a file: found a file, expected a folder"),
    ("simulate flap.toml -o others", "others: found files that are no result of harness-opt (note.txt)"),
    ("simulate flap.toml -o .", ".: found the folder you work in"),
    ("simulate flap.toml --files none", "'--files': Directory 'none' does not exist"),
    ("preview flap.toml -o flap.toml", "flap.toml: found no name of a page, expected one that ends in .html"),
    ("new flap", "flap.toml: found a file of that name, expected a new one"),
    ("new E", "found no name of a file, expected one such as my_cable"),
    ("show A", "a file: found no result of harness-opt, expected a folder with summary.json"),
    ("export others --to csv", "others: found no result of harness-opt, expected a folder with summary.json"),
    ("sensitivity empty.toml", "empty.toml: found an empty file, expected a problem file or a study file"),
    ("redesign flap.toml --pareto a,b", "--pareto: found 'a,b', expected two of length, change"),
]


@pytest.fixture
def filled(here: Path) -> Path:
    for name, content in FILES.items():
        file = here / name
        file.parent.mkdir(exist_ok=True)
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
    return here


@pytest.mark.parametrize(("line", "words"), SILLY, ids=[line for line, _ in SILLY])
def test_one_message_that_names_it(filled, capsys, line, words):
    before = {file: file.stat().st_mtime_ns for file in filled.rglob("*")}
    arguments = ["a file" if word == "A" else "" if word == "E" else word for word in line.split()]
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    told = [said for said in err.splitlines() if not said.startswith("Usage: ")]
    assert out == "" and len(told) == 1, err
    assert words in told[0]
    assert {file: file.stat().st_mtime_ns for file in filled.rglob("*")} == before


def test_results_are_exported_into_folders(filled, capsys):
    assert main(["simulate", "flap.toml", "-q", "-o", "R"]) == 0
    assert main(["export", "R", "--to", "csv", "-o", "a file"]) == 2
    assert capsys.readouterr().err == "a file: found a file, expected a folder to write in\n"
    assert Path("a file").read_text() == "mine"


def test_names_of_any_language_are_taken(here, capsys):
    Path("Kabel ä 日本.toml").write_text(
        FLAP.replace("cables.lead", 'cables."käbel 日本"').replace("lead.", "käbel 日本.")
    )
    assert main(["simulate", "Kabel ä 日本.toml", "-q"]) == 0
    assert os.path.isfile("results/Kabel ä 日本/report.html")
    capsys.readouterr()
    assert main(["check", "Kabel ä 日本.toml"]) == 0
    assert "käbel 日本" in capsys.readouterr().out
