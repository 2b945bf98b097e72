"""A design as its file will be simulated: its values rounded, from a cold start, on twice the frames and twice the
elements, certified.
"""

from __future__ import annotations

import itertools
import math
import time
from dataclasses import dataclass

import numpy as np

from harness_opt.clearance.centreline import Curve
from harness_opt.clearance.limits import all_hold, all_limits
from harness_opt.clearance.measure import measure
from harness_opt.clearance.pairs import Between, ClearanceResult
from harness_opt.design.evaluation import GUARD, HELD, Evaluated, Evaluator
from harness_opt.design.objective import Objective
from harness_opt.harness.over_motion import FoundHarness
from harness_opt.model import design_variables
from harness_opt.model.problem import Problem
from harness_opt.model.results import STATIONS, CableMotion, LimitResult, Motion, joined, split
from harness_opt.motion.between_frames import BetweenFrames
from harness_opt.motion.simulate import collect
from harness_opt.motion.sweep import Sweep, in_turn, sweep
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices

EXTRA = 1.5  # of what a verification found short: asked for in addition
ELSEWHERE = 1e-3  # lengths of the cable: shapes this far apart at one pose are two shapes
MOST_WAYS = (
    8  # variables of which all neighbours are tried, a few thousand designs at most; of further ones the nearest
)


@dataclass(frozen=True)
class Verified:
    """A design simulated anew.

    Args:
        trial: what the search saw of it.
        unrounded: where the search ended, before its values were rounded.
        motion: of the problem as it would be written.
        clearances: of the whole motion, between the frames too.
        rows: of all limits.
    """

    trial: Evaluated
    unrounded: Evaluated
    motion: Motion
    clearances: ClearanceResult
    rows: tuple[LimitResult, ...]

    def holds(self, *, snaps: bool = False) -> bool:
        """Return whether every limit is certain to hold; ``snaps`` allows them."""
        return self.motion.ok and all_hold(self.rows) == "yes" and (snaps or not self.motion.snaps)

    @property
    def strayed(self) -> bool:
        """Whether its shapes are others than those that the search saw in the same frames."""
        return strays(self.trial.motion, self.motion)


def strays(one: Motion, other: Motion) -> bool:
    """Return whether any cable has other shapes in the frames that both motions have."""
    _, ours, theirs = np.intersect1d(one.motion, other.motion, return_indices=True)
    for name, cable in other.cables.items():
        # stations stand closer where a shape turns, so those of two shapes need not be at the same shares of the length
        ends = [_places(one.cables[name], ours), _places(cable, theirs)]
        if float(np.max(np.linalg.norm(ends[0] - ends[1], axis=-1), initial=0.0)) > ELSEWHERE * cable.s[-1]:
            return True
    return False


def _places(cable: CableMotion, frames: Indices) -> Array:
    """Return the positions (P, STATIONS, 3) of ``frames`` (P,) at equal shares of the length."""
    curve = Curve(cable.s, cable.position[frames], rotations.tangent(cable.quaternion[frames]))
    return curve.grid(np.linspace(0.0, cable.s[-1], STATIONS))


def verify(evaluate: Evaluator, design: Evaluated, unrounded: Evaluated | None = None) -> Verified:
    """Simulate ``design`` anew; ``unrounded`` is what it was before its values were rounded, None where it is that."""
    frames = evaluate.frames
    problem = design_variables.rebased(evaluate.problem, design.values)
    fine = np.interp(np.linspace(0, 1, 2 * len(frames) - 1), np.linspace(0, 1, len(frames)), frames)
    motion = _fine_motion(problem, fine, design, evaluate.solver)
    problem, apart = motion.problem, split(motion)
    between = Between(BetweenFrames(apart), apart.snaps)
    clearances = measure(problem, evaluate.scene, motion.motion, motion.cables, between=between)
    rows = all_limits(problem, motion, clearances)
    return Verified(design, unrounded or design, motion, clearances, rows)


def _fine_motion(problem: Problem, fine: Array, design: Evaluated, solver: str) -> Motion:
    """Simulate ``problem`` anew, from a cold start, on the frames ``fine`` and twice the elements."""
    begin = time.perf_counter()

    def follow(apart: Problem, name: str, harness: FoundHarness | None) -> Sweep:
        elements = 2 * (len(design.sweeps[name].frames[0].bound.mesh) - 1)
        return sweep(apart, name, fine, solver=solver, elements=elements, harness=harness)

    swept = in_turn(problem, fine, follow, solver)
    return joined(problem, collect(swept, fine, time.perf_counter() - begin))


def ask_for_more(evaluate: Evaluator, found: Verified) -> None:
    """Ask in addition for what a verification found short, or too near to its limit to be certain."""
    for row in found.rows:
        short = row.margin - (row.tolerance if row.holds == "uncertain" else 0.0)
        if short < 0 and math.isfinite(short):
            radius = found.motion.problem.cables[row.cable].cable.radius
            # what is short by less than the search lets pass would otherwise stay so
            evaluate.asked[row.id] += EXTRA * -short / row.scale(radius) + GUARD


def rounded(problem: Problem, objective: Objective, best: Evaluated) -> Array:
    """Return the values (k,) of ``best``, rounded as the problem asks, inside the bounds.

    Of the neighbours up and down, and the drawn value where it is as near as they are, those are taken that hold the
    linearised limits best, and then have the lower objective. What others follow stays as it is, and so does all where
    nothing round holds what ``best`` does.

    Args:
        problem: with the design's variables.
        objective: what was sought.
        best: the design, with its derivatives.
    """
    choices = [_choices(problem, objective, best, number) for number in range(len(best.values))]
    for number in [number for number, values in enumerate(choices) if len(values) > 1][MOST_WAYS:]:
        choices[number] = sorted(choices[number], key=lambda value, n=number: abs(value - best.values[n]))[:1]  # type: ignore[misc]
    ways = (np.array(values) for values in itertools.product(*choices))
    way: Array = min(ways, key=lambda values: objective.merit(best, values))
    return way if objective.violation(best, way) <= max(HELD, objective.violation(best)) else best.values


def _choices(problem: Problem, objective: Objective, best: Evaluated, number: int) -> list[float]:
    """Return what the variable with this ``number`` may be rounded to."""
    design, value = problem.design, float(best.values[number])
    name, drawn = design.variables[number].name, float(objective.centre[number])
    unit = design.round_deg if name.endswith("_deg") else design.round_length
    if value == drawn or unit == 0.0 or any(coupling.leader == name for coupling in design.couplings):
        return [value]
    lower, upper = objective.lower[number], objective.upper[number]
    around = (float(f"{n * unit:.12g}") for n in (math.floor(value / unit), math.floor(value / unit) + 1))
    inside = [n for n in around if lower <= n <= upper]
    return [drawn, *inside] if abs(value - drawn) <= 0.5 * unit else inside or [value]
