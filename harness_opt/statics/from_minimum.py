"""From an energy minimum on a chain of elements to an accurate shape of the cable, by collocation."""

from __future__ import annotations

import dataclasses

import numpy as np

from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.rod.boundary import Case
from harness_opt.rod.collocation import pack, stations
from harness_opt.statics.continuation import follow, turning
from harness_opt.statics.energy_minimum import EnergyMinimum, density, fitted, refine_curls
from harness_opt.statics.mesh import ELEMENTS, divided
from harness_opt.statics.solve import NEAR_NULL_AFTER, STAGES, Solved, error_estimate, solve_on

LAYER, DECAYED = 1.0, 18.0  # decay lengths: of an element at the foot of a layer, and after which 1e-8 of it is left


def solve_from_minimum(case: Case, minimum: EnergyMinimum, solver: str) -> Solved | None:
    """Solve ``case`` accurately from an energy minimum; None where what comes out is not its shape.

    Where that fails, curls may be too far from their equilibrium: along the cable there is next to nothing that holds
    them. They are moved closer, on finer elements too, and it is tried again.
    """
    curl_refinements = (1, 2)  # elements for one of a chain that curls are moved on to the last digit
    solved = _solve_near_minimum(case, minimum, solver)
    for finer in curl_refinements:
        if solved is not None:
            break
        nearer = refine_curls(minimum, finer)
        if nearer is None:
            break
        minimum, solved = nearer, _solve_near_minimum(case, nearer, solver)
    return solved


def _solve_near_minimum(case: Case, minimum: EnergyMinimum, solver: str) -> Solved | None:
    """Solve ``case`` accurately from an energy minimum; None where what comes out is not its shape."""
    refinements = (1, 2)  # collocation elements tried for one of the chain
    # the chain is right to a per mille: what needs more does not converge, of the fastest solver and of the others
    solve_iterations, slower_iterations = 20, 60
    most_error = 0.02  # estimated error, in L, of a solve on a coarse mesh that is taken for a shape of the cable
    most_turning = 0.5  # rad, turning up to which a solved shape is that of the chain
    chain = minimum.chain
    boundary = dataclasses.replace(chain.boundary, gap=case.boundary.gap)  # with the signs of its quaternions
    case = dataclasses.replace(case, boundary=boundary)
    still = dataclasses.replace(boundary, start_moment=np.zeros(3), end_moment=np.zeros(3))
    without_moments = dataclasses.replace(case, boundary=still)
    force = chain.force(minimum.multipliers) + case.load
    coarse = _solving_mesh(minimum)
    for finer in refinements:
        elements = next((n for n in ELEMENTS if n >= finer * (len(coarse) - 1)), None)
        if elements is None:
            return None
        mesh = divided(coarse, elements)
        q, omega = chain.sample(minimum.q, stations(mesh, STAGES))
        moment = rotations.rotate(q, case.section.stiffness * (omega - case.section.rest_curvature))
        x = pack(q, moment, force, STAGES)
        iterations = solve_iterations if solver == NEAR_NULL_AFTER else slower_iterations
        solved = solve_on(without_moments, mesh, x, solver, iterations)
        if not solved.ok or solved.turned or not error_estimate(solved)[0] < most_error:
            continue
        followed = (
            solved.solution.factor is None
        )  # the near-null curve: no step of the last iterations was Newton's own
        if followed or turning(solved.rod.sample(chain.nodes).q, minimum.q) < most_turning:
            break
    else:
        return None
    if np.any(boundary.start_moment) or np.any(boundary.end_moment):
        solved, reached = follow(lambda t: without_moments.blend(case, t), solved, 0.0, 1.0, solver)
        if reached < 1.0:
            return None
    return solved


def _solving_mesh(minimum: EnergyMinimum) -> Array:
    """Return a mesh for the collocation of an energy minimum: as dense as that needs, and as its layers do."""
    chain = minimum.chain
    omega = chain.sample(minimum.q, chain.points)[1]
    places, layers = _layers(minimum, np.abs(omega - chain.section.rest_curvature))
    return fitted(places, np.maximum(np.interp(places, chain.points, density(omega, chain.points)), layers))


def _layers(minimum: EnergyMinimum, bending: Array) -> tuple[Array, Array]:
    """Return places (N,) and the elements per length (N,) that what decays from clamps and curls needs there.

    Where a cable is taut, bending about axis i falls off with exp(-sqrt(F / k_i) s). The local errors of order
    p = 2 STAGES + 1 are then equal on elements that grow with exp(sqrt(F / k_i) s / p), and what has DECAYED needs none
    of its own.

    Args:
        minimum: the shape.
        bending: its curvatures at the points of the chain, without sign, (m, 3).
    """
    bent_from = 0.05  # curvature times the decay length, rad, from which on a layer or a curl is bent
    chain, grid, found = minimum.chain, [minimum.chain.points], []

    def force(s: Array) -> Array:
        size: Array = np.linalg.norm(chain.force(minimum.multipliers) + (1.0 - s)[:, None] * chain.load, axis=1)
        return size

    for axis in (0, 1):
        bent = bending[:, axis] > bent_from * np.sqrt(force(chain.points) / chain.section.stiffness[axis])
        sources = np.concatenate([[0.0], chain.points[bent], [1.0]])
        wave = np.sqrt(force(sources) / chain.section.stiffness[axis])
        decay = np.arange(-DECAYED, DECAYED + 1.0) / np.maximum(wave, 1.0)[:, None]
        grid.append((sources[:, None] + decay).ravel())
        found.append((sources, wave))
    s = np.unique(np.clip(np.concatenate(grid), 0.0, 1.0))
    density = np.zeros(len(s))
    for sources, wave in found:
        nearest = np.clip(np.searchsorted(sources, s), 1, len(sources) - 1)
        nearest -= s - sources[nearest - 1] < sources[nearest] - s
        away = wave[nearest] * np.abs(s - sources[nearest])
        needed = wave[nearest] / LAYER * np.exp(-away / (2 * STAGES + 1))
        density = np.maximum(density, np.where(away < DECAYED, needed, 0.0))
    return s, density
