"""What hardly anybody means is told, once, and solved all the same."""

from __future__ import annotations

import dataclasses
import tomllib
from pathlib import Path

import pytest
import trimesh

from harness_opt.cli.commands import main
from harness_opt.cli.template import write_template
from harness_opt.files.read import read_problem
from harness_opt.files.stored_results import read_results
from harness_opt.model.design import Design, Limits, Variable
from harness_opt.model.parts import Part, Sphere
from harness_opt.model.plausibility import doubts
from harness_opt.parts.scene import load_scene
from oracles.clipped import arm
from oracles.flap import FLAP, PLAIN, put, strict
from oracles.problems import PROBLEMS, shipped

FREE = Design(variables=(Variable("lead.elbow.at", 0.14, 0.3),))  # a cable that is drawn too short may be, then

ODD = [
    ("length = 0.3\n", "length = 300\n", "cables.lead.length: found 300 m, longer than a ship"),
    ("diameter = 0.005", "diameter = 1e-5", "cables.lead.diameter: found 1e-05 m, thinner than a hair"),
    ("diameter = 0.005", "diameter = 5", "cables.lead.diameter: found 5 m, thicker than a submarine cable"),
    ("diameter = 0.005", "diameter = 0.08", "cables.lead.length: found 3.75 diameters, too short for a rod"),
    ("bending_stiffness = 2e-3", "bending_stiffness = 2000", "stiffer than a rod of diamond"),
    ("bending_stiffness = 2e-3", "bending_stiffness = 2e-9", "softer than a rod of jelly"),
    ("torsional_stiffness = 1.5e-3", "torsional_stiffness = 1.5", "found 750 times the bending stiffness"),
    ("torsional_stiffness = 1.5e-3", "torsional_stiffness = 1e-6", "found 0.0005 times the bending stiffness"),
    ("mass_per_length = 0.05", "mass_per_length = 50", "kg/m3 over the full circle, more than osmium"),
    ("mass_per_length = 0.05", "density = 7800000", "kg/m3 over the full circle, more than osmium"),
    ("mass_per_length = 0.05", "density = 0.5", "less than air"),
    ("mass_per_length = 0.05", "rest_curvature = [500, 0, 0]", "a radius below half the diameter"),
    ("gravity = [0, 0, -9.81]", "gravity = [0, 0, -9810]", "gravity: found 9810 m/s2, more than on Jupiter"),
    ("gravity = [0, 0, -9.81]", "gravity = [0, 0, 9.81]", "gravity: found 9.81 m/s2 along z, which is up"),
    ("to_deg = 20", "to_deg = 0", "bodies.flap.motion: found the same value at its begin and its end"),
    ("to_deg = 20", "to_deg = 7200", "found 7200 degrees, more than ten turns"),
    ("clearance = 0.004", "clearance = 4", "limits.clearance: found 4 m, more than the length of the longest cable"),
    ("bend_radius = 0.01", "bend_radius = 31", "limits.bend_radius: found 31 m, more than the length"),
]


@pytest.mark.parametrize(("old", "new", "words"), ODD)
def test_each_is_told_by_its_key(here, old, new, words):
    assert FLAP.count(old) == 1
    text = FLAP.replace(old, new)
    if old.startswith("diameter"):
        text = text.replace("bend_radius = 0.01\n", "")  # it would be below half the diameter
    found = doubts(read_problem(put(text)))
    assert any(words in line for line in found), found
    keys = tomllib.loads(text)
    for line in found:
        node = keys
        for key in line.partition(": ")[0].split("."):
            # a mass may be told by the key that was not given
            node = node.get(key, {}) if isinstance(node, dict) else node
        assert node != {} or line.startswith("cables.lead.mass_per_length")


SHIPPED = [file for file in sorted(PROBLEMS.glob("*/*.toml")) if "[vary]" not in file.read_text(encoding="utf-8")]


@pytest.mark.parametrize("file", SHIPPED, ids=lambda file: file.stem)
def test_nothing_is_odd_about_what_is_shipped(file):
    if file.parent.name == "robot_wrist" and not (file.parent / "meshes").is_dir():
        pytest.skip("its meshes come with the extra robots")
    problem = read_problem(file)
    assert doubts(problem) == () and load_scene(problem).warnings == ()


def test_nothing_is_odd_about_a_new_problem(here):
    assert doubts(read_problem(write_template(Path("mine")))) == ()


@pytest.mark.parametrize(("unit", "words"), [("m", "more than 100 times the longest cable"), ("mm", ""), ("in", "")])
def test_meshes_in_another_unit(here, unit, words):
    trimesh.creation.box((20, 30, 40)).export("box.stl")
    text = FLAP.replace("sphere = { radius = 0.02 }", f'mesh = "box.stl"\nmesh_unit = "{unit}"')
    warnings = load_scene(read_problem(put(text))).warnings
    assert bool(warnings) == bool(words)
    assert all(line.startswith("parts.ball.mesh_unit: ") and words in line for line in warnings)


def test_parts_that_are_too_small_to_be_meant(here):
    (line,) = load_scene(read_problem(put(FLAP.replace("radius = 0.02", "radius = 2e-5")))).warnings
    assert line.startswith("parts.ball.sphere: ") and "far less than the thinnest cable" in line


def test_parts_without_cables_are_compared_with_nothing():
    parts = {"ball": Part(Sphere(1e9))}
    alone = shipped("lift_arm").changed(cables={}, bodies={}, parts=parts, limits=Limits(clearance=1e9))
    assert load_scene(alone).warnings == () == doubts(alone)


def test_spans_that_are_too_short_to_be_meant():
    run = arm().cables["lead"]
    assert doubts(arm()) == ()
    for at, key, words in (
        (1e-9, "cables.lead.clips.elbow.at", "found 1.67e-07 diameters from start to elbow, too short"),
        (0.4, "cables.lead.clips.wrist.at", "found 3.33 diameters from elbow to wrist, too short"),
    ):
        clips = (dataclasses.replace(run.clips[0], at=at), run.clips[1])
        given = dataclasses.replace(run, clips=clips)
        (line,) = doubts(arm(cables={"lead": given}, design=FREE))
        assert line.startswith(f"{key}: {words}")


def test_it_is_told_once_and_is_no_mistake(here, capsys):
    odd = FLAP.replace("mass_per_length = 0.05", "mass_per_length = 0.5").replace("[parts.ball]", "[parts.ball]", 1)
    words = "more than osmium"
    file = put(odd)
    assert main(["check", file]) == 0
    out, err = capsys.readouterr()
    assert " ".join(out.split()).count(words) == 1 and words not in err
    assert main(["check", file, "--json"]) == 0
    assert sum(words in line for line in strict(capsys.readouterr().out)["warnings"]) == 1
    assert main(["simulate", file, *PLAIN]) in (0, 1)
    out, err = capsys.readouterr()
    assert (out.count(words), err.count(words)) == (0, 1)
    assert err.splitlines()[0].startswith("flap.toml: cables.lead.mass_per_length: ")
    assert sum(words in line for line in read_results("results/flap").summary["warnings"]) == 1
    assert main(["simulate", file, *PLAIN, "--quiet"]) in (0, 1)
    assert capsys.readouterr().err == ""
