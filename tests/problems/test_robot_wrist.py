"""The problem on a real robot: made by its script where the extra is installed, skipped with a message where not."""

from __future__ import annotations

import importlib.util
import shutil

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.cli.commands import main
from harness_opt.numerics import rotations
from oracles.browser import looked_through
from oracles.problems import PROBLEMS
from oracles.scripts import script

PROBLEM = PROBLEMS / "robot_wrist" / "robot_wrist.toml"


@pytest.fixture
def wrist():
    return script("robot_wrist")


@pytest.fixture
def put(tmp_path):
    shutil.copy(PROBLEM, tmp_path)
    return tmp_path / PROBLEM.name


def test_without_the_extra_it_is_left_out_with_a_message(wrist, put, monkeypatch, capsys):
    monkeypatch.setattr(wrist.importlib.util, "find_spec", lambda name: None)
    assert wrist.main(put.parent) == 0
    assert 'pip install "harness-opt[robots]"' in capsys.readouterr().err
    assert [file.name for file in put.parent.iterdir()] == [put.name]
    # what is missing is named, each file by its key
    assert main(["check", str(put)]) == 2
    error = capsys.readouterr().err
    for key in ("bodies.wrist_3.motion.file", "parts.forearm.mesh"):
        assert key in error


@pytest.mark.skipif(not importlib.util.find_spec("pinocchio"), reason="the extra robots is not installed")
def test_two_cables_over_the_wrist_of_a_robot(wrist, put, capsys):
    assert wrist.main(put.parent) == 0
    capsys.readouterr()
    problem = ho.read_problem(put)
    # between the rows of the tables too, the links are where the robot has them
    share = np.linspace(0.0, 1.0, 173)
    for link, poses in wrist.link_poses(wrist.joints(share)).items():
        position, quaternion = problem.poses(link.removesuffix("_link"), share)
        np.testing.assert_allclose(position, poses[:, :3], atol=1e-5)
        # the spline of the rotations has its own idea of the very ends
        along = [rotations.rotate(q, [0.0, 0.0, 1.0]) for q in (quaternion, poses[:, 3:])]
        np.testing.assert_allclose(*along, atol=1e-4)
    motion = ho.simulate(problem, spatial_step=0.02)
    assert motion.ok and not motion.snaps
    found = ho.clearances(motion)
    assert all(row.certified and row.margin > 0 for row in found.limits), found.limits
    assert {pair.obstacle.key for pair in found.pairs if pair.cable == "power"} == {
        "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3", "tool", "cable:power", "cable:air",
    }  # fmt: skip
    assert all(pair.closed for pair in found.pairs)
    page = ho.write_report(motion, put.parent / "report.html")
    assert page.stat().st_size < 10e6
    looked_through(page, motion.motion, parts=True)
