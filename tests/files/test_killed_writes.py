"""What a killed run leaves is hidden, and goes with the next one that writes there; nobody else's is touched."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from harness_opt.cli import main
from harness_opt.files.whole_folder import filling, locked, write_whole
from oracles.flap import FLAP, PLAIN, put

GONE = "4194305"  # no process has this number


@pytest.mark.skipif(os.name == "nt", reason="Windows cannot tell who holds a file")
def test_what_killed_writes_left_goes_and_what_is_held_stays(here):
    for name in (f".a.txt.{GONE}.part", f".b.txt.{GONE}.part", ".a.txt.part", ".a.txt.x.part"):
        Path(name).write_text("half")
    Path(f".a.txt.{GONE}1.part").write_text("of a run that goes on")
    with locked(Path(f".a.txt.{GONE}1.part")):
        write_whole(Path("a.txt"), b"whole")
    left = {".a.txt.part", ".a.txt.x.part", f".a.txt.{GONE}1.part", f".b.txt.{GONE}.part"}
    assert {entry.name for entry in here.iterdir()} == left | {"a.txt"}


@pytest.mark.skipif(os.name == "nt", reason="Windows cannot tell who holds a folder")
def test_a_killed_export_goes_with_the_next_one(here):
    Path(f".export.{GONE}.part", "frames").mkdir(parents=True)
    with filling(Path("export")) as aside:
        (aside / "motion.glb").write_bytes(b"glTF")
    assert sorted(entry.name for entry in here.iterdir()) == ["export"]


def test_a_killed_export_in_a_result_is_not_carried_over_to_the_next_result(here):
    put(FLAP)
    assert main(["simulate", "flap.toml", "-o", "r", "--quiet", *PLAIN]) == 0
    Path("r", f".export.{GONE}.part").mkdir()
    Path("r", "mine.txt").write_text("kept")
    assert main(["simulate", "flap.toml", "-o", "r", "--quiet", *PLAIN]) == 0
    assert Path("r", "mine.txt").exists()
    assert not Path("r", f".export.{GONE}.part").exists()


def test_nothing_is_written_through_a_link_in_the_place_of_a_file(here):
    Path("victim").write_text("mine")
    Path("a.txt").symlink_to("victim")
    write_whole(Path("a.txt"), b"new")
    assert Path("victim").read_text() == "mine"
    assert Path("a.txt").read_text() == "new" and not Path("a.txt").is_symlink()


def test_a_folder_that_may_not_be_looked_into_can_still_be_written(here):
    if os.name == "nt" or os.getuid() == 0:
        pytest.skip("rights mean nothing here")
    Path("dark").mkdir()
    Path("dark").chmod(0o300)
    write_whole(Path("dark", "a.txt"), b"new")
    Path("dark").chmod(0o700)
    assert Path("dark", "a.txt").read_bytes() == b"new"


def test_a_mount_point_is_refused_before_the_work_and_exported_into(here, capsys, monkeypatch):
    """A volume of a container: its name cannot be given to another folder, and nothing is renamed into it."""
    put(FLAP)
    assert main(["simulate", "flap.toml", "-o", "r", "--quiet", *PLAIN]) == 0
    Path("volume").mkdir()
    monkeypatch.setattr(Path, "is_mount", lambda self: self.name == "volume")

    def never(*_: object, **__: object) -> None:
        raise AssertionError("it was worked for")

    with monkeypatch.context() as patch:
        patch.setattr("harness_opt.motion.simulate.simulate", never)
        assert main(["simulate", "flap.toml", "-o", "volume", "--quiet", *PLAIN]) == 2
    assert "volume: found a mount point" in capsys.readouterr().err

    move = os.replace

    def within(one: os.PathLike[str], other: os.PathLike[str]) -> None:
        assert [Path(entry).is_relative_to(here / "volume") for entry in (one, other)] == [True, True]
        move(one, other)

    monkeypatch.setattr(os, "replace", within)
    assert main(["export", "r", "--to", "csv", "-o", "volume"]) == 0
    assert all(not entry.name.startswith(".") for entry in Path("volume").iterdir()) and any(Path("volume").iterdir())


def test_an_export_that_a_full_disk_ends_names_its_folder(here, capsys, monkeypatch):
    put(FLAP)
    assert main(["simulate", "flap.toml", "-o", "r", "--quiet", *PLAIN]) == 0

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("harness_opt.files.whole_folder.flush", full)
    assert main(["export", "r", "--to", "csv", "-o", "out"]) == 2
    assert capsys.readouterr().err == "harness-opt: out: No space left on device\n"
    assert not Path("out").exists()
