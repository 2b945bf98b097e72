"""Mesh refinement: the elements of a shape redistributed to where its error is, until that is small enough."""

from __future__ import annotations

import numpy as np

from harness_opt.errors import Status
from harness_opt.numerics.rotations import Array
from harness_opt.statics.solve import STAGES, Solved, correct_to_rounding, error_estimate, resample, solve_on

# meshes on offer; a function is built once for each
ELEMENTS = (8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256)
LAST_RESORT = (384, 512)  # elements of the one shape that those do not do for
# Estimated errors, in L: at which a path is refined on the way, as near folds more leads past them; and at which it is
# given up, as more leads to shapes that the cable does not have. Along a near-null direction no mesh may do for the
# first.
COARSE, ROUGH = 1e-5, 1e-3
RESOLVED = 1e-6  # estimated error, in L, that it is refined to then


def refined_mesh(mesh: Array, local: Array, elements: int) -> Array:
    """Return a mesh of ``elements`` on which the local errors (n,) would be equal (equidistribution).

    The error of an element falls with the power 2 STAGES + 1 of its length; the density is smoothed over neighbours
    so that lengths change gradually. Ascher, Mattheij, Russell, "Numerical Solution of BVPs for ODEs", section 9.2.
    """
    steps = np.diff(mesh)
    finite = local[np.isfinite(local)]
    ceiling = max(float(finite.max(initial=0.0)), 1e-30)
    monitor = np.clip(np.where(np.isfinite(local), local, 10.0 * ceiling), 1e-12 * ceiling, None)
    density = monitor ** (1.0 / (2 * STAGES + 1)) / steps
    padded = np.concatenate([density[:1], density, density[-1:]])
    density = np.maximum(density, 0.5 * np.maximum(padded[:-2], padded[2:]))
    density = density + 0.1 * np.sum(density * steps)  # no stretch is left without elements
    run = np.concatenate([[0.0], np.cumsum(density * steps)])
    return np.interp(np.linspace(0.0, run[-1], elements + 1), run, mesh)


def divided(mesh: Array, elements: int) -> Array:
    """Return a mesh of so many elements that is as dense as ``mesh`` (n + 1,) everywhere, in proportion."""
    count = len(mesh) - 1
    return np.interp(np.linspace(0.0, count, elements + 1), np.arange(count + 1.0), mesh)


def finer_mesh(mesh: Array, local: Array, excess: float, before: float, most: int = ELEMENTS[-1]) -> Array | None:
    """Return the mesh on offer on which the error would be ``excess`` times smaller, or one of twice the elements.

    Args:
        mesh, local: nodes (n + 1,) and local errors (n,).
        excess: error over tolerance.
        before: the same on the mesh before.
        most: elements.

    Returns:
        The finest of these, redistributed, where there is no finer one; None where that gains nothing any more.
    """
    worthwhile = 0.5  # part of the error that redistributing the finest mesh must leave at most, to be done again
    n = len(mesh) - 1
    if n >= most and not excess < worthwhile * before:
        return None
    most = max(n, most)
    wanted = n * min(2.0, 1.15 * excess ** (0.5 / STAGES))
    finer = next((m for m in (*ELEMENTS, *LAST_RESORT) if most >= m > n and m >= wanted), most)
    return refined_mesh(mesh, local, finer)


def elements_for(elements: int, error: float, local: Array) -> int:
    """Return up to how many elements a shape on a path is to be refined; 0 where its mesh is good enough for one.

    Args:
        elements: that it has.
        error, local: what :func:`error_estimate` returns.
    """
    least_local = 1e-9  # largest local error, in L, of a mesh not to blame: a near-null direction is
    first_refinement = 128  # elements up to which it is refined for the first
    if error <= COARSE or np.max(local) <= least_local:
        return 0
    if error > ROUGH:
        return ELEMENTS[-1]
    return first_refinement if elements < first_refinement else 0


def refine(solved: Solved, tolerance: float, solver: str, most: int = ELEMENTS[-1]) -> tuple[Solved, float, Status]:
    """Refine the mesh of a solved case until its estimated error is at most ``tolerance`` (in L).

    Args:
        solved, tolerance: as above.
        solver: name.
        most: elements.

    Returns:
        The best solve, its estimated error, and OK, INACCURATE or the solver's own failure.
    """
    error, local = error_estimate(solved)
    if error > tolerance or np.any(solved.rod.long):  # what is good enough stays, with all that is known of it
        solved = correct_to_rounding(solved)
        error, local = error_estimate(solved)
    best, before = (solved, error), np.inf
    while error > tolerance:
        mesh = finer_mesh(solved.rod.mesh, local, error / tolerance, before, most)
        if mesh is None:
            return *best, Status.INACCURATE
        before = error / tolerance
        x = resample(solved.rod, mesh)
        if not np.all(np.isfinite(x)):
            return *best, Status.INACCURATE
        again = solve_on(solved.case, mesh, x, solver)
        if not again.ok or again.turned:
            return *best, again.solution.status if not again.ok else Status.WRONG_TURNS
        solved = correct_to_rounding(again)
        error, local = error_estimate(solved)
        best = min(best, (solved, error), key=lambda found: found[1])
    return solved, error, Status.OK
