"""A harness at one pose of its free bodies and clips: what it weighs on each freedom, and how that changes.

The energy of the whole, with its spans in equilibrium between ends that are held, depends on the pose alone. Its
gradient is what the spans pull with at what is free, its Hessian their end stiffnesses put together: substructuring
(Craig and Bampton, AIAA Journal 6 (1968), section II, for the assembly). The index of the whole is the sum of the
spans', their ends held, and the number of negative eigenvalues of this Hessian (Haynsworth, Linear Algebra Appl. 1
(1968)).
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness_opt.harness.freedoms import Freedoms, PlacedEnds, Pose
from harness_opt.harness.span_loads import LENGTH, POSITION, ROTATION, SIZE, SpanLoads
from harness_opt.model.cable import CableRun
from harness_opt.model.ends import ENDS
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices
from harness_opt.rod import equations as rod_module
from harness_opt.rod.boundary import Boundary, Case, Kind
from harness_opt.rod.equations import Section, Units
from harness_opt.statics.solve import Solved

NEUTRAL = 1e-9  # of the largest eigenvalue: below it a pose may be moved freely


@dataclass(frozen=True)
class State:
    """A harness whose spans are solved at a pose.

    Args:
        harness: whose it is.
        at: motion value.
        pose, placed: of what is free, and of the spans' ends.
        spans: solved, in the order of the harness.
    """

    harness: Harness
    at: float
    pose: Pose
    placed: PlacedEnds
    spans: tuple[SpanLoads, ...]

    @functools.cached_property
    def energy(self) -> float:
        """Of the spans, and of the free bodies' weights, J."""
        weights = self.harness.masses[:, None] * self.harness.gravity
        work = float(np.sum(weights * self.pose.positions))
        energies: list[float] = [span.energy for span in self.spans]
        return sum(energies) - work

    @functools.cached_property
    def gradient(self) -> Array:
        """Rates of the energy with the freedoms, (n,): N, and N m."""
        found = np.zeros(self.harness.freedoms.size)
        for span, (columns, moves) in zip(self.spans, self.moves, strict=True):
            found[columns] += moves.T @ span.gradient
        for body, mass in enumerate(self.harness.masses):
            found[self.harness.freedoms.of_body(body)][:3] -= mass * self.harness.gravity
        return found

    @functools.cached_property
    def hessian(self) -> Array:
        """Rates of :attr:`gradient`, (n, n); symmetric at rest."""
        size = self.harness.freedoms.size
        found = np.zeros((size, size))
        for number, (span, (columns, moves)) in enumerate(zip(self.spans, self.moves, strict=True)):
            found[np.ix_(columns, columns)] += moves.T @ span.stiffness @ moves
            self._add_levers(found, number, span.gradient)
        return found

    def _add_levers(self, found: Array, number: int, gradient: Array) -> None:
        """Add what the arms of forces on a body, and the axes of swivels, change as the body turns."""
        freedoms = self.harness.freedoms
        for side, end in enumerate(freedoms.ends[number]):
            force, moment = gradient[POSITION[side]], gradient[ROTATION[side]]
            if end.carrier is None:
                continue
            turned = freedoms.of_body(end.carrier)
            rotation = np.arange(turned.start + 3, turned.stop)
            arm = self.placed.positions[number, side] - self.pose.positions[end.carrier]
            found[np.ix_(rotation, rotation)] += rotations.cross_matrix(force) @ rotations.cross_matrix(arm)
            if end.clip is not None and freedoms.clips[end.clip].clip.freedoms == 1:
                tangent = rotations.tangent(self.placed.clips[end.clip])
                found[freedoms.of_clip(end.clip).start, rotation] += np.cross(tangent, moment)

    @functools.cached_property
    def moves(self) -> list[tuple[Indices, Array]]:
        """For each span, which freedoms move it, (k,), and how they move its ends and length, (SIZE, k)."""
        freedoms, found = self.harness.freedoms, []
        for number, ends in enumerate(freedoms.ends):
            columns, blocks = [np.zeros(0, dtype=np.int64)], [np.zeros((SIZE, 0))]
            for side, end in enumerate(ends):
                if end.carrier is not None:
                    own, block = freedoms.of_body(end.carrier), np.zeros((SIZE, 6))
                    place = self.placed.positions[number, side]
                    arm = np.nan_to_num(place - self.pose.positions[end.carrier])
                    block[POSITION[side], :3] = np.eye(3)
                    block[POSITION[side], 3:] = -rotations.cross_matrix(arm)
                    block[ROTATION[side], 3:] = np.eye(3)
                    columns, blocks = [*columns, np.arange(own.start, own.stop)], [*blocks, block]
                if end.clip is not None:
                    own, slide = freedoms.of_clip(end.clip), freedoms.slide_of(end.clip)
                    block = np.zeros((SIZE, own.stop - own.start))
                    tangent = rotations.tangent(self.placed.clips[end.clip])
                    block[ROTATION[side]] = {0: np.zeros((3, 0)), 1: tangent[:, None], 3: np.eye(3)}[block.shape[1]]
                    columns, blocks = [*columns, np.arange(own.start, own.stop)], [*blocks, block]
                    if slide is not None:
                        longer = np.zeros((SIZE, 1))
                        longer[LENGTH] = 1.0 if side else -1.0
                        columns, blocks = [*columns, np.array([slide])], [*blocks, longer]
            found.append((np.concatenate(columns), np.concatenate(blocks, axis=1)))
        return found

    # --- scaled: ways in lengths of the harness, loads in its own -------------------------------------------------

    @functools.cached_property
    def slope(self) -> Array:
        """The gradient without dimensions, (n,)."""
        return self.gradient * self.harness.scales / self.harness.stiff

    @property
    def matrix(self) -> Array:
        """The Hessian without dimensions, made symmetric, (n, n)."""
        scaled = self.hessian * np.outer(self.harness.scales, self.harness.scales) / self.harness.stiff
        symmetric: Array = 0.5 * (scaled + scaled.T)
        return symmetric

    @functools.cached_property
    def curvature(self) -> tuple[Array, Array]:
        """Eigenvalues (n,), ascending, and eigenvectors (n, n) of :attr:`matrix`."""
        values, vectors = np.linalg.eigh(self.matrix)
        return values, vectors

    @property
    def neutral(self) -> float:
        """The size below which an eigenvalue counts as none."""
        return NEUTRAL * float(np.max(np.abs(self.curvature[0]), initial=1.0))

    @property
    def index(self) -> int:
        """How many directions of what is free lower the energy to second order."""
        return int(np.sum(self.curvature[0] < -self.neutral))

    @property
    def load(self) -> float:
        """The size of the loads that are balanced, as :attr:`slope` has them."""
        length, stiff = self.harness.length, self.harness.stiff
        weights = [mass * float(np.linalg.norm(self.harness.gravity)) * length for mass in self.harness.masses]
        ends = [
            max(length * np.linalg.norm(span.gradient[POSITION[side]]), np.linalg.norm(span.gradient[ROTATION[side]]))
            for span in self.spans
            for side in (0, 1)
        ]
        largest: float = max([*weights, *map(float, ends)])
        return 1.0 + largest / stiff

    @property
    def miss(self) -> float:
        """By how much it is off its balance, over the loads."""
        return float(np.max(np.abs(self.slope), initial=0.0)) / self.load


class Harness:
    """Spans that are coupled, with what is needed to pose and weigh them.

    Args:
        freedoms: of the harness.
        solver: name of the one that its spans are solved by.
    """

    def __init__(self, freedoms: Freedoms, solver: str):
        problem = freedoms.problem
        self.freedoms, self.solver, self.gravity = freedoms, solver, np.asarray(problem.gravity, dtype=float)
        self.masses = np.array([problem.bodies[name].mass for name in freedoms.bodies])
        self.units: list[Units] = [rod_module.scale(problem.cables[span].cable)[1] for span in freedoms.spans]
        self.length = float(np.mean(freedoms.lengths()))
        self.stiff = float(np.mean([unit.moment for unit in self.units]))
        ways = np.zeros(freedoms.size, dtype=bool)
        for body in range(len(freedoms.bodies)):
            ways[freedoms.of_body(body)][:3] = True
        for clip in range(len(freedoms.clips)):
            slide = freedoms.slide_of(clip)
            if slide is not None:
                ways[slide] = True
        self.scales = np.where(ways, self.length, 1.0)
        self._templates = [_unplaced(problem.cables[span], self.gravity) for span in freedoms.spans]

    def cases(self, placed: PlacedEnds, near: Sequence[Solved | None]) -> list[Case] | None:
        """Return the cases of all spans, signed like those ``near``; None where a span does not reach."""
        found = []
        for number, unplaced in enumerate(self._templates):
            length = float(placed.lengths[number])
            if not length > 0.0:  # slid out of its clips
                return None
            template = _of_length(unplaced, length / self.units[number].length)
            boundary, kind = template.boundary, template.boundary.kind
            changed = {}
            if kind.start_position and kind.end_position:
                gap = (placed.positions[number, 1] - placed.positions[number, 0]) / length
                if not float(gap @ gap) < 1.0:
                    return None
                changed["gap"] = gap
            if kind.start_orientation:
                changed["start_quaternion"] = placed.frames[number, 0]
            if kind.end_orientation:
                changed["end_quaternion"] = placed.frames[number, 1]
            posed = dataclasses.replace(template, boundary=dataclasses.replace(boundary, **changed))
            before = near[number]
            if before is not None:
                like = before.case.boundary
                posed = posed.signed_like(like.start_quaternion, like.end_quaternion)
            found.append(posed)
        return found

    def state(self, at: float, pose: Pose, placed: PlacedEnds, solves: Sequence[Solved]) -> State:
        """Return the state of solved spans."""
        spans = []
        for number, solved in enumerate(solves):
            origin, units = placed.positions[number, 0], _longer(self.units[number], float(placed.lengths[number]))
            if not solved.case.boundary.kind.start_position:
                origin = placed.positions[number, 1] - units.length * solved.rod.r[-1]
            spans.append(SpanLoads(solved, units, origin))
        return State(self, at, pose, placed, tuple(spans))


def _longer(units: Units, length: float) -> Units:
    """Return the units of a span of another ``length``, m."""
    if length == units.length:
        return units
    ratio = units.length / length
    return Units(length, units.force * ratio**2, units.moment * ratio)


def _of_length(unplaced: Case, ratio: float) -> Case:
    """Return the case of a span ``ratio`` times as long: loads without dimensions grow with its length."""
    if ratio == 1.0:
        return unplaced
    section, boundary = unplaced.section, unplaced.boundary
    loads = {
        f"{side}_{kind}": ratio**power * getattr(boundary, f"{side}_{kind}")
        for side in ENDS
        for kind, power in (("force", 2), ("moment", 1))
    }
    return Case(
        Section(section.stiffness, ratio * section.rest_curvature),
        ratio**3 * unplaced.load,
        dataclasses.replace(boundary, **loads),
    )


def _unplaced(run: CableRun, gravity: Array) -> Case:
    """Return the case of a span whose ends are still to be placed."""
    section, units = rod_module.scale(run.cable)
    kind = Kind(
        run.start.position is not None,
        run.start.frame is not None,
        run.end.position is not None,
        run.end.frame is not None,
        run.start.has_open_roll,
        run.end.has_open_roll,
    )
    loads = [
        np.zeros(3) if value is None else np.asarray(value) / unit
        for value, unit in (
            (run.start.force, units.force),
            (run.end.force, units.force),
            (run.start.moment, units.moment),
            (run.end.moment, units.moment),
        )
    ]
    still = np.asarray(rotations.IDENTITY, dtype=float)
    return Case(section, rod_module.weight(run.cable, gravity), Boundary(kind, np.zeros(3), still, still, *loads))
