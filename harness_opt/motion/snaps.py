"""Where a cable loses its shape, and which one it takes then: snap-through, and what only looks like it.

The place of the loss is found by bisection, the cable released there, and its new shape followed on: so the outcome
does not depend on where the frames are.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from harness_opt.motion.cases import CableCases
from harness_opt.rod.link import links_of, turns_lost
from harness_opt.statics.continuation import turning
from harness_opt.statics.mesh import refine
from harness_opt.statics.release import is_stable, release
from harness_opt.statics.solve import Solved

PLACE_TOLERANCE = 2.0**-13  # of the motion: how closely the place is found where a shape is lost


@dataclass(frozen=True)
class Recovery:
    """How a cable went on after it had lost its shape.

    Args:
        solved: its shape at the frame that was sought; None where it could not be found.
        snaps: motion value of each jump on the way, and whether the cable goes through itself there.
        first: the shape that the first frame has to have for it, where that one may turn freely; else None.
    """

    solved: Solved | None
    snaps: tuple[tuple[float, bool], ...]
    first: Solved | None


def recover(cases: CableCases, here: Solved, at: float, target: float, *, is_first: bool) -> Recovery:
    """Find where a shape is lost on its way, release the cable there, and follow its new shape to the end of the way.

    A cable that jumps there snaps; one that starts to lean out of its old shape there does not.

    Args:
        cases: of the cable.
        here: its last frame before the loss.
        at, target: motion values of that frame and of the next one.
        is_first: whether ``here`` is the first frame of the motion: one that may turn freely is turned, not left by a
            snap.
    """
    most_losses = 8  # between two frames
    jump = 0.2  # rad, largest turning of a section at the place of a loss above which it is a snap
    first, start, turned = here, at, None
    snaps = list[tuple[float, bool]]()
    for _ in range(most_losses):
        here, at, beyond = _last_stable(cases, here, at, target)
        released, where = _released(cases, here, beyond, target)
        if released is None:
            break
        if turning(released.rod.sample(here.rod.mesh).q, here.rod.q) > jump:
            member = _turned_first(cases, (turned or first, start), released, where) if is_first else None
            if member is None:
                snaps.append((beyond, _passes(here, released)))
            else:
                turned = member
        solved, reached = cases.follow(released, where, target)
        if reached == target and is_stable(solved, cases.solver):
            return Recovery(solved, tuple(snaps), turned)
        here, at = released, where
    return Recovery(None, tuple(snaps), turned)


def first_shape(cases: CableCases, at: float) -> Solved | None:
    """Return the shape at motion value ``at`` that a motion begins with; None where none is found.

    A cable that was fitted somewhere is moved from there, over snaps if need be.
    """
    if cases.unfitted:
        return None
    if cases.fitted is None:
        return cases.from_ends(at)
    fitted_at, begun = cases.run.fitted_at, cases.as_fitted()
    if begun is None or at == fitted_at:
        return begun
    there, reached = cases.follow(begun, fitted_at, at)
    if reached == at and is_stable(there, cases.solver):
        return dataclasses.replace(there, passed=begun.passed)
    found = recover(cases, begun, fitted_at, at, is_first=False)
    passed = begun.passed or any(passes for _, passes in found.snaps)
    return None if found.solved is None else dataclasses.replace(found.solved, passed=passed)


def _passes(before: Solved, after: Solved) -> bool:
    """Whether the turns of a shape are not those of the one before: the cable would have to go through itself."""
    return bool(turns_lost(after.case.boundary.kind, links_of(before.rod), links_of(after.rod)))


def _last_stable(cases: CableCases, here: Solved, at: float, target: float) -> tuple[Solved, float, float]:
    """Return the last stable shape on the way from ``here`` to ``target``, its motion value, and one beyond."""
    smallest = 0.2  # part of the way, smallest step in this search: it halves the way itself
    beyond = target
    while True:
        while abs(beyond - at) > PLACE_TOLERANCE:
            middle = 0.5 * (at + beyond)
            solved, reached = cases.follow(here, at, middle, smallest)
            if reached == middle and is_stable(solved, cases.solver):
                here, at = solved, middle
            else:
                beyond = middle
        # those steps may only have been too long: with short ones the shape is lost here, or goes on
        solved, reached = cases.follow(here, at, beyond)
        if beyond == target or reached != beyond or not is_stable(solved, cases.solver):
            return here, at, beyond
        here, at, beyond = solved, beyond, target


def _released(cases: CableCases, here: Solved, beyond: float, target: float) -> tuple[Solved | None, float]:
    """Release the cable at ``beyond``, or further on where no shape is found; return the new shape, and where."""
    later = 4  # times further on that it is tried
    accurate = 1e-5  # estimated error, in L, of a shape that is taken: a coarse mesh has shapes that no cable has
    for wait in np.linspace(0.0, 1.0, later + 1) ** 2:
        where = beyond + float(wait) * (target - beyond)
        released = release(cases.path(here.case)(where), here.rod, cases.solver)
        if released is not None:
            released, _, status = refine(released, accurate, cases.solver)
            if status.ok and is_stable(released, cases.solver):
                return released, where
        if beyond == target:
            break
    return None, beyond


def _turned_first(cases: CableCases, first: tuple[Solved, float], released: Solved, where: float) -> Solved | None:
    """Return the member of the first shape's neutral family that leads to ``released``; None where there is none.

    Coaxial clamps and no weight leave the first shape undetermined up to a rotation; the next pose determines it. Where
    the way back from ``released`` ends in another shape, the jump is a snap.

    Args:
        cases: of the cable.
        first: the first shape, and its motion value.
        released, where: the shape after the jump, and its motion value.
    """
    same_energy = 1e-6  # relative difference below which two shapes of one pose are of one neutral family
    solved, start = first
    turned, reached = cases.follow(released, where, start)
    energy = float(solved.rod.energy())
    if reached != start or abs(float(turned.rod.energy()) - energy) > same_energy * (1.0 + abs(energy)):
        return None
    return turned
