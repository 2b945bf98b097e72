"""Shapes between the solved frames of a motion: each from its two neighbours.

The neighbours are read from the motion's plain arrays and blended; the corrector then has to stay near the blend,
as on any step along a path, and the shape has to be stable. Where it does not, there is no shape between the two
that belongs to both.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from harness_opt.model.cable import End
from harness_opt.model.problem import Problem
from harness_opt.model.results import CableMotion, Motion
from harness_opt.motion.frames import Frames, batch
from harness_opt.motion.sweep import TOLERANCE, accurate, start_positions
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.threads import one_thread
from harness_opt.numerics.vectors import Indices
from harness_opt.rod import equations as rod_module
from harness_opt.rod.boundary import Kind, case
from harness_opt.rod.stability import stability, surely_stable
from harness_opt.rod.states import Rod
from harness_opt.statics.continuation import NEAR, STEP_ITERATIONS, turning
from harness_opt.statics.mesh import ELEMENTS
from harness_opt.statics.solve import Solved, resample, solve_on

SOLVER = "gauss-newton"


class BetweenFrames:
    """Finds shapes of a motion's cables between its frames, as :data:`harness_opt.clearance.solved_frames.Solve` asks.

    Args:
        motion: simulated.
        tolerance: of the centreline, in lengths of the cable.
    """

    def __init__(self, motion: Motion, tolerance: float = TOLERANCE):
        self._motion, self._tolerance = motion, tolerance
        self._meshes: dict[str, Array] = {}

    @one_thread
    def __call__(self, cable: str, values: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return positions (k, N, 3), m, quaternions (k, N, 4) and whether they were found (k,).

        Args:
            cable: its name.
            values: motion values (k,), from the first frame's to the last one's.
        """
        problem, shapes, frames = self._motion.held(cable), self._motion.cables[cable], self._motion.motion
        before = np.clip(np.searchsorted(frames, values, side="right") - 1, 0, len(frames) - 2)
        position, quaternion = shapes.position[before], shapes.quaternion[before]
        if _rests(problem, cable):
            return position, quaternion, np.ones(len(values), dtype=bool)
        ends = problem.ends(cable, values)
        share = (values - frames[before]) / (frames[before + 1] - frames[before])
        solves = self._solves(cable, ends, before, share)
        found = np.array([solved is not None for solved in solves], dtype=bool)
        solved = [one for one in solves if one is not None]
        if solved:
            between, errors = accurate(Frames(solved), self._tolerance, SOLVER)
            rods = batch(between)
            self._meshes[cable] = rods.mesh
            units = rod_module.scale(problem.cables[cable].cable)[1]
            samples = rods.sample(shapes.s / units.length)
            kept = [end for end, ok in zip(ends, found, strict=True) if ok]
            origins = start_positions(kept, samples.r[:, -1], units)
            position[found] = origins[:, None] + units.length * samples.r
            quaternion[found] = samples.q
            found[found] = (errors <= self._tolerance) & _stable(rods, between[0].case.boundary.kind)
        return position, quaternion, found

    def _solves(
        self, cable: str, ends: Sequence[tuple[End, End]], before: Indices, share: Array
    ) -> list[Solved | None]:
        """Solve at the shares (k,) of the ways from frames (k,) to the next; None where that leads elsewhere."""
        problem, shapes = self._motion.problem, self._motion.cables[cable]
        run, gravity = problem.cables[cable], np.asarray(problem.gravity)
        used = np.union1d(before, before + 1)
        rods = _rods(problem, cable, shapes, used)
        mesh = self._meshes.get(cable, np.linspace(0.0, 1.0, ELEMENTS[0] + 1))
        unknowns = resample(rods, mesh)
        solves: list[Solved | None] = []
        for pair, k, part in zip(ends, np.searchsorted(used, before), share, strict=True):
            posed = case(run.cable, *pair, gravity).signed_like(rods.q[k, 0], rods.q[k, -1])
            guess = unknowns[k] + part * (unknowns[k + 1] - unknowns[k])
            solved = solve_on(posed, mesh, guess, SOLVER, STEP_ITERATIONS)
            near = solved.ok and not solved.turned
            near = near and turning(solved.bound.quaternions(guess), solved.rod.q) <= NEAR
            solves.append(solved if near else None)
        return solves


def _stable(rods: Rod, kind: Kind) -> NDArray[np.bool_]:
    """Return which shapes (k,) of ``rods`` have no unstable direction."""
    if surely_stable(rods, kind):
        return np.ones(len(rods.q), dtype=bool)
    return np.asarray(stability(rods, kind).index == 0)


def _rests(problem: Problem, cable: str) -> bool:
    """Whether neither end of ``cable`` moves."""
    run = problem.cables[cable]
    return all(problem.body(end.body).motion is None for end in (run.start, run.end))


def _rods(problem: Problem, cable: str, shapes: CableMotion, frames: Indices) -> Rod:
    """Return ``frames`` (k,) as rods whose nodes are the stations."""
    described = problem.cables[cable].cable
    section, units = rod_module.scale(described)
    return Rod(
        section,
        rod_module.weight(described, np.asarray(problem.gravity)),
        shapes.s / units.length,
        shapes.quaternion[frames],
        (shapes.position[frames] - shapes.position[frames, :1]) / units.length,
        shapes.force[frames] / units.force,
        shapes.moment[frames] / units.moment,
    )
