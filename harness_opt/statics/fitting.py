"""Roll that a fitter would leave: an end clamped as it comes, without twist, and what it is turned by afterwards."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from harness_opt.model.cable import CableRun
from harness_opt.model.ends import End
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.rod.boundary import Case, case
from harness_opt.rod.states import Rod
from harness_opt.statics.cold_start import Wound, cold_start
from harness_opt.statics.mesh import refine
from harness_opt.statics.release import is_stable
from harness_opt.statics.solve import Solved, resample, solve_on

FITTED = 1e-9  # estimated error, in L, of the shape that a roll is taken from


@dataclass(frozen=True)
class Fitted:
    """A cable as it was fitted: one end free to turn about its tangent, so that it carries no twisting moment there.

    Args:
        run: as described.
        solved: its shape; where an end turned freely, the frame there is what it is clamped in.
        light: the mesh that it was found on; the roll takes a finer one, which a motion does not need.
        length: of the cable there, m, where it slides through a clip; None is as described.
    """

    run: CableRun
    solved: Solved
    light: Array
    length: float | None = None

    @property
    def frames(self) -> tuple[Array, Array]:
        """The section frames (4,) in the world that the ends are held in while it is fitted, with their turns."""
        q, run = rotations.normalise(self.solved.rod.q[[0, -1]]), self.run
        return turned(q[0], own_turns(run.start)), turned(q[1], own_turns(run.end))

    def wound(self) -> Wound:
        """Return the shape with what its ends are turned by afterwards spread along it."""
        places = 8  # an element, at which the shape is sampled
        mesh = self.solved.rod.mesh
        s = np.interp(np.arange(places * (len(mesh) - 1) + 1) / places, np.arange(len(mesh)), mesh)
        samples, run = self.solved.rod.sample(s), self.run
        return Wound(s, turned(samples.q, own_turns(run.start) + run.turned_in * s), samples.r)


def own_turns(end: End) -> float:
    """Return by how many turns an end is turned after it was fitted: those of an untwisted one."""
    return float(end.turns) if end.roll == "untwisted" else 0.0


def turned(q: Array, turns: Array | float) -> Array:
    """Return frames ``q`` (..., 4) turned about their tangents by ``turns`` (...)."""
    angle = 2.0 * math.pi * np.asarray(turns, dtype=float)
    about = np.stack([0.0 * angle, 0.0 * angle, angle], axis=-1)
    return rotations.multiply(q, rotations.from_rotation_vector(about))


def fit(
    run: CableRun, placed: tuple[End, End], gravity: Array, solver: str, near: Solved | Rod | None = None
) -> Fitted | None:
    """Return ``run`` as it is fitted; None where no shape is found.

    Args:
        run: with an untwisted end.
        placed: the ends of :attr:`CableRun.to_fit` where it is fitted, in world coordinates.
        gravity: m/s2, (3,).
        solver: name.
        near: a fit or a shape of a like cable to start from; None leaves it to a cold start.
    """
    posed = case(run.cable, *placed, gravity)
    solved = None
    if isinstance(near, Solved) and near.case.boundary.kind == posed.boundary.kind:
        solved = solve_on(posed, near.bound.mesh, near.solution.x, solver, near=near)
        if solved.ok:
            return Fitted(run, solved, solved.bound.mesh)
    if isinstance(near, Rod):
        solved = solve_on(posed, near.mesh, resample(near, near.mesh), solver)
    if solved is None or not solved.ok:
        solved = cold_start(posed, 0, None if run.bow is None else np.asarray(run.bow), solver)
    if solved is None or not solved.ok:
        return None
    return Fitted(run, refine(solved, FITTED, solver)[0], solved.bound.mesh)


def held(fitted: Fitted) -> tuple[End, End]:
    """Return the ends of a single pose, in world coordinates, as they are held once it is fitted."""
    run, frames = fitted.run, fitted.frames
    start, end = (
        side.held(frame) if side.roll == "untwisted" else side
        for side, frame in zip((run.start, run.end), frames, strict=True)
    )
    return start, end


def clamped(posed: Case, fitted: Fitted, solver: str) -> Solved | None:
    """Return the shape of a fitted cable once its ends are held, and turned by their turns; None where none is found.

    Args:
        posed: the ends as they are held, at the place where the cable was fitted.
        fitted: as it was fitted.
        solver: name.
    """
    rod = fitted.solved.rod
    if not fitted.run.turned_in:
        rod = dataclasses.replace(rod, q=turned(rod.q, own_turns(fitted.run.start)))
        like = posed.signed_like(rod.q[0], rod.q[-1])
        solved = solve_on(like, fitted.light, resample(rod, fitted.light), solver)
        if solved.ok and is_stable(solved, solver):
            return solved
    bow = None if fitted.run.bow is None else np.asarray(fitted.run.bow)
    return cold_start(posed, 0, bow, solver, fitted.wound())


@dataclass(frozen=True)
class PosedRun:
    """A cable in a single pose, an untwisted end fitted right there.

    Args:
        run: as described, its ends in world coordinates.
        ends: as they are held.
        case: the same without dimensions.
        fitted: as it was fitted; None where there was nothing to fit, or no shape was found.
    """

    run: CableRun
    ends: tuple[End, End]
    case: Case
    fitted: Fitted | None

    def cold_start(self, solver: str) -> Solved | None:
        """Return a first shape found from the ends alone; None where there is none."""
        if self.fitted is not None:
            return clamped(self.case, self.fitted, solver)
        if self.run.untwisted is not None:
            return None
        bow = None if self.run.bow is None else np.asarray(self.run.bow)
        return cold_start(self.case, int(self.run.end.turns), bow, solver)


def posed_run(run: CableRun, gravity: Array, solver: str, near: Rod | None = None) -> PosedRun:
    """Return ``run``, whose ends are in world coordinates, as it is held in ``gravity`` (3,), m/s2.

    Raises:
        ProblemError: ends that no shape can join.
    """
    still = (0.0, 0.0, 0.0), rotations.IDENTITY
    ends, fitted = (run.to_fit.start.placed(*still), run.to_fit.end.placed(*still)), None
    if run.untwisted is not None:
        fitted = fit(run, ends, gravity, solver, near)
        if fitted is not None:
            start, end = held(fitted)
            ends = start.placed(*still), end.placed(*still)
    posed = case(run.cable, *ends, gravity)
    if near is not None:
        posed = posed.signed_like(near.q[0], near.q[-1])
    return PosedRun(run, ends, posed, fitted)
