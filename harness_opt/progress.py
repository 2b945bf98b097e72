"""What the command line does while a run goes on: progress for people, and stopping where nothing is lost."""

from __future__ import annotations

import contextlib
import signal
import threading
import time
from collections.abc import Callable, Iterator
from types import FrameType
from typing import TYPE_CHECKING, Any, TextIO

if TYPE_CHECKING:
    from .motion import Progress

STOPPING = "Stopping after this frame; Ctrl-C again stops at once and keeps nothing."
SECONDS_A_LINE = 5.0  # between two lines of progress where no terminal shows a bar


class Abandoned(BaseException):
    """Somebody asked twice for a stop: at once. No KeyboardInterrupt, which a solve would catch."""


class Interrupts:
    """Where there is something to lose, Ctrl-C asks for a stop at a safe point; a second one stops at once.

    A context manager, for as long as it is to hold.

    Attributes:
        asked: whether somebody pressed it.
        patient: whether there is something to lose.
    """

    def __init__(self, warn: Callable[[str], None], words: str = STOPPING) -> None:
        """Take ``warn``, which shows a line to the user from inside a signal handler, and the line's ``words``."""
        self.asked = False
        self.patient = True
        self._warn, self._words = warn, words

    def __enter__(self) -> Interrupts:
        """Take over the handling of Ctrl-C, if this is the main thread."""
        self._main = threading.current_thread() is threading.main_thread()  # elsewhere Python has no handlers
        if self._main:
            self._before = signal.signal(signal.SIGINT, self._handle)
        return self

    def __exit__(self, *_: object) -> None:
        """Give it back."""
        if self._main:
            signal.signal(signal.SIGINT, self._before)

    def _handle(self, _number: int, _frame: FrameType | None) -> None:
        if not self.patient:
            raise KeyboardInterrupt
        if self.asked:
            raise Abandoned
        self.asked = True
        self._warn(f"\n{self._words}\n")

    def stop_here(self) -> None:
        """Raise KeyboardInterrupt if somebody asked for it."""
        if self.asked:
            raise KeyboardInterrupt


@contextlib.contextmanager
def progress_for(interrupts: Interrupts, stream: TextIO | None, counted: str = "frames") -> Iterator[Progress]:
    """Give the function that is told of every frame; between frames it is safe to stop.

    Args:
        interrupts: asked after every frame.
        stream: where to show the progress, as a bar if it is a terminal; None shows nothing.
        counted: what is counted, for logs.
    """
    with contextlib.ExitStack() as stack:
        show: Progress | None = None
        if stream is not None:
            show = stack.enter_context(_bar(stream)) if stream.isatty() else _lines(stream, counted)

        def told(name: str, done: int, total: int) -> None:
            if show is not None:
                show(name, done, total)
            interrupts.stop_here()

        yield told


@contextlib.contextmanager
def _bar(stream: TextIO) -> Iterator[Progress]:
    """Give a progress that draws a bar for each name."""
    # a tenth of a second that only terminals need
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.progress import Progress as Bars

    columns = (
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
        TextColumn("left:"), TimeRemainingColumn(),
    )  # fmt: skip
    with Bars(*columns, console=Console(file=stream), transient=True) as bars:
        tasks: dict[str, Any] = {}

        def show(name: str, done: int, total: int) -> None:
            if name not in tasks:
                tasks[name] = bars.add_task(escape(name))
            bars.update(tasks[name], completed=done, total=total or None)

        yield show


def _lines(stream: TextIO, counted: str) -> Progress:
    """Return a progress for logs: a line for each name now and then."""
    last: dict[str, float] = {}
    first: dict[str, tuple[float, int]] = {}

    def show(name: str, done: int, total: int) -> None:
        now = time.monotonic()
        begin, from_ = first.setdefault(name, (now, done))
        if name not in last or now - last[name] > SECONDS_A_LINE:
            last[name] = now
            words = f"{name}: {done} of {total} {counted}" if total else f"{name}: {done}"
            if total and done > from_:
                words += f", about {(now - begin) / (done - from_) * (total - done):.0f} s left"
            stream.write(f"{words}\n")
            stream.flush()

    return show
