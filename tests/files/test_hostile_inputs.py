"""Files that ask for more than they are: refused in words and in seconds, with nothing told of what lies elsewhere."""

from __future__ import annotations

import hashlib
import os
import pickle
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.cli.commands import main
from harness_opt.errors import ProblemError
from harness_opt.files.read import read_problem
from harness_opt.parts.mesh_headers import Refused
from harness_opt.parts.scene import load_scene
from oracles.flap import FLAP, PLAIN, put

SOON = 10.0  # s, for all of it on a busy machine


def refused(text: str) -> str:
    """Return the one line that a problem is refused with, soon."""
    begin = time.monotonic()
    with pytest.raises(ProblemError) as error:
        read_problem(put(text))
    assert time.monotonic() - begin < SOON
    (line,) = error.value.mistakes
    return line


# --- keys ------------------------------------------------------------------------------------------------

DEEP = 200_000
LONG = {
    "dotted": ".".join("a" * DEEP) + " = 1\n",
    "spaced": " . ".join("a" * DEEP) + " = 1\n",
    "quoted": ".".join(['"a b"'] * DEEP) + " = 1\n",
    "single": ".".join(["'a'"] * DEEP) + " = 1\n",
    "header": "[" + ".".join("a" * DEEP) + "]\n",
    "headers": "[[" + ".".join("a" * DEEP) + "]]\n",
    "inline": "x = {" + ".".join("a" * DEEP) + " = 1}\n",
    "many": "".join("a." * 40 + f"b{k} = 1\n" for k in range(20_000)),
}


@pytest.mark.parametrize("kind", LONG)
def test_long_keys_are_refused_before_they_are_read(here, kind):
    line = refused(LONG[kind] + FLAP)
    assert line == "flap.toml: line 1: found more keys or levels than any problem has, expected at most 32 levels"


@pytest.mark.parametrize("text", ["a" * 3_000_000 + " = 1\n", '"' * 3_000_000, "." * 3_000_000, "a." * 20 + "b = 1\n"])
def test_other_long_lines_take_no_longer(here, text):
    begin = time.monotonic()
    with pytest.raises(ProblemError):
        read_problem(put(text + FLAP))
    assert time.monotonic() - begin < SOON


def test_texts_and_numbers_with_dots_are_no_keys(here):
    title = 'title = "' + "a.b " * 40 + '1.2.3 and so on..."'
    many = "# " + ", ".join(f"{k}.{k}" for k in range(100)) + "\n"
    assert read_problem(put(many + FLAP.replace('title = "A flap"', title))).cables


# --- grids -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("keys", [3, 1])
def test_grids_are_counted_before_they_are_listed(here, capsys, keys):
    put(FLAP)
    count = 1_000_000 if keys == 3 else 1_000_001
    vary = "".join(
        f'"cables.lead.start.position.{x}" = {{ from = 0, to = 1, count = {count} }}\n' for x in "xyz"[:keys]
    )
    put(f'schema = 1\nproblem = "flap.toml"\nmethod = "grid"\n[vary]\n{vary}', "study.toml")
    begin = time.monotonic()
    assert main(["study", "study.toml"]) == 2
    assert time.monotonic() - begin < SOON
    words = f"study.toml: vary: found a grid of {count**keys:,} variants, expected at most 1,000,000\n"
    assert capsys.readouterr().err == words


def test_many_values_of_one_key_are_judged_by_those_that_tell(here):
    from harness_opt.files.quantities import quantities_of
    from harness_opt.studies.variations import Variations, expand

    put(FLAP)
    quantities = quantities_of("flap.toml")
    begin = time.monotonic()
    assert (
        len(expand(quantities, Variations("grid", {"cables.lead.length": np.linspace(0.3, 0.4, 50_000).tolist()})))
        == 50_000
    )
    assert time.monotonic() - begin < SOON
    for wrong in (-1.0, 0.0, float("nan"), "x", True, 1e-200):
        values = [0.3 + 1e-6 * k for k in range(500)]
        values[250] = wrong
        with pytest.raises(ProblemError):
            expand(quantities, Variations("grid", {"cables.lead.length": values}))


# --- what lies elsewhere ---------------------------------------------------------------------------------

MESH = 'mesh = "NAME"\nmesh_unit = "mm"'


@pytest.mark.parametrize("sha256", [None, hashlib.sha256(b"x").hexdigest()])
def test_nothing_is_told_of_files_elsewhere_with_or_without_a_hash(here, sha256):
    (here / "there").mkdir()
    (here / "there" / "kept.stl").write_text("solid")
    (here / "there" / "dark.stl").write_text("solid")
    (here / "there" / "dark.stl").chmod(0)
    (here / "inside").mkdir()
    os.chdir(here / "inside")
    extra = "" if sha256 is None else f'\nmesh_sha256 = "{sha256}"'
    told = set()
    for name in ("kept.stl", "kepd.stl", "none.stl", "dark.stl", "sub/none.stl", "x" * 300 + ".stl"):
        shape = MESH.replace("NAME", f"../there/{name}") + extra
        line = refused(FLAP.replace("sphere = { radius = 0.02 }", shape))
        told.add(line.partition(", ")[2])
    assert len(told) == 1, told
    assert "a file outside the problem's folder" in told.pop()


def test_a_study_is_no_way_to_ask_for_files_elsewhere(here, capsys):
    (here / "inside").mkdir()
    put(FLAP)
    os.chdir(here / "inside")
    told = set()
    for name in ("../flap.toml", "../none.toml", "/etc/passwd", "/etc/none", ".."):
        put(f'schema = 1\nproblem = "{name}"\nmethod = "grid"\n[vary]\n"cables.lead.length" = [0.3]\n', "study.toml")
        assert main(["study", "study.toml"]) == 2
        told.add(capsys.readouterr().err.partition(", ")[2])
    assert len(told) == 1, told
    put('schema = 1\nproblem = "../flap.toml"\nmethod = "grid"\n[vary]\n"cables.lead.length" = [0.3]\n', "study.toml")
    assert main(["study", "study.toml", "--files", str(here), "--workers", "1", "-q"]) == 0


# --- times -----------------------------------------------------------------------------------------------

POSES = FLAP.replace(
    'kind = "hinge"\npoint = [0.2, 0, 0]\naxis = [0, 1, 0]\nfrom_deg = 0\nto_deg = 20',
    'kind = "poses"\nfile = "p.csv"',
)  # fmt: skip


@pytest.mark.parametrize("step", ["5e-324", "1e-200", "1e-10"])
def test_times_that_underflow_are_refused(here, step):
    rows = "".join(f"{k * float(step)!r},{0.002 * k},0,0,1,0,0,0\n" for k in range(3))
    Path("p.csv").write_text(f"t,x,y,z,qw,qx,qy,qz\n{rows}")
    with pytest.raises(ProblemError) as error:
        read_problem(put(POSES))
    assert all("expected at least 1e-09 s between them" in line for line in error.value.mistakes)
    with pytest.raises(ProblemError, match="times: expected at least 1e-09 s between two"):
        ho.Poses((0.0, float(step)), ((0, 0, 0), (0, 0, 0.01)), ((1, 0, 0, 0), (1, 0, 0, 0)))


# --- names -----------------------------------------------------------------------------------------------


@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="file names are text there")
def test_names_of_files_that_are_no_text(here, capsys):
    odd = os.fsdecode(b"caf\xe9")
    put(FLAP, f"{odd}.toml")
    for command in (
        ["check"],
        ["simulate"],
        ["redesign", *PLAIN],
        ["sensitivity"],
        ["simulate", "--json", "-q", *PLAIN],
    ):
        assert main([command[0], f"{odd}.toml", *command[1:]]) == 0, command
    assert main(["export", f"results/{odd}", "--to", "csv"]) == 0
    assert main(["new", f"{odd}2"]) == 0
    assert main(["check", f"{odd}2.toml"]) == 0
    assert main(["check", os.fsdecode(b"no\xe9.toml")]) == 2
    put('schema = 1\nproblem = "f.toml"\nmethod = "grid"\n[vary]\n"cables.lead.length" = [0.3]\n', f"{odd}3.toml")
    put(FLAP, "f.toml")
    assert main(["study", f"{odd}3.toml", "--workers", "1"]) == 0
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="file names are text there")
def test_a_problem_file_cannot_name_a_file_that_is_no_text(here):
    problem = read_problem(put(FLAP))
    part = ho.Part(ho.MeshFile(here / os.fsdecode(b"caf\xe9.stl"), "mm"))
    with pytest.raises(ProblemError, match="is no UTF-8, near"):
        ho.write_problem(ho.Problem(problem.cables, problem.bodies, {"ball": part}), here / "out.toml")


# --- other machines --------------------------------------------------------------------------------------


def test_without_coal_meshes_are_refused_and_nothing_else(here, monkeypatch):
    find = __import__("importlib").util.find_spec
    monkeypatch.setattr("importlib.util.find_spec", lambda name, *rest: None if name == "coal" else find(name, *rest))
    assert load_scene(read_problem(put(FLAP))).parts
    import trimesh

    trimesh.creation.box((20, 20, 20)).export("m.stl")
    problem = read_problem(put(FLAP.replace("sphere = { radius = 0.02 }", MESH.replace("NAME", "m.stl"))))
    with pytest.raises(ProblemError, match=r"^parts\.ball\.mesh: found no coal"):
        load_scene(problem)


@pytest.mark.parametrize(
    "error",
    [
        ho.HarnessError("a"),
        ho.ProblemError(["a: found 1", "b: found 2"]),
        ho.SolveError("a", ho.Status.STALLED, partial=(1, 2)),
        ho.CompilerError("a"),
        Refused("a", "b"),
    ],
    ids=lambda error: type(error).__name__,
)
def test_errors_travel_between_processes(error):
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error) and str(again) == str(error) and vars(again) == vars(error)
