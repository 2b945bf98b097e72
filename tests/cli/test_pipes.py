"""Readers that go away, streams that are full or closed: the work is written, and the exit code is the verdict's."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from harness_opt.files.stored_results import read_results
from oracles.flap import FLAP, HIT, PLAIN, environment, put

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="a shell of POSIX")

PROGRAM = f"{sys.executable} -m harness_opt"
STUDY = 'schema = 1\nproblem = "flap.toml"\nmethod = "list"\n[[variants]]\n"cables.lead.length" = 0.31\n'
READERS = {
    "head of both": "{} 2>&1 | head -1; exit ${{PIPESTATUS[0]}}",
    "no reader": "{} 2>&1 | true; exit ${{PIPESTATUS[0]}}",
    "no reader of words": "{} 2> >(true)",
    "words full": "{} 2> /dev/full",
    "words closed": "{} 2>&-",
    "results closed": "{} >&-",
    "all closed": "{} >&- 2>&- <&-",
    "words full, results closed": "{} >&- 2> /dev/full",
}


def shell(command: str, reader: str, here: Path) -> int:
    line = READERS[reader].format(f"{PROGRAM} {command}")
    done = subprocess.run(["bash", "-c", line], cwd=here, env=environment(), check=False, capture_output=True)
    return done.returncode


@pytest.mark.parametrize("reader", READERS)
def test_a_run_is_written_whoever_reads(here, reader):
    put(FLAP.replace("spatial_step = 0.01", "spatial_step = 0.001"))
    assert shell("simulate flap.toml -o out", reader, here) == 0
    assert read_results("out").summary["status"] == "ok"
    assert {"report.html", "motion.npz"} <= {entry.name for entry in Path("out").iterdir()}


@pytest.mark.parametrize("reader", ["head of both", "words full", "all closed"])
def test_a_verdict_stays_a_verdict(here, reader):
    put(HIT)
    assert shell("simulate flap.toml -o out --no-pictures", reader, here) == 1
    assert shell("redesign flap.toml -o better --no-pictures", reader, here) == 0
    assert shell("check flap.toml", reader, here) == 0
    assert shell("check missing.toml", reader, here) == 2
    assert shell("--help", reader, here) == 0
    assert (here / "better" / "redesigned.toml").exists()


@pytest.mark.parametrize("reader", ["head of both", "words full", "all closed"])
def test_a_study_is_finished_too(here, reader):
    put(FLAP)
    put(STUDY, "study.toml")
    assert shell("study study.toml -o out --workers 1", reader, here) == 0
    assert (here / "out" / "variants.csv").exists()


def test_a_closed_stream_is_never_a_file_of_the_results(here):
    """Files that are opened take the lowest number that is free: that of stdout, were it left closed."""
    put(FLAP)
    assert shell(f"simulate flap.toml -o out --json {PLAIN[0]}", "all closed", here) == 0
    assert len(read_results("out").motion)


def test_an_exit_code_is_kept_while_python_ends(here):
    """What is still in a buffer when the reader has gone must not turn 0 into Python's 120."""
    assert shell("schema", "no reader", here) == 0
    assert shell("completion bash", "results closed", here) == 0
