"""Other meshes for followed frames: lighter ones where fewer elements do, and one for all frames in the end.

Loops move along a cable and grow with its slack: a mesh that serves one frame is in the wrong place a few frames on.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from harness_opt.motion.frames import Frames, Stretches
from harness_opt.numerics.rotations import Array
from harness_opt.statics.continuation import MOST_TURNING, turning
from harness_opt.statics.mesh import ELEMENTS, RESOLVED, elements_for, refine, refined_mesh
from harness_opt.statics.solve import STAGES, Solved, error_estimate, resample, solve_on


def on_mesh(solved: Solved, mesh: Array, solver: str) -> Solved | None:
    """Return the same shape on another mesh, or one of the same energy along its near-null direction; None in vain."""
    same_energy = 1e-5  # relative difference up to which a shape that has moved did so along a near-null direction
    again = solve_on(solved.case, mesh, resample(solved.rod, mesh), solver)
    if not again.ok or again.turned:
        return None
    if turning(again.rod.q, solved.rod.sample(mesh).q) > MOST_TURNING:
        level = float(solved.rod.energy())
        if not abs(float(again.rod.energy()) - level) <= same_energy * (1.0 + abs(level)):
            return None
    return again


def coarsened(solved: Solved, like: Solved, elements: int, solver: str) -> Solved:
    """Return a shape on the mesh of the one before it where that serves, or on fewer elements of its own.

    Args:
        solved: the shape.
        like: the one before it.
        elements: least number of elements.
        solver: name.
    """
    element_margin = 1.15  # times the elements that the order of the method asks for
    error, local = error_estimate(solved)
    count = len(solved.bound.mesh) - 1
    wanted = max(elements, element_margin * count * (error / RESOLVED) ** (0.5 / STAGES))
    fewer = next(n for n in ELEMENTS if n >= min(wanted, count))
    for mesh in (like.bound.mesh, refined_mesh(solved.bound.mesh, local, fewer)):
        again = on_mesh(solved, mesh, solver) if len(mesh) - 1 <= count else None
        if again is not None and error_estimate(again)[0] <= RESOLVED:
            return again
    return solved


def on_one_mesh(frames: Stretches, solver: str) -> Frames:
    """Return frames on one mesh, as fine everywhere as the finest of theirs, as many of the first as can be had."""
    sure_error = 1e-7  # estimated error, in L, of a shape that is in doubt on a coarse mesh
    if len(frames.parts) <= 1:
        return frames.parts[0] if frames.parts else Frames(most_held=frames.most_held)
    mesh = common_mesh([part[0].bound.mesh for part in frames.parts])
    found = Frames(most_held=frames.most_held)
    for frame in frames:
        again = on_mesh(frame, mesh, solver) or on_mesh(refine(frame, sure_error, solver)[0], mesh, solver)
        if again is None or elements_for(len(mesh) - 1, *error_estimate(again)) == ELEMENTS[-1]:
            break
        found.append(again)
    return found


def common_mesh(meshes: Sequence[Array]) -> Array:
    """Return a mesh, of a size on offer, as dense everywhere as the densest of ``meshes``, as far as there is one."""
    places = np.unique(np.concatenate(meshes))
    middles = 0.5 * (places[1:] + places[:-1])
    density = np.max([1.0 / np.diff(mesh)[np.searchsorted(mesh, middles) - 1] for mesh in meshes], axis=0)
    run = np.concatenate([[0.0], np.cumsum(density * np.diff(places))])
    count = next((n for n in ELEMENTS if n >= math.floor(run[-1])), ELEMENTS[-1])
    return np.interp(np.linspace(0.0, run[-1], count + 1), run, places)
