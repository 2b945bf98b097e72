"""Finding a first shape: relaxed on a coarse chain from a length-true curve, then solved accurately.

The chain goes to a minimum of its energy, so what it leads to is stable; where it fails, an easier case (lighter,
slacker, more even stiffness) is relaxed and followed to the one asked for. The same descent shows where a cable
lands that has lost its shape.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from . import rotations
from .boundary import Boundary, Case
from .continuation import ELEMENTS, STAGES, STEP_ITERATIONS, Solved, error_estimate, follow, solve_on, turning
from .rod import Section
from .rotations import Array
from .shape import Rod
from .stability import lowest_mode, stability, wave_numbers
from .starting_curve import starting_curve
from .transcriptions import chain
from .transcriptions.collocation import pack, stations

Descent = Callable[[Section, Array, Boundary, Array, Array], chain.ChainState | None]

NUDGES = (
    0.05,
    0.2,
    0.6,
)  # rad, largest turning of a section, to leave a saddle of the energy or a minimum just lost
RESOLVED = 0.02  # estimated error, in L, above which a solve on a coarse mesh is not taken for a shape of the cable
THOROUGH = 2  # starting curves from which easier cases are followed; an impossible pose costs most of its time there
CHAINS = (chain.SEGMENTS, 2 * chain.SEGMENTS, 4 * chain.SEGMENTS)  # segments on offer for a descent
PIECES_A_RADIAN = 1.0  # segments that a lost cable starts down with, in a radian of what may vary along it
FINE = 96  # segments of the chain that a lost cable sinks with in the end
FAITHFUL = 0.5  # rad, turning up to which a solved shape is that of a fine chain
DESCENTS = 4  # one after the other, from saddle to saddle
NEAR = 0.05  # rad, turning up to which a descent has come back to the shape that it began at
LEAN = 1.6  # rad, largest turning of a section for which a shape counts as the old one leaning over


def _from_chain(case: Case, state: chain.ChainState, mesh: Array) -> Array:
    """Return the unknowns on ``mesh`` that describe a chain."""
    s, nodes = stations(mesh, STAGES), np.linspace(0.0, 1.0, len(state.q))
    q = rotations.normalise(np.stack([np.interp(s, nodes, state.q[:, i]) for i in range(4)], axis=1))
    middles = 0.5 * (nodes[1:] + nodes[:-1])
    strain = (
        np.stack([np.interp(s, middles, state.omega[:, i]) for i in range(3)], axis=1) - case.section.rest_curvature
    )
    return pack(q, rotations.rotate(q, case.section.stiffness * strain), state.force, STAGES)


def _relaxed(case: Case, q: Array, r: Array, solver: str, descent: Descent = chain.relax) -> Solved | None:
    """Relax a shape on the chain by ``descent`` and solve it; None where either fails.

    A fine chain is as good as right, so what is solved from it has to be near it.
    """
    state = descent(case.section, case.load, case.boundary, q, r)
    if state is None:
        return None
    nodes = np.linspace(0.0, 1.0, len(state.q))
    faithful = FAITHFUL if len(state.q) > FINE else np.inf
    still = dataclasses.replace(case.boundary, start_moment=np.zeros(3), end_moment=np.zeros(3))
    without_moments = dataclasses.replace(case, boundary=still)
    first = ELEMENTS[0]
    for elements, method in (
        (first, solver),
        (2 * first, solver),
        (2 * first, "levenberg-marquardt"),
        (4 * first, solver),
    ):
        mesh = np.linspace(0.0, 1.0, elements + 1)
        solved = solve_on(without_moments, mesh, _from_chain(without_moments, state, mesh), method)
        if not solved.ok or solved.turned or error_estimate(solved)[0] >= RESOLVED:
            continue
        if turning(solved.rod.sample(nodes).q, state.q) < faithful:
            break
    else:
        return None
    if np.any(case.boundary.start_moment) or np.any(case.boundary.end_moment):
        solved, reached = follow(lambda t: without_moments.blend(case, t), solved, 0.0, 1.0, solver)
        if reached < 1.0:
            return None
    return solved


def _sink_fine(section: Section, load: Array, boundary: Boundary, q: Array, r: Array) -> chain.ChainState | None:
    """Let a fine chain sink, as :func:`chain.settle`: its valleys are those of the cable to a per mille."""
    nodes, fine = np.linspace(0.0, 1.0, len(q)), np.linspace(0.0, 1.0, max(FINE, 2 * (len(q) - 1)) + 1)
    q, r = (np.stack([np.interp(fine, nodes, column) for column in field.T], axis=1) for field in (q, r))
    return chain.settle(section, load, boundary, rotations.normalise(q), r)


def let_go(case: Case, rod: Rod, solver: str, *, gently: bool = True) -> Solved | None:
    """Let the cable go from ``rod`` to a stable shape nearby of less energy; None where none is found.

    ``case`` may differ from what ``rod`` was solved for: after a fold the old shape does not exist any more. The
    shape is nudged along its weakest direction. What lies close by, where the old shape only leans over, is found by
    solving from there; what lies further down by a descent on the coarse chain.

    Args:
        case: what holds the cable now.
        rod: its last shape.
        solver: name.
        gently: run down the energy's own valley first, as a real cable does; else jump where that is faster.
    """
    gentle = ((chain.settle, NUDGES[1:]), (_sink_fine, NUDGES[1:2]), (chain.relax, NUDGES))
    for descent, nudges in gentle if gently else ((chain.relax, NUDGES), (chain.settle, NUDGES)):
        here = rod
        for _ in range(DESCENTS):
            direction = lowest_mode(here, case.boundary.kind)
            near = _lean(case, here, direction, solver) if gently or here is not rod else None
            if near is not None:
                return near
            landed = _down(case, here, direction, solver, descent, nudges)
            if landed is None:
                break
            if is_stable(landed):
                return landed
            here = landed.rod  # a saddle on the way down, or a place where only the coarse chain rests
    return None


def _down(
    case: Case, rod: Rod, direction: Array, solver: str, descent: Descent, nudges: Sequence[float]
) -> Solved | None:
    """Return where the first descent from ``rod`` ends that does not come back to it; None where all do."""
    for nudge in nudges:
        for sign in (1.0, -1.0):
            landed = _descend(case, rod, sign * nudge * direction, solver, descent)
            if landed is not None and turning(landed.rod.sample(rod.mesh).q, rod.q) > NEAR:
                return landed
    return None


def is_stable(solved: Solved) -> bool:
    """Return whether a solved shape has no unstable direction."""
    return bool(stability(solved.rod, solved.case.boundary.kind).stable)


def _lean(case: Case, rod: Rod, direction: Array, solver: str) -> Solved | None:
    """Solve from ``rod`` nudged along ``direction`` (n + 1, 3), in its section frames at the nodes.

    None where that leads to no stable shape nearby: the way over a fork, of which one arm is stable.
    """
    s = stations(rod.mesh, STAGES)
    samples, field = rod.sample(s), CubicSpline(rod.mesh, direction, axis=0)
    for nudge in NUDGES:
        for sign in (1.0, -1.0):
            turn, rate = sign * nudge * field(s), sign * nudge * field(s, 1)
            q = rotations.multiply(samples.q, rotations.from_rotation_vector(turn))
            strain = samples.omega + rate + rotations.cross(samples.omega, turn) - case.section.rest_curvature
            moment = rotations.rotate(q, case.section.stiffness * strain)
            solved = solve_on(case, rod.mesh, pack(q, moment, rod.force[0], STAGES), solver, STEP_ITERATIONS)
            if not solved.ok or solved.turned or error_estimate(solved)[0] > RESOLVED:
                continue
            if turning(solved.rod.q, rod.q) <= LEAN and is_stable(solved):
                return solved
    return None


def _descend(case: Case, rod: Rod, field: Array, solver: str, descent: Descent) -> Solved | None:
    """Go down from ``rod`` turned by ``field`` (n + 1, 3), in its section frames at the nodes, rad; None if in vain."""
    pieces = PIECES_A_RADIAN * float(np.max(wave_numbers(rod.force, rod.moment, rod.section.stiffness)))
    nodes = np.linspace(0.0, 1.0, next((n for n in CHAINS if n >= pieces), CHAINS[-1]) + 1)
    samples = rod.sample(nodes)
    field = np.stack([np.interp(nodes, rod.mesh, field[:, i]) for i in range(3)], axis=1)
    q = rotations.multiply(samples.q, rotations.from_rotation_vector(field))
    return _relaxed(case, q, samples.r, solver, descent)


def stabilise(solved: Solved, solver: str) -> Solved:
    """Return a stable shape of less energy than an unstable one, or ``solved`` itself where none is found.

    None is looked for where a dead moment acts: it has no energy to descend, and often no stable shape at all.
    """
    boundary = solved.case.boundary
    if is_stable(solved) or np.any(boundary.start_moment) or np.any(boundary.end_moment):
        return solved
    return let_go(solved.case, solved.rod, solver, gently=False) or solved


def _easier(case: Case) -> list[Case]:
    """Return cases that a chain relaxes without trouble, the nearest to ``case`` first."""
    heavy = float(np.linalg.norm(case.load))
    light = case.load if heavy <= 300.0 else case.load * (100.0 / heavy)
    stiffness = np.clip(case.section.stiffness, 0.1, 10.0)
    slack = dataclasses.replace(case.boundary, gap=0.9 * case.boundary.gap)
    return [
        Case(case.section, light, case.boundary),
        Case(case.section, light, slack),
        Case(Section(stiffness, case.section.rest_curvature), light, slack),
        Case(Section(stiffness, case.section.rest_curvature), np.zeros(3) * light, slack),
    ]


def _bows(case: Case, bow: Array | None) -> list[Array | None]:
    """Return directions to bow a starting curve to, the one wished for first.

    A curve bowed against its own clamps, in a plane of symmetry, can lead the chain to a saddle; another bow does not.
    """
    first = case.load if bow is None and np.any(case.load) else bow
    aside = np.roll(np.array([1.0, 2.0, 3.0]), 1)  # in no plane that a scene is likely to be symmetric about
    return [first, None, aside, -aside]


def from_curve(case: Case, turns: int, bow: Array | None, solver: str, *, thorough: bool) -> Solved | None:
    """Find a shape from the starting curve bowed to ``bow``; None where nothing worked.

    Args:
        case, turns, bow, solver: as in :func:`cold_start`.
        thorough: follow easier cases to the one asked for where it cannot be solved at once.
    """
    r, q = starting_curve(case.boundary, chain.SEGMENTS + 1, turns, bow)
    boundary = case.boundary
    if boundary.kind.end_orientation:  # the curve decides which of the two signs stands for the turns asked for
        sign = 1.0 if q[-1] @ boundary.end_quaternion >= 0 else -1.0
        boundary = dataclasses.replace(boundary, end_quaternion=sign * boundary.end_quaternion)
    case = dataclasses.replace(case, boundary=boundary)
    found = _relaxed(case, q, r, solver)
    if found is not None or not thorough:
        return found
    for easier in _easier(case):
        begin = _relaxed(easier, q, r, solver)
        if begin is None:
            continue
        end, reached = follow(functools.partial(easier.blend, case), begin, 0.0, 1.0, solver)
        if reached == 1.0:
            return end
    return None


def cold_start(case: Case, turns: int, bow: Array | None, solver: str) -> Solved | None:
    """Find a shape for ``case`` from its ends alone: a stable one where any is found, None where nothing worked.

    Args:
        case: what to solve.
        turns: whole turns added to the smallest twist that joins the clamps along the starting curve.
        bow: direction to which that curve is bowed; None takes the load's, then others where that fails.
        solver: name.
    """
    unstable = None
    for k, wish in enumerate(_bows(case, bow)):
        found = from_curve(case, turns, wish, solver, thorough=k < THOROUGH)
        if found is None:
            continue
        settled = stabilise(found, solver)
        if is_stable(settled):
            return settled
        unstable = unstable or settled
    return unstable
