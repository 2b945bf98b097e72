"""Exceptions and the status of a solve; the messages a user reads when something cannot be done."""

from __future__ import annotations

import enum
from collections.abc import Iterable
from typing import Any


class Status(enum.Enum):
    """How a solve ended; the value is the sentence shown to the user."""

    OK = "the shape is an equilibrium to the tolerance asked for"
    ITERATION_LIMIT = "the solver reached its iteration limit before the residual was small enough"
    STALLED = "the solver could not reduce the residual any further"
    NOT_FINITE = "the residual became infinite or not a number"
    INACCURATE = "the shape did not become accurate enough on the finest mesh"
    WRONG_TURNS = "the solver slipped to another number of whole turns of twist"
    NOT_WITHOUT_CONTACT = "not without contact: no shape was found with the turns asked for that does not touch itself"
    NO_START = "no starting shape was found that joins the two ends"
    STEP_TOO_SMALL = "the motion could not be followed: the step became too small"
    INTERRUPTED = "the run was interrupted"
    TIME_LIMIT = "the time limit was reached"

    @property
    def ok(self) -> bool:
        """True for :attr:`OK` alone."""
        return self is Status.OK


class HarnessError(Exception):
    """Base of every error that harness-opt raises on purpose."""


class ProblemError(HarnessError):
    """The problem is not well posed: bad input, every mistake in one message.

    Args:
        mistakes: one line per mistake, each with the key's path first
            (``cables.lead.length: found -1, expected a length above 0 m``).
    """

    def __init__(self, mistakes: str | Iterable[str]):
        self.mistakes: tuple[str, ...] = (mistakes,) if isinstance(mistakes, str) else tuple(mistakes)
        super().__init__("\n".join(self.mistakes))

    def __reduce__(self) -> tuple[Any, ...]:
        """Return what makes it anew in another process."""
        return type(self), (self.mistakes,)


class CompilerError(HarnessError):
    """Functions can't be compiled here; without that everything works the same, but slower."""


class SolveError(HarnessError):
    """No shape was found.

    Args:
        message: what failed, where, and what to try.
        status: the :class:`Status` that ended the solve.
        partial: what was solved until then (a shape, motion or design), or None.
    """

    def __init__(self, message: str, status: Status, partial: Any = None):
        self.status = status
        self.partial = partial
        super().__init__(message)

    def __reduce__(self) -> tuple[Any, ...]:
        """Return what makes it anew in another process, what was solved until then with it."""
        return type(self), (str(self), self.status, self.partial)
