"""How far every quantity of a problem moves its limits: the derivatives of margins by any key of the file.

The discretised equations R(x, p) = 0 of every frame hold whatever p stands for, so dx = -J^-1 R_p dp with the Jacobian
that the solve factorised (Griewank and Walther, "Evaluating Derivatives", section 15). R_p dp is the difference of R at
fixed x between the problem with the key a little more and a little less: R is a closed form of stiffness, load and
clamps, so that costs two evaluations a frame and no digit that matters. What is nearest on a part moves with the part.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness_opt.clearance.measure import measure
from harness_opt.clearance.pairs import ClearanceResult, PairClearance, of_whole_cables
from harness_opt.clearance.what_counts import arc_apart, let_off_rate
from harness_opt.clearance.witnesses import Witnesses
from harness_opt.design.margins import Passing, at_stations, linearised, second_order
from harness_opt.errors import ProblemError, SolveError
from harness_opt.files.quantities import Quantities
from harness_opt.files.quantity_keys import Quantity, differentiable
from harness_opt.harness.freedoms import harnesses
from harness_opt.model.limits import LimitId
from harness_opt.model.problem import Problem
from harness_opt.model.results import CableMotion, Motion, joined
from harness_opt.model.spans import carried, has_clips, in_spans, spans_of, whole
from harness_opt.motion.cases import CableCases
from harness_opt.motion.path import place_frames
from harness_opt.motion.shape_rates import ShapeRates
from harness_opt.motion.simulate import collect
from harness_opt.motion.sweep import Sweep, cable_motion, in_turn, start_positions, sweep
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.threads import one_thread
from harness_opt.parts.scene import Scene
from harness_opt.rod.boundary import Case, case
from harness_opt.rod.collocation import BoundCollocation, collocation
from harness_opt.rod.equations import scale

STEP = 1e-5  # of a key, in its own scale: turns no section by more than that, and leaves eleven digits of a difference
SOLVER = "gauss-newton"  # of rolls that are found anew
AT = 1e-6  # of the length: a place that close to the end of a stretch is that end


@dataclass(frozen=True)
class Linear:
    """Margins of a problem, and how they change with k quantities: a row for each limit, frame and place.

    Args:
        quantities: the k quantities.
        margin: (m,), a share of the limit as in :mod:`harness_opt.design.margins`; >= 0 holds.
        rate: (m, k), per unit of each key.
        limit: (m,), which of ``limits`` a row is of.
        limits: that the rows are of.
        scales: what a margin of each limit is multiplied by to be in metres or as the limit is.
        motion: what was simulated.
        clearances: of its frames.
        second: (m, k, k), second derivatives where a cable passes a part: of the distance, not of the shapes.
    """

    quantities: tuple[Quantity, ...]
    margin: Array
    rate: Array
    limit: Array
    limits: tuple[LimitId, ...]
    scales: Array
    motion: Motion
    clearances: ClearanceResult
    second: Array

    def worst(self, limit: LimitId) -> int:
        """Return the row with the smallest margin of ``limit``."""
        rows = np.flatnonzero(self.limit == self.limits.index(limit))
        return int(rows[np.argmin(self.margin[rows])])


@dataclass(frozen=True)
class _Sides:
    """The problem with one key a little more and a little less, and half the difference of the key."""

    more: Problem
    less: Problem
    step: float


@one_thread
def linear(quantities: Quantities, keys: Sequence[str], scene: Scene, motion: Array | None = None) -> Linear:
    """Return the margins of a problem, linearised in the quantities ``keys``.

    Args:
        quantities: of the problem.
        keys: of those to differentiate by.
        scene: the problem's parts.
        motion: values (P,) of the frames; None takes the problem's own.

    Raises:
        ProblemError: a key that no shape or place depends on smoothly.
        SolveError: the problem cannot be simulated.
    """
    chosen = tuple(quantities[key] for key in keys)
    whole_problem = quantities.problem({})
    if harnesses(in_spans(whole_problem), whole_problem):
        words = "expected none where keys are varied all at once: their rates are known to a redesign alone so far"
        raise ProblemError(f"bodies: found free ones, or clips that let the cable turn or slide, {words}")
    frames, spans = place_frames(whole_problem) if motion is None else motion, spans_of(whole_problem)
    swept = in_turn(
        whole_problem, frames, lambda apart, name, harness: sweep(apart, name, frames, harness=harness), SOLVER
    )
    whole_problem, problem, sweeps = swept.whole, swept.problem, swept.sweeps
    found = collect(swept, frames, 0.0)
    if not found.ok:
        raise SolveError(found.message, found.status, joined(whole_problem, found))
    sides = [_sides(quantities, quantity, whole_problem, sweeps) for quantity in chosen]
    clearances = measure(problem, scene, frames, found.cables)
    rates = {name: _shape_rates(problem, name, swept, frames, sides) for name, swept in sweeps.items()}
    looked = _Looked(found, rates, sides, scene)
    rows = [_pair_rows(pair, looked) for pair in clearances.pairs if pair.limit is not None]
    rows = [dataclasses.replace(row, limit=whole(spans, row.limit)) for row in rows]
    others = linearised(problem, found, dataclasses.replace(clearances, pairs=()), rates, _Nothing(), len(keys))
    others = others.of_whole_cables(spans)
    for limit in dict.fromkeys(limit for limit in others.limit if limit is not None):
        of = np.array([row == limit for row in others.limit])
        flat = np.zeros((np.count_nonzero(of), len(keys), len(keys)))
        scale = whole_problem.cable_limit(limit.kind, limit.cable) or 0.0
        rows.append(_Rows(limit, scale, others.margin[of], others.rate[of], flat))
    if not rows:
        raise ProblemError("limits: found none, expected at least one for a quantity to move")
    found, clearances = joined(whole_problem, found), of_whole_cables(whole_problem, clearances)
    limits = tuple(dict.fromkeys(row.limit for row in rows))
    return Linear(
        chosen,
        np.concatenate([row.margin for row in rows]),
        np.concatenate([row.rate for row in rows]),
        np.repeat([limits.index(row.limit) for row in rows], [len(row.margin) for row in rows]),
        limits,
        np.array([next(row.scale for row in rows if row.limit == limit) for limit in limits]),
        found,
        clearances,
        np.concatenate([row.second for row in rows]),
    )


class _Nothing(dict[LimitId, float]):
    """Asks for nothing beyond any limit."""

    def __missing__(self, key: LimitId) -> float:
        return 0.0


@dataclass(frozen=True)
class _Rows:
    """Rows of one limit: margins (w,) in shares of ``scale``, rates (w, k), and second derivatives (w, k, k)."""

    limit: LimitId
    scale: float
    margin: Array
    rate: Array
    second: Array


@dataclass(frozen=True)
class _Looked:
    """What was simulated: a motion, the rates of its shapes by cable, the keys on both sides, and the parts."""

    motion: Motion
    rates: Mapping[str, ShapeRates]
    sides: Sequence[_Sides]
    scene: Scene


# --- a key, a little more and less ---------------------------------------------------------------------


def _sides(quantities: Quantities, quantity: Quantity, problem: Problem, sweeps: Mapping[str, Sweep]) -> _Sides:
    """Return the problem of spans on both sides of a key; ``sweeps`` of the ``problem`` itself, by span.

    Raises:
        ProblemError: the key has no derivative.
    """
    if not differentiable(quantity):
        raise ProblemError(f"{quantity.key}: found no derivative by it, expected a number that moves a cable or a part")
    step = STEP * key_scale(quantity, problem)
    both = [quantities.problem({quantity.key: quantity.value + sign * step}) for sign in (1, -1)]
    return _Sides(_with_rolls(both[0], sweeps), _with_rolls(both[1], sweeps), step)


def _with_rolls(problem: Problem, sweeps: Mapping[str, Sweep]) -> Problem:
    """Return ``problem`` in spans, its clips in the rolls that they are fitted in; ``sweeps`` are of one nearby."""
    spans = spans_of(problem)
    apart: Problem = in_spans(problem)
    for name in spans:
        run = apart.cables[name]
        if has_clips(problem) and run.untwisted == "end":
            held = CableCases(apart, name, SOLVER, sweeps[name].fitted).problem
            frame = held.ends(name, [run.fitted_at])[0][1].quaternion
            apart = carried(apart, spans, name, run.fitted_at, np.asarray(frame))
    return apart


def key_scale(quantity: Quantity, problem: Problem) -> float:
    """Return a change of a key that would be large: what its derivative is to be smooth over."""
    length = max(run.cable.length for run in problem.cables.values())
    if quantity.unit == "deg":
        return float(np.rad2deg(1.0))
    if quantity.unit == "percent":
        return 100.0
    if quantity.path[-1] in ("position", "point", "from", "to"):
        return length
    if quantity.path[-1] == "rest_curvature":
        return 1.0 / length
    if quantity.path[-1] in ("tangent", "axis", "direction", "quaternion", "gravity", "force", "moment"):
        found: float = max(1.0, abs(quantity.value))
        return found
    return abs(quantity.value) or 1.0


# --- shapes --------------------------------------------------------------------------------------------


def _shape_rates(problem: Problem, name: str, swept: Sweep, frames: Array, sides: Sequence[_Sides]) -> ShapeRates:
    """Return the rates of the shapes of a cable at its stations of fixed s / L by every key."""
    shapes = cable_motion(swept)
    shares = shapes.s / shapes.s[-1]
    columns = [_column(name, swept, frames, side, shares) for side in sides]
    shape = (*shapes.position.shape, 0)

    def stacked(field: str) -> Array:
        return np.stack([getattr(column, field) for column in columns], axis=-1) if columns else np.zeros(shape)

    unknowns = np.zeros((len(frames), 0, len(sides)))  # of no use here
    return ShapeRates(
        stacked("position"), stacked("curvature"), stacked("force"), stacked("moment"), unknowns,
        np.array([_cable_rate(side, name, "length") for side in sides]),
    )  # fmt: skip


@dataclass(frozen=True)
class _Column:
    """Rates by one key, each (P, N, 3)."""

    position: Array
    curvature: Array
    force: Array
    moment: Array


def _column(name: str, swept: Sweep, frames: Array, side: _Sides, shares: Array) -> _Column:
    """Return the rates of the shapes of a cable by one key, at stations at ``shares`` (N,) of its length."""
    bound = [_bound(problem, name, swept, frames) for problem in (side.more, side.less)]
    shapes: list[CableMotion] = []
    changes = []
    for k, frame in enumerate(swept.frames):
        residuals = [equations[k].residual(frame.solution.x) for _, equations in bound]
        changes.append(-frame.factor.solve(0.5 * (residuals[0] - residuals[1])))
    for sign, problem, (cases, equations) in zip((1, -1), (side.more, side.less), bound, strict=True):
        moved = []
        for k, frame in enumerate(swept.frames):
            solution = dataclasses.replace(frame.solution, x=frame.solution.x + sign * changes[k])
            moved.append(dataclasses.replace(frame, case=cases[k], bound=equations[k], solution=solution))
        units = scale(problem.cables[name].cable)[1]
        last = np.array([frame.rod.r[-1] for frame in moved])
        lengths = problem.lengths(name, frames)
        origins = start_positions(problem.ends(name, frames), last, lengths)
        shapes.append(
            cable_motion(
                dataclasses.replace(swept, frames=moved, origins=origins, units=units, lengths=lengths), shares
            )
        )
    more, less = shapes
    return _Column(
        *(
            (getattr(more, field) - getattr(less, field)) / (2 * side.step)
            for field in ("position", "curvature", "force", "moment")
        )
    )


def _bound(problem: Problem, name: str, swept: Sweep, frames: Array) -> tuple[list[Case], list[BoundCollocation]]:
    """Return the cases of a cable of ``problem`` in every frame, and their equations on the mesh of ``swept``."""
    cable, gravity = problem.cables[name].cable, np.asarray(problem.gravity, dtype=float)
    cases, equations = [], []
    held = CableCases(problem, name, SOLVER, swept.fitted).problem
    for frame, ends in zip(swept.frames, held.ends(name, frames), strict=True):
        old = frame.case.boundary
        posed = case(cable, *ends, gravity).signed_like(old.start_quaternion, old.end_quaternion)
        kind = frame.bound.transcription
        if np.any(posed.load) and not kind.loaded:
            kind = collocation(kind.elements, kind.stages, True)
        cases.append(posed)
        equations.append(kind.bind(posed.section, posed.load, posed.boundary, frame.bound.mesh))
    return cases, equations


# --- clearances ----------------------------------------------------------------------------------------


def _pair_rows(pair: PairClearance, looked: _Looked) -> _Rows:
    """Linearise a pair's clearance at its witnesses, and at the nearest point of every frame."""
    motion, sides, rates = looked.motion, looked.sides, looked.rates[pair.cable].position
    problem, shapes = motion.problem, motion.cables[pair.cable]
    limit, radius = pair.limit or 0.0, problem.cables[pair.cable].cable.radius
    unit = limit + radius
    found = Witnesses.joined(
        [pair.witnesses, pair.nearest.take(np.setdiff1d(pair.nearest.frame, pair.witnesses.frame))]
    )
    moved = at_stations(rates, shapes.s, found.frame, found.arc_length)
    grown = np.array([_cable_rate(side, pair.cable, "radius") for side in sides])
    second = np.zeros((len(found.frame), len(sides), len(sides)))
    if pair.obstacle.is_cable:
        other = pair.obstacle.name
        along = motion.cables[other].s
        moved = moved - at_stations(looked.rates[other].position, along, found.frame, found.other_arc_length)
        grown = grown + np.array([_cable_rate(side, other, "radius") for side in sides])
    elif sides:
        at = motion.motion[found.frame]
        moved = moved - np.stack(
            [_carried(problem, side, pair.obstacle.name, at, found.point) for side in sides], axis=-1
        )
        geometry = looked.scene.parts[pair.obstacle.name]
        passing = Passing(found, moved, rates, np.logical_or(*_at_ends(pair, found.arc_length, float(shapes.s[-1]))))
        second = second_order(passing, shapes, geometry, problem.poses(geometry.body, at))
    slid = np.stack([_slid(pair, found, motion, side) for side in sides], axis=-1) if sides else 0.0
    slope = (np.einsum("wc,wck->wk", found.normal, moved) - grown + slid) / unit
    return _Rows(pair.id, unit, (found.clearance - limit) / unit, slope, second / unit)


def _at_ends(pair: PairClearance, arc: Array, whole: float) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which places (W,) stand where a cable begins to count, and which where it ends to."""
    start, end = pair.excluded
    return (start > 0) & (arc <= start + AT * whole), (end > 0) & (arc >= whole - end - AT * whole)


def _cable_rate(side: _Sides, cable: str, field: str) -> float:
    more, less = (getattr(problem.cables[cable].cable, field) for problem in (side.more, side.less))
    return float(more - less) / (2 * side.step)


def _slid(pair: PairClearance, found: Witnesses, motion: Motion, side: _Sides) -> Array:
    """Return the rates (W,) of clearances that stand where a cable begins to count, which moves along it.

    Everywhere else a clearance is smallest, and moving along the cable changes nothing. How long the stretches are is
    up to :mod:`harness_opt.clearance.what_counts`; the rates of shapes are at fixed s / L.
    """
    shapes = motion.cables[pair.cable]
    length, grown = _cable_rate(side, pair.cable, "length"), _cable_rate(side, pair.cable, "radius")
    whole, arc, other = float(shapes.s[-1]), found.arc_length, found.other_arc_length
    tangents = rotations.tangent(shapes.quaternion)[..., None]
    if pair.is_to_itself:
        gap = arc_apart(motion.problem.cables[pair.cable].cable.radius, pair.limit)
        along = -np.einsum("wc,wc->w", found.normal, at_stations(tangents, shapes.s, found.frame, other)[..., 0])
        return np.where(other - arc <= gap * (1 + AT), along * (np.pi * grown - gap / whole * length), 0.0)
    if pair.obstacle.is_cable:
        return np.zeros(len(arc))
    along = np.einsum("wc,wc->w", found.normal, at_stations(tangents, shapes.s, found.frame, arc)[..., 0])
    first, last = _at_ends(pair, arc, whole)
    run = motion.problem.cables[pair.cable]
    at_start, at_end = (grown * let_off_rate(end, run.cable.radius, pair.limit) for end in (run.start, run.end))
    shift = np.where(first, at_start, np.where(last, length - at_end, arc / whole * length))
    result: Array = along * np.where(first | last, shift - arc / whole * length, 0.0)
    return result


def _carried(problem: Problem, side: _Sides, part: str, at: Array, point: Array) -> Array:
    """Return the rates (W, 3) of points (W, 3), world, that a part carries at motion values ``at`` (W,)."""
    position, quaternion = _placed(problem, part, at)
    local = rotations.rotate(rotations.conjugate(quaternion), point - position)
    moved = []
    for changed in (side.more, side.less):
        position, quaternion = _placed(changed, part, at)
        moved.append(position + rotations.rotate(quaternion, local))
    return (moved[0] - moved[1]) / (2 * side.step)


def _placed(problem: Problem, name: str, at: Array) -> tuple[Array, Array]:
    """Return the world poses of a part: (W, 3), (W, 4)."""
    part = problem.parts[name]
    position, quaternion = problem.poses(part.body, at)
    own = np.broadcast_to(np.asarray(part.position, dtype=float), position.shape)
    turn = np.broadcast_to(np.asarray(part.quaternion, dtype=float), quaternion.shape)
    return position + rotations.rotate(quaternion, own), rotations.multiply(quaternion, turn)


def usual(quantities: Quantities) -> Iterator[str]:
    """Yield the keys that people ask about: lengths, stiffnesses, weights, clamps, and where parts stand."""
    for key, quantity in quantities.items():
        place = quantity.path[-1] == "position" and quantity.component is not None
        length = quantity.path[0] == "cables" and quantity.path[-1] == "length"
        if quantity.change or length or (place and differentiable(quantity)):
            yield key
