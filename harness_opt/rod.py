"""The balance laws of the Kirchhoff rod: in CasADi for the transcriptions, as a power series for everything after.

Without dimensions: lengths by the cable's length L, forces by B/L^2, moments by B/L, B = sqrt(kx ky).
Centreline r, section frame R = [d1 d2 d3] with d3 the tangent, unit quaternion q = (q1, q2, q3, q4), Darboux
vector omega in the section frame, internal force F and moment M (s+ side on s- side), distributed load f. From (1), (2)
and (7) of Liu et al., in the world frame,

    r' = d3,   q' = q (0, omega) / 2,   F' + f = 0,   M' + d3 x F = 0,   R^T M = diag(kx, ky, kz) (omega - omega_rest),

so that F(s) = F0 - f s needs three unknowns in all. (9) is the second equation solved for omega.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from . import rotations
from .problem import Cable
from .rotations import Array


@dataclass(frozen=True)
class Units:
    """What turns dimensionless quantities into SI: multiply by these.

    Args:
        length: L, m.
        force: B / L^2, N.
        moment: B / L, N m.
    """

    length: float
    force: float
    moment: float


@dataclass(frozen=True)
class Section:
    """The dimensionless cable.

    Args:
        stiffness: (kx, ky, kz) / B, (3,).
        rest_curvature: times L, (3,).
    """

    stiffness: Array
    rest_curvature: Array


def scale(cable: Cable) -> tuple[Section, Units]:
    """Return the dimensionless section of ``cable`` and its units."""
    stiffness = cable.stiffness
    bending = float(np.sqrt(stiffness[0] * stiffness[1]))
    section = Section(stiffness / bending, np.asarray(cable.rest_curvature) * cable.length)
    return section, Units(cable.length, bending / cable.length**2, bending / cable.length)


def weight(cable: Cable, gravity: Array) -> Array:
    """Return the dimensionless load per length (3,) of ``cable`` in ``gravity`` (3,), m/s2: f L^3 / B."""
    _, units = scale(cable)
    return cable.mass_per_length * np.asarray(gravity, dtype=float) * cable.length / units.force


def wave_numbers(force: Array, moment: Array, stiffness: Array) -> Array:
    """Return how fast fields may vary along a rod under loads (..., n, 3), rad in its length, (..., n).

    sqrt(F / B) is that of the layer at a clamp, M / B that of the helix of a twisted rod.
    """
    bending = float(np.min(stiffness[:2]))
    return np.asarray(
        np.sqrt(np.linalg.norm(force, axis=-1) / bending) + np.linalg.norm(moment, axis=-1) / bending, dtype=float
    )


def frame(q: ca.SX) -> ca.SX:
    """Return R(q) (3, 3) as a CasADi expression of the quaternion ``q`` (4,)."""
    a, b, c, d = (q[i] for i in range(4))
    return ca.vertcat(
        ca.horzcat(a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)),
        ca.horzcat(2 * (b * c + a * d), a * a - b * b + c * c - d * d, 2 * (c * d - a * b)),
        ca.horzcat(2 * (b * d - a * c), 2 * (c * d + a * b), a * a - b * b - c * c + d * d),
    )


def quaternion_rate(q: ca.SX, omega: ca.SX) -> ca.SX:
    """Return q' = q (0, omega) / 2 (4,): eq. (9) solved for the derivative."""
    return 0.5 * ca.vertcat(-ca.dot(q[1:], omega), q[0] * omega + ca.cross(q[1:], omega))


def darboux(moment: ca.SX, section_frame: ca.SX, stiffness: ca.SX, rest_curvature: ca.SX) -> ca.SX:
    """Return omega (3,) in the section frame from the moment in the world frame: the constitutive law."""
    return ca.mtimes(section_frame.T, moment) / stiffness + rest_curvature


def _cauchy_cross(a: list[Array], b: list[Array]) -> Array:
    """Return the coefficient of order len(a) - 1 of the product series a x b."""
    return np.sum(rotations.cross(np.stack(a), np.stack(b[::-1])), axis=0)


@dataclass(frozen=True)
class Series:
    """Power series in arc length of a rod's state about given points; leading axes of any shape.

    Args:
        q, r, force, moment: coefficients (K + 1, ..., 4 or 3); force and moment in the section frame.
        omega: coefficients of the Darboux vector in the section frame.
    """

    q: Array
    r: Array
    force: Array
    moment: Array
    omega: Array


def series(q: Array, r: Array, force: Array, moment: Array, section: Section, load: Array, order: int) -> Series:
    """Expand the exact rod through the given states by recurrence on its equations.

    In the section frame the equations are quadratic: (6), (7) with q' = q (0, omega) / 2 and r' = d3, so every
    coefficient is a Cauchy product of lower ones (Hairer, Norsett, Wanner I, section I.8).

    Args:
        q, r, force, moment: states in the world frame, (..., 4) and (..., 3), dimensionless.
        section: of the cable.
        load: f in the world frame, (3,).
        order: K, highest power.
    """
    inverse = rotations.conjugate(q)
    weightless = not np.any(load)
    qs, rs = [np.asarray(q, dtype=float)], [np.asarray(r, dtype=float)]
    forces, moments = [rotations.rotate(inverse, force)], [rotations.rotate(inverse, moment)]
    omegas: list[Array] = []
    e3 = np.array([0.0, 0.0, 1.0])
    for k in range(order + 1):
        rest = section.rest_curvature if k == 0 else 0.0
        omegas.append(moments[k] / section.stiffness + rest)
        if k == order:
            break
        left, right = np.stack(qs), np.stack(qs[::-1])
        a, b, c, d = (left[..., i] for i in range(4))
        a2, b2, c2, d2 = (right[..., i] for i in range(4))
        d3 = np.stack(
            [
                2 * np.sum(b * d2 + a * c2, axis=0),
                2 * np.sum(c * d2 - a * b2, axis=0),
                np.sum(a * a2 - b * b2 - c * c2 + d * d2, axis=0),
            ],
            axis=-1,
        )
        omega = np.stack(omegas[::-1])
        scalar = -np.sum(left[..., 1:] * omega, axis=(0, -1))[..., None]
        vector = np.sum(left[..., :1] * omega + rotations.cross(left[..., 1:], omega), axis=0)
        force_rate = _cauchy_cross(forces, omegas)
        if not weightless:
            # R^T f from the same products of quaternion coefficients as d3, with the transposed matrix
            force_rate = force_rate - _section_load(left, right, load)
        qs.append(0.5 * np.concatenate([scalar, vector], axis=-1) / (k + 1))
        rs.append(d3 / (k + 1))
        forces.append(force_rate / (k + 1))
        moments.append((_cauchy_cross(moments, omegas) + rotations.cross(forces[k], e3)) / (k + 1))
    return Series(np.stack(qs), np.stack(rs), np.stack(forces), np.stack(moments), np.stack(omegas))


def _section_load(left: Array, right: Array, load: Array) -> Array:
    """Return the coefficient of R^T f whose quaternion coefficients are ``left`` and reversed ``right``."""
    scalar = np.sum(left[..., 0] * right[..., 0] - np.sum(left[..., 1:] * right[..., 1:], axis=-1), axis=0)
    along = np.sum(left[..., 1:] * np.sum(right[..., 1:] * load, axis=-1, keepdims=True), axis=0)
    across = rotations.cross(np.sum(left[..., :1] * right[..., 1:], axis=0), load)
    return scalar[..., None] * load + 2.0 * along - 2.0 * across


def evaluate(coefficients: Array, distance: Array) -> Array:
    """Sum a power series (K + 1, ..., c) at ``distance`` (...) by Horner's rule; returns (..., c)."""
    total = np.array(np.broadcast_to(coefficients[-1], (*np.shape(distance), coefficients.shape[-1])))
    for term in coefficients[-2::-1]:
        total *= distance[..., None]
        total += term
    return total
