"""A small study, tasks that end their worker, and ways to run studies as a user does, for the tests of studies."""

from __future__ import annotations

import csv
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterable
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

from harness_opt.files.quantities import Quantities
from harness_opt.files.read import toml_tables
from oracles.flap import FLAP, environment

STUDY = """\
schema = 1
title = "A flap, more or less"
problem = "flap.toml"
method = "monte carlo"
samples = 8
seed = 3

[vary]
"cables.lead.length" = { plus_minus = 0.01 }
"cables.lead.stiffness_percent" = { plus_minus = 30, deviation = 15 }
"parts.ball.position.y" = { deviation = 0.002 }
"""

LENGTHS = [{"cables.lead.length": length} for length in (0.3, 0.29, 0.31)]

# near enough for some variants to hold the limit and others not
NEAR = FLAP.replace("position = [0.08, 0, 0]", "position = [0.08, 0, 0.085]")


def placed(folder: Path, study: str = STUDY, problem: str = NEAR) -> Path:
    """Return the study file with its problem in ``folder``."""
    (folder / "flap.toml").write_text(problem)
    file = folder / "study.toml"
    file.write_text(study)
    return file


def quantities(problem: str = FLAP) -> Quantities:
    file = Path("flap.toml").absolute()
    return Quantities(toml_tables(problem.encode(), file), file)


def started(*arguments: str, cwd: Path) -> subprocess.Popen[str]:
    """Start the program as a user does, in a session of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "harness_opt", *arguments],
        cwd=cwd, env=environment(), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        stdin=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip


def rows(folder: Path) -> list[dict[str, str]]:
    with (folder / "variants.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def alive(session: int) -> list[int]:
    """Return the processes of a session that are still there, zombies not counted."""
    found = []
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        try:
            words = (entry / "stat").read_text().rpartition(")")[2].split()
        except OSError:  # it has just ended
            continue
        if int(words[3]) == session and words[0] != "Z":
            found.append(int(entry.name))
    return found


def gone(session: int, seconds: float) -> bool:
    """Return whether every process of a session ends within ``seconds``."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if not alive(session):
            return True
        time.sleep(0.05)
    return False


# --- executors and tasks -------------------------------------------------------------------------------


class Here(Executor):
    """Runs what it is given at once, in this process, and counts."""

    def __init__(self) -> None:
        self.count = 0

    def submit(self, function: Any, /, *arguments: Any, **named: Any) -> Future:
        self.count += 1
        future: Future = Future()
        future.set_result(function(*arguments, **named))
        return future


def squared(number: int) -> int:
    return number * number


def fatal_once(number: int, folder: str) -> int:
    """End the worker the first time that number 3 comes."""
    mark = Path(folder) / "died"
    if number == 3 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number * number


def fatal(number: int) -> int:
    """End every worker that number 3 comes to."""
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return number * number


def collected(finished: Iterable[tuple[Any, Any]]) -> dict[int, Any]:
    """Return results by the task's first argument; none may come twice."""
    found: dict[int, Any] = {}
    for task, outcome in finished:
        assert task[0] not in found
        found[task[0]] = outcome
    return found
