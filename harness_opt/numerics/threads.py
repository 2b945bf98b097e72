"""One thread for dense linear algebra: the matrices here are too small to share, and sharing them costs more than they
do.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController

P = ParamSpec("P")
T = TypeVar("T")


@functools.cache
def _controller() -> ThreadpoolController:
    """Return the libraries loaded; looking for them takes longer than a small solve."""
    return ThreadpoolController()


def one_thread(function: Callable[P, T]) -> Callable[P, T]:
    """Return ``function``, run with BLAS held to one thread (measured on two busy cores: 2.2 times as fast)."""

    @functools.wraps(function)
    def pinned(*args: P.args, **kwargs: P.kwargs) -> T:
        with _controller().limit(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return pinned
