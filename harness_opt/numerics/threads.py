"""One solve at a time, and one thread in each for dense linear algebra.

What CasADi and coal build is built once and evaluated in place, in memory that all threads of a process share; so the
public functions take turns. A second process solves beside the first one; a second thread would not, for Python's own
lock. The matrices here are too small to share among threads, and sharing them costs more than they do.
"""

from __future__ import annotations

import functools
import os
import threading
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController

P = ParamSpec("P")
T = TypeVar("T")

_turn = threading.RLock()  # public functions call each other
if hasattr(os, "register_at_fork"):  # no copy of this process begins in the middle of a solve
    os.register_at_fork(before=_turn.acquire, after_in_parent=_turn.release, after_in_child=_turn.release)


@functools.cache
def _controller() -> ThreadpoolController:
    """Return the libraries loaded; looking for them takes longer than a small solve."""
    return ThreadpoolController()


def one_at_a_time(function: Callable[P, T]) -> Callable[P, T]:
    """Return ``function``, which waits while another thread is inside any function made so.

    What it calls back (a progress, a stop) may call such functions itself, and must not wait for a thread that does.
    """

    @functools.wraps(function)
    def alone(*args: P.args, **kwargs: P.kwargs) -> T:
        with _turn:
            return function(*args, **kwargs)

    return alone


def one_thread(function: Callable[P, T]) -> Callable[P, T]:
    """Return ``function``, run in turn and with BLAS held to one thread (on two busy cores 2.2 times as fast)."""

    @functools.wraps(function)
    def pinned(*args: P.args, **kwargs: P.kwargs) -> T:
        # the limit is that of the process: two threads that set and unset it by turns would leave it set
        with _turn, _controller().limit(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return pinned
