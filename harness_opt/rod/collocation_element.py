"""Gauss collocation on one element of the rod: its equations and their derivatives, as CasADi functions.

The element's unknowns are the quaternion and the moment at its two nodes, the quaternions at its Gauss points (stages),
and the one constant of the force, all without dimensions. Equations of whole cables are put together from these in
:mod:`harness_opt.rod.collocation`. Hairer, Norsett, Wanner, "Solving Ordinary Differential Equations I", section II.7.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import TypeVar

import casadi as ca
import numpy as np

from harness_opt.numerics.machine_code import built
from harness_opt.numerics.quadrature import gauss
from harness_opt.rod import equations as rod
from harness_opt.rod.boundary import Kind

NODE = 7  # unknowns of a node: quaternion and moment
FORCE = 3  # the constant of the force
CLOSURE = 3  # equations of the gap (or force)
PARAMETERS = (3, 3, 3, 3, 4, 12, 3, 3, 3, 3)  # sizes; see split


def _element(stages: int, loaded: bool) -> ca.Function:
    """Return one element: its unknowns and parameters -> (4 stages + 7 defects, chord (3,)).

    The element's unknowns are [q, M, stages' q, next q, next M, F0]; parameters are the element's length and start,
    the stiffness, the rest curvature and, where ``loaded``, the load per length.
    """
    tableau = gauss(stages)
    z = ca.SX.sym("z", 2 * NODE + 4 * stages + FORCE)
    h, s = ca.SX.sym("h"), ca.SX.sym("s")
    stiffness, rest, load = (ca.SX.sym(name, 3) for name in ("stiffness", "rest", "load"))
    q, moment, stacked, q_next, moment_next, force0 = ca.vertsplit(
        z, np.cumsum([0, 4, 3, 4 * stages, 4, 3, FORCE]).tolist()
    )
    stage_q = ca.reshape(stacked, 4, stages)
    frames = [rod.frame(stage_q[:, j]) / ca.sumsqr(stage_q[:, j]) for j in range(stages)]
    tangents = ca.horzcat(*(frame[:, 2] for frame in frames))
    forces = [force0 - (load * (s + float(c) * h) if loaded else 0) for c in tableau.nodes]
    moment_rates = ca.horzcat(*(-ca.cross(tangents[:, j], forces[j]) for j in range(stages)))
    moments = [moment + h * ca.mtimes(moment_rates, a) for a in tableau.matrix]
    omegas = [rod.darboux(moments[j], frames[j], stiffness, rest) for j in range(stages)]
    rates = ca.horzcat(*(rod.quaternion_rate(stage_q[:, j], omegas[j]) for j in range(stages)))
    defects = [stage_q[:, j] - q - h * ca.mtimes(rates, tableau.matrix[j]) for j in range(stages)]
    defects.append(q_next - q - h * ca.mtimes(rates, tableau.weights))
    defects.append(moment_next - moment - h * ca.mtimes(moment_rates, tableau.weights))
    chord = h * ca.mtimes(tangents, tableau.weights)
    return ca.Function("element", [z, h, s, stiffness, rest, load], [ca.vertcat(*defects, chord)], {"cse": True})


@dataclass(frozen=True)
class Element:
    """Functions of one element: its equations, and their derivatives by its unknowns."""

    equations: ca.Function
    jacobian: ca.Function


@functools.lru_cache(maxsize=8)
def functions(stages: int, loaded: bool, machine: bool) -> Element:
    """Return the functions of an element of any mesh, as machine code where ``machine``."""
    element = _element(stages, loaded)
    z, *parameters = element.sx_in()
    # of an element whose common expressions are taken out already, hardly any are left in the Jacobian
    jacobian = ca.Function("jacobian", [z, *parameters], [ca.jacobian(element(z, *parameters), z)])
    return Element(built(element), built(jacobian)) if machine else Element(element, jacobian)


@functools.lru_cache(maxsize=8)
def rates(stages: int, loaded: bool, machine: bool) -> ca.Function:
    """Return an element's derivatives by rest curvature and load, which few ask for; as :func:`functions`."""
    element = _element(stages, loaded)
    z, *parameters = element.sx_in()
    by_parameters = ca.jacobian(element(z, *parameters), ca.vertcat(*parameters[3:]))
    rates = ca.Function("rates", [z, *parameters], [by_parameters], {"cse": True})
    return built(rates) if machine else rates


Symbols = TypeVar("Symbols", ca.SX, ca.MX)


def split(p: Symbols, elements: int) -> list[Symbols]:
    """Return the parameters of all equations, one vector each.

    Steps, element starts, stiffness, rest curvature, load, gap, start quaternion, the matrix of
    :func:`~harness_opt.rod.boundary.relative_matrix` by columns, and the loads on start and end: forces, then
    moments.
    """
    return ca.vertsplit(p, np.cumsum([0, elements, elements, *PARAMETERS]).tolist())


def relative_to(q: Symbols) -> Symbols:
    """Return the matrix (3, 4) that takes p to the vector part of conj(q) p."""
    a, b, c, d = (q[i] for i in range(4))
    return ca.vertcat(ca.horzcat(-b, a, d, -c), ca.horzcat(-c, -d, a, b), ca.horzcat(-d, c, -b, a))


def tangent(q: Symbols) -> Symbols:
    """Return d3 (3,) of a quaternion (4,)."""
    a, b, c, d = (q[i] for i in range(4))
    return ca.vertcat(2 * (b * d + a * c), 2 * (c * d - a * b), a * a - b * b - c * c + d * d)


def assembled(x: Symbols, p: Symbols, table: Symbols, kind: Kind) -> Symbols:
    """Return R(x, p) from the elements' defects and chords (4 stages + 10, elements), side by side."""
    count, elements = table.shape[0] - CLOSURE, table.shape[1]
    load, gap, start_q, relative, start_force, end_force, start_moment, end_moment = split(p, elements)[4:]
    node = x.shape[0] - FORCE - NODE
    start = x[:4] - start_q
    if not kind.start_orientation:
        start = ca.vertcat(ca.sumsqr(x[:4]) - 1, x[4:7] + start_moment)
    elif kind.start_swivels:
        tilt = ca.mtimes(relative_to(start_q), x[:4])[:2]
        start = ca.vertcat(ca.sumsqr(x[:4]) - 1, tilt, ca.mtimes(tangent(start_q).T, x[4:7]))
    closure = ca.sum2(table[count:, :]) - gap
    if not kind.end_position:
        closure = x[-3:] - load - end_force
    elif not kind.start_position:
        closure = x[-3:] + start_force
    end = x[node + 4 : node + 7] - end_moment
    if kind.end_orientation:
        end = ca.mtimes(ca.reshape(relative, 3, 4), x[node : node + 4])
    if kind.end_swivels:
        end_q = ca.vertcat(relative[3], -relative[:3])  # its first column is that of conj(q_end)
        end = ca.vertcat(end[:2], ca.mtimes(tangent(end_q).T, x[node + 4 : node + 7]))
    return ca.vertcat(start, ca.vec(table[:count, :]), closure, end)
