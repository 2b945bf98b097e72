"""Derivatives of margins by any key of a problem, against differences of whole simulations; their ranking."""

from __future__ import annotations

import csv
import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.clearance.measure import measure
from harness_opt.clearance.witnesses import Witnesses
from harness_opt.cli.commands import main
from harness_opt.design.key_derivatives import key_scale, linear, usual
from harness_opt.design.margins import Passing, second_order
from harness_opt.design.robustness import smallest
from harness_opt.errors import ProblemError
from harness_opt.files.quantities import quantities_of
from harness_opt.files.quantity_keys import differentiable
from harness_opt.model.limits import LimitId, LimitKind, Obstacle
from harness_opt.model.problem import Problem
from harness_opt.model.results import CableMotion
from harness_opt.parts.primitives import Primitive
from harness_opt.parts.scene import load_scene
from harness_opt.studies import ranking
from harness_opt.studies.ranking import ranked, step_of, tightest, worst_margin
from oracles.clipped import arm
from oracles.flap import put, strict
from oracles.studies import STUDY, placed

HANGING = """\
schema = 1
[cables.lead]
length = 0.3
diameter = 0.005
bending_stiffness = 2e-3
torsional_stiffness = 1.5e-3
mass_per_length = 0.05
start = { body = "flap", position = [0, 0, 0], tangent = [0, 0, 1] }
end = { force = [0, 0, 0], moment = [0, 0, 0] }
[bodies.flap.motion]
kind = "hinge"
point = [0.1, 0, 0]
axis = [0, 0, 1]
from_deg = 0
to_deg = 60
[motion]
spatial_step = 0.01
[limits]
bend_radius = 0.02
"""  # weightless, so straight

SCENE = """\
schema = 1
title = "Two cables, skew"
gravity = [0.4, -0.3, -9.81]

[cables.lead]
length = 0.3
diameter = 0.005
bending_stiffness = [2e-3, 2.6e-3]
torsional_stiffness = 1.5e-3
mass_per_length = 0.05
rest_curvature = [0.3, 0.2, 0.5]
start = { position = [0, 0.01, 0], tangent = [0.2, 0.1, 1], roll_deg = 20 }
end = { body = "flap", position = [0.15, 0.03, 0.01], tangent = [0.1, 0.2, -1], roll_deg = 170 }

[cables.tail]
length = 0.2
diameter = 0.004
bending_stiffness = 1e-3
torsional_stiffness = 1e-3
density = 3000
start = { body = "flap", position = [0.15, -0.02, 0.02], tangent = [1, 0.3, 0.4] }
end = { force = [0.02, 0.01, -0.05] }

[bodies.flap.motion]
kind = "hinge"
point = [0.2, 0.01, 0.02]
axis = [0.1, 1, 0.05]
from_deg = 0
to_deg = 20

[motion]
spatial_step = 0.025

[parts.ball]
sphere = { radius = 0.02 }
position = [0.08, 0.03, 0.07]

[parts.rod]
body = "flap"
capsule = { radius = 0.01, length = 0.1 }
position = [0.3, -0.04, -0.03]
quaternion = [0.7071067811865476, 0.7071067811865475, 0, 0]

[limits]
clearance = 0.004
bend_radius = 0.01
twist_deg_per_m = 500
clamp_force = 5
clamp_moment = 0.5
"""
# of a central difference of whole simulations: their own steps and the tolerance of clearances show from here on
AGREE = 1e-3
# one key of every kind
COMPARED = [
    "gravity.x", "cables.lead.length", "cables.tail.length", "cables.lead.diameter", "cables.lead.bending_stiffness.0",
    "cables.lead.torsional_stiffness", "cables.lead.mass_per_length", "cables.tail.density",
    "cables.lead.rest_curvature.y", "cables.lead.start.position.x", "cables.lead.end.position.y",
    "cables.lead.start.tangent.x", "cables.lead.end.roll_deg", "cables.tail.end.force.z", "bodies.flap.motion.point.x",
    "bodies.flap.motion.axis.x", "bodies.flap.motion.to_deg", "parts.ball.position.z", "parts.rod.position.x",
    "parts.rod.quaternion.y", "cables.lead.stiffness_percent", "cables.lead.weight_percent",
    "cables.lead.start.rotate_x_deg", "cables.lead.end.rotate_z_deg", "parts.rod.rotate_y_deg",
]  # fmt: skip

BALL = LimitId(LimitKind.CLEARANCE, "lead", Obstacle("ball"))


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """The quantities of the scene, all keys that have a derivative, and what :func:`linear` says of them."""
    file = tmp_path_factory.mktemp("scene") / "scene.toml"
    file.write_text(SCENE)
    quantities = quantities_of(file)
    keys = [key for key in quantities if differentiable(quantities[key])]
    return quantities, keys, linear(quantities, keys, load_scene(quantities.problem({})))


def margins(problem: Problem, frames: np.ndarray) -> dict[str, np.ndarray]:
    """Return the scaled margins (P,) of every limit and frame, from a simulation of its own."""
    motion = ho.simulate(problem, frames=frames, tolerance=1e-10)
    found = {}
    for pair in measure(problem, load_scene(problem), frames, motion.cables).pairs:
        scale = pair.limit + 0.5 * {"lead": 0.005, "tail": 0.004}[pair.cable]
        found[pair.id] = (pair.clearance - pair.limit) / scale
    limits = problem.limits
    for name, shapes in motion.cables.items():
        bending, twist = np.linalg.norm(shapes.curvature[..., :2], axis=-1), np.abs(shapes.curvature[..., 2])
        found[LimitId(LimitKind.BEND_RADIUS, name)] = 1 - bending.max(axis=1) * limits.bend_radius
        found[LimitId(LimitKind.TWIST, name)] = 1 - twist.max(axis=1) / limits.twist
        for kind, load in (("force", shapes.force), ("moment", shapes.moment)):
            size = np.linalg.norm(load[:, [0, -1]], axis=-1).max(axis=1)
            found[LimitId(LimitKind(f"clamp_{kind}"), name)] = 1 - size / getattr(limits, f"clamp_{kind}")
    return found


def test_keys_of_every_kind_against_differences_of_simulations(scene):
    quantities, keys, found = scene
    problem, frames = quantities.problem({}), found.motion.motion
    base = margins(problem, frames)
    assert set(found.limits) == set(base)
    assert len(keys) > 60
    worst = {name: int(np.argmin(values)) for name, values in base.items()}
    wrong = []
    for key in COMPARED:
        j = keys.index(key)
        size = key_scale(quantities[key], problem)
        step = 2e-4 * size if quantities[key].unit != "deg" else 0.02
        both = [margins(quantities.problem({key: quantities[key].value + s * step}), frames) for s in (1, -1)]
        for name, frame in worst.items():
            slope = (both[0][name][frame] - both[1][name][frame]) / (2 * step)
            mine = found.rate[found.worst(name), j]
            if abs(mine - slope) * size > AGREE * (1 + abs(slope) * size):
                wrong.append((key, name, mine, slope))
    assert not wrong


def test_margins_are_those_of_the_simulation(scene):
    _, _, found = scene
    base = margins(found.motion.problem, found.motion.motion)
    for name in found.limits:
        assert found.margin[found.worst(name)] == pytest.approx(np.min(base[name]), abs=1e-6)


def test_a_straight_cable_passing_a_ball():
    """The distance of a line to a ball is of second order across the line, round the ball's middle, and not along."""
    s = np.linspace(0, 1, 101)
    along_x = np.array([np.sqrt(0.5), 0, np.sqrt(0.5), 0])  # d3 along x
    line = np.stack([s - 0.5, np.zeros(101), np.full(101, 0.05)], axis=-1)
    nothing = np.zeros((1, 101, 3))
    shapes = CableMotion(
        s, line[None], np.broadcast_to(along_x, (1, 101, 4)), nothing, nothing, nothing, *[np.zeros(1)] * 4
    )
    ball = Primitive.of("ball", "world", ho.Sphere(0.02), (0.0, 0, 0), (1.0, 0, 0, 0))
    found = Witnesses(*(np.array(v) for v in ([0], [0.5], [0.03], [[0.0, 0, 1]], [[0, 0, 0.02]], [np.nan])))
    rates = np.broadcast_to(np.eye(3), (1, 101, 3, 3))
    pose = np.zeros((1, 3)), np.array([[1.0, 0, 0, 0]])
    for still, across in ((False, [0, 20, 0]), (True, [20, 20, 0])):
        passing = Passing(found, np.eye(3)[None], rates, np.array([still]))
        assert second_order(passing, shapes, ball, pose)[0] == pytest.approx(np.diag(across), abs=0.15)


def test_what_is_of_second_order_brings_margins_nearer(scene):
    """Margins to the ball at once along and across, against simulations: the rest is an order smaller."""
    quantities, _, _ = scene
    chosen = ["parts.ball.position.x", "parts.ball.position.y", "cables.lead.length", "cables.lead.start.rotate_x_deg"]
    found = linear(quantities, chosen, load_scene(quantities.problem({})))
    frames, name = found.motion.motion, BALL
    given = np.array([quantities[key].value for key in chosen])
    deviations = np.array([[0.004, -0.006, 0.004, 3.0], [-0.006, 0.004, -0.004, 2.0], [0.006, 0.006, 0.002, -3.0]])
    flat = dataclasses.replace(found, second=np.zeros_like(found.second))
    errors = []
    for each in deviations:
        problem = quantities.problem(dict(zip(chosen, (given + each).tolist(), strict=True)))
        true = margins(problem, frames)[name].min()
        row = found.limits.index(name)
        errors.append([abs(smallest(one, each[None])[row, 0] - true) for one in (flat, found)])
    without, with_ = np.mean(errors, axis=0)
    assert with_ < 0.5 * without


def test_steps_and_units(scene):
    """A part pushed along the normal takes its clearance away, millimetre by millimetre."""
    quantities, _, found = scene
    name = BALL
    pair = next(pair for pair in found.clearances.pairs if (pair.cable, pair.obstacle.key) == ("lead", "ball"))
    normal = pair.place.normal[0]
    effects = {effect.key: effect for effect in ranked(found, name)}
    for letter, component in zip("xyz", normal, strict=True):
        effect = effects[f"parts.ball.position.{letter}"]
        assert effect.step == "mm"
        assert effect.per_step == pytest.approx(-1e-3 * component, abs=1e-8)
    assert worst_margin(found, name) == pytest.approx(pair.worst - pair.limit)
    assert step_of(quantities["cables.lead.start.rotate_x_deg"]) == ("deg", 1.0)
    assert step_of(quantities["cables.lead.torsional_stiffness"]) == ("%", pytest.approx(1.5e-5))
    sizes = [effect.size for effect in ranked(found, name)]
    assert sizes == sorted(sizes, reverse=True)


def test_a_thicker_cable_bends_and_comes_nearer(scene):
    """Other units: a bend radius in m and a twist in deg/m, by one per cent of stiffness, against simulations."""
    quantities, _, found = scene
    frames = found.motion.motion
    for name, value in ((LimitId(LimitKind.BEND_RADIUS, "lead"), "bend"), (LimitId(LimitKind.TWIST, "lead"), "twist")):
        effect = {e.key: e for e in ranked(found, name)}["cables.lead.torsional_stiffness"]
        both = []
        for factor in (1.001, 0.999):
            motion = ho.simulate(quantities.problem({effect.key: factor * 1.5e-3}), frames=frames, tolerance=1e-10)
            curvature = motion.cables["lead"].curvature
            bend = 1 / np.linalg.norm(curvature[..., :2], axis=-1).max()
            both.append(bend if value == "bend" else -np.degrees(np.abs(curvature[..., 2]).max()))
        assert effect.per_step == pytest.approx((both[0] - both[1]) / 0.2, rel=2e-3)


@pytest.mark.parametrize(
    "key", ["parts.ball.sphere.radius", "limits.clearance", "motion.duration", "cables.lead.end.turns"]
)
def test_keys_without_a_derivative(scene, key):
    quantities = scene[0]
    assert not differentiable(quantities[key])
    with pytest.raises(ProblemError, match=f"{key}: found no derivative by it"):
        linear(quantities, [key], load_scene(quantities.problem({})))


def test_usual_keys(scene):
    keys = list(usual(scene[0]))
    assert {"cables.lead.length", "cables.tail.weight_percent", "parts.rod.position.x"} < set(keys)
    assert all(differentiable(scene[0][key]) for key in keys)
    assert tightest(scene[2]).kind is LimitKind.CLEARANCE


def test_what_a_cable_never_comes_near_is_not_the_tightest(tmp_path):
    """A short way along the cable is near in space at any shape: it is not what stands in the way."""
    file = ho.write_problem(arm(spatial_step=0.1), tmp_path / "arm.toml")
    quantities = quantities_of(file)
    found = linear(quantities, ["cables.lead.length"], load_scene(quantities.problem({})))
    itself = LimitId(LimitKind.CLEARANCE, "lead", Obstacle("lead", is_cable=True))
    post = LimitId(LimitKind.CLEARANCE, "lead", Obstacle("post"))
    assert found.margin[found.worst(itself)] < found.margin[found.worst(post)], "by the arc that is left out"
    assert tightest(found) == post
    assert worst_margin(found, post) == pytest.approx(ho.clearances(found.motion).limits[0].margin, abs=1e-4)


# --- the command ----------------------------------------------------------------------------------------


def test_the_command_on_a_problem(here, capsys):
    pytest.importorskip("matplotlib")
    put(SCENE, "scene.toml")
    assert main(["sensitivity", "scene.toml"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("Clearance of ") and "mm per" in out
    folder = Path("results/scene_sensitivity")
    assert sorted(file.name for file in folder.iterdir()) == ["sensitivity.csv", "tornado.png"]
    assert (folder / "tornado.png").read_bytes().startswith(b"\x89PNG")
    with (folder / "sensitivity.csv").open(newline="") as file:
        table = list(csv.DictReader(file))
    assert {"key", "per", "clearance.lead.ball", "twist_deg_per_m.tail"} < set(table[0])
    assert main(["sensitivity", "scene.toml"]) == 0, "again, in the same place"


def test_the_command_on_a_study(here, capsys):
    file = placed(here, STUDY.replace("{ plus_minus = 0.01 }", "{ nominal = 0.302, plus_minus = 0.01 }"))
    assert main(["sensitivity", str(file), "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    tolerances = {effect["key"]: effect["tolerance"] for effect in content["effects"]}
    assert tolerances == pytest.approx(
        {"cables.lead.length": 10.0, "cables.lead.stiffness_percent": 30.0, "parts.ball.position.y": 8.0}
    )
    assert content["unit"] == "mm"


def test_a_straight_cable_has_a_bend_radius_to_speak_of(here, capsys):
    put(HANGING, "straight.toml")
    assert main(["sensitivity", "straight.toml", "--json"]) == 0
    content = strict(capsys.readouterr().out)
    assert content["limit"] == "bend radius of lead" and content["effects"]
    text = Path("results/straight_sensitivity/sensitivity.csv").read_text()
    assert "nan" not in text and "inf" not in text


def test_what_is_no_number_is_null_and_an_empty_cell(here, capsys, monkeypatch):
    monkeypatch.setattr(ranking, "ranked", lambda *given: _spoilt(ranked(*given)))
    put(SCENE, "scene.toml")
    assert main(["sensitivity", "scene.toml", "--json"]) == 0
    effects = strict(capsys.readouterr().out)["effects"]
    assert effects[0]["per_step"] is None and effects[1]["per_step"] is not None
    with Path("results/scene_sensitivity/sensitivity.csv").open(newline="") as file:
        cells = [cell for row in csv.reader(file) for cell in row]
    assert "nan" not in cells


def _spoilt(effects):
    return [dataclasses.replace(effects[0], per_step=math.nan), *effects[1:]]


def test_without_matplotlib_there_is_a_table(here, capsys, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    file = placed(here)
    assert main(["sensitivity", str(file)]) == 0
    assert "Chart left out" in capsys.readouterr().err
    assert Path("results/study_sensitivity/sensitivity.csv").exists()


@pytest.mark.parametrize(
    ("spread", "words"),
    [
        ('"cables.lead.lenght" = { plus_minus = 1 }', "did you mean 'cables.lead.length'"),
        ('"cables.lead.end.body" = ["world"]', "found no distribution of a number"),
    ],
)
def test_bad_studies(here, capsys, spread, words):
    file = placed(here, STUDY[: STUDY.index("[vary]")] + f"[vary]\n{spread}\n")
    assert main(["sensitivity", str(file)]) == 2
    assert words in capsys.readouterr().err
