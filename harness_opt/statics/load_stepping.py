"""Load stepping between energy minima: stiffer in torsion, tauter, step by step."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.rod.boundary import Case
from harness_opt.rod.energy_chain import Chain
from harness_opt.statics.energy_minimum import (
    LITTLE_WORK,
    LONG_STEP,
    SMALL_STEP,
    TURNING_PER_ELEMENT,
    WARM_SHIFT,
    WORK,
    DescentLimits,
    EnergyMinimum,
    descend_to_minimum,
    slack_of,
)


def softened(case: Case, s: Array, q: Array, coiled: float) -> Case:
    """Return ``case`` with so little torsional stiffness that a curve does not coil up as its energy is minimised.

    A twisted cable bends first in waves as short as M / k allows, and many turns of one that is stiff in torsion would
    have it coil too finely for any mesh. A soft one takes its turns into loops as long as itself.

    Args:
        case: the cable and what holds it.
        s, q: arc lengths (m,) and quaternions (m, 4) of the curve.
        coiled: what is left of those waves, rad in its length.
    """
    spin = rotations.rotation_vector(rotations.multiply(rotations.conjugate(q[:-1]), q[1:]))
    stiffness = case.section.stiffness
    waves = stiffness[2] * float(np.max(np.abs(spin[:, 2] / np.diff(s)))) / float(np.min(stiffness[:2]))
    if waves <= coiled:
        return case
    soft = np.array([*stiffness[:2], stiffness[2] * coiled / waves])
    return dataclasses.replace(case, section=dataclasses.replace(case.section, stiffness=soft))


def stiffen(
    case: Case, minimum: EnergyMinimum, work: int = WORK, *, shorten_steps: bool = False
) -> EnergyMinimum | None:
    """Take the energy minimum of a :func:`softened` cable to the stiffness of ``case``, step by step; None if in vain.

    Args:
        case, minimum: as above.
        work: elements times steps that each minimum may take.
        shorten_steps: take shorter steps where the first fails, else give up.
    """
    least_factor = 1.15
    first_factor = 4.0  # factor by which a load step makes it stiffer in torsion; too long a step coils it up
    wanted, factor = float(case.section.stiffness[2]), first_factor
    while (reached := float(minimum.chain.section.stiffness[2])) < wanted:
        stiffness = np.array([*case.section.stiffness[:2], min(factor * reached, wanted)])
        section = dataclasses.replace(case.section, stiffness=stiffness)
        chain = Chain(section, case.load, minimum.chain.boundary, minimum.chain.mesh, exact=minimum.chain.exact)
        tried = min(work, LITTLE_WORK) if shorten_steps and factor >= least_factor**2 else work
        limits = DescentLimits(LONG_STEP, tried, roughly=stiffness[2] < wanted)
        found = descend_to_minimum(chain, minimum.q, minimum.multipliers, WARM_SHIFT, limits)
        if found is not None:
            minimum = found
            continue
        factor = math.sqrt(factor)
        if not shorten_steps or factor < least_factor:
            return None
    return minimum


def tighten(case: Case, minimum: EnergyMinimum) -> EnergyMinimum | None:
    """Take an energy minimum to the shorter slack of ``case``, step by step; None where it gets lost.

    A taut cable is straight but for clamp layers and curls as long as its slack, and its tension goes with the inverse
    square of it: so what is bent is shrunk with every step, which leaves hardly anything to solve.
    """
    least_ratio = 1.1
    first_ratio = 2.0  # factor by which a load step makes a cable tauter
    wanted, factor = slack_of(case.boundary), first_ratio
    direction = case.boundary.gap / np.linalg.norm(case.boundary.gap)
    slack = slack_of(minimum.chain.boundary)
    while slack > wanted * (1.0 + 1e-9):
        step = min(factor, slack / wanted)
        gap = case.boundary.gap if step == slack / wanted else (1.0 - slack / step) * direction
        boundary = dataclasses.replace(minimum.chain.boundary, gap=gap)
        chain = Chain(case.section, case.load, boundary, _shrunk(minimum, step), exact=True)
        limits = DescentLimits(SMALL_STEP, WORK, roughly=step < slack / wanted)
        found = descend_to_minimum(chain, minimum.q, minimum.multipliers * step**2, WARM_SHIFT, limits)
        if found is None:
            factor = np.sqrt(factor)
            if factor < least_ratio:
                return None
            continue
        minimum, slack = found, slack / step
    return minimum


def _shrunk(minimum: EnergyMinimum, factor: float) -> Array:
    """Return the mesh of a chain with its bent elements shorter by ``factor`` and its straight ones longer."""
    chain = minimum.chain
    steps = np.diff(chain.mesh)
    bending = np.linalg.norm(chain.sample(minimum.q, chain.points)[1][:, :2], axis=1)
    bent = np.clip(bending.reshape(len(steps), -1).max(axis=1) * steps / (1e-4 * TURNING_PER_ELEMENT), 0.0, 1.0)
    steps, straight = steps * (1.0 - (1.0 - 1.0 / factor) * bent), steps * (1.0 - bent)
    if np.sum(straight) > 0.0:
        steps = steps + (1.0 - np.sum(steps)) * straight / np.sum(straight)
    run = np.concatenate([[0.0], np.cumsum(steps)])
    mesh: Array = run / run[-1]
    return mesh
