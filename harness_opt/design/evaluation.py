"""Evaluated designs of a redesign: each simulated over the motion, measured, and linearised."""

from __future__ import annotations

import dataclasses
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from harness_opt.clearance.measure import measure
from harness_opt.clearance.pairs import ClearanceResult
from harness_opt.design.margins import Rows, linearised
from harness_opt.errors import ProblemError, Status
from harness_opt.model import design_variables
from harness_opt.model.limits import LimitId
from harness_opt.model.problem import Problem
from harness_opt.model.results import Motion
from harness_opt.motion.follower import Progress
from harness_opt.motion.path import place_frames
from harness_opt.motion.shape_rates import ShapeRates, shape_rates
from harness_opt.motion.simulate import collect
from harness_opt.motion.sweep import Sweep, followed, sweep
from harness_opt.numerics.rotations import Array
from harness_opt.parts.scene import Scene
from harness_opt.statics.solve import Solved

GUARD = 0.002  # asked for beyond each limit, in its own scale, so that a finer simulation still holds it
HELD = 0.5 * GUARD  # a violation of what is asked for that leaves the limit itself held
SNAP_COST = 1.0  # of a snap, in scales of a limit: snaps are not for designing with


@dataclass(frozen=True)
class Evaluated:
    """One simulated design.

    Args:
        values: of the design variables, (k,).
        indices: which of the motion's frames were solved.
        sweeps: by cable.
        motion, clearances: of these frames.
        rates: of the shapes, by cable; empty where only a quick look was asked for.
        rows: the limits, scaled and linearised.
    """

    values: Array
    indices: Sequence[int]
    sweeps: Mapping[str, Sweep]
    motion: Motion
    clearances: ClearanceResult
    rates: Mapping[str, ShapeRates]
    rows: Rows

    def predicted(self, name: str, values: Array) -> dict[int, Solved]:
        """Return the frames of cable ``name``, by index, moved to first order to the design ``values`` (k,)."""
        own = self.sweeps[name]
        shapes = dict(zip(self.indices, own.frames, strict=True))
        if name in self.rates:
            moved = self.rates[name].unknowns @ (values - self.values)
            shapes = {
                index: dataclasses.replace(f, solution=dataclasses.replace(f.solution, x=f.solution.x + dx))
                for (index, f), dx in zip(shapes.items(), moved, strict=True)
            }
        # a design that goes on from a cable that went through itself has done so too
        through = [0] * own.begins_through_itself + [frame for frame, _, passes in own.snaps if passes]
        for index in {self.indices[frame] for frame in through}:
            shapes[index] = dataclasses.replace(shapes[index], passed=True)
        return shapes

    @property
    def worst(self) -> int:
        """The row with the smallest margin."""
        return int(np.argmin(self.rows.margin))


class Evaluator:
    """Simulates designs of one problem.

    Args:
        problem: the design variables are taken from it.
        scene: its parts.
        solver: name.
        progress: called for every frame.
    """

    def __init__(self, problem: Problem, scene: Scene, solver: str, progress: Progress | None):
        self.problem, self.scene, self.solver, self.progress = problem, scene, solver, progress
        self.frames = place_frames(problem)
        # asked for beyond each limit, in its scale; verifications add to it
        self.asked: defaultdict[LimitId, float] = defaultdict(lambda: GUARD)
        self.count = 0  # designs simulated
        self.cold = False  # whether every design starts from nothing, as its file will: where one shape leads elsewhere

    def __call__(
        self, values: Array, near: Evaluated | None, *, stride: int = 1, quick: bool = False
    ) -> Evaluated | None:
        """Simulate the design ``values`` (k,); None where it cannot be simulated.

        Args:
            values: of the variables.
            near: a design whose shapes to start from.
            stride: only every so many of the motion's frames are solved, and the last.
            quick: leave the derivatives and the stability of shapes out.

        Raises:
            KeyboardInterrupt: raised by ``progress``.
        """
        self.count += 1
        indices = sorted({*range(0, len(self.frames), stride), len(self.frames) - 1})
        motion_values = self.frames[indices]
        try:
            changed = design_variables.apply(self.problem, values)
            sweeps = {}
            for name in changed.cables:
                close = near.predicted(name, values) if near and not self.cold else {}
                guesses = [close.get(index) for index in indices]
                fitted = near.sweeps[name].fitted if close and near else None
                sweeps[name] = sweep(
                    changed, name, motion_values, solver=self.solver, guesses=guesses, near=fitted,
                    rigour="quick look" if quick else "stable", progress=self.progress,
                )  # fmt: skip
        except ProblemError:  # shorter than the distance of its ends somewhere on the motion
            return None
        if any(swept.status is Status.INTERRUPTED for swept in sweeps.values()):
            raise KeyboardInterrupt
        if not all(swept.status.ok for swept in sweeps.values()):
            return None
        motion = collect(changed, motion_values, {name: followed(swept) for name, swept in sweeps.items()}, 0.0)
        clearances = measure(changed, self.scene, motion_values, motion.cables)
        rates = {}
        if not quick:
            for name, swept in sweeps.items():
                clamps = design_variables.clamp_rates(self.problem, name, values, motion_values)
                rates[name] = shape_rates(swept, clamps, motion.cables[name].s / swept.units.length, exact=False)
        rows = linearised(changed, motion, clearances, rates, self.asked, len(values))
        return Evaluated(values, indices, sweeps, motion, clearances, rates, rows)
