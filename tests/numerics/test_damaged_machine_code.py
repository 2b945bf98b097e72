"""Machine code that is damaged, cut, foreign or cannot be made: built once more, or done without, with a line."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
import time
from pathlib import Path

import casadi as ca
import platformdirs
import pytest

import harness_opt as ho
from harness_opt.cli.commands import main
from harness_opt.files.stored_results import read_results
from harness_opt.numerics import machine_code
from oracles.flap import FLAP, put

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="compilers are found another way there")
REAL = machine_code.shutil.which("cc")


def forget() -> None:
    machine_code._try_out.cache_clear()
    machine_code._compiler.cache_clear()


@pytest.fixture
def cached(tmp_path, monkeypatch) -> Path:
    """An empty cache folder, and nothing remembered of other tests."""
    monkeypatch.setattr(platformdirs, "user_cache_path", lambda *_, **__: tmp_path / "cache")
    forget()
    yield tmp_path / "cache" / "machine_code"
    forget()


@pytest.fixture
def works(cached) -> None:
    try:
        with ho.compiled():
            pass
    except ho.CompilerError as error:
        pytest.skip(f"nothing can be compiled here: {error}")


def cube() -> ca.Function:
    x = ca.SX.sym("x")
    return ca.Function("cube", [x], [x * x * x])


def said(caplog) -> list[str]:
    return [record.getMessage() for record in caplog.records]


DAMAGE = {
    "cut": lambda file: os.truncate(file, file.stat().st_size // 2),
    "empty": lambda file: os.truncate(file, 0),
    "a bit": lambda file: file.write_bytes(bytes([*file.read_bytes()[:-1], file.read_bytes()[-1] ^ 1])),
    "foreign": lambda file: file.write_bytes(Path(sys.executable).resolve().read_bytes()[:200_000]),
    "text": lambda file: file.write_text("hello"),
}


@pytest.mark.parametrize("kind", DAMAGE)
def test_what_is_damaged_is_compiled_again(works, cached, caplog, kind):
    assert float(machine_code.built(cube())(2.0)) == 8.0
    (library,) = cached.glob("cube-*")
    fresh = library.with_suffix(".copy")
    fresh.write_bytes(library.read_bytes())  # the loaded one stays as it is
    DAMAGE[kind](fresh)
    fresh.replace(library)
    assert float(machine_code.built(cube())(3.0)) == 27.0
    (line,) = said(caplog)
    assert line == f"{library}: found damaged machine code, expected what was compiled: compiling it again"
    (again,) = cached.glob("cube-*")
    assert machine_code._digest(again) == again.stem.rpartition("-")[2]


def test_what_was_made_for_another_system_is_compiled_again(works, cached, caplog):
    machine_code.built(cube())
    (library,) = cached.glob("cube-*")
    stem = library.stem.rpartition("-")[0]
    library.unlink()
    other = cached / "other.so"
    other.write_bytes(b"\x7fELF of another processor")
    other.rename(cached / f"{stem}-{machine_code._digest(other)}.so")  # whole, as it was made, and of no use here
    assert float(machine_code.built(cube())(3.0)) == 27.0
    assert said(caplog) == []


def test_a_killed_compilation_leaves_nothing_for_ever(works, cached):
    old, young = cached / "compiling-old", cached / "compiling-young"
    for place in (old, young):
        place.mkdir()
    os.utime(old, (0, 0))
    machine_code.cache_folder()
    assert not old.exists() and young.exists()


# --- compilers -------------------------------------------------------------------------------------------

COMPILERS = {
    "hangs": ("sleep 60", "took longer than 1 s"),
    "hangs with children": ("sleep 60 & wait", "took longer than 1 s"),
    "odd bytes": (r"printf '\377\376 no\n' >&2; exit 1", "\ufffd\ufffd no"),
    "nothing": ("exit 0", "made nothing"),
    "an empty file": (': > "${@: -2:1}"; exit 0', "made nothing"),
    "rubbish": ('echo rubbish > "${@: -2:1}"; exit 0', "machine code can't be run from there"),
    "a full disk": ("echo 'No space left on device' >&2; exit 1", "No space left on device"),
    "killed": ("kill -9 $$", "the C compiler failed"),
}


def stand_in(folder: Path, monkeypatch, body: str, probe: str = "") -> None:
    """Have the compiler be a script, which does ``probe`` where it is to compile the first function."""
    script = folder / "cc"
    version = '[ "$1" = --version ] && echo 1.0 && exit 0'
    first = f'grep -q probe "${{@: -4:1}}" && {{ {probe}; }}' if probe else ":"
    script.write_text(f"#!/bin/bash\n{version}\n{first}\n{body}\n")
    script.chmod(0o755)
    monkeypatch.setattr(machine_code.shutil, "which", lambda _name: str(script))
    forget()


@pytest.mark.parametrize("kind", COMPILERS)
def test_a_compiler_that_fails_is_done_without(cached, here, capsys, monkeypatch, kind):
    body, words = COMPILERS[kind]
    monkeypatch.setattr(machine_code, "ASKING", 1.0)
    stand_in(here, monkeypatch, body)
    begin = time.monotonic()
    assert main(["simulate", put(FLAP), "--compile", "-q", "--no-pictures"]) == 0
    assert time.monotonic() - begin < 30
    err = capsys.readouterr().err
    assert "--compile: " in err and words in err and len(err.splitlines()) == 1
    assert read_results("results/flap").summary["status"] == "ok"
    assert not list(cached.glob("*"))


@pytest.mark.skipif(REAL is None, reason="no compiler here")
@pytest.mark.parametrize("kind", COMPILERS)
def test_a_compiler_that_fails_after_the_first_try_is_done_without_too(cached, here, caplog, monkeypatch, kind):
    body, words = COMPILERS[kind]
    monkeypatch.setattr(machine_code, "LONGEST", 1.0)
    stand_in(here, monkeypatch, body, probe=f'exec {REAL} "$@"')
    with caplog.at_level(logging.WARNING), ho.compiled():
        assert machine_code.wanted()
        assert float(machine_code.built(cube())(3.0)) == 27.0
        assert not machine_code.wanted()  # one failure is enough: nothing is waited for twice
    (line,) = said(caplog)
    assert words in line and line.endswith("going on without machine code: the results are the same")


def test_a_compiler_that_hangs_leaves_no_process(cached, here, monkeypatch):
    monkeypatch.setattr(machine_code, "ASKING", 1.0)
    stand_in(here, monkeypatch, "echo $$ > pid; sleep 61 & echo $! >> pid; wait")
    with pytest.raises(ho.CompilerError, match="took longer than 1 s"), ho.compiled():
        pass
    for number in Path("pid").read_text().split():
        end = time.monotonic() + 5
        while Path("/proc", number).exists() and time.monotonic() < end:
            time.sleep(0.05)
        state = Path("/proc", number, "stat")
        assert not state.exists() or state.read_text().rpartition(")")[2].split()[0] == "Z"


# --- folders ---------------------------------------------------------------------------------------------


def test_a_cache_where_nothing_may_be_run_is_done_without(cached, here, capsys):
    cached.mkdir(parents=True, mode=0o700)
    options = ["mount", "-t", "tmpfs", "-o", "noexec,mode=700", "harness-opt-test", str(cached)]
    if sys.platform != "linux" or subprocess.run(options, capture_output=True, check=False).returncode:
        pytest.skip("nothing can be mounted here")
    try:
        assert main(["simulate", put(FLAP), "--compile", "-q", "--no-pictures"]) == 0
    finally:
        subprocess.run(["umount", "-l", str(cached)], check=True)
    assert "machine code can't be run from there" in capsys.readouterr().err


def test_a_cache_that_is_full_is_done_without(works, cached, caplog, monkeypatch):
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    assert float(machine_code.built(cube())(3.0)) == 27.0
    assert "machine code can't be kept there: No space left on device" in said(caplog)[0]
    assert not list(cached.glob("compiling-*"))


def test_a_file_in_the_place_of_the_cache_is_done_without(tmp_path, monkeypatch, here, capsys):
    (tmp_path / "cache").write_text("mine")
    monkeypatch.setattr(platformdirs, "user_cache_path", lambda *_, **__: tmp_path / "cache")
    forget()
    assert main(["simulate", put(FLAP), "--compile", "-q", "--no-pictures"]) == 0
    assert "machine code can't be kept there" in capsys.readouterr().err
    forget()
