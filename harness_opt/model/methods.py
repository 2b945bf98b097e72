"""Names of the transcriptions of the rod's equations, of the solvers, and of the interpolations between frames."""

from __future__ import annotations

from typing import Literal, get_args

from harness_opt.errors import ProblemError

Transcription = Literal["collocation", "dqm"]
SolverName = Literal["gauss-newton", "levenberg-marquardt", "ipopt", "paper"]
Interpolation = Literal["exact", "linear"]

TRANSCRIPTIONS: tuple[Transcription, ...] = get_args(Transcription)
SOLVERS: tuple[SolverName, ...] = get_args(SolverName)
INTERPOLATIONS: tuple[Interpolation, ...] = get_args(Interpolation)


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
