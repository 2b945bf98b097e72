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
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from . import design_variables
from .clearance import ClearanceResult, measure
from .continuation import Solved
from .errors import ProblemError, SolveError, Status
from .limits import all_limits, held, limit_label
from .linearised import Rows, linearised
from .motion import Sweep, collect, simulate, sweep
from .path import place_frames
from .problem import Problem
from .results import LimitResult, Motion
from .rotations import Array
from .scene import Scene, load_scene
from .sensitivity import ShapeRates, shape_rates
from .threads import one_thread

ITERATIONS = 60
TRUST = 0.25  # first trust region, in the bounds' ranges
LEAST_TRUST = 1e-5
PENALTY = 100.0  # of the slack in the quadratic program; above any multiplier of an objective of order one
STEP_DONE = 1e-3  # a step below this, in the bounds' ranges, ends the loop
MARGIN = 1e-3  # by how much a trial must improve on the designs met before
WORST = 0.5  # largest scaled violation that a lower objective can excuse
LOOK_STRIDE = 4  # of the frames that a look at a far design solves
ROWS = 400  # most linearised limits in a quadratic program, the tightest first
GUARD = 0.002  # asked for beyond each limit, in its own scale, so that a finer simulation still holds it
HELD = 0.5 * GUARD  # a violation of what is asked for that leaves the limit itself held
VERIFICATIONS = 4
STARTS = 4  # other designs looked at where the first start stalls, and as many for each variable
RESTARTS = 3  # of which the best are iterated from
SNAP_COST = 1.0  # of a snap in the merit, in scales of a limit: snaps are not for designing with

Progress = Callable[[str, int, int], None]


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


@dataclass(frozen=True)
class _Design:
    """One simulated design: the variables' values, sweeps by cable, motion, clearances, and the linearised limits."""

    values: Array
    sweeps: Mapping[str, Sweep]
    motion: Motion
    clearances: ClearanceResult
    rates: Mapping[str, ShapeRates]
    rows: Rows

    def predicted(self, name: str, values: Array) -> list[Solved]:
        """Return the frames of cable ``name`` with their unknowns moved to first order to the design ``values``."""
        frames = self.sweeps[name].frames
        if name not in self.rates:
            return list(frames)
        moved = self.rates[name].unknowns @ (values - self.values)
        return [
            dataclasses.replace(f, solution=dataclasses.replace(f.solution, x=f.solution.x + dx))
            for f, dx in zip(frames, moved, strict=True)
        ]

    @property
    def worst(self) -> int:
        return int(np.argmin(self.rows.margin))

    @property
    def violation(self) -> float:
        least = float(np.min(self.rows.margin, initial=np.inf))
        return max(0.0, -least) + SNAP_COST * len(self.motion.snaps)


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


class _Loop:
    """The state of one redesign; see :func:`redesign`."""

    def __init__(self, problem: Problem, scene: Scene, solver: str, progress: Progress | None):
        self.problem, self.scene, self.solver, self.progress = problem, scene, solver, progress
        variables = problem.design.variables
        self.lower = np.array([v.lower for v in variables])
        self.upper = np.array([v.upper for v in variables])
        self.range = self.upper - self.lower
        self.start = np.clip(design_variables.values(problem), self.lower, self.upper)
        self.frames = place_frames(problem)
        # asked for beyond each limit, in its scale; verifications add to it
        self.asked: defaultdict[str, float] = defaultdict(lambda: GUARD)
        self.history: list[Step] = []
        self.best: _Design

    # -- simulate and linearise ----------------------------------------------------------------------------------

    def evaluate(self, values: Array, near: _Design | None, *, stride: int = 1) -> _Design | None:
        """Simulate the design ``values`` (k,); None where it cannot be simulated.

        Args:
            values: of the variables.
            near: a design whose shapes to start from.
            stride: above 1 only every so many frames are solved and nothing is differentiated: a look, not a step.
        """
        frames = self.frames[::stride]
        try:
            changed = design_variables.apply(self.problem, values)
            sweeps = {
                name: sweep(
                    changed, name, frames, solver=self.solver, margins=False,
                    guesses=near.predicted(name, values)[::stride] if near else None, progress=self.progress,
                )
                for name in changed.cables
            }  # fmt: skip
        except ProblemError:  # shorter than the distance of its ends somewhere on the motion
            return None
        if any(swept.status is Status.INTERRUPTED for swept in sweeps.values()):
            raise KeyboardInterrupt
        if not all(swept.status.ok for swept in sweeps.values()):
            return None
        motion = collect(changed, frames, sweeps, 0.0)
        clearances = measure(changed, self.scene, frames, motion.cables)
        rates = {
            name: shape_rates(
                swept, design_variables.clamp_rates(self.problem, name, values, frames),
                motion.cables[name].s / swept.units.length,
            )
            for name, swept in (sweeps.items() if stride == 1 else ())
        }  # fmt: skip
        rows = linearised(changed, motion, clearances, rates, self.asked, len(self.range))
        return _Design(values, sweeps, motion, clearances, rates, rows)

    # -- the quadratic program -----------------------------------------------------------------------------------

    def objective(self, values: Array) -> float:
        """Return the objective, of order one: squared change in the bounds' ranges, or length in ranges."""
        if self.problem.design.minimise == "change":
            return 0.5 * float(np.sum(((values - self.start) / self.range) ** 2))
        return float(self.lengths() @ ((values - self.lower) / self.range))

    def lengths(self) -> Array:
        return np.array(
            [float(design_variables.target(v.name).quantity == "length") for v in self.problem.design.variables]
        )

    def step(self, design: _Design, trust: float) -> Array:
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

    def better(self, a: _Design, b: _Design) -> bool:
        """Return whether ``a`` is to be preferred to ``b``: less violation, then the lower objective."""
        if max(a.violation, b.violation) <= HELD:
            return self.objective(a.values) < self.objective(b.values)
        return a.violation < b.violation

    def search(self, design: _Design) -> _Design:
        """Iterate from ``design``; where that ends with a limit violated, from other designs within the bounds too.

        A cable deep inside a part is pushed out through the nearest face, which may be one that no design reaches.
        """
        best = self.run(design)
        if best.violation <= HELD:
            return best
        from scipy.stats import qmc  # takes a third of a second to import, and most designs never need it

        sampler = qmc.Halton(len(self.range), scramble=False)
        sampler.fast_forward(1)  # its first point is a corner
        starts = self.lower + sampler.random(STARTS * (1 + len(self.range))) * self.range
        looks = [(start, self.evaluate(start, None, stride=LOOK_STRIDE)) for start in starts]
        found = sorted(((look.violation, i) for i, (_, look) in enumerate(looks) if look is not None))
        for _, i in found[:RESTARTS]:
            scout = self.evaluate(looks[i][0], design)
            if scout is None:
                continue
            end = self.run(scout)
            best = end if self.better(end, best) else best
            if best.violation <= HELD:
                break
        return best

    def run(self, design: _Design) -> _Design:
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
            trial = self.evaluate(design.values + step * self.range, design)
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

    def note(self, design: _Design, trust: float, accepted: bool) -> None:
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

    def active(self, design: _Design) -> tuple[str, ...]:
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
    loop = _Loop(problem, scene, solver, progress)
    before = design_variables.values(problem)
    original = loop.evaluate(before, None)
    first = original if np.array_equal(loop.start, before) else loop.evaluate(loop.start, original)
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


def _verified(loop: _Loop, design: _Design) -> tuple[_Design, Motion, ClearanceResult, tuple[LimitResult, ...]]:
    """Run the loop, simulate the end twice as finely, ask for what is short there, and run again."""
    for attempt in range(VERIFICATIONS):
        design = loop.search(design)
        changed = design_variables.rebased(loop.problem, design.values)
        fine = np.interp(np.linspace(0, 1, 2 * len(loop.frames) - 1), np.linspace(0, 1, len(loop.frames)), loop.frames)
        motion = _fine_motion(changed, fine, design, loop)
        clearances = measure(changed, loop.scene, motion.motion, motion.cables)
        rows = all_limits(changed, motion, clearances)
        short = {
            limit_label(row.name, row.cable, row.part): -row.margin / _scale(row, changed)
            for row in rows
            if row.margin < 0
        }
        if not short or design.violation > HELD or attempt == VERIFICATIONS - 1:
            break
        for name, amount in short.items():
            loop.asked[name] += 1.5 * amount
        again = loop.evaluate(design.values, design)
        if again is None:
            break
        design = again
    return design, motion, clearances, rows


def _fine_motion(problem: Problem, fine: Array, design: _Design, loop: _Loop) -> Motion:
    """Simulate ``problem`` anew, from a cold start, on the frames ``fine`` and twice the elements."""
    begin = time.perf_counter()
    sweeps = {
        name: sweep(
            problem,
            name,
            fine,
            solver=loop.solver,
            elements=2 * (len(design.sweeps[name].frames[0].bound.mesh) - 1),
        )
        for name in problem.cables
    }
    return collect(problem, fine, sweeps, time.perf_counter() - begin)
