"""From a chain at rest to an accurate shape of the cable."""

from __future__ import annotations

import dataclasses

import numpy as np

from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.rod.boundary import Case
from harness_opt.rod.collocation import pack, stations
from harness_opt.statics.continuation import follow, turning
from harness_opt.statics.energy_minimum import Resting, closer, density, fitted
from harness_opt.statics.mesh import ELEMENTS, divided
from harness_opt.statics.solve import SAFEGUARDED, STAGES, Solved, error_estimate, solve_on

BENT = 0.05  # curvature times the decay length, rad, from which on a layer or a curl is bent
LAYER, DECAYED = 1.0, 18.0  # decay lengths: of an element at the foot of a layer, and after which 1e-8 of it is left
FAITHFUL = 0.5  # rad, turning up to which a solved shape is that of the chain
RESOLVED = 0.02  # estimated error, in L, above which a solve on a coarse mesh is not taken for a shape of the cable
# the chain is right to a per mille: what needs more does not converge, of the fastest solver and of the others
SOLVE_ITERATIONS, SLOWER = 20, 60
REFINEMENTS = (1, 2)  # collocation elements tried for one of the chain
CLOSER = (1, 2)  # elements for one of a chain that curls are brought closer to their rest on


def solve_resting(case: Case, resting: Resting, solver: str) -> Solved | None:
    """Solve ``case`` accurately from a chain at rest; None where what comes out is not its shape.

    Where that fails, curls may be too far from where they rest: along the cable there is next to nothing that holds
    them. They are brought closer, on finer elements too, and it is tried again.
    """
    solved = _solve_resting(case, resting, solver)
    for finer in CLOSER:
        if solved is not None:
            break
        nearer = closer(resting, finer)
        if nearer is None:
            break
        resting, solved = nearer, _solve_resting(case, nearer, solver)
    return solved


def _solve_resting(case: Case, resting: Resting, solver: str) -> Solved | None:
    """Solve ``case`` accurately from a chain at rest; None where what comes out is not its shape."""
    chain = resting.chain
    boundary = dataclasses.replace(chain.boundary, gap=case.boundary.gap)  # with the signs of its quaternions
    case = dataclasses.replace(case, boundary=boundary)
    still = dataclasses.replace(boundary, start_moment=np.zeros(3), end_moment=np.zeros(3))
    without_moments = dataclasses.replace(case, boundary=still)
    force = chain.force(resting.multipliers) + case.load
    coarse = _solving_mesh(resting)
    for finer in REFINEMENTS:
        elements = next((n for n in ELEMENTS if n >= finer * (len(coarse) - 1)), None)
        if elements is None:
            return None
        mesh = divided(coarse, elements)
        q, omega = chain.sample(resting.q, stations(mesh, STAGES))
        moment = rotations.rotate(q, case.section.stiffness * (omega - case.section.rest_curvature))
        x = pack(q, moment, force, STAGES)
        iterations = SOLVE_ITERATIONS if solver == SAFEGUARDED else SLOWER
        solved = solve_on(without_moments, mesh, x, solver, iterations)
        if not solved.ok or solved.turned or not error_estimate(solved)[0] < RESOLVED:
            continue
        walked = solved.solution.factor is None  # along a valley: no step of the last iterations was Newton's own
        if walked or turning(solved.rod.sample(chain.nodes).q, resting.q) < FAITHFUL:
            break
    else:
        return None
    if np.any(boundary.start_moment) or np.any(boundary.end_moment):
        solved, reached = follow(lambda t: without_moments.blend(case, t), solved, 0.0, 1.0, solver)
        if reached < 1.0:
            return None
    return solved


def _solving_mesh(resting: Resting) -> Array:
    """Return a mesh for the collocation of a shape at rest: as dense as that needs, and as its layers do."""
    chain = resting.chain
    omega = chain.sample(resting.q, chain.points)[1]
    places, layers = _layers(resting, np.abs(omega - chain.section.rest_curvature))
    return fitted(places, np.maximum(np.interp(places, chain.points, density(omega, chain.points)), layers))


def _layers(resting: Resting, bending: Array) -> tuple[Array, Array]:
    """Return places (N,) and the elements per length (N,) that what decays from clamps and curls needs there.

    Where a cable is taut, bending about axis i falls off with exp(-sqrt(F / k_i) s). The local errors of order
    p = 2 STAGES + 1 are then equal on elements that grow with exp(sqrt(F / k_i) s / p), and what has DECAYED needs none
    of its own.

    Args:
        resting: the shape.
        bending: its curvatures at the points of the chain, without sign, (m, 3).
    """
    chain, grid, found = resting.chain, [resting.chain.points], []

    def force(s: Array) -> Array:
        return np.linalg.norm(chain.force(resting.multipliers) + (1.0 - s)[:, None] * chain.load, axis=1)

    for axis in (0, 1):
        bent = bending[:, axis] > BENT * np.sqrt(force(chain.points) / chain.section.stiffness[axis])
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
