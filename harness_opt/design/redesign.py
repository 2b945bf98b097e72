"""Redesign, within tolerances where the problem states them: the outer loop, asked for what tolerances take away.

The first round holds the limits for the nominal design. At its end margins are linearised in the tolerances; what they
take from each limit is asked for in the next round, until a design holds with what its own tolerances take.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

from harness_opt.design import nominal
from harness_opt.design.evaluation import GUARD
from harness_opt.design.nominal import Watch
from harness_opt.design.result import Earlier, Redesign
from harness_opt.design.robustness import Robustness, Within, within
from harness_opt.errors import ProblemError, SolveError, Status
from harness_opt.model.design import Robust
from harness_opt.model.limits import LimitId
from harness_opt.model.problem import Problem, given_problem
from harness_opt.motion.follower import Progress
from harness_opt.numerics.threads import one_at_a_time
from harness_opt.parts.scene import Scene, load_scene

ROUNDS = 5  # allowances change little with the design, so two or three do
SPARE = 0.05  # of an allowance, asked for on top: what the next design's own allowances may be more
WASTE = 0.15  # of an allowance: more than that on top of what a design needs is asked for less in another round
NEAR = 4.0 * GUARD  # a margin that near to what it is asked for stands in the way


@one_at_a_time
def redesign(
    problem: Problem,
    *,
    solver: str = "gauss-newton",
    progress: Progress | None = None,
    watch: Watch | None = None,
    earlier: Earlier | None = None,
    pareto: tuple[str, str] | None = None,
    throw: bool = True,
) -> Redesign:
    """Return the design nearest to the one given (or what ``problem.design`` asks for) that holds every limit.

    Where ``problem.robust`` states tolerances, it holds them at every corner, or for the share asked for.

    Args:
        problem: with design variables and limits.
        solver: name, as in :func:`harness_opt.equilibrium`.
        progress: called with every frame, as in :func:`harness_opt.simulate`.
        watch: called with every iteration.
        earlier: a redesign of the same problem that was interrupted, to go on from.
        pareto: two quantities whose trade-off curve is wanted too, as in
            :func:`harness_opt.design.trade_off.quantities`.
        throw: raise where no shape can be found, or return the failed result.

    Raises:
        ProblemError: no variables or no limits; a mesh that cannot be used; tolerances that no problem can have.
        SolveError: the original design cannot be simulated, not even moved inside its bounds.
    """
    robust = given_problem(problem).robust
    if robust is None:
        return nominal.nominal_redesign(
            problem, solver=solver, progress=progress, watch=watch, earlier=earlier, pareto=pareto, throw=throw
        )
    if pareto is not None:
        raise ProblemError("robust: found tolerances, expected none for a trade-off curve, whose points know of none")
    scene = load_scene(problem)
    before = _within(problem, scene, robust)
    asked: Mapping[LimitId, float] = {}
    rounds: list[_Round] = []
    while len(rounds) < ROUNDS:
        found = nominal.nominal_redesign(
            problem, solver=solver, progress=progress, watch=watch, earlier=None if rounds else earlier, asked=asked,
            throw=throw,
        )  # fmt: skip
        after = _within(found.problem, scene, robust) if len(found.motion.motion) else None
        rounds.append(_Round(found, after, asked))
        if after is None or not found.feasible or found.status is Status.INTERRUPTED or rounds[-1].done(robust):
            break
        asked = {limit: (1.0 + SPARE) * allowance for limit, allowance in after.allowances.items()}
    best = rounds[0]
    for this in rounds[1:]:
        best = this if this.better(best, robust) else best
    holds, share = best.holds(robust), robust.share if robust.hold == "quantile" else 1.0
    told = Robustness(robust.hold, share, holds, len(rounds), before, best.after)
    return dataclasses.replace(best.found, feasible=holds, robust=told)


@dataclass(frozen=True)
class _Round:
    """One redesign, how it fares within the tolerances, and the allowances that it was asked for."""

    found: Redesign
    after: Within | None
    asked: Mapping[LimitId, float]

    def holds(self, robust: Robust) -> bool:
        return self.found.feasible and self.after is not None and self.after.holds(robust, GUARD)

    def done(self, robust: Robust) -> bool:
        """Return whether it holds, and no limit that stands in its way was asked for more than it needs."""
        if self.after is None or not self.holds(robust):
            return False
        needed, margins = self.after.allowances, self.after.nominal
        near = [limit for limit, asked in self.asked.items() if margins[limit] < asked + NEAR]
        return all(self.asked[limit] <= (1.0 + WASTE) * needed[limit] + GUARD for limit in near)

    def better(self, other: _Round, robust: Robust) -> bool:
        """Return whether it holds more of what is asked for, or the same with less."""
        if self.holds(robust) and other.holds(robust):
            return sum(self.asked.values()) < sum(other.asked.values())
        if self.after is None or other.after is None:
            return other.after is None and self.after is not None
        return self.holds(robust) or (not other.holds(robust) and self.after.share > other.after.share)


def _within(problem: Problem, scene: Scene, robust: Robust) -> Within | None:
    """Return how a design fares within tolerances; None where it cannot be simulated."""
    try:
        return within(problem, scene, robust)
    except SolveError:
        return None
