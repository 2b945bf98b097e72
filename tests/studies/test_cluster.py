"""Studies on a real Dask cluster of one scheduler and two workers, each a process of its own."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from oracles.flap import environment, run
from oracles.studies import STUDY, placed, rows, started

pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")

STARTING = 60.0  # s for a scheduler or a worker to start, on a busy machine
LOOK = 0.02  # s between two looks


@contextlib.contextmanager
def cluster(folder: Path, workers: int) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """Give the address of a scheduler, and the processes of its workers."""
    with contextlib.ExitStack() as stack:

        def begin(room: str, *arguments: str) -> subprocess.Popen[bytes]:
            process = subprocess.Popen(
                [sys.executable, "-m", f"distributed.cli.{room}", *arguments],
                cwd=folder, env=environment(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            )  # fmt: skip
            stack.callback(process.wait)
            stack.callback(process.kill)
            return process

        place = folder / "scheduler.json"
        begin("dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(place))
        address = json.loads(_text(place))["address"]
        options = ("--no-nanny", "--nthreads", "1", "--no-dashboard", "--local-directory", str(folder / "spill"))
        yield address, [begin("dask_worker", address, *options, "--name", f"w{i}") for i in range(workers)]


def _text(file: Path) -> str:
    end = time.monotonic() + STARTING
    while time.monotonic() < end:
        with contextlib.suppress(OSError):
            if text := file.read_text():
                return text
        time.sleep(LOOK)
    raise TimeoutError(f"{file} was not written")


def test_the_same_table_on_a_cluster_that_loses_a_worker(here):
    study = STUDY.replace("samples = 8", "samples = 24")
    alone, spread = here / "alone", here / "spread"
    for folder in (alone, spread):
        folder.mkdir()
        placed(folder, study)
    assert run("study", "study.toml", "-q", cwd=alone).returncode == 1
    with cluster(here, 2) as (address, workers):
        process = started("study", "study.toml", "--scheduler", address, cwd=spread)
        assert process.stdout is not None
        said = []
        for line in process.stdout:  # a line now and then: the first ones come while most is to be done
            said.append(line)
            if line.startswith("variants: "):
                time.sleep(2.0)  # to about half of them
                os.kill(workers[0].pid, signal.SIGKILL)
                break
        said += process.communicate()[0].splitlines(keepends=True)
        assert process.returncode == 1, "".join(said)
    table = rows(spread / "results/study")
    assert [int(row["number"]) for row in table] == list(range(24)), "none lost, none doubled"
    tables = [(folder / "results/study/variants.csv").read_bytes() for folder in (alone, spread)]
    assert tables[0] == tables[1]


def test_workers_elsewhere_are_sent_the_meshes(folder, monkeypatch):
    """The workers start after the mesh has gone from where the study found it, as on a machine of their own."""
    from harness_opt.studies.cluster import cluster as connected
    from harness_opt.studies.study import plan
    from harness_opt.studies.variant import run_variant
    from oracles.problem_files import CONTRACT

    (folder / "lift.toml").write_text(CONTRACT.replace("position = [0, 0.055, 0.12]", "position = [0, 0.2, 0.12]"))
    planned = plan(folder / "lift.toml", [{"motion.spatial_step": 0.1}])
    monkeypatch.setenv("TMPDIR", str(folder / "elsewhere"))
    (folder / "elsewhere").mkdir()
    with cluster(folder, 0) as (address, _), connected(address, planned.shared) as executor:
        future = executor.submit(run_variant, planned.shared, 0, planned.variants[0])
        (folder / "meshes" / "housing.stl").unlink()
        options = ("--no-nanny", "--nthreads", "1", "--no-dashboard")
        worker = subprocess.Popen(
            [sys.executable, "-m", "distributed.cli.dask_worker", address, *options],
            cwd=folder / "elsewhere", env=environment(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        try:
            result = future.result(timeout=STARTING)
        finally:
            worker.kill()
            worker.wait()
    assert result.status in ("ok", "violated"), result.reason
    assert "clearance.lead.housing" in result.margins


def test_a_scheduler_that_is_not_there(here):
    with socket.socket() as nobody:  # bound, and not listening: refuses whoever comes
        nobody.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{nobody.getsockname()[1]}"
        placed(here)
        begin = time.monotonic()
        done = run("study", "study.toml", "--scheduler", address, cwd=here)
    assert done.returncode == 2
    assert f"--scheduler: found no Dask scheduler at {address}" in done.stderr
    assert "Traceback" not in done.stderr
    assert time.monotonic() - begin < STARTING
    assert sorted(os.listdir(here)) == ["flap.toml", "study.toml"], "nothing is written"


@pytest.mark.parametrize("address", ["cluster:port", "carrier-pigeon://coop"])
def test_an_address_that_is_none(here, address):
    placed(here)
    done = run("study", "study.toml", "--scheduler", address, cwd=here)
    assert done.returncode == 2
    assert f"--scheduler: found no Dask scheduler at {address}" in done.stderr
    assert "Traceback" not in done.stderr


def test_without_the_extra(here, capsys, monkeypatch):
    from harness_opt.cli.commands import main

    monkeypatch.setitem(sys.modules, "distributed", None)
    monkeypatch.delitem(sys.modules, "harness_opt.studies.cluster", raising=False)
    placed(here)
    assert main(["study", "study.toml", "--scheduler", "tcp://127.0.0.1:1"]) == 2
    assert 'try pip install "harness-opt[cluster]"' in capsys.readouterr().err
