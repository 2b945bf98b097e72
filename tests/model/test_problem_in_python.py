"""A Problem made in Python is checked as a file is: every mistake at once, by the same keys, in the same words."""

from __future__ import annotations

import dataclasses
import re
import tomllib

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.files.read import read_problem
from oracles.flap import FLAP, put
from oracles.in_python import mistakes_in_python
from oracles.mistakes import BETWEEN, NUMBERS, STRUCTURE
from oracles.problem_files import changed, mistakes, written
from oracles.report_scene import flap

LEAD = flap().cables["lead"]
VARIABLE = '"lead.length" = [0.25, 0.45]'
START = "start = { "


def ends(**changes: object) -> dict:
    return {"cables": {"lead": dataclasses.replace(LEAD, start=dataclasses.replace(LEAD.start, **changes))}}


def varied(*variables: ho.Variable, **more: object) -> dict:
    return {"design": ho.Design(variables=variables, **more)}  # type: ignore[arg-type]


LENGTH = ho.Variable("lead.length", 0.25, 0.45)
# what is wrong in Python, and the same in the file
SAME = [
    (ends(body="flop"), (START, f'{START}body = "flop", ')),
    ({"parts": {"ball": ho.Part(ho.Sphere(0.02), body="wrold")}}, ("[parts.ball]\n", '[parts.ball]\nbody = "wrold"\n')),
    ({"gravity": (0, -9.81)}, ("gravity = [0, 0, -9.81]", "gravity = [0, -9.81]")),
    ({"duration": 0}, ("[motion]\n", "[motion]\nduration = 0\n")),
    ({"spatial_step": -0.01}, ("spatial_step = 0.01", "spatial_step = -0.01")),
    ({"limits": ho.Limits(clearance=-0.004)}, ("clearance = 0.004", "clearance = -0.004")),
    ({"limits": ho.Limits(bend_radius=0)}, ("bend_radius = 0.01", "bend_radius = 0")),
    ({"limits": ho.Limits(bend_radius=0.001)}, ("bend_radius = 0.01", "bend_radius = 0.001")),
    ({"limits": ho.Limits(clamp_force=float("nan"))}, ("[limits]\n", "[limits]\nclamp_force = nan\n")),
    ({"parts": {"ball": ho.Part(ho.Sphere(-1))}}, ("sphere = { radius = 0.02 }", "sphere = { radius = -1 }")),
    ({"parts": {"ball": ho.Part(ho.Sphere(1), clearance=-1)}}, ("[parts.ball]\n", "[parts.ball]\nclearance = -1\n")),
    (varied(ho.Variable("lead.lenght", 0.2, 0.4)), (VARIABLE, '"lead.lenght" = [0.2, 0.4]')),
    (varied(ho.Variable("lead.length", 0.4, 0.2)), (VARIABLE, '"lead.length" = [0.4, 0.2]')),
    (varied(ho.Variable("lead.length", -0.4, 0.2)), (VARIABLE, '"lead.length" = [-0.4, 0.2]')),
    (
        varied(LENGTH, couplings=(ho.Coupling("lead.start.position.z", "lead.start.position.x"),)),
        (VARIABLE, f'{VARIABLE}\n"lead.start.position.z" = "= lead.start.position.x"'),
    ),
    (
        varied(LENGTH, weights={"lead.start.position.x": 2.0}),
        ("[design.variables]", '[design.weights]\n"lead.start.position.x" = 2.0\n[design.variables]'),
    ),
    (varied(LENGTH, minimise="lenght"), ("[design.variables]", '[design]\nminimise = "lenght"\n\n[design.variables]')),
    ({"bodies": {**flap().bodies, "world": ho.Body()}}, ("[motion]\n", "[bodies.world]\n[motion]\n")),
]


@pytest.mark.parametrize(("given", "typed"), SAME, ids=[typed[1].strip()[:40] for _, typed in SAME])
def test_the_words_are_those_of_files(here, given, typed):
    assert typed[0] in FLAP
    with pytest.raises(ho.ProblemError) as of_file:
        read_problem(put(FLAP.replace(typed[0], typed[1], 1)))
    with pytest.raises(ho.ProblemError) as of_python:
        flap(**given)
    assert set(of_python.value.mistakes) == {line.removeprefix("flap.toml: ") for line in of_file.value.mistakes}


# what only a file can have: its format, keys by other names, and two words for one thing
NO_CALL = ("unknown key", "found nothing", "no shape", "a table", "[lower, upper]", "one of 'hinge'")
UNREAD = ("no such file", "an empty file", "null character")
OF_FILES = ("schema", "density", "deg_per_m", "from_deg", "mass_per_length")


@pytest.mark.parametrize(("old", "new"), dict.fromkeys((old, new) for old, new, _ in (*NUMBERS, *STRUCTURE, *BETWEEN)))
def test_every_mistake_of_files_has_the_same_words_in_python(folder, old, new):
    """The file's tables are given to Python as they are; what Python has no call for at all is left out."""
    if any(key in old for key in OF_FILES) or ("mesh" in new and "sphere" in new):
        pytest.skip("no such thing in Python")
    text = changed((old, new))
    of_file = {line.partition(" (paths start at")[0] for line in mistakes(written(folder, text))}
    try:
        of_python = mistakes_in_python(tomllib.loads(text))
    except (TypeError, KeyError, ValueError):
        assert any(word in " ".join(of_file) for word in NO_CALL)
        return
    if not of_python and any(word in " ".join(of_file) for word in UNREAD):
        return  # files are looked at when they are read
    assert of_python and set(of_python) <= of_file


def test_files_that_are_not_there_are_named_when_they_are_read(folder, monkeypatch):
    monkeypatch.chdir(folder)
    motion = ho.simulate(flap(), frames=[0.0, 1.0])
    for name, words in (("hosing.stl", "no such file (did you mean 'housing.stl'?)"), ("empty.stl", "an empty file")):
        file = f"meshes/{name}"
        problem = flap(parts={"ball": ho.Part(ho.MeshFile(file, "mm"))})
        with pytest.raises(ho.ProblemError) as error:
            ho.clearances(dataclasses.replace(motion, problem=problem))
        assert error.value.mistakes == (f'parts.ball.mesh: found "{file}", {words}, expected a mesh',)


def test_bounds_that_are_no_numbers_are_named():
    for lower in ("0.2", None, float("nan"), True):
        with pytest.raises(ho.ProblemError, match=r'design.variables."lead.length": found \[.*, 0.4\], expected \['):
            flap(**varied(ho.Variable("lead.length", lower, 0.4)))  # type: ignore[arg-type]


def test_every_mistake_at_once():
    with pytest.raises(ho.ProblemError) as error:
        flap(**ends(body="flop"), gravity=(1, 2), limits=ho.Limits(clearance=-1, clamp_force=0))
    keys = {line.partition(": ")[0] for line in error.value.mistakes}
    assert keys == {"cables.lead.start.body", "gravity", "limits.clearance", "limits.clamp_force"}


def test_every_mistake_of_a_cable_and_of_an_end():
    with pytest.raises(ho.ProblemError) as error:
        ho.Cable(length=-1, diameter="thin", bending_stiffness=(1, -2), torsional_stiffness=True)  # type: ignore[arg-type]
    assert [line.partition(": ")[0] for line in error.value.mistakes] == [
        "length", "diameter", "torsional_stiffness", "bending_stiffness",
    ]  # fmt: skip
    assert 'diameter: found "thin", expected a number above 0' in error.value.mistakes
    with pytest.raises(ho.ProblemError) as error:
        ho.End(position=(0, 0), force=(0, 0, 1), quaternion=(1, 1, 0, 0), tangent=(0, 0, 0))
    assert len(error.value.mistakes) == 5


def test_a_cable_too_short_for_its_clamps_is_named():
    short = dataclasses.replace(LEAD, cable=dataclasses.replace(LEAD.cable, length=0.1))
    with pytest.raises(ho.ProblemError, match=r"cables\.lead\.length: found 0\.1, expected at least 0\.15"):
        flap(cables={"lead": short})
    assert flap(cables={"lead": short}, **varied(LENGTH)), "it may become longer"


def test_what_is_of_another_kind_is_said():
    with pytest.raises(ho.ProblemError, match=r"cables\.lead: found Cable, expected CableRun: a cable with"):
        ho.Problem({"lead": LEAD.cable})  # type: ignore[dict-item]
    with pytest.raises(ho.ProblemError, match="cables: found list, expected CableRuns by name"):
        ho.Problem([LEAD])  # type: ignore[arg-type]
    with pytest.raises(ho.ProblemError, match="cables: found an empty table, expected at least one cable"):
        ho.Problem({})


@pytest.mark.parametrize("call", [ho.simulate, ho.redesign])
def test_a_path_in_the_place_of_a_problem(call, tmp_path):
    words = r"problem: found the path 'x.toml', expected a Problem: harness_opt.read_problem\('x.toml'\)"
    with pytest.raises(ho.ProblemError, match=words):
        call("x.toml")
    with pytest.raises(ho.ProblemError, match="expected a Problem"):
        call(tmp_path)
    with pytest.raises(ho.ProblemError, match="problem: found int, expected a Problem"):
        call(3)


def test_results_print_as_one_line():
    problem = flap(**varied(LENGTH))
    moved = ho.simulate(problem, frames=[0.0, 0.5, 1.0])
    found = ho.clearances(moved)
    design = ho.redesign(problem)
    run = problem.cables["lead"]
    shape = ho.equilibrium(run.cable, run.start, dataclasses.replace(run.end, body="world"))
    for thing, begin in (
        (problem, "<Problem: 'A flap', cables lead; moving bodies flap; 1 parts>"),
        (moved, "<Motion: 3 frames of lead; solved>"),
        (found, "<Clearances: 2 pairs in 3 frames; smallest "),
        (design, "<Redesign: all limits hold; "),
        (shape, "<Shape: 300 mm at "),
    ):
        assert repr(thing).startswith(begin)
        assert "\n" not in repr(thing) and len(repr(thing)) < 200


def test_a_notebook_shows_verdict_limits_and_a_picture():
    moved = ho.simulate(flap(title="<b>"), frames=[0.0, 0.5, 1.0])
    page = moved._repr_html_()
    assert "All limits hold" in page and "&lt;b&gt;" in page and "<b><b>" not in page
    assert page.count("<tr>") == 1 + 6, "a head and six limits"
    lines = re.findall(r"polyline points='([^']*)'", page)
    assert len(lines) == 3, "a line a frame"
    points = np.array([[float(x) for x in pair.split(",")] for line in lines for pair in line.split()])
    assert points.min() >= 0 and points[:, 0].max() <= 320 and points[:, 1].max() <= 200
    assert "redesigned" not in ho.redesign(flap(**varied(LENGTH)))._repr_html_()


def test_the_names_of_the_package_are_the_public_ones():
    assert not [name for name in dir(ho) if name.startswith("_") or name in ("cli", "model", "files", "lazy_loader")]
    assert set(dir(ho)) == set(ho.__all__)
    for name in dir(ho):
        assert getattr(ho, name).__doc__, name


def test_arrays_have_the_shapes_that_are_promised():
    """The contract's shapes: P frames, N stations."""
    moved = ho.simulate(flap(), frames=[0.0, 0.5, 1.0])
    shapes = moved.cables["lead"]
    frames, stations = 3, len(shapes.s)
    promised = {
        "s": (stations,), "position": (frames, stations, 3), "quaternion": (frames, stations, 4),
        "curvature": (frames, stations, 3), "force": (frames, stations, 3), "moment": (frames, stations, 3),
        "stable": (frames,), "stability_margin": (frames,), "residual": (frames,), "estimated_error": (frames,),
    }  # fmt: skip
    assert {name: getattr(shapes, name).shape for name in promised} == promised
    assert moved.motion.shape == (frames,)
    run = moved.problem.cables["lead"]
    shape = ho.equilibrium(run.cable, run.start, dataclasses.replace(run.end, body="world"))
    n = len(shape.s)
    of_shape = {name: (n, 3) for name in ("position", "curvature", "force", "moment")}
    of_shape |= {"s": (n,), "quaternion": (n, 4)}
    assert {name: getattr(shape, name).shape for name in of_shape} == of_shape
    there = shape.at([0.0, 0.1])
    assert {name: getattr(there, name).shape for name in of_shape} == {
        name: (2, *size[1:]) for name, size in of_shape.items()
    }
