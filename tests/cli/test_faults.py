"""What nobody foresaw ends with 70, one line and how to report it; 1 is a verdict and nothing else."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import click
import pytest

from harness_opt.cli import ending
from harness_opt.cli.commands import commands, main
from harness_opt.errors import HarnessError, SolveError, Status
from oracles.flap import FLAP, PLAIN, environment, put

REPORT = "please report it, with the files and what the same command says with --debug"


def failing(error: BaseException):
    def fail(*_: object, **__: object) -> None:
        raise error

    return fail


@pytest.mark.parametrize(
    ("error", "found"),
    [
        (ZeroDivisionError("by zero"), "a fault of its own (ZeroDivisionError: by zero"),
        (RuntimeError("two\nlines"), "a fault of its own (RuntimeError: two lines"),
        (RecursionError("too deep"), "a fault of its own (RecursionError: too deep"),
        (AssertionError(), "a fault of its own (AssertionError:"),
        (SystemExit(1), "a fault of its own (SystemExit: 1"),
        (MemoryError(), "too little memory, expected more; nothing was left half-written"),
    ],
)
@pytest.mark.parametrize("command", ["check", "simulate", "redesign", "study", "sensitivity"])
def test_what_nobody_foresaw_is_70_and_one_line(here, capsys, monkeypatch, command, error, found):
    monkeypatch.setattr("harness_opt.studies.study_file.toml_tables", failing(error))
    monkeypatch.setattr("harness_opt.files.read.toml_tables", failing(error))
    assert main([command, put(FLAP)]) == 70
    out, err = capsys.readouterr()
    assert out == ""
    (line,) = err.splitlines()
    assert line.startswith(f"harness-opt: found {found}") and line.endswith(REPORT)
    assert os.listdir() == ["flap.toml"]


def test_the_line_says_where(here, capsys, monkeypatch):
    monkeypatch.setattr("harness_opt.files.read.structured", failing(KeyError("spam")))
    assert main(["check", put(FLAP)]) == 70
    assert "(KeyError: 'spam', files/read.py:" in capsys.readouterr().err


@pytest.mark.parametrize("place", ["before", "after"])
def test_a_traceback_is_shown_where_it_is_asked_for(here, capsys, monkeypatch, place):
    monkeypatch.setattr("harness_opt.files.read.toml_tables", failing(KeyError("spam")))
    arguments = ["--debug", "check", put(FLAP)] if place == "before" else ["check", put(FLAP), "--debug"]
    assert main(arguments) == 70
    err = capsys.readouterr().err
    assert err.startswith("Traceback (most recent call last):") and err.rstrip().endswith(REPORT)


def test_every_command_takes_debug():
    assert all("--debug" in [name for p in c.params for name in p.opts] for c in commands.commands.values())


@pytest.mark.parametrize("moment", ["solve", "clearance", "write"])
def test_a_fault_in_the_middle_leaves_nothing_half_written(here, capsys, monkeypatch, moment):
    place = {
        "solve": "harness_opt.motion.simulate.simulate",
        "clearance": "harness_opt.clearance.measure.clearances",
        "write": "harness_opt.report.result_files.as_json",
    }[moment]
    monkeypatch.setattr(place, failing(MemoryError()))
    assert main(["simulate", put(FLAP), *PLAIN]) == 70
    assert "too little memory" in capsys.readouterr().err
    assert [entry.name for entry in here.rglob("*") if entry.is_file()] == ["flap.toml"]


def test_no_error_is_a_verdict():
    """Every error there is, thrown through the one place that ends commands: none of them comes out as 0 or 1."""
    errors: list[BaseException] = [
        kind() for kind in (ValueError, KeyError, OSError, MemoryError, SystemExit, EOFError)
    ]
    errors += [HarnessError("x"), SolveError("x", Status.STALLED), click.UsageError("x"), KeyboardInterrupt()]
    codes = [ending.code_of(failing(error), lambda: False) for error in errors]
    assert codes == [70, 70, 2, 70, 70, 70, 2, 3, 2, 130]


def test_memory_that_runs_out_for_real(here):
    resource = pytest.importorskip("resource")
    put(FLAP)
    limit = 900 * 2**20  # enough to begin, not for eighty million numbers more
    code = (
        f"import resource, sys; resource.setrlimit(resource.RLIMIT_AS, ({limit}, {limit}));"
        "import numpy, harness_opt.motion.simulate as s;"
        "s.simulate = lambda *a, **k: numpy.ones(10**9);"
        "from harness_opt.cli import main; sys.exit(main(['simulate', 'flap.toml', '--no-pictures']))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=here, env=environment() | {"OPENBLAS_NUM_THREADS": "1"}, text=True,
        capture_output=True, check=False,
    )  # fmt: skip
    assert resource is not None
    assert (done.returncode, "too little memory" in done.stderr) == (70, True), done.stderr
    assert os.listdir() == ["flap.toml"]


@pytest.mark.skipif(sys.platform == "win32", reason="no such signals there")
@pytest.mark.parametrize("module", ["click", "tomllib", "pydantic", "casadi", "trimesh", "scipy"])
def test_ctrl_c_is_heard_while_libraries_are_imported(here, module):
    """Some catch every exception while they are imported: what is asked for then is not forgotten."""
    hook = Path("hook")
    hook.mkdir()
    (hook / "sitecustomize.py").write_text(
        "import os, signal, sys\n"
        "class Once:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        f"        if name == {module!r} or name.startswith({module + '.'!r}):\n"
        "            sys.meta_path.remove(self)\n"
        "            os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.meta_path.insert(0, Once())\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    )
    import trimesh

    trimesh.creation.box((20, 20, 20)).export("ball.obj")
    put(FLAP.replace("sphere = { radius = 0.02 }", 'mesh = "ball.obj"\nmesh_unit = "mm"'))
    environ = environment()
    environ["PYTHONPATH"] = os.pathsep.join([str(hook.resolve()), environ["PYTHONPATH"]])
    done = subprocess.run(
        [sys.executable, "-m", "harness_opt", "simulate", "flap.toml", *PLAIN],
        cwd=here, env=environ, text=True, capture_output=True, check=False,
    )  # fmt: skip
    assert done.returncode == 130, done.stderr
    assert "Traceback (" not in done.stderr
    assert not Path("results").exists() or module == "casadi"  # in the middle of a solve: what is finished is kept
