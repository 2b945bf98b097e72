"""Schedulers that go away, or do not let us in: told in seconds, with what is finished kept."""

from __future__ import annotations

import json
import os
import signal
import socket
import stat
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from harness_opt.errors import ProblemError
from harness_opt.studies.shared_problem import LocalProblem, carried_root
from harness_opt.studies.study import plan
from oracles.flap import FLAP, environment, put, run
from oracles.studies import STUDY, placed, started

SECONDS = 60.0  # within which all of it is told, Python and Dask started on a busy machine


@pytest.fixture
def scheduler(here) -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """The address of a scheduler with a worker, and its process."""
    pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
    processes = []

    def begin(room: str, *arguments: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.{room}", *arguments]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        processes.append(subprocess.Popen(command, env=environment(), **quiet))
        return processes[-1]

    place = here / "scheduler.json"
    options = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(place))
    process = begin("dask_scheduler", *options)
    end = time.monotonic() + SECONDS
    while not (place.exists() and place.read_text()) and time.monotonic() < end:
        time.sleep(0.05)
    address = json.loads(place.read_text())["address"]
    begin("dask_worker", address, "--no-nanny", "--nthreads", "1", "--no-dashboard")
    yield address, process
    for process in reversed(processes):
        process.kill()
        process.wait()


def test_a_scheduler_that_goes_away_is_told_in_seconds(here, scheduler):
    address, process = scheduler
    placed(here, STUDY.replace("samples = 8", "samples = 500"))
    running = started("study", "study.toml", "--scheduler", address, cwd=here)
    assert running.stdout is not None
    said = [next(line for line in running.stdout if line.startswith("variants: "))]
    process.kill()
    begin = time.monotonic()
    said += running.communicate(timeout=300)[0].splitlines(keepends=True)
    seconds = time.monotonic() - begin
    assert running.returncode == 2, "".join(said)
    assert "Traceback" not in "".join(said), "".join(said)
    assert "what is finished is kept: start the study again to go on" in "".join(said)
    assert seconds < SECONDS


def test_tls_without_keys_is_told_at_once(here):
    pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
    placed(here)
    begin = time.monotonic()
    done = run("study", "study.toml", "--scheduler", "tls://127.0.0.1:8786", cwd=here)
    assert done.returncode == 2
    assert "--scheduler: found no Dask scheduler at tls://127.0.0.1:8786" in done.stderr
    assert "Traceback" not in done.stderr and time.monotonic() - begin < SECONDS


def test_whoever_listens_and_says_nothing_is_not_waited_for(here):
    pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
    placed(here)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        begin = time.monotonic()
        done = run("study", "study.toml", "--scheduler", f"tcp://127.0.0.1:{silent.getsockname()[1]}", cwd=here)
    assert done.returncode == 2 and "Traceback" not in done.stderr
    assert time.monotonic() - begin < SECONDS


# --- where a worker keeps what it is sent ----------------------------------------------------------------


def test_what_workers_are_sent_is_its_user_s_and_its_study_s_alone(here, monkeypatch):
    monkeypatch.setattr("tempfile.gettempdir", lambda: str(here))
    put(FLAP)
    one, other = (plan("flap.toml", [{"cables.lead.length": 0.31}], kind).shared for kind in ("simulate", "redesign"))
    assert one.name != other.name
    places = [carried_root(shared.name) for shared in (one, other)]
    assert places[0] != places[1] and places[0].parent == places[1].parent
    if os.name == "posix":
        assert all(stat.S_IMODE(place.stat().st_mode) == 0o700 for place in (*places, places[0].parent))
        assert str(os.getuid()) in places[0].parent.name


@pytest.mark.skipif(os.name != "posix", reason="rights of files are told another way here")
@pytest.mark.parametrize("kind", ["open to all", "a link", "a file"])
def test_a_folder_that_somebody_else_prepared_is_not_used(here, monkeypatch, kind):
    monkeypatch.setattr("tempfile.gettempdir", lambda: str(here))
    place = here / f"harness-opt-{os.getuid()}"
    if kind == "open to all":
        place.mkdir()
        place.chmod(0o777)
    elif kind == "a link":
        (here / "theirs").mkdir(mode=0o700)
        place.symlink_to(here / "theirs")
    else:
        place.write_text("")
    with pytest.raises(ProblemError, match=f"^{place}: found "):
        carried_root("study")


def test_a_study_of_this_machine_needs_no_such_folder(here, monkeypatch):
    monkeypatch.setattr("tempfile.gettempdir", lambda: "/nowhere")
    put(FLAP)
    LocalProblem(plan("flap.toml", [{"cables.lead.length": 0.31}]).shared)
    assert signal.getsignal(signal.SIGINT) is not None and Path("flap.toml").exists()
