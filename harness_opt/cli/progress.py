"""What the command line does while a run goes on: progress for people, and stopping where nothing is lost."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, TextIO

from harness_opt.cli.interrupts import Interrupts

if TYPE_CHECKING:
    Show = Callable[[str, int, int, bool], None]  # what is done, how much of it, of how much; whether that is all

SECONDS_A_LINE = 5.0  # between two lines of progress where no terminal shows a bar


class Shown:
    """What is told of what is being done, and of anything else in a line; between frames it is safe to stop."""

    def __init__(self, interrupts: Interrupts, show: Show | None, line: Callable[[str], None]):
        self._interrupts, self._show, self.line = interrupts, show, line

    def __call__(self, name: str, done: int, total: int) -> None:
        """Tell how far ``name`` is, such as "variants"; stop here if somebody asked for it."""
        self.tell(name, done, total)
        self._interrupts.stop_here()

    def tell(self, doing: str, done: int, total: int, *, whole: bool = True) -> None:
        """Tell how far it is with ``doing``, and do no more.

        Args:
            doing: what is being done.
            done, total: of it.
            whole: whether little else is left once it is done, so that its end may be guessed at.
        """
        if self._show is not None:
            self._show(doing, done, total, whole)

    def solving(self, cables: Sequence[str]) -> Callable[[str, int, int], None]:
        """Return what is told of every frame of ``cables``, which are solved one after the other."""

        def told(name: str, done: int, total: int) -> None:
            self(f"solving {name}", cables.index(name) * total + done, len(cables) * total)

        return told

    def designs(self) -> Callable[[str, int, int], None]:
        """Return what is told of every frame of one design after the other: each begins with its first cable again."""
        number, first, last = 0, "", 0

        def told(name: str, done: int, total: int) -> None:
            nonlocal number, first, last
            first = first or name
            if name == first:
                number, last = number + (done <= last or not number), done
            self.tell(f"looking at design {number}", done, total, whole=False)
            self._interrupts.stop_here()

        return told


@contextlib.contextmanager
def progress_for(interrupts: Interrupts, stream: TextIO | None) -> Iterator[Shown]:
    """Give what is told of every frame; between frames it is safe to stop.

    Args:
        interrupts: asked after every frame.
        stream: where to show the progress, as a bar if it is a terminal; None shows nothing.
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

        yield Shown(interrupts, _lines(write), write)


@contextlib.contextmanager
def _bar(stream: TextIO) -> Iterator[tuple[Show, Callable[[str], None]]]:
    """Give a progress that draws one bar, of what is being done, and what puts a line above it."""
    # a tenth of a second that only terminals need
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
    from rich.progress import Progress as Bars

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[left]}"))
    with Bars(*columns, console=Console(file=stream), transient=True) as bars:
        task = bars.add_task("", start=False, visible=False, left="")
        left = _TimeLeft()

        def show(doing: str, done: int, total: int, whole: bool) -> None:
            words = left.words(doing, done, total) if whole else ""
            bars.update(task, description=escape(doing), completed=done, total=total, visible=True, left=words)

        yield show, lambda words: bars.console.print(escape(words), highlight=False)


def _lines(write: Callable[[str], None]) -> Show:
    """Return a progress for logs: a line now and then."""
    left = _TimeLeft()
    last = [-SECONDS_A_LINE]

    def show(doing: str, done: int, total: int, whole: bool) -> None:
        now, words = time.monotonic(), left.words(doing, done, total)
        if now - last[0] >= SECONDS_A_LINE:
            last[0] = now
            counted = f"{doing}: {done} of {total}"
            write(f"{counted}, {words}" if whole and words else counted)

    return show


class _TimeLeft:
    """Guesses when what is being done (its first word) will be: as fast as it went since it began."""

    def __init__(self) -> None:
        self._doing, self._begin, self._from = "", 0.0, 0

    def words(self, doing: str, done: int, total: int) -> str:
        """Return the guess in words; nothing where there is none yet."""
        now, doing = time.monotonic(), doing.partition(" ")[0]
        if doing != self._doing or done < self._from:
            self._doing, self._begin, self._from = doing, now, done
        if done == self._from:
            return ""
        return f"about {(now - self._begin) / (done - self._from) * (total - done):.0f} s left"
