"""Files from many hands: where they may lie."""

from __future__ import annotations

import hashlib
import os
import sys
from pathlib import Path

import pytest
import trimesh

from harness_opt.cli.commands import main
from harness_opt.errors import ProblemError
from harness_opt.files.read import read_problem, write_problem
from oracles.flap import FLAP, PLAIN, put
from oracles.problem_files import HINGE, MESH, changed, mistakes, naming, same, written

OUTSIDE = "a file outside the problem's folder"
links = pytest.mark.skipif(sys.platform == "win32", reason="links need rights there")


@pytest.fixture
def inside(folder: Path) -> Path:
    """A folder for a problem file beside that of the mesh, which is outside of it."""
    (folder / "inside").mkdir()
    return folder / "inside"


@pytest.mark.parametrize("name", ["../meshes/housing.stl", "x/../../meshes/housing.stl", "HERE/meshes/housing.stl"])
def test_meshes_outside_are_refused_unless_their_folder_is_given(folder: Path, inside: Path, name: str) -> None:
    (inside / "x").mkdir()
    file = written(inside, naming(name.replace("HERE", folder.as_posix())))
    (line,) = mistakes(file)
    assert line.startswith("parts.housing.mesh: found ") and OUTSIDE in line and "--files" in line
    assert read_problem(file, [folder / "meshes"]).parts["housing"].shape.path.is_file()
    with pytest.raises(ProblemError, match=OUTSIDE):
        read_problem(file, [folder / "mesh"])  # the beginning of a name is no folder


def test_dots_that_lead_back_are_no_matter(folder: Path) -> None:
    problem = read_problem(written(folder, naming("meshes/../meshes/./housing.stl")))
    assert problem.parts["housing"].shape.path.samefile(folder / "meshes" / "housing.stl")


def test_nothing_is_told_of_files_outside(folder: Path, inside: Path) -> None:
    """Whether they are there, empty or folders: a problem file is no way to ask."""
    (folder / "empty.stl").touch()
    names = ("../empty.stl", "../none.stl", "..", "../meshes", "/etc/passwd", "/dev/zero")
    lines = [mistakes(written(inside, naming(name))) for name in names]
    told = {
        line.partition("found ")[2].partition(", ")[2] for found in lines for line in found if "ending in" not in line
    }
    assert len(told) == 1 and OUTSIDE in told.pop()


@links
def test_links_count_where_they_lead(folder: Path, inside: Path) -> None:
    (inside / "link.stl").symlink_to(folder / "meshes" / "housing.stl")
    (inside / "linked").symlink_to(folder / "meshes")
    for name in ("link.stl", "linked/housing.stl"):
        assert OUTSIDE in mistakes(written(inside, naming(name)))[0]
        read_problem(written(inside, naming(name)), [folder / "meshes"])
    # within the folder they are as good as what they lead to, and so is a folder reached by a link
    (folder / "near.stl").symlink_to("meshes/housing.stl")
    read_problem(written(folder, naming("near.stl")))
    (inside / "whole").symlink_to(folder)
    read_problem(inside / "whole" / "lift.toml")


@links
def test_links_in_a_circle(folder: Path) -> None:
    (folder / "a.stl").symlink_to("b.stl")
    (folder / "b.stl").symlink_to("a.stl")
    assert mistakes(written(folder, naming("a.stl")))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
def test_pipes_and_devices_are_no_meshes(folder: Path) -> None:
    os.mkfifo(folder / "pipe.stl")  # reading it would wait for ever
    assert "a device or a pipe" in mistakes(written(folder, naming("pipe.stl")))[0]


@pytest.mark.parametrize("name", [r"\\\\host\\share\\x.stl", "//host/share/x.stl"])
def test_files_on_other_computers_are_not_even_asked_for(folder: Path, name: str) -> None:
    (line,) = mistakes(written(folder, naming(name)))
    assert "on another computer" in line


def test_tables_of_poses_keep_to_the_same_rule(folder: Path, inside: Path) -> None:
    (folder / "arm.csv").write_text("t,x,y,z,qw,qx,qy,qz\n0,0,0,0,1,0,0,0\n1,0,0,0.01,1,0,0,0\n")
    text = changed((HINGE, 'kind = "poses"\nfile = "../arm.csv"\n'), (MESH, "sphere = { radius = 0.01 }"))
    (line,) = mistakes(written(inside, text))
    assert line.startswith("bodies.arm.motion.file: ") and OUTSIDE in line
    read_problem(written(inside, text), [folder])


def test_a_checksum_lets_a_file_in_and_only_that(folder: Path, inside: Path) -> None:
    mesh = folder / "meshes" / "housing.stl"
    digest = hashlib.sha256(mesh.read_bytes()).hexdigest()
    text = changed(("meshes/housing.stl", "../meshes/housing.stl"), ("clearance = 0.006", f'mesh_sha256 = "{digest}"'))
    read_problem(written(inside, text))
    read_problem(written(inside, text.replace(digest, digest.upper())))
    mesh.write_bytes(mesh.read_bytes() + b" ")
    assert "not what it was when this problem was written" in mistakes(written(inside, text))[0]
    read_problem(inside / "lift.toml", [folder])
    assert "64 hexadecimal digits" in mistakes(written(inside, text.replace(digest, "abc")))[0]
    without = changed((MESH, "sphere = { radius = 1 }"), ("clearance = 0.006", f'mesh_sha256 = "{digest}"'))
    assert "found a SHA-256 without a mesh" in mistakes(written(inside, without))[0]


def test_written_problems_run_from_where_they_lie(folder: Path) -> None:
    problem = read_problem(written(folder, changed()))
    file = write_problem(problem, folder / "far" / "away.toml")
    assert same(read_problem(file), problem)
    assert main(["check", str(file)]) == 0
    beside = write_problem(problem, folder / "beside.toml")
    assert "sha256" not in beside.read_text(), "none is needed there"


def test_the_folders_of_the_command_line(folder: Path, inside: Path, capsys) -> None:
    trimesh.creation.box((10, 20, 30)).export(folder / "box.stl")
    text = FLAP.replace("sphere = { radius = 0.02 }", 'mesh = "../box.stl"\nmesh_unit = "mm"')
    file = str(inside / put(text, str(inside / "flap.toml")))
    out = str(inside / "out")
    given = ["--files", str(folder)]
    for command in ("check", "simulate", "redesign"):
        assert main([command, file]) == 2
        assert "--files" in capsys.readouterr().err
    assert main(["check", file, *given]) == 0
    assert main(["simulate", file, *given, *PLAIN, "-o", out]) == 0
    assert main(["export", out, "--to", "csv"]) == 0, "a result carries the parts that it was made with"
    assert main(["redesign", file, *given, *PLAIN, "-o", str(inside / "better")]) == 0
    assert main(["simulate", str(inside / "better" / "redesigned.toml"), *PLAIN, "-o", out]) == 0
