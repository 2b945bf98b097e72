"""Problem files: what is read from them, their tables of poses, and the schema that editors are given."""

from __future__ import annotations

import hashlib
import math
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from harness_opt.files.read import read_problem, schema, write_problem
from harness_opt.model.bodies import Hinge, Slide
from harness_opt.model.cable import Cable
from harness_opt.model.design import Limits, Variable
from harness_opt.model.ends import End
from harness_opt.model.parts import Box, Capsule, Cylinder, MeshFile, Part, Sphere
from harness_opt.model.problem import Problem
from harness_opt.numerics import rotations
from oracles.problem_files import (
    CONTRACT,
    HEADER,
    HINGE,
    MESH,
    MINIMAL,
    ROWS,
    changed,
    mistakes,
    poses_of,
    with_poses,
    written,
)

# --- what is read --------------------------------------------------------------------------------------


def test_contract_example(folder: Path) -> None:
    file = written(folder, CONTRACT)
    problem = read_problem(file)
    lead = problem.cables["lead"]
    assert problem.title == "Lift arm, original design"
    assert problem.gravity == (0.0, 0.0, -9.81)
    assert lead.cable.mass_per_length == pytest.approx(5571 * math.pi * 3.1e-3**2)
    assert lead.start == End(position=(0, 0.055, 0.12), tangent=(0, 0, 1), roll_deg=0)
    assert lead.end.body == "arm"
    assert problem.bodies["arm"].motion == Hinge((0, 0, 0.1), (0, 1, 0), 0.0, math.radians(110))
    assert problem.parts["housing"].shape == MeshFile(folder.resolve() / "meshes" / "housing.stl", "mm")
    assert problem.clearance_limit("housing") == 0.006
    assert problem.limits == Limits(0.004, 0.031, math.radians(360), 20.0, 0.5)
    assert problem.design.variables[0] == Variable("lead.length", 0.4, 0.6)
    assert (problem.duration, problem.spatial_step) == (2.0, 0.004)
    assert problem.file == file.resolve()
    assert problem.sha256 == hashlib.sha256(file.read_bytes()).hexdigest()


def test_minimal_file_takes_the_defaults(folder: Path) -> None:
    problem = read_problem(written(folder, MINIMAL))
    lead = problem.cables["lead"]
    assert lead.cable == Cable(1.0, 0.01, (2.0, 3.0), 1.0)
    assert lead.end == End(force=(0, 0, -1), moment=(0, 1, 0))
    # d1 is y where the tangent lies along x; a quarter turn about x takes it to z
    assert lead.start.frame is not None
    np.testing.assert_allclose(rotations.matrix(lead.start.frame)[:, 0], [0, 0, 1], atol=1e-15)
    np.testing.assert_allclose(rotations.tangent(lead.start.frame), [1, 0, 0], atol=1e-15)
    rest = problem.changed(cables={}, file=None, sha256=None)
    assert rest == Problem(cables=problem.cables).changed(cables={})


@pytest.mark.parametrize(
    ("old", "new", "shape"),
    [
        (MESH, "box = { size = [1, 2, 3] }", Box((1.0, 2.0, 3.0))),
        (MESH, "sphere = { radius = 1 }", Sphere(1.0)),
        (MESH, "cylinder = { radius = 1, length = 2 }", Cylinder(1.0, 2.0)),
        (MESH, "capsule = { radius = 1, length = 2 }", Capsule(1.0, 2.0)),
    ],
)
def test_primitives(folder: Path, old: str, new: str, shape: object) -> None:
    part = read_problem(written(folder, changed((old, f"{new}\nposition = [1, 0, 0]")))).parts["housing"]
    assert part == Part(shape, "world", (1.0, 0.0, 0.0), clearance=0.006)  # type: ignore[arg-type]


@pytest.mark.parametrize("suffix", ["glb", "gltf", "GLB"])
def test_gltf_needs_no_unit(folder: Path, suffix: str) -> None:
    (folder / f"a.{suffix}").write_bytes(b"glTF")
    part = read_problem(written(folder, changed((MESH, f'mesh = "a.{suffix}"')))).parts["housing"]
    assert part.shape == MeshFile(folder.resolve() / f"a.{suffix}", None)


def test_slide(folder: Path) -> None:
    slide = 'kind = "slide"\ndirection = [0, 0, 2]\nfrom = 0\nto = 0.2\n'
    problem = read_problem(written(folder, changed((HINGE, slide))))
    assert problem.bodies["arm"].motion == Slide((0, 0, 2), 0.0, 0.2)


def test_rounded_quaternion_is_normalised(folder: Path) -> None:
    text = changed(("quaternion = [1, 0, 0, 0]", "quaternion = [0.707, 0, 0.707, 0]"))
    quaternion = read_problem(written(folder, text)).cables["lead"].end.quaternion
    assert quaternion == pytest.approx((math.sqrt(0.5), 0, math.sqrt(0.5), 0), abs=1e-15)


def test_byte_order_mark_and_windows_lines_pass(folder: Path) -> None:
    marked = read_problem(written(folder, b"\xef\xbb\xbf" + CONTRACT.replace("\n", "\r\n").encode()))
    assert marked.cables == read_problem(written(folder, CONTRACT)).cables


def test_design_value_outside_its_bounds_passes(folder: Path) -> None:
    problem = read_problem(written(folder, changed(("[0.40, 0.60]", "[0.50, 0.60]"))))
    assert problem.cables["lead"].cable.length < problem.design.variables[0].lower


def test_cable_as_long_as_its_clamps_are_apart_passes(folder: Path) -> None:
    straight = "end = { position = [0.6, 0, 0.8], quaternion = [1, 0, 0, 0] }"
    run = read_problem(written(folder, re.sub("end = .*", straight, MINIMAL))).cables["lead"]
    assert math.dist(run.start.position, run.end.position) == pytest.approx(run.cable.length, rel=1e-12)


# --- tables of poses -----------------------------------------------------------------------------------


def test_poses(folder: Path) -> None:
    table = "# recorded\n\n" + HEADER + "\n".join(f"{row}  # fine" for row in ROWS) + "\n\n"
    poses = poses_of(read_problem(with_poses(folder, table)))
    assert poses.times == (0.0, 1.0, 2.0, 3.0)
    assert poses.positions[3] == (0.0, 0.0, 0.03)
    assert poses.quaternions[2] == pytest.approx((math.sqrt(0.5), math.sqrt(0.5), 0, 0), abs=1e-15)
    assert poses.quaternions[3] == (0.0, 1.0, 0.0, 0.0), "the sign follows the row before"
    assert poses.file == folder.resolve() / "arm.csv"


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (["0,0,0,0,1,0,0", *ROWS[1:]], "arm.csv, line 2: found 7 values, expected 8 numbers"),
        (["0,0,0,a,1,0,0,0", *ROWS[1:]], 'arm.csv, line 2: found "a" as z, expected a number'),
        (["0,0,0,,1,0,0,0", *ROWS[1:]], 'arm.csv, line 2: found "" as z, expected a number'),
        (["0,0,0,nan,1,0,0,0", *ROWS[1:]], "arm.csv, line 2: found nan as z, expected a finite number"),
        ([ROWS[0], "1,0,0,0,inf,0,0,0", *ROWS[2:]], "arm.csv, line 3: found inf as qw, expected a finite number"),
        ([ROWS[0], ROWS[0], *ROWS[2:]], "arm.csv, line 3: found t = 0 after 0, expected increasing times"),
        ([*ROWS, "90,0,0,0,1,0,0,0"], "arm.csv, line 6: found a gap from t = 3 to 90, expected no interval above 10"),
        ([*ROWS, "4,0,0,0,1,0.1,0,0"], "arm.csv, line 6: found a quaternion of length 1.00499, expected 1 to within"),
        (ROWS[:1], "arm.csv: found 1 row, expected at least two"),
        ([], "arm.csv: found 0 rows, expected at least two"),
    ],
)
def test_wrong_poses(folder: Path, rows: list[str], words: str) -> None:
    (line,) = mistakes(with_poses(folder, HEADER + "\n".join(rows)))
    assert line.startswith(f"bodies.arm.motion.file: {words}")


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("\n".join(ROWS), 'line 1: found "0,0,0,0,1,0,0,0", expected the header t,x,y,z,qw,qx,qy,qz'),
        (HEADER.replace(",", ";"), 'line 1: found "t;x;y;z;qw;qx;qy;qz", expected the header'),
        ("# nothing\n", "line 1: found nothing, expected the header"),
        (b"t,x\n\xff\n", "line 2: found bytes that are not UTF-8, expected text"),
    ],
)
def test_poses_without_header(folder: Path, table: str | bytes, words: str) -> None:
    (line,) = mistakes(with_poses(folder, table))
    assert line.startswith(f"bodies.arm.motion.file: arm.csv, {words}")


def test_poses_file_is_missing(folder: Path) -> None:
    file = with_poses(folder, HEADER)
    (folder / "arm.csv").unlink()
    (line,) = mistakes(file)
    assert line.startswith(
        'bodies.arm.motion.file: found "arm.csv", no such file, expected a table of poses (paths start at'
    )


def test_wrong_poses_name_every_line_but_not_without_end(folder: Path) -> None:
    lines = mistakes(with_poses(folder, HEADER + "1,2\n" * 3))
    assert [line.split(":")[1].strip() for line in lines] == [f"arm.csv, line {i}" for i in (2, 3, 4)]
    lines = mistakes(with_poses(folder, HEADER + "1,2\n" * 1000))
    assert len(lines) == 11
    assert "found 990 more mistakes like these" in lines[-1]


def test_poses_are_named_together_with_the_rest(folder: Path) -> None:
    file = with_poses(folder, HEADER)
    text = file.read_text().replace("length = 0.42 ", "length = -1")
    assert len(mistakes(written(folder, text))) == 2


# --- schema --------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def validator() -> jsonschema.Draft202012Validator:
    jsonschema.Draft202012Validator.check_schema(schema())
    return jsonschema.Draft202012Validator(schema())


def test_schema_takes_what_is_right(folder: Path, validator: jsonschema.Draft202012Validator) -> None:
    written_text = write_problem(read_problem(written(folder, CONTRACT)), folder / "b.toml").read_text()
    for text in (CONTRACT, MINIMAL, written_text):
        assert not list(validator.iter_errors(tomllib.loads(text)))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("length = 0.42 ", "length = -1"),
        ("length = 0.42 ", ""),
        ("density = 5571", "density = -1"),
        ("diameter =", "diametre ="),
        ("schema = 1", "schema = 2"),
        ('kind = "hinge"', 'kind = "slide"'),
        ("density = 5571", "density = 1\nmass_per_length = 1"),
        ("turns = 0", "tangent = [0, 0, 1]"),
        ("turns = 0", "force = [0, 0, 1]"),
        ("turns = 0", "roll_deg = 1"),
        ('\nmesh_unit = "mm"', ""),
        (MESH, ""),
        (MESH, f"{MESH}\nsphere = {{ radius = 1 }}"),
        ("gravity = [0, 0, -9.81]", "gravity = [0, 0]"),
    ],
)
def test_schema_refuses_what_is_wrong(validator: jsonschema.Draft202012Validator, old: str, new: str) -> None:
    assert not validator.is_valid(tomllib.loads(changed((old, new))))


def test_schema_lets_a_cable_of_a_library_leave_out_what_that_says(validator: jsonschema.Draft202012Validator) -> None:
    tables = tomllib.loads(CONTRACT)
    cable = tables["cables"]["lead"]
    for key in ("diameter", "bending_stiffness", "torsional_stiffness", "density"):
        del cable[key]
    assert not validator.is_valid(tables)
    cable["from"] = "my_cables.toml#power"
    assert validator.is_valid(tables)
    del cable["length"]
    assert not validator.is_valid(tables), "no library says how long it is here"


def test_schema_describes_every_key() -> None:
    generated = schema()
    assert generated["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    for table in (generated, *generated["$defs"].values()):
        assert table["description"] and table["title"]
        for key, field in table["properties"].items():
            assert len(field["description"]) > 5, key
            assert {"type": "null"} not in field.get("anyOf", []), key


def test_the_reader_is_light() -> None:
    """Reading a file must not wait for meshes, splines and solvers to be imported."""
    package = Path(sys.modules["harness_opt.files.read"].__file__ or "").parent.parent
    code = (
        "import sys, types; package = types.ModuleType('harness_opt');"
        f"package.__path__ = [{str(package)!r}]; sys.modules['harness_opt'] = package;"
        "import harness_opt.files.read;"
        "print([m for m in ('scipy', 'casadi', 'trimesh', 'coal') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
