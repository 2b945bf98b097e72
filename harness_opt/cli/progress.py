"""What the command line does while a run goes on: progress for people, and stopping where nothing is lost."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, TextIO

from harness_opt.cli.interrupts import Interrupts

if TYPE_CHECKING:
    from harness_opt.motion.follower import Progress

SECONDS_A_LINE = 5.0  # between two lines of progress where no terminal shows a bar


class Shown:
    """What is told of every frame, and of anything else in a line; between frames it is safe to stop."""

    def __init__(self, interrupts: Interrupts, show: Progress | None, line: Callable[[str], None]):
        self._interrupts, self._show, self.line = interrupts, show, line

    def __call__(self, name: str, done: int, total: int) -> None:
        """Tell of a frame."""
        if self._show is not None:
            self._show(name, done, total)
        self._interrupts.stop_here()


@contextlib.contextmanager
def progress_for(interrupts: Interrupts, stream: TextIO | None, counted: str = "frames") -> Iterator[Shown]:
    """Give what is told of every frame; between frames it is safe to stop.

    Args:
        interrupts: asked after every frame.
        stream: where to show the progress, as a bar if it is a terminal; None shows nothing.
        counted: what is counted, for logs.
    """
    if stream is None:
        yield Shown(interrupts, None, lambda _: None)
    elif stream.isatty():
        with _bar(stream) as (show, line):
            yield Shown(interrupts, show, line)
    else:

        def write(words: str) -> None:
            stream.write(f"{words}\n")
            stream.flush()

        yield Shown(interrupts, _lines(stream, counted), write)


@contextlib.contextmanager
def _bar(stream: TextIO) -> Iterator[tuple[Progress, Callable[[str], None]]]:
    """Give a progress that draws a bar for each name, and what puts a line above the bars."""
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

        yield show, lambda words: bars.console.print(escape(words), highlight=False)


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
