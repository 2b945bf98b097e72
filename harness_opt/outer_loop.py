"""The outer loop: change length and clamp poses as little as possible until every limit holds over the whole motion.

Sequential quadratic programming with a trust region and one elastic slack (Fletcher, "Practical Methods of
Optimization", section 12.4; Nocedal and Wright, section 18.5): at each design the whole motion is simulated, every
limit near its bound is linearised at its witnesses, and a small quadratic program gives the step. The end is
verified on twice the frames and twice the elements; what that shows to be short is asked for in addition, and the
loop goes on.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from . import design_variables
from .between_frames import BetweenFrames
from .clearance import Between, ClearanceResult, measure
from .errors import ProblemError, SolveError, Status
from .following import Progress
from .limits import all_limits, held, limit_label
from .motion import collect, simulate
from .problem import Problem
from .results import LimitResult, Motion
from .rotations import Array
from .scene import load_scene
from .sweeps import followed, sweep
from .threads import one_thread
from .trials import GUARD, HELD, Trial, Trials

ITERATIONS = 60
TRUST = 0.25  # first trust region, in the bounds' ranges
LEAST_TRUST = 1e-5
PENALTY = 100.0  # of the slack in the quadratic program; above any multiplier of an objective of order one
STEP_DONE = 1e-3  # a step below this, in the bounds' ranges, ends the loop
MARGIN = 1e-3  # by how much a trial must improve on the designs met before
WORST = 0.5  # largest scaled violation that a lower objective can excuse
SEARCH_STRIDE = 2  # of the frames that the search solves
LOOK_STRIDE = 4  # of those that a look at a far design solves
ROWS = 400  # most linearised limits in a quadratic program, the tightest first
VERIFICATIONS = 4
STARTS = 3  # other designs looked at where the first start stalls, and as many for each variable
RESTARTS = 3  # of which the best are iterated from


@dataclass(frozen=True)
class VariableResult:
    """One design variable before and after, with its bounds, in the unit of its key."""

    before: float
    after: float
    lower: float
    upper: float


@dataclass(frozen=True)
class Step:
    """One iteration: objective, worst scaled margin (>= 0 holds) and which limit it was, trust region, accepted or
    not.
    """

    objective: float
    margin: float
    limit: str
    trust: float
    accepted: bool


@dataclass(frozen=True)
class Redesign:
    """What a redesign found.

    Args:
        problem: the redesigned problem; ``harness_opt.write_problem`` writes it.
        original: the problem it came from.
        motion: of the redesigned problem, on twice the frames and twice the elements.
        clearances: of that motion.
        limits: rows of that motion; all margins are >= 0 where ``ok``.
        limits_before: rows of the original design.
        motion_before: of the original design.
        variables: before and after, by name.
        iterations: quadratic programs solved.
        history: of the iterations.
        active: what holds the design where it is: limits by name, and variables at a bound.
        feasible: whether all limits hold.
        status: OK, or why a design could not be simulated.
        message: for the user; empty where all is well.
        timing: seconds by phase.
    """

    problem: Problem
    original: Problem
    motion: Motion
    clearances: ClearanceResult
    limits: tuple[LimitResult, ...]
    limits_before: tuple[LimitResult, ...]
    motion_before: Motion
    variables: Mapping[str, VariableResult]
    iterations: int
    history: tuple[Step, ...]
    active: tuple[str, ...]
    feasible: bool
    status: Status = Status.OK
    message: str = ""
    timing: Mapping[str, float] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        """True where every shape was found and every limit holds."""
        return self.status.ok and self.feasible


def check_design(problem: Problem) -> None:
    """Raise ProblemError where ``problem`` has nothing to redesign or nothing to hold."""
    mistakes = []
    if not problem.design.variables:
        some = ", ".join(design_variables.names(problem)[:3])
        mistakes.append(f"design.variables: found none, expected at least one, such as {some}")
    limits = dataclasses.asdict(problem.limits).values()
    if all(limit is None for limit in limits) and all(part.clearance is None for part in problem.parts.values()):
        mistakes.append("limits: found none, expected at least one limit for the redesign to hold")
    if mistakes:
        raise ProblemError(mistakes)


def spread(count: int, dimensions: int) -> Array:
    """Return ``count`` points (count, dimensions) that fill the unit cube evenly, the same at every call.

    The additive recurrence whose steps are powers of the root of x^(d + 1) = x + 1 (Roberts, "The unreasonable
    effectiveness of quasirandom sequences", 2018); scipy.stats has others, at a third of a second of import.
    """
    root = 1.5
    for _ in range(60):  # a contraction by at least a half each time
        root = (1.0 + root) ** (1.0 / (dimensions + 1))
    steps = root ** -np.arange(1.0, dimensions + 1)
    return (0.5 + np.outer(np.arange(1, count + 1), steps)) % 1.0


class _Loop:
    """The state of one redesign; see :func:`redesign`."""

    def __init__(self, trials: Trials, progress: Progress | None):
        self.trials, self.progress = trials, progress
        self.problem = trials.problem
        variables = self.problem.design.variables
        self.lower = np.array([v.lower for v in variables])
        self.upper = np.array([v.upper for v in variables])
        self.range = self.upper - self.lower
        self.start = np.clip(design_variables.values(self.problem), self.lower, self.upper)
        self.history: list[Step] = []
        self.best: Trial

    def objective(self, values: Array) -> float:
        """Return the objective, of order one: squared change in the bounds' ranges, or length in ranges."""
        if self.problem.design.minimise == "change":
            return 0.5 * float(np.sum(((values - self.start) / self.range) ** 2))
        return float(self.lengths() @ ((values - self.lower) / self.range))

    def lengths(self) -> Array:
        return np.array(
            [float(design_variables.target(v.name).quantity == "length") for v in self.problem.design.variables]
        )

    def step(self, design: Trial, trust: float) -> Array:
        """Return the step (k,), in the bounds' ranges, of the quadratic program at ``design``."""
        tightest = np.argsort(design.rows.margin, kind="stable")[:ROWS]
        rate = design.rows.rate[tightest] * self.range
        k, m = len(self.range), len(tightest)
        at = (design.values - self.start) / self.range
        small = 1e-6  # keeps the step unique where the objective does not
        hessian, gradient = small * np.eye(k + 1), np.zeros(k + 1)
        if self.problem.design.minimise == "change":
            hessian[:k, :k] += np.eye(k)
            gradient[:k] = at
        else:
            gradient[:k] = self.lengths()
        gradient[k] = PENALTY
        lowest = np.maximum((self.lower - design.values) / self.range, -trust)
        highest = np.minimum((self.upper - design.values) / self.range, trust)
        program = ca.conic(
            "step", "highs", {"h": ca.Sparsity.dense(k + 1, k + 1), "a": ca.Sparsity.dense(m, k + 1)},
            {"highs": {"output_flag": False}, "error_on_fail": False},
        )  # fmt: skip
        answer = program(
            h=hessian, g=gradient, a=np.hstack([rate, np.ones((m, 1))]), lba=-design.rows.margin[tightest],
            lbx=np.append(lowest, 0.0), ubx=np.append(highest, np.inf),
        )  # fmt: skip
        return np.clip(np.asarray(answer["x"]).ravel()[:k], lowest, highest)

    def better(self, a: Trial, b: Trial) -> bool:
        """Return whether ``a`` is to be preferred to ``b``: less violation, then the lower objective."""
        if max(a.violation, b.violation) <= HELD:
            return self.objective(a.values) < self.objective(b.values)
        return a.violation < b.violation

    def search(self, trial: Trial) -> Trial:
        """Iterate from ``trial``; where that ends with a limit violated, from other designs within the bounds too.

        A cable deep inside a part is pushed out through the nearest face, which may be one that no design reaches. The
        search uses half of the frames, and all of them to end with.
        """
        best = self.run(trial, SEARCH_STRIDE)
        if best.violation > HELD:
            starts = self.lower + spread(STARTS * (1 + len(self.range)), len(self.range)) * self.range
            looks = [self.trials(start, None, stride=LOOK_STRIDE, look=True) for start in starts]
            found = [look for look in looks if look is not None]
            found.sort(key=lambda look: (max(look.violation, HELD), self.objective(look.values)))
            for look in found[:RESTARTS]:
                scout = self.trials(look.values, look, stride=SEARCH_STRIDE)
                if scout is None:
                    continue
                end = self.run(scout, SEARCH_STRIDE)
                best = end if self.better(end, best) else best
                if best.violation <= HELD:
                    break
        full = self.trials(best.values, best)
        return best if full is None else self.run(full, 1)

    def run(self, design: Trial, stride: int) -> Trial:
        """Iterate from ``design`` until the step is small or the trust region is; return the best design met.

        A trial is taken where no earlier design has both less violation and a lower objective: a filter, which lets
            the iterates pass through slight violations on the way along a curved limit. Fletcher and Leyffer,
            "Nonlinear programming without a penalty function", Math. Program. 91 (2002).
        """
        trust, best = TRUST, design
        met = [(design.violation, self.objective(design.values))]
        for _ in range(ITERATIONS):
            step = self.step(design, trust)
            size = float(np.max(np.abs(step)))
            if size < STEP_DONE and (design.violation <= HELD or size < 1e-2 * STEP_DONE):
                break
            trial = self.trials(design.values + step * self.range, design, stride=stride)
            accepted = False
            if trial is not None:
                violation, objective = trial.violation, self.objective(trial.values)
                accepted = all(
                    (violation <= max((1.0 - MARGIN) * v, HELD) and (violation < v or objective < o))
                    or (objective <= o - MARGIN * violation and violation <= WORST)
                    for v, o in met
                )
            self.note(trial or design, trust, accepted)
            if accepted and trial is not None:
                met.append((trial.violation, self.objective(trial.values)))
                trust = 2.0 * trust if size > 0.9 * trust else trust
                design = trial
                best = design if self.better(design, best) else best
                self.best = best
            else:
                trust = 0.35 * min(trust, size)
                if trust < LEAST_TRUST:
                    break
        return best

    def note(self, design: Trial, trust: float, accepted: bool) -> None:
        worst = design.worst
        self.history.append(
            Step(
                self.objective(design.values),
                float(design.rows.margin[worst]),
                design.rows.name[worst],
                trust,
                accepted,
            )
        )
        if self.progress:
            self.progress("redesign", len(self.history), 0)

    def active(self, design: Trial) -> tuple[str, ...]:
        """Return what holds the design where it is: limits near their bound, and variables at theirs."""
        near = dict.fromkeys(
            name for name, margin in zip(design.rows.name, design.rows.margin, strict=True) if margin < 2.0 * GUARD
        )
        at_bound = [
            f"{v.name} at its {side} bound"
            for v, value, width in zip(self.problem.design.variables, design.values, self.range, strict=True)
            for side, bound in (("lower", v.lower), ("upper", v.upper))
            if abs(value - bound) < 1e-6 * width
        ]
        return (*near, *at_bound)


@one_thread
def redesign(
    problem: Problem,
    *,
    solver: str = "gauss-newton",
    progress: Progress | None = None,
    throw: bool = True,
) -> Redesign:
    """Return the design nearest to the one given (or the shortest) that holds every limit over the whole motion.

    Args:
        problem: with design variables and limits.
        solver: name, as in :func:`harness_opt.equilibrium`.
        progress: called with a word, iterations done and 0, and with frames as in :func:`harness_opt.simulate`.
        throw: raise where no shape can be found, or return the failed result.

    Raises:
        ProblemError: no variables or no limits; a mesh that cannot be used.
        SolveError: the original design cannot be simulated, not even moved inside its bounds.
    """
    check_design(problem)
    begin = time.perf_counter()
    scene = load_scene(problem)
    loaded = time.perf_counter()
    trials = Trials(problem, scene, solver, progress)
    loop = _Loop(trials, progress)
    before = design_variables.values(problem)
    original = trials(before, None)
    first = original if np.array_equal(loop.start, before) else trials(loop.start, original)
    if original is None:
        motion_before = simulate(problem, solver=solver, throw=False)
        clearances_before = measure(problem, scene, motion_before.motion, motion_before.cables)
    else:
        motion_before, clearances_before = original.motion, original.clearances
    limits_before = all_limits(problem, motion_before, clearances_before) if len(motion_before.motion) else ()
    message = ""
    if first is None:
        final, clearances, rows, values = motion_before, clearances_before, limits_before, before
        status = Status.STEP_TOO_SMALL if motion_before.ok else motion_before.status
        message = motion_before.message or "the design moved inside its bounds cannot be simulated"
        active: tuple[str, ...] = ()
    else:
        loop.best = first
        try:
            best, final, clearances, rows = _verified(loop, first)
            status, message = final.status, final.message
        except KeyboardInterrupt:  # raised by ``progress``: the best design met is kept, unverified
            best = loop.best
            final, clearances = best.motion, best.clearances
            rows = all_limits(final.problem, final, clearances)
            status = Status.INTERRUPTED
            message = status.value
        values, active = best.values, loop.active(best)
    variables = {
        v.name: VariableResult(float(b), float(a), v.lower, v.upper)
        for v, b, a in zip(problem.design.variables, before, values, strict=True)
    }
    result = Redesign(
        final.problem, problem, final, clearances, rows, limits_before, motion_before, variables, len(loop.history),
        tuple(loop.history), active, status.ok and held(rows) and not final.snaps, status, message,
        {"load": loaded - begin, "solve": time.perf_counter() - loaded},
    )  # fmt: skip
    if throw and not status.ok:
        raise SolveError(message, status, result)
    return result


def _scale(row: LimitResult, problem: Problem) -> float:
    """Return what a margin is divided by to be comparable, as in :mod:`harness_opt.linearised`."""
    return row.limit + problem.cables[row.cable].cable.radius if row.name == "clearance" else row.limit


def _verified(loop: _Loop, design: Trial) -> tuple[Trial, Motion, ClearanceResult, tuple[LimitResult, ...]]:
    """Run the loop, simulate the end twice as finely, ask for what is short there, and run again.

    Clearances are those of the whole motion there, between the frames too.
    """
    for attempt in range(VERIFICATIONS):
        design = loop.search(design)
        changed = design_variables.rebased(loop.problem, design.values)
        frames = loop.trials.frames
        fine = np.interp(np.linspace(0, 1, 2 * len(frames) - 1), np.linspace(0, 1, len(frames)), frames)
        motion = _fine_motion(changed, fine, design, loop)
        between = Between(BetweenFrames(motion), motion.snaps)
        clearances = measure(changed, loop.trials.scene, motion.motion, motion.cables, between=between)
        rows = all_limits(changed, motion, clearances)
        short = {
            limit_label(row.name, row.cable, row.part): -row.margin / _scale(row, changed)
            for row in rows
            if row.margin < 0
        }
        if not short or design.violation > HELD or attempt == VERIFICATIONS - 1:
            break
        for name, amount in short.items():
            loop.trials.asked[name] += 1.5 * amount
        again = loop.trials(design.values, design)
        if again is None:
            break
        design = again
    return design, motion, clearances, rows


def _fine_motion(problem: Problem, fine: Array, design: Trial, loop: _Loop) -> Motion:
    """Simulate ``problem`` anew, from a cold start, on the frames ``fine`` and twice the elements."""
    begin = time.perf_counter()
    cables = {}
    for name in problem.cables:
        elements = 2 * (len(design.sweeps[name].frames[0].bound.mesh) - 1)
        cables[name] = followed(sweep(problem, name, fine, solver=loop.trials.solver, elements=elements))
    return collect(problem, fine, cables, time.perf_counter() - begin)
