"""The outer loop: change length and clamp poses as little as possible until every limit holds over the whole motion.

The search is :mod:`harness_opt.design.sqp`, over several starts :mod:`harness_opt.design.search`, which verifies its
end on twice the frames and twice the elements. Where a problem states tolerances, the first round holds the limits for
the nominal design. At its end margins are linearised in the tolerances; what they take from each limit is asked for in
the next round, until a design holds with what its own tolerances take.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from harness_opt.clearance.limits import all_limits
from harness_opt.clearance.pairs import ClearanceResult
from harness_opt.design.evaluation import GUARD, Evaluated, Evaluator
from harness_opt.design.explanations import Price, WaysOut, prices, ways_out
from harness_opt.design.objective import Objective, objective_of
from harness_opt.design.result import AtBound, Earlier, Redesign, VariableResult
from harness_opt.design.robustness import Robustness, Within, within
from harness_opt.design.search import otherwise_bowed, verified
from harness_opt.design.sqp import Step, stationary
from harness_opt.design.starts import beginning
from harness_opt.design.trade_off import TradeOff, check_pair, trade_off
from harness_opt.design.verification import Verified
from harness_opt.errors import ProblemError, SolveError, Status
from harness_opt.model import design_variables
from harness_opt.model.design import Robust
from harness_opt.model.limits import LimitId
from harness_opt.model.problem import Problem, given_problem
from harness_opt.model.results import LimitResult, Motion
from harness_opt.motion.follower import Progress
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.threads import one_at_a_time, one_thread
from harness_opt.parts.scene import Scene, load_scene

ROUNDS = 5  # allowances change little with the design, so two or three do
SPARE = 0.05  # of an allowance, asked for on top: what the next design's own allowances may be more
WASTE = 0.15  # of an allowance: more than that on top of what a design needs is asked for less in another round
NEAR = 4.0 * GUARD  # a margin that near to what it is asked for stands in the way
AT_BOUND = 1e-6  # of a variable's range: this near to a bound it stands at it


@one_at_a_time
def redesign(
    problem: Problem,
    *,
    solver: str = "gauss-newton",
    progress: Progress | None = None,
    watch: Watch | None = None,
    earlier: Earlier | None = None,
    pareto: tuple[str, str] | None = None,
    executor: Executor | None = None,
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
        executor: of processes that help where many designs are looked at, such as a ``ProcessPoolExecutor`` that spawns
            its own; what is found is the same. None looks at one after the other.
        throw: raise where no shape can be found, or return the failed result.

    Raises:
        ProblemError: no variables or no limits; a mesh that cannot be used; a cable too short within all bounds;
            tolerances that no problem can have.
        SolveError: no design that was looked at within the bounds can be simulated.
    """
    robust = given_problem(problem).robust
    if problem.design.minimise == "clips" and problem.design.maximise is None:
        if pareto is not None:
            raise ProblemError('design.minimise: found "clips", expected "change" or "length" for a trade-off curve')
        if robust is not None:
            raise ProblemError(
                'design.minimise: found "clips", expected "change" or "length" where tolerances are held'
            )

        def solved(one: Problem, reasons: bool) -> Redesign:
            return _nominal_redesign(
                one, solver=solver, progress=progress, watch=watch, executor=executor, reasons=reasons, throw=False
            )

        return _fewest_clips(problem, solved, throw=throw)
    if robust is None:
        return _nominal_redesign(
            problem, solver=solver, progress=progress, watch=watch, earlier=earlier, pareto=pareto, executor=executor,
            throw=throw,
        )  # fmt: skip
    if pareto is not None:
        raise ProblemError("robust: found tolerances, expected none for a trade-off curve, whose points know of none")
    scene = load_scene(problem)
    before = _within(problem, scene, robust)
    asked: Mapping[LimitId, float] = {}
    rounds: list[_Round] = []
    while len(rounds) < ROUNDS:
        found = _nominal_redesign(
            problem, solver=solver, progress=progress, watch=watch, earlier=None if rounds else earlier, asked=asked,
            executor=executor, throw=throw,
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


def _fewest_clips(problem: Problem, solved: Callable[[Problem, bool], Redesign], *, throw: bool) -> Redesign:
    """Return the redesign with the fewest optional clips that holds all limits, of those the one of least change.

    Every choice of clips is redesigned in turn, none of them first; that with all of them where none holds.
    """
    optional = [(name, clip.name) for name, run in problem.cables.items() for clip in run.clips if clip.optional]
    last: Redesign | None = None
    for count in range(len(optional) + 1):
        held = []
        for kept in itertools.combinations(optional, count):
            without = [one for one in optional if one not in kept]
            # why one with fewer clips does not do is not asked: one with more may
            found = solved(_without(problem, without), count == len(optional))
            last = dataclasses.replace(found, without=tuple(f"{cable}.{clip}" for cable, clip in without))
            if last.feasible or last.status is Status.INTERRUPTED:
                held.append(last)
            if last.status is Status.INTERRUPTED:
                break
        if held:
            return min(held, key=_change)
    assert last is not None
    if throw and not last.status.ok:
        raise SolveError(last.message, last.status, last)
    return last


def _without(problem: Problem, clips: Sequence[tuple[str, str]]) -> Problem:
    """Return ``problem`` without some clips, their variables, and what follows these."""
    runs = {
        name: dataclasses.replace(run, clips=tuple(clip for clip in run.clips if (name, clip.name) not in clips))
        for name, run in problem.cables.items()
    }
    gone = tuple(f"{cable}.{clip}." for cable, clip in clips)
    design = dataclasses.replace(
        problem.design,
        variables=tuple(v for v in problem.design.variables if not v.name.startswith(gone)),
        couplings=tuple(c for c in problem.design.couplings if not c.name.startswith(gone)),
        weights={name: weight for name, weight in problem.design.weights.items() if not name.startswith(gone)},
        minimise="change",
    )
    led = {c.leader for c in design.couplings} - {v.name for v in design.variables}
    design = dataclasses.replace(design, couplings=tuple(c for c in design.couplings if c.leader not in led))
    return dataclasses.replace(problem, cables=runs, design=design)


def _change(found: Redesign) -> float:
    """Return how much a redesign changes, in the ranges of its variables."""
    shares = [(v.after - v.before) / (v.upper - v.lower) for v in found.variables.values()]
    return math.hypot(*shares)


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


Watch = Callable[[Step], None]


def check_design(problem: Problem) -> None:
    """Raise ProblemError where ``problem`` has nothing to redesign or nothing to hold."""
    mistakes = []
    if not problem.design.variables:
        some = ", ".join(design_variables.names(problem)[:3])
        mistakes.append(f"design.variables: found none, expected at least one, such as {some}")
    if not problem.has_limits:
        mistakes.append("limits: found none, expected at least one limit for the redesign to hold")
    if mistakes:
        raise ProblemError(mistakes)


def _active(trial: Evaluated, problem: Problem, objective: Objective) -> tuple[LimitId | AtBound, ...]:
    """Return what holds the design where it is: limits near their bound, and variables at theirs."""
    rows = zip(trial.rows.limit, trial.rows.margin, strict=True)
    near = dict.fromkeys(limit for limit, margin in rows if limit is not None and margin < 2.0 * GUARD)
    at_bound = [
        AtBound(v.name, side)
        for v, value, width in zip(problem.design.variables, trial.values, objective.range, strict=True)
        for side, bound in (("lower", v.lower), ("upper", v.upper))
        if abs(value - bound) < AT_BOUND * width
    ]
    return (*near, *at_bound)


class _Log:
    """The history of a redesign, and the best design met so far."""

    def __init__(self, first: Evaluated | None, earlier: Earlier | None, watch: Watch | None):
        self.history: list[Step] = [] if earlier is None else list(earlier.history)
        self.best = first
        self._watch = watch

    def __call__(self, step: Step, best: Evaluated) -> None:
        self.history.append(step)
        self.best = best
        if self._watch:
            self._watch(step)


@one_thread
def _nominal_redesign(
    problem: Problem,
    *,
    solver: str = "gauss-newton",
    progress: Progress | None = None,
    watch: Watch | None = None,
    earlier: Earlier | None = None,
    pareto: tuple[str, str] | None = None,
    executor: Executor | None = None,
    asked: Mapping[LimitId, float] | None = None,
    reasons: bool = True,
    throw: bool = True,
) -> Redesign:
    """Return what :func:`redesign` does for the nominal design, tolerances or none.

    Arguments and errors as there, and:

    Args:
        asked: margins to hold, by limit, as a share of it: what tolerances take from it; none where left out.
        reasons: whether to look for what would have to give where a limit is violated.
    """
    check_design(problem)
    if pareto is not None:
        check_pair(problem, pareto)
    begin = time.perf_counter()
    scene = load_scene(problem)
    loaded = time.perf_counter()
    evaluate, objective = Evaluator(problem, scene, solver, progress, executor), objective_of(problem)
    for limit, margin in (asked or {}).items():
        evaluate.asked[limit] += margin
    begun = beginning(evaluate, objective, _begin(problem, objective, earlier))
    first = begun.first
    status, message = Status.OK, ""
    log = _Log(first, earlier, watch)
    curve: TradeOff | None = None
    told: tuple[WaysOut, tuple[Price, ...]] = (WaysOut(), ())
    if first is None:
        status = Status.STEP_TOO_SMALL if begun.motion.ok else begun.motion.status
        message = begun.motion.message or f"none of {evaluate.count} designs within the bounds can be simulated"
        nothing = ClearanceResult(begun.motion.motion, ())
        ends = _Ends(design_variables.values(problem), begun.motion, nothing, begun.limits or (), (), False)
    else:
        try:
            found = verified(evaluate, objective, first, log)
            if found.motion.ok and not found.holds(snaps=objective.snaps):
                evaluate, found = otherwise_bowed(evaluate, objective, found, log)
            ends = _ends_of(found, problem, objective)
            status, message = found.motion.status, found.motion.message
            if status.ok and (reasons or found.holds(snaps=objective.snaps)):
                told = _reasons(evaluate, objective, found, log)
            if status.ok and pareto is not None:
                curve = trade_off(evaluate, _named(problem, ends.values), pareto, log)
        except KeyboardInterrupt:  # raised by ``progress``: the best design met is kept, verified or not
            status = Status.INTERRUPTED
            message = status.value
            ends = _unverified(log.best or first, problem, objective)
    variables = {
        v.name: VariableResult(float(b), float(a), v.lower, v.upper)
        for v, b, a in zip(problem.design.variables, design_variables.values(problem), ends.values, strict=True)
    }
    result = Redesign(
        problem=ends.motion.problem,
        original=problem,
        motion=ends.motion,
        clearances=ends.clearances,
        limits=ends.rows,
        limits_before=begun.limits,
        motion_before=begun.motion,
        variables=variables,
        iterations=len(log.history),
        history=tuple(log.history),
        active=ends.active,
        looked_at=evaluate.count,
        moved=design_variables.moved(problem),
        short=begun.short,
        optimal=ends.optimal,
        relaxations=told[0].alone,
        relaxations_together=told[0].together,
        prices=told[1],
        feasible=status.ok and ends.holds,
        status=status,
        message=message,
        timing={"load": loaded - begin, "solve": time.perf_counter() - loaded},
        trade_off=curve,
    )
    if throw and not status.ok:
        raise SolveError(message, status, result)
    return result


def _begin(problem: Problem, objective: Objective, earlier: Earlier | None) -> Array:
    """Return the values (k,) of the first design."""
    if earlier is None:
        return objective.centre
    return np.clip([earlier.values[v.name] for v in problem.design.variables], objective.lower, objective.upper)


def _named(problem: Problem, values: Array) -> dict[str, float]:
    return dict(zip((v.name for v in problem.design.variables), values.tolist(), strict=True))


@dataclass(frozen=True)
class _Ends:
    """Where a redesign ends: values (k,), their motion and its limits, what holds them, and whether all is well."""

    values: Array
    motion: Motion
    clearances: ClearanceResult
    rows: tuple[LimitResult, ...]
    active: tuple[LimitId | AtBound, ...]
    holds: bool
    optimal: bool = False


def _ends_of(found: Verified, problem: Problem, objective: Objective) -> _Ends:
    holds = found.holds(snaps=objective.snaps)
    active = _active(found.unrounded, problem, objective)
    optimal = holds and stationary(objective, found.unrounded)
    return _Ends(found.trial.values, found.motion, found.clearances, found.rows, active, holds, optimal)


def _unverified(best: Evaluated, problem: Problem, objective: Objective) -> _Ends:
    rows = all_limits(best.motion.problem, best.motion, best.clearances)
    return _Ends(best.values, best.motion, best.clearances, rows, _active(best, problem, objective), False)


def _reasons(
    evaluate: Evaluator, objective: Objective, found: Verified, log: _Log
) -> tuple[WaysOut, tuple[Price, ...]]:
    """Return what would have to give where a limit is violated, and what limits and bounds cost where none is."""
    if found.holds(snaps=objective.snaps):
        return WaysOut(), prices(evaluate.problem, objective, found.unrounded)
    return ways_out(evaluate, objective, found.unrounded, log), ()
