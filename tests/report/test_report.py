"""Results: the summary is strict JSON with the contract's fields, the folder whole or absent, tables fit."""

from __future__ import annotations

import dataclasses
import errno
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from harness_opt.clearance.measure import clearances
from harness_opt.design.redesign import redesign
from harness_opt.errors import ProblemError, SolveError, Status
from harness_opt.files.read import read_problem, write_problem
from harness_opt.files.stored_results import read_results
from harness_opt.model.bodies import Body, Hinge
from harness_opt.model.cable import Cable, CableRun
from harness_opt.model.design import Design, Limits, Variable
from harness_opt.model.ends import End
from harness_opt.model.parts import Part, Sphere
from harness_opt.model.problem import Problem
from harness_opt.model.results import Motion
from harness_opt.motion.simulate import simulate
from harness_opt.report import words as tables
from harness_opt.report.result_files import write_results
from harness_opt.report.summary import summary, timed, verdict
from harness_opt.statics import mesh as refinement
from oracles.flap import environment

# fmt: off
FIELDS = {
    "schema", "command", "problem", "versions", "status", "frames", "limits", "snaps", "stable",
    "equilibrium", "timing", "left_out",
}
LIMIT_FIELDS = {
    "name", "limit", "worst", "margin", "cable", "frame", "motion", "arc_length", "part", "certified",
    "tolerance",
}
# fmt: on
DOWN = (0.0, 0.0, 1.0, 0.0)  # half a turn about y


def flap(**changes: object) -> Problem:
    """Return a cable that bows over a ball to a flap that opens by 20 degrees."""
    given = {
        "cables": {
            "lead": CableRun(
                Cable(0.3, 0.005, 2e-3, 1.5e-3, 0.05),
                start=End(position=(0, 0, 0), quaternion=(1, 0, 0, 0)),
                end=End(position=(0.15, 0.02, 0), quaternion=DOWN, body="flap"),
            )
        },
        "bodies": {"flap": Body(Hinge((0.2, 0, 0), (0, 1, 0), 0.0, np.deg2rad(20)))},
        "parts": {"ball": Part(Sphere(0.02), position=(0.08, 0, 0))},
        "gravity": (0.0, 0.0, -9.81),
        "limits": Limits(clearance=0.004, bend_radius=0.01, twist=6.0, clamp_force=50.0, clamp_moment=5.0),
        "spatial_step": 0.01,
        "title": "A flap",
    }
    return Problem(**{**given, **changes})  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def motion() -> Motion:
    return simulate(flap())


@pytest.fixture(scope="module")
def design():
    ball = {"ball": Part(Sphere(0.02), position=(0.08, 0.01, 0.092))}
    return redesign(flap(parts=ball, design=Design("change", (Variable("lead.length", 0.25, 0.45),))))


def strict(text: str) -> dict:
    """Parse JSON, refusing NaN and Infinity."""

    def refuse(name: str) -> None:
        raise AssertionError(name)

    return json.loads(text, parse_constant=refuse)


# --- the summary ---------------------------------------------------------------------------------------


def test_summary_has_the_fields_of_the_contract(motion):
    content = summary(motion)
    assert content.keys() >= FIELDS
    assert content["command"] == "simulate"
    assert content["status"] == "ok"
    assert content["frames"] == len(motion.motion)
    assert content["stable"] is True
    assert content["left_out"] == ["other cables", "pictures"]
    assert content["problem"] == {"title": "A flap", "file": None, "sha256": None}
    assert content["versions"].keys() >= {"harness-opt", "python", "numpy", "casadi"}
    assert content["timing"].keys() == {"load", "solve", "clearance", "pictures", "total"}
    assert 0 < content["equilibrium"]["max_residual"] < 1e-6
    assert 0 < content["equilibrium"]["estimated_error"] < 1e-6
    names = {row["name"] for row in content["limits"]}
    assert names == {"clearance", "bend_radius", "twist_deg_per_m", "clamp_force", "clamp_moment"}
    assert all(row.keys() >= LIMIT_FIELDS for row in content["limits"])
    assert strict(json.dumps(content)) == content


def test_limits_are_in_the_unit_of_their_key(motion):
    row = next(row for row in summary(motion)["limits"] if row["name"] == "twist_deg_per_m")
    twist = np.max(np.abs(motion.cables["lead"].curvature[..., 2]))
    assert row["limit"] == pytest.approx(np.rad2deg(6.0))
    assert row["worst"] == pytest.approx(np.rad2deg(twist))
    assert row["margin"] == pytest.approx(row["limit"] - row["worst"])


def test_lengths_left_out_near_clamps_and_certificates_are_named(motion):
    content = summary(motion)
    pair = next(pair for pair in content["clearances"] if pair["part"] == "ball")
    assert pair["excluded_near_clamps"] == {"start": 0.0, "end": 0.0}, "the ball holds no clamp"
    rows = [row for row in content["limits"] if row["name"] == "clearance"]
    assert all(row["certified_along_arc"] is True for row in rows)
    assert all("certified_along_arc" not in row for row in content["limits"] if row not in rows)


def test_what_is_not_finite_is_null(motion):
    cable = motion.cables["lead"]
    broken = dataclasses.replace(cable, residual=np.full_like(cable.residual, np.inf))
    content = summary(dataclasses.replace(motion, cables={"lead": broken}))
    assert content["equilibrium"]["max_residual"] is None
    strict(json.dumps(content, allow_nan=False))


def test_verdicts(motion, design):
    held = clearances(motion).limits
    short = [dataclasses.replace(held[0], margin=-1e-9)]
    unknown = [dataclasses.replace(held[0], margin=float("nan"))]
    loose = [dataclasses.replace(held[0], certified=False)]
    stopped = dataclasses.replace(motion, status=Status.STALLED)
    assert verdict(motion, held) == "ok"
    assert verdict(motion, ()) == "ok"
    assert verdict(motion, short) == "violated"
    assert verdict(motion, unknown) == verdict(motion, loose) == "uncertain"
    assert verdict(motion, [*short, *loose]) == "violated", "a no outranks an uncertain"
    assert verdict(stopped, held) == "unsolved"
    assert verdict(design, design.limits) == "ok"
    assert verdict(dataclasses.replace(design, feasible=False), design.limits) == "infeasible"
    assert verdict(dataclasses.replace(design, status=Status.STALLED), design.limits) == "unsolved"


def test_unstable_frames_are_told(motion):
    cable = motion.cables["lead"]
    stable = cable.stable.copy()
    stable[1] = False
    shaky = dataclasses.replace(motion, cables={"lead": dataclasses.replace(cable, stable=stable)})
    content = summary(shaky)
    assert content["stable"] is False
    assert "unstable" in tables.report(content)


def test_a_redesign_tells_what_changed(design):
    content = summary(design)
    assert content["command"] == "redesign"
    assert content["status"] == "ok"
    found = content["redesign"]
    assert found.keys() >= {"variables", "iterations", "limits_before", "active"}
    assert found["variables"]["lead.length"].keys() == {"before", "after", "lower", "upper"}
    assert found["variables"]["lead.length"]["before"] == 0.3
    assert min(row["margin"] for row in found["limits_before"] if row["margin"] is not None) < 0
    assert "lead.length: 0.3 -> " in tables.report(content)
    strict(json.dumps(content))


def test_a_redesign_that_could_not_begin_gives_its_first_motion():
    variables = Design("change", (Variable("lead.length", 0.25, 0.45),))
    empty = Motion(flap(design=variables), np.zeros(0), {}, Status.NO_START, "no shape")
    content = summary(empty, command="redesign")
    assert content["status"] == "unsolved"
    assert content["frames"] == 0
    assert content["stable"] is False
    assert content["limits"] == []
    bounds = {"before": 0.3, "after": None, "lower": 0.25, "upper": 0.45}
    assert content["redesign"]["variables"] == {"lead.length": bounds}
    assert "no shape" in tables.report(content)


def test_timing_adds_up(motion):
    once = timed(motion, load=1.0, total=5.0)
    assert timed(once, pictures=2.0).timing["total"] == 7.0
    assert summary(once)["timing"]["total"] == 5.0


# --- the table -----------------------------------------------------------------------------------------


def test_table_fits_and_names_every_limit(motion):
    rows = summary(motion)["limits"]
    text = tables.table(rows)
    assert len(text.splitlines()) == 1 + len(rows)
    assert all(line.endswith("OK") for line in text.splitlines()[1:])
    assert "VIOLATED" in tables.table([{**rows[0], "margin": -0.001, "holds": "no"}])
    assert tables.table([]) == ""


def test_long_names_and_odd_numbers_keep_to_the_width(motion):
    rows = summary(motion)["limits"]
    rows = [{**row, "cable": "c" * 60, "part": "p" * 60, "worst": 1e9, "margin": None} for row in rows]
    assert max(map(len, tables.table(rows).splitlines())) <= tables.WIDTH


def test_words_are_at_most_a_line_wide(motion, design):
    for result in (motion, design):
        assert max(map(len, tables.report(summary(result)).splitlines())) <= tables.WIDTH


def test_what_is_in_the_way_is_named(design):
    content = summary(dataclasses.replace(design, feasible=False))
    row = next(row for row in content["limits"] if row["part"] == "ball")
    row["margin"], row["holds"] = -0.0012, "no"
    words = " ".join(tables.conclusion(content).split())
    assert "None found among" in words and "designs looked at that holds all limits" in words
    assert "clearance of lead to ball (by 1.20 mm" in words


# --- the folder ----------------------------------------------------------------------------------------


def test_motion_is_plain_arrays(motion, tmp_path):
    write_results(motion, tmp_path / "out")
    frames, stations = len(motion.motion), len(motion.cables["lead"].s)
    with np.load(tmp_path / "out" / "motion.npz", allow_pickle=False) as stored:
        assert stored["motion"].shape == (frames,)
        assert stored["lead/s"].shape == (stations,)
        assert stored["lead/quaternion"].shape == (frames, stations, 4)
        for name in ("position", "curvature", "force", "moment"):
            assert stored[f"lead/{name}"].shape == (frames, stations, 3)


def test_what_is_written_reads_back(motion, tmp_path):
    content = write_results(motion, tmp_path / "a" / "b")
    assert sorted(p.name for p in (tmp_path / "a").iterdir()) == ["b"]
    assert content["files"] == ["motion.npz", "summary.json", "used"]
    again = read_results(tmp_path / "a" / "b")
    assert again.summary == content
    assert strict((tmp_path / "a" / "b" / "summary.json").read_text()) == content
    np.testing.assert_array_equal(again.motion, motion.motion)
    for name, value in vars(motion.cables["lead"]).items():
        np.testing.assert_array_equal(getattr(again.cables["lead"], name), value)


def test_a_redesign_writes_a_problem_that_holds(design, tmp_path):
    write_results(design, tmp_path / "out")
    names = ["before.npz", "motion.npz", "redesigned.toml", "summary.json", "used"]
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == names
    again = simulate(read_problem(tmp_path / "out" / "redesigned.toml"))
    assert summary(again)["status"] == "ok"


def test_an_earlier_result_gives_way_and_other_files_stay(motion, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    write_results(dataclasses.replace(motion, message="old"), out, pictures=_draw("old.png"))
    (out / "notes.txt").write_text("mine")
    write_results(motion, out)
    assert sorted(p.name for p in out.iterdir()) == ["motion.npz", "notes.txt", "summary.json", "used"]
    assert read_results(out).summary["message"] == ""
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def _draw(name: str, error: BaseException | None = None):
    def draw(_result: object, folder: Path) -> list[str]:
        (folder / name).write_text("a picture")
        if error is not None:
            raise error
        return [name]

    return draw


def test_pictures_are_part_of_the_folder(motion, tmp_path):
    content = write_results(timed(motion, total=1.0), tmp_path / "out", pictures=_draw("worst.png"))
    assert content["files"] == ["motion.npz", "summary.json", "used", "worst.png"]
    assert "pictures" not in content["left_out"]
    assert content["timing"]["total"] == 1.0 + content["timing"]["pictures"]


@pytest.mark.parametrize("error", [RuntimeError("no OpenGL"), KeyboardInterrupt(), SystemExit(1)])
def test_what_stops_midway_leaves_the_earlier_result(motion, tmp_path, error):
    out = tmp_path / "out"
    before = write_results(motion, out)
    with pytest.raises(type(error)):
        write_results(dataclasses.replace(motion, message="new"), out, pictures=_draw("worst.png", error))
    assert read_results(out).summary == before
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_a_kill_leaves_the_earlier_result(motion, tmp_path):
    write_problem(flap(), tmp_path / "flap.toml")
    before = write_results(motion, tmp_path / "out")
    program = (
        "import os, harness_opt as ho\n"
        "motion = ho.simulate(ho.read_problem('flap.toml'))\n"
        "ho.write_results(motion, 'out', pictures=lambda *_: os.kill(os.getpid(), 9))\n"
    )
    run = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, env=environment(), check=False)
    assert run.returncode == -signal.SIGKILL
    assert read_results(tmp_path / "out").summary == before


def test_a_full_disk_is_a_plain_line(motion, tmp_path, monkeypatch):
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "motion.npz")

    monkeypatch.setattr(np, "savez", full)
    with pytest.raises(ProblemError, match="No space left on device"):
        write_results(motion, tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_folders_of_others_are_refused(motion, tmp_path, monkeypatch):
    other = tmp_path / "other"
    other.mkdir()
    (other / "summary.json").write_text('{"schema": 1, "tests": 12}')
    with pytest.raises(ProblemError, match=r"no result of harness-opt \(summary.json\)"):
        write_results(motion, other)
    assert [p.name for p in other.iterdir()] == ["summary.json"]
    with pytest.raises(ProblemError, match="found a file"):
        write_results(motion, other / "summary.json")
    with pytest.raises(ProblemError, match="which is no folder"):
        write_results(motion, other / "summary.json" / "deeper")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ProblemError, match="the folder you work in"):
        write_results(motion, ".")


def test_a_problem_is_not_replaced_by_its_results(design, tmp_path):
    out = tmp_path / "out"
    write_results(design, out)
    again = simulate(read_problem(out / "redesigned.toml"))
    with pytest.raises(ProblemError, match=r"redesigned.toml in it, which this problem needs"):
        write_results(again, out)
    assert (out / "redesigned.toml").exists()


def test_what_is_no_result_is_named(motion, tmp_path):
    with pytest.raises(ProblemError, match="no result of harness-opt"):
        read_results(tmp_path)
    write_results(motion, tmp_path / "out")
    (tmp_path / "out" / "motion.npz").write_bytes(b"PK damaged")
    with pytest.raises(ProblemError, match="damaged"):
        read_results(tmp_path / "out")


def test_a_partial_motion_is_written(tmp_path, monkeypatch):
    monkeypatch.setattr(refinement, "ELEMENTS", (8, 12))  # the finer ones take seconds to build
    with pytest.raises(SolveError) as caught:
        simulate(flap(), tolerance=1e-18)
    content = write_results(caught.value.partial, tmp_path / "out")
    assert content["status"] == "unsolved"
    assert content["frames"] > 0
    assert content["limits"]


# --- what is not needed is not imported ----------------------------------------------------------------


def test_meshes_and_pictures_are_imported_only_when_needed(tmp_path):
    write_problem(flap(parts={}, limits=Limits(bend_radius=0.01)), tmp_path / "flap.toml")
    program = (
        "import sys, harness_opt as ho\n"
        "motion = ho.simulate(ho.read_problem('flap.toml'))\n"
        "ho.write_results(motion, 'out')\n"
        "print(*sorted({'trimesh', 'coal', 'pyvista', 'vtkmodules'} & set(sys.modules)))\n"
    )
    command = [sys.executable, "-c", program]
    run = subprocess.run(command, cwd=tmp_path, env=environment(), check=True, capture_output=True, text=True)
    assert run.stdout.strip() == ""
