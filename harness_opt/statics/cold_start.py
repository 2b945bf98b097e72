"""Finding a first shape: the energy is minimised from a length-true curve, and its minimum solved accurately.

What is solved from an energy minimum is stable. The same minimisation finds the new shape of a cable that has lost its
own (:mod:`harness_opt.statics.release`).
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.rod.boundary import Case
from harness_opt.rod.collocation import pack, stations
from harness_opt.rod.link import keeps_turns, links_of, links_of_curve, turns_lost
from harness_opt.rod.states import Rod
from harness_opt.statics.curls import minimum_with_curls
from harness_opt.statics.energy_minimum import COILED, LITTLE_WORK, TWISTED, WORK, EnergyMinimum, minimise_energy
from harness_opt.statics.from_minimum import solve_from_minimum
from harness_opt.statics.load_stepping import softened, stiffen, tighten
from harness_opt.statics.release import stabilised
from harness_opt.statics.solve import STAGES, Solved, solve_on
from harness_opt.statics.starting_curve import EASY_SLACK, curve, loose, signed


def _bows(case: Case, bow: Array | None) -> Sequence[Array | None]:
    """Return directions to bow a starting curve to, the one wished for first.

    A curve bowed against its own clamps, in a plane of symmetry, can lead to a saddle; another bow does not.
    """
    first = case.load if bow is None and np.any(case.load) else bow
    aside = np.roll(np.array([1.0, 2.0, 3.0]), 1)  # in no plane that a scene is likely to be symmetric about
    return first, None, aside, -aside


def from_curve(case: Case, turns: int, bow: Array | None, solver: str) -> Iterator[Solved]:
    """Yield shapes from the starting curve bowed to ``bow``, one for each way that leads to one, mostly a single one.

    Of a taut cable, three ways are tried: minimised as it is, which does where its clamps point along it, or its clamp
    layers are long enough for a curve through the ends; begun slack and soft in torsion, tightened while the turns are
    nothing but twist, and stiffened; begun slack, stiffened until the turns have made loops, and tightened.

    Args:
        case, turns, bow, solver: as in :func:`cold_start`.
    """
    straight_slack = 1e-8  # slack below which a cable is taken for straight
    begun, s, q = curve(case, case.boundary, turns, bow)
    taut = _is_taut(case)
    if taut and 1.0 - float(np.linalg.norm(case.boundary.gap)) <= straight_slack:
        yield from _some(_straight(begun, s, q, solver))
        return
    yield from _some(_minimised(begun, s, q, solver, LITTLE_WORK if taut else WORK))
    if taut:
        for coiled in (TWISTED, COILED):
            yield from _some(_tightened(case, turns, bow, coiled, solver))


def _is_taut(case: Case) -> bool:
    kind = case.boundary.kind
    slack = 1.0 - float(np.linalg.norm(case.boundary.gap))
    return kind.start_position and kind.end_position and slack < EASY_SLACK


def _minimised(begun: Case, s: Array, q: Array, solver: str, work: int) -> Solved | None:
    """Solve the energy minimum that a curve with frames (m, 4) at ``s`` (m,) leads to; None where none is reached.

    Args:
        begun: with the signs of the curve's quaternions.
        s, q, solver: as above.
        work: elements times steps that it may take.
    """
    minimum = minimise_energy(softened(begun, s, q, COILED), s, q, np.zeros(3), short_steps=False, work=work)
    if minimum is not None:
        minimum = stiffen(begun, minimum, work, shorten_steps=not _is_taut(begun))
    return _solved(begun, minimum, solver)


def _from_curls(case: Case, turns: int, bow: Array | None, solver: str) -> Iterator[Solved]:
    """Yield a shape begun with a curl for each turn (:mod:`.curls`), of a cable that has to begin soft in torsion.

    Args:
        case, turns, bow, solver: as in :func:`cold_start`.
    """
    begun, s, q = curve(case, loose(case.boundary), turns, bow)
    if softened(begun, s, q, COILED) is not begun:
        yield from _some(_solved(case, minimum_with_curls(case, turns, bow), solver))


def _some(found: Solved | None) -> Iterator[Solved]:
    if found is not None:
        yield found


def _tightened(case: Case, turns: int, bow: Array | None, coiled: float, solver: str) -> Solved | None:
    """Find a shape from a curve between nearer ends; stiffened before it is tightened where it may have loops.

    Args:
        case, turns, bow, solver: as in :func:`cold_start`.
        coiled: as in :func:`softened`.
    """
    begun, s, q = curve(case, loose(case.boundary), turns, bow)
    case = dataclasses.replace(case, boundary=signed(case.boundary, q))
    soft = softened(begun, s, q, coiled)
    minimum = minimise_energy(soft, s, q, np.zeros(3), short_steps=False)
    if minimum is not None and coiled >= COILED:
        soft, minimum = begun, stiffen(begun, minimum)
    if minimum is not None:
        minimum = tighten(dataclasses.replace(case, section=soft.section), minimum)
    if minimum is not None:
        minimum = stiffen(case, minimum, LITTLE_WORK)
    return _solved(case, minimum, solver)


def _solved(case: Case, minimum: EnergyMinimum | None, solver: str) -> Solved | None:
    return None if minimum is None else solve_from_minimum(case, minimum, solver)


def _straight(case: Case, s: Array, q: Array, solver: str) -> Solved | None:
    """Solve a cable stretched straight between its ends, whose tension is anything; None where its clamps bend it."""
    mesh = np.linspace(0.0, 1.0, 9)
    places = stations(mesh, STAGES)
    frames = rotations.normalise(np.stack([np.interp(places, s, column) for column in q.T], axis=1))
    omega = np.zeros((len(places), 3))
    omega[:, 2] = rotations.rotation_vector(rotations.multiply(rotations.conjugate(q[0]), q[-1]))[2]
    moment = rotations.rotate(frames, case.section.stiffness * (omega - case.section.rest_curvature))
    solved = solve_on(case, mesh, pack(frames, moment, np.zeros(3), STAGES), solver)
    return solved if solved.ok and not solved.turned else None


@dataclass(frozen=True)
class Wound:
    """A curve with frames to begin with, that has the turns asked for: stations (m,), frames (m, 4), points (m, 3)."""

    s: Array
    q: Array
    r: Array

    @functools.cached_property
    def links(self) -> Array:
        """What :func:`harness_opt.rod.link.links` says of it."""
        return links_of_curve(self.s, self.q, self.r)


def wound_curve(case: Case, turns: int, bow: Array | None) -> Wound:
    """Return the curve that :func:`cold_start` begins with."""
    _, s, q = curve(case, case.boundary, turns, bow)
    steps = np.diff(s)[:, None] * 0.5 * (rotations.tangent(q[1:]) + rotations.tangent(q[:-1]))
    return Wound(s, q, np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)]))


def _starts(
    case: Case, turns: int, bow: Array | None, solver: str, wound: Wound | None
) -> Iterator[tuple[Wound, Solved]]:
    """Yield shapes from curves with different bows, then from curls, and before each a curve that has its turns.

    Arguments as of :func:`cold_start`.
    """
    same_frames = 1e-6  # of quaternions: curves that no bow makes different, where clamps leave no length for it

    def frames(wish: Array | None) -> Array:
        return curve(case, loose(case.boundary), turns, wish)[2]

    tried = list[Array | None]()
    if wound is not None:
        boundary = signed(case.signed_like(wound.q[0], wound.q[-1]).boundary, wound.q)
        begun = dataclasses.replace(case, boundary=boundary)
        work = LITTLE_WORK if _is_taut(case) else WORK
        yield from ((wound, one) for one in _some(_minimised(begun, wound.s, wound.q, solver, work)))
    for wish in _bows(case, bow):
        if any(np.allclose(frames(wish), frames(other), rtol=0.0, atol=same_frames) for other in tried):
            continue
        tried.append(wish)
        own = whole_turns(case, wish, wound) if wound is not None else turns
        asked = wound_curve(case, own, wish)
        yield from ((asked, one) for one in from_curve(case, own, wish, solver))
    own = whole_turns(case, tried[0], wound) if wound is not None else turns
    asked = wound_curve(case, own, tried[0])
    yield from ((asked, one) for one in _from_curls(case, own, tried[0], solver))


def whole_turns(case: Case, bow: Array | None, wound: Wound) -> int:
    """Return the whole turns with which the curve bowed to ``bow`` is wound as ``wound`` is."""
    return round(float(wound.links[0] - wound_curve(case, 0, bow).links[0]))


def cold_start(case: Case, turns: int, bow: Array | None, solver: str, wound: Wound | None = None) -> Solved | None:
    """Find a shape for ``case`` from its ends alone: a stable one where any is found, None where nothing worked.

    It has the turns that it was begun with; one that got rid of some by going through itself comes back only where
    there is no other, and says so.

    Args:
        case: what to solve.
        turns: whole turns added to the smallest twist that joins the clamps along the starting curve.
        bow: direction to which that curve is bowed; None takes the load's, then others where that fails.
        solver: name.
        wound: a curve to begin with that has the turns asked for, in place of ``turns``.
    """
    unstable = lost = None
    changes = list[int]()
    for asked, found in _starts(case, turns, bow, solver, wound):
        stable = stabilised(found, solver)
        change = lost_turns(case, asked, (stable or found).rod)
        if change:
            changes.append(change)
            lost = lost or dataclasses.replace(stable or found, passed=True)
        elif stable is not None:
            return stable
        else:
            unstable = unstable or found
    won_back = _won_back(case, turns, bow, solver, wound, changes[0]) if changes else None
    return won_back or lost or unstable


def lost_turns(case: Case, asked: Wound, rod: Rod) -> int:
    """Return by how many turns a shape differs from a curve that has those asked for; 0 where turns come and go."""
    return turns_lost(case.boundary.kind, asked.links, links_of(rod)) if keeps_turns(case.boundary.kind) else 0


def _won_back(
    case: Case, turns: int, bow: Array | None, solver: str, wound: Wound | None, change: int
) -> Solved | None:
    """Return a stable shape with the turns asked for, begun with as many more as were lost; None where they go again.

    A cable soft in torsion loses them where its starting curve is thrown over on the way, and has room for others.

    Args:
        case, turns, bow, solver, wound: as in :func:`cold_start`.
        change: what :func:`harness_opt.rod.link.turns_lost` says of the first shape.
    """
    wish = next(iter(_bows(case, bow)))
    own = turns if wound is None else whole_turns(case, wish, wound)
    asked = wound_curve(case, own, wish)
    for found in from_curve(case, own - change, wish, solver):
        stable = stabilised(found, solver)
        if stable is not None and not lost_turns(case, asked, stable.rod):
            return stable
    return None
