"""Problem files: every mistake is named by its key, all at once, and what is written reads back the same."""

from __future__ import annotations

import dataclasses
import hashlib
import math
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import jsonschema
import numpy as np
import pytest
import tomlkit
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from harness_opt import rotations
from harness_opt.errors import ProblemError
from harness_opt.problem import (
    Body,
    Box,
    Cable,
    CableRun,
    Capsule,
    Cylinder,
    Design,
    End,
    Hinge,
    Limits,
    MeshFile,
    Part,
    Poses,
    Problem,
    Slide,
    Sphere,
    Variable,
)
from harness_opt.problem_file import read_problem, schema, write_problem

CONTRACT = """\
schema = 1
title = "Lift arm, original design"
gravity = [0, 0, -9.81]                  # m/s2; leave out for weightless

[cables.lead]
length = 0.42                            # m
diameter = 6.2e-3
bending_stiffness = 2.1e-3               # N m2, or [kx, ky] for a flat section
torsional_stiffness = 1.6e-3             # N m2
density = 5571                           # kg/m3, or mass_per_length
# rest_curvature = [0, 0, 0]             # 1/m, as made
start = { body = "world", position = [0, 0.055, 0.12], tangent = [0, 0, 1], roll_deg = 0 }
end   = { body = "arm", position = [0.03, 0, 0.018], quaternion = [1, 0, 0, 0], turns = 0 }

[bodies.arm.motion]
kind = "hinge"
point = [0, 0, 0.1]
axis = [0, 1, 0]
from_deg = 0
to_deg = 110

[motion]
duration = 2.0
spatial_step = 0.004

[parts.housing]
body = "world"
mesh = "meshes/housing.stl"
mesh_unit = "mm"
clearance = 0.006

[limits]
clearance = 0.004
bend_radius = 0.031
twist_deg_per_m = 360
clamp_force = 20
clamp_moment = 0.5

[design]
minimise = "change"
[design.variables]
"lead.length" = [0.40, 0.60]
"lead.start.position.z" = [0.10, 0.14]
"lead.end.rotate_x_deg" = [-20, 20]
"""

HINGE = CONTRACT[CONTRACT.index('kind = "hinge"') : CONTRACT.index("\n[motion]")]
START = '{ body = "world", position = [0, 0.055, 0.12], tangent = [0, 0, 1], roll_deg = 0 }'
END = '{ body = "arm", position = [0.03, 0, 0.018], quaternion = [1, 0, 0, 0], turns = 0 }'
MESH = 'mesh = "meshes/housing.stl"\nmesh_unit = "mm"'
HEADER = "t,x,y,z,qw,qx,qy,qz\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "meshes").mkdir()
    trimesh.creation.box((60, 40, 30)).export(tmp_path / "meshes" / "housing.stl")
    (tmp_path / "meshes" / "empty.stl").touch()
    (tmp_path / "meshes" / "housing.step").write_text("ISO-10303-21;")
    return tmp_path


def written(folder: Path, text: str | bytes) -> Path:
    file = folder / "lift.toml"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    return file


def mistakes(file: Path) -> list[str]:
    with pytest.raises(ProblemError) as caught:
        read_problem(file)
    assert all("\n" not in line and line.startswith(f"{file}: ") for line in caught.value.mistakes)
    return [line.removeprefix(f"{file}: ") for line in caught.value.mistakes]


def changed(*pairs: tuple[str, str]) -> str:
    text = CONTRACT
    for old, new in pairs:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text


def same(a: Problem, b: Problem) -> bool:
    return dataclasses.replace(a, file=None, sha256=None) == dataclasses.replace(b, file=None, sha256=None)


# --- what is read --------------------------------------------------------------------------------------


def test_contract_example(folder: Path) -> None:
    file = written(folder, CONTRACT)
    problem = read_problem(file)
    lead = problem.cables["lead"]
    assert problem.title == "Lift arm, original design"
    assert problem.gravity == (0.0, 0.0, -9.81)
    assert lead.cable.mass_per_length == pytest.approx(5571 * math.pi * 3.1e-3**2)
    assert lead.start == End(position=(0, 0.055, 0.12), quaternion=(1, 0, 0, 0))
    assert lead.end.body == "arm"
    assert problem.bodies["arm"].motion == Hinge((0, 0, 0.1), (0, 1, 0), 0.0, math.radians(110))
    assert problem.parts["housing"].shape == MeshFile(folder.resolve() / "meshes" / "housing.stl", "mm")
    assert problem.clearance_limit("housing") == 0.006
    assert problem.limits == Limits(0.004, 0.031, math.radians(360), 20.0, 0.5)
    assert problem.design.variables[0] == Variable("lead.length", 0.4, 0.6)
    assert (problem.duration, problem.spatial_step) == (2.0, 0.004)
    assert problem.file == file.resolve()
    assert problem.sha256 == hashlib.sha256(file.read_bytes()).hexdigest()


MINIMAL = """\
schema = 1
[cables.lead]
length = 1
diameter = 0.01
bending_stiffness = [2, 3]
torsional_stiffness = 1
start = { position = [0, 0, 0], tangent = [2, 0, 0], roll_deg = 90 }
end = { force = [0, 0, -1], moment = [0, 1, 0] }
"""


def test_minimal_file_takes_the_defaults(folder: Path) -> None:
    problem = read_problem(written(folder, MINIMAL))
    lead = problem.cables["lead"]
    assert lead.cable == Cable(1.0, 0.01, (2.0, 3.0), 1.0)
    assert lead.end == End(force=(0, 0, -1), moment=(0, 1, 0))
    # d1 is y where the tangent lies along x; a quarter turn about x takes it to z
    assert lead.start.quaternion is not None
    np.testing.assert_allclose(rotations.matrix(lead.start.quaternion)[:, 0], [0, 0, 1], atol=1e-15)
    np.testing.assert_allclose(rotations.tangent(lead.start.quaternion), [1, 0, 0], atol=1e-15)
    rest = dataclasses.replace(problem, cables={}, file=None, sha256=None)
    assert rest == Problem(cables={})


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
    read_problem(written(folder, b"\xef\xbb\xbf" + CONTRACT.replace("\n", "\r\n").encode()))


def test_design_value_outside_its_bounds_passes(folder: Path) -> None:
    read_problem(written(folder, changed(("[0.40, 0.60]", "[0.50, 0.60]"))))


def test_cable_as_long_as_its_clamps_are_apart_passes(folder: Path) -> None:
    straight = "end = { position = [0.6, 0, 0.8], quaternion = [1, 0, 0, 0] }"
    read_problem(written(folder, re.sub("end = .*", straight, MINIMAL)))


# --- mistakes ------------------------------------------------------------------------------------------

NUMBERS = [
    ("length = 0.42 ", "length = -1", "cables.lead.length: found -1, expected a number above 0"),
    ("length = 0.42 ", "length = true", "cables.lead.length: found true, expected a number above 0"),
    ("length = 0.42 ", 'length = "0.42"', 'cables.lead.length: found "0.42", expected a number above 0'),
    ("length = 0.42 ", "length = nan", "cables.lead.length: found nan, expected a number above 0"),
    ("length = 0.42 ", "length = inf", "cables.lead.length: found inf, expected a number above 0"),
    (
        "length = 0.42 ",
        "length = 2020-01-01",
        "cables.lead.length: found 2020-01-01, expected a number above 0",
    ),
    (
        "length = 0.42 ",
        "length = " + "9" * 400,
        "cables.lead.length: found a number of about 400 digits, expected",
    ),
    (
        "length = 0.42 ",
        "length = 0x" + "f" * 6000,
        "cables.lead.length: found a number of about 7225 digits, expected",
    ),
    ("length = 0.42 ", "", "cables.lead.length: found nothing, expected a number above 0"),
    ("diameter = 6.2e-3", "diameter = 0", "cables.lead.diameter: found 0, expected a number above 0"),
    (
        "2.1e-3",
        "[1, -2]",
        "cables.lead.bending_stiffness: found [1, -2], expected a number above 0, or [kx, ky]",
    ),
    ("2.1e-3", "[1, 2, 3]", "cables.lead.bending_stiffness: found [1, 2, 3], expected a number above 0, or"),
    ("1.6e-3", "[1]", "cables.lead.torsional_stiffness: found [1], expected a number above 0"),
    ("density = 5571", "density = -1", "cables.lead.density: found -1, expected a number of at least 0"),
    ("gravity = [0, 0, -9.81]", "gravity = -9.81", "gravity: found -9.81, expected [x, y, z], three numbers"),
    (
        "gravity = [0, 0, -9.81]",
        "gravity = [0, -9.81]",
        "gravity: found [0, -9.81], expected [x, y, z], three",
    ),
    (
        "gravity = [0, 0, -9.81]",
        "gravity = [0, 0, true]",
        "gravity: found [0, 0, true], expected [x, y, z], three",
    ),
    ('title = "Lift arm, original design"', "title = 3", "title: found 3, expected text in quotes"),
    ("duration = 2.0", "duration = 0", "motion.duration: found 0, expected a number above 0"),
    (
        "spatial_step = 0.004",
        "spatial_step = 0.0",
        "motion.spatial_step: found 0.0, expected a number above 0",
    ),
    (
        "clearance = 0.004",
        "clearance = -0.004",
        "limits.clearance: found -0.004, expected a number of at least 0",
    ),
    ("clearance = 0.004", 'clearance = ""', 'limits.clearance: found "", expected a number of at least 0'),
    ("bend_radius = 0.031", "bend_radius = 0", "limits.bend_radius: found 0, expected a number above 0"),
    ("deg_per_m = 360", "deg_per_m = 0", "limits.twist_deg_per_m: found 0, expected a number above 0"),
    ("clamp_force = 20", "clamp_force = -20", "limits.clamp_force: found -20, expected a number above 0"),
    ("clamp_moment = 0.5", "clamp_moment = nan", "limits.clamp_moment: found nan, expected a number above 0"),
    (
        "clearance = 0.006",
        "clearance = -1",
        "parts.housing.clearance: found -1, expected a number of at least 0",
    ),
    ("from_deg = 0", 'from_deg = "0"', 'bodies.arm.motion.from_deg: found "0", expected a number'),
    (
        "axis = [0, 1, 0]",
        "axis = [0, 0, 0]",
        "bodies.arm.motion.axis: found [0, 0, 0], expected a direction, not",
    ),
    (
        "tangent = [0, 0, 1]",
        "tangent = [0, 0, 0]",
        "cables.lead.start.tangent: found [0, 0, 0], expected a direc",
    ),
    ("turns = 0", "turns = 0.5", "cables.lead.end.turns: found 0.5, expected a whole number"),
    ("turns = 0", "turns = true", "cables.lead.end.turns: found true, expected a whole number"),
    (
        "quaternion = [1, 0, 0, 0]",
        "quaternion = [1, 1, 0, 0]",
        "cables.lead.end.quaternion: found [1, 1, 0, 0], expected a unit quaternion [w, x, y, z] "
        "(this one is 1.41421 long)",
    ),
    (
        "quaternion = [1, 0, 0, 0]",
        "quaternion = [1, 0, 0]",
        "cables.lead.end.quaternion: found [1, 0, 0], expected",
    ),
    (
        "[0.40, 0.60]",
        "[0.40]",
        'design.variables."lead.length": found [0.4], expected [lower, upper], two numbers',
    ),
    (
        "[0.40, 0.60]",
        "0.5",
        'design.variables."lead.length": found 0.5, expected [lower, upper], two numbers',
    ),
]

STRUCTURE = [
    ("schema = 1", "schema = 2", "schema: found 2, expected 1"),
    ("schema = 1", "schema = true", "schema: found true, expected 1"),
    ("schema = 1", "", "schema: found nothing, expected 1"),
    (
        "diameter =",
        "diametre =",
        "cables.lead.diametre: found an unknown key, expected one of 'length', 'diameter'",
    ),
    ("diameter =", "diametre =", "did you mean 'diameter'?"),
    ("diameter =", "diametre =", "cables.lead.diameter: found nothing, expected a number above 0"),
    ("[limits]", "[limit]", "limit: found an unknown key, expected one of"),
    ("[limits]", "[limit]", "did you mean 'limits'?"),
    ("turns = 0", "turn = 0", "cables.lead.end.turn: found an unknown key"),
    ("from_deg", "from", "bodies.arm.motion.from: found an unknown key"),
    ("from_deg", "from", "bodies.arm.motion.from_deg: found nothing, expected a number"),
    (
        'kind = "hinge"',
        'kind = "hinges"',
        "bodies.arm.motion.kind: found \"hinges\", expected one of 'hinge', 'slide'",
    ),
    ('kind = "hinge"', 'kind = "hinges"', "did you mean 'hinge'?"),
    (
        'kind = "hinge"',
        "",
        "bodies.arm.motion.kind: found nothing, expected one of 'hinge', 'slide', 'poses'",
    ),
    (START, "3", "cables.lead.start: found 3, expected a table"),
    (f"start = {START}", "", "cables.lead.start: found nothing, expected a table"),
    (
        'minimise = "change"',
        'minimise = "lenght"',
        "design.minimise: found \"lenght\", expected one of 'change'",
    ),
    (
        'mesh_unit = "mm"',
        'mesh_unit = "cubits"',
        "parts.housing.mesh_unit: found \"cubits\", expected one of 'm', 'cm'",
    ),
    (
        MESH,
        "sphere = { radius = 1, size = 1 }",
        "parts.housing.sphere.size: found an unknown key, expected 'radius'",
    ),
    (
        '"lead.length"',
        "lead.length",
        "design.variables.lead: found a table, expected [lower, upper], two numbers",
    ),
    ('"lead.length"', "lead.length", 'behind a name in quotes such as "lead.length"'),
]

BETWEEN = [
    ('body = "arm"', 'body = "amr"', "cables.lead.end.body: found \"amr\", expected one of 'world', 'arm'"),
    ('body = "arm"', 'body = "amr"', "did you mean 'arm'?"),
    (
        'body = "world"\n',
        'body = "wrold"\n',
        "parts.housing.body: found \"wrold\", expected one of 'world', 'arm'; did",
    ),
    (
        "[bodies.arm.motion]",
        "[bodies.world]\n[bodies.arm.motion]",
        'bodies.world: found "world", expected another',
    ),
    ("[cables.lead]", '[cables."a/b"]', 'cables."a/b": found the name "a/b", expected a name of letters'),
    (
        "density = 5571",
        "density = 1\nmass_per_length = 1",
        "cables.lead.density: found mass_per_length as well",
    ),
    (
        "position = [0.03, 0, 0.018],",
        "force = [0, 0, 0], position = [0.03, 0, 0.018],",
        "cables.lead.end.force: found po",
    ),
    (
        "turns = 0",
        "tangent = [0, 0, 1]",
        "cables.lead.end.tangent: found quaternion as well, expected quaternion or",
    ),
    (
        "turns = 0",
        "moment = [0, 0, 1]",
        "cables.lead.end.moment: found quaternion as well, expected quaternion or",
    ),
    (
        "roll_deg = 0",
        "moment = [0, 0, 1]",
        "cables.lead.start.moment: found tangent as well, expected tangent or",
    ),
    ("turns = 0", "roll_deg = 3", "cables.lead.end.tangent: found nothing, expected a tangent for roll_deg"),
    ("roll_deg = 0", "turns = 1", "cables.lead.start.turns: found 1, expected turns at the cable's end only"),
    (
        "roll_deg = 0 }\n",
        "roll_deg = 0 }\nbow = [0, 0, 0]\n",
        "cables.lead.bow: found [0, 0, 0], expected a",
    ),
    (
        "quaternion = [1, 0, 0, 0], turns = 0",
        "turns = 1",
        "cables.lead.end.turns: found 1, expected 0, as the end has",
    ),
    (
        "bend_radius = 0.031",
        "bend_radius = 0.003",
        "limits.bend_radius: found 0.003, expected at least 0.0031, half",
    ),
    (
        "[0.40, 0.60]",
        "[0.60, 0.40]",
        'design.variables."lead.length": found [0.6, 0.4], expected [lower, upper] with',
    ),
    (
        "[0.40, 0.60]",
        "[0.60, 0.60]",
        'design.variables."lead.length": found [0.6, 0.6], expected [lower, upper] with',
    ),
    (
        "[0.40, 0.60]",
        "[0, 0.60]",
        'design.variables."lead.length": found [0, 0.6], expected a lower bound above 0',
    ),
    (
        '"lead.length"',
        '"led.length"',
        'design.variables."led.length": found an unknown variable, expected CABLE.length',
    ),
    ('"lead.length"', '"led.length"', "did you mean 'lead.length'?"),
    ("rotate_x_deg", "rotate_x", "did you mean 'lead.end.rotate_x_deg'?"),
    (
        "quaternion = [1, 0, 0, 0]",
        "moment = [0, 0, 0]",
        "found no quaternion or tangent in cables.lead.end, expected",
    ),
    (
        "position = [0, 0.055, 0.12]",
        "force = [0, 0, 0]",
        'design.variables."lead.start.position.z": found no position in cables.lead.start, expected one',
    ),
    ("length = 0.42 ", "length = 0.06", "cables.lead.length: found 0.06, expected at least 0.1"),
    ("length = 0.42 ", "length = 0.06", "the distance between its clamps at motion"),
    (MESH, "", "parts.housing: found no shape, expected exactly one of mesh, box, cylinder, sphere, capsule"),
    (
        MESH,
        f"{MESH}\nsphere = {{ radius = 1 }}",
        "parts.housing: found mesh and sphere, expected exactly one of",
    ),
    (
        '\nmesh_unit = "mm"',
        "",
        "parts.housing.mesh_unit: found nothing, expected one of 'm', 'cm', 'mm', 'in': .stl",
    ),
    (
        MESH,
        'sphere = { radius = 1 }\nmesh_unit = "mm"',
        "parts.housing.mesh_unit: found a unit without a mesh, expected it beside mesh only",
    ),
    (
        "housing.stl",
        "hosing.stl",
        'parts.housing.mesh: found "meshes/hosing.stl", no such file (did you mean',
    ),
    ("housing.stl", "hosing.stl", "did you mean 'housing.stl'?"),
    (
        "housing.stl",
        "empty.stl",
        'parts.housing.mesh: found "meshes/empty.stl", an empty file, expected a mesh (paths',
    ),
    (
        "housing.stl",
        "housing.step",
        'parts.housing.mesh: found "meshes/housing.step", expected a file ending in',
    ),
    ("meshes/housing.stl", "meshes", 'parts.housing.mesh: found "meshes", a folder, expected a mesh (paths'),
    ("meshes/housing.stl", "a\\u0000.stl", "parts.housing.mesh: found "),
]


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
        (HINGE, slide),
        (START, "{ position = [0, 0, 0.018] }"),
        ('"lead.start.position.z"', '"lead.start.position.x"'),
    )
    (line,) = mistakes(written(folder, text))
    words = "found 0.42, expected at least 1, the distance between its clamps at motion 1 (of 0 to 1)"
    assert line == f"cables.lead.length: {words}"


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


# --- tables of poses -----------------------------------------------------------------------------------

ROWS = ["0,0,0,0,1,0,0,0", "1,0,0,0.01,1,0,0,0", "2,0,0,0.02,0.7071,0.7071,0,0", "3,0,0,0.03,0,-1,0,0"]


def with_poses(folder: Path, table: str | bytes) -> Path:
    (folder / "arm.csv").write_bytes(table if isinstance(table, bytes) else table.encode())
    return written(folder, changed((HINGE, 'kind = "poses"\nfile = "arm.csv"\n')))


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
        (
            [ROWS[0], "1,0,0,0,inf,0,0,0", *ROWS[2:]],
            "arm.csv, line 3: found inf as qw, expected a finite number",
        ),
        ([ROWS[0], ROWS[0], *ROWS[2:]], "arm.csv, line 3: found t = 0 after 0, expected increasing times"),
        (
            [*ROWS, "90,0,0,0,1,0,0,0"],
            "arm.csv, line 6: found a gap from t = 3 to 90, expected no interval above 10",
        ),
        (
            [*ROWS, "4,0,0,0,1,0.1,0,0"],
            "arm.csv, line 6: found a quaternion of length 1.00499, expected 1 to within",
        ),
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


def poses_of(problem: Problem) -> Poses:
    motion = problem.bodies["arm"].motion
    assert isinstance(motion, Poses)
    return motion


# --- writing -------------------------------------------------------------------------------------------


def test_written_file_reads_back_from_another_folder(folder: Path) -> None:
    problem = read_problem(with_poses(folder, HEADER + "\n".join(ROWS)))
    target = write_problem(problem, folder / "deep" / "er" / "better.toml")
    text = target.read_text()
    assert 'mesh = "../../meshes/housing.stl"' in text
    assert 'file = "../../arm.csv"' in text
    again = read_problem(target)
    assert same(again, problem)
    assert again.file == target
    assert sorted(p.name for p in target.parent.iterdir()) == ["better.toml"], "nothing left beside"
    assert write_problem(again, target).read_text() == text


def test_typed_degrees_stay_as_typed(folder: Path) -> None:
    problem = read_problem(written(folder, changed(("to_deg = 110", "to_deg = -112.3"))))
    tables = tomllib.loads(write_problem(problem, folder / "b.toml").read_text())
    assert tables["bodies"]["arm"]["motion"]["to_deg"] == -112.3
    assert tables["limits"]["twist_deg_per_m"] == 360


def test_poses_without_a_file_are_written_beside(folder: Path) -> None:
    problem = read_problem(with_poses(folder, HEADER + "\n".join(ROWS)))
    poses = dataclasses.replace(poses_of(problem), file=None)
    problem = dataclasses.replace(problem, bodies={"arm": Body(poses)})
    again = read_problem(write_problem(problem, folder / "out" / "b.toml"))
    assert again.bodies["arm"].motion == dataclasses.replace(poses, file=folder.resolve() / "out" / "b_arm.csv")


def test_changed_poses_do_not_point_to_their_old_file(folder: Path) -> None:
    problem = read_problem(with_poses(folder, HEADER + "\n".join(ROWS)))
    poses = dataclasses.replace(poses_of(problem), times=(0.0, 1.0, 2.0, 4.0))
    again = read_problem(write_problem(dataclasses.replace(problem, bodies={"arm": Body(poses)}), folder / "b.toml"))
    assert again.bodies["arm"].motion == dataclasses.replace(poses, file=folder.resolve() / "b_arm.csv")
    assert (folder / "arm.csv").read_text() == HEADER + "\n".join(ROWS)


def test_what_could_not_be_read_back_is_not_written(folder: Path) -> None:
    problem = dataclasses.replace(read_problem(written(folder, CONTRACT)), limits=Limits(clearance=math.nan))
    with pytest.raises(ProblemError, match=r"b\.toml: limits\.clearance: found nan"):
        write_problem(problem, folder / "new" / "b.toml")
    assert not (folder / "new").exists()


def test_nowhere_to_write(folder: Path) -> None:
    problem = read_problem(written(folder, CONTRACT))
    with pytest.raises(ProblemError, match="found a folder, expected the name of a file"):
        write_problem(problem, folder)
    with pytest.raises(ProblemError, match="found no way to write"):
        write_problem(problem, folder / "lift.toml" / "b.toml")


def test_a_failed_write_leaves_the_old_file(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = written(folder, CONTRACT)
    problem = read_problem(file)

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(ProblemError, match="No space left on device"):
        write_problem(problem, file)
    assert file.read_text() == CONTRACT
    assert not list(folder.glob(".*"))


@pytest.mark.skipif(sys.platform == "win32", reason="links need rights there")
def test_links_of_folders(folder: Path) -> None:
    real = folder / "real" / "deep"
    real.mkdir(parents=True)
    (folder / "link").symlink_to(real)
    problem = read_problem(written(folder, CONTRACT))
    write_problem(problem, folder / "link" / "b.toml")
    assert same(read_problem(folder / "link" / "b.toml"), problem)
    assert same(read_problem(real / "b.toml"), problem)


finite = st.floats(-1e6, 1e6)
positive = st.floats(1e-6, 1e6)
vectors = st.tuples(finite, finite, finite)
directions = vectors.filter(lambda v: math.hypot(*v) > 1e-3)
names = st.text("abcXYZ_-09é ", min_size=1, max_size=6).filter(lambda name: name == name.strip() and name != "world")
quaternions = (
    st.tuples(*[st.floats(-1, 1)] * 4)
    .filter(lambda q: math.hypot(*q) > 0.1)
    .map(lambda q: tuple((np.array(q) / math.hypot(*q)).tolist()))
)
optional = lambda strategy: st.none() | strategy  # noqa: E731

cables = st.builds(
    Cable,
    length=st.just(1e8),  # longer than any distance drawn here
    diameter=positive,
    bending_stiffness=positive | st.tuples(positive, positive),
    torsional_stiffness=positive,
    mass_per_length=st.just(0.0) | positive,
    rest_curvature=vectors,
)
motions = optional(
    st.builds(Hinge, vectors, directions, st.floats(-7, 7), st.floats(-7, 7))
    | st.builds(Slide, directions, finite, finite)
)
parts = st.builds(
    Part,
    shape=st.builds(Box, st.tuples(positive, positive, positive))
    | st.builds(Sphere, positive)
    | st.builds(Cylinder, positive, positive)
    | st.builds(Capsule, positive, positive),
    position=vectors,
    quaternion=quaternions,
    clearance=optional(st.just(0.0) | positive),
)


@st.composite
def problems(draw: st.DrawFn) -> Problem:
    bodies = draw(st.dictionaries(names, st.builds(Body, motions), max_size=2))
    body = st.sampled_from(["world", *bodies])
    clamps = st.builds(End, position=vectors, quaternion=quaternions, body=body)
    loads = st.builds(End, force=optional(vectors), moment=optional(vectors))
    turned = st.builds(dataclasses.replace, clamps, turns=st.integers(-3, 3))
    runs = st.builds(CableRun, cables, clamps, turned | loads, optional(directions))
    lead = draw(names)
    bounds = draw(st.tuples(positive, positive).filter(lambda b: b[0] < b[1]))
    variables = tuple(
        Variable(f"{lead}.{key}", *bounds) for key in ("length", "start.position.x", "start.rotate_y_deg")
    )
    return Problem(
        cables={
            lead: draw(runs),
            **draw(st.dictionaries(names.filter(lambda n: n != lead), runs, max_size=1)),
        },
        bodies=bodies,
        parts=draw(st.dictionaries(names, parts, max_size=2)),
        gravity=draw(vectors),
        limits=draw(
            st.builds(Limits, optional(positive), st.none(), st.none(), optional(positive), optional(positive))
        ),
        design=Design(draw(st.sampled_from(["change", "length"])), variables),
        duration=draw(positive),
        spatial_step=draw(optional(positive)),
        title=draw(st.text(max_size=12)),
    )


def near(problem: Problem) -> Problem:
    """Return ``problem`` with angles rounded to what degrees keep, 1e-12 rad."""
    bodies = {
        name: Body(dataclasses.replace(b.motion, start=round(b.motion.start, 12), stop=round(b.motion.stop, 12)))
        if isinstance(b.motion, Hinge)
        else b
        for name, b in problem.bodies.items()
    }
    return dataclasses.replace(problem, bodies=bodies)


@settings(
    max_examples=60,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(problem=problems())
def test_round_trip(tmp_path: Path, problem: Problem) -> None:
    again = read_problem(write_problem(problem, tmp_path / "p.toml"))
    assert same(near(again), near(problem))
    # angles that have been degrees once stay the same to the last bit
    third = read_problem(write_problem(again, tmp_path / "q.toml"))
    assert same(third, again)


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


# --- schema --------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def validator() -> jsonschema.Draft202012Validator:
    jsonschema.Draft202012Validator.check_schema(schema())
    return jsonschema.Draft202012Validator(schema())


def test_schema_takes_what_is_right(folder: Path, validator: jsonschema.Draft202012Validator) -> None:
    written_text = write_problem(read_problem(written(folder, CONTRACT)), folder / "b.toml").read_text()
    for text in (CONTRACT, MINIMAL, written_text):
        validator.validate(tomllib.loads(text))


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
    package = Path(sys.modules["harness_opt.problem_file"].__file__ or "").parent
    code = (
        "import sys, types; package = types.ModuleType('harness_opt');"
        f"package.__path__ = [{str(package)!r}]; sys.modules['harness_opt'] = package;"
        "import harness_opt.problem_file;"
        "print([m for m in ('scipy', 'casadi', 'trimesh', 'coal') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
