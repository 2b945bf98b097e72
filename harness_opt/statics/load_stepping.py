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
    LONG_STEP,
    QUICK,
    SMALL_STEP,
    TURNING,
    WARM_SHIFT,
    WORK,
    Resting,
    _Manner,
    _rest,
    _slack,
)

STIFFEN = 4.0  # factor by which a march makes it stiffer in torsion; one that jumps too far coils it up
LEAST_STIFFEN = 1.15
TIGHTEN = 2.0  # factor by which a march makes a cable tauter
LEAST_TIGHTEN = 1.1


def softened(case: Case, s: Array, q: Array, coiled: float) -> Case:
    """Return ``case`` with so little torsional stiffness that a curve does not coil up where it is let go.

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


def stiffen(case: Case, resting: Resting, work: int = WORK, *, patiently: bool = False) -> Resting | None:
    """Take a :func:`softened` cable at rest to the stiffness of ``case``, from minimum to minimum; None if in vain.

    Args:
        case, resting: as above.
        work: elements times steps that each minimum may take.
        patiently: in shorter steps where the first fails, else it fails.
    """
    wanted, factor = float(case.section.stiffness[2]), STIFFEN
    while (reached := float(resting.chain.section.stiffness[2])) < wanted:
        stiffness = np.array([*case.section.stiffness[:2], min(factor * reached, wanted)])
        section = dataclasses.replace(case.section, stiffness=stiffness)
        chain = Chain(section, case.load, resting.chain.boundary, resting.chain.mesh, exact=resting.chain.exact)
        tried = min(work, QUICK) if patiently and factor >= LEAST_STIFFEN**2 else work
        manner = _Manner(LONG_STEP, tried, nearly=stiffness[2] < wanted)
        found = _rest(chain, resting.q, resting.multipliers, WARM_SHIFT, manner)
        if found is not None:
            resting = found
            continue
        factor = math.sqrt(factor)
        if not patiently or factor < LEAST_STIFFEN:
            return None
    return resting


def tighten(case: Case, resting: Resting) -> Resting | None:
    """Take a cable at rest to the shorter slack of ``case``, from minimum to minimum; None where it gets lost.

    A taut cable is straight but for clamp layers and curls as long as its slack, and its tension goes with the inverse
    square of it: so what is bent is shrunk with every step, which leaves hardly anything to solve.
    """
    wanted, factor = _slack(case.boundary), TIGHTEN
    direction = case.boundary.gap / np.linalg.norm(case.boundary.gap)
    slack = _slack(resting.chain.boundary)
    while slack > wanted * (1.0 + 1e-9):
        step = min(factor, slack / wanted)
        gap = case.boundary.gap if step == slack / wanted else (1.0 - slack / step) * direction
        boundary = dataclasses.replace(resting.chain.boundary, gap=gap)
        chain = Chain(case.section, case.load, boundary, _shrunk(resting, step), exact=True)
        manner = _Manner(SMALL_STEP, WORK, nearly=step < slack / wanted)
        found = _rest(chain, resting.q, resting.multipliers * step**2, WARM_SHIFT, manner)
        if found is None:
            factor = np.sqrt(factor)
            if factor < LEAST_TIGHTEN:
                return None
            continue
        resting, slack = found, slack / step
    return resting


def _shrunk(resting: Resting, factor: float) -> Array:
    """Return the mesh of a chain with its bent elements shorter by ``factor`` and its straight ones longer."""
    chain = resting.chain
    steps = np.diff(chain.mesh)
    bending = np.linalg.norm(chain.sample(resting.q, chain.points)[1][:, :2], axis=1)
    bent = np.clip(bending.reshape(len(steps), -1).max(axis=1) * steps / (1e-4 * TURNING), 0.0, 1.0)
    steps, straight = steps * (1.0 - (1.0 - 1.0 / factor) * bent), steps * (1.0 - bent)
    if np.sum(straight) > 0.0:
        steps = steps + (1.0 - np.sum(steps)) * straight / np.sum(straight)
    run = np.concatenate([[0.0], np.cumsum(steps)])
    return run / run[-1]
