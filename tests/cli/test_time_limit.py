"""The time limit counts everything: reading, solving, measuring, pictures."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from harness_opt.cli import interrupts
from harness_opt.cli.commands import main
from harness_opt.files.stored_results import read_results
from oracles.flap import FLAP, PLAIN, put

LONG = 60.0  # s, that each phase would take


def dawdle(*_: object, **__: object) -> None:
    """Take long, a step at a time, as Python does."""
    end = time.monotonic() + LONG
    while time.monotonic() < end:
        time.sleep(0.01)
    raise AssertionError("waited for")


@pytest.mark.skipif(not hasattr(interrupts.signal, "setitimer"), reason="no timers there")
@pytest.mark.parametrize("place", ["harness_opt.files.read.read_problem", "harness_opt.parts.scene.load_scene"])
def test_reading_counts(here, capsys, monkeypatch, place):
    put(FLAP)
    monkeypatch.setattr(place, dawdle)
    begin = time.monotonic()
    assert main(["simulate", "flap.toml", *PLAIN, "--time-limit", "0.3"]) == 3
    assert time.monotonic() - begin < LONG / 2
    err = capsys.readouterr().err
    assert "flap.toml: found no end of reading the files within the time limit, 0.3 s; try a longer --time-limit" in err
    assert not Path("results").exists()


@pytest.mark.skipif(not hasattr(interrupts.signal, "setitimer"), reason="no timers there")
def test_pictures_count(here, monkeypatch):
    put(FLAP)
    monkeypatch.setattr("harness_opt.report.html_page.prepare", dawdle)
    begin = time.monotonic()
    assert main(["simulate", "flap.toml", "--time-limit", "5", "-q"]) == 0
    assert time.monotonic() - begin < LONG / 2
    assert read_results("results/flap").summary["status"] == "ok"


def test_measuring_counts_and_what_was_not_measured_is_no_verdict(here, capsys, monkeypatch):
    put(FLAP)
    monkeypatch.setattr(interrupts.Interrupts, "overdue", lambda _: True)
    monkeypatch.setattr(interrupts.Interrupts, "late", True)
    monkeypatch.setattr(interrupts.Interrupts, "stop_here", lambda _: None)
    assert main(["simulate", "flap.toml", *PLAIN, "--time-limit", "1000"]) == 3
    stored = read_results("results/flap").summary
    assert (stored["status"], stored["reason"]) == ("unsolved", "time_limit")
    assert "clearances of 2 pairs: the run was stopped before they were measured" in stored["left_out"]
    assert "Traceback" not in capsys.readouterr().err
