"""Files from many hands: how large they may be, and how much they may say."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from harness_opt.cli.commands import main
from harness_opt.errors import ProblemError
from harness_opt.files import places as file_places
from harness_opt.files import read as problem_file
from harness_opt.files.read import read_problem
from harness_opt.model.checks import dotted
from harness_opt.parts.scene import load_scene
from oracles.flap import FLAP, put
from oracles.problem_files import HINGE, MESH, changed, mistakes, naming, written


def test_large_files_are_refused_before_they_are_read(folder: Path, monkeypatch) -> None:
    file = written(folder, changed())
    huge = folder / "meshes" / "housing.stl"
    with huge.open("wb") as stream:
        stream.truncate(file_places.MOST_MESH_BYTES + 1)  # a hole: nothing is written
    assert "a file of 600 MB, of which at most 600 are read" in mistakes(file)[0]
    with file.open("wb") as stream:
        stream.truncate(problem_file.MOST_BYTES + 1)
    assert "a file of 4 MB, of which at most 4 are read" in mistakes(file)[0]


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="no endless file")
def test_an_endless_problem_file() -> None:
    assert mistakes(Path("/dev/zero")) == ["found more than 4 MB, expected a problem file"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x." * 3000 + "y = 1", "more keys or levels"),
        ("[" + "x." * 3000 + "y]", "more keys or levels"),
        ("\n".join(f"k{i} = 1" for i in range(problem_file.MOST_KEYS + 1)), "more keys or levels"),
        ("schema = 1\n" + "\n".join(f"[cables.c{i}]" for i in range(101)), "cables: found 101, expected at most 100"),
        ("schema = 1\n" + "\n".join(f"[parts.c{i}]" for i in range(1001)), "parts: found 1,001, expected at most"),
    ],
)
def test_more_than_anybody_types(folder: Path, text: str, words: str) -> None:
    (line,) = mistakes(written(folder, text))
    assert words in line


def test_thousands_of_mistakes_are_counted(folder: Path) -> None:
    lines = mistakes(written(folder, "schema = 1\n" + "\n".join(f"k{i} = 1" for i in range(1000))))
    assert len(lines) == problem_file.MOST_MISTAKES + 1
    assert lines[-1] == "found 801 more mistakes, expected none"  # the keys, and that there is no cable


def test_triangles_of_all_parts_together(folder: Path, monkeypatch) -> None:
    monkeypatch.setattr("harness_opt.parts.scene.MOST_FACES", 20)
    text = changed() + "\n[parts.second]\n" + MESH
    with pytest.raises(ProblemError, match="parts: found 24 triangles up to second, expected at most 20 in all"):
        load_scene(read_problem(written(folder, text)))


def test_packed_meshes_are_not_unpacked(folder: Path) -> None:
    for name in ("bomb.stl.gz", "bomb.zip", "bomb.3mf", "bomb.stl.bz2"):
        (folder / name).write_bytes(b"PK")
        (line,) = mistakes(written(folder, naming(name)))
        assert "expected a file ending in" in line or "not read: export STL or GLB" in line


def test_what_a_file_holds_does_not_steer_the_terminal(here: Path, capsys) -> None:
    title = 'title = "clear \\u001b[2J bell \\u0007 c1 \\u009b31m turned \\u202e"'
    assert main(["check", put(FLAP.replace('title = "A flap"', title))]) == 0
    out = capsys.readouterr().out
    assert "clear ?[2J bell ? c1 ?31m turned ?" in out
    assert main(["check", put(FLAP.replace("[parts.ball]", '[parts."a\\u009bb"]'))]) == 2
    assert "\x9b" not in capsys.readouterr().err


def test_long_names(folder: Path) -> None:
    (line,) = mistakes(written(folder, changed(("[parts.housing]", f"[parts.{'x' * 200}]"))))
    assert line == f"parts.{'x' * 100}: found a longer name, expected 100 letters at most"


def test_long_tables_of_poses(folder: Path) -> None:
    (folder / "arm.csv").write_text("t,x,y,z,qw,qx,qy,qz\n" * 100_001)
    (line,) = mistakes(written(folder, changed((HINGE, 'kind = "poses"\nfile = "arm.csv"\n'))))
    assert "arm.csv: found 100,001 lines, expected at most 100,000" in line


def test_keys_in_messages_are_quoted() -> None:
    assert dotted(("parts", 'a"b\n')) == 'parts."a\\"b\\n"'


@pytest.mark.parametrize("text", ["x." * 3000 + "y = 1", "[vary]\n" + "x." * 3000 + "y = 1", "k = {" * 500])
@pytest.mark.parametrize("command", ["study", "sensitivity"])
def test_study_files_are_no_deeper_than_problem_files(here: Path, capsys, command: str, text: str) -> None:
    Path("study.toml").write_text(text)
    assert main([command, "study.toml"]) == 2
    assert capsys.readouterr().err.startswith("study.toml: ")
    assert os.listdir() == ["study.toml"]
