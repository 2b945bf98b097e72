"""Beginning with curls: a cable stiff in torsion takes whole turns into curls, one each, and is hardly twisted.

Where energy minimisation begins at a twisted one instead, or load stepping makes it stiffer, it finds its curls by
long detours, or not at all.
A curl is begun as a circle about the section's softer axis, tilted a little towards the tangent, which makes it a turn
of a helix: so it takes up a turn of the sense that is asked for. Coyne, "Analysis of the formation and elimination of
loops in twisted cable", IEEE J. Oceanic Eng. 15, 1990.
"""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np

from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.rod.boundary import CLAMPED, Case
from harness_opt.statics.energy_minimum import COILED, EnergyMinimum, minimise_energy
from harness_opt.statics.load_stepping import softened, stiffen, tighten
from harness_opt.statics.starting_curve import curve, loose, signed

BASE_PLACES, CURL_PLACES = 241, 25  # places at which the cable without its curls is looked at, and a curl


def minimum_with_curls(case: Case, turns: int, bow: Array | None) -> EnergyMinimum | None:
    """Return the energy minimum begun with a curl for each of its turns; None where it has none or that fails.

    The energy of the cable without them is minimised first: curls gather where it is least tense.

    Args:
        case: what is sought.
        turns, bow: as in :func:`~harness_opt.statics.cold_start.cold_start`.
    """
    curls_share = 0.5  # of the slack: what the curls take up
    if not turns or case.boundary.kind != CLAMPED:
        return None
    boundary = loose(case.boundary)
    taken = curls_share * (1.0 - float(np.linalg.norm(boundary.gap)))
    shorter = dataclasses.replace(boundary, gap=boundary.gap / (1.0 - taken))
    begun, s, q = curve(case, shorter, 0, bow)
    soft = softened(begun, s, q, COILED)
    base = minimise_energy(soft, s, q, np.zeros(3), short_steps=False)
    if base is None:
        return None
    s, q = _with_curls(base, turns, taken)
    clamps = signed(boundary, q)
    force = base.chain.force(base.multipliers)
    minimum = minimise_energy(dataclasses.replace(soft, boundary=clamps), s, q, force, short_steps=False)
    if minimum is not None:
        minimum = stiffen(dataclasses.replace(case, boundary=clamps), minimum)
    if minimum is not None and boundary is not case.boundary:
        gap = case.boundary.gap
        minimum = tighten(dataclasses.replace(case, boundary=dataclasses.replace(clamps, gap=gap)), minimum)
    return minimum


def _with_curls(base: EnergyMinimum, turns: int, taken: float) -> tuple[Array, Array]:
    """Return arc lengths (m,) and quaternions (m, 4) of a cable that has curls for part ``taken`` of its length."""
    tilt = 0.15  # rad, of the axis of a curl towards the tangent
    count, chain = abs(turns), base.chain
    length = taken / count
    softer = int(np.argmin(chain.section.stiffness[:2]))
    axis = np.zeros(3)
    axis[softer], axis[2] = np.cos(tilt), np.sign(turns) * np.sin(tilt)
    circle = np.linspace(0.0, 1.0, CURL_PLACES)
    around = rotations.from_rotation_vector(2.0 * np.pi * circle[:, None] * axis)  # ends at the other sign
    places = _places(base, count, length)
    pieces_s, pieces_q = [], []
    edges = np.concatenate([[0.0], places, [1.0]])
    for i, (begin, end) in enumerate(itertools.pairwise(edges.tolist())):
        u = np.linspace(begin, end, max(2, round(BASE_PLACES * (end - begin))))
        q = (-1.0) ** i * chain.sample(base.q, u)[0]
        pieces_s.append((1.0 - taken) * u + i * length)
        pieces_q.append(q)
        if i < count:
            pieces_s.append(pieces_s[-1][-1] + length * circle[1:-1])
            pieces_q.append(rotations.multiply(q[-1:], around[1:-1]))
    return np.concatenate(pieces_s), np.concatenate(pieces_q)


def _places(base: EnergyMinimum, count: int, length: float) -> Array:
    """Return where the curls go, (count,), in lengths of the cable without them: evenly, or where it is least tense."""
    even_tension = 1e-3  # relative: a tension that differs by less along the cable gathers no curls
    spacing = 2.0  # lengths of a curl, from one to the next where they gather
    chain = base.chain
    u = np.linspace(0.0, 1.0, BASE_PLACES)
    tension = np.linalg.norm(chain.force(base.multipliers) + (1.0 - u)[:, None] * chain.load, axis=1)
    apart = 1.0 / count
    if np.ptp(tension) > even_tension * np.max(tension):
        apart = min(apart, spacing * length)
    offsets = apart * (np.arange(count) - 0.5 * (count - 1))
    middle = np.clip(u[np.argmin(tension)], 0.5 * apart * count, 1.0 - 0.5 * apart * count)
    return np.asarray(middle + offsets)
