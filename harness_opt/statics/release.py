"""A cable released from a curve or from a shape that it lost: it moves down its energy to a stable one."""

from __future__ import annotations

import numpy as np

from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.rod.boundary import Case
from harness_opt.rod.stability import doubtful, lowest_mode, stability
from harness_opt.rod.states import Rod
from harness_opt.statics.energy_minimum import minimise_energy
from harness_opt.statics.from_minimum import solve_from_minimum
from harness_opt.statics.mesh import divided, refine
from harness_opt.statics.solve import Solved, error_estimate


def release(case: Case, rod: Rod, solver: str, *, short_steps: bool = True) -> Solved | None:
    """Release the cable from ``rod`` to a stable shape nearby of less energy; None where none is found.

    ``case`` may differ from what ``rod`` was solved for: after a fold the old shape does not exist any more. The
    shape is perturbed along its weakest direction, and its energy minimised from there.

    Args:
        case: what holds the cable now.
        rod: its last shape.
        solver: name.
        short_steps: as a cable moves through a viscous medium.
    """
    perturbations = (0.05, 0.2, 0.6)  # rad, largest turning of a section, to leave a saddle or a lost minimum
    direction = lowest_mode(rod, case.boundary.kind)
    for size in perturbations:
        for sign in (1.0, -1.0):
            found = _perturbed(case, rod, sign * size * direction, solver, short_steps)
            if found is not None and is_stable(found, solver):
                return found
    return None


def _perturbed(case: Case, rod: Rod, field: Array, solver: str, short_steps: bool) -> Solved | None:
    """Minimise the energy from ``rod`` turned by ``field`` (n + 1, 3), section frames, rad; None if in vain."""
    places_per_element = 8  # an element, at which a lost shape is sampled
    s = divided(rod.mesh, places_per_element * (len(rod.mesh) - 1))
    turned = np.stack([np.interp(s, rod.mesh, column) for column in field.T], axis=1)
    q = rotations.multiply(rod.sample(s).q, rotations.from_rotation_vector(turned))
    minimum = minimise_energy(case, s, q, rod.force[-1], short_steps=short_steps)
    return None if minimum is None else solve_from_minimum(case, minimum, solver)


def is_stable(solved: Solved, solver: str) -> bool:
    """Return whether a solved shape has no unstable direction; where it is hard to tell, judged on a finer mesh."""
    judged_error = 1e-8  # estimated error, in L, of a shape whose stability is hard to tell
    kind = solved.case.boundary.kind
    found = stability(solved.rod, kind)
    if doubtful(solved.rod, found, error_estimate(solved)[0]):
        found = stability(refine(solved, judged_error, solver)[0].rod, kind)
    return bool(found.stable)


def stabilised(solved: Solved, solver: str) -> Solved | None:
    """Return ``solved`` where it is stable, else a stable shape of less energy; None where none is found.

    None is looked for where a dead moment acts: it has no energy to descend, and often no stable shape at all.
    """
    boundary = solved.case.boundary
    if is_stable(solved, solver):
        return solved
    if np.any(boundary.start_moment) or np.any(boundary.end_moment):
        return None
    return release(solved.case, solved.rod, solver, short_steps=False)
