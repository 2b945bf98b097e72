"""Results from many hands: damaged ones are told from whole ones, and nothing in them is run."""

from __future__ import annotations

import json
import os
import re
import zipfile
from pathlib import Path

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.cli.commands import main
from harness_opt.cli.redesign import interrupted
from harness_opt.errors import HarnessError, ProblemError
from harness_opt.files import arrays as stored_arrays
from harness_opt.files.read import read_problem
from harness_opt.files.stored_results import read_motion, read_results
from oracles.flap import FLAP, PLAIN, put


@pytest.fixture
def result(here: Path) -> Path:
    assert main(["simulate", put(FLAP), *PLAIN, "-q", "-o", "out"]) == 0
    return here / "out"


def spoil(result: Path, name: str, **arrays: np.ndarray) -> None:
    with np.load(result / name) as stored:
        kept = dict(stored)
    np.savez(result / name, **{**kept, **arrays})


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("motion", np.array([0.0, np.nan])),
        ("motion", np.zeros((2, 2))),
        ("lead/position", np.zeros((1, 1, 3))),
        ("lead/force", np.full((4, 101, 3), np.inf)),
        ("lead/position", np.full((4, 101, 3), 1e300) * np.resize([1.0, -1.0], (101, 1))),
        ("lead/quaternion", np.full((4, 101, 4), 1e300)),
        ("lead/s", np.zeros(101)),
        ("lead/s", np.array(["x"])),
        ("lead/residual", np.zeros(3)),
    ],
    ids=lambda given: given if isinstance(given, str) else f"{given.flat[0]}",
)
def test_arrays_that_do_not_fit(result: Path, key: str, value: np.ndarray) -> None:
    spoil(result, "motion.npz", **{key: value})
    with pytest.raises(ProblemError, match="found a damaged result"):
        read_results(result)
    with pytest.raises(HarnessError, match="found a damaged result"):
        read_motion(result)
    assert main(["export", str(result), "--to", "csv"]) == 2


def test_what_is_not_known_of_a_frame_may_be_missing(result: Path) -> None:
    with np.load(result / "motion.npz") as stored:
        kept = {name: stored[name] for name in stored.files if not name.endswith("residual")}
    np.savez(result / "motion.npz", **kept)
    assert np.all(np.isnan(read_results(result).cables["lead"].residual))


def test_archives_that_promise_more_than_they_hold(result: Path, monkeypatch) -> None:
    head = {"descr": "<f8", "fortran_order": False, "shape": (10**12,)}
    with (
        zipfile.ZipFile(result / "motion.npz", "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("motion.npy", "w") as f,
    ):
        np.lib.format.write_array_header_1_0(f, head)
    with pytest.raises(ProblemError, match="damaged"):
        read_results(result)
    # and what unpacks to more than fits is refused before it is unpacked
    with zipfile.ZipFile(result / "motion.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("motion.npy", bytes(10**6))
    assert (result / "motion.npz").stat().st_size < 2000
    monkeypatch.setattr(stored_arrays, "MOST_BYTES", 10**5)
    with pytest.raises(ProblemError, match="1,000,000 bytes of arrays, of which at most 100,000 are read"):
        read_results(result)


def test_archives_of_profiles_too(tmp_path: Path, monkeypatch) -> None:
    np.savez_compressed(
        tmp_path / "p.npz", **{"profiles/position": np.zeros((2000, 3)), "profiles/rotation": np.zeros(9)}
    )
    monkeypatch.setattr(stored_arrays, "MOST_BYTES", 10_000)
    with pytest.raises(ProblemError, match="bytes of arrays, of which at most 10,000 are read"):
        ho.load_profiles(tmp_path / "p.npz")


def test_pickles_are_not_opened(result: Path) -> None:
    spoil(result, "motion.npz", motion=np.array([print], dtype=object))
    with pytest.raises(ProblemError, match="damaged"):
        read_results(result)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
@pytest.mark.parametrize("name", ["motion.npz", "summary.json", "used/problem.toml"])
def test_results_with_pipes_for_files(here: Path, result: Path, name: str) -> None:
    """Opening one would wait for ever."""
    file = result / name
    file.unlink()
    os.mkfifo(file)
    assert main(["export", str(result), "--to", "csv"]) == 2


@pytest.mark.parametrize("files", [5, {"a": 1}, [1.5], [None, "motion.npz"], "motion.npz"])
def test_a_summary_with_files_that_are_none(result: Path, files: object) -> None:
    content = json.loads((result / "summary.json").read_text()) | {"files": files}
    (result / "summary.json").write_text(json.dumps(content))
    assert main(["export", str(result), "--to", "csv"]) == 2
    assert main(["simulate", "flap.toml", *PLAIN, "-q", "-o", "out"]) == 2, "no result of ours gives way"


@pytest.mark.parametrize("content", [b"\xff", b"[]", b'{"command": "simulate"}', b'{"a":' * 10_000])
def test_summaries_that_are_none(result: Path, content: bytes) -> None:
    (result / "summary.json").write_bytes(content)
    with pytest.raises(ProblemError, match="found"):
        read_results(result)
    with pytest.raises(HarnessError, match="found"):
        read_motion(result)


def test_a_summary_with_a_number_of_a_thousand_digits(result: Path) -> None:
    summary = result / "summary.json"
    text = re.sub(r'"margin": [^,]*', '"margin": ' + "9" * 1000, summary.read_text())
    summary.write_text(text)
    with pytest.raises(HarnessError, match="found a damaged result"):
        read_motion(result)


def test_no_shape_that_is_not_finite_is_written(result: Path) -> None:
    stored = read_results(result)
    cable = stored.cables["lead"]
    cable.force[0, 0, 0] = np.nan
    with pytest.raises(ValueError, match="not finite in lead/force"):
        stored_arrays.write_arrays(result / "other.npz", stored.motion, {"lead": cable})
    assert not (result / "other.npz").exists()


@pytest.mark.parametrize(
    "damage",
    [
        {"problem": []},
        {"redesign": None},
        {"redesign": {"variables": {"lead.length": {"after": "long"}}}},
        {"redesign": {"variables": {"lead.length": {}}}},
        {"redesign": {"variables": {"lead.length": {"after": 0.3}}, "history": [{"colour": "red"}]}},
        {"redesign": {"variables": {"lead.length": {"after": 0.3}}, "history": 3}},
    ],
    ids=str,
)
def test_a_damaged_redesign_is_begun_anew(here: Path, damage: dict[str, object]) -> None:
    problem = read_problem(put(FLAP))
    content = {"command": "redesign", "versions": {"harness-opt": "0"}, "reason": "interrupted"}
    content |= {"problem": {"sha256": problem.sha256}, "redesign": {"variables": {"lead.length": {"after": 0.3}}}}
    (here / "out").mkdir()
    (here / "out" / "summary.json").write_text(json.dumps(content))
    assert interrupted(here / "out", problem) is not None
    (here / "out" / "summary.json").write_text(json.dumps(content | damage))
    assert interrupted(here / "out", problem) is None
