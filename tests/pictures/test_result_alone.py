"""A result folder is enough to show and to export it, and all that is read: no link leads out of it."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh

import harness_opt as ho
from harness_opt.cli.commands import main
from harness_opt.errors import HarnessError
from harness_opt.files.stored_results import read_motion
from harness_opt.parts.scene import load_scene
from oracles.flap import FLAP, HIT, PLAIN, put

MESHED = FLAP.replace("sphere = { radius = 0.02 }", 'mesh = "ball.stl"\nmesh_unit = "mm"\nquaternion = [0, 1, 0, 0]')
POSED = MESHED.replace(
    'kind = "hinge"\npoint = [0.2, 0, 0]\naxis = [0, 1, 0]\nfrom_deg = 0\nto_deg = 20',
    'kind = "poses"\nfile = "flap.csv"',
)  # fmt: skip
links = pytest.mark.skipif(os.name == "nt", reason="links need rights there")


def solved(here: Path, text: str = POSED, command: str = "simulate") -> Path:
    """Return a result whose problem, mesh and table of poses are gone."""
    trimesh.creation.icosphere(subdivisions=3, radius=20).export("ball.stl")
    rows = "\n".join(f"{t},0,0,{0.01 * t},1,0,0,0" for t in range(4))
    Path("flap.csv").write_text(f"t,x,y,z,qw,qx,qy,qz\n{rows}\n")
    assert main([command, put(text), *PLAIN, "-q", "-o", "out/result"]) in (0, 1)
    for name in ("ball.stl", "flap.csv", "flap.toml"):
        Path(name).unlink()
    return here / "out" / "result"


def test_a_result_is_exported_where_nothing_else_is_left(here, capsys):
    result = solved(here)
    assert main(["export", str(result), "--to", "csv", "--to", "gltf", "--to", "stl"]) == 0
    elsewhere = here / "moved"
    shutil.move(result, elsewhere)
    shutil.rmtree(here / "out")
    assert main(["export", str(elsewhere), "--to", "csv"]) == 0
    assert "Traceback" not in capsys.readouterr().err


def test_the_geometry_is_that_which_was_used_to_the_last_digit(here):
    trimesh.creation.annulus(15.1, 40.3, 25.7, sections=48).export("ball.stl")
    problem = ho.read_problem(put(MESHED))
    before = load_scene(problem).parts["ball"]
    motion = ho.simulate(problem)
    ho.write_results(motion, "out")
    margins = [pair.worst for pair in ho.clearances(motion).pairs]
    Path("ball.stl").unlink()
    again, _, _ = read_motion("out")
    after = load_scene(again.problem).parts["ball"]
    key = sorted(map(tuple, before.vertices[before.faces].reshape(-1, 9).tolist()))
    assert key == sorted(map(tuple, after.vertices[after.faces].reshape(-1, 9).tolist()))
    assert (after.closed, after.body) == (before.closed, before.body)
    assert [pair.worst for pair in ho.clearances(again).pairs] == pytest.approx(margins, abs=1e-12)


def test_a_redesign_carries_both_designs(here):
    result = solved(here, HIT, "redesign")
    motion, before, _ = read_motion(result)
    assert before is not None
    assert before.problem.cables["lead"].cable.length == 0.3
    assert motion.problem.cables["lead"].cable.length != 0.3
    assert main(["export", str(result), "--to", "gltf"]) == 0


def test_what_a_result_was_made_with_can_be_simulated_again(here):
    result = solved(here)
    assert main(["simulate", str(result / "used" / "problem.toml"), *PLAIN, "-q", "-o", "again"]) == 0
    first, second = (np.load(Path(place, "motion.npz")) for place in (result, "again"))
    assert np.abs(first["lead/position"] - second["lead/position"]).max() < 1e-9
    first.close()
    second.close()


@links
@pytest.mark.parametrize(
    "name",
    [
        "summary.json",
        "motion.npz",
        "used",
        "used/problem.toml",
        "used/meshes",
        "used/meshes/0.ply",
        "used/problem_flap.csv",
    ],
)
def test_no_link_out_of_the_folder_is_followed(here, capsys, name):
    result = solved(here)
    file, outside = result / name, here / "outside"
    shutil.move(file, outside)
    file.symlink_to(outside)
    assert main(["export", str(result), "--to", "csv"]) == 2
    err = capsys.readouterr().err
    assert "found a link out of it" in err or "a file outside the problem's folder" in err
    assert not (result / "export").exists()


@links
def test_links_within_the_folder_are_as_good_as_what_they_lead_to(here):
    result = solved(here)
    (result / "motion.npz").rename(result / "shapes.npz")
    (result / "motion.npz").symlink_to("shapes.npz")
    assert main(["export", str(result), "--to", "csv"]) == 0


@links
def test_nothing_is_written_through_a_link_in_the_folder(here, capsys):
    result, victim = solved(here), here / "victim"
    victim.mkdir()
    (result / "export").symlink_to(victim)
    assert main(["export", str(result), "--to", "csv"]) == 2
    assert "found a link out of it, export, expected a file of its own" in capsys.readouterr().err
    assert not list(victim.iterdir())
    (result / "export").unlink()
    (result / "export").mkdir()
    (victim / "lead.csv").write_text("mine")
    (result / "export" / "lead.csv").symlink_to(victim / "lead.csv")
    assert main(["export", str(result), "--to", "csv", "--to", "gltf"]) == 0
    assert (victim / "lead.csv").read_text() == "mine"


SPOILT = {
    "a limit beyond the motion": lambda summary: summary["limits"][0].update(motion=7.5, margin=-1),
    "a limit that is no number": lambda summary: summary["limits"][0].update(margin="much"),
    "no limits": lambda summary: summary.pop("limits"),
    "limits that are none": lambda summary: summary.update(limits=[3]),
    "snaps that are none": lambda summary: summary.update(snaps=[{"cable": "lead", "frame": "x", "motion": 0}]),
    "a snap of no frame": lambda summary: summary.update(snaps=[{"cable": "lead", "frame": 99, "motion": 0.5}]),
    "a snap of no cable": lambda summary: summary.update(snaps=[{"cable": "x", "frame": 1, "motion": 0.5}]),
    "a motion beyond its end": None,
    "a quaternion that is none": None,
    "a cable that goes back": None,
}


@pytest.mark.parametrize("kind", SPOILT)
def test_a_result_that_was_tampered_with_is_refused_in_words(here, capsys, kind):
    result = solved(here, FLAP)
    if SPOILT[kind] is not None:
        summary = json.loads((result / "summary.json").read_text())
        SPOILT[kind](summary)
        (result / "summary.json").write_text(json.dumps(summary))
    else:
        with np.load(result / "motion.npz") as stored:
            arrays = dict(stored)
        if kind == "a motion beyond its end":
            arrays["motion"] = arrays["motion"] + 0.5
        elif kind == "a quaternion that is none":
            arrays["lead/quaternion"] = arrays["lead/quaternion"] * 3.0
        else:
            arrays["lead/s"] = arrays["lead/s"] - 0.1
        np.savez(result / "motion.npz", **arrays)
    assert main(["export", str(result), "--to", "csv"]) == 2
    err = capsys.readouterr().err
    assert "found a damaged result" in err and "Traceback" not in err
    assert not (result / "export").exists()


def test_a_result_of_another_problem_is_refused(here, capsys):
    result = solved(here, FLAP)
    used = result / "used" / "problem.toml"
    used.write_text(used.read_text().replace("[cables.lead]", "[cables.other]").replace("lead.", "other."))
    assert main(["export", str(result), "--to", "csv"]) == 2
    assert "found shapes of ['lead'], expected ['other']" in capsys.readouterr().err
    with pytest.raises(HarnessError):
        read_motion(result)
