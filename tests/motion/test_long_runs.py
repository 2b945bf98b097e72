"""Long motions on fine meshes: past a limit frames go to disk, give the same results, and leave nothing behind."""

from __future__ import annotations

import itertools
import resource

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.motion import follower as following
from harness_opt.motion import frames as followed_frames
from harness_opt.motion import sweep as sweeps
from harness_opt.motion.common_mesh import common_mesh, on_mesh, on_one_mesh
from harness_opt.motion.frames import KEPT_FRAMES, Frames, Stretches, at_a_time, by_mesh
from harness_opt.motion.rows_on_disk import RowsOnDisk
from harness_opt.statics.mesh import ELEMENTS
from oracles.problems import PROBLEMS


@pytest.fixture(autouse=True)
def few_frames_are_a_block(monkeypatch):
    monkeypatch.setattr(followed_frames, "NODES_AT_A_TIME", 60)


def problem() -> ho.Problem:
    return ho.read_problem(PROBLEMS / "lift_arm" / "lift_arm.toml")


@pytest.mark.parametrize("rigour", ["full", "stable"])
def test_frames_on_disk_change_nothing(monkeypatch, rigour):
    values = np.linspace(0.0, 1.0, 120)
    found = []
    for most_held in (following.MOST_HELD, 100_000):
        monkeypatch.setattr(following, "MOST_HELD", most_held)
        found.append(sweeps.sweep(problem(), "lead", values, rigour=rigour))
    held, streamed = found
    assert held.frames.stowed == 0
    assert streamed.frames.stowed >= 120 - KEPT_FRAMES - at_a_time(streamed.frames[0])
    assert np.array_equal(held.origins, streamed.origins)
    assert np.array_equal(held.errors, streamed.errors)
    for before, after in zip(held.frames, streamed.frames, strict=True):
        assert np.array_equal(before.solution.x, after.solution.x)
    one, other = (vars(sweeps.cable_motion(swept)) for swept in found)
    for name, values in one.items():
        assert np.array_equal(values, other[name], equal_nan=True), name


def test_what_is_on_disk_takes_no_memory():
    values = np.linspace(0.0, 1.0, 100)
    given = sweeps.sweep(problem(), "lead", values, rigour="quick look").frames
    size = given[0].solution.x.nbytes
    frames = Frames(most_held=10 * size)
    for count, frame in enumerate(given, 1):
        frames.append(frame)
        assert len(frames) == count
        assert count - frames.stowed <= KEPT_FRAMES + at_a_time(frame)
    assert all(stub.solution.factor is None and not stub.solution.x.size for stub in frames._stowed)
    assert all("rod" not in vars(stub) and stub.trail is None for stub in frames._stowed)
    assert np.array_equal(frames.errors()[0], given.errors()[0])
    frames.cut(frames.stowed + 3)
    assert np.array_equal(frames[-1].solution.x, given[len(frames) - 1].solution.x)
    with pytest.raises(IndexError):
        frames[len(frames)]


@pytest.mark.parametrize("count", [0, 7, 60, 97])
def test_frames_that_are_cut_off_can_be_added_again(count):
    given = sweeps.sweep(problem(), "lead", np.linspace(0.0, 1.0, 100), rigour="quick look").frames
    frames = Frames(given, most_held=0)
    errors = frames.errors()[0]
    frames.cut(count)
    assert len(frames) == count
    for frame in given[count:]:
        frames.append(frame)
    assert len(frames) == len(given) and frames.stowed > 70
    assert all(np.array_equal(a.solution.x, b.solution.x) for a, b in zip(frames, given, strict=True))
    # a frame that came back from disk is estimated with a Jacobian of its own, in place of one from nearby
    assert frames.errors()[0] == pytest.approx(errors, rel=0.05)


@pytest.mark.parametrize("rows", [0, 1, 8])
def test_a_time_limit_that_strikes_on_the_way_to_disk_loses_nothing(monkeypatch, rows):
    given = sweeps.sweep(problem(), "lead", np.linspace(0.0, 1.0, 40), rigour="quick look").frames
    frames, written, write = Frames(most_held=0), [], RowsOnDisk.__setitem__

    def struck(self, number, row):
        written.append(number)
        if len(written) == rows + 1:
            raise KeyboardInterrupt
        write(self, number, row)

    monkeypatch.setattr(RowsOnDisk, "__setitem__", struck)
    count = 0
    with pytest.raises(KeyboardInterrupt):
        for frame in given:
            count += 1
            frames.append(frame)
    assert len(frames) == count
    for frame in given[count:]:
        frames.append(frame)
    assert frames.stowed > 0
    assert all(np.array_equal(a.solution.x, b.solution.x) for a, b in zip(frames, given, strict=True))


def test_the_file_has_no_name(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    rows = RowsOnDisk(3)
    rows[1], rows[0] = np.arange(3.0), np.full(3, np.pi)
    assert np.array_equal(rows[1], np.arange(3.0))
    assert np.array_equal(rows[0], np.full(3, np.pi))
    assert list(tmp_path.iterdir()) == []


def test_what_the_disk_refuses_stays_in_memory():
    given = np.random.default_rng(0).normal(size=(6, 10))
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    rows = RowsOnDisk(10)
    resource.setrlimit(resource.RLIMIT_FSIZE, (200, before[1]))  # two rows and a half
    try:
        for k, row in enumerate(given):
            rows[k] = row
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert len(rows._refused) == 4
    assert all(np.array_equal(rows[k], row) for k, row in enumerate(given))


def test_where_there_is_no_folder_for_it_rows_stay_in_memory(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", "set, so that the usual one is not taken")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "nowhere"))
    rows = RowsOnDisk(2)
    rows[0] = np.ones(2)
    assert np.array_equal(rows[0], np.ones(2))


def test_frames_on_several_meshes_are_a_sequence_and_come_onto_one():
    given = list(sweeps.sweep(problem(), "lead", np.linspace(0.0, 1.0, 9), rigour="quick look").frames)
    third = np.linspace(0.0, 1.0, 17) ** 1.2
    mixed = [*given[:3], *(on_mesh(frame, third, "gauss-newton") for frame in given[3:6]), *given[6:]]
    frames = Stretches()
    for count, frame in enumerate(mixed, 1):
        frames.append(frame)
        assert len(frames) == count and frames[-1] is frame
    assert [len(part) for part in frames.parts] == [len(part) for part in by_mesh(mixed)] == [3, 3, 3]
    for one, other in zip(frames, mixed, strict=True):
        assert np.array_equal(one.solution.x, other.solution.x)
    assert all(frame.solution.factor is None for frame in frames[:6])
    with pytest.raises(IndexError):
        frames[9]
    together = on_one_mesh(frames, "gauss-newton")
    assert len({frame.bound.mesh.tobytes() for frame in together}) == 1
    s = np.linspace(0.0, 1.0, 50)
    for one, other in zip(together, given, strict=True):
        assert np.max(np.abs(one.rod.sample(s).r - other.rod.sample(s).r)) < 1e-7
    frames.cut(4)
    assert [len(part) for part in frames.parts] == [3, 1]
    frames.append(mixed[4])
    assert [len(part) for part in frames.parts] == [3, 2]
    frames.cut(0)
    assert not len(frames)


def test_the_common_mesh_is_as_dense_as_all():
    left, right = np.linspace(0.0, 1.0, 17) ** 2, 1.0 - np.linspace(1.0, 0.0, 17) ** 2
    mesh = common_mesh([left, right])
    assert len(mesh) - 1 in ELEMENTS and mesh[0] == 0.0 and mesh[-1] == 1.0
    for one in (left, right):
        touched = [np.diff(one)[(one[1:] > a) & (one[:-1] < b)].max() for a, b in itertools.pairwise(mesh)]
        assert np.all(np.diff(mesh) <= 1.05 * np.array(touched))
