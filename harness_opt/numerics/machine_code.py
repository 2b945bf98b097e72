"""CasADi functions as machine code: written as C, compiled once by the system's compiler, kept between runs.

Nothing needs it, and results are the same to rounding: the same operations run in the same order, ten to twenty times
as fast. What is compiled are the functions of one element of a cable, so that a few files serve for all cables and all
meshes. They are kept in the user's cache folder, which nobody else may write into: what lies there is run. Each has the
digest of its content in its name, so that what a full disk, a crash or an editor damaged is known by it and compiled
again. Whatever goes wrong later than the first try is logged in a line, and then it is done without.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import hashlib
import logging
import os
import platform
import shutil
import signal
import stat
import subprocess
import tempfile
import time
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
LONGEST = 120.0  # s, of one compilation: the largest takes five
ASKING = 20.0  # s, that a compiler may take to tell its version, and for a function of one line
ABANDONED = 3600.0  # s after which nobody is at work any more in a folder to compile in
DIGITS = 16  # of the digest in a library's name
SAID = 500  # characters of what the compiler says that are shown

_log = logging.getLogger(__name__)
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
            return _Compiler(path, _run([path, "--version"], ASKING))
    raise CompilerError(f"no C compiler was found on the PATH: looked for {', '.join(compilers)}")


def _run(command: list[str], seconds: float) -> str:
    """Return what a command prints; bytes that are no text become question marks.

    Raises:
        CompilerError: it could not be run, failed, or took longer than ``seconds``.
    """
    group = os.name == "posix"  # a compiler is several processes: they end together
    try:
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=group
        )
    except OSError as error:
        raise CompilerError(f"the C compiler did not run: {error}") from error
    with process:
        try:
            out, err = (said.decode("utf-8", "replace") for said in process.communicate(timeout=seconds))
        except subprocess.TimeoutExpired:
            raise CompilerError(f"the C compiler took longer than {seconds:g} s ({command[0]})") from None
        finally:
            _end(process, group)
    if process.returncode != 0:
        words = " ".join((err or out).split())[:SAID]
        raise CompilerError(f"the C compiler failed ({command[0]}): {words}")
    return out


def _end(process: subprocess.Popen[bytes], group: bool) -> None:
    """End a process that still runs, and those that it started."""
    if process.returncode is not None:
        return
    with contextlib.suppress(ProcessLookupError):  # it has just ended by itself
        if group:
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()


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
        _clear(folder)
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


def _clear(folder: Path) -> None:
    """Remove what compilations that were killed have left."""
    for place in folder.glob("compiling-*"):
        if time.time() - place.stat().st_mtime > ABANDONED:
            shutil.rmtree(place, ignore_errors=True)


def built(function: ca.Function) -> ca.Function:
    """Return ``function`` as machine code, compiled now if it is not at hand from another run.

    Where that can't be done it is returned as it is, and no more is compiled in this context; a line is logged.
    """
    try:
        return machine_code(function, LONGEST)
    except CompilerError as error:
        _log.warning("%s; going on without machine code: the results are the same", error)
        _wanted.set(False)
        return function


def machine_code(function: ca.Function, seconds: float) -> ca.Function:
    """Return ``function`` as machine code; compiling it may take ``seconds``.

    Raises:
        CompilerError: it can't be compiled, kept, or run.
    """
    compiler, folder, name = _compiler(), cache_folder(), function.name()
    generator = ca.CodeGenerator(f"{name}.c")
    generator.add(function)
    source = generator.dump()
    made_by = (platform.machine(), version("casadi"), compiler.path, compiler.version, *FLAGS, *LIBRARIES)
    stem = f"{name}-{hashlib.sha256(chr(0).join((source, *made_by)).encode()).hexdigest()}"
    try:
        kept = _kept(folder, stem)
        if kept is not None:
            with contextlib.suppress(_NotRun):  # made for another system, which shares this folder
                return _loaded(name, kept)
        return _loaded(name, _compile(compiler, source, folder, stem, seconds))
    except OSError as error:
        raise CompilerError(f"{folder}: machine code can't be kept there: {error.strerror or error}") from error


class _NotRun(CompilerError):
    """A library that the system does not take."""


def _loaded(name: str, library: Path) -> ca.Function:
    """Return the function ``name`` of a library.

    Raises:
        _NotRun: the system does not load it, or it holds no such function; it is removed.
    """
    try:
        ctypes.CDLL(str(library))  # says in a line what is wrong; casadi lists every folder that it looked into
        return ca.external(name, str(library))
    except (OSError, RuntimeError) as error:
        library.unlink(missing_ok=True)
        words = " ".join(str(error).replace(f"{library}: ", "").split())[:SAID]
        raise _NotRun(f"{library.parent}: machine code can't be run from there: {words}") from error


def _kept(folder: Path, stem: str) -> Path | None:
    """Return the library that is kept under ``stem``, or None; those whose content is not what it was are removed."""
    found = None
    for library in sorted(folder.glob(f"{stem}-*.so")):
        if library.is_file() and _digest(library) == library.stem.rpartition("-")[2]:
            found = library
        else:
            _log.warning("%s: found damaged machine code, expected what was compiled: compiling it again", library)
            library.unlink(missing_ok=True)
    return found


def _digest(library: Path) -> str:
    return hashlib.sha256(library.read_bytes()).hexdigest()[:DIGITS]


def _compile(compiler: _Compiler, source: str, folder: Path, stem: str, seconds: float) -> Path:
    """Compile ``source`` to a library, which is there whole or not at all, however many processes do the same."""
    with tempfile.TemporaryDirectory(dir=folder, prefix="compiling-") as place:
        text, result = Path(place, "function.c"), Path(place, "function.so")
        text.write_text(source, encoding="utf-8")
        _run([compiler.path, *FLAGS, str(text), "-o", str(result), *LIBRARIES], seconds)
        if not result.is_file() or not result.stat().st_size:
            raise CompilerError(f"the C compiler made nothing ({compiler.path})")
        with result.open("rb+") as stream:
            os.fsync(stream.fileno())
        return result.replace(folder / f"{stem}-{_digest(result)}.so")


@functools.cache
def _try_out() -> None:
    """Compile a function and run it.

    Raises:
        CompilerError: that does not work.
    """
    x = ca.SX.sym("x")
    probe = ca.Function("probe", [x], [ca.sqrt(x)])
    if float(machine_code(probe, ASKING)(4.0)) != 2.0:
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
