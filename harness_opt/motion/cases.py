"""One cable's cases along the motion: what holds it at any motion value, and shapes continued from one to another."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from harness_opt.model.cable import End
from harness_opt.model.problem import Problem
from harness_opt.rod.boundary import Case, case
from harness_opt.statics.continuation import follow
from harness_opt.statics.solve import Solved


class CableCases:
    """The dimensionless cases of one cable along the motion.

    Args:
        problem: the problem.
        name: of the cable.
        solver: name of the one that shapes are continued by.
    """

    def __init__(self, problem: Problem, name: str, solver: str):
        self.problem, self.name, self.solver = problem, name, solver
        self.run, self._gravity = problem.cables[name], np.asarray(problem.gravity)

    def posed(self, ends: tuple[End, End], near: Case | None) -> Case:
        """Return the case of ``ends``, its quaternions signed like those of ``near``."""
        posed = case(self.run.cable, *ends, self._gravity)
        if near is None:
            return posed
        return posed.signed_like(near.boundary.start_quaternion, near.boundary.end_quaternion)

    def path(self, near: Case) -> Callable[[float], Case]:
        """Return the cases by motion value (0 to 1), signed like ``near``."""
        return lambda at: self.posed(self.problem.ends(self.name, [at])[0], near)

    def follow(self, start: Solved, first: float, last: float, smallest: float | None = None) -> tuple[Solved, float]:
        """Continue ``start`` from motion value ``first`` towards ``last``, as far as it goes.

        Arguments and results as of :func:`harness_opt.statics.continuation.follow`.
        """
        return follow(self.path(start.case), start, first, last, self.solver, smallest)
