"""The rod as a coarse chain whose energy is least: finds a stable shape from far away, to a few per cent.

Nodes carry a quaternion and a position, segments a Darboux vector. The implicit midpoint rule joins them,

    q+ - q = h qm (0, omega) / 2,  qm = (q + q+) / 2,  r+ - r = h d3(qm) / |qm|^2,

and keeps |q| = 1 and the length exactly. Energy: sum h/2 (omega - rest) . K (omega - rest) less the work of dead loads.
A minimum is a stable equilibrium; a saddle is not, which is what makes it the right start for an accurate solve.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from .. import rod
from ..boundary import Boundary
from ..rod import Section
from ..rotations import Array
from ..solvers.interface import QUIET

SEGMENTS = 24
ITERATIONS = 300
TOLERANCE = 1e-7  # of IPOPT; the collocation solve makes it accurate
FIRST_DRAG = 10.0  # of the viscous medium in the first step, in the largest stiffness
LONG_STEP = 0.6  # rad, a step that turns a section further is taken again with more drag
AT_REST = 1e-3  # rad, in a step of hardly any drag
SINKING_ITERATIONS = 40  # of IPOPT in a short step; one that needs more is too long
MOST_SINKING, STUCK = 80, 1e9  # steps, and the drag at which not even a tiny one can be solved


@dataclass(frozen=True)
class ChainState:
    """A chain's shape: ``q`` (n + 1, 4), ``r`` (n + 1, 3), ``omega`` of the segments (n, 3), ``force`` at the start
    (3,).
    """

    q: Array
    r: Array
    omega: Array
    force: Array


@functools.lru_cache(maxsize=8)
def _program(segments: int, iterations: int) -> tuple[ca.Function, int]:
    """Return the nonlinear program of a chain of ``segments``, and its number of unknowns."""
    q, r, omega = (
        ca.SX.sym(name, rows, segments + extra) for name, rows, extra in (("q", 4, 1), ("r", 3, 1), ("w", 3, 0))
    )
    stiffness, rest, load, start_force, end_force = (ca.SX.sym(f"p{i}", 3) for i in range(5))
    end_quaternion, drag, held = ca.SX.sym("end_quaternion", 4), ca.SX.sym("drag"), ca.SX.sym("held", 4, segments + 1)
    h = 1.0 / segments
    energy = -ca.dot(end_force, r[:, -1]) - ca.dot(start_force, r[:, 0])
    energy += 2.0 * h * drag * ca.sumsqr(q - held)  # |2 (q - held)| is the angle turned through
    defects = []
    for i in range(segments):
        middle = 0.5 * (q[:, i] + q[:, i + 1])
        strain = omega[:, i] - rest
        energy += 0.5 * h * ca.dot(stiffness * strain, strain) - 0.5 * h * ca.dot(load, r[:, i] + r[:, i + 1])
        # |qm|^2 = 1 / (1 + h^2 omega^2 / 16), from the rule above
        stretch = 1.0 + (0.25 * h) ** 2 * ca.sumsqr(omega[:, i])
        defects.append(q[:, i + 1] - q[:, i] - h * rod.quaternion_rate(middle, omega[:, i]))
        defects.append(r[:, i + 1] - r[:, i] - h * stretch * rod.frame(middle)[:, 2])
    conjugate = ca.vertcat(end_quaternion[0], -end_quaternion[1:])
    last = q[:, -1]
    relative = conjugate[0] * last[1:] + last[0] * conjugate[1:] + ca.cross(conjugate[1:], last[1:])
    unknowns = ca.vertcat(ca.vec(q), ca.vec(r), ca.vec(omega))
    constraints = ca.vertcat(*defects, ca.sumsqr(q[:, 0]) - 1, relative)
    parameters = ca.vertcat(stiffness, rest, load, start_force, end_force, end_quaternion, drag, ca.vec(held))
    nlp = {"x": unknowns, "f": energy, "g": constraints, "p": parameters}
    settings: dict[str, Any] = {
        **QUIET,
        "ipopt.max_iter": iterations,
        "ipopt.tol": TOLERANCE,
        "ipopt.fixed_variable_treatment": "make_parameter",
    }
    return ca.nlpsol("chain", "ipopt", nlp, settings), unknowns.numel()


def relax(
    section: Section, load: Array, boundary: Boundary, q: Array, r: Array, drag: float = 0.0
) -> ChainState | None:
    """Let a chain go from the shape given to a minimum of its energy.

    Args:
        section, load, boundary: the cable and its ends, dimensionless; moments given at the ends are left out.
        q, r: the shape, (n + 1, 4) and (n + 1, 3), r from the start of the cable.
        drag: of a viscous medium over the time step taken, per length and angle squared: the energy has half of it
            times the squared angle turned through added. 0 is a step without end.

    Returns:
        The relaxed chain, or None where IPOPT found none or turned the end by whole turns.
    """
    segments = len(q) - 1
    solver, size = _program(segments, SINKING_ITERATIONS if drag > 0.0 else ITERATIONS)
    h = 1.0 / segments
    difference = np.diff(q, axis=0)
    middle = 0.5 * (q[1:] + q[:-1])
    middle = middle / np.sum(middle**2, axis=1, keepdims=True)
    omega = (
        2.0
        / h
        * (
            middle[:, :1] * difference[:, 1:]
            - difference[:, :1] * middle[:, 1:]
            - np.cross(middle[:, 1:], difference[:, 1:])
        )
    )
    x = np.concatenate([q.ravel(), r.ravel(), omega.ravel()])
    lower, upper = np.full(size, -np.inf), np.full(size, np.inf)
    kind = boundary.kind

    def fix(first: int, values: Array) -> None:
        lower[first : first + len(values)] = upper[first : first + len(values)] = values
        x[first : first + len(values)] = values

    if kind.start_orientation:
        fix(0, boundary.start_quaternion)
    position = 4 * (segments + 1)
    if kind.start_position:
        fix(position, np.zeros(3))
    if kind.end_position:
        fix(position + 3 * segments, boundary.gap)
    count = 7 * segments
    lowest, highest = np.zeros(count + 4), np.zeros(count + 4)
    if kind.start_orientation:  # the norm is then fixed with the quaternion itself
        lowest[count], highest[count] = -np.inf, np.inf
    if not kind.end_orientation:
        lowest[count + 1 :], highest[count + 1 :] = -np.inf, np.inf
    parameters = np.concatenate(
        [
            section.stiffness,
            section.rest_curvature,
            load,
            boundary.start_force,
            boundary.end_force,
            boundary.end_quaternion,
            [drag],
            q.ravel(),
        ]
    )
    answer = solver(x0=x, p=parameters, lbx=lower, ubx=upper, lbg=lowest, ubg=highest)
    if not solver.stats()["success"]:
        return None
    x = np.asarray(answer["x"]).ravel()
    frames = x[:position].reshape(-1, 4)
    if kind.end_orientation and (frames[-1] @ boundary.end_quaternion) * (q[-1] @ boundary.end_quaternion) < 0:
        return None
    multipliers = np.asarray(answer["lam_g"]).ravel()[:count].reshape(segments, 7)
    # the multiplier of r+ - r = chord is the force in the segment; extrapolated to s = 0 along the load
    force = multipliers[0, 4:] + 0.5 * h * np.asarray(load)
    places = x[position : position + 3 * (segments + 1)].reshape(-1, 3)
    return ChainState(frames, places - places[0], x[position + 3 * (segments + 1) :].reshape(segments, 3), force)


def settle(section: Section, load: Array, boundary: Boundary, q: Array, r: Array) -> ChainState | None:
    """Let a chain sink through a viscous medium from the shape given to where it comes to rest.

    Implicit Euler steps of the overdamped motion, so the chain runs down its own valley of the energy and does not
    jump to another, as :func:`relax` may; steps are bounded by how far a section turns in one.

    Args:
        section, load, boundary, q, r: as in :func:`relax`.

    Returns:
        The chain at rest, or None where a step could not be solved.
    """
    drag = FIRST_DRAG * (1.0 + float(np.max(section.stiffness)))
    for _ in range(MOST_SINKING):
        state = relax(section, load, boundary, q, r, drag)
        turned = np.inf if state is None else 2.0 * float(np.max(np.linalg.norm(state.q - q, axis=1)))
        if state is None or turned > LONG_STEP:
            drag *= 8.0
            if drag > STUCK:
                return None
            continue
        q, r = state.q, state.r
        if turned < AT_REST and drag < 1.0:
            return relax(section, load, boundary, q, r)
        if turned < 0.5 * LONG_STEP:
            drag *= 0.25
    return None
