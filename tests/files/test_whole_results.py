"""Results are whole or absent: full disks, folders that cannot be written, runs that are killed at any moment."""

from __future__ import annotations

import contextlib
import errno
import os
import random
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from harness_opt.cli.commands import main
from harness_opt.errors import ProblemError
from harness_opt.files import result_folder, whole_folder
from harness_opt.files.result_folder import replacing
from harness_opt.files.stored_results import read_results
from oracles.flap import FLAP, HIT, PLAIN, environment, put, stand_in
from oracles.scripts import script

KILLS = 3  # of each command; scripts/checks/kill.py kills 50
COMMANDS = ("simulate", "redesign")
OURS = '{"command": "simulate", "versions": {"harness-opt": "0"}, "files": ["a.txt", "summary.json"]}'


@pytest.fixture
def earlier(tmp_path: Path) -> Path:
    """A result folder, as far as it needs to look like one."""
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "summary.json").write_text(OURS)
    (folder / "a.txt").write_text("old")
    return folder


def write(folder: Path) -> None:
    with replacing(folder) as aside:
        (aside / "a.txt").write_text("new")
        (aside / "summary.json").write_text(OURS)


def hidden(folder: Path) -> list[str]:
    return [entry.name for entry in folder.iterdir() if entry.name.startswith(".")]


# --- one step ------------------------------------------------------------------------------------------


@pytest.mark.skipif(not sys.platform.startswith(("linux", "darwin")), reason="no exchange of names there")
def test_folders_are_exchanged_in_one_step(earlier, tmp_path, monkeypatch):
    renamed = os.rename

    def rename(source: Path, target: Path) -> None:
        assert Path(target).name != "out", "the name was free for a moment"
        renamed(source, target)

    monkeypatch.setattr(os, "rename", rename)
    write(earlier)
    assert (earlier / "a.txt").read_text() == "new"
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_where_they_cannot_be_exchanged_they_are_renamed(earlier, tmp_path, monkeypatch):
    monkeypatch.setattr(whole_folder, "exchanged", lambda *_: False)
    write(earlier)
    assert (earlier / "a.txt").read_text() == "new"
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_a_second_rename_that_fails_brings_the_earlier_result_back(earlier, tmp_path, monkeypatch):
    monkeypatch.setattr(whole_folder, "exchanged", lambda *_: False)
    renamed = os.rename

    def rename(source: Path, target: Path) -> None:
        if Path(source).name.endswith(".part"):
            raise OSError(errno.EIO, "Input/output error")
        renamed(source, target)

    monkeypatch.setattr(os, "rename", rename)
    with pytest.raises(ProblemError, match="Input/output error"):
        write(earlier)
    assert (earlier / "a.txt").read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_what_others_put_there_is_in_both_results_until_the_end(earlier, monkeypatch):
    (earlier / "notes.txt").write_text("mine")
    (earlier / "deep" / "er").mkdir(parents=True)
    (earlier / "deep" / "er" / "sketch.txt").write_text("mine too")
    if sys.platform != "win32":
        (earlier / "link").symlink_to("nowhere")
    put_there = result_folder.put

    def last(aside: Path, target: Path) -> None:
        for place in (aside, target):
            assert (place / "notes.txt").read_text() == "mine"
            assert (place / "deep" / "er" / "sketch.txt").read_text() == "mine too"
        put_there(aside, target)

    monkeypatch.setattr(result_folder, "put", last)
    write(earlier)
    kept = {"a.txt", "deep", "notes.txt", "summary.json"} | ({"link"} if sys.platform != "win32" else set())
    assert {entry.name for entry in earlier.iterdir()} == kept
    assert (earlier / "a.txt").read_text() == "new"


def test_disks_without_second_names(earlier, monkeypatch):
    def refuse(*_: object, **__: object) -> None:
        raise OSError(errno.EPERM, "Operation not permitted")

    (earlier / "notes.txt").write_text("mine")
    monkeypatch.setattr(os, "link", refuse)
    write(earlier)
    assert (earlier / "notes.txt").read_text() == "mine"


# --- what killed runs leave ----------------------------------------------------------------------------


@pytest.mark.skipif(sys.platform == "win32", reason="no locks on folders there")
def test_leftovers_go_unless_somebody_is_at_work_on_them(earlier, tmp_path):
    for name in (".out.1.part", ".out.2.part", ".out.x.part", ".other.1.part", ".out.3.before"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "summary.json").write_text(OURS)
    with whole_folder.locked(tmp_path / ".out.2.part"):
        write(earlier)
    assert sorted(hidden(tmp_path)) == [".other.1.part", ".out.2.part", ".out.x.part"]
    write(earlier)
    assert sorted(hidden(tmp_path)) == [".other.1.part", ".out.x.part"]


@pytest.mark.skipif(sys.platform == "win32", reason="no locks on folders there")
def test_a_result_that_had_given_way_comes_back(tmp_path):
    """Killed between the two renames of a system that cannot exchange: the next run finds the earlier result."""
    before = tmp_path / ".out.7.before"
    before.mkdir()
    (before / "summary.json").write_text(OURS)
    (before / "notes.txt").write_text("mine")
    write(tmp_path / "out")
    assert (tmp_path / "out" / "notes.txt").read_text() == "mine"
    assert hidden(tmp_path) == []


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "kill") or sys.platform == "win32", reason="no SIGKILL there")
@pytest.mark.parametrize("command", COMMANDS)
def test_killed_at_any_moment(tmp_path, command):
    kill = script("kill")
    (tmp_path / "flap.toml").write_text(HIT)
    dice = random.Random(sum(command.encode()))
    ends = [kill.killed(command, tmp_path, dice, 3.0) for _ in range(KILLS)]
    assert set(ends) <= {"old", "new", "absent"}
    assert kill.started(command, tmp_path, "--no-pictures").wait(120) == {"simulate": 1, "redesign": 0}[command]
    read_results(tmp_path / "out" / "result")
    assert not kill.hidden(tmp_path / "out")


# --- disks and rights ----------------------------------------------------------------------------------


@contextlib.contextmanager
def mounted(folder: Path, options: str) -> Iterator[Path]:
    """Give a file system of its own, where this process may mount one."""
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", options, "harness-opt-test", str(folder)]
    try:
        done = subprocess.run(command, capture_output=True, check=False)
    except OSError:
        pytest.skip("no mount here")
    if done.returncode:
        pytest.skip("no right to mount")
    try:
        yield folder
    finally:
        subprocess.run(["umount", str(folder)], check=True)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_full_disk(here, capsys, command):
    put(HIT)
    with mounted(here / "disk", "size=20k") as disk:
        assert main([command, "flap.toml", *PLAIN, "-o", "disk/out"]) == 2
        out, err = capsys.readouterr()
        assert "Nothing was written." in out and "limit" in out, "what was found is shown all the same"
        assert "No space left on device" in err.splitlines()[-1] and "Traceback" not in err
        assert list(disk.iterdir()) == []


@pytest.mark.parametrize("command", COMMANDS)
def test_a_disk_that_fills_up_with_the_report_keeps_the_result(here, capsys, command):
    put(FLAP if command == "simulate" else HIT)
    with mounted(here / "disk", "size=150k" if command == "simulate" else "size=250k"):  # room for it without
        assert main([command, "flap.toml", "-o", "disk/out"]) == 2
        out, err = capsys.readouterr()
        assert "Results: disk/out" in out
        assert "No space left on device" in err.splitlines()[-1]
        stored = read_results("disk/out")
        assert stored.summary["status"] == "ok" and "report.html" not in stored.summary["files"]
        assert hidden(Path("disk")) == []


@pytest.mark.parametrize("command", COMMANDS)
def test_a_disk_for_reading_only(here, capsys, monkeypatch, command):
    solving = {"simulate": "harness_opt.motion.simulate.simulate", "redesign": "harness_opt.design.redesign.redesign"}
    monkeypatch.setattr(solving[command], None)
    put(FLAP)
    with mounted(here / "disk", "ro"):
        assert main([command, "flap.toml", *PLAIN, "-o", "disk/out"]) == 2, "before anything is solved"
        assert "found no right to write in" in capsys.readouterr().err


@pytest.mark.parametrize("place", ["mkdir", "fsync", "rename"])
def test_rights_that_are_lost_on_the_way(here, capsys, monkeypatch, place):
    assert main(["simulate", put(FLAP), *PLAIN, "-q"]) == 0
    before = read_results("results/flap").summary
    (here / "results" / "flap" / "notes.txt").write_text("mine")

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied", "results")

    with monkeypatch.context() as patch:
        patch.setattr(whole_folder, "exchanged", lambda *_: False)
        patch.setattr(os, place, refuse)
        assert main(["simulate", "flap.toml", *PLAIN]) == 2
    out, err = capsys.readouterr()
    assert "Permission denied" in err.splitlines()[-1] and "Traceback" not in err
    assert "All 3 limits hold." in out
    assert read_results("results/flap").summary == before
    assert (here / "results" / "flap" / "notes.txt").read_text() == "mine"


def test_a_disk_behind_stdout_that_is_full(here):
    if not Path("/dev/full").exists():
        pytest.skip("no such disk here")
    put(FLAP)
    for arguments in (["schema"], ["check", "flap.toml"], ["simulate", "flap.toml", *PLAIN, "-q", "--json"]):
        with Path("/dev/full").open("w") as full:
            done = subprocess.run(
                [sys.executable, "-m", "harness_opt", *arguments],
                cwd=here, env=environment(), stdout=full, stderr=subprocess.PIPE, text=True, check=False,
            )  # fmt: skip
        assert done.returncode == 2, arguments
        assert "No space left on device" in done.stderr and "Traceback" not in done.stderr


def test_a_disk_that_fills_up_with_pictures(here, capsys, monkeypatch):
    def draw(*_: object, **__: object) -> list[str]:
        raise ProblemError("results/flap: found no way to write film.mp4 (No space left on device), expected one")

    monkeypatch.setitem(sys.modules, "harness_opt.pictures.film", stand_in(write_pictures_and_film=draw))
    assert main(["simulate", put(FLAP), "--film"]) == 2
    out, err = capsys.readouterr()
    assert "No space left on device" in err.splitlines()[-1] and "Results: results/flap" in out
    assert "report.html" in read_results("results/flap").summary["files"]
