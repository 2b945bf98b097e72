"""Words that results use are explained in a terminal; files that an engineer meets first are refused in clear words."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
import trimesh

from harness_opt.cli.commands import main
from harness_opt.cli.explain import explained, names
from harness_opt.cli.run import remedied
from harness_opt.errors import HarnessError
from harness_opt.model.limits import LimitKind
from oracles.flap import FLAP, put
from oracles.problems import ROOT

MESH = FLAP.replace("sphere = { radius = 0.02 }", 'mesh = "NAME"\nmesh_unit = "mm"')
CORNERS = "   vertex 0 0 0\n   vertex 1 0 0\n   vertex 0 1 0\n"
TEXT = f"solid a\n facet normal 0 0 1\n  outer loop\n{CORNERS}  endloop\n endfacet\n"


@pytest.mark.parametrize("word", [*(kind.words for kind in LimitKind), "snap", "uncertain", "margin", "certified"])
def test_the_words_of_tables_are_explained(capsys, word):
    assert main(["explain", *word.split()]) == 0
    out = capsys.readouterr().out
    assert word in out and len(out) > len(word) + 30
    assert max(map(len, out.splitlines())) <= 80 and "](" not in out


def test_spellings_do_not_matter_and_pages_exist():
    assert explained("Bend_Radius") == explained("bend radius") == explained("bend radii".replace("radii", "radius"))
    assert explained("snaps") == explained("snap")
    pages = {line.partition("docs/")[2] for name in names() for line in explained(name).splitlines() if "docs/" in line}
    assert pages and all((ROOT / "docs" / page.partition("#")[0]).is_file() for page in pages)


def test_unknown_words_are_refused_with_what_comes_nearest(capsys):
    assert main(["explain", "cleerance"]) == 2
    assert "did you mean 'clearance'" in capsys.readouterr().err
    assert main(["explain"]) == 0
    assert set(capsys.readouterr().out.splitlines()) == set(names())


@pytest.mark.slow
def test_a_wheel_has_the_words(tmp_path):
    pytest.importorskip("build", reason="build is not installed")
    subprocess.run([sys.executable, "-m", "build", "-w", "-n", "-o", tmp_path, ROOT], check=True, capture_output=True)
    with zipfile.ZipFile(next(tmp_path.glob("*.whl"))) as wheel:
        assert "harness_opt/cli/glossary.md" in wheel.namelist()


def told(capsys, name: str) -> str:
    assert main(["check", put(MESH.replace("NAME", name))]) == 2
    return capsys.readouterr().err


def test_a_comma_in_an_stl(here, capsys):
    Path("a.stl").write_text(TEXT.replace("vertex 1 0 0", "vertex 1,5 0 0") + "endsolid a\n")
    assert "found a comma in line 5, 'vertex 1,5 0 0', expected decimal points" in told(capsys, "a.stl")


def test_an_stl_cut_short(here, capsys):
    Path("a.stl").write_text(TEXT)
    assert "found a file cut short: its last solid has no end (endsolid)" in told(capsys, "a.stl")
    trimesh.creation.box((10, 20, 30)).export("b.stl")
    Path("b.stl").write_bytes(Path("b.stl").read_bytes()[:400])
    assert "found a file cut short: 400 of the 684 bytes that 12 triangles take" in told(capsys, "b.stl")


@pytest.mark.parametrize("name", ["a.stp", "a.STEP", "a.sldprt"])
def test_cad_files_that_are_not_read(here, capsys, name):
    Path(name).write_text("ISO-10303-21;")
    assert f'found "{name}", a kind of CAD file that is not read: export STL or GLB' in told(capsys, name)


def test_the_extra_that_is_missing_is_the_one_that_is_named():
    error = HarnessError('found no manifold3d, expected the extra "harness-opt[meshes]"')
    error.__cause__ = ImportError("manifold3d")
    assert remedied(error).endswith('try pip install "harness-opt[meshes]"')
    assert remedied(ImportError("No module named 'pyvista'")).endswith('try pip install "harness-opt[pictures]"')
