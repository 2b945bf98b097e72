"""Names of the transcriptions of the rod's equations and of the solvers; light, so that a command line knows them."""

from __future__ import annotations

from typing import Literal, get_args

from harness_opt.errors import ProblemError

Transcription = Literal["collocation", "dqm"]
SolverName = Literal["gauss-newton", "levenberg-marquardt", "ipopt", "paper"]

TRANSCRIPTIONS: tuple[Transcription, ...] = get_args(Transcription)
SOLVERS: tuple[SolverName, ...] = get_args(SolverName)


def check_method(transcription: str, solver: str) -> None:
    """Refuse names that are not in TRANSCRIPTIONS and SOLVERS.

    Raises:
        ProblemError: there is no transcription or solver of that name.
    """
    if transcription not in TRANSCRIPTIONS:
        expected = " or ".join(map(repr, TRANSCRIPTIONS))
        raise ProblemError(f"transcription: found {transcription!r}, expected {expected}")
    if solver not in SOLVERS:
        raise ProblemError(f"solver: found {solver!r}, expected one of {', '.join(map(repr, SOLVERS))}")
