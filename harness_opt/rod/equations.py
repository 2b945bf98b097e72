"""The balance laws of the Kirchhoff rod: in CasADi for the transcriptions, as a power series for everything after.

Without dimensions: lengths by the cable's length L, forces by B/L^2, moments by B/L, B = sqrt(kx ky).
Centreline r, section frame R = [d1 d2 d3] with d3 the tangent, unit quaternion q = (q1, q2, q3, q4), Darboux
vector omega in the section frame, internal force F and moment M (s+ side on s- side), distributed load f. From (1), (2)
and (7) of Liu et al., in the world frame,

    r' = d3,   q' = q (0, omega) / 2,   F' + f = 0,   M' + d3 x F = 0,   R^T M = diag(kx, ky, kz) (omega - omega_rest),

so that F(s) = F0 - f s needs three unknowns in all. (9) is the second equation solved for omega.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from harness_opt.model.cable import Cable
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array


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

    def at(self, lengths: Array) -> Factors:
        """Return the units of many shapes of the same cable, of ``lengths`` (P,), m."""
        ratio = (self.length / lengths)[:, None, None]
        return Factors(self.length / ratio, self.force * ratio**2, self.moment * ratio)


class Factors(NamedTuple):
    """Units of many shapes, each (P, 1, 1)."""

    length: Array
    force: Array
    moment: Array


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


def twisted_waves(q: Array, moment: Array, stiffness: Array) -> Array:
    """Return how fast fields turn in the section frame for the moments (..., n, 3) alone, rad in its length, (..., n).

    Those of Euler's top, to which m' = m x K^-1 m belongs, about each of its axes; M / B for a twisted rod that is
    stiff in torsion. Landau and Lifshitz, "Mechanics", section 37.

    Args:
        q: quaternions of the sections, (..., n, 4).
        moment: in the world frame.
        stiffness: (3,).
    """
    own, soft = rotations.rotate(rotations.conjugate(q), moment), 1.0 / stiffness
    rates = [math.sqrt(abs((soft[i - 1] - soft[i]) * (soft[i - 2] - soft[i]))) for i in range(3)]
    return np.asarray(np.abs(own) @ np.array(rates))


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


_Q, _FORCE, _MOMENT, _OMEGA = slice(0, 4), slice(4, 7), slice(7, 10), slice(10, 13)  # of a state in the section frame
_STATE = 13


@functools.cache
def _quadratic() -> tuple[NDArray[np.intp], NDArray[np.intp], Array, Array]:
    """Return the quadratic part of a rod's equations in the section frame.

    Which entries of two states are multiplied, (T,) each; what the products give the rates of q, r, force and moment,
    (T, 13); and what they give that of the force per load, (T, 3, 3).
    """
    x, y = np.broadcast_arrays(np.eye(_STATE)[:, None], np.eye(_STATE))
    q, p, spin = x[..., _Q], y[..., _Q], y[..., _OMEGA]
    turning = 0.5 * rotations.multiply(q, np.concatenate([np.zeros((_STATE, _STATE, 1)), spin], axis=-1))
    frame = 0.5 * (rotations.matrix(q + p) - rotations.matrix(q) - rotations.matrix(p))
    force, moment = (rotations.cross(x[..., part], spin) for part in (_FORCE, _MOMENT))
    rates = np.concatenate([turning, frame[..., 2], force, moment], axis=-1)
    loaded = -np.swapaxes(frame, -1, -2)
    for table in (rates, loaded):  # q_a q_b and q_b q_a are the same
        among = table[_Q, _Q]
        among += np.swapaxes(among, 0, 1).copy()
        among[np.tril_indices(4, -1)] = 0.0
        among[np.diag_indices(4)] *= 0.5
    left, right = np.nonzero(np.any(rates, axis=-1) | np.any(loaded, axis=(-1, -2)))
    return left, right, rates[left, right], loaded[left, right]


def series(q: Array, r: Array, force: Array, moment: Array, section: Section, load: Array, order: int) -> Series:
    """Expand the exact rod through the given states by recurrence on its equations.

    In the section frame the equations are quadratic: (6), (7) with q' = q (0, omega) / 2 and r' = d3, so every
    coefficient is a Cauchy product of lower ones (Hairer, Norsett, Wanner I, section I.8).

    Args:
        q, r, force, moment: states in the world frame, (..., 4) and (..., 3), dimensionless.
        section: of the cable.
        load: f in the world frame, (3,), or of many shapes (P, 1, 3).
        order: K, highest power.
    """
    left, right, weights, loaded = _quadratic()
    if np.any(load):
        weights = np.tile(weights, (*load.shape[:-2], 1, 1))
        weights[..., 7:10] += np.einsum("tij,...j->...ti", loaded, load.reshape(*load.shape[:-2], 3))
    q = np.asarray(q, dtype=float)
    inverse, lead = rotations.conjugate(q), q.shape[:-1]
    state, position = np.empty((order + 1, *lead, _STATE)), np.empty((order + 1, *lead, 3))
    state[0, ..., _Q], position[0] = q, r
    state[0, ..., _FORCE], state[0, ..., _MOMENT] = rotations.rotate(inverse, force), rotations.rotate(inverse, moment)
    first, second = (np.empty((order + 1, *lead, len(left))) for _ in range(2))
    for k in range(order + 1):
        here = state[k]
        np.divide(here[..., _MOMENT], section.stiffness, out=here[..., _OMEGA])
        if k == 0:
            here[..., _OMEGA] += section.rest_curvature
        if k == order:
            break
        first[k], second[k] = here[..., left], here[..., right]
        rates = np.einsum("k...t,k...t->...t", first[: k + 1], second[k::-1]) @ weights
        rates[..., 10] += here[..., 5]  # F x e3
        rates[..., 11] -= here[..., 4]
        rates /= k + 1
        position[k + 1] = rates[..., 4:7]
        state[k + 1, ..., _Q] = rates[..., :4]
        state[k + 1, ..., 4:10] = rates[..., 7:]
    return Series(state[..., _Q], position, state[..., _FORCE], state[..., _MOMENT], state[..., _OMEGA])


def evaluate(coefficients: Array, distance: Array) -> Array:
    """Sum a power series (K + 1, ..., c) at ``distance`` (...) by Horner's rule; returns (..., c)."""
    total = np.array(np.broadcast_to(coefficients[-1], (*np.shape(distance), coefficients.shape[-1])))
    for term in coefficients[-2::-1]:
        total *= distance[..., None]
        total += term
    return total
