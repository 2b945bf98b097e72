"""Paths and profiles on disk: the same to the bit, and refused where they are none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import harness_opt as ho
from oracles.hinged import (
    POINTS,
    PROBLEM,
    TURNS,
)


def test_files_come_back_to_the_same_bits(tmp_path, motion):
    path, listed = ho.disperse(PROBLEM, "lead"), ho.profiles(motion, "lead")
    path.save(tmp_path / "path")  # the name as given, whatever its ending
    ho.save_profiles(tmp_path / "all.npz", listed)
    listed[3].save(tmp_path / "one.npz")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["all.npz", "one.npz", "path"]
    pairs = [(ho.Path.load(tmp_path / "path"), path), (ho.Profile.load(str(tmp_path / "one.npz")), listed[3])]
    for again, saved in (*pairs, *zip(ho.load_profiles(tmp_path / "all.npz"), listed, strict=True)):
        assert type(again) is type(saved)
        np.testing.assert_array_equal(again.position, saved.position)
        np.testing.assert_array_equal(again.rotation, saved.rotation)


def npz(**arrays: object):
    return lambda file: np.savez(file, **{name.replace("_", "/"): array for name, array in arrays.items()})


def cut_short(file: Path) -> None:
    npz(path_position=POINTS, path_rotation=TURNS)(file)
    file.write_bytes(file.read_bytes()[:-200])


def damaged(file: Path) -> None:
    npz(path_position=POINTS, path_rotation=TURNS)(file)
    content = bytearray(file.read_bytes())
    content[content.index(POINTS.tobytes()) + 9] ^= 0xFF
    file.write_bytes(content)


def single(file: Path) -> None:
    with file.open("wb") as handle:
        np.save(handle, POINTS)


@pytest.mark.parametrize(
    ("write", "words"),
    [
        (lambda file: None, "no way to read it .*No such file"),
        (lambda file: file.mkdir(), "no way to read it .*directory"),
        (lambda file: file.write_bytes(b""), "found a file that is none, or damaged"),
        (lambda file: file.write_bytes(b"t,x,y,z\n0,1,2,3\n"), "found a file that is none, or damaged"),
        (cut_short, "found a file that is none, or damaged"),
        (damaged, "found a file that is none, or damaged .*CRC"),
        (single, "found a single array"),
        (npz(), "found nothing, expected an npz archive of path/position and path/rotation"),
        (npz(lead_position=POINTS), "found lead/position, expected an npz archive of path/position"),
        (npz(profile_position=POINTS[None], profile_rotation=TURNS[None]), "found profile/position, profile/rotation"),
        (npz(path_position=np.array([None, 1]), path_rotation=TURNS), "found a file that is none, .*pickle"),
        (npz(path_position=POINTS, path_rotation=-TURNS), "rotation: found a matrix of determinant -1 at path point 0"),
    ],
    ids=[
        "missing", "folder", "empty", "text", "cut short", "damaged", "npy", "nothing in it", "another's", "profiles",
        "pickled", "no rotations",
    ],
)  # fmt: skip
def test_files_that_are_no_path(tmp_path, write, words):
    file = tmp_path / "path.npz"
    write(file)
    with pytest.raises(ho.ProblemError, match=rf"path\.npz: .*{words}"):
        ho.Path.load(file)


def test_files_that_are_no_profiles(tmp_path):
    file = tmp_path / "profiles.npz"
    two = [ho.Profile(POINTS, TURNS), ho.Profile(POINTS + 1.0, TURNS)]
    ho.save_profiles(file, two)
    with pytest.raises(ho.ProblemError, match="found 2 profiles, expected one"):
        ho.Profile.load(file)
    np.savez(file, **{"profile/position": np.stack([POINTS] * 2), "profile/rotation": np.stack([TURNS, -TURNS])})
    with pytest.raises(ho.ProblemError, match=r"profiles\.npz: profile 1: rotation: found .* at node 0"):
        ho.load_profiles(file)
    np.savez(file, **{"profile/position": POINTS, "profile/rotation": TURNS})
    with pytest.raises(ho.ProblemError, match=r"of shape \(4, 3\) .*expected \(P, N, 3\)"):
        ho.load_profiles(file)
    with pytest.raises(ho.ProblemError, match="profiles: found profiles of 3 and 4 nodes"):
        ho.save_profiles(file, [two[0], ho.Profile(POINTS[:3], TURNS[:3])])
    with pytest.raises(ho.ProblemError, match="profiles: found none"):
        ho.save_profiles(file, [])


def test_places_that_cannot_be_written(tmp_path):
    path = ho.Path(POINTS, TURNS)
    for place in (tmp_path / "nowhere" / "path.npz", tmp_path):
        with pytest.raises(ho.ProblemError, match="found no way to write it"):
            path.save(place)
    assert not any(tmp_path.iterdir()) and not list(tmp_path.parent.glob(f".{tmp_path.name}*.part"))
