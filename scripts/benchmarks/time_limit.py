"""A limit on the time of a piece of work, for studies whose rows may take hours."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Iterator

AGAIN = 1.0  # s from one exception to the next: whoever takes the first for something else goes on


class OutOfTimeError(Exception):
    """The work took longer than it may."""


@contextlib.contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Raise OutOfTimeError in what this ``with`` holds once it has taken so many seconds.

    By the wall's clock: where a timer of the processor's runs, ``time.process_time`` goes by ticks of milliseconds.

    It is raised again and again: IPOPT takes the first one for a reason to stop, and its caller would go on.
    """
    if not hasattr(signal, "setitimer"):  # Windows: no limit
        yield
        return
    struck = False

    def ring(_number: int, _frame: object) -> None:
        nonlocal struck
        struck = True
        raise OutOfTimeError

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds, AGAIN)
    try:
        yield
    except Exception as error:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        if struck:  # whatever C++ has made of it
            raise OutOfTimeError from error
        raise
    else:
        if struck:  # what was taken for a reason to stop has changed what came out
            raise OutOfTimeError
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
