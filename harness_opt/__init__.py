"""Motional cable harness design: shapes, clearances and redesign of cables between moving clamps."""

from .equilibrium import Shape, equilibrium
from .errors import HarnessError, ProblemError, SolveError, Status
from .problem import Cable, End

__all__ = ["Cable", "End", "HarnessError", "ProblemError", "Shape", "SolveError", "Status", "equilibrium"]
