"""The search for the best design over the bounds, and its verification on twice the frames and twice the elements.

A search that ends with a limit violated is followed by one for the least violation, from where it ended and from other
designs within the bounds. What a verification shows to be short is asked for in addition, and the search goes on.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from harness_opt.clearance.limits import all_hold, all_limits
from harness_opt.clearance.measure import measure
from harness_opt.clearance.pairs import Between, ClearanceResult
from harness_opt.design.evaluation import GUARD, Evaluated, Evaluator
from harness_opt.design.objective import Objective
from harness_opt.design.sqp import Note, descend
from harness_opt.model import design_variables
from harness_opt.model.problem import Problem
from harness_opt.model.results import LimitResult, Motion
from harness_opt.motion.between_frames import BetweenFrames
from harness_opt.motion.simulate import collect
from harness_opt.motion.sweep import followed, sweep
from harness_opt.numerics.rotations import Array

SEARCH_STRIDE = 2  # of the frames that the search solves
LOOK_STRIDE = 4  # of those that a look at a far design solves
VERIFICATIONS = 4
STARTS = 3  # other designs looked at where the first start stalls, and as many for each variable
RESTARTS = 3  # of which the best are iterated from
EXTRA = 1.5  # of what a verification found short: asked for in addition
ELSEWHERE = 1e-3  # lengths of the cable: shapes this far apart at one pose are two shapes


@dataclass(frozen=True)
class Verified:
    """A design simulated anew, from a cold start, on twice the frames and twice the elements.

    Args:
        trial: what the search saw of it.
        motion: of the problem as it would be written.
        clearances: of the whole motion, between the frames too.
        rows: of all limits.
    """

    trial: Evaluated
    motion: Motion
    clearances: ClearanceResult
    rows: tuple[LimitResult, ...]

    def holds(self, *, snaps: bool = False) -> bool:
        """Return whether every limit is certain to hold; ``snaps`` allows them."""
        return self.motion.ok and all_hold(self.rows) == "yes" and (snaps or not self.motion.snaps)


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


def search(evaluate: Evaluator, objective: Objective, trial: Evaluated, note: Note, *, near: bool = False) -> Evaluated:
    """Return the best design found from ``trial``, on all frames.

    The search uses half of the frames, and all of them to end with. Where it ends with a limit violated it begins again
    from other designs within the bounds, and looks for the least violation: a cable deep inside a part is pushed out
    through the nearest face, which may be one that no design reaches. A design that is ``near`` the end already needs
    no more than all frames.
    """
    if near:
        best = descend(evaluate, objective, trial, 1, note)
        if objective.held(best):
            return best
    best = descend(evaluate, objective, trial, SEARCH_STRIDE, note)
    if not objective.held(best):
        best = _elsewhere(evaluate, objective, best, note)
    if not objective.held(best):
        best = _redeemed(evaluate, objective, best, note)
    full = evaluate(best.values, best)
    if full is None:
        return best
    best = descend(evaluate, objective, full, 1, note)
    return best if objective.held(best) else descend(evaluate, objective.least_violation(), best, 1, note)


def _redeemed(evaluate: Evaluator, objective: Objective, design: Evaluated, note: Note) -> Evaluated:
    """Return the design of least violation near ``design``, and where that holds all limits the best from there."""
    least = descend(evaluate, objective.least_violation(), design, SEARCH_STRIDE, note)
    return descend(evaluate, objective, least, SEARCH_STRIDE, note) if objective.held(least) else least


def _elsewhere(evaluate: Evaluator, objective: Objective, best: Evaluated, note: Note) -> Evaluated:
    """Return the best found from other designs within the bounds, or ``best`` where none is better."""
    found = []
    for start in _starts(objective):
        look = evaluate(start, None, stride=LOOK_STRIDE, quick=True)
        if look is not None:
            found.append(look)
            if objective.held(look):
                break
    for look in sorted(found, key=objective.violation)[:RESTARTS]:
        scout = evaluate(look.values, look, stride=SEARCH_STRIDE)
        if scout is None:
            continue
        end = _redeemed(evaluate, objective, scout, note)
        best = end if objective.better(end, best) else best
        if objective.held(best):
            break
    return best


def _starts(objective: Objective) -> Array:
    """Return designs (n, k) within the bounds, evenly spread, the best for the objective first."""
    count = len(objective.range)
    starts = objective.lower + spread(STARTS * (1 + count), count) * objective.range
    return starts[np.argsort([objective.preference(start) for start in starts], kind="stable")]


def verified(evaluate: Evaluator, objective: Objective, design: Evaluated, note: Note) -> Verified:
    """Search from ``design``, verify the end, ask for what is short there, and search again."""
    for attempt in range(VERIFICATIONS):
        design = search(evaluate, objective, design, note, near=attempt > 0 and not evaluate.cold)
        found = verify(evaluate, design)
        if found.holds(snaps=objective.snaps) or not objective.held(design) or attempt == VERIFICATIONS - 1:
            break
        if _strayed(design, found.motion):
            # of two shapes of one pose the search followed another one than a start from nothing finds
            evaluate.cold = True
        else:
            _ask_for_more(evaluate, found)
        again = evaluate(design.values, design)
        if again is None:
            break
        design = again
    return found


def _ask_for_more(evaluate: Evaluator, found: Verified) -> None:
    """Ask in addition for what a verification found short, or too near to its limit to be certain."""
    for row in found.rows:
        short = row.margin - (row.tolerance if row.holds == "uncertain" else 0.0)
        if short < 0 and math.isfinite(short):
            radius = found.motion.problem.cables[row.cable].cable.radius
            # what is short by less than the search lets pass would otherwise stay so
            evaluate.asked[row.id] += EXTRA * -short / row.scale(radius) + GUARD


def verify(evaluate: Evaluator, design: Evaluated) -> Verified:
    """Simulate ``design`` anew on twice the frames and twice the elements; clearances are those between frames too."""
    frames = evaluate.frames
    problem = design_variables.rebased(evaluate.problem, design.values)
    fine = np.interp(np.linspace(0, 1, 2 * len(frames) - 1), np.linspace(0, 1, len(frames)), frames)
    motion = _fine_motion(problem, fine, design, evaluate.solver)
    between = Between(BetweenFrames(motion), motion.snaps)
    clearances = measure(problem, evaluate.scene, motion.motion, motion.cables, between=between)
    return Verified(design, motion, clearances, all_limits(problem, motion, clearances))


def _fine_motion(problem: Problem, fine: Array, design: Evaluated, solver: str) -> Motion:
    """Simulate ``problem`` anew, from a cold start, on the frames ``fine`` and twice the elements."""
    begin = time.perf_counter()
    cables = {}
    for name in problem.cables:
        elements = 2 * (len(design.sweeps[name].frames[0].bound.mesh) - 1)
        cables[name] = followed(sweep(problem, name, fine, solver=solver, elements=elements))
    return collect(problem, fine, cables, time.perf_counter() - begin)


def _strayed(design: Evaluated, fine: Motion) -> bool:
    """Return whether the shapes of ``fine`` are others than those that the search saw in the same frames."""
    seen, new = design.motion, fine.motion
    _, ours, theirs = np.intersect1d(seen.motion, new, return_indices=True)
    return any(
        float(np.max(np.linalg.norm(seen.cables[name].position[ours] - cable.position[theirs], axis=-1), initial=0.0))
        > ELSEWHERE * cable.s[-1]
        for name, cable in fine.cables.items()
    )
