"""One cable's cases along the motion: what holds it at any motion value, and shapes continued from one to another."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from harness_opt.model.ends import End
from harness_opt.model.problem import Problem, held_as
from harness_opt.rod.boundary import Case, case
from harness_opt.rod.states import Rod
from harness_opt.statics.cold_start import cold_start
from harness_opt.statics.continuation import follow
from harness_opt.statics.fitting import Fitted, clamped, fit
from harness_opt.statics.solve import Solved


class CableCases:
    """The dimensionless cases of one cable along the motion, its untwisted end fitted.

    Args:
        problem: the problem.
        name: of the cable.
        solver: name of the one that shapes are continued by.
        near: a fit of a like cable to start from.
        first: a shape of the first frame that the rolls are to be taken from, where the cable is fitted there.
    """

    def __init__(self, problem: Problem, name: str, solver: str, near: Fitted | None = None, first: Rod | None = None):
        self.problem, self.name, self.solver = problem, name, solver
        self.run, self._gravity = problem.cables[name], np.asarray(problem.gravity)
        self.fitted: Fitted | None = None
        if self.run.untwisted is None:
            self.problem = problem.changed(cables={**problem.cables, name: self.run.to_fit})
            return
        if first is not None and self.run.fitted_at == 0.0:
            frames = (first.q[0], first.q[-1])
        else:
            to_fit = problem.changed(cables={name: self.run.to_fit})
            placed = to_fit.ends(name, [self.run.fitted_at])[0]
            self.fitted = fit(self.run, placed, self._gravity, solver, near.solved if near else None)
            if self.fitted is None:
                return
            frames = self.fitted.frames
        self.problem = held_as(problem, name, self.run.fitted_at, frames)

    @property
    def unfitted(self) -> bool:
        """Whether no shape was found to fit the cable in."""
        return self.run.untwisted is not None and self.problem.cables[self.name].untwisted is not None

    def from_ends(self, at: float) -> Solved | None:
        """Return a shape at motion value ``at`` found from the ends alone; None where there is none."""
        bow = None if self.run.bow is None else np.asarray(self.run.bow)
        posed = self.at(at, None)
        return cold_start(posed, int(self.problem.cables[self.name].end.turns), bow, self.solver)

    def as_fitted(self) -> Solved | None:
        """Return the shape where the cable was fitted, its ends held; None where there is none, or nothing to fit."""
        if self.fitted is None:
            return None
        posed = self.at(self.run.fitted_at, None)
        return clamped(posed, self.fitted, self.solver)

    def posed(self, ends: tuple[End, End], near: Case | None, length: float | None = None) -> Case:
        """Return the case of ``ends``, its quaternions signed like those of ``near``.

        Args:
            ends: in world coordinates.
            near: a case nearby; None leaves the signs as they are.
            length: of the cable there, m; None takes its own.
        """
        cable = self.run.cable
        if length is not None and length != cable.length:
            cable = dataclasses.replace(cable, length=length)
        posed = case(cable, *ends, self._gravity)
        if near is None:
            return posed
        return posed.signed_like(near.boundary.start_quaternion, near.boundary.end_quaternion)

    def path(self, near: Case) -> Callable[[float], Case]:
        """Return the cases by motion value (0 to 1), signed like ``near``."""
        return lambda at: self.at(at, near)

    def at(self, at: float, near: Case | None) -> Case:
        """Return the case at motion value ``at``, signed like ``near``."""
        return self.posed(self.problem.ends(self.name, [at])[0], near, float(self.problem.lengths(self.name, [at])[0]))

    def follow(self, start: Solved, first: float, last: float, smallest: float | None = None) -> tuple[Solved, float]:
        """Continue ``start`` from motion value ``first`` towards ``last``, as far as it goes.

        Arguments and results as of :func:`harness_opt.statics.continuation.follow`.
        """
        return follow(self.path(start.case), start, first, last, self.solver, smallest)
