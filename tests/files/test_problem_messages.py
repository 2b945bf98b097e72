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
from oracles.problem_files import CONTRACT, HINGE, MESH, MINIMAL, START, changed, mistakes, written

NUMBERS = [
    ("length = 0.42 ", "length = -1", "cables.lead.length: found -1, expected a number above 0"),
    ("length = 0.42 ", "length = true", "cables.lead.length: found true, expected a number above 0"),
    ("length = 0.42 ", 'length = "0.42"', 'cables.lead.length: found "0.42", expected a number above 0'),
    ("length = 0.42 ", "length = nan", "cables.lead.length: found nan, expected a number above 0"),
    ("length = 0.42 ", "length = inf", "cables.lead.length: found inf, expected a number above 0"),
    ("length = 0.42 ", "length = 2020-01-01", "cables.lead.length: found 2020-01-01, expected a number above 0"),
    ("length = 0.42 ", "length = " + "9" * 400, "cables.lead.length: found a number of about 400 digits, expected"),
    ("length = 0.42 ", "length = 0x" + "f" * 6000, "cables.lead.length: found a number of about 7225 digits, expected"),
    ("length = 0.42 ", "", "cables.lead.length: found nothing, expected a number above 0"),
    ("diameter = 6.2e-3", "diameter = 0", "cables.lead.diameter: found 0, expected a number above 0"),
    ("2.1e-3", "[1, -2]", "cables.lead.bending_stiffness: found [1, -2], expected a number above 0, or [kx, ky]"),
    ("2.1e-3", "[1, 2, 3]", "cables.lead.bending_stiffness: found [1, 2, 3], expected a number above 0, or"),
    ("1.6e-3", "[1]", "cables.lead.torsional_stiffness: found [1], expected a number above 0"),
    ("density = 5571", "density = -1", "cables.lead.density: found -1, expected a number of at least 0"),
    ("gravity = [0, 0, -9.81]", "gravity = -9.81", "gravity: found -9.81, expected [x, y, z], three numbers"),
    ("gravity = [0, 0, -9.81]", "gravity = [0, -9.81]", "gravity: found [0, -9.81], expected [x, y, z], three"),
    ("gravity = [0, 0, -9.81]", "gravity = [0, 0, true]", "gravity: found [0, 0, true], expected [x, y, z], three"),
    ('title = "Lift arm, original design"', "title = 3", "title: found 3, expected text in quotes"),
    ("duration = 2.0", "duration = 0", "motion.duration: found 0, expected a number above 0"),
    ("spatial_step = 0.004", "spatial_step = 0.0", "motion.spatial_step: found 0.0, expected a number above 0"),
    ("clearance = 0.004", "clearance = -0.004", "limits.clearance: found -0.004, expected a number of at least 0"),
    ("clearance = 0.004", 'clearance = ""', 'limits.clearance: found "", expected a number of at least 0'),
    ("bend_radius = 0.031", "bend_radius = 0", "limits.bend_radius: found 0, expected a number above 0"),
    ("deg_per_m = 360", "deg_per_m = 0", "limits.twist_deg_per_m: found 0, expected a number above 0"),
    ("clamp_force = 20", "clamp_force = -20", "limits.clamp_force: found -20, expected a number above 0"),
    ("clamp_moment = 0.5", "clamp_moment = nan", "limits.clamp_moment: found nan, expected a number above 0"),
    ("clearance = 0.006", "clearance = -1", "parts.housing.clearance: found -1, expected a number of at least 0"),
    ("from_deg = 0", 'from_deg = "0"', 'bodies.arm.motion.from_deg: found "0", expected a number'),
    ("axis = [0, 1, 0]", "axis = [0, 0, 0]", "bodies.arm.motion.axis: found [0, 0, 0], expected a direction, not"),
    ("tangent = [0, 0, 1]", "tangent = [0, 0, 0]", "cables.lead.start.tangent: found [0, 0, 0], expected a direc"),
    ("turns = 0", "turns = 0.5", "cables.lead.end.turns: found 0.5, expected a whole number"),
    ("turns = 0", "turns = true", "cables.lead.end.turns: found true, expected a number"),
    (
        "quaternion = [1, 0, 0, 0]",
        "quaternion = [1, 1, 0, 0]",
        "cables.lead.end.quaternion: found [1, 1, 0, 0], expected a unit quaternion [w, x, y, z] "
        "(this one is 1.41421 long)",
    ),
    ("quaternion = [1, 0, 0, 0]", "quaternion = [1, 0, 0]", "cables.lead.end.quaternion: found [1, 0, 0], expected"),
    ("[0.40, 0.60]", "[0.40]", 'design.variables."lead.length": found [0.4], expected [lower, upper], two numbers'),
    ("[0.40, 0.60]", "0.5", 'design.variables."lead.length": found 0.5, expected [lower, upper], two numbers'),
]

STRUCTURE = [
    ("schema = 1", "schema = 2", "schema: found 2, expected 1"),
    ("schema = 1", "schema = true", "schema: found true, expected 1"),
    ("schema = 1", "", "schema: found nothing, expected 1"),
    ("diameter =", "diametre =", "cables.lead.diametre: found an unknown key, expected one of 'length', 'diameter'"),
    ("diameter =", "diametre =", "did you mean 'diameter'?"),
    ("diameter =", "diametre =", "cables.lead.diameter: found nothing, expected a number above 0"),
    ("[limits]", "[limit]", "limit: found an unknown key, expected one of"),
    ("[limits]", "[limit]", "did you mean 'limits'?"),
    ("turns = 0", "turn = 0", "cables.lead.end.turn: found an unknown key"),
    ("from_deg", "from", "bodies.arm.motion.from: found an unknown key"),
    ("from_deg", "from", "bodies.arm.motion.from_deg: found nothing, expected a number"),
    ('kind = "hinge"', 'kind = "hinges"', "bodies.arm.motion.kind: found \"hinges\", expected one of 'hinge', 'slide'"),
    ('kind = "hinge"', 'kind = "hinges"', "did you mean 'hinge'?"),
    ('kind = "hinge"', "", "bodies.arm.motion.kind: found nothing, expected one of 'hinge', 'slide', 'poses'"),
    (START, "3", "cables.lead.start: found 3, expected a table"),
    (f"start = {START}", "", "cables.lead.start: found nothing, expected a table"),
    ('minimise = "change"', 'minimise = "lenght"', "design.minimise: found \"lenght\", expected one of 'change'"),
    (
        'mesh_unit = "mm"',
        'mesh_unit = "cubits"',
        "parts.housing.mesh_unit: found \"cubits\", expected one of 'm', 'cm'",
    ),
    (MESH, "sphere = { radius = 1, size = 1 }", "parts.housing.sphere.size: found an unknown key, expected 'radius'"),
    ('"lead.length"', "lead.length", "design.variables.lead: found a table, expected [lower, upper], two numbers"),
    ('"lead.length"', "lead.length", 'behind a name in quotes such as "lead.length"'),
]

BETWEEN = [
    (
        "roll_deg = 0 }",
        'roll_deg = 0, holders = ["hosing"] }',
        "cables.lead.start.holders: found \"hosing\", expected a part of \"world\": 'housing'; did you mean 'housing'?",
    ),
    (
        "turns = 0 }",
        'turns = 0, holders = ["housing"] }',
        'cables.lead.end.holders: found "housing", a part of "world", expected a part of "arm"',
    ),
    (
        "turns = 0 }",
        'turns = 0, holders = ["gland"] }',
        'cables.lead.end.holders: found "gland", expected a part of "arm": it has none',
    ),
    ('body = "arm"', 'body = "amr"', "cables.lead.end.body: found \"amr\", expected one of 'world', 'arm'"),
    ('body = "arm"', 'body = "amr"', "did you mean 'arm'?"),
    (
        'body = "world"\n',
        'body = "wrold"\n',
        "parts.housing.body: found \"wrold\", expected one of 'world', 'arm'; did",
    ),
    ("[bodies.arm.motion]", "[bodies.world]\n[bodies.arm.motion]", 'bodies.world: found "world", expected another'),
    ("[cables.lead]", '[cables."a/b"]', 'cables."a/b": found the name "a/b", expected a name of letters'),
    ("density = 5571", "density = 1\nmass_per_length = 1", "cables.lead.density: found mass_per_length as well"),
    (
        "position = [0.03, 0, 0.018],",
        "force = [0, 0, 0], position = [0.03, 0, 0.018],",
        "cables.lead.end.force: found po",
    ),
    ("turns = 0", "tangent = [0, 0, 1]", "cables.lead.end.tangent: found quaternion as well, expected quaternion or"),
    ("turns = 0", "moment = [0, 0, 1]", "cables.lead.end.moment: found quaternion as well, expected quaternion or"),
    ("roll_deg = 0", "moment = [0, 0, 1]", "cables.lead.start.moment: found tangent as well, expected tangent or"),
    ("turns = 0", "roll_deg = 3", "cables.lead.end.tangent: found nothing, expected a tangent for roll_deg"),
    (
        "roll_deg = 0",
        "roll_deg = 0, turns = 1",
        "cables.lead.start.turns: found 1, expected turns at the cable's end only",
    ),
    ("roll_deg = 0", "roll_deg = 0, roll = 'free'", "cables.lead.start.roll_deg: found roll as well, expected roll or"),
    ("turns = 0", "roll = 'free'", "cables.lead.end.roll: found quaternion as well, expected quaternion or roll"),
    ("roll_deg = 0", "roll = 'loose'", "cables.lead.start.roll: found \"loose\", expected one of 'untwisted', 'free'"),
    (
        "roll_deg = 0 }\n",
        "roll_deg = 0 }\nfitted_at = 1.5\n",
        "cables.lead.fitted_at: found 1.5, expected a number from 0 to 1",
    ),
    (
        "roll_deg = 0 }\n",
        "roll_deg = 0 }\nfitted_at = -0.1\n",
        "cables.lead.fitted_at: found -0.1, expected a number from 0",
    ),
    ("roll_deg = 0", "roll = 'free', turns = 1", "cables.lead.start.turns: found 1, expected"),
    (
        "quaternion = [1, 0, 0, 0], turns = 0",
        "tangent = [0, 0, 1], roll_deg = 5, turns = 0.25",
        "cables.lead.end.turns: found 0.25, expected a whole number",
    ),
    ("roll_deg = 0 }\n", "roll_deg = 0 }\nbow = [0, 0, 0]\n", "cables.lead.bow: found [0, 0, 0], expected a"),
    ("quaternion = [1, 0, 0, 0], turns = 0", "turns = 1", "cables.lead.end.turns: found 1, expected 0, as the end has"),
    ("bend_radius = 0.031", "bend_radius = 0.003", "limits.bend_radius: found 0.003, expected at least 0.0031, half"),
    ("[0.40, 0.60]", "[0.60, 0.40]", 'design.variables."lead.length": found [0.6, 0.4], expected [lower, upper] with'),
    ("[0.40, 0.60]", "[0.60, 0.60]", 'design.variables."lead.length": found [0.6, 0.6], expected [lower, upper] with'),
    ("[0.40, 0.60]", "[0, 0.60]", 'design.variables."lead.length": found [0, 0.6], expected a lower bound above 0'),
    (
        '"lead.length"',
        '"led.length"',
        'design.variables."led.length": found an unknown variable, expected CABLE.length',
    ),
    ('"lead.length"', '"led.length"', "did you mean 'lead.length'?"),
    ("rotate_x_deg", "rotate_x", "did you mean 'lead.end.rotate_x_deg'?"),
    ("quaternion = [1, 0, 0, 0]", "moment = [0, 0, 0]", "found no quaternion or tangent in cables.lead.end, expected"),
    (
        "position = [0, 0.055, 0.12]",
        "force = [0, 0, 0]",
        'design.variables."lead.start.position.z": found no position in cables.lead.start, expected one',
    ),
    (MESH, "", "parts.housing: found no shape, expected exactly one of mesh, box, cylinder, sphere, capsule"),
    (MESH, f"{MESH}\nsphere = {{ radius = 1 }}", "parts.housing: found mesh and sphere, expected exactly one of"),
    ('\nmesh_unit = "mm"', "", "parts.housing.mesh_unit: found nothing, expected one of 'm', 'cm', 'mm', 'in': .stl"),
    (
        MESH,
        'sphere = { radius = 1 }\nmesh_unit = "mm"',
        "parts.housing.mesh_unit: found a unit without a mesh, expected it beside mesh only",
    ),
    ("housing.stl", "hosing.stl", 'parts.housing.mesh: found "meshes/hosing.stl", no such file (did you mean'),
    ("housing.stl", "hosing.stl", "did you mean 'housing.stl'?"),
    ("housing.stl", "empty.stl", 'parts.housing.mesh: found "meshes/empty.stl", an empty file, expected a mesh (paths'),
    (
        "housing.stl",
        "housing.step",
        'parts.housing.mesh: found "meshes/housing.step", a kind of CAD file that',
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
