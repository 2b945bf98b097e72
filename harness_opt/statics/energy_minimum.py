"""Energy minimisation from a curve to an equilibrium nearby, on elements that fit the shape as it changes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness_opt.numerics import rotations
from harness_opt.numerics.descent import FIRST_SHIFT, Ended, descend
from harness_opt.numerics.rotations import Array
from harness_opt.rod.boundary import Boundary, Case
from harness_opt.rod.energy_chain import Chain
from harness_opt.statics.curl_steps import has_curls, move_curls
from harness_opt.statics.mesh import ELEMENTS, divided

TURNING_PER_ELEMENT = 1.2  # rad
CHANGE_PER_ELEMENT = 0.8  # root of the rad by which the curvature's change over an element changes its turning
SMALL_STEP, LONG_STEP = 0.3, 0.7  # rad a step: as through a viscous medium, and where any minimum will do
WORK = 60_000  # elements times steps that a descent may take: some seconds
LITTLE_WORK = 8_000  # the same for a descent that another one can stand in for
STEPS_A_ROUND = 20  # steps of a descent, after which curls are moved on
WARM_SHIFT = 1e-3  # first shift of a descent that goes on from a minimum
COILED, TWISTED = 100.0, 6.0  # rad in its length, of the waves M / k that it may bend in, and that it hardly does in


@dataclass(frozen=True)
class EnergyMinimum:
    """A chain at a minimum of its energy.

    Args:
        chain: its energy.
        q: quaternions of the nodes, (m, 4).
        multipliers: of its constraints.
    """

    chain: Chain
    q: Array
    multipliers: Array


def minimise_energy(
    case: Case, s: Array, q: Array, force: Array, *, short_steps: bool, work: int = WORK
) -> EnergyMinimum | None:
    """Minimise a cable's energy from a shape to a minimum nearby; None where none was reached.

    Moments given at the ends are left out.

    Args:
        case: the cable and what holds it.
        s, q: arc lengths (m,) and quaternions (m, 4) of the shape, close enough to be interpolated.
        force: guess of the internal force at the end, (3,).
        short_steps: as a cable moves through a viscous medium, to the minimum next to the shape; else long ones.
        work: elements times steps that it may take.
    """
    spin = rotations.rotation_vector(rotations.multiply(rotations.conjugate(q[:-1]), q[1:]))
    middles = 0.5 * (s[1:] + s[:-1])
    mesh = fitted(middles, np.linalg.norm(spin, axis=1) / np.diff(s) / TURNING_PER_ELEMENT)
    chain = Chain(case.section, case.load, case.boundary, mesh)
    nodes = chain.clamped(_between(s, q, chain.nodes))
    multipliers = force if chain.closed else chain.multipliers
    limits = DescentLimits(SMALL_STEP if short_steps else LONG_STEP, work, moves_curls=not short_steps)
    return descend_to_minimum(chain, nodes, multipliers, FIRST_SHIFT, limits)


def _between(s: Array, q: Array, wanted: Array) -> Array:
    """Return quaternions (N, 4) at ``wanted`` (N,), turned evenly between those (m, 4) at ``s`` (m,)."""
    i = np.clip(np.searchsorted(s, wanted, side="right") - 1, 0, len(s) - 2)
    part = (wanted - s[i]) / (s[i + 1] - s[i])
    turn = rotations.rotation_vector(rotations.multiply(rotations.conjugate(q[i]), q[i + 1]))
    return rotations.multiply(q[i], rotations.from_rotation_vector(part[:, None] * turn))


def fitted(s: Array, needed: Array) -> Array:
    """Return a mesh, of a size on offer, as dense as ``needed`` (m,), elements per length, asks for at ``s`` (m,).

    Lengths change gradually, and what is dense stays dense for some elements on either side: curls move.
    """
    rows_at_once = 64  # of distances between places, looked at together: what a processor keeps at hand
    kept_lengths, growth_rate = 3.0, 0.3  # an element keeps its length over so many of its own, then grows by this part
    fine = np.unique(np.concatenate([s, np.linspace(0.0, 1.0, 8 * ELEMENTS[0] + 1)]))
    size = 1.0 / np.maximum(np.interp(fine, s, needed), ELEMENTS[0])
    # size + growth_rate max(0, distance - kept_lengths size), of whatever asks for least
    grown, begun = growth_rate * fine, (1.0 - growth_rate * kept_lengths) * size
    spread = [
        np.min(np.maximum(size, np.abs(grown[i : i + rows_at_once, None] - grown) + begun), axis=1)
        for i in range(0, len(fine), rows_at_once)
    ]
    size = np.concatenate(spread)
    run = np.concatenate([[0.0], np.cumsum(np.diff(fine) * 2.0 / (size[1:] + size[:-1]))])
    count = next((n for n in ELEMENTS if n >= run[-1]), ELEMENTS[-1])
    mesh: Array = np.interp(np.linspace(0.0, run[-1], count + 1), run, fine)
    return mesh


def density(omega: Array, s: Array) -> Array:
    """Return the elements per length (m,) that a shape with Darboux vectors (m, 3) at ``s`` (m,) needs."""
    change = np.linalg.norm(np.diff(omega, axis=0), axis=1) / np.diff(s)
    nearby = np.maximum(np.append(change, 0.0), np.append(0.0, change))
    elements: Array = np.maximum(
        np.linalg.norm(omega, axis=1) / TURNING_PER_ELEMENT, np.sqrt(nearby) / CHANGE_PER_ELEMENT
    )
    return elements


@dataclass(frozen=True)
class DescentLimits:
    """How an energy is minimised.

    Args:
        longest: step, rad.
        work: elements times steps that it may take.
        moves_curls: whether curls are moved along the cable on the way: see :mod:`.curl_steps`.
        roughly: whether it is enough that it hardly falls any more: at a step on the way to another cable.
    """

    longest: float
    work: int
    moves_curls: bool = True
    roughly: bool = False


def descend_to_minimum(
    chain: Chain, q: Array, multipliers: Array, shift: float, limits: DescentLimits
) -> EnergyMinimum | None:
    """Descend on ``chain``, and on others made to fit, to the minimum of one that fits; None where that fails.

    Args:
        chain, q, multipliers: where to begin: quaternions of the nodes (m, 4), and the multipliers of the constraints.
        shift: of the first step, in the metric of the chain.
        limits: how far to go.
    """
    few_steps = 5  # meshes in a row, the finest, that allow no more steps than this: what is bent is too sharp for them
    little_gain = 1e-4  # relative, of the energy: a round that gains less hardly goes down
    most_drift = 2.0  # times its length, or the inverse: an element that has changed so much does not fit any more
    most_misfit = 1.6  # how far a chain may miss that at the minimum
    room, work = _room(chain), limits.work
    standstills, grown, above = 0, np.ones(len(chain.mesh) - 1), np.inf
    while work > 0:
        elements = len(chain.mesh) - 1
        steps = max(1, min(STEPS_A_ROUND, work // elements) if limits.moves_curls else work // elements)
        found = descend(chain, q, multipliers, longest=limits.longest, steps=steps, shift=shift, room=room)
        q, multipliers = found.q, found.multipliers
        if found.ended is Ended.STUCK:
            return None
        work -= elements * max(1, found.steps)
        too_coarse = found.ended is Ended.TOO_COARSE
        drifts = limits.moves_curls and found.ended is Ended.UNFINISHED and work > 0
        moved = move_curls(chain, q, multipliers, room) if drifts else None
        if moved is not None:
            grown *= np.diff(moved.chain.mesh) / np.diff(chain.mesh)
            chain, q, multipliers = moved.chain, moved.q, moved.multipliers
        energy = chain.energy(q)[0]
        little = above - energy < little_gain * (1.0 + abs(energy))
        arrived = (found.ended is Ended.AT_MINIMUM and moved is None) or (limits.roughly and not too_coarse and little)
        above = energy
        unfit = np.max(np.maximum(grown, 1.0 / grown)) > most_drift
        if not (arrived or too_coarse or unfit or found.ended is Ended.AT_MINIMUM):
            shift = found.shift
            continue
        standstills = standstills + 1 if too_coarse and elements == ELEMENTS[-1] and found.steps <= few_steps else 0
        if standstills > few_steps:
            return None
        omega = chain.sample(q, chain.points)[1]
        if too_coarse:  # on the way down only what turns far needs elements
            needed = np.linalg.norm(omega, axis=1) / TURNING_PER_ELEMENT
        else:
            needed = density(omega, chain.points)
            lengths = np.repeat(np.diff(chain.mesh), len(chain.points) // elements)
            fits = np.max(needed * lengths) <= most_misfit or (elements == ELEMENTS[-1] and shift == WARM_SHIFT)
            if arrived and fits:
                return EnergyMinimum(chain, q, multipliers)
            if fits and not unfit:
                shift = found.shift
                continue
        finer = chain.on(fitted(chain.points, needed))
        q = finer.clamped(chain.sample(q, finer.nodes)[0])
        shift = FIRST_SHIFT if too_coarse else WARM_SHIFT
        chain, grown = finer, np.ones(len(finer.mesh) - 1)
    return None


def refine_curls(minimum: EnergyMinimum, finer: int) -> EnergyMinimum | None:
    """Move the curls of a chain as near to their equilibrium as rounding lets them; None where it has none.

    Args:
        minimum: on the chain.
        finer: elements for one of it.
    """
    most_rounds, least_gain = 8, 1e-11  # rounds; relative gain of energy that is worth one
    chain, q, multipliers = minimum.chain, minimum.q, minimum.multipliers
    if not has_curls(chain, q):
        return None
    chain = chain.on(divided(chain.mesh, finer * (len(chain.mesh) - 1)))
    q = chain.clamped(minimum.chain.sample(q, chain.nodes)[0])
    room = _room(chain)
    for _ in range(most_rounds):
        found = descend(chain, q, multipliers, longest=SMALL_STEP, steps=STEPS_A_ROUND, shift=WARM_SHIFT, room=room)
        q, multipliers = found.q, found.multipliers
        moved = move_curls(chain, q, multipliers, room, least_gain)
        if moved is None:
            break
        chain, q, multipliers = moved.chain, moved.q, moved.multipliers
    return EnergyMinimum(chain, q, multipliers)


def slack_of(boundary: Boundary) -> float:
    """Return by how much a cable is longer than the distance of its ends, in lengths of the cable."""
    return 1.0 - float(np.linalg.norm(boundary.gap))


def _room(chain: Chain) -> float:
    """Return how little the constraints of a chain leave free."""
    return slack_of(chain.boundary) if chain.closed else 1.0
