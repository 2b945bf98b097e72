"""CasADi functions as machine code: written as C, compiled once by the system's compiler, kept between runs.

Nothing needs it, and results are the same to rounding: the same operations run in the same order, ten to twenty times
as fast. What is compiled are the functions of one element of a cable, so that a few files serve for all cables and all
meshes. They are kept in the user's cache folder, which nobody else may write into: what lies there is run.
"""

from __future__ import annotations

import functools
import hashlib
import os
import shutil
import stat
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import casadi as ca
import numpy as np

from harness_opt.errors import CompilerError
from harness_opt.numerics.rotations import Array

# -O2 takes twice as long to compile and makes nothing faster; products and sums are rounded one by one, as casadi does
FLAGS = ("-O1", "-ffp-contract=off", "-fPIC", "-shared")
LIBRARIES = ("-lm",)

_wanted: ContextVar[bool] = ContextVar("machine code wanted", default=False)


@contextmanager
def compiled() -> Iterator[None]:
    """Have what is built inside this ``with`` run as machine code; the first time, it takes some seconds more.

    Raises:
        CompilerError: there is no C compiler that works, or no safe folder to keep its work in.
    """
    _try_out()
    token = _wanted.set(True)
    try:
        yield
    finally:
        _wanted.reset(token)


def wanted() -> bool:
    """Return whether machine code is wanted here."""
    return _wanted.get()


@dataclass(frozen=True)
class _Compiler:
    """A C compiler: its path, and what it says of its version."""

    path: str
    version: str


@functools.cache
def _compiler() -> _Compiler:
    """Return the system's C compiler.

    Raises:
        CompilerError: there is none.
    """
    compilers = ("cc", "gcc", "clang")
    for name in compilers:
        path = shutil.which(name)
        if path is not None:
            return _Compiler(path, _run([path, "--version"]))
    raise CompilerError(f"no C compiler was found on the PATH: looked for {', '.join(compilers)}")


def _run(command: list[str]) -> str:
    """Return what a command prints.

    Raises:
        CompilerError: it could not be run, failed, or took too long.
    """
    most_shown = 2000  # characters of what the compiler says that are shown
    most_seconds = 600.0  # s, of one compilation
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=most_seconds, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise CompilerError(f"the C compiler did not run: {error}") from error
    if done.returncode != 0:
        raise CompilerError(
            f"the C compiler failed ({command[0]}): {(done.stderr or done.stdout).strip()[:most_shown]}"
        )
    return done.stdout


def cache_folder() -> Path:
    """Return the folder where machine code is kept, made where it is missing.

    Raises:
        CompilerError: it can't be made, or others than this user may write into it.
    """
    import platformdirs

    folder = platformdirs.user_cache_path("harness-opt", appauthor=False) / "machine_code"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        folder = folder.resolve()
        unsafe = next((place for place in (folder, *folder.parents) if not _private(place, place == folder)), None)
    except OSError as error:
        raise CompilerError(f"{folder}: machine code can't be kept there: {error.strerror or error}") from error
    if unsafe is not None:
        raise CompilerError(f"{unsafe}: others may write here, so no machine code below it is run")
    return folder


def _private(folder: Path, last: bool) -> bool:
    """Return whether nobody but this user and the system's can put anything in the place of what lies in ``folder``.

    Only the ``last`` folder has to be this user's own; those above may belong to the system, or be open to all where
    everybody owns what he puts there. (Windows keeps users' folders apart by other means.)
    """
    if os.name != "posix":
        return True
    info, user = folder.stat(), os.getuid()
    own_group = info.st_gid == user == os.getgid()  # a group of one
    others = info.st_mode & (stat.S_IWOTH if own_group else stat.S_IWOTH | stat.S_IWGRP)
    if last:
        return info.st_uid == user and not others
    return info.st_uid in (0, user) and (not others or bool(info.st_mode & stat.S_ISVTX))


def built(function: ca.Function) -> ca.Function:
    """Return ``function`` as machine code, compiled now if it is not at hand from another run.

    Raises:
        CompilerError: it can't be compiled, or kept.
    """
    compiler, folder, name = _compiler(), cache_folder(), function.name()
    generator = ca.CodeGenerator(f"{name}.c")
    generator.add(function)
    source = generator.dump()
    parts = (source, version("casadi"), compiler.path, compiler.version, *FLAGS, *LIBRARIES)
    key = hashlib.sha256("\0".join(parts).encode()).hexdigest()
    library = folder / f"{name}-{key}.so"
    try:
        if not library.exists():
            _compile(compiler, source, library)
    except OSError as error:
        raise CompilerError(f"{folder}: machine code can't be kept there: {error.strerror or error}") from error
    return ca.external(name, str(library))


def _compile(compiler: _Compiler, source: str, library: Path) -> None:
    """Compile ``source`` to ``library``, which is there whole or not at all, however many processes do the same."""
    with tempfile.TemporaryDirectory(dir=library.parent, prefix="compiling-") as place:
        text, result = Path(place, "function.c"), Path(place, "function.so")
        text.write_text(source, encoding="utf-8")
        _run([compiler.path, *FLAGS, str(text), "-o", str(result), *LIBRARIES])
        result.replace(library)


@functools.cache
def _try_out() -> None:
    """Compile a function and run it.

    Raises:
        CompilerError: that does not work.
    """
    x = ca.SX.sym("x")
    probe = ca.Function("probe", [x], [ca.sqrt(x)])
    if float(built(probe)(4.0)) != 2.0:
        raise CompilerError(f"the C compiler makes wrong machine code: {_compiler().path}")


class Buffered:
    """A CasADi function of two vectors that reads and writes arrays in place, without an ordinary call's copies."""

    _given: Array | None = None

    def __init__(self, function: ca.Function):
        self._buffer, self._evaluate = function.buffer()
        self._first, self._second = (np.zeros(function.nnz_in(i)) for i in range(2))
        self._result = np.zeros(function.nnz_out(0))
        for i, array in enumerate((self._first, self._second)):
            self._buffer.set_arg(i, memoryview(array))  # type: ignore[arg-type,call-arg]
        self._buffer.set_res(0, memoryview(self._result))  # type: ignore[arg-type,call-arg]

    def __call__(self, first: Array, second: Array) -> Array:
        """Evaluate at flat arrays (column-major); the result is overwritten by the next call.

        ``second`` is copied where it is another array than the last time: it must not be changed in between.
        """
        self._first[:] = first
        if second is not self._given:
            self._second[:] = second
            self._given = second
        self._evaluate()
        return self._result
