"""Evaluated designs of a redesign: each simulated over the motion, measured, and linearised."""

from __future__ import annotations

import copy
import dataclasses
import functools
import itertools
import pickle
import time
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Executor
from dataclasses import dataclass

import numpy as np

from harness_opt.clearance.limits import all_limits
from harness_opt.clearance.measure import measure
from harness_opt.clearance.pairs import ClearanceResult, of_whole_cables
from harness_opt.design.margins import OfWholeCables, Rows, linearised, reach_rows
from harness_opt.design.sides import past_sides
from harness_opt.errors import ProblemError, Status
from harness_opt.harness.over_motion import FoundHarness
from harness_opt.model import design_variables
from harness_opt.model.limits import LimitId
from harness_opt.model.problem import Problem
from harness_opt.model.results import Motion, joined
from harness_opt.model.spans import in_spans, shortest, spans_of
from harness_opt.motion.follower import Progress
from harness_opt.motion.path import place_frames
from harness_opt.motion.shape_rates import ShapeRates, clamps_of_spans, shape_rates
from harness_opt.motion.simulate import collect
from harness_opt.motion.sweep import Sweep, in_turn, sweep
from harness_opt.numerics.rotations import Array
from harness_opt.parts.scene import Scene, load_scene
from harness_opt.statics.solve import Solved

SPARE = 0.01  # of the distance of its clamps, by which a cable is longer than that: a straight one has no room to bend
GUARD = 0.002  # asked for beyond each limit, in its own scale, so that a finer simulation still holds it
HELD = 0.5 * GUARD  # a violation of what is asked for that leaves the limit itself held
SEARCH_STRIDE = 2  # of the frames that a search solves
ALONE = 4  # looks, by which it is known what others will take
STARTING = 3.0  # s, that looks must take for other processes to help: to start takes each of them 1.5 s
SNAP_COST = 1.0  # of a snap, in scales of a limit: snaps are not for designing with


@dataclass(frozen=True)
class Evaluated:
    """One simulated design.

    Args:
        values: of the design variables, (k,).
        indices: which of the motion's frames were solved.
        sweeps: by span.
        harnesses: by span, those that are part of one.
        motion, clearances: of these frames.
        rates: of the shapes, by span; empty where only a quick look was asked for.
        rows: the limits, scaled and linearised.
    """

    values: Array
    indices: Sequence[int]
    sweeps: Mapping[str, Sweep]
    harnesses: Mapping[str, FoundHarness]
    motion: Motion
    clearances: ClearanceResult
    rates: Mapping[str, ShapeRates]
    rows: Rows

    def without_shapes(self) -> Evaluated:
        """Return the same without the solver's own objects, which no other process can be sent."""
        return dataclasses.replace(self, sweeps={}, harnesses={}, rates={})

    def predicted(self, name: str, values: Array) -> dict[int, Solved]:
        """Return the frames of span ``name``, by index, moved to first order to the design ``values`` (k,)."""
        own = self.sweeps[name]
        shapes = dict(zip(self.indices, own.frames, strict=True))
        if name in self.rates:
            moved = self.rates[name].unknowns @ (values - self.values)
            shapes = {
                index: dataclasses.replace(f, solution=dataclasses.replace(f.solution, x=f.solution.x + dx))
                for (index, f), dx in zip(shapes.items(), moved, strict=True)
            }
        # a design that goes on from a cable that went through itself has done so too
        through = [0] * own.begins_through_itself + [frame for frame, _, passes in own.snaps if passes]
        for index in {self.indices[frame] for frame in through}:
            shapes[index] = dataclasses.replace(shapes[index], passed=True)
        return shapes

    @functools.cached_property
    def shortfalls(self) -> dict[LimitId, float]:
        """By how much each limit is missed, over its scale, as it is reported; below 0 where it holds."""
        problem = self.motion.problem
        rows = all_limits(problem, self.motion, self.clearances)
        return {row.id: -row.margin / row.scale(problem.cables[row.cable].cable.radius) for row in rows}

    @property
    def violation(self) -> float:
        """The largest shortfall, 0 where all limits hold, and what snaps cost on top."""
        return max([0.0, *self.shortfalls.values()]) + SNAP_COST * len(self.motion.snaps)

    @property
    def worst(self) -> int:
        """The row with the smallest margin."""
        return int(np.argmin(self.rows.margin))


class Evaluator:
    """Simulates designs of one problem.

    Args:
        problem: the design variables are taken from it.
        scene: its parts.
        solver: name.
        progress: called for every frame.
        executor: of processes that may help with looks.
    """

    def __init__(
        self, problem: Problem, scene: Scene, solver: str, progress: Progress | None, executor: Executor | None = None
    ):
        self.problem, self.scene, self.solver, self.progress = problem, scene, solver, progress
        self.frames = place_frames(problem)
        # asked for beyond each limit, in its scale; verifications add to it
        self.asked: defaultdict[LimitId, float] = defaultdict(lambda: GUARD)
        self.spare = {name: self._spare(name) for name in spans_of(problem)}
        self._executor, self._helped = executor, False
        self._count = [0]  # shared by all that report for this one
        self._as_reported = False
        self._past_sides = True
        self.cold = False  # whether every design starts from nothing, as its file will: where one shape leads elsewhere

    @property
    def count(self) -> int:
        """How many designs were simulated."""
        return self._count[0]

    def _spare(self, span: str) -> float:
        """Return how much longer than its clamps are apart a span has to be, as a share: as was drawn or a little."""
        apart = in_spans(self.problem)
        distance, drawn = shortest(apart, span)[0], apart.cables[span].cable.length
        slack = drawn / distance - 1.0 if distance else SPARE
        return min(SPARE, 0.5 * slack) if slack > 0.0 else SPARE

    def of(self, problem: Problem) -> Evaluator:
        """Return an evaluator that asks the same of another ``problem``, with the same parts, clamps and variables."""
        other = copy.copy(self)
        other.problem = problem
        return other

    def by_nearest_faces(self) -> Evaluator:
        """Return an evaluator of the same problem that measures what goes through a part by the part's nearest faces.

        Others measure it past the side that it came in by, or aside: see :mod:`harness_opt.design.sides`.
        """
        other = copy.copy(self)
        other._past_sides = False
        return other

    def reporting(self, allowed: Mapping[LimitId, float]) -> Evaluator:
        """Return an evaluator of the same problem that takes every shortfall as it is reported, and asks no more.

        Args:
            allowed: shortfalls, by limit, that just count as held.
        """
        other = copy.copy(self)
        other.asked = defaultdict(float, {limit: -short for limit, short in allowed.items() if short > 0.0})
        other._as_reported = True
        return other

    def __call__(
        self, values: Array, near: Evaluated | None, *, stride: int = 1, quick: bool = False
    ) -> Evaluated | None:
        """Simulate the design ``values`` (k,); None where it cannot be simulated.

        Args:
            values: of the variables.
            near: a design whose shapes to start from.
            stride: only every so many of the motion's frames are solved, and the last.
            quick: leave the derivatives and the stability of shapes out.

        Raises:
            KeyboardInterrupt: raised by ``progress``.
        """
        self._count[0] += 1
        near = None if self.cold or near is None or not near.sweeps else near
        indices = sorted({*range(0, len(self.frames), stride), len(self.frames) - 1})
        motion_values = self.frames[indices]

        # beside shapes all along the motion that never snap, what cannot go on from them does: that costs most
        snaps = near is None or self.problem.design.snaps or near.motion.snaps or not {*indices} <= {*near.indices}

        def follow(apart: Problem, name: str, harness: FoundHarness | None) -> Sweep:
            close = near.predicted(name, values) if near else {}
            guesses = [close.get(index) for index in indices]
            fitted = near.sweeps[name].fitted if near else None
            return sweep(
                apart, name, motion_values, solver=self.solver, guesses=guesses, near=fitted, harness=harness,
                rigour="quick look" if quick else "stable", recovers=bool(snaps), progress=self.progress,
            )  # fmt: skip

        try:
            changed = design_variables.apply(self.problem, values)
            swept = in_turn(
                changed,
                motion_values,
                follow,
                self.solver,
                self.progress,
                between=False,
                near=near.harnesses if near else None,
            )
        except ProblemError:  # shorter than the distance of its ends somewhere on the motion
            return None
        changed, apart, sweeps = swept.whole, swept.problem, swept.sweeps
        if any(one.status is Status.INTERRUPTED for one in sweeps.values()):
            raise KeyboardInterrupt
        if not all(one.status.ok for one in sweeps.values()):
            return None
        spans = spans_of(changed)
        motion = collect(swept, motion_values, 0.0)
        clearances = measure(apart, self.scene, motion_values, motion.cables)
        rates, reach = {}, []
        if not quick:
            for name, clamps in clamps_of_spans(self.problem, values, motion_values, swept).items():
                reach.append(reach_rows(apart, name, motion_values, clamps, self.spare[name]))
                shares = motion.cables[name].s / sweeps[name].units.length
                rates[name] = shape_rates(sweeps[name], clamps, shares, exact=False)
        asked = defaultdict[LimitId, float](float) if self._as_reported else self.asked
        seen = clearances
        if self._past_sides and not self._as_reported:
            seen = past_sides(apart, self.scene, motion.cables, clearances)
        rows = linearised(apart, motion, seen, rates, OfWholeCables(asked, spans), len(values)).of_whole_cables(spans)
        if self._as_reported:
            rows = rows.as_reported(self.asked)
        rows = Rows.joined([rows, *reach])
        motion, clearances = joined(changed, motion), of_whole_cables(changed, clearances)
        return Evaluated(values, indices, sweeps, swept.harnesses, motion, clearances, rates, rows)

    def looks(self, places: Array, stride: int) -> Iterator[Evaluated | None]:
        """Yield a quick look at each of ``places`` (n, k), in order and from nothing; what it yields has no shapes.

        Other processes help where there are any and it pays; what they find is the same.
        """
        begin = time.perf_counter()
        for number, place in enumerate(places):
            left = (time.perf_counter() - begin) / max(number, 1) * (len(places) - number)
            if self._executor is not None and (self._helped or (number >= ALONE and left > STARTING)):
                yield from self._helped_looks(self._executor, places[number:], stride)
                return
            look = self(place, None, stride=stride, quick=True)
            yield None if look is None else look.without_shapes()

    def _helped_looks(self, executor: Executor, places: Array, stride: int) -> Iterator[Evaluated | None]:
        self._helped = True
        asked = pickle.dumps((self.problem, self.solver, dict(self.asked)))
        done = 0
        try:
            for look in executor.map(_look, itertools.repeat(asked), places, itertools.repeat(stride)):
                self._count[0] += 1
                if self.progress:
                    self.progress(next(iter(self.problem.cables)), 1, 1)
                done += 1
                yield look
        except BrokenExecutor:  # a process was killed: the rest is done here
            self._executor = None
            yield from self.looks(places[done:], stride)


@functools.lru_cache(maxsize=1)
def _evaluator(asked: bytes) -> Evaluator:
    """Return the evaluator of another process: of a problem, by a solver, for what is asked of each limit."""
    problem, solver, limits = pickle.loads(asked)
    evaluate = Evaluator(problem, load_scene(problem), solver, None)
    evaluate.asked.update(limits)
    return evaluate


def _look(asked: bytes, place: Array, stride: int) -> Evaluated | None:
    """Return a quick look at ``place`` (k,), in another process."""
    return next(_evaluator(asked).looks(place[None], stride))
