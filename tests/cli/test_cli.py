"""The command line: every exit code of every command, what stands on stdout, and what is written when."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

from harness_opt.cli import commands as cli
from harness_opt.cli.commands import main
from harness_opt.cli.interrupts import Abandoned, Interrupts
from harness_opt.cli.progress import progress_for
from harness_opt.design import redesign as outer_loop
from harness_opt.errors import SolveError, Status
from harness_opt.files.read import read_problem
from harness_opt.files.stored_results import read_results
from harness_opt.model.results import Motion
from harness_opt.motion import simulate as motion
from harness_opt.report import words as tables
from harness_opt.statics import mesh as refinement
from harness_opt.statics import solve as solving
from oracles.flap import FLAP, HIT, PLAIN, WALLED, environment, put, run, stand_in, strict

# --- check ---------------------------------------------------------------------------------------------


def test_check_says_what_would_be_solved_and_writes_nothing(here, capsys):
    assert main(["check", put(FLAP)]) == 0
    out, err = capsys.readouterr()
    words = " ".join(out.split())
    assert "1 cable over" in words
    assert "weighs 15 g, w L^3/B = 6.622, kz/kx = 0.75" in words
    assert "slack over the distance of its ends" in words
    assert "turns about the axis (0, 1, 0) through the point (200, 0, 0) mm, from 0 to 20 deg" in words
    assert "sphere; at least 4 mm clear box from (60, -20, -20) to (100, 20, 20) mm" in words
    assert "Left out: other cables, for there is only one." in words
    assert "lead.length: 0.3 m now, within [0.25, 0.45]" in words
    assert max(map(len, out.splitlines())) <= tables.WIDTH
    assert err == ""
    assert os.listdir() == ["flap.toml"]


def test_check_in_json(here, capsys):
    assert main(["check", put(FLAP), "--json"]) == 0
    content = strict(capsys.readouterr().out)
    frames = len(motion.place_frames(read_problem("flap.toml")))
    assert (content["command"], content["status"], content["frames"]) == ("check", "ok", frames)
    assert content["cables"]["lead"]["mass"] == pytest.approx(0.015)
    slack = content["cables"]["lead"]["slack"]
    assert slack[1] == pytest.approx(0.3 - np.hypot(0.15, 0.02))
    assert slack[0] < slack[1]


def test_figures_beyond_all_numbers_are_null(here, capsys):
    text = FLAP.replace("length = 0.3\n", "length = 1e3\n").replace("mass_per_length = 0.05", "mass_per_length = 1e100")
    text = text.replace("bending_stiffness = 2e-3", "bending_stiffness = 1e-100").replace("-9.81", "-1e100")
    assert main(["check", put(text), "--json"]) == 0
    assert strict(capsys.readouterr().out)["cables"]["lead"]["weight_number"] is None


def test_check_reads_the_meshes(here, capsys):
    box = trimesh.creation.box((10, 20, 30))
    box.export("box.stl")
    file = put(FLAP.replace("sphere = { radius = 0.02 }", 'mesh = "box.stl"\nmesh_unit = "mm"'))
    assert main(["check", file]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "mesh box.stl, 12 triangles, closed" in out
    assert "box from (75, -10, -15) to (85, 10, 15) mm" in out
    box.update_faces(np.arange(12) > 1)
    box.export("box.stl")
    assert main(["check", file]) == 2
    assert "expected a closed one, or shell = true" in capsys.readouterr().err
    put(FLAP.replace("sphere = { radius = 0.02 }", 'mesh = "box.stl"\nmesh_unit = "mm"\nshell = true'))
    assert main(["check", file]) == 0
    assert "10 triangles, open, so a shell" in " ".join(capsys.readouterr().out.split())
    Path("box.stl").write_text("no mesh")
    assert main(["check", file]) == 2
    assert capsys.readouterr().err.startswith("flap.toml: parts.ball.mesh: ")


def test_check_tells_other_motions_and_ends(here, capsys):
    text = FLAP.replace("[limits]\nclearance = 0.004\nbend_radius = 0.01\n", "")
    text = text.replace('kind = "hinge"\npoint = [0.2, 0, 0]\naxis = [0, 1, 0]', "")
    text = text.replace("from_deg = 0\nto_deg = 20", 'kind = "slide"\ndirection = [0, 0, 2]\nfrom = 0\nto = 0.01')
    text = text.replace(", tangent = [0, 0, 1] }", " }").replace("gravity = [0, 0, -9.81]", "")
    assert main(["check", put(text)]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "slides along (0, 0, 2), from 0 to 10 mm" in out
    assert "its start is pinned in the world" in out
    assert "weight, for gravity is zero or not given" in out
    assert "limits.clearance is not given" in out
    assert "ball" in out
    assert "no limit" in out


# --- bad input: exit 2, one line a mistake, nothing written --------------------------------------------


@pytest.mark.parametrize("command", ["check", "simulate", "redesign"])
def test_bad_problems_are_named_line_by_line(here, capsys, command):
    file = put(FLAP.replace("length = 0.3\n", "length = -1\n").replace("bend_radius", "bend_radios"))
    assert main([command, file]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    lines = err.splitlines()
    assert len(lines) == 2
    assert any(line.startswith("flap.toml: cables.lead.length: found -1") for line in lines)
    assert any(line.startswith("flap.toml: limits.bend_radios: ") for line in lines)
    assert os.listdir() == ["flap.toml"]


@pytest.mark.parametrize("command", ["check", "simulate", "redesign", "show"])
def test_missing_files(here, capsys, command):
    assert main([command, "none"]) == 2
    assert capsys.readouterr().err.startswith("none: found ")
    assert os.listdir() == []


def test_no_traceback_for_users(here):
    put("cables = 1")
    for arguments in (["simulate", "flap.toml"], ["simulate"], ["nonsense"], ["show", "flap.toml"]):
        done = run(*arguments, cwd=here)
        assert done.returncode == 2
        assert done.stdout == ""
        assert done.stderr
        assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    "option",
    [
        "--tolerance=nan",
        "--tolerance=0",
        "--spatial-step=inf",
        "--elements=0",
        "--solver=newton",
        "--colour",
        "-o",
    ],
)
def test_wrong_usage(here, capsys, option):
    assert main(["simulate", put(FLAP), option]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "Error: " in err
    assert os.listdir() == ["flap.toml"]


def test_too_many_frames(here, capsys):
    assert main(["simulate", put(FLAP), "--spatial-step", "1e-9"]) == 2
    assert capsys.readouterr().err.startswith("flap.toml: motion.spatial_step: found 1e-09 m")
    assert os.listdir() == ["flap.toml"]


@pytest.mark.parametrize(("step", "words"), [("1e-320", "at least 1e-100"), ("1e-100", "expected at most 10000")])
def test_steps_of_nearly_nothing(here, capsys, step, words):
    assert main(["simulate", put(FLAP), "--spatial-step", step]) == 2
    assert words in capsys.readouterr().err


def test_frames_are_counted_over_all_cables(here, capsys):
    cable = FLAP[FLAP.index("[cables.lead]") : FLAP.index("[bodies.flap.motion]")]
    text = FLAP.replace("spatial_step = 0.01", "spatial_step = 3e-6")
    assert main(["check", put(text)]) == 0
    assert main(["check", put(text + cable.replace("lead", "second"))]) == 2
    assert "frames of 2 cables, expected at most 5000" in capsys.readouterr().err


def test_nothing_to_redesign(here, capsys):
    file = put(FLAP.partition("[design.variables]")[0])
    assert main(["redesign", file]) == 2
    assert capsys.readouterr().err.startswith("flap.toml: design.variables: found none")
    assert os.listdir() == ["flap.toml"]


def test_foreign_folders_are_refused_before_anything_is_solved(here, capsys, monkeypatch):
    monkeypatch.setattr(motion, "simulate", None)  # would fail if it were called
    Path("mine").mkdir()
    Path("mine/thesis.tex").write_text("years")
    assert main(["simulate", put(FLAP), "-o", "mine"]) == 2
    assert "thesis.tex" in capsys.readouterr().err
    assert os.listdir("mine") == ["thesis.tex"]
    assert main(["simulate", "flap.toml", "-o", "flap.toml"]) == 2
    assert main(["simulate", "flap.toml", "-o", "."]) == 2


def test_a_disk_that_fails_is_told_and_the_result_shown(here, capsys, monkeypatch):
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device", "motion.npz")

    monkeypatch.setattr(np, "savez", full)
    assert main(["simulate", put(FLAP), *PLAIN]) == 2
    out, err = capsys.readouterr()
    assert "All 3 limits hold." in out
    assert "Nothing was written." in out
    assert "results/flap: found no way to write motion.npz (No space left on device)" in err
    assert os.listdir("results") == []


# --- simulate ------------------------------------------------------------------------------------------


def test_simulate_where_all_limits_hold(here, capsys):
    assert main(["simulate", put(FLAP), *PLAIN]) == 0
    out, err = capsys.readouterr()
    assert "All 3 limits hold." in out
    assert "Results: results/flap/" in out
    assert max(map(len, out.splitlines())) <= tables.WIDTH
    assert err.startswith("solving lead: ")  # progress
    assert sorted(os.listdir("results/flap")) == ["motion.npz", "report.html", "summary.json", "used"]


def test_simulate_where_a_limit_is_violated(here, capsys):
    assert main(["simulate", put(HIT), *PLAIN, "-o", "out"]) == 1
    assert "1 of 3 limits violated: clearance of lead to ball" in " ".join(capsys.readouterr().out.split())
    assert read_results("out").summary["status"] == "violated"


def test_simulate_where_no_shape_is_found(here, capsys, monkeypatch):
    monkeypatch.setattr(refinement, "ELEMENTS", (8, 12))  # the finer ones take seconds to build
    assert main(["simulate", put(FLAP), *PLAIN, "--tolerance=1e-18", "--quiet"]) == 3
    out, err = capsys.readouterr()
    assert out == ""
    assert "cable lead, frame" in err
    assert "try " in err
    stored = read_results("results/flap")
    assert stored.summary["status"] == "unsolved"
    assert stored.summary["message"] in err
    assert len(stored.motion) > 0


def test_options_reach_the_solve(here, monkeypatch):
    seen = {}
    simulate = motion.simulate

    def spy(problem, **options):
        seen.update(options)
        return simulate(problem, **{k: v for k, v in options.items() if k in ("progress", "throw")})

    monkeypatch.setattr(motion, "simulate", spy)
    options = {"spatial_step": 0.05, "elements": 12, "solver": "gauss-newton", "tolerance": 1e-4}
    given = [part for name, value in options.items() for part in (f"--{name.replace('_', '-')}", str(value))]
    assert main(["simulate", put(FLAP), *PLAIN, *given]) == 0
    assert {name: seen[name] for name in options} == options
    assert set(cli.SOLVERS) == set(solving.SOLVER_OF)


def test_json_and_nothing_else_on_stdout(here):
    put(HIT)
    done = run("simulate", "flap.toml", "--json", "--no-pictures", cwd=here)
    assert done.returncode == 1
    content = strict(done.stdout)
    assert content == strict((here / "results/flap/summary.json").read_text())
    assert content["problem"]["file"] == str(here / "flap.toml")
    assert len(content["problem"]["sha256"]) == 64
    assert content["timing"]["total"] >= content["timing"]["solve"] > 0
    assert "VIOLATED" in done.stderr
    quiet = run("simulate", "flap.toml", "--json", "--quiet", "--no-pictures", cwd=here)
    assert (quiet.returncode, quiet.stderr) == (1, "")
    assert strict(quiet.stdout)["limits"] == content["limits"]


def test_a_reader_that_goes_away_changes_nothing(here):
    command = f"{sys.executable} -m harness_opt schema | true; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(
        ["bash", "-c", command], cwd=here, env=environment(), check=False, capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (0, "")


# --- redesign ------------------------------------------------------------------------------------------


def test_redesign_that_holds_and_its_problem_passes(here, capsys):
    assert main(["redesign", put(HIT), *PLAIN, "-o", "better"]) == 0
    assert "lead.length: 0.3 -> " in capsys.readouterr().out
    names = ["before.npz", "motion.npz", "redesigned.toml", "report.html", "summary.json", "used"]
    assert sorted(os.listdir("better")) == names
    assert main(["simulate", "better/redesigned.toml", *PLAIN]) == 0
    assert sorted(os.listdir("results/redesigned")) == ["motion.npz", "report.html", "summary.json", "used"]


def test_redesign_that_finds_none(here, capsys):
    assert main(["redesign", put(WALLED), *PLAIN, "--json"]) == 1
    out, err = capsys.readouterr()
    content = strict(out)
    assert content["status"] == "infeasible"
    assert any("lead.length" in name for name in content["redesign"]["active"])
    assert "In the way: clearance of lead to ball" in " ".join(err.split())
    assert Path("results/flap/redesigned.toml").exists()


def test_redesign_whose_first_shape_is_not_found(here, capsys, monkeypatch):
    def fail(problem, **_):
        part = Motion(problem, np.zeros(0), {}, Status.OK)
        raise SolveError("cable lead, frame 0: none; try more length", Status.NO_START, part)

    monkeypatch.setattr(outer_loop, "redesign", fail)
    assert main(["redesign", put(HIT), *PLAIN]) == 3
    assert "try more length" in " ".join(capsys.readouterr().out.split())
    content = read_results("results/flap").summary
    assert (content["command"], content["status"], content["reason"]) == ("redesign", "unsolved", "no_start")
    assert content["redesign"]["variables"]["lead.length"]["after"] is None


# --- interrupts ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["simulate", "redesign"])
def test_an_interrupt_keeps_what_was_finished(here, command):
    put(HIT.replace("spatial_step = 0.01", "spatial_step = 1e-5"))
    arguments = [sys.executable, "-m", "harness_opt", command, "flap.toml", "--no-pictures", "--json"]
    with subprocess.Popen(
        arguments, cwd=here, env=environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr is not None
        assert process.stderr.readline().startswith(("solving lead: ", "looking at design 1: "))
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=120)
    assert process.returncode == 130
    assert "Traceback" not in err
    content = strict(out)
    assert content["status"] == "unsolved"
    assert content["reason"] == "interrupted"
    if command == "simulate":
        stored = read_results(here / "results/flap")
        assert stored.summary == content
        assert 0 < len(stored.motion) < len(motion.place_frames(read_problem(here / "flap.toml")))
        assert os.listdir(here / "results") == ["flap"]
    elif (here / "results").exists():  # whole or absent
        assert os.listdir(here / "results") == ["flap"]
        read_results(here / "results/flap")


def test_an_interrupt_before_anything_is_solved_leaves_the_earlier_result(here, capsys, monkeypatch):
    assert main(["simulate", put(FLAP), *PLAIN, "-q"]) == 0
    before = Path("results/flap/summary.json").read_bytes()

    def interrupted(problem, *, progress, **_):
        signal.raise_signal(signal.SIGINT)
        progress("lead", 1, 9)

    monkeypatch.setattr(motion, "simulate", interrupted)
    assert main(["simulate", "flap.toml", *PLAIN]) == 130
    assert "Nothing was written." in capsys.readouterr().out
    assert Path("results/flap/summary.json").read_bytes() == before


def test_a_second_interrupt_stops_at_once(here, capsys, monkeypatch):
    def stubborn(problem, **_):
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
        raise AssertionError("still running")

    monkeypatch.setattr(motion, "simulate", stubborn)
    assert main(["simulate", put(FLAP), *PLAIN]) == 130
    assert os.listdir() == ["flap.toml"]


def test_an_interrupt_while_pictures_are_drawn_keeps_the_result(here, monkeypatch):
    def draw(*_: object, **__: object) -> list[str]:
        signal.raise_signal(signal.SIGINT)
        raise AssertionError("still drawing")

    monkeypatch.setitem(sys.modules, "harness_opt.pictures.film", stand_in(write_pictures_and_film=draw))
    assert main(["simulate", put(FLAP), "-q", "--pictures"]) == 130
    stored = read_results("results/flap").summary
    assert (stored["status"], stored["left_out"][-1]) == ("ok", "pictures")
    assert os.listdir("results") == ["flap"]


def test_an_interrupt_while_reading(here, monkeypatch):
    monkeypatch.setattr("harness_opt.files.read.read_problem", lambda *_: signal.raise_signal(signal.SIGINT))
    assert main(["check", put(FLAP)]) == 130
    assert main(["simulate", "flap.toml"]) == 130
    assert os.listdir() == ["flap.toml"]


def test_handlers_are_put_back():
    before = signal.getsignal(signal.SIGINT)
    said: list[str] = []
    with Interrupts(said.append) as interrupts, progress_for(interrupts, None) as progress:
        progress("lead", 1, 2)
        signal.raise_signal(signal.SIGINT)
        assert interrupts.asked
        with pytest.raises(KeyboardInterrupt):
            progress("lead", 2, 2)
        with pytest.raises(Abandoned):
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before
    assert len(said) == 1
