"""How a command ends: every error as an exit code and words. 1 is a verdict, and nothing but a verdict."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from pathlib import Path

import click

from harness_opt.cli.interrupts import Abandoned, heard
from harness_opt.cli.streams import tell
from harness_opt.errors import CompilerError, HarnessError, ProblemError, SolveError

BAD_INPUT, UNSOLVED, FAULT, INTERRUPTED = 2, 3, 70, 130  # 70: EX_SOFTWARE of sysexits.h
LONGEST = 200  # characters of what an error says of itself
DEBUG = "--debug"


def code_of(command: Callable[[], int | None], debug: Callable[[], bool]) -> int:
    """Run ``command`` and return its exit code, whatever becomes of it.

    Args:
        command: returns its own exit code, or None for 0.
        debug: asked when something unforeseen happened; True shows where.
    """
    with heard() as pressed:
        code, lines = _outcome(command, debug)
    if pressed():
        code, lines = INTERRUPTED, ("Interrupted.",)
    tell(*lines)
    return code


def _outcome(command: Callable[[], int | None], debug: Callable[[], bool]) -> tuple[int, tuple[str, ...]]:
    """Return the exit code of ``command``, and what is left to say."""
    try:
        return command() or 0, ()
    except (KeyboardInterrupt, Abandoned, click.Abort):  # click's word for Ctrl-C, and for the end of its input
        return INTERRUPTED, ("Interrupted.",)
    except (Exception, SystemExit) as error:  # the one place for whatever nobody foresaw: it must not look like a 1
        foreseen = _foreseen(error)
        if debug() and (foreseen is None or isinstance(error, OSError)):
            tell(traceback.format_exc().rstrip())
        return foreseen or (FAULT, (_fault(error),))


def _foreseen(error: BaseException) -> tuple[int, tuple[str, ...]] | None:
    """Return the exit code and the words for an error that is not the program's own, or None for one that is."""
    words: tuple[str, ...] = (str(error),)
    if isinstance(error, click.ClickException):
        context = error.ctx if isinstance(error, click.UsageError) else None
        words = (*([context.get_usage()] if context else ()), f"Error: {error.format_message()}")
    elif isinstance(error, ProblemError):
        words = error.mistakes
    elif isinstance(error, CompilerError):  # one that worked when it was tried out
        words = (f"harness-opt: {error}; leave --compile out to do without",)
    elif isinstance(error, OSError):  # such as a full disk behind stdout
        words = (f"harness-opt: {error.filename or 'output'}: {error.strerror or error}",)
    elif not isinstance(error, HarnessError):
        return None
    return (UNSOLVED if isinstance(error, SolveError) else BAD_INPUT), words


def _fault(error: BaseException) -> str:
    """Return one line for a fault of the program: what, where, and how to report it."""
    if isinstance(error, MemoryError):
        found, advice = "too little memory", "expected more; nothing was left half-written. If the problem is small"
    else:
        words = " ".join(f"{type(error).__name__}: {error}".split())[:LONGEST]
        found, advice = f"a fault of its own ({words}{_place(error)})", "expected none; nothing was left half-written"
    report = f"please report it, with the files and what the same command says with {DEBUG}"
    return f"harness-opt: found {found}, {advice}: {report}"


def _place(error: BaseException) -> str:
    """Return where an error arose, in our own files if it came through any."""
    own = Path(__file__).resolve().parents[1]
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if Path(frame.filename).is_relative_to(own)]
    return f", {Path(ours[-1].filename).relative_to(own).as_posix()}:{ours[-1].lineno}" if ours else ""
