"""Letting a cable go: down its energy to rest, on elements that fit what it holds, then solved accurately."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from . import rotations
from .boundary import Boundary, Case
from .continuation import ELEMENTS, STAGES, Solved, error_estimate, follow, solve_on, turning
from .rotations import Array
from .solvers.descent import FIRST_SHIFT, Ended, descend
from .transcriptions.chain import Chain
from .transcriptions.collocation import pack, stations

TURNING, BENDING = 1.2, 0.8  # rad an element; root of the rad by which its curvature changes the turning
BENT = 0.05  # curvature times the decay length, rad, from which on a layer or a curl is bent
LAYER, DECAYED = 1.0, 18.0  # decay lengths: of an element at the foot of a layer, and after which 1e-8 of it is left
LOOSE = 1.6  # how far a chain may miss that at rest
SPREAD, GROWTH = 3.0, 0.3  # an element keeps its length over so many of its own, then grows by this part
ROWS = 64  # of distances between places, looked at together: what a processor keeps at hand
SMALL_STEP, LONG_STEP = 0.3, 0.7  # rad a step: of a cable that sinks gently, of one that only looks for rest
WORK = 60_000  # elements times steps that a descent may take: some seconds
QUICK = 8_000  # the same for a descent that another one can stand in for
STANDSTILL = 5  # meshes in a row, the finest, that allow no more steps than this: what is bent is too sharp for them
WARM_SHIFT = 1e-3  # first shift of a descent that goes on from rest
COILED, TWISTED = 100.0, 6.0  # rad in its length, of the waves M / k that it may bend in, and that it hardly does in
STIFFEN = 4.0  # factor by which a march makes it stiffer in torsion; one that jumps too far coils it up
LEAST_STIFFEN = 1.15
TIGHTEN = 2.0  # factor by which a march makes a cable tauter
LEAST_TIGHTEN = 1.1
FAITHFUL = 0.5  # rad, turning up to which a solved shape is that of the chain
RESOLVED = 0.02  # estimated error, in L, above which a solve on a coarse mesh is not taken for a shape of the cable
SOLVE_ITERATIONS = 20  # the chain is right to a per mille: what needs more does not converge
REFINEMENTS = (1, 2)  # collocation elements tried for one of the chain


@dataclass(frozen=True)
class Resting:
    """A chain at a minimum of its energy.

    Args:
        chain: its energy.
        q: quaternions of the nodes, (m, 4).
        multipliers: of its constraints.
    """

    chain: Chain
    q: Array
    multipliers: Array


def sink(case: Case, s: Array, q: Array, force: Array, *, gently: bool, work: int = WORK) -> Resting | None:
    """Let a cable go from a shape to a minimum of its energy nearby; None where none was reached.

    Moments given at the ends are left out.

    Args:
        case: the cable and what holds it.
        s, q: arc lengths (m,) and quaternions (m, 4) of the shape, close enough for a straight look between them.
        force: guess of the internal force at the end, (3,).
        gently: in short steps, as a real cable sinks through a viscous medium; else in long ones.
        work: elements times steps that it may take.
    """
    spin = rotations.rotation_vector(rotations.multiply(rotations.conjugate(q[:-1]), q[1:]))
    middles = 0.5 * (s[1:] + s[:-1])
    mesh = _fitted(middles, np.linalg.norm(spin, axis=1) / np.diff(s) / TURNING)
    chain = Chain(case.section, case.load, case.boundary, mesh)
    nodes = chain.held(_between(s, q, chain.nodes))
    multipliers = force if chain.closed else chain.multipliers
    return _rest(chain, nodes, multipliers, FIRST_SHIFT, SMALL_STEP if gently else LONG_STEP, work)


def _between(s: Array, q: Array, wanted: Array) -> Array:
    """Return quaternions (N, 4) at ``wanted`` (N,), turned evenly between those (m, 4) at ``s`` (m,)."""
    i = np.clip(np.searchsorted(s, wanted, side="right") - 1, 0, len(s) - 2)
    part = (wanted - s[i]) / (s[i + 1] - s[i])
    turn = rotations.rotation_vector(rotations.multiply(rotations.conjugate(q[i]), q[i + 1]))
    return rotations.multiply(q[i], rotations.from_rotation_vector(part[:, None] * turn))


def _fitted(s: Array, density: Array) -> Array:
    """Return a mesh, of a size on offer, as dense as ``density`` (m,), elements per length, asks for at ``s`` (m,).

    Lengths change gradually, and what is dense stays dense for some elements on either side: curls slide.
    """
    fine = np.unique(np.concatenate([s, np.linspace(0.0, 1.0, 8 * ELEMENTS[0] + 1)]))
    size = 1.0 / np.maximum(np.interp(fine, s, density), ELEMENTS[0])
    # size + GROWTH max(0, distance - SPREAD size), of whatever asks for least
    grown, begun = GROWTH * fine, (1.0 - GROWTH * SPREAD) * size
    spread = [
        np.min(np.maximum(size, np.abs(grown[i : i + ROWS, None] - grown) + begun), axis=1)
        for i in range(0, len(fine), ROWS)
    ]
    size = np.concatenate(spread)
    run = np.concatenate([[0.0], np.cumsum(np.diff(fine) * 2.0 / (size[1:] + size[:-1]))])
    count = next((n for n in ELEMENTS if n >= run[-1]), ELEMENTS[-1])
    return np.interp(np.linspace(0.0, run[-1], count + 1), run, fine)


def _density(omega: Array, s: Array) -> Array:
    """Return the elements per length (m,) that a shape with Darboux vectors (m, 3) at ``s`` (m,) needs."""
    change = np.linalg.norm(np.diff(omega, axis=0), axis=1) / np.diff(s)
    nearby = np.maximum(np.append(change, 0.0), np.append(0.0, change))
    return np.maximum(np.linalg.norm(omega, axis=1) / TURNING, np.sqrt(nearby) / BENDING)


def _solving_mesh(resting: Resting) -> Array:
    """Return a mesh for the collocation of a shape at rest: as dense as that needs, and as its layers do."""
    chain = resting.chain
    omega = chain.sample(resting.q, chain.points)[1]
    places, layers = _layers(resting, np.abs(omega - chain.section.rest_curvature))
    return _fitted(places, np.maximum(np.interp(places, chain.points, _density(omega, chain.points)), layers))


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


def _rest(chain: Chain, q: Array, multipliers: Array, shift: float, longest: float, work: int = WORK) -> Resting | None:
    """Descend on ``chain``, and on others made to fit, until one that fits is at rest; None where that fails."""
    room = _slack(chain.boundary) if chain.closed else 1.0
    standstills = 0
    while True:
        elements = len(chain.mesh) - 1
        found = descend(
            chain, q, multipliers, longest=longest, steps=max(1, work // elements), shift=shift, room=room
        )  # fmt: skip
        q, multipliers = found.q, found.multipliers
        if found.ended in (Ended.STUCK, Ended.UNFINISHED):
            return None
        work -= elements * max(1, found.steps)
        strained_at_once = found.ended is Ended.STRAINED and elements == ELEMENTS[-1] and found.steps <= STANDSTILL
        standstills = standstills + 1 if strained_at_once else 0
        omega = chain.sample(q, chain.points)[1]
        if found.ended is Ended.STRAINED:  # on the way down only what turns far needs elements
            density = np.linalg.norm(omega, axis=1) / TURNING
        else:
            density = _density(omega, chain.points)
            lengths = np.repeat(np.diff(chain.mesh), len(chain.points) // elements)
            if np.max(density * lengths) <= LOOSE or (elements == ELEMENTS[-1] and shift == WARM_SHIFT):
                return Resting(chain, q, multipliers)
        mesh = _fitted(chain.points, density)
        finer = Chain(chain.section, chain.load, chain.boundary, mesh, exact=chain.exact)
        q = finer.held(chain.sample(q, finer.nodes)[0])
        shift = FIRST_SHIFT if found.ended is Ended.STRAINED else WARM_SHIFT
        if work <= 0 or standstills > STANDSTILL:
            return None
        chain = finer


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
        found = _rest(chain, resting.q, resting.multipliers, WARM_SHIFT, LONG_STEP, tried)
        if found is not None:
            resting = found
            continue
        factor = math.sqrt(factor)
        if not patiently or factor < LEAST_STIFFEN:
            return None
    return resting


def _slack(boundary: Boundary) -> float:
    return 1.0 - float(np.linalg.norm(boundary.gap))


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
        found = _rest(chain, resting.q, resting.multipliers * step**2, WARM_SHIFT, SMALL_STEP)
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


def solve_resting(case: Case, resting: Resting, solver: str) -> Solved | None:
    """Solve ``case`` accurately from a chain at rest; None where what comes out is not its shape."""
    chain = resting.chain
    boundary = dataclasses.replace(chain.boundary, gap=case.boundary.gap)  # with the signs of its quaternions
    case = dataclasses.replace(case, boundary=boundary)
    still = dataclasses.replace(boundary, start_moment=np.zeros(3), end_moment=np.zeros(3))
    without_moments = dataclasses.replace(case, boundary=still)
    force = chain.force(resting.multipliers) + case.load
    fitted = _solving_mesh(resting)
    count = len(fitted) - 1
    for finer in REFINEMENTS:
        elements = next((n for n in ELEMENTS if n >= finer * count), None)
        if elements is None:
            return None
        mesh = np.interp(np.linspace(0.0, count, elements + 1), np.arange(count + 1.0), fitted)
        q, omega = chain.sample(resting.q, stations(mesh, STAGES))
        moment = rotations.rotate(q, case.section.stiffness * (omega - case.section.rest_curvature))
        x = pack(q, moment, force, STAGES)
        solved = solve_on(without_moments, mesh, x, solver, SOLVE_ITERATIONS)
        if not solved.ok or solved.turned or not error_estimate(solved)[0] < RESOLVED:
            continue
        slid = solved.solution.factor is None  # along a valley: no step of the last iterations was Newton's own
        if slid or turning(solved.rod.sample(chain.nodes).q, resting.q) < FAITHFUL:
            break
    else:
        return None
    if np.any(boundary.start_moment) or np.any(boundary.end_moment):
        solved, reached = follow(lambda t: without_moments.blend(case, t), solved, 0.0, 1.0, solver)
        if reached < 1.0:
            return None
    return solved
