"""A length-true curve with section frames between two ends: where the search for a first shape begins.

A cubic Hermite curve through the ends, bowed sideways until it has the cable's length, with rotation-minimising
frames (double
reflection: Wang, Juettler, Zheng and Liu, ACM Trans. Graph. 27, 2008) and the left-over twist, plus whole turns,
spread evenly along it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from . import rotations
from .boundary import Boundary
from .rotations import Array

FINE = 241  # points for measuring the length of the curve
LEAST_PULL = 0.1  # end slope of the cubic that still holds the tangents at the ends
DIRECT = 0.75  # end distance taken for a cable whose gap is not given, in lengths


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
    for candidate in (wish, t0 - t1, t0 + t1, np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])):
        across = candidate - axis * (axis @ candidate)
        if np.linalg.norm(across) > 1e-6 * max(1.0, float(np.linalg.norm(candidate))):
            return rotations.normalise(across)
    raise AssertionError("of two perpendicular directions one has a part across any axis")


def _bisect(too_long: Callable[[float], bool], low: float, high: float) -> float:
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if too_long(middle) else (middle, high)
    return 0.5 * (low + high)


def _pull(gap: Array, t0: Array, t1: Array) -> float:
    """Return the end slopes of the cubic: 1, or less where it would run backwards in its middle.

    A cubic that runs backwards and is bowed sideways closes to a loop, a whole turn away from the open arch.
    """
    forward = t0 + t1
    size = float(np.linalg.norm(forward))
    ahead = float(gap @ forward) / size if size > 1e-9 else 0.0
    if ahead <= 0.0:
        return 1.0
    # slope in the middle: 3/2 gap - pull (t0 + t1) / 4
    return min(1.0, max(LEAST_PULL, 6.0 * ahead / size))


def _unit_length_points(gap: Array, t0: Array, t1: Array, wish: Array) -> Array:
    """Return points (FINE, 3) of a curve of length 1 from 0 to ``gap`` that starts along t0 and ends along t1."""
    u = np.linspace(0.0, 1.0, FINE)

    def plain(pull: float) -> Array:
        return _hermite(gap, t0, t1, pull, u)

    most = _pull(gap, t0, t1)
    if _length(plain(most)) > 1.0:
        return plain(_bisect(lambda pull: _length(plain(pull)) > 1.0, 0.0, most))
    side = _sideways(gap, t0, t1, wish)
    bump = np.sin(np.pi * u[:, None]) ** 2 * side  # level at both ends, so that the tangents stay
    height = _bisect(lambda a: _length(plain(most) + a * bump) > 1.0, 0.0, 1.0)
    return plain(most) + height * bump


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
    frames = [np.asarray(first, dtype=float)]
    d1 = rotations.rotate(first, np.array([1.0, 0.0, 0.0]))
    for i in range(len(points) - 1):
        v = points[i + 1] - points[i]
        c = max(float(v @ v), 1e-30)
        d1_left = d1 - 2.0 / c * (v @ d1) * v
        t_left = tangents[i] - 2.0 / c * (v @ tangents[i]) * v
        w = tangents[i + 1] - t_left
        c = max(float(w @ w), 1e-30)
        d1 = d1_left - 2.0 / c * (w @ d1_left) * w
        d3 = tangents[i + 1]
        d1 = rotations.normalise(d1 - d3 * (d3 @ d1))
        q = rotations.from_matrix(np.column_stack([d1, np.cross(d3, d1), d3]))
        frames.append(q if q @ frames[-1] >= 0 else -q)
    return np.array(frames)


def _chord_and_tangents(boundary: Boundary, wish: Array) -> tuple[Array, Array, Array]:
    """Return the vector between the ends and the tangents there, with something sensible for what is not given."""
    kind, ahead = boundary.kind, np.array([0.0, 0.0, 1.0])
    t0 = rotations.rotate(boundary.start_quaternion, ahead) if kind.start_orientation else None
    t1 = rotations.rotate(boundary.end_quaternion, ahead) if kind.end_orientation else None
    if kind.start_position and kind.end_position:
        gap = boundary.gap
    elif t0 is not None and t1 is not None and t0 @ t1 < 1.0 - 1e-9:
        mean = t0 + t1
        gap = DIRECT * rotations.normalise(mean if np.linalg.norm(mean) > 1e-6 else _sideways(mean, t0, t1, wish))
    else:
        gap = next((t for t in (t0, t1) if t is not None), ahead)
    toward = rotations.normalise(gap) if np.linalg.norm(gap) > 1e-9 else ahead
    return gap, toward if t0 is None else t0, toward if t1 is None else t1


def _first_frame(boundary: Boundary, points: Array, tangents: Array) -> Array:
    """Return the section frame (4,) at the start: the clamp's, or the one that leads to the end's clamp untwisted."""
    if boundary.kind.start_orientation:
        return boundary.start_quaternion
    if boundary.kind.end_orientation:
        return rotation_minimising(points[::-1], tangents[::-1], boundary.end_quaternion)[-1]
    return rotations.from_tangent(tangents[0])


def starting_curve(boundary: Boundary, nodes: int, turns: int = 0, bow: Array | None = None) -> tuple[Array, Array]:
    """Return positions (nodes, 3), from the start, and quaternions (nodes, 4) of a curve of length 1.

    Args:
        boundary: the ends, dimensionless.
        nodes: equally spaced along the curve.
        turns: whole turns added to the smallest twist, at most half a turn, that joins the ends.
        bow: direction to which the curve is bowed where its length leaves the choice; None takes the curve's own plane.
    """
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
    if not boundary.kind.end_orientation or not boundary.kind.start_orientation:
        return points, frames
    left = rotations.multiply(rotations.conjugate(frames[-1]), boundary.end_quaternion)
    twist = (2.0 * np.arctan2(left[3], left[0]) + np.pi) % (2.0 * np.pi) - np.pi
    if twist < -np.pi + 1e-9:  # exactly half a turn either way: take the positive one
        twist += 2.0 * np.pi
    spread = np.zeros((nodes, 3))
    spread[:, 2] = (twist + 2.0 * np.pi * turns) * s
    return points, rotations.multiply(frames, rotations.from_rotation_vector(spread))
