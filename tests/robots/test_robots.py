"""Robots by URDF: poses against Pinocchio and yourdfpy, parts against their shapes, files in and out, bad input."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import harness_opt as ho
from harness_opt.cli.commands import main
from harness_opt.files.quantities import quantities_of
from harness_opt.files.read import read_problem, write_problem
from harness_opt.parts.scene import load_scene
from oracles.problem_files import mistakes, same
from oracles.robots import PROBLEM, PROGRAM, URDF, by_pinocchio, by_yourdfpy, matrices, put_crane

pytest.importorskip("yourdfpy")
PINOCCHIO = pytest.mark.skipif(not importlib.util.find_spec("pinocchio"), reason="the extra robots is not installed")
DATA = "package:example_robot_data/robots"
CABLE = '[cables.c]\nlength = 9\ndiameter = 0.01\nbending_stiffness = 1\ntorsional_stiffness = 1\nstart = {{ position = [0, 0, 0] }}\nend = {{ position = [0, 0, 1], body = "r.{end}" }}\n'  # noqa: E501


def changed(*pairs: tuple[str, str], text: str = PROBLEM) -> str:
    for old, new in pairs:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text


def installed(urdf: str) -> Path:
    """Return the file of a robot of example-robot-data, or skip."""
    try:
        files = importlib.metadata.files("example-robot-data") or []
    except importlib.metadata.PackageNotFoundError:
        pytest.skip("the extra robots is not installed")
    return next(Path(str(file.locate())) for file in files if file.as_posix().endswith(f"robots/{urdf}"))


# --- where links stand ----------------------------------------------------------------------------------


def test_every_kind_of_joint_stands_where_yourdfpy_has_it(tmp_path):
    """At the rows and between them, where the joints follow cubic splines; a mimicking joint too."""
    problem = read_problem(put_crane(tmp_path))
    rows = np.array([[float(cell) for cell in line.split(",")] for line in PROGRAM.splitlines()[1:]])
    turn, reach = CubicSpline(rows[:, 0], np.radians(rows[:, 1])), CubicSpline(rows[:, 0], rows[:, 2])
    assert set(problem.bodies) == {f"crane.{link}" for link in ("foot", "mast", "boom", "hook", "claw")}
    assert problem.duration == 3.0
    for at in np.linspace(0, 1, 13):
        joints = {"turn": float(turn(3 * at)), "reach": float(reach(3 * at))}
        for link, expected in by_yourdfpy(tmp_path / "crane.urdf", joints).items():
            np.testing.assert_allclose(matrices(problem.poses(f"crane.{link}", [at]))[0], expected, atol=1e-12)


@PINOCCHIO
@pytest.mark.parametrize(
    ("urdf", "end"),
    [
        ("ur_description/urdf/ur5_robot.urdf", "tool0"),
        ("panda_description/urdf/panda.urdf", "panda_leftfinger"),
        ("talos_data/robots/talos_left_arm.urdf", "gripper_left_base_link"),
        ("xarm_description/urdf/xarm7.urdf", "link7"),
        ("so_arm_description/urdf/so101.urdf", "gripper_link"),
    ],
)
def test_robots_stand_where_pinocchio_has_them(urdf, end, tmp_path, rng):
    """To 1e-9 over a program of 100 rows, all links, with prismatic and mimicking joints among them."""
    from yourdfpy import URDF as Reader

    file = installed(urdf)
    joints = [joint for joint in Reader.load(str(file), load_meshes=False).robot.joints]
    own = [joint.name for joint in joints if joint.type != "fixed" and joint.mimic is None]
    times = np.linspace(0.0, 5.0, 100)
    values = 0.5 * np.sin(times[:, None] * rng.uniform(0.2, 1.5, len(own)) + rng.uniform(0, 6, len(own)))
    table = "\n".join(",".join(map(repr, row)) for row in np.column_stack([times, values]).tolist())
    (tmp_path / "program.csv").write_text(f"t,{','.join(own)}\n{table}\n")
    text = f'schema = 1\n{CABLE.format(end=end)}[robots.r]\nurdf = "{DATA}/{urdf}"\nprogram = "program.csv"\n'
    (tmp_path / "p.toml").write_text(text + "shell = true\n")
    problem = read_problem(tmp_path / "p.toml")
    found = {name: matrices(problem.poses(name, np.linspace(0, 1, 100))) for name in problem.bodies}
    for row in range(0, 100, 9):
        expected = by_pinocchio(file, dict(zip(own, values[row].tolist(), strict=True)))
        root = np.linalg.inv(next(iter(found.values()))[row])
        for link, matrix in expected.items():
            if f"r.{link}" in found:
                np.testing.assert_allclose(root @ found[f"r.{link}"][row], matrix, atol=1e-9)
    assert len(found) >= len(own)


def test_a_base_on_a_body_and_a_robot_on_a_robot(tmp_path):
    base = '\nbase = { body = "cart", position = [0, 0, 1], quaternion = [0, 0, 0, 1] }'
    second = '[robots.other]\nurdf = "crane.urdf"\nbase = { body = "crane.claw", position = [0.1, 0, 0] }\n[motion]'
    cart = '[bodies.cart.motion]\nkind = "slide"\ndirection = [1, 0, 0]\nfrom = 0\nto = 0.4\n[motion]'
    text = changed(('unit = "deg"', 'unit = "deg"' + base), ("[motion]", second), ("length = 0.5", "length = 9"))
    problem = read_problem(put_crane(tmp_path, changed(("[motion]", cart), text=text)))
    foot = matrices(problem.poses("crane.foot", [0.5]))[0]
    np.testing.assert_allclose(foot[:3, 3], [0.2, 0, 1])
    np.testing.assert_allclose(foot[:3, 0], [-1, 0, 0], atol=1e-15)
    claw, other = (matrices(problem.poses(name, [0.5]))[0] for name in ("crane.claw", "other.foot"))
    np.testing.assert_allclose(other[:3, 3], claw[:3, 3] + 0.1 * claw[:3, 0], atol=1e-15)


# --- parts ----------------------------------------------------------------------------------------------


def test_shapes_become_parts_with_their_origins_and_scales(tmp_path):
    problem = read_problem(put_crane(tmp_path))
    assert list(problem.parts) == ["crane.foot", "crane.mast.1", "crane.mast.2", "crane.boom", "crane.claw"]
    scene = load_scene(problem)
    c, s = math.cos(0.3), math.sin(0.3)
    half = np.array([10 * c + 15 * s, 10 * s + 15 * c, 20]) * 1e-3
    wedge = scene.parts["crane.mast.1"]
    centre = np.array([[0, 0, 0.1], [0, 0, 0.25]])
    np.testing.assert_allclose([wedge.lower, wedge.upper], [centre[0] - half, centre[0] + half], atol=1e-9)
    assert np.all(wedge.signed_distance(centre[:1])[0] < -0.009), "mirrored, and still solid"
    np.testing.assert_allclose(scene.parts["crane.mast.2"].signed_distance(centre[1:])[0], -0.01, atol=1e-12)
    assert scene.parts["crane.boom"].body == "crane.boom"


def test_visual_shapes_and_what_is_left_out(tmp_path):
    visual = read_problem(put_crane(tmp_path, changed(('unit = "deg"', 'unit = "deg"\nmeshes = "visual"'))))
    assert {name: part.shape for name, part in visual.parts.items()} == {"crane.mast": ho.Sphere(0.03)}
    names = '["crane.foot", "crane.mast.1"]'
    fewer = read_problem(put_crane(tmp_path, changed(('unit = "deg"', f'unit = "deg"\nleave_out = {names}'))))
    assert list(fewer.parts) == ["crane.mast.2", "crane.boom", "crane.claw"]
    link = read_problem(put_crane(tmp_path, changed(('unit = "deg"', 'unit = "deg"\nleave_out = ["crane.mast"]'))))
    assert "crane.mast" in link.bodies and not [name for name in link.parts if name.startswith("crane.mast")]


# --- files ----------------------------------------------------------------------------------------------


def test_a_robot_is_written_as_one_in_its_folder_and_link_by_link_elsewhere(tmp_path):
    problem = read_problem(put_crane(tmp_path))
    beside = write_problem(problem, tmp_path / "b.toml")
    assert "[robots.crane]" in beside.read_text() and "[bodies" not in beside.read_text()
    assert same(read_problem(beside), problem)
    away = write_problem(problem, tmp_path / "away" / "c.toml")
    assert "robots" not in away.read_text() and '[bodies."crane.mast"]' in away.read_text()
    again, at = read_problem(away), np.linspace(0, 1, 7)
    assert again.parts == problem.parts
    for name in problem.bodies:
        for one, other in zip(again.poses(name, at), problem.poses(name, at), strict=True):
            np.testing.assert_allclose(one, other, atol=1e-15)
    part = dict(problem.parts)
    del part["crane.boom"]
    assert "robots" not in write_problem(problem.changed(parts=part), tmp_path / "d.toml").read_text(), (
        "no more as made"
    )
    (tmp_path / "program.csv").write_text(PROGRAM.replace("50", "40"))
    late = write_problem(problem, tmp_path / "e.toml")
    assert "robots" not in late.read_text(), "the program is another by now"
    np.testing.assert_allclose(read_problem(late).poses("crane.claw", at)[0], problem.poses("crane.claw", at)[0])


def test_quantities_of_a_robot(tmp_path):
    quantities = quantities_of(put_crane(tmp_path))
    assert quantities.mistakes({"cables.lead.length": 0.6}) == []
    moved = quantities.problem({"robots.crane.base.position.z": 0.02})
    np.testing.assert_allclose(moved.poses("crane.foot", [0.0])[0], [[0, 0, 0.02]])


def test_a_verdict_from_a_urdf(tmp_path, capsys):
    file = put_crane(tmp_path)
    assert main(["simulate", str(file), "-o", str(tmp_path / "out"), "--no-pictures"]) in (0, 1)
    assert "crane.claw" in capsys.readouterr().out
    used = read_problem(tmp_path / "out" / "used" / "problem.toml")
    assert not used.robots and set(used.parts) == set(read_problem(file).parts)
    for command in (["check", str(file)], ["preview", str(file), "-o", str(tmp_path / "p.html")]):
        assert main(command) == 0
    assert main(["export", str(tmp_path / "out"), "--to", "gltf", "-o", str(tmp_path / "gltf")]) == 0


def test_a_part_fixed_to_the_clamp_s_link_is_certain(tmp_path):
    """The claw is welded to the hook, which carries the clamp: seen from either, they don't move."""
    on_hook = ('body = "crane.claw", position = [0, 0, 0.02]', 'body = "crane.hook", position = [0, 0, -0.08]')
    gentle = "t,turn,reach\n0,-10,0.0\n1,-5,0.02\n2,0,0.04\n3,8,0.05\n"
    problem = read_problem(put_crane(tmp_path, changed(on_hook), program=gentle))
    found = ho.clearances(ho.simulate(problem))
    (row,) = [row for row in found.limits if row.part == "crane.claw"]
    assert row.certified, row.reason


# --- what is wrong --------------------------------------------------------------------------------------

IN_TABLE = [
    (("urdf = \"crane.urdf\"\n", ""), "robots.crane.urdf: found nothing, expected text in quotes"),
    (('"crane.urdf"', '"crone.urdf"'), 'robots.crane.urdf: found "crone.urdf", no such file (did you mean'),
    (('"crane.urdf"', '"../crane.urdf"'), 'robots.crane.urdf: found "../crane.urdf", a file outside the problem'),
    (('"crane.urdf"', '"crane.toml"'), "robots.crane.urdf: found a file that can't be read (XMLSyntaxError"),
    (('"crane.urdf"', '"package:nowhere/x.urdf"'), "found \"package:nowhere/x.urdf\", of which nothing is installed"),
    (('"crane.urdf"', '"package:numpy/../x.urdf"'), "expected a file of an installed Python package"),
    (('"program.csv"', '"programme.csv"'), 'robots.crane.program: found "programme.csv", no such file'),
    (('program = "program.csv"\n', ""), "robots.crane.unit: found a unit without a program, expected it beside"),
    (('unit = "deg"', 'unit = "grad"'), "robots.crane.unit: found \"grad\", expected one of 'rad', 'deg'"),
    (('unit = "deg"', 'meshes = "both"'), "robots.crane.meshes: found \"both\", expected one of 'collision', 'visual'"),
    (('unit = "deg"', 'leave_out = ["crane.boon"]'), 'robots.crane.leave_out: found "crane.boon", expected one of'),
    (('unit = "deg"', 'base = { body = "crate" }'), 'robots.crane.base.body: found "crate", expected one of'),
    (('unit = "deg"', 'base = { body = "crane.claw" }'), 'bodies."crane.foot".parent: found a circle'),
    (('"crane.claw"', '"crane.clow"'), "cables.lead.end.body: found \"crane.clow\", expected one of"),
    (("[motion]", '[bodies."crane.hook"]\n[motion]'), 'bodies."crane.hook": found a name that robot "crane" gives'),
    (("[robots.crane]", "[robots.crane]\narm = 1"), "robots.crane.arm: found an unknown key, expected one of 'urdf'"),
]  # fmt: skip
IN_URDF = [
    (('type="continuous"', 'type="floating"'), 'found joint "swing" of the kind "floating", expected one of'),
    (('<child link="claw"/>', '<child link="claws"/>'), 'found joint "weld" at a link "claws", expected one of'),
    (('<child link="claw"/>', '<child link="mast"/>'), 'found two joints that move link "mast", expected one'),
    (('<parent link="foot"/>', '<parent link="claw"/>'), 'found joint "turn" in a circle, expected a way to "foot"'),
    (
        ('<link name="hook"/>', '<link name="hook"/><link name="lost"/>'),
        "found several links that no joint moves (",
    ),
    (('<link name="hook"/>', '<link name="boom"/>'), 'found two links called "boom", expected one'),
    (('mimic joint="turn"', 'mimic joint="turm"'), 'found joint "swing" that mimics "turm", which the URDF lacks'),
    (('mimic joint="turn"', 'mimic joint="swing"'), 'found joint "swing" that mimics itself'),
    (
        ('axis xyz="1 0 0"', 'axis xyz="0 0 0"'),
        'found joint "reach" with the axis [0.0, 0.0, 0.0], expected a direction',
    ),
    (("meshes/wedge.stl", "../wedge.stl"), 'link mast, mesh "../wedge.stl": found'),
    (("meshes/wedge.stl", "meshes/wedge.dae"), 'link mast: found "wedge.dae", expected a mesh ending in'),
    (("meshes/wedge.stl", "package://crane/wedge.stl"), 'link mast, mesh "package://crane/wedge.stl": found'),
    (("meshes/wedge.stl", "file:///etc/passwd.stl"), "a file outside the problem's folder"),
    (('<?xml version="1.0"?>', '<!DOCTYPE x [<!ENTITY a "b">]>'), "found a document type or entities, expected a URDF"),
    (("</robot>", ""), "found a file that can't be read (XMLSyntaxError"),
    (('<box size="0.2 0.2 0.02"/>', '<box size="a b c"/>'), "found a file that can't be read (ValueError"),
]
IN_PROGRAM = [
    (
        ("t,turn,reach", "t,tern,reach"),
        "program.csv: found joint \"tern\", which the URDF lacks, expected one of 'turn'",
    ),
    (("t,turn,reach", "t,turn,swing"), 'program.csv: found joint "swing", which mimics "turn", expected one of'),
    (("t,turn,reach", "t,turn,weld"), 'program.csv: found joint "weld", which is fixed, expected one of'),
    (("t,turn,reach", "t,turn,turn"), 'program.csv, line 1: found "t,turn,turn", expected the header t and the names'),
    (("1,-20,0.05", "1,-20"), "program.csv, line 3: found 2 values, expected 3 numbers (t,turn,reach)"),
    (("1,-20", "0,-20"), "program.csv, line 3: found t = 0 after 0, expected increasing times"),
]


@pytest.mark.parametrize(("pair", "words"), IN_TABLE)
def test_mistakes_in_the_table_name_their_key(tmp_path, pair, words):
    told = mistakes(put_crane(tmp_path, changed(pair)))
    assert len(told) == 1 and words in told[0], told


def test_a_robot_s_name_is_a_name(tmp_path):
    text = PROBLEM.replace("robots.crane", 'robots."cr/ane"').replace('"crane.claw"', '"cr/ane.claw"')
    (told,) = mistakes(put_crane(tmp_path, text))
    assert 'robots."cr/ane": found the name "cr/ane", expected a name of letters' in told


@pytest.mark.parametrize(("pair", "words"), IN_URDF)
def test_mistakes_in_the_urdf_name_what_they_are_of(tmp_path, pair, words):
    told = mistakes(put_crane(tmp_path, urdf=changed(pair, text=URDF)))
    assert len(told) == 1 and words in told[0] and "robots.crane.urdf: " in told[0], told


@pytest.mark.parametrize(("pair", "words"), IN_PROGRAM)
def test_mistakes_in_the_program_name_joint_or_line(tmp_path, pair, words):
    told = mistakes(put_crane(tmp_path, program=changed(pair, text=PROGRAM)))
    assert len(told) == 1 and words in told[0] and "robots.crane.program: " in told[0], told


def test_meshes_in_folders_that_the_user_gives(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    file = put_crane(tmp_path / "here", urdf=URDF.replace("meshes/wedge.stl", "../elsewhere/wedge.stl"))
    (tmp_path / "here" / "meshes" / "wedge.stl").rename(tmp_path / "elsewhere" / "wedge.stl")
    assert "a file outside the problem's folder" in mistakes(file)[0]
    found = read_problem(file, [tmp_path / "elsewhere"]).parts["crane.mast.1"].shape.path
    assert found == (tmp_path / "elsewhere" / "wedge.stl").resolve()
    written = write_problem(read_problem(file, [tmp_path / "elsewhere"]), tmp_path / "here" / "b.toml")
    assert "robots" not in written.read_text(), "its meshes are not where a reader would look"
    assert read_problem(written).parts["crane.mast.1"].shape.path == found
    ros = put_crane(tmp_path / "crane_description", urdf=URDF.replace("meshes/", "package://crane_description/meshes/"))
    assert read_problem(ros).parts["crane.mast.1"].shape.path.is_file()


def test_joints_beyond_their_limits_are_warned_of(tmp_path, capsys):
    assert ho.doubts(read_problem(put_crane(tmp_path))) == ()
    far = put_crane(tmp_path, program=PROGRAM.replace("0.12", "0.22"))
    (words,) = [line for line in ho.doubts(read_problem(far)) if "limits" in line]
    assert words.startswith("robots.crane: found joint reach from -0.019")
    assert words.endswith("beyond its limits 0 and 0.2 m")
    assert main(["check", str(far)]) == 0
    assert "Beware: robots.crane: found joint reach" in " ".join(capsys.readouterr().out.split())
    standing = put_crane(tmp_path, urdf=URDF.replace('lower="-1.5"', 'lower="0.5"'), program="t,reach\n0,0\n1,0.1\n")
    assert any(
        "found joint turn at 0 deg, beyond its limits 28.648" in line for line in ho.doubts(read_problem(standing))
    )
