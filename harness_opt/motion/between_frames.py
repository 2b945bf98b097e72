"""Shapes between the solved frames of a motion: each from its two neighbours.

The neighbours are read from the motion's plain arrays and blended; the corrector then has to stay near the blend,
as on any step along a path, and the shape has to be stable. Where it does not, the frames are too far apart for that:
the one before is followed in as many steps as it takes, and on to the one after. Where it does not come there, there is
no shape between the two that belongs to both.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from harness_opt.model.ends import End
from harness_opt.model.problem import Problem
from harness_opt.model.results import CableMotion, Motion, Quantities
from harness_opt.motion.cases import CableCases
from harness_opt.motion.common_mesh import on_mesh
from harness_opt.motion.frames import Frames
from harness_opt.motion.sweep import MOTION_TOLERANCE, accurate, start_positions
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.threads import one_thread
from harness_opt.numerics.vectors import Indices
from harness_opt.rod import equations as rod_module
from harness_opt.rod.boundary import Kind
from harness_opt.rod.equations import Section
from harness_opt.rod.stability import stability, surely_stable
from harness_opt.rod.states import Rod
from harness_opt.statics.continuation import MOST_TURNING, STEP_ITERATIONS, turning
from harness_opt.statics.solve import Solved, batch, resample, solve_on

SOLVER = "gauss-newton"
# why a shape between two frames is none that can be used
ELSEWHERE = "the shape there is not near that of the frames around it"
INEXACT = "the shape there could not be found as exactly as those of the frames"
UNSTABLE = "the shape there is not stable"


class BetweenFrames:
    """Finds shapes of a motion's cables between its frames, as :data:`harness_opt.clearance.solved_frames.Solve` asks.

    Args:
        motion: simulated.
        tolerance: of the centreline, in lengths of the cable.
    """

    def __init__(self, motion: Motion, tolerance: float = MOTION_TOLERANCE):
        self._motion, self._tolerance = motion, tolerance
        self._meshes = {name: shapes.mesh for name, shapes in motion.cables.items()}

    @one_thread
    def __call__(self, cable: str, values: Array) -> tuple[Quantities, tuple[str, ...]]:
        """Return the shapes found at motion values (k,), and why none was, for each; empty where one was.

        Args:
            cable: its name.
            values: motion values (k,), from the first frame's to the last one's.
        """
        problem, shapes, frames = self._motion.held(cable), self._motion.cables[cable], self._motion.motion
        before = np.clip(np.searchsorted(frames, values, side="right") - 1, 0, len(frames) - 2)
        if _rests(problem, cable):
            return shapes.at_frames(before), ("",) * len(values)
        ends = problem.ends(cable, values)
        share = (values - frames[before]) / (frames[before + 1] - frames[before])
        why = [""] * len(values)
        solves = self._solves(cable, ends, before, share)
        tried = [k for k, solved in enumerate(solves) if solved is not None]
        for k in set(range(len(values))) - set(tried):
            why[k] = ELSEWHERE
        if not tried:
            return shapes.at_frames(before[:0]), tuple(why)
        between, errors = accurate(Frames(solved for solved in solves if solved is not None), self._tolerance, SOLVER)
        rods = batch(between)
        self._meshes[cable] = rods.mesh
        stable = _stable(rods, between[0].case.boundary.kind)
        for k, error, holds in zip(tried, errors, stable, strict=True):
            why[k] = "" if holds and error <= self._tolerance else INEXACT if holds else UNSTABLE
        units = rod_module.scale(problem.cables[cable].cable)[1]
        samples = rods.sample(shapes.s / units.length)
        lengths = problem.lengths(cable, values[tried])
        origins = start_positions([ends[k] for k in tried], samples.r[:, -1], lengths)
        whole = samples.in_si(shapes.s, units.at(lengths), origins)
        return whole.at_frames(np.flatnonzero([not why[k] for k in tried])), tuple(why)

    def _solves(
        self, cable: str, ends: Sequence[tuple[End, End]], before: Indices, share: Array
    ) -> list[Solved | None]:
        """Solve at the shares (k,) of the ways from frames (k,) to the next; None where that leads elsewhere."""
        problem, shapes, frames = self._motion.held(cable), self._motion.cables[cable], self._motion.motion
        cases = CableCases(problem, cable, SOLVER)
        lengths = problem.lengths(cable, frames[before] + share * (frames[before + 1] - frames[before]))
        used = np.union1d(before, before + 1)
        rods, mesh = _rods(problem, cable, shapes, used, frames[used]), self._meshes[cable]
        unknowns = resample(rods, mesh)
        solves: list[Solved | None] = []
        for pair, length, k, part in zip(ends, lengths, np.searchsorted(used, before), share, strict=True):
            posed = cases.posed(pair, None, float(length)).signed_like(rods.q[k, 0], rods.q[k, -1])
            guess = unknowns[k] + part * (unknowns[k + 1] - unknowns[k])
            solved = solve_on(posed, mesh, guess, SOLVER, STEP_ITERATIONS)
            near = solved.ok and not solved.turned
            near = near and turning(solved.bound.quaternions(guess), solved.rod.q) <= MOST_TURNING
            if near:
                solves.append(solved)
                continue
            first, last = frames[used[k]], frames[used[k + 1]]
            begin, end = (
                solve_on(cases.at(at, posed), mesh, unknowns[i], SOLVER) for at, i in ((first, k), (last, k + 1))
            )
            solves.append(_on_the_way(cases, (begin, first), (end, last), first + part * (last - first)))
        return solves


def _on_the_way(
    cases: CableCases, before: tuple[Solved, float], after: tuple[Solved, float], at: float
) -> Solved | None:
    """Return the shape at motion value ``at`` on the way from one frame to the next; None where one leads elsewhere.

    Args:
        cases: of the cable.
        before, after: the two frames, and their motion values.
        at: between these.
    """
    same = 1e-3  # rad, most that sections turn between a frame as it was solved and as it is come to from another
    (begin, first), (end, last) = before, after
    if not (begin.ok and end.ok):
        return None
    found, reached = cases.follow(begin, first, at)
    if reached != at:
        return None
    there, reached = cases.follow(found, at, last)
    mesh = end.bound.mesh
    if reached != last or turning(there.rod.sample(mesh).q, end.rod.q) > same:
        return None
    return found if np.array_equal(found.bound.mesh, mesh) else on_mesh(found, mesh, SOLVER)


def _stable(rods: Rod, kind: Kind) -> NDArray[np.bool_]:
    """Return which shapes (k,) of ``rods`` have no unstable direction."""
    if surely_stable(rods, kind):
        return np.ones(len(rods.q), dtype=bool)
    return np.asarray(stability(rods, kind).index == 0)


def _rests(problem: Problem, cable: str) -> bool:
    """Whether neither end of ``cable`` moves."""
    run = problem.cables[cable]
    return not any(problem.is_moved(end.body) or end.found is not None for end in (run.start, run.end))


def _rods(problem: Problem, cable: str, shapes: CableMotion, frames: Indices, at: Array) -> Rod:
    """Return ``frames`` (k,), at motion values ``at`` (k,), as rods whose nodes are the stations."""
    described = problem.cables[cable].cable
    section, units = rod_module.scale(described)
    load, lengths = rod_module.weight(described, np.asarray(problem.gravity)), problem.lengths(cable, at)
    if np.any(lengths != units.length):
        ratio = (lengths / units.length)[:, None, None]
        section, load = Section(section.stiffness, ratio * section.rest_curvature), ratio**3 * load
    by = units.at(lengths)
    return Rod(
        section,
        load,
        shapes.s / shapes.s[-1],
        shapes.quaternion[frames],
        (shapes.position[frames] - shapes.position[frames, :1]) / by.length,
        shapes.force[frames] / by.force,
        shapes.moment[frames] / by.moment,
    )
