"""Ctrl-C and time limits: a stop at the next safe point, so that what is finished is kept."""

from __future__ import annotations

import contextlib
import math
import signal
import threading
import time
from collections.abc import Callable, Iterator
from types import FrameType

STOPPING = "Stopping after this frame; Ctrl-C again stops at once and keeps nothing."


GRACE, LEAST_GRACE = 0.1, 1.0  # of a time limit, and s: so much later a run is cut off
SOON = 0.02  # s until the next try to cut off a run


@contextlib.contextmanager
def heard() -> Iterator[Callable[[], bool]]:
    """Give what says whether somebody pressed Ctrl-C; it stops the work at once, and is remembered.

    Some libraries catch every exception while they are imported, this one too: without a memory it would be lost.
    """
    pressed: list[int] = []

    def press(number: int, _frame: FrameType | None) -> None:
        pressed.append(number)
        raise KeyboardInterrupt

    before = signal.getsignal(signal.SIGINT)
    main = threading.current_thread() is threading.main_thread()  # elsewhere Python has no handlers
    if main and before != signal.SIG_IGN:
        signal.signal(signal.SIGINT, press)
    try:
        yield lambda: bool(pressed)
    finally:
        if main:
            signal.signal(signal.SIGINT, before)


class Abandoned(BaseException):
    """Somebody asked twice for a stop: at once. No KeyboardInterrupt, which a solve would catch."""


class Interrupts:
    """Where there is something to lose, Ctrl-C asks for a stop at a safe point; a second one stops at once.

    So does a time limit; what does not come to a safe point soon after it is cut off (:meth:`cut_off`). A context
    manager, for as long as it is to hold.

    Attributes:
        asked: whether somebody pressed it.
        patient: whether there is something to lose, or Ctrl-C stops at once.
    """

    def __init__(
        self, warn: Callable[[str], None], seconds: float | None = None, *, words: str = STOPPING, patient: bool = True
    ) -> None:
        """Take ``warn``, which shows a line to the user from inside a signal handler, a time limit from now on, the
        words to warn with, and whether there is something to lose already.
        """
        self.asked = False
        self.patient = patient
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

    def overdue(self) -> bool:
        """Return whether the time limit is past by more than a little."""
        return math.isfinite(self._end) and time.monotonic() >= self._end + self._grace

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
            self.asked = True  # remembered: some libraries catch every exception while they are imported
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
