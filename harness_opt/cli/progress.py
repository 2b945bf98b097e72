"""What the command line does while a run goes on: progress for people, and stopping where nothing is lost."""

from __future__ import annotations

import contextlib
import math
import signal
import threading
import time
from collections.abc import Callable, Iterator
from types import FrameType
from typing import TYPE_CHECKING, Any, TextIO

if TYPE_CHECKING:
    from harness_opt.motion.simulate import Progress

STOPPING = "Stopping after this frame; Ctrl-C again stops at once and keeps nothing."
GRACE, LEAST_GRACE = 0.1, 1.0  # of a time limit, and s: so much later a run is cut off
SOON = 0.02  # s until the next try to cut off a run
SECONDS_A_LINE = 5.0  # between two lines of progress where no terminal shows a bar


class Abandoned(BaseException):
    """Somebody asked twice for a stop: at once. No KeyboardInterrupt, which a solve would catch."""


class Interrupts:
    """Where there is something to lose, Ctrl-C asks for a stop at a safe point; a second one stops at once.

    So does a time limit; what does not come to a safe point soon after it is cut off (:meth:`cut_off`). A context
    manager, for as long as it is to hold.

    Attributes:
        asked: whether somebody pressed it.
        patient: whether there is something to lose.
    """

    def __init__(self, warn: Callable[[str], None], seconds: float | None = None, *, words: str = STOPPING) -> None:
        """Take ``warn``, which shows a line to the user from inside a signal handler, a time limit from now on, and
        the words to warn with.
        """
        self.asked = False
        self.patient = True
        self._warn, self._words = warn, words
        self._end = math.inf if seconds is None else time.monotonic() + seconds
        self._grace = 0.0 if seconds is None else max(LEAST_GRACE, GRACE * seconds)

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

    @property
    def late(self) -> bool:
        """Whether the time limit has been reached."""
        return math.isfinite(self._end) and time.monotonic() >= self._end

    def stopping(self) -> bool:
        """Return whether to stop at the next safe point, whatever for."""
        return self.asked or self.late

    @contextlib.contextmanager
    def cut_off(self) -> Iterator[None]:
        """Raise KeyboardInterrupt inside, wherever that may be, where the time limit is past by more than a little.

        Where there are no timers (Windows, other threads), only safe points keep to the limit.
        """
        if not (self._main and hasattr(signal, "setitimer") and math.isfinite(self._end)):
            yield
            return

        def ring(_number: int, frame: FrameType | None) -> None:
            # CasADi turns what is raised inside a call of it into errors of its own
            if _within(frame, "casadi"):
                signal.setitimer(signal.ITIMER_REAL, SOON)
            else:
                raise KeyboardInterrupt

        before = signal.signal(signal.SIGALRM, ring)
        signal.setitimer(signal.ITIMER_REAL, max(self._end - time.monotonic(), 0.0) + self._grace)
        try:
            yield
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, before)

    def _handle(self, _number: int, _frame: FrameType | None) -> None:
        if not self.patient:
            raise KeyboardInterrupt
        if self.asked:
            raise Abandoned
        self.asked = True
        self._warn(f"\n{self._words}\n")

    def stop_here(self) -> None:
        """Raise KeyboardInterrupt if somebody asked for it, or the time is up."""
        if self.stopping():
            raise KeyboardInterrupt


def _within(frame: FrameType | None, package: str) -> bool:
    """Return whether ``frame``, or what called it, belongs to ``package``."""
    while frame is not None:
        if str(frame.f_globals.get("__name__", "")).partition(".")[0] == package:
            return True
        frame = frame.f_back
    return False


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
