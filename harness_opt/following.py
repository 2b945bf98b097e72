"""Following one cable along the motion: frame by frame, over folds and lost stability.

Where a shape is lost between two frames, the place is found by bisection, the cable let go there, and followed on from
where it landed: what it does does not hang on where the frames stand.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from .boundary import Case, case
from .cold_start import cold_start, is_stable, let_go
from .continuation import (
    COARSE,
    ELEMENTS,
    NEAR,
    Solved,
    error_estimate,
    follow,
    refine,
    refined_mesh,
    resample,
    solve_on,
    step,
    turning,
)
from .errors import Status
from .followed_frames import MOST_HELD, Frames, batch
from .problem import End, Problem
from .rotations import Array
from .shape import Rod
from .stability import stability, surely_stable

SAME_ENERGY = 1e-6  # relative difference below which two shapes of one pose are of one neutral family
BATCH = 16  # frames whose stability is checked together; a lost one sends the sweep back to it
EDGE = 2.0**-13  # of the motion: how closely the place is found where a shape is lost
JUMP = 0.2  # rad, largest turning of a section at the place of a loss above which the cable is said to have snapped
COARSEST = 0.2  # smallest step in the search for that place: it halves the way itself
MOST_LOSSES = 8  # between two frames
LANDED = 1e-5  # estimated error, in L, of a shape that a cable is taken to land in
LATER = 4  # times over further on that a landing is tried where there is none at the place of the loss itself

Progress = Callable[[str, int, int], None]


class Follower:
    """Follows one cable along the motion.

    Args:
        problem: the problem.
        name: of the cable.
        motion: values of the frames, (P,), no two neighbours equal.
        solver: name.
        elements: least number of elements; 0 leaves it to the shape.
        progress: called with the cable's name, frames done, frames in all.
    """

    def __init__(
        self, problem: Problem, name: str, motion: Array, solver: str, elements: int, progress: Progress | None
    ):
        self.problem, self.name, self.motion = problem, name, motion
        self.solver, self.elements, self.progress = solver, elements, progress
        self.run = problem.cables[name]
        self.gravity = np.asarray(problem.gravity)
        self.ends = problem.ends(name, motion)
        self.frames = self._no_frames()
        self.snaps: list[tuple[int, float]] = []

    def run_all(
        self, first: Rod | None, guesses: Sequence[Solved | None] | None, *, check: bool = True
    ) -> tuple[Status, str]:
        """Solve all frames.

        Args:
            first: the shape of the first frame; None leaves it to a cold start.
            guesses: solves of a like motion to start from, one a frame or None.
            check: whether stability is checked, for BATCH frames at a time, and gone back to where it is lost.
        """
        checked, total = 0, len(self.motion)
        given: Sequence[Solved | None] = guesses or [None] * total
        begin = self._refined(self._start(first, given[0]))
        if begin is None:
            return Status.NO_START, self._failure(0, "no shape joins its two ends there")
        self.frames.append(begin)
        while True:
            while len(self.frames) < total and not (check and len(self.frames) - checked >= BATCH):
                k = len(self.frames)
                solved = self._advance(given[k]) or self._lose(k)
                if solved is None:
                    return Status.STEP_TOO_SMALL, self._failure(k, "the shape was lost and no stable one found again")
                self._append(solved)
                if self.progress:
                    self.progress(self.name, len(self.frames), total)
            # a cable that was lost on the way to the last frame leaves none to check
            lost = self._first_unstable(checked) if check and checked < len(self.frames) else None
            if lost is None:
                checked = len(self.frames)
                if checked == total:
                    return Status.OK, ""
                continue
            self.frames.cut(lost)
            self.snaps = [(frame, at) for frame, at in self.snaps if frame < lost]
            landed = self._lose(lost)
            if landed is None:
                return Status.STEP_TOO_SMALL, self._failure(
                    lost, "the shape became unstable and no stable one was found"
                )
            self._append(landed)
            checked = lost + 1

    def _case(self, ends: tuple[End, End], near: Case | None) -> Case:
        """Return the case of ``ends``, its quaternions signed like those of ``near``."""
        posed = case(self.run.cable, *ends, self.gravity)
        return (
            posed if near is None else posed.signed_like(near.boundary.start_quaternion, near.boundary.end_quaternion)
        )

    def _path(self, near: Case) -> Callable[[float], Case]:
        """Return the cases along the motion, signed like ``near``."""
        return lambda at: self._case(self.problem.ends(self.name, [at])[0], near)

    def _start(self, first: Rod | None, guess: Solved | None) -> Solved | None:
        """Solve the first frame."""
        posed = self._case(self.ends[0], None)
        if first is not None:
            posed = posed.signed_like(first.q[0], first.q[-1])
            return solve_on(posed, first.mesh, resample(first, first.mesh), self.solver)
        if guess is not None:
            posed = self._case(self.ends[0], guess.case)
            warm = step(posed, dataclasses.replace(guess, case=posed), None, 0.0, self.solver)
            if warm is not None:
                return warm
        bow = None if self.run.bow is None else np.asarray(self.run.bow)
        return cold_start(self._case(self.ends[0], None), self.run.end.turns, bow, self.solver)

    def _refined(self, first: Solved | None) -> Solved | None:
        """Return the first shape on as many elements as were asked for; None where there is none."""
        if first is not None and first.ok and self.elements >= len(first.bound.mesh):
            finer = next((m for m in ELEMENTS if m >= self.elements), ELEMENTS[-1])
            mesh = refined_mesh(first.bound.mesh, error_estimate(first)[1], finer)
            first = solve_on(first.case, mesh, resample(first.rod, mesh), self.solver)
        return first if first is not None and first.ok and not first.turned else None

    def _advance(self, guess: Solved | None) -> Solved | None:
        """Solve the next frame from the last ones, or from ``guess``; None where the shape is lost."""
        k, here = len(self.frames), self.frames[-1]
        target = self._case(self.ends[k], here.case)
        if guess is not None and np.array_equal(guess.bound.mesh, here.bound.mesh):
            warm = step(target, guess, None, 0.0, self.solver)
            if warm is not None:
                return warm
        before = self.frames[-2] if k > 1 and (not self.snaps or self.snaps[-1][0] < k - 1) else None
        ratio = (self.motion[k] - self.motion[k - 1]) / (self.motion[k - 1] - self.motion[k - 2]) if before else 0.0
        solved = step(target, here, before, ratio, self.solver)
        if solved is not None:
            return solved
        solved, reached = follow(self._path(here.case), here, self.motion[k - 1], self.motion[k], self.solver)
        return solved if reached == self.motion[k] else None

    def _first_unstable(self, checked: int) -> int | None:
        """Return the first frame from ``checked`` on, but not frame 0, whose shape is unstable."""
        rods, kind = batch(self.frames[checked:]), self.frames[0].case.boundary.kind
        if surely_stable(rods, kind):
            return None
        lost = checked + np.flatnonzero(stability(rods, kind).index)
        lost = lost[lost > max(0, checked - 1)]
        return int(lost[0]) if len(lost) else None

    def _lose(self, k: int) -> Solved | None:
        """Find where the shape is lost between frames k - 1 and k, let go there, and follow to frame k; None in vain.

        A cable that jumps there snaps; one that starts to lean out of its old shape there does not.
        """
        here, at, target = self.frames[k - 1], float(self.motion[k - 1]), float(self.motion[k])
        for _ in range(MOST_LOSSES):
            here, at, beyond = self._edge(here, at, target)
            landed, where = self._land(here, beyond, target)
            if landed is None:
                return None
            if turning(landed.rod.sample(here.rod.mesh).q, here.rod.q) > JUMP and not (
                k == 1 and self._swing_start(landed, where)
            ):
                self.snaps.append((k, beyond))
            solved, reached = follow(self._path(landed.case), landed, where, target, self.solver)
            if reached == target and is_stable(solved):
                return solved
            here, at = landed, where
        return None

    def _edge(self, here: Solved, at: float, target: float) -> tuple[Solved, float, float]:
        """Return the last stable shape on the way from ``here`` to ``target``, its motion value, and one beyond."""
        beyond = target
        while True:
            while abs(beyond - at) > EDGE:
                middle = 0.5 * (at + beyond)
                solved, reached = follow(self._path(here.case), here, at, middle, self.solver, COARSEST)
                if reached == middle and is_stable(solved):
                    here, at = solved, middle
                else:
                    beyond = middle
            # those steps may only have been too long: with short ones the shape is lost here, or goes on
            solved, reached = follow(self._path(here.case), here, at, beyond, self.solver)
            if beyond == target or reached != beyond or not is_stable(solved):
                return here, at, beyond
            here, at, beyond = solved, beyond, target

    def _land(self, here: Solved, beyond: float, target: float) -> tuple[Solved | None, float]:
        """Let the cable go at ``beyond``, or further on where it lands nowhere; return where it landed, and when."""
        for wait in np.linspace(0.0, 1.0, LATER + 1) ** 2:
            where = beyond + float(wait) * (target - beyond)
            landed = let_go(self._path(here.case)(where), here.rod, self.solver)
            if landed is not None:
                landed, _, status = refine(landed, LANDED, self.solver)  # a coarse mesh has shapes that no cable has
                if status.ok and is_stable(landed):
                    return landed, where
            if beyond == target:
                break
        return None, beyond

    def _append(self, solved: Solved) -> None:
        """Add a frame; all frames are on one mesh, so one that needed a finer mesh takes the others along."""
        mesh = solved.bound.mesh
        if self.frames and not np.array_equal(mesh, self.frames[-1].bound.mesh):
            old = self.frames[-1].bound.mesh
            again = solve_on(solved.case, old, resample(solved.rod, old), self.solver)
            same = again.ok and not again.turned and turning(again.rod.q, solved.rod.sample(old).q) < NEAR
            if same and error_estimate(again)[0] < COARSE:
                solved = again
            else:
                finer = self._no_frames()
                for f in self.frames:
                    finer.append(solve_on(f.case, mesh, resample(f.rod, mesh), self.solver))
                self.frames = finer
        self.frames.append(solved)

    def _swing_start(self, landed: Solved, where: float) -> bool:
        """Replace a first frame that may turn freely by the member of its family that leads to ``landed``.

        Coaxial clamps and no weight leave the first shape undetermined up to a rotation; the next pose determines
        it. Returns False where the way back from ``landed`` ends in another shape, which makes the jump a snap.
        """
        first, start = self.frames[0], float(self.motion[0])
        swung, reached = follow(self._path(landed.case), landed, where, start, self.solver)
        energy = float(first.rod.energy())
        if reached != start or abs(float(swung.rod.energy()) - energy) > SAME_ENERGY * (1.0 + abs(energy)):
            return False
        self.frames = self._no_frames()
        self._append(swung)
        return True

    def _no_frames(self) -> Frames:
        """Return a place for frames."""
        return Frames(most_held=MOST_HELD // len(self.problem.cables))

    def _failure(self, frame: int, reason: str) -> str:
        """Return the sentence for the user."""
        return (
            f"cable {self.name}, frame {frame} of {len(self.motion)} (motion {self.motion[frame]:.4f}): {reason}; "
            "try a smaller motion.spatial_step, more length, or another bow or number of turns"
        )
