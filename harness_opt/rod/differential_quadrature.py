"""The paper's own transcription: Kirchhoff's balance in the section frame by differential quadrature.

Liu et al., eqs. (3)-(25): quaternion q and internal force F (section frame) at every one of N Chebyshev points are
the 7 N unknowns. At every point stand the norm (10), the force balance (11)-(13) and the moment balance (14)-(16);
to these come the clamps and the end position (24), with the position from the integral (17), and, where switched
on, the closure of the length (25): an overdetermined system, solved in least squares as in (26).

Corrected here: (11)-(13) as printed lack the factor 2 that (9) brings into the curvatures. Beyond the paper: force or
moment in place of position or orientation at either end, and a rest curvature.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import casadi as ca
import numpy as np
import scipy.sparse as sp

from harness_opt.numerics import rotations
from harness_opt.numerics.interface import Equations, LeastSquares
from harness_opt.numerics.quadrature import DifferentialQuadrature, differential_quadrature
from harness_opt.numerics.rotations import Array
from harness_opt.rod import equations as rod
from harness_opt.rod.boundary import Case, Kind
from harness_opt.rod.collocation_element import relative_to

FEWEST, MOST = 5, 200  # points


def curvatures(q: ca.SX, rate: ca.SX) -> ca.SX:
    """Return omega (3, N) from quaternions (4, N) and their derivatives (4, N): eq. (9), and (14)-(16) with second
    ones.
    """
    q1, q2, q3, q4 = (q[i, :] for i in range(4))
    d1, d2, d3, d4 = (rate[i, :] for i in range(4))
    return 2 * ca.vertcat(
        -q2 * d1 + q1 * d2 + q4 * d3 - q3 * d4,
        -q3 * d1 - q4 * d2 + q1 * d3 + q2 * d4,
        -q4 * d1 + q3 * d2 - q2 * d3 + q1 * d4,
    )


def _cross(a: ca.SX, b: ca.SX) -> ca.SX:
    """Return a x b (3, N) column by column."""
    return ca.vertcat(
        a[1, :] * b[2, :] - a[2, :] * b[1, :],
        a[2, :] * b[0, :] - a[0, :] * b[2, :],
        a[0, :] * b[1, :] - a[1, :] * b[0, :],
    )


def _to_section(q: ca.SX, v: ca.SX) -> ca.SX:
    """Return R(q)^T v (3, N) for a world vector v (3,) and quaternions (4, N)."""
    return ca.horzcat(*(ca.mtimes(rod.frame(q[:, i]).T, v) for i in range(q.size2())))


@functools.lru_cache(maxsize=32)
def _equations(points: int, kind: Kind, closure: bool) -> tuple[ca.Function, ca.Function]:
    """Return residual and (residual, Jacobian) as functions of the 7 N unknowns and the parameters."""
    rule = differential_quadrature(points)
    q, force = ca.SX.sym("q", 4, points), ca.SX.sym("F", 3, points)
    stiffness, rest, load, gap = (ca.SX.sym(name, 3) for name in ("k", "rest", "f", "gap"))
    start_q, end_q = ca.SX.sym("qo", 4), ca.SX.sym("ql", 4)
    loads = [ca.SX.sym(name, 3) for name in ("fo", "fl", "mo", "ml")]
    omega = curvatures(q, ca.mtimes(q, rule.first.T))  # (9) with (19)
    omega_rate = curvatures(q, ca.mtimes(q, rule.second.T))  # of (14)-(16): products of first derivatives cancel
    strain = omega - ca.repmat(rest, 1, points)
    k = ca.repmat(stiffness, 1, points)
    e3 = ca.SX(ca.repmat(ca.DM([0, 0, 1]), 1, points))
    norm = ca.sum1(q * q) - 1  # (10)
    forces = ca.mtimes(force, rule.first.T) + _cross(omega, force) + _to_section(q, load)  # (11)-(13)
    moments = (k * omega_rate + _cross(omega, k * strain) + _cross(e3, force)) / (2 * k)  # (14)-(16)
    tangents = ca.horzcat(*(rod.frame(q[:, i])[:, 2] for i in range(points)))
    position = ca.mtimes(tangents, rule.integral.T)  # (17)
    rows = [ca.vec(norm), ca.vec(forces), ca.vec(moments)]
    rows += _ends(kind, q, force, k * strain, position, (start_q, end_q, gap, load), loads)
    if closure:
        chords = position[:, 1:] - position[:, :-1]
        rows.append(1 - ca.sum2(ca.sqrt(ca.sum1(chords * chords))))  # (25)
    x, p = (
        ca.vertcat(ca.vec(q), ca.vec(force)),
        ca.vertcat(stiffness, rest, load, gap, start_q, end_q, *loads),
    )
    residual = ca.vertcat(*rows)
    return (
        ca.Function("residual", [x, p], [residual]),
        ca.Function("linearised", [x, p], [residual, ca.jacobian(residual, x)]),
    )


@functools.lru_cache(maxsize=32)
def _symbols(points: int, kind: Kind, closure: bool) -> Equations:
    """Return R(x, p) with the parameters of :func:`_equations`."""
    function = _equations(points, kind, closure)[0]
    x, p = function.sx_in()
    return Equations(x, p, function(x, p))


def _ends(
    kind: Kind, q: ca.SX, force: ca.SX, moment: ca.SX, position: ca.SX, given: tuple[ca.SX, ...], loads: list[ca.SX]
) -> list[ca.SX]:
    """Return the conditions at the ends: (24), or the mechanical groups in their place."""
    start_q, end_q, gap, _ = given
    start_force, end_force, start_moment, end_moment = loads
    first, last = rod.frame(q[:, 0]), rod.frame(q[:, -1])
    rows = [q[:, 0] - start_q if kind.start_orientation else ca.mtimes(first, moment[:, 0]) + start_moment]
    rows.append(q[:, -1] - end_q if kind.end_orientation else ca.mtimes(last, moment[:, -1]) - end_moment)
    swivels = ((kind.start_swivels, 0, start_q), (kind.end_swivels, -1, end_q))
    for place, (swivel, node, clamp) in enumerate(swivels):
        if swivel:
            rows[place] = ca.vertcat(ca.mtimes(relative_to(clamp), q[:, node])[:2], moment[2, node])
    if kind.start_position and kind.end_position:
        rows.append(position[:, -1] - gap)
    elif kind.start_position:
        rows.append(ca.mtimes(last, force[:, -1]) - end_force)
    else:
        rows.append(ca.mtimes(first, force[:, 0]) + start_force)
    return rows


@dataclass(frozen=True)
class Dqm:
    """The paper's equations for one case.

    Args:
        case: cable, load and ends; the sign of the end's quaternion chooses even or odd turns, as (24) compares all
            four
            components.
        points: N, 5 to 200.
        closure: whether the length closure (25) is among the equations.
    """

    case: Case
    points: int
    closure: bool

    @property
    def rule(self) -> DifferentialQuadrature:
        """Nodes and weights."""
        return differential_quadrature(self.points)

    @functools.cached_property
    def _parameters(self) -> Array:
        c, b = self.case, self.case.boundary
        loads = (b.start_force, b.end_force, b.start_moment, b.end_moment)
        return np.concatenate(
            [
                c.section.stiffness,
                c.section.rest_curvature,
                c.load,
                b.gap,
                b.start_quaternion,
                b.end_quaternion,
                *loads,
            ]
        )

    def residual(self, x: Array) -> Array:
        """Return the residuals, in the order norm, force, moment, ends, closure."""
        return np.asarray(
            _equations(self.points, self.case.boundary.kind, self.closure)[0](x, self._parameters)
        ).ravel()

    def linearise(self, x: Array) -> tuple[Array, sp.csc_array]:
        """Return the residuals and their Jacobian (more rows than columns)."""
        residual, jacobian = _equations(self.points, self.case.boundary.kind, self.closure)[1](x, self._parameters)
        return np.asarray(residual).ravel(), sp.csc_array(jacobian.sparse())

    def parametric(self) -> tuple[Equations, Array]:
        """Return the equations of this kind in symbols, and the values of their parameters."""
        return _symbols(self.points, self.case.boundary.kind, self.closure), self._parameters

    def symbolic(self) -> tuple[ca.SX, ca.SX]:
        """Return (x, residual) as CasADi expressions."""
        x = ca.SX.sym("x", 7 * self.points)
        return x, _equations(self.points, self.case.boundary.kind, self.closure)[0](x, self._parameters)

    def least_squares(self) -> LeastSquares:
        """Return the problem as a solver takes it."""
        return LeastSquares(self.residual, self.linearise, self.symbolic, self.parametric)

    def pack(self, q: Array, force: Array) -> Array:
        """Return x from quaternions (N, 4) and world forces (N, 3) at the nodes."""
        section = rotations.rotate(rotations.conjugate(q), force)
        return np.concatenate([q.ravel(), section.ravel()])

    def states(self, x: Array, s: Array) -> tuple[Array, Array, Array]:
        """Return quaternions (m, 4), world moments (m, 3) and world forces (m, 3) at ``s`` (m,) from 0 to 1.

        The polynomials of the method itself are evaluated; quaternions are normalised.
        """
        n, rule = self.points, self.rule
        q, force = x[: 4 * n].reshape(n, 4), x[4 * n :].reshape(n, 3)
        rate = rule.first @ q
        omega = 2.0 * rotations.multiply(rotations.conjugate(q), rate)[:, 1:]
        at = rule.interpolate(s)
        turned = rotations.normalise(at @ q)
        strain = at @ (omega - self.case.section.rest_curvature)
        return (
            turned,
            rotations.rotate(turned, self.case.section.stiffness * strain),
            rotations.rotate(turned, at @ force),
        )

    def centreline(self, x: Array, s: Array) -> Array:
        """Return the centreline (m, 3), relative to the start, by the integral (17) at ``s`` (m,)."""
        q = x[: 4 * self.points].reshape(self.points, 4)
        return self.rule.interpolate(s) @ (self.rule.integral @ rotations.tangent(q))
