"""One cable in one pose: its shape, and how what is measured of it changes with the cable.

From R(x, p) = 0 follows dx = -J^-1 dR/dp dp with the factorised Jacobian of the solve: dR is a difference of R at fixed
x between cables on both sides (as in :mod:`harness_opt.design.key_derivatives`), and whatever is read off a shape is
the difference of what is read off the two shapes moved so.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from harness_opt.errors import SolveError, Status
from harness_opt.measured.measurements import Measurement, Pose
from harness_opt.model.cable import Cable, CableRun
from harness_opt.model.results import Quantities
from harness_opt.motion.sweep import start_positions
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.rod.boundary import Case, case
from harness_opt.rod.equations import scale
from harness_opt.statics.cold_start import cold_start
from harness_opt.statics.continuation import MOST_TURNING, STEP_ITERATIONS, turning
from harness_opt.statics.mesh import refine
from harness_opt.statics.solve import Solved, solve_on

SOLVER = "gauss-newton"
DENSE = 401  # places along a cable among which the nearest to a point is looked for
NEAR = 0.1  # of the length by which a point may lie off its share of the way
TOLERANCE = 1e-7  # of a shape, in its length: a hundredth of what any photograph shows
STILL = ((0.0, 0.0, 0.0), rotations.IDENTITY)


@dataclasses.dataclass(frozen=True)
class Shaped:
    """A cable in a pose.

    Args:
        pose, cable: of that pose's length.
        solved: its shape.
    """

    pose: Pose
    cable: Cable
    solved: Solved

    def at(self, s: Array) -> Quantities:
        """Return the quantities at arc lengths ``s`` (n,), m."""
        units, rod = scale(self.cable)[1], self.solved.rod
        samples = rod.sample(s / units.length)
        ends = [(self.pose.start, self.pose.end)]
        return samples.in_si(s, units, start_positions(ends, rod.r[None, -1], np.array([units.length]))[0])


def _case(pose: Pose, cable: Cable, gravity: Array) -> Case:
    """Return the case of a cable in a pose; an end without a roll turns freely, so that it carries no twist."""
    run = CableRun(cable, pose.start, pose.end, pose.bow)
    held = run if run.untwisted is None else run.to_fit
    return case(cable, held.start.placed(*STILL), held.end.placed(*STILL), gravity)


def shaped(pose: Pose, cable: Cable, gravity: Sequence[float], near: Shaped | None = None) -> Shaped:
    """Return the shape of ``cable`` in a pose.

    Args:
        pose: how it is held.
        cable: its length is the pose's.
        gravity: m/s2, (3,).
        near: of a like cable in the same pose, to go on from.

    Raises:
        SolveError: no shape was found.
        ProblemError: a cable too short for its ends.
    """
    cable, weight = dataclasses.replace(cable, length=pose.length), np.asarray(gravity, dtype=float)
    posed, solved = _case(pose, cable, weight), None
    if near is not None:
        old = near.solved
        like = posed.signed_like(old.rod.q[0], old.rod.q[-1])
        solved = solve_on(like, old.bound.mesh, old.solution.x, SOLVER, STEP_ITERATIONS, old)
        if not solved.ok or solved.turned or turning(old.rod.q, solved.rod.q) > MOST_TURNING:
            solved = None
    if solved is None:
        bow = None if pose.bow is None else np.asarray(pose.bow)
        solved = cold_start(posed, int(pose.end.turns) if pose.end.roll is None else 0, bow, SOLVER)
    if solved is None:
        raise SolveError("no shape was found in a pose", Status.NO_START, None)
    solved, _, status = refine(solved, TOLERANCE, SOLVER)
    if not status.ok:
        raise SolveError(f"no shape was found in a pose: {status.value}", status, None)
    return Shaped(pose, cable, solved)


def rates(
    here: Shaped,
    gravity: Sequence[float],
    sides: Sequence[tuple[Cable, Cable, float]],
    read: Callable[[Shaped], Array],
) -> Array:
    """Return how what is read off a shape, (n,), changes with k quantities of the cable, (n, k).

    Args:
        here: the shape.
        gravity: m/s2, (3,).
        sides: the cable with a little more and a little less of each quantity, and half the difference.
        read: off a shape.
    """
    weight, x, columns = np.asarray(gravity, dtype=float), here.solved.solution.x, []
    old, transcription = here.solved.case.boundary, here.solved.bound.transcription
    for more, less, step in sides:
        moved = []
        for cable in (more, less):
            own = dataclasses.replace(cable, length=here.pose.length)
            posed = _case(here.pose, own, weight).signed_like(old.start_quaternion, old.end_quaternion)
            bound = transcription.bind(posed.section, posed.load, posed.boundary, here.solved.bound.mesh)
            moved.append((own, posed, bound))
        change = -here.solved.factor.solve(0.5 * (moved[0][2].residual(x) - moved[1][2].residual(x)))
        found = []
        for sign, (own, posed, bound) in zip((1, -1), moved, strict=True):
            solution = dataclasses.replace(here.solved.solution, x=x + sign * change)
            found.append(read(Shaped(here.pose, own, Solved(posed, bound, solution))))
        columns.append((found[0] - found[1]) / (2.0 * step))
    return np.stack(columns, axis=-1)


# --- what is read off a shape --------------------------------------------------------------------------------


def tip(shape: Shaped) -> Array:
    """Return how far the end hangs below the level of the world's origin, (1,), m."""
    return np.array([-shape.at(np.array([shape.pose.length])).position[0, 2]])


def force_at(shape: Shaped, side: str) -> Array:
    """Return the size of the force at an end, (1,), N."""
    place = np.array([0.0 if side == "start" else shape.pose.length])
    size: Array = np.linalg.norm(shape.at(place).force, axis=-1)
    return size


def missed_by(
    one: Measurement, shape: Shaped, sides: Sequence[tuple[Cable, Cable, float]], gravity: Sequence[float]
) -> tuple[Array, Array]:
    """Return by how much a shape misses a measurement, (n,), in its unit, and the rates of that (n, k)."""
    if one.kind != "loop":
        read = tip if one.kind == "sag" else lambda there: force_at(there, one.side)
        return one.value - read(shape), -rates(shape, gravity, sides, read)
    s = nearest(shape, one) if one.arc_lengths is None else np.minimum(one.arc_lengths, one.pose.length)
    found = shape.at(s)
    across = _across(found.quaternion, one)

    def seen(there: Shaped) -> Array:
        along: Array = np.einsum("nac,nc->na", across, there.at(s).position)
        return along.ravel()

    missed = np.einsum("nac,nc->na", across, one.points - found.position).ravel()
    return missed, -rates(shape, gravity, sides, seen)


def _across(quaternion: Array, one: Measurement) -> Array:
    """Return the directions (n, a, 3) along which points of a shape were measured, at its frames (n, 4)."""
    tangent = rotations.tangent(quaternion)
    if one.arc_lengths is not None:
        axes = np.eye(3)[[0, 2]] if one.planar else np.eye(3)
        return np.broadcast_to(axes, (len(tangent), *axes.shape))
    if one.planar:
        normal = np.cross(tangent, np.array([0.0, 1.0, 0.0]))
        return rotations.normalise(normal)[:, None]
    return rotations.matrix(quaternion).transpose(0, 2, 1)[:, :2]


def nearest(shape: Shaped, one: Measurement) -> Array:
    """Return the arc lengths (n,), m, at which a shape is nearest to points, each near its share of the way."""
    s = np.linspace(0.0, one.pose.length, DENSE)
    places = shape.at(s).position
    chords = np.linalg.norm(np.diff(one.points, axis=0), axis=1)
    # the first and the last point need not stand at the ends
    expected = np.interp(np.append(0.0, np.cumsum(chords)), [0.0, float(chords.sum())], _reach(places, s, one.points))
    apart = np.linalg.norm(one.points[:, None] - places[None], axis=-1)
    apart[np.abs(expected[:, None] - s[None]) > NEAR * one.pose.length] = np.inf
    found: Array = s[np.argmin(apart, axis=1)]
    for _ in range(3):  # Newton's method along the arc; quadratic from a four-hundredth of the length
        there = shape.at(found)
        along = rotations.tangent(there.quaternion)
        found = np.clip(found + np.einsum("nc,nc->n", one.points - there.position, along), 0.0, one.pose.length)
    return found


def _reach(places: Array, s: Array, points: Array) -> tuple[float, float]:
    """Return the arc lengths nearest to the first and the last point, in the first and the last half."""
    half = len(s) // 2
    first = s[int(np.argmin(np.linalg.norm(places[:half] - points[0], axis=1)))]
    last = s[half + int(np.argmin(np.linalg.norm(places[half:] - points[-1], axis=1)))]
    return float(first), float(last)


def mean_distance(shape: Shaped, one: Measurement) -> float:
    """Return the mean distance of the points of a measured loop from a shape, m."""
    there = shape.at(nearest(shape, one)).position
    return float(np.mean(np.linalg.norm(one.points - there, axis=1)))
