"""Following one cable along the motion: frame by frame, over folds and lost stability.

Where a shape is lost between two frames, the cable is released to a new one (:mod:`harness_opt.motion.snaps`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from harness_opt.errors import Status
from harness_opt.model.cable import REACH_TOLERANCE
from harness_opt.model.spans import clamp_way
from harness_opt.motion.cases import CableCases
from harness_opt.motion.common_mesh import coarsened, on_mesh
from harness_opt.motion.frames import MOST_HELD, Stretches, by_mesh
from harness_opt.motion.snaps import first_shape, recover
from harness_opt.numerics.rotations import Array
from harness_opt.rod.boundary import Case
from harness_opt.rod.neutral_family import angle_between, line_of, turned
from harness_opt.rod.stability import doubt, doubtful, stability, surely_stable
from harness_opt.rod.states import Rod
from harness_opt.statics.continuation import step
from harness_opt.statics.mesh import ELEMENTS, RESOLVED, elements_for, finer_mesh, refine, refined_mesh
from harness_opt.statics.release import is_stable
from harness_opt.statics.solve import Solved, batch, error_estimate, estimates, resample, solve_on

BATCH = 16  # frames whose stability is checked together; a lost one sends the sweep back to it
TAUT = "it is just as long as its two ends are apart, and its weight or its clamps bend it"

Progress = Callable[[str, int, int], None]


class CableFollower:
    """Follows one cable along the motion.

    Args:
        cases: of the cable.
        motion: values of the frames, (P,), no two neighbours equal.
        elements: least number of elements; 0 leaves it to the shape.
        progress: called with the cable's name, frames done, frames in all.
        recovers: whether a cable that loses its shape is released, and followed on; it ends there otherwise.
    """

    def __init__(
        self, cases: CableCases, motion: Array, elements: int, progress: Progress | None, *, recovers: bool = True
    ):
        self.recovers = recovers
        self.problem, self.name, self.motion = cases.problem, cases.name, motion
        self.solver, self.elements, self.progress = cases.solver, elements, progress
        self.cases = cases
        self.ends = cases.problem.ends(cases.name, motion)
        self.lengths = cases.problem.lengths(cases.name, motion)
        self.frames = self._no_frames()
        self.snaps: list[tuple[int, float, bool]] = []
        self.begins_through_itself = False
        self._errors: list[float] = []  # estimated, in L, of the first frames: those known to be resolved by their mesh
        self._meshes = 0  # that were made finer for the frames on them

    def run_all(
        self, first: Rod | None, guesses: Sequence[Solved | None] | None, *, check: bool = True
    ) -> tuple[Status, str]:
        """Solve all frames.

        Args:
            first: the shape of the first frame; None leaves it to a cold start.
            guesses: solves of a like motion to start from, one a frame or None.
            check: whether stability is checked, for BATCH frames at a time, and gone back to where it is lost.
        """
        most_meshes = 40  # that were too coarse, in one motion
        checked, total = 0, len(self.motion)
        given: Sequence[Solved | None] = guesses or [None] * total
        failed = self._begin(first, given[0])
        if failed is not None:
            return failed
        while self.frames and self._meshes <= most_meshes:
            lost, why = None, "the shape was lost and no stable one found again"
            while len(self.frames) < total and not (check and len(self.frames) - checked >= BATCH):
                solved = self._advance(given[len(self.frames)])
                if solved is None:
                    lost = len(self.frames)
                    break
                self._append(solved)
                checked = min(checked, len(self.frames))
                if self.progress:
                    self.progress(self.name, len(self.frames), total)
            if check and self._refine_coarse():
                checked = min(checked, len(self.frames))
                continue
            # a cable that was lost on the way to the last frame leaves none to check
            unstable = self._first_unstable(checked) if check and checked < len(self.frames) else None
            if unstable is not None:
                lost, why = unstable, "the shape became unstable and no stable one was found"
                self._cut(lost)
            if lost is not None:
                recovered = self._recover(lost) if self.recovers else None
                if recovered is None:
                    return Status.STEP_TOO_SMALL, self.failure(lost, why)
                if self._unlinked(lost):
                    return Status.NOT_WITHOUT_CONTACT, self.failure(lost, Status.NOT_WITHOUT_CONTACT.value)
                self._append(recovered)
                checked = len(self.frames)
            elif len(self.frames) == total:
                return Status.OK, ""
            else:
                checked = len(self.frames)
        return Status.STEP_TOO_SMALL, self.failure(len(self.frames), "no mesh serves for the frames before it too")

    def _start(self, first: Rod | None, guess: Solved | None) -> Solved | None:
        """Solve the first frame."""
        posed = self._posed(0, None)
        if first is not None:
            posed = posed.signed_like(first.q[0], first.q[-1])
            return solve_on(posed, first.mesh, resample(first, first.mesh), self.solver)
        if guess is not None:
            posed = self._posed(0, guess.case)
            warm = step(posed, dataclasses.replace(guess, case=posed), None, 0.0, self.solver)
            if warm is not None:
                return dataclasses.replace(warm, passed=True) if guess.passed else warm
        return first_shape(self.cases, float(self.motion[0]))

    def _posed(self, frame: int, near: Case | None) -> Case:
        """Return the case of a frame, signed like ``near``."""
        return self.cases.posed(self.ends[frame], near, float(self.lengths[frame]))

    def _begin(self, first: Rod | None, guess: Solved | None) -> tuple[Status, str] | None:
        """Solve the first frame; return why there is none, where that is so."""
        started = None if self.cases.unfitted else self._start(first, guess)
        begin = self._refined(started)
        if started is None or begin is None:
            return Status.NO_START, self.failure(0, TAUT if self._is_taut() else "no shape joins its two ends there")
        self.begins_through_itself = started.passed
        if self._unlinked(0):
            return Status.NOT_WITHOUT_CONTACT, self.failure(0, Status.NOT_WITHOUT_CONTACT.value)
        self.frames.append(begin)
        return None

    def _is_taut(self) -> bool:
        """Whether the cable is just as long as its ends are apart, in the first frame."""
        way, length = clamp_way(self.problem, self.name, self.motion[:1]), self.problem.cables[self.name].cable.length
        return way is not None and bool(np.linalg.norm(way[0]) >= length * (1 - REACH_TOLERANCE))

    def _unlinked(self, frame: int) -> bool:
        """Whether the cable goes through itself on the way to ``frame``, and no limit is there for it to violate."""
        if self.problem.limits.clearance is not None:
            return False
        lost = any(passes and k == frame for k, _, passes in self.snaps) or (frame == 0 and self.begins_through_itself)
        if lost:
            self._drop_snaps()
        return lost

    def _refined(self, first: Solved | None) -> Solved | None:
        """Return the first shape resolved, on as many elements as were asked for; None where there is none."""
        if first is not None and first.ok:
            first = refine(first, RESOLVED, self.solver)[0]
        if first is not None and first.ok and self.elements >= len(first.bound.mesh):
            finer = next((m for m in ELEMENTS if m >= self.elements), ELEMENTS[-1])
            mesh = refined_mesh(first.bound.mesh, error_estimate(first)[1], finer)
            first = solve_on(first.case, mesh, resample(first.rod, mesh), self.solver)
        return first if first is not None and first.ok and not first.turned else None

    def _advance(self, guess: Solved | None) -> Solved | None:
        """Solve the next frame from the last ones, or from ``guess``; None where the shape is lost."""
        k, here = len(self.frames), self.frames[-1]
        target = self._posed(k, here.case)
        if guess is not None and np.array_equal(guess.bound.mesh, here.bound.mesh):
            warm = step(target, guess, None, 0.0, self.solver)
            if warm is not None:
                if guess.passed:
                    self.snaps.append((k, float(self.motion[k]), True))
                return warm
        before = self.frames[-2] if k > 1 and (not self.snaps or self.snaps[-1][0] < k - 1) else None
        ratio = (self.motion[k] - self.motion[k - 1]) / (self.motion[k - 1] - self.motion[k - 2]) if before else 0.0
        solved = step(target, here, before, ratio, self.solver)
        if solved is not None:
            return solved
        solved, reached = self.cases.follow(here, self.motion[k - 1], self.motion[k])
        return solved if reached == self.motion[k] else None

    def _first_unstable(self, checked: int) -> int | None:
        """Return the first frame from ``checked`` on, but not frame 0, whose shape is unstable."""
        kind, first = self.frames[0].case.boundary.kind, checked
        for frames in by_mesh(self.frames[checked:]):
            rods, errors = batch(frames), np.array(self._errors[first : first + len(frames)])
            if not surely_stable(rods, kind, doubt(errors)):
                found = stability(rods, kind)
                for k in np.flatnonzero(doubtful(rods, found, errors) | (found.index > 0)).tolist():
                    if first + k and not is_stable(frames[k], self.solver):
                        return first + k
            first += len(frames)
        return None

    def _recover(self, k: int) -> Solved | None:
        """Return frame k of a cable that lost its shape on the way to it, its snaps noted; None in vain."""
        at, target = float(self.motion[k - 1]), float(self.motion[k])
        found = recover(self.cases, self.frames[k - 1], at, target, is_first=k == 1)
        self.snaps += [(k, where, passes) for where, passes in found.snaps]
        if found.first is not None:
            self.frames, self._errors = self._no_frames(), []
            self._append(found.first)
        return found.solved

    def _append(self, solved: Solved) -> None:
        """Add a frame; where its mesh is not that of the last one, on as light a one as does."""
        if self.frames and not np.array_equal(solved.bound.mesh, self.frames[-1].bound.mesh):
            solved = coarsened(solved, self.frames[-1], self.elements, self.solver)
        self.frames.append(_beside(solved, self.frames[-1]) if self.frames else solved)

    def _cut(self, count: int) -> None:
        """Keep the first ``count`` frames alone."""
        self.frames.cut(count)
        del self._errors[count:]
        self._drop_snaps()

    def _drop_snaps(self) -> None:
        """Forget snaps on the way to frames that are not there any more."""
        self.snaps = [snap for snap in self.snaps if snap[0] < len(self.frames)]

    def _refine_coarse(self) -> bool:
        """Go back to before the first frame that its mesh is too coarse for, on a finer one; return whether there is.

        What is followed on too coarse a mesh leads to shapes that the cable does not have.
        """
        for frames in by_mesh(self.frames[len(self._errors) :]):
            mesh, local = frames[0].bound.mesh, np.zeros(len(frames[0].bound.mesh) - 1)
            for error, own in estimates(frames):
                local = np.maximum(local, own)
                most = elements_for(len(mesh) - 1, error, own)
                finer = finer_mesh(mesh, local, error / RESOLVED, np.inf, most) if most else None
                if finer is not None:
                    self._meshes += 1
                    self._go_on_from(max(0, len(self._errors) - 1), finer)
                    return True
                self._errors.append(error)
        return False

    def _go_on_from(self, last: int, mesh: Array) -> None:
        """Keep the frames up to ``last``, and that on another mesh; where it does not stay the same, one before it."""
        for k in range(last, -1, -1):
            moved = on_mesh(self.frames[k], mesh, self.solver)
            self._cut(k)
            if moved is not None:
                self.frames.append(moved)
                return

    def _no_frames(self) -> Stretches:
        """Return a place for frames."""
        return Stretches(MOST_HELD // len(self.problem.cables))

    def failure(self, frame: int, reason: str) -> str:
        """Return the sentence for the user: at which ``frame`` it ended, and the ``reason``."""
        at = self.problem.moments.words(float(self.motion[frame]))
        return (
            f"cable {self.name}, frame {frame} of {len(self.motion)} ({at}): {reason}; "
            "try a smaller motion.spatial_step, more length, or another bow or number of turns"
        )


def _beside(solved: Solved, before: Solved) -> Solved:
    """Return ``solved``, where it is one of a family that turns about a line, as the member nearest to ``before``."""
    places = np.linspace(0.0, 1.0, 41)
    line = line_of(solved.case)
    if line is None:
        return solved
    angle = angle_between(line, solved.rod.sample(places).r, before.rod.sample(places).r)
    if angle == 0.0:
        return solved
    x = turned(solved.bound, solved.solution.x, line, angle)
    solution = dataclasses.replace(solved.solution, x=x, factor=None)
    return dataclasses.replace(solved, solution=solution, trail=None)
