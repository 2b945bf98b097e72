"""The search between frames takes no more frames, memory and time than it may, and says so where that is too little."""

from __future__ import annotations

import dataclasses
import math
import sys
import tracemalloc

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.clearance import certify as through_motion
from harness_opt.clearance.certify import MOST_INSERTED
from harness_opt.clearance.measure import measure
from harness_opt.clearance.pairs import Between, Options
from harness_opt.clearance.witnesses import CROWDED, LONG, ROUGH, STOPPED
from harness_opt.model.bodies import Hinge
from harness_opt.motion.between_frames import BetweenFrames
from harness_opt.parts.scene import load_scene
from harness_opt.report.summary import summary
from oracles.flap import FLAP
from oracles.problem_files import written
from oracles.scripts import script

MOST_MEMORY = 400e6  # bytes; it was more than ten times as much
REASONS = {CROWDED, LONG, ROUGH}


@pytest.fixture(scope="module")
def motion(tmp_path_factory):
    return ho.simulate(ho.read_problem(written(tmp_path_factory.mktemp("flap"), FLAP)))


def certified(motion, **options):
    between = Between(BetweenFrames(motion), motion.snaps)
    scene = load_scene(motion.problem)
    return measure(motion.problem, scene, motion.motion, motion.cables, Options(**options), between)


def test_a_motion_that_belongs_to_other_bodies_is_given_up(motion):
    """Frames solved between those given lie far off them: no number of frames makes that certain."""
    fine = ho.simulate(motion.problem, spatial_step=0.001)
    other = Hinge((0.2, 0, 0), (0, 1, 0), 0, math.radians(40.0))
    wrong = dataclasses.replace(fine, problem=dataclasses.replace(fine.problem, bodies={"flap": ho.Body(other)}))
    tracemalloc.start()
    found = certified(wrong, most_queries=4000)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < MOST_MEMORY
    assert all(not pair.certified and set(pair.reason.split("; ")) <= REASONS for pair in found.pairs)
    # beside the searches', each stretch of the motion gets what a cubic needs
    assert found.inserted["lead"] <= MOST_INSERTED * len(found.pairs) + 8
    rows = [row for row in summary(wrong, found)["limits"] if row["name"] == "clearance"]
    assert not any(row["certified"] for row in rows) and all(row["reason"] for row in rows)


@pytest.mark.parametrize("most", [0, 1])
def test_frames_between_are_no_more_than_allowed(motion, monkeypatch, most):
    free = certified(motion, tolerance=5e-7)
    assert free.inserted["lead"] > 3, "so many are needed"
    assert all(pair.certified for pair in free.pairs)
    monkeypatch.setattr(through_motion, "MOST_INSERTED", most)
    found = certified(motion, tolerance=5e-7)
    assert found.inserted["lead"] <= most * len(found.pairs)
    assert any(pair.reason == CROWDED for pair in found.pairs)
    for pair, sure in zip(found.pairs, free.pairs, strict=True):
        assert pair.certified or pair.reason in REASONS
        # what is not certain is still bounded from below
        assert pair.lower_bound <= sure.worst


def test_cells_asked_in_blocks_are_the_same(motion, monkeypatch):
    whole = certified(motion)
    monkeypatch.setattr(through_motion, "BLOCK", 7)
    for one, other in zip(certified(motion).pairs, whole.pairs, strict=True):
        assert (one.worst, one.lower_bound, one.certified) == (other.worst, other.lower_bound, other.certified)


def test_a_search_for_more_cells_than_it_may_hold(motion):
    found = certified(motion, most_queries=1)
    assert any(pair.reason == LONG and not pair.certified for pair in found.pairs)
    assert all(pair.certified or pair.reason == LONG for pair in found.pairs)


def test_a_stop_leaves_the_frames_measured(motion):
    asked = []

    def stop() -> bool:
        asked.append(True)
        return len(asked) > 3

    found, free = certified(motion, stop=stop), certified(motion)
    assert {pair.reason for pair in found.pairs if not pair.certified} == {STOPPED}
    alone = measure(motion.problem, load_scene(motion.problem), motion.motion, motion.cables)
    for pair, frames, sure in zip(found.pairs, alone.pairs, free.pairs, strict=True):
        np.testing.assert_array_equal(pair.clearance, frames.clearance)
        assert sure.worst - 1e-12 <= pair.worst <= frames.worst


def test_long_motions_are_gone_through_in_blocks(motion, monkeypatch):
    monkeypatch.setattr("harness_opt.motion.frames.MOST_AT_A_TIME", 3)
    again = ho.simulate(motion.problem)
    for name, value in vars(motion.cables["lead"]).items():
        np.testing.assert_allclose(getattr(again.cables["lead"], name), value, rtol=1e-9, atol=1e-12, err_msg=name)


@pytest.mark.skipif(sys.platform == "win32", reason="no measure of it there")
def test_memory_of_a_whole_run(tmp_path):
    """A small scene of ``scripts/benchmarks/memory.py``, which tries 1,000 frames by 20 parts, and 10 cables."""
    memory = script("memory")
    row = memory.run(memory.Scene(frames=60, parts=4, cables=2), tmp_path)
    assert row["frames"] >= 60 and row["status"] in ("ok", "violated")
    assert row["memory_MB"] < 600
