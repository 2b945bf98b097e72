"""Free bodies in problem files, and what was found of harnesses in results: read, written, and every mistake named."""

from __future__ import annotations

import dataclasses
import json
import re
import shutil

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.files.read import read_problem, write_problem
from harness_opt.files.stored_results import read_motion, read_results
from oracles.problems import ROOT

BRANCH = ROOT / "problems" / "y_branch" / "y_branch.toml"


@pytest.fixture(scope="module")
def branch() -> ho.Problem:
    return read_problem(BRANCH)


def test_a_written_problem_reads_back(branch, tmp_path):
    again = read_problem(write_problem(branch, tmp_path / "again.toml"))
    assert again.bodies == branch.bodies
    assert again.cables == branch.cables
    assert (again.bodies["splice"].free, again.bodies["splice"].mass) == (True, 0.03)


WRONG = [
    ("free = true", "", "bodies.splice.mass: found 0.03, expected free = true beside it"),
    ("mass = 0.03", "mass = -1", "bodies.splice.mass: found -1, expected a number"),
    ("free = true", 'parent = "lamp"\nfree = true', 'bodies.splice.parent: found "lamp", expected none'),
    (
        "[parts.splice]",
        "[bodies.loose]\nfree = true\n[parts.splice]",
        "bodies.loose.free: found no cable that leads from it to what stands or moves",
    ),
    ("free = true", 'free = "yes"', 'bodies.splice.free: found "yes", expected true or false'),
    ('minimise = "change"', 'minimise = "clips"', 'design.minimise: found "clips", expected a clip with optional'),
]


@pytest.mark.parametrize(("given", "typed", "words"), WRONG, ids=[words[:40] for *_, words in WRONG])
def test_mistakes_are_named_by_their_keys(tmp_path, given, typed, words):
    text = BRANCH.read_text(encoding="utf-8")
    assert given in text
    file = tmp_path / "wrong.toml"
    file.write_text(text.replace(given, typed, 1), encoding="utf-8")
    with pytest.raises(ho.ProblemError) as caught:
        read_problem(file)
    assert any(words in line for line in caught.value.mistakes), caught.value.mistakes


def test_a_body_that_only_hangs_on_another_that_hangs_is_refused(branch):
    cable = branch.cables["lamp"]
    lost = dataclasses.replace(
        cable, start=dataclasses.replace(cable.start, body="a"), end=dataclasses.replace(cable.end, body="b")
    )
    bodies = {**branch.bodies, "a": ho.Body(free=True), "b": ho.Body(free=True)}
    with pytest.raises(ho.ProblemError, match=re.escape("bodies.a.free: found no cable")):
        dataclasses.replace(branch, cables={**branch.cables, "lost": lost}, bodies=bodies)


def test_a_body_in_python_checks_itself():
    with pytest.raises(ho.ProblemError, match="mass: found 1, expected free = true"):
        ho.Body(mass=1.0)
    with pytest.raises(ho.ProblemError, match="motion: found one, expected none"):
        ho.Body(ho.Slide((1, 0, 0), 0.0, 0.1), free=True)


@pytest.fixture(scope="module")
def result(branch, tmp_path_factory):
    """Return a written result of the branch with a sleeve on its trunk, and the motion that it is of."""
    trunk = branch.cables["trunk"]
    sleeve = ho.Clip(name="guide", kind="sleeve", at=0.15, position=(0.14, 0.0, 0.38), tangent=(1, 0, -0.5))
    cables = {**branch.cables, "trunk": dataclasses.replace(trunk, clips=(sleeve,))}
    problem = dataclasses.replace(branch, cables=cables, limits=dataclasses.replace(branch.limits, travel=0.05))
    motion = ho.simulate(problem, spatial_step=0.03)
    folder = tmp_path_factory.mktemp("results") / "branch"
    ho.write_results(motion, folder)
    return folder, motion


def test_what_was_found_is_read_back(result):
    folder, motion = result
    again = read_motion(folder)[0]
    assert set(again.problem.found) == {"splice", "trunk, guide"}
    for name, found in motion.problem.found.items():
        read = again.problem.found[name]
        for key in ("motion", "positions", "quaternions", "jumps", "kinks"):
            assert np.array_equal(getattr(found, key), getattr(read, key))
    assert again.problem.found["trunk, guide"].places is not None
    assert np.array_equal(
        again.problem.poses("splice", motion.motion)[0], motion.problem.poses("splice", motion.motion)[0]
    )
    assert np.array_equal(read_results(folder).found["splice"].positions, motion.problem.found["splice"].positions)


def test_the_summary_says_what_clips_do(result):
    folder, motion = result
    content = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    (clip,) = content["clips"]
    places = motion.problem.found["trunk, guide"].arc_lengths(motion.motion)
    assert (clip["cable"], clip["clip"], clip["kind"]) == ("trunk", "guide", "sleeve")
    assert clip["arc_length"] == pytest.approx([places[0], places.min(), places.max()])
    shapes = motion.cables["trunk"]
    station = shapes.clip_stations[0]
    force = np.linalg.norm(shapes.force[:, station] - shapes.force[:, station + 1], axis=1)
    assert clip["force"] == pytest.approx(force.max())
    (travel,) = [row for row in content["limits"] if row["name"] == "travel"]
    assert travel["worst"] == pytest.approx(np.ptp(motion.problem.found["trunk, guide"].places), rel=1e-3)
    assert travel["certified"] and travel["clip"] == "guide"


@pytest.mark.parametrize(
    "spoil",
    [
        pytest.param(lambda a: {k: v for k, v in a.items() if "found/splice" not in k}, id="a body is missing"),
        pytest.param(
            lambda a: {**a, "found/splice/quaternions": 2 * a["found/splice/quaternions"]}, id="not of unit length"
        ),
        pytest.param(lambda a: {**a, "found/splice/motion": a["found/splice/motion"][::-1]}, id="backwards"),
        pytest.param(lambda a: {**a, "found/splice/jumps": np.array([10_000.0])}, id="a jump beyond the end"),
        pytest.param(lambda a: {**a, "found/trunk, guide/places": np.zeros(3)}, id="places of another motion"),
    ],
)
def test_a_damaged_result_is_refused(result, tmp_path, spoil):
    folder, _ = result
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    with np.load(copy / "motion.npz") as stored:
        arrays = {name: stored[name] for name in stored.files}
    np.savez(copy / "motion.npz", **spoil(arrays))
    with pytest.raises(ho.HarnessError, match="damaged result"):
        read_motion(copy)
