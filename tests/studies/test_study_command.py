"""The command: the same table through kills, lost workers and interrupts."""

from __future__ import annotations

import json
import os
import random
import signal
import time

import pytest

from harness_opt.cli.commands import main
from oracles.flap import run, strict
from oracles.studies import (
    STUDY,
    alive,
    gone,
    placed,
    rows,
    started,
)


@pytest.fixture(scope="module")
def alone(tmp_path_factory) -> tuple[bytes, dict]:
    """The table of the study, run without a break, and its summary."""
    folder = tmp_path_factory.mktemp("alone")
    placed(folder)
    done = run("study", "study.toml", "--json", "-q", cwd=folder)
    assert done.returncode == 1, done.stderr
    return (folder / "results/study/variants.csv").read_bytes(), strict(done.stdout)


def test_the_command(alone):
    table, summary = alone
    assert summary["status"] == "violated" and summary["finished"] == summary["variants"] == 8
    assert sum(summary["counts"].values()) == 8
    assert 0 < summary["yield"] < 1
    assert table.count(b"\n") == 9


@pytest.mark.slow
def test_killed_at_random_moments_and_started_again(here, alone):
    file = placed(here)
    moments = random.Random(11)
    for _ in range(10):
        process = started("study", file.name, "-q", cwd=here)
        store = here / "results/study/study.sqlite"
        end = time.monotonic() + moments.uniform(0.2, 6.0)
        while time.monotonic() < end and process.poll() is None:
            time.sleep(0.01)
        process.kill()  # nothing where it has ended by itself
        process.communicate()
        assert gone(process.pid, 20.0), "no worker outlives its study"
        assert not (here / "results/study/summary.json").exists() or store.exists()
    done = run("study", file.name, "-q", cwd=here)
    assert done.returncode == 1, done.stderr
    assert (here / "results/study/variants.csv").read_bytes() == alone[0]


def test_a_killed_worker(here, alone):
    file = placed(here)
    process = started("study", file.name, "--workers", "2", cwd=here)
    while len(alive(process.pid)) < 3:  # the study, and its workers
        assert process.poll() is None
        time.sleep(0.02)
    while not (store := here / "results/study/study.sqlite").exists() or store.stat().st_size < 8192:
        time.sleep(0.02)
    victim = max(alive(process.pid))
    assert victim != process.pid
    os.kill(victim, signal.SIGKILL)
    output, _ = process.communicate()
    assert process.returncode == 1, output
    assert (here / "results/study/variants.csv").read_bytes() == alone[0]


def test_an_interrupt_keeps_what_is_finished(here, alone):
    file = placed(here)
    process = started("study", file.name, "--workers", "1", cwd=here)
    assert process.stdout is not None
    for line in process.stdout:
        if "1 of 8" in line:
            break
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the workers too
    output, _ = process.communicate()
    assert process.returncode == 130, output
    assert "Traceback" not in output and "is kept" in output
    kept = rows(here / "results/study")
    assert 0 < len(kept) < 8
    assert json.loads((here / "results/study/summary.json").read_text())["finished"] == len(kept)
    assert run("study", file.name, "-q", cwd=here).returncode == 1
    assert (here / "results/study/variants.csv").read_bytes() == alone[0]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"cables.lead.length"', '"cables.lead.lenght"', "did you mean 'cables.lead.length'?"),
        ("plus_minus = 0.01", "plus_minus = 0.4", "distribution from -0.1"),
        ('"flap.toml"', '"flop.toml"', "no such file"),
    ],
)
def test_bad_input_is_refused_at_once_and_writes_nothing(here, capsys, old, new, words):
    file = placed(here, STUDY.replace(old, new))
    assert main(["study", str(file)]) == 2
    out, err = capsys.readouterr()
    assert words in err and not out
    assert sorted(os.listdir(here)) == ["flap.toml", "study.toml"]


def test_a_folder_of_something_else_is_refused(here, capsys):
    file = placed(here)
    assert main(["simulate", "flap.toml", "--no-pictures", "-q", "-o", "out"]) == 0
    assert main(["study", str(file), "-o", "out"]) == 2
    assert "out: found the results of another command" in capsys.readouterr().err
    (here / "mine").mkdir()
    (here / "mine" / "letter.txt").write_text("Dear")
    assert main(["study", str(file), "-o", "mine"]) == 2
    assert "found files that are no result" in capsys.readouterr().err
