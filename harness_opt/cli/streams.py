"""Stdout and stderr as the command line uses them: they outlast their readers, and no file's text steers a terminal.

What a run says has no say in what it does. A pipe whose reader went away, a stream that was closed before the program
began, a full disk behind stderr: the words are lost, and the work goes on. A full disk behind stdout alone is an error,
for whoever keeps the output in a file must not take half of it for all.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
import re
import select
import sys
from collections.abc import Iterator
from typing import Any, TextIO

import click

STDOUT, STDERR = 1, 2
GONE = (errno.EPIPE, errno.EBADF, errno.EIO)  # no reader | closed | a terminal that hung up
CONTROLS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")  # all but tab and new line


class _Lasting(io.RawIOBase):
    """Writes to a descriptor for as long as somebody reads there.

    Args:
        number: of the descriptor.
        forgiving: whether any error of writing only loses the words, and not just that nobody reads them.
    """

    def __init__(self, number: int, forgiving: bool):
        self._number, self._forgiving, self._lost = number, forgiving, False

    def writable(self) -> bool:
        """Return True."""
        return True

    def fileno(self) -> int:
        """Return the number of the descriptor."""
        return self._number

    def isatty(self) -> bool:
        """Return whether a terminal reads."""
        return not self._lost and os.isatty(self._number)

    def write(self, content: Any) -> int:
        """Write, or do nothing once the reader is gone; return how many bytes are done with."""
        while not self._lost:
            try:
                return os.write(self._number, content)
            except BlockingIOError:  # a slow reader of a pipe that does not wait
                select.select([], [self._number], [])
            except OSError as error:
                if not self._forgiving and error.errno not in GONE:
                    raise
                self._lost = True
        return len(content)


@contextlib.contextmanager
def lasting() -> Iterator[None]:
    """Have stdout and stderr of the process outlast their readers; streams that stand in for them are left alone."""
    _plug()
    before = sys.stdout, sys.stderr
    sys.stdout = _outlasting(sys.stdout, sys.__stdout__, STDOUT)
    sys.stderr = _outlasting(sys.stderr, sys.__stderr__, STDERR)
    try:
        yield
    finally:
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError):  # told already, where it matters
                stream.flush()
        sys.stdout, sys.stderr = before


def _plug() -> None:
    """Open nothing in the place of standard streams that are closed: files opened later would take their numbers."""
    for number in range(STDERR + 1):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest number that is free


def _outlasting(stream: TextIO | None, original: TextIO | None, number: int) -> TextIO:
    if stream is None:  # closed before Python began
        return open(os.devnull, "w", encoding="utf-8")
    if stream is not original:
        return stream
    if os.name == "nt" and stream.isatty():  # a console of Windows takes text, not bytes
        reconfigure = getattr(stream, "reconfigure", None)
        if reconfigure is not None:
            reconfigure(errors="replace")
        return stream
    raw = io.BufferedWriter(_Lasting(number, number == STDERR))
    # a name that the terminal's encoding lacks must not end a run
    return io.TextIOWrapper(raw, encoding=stream.encoding, errors="replace", line_buffering=True)


# --- words ---------------------------------------------------------------------------------------------


def say(text: str) -> None:
    """Print on stdout."""
    click.echo(coloured(text), color=_colour())


def tell(*lines: str) -> None:
    """Print on stderr."""
    for line in lines:
        click.echo(coloured(line), err=True, color=_colour())


def warn(text: str) -> None:
    """Print on stderr from a signal handler, where Python's own streams may be in use."""
    with contextlib.suppress(OSError):  # nobody reads it
        os.write(STDERR, text.encode())


def _colour() -> bool | None:
    """Return False where no colours are wanted (no-color.org), None to leave it to whether this is a terminal."""
    return False if os.environ.get("NO_COLOR") else None


def coloured(text: str) -> str:
    """Return the words of a table's last column in colours, which whatever is no terminal loses again.

    What a file holds may not steer the terminal: control characters in it, and those that turn the direction of
    writing, become question marks; so do bytes of names that are no text.
    """
    text = CONTROLS.sub("?", text).encode("utf-8", "replace").decode()
    text = re.sub(r" OK$", lambda found: click.style(found[0], fg="green"), text, flags=re.MULTILINE)
    return re.sub(r" VIOLATED$", lambda found: click.style(found[0], fg="red", bold=True), text, flags=re.MULTILINE)
