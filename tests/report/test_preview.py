"""The scene as drawn, before anything is solved: one page, with what is suspicious marked."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh

import harness_opt as ho
from harness_opt.cli.commands import main
from harness_opt.files.read import read_problem
from harness_opt.model.plausibility import doubts
from harness_opt.parts.scene import load_scene
from harness_opt.report.preview import preview
from harness_opt.report.suspects import suspects
from oracles.browser import opened
from oracles.flap import FLAP, put
from oracles.problems import PROBLEMS

CLAMP = "position = [0, 0, 0], tangent = [0, 0, 1] }"
WALL = "\n[parts.wall]\nbox = { size = [0.1, 0.1, 0.04] }\nposition = [0, 0, -0.02]\n"


def data_of(page: str) -> dict:
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)[1])


def told(text: str) -> list[str]:
    problem = read_problem(put(text))
    return [found.words for found in suspects(problem, load_scene(problem))]


# --- what is suspicious --------------------------------------------------------------------------------


def test_a_plain_scene_has_nothing_suspicious(here):
    assert CLAMP in FLAP
    assert told(FLAP) == []
    assert told(FLAP + WALL) == [], "clamped on a wall, and out of it"


@pytest.mark.parametrize("file", sorted(PROBLEMS.rglob("*.toml")), ids=lambda file: file.stem)
def test_shipped_problems_have_nothing_suspicious(file):
    if "[vary]" in file.read_text(encoding="utf-8") or file.stem == "robot_wrist":
        pytest.skip("a study, or with meshes that an extra brings")
    problem = read_problem(file)
    assert suspects(problem, load_scene(problem)) == []


def test_a_tangent_that_points_into_its_wall(here):
    (words,) = told(FLAP.replace(CLAMP, CLAMP.replace("[0, 0, 1]", "[0, 0, -1]")) + WALL)
    assert words.startswith("cables.lead.start.tangent: found the cable ")
    assert "still inside wall, which holds it; the other way it would come out" in words


def test_a_clamp_in_a_part_that_does_not_hold_it(here):
    loose = FLAP.replace(CLAMP, CLAMP.replace(" }", ", holders = [] }"))
    (words,) = told(loose + WALL.replace("-0.02]", "-0.01]"))
    assert words == ("cables.lead.start.position: found 10 mm deep in wall, which does not hold it, at 0.0 deg, 0.0 %")


def test_a_length_in_millimetres_is_said(here):
    problem = read_problem(put(FLAP.replace("length = 0.3\n", "length = 300\n")))
    assert any("lengths are in metres" in words for words in doubts(problem))
    assert not any("lengths are in metres" in words for words in doubts(read_problem(put(FLAP, "fine.toml"))))


# --- check ---------------------------------------------------------------------------------------------


def test_check_says_where_the_design_stands_and_what_turns_about_what(here, capsys):
    turning = '"lead.end.rotate_y_deg" = [-30, 30]\n"lead.start.rotate_z_deg" = [10, 20]\n'
    assert main(["check", put(FLAP.replace("[design.variables]\n", f"[design.variables]\n{turning}"))]) == 0
    words = " ".join(capsys.readouterr().out.split())
    assert "lead.length: 0.3 m now, within [0.25, 0.45]" in words
    # d2 of a clamp whose d3 is -z and whose d1 is x: d3 x d1
    assert "lead.end.rotate_y_deg: 0 deg now, within [-30, 30], about (0, -1, 0) of flap" in words
    outside = "within [10, 20]: outside, so it begins at the nearest, about (0, 0, 1)"
    assert f"lead.start.rotate_z_deg: 0 deg now, {outside}" in words
    assert re.search(r"slack .* least at -?\d+\.\d deg, \d+\.\d %", words)


def test_a_study_is_not_simulated(capsys):
    file = PROBLEMS / "lift_arm" / "tolerances.toml"
    for command in ("check", "simulate", "redesign", "preview"):
        assert main([command, str(file)]) == 2
        expected = f"{file}: found a study, expected a problem file; a study is run by: harness-opt study {file}\n"
        assert capsys.readouterr().err == expected


# --- the page ------------------------------------------------------------------------------------------


def test_the_page_has_parts_clamps_and_the_motion_in_its_own_unit(here):
    problem = read_problem(put(FLAP))
    data = data_of(preview(problem, load_scene(problem)))
    (scene,) = data["scenes"]
    assert [clamp["name"] for clamp in scene["clamps"]] == ["lead start", "lead end"]
    assert scene["ghosts"] == [0, len(data["motion"]) - 1], "the bodies at both ends"
    assert data["path"]["ways"] == [{"body": "flap", "unit": "deg", "start": 0.0, "stop": pytest.approx(20.0)}]
    assert scene["cables"] == []
    hold = np.array(data["view"]["hold"])
    box = load_scene(problem).parts["ball"]
    assert np.all(hold.min(axis=0) <= box.lower + 1e-3) and np.all(hold.max(axis=0) >= box.upper - 1e-3)


def test_the_command_writes_one_page_and_nothing_else(here, capsys):
    assert main(["preview", put(FLAP)]) == 0
    out, err = capsys.readouterr()
    assert out.startswith(f"results{os.sep}flap_preview.html\n") and err == ""
    assert os.listdir("results") == ["flap_preview.html"]
    assert main(["preview", "flap.toml", "-o", "flap.toml"]) == 2
    assert "expected one that ends in .html" in capsys.readouterr().err
    assert Path("flap.toml").read_text() == FLAP
    assert main(["preview", put("cables = 1", "bad.toml"), "-o", "bad.html"]) == 2
    assert not Path("bad.html").exists()


def test_a_mesh_a_thousand_times_too_large_is_marked(here, capsys):
    trimesh.creation.icosphere(radius=20).export("ball.stl")
    mesh = FLAP.replace("sphere = { radius = 0.02 }", 'mesh = "ball.stl"\nmesh_unit = "m"')
    assert main(["preview", put(mesh), "-o", "page.html"]) == 0
    assert "parts.ball.mesh_unit: the part is " in capsys.readouterr().err
    page = Path("page.html").read_text(encoding="utf-8")
    assert [part["odd"] for part in data_of(page)["parts"]] == [True]
    assert "ball (look)" in page


@pytest.mark.parametrize("width", [1280, 400])
def test_the_page_in_a_browser(here, width):
    problem = read_problem(put(FLAP.replace(CLAMP, CLAMP.replace("[0, 0, 1]", "[0, 0, -1], roll_deg = 20")) + WALL))
    file = here / "page.html"
    file.write_text(preview(problem, load_scene(problem)), encoding="utf-8")
    with opened(file) as view:
        view.page.set_viewport_size({"width": width, "height": 800})
        view.settle()
        assert view.page.evaluate("document.documentElement.scrollWidth") <= width
        assert view.pixels()["vivid"] > 100, "arrows are coloured"
        assert "lead start" in view.page.locator("#labels .odd").all_inner_texts()
        assert "0.0 deg, 0.0 %" in view.page.inner_text("#moment")
        seen = view.page.evaluate("document.querySelector('#canvas').toDataURL()")
        view.slide(1.0)
        assert "20.0 deg, 100.0 %" in view.page.inner_text("#moment")
        assert view.page.evaluate("document.querySelector('#canvas').toDataURL()") != seen
        view.choose("[data-look=near]")
        assert view.said == [] and view.asked == [file.as_uri()]


def test_a_scene_without_motion_parts_or_directions_has_a_page(here):
    still = ho.Problem(
        cables={"lead": ho.CableRun(ho.Cable(0.3, 0.005, 2e-3, 1.5e-3), ho.End(position=(0, 0, 0)), ho.End())}
    )
    data = data_of(preview(still, load_scene(still)))
    assert [clamp["tangent"] for clamp in data["scenes"][0]["clamps"]] == [False] and data["motion"] == [0.0]
