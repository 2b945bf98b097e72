"""A length-true curve with section frames between two ends: where the search for a first shape begins.

A cubic Hermite curve through the ends, bowed sideways until it has the cable's length, with rotation-minimising frames
(double reflection: Wang, Juettler, Zheng and Liu, ACM Trans. Graph. 27, 2008) and the left-over twist, plus whole
turns, spread evenly along it.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.rod.boundary import HELD, Boundary, Case

LENGTH_POINTS = 241  # points for measuring the length of the curve
NO_LENGTH = 1e-15  # length below which a vector has no direction


def _hermite(gap: Array, t0: Array, t1: Array, pull: float, u: Array) -> Array:
    """Return the cubic from 0 to ``gap`` with end slopes ``pull`` t0 and ``pull`` t1 at ``u`` (m,) in 0..1; (m, 3)."""
    u = u[:, None]
    blend = u * u * (3.0 - 2.0 * u)
    return blend * gap + pull * (u * (1.0 - u) ** 2 * t0 - u * u * (1.0 - u) * t1)


def _length(points: Array) -> float:
    return float(np.sum(np.linalg.norm(np.diff(points, axis=0), axis=1)))


def _sideways(gap: Array, t0: Array, t1: Array, wish: Array) -> Array:
    """Return the unit direction across the chord that is nearest to ``wish``, or to the curve's own plane."""
    span = np.linalg.norm(gap)
    axis = gap / span if span > 1e-9 else rotations.normalise(t0)
    for candidate in (wish / max(1.0, float(np.max(np.abs(wish)))), t0 - t1, t0 + t1, *np.eye(3)[[2, 1]]):
        across = candidate - axis * (axis @ candidate)
        if np.linalg.norm(across) > 1e-6 * max(1.0, float(np.linalg.norm(candidate))):
            return rotations.normalise(across)
    raise AssertionError("of two perpendicular directions one has a part across any axis")


def _of_unit_length(base: Array, extra: Array, most: float) -> float:
    """Return a in 0..``most`` with which ``base`` + a ``extra``, points (m, 3) both, has the length 1.

    The length is convex in a, at most 1 without ``extra`` and more with ``most`` of it; so Newton's method comes down
    to it from there without a safeguard.
    """
    most_steps = 60  # of Newton's method: where slack is lost, each only halves what is left
    edges, changes = np.diff(base, axis=0), np.diff(extra, axis=0)
    a = most
    for _ in range(most_steps):
        there = edges + a * changes
        lengths = np.linalg.norm(there, axis=1)
        slope = float(np.sum(np.sum(there * changes, axis=1) / np.maximum(lengths, NO_LENGTH)))
        step = (float(np.sum(lengths)) - 1.0) / slope if slope > 0.0 else 0.0
        a -= step
        if step <= NO_LENGTH * most:
            break
    return max(a, 0.0)


def _pull(gap: Array, t0: Array, t1: Array) -> float:
    """Return the end slopes of the cubic: 1, or less where it would run backwards in its middle.

    A cubic that runs backwards and is bowed sideways closes to a loop, a whole turn away from the open arch.
    """
    least_pull = 0.1  # end slope of the cubic that still holds the tangents at the ends
    forward = t0 + t1
    size = float(np.linalg.norm(forward))
    ahead = float(gap @ forward) / size if size > 1e-9 else 0.0
    if ahead <= 0.0:
        return 1.0
    # slope in the middle: 3/2 gap - pull (t0 + t1) / 4
    return min(1.0, max(least_pull, 6.0 * ahead / size))


def _unit_length_points(gap: Array, t0: Array, t1: Array, wish: Array) -> Array:
    """Return points (m, 3) of a curve of length 1 from 0 to ``gap`` that starts along t0 and ends along t1."""
    u = np.linspace(0.0, 1.0, LENGTH_POINTS)

    most, straight = _pull(gap, t0, t1), _hermite(gap, t0, t1, 0.0, u)
    plain = _hermite(gap, t0, t1, most, u)
    if _length(plain) > 1.0:
        pulled = _hermite(gap, t0, t1, 1.0, u) - straight
        return straight + _of_unit_length(straight, pulled, most) * pulled
    side = _sideways(gap, t0, t1, wish)
    bump = np.sin(np.pi * u[:, None]) ** 2 * side  # level at both ends, so that the tangents stay
    return plain + _of_unit_length(plain, bump, 1.0) * bump


def _resample(points: Array, s: Array) -> Array:
    """Return points (m, 3) at fractions ``s`` (m,) of the length of the polygon ``points``."""
    run = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    return np.stack([np.interp(s * run[-1], run, points[:, i]) for i in range(3)], axis=1)


def rotation_minimising(points: Array, tangents: Array, first: Array) -> Array:
    """Return frames (m, 4) along a curve that turn about its tangent as little as possible, from ``first`` (4,).

    Args:
        points, tangents: (m, 3), tangents of unit length.
        first: the first frame; its d3 is the first tangent.
    """
    v = np.diff(points, axis=0)
    left = _reflected(tangents[:-1], v)
    # two reflections one after the other are one turn: w (v x v) w = (w v) x (w v)*
    turns = rotations.multiply(_pure(tangents[1:] - left), _pure(v))
    size = np.linalg.norm(turns, axis=1)
    lost = size < NO_LENGTH  # points that coincide, or a tangent that turns back
    if np.any(lost):
        turns[lost], size[lost] = rotations.shortest_arc(tangents[:-1][lost], tangents[1:][lost]), 1.0
    turns *= np.where(turns[:, :1] < 0.0, -1.0, 1.0) / size[:, None]  # of both quaternions the one nearer to no turn
    return rotations.multiply(_run(np.concatenate([[rotations.IDENTITY], turns])), np.asarray(first, dtype=float))


def _pure(v: Array) -> Array:
    """Return vectors (..., 3) as quaternions (..., 4)."""
    return np.concatenate([np.zeros((*v.shape[:-1], 1)), v], axis=-1)


def _reflected(t: Array, v: Array) -> Array:
    """Return vectors ``t`` (m, 3) reflected in planes across ``v`` (m, 3)."""
    square = np.maximum(np.sum(v * v, axis=1, keepdims=True), NO_LENGTH**2)
    reflected: Array = t - 2.0 / square * np.sum(v * t, axis=1, keepdims=True) * v
    return reflected


def _run(turns: Array) -> Array:
    """Return the products (m, 4) of all ``turns`` (m, 4) up to each, the first one first, in log2(m) rounds."""
    reach = 1
    while reach < len(turns):
        turns = np.concatenate([turns[:reach], rotations.multiply(turns[reach:], turns[:-reach])])
        reach *= 2
    return rotations.normalise(turns)


def _eased(frames: Array, width: float) -> Array:
    """Return ``frames`` (m, 4), evenly spaced, with their bends spread over ``width`` of the length, at least.

    A cubic may bend as sharply as it likes, and energy minimisation from a kink asks for many small elements. The ends
    stay: a frame there is the mean of those before it, which are taken as far to one side as those behind are to the
    other.
    """
    reach = round(0.5 * width * (len(frames) - 1))
    if reach == 0:
        return frames
    before = 2.0 * frames[0] - frames[reach:0:-1]
    behind = 2.0 * frames[-1] - frames[-2 : -reach - 2 : -1]
    run = np.cumsum(np.concatenate([np.zeros((1, 4)), before, frames, behind]), axis=0)
    return rotations.normalise(run[2 * reach + 1 :] - run[: -2 * reach - 1])


def _chord_and_tangents(boundary: Boundary, wish: Array) -> tuple[Array, Array, Array]:
    """Return the vector between the ends and the tangents there, with something sensible for what is not given."""
    assumed_distance = 0.75  # end distance taken for a cable whose gap is not given, in lengths
    kind, ahead = boundary.kind, np.array([0.0, 0.0, 1.0])
    t0 = rotations.rotate(boundary.start_quaternion, ahead) if kind.start_orientation else None
    t1 = rotations.rotate(boundary.end_quaternion, ahead) if kind.end_orientation else None
    if kind.start_position and kind.end_position:
        gap = boundary.gap
    elif t0 is not None and t1 is not None and t0 @ t1 < 1.0 - 1e-9:
        mean = t0 + t1
        gap = assumed_distance * rotations.normalise(
            mean if np.linalg.norm(mean) > 1e-6 else _sideways(mean, t0, t1, wish)
        )
    else:
        gap = next((t for t in (t0, t1) if t is not None), ahead)
    toward = rotations.normalise(gap) if np.linalg.norm(gap) > 1e-9 else ahead
    return gap, toward if t0 is None else t0, toward if t1 is None else t1


def _first_frame(boundary: Boundary, points: Array, tangents: Array) -> Array:
    """Return the section frame (4,) at the start: the clamp's, or the one that leads to the end's clamp untwisted."""
    if boundary.kind.start_held == HELD:
        return boundary.start_quaternion
    if boundary.kind.end_held == HELD:
        first: Array = rotation_minimising(points[::-1], tangents[::-1], boundary.end_quaternion)[-1]
        return first
    return boundary.start_quaternion if boundary.kind.start_held else rotations.from_tangent(tangents[0])


def starting_curve(boundary: Boundary, nodes: int, turns: int = 0, bow: Array | None = None) -> tuple[Array, Array]:
    """Return positions (nodes, 3), from the start, and quaternions (nodes, 4) of a curve of length 1.

    Args:
        boundary: the ends, dimensionless.
        nodes: equally spaced along the curve.
        turns: whole turns added to the smallest twist, at most half a turn, that joins the ends.
        bow: direction to which the curve is bowed where its length leaves the choice; None takes the curve's own plane.
    """
    eased_length, eased_slack = 0.1, 0.3  # of the length, of the slack: the lesser is what a bend is spread over
    wish = np.zeros(3) if bow is None else np.asarray(bow, dtype=float)
    gap, t0, t1 = _chord_and_tangents(boundary, wish)
    s = np.linspace(0.0, 1.0, nodes)
    if np.linalg.norm(gap - t0) + np.linalg.norm(gap - t1) < 1e-7:
        points, tangents = s[:, None] * gap, np.tile(t0, (nodes, 1))
    else:
        points = _resample(_unit_length_points(gap, t0, t1, wish), s)
        tangents = rotations.normalise(np.gradient(points, s, axis=0))
        tangents[0], tangents[-1] = t0, t1
    frames = rotation_minimising(points, tangents, _first_frame(boundary, points, tangents))
    width = min(eased_length, eased_slack * (1.0 - float(np.linalg.norm(points[-1] - points[0]))))
    frames = _eased(_eased(frames, width), width)
    if boundary.kind.end_held < HELD or boundary.kind.start_held < HELD:
        return points, frames
    left = rotations.multiply(rotations.conjugate(frames[-1]), boundary.end_quaternion)
    twist = (2.0 * np.arctan2(left[3], left[0]) + np.pi) % (2.0 * np.pi) - np.pi
    if twist < -np.pi + 1e-9:  # exactly half a turn either way: take the positive one
        twist += 2.0 * np.pi
    spread = np.zeros((nodes, 3))
    spread[:, 2] = (twist + 2.0 * np.pi * turns) * s
    return points, rotations.multiply(frames, rotations.from_rotation_vector(spread))


EASY_SLACK = 0.1  # slack, in L, with which a taut cable is begun


def loose(boundary: Boundary) -> Boundary:
    """Return ``boundary`` with a gap that leaves EASY_SLACK for a slack, where it leaves less."""
    kind, distance = boundary.kind, float(np.linalg.norm(boundary.gap))
    if not (kind.start_position and kind.end_position and 1.0 - distance < EASY_SLACK):
        return boundary
    return dataclasses.replace(boundary, gap=(1.0 - EASY_SLACK) / distance * boundary.gap)


def curve(case: Case, boundary: Boundary, turns: int, bow: Array | None) -> tuple[Case, Array, Array]:
    """Return ``case`` with ``boundary``, and the arc lengths (m,) and quaternions (m, 4) of the curve between these.

    ``turns`` and ``bow`` are as in :func:`starting_curve`.
    A swivel of a flat or bent section begins at the roll of its frame.
    """
    curve_points = 241  # places at which a starting curve is sampled
    kind, stiffness = boundary.kind, case.section.stiffness
    begin = boundary
    if stiffness[0] != stiffness[1] or np.any(case.section.rest_curvature):
        begin = dataclasses.replace(boundary, kind=kind._replace(start_swivels=False, end_swivels=False))
    _, q = starting_curve(begin, curve_points, turns, bow)
    return dataclasses.replace(case, boundary=signed(boundary, q)), np.linspace(0.0, 1.0, curve_points), q


def signed(boundary: Boundary, q: Array) -> Boundary:
    """Return ``boundary`` with that of the end's two quaternions that stands for the turns of the curve (m, 4)."""
    if boundary.kind.end_held < HELD:
        return boundary
    sign = 1.0 if q[-1] @ boundary.end_quaternion >= 0 else -1.0
    return dataclasses.replace(boundary, end_quaternion=sign * boundary.end_quaternion)
