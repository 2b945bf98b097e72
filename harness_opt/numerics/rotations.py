"""Unit quaternions, scalar first, as plain NumPy arrays of shape (..., 4).

A quaternion ``q = (q1, q2, q3, q4)`` takes section coordinates to the world: ``v_world = R(q) v``.
The third column of ``R(q)`` is the tangent ``d3``; integrating it gives the centreline, eq. (17) of
Liu et al. Formulas: Shuster, "A survey of attitude representations", J. Astronaut. Sci. 41 (1993).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

IDENTITY = (1.0, 0.0, 0.0, 0.0)

# What each part of a quaternion contributes to the matrix of products with it, (4, 16).
_LEFT = np.array(
    [
        [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
        [[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 0, -1], [0, 0, 1, 0]],
        [[0, 0, -1, 0], [0, 0, 0, 1], [1, 0, 0, 0], [0, -1, 0, 0]],
        [[0, 0, 0, -1], [0, 0, -1, 0], [0, 1, 0, 0], [1, 0, 0, 0]],
    ],
    dtype=float,
).reshape(4, 16)


def normalise(v: ArrayLike) -> Array:
    """Return ``v`` (..., n) divided by its Euclidean length along the last axis."""
    v = np.asarray(v, dtype=float)
    length: Array = np.linalg.norm(v, axis=-1, keepdims=True)
    return v / length


def unit(v: ArrayLike) -> Array:
    """Return ``v`` (..., n) normalised, or untouched where its length is 1 to rounding: twice gives the same bits."""
    v = np.asarray(v, dtype=float)
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    # 8 eps: the rounding of four squares, their root and the division, with room
    return np.where(np.abs(length - 1.0) <= 8 * np.finfo(float).eps, v, v / length)


def conjugate(q: ArrayLike) -> Array:
    """Return the inverse rotation of the unit quaternion ``q`` (..., 4)."""
    return np.asarray(q, dtype=float) * (1.0, -1.0, -1.0, -1.0)


def cross(a: Array, b: Array) -> Array:
    """Return a x b (..., 3) of arrays (..., 3): what ``numpy.cross`` gives, without its overhead on small arrays."""
    a0, a1, a2 = a[..., 0], a[..., 1], a[..., 2]
    b0, b1, b2 = b[..., 0], b[..., 1], b[..., 2]
    out = np.empty(np.broadcast(a, b).shape)
    out[..., 0], out[..., 1], out[..., 2] = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
    return out


def cross_matrix(v: ArrayLike) -> Array:
    """Return [v] (..., 3, 3) with [v] u = v x u."""
    v = np.asarray(v, dtype=float)
    out = np.zeros((*v.shape, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., i, j] = -v[..., k]
        out[..., j, i] = v[..., k]
    return out


def multiply(p: ArrayLike, q: ArrayLike) -> Array:
    """Return the Hamilton product ``p q`` (..., 4): first ``q`` turns, then ``p``."""
    p, q = np.asarray(p, dtype=float), np.asarray(q, dtype=float)
    left = (p @ _LEFT).reshape(
        *p.shape, 4
    )  # the matrix of a product with p: on small arrays, few calls are what counts
    product: Array = np.einsum("...ij,...j->...i", left, q)
    return product


def rotate(q: ArrayLike, v: ArrayLike) -> Array:
    """Return ``R(q) v`` (..., 3) for unit quaternions (..., 4) and vectors (..., 3)."""
    q, v = np.asarray(q, dtype=float), np.asarray(v, dtype=float)
    u = q[..., 1:]
    t = 2.0 * cross(u, v)
    return v + q[..., :1] * t + cross(u, t)


def matrix(q: ArrayLike) -> Array:
    """Return the rotation matrices (..., 3, 3) of unit quaternions (..., 4); columns d1, d2, d3."""
    q = np.asarray(q, dtype=float)
    a, b, c, d = (q[..., i] for i in range(4))
    rows = [
        [a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)],
        [2 * (b * c + a * d), a * a - b * b + c * c - d * d, 2 * (c * d - a * b)],
        [2 * (b * d - a * c), 2 * (c * d + a * b), a * a - b * b - c * c + d * d],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def tangent(q: ArrayLike) -> Array:
    """Return d3 (..., 3), the third column of ``R(q)``: the integrand of eq. (17)."""
    q = np.asarray(q, dtype=float)
    a, b, c, d = (q[..., i] for i in range(4))
    return np.stack([2 * (b * d + a * c), 2 * (c * d - a * b), a * a - b * b - c * c + d * d], axis=-1)


def from_rotation_vector(v: ArrayLike) -> Array:
    """Return the quaternion (..., 4) that turns by ``|v|`` radians about ``v`` (..., 3)."""
    v = np.asarray(v, dtype=float)
    half = 0.5 * np.linalg.norm(v, axis=-1, keepdims=True)
    return np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * v], axis=-1)


def rotation_vector(q: ArrayLike) -> Array:
    """Return ``v`` (..., 3), |v| up to 2 pi, with from_rotation_vector(v) = ``q`` (..., 4); that of -q is another."""
    q = np.asarray(q, dtype=float)
    sine = np.linalg.norm(q[..., 1:], axis=-1)
    half = np.arctan2(sine, q[..., 0])
    with np.errstate(invalid="ignore"):
        ratio: Array = np.where(sine > 1e-12, half / sine, 1.0)  # sin x / x is 1 to rounding there
    vector: Array = 2.0 * ratio[..., None] * q[..., 1:]
    return vector


def small_rotation_vector(q: ArrayLike) -> Array:
    """Return the rotation vectors (..., 3), of at most half a turn, of ``q`` (..., 4): those of -q are the same."""
    q = np.asarray(q, dtype=float)
    return rotation_vector(np.copysign(1.0, q[..., :1]) * q)


def slerp(a: ArrayLike, b: ArrayLike, weight: ArrayLike) -> Array:
    """Return the unit quaternions (..., 4) at ``weight`` of the way from ``a`` to ``b``, along the great circle.

    Shoemake, "Animating rotation with quaternion curves", SIGGRAPH 1985. At 0 and 1 it gives ``a`` and ``b`` to the
    last digit. The way from ``a`` to -``b`` is another, with a whole turn more or less.

    Args:
        a, b: (..., 4).
        weight: 0 to 1, a number or (..., 1).
    """
    a, b, weight = (np.asarray(x, dtype=float) for x in (a, b, weight))
    angle = 2.0 * np.arctan2(
        np.linalg.norm(a - b, axis=-1, keepdims=True), np.linalg.norm(a + b, axis=-1, keepdims=True)
    )
    near = angle < 1e-9  # rad: either is the other to the square root of rounding
    sine = np.where(near, 1.0, np.sin(angle))
    blended = np.sin((1.0 - weight) * angle) / sine * a + np.sin(weight * angle) / sine * b
    return np.where(near, np.where(weight > 0.5, b, a), blended)


def from_matrix(frame: ArrayLike) -> Array:
    """Return the unit quaternion (4,) of one rotation matrix (3, 3), with q1 >= 0.

    Shepperd's method: the largest of the four components is taken from the diagonal, so nothing cancels.
    """
    m = np.asarray(frame, dtype=float)
    diagonal = np.diag(m)
    squares = np.array([1 + diagonal.sum(), *(1 + 2 * diagonal - diagonal.sum())]) / 4
    k = int(np.argmax(squares))
    q = np.empty(4)
    q[k] = np.sqrt(squares[k])
    antisymmetric = np.array([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]])
    if k == 0:
        q[1:] = antisymmetric / (4 * q[0])
    else:
        i = k - 1
        q[0] = antisymmetric[i] / (4 * q[k])
        for j in {0, 1, 2} - {i}:
            q[j + 1] = (m[i, j] + m[j, i]) / (4 * q[k])
    return q if q[0] >= 0 else -q


def from_tangent(direction: ArrayLike, roll: float = 0.0) -> Array:
    """Return the section frame (4,) whose d3 lies along ``direction`` (3,), turned by ``roll`` radians about it.

    At zero roll d1 is the x axis projected on the section, or the y axis where ``direction`` lies along x.
    """
    d3 = normalise(direction)
    reference = np.array([1.0, 0.0, 0.0])
    if np.linalg.norm(np.cross(d3, reference)) < 1e-9:
        reference = np.array([0.0, 1.0, 0.0])
    d1 = normalise(reference - d3 * (d3 @ reference))
    frame = np.column_stack([d1, np.cross(d3, d1), d3])
    return multiply(from_matrix(frame), from_rotation_vector([0.0, 0.0, roll]))


def shortest_arc(a: ArrayLike, b: ArrayLike) -> Array:
    """Return the smallest rotation (..., 4) that takes the unit vectors ``a`` to ``b`` (..., 3).

    Raises nothing at ``b = -a``: any half turn about an axis across ``a`` is returned there.
    """
    a, b = np.broadcast_arrays(np.asarray(a, dtype=float), np.asarray(b, dtype=float))
    q = np.concatenate([1.0 + np.sum(a * b, axis=-1, keepdims=True), np.cross(a, b)], axis=-1)
    opposed = np.linalg.norm(q, axis=-1) < 1e-7
    if np.any(opposed):
        q = q.copy()
        across = np.cross(a[opposed], np.eye(3)[np.argmin(np.abs(a[opposed]), axis=-1)])
        q[opposed] = np.concatenate([np.zeros((len(across), 1)), normalise(across)], axis=-1)
    return normalise(q)
