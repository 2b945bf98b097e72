"""Several shapes for one pose: what else the cable might hang like between the same two clamps."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from harness_opt.errors import ProblemError
from harness_opt.model import checks
from harness_opt.model.cable import Cable, CableRun
from harness_opt.model.ends import End
from harness_opt.model.results import STATIONS
from harness_opt.numerics.rotations import Array, cross, normalise
from harness_opt.numerics.threads import one_thread
from harness_opt.rod.boundary import HELD, Case
from harness_opt.rod.methods import check_method
from harness_opt.statics.cold_start import from_curve, lost_turns, whole_turns, wound_curve
from harness_opt.statics.equilibrium import SHAPE_TOLERANCE, Shape, refined_shape
from harness_opt.statics.fitting import posed_run
from harness_opt.statics.release import stabilised
from harness_opt.statics.solve import Solved

BOWS = 8  # directions about the chord to which starting curves bow
EXTRA_TURNS = (-1, 0, 1)
MOST_STARTS = 10_000
SAME_PLACE = 1e-4  # in lengths of the cable: centrelines this close are one shape


@one_thread
def equilibria(
    cable: Cable,
    start: End,
    end: End,
    gravity: ArrayLike = (0.0, 0.0, 0.0),
    *,
    bows: int = BOWS,
    turns: Iterable[int] = EXTRA_TURNS,
    solver: str = "gauss-newton",
    tolerance: float = SHAPE_TOLERANCE,
    stations: int = STATIONS,
) -> tuple[Shape, ...]:
    """Return the distinct stable shapes found between two ends in world coordinates, that of least energy first.

    Each start is a curve of the cable's length, bowed to one of several directions about the chord and twisted by one
    of several numbers of turns; its energy is minimised, and the minimum solved. A search, so there may be
    shapes that it does not find; none that it returns is unstable, or an image of another in a neutral family. One of
    them can begin a motion: ``simulate(problem, first={"lead": shape})``.

    Args:
        cable, start, end, gravity, solver, tolerance, stations: as in :func:`harness_opt.equilibrium`.
        bows: number of directions.
        turns: whole turns of twist tried, on top of ``end.turns``; of use only where both ends are clamped or guided.

    Raises:
        ProblemError: as :func:`harness_opt.equilibrium`; no start, or more than MOST_STARTS.
    """
    check_method("collocation", solver)
    tolerance = checks.positive("tolerance", tolerance)
    sought = posed_run(CableRun(cable, start, end), np.asarray(checks.numbers("gravity", gravity, 3)), solver)
    posed, kind = sought.case, sought.case.boundary.kind
    twists = sorted(set(turns)) if kind.start_held == kind.end_held == HELD else [0]
    if not (isinstance(bows, int) and 0 < bows * len(twists) <= MOST_STARTS):
        raise ProblemError(
            f"bows, turns: found {bows!r} times {len(twists)} starts, expected at least one and at most {MOST_STARTS}"
        )
    found: list[Shape] = []
    wound = None if sought.fitted is None else sought.fitted.wound()
    for twist in twists:
        for bow in _directions(posed.boundary.gap, bows):
            own = int(sought.ends[1].turns) if wound is None else whole_turns(posed, bow, wound)
            stable = _stable_from(posed, own + twist, bow, solver)
            if stable is None:
                continue
            shape = refined_shape(cable, sought.ends, stable, tolerance, solver, stations)
            if shape.ok and shape.stable and not any(_same(shape, other) for other in found):
                found.append(shape)
    return tuple(sorted(found, key=lambda shape: shape.energy))


def _stable_from(posed: Case, turns: int, bow: Array, solver: str) -> Solved | None:
    """Return the first stable shape from a curve that has kept its turns; None where there is none."""
    asked = wound_curve(posed, turns, bow)
    for start in from_curve(posed, turns, bow, solver):
        stable = stabilised(start, solver)
        if stable is not None and not lost_turns(posed, asked, stable.rod):
            return stable
    return None


def _directions(gap: Array, count: int) -> Array:
    """Return ``count`` directions (count, 3) evenly about the chord ``gap`` (3,), or about the vertical without one."""
    axis = normalise(gap) if np.linalg.norm(gap) > SAME_PLACE else np.array([0.0, 0.0, 1.0])
    across = normalise(cross(axis, np.eye(3)[np.argmin(np.abs(axis))]))
    angle = 2.0 * np.pi * np.arange(count)[:, None] / count
    return np.asarray(np.cos(angle) * across + np.sin(angle) * cross(axis, across))


def _same(a: Shape, b: Shape) -> bool:
    """Return whether two shapes of one pose are the same, or of one neutral family.

    A family is one shape turned about an axis: energy and twist are those of all its members, but not of their mirror
    images.
    """
    neutral_margin = 1e-3  # stability margin of a neutral family at most, in the largest load on the cable
    same_twist = 1e-3  # rad over the cable
    same_energy = 1e-6  # relative: neutral shapes of one energy are one family
    length = float(a.s[-1])
    if np.max(np.linalg.norm(a.position - b.position, axis=1)) < SAME_PLACE * length:
        return True
    neutral = all(
        abs(shape.stability_margin) < neutral_margin * (1.0 + float(np.max(np.abs(shape.rod.force))))
        for shape in (a, b)
    )
    twisted = float(np.max(np.abs(a.curvature[:, 2] - b.curvature[:, 2]))) * length
    near = abs(a.energy - b.energy) < same_energy * max(abs(a.energy), abs(b.energy))
    return neutral and near and twisted < same_twist
