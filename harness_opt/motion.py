"""The whole motion: frames along the path of the clamps, every cable followed from frame to frame.

The paper's dispersion, section 4.2: the moving clamp's trail is cut by a spatial step, one shape is solved for each
point. Here each shape starts from the last ones, and a cable that loses its shape is let go and lands where its
energy is least.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from . import rod as rod_module
from .boundary import Case, case
from .cold_start import cold_start, let_go, stabilise
from .continuation import (
    COARSE,
    ELEMENTS,
    Solved,
    error_estimate,
    error_from_defects,
    follow,
    refined_mesh,
    resample,
    solve_on,
    step,
)
from .errors import SolveError, Status
from .path import given_frames, left_out, place_frames
from .pose import STATIONS, check_method
from .problem import End, Problem
from .results import CableMotion, Motion, Snap
from .rod import Units
from .rotations import Array
from .shape import Rod
from .stability import Stability, stability, surely_stable
from .threads import one_thread

TOLERANCE = 1e-7  # of the centreline over a motion, in lengths of the cable
SAME_ENERGY = 1e-6  # relative difference below which two shapes of one pose are of one neutral family
BATCH = 64  # frames whose stability is checked together; a lost one sends the sweep back to it

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Sweep:
    """One cable followed over the frames, with the solver's own objects; not for keeping.

    Args:
        frames: a solve each, all on one mesh; fewer than asked where ``status`` says so.
        origins: world position of the cable's start, (P, 3), m.
        units: of the cable.
        stability: of the frames, batched.
        errors: estimated, (P,), in lengths of the cable.
        snaps: (frame, motion) of each jump.
        status, message: why the sweep ended early; OK and empty otherwise.
    """

    frames: Sequence[Solved]
    origins: Array
    units: Units
    stability: Stability
    errors: Array
    snaps: tuple[tuple[int, float], ...]
    status: Status
    message: str

    @property
    def rod(self) -> Rod:
        """All frames as one batch."""
        return batch(self.frames)


def batch(frames: Sequence[Solved]) -> Rod:
    """Return the shapes of ``frames``, which share cable and mesh, as one Rod with a leading axis."""
    rods = [frame.rod for frame in frames]
    stacked = {name: np.stack([getattr(r, name) for r in rods]) for name in ("q", "r", "force", "moment")}
    return Rod(rods[0].section, rods[0].load, rods[0].mesh, **stacked)


class _Follower:
    """Follows one cable along the motion; see :func:`sweep`."""

    def __init__(
        self,
        problem: Problem,
        name: str,
        motion: Array,
        solver: str,
        elements: int,
        progress: Progress | None,
    ):
        self.problem, self.name, self.motion, self.solver, self.progress = (
            problem,
            name,
            motion,
            solver,
            progress,
        )
        self.elements = elements
        self.run = problem.cables[name]
        self.gravity = np.asarray(problem.gravity)
        self.frames: list[Solved] = []
        self.snaps: list[tuple[int, float]] = []
        self.kind_ends = problem.ends(name, motion)

    def case_at(self, ends: tuple[End, End], near: Case | None) -> Case:
        """Return the case of ``ends``, its quaternions signed like those of ``near``."""
        posed = case(self.run.cable, *ends, self.gravity)
        return (
            posed if near is None else posed.signed_like(near.boundary.start_quaternion, near.boundary.end_quaternion)
        )

    def start(self, guess: Solved | None) -> Solved | None:
        """Solve the first frame."""
        if guess is not None:
            posed = self.case_at(self.kind_ends[0], guess.case)
            warm = step(posed, dataclasses.replace(guess, case=posed), None, 0.0, self.solver)
            if warm is not None:
                return warm
        bow = None if self.run.bow is None else np.asarray(self.run.bow)
        return cold_start(self.case_at(self.kind_ends[0], None), self.run.end.turns, bow, self.solver)

    def advance(self, guess: Solved | None) -> Solved | None:
        """Solve the next frame from the last ones, or from ``guess``; None where the shape is lost."""
        k = len(self.frames)
        here = self.frames[-1]
        target = self.case_at(self.kind_ends[k], here.case)
        if guess is not None and np.array_equal(guess.bound.mesh, here.bound.mesh):
            warm = step(target, guess, None, 0.0, self.solver)
            if warm is not None:
                return warm
        before = self.frames[-2] if k > 1 and (not self.snaps or self.snaps[-1][0] < k - 1) else None
        ratio = (self.motion[k] - self.motion[k - 1]) / (self.motion[k - 1] - self.motion[k - 2]) if before else 0.0
        solved = step(target, here, before, ratio, self.solver)
        if solved is not None:
            return solved
        last = {"case": here.case}

        def path(at: float) -> Case:
            last["case"] = self.case_at(self.problem.ends(self.name, [at])[0], here.case)
            return last["case"]

        solved, reached = follow(path, here, self.motion[k - 1], self.motion[k], self.solver)
        return solved if reached == self.motion[k] else None

    def snap(self, lost: Solved) -> Solved | None:
        """Let the cable go at the frame now due, from the last shape ``lost``; None where it lands nowhere."""
        k = len(self.frames)
        target = self.case_at(self.kind_ends[k], lost.case)
        landed = let_go(target, lost.rod, self.solver)
        if landed is None:
            return None
        landed = stabilise(landed, self.solver)
        if not (k == 1 and self.swing_start(landed)):
            self.snaps.append((k, float(self.motion[k])))
        return landed

    def append(self, solved: Solved) -> None:
        """Add a frame; all frames are on one mesh, so one that needed a finer mesh takes the others along."""
        mesh = solved.bound.mesh
        if self.frames and not np.array_equal(mesh, self.frames[-1].bound.mesh):
            old = self.frames[-1].bound.mesh
            again = solve_on(solved.case, old, resample(solved.rod, old), self.solver)
            if again.ok and not again.turned and error_estimate(again)[0] < COARSE:
                solved = again
            else:
                self.frames = [solve_on(f.case, mesh, resample(f.rod, mesh), self.solver) for f in self.frames]
        self.frames.append(solved)

    def swing_start(self, landed: Solved) -> bool:
        """Replace a first frame that may turn freely by the member of its family that leads to ``landed``.

        Coaxial clamps and no weight leave the first shape undetermined up to a rotation; the next pose determines
        it. Returns False where the way back from ``landed`` ends in another shape, which makes the jump a snap.
        """
        first = self.frames[0]

        def path(at: float) -> Case:
            return self.case_at(self.problem.ends(self.name, [at])[0], landed.case)

        swung, reached = follow(path, landed, self.motion[1], self.motion[0], self.solver)
        energy = float(first.rod.energy())
        if reached != self.motion[0] or abs(float(swung.rod.energy()) - energy) > SAME_ENERGY * (1.0 + abs(energy)):
            return False
        self.frames = []
        self.append(swung)
        return True

    def run_all(self, guesses: Sequence[Solved | None] | None, together: int) -> tuple[Status, str]:
        """Solve all frames; stability is checked for ``together`` at a time (0: never), and gone back to where lost."""
        checked, total = 0, len(self.motion)
        given: Sequence[Solved | None] = guesses or [None] * total
        first = self.start(given[0])
        if first is None or not first.ok:
            return Status.NO_START, self.failure(0, "no shape joins its two ends there")
        mesh = first.bound.mesh
        if self.elements >= len(mesh):  # asked for more than the first shape needed
            finer = next((m for m in ELEMENTS if m >= self.elements), ELEMENTS[-1])
            mesh = refined_mesh(mesh, error_estimate(first)[1], finer)
            first = solve_on(first.case, mesh, resample(first.rod, mesh), self.solver)
            if not first.ok or first.turned:
                return Status.NO_START, self.failure(0, "the first shape could not be refined")
        self.frames.append(first)
        while True:
            while len(self.frames) < total and (not together or len(self.frames) - checked < together):
                solved = self.advance(given[len(self.frames)]) or self.snap(self.frames[-1])
                if solved is None:
                    return Status.STEP_TOO_SMALL, self.failure(
                        len(self.frames), "the shape was lost and none found again"
                    )
                self.append(solved)
                if self.progress:
                    self.progress(self.name, len(self.frames), total)
            if not together:
                return Status.OK, ""
            rods, kind = batch(self.frames[checked:]), first.case.boundary.kind
            lost = np.zeros(0, dtype=int) if surely_stable(rods, kind) else np.flatnonzero(stability(rods, kind).index)
            lost = lost[[checked + k not in {f for f, _ in self.snaps} for k in lost]] if len(lost) else lost
            if len(lost) and checked + lost[0] > 0:
                k = checked + int(lost[0])
                unstable = self.frames[k]
                del self.frames[k:]
                self.snaps = [(f, at) for f, at in self.snaps if f < k]
                landed = self.snap(unstable)
                if landed is None:
                    return Status.STEP_TOO_SMALL, self.failure(
                        k, "the shape became unstable and no stable one was found"
                    )
                self.append(landed)
                checked = k
                continue
            checked = len(self.frames)
            if checked == total:
                return Status.OK, ""

    def failure(self, frame: int, reason: str) -> str:
        """Return the sentence for the user."""
        return (
            f"cable {self.name}, frame {frame} of {len(self.motion)} (motion {self.motion[frame]:.4f}): {reason}; "
            "try a smaller motion.spatial_step, more length, or another bow or number of turns"
        )


def sweep(
    problem: Problem,
    name: str,
    motion: Array,
    *,
    tolerance: float = TOLERANCE,
    solver: str = "gauss-newton",
    elements: int | None = None,
    guesses: Sequence[Solved | None] | None = None,
    margins: bool = True,
    look: bool = False,
    progress: Progress | None = None,
) -> Sweep:
    """Follow the cable ``name`` over ``motion`` (P,).

    Args:
        problem: the problem.
        name: of the cable.
        motion: values of the frames.
        tolerance: of the centreline, in lengths of the cable; the mesh is refined and the frames solved again until
            it holds.
        solver: name.
        elements: least number of elements; None leaves it to the tolerance.
        guesses: solves of a like motion to start from, one a frame or None.
        margins: False leaves the stability margins out (NaN); whether the frames are stable is checked all the same.
        look: leaves out stability and accuracy both, for a first look at a design.
        progress: called with the cable's name, frames done, frames in all.
    """
    follower = _Follower(problem, name, motion, solver, elements or 0, progress)
    try:
        status, message = follower.run_all(guesses, BATCH if not look else 0)
    except KeyboardInterrupt:  # raised by ``progress``: what is solved until here is kept
        status, message = Status.INTERRUPTED, f"cable {name}: {Status.INTERRUPTED.value}"
    frames = follower.frames
    units = rod_module.scale(follower.run.cable)[1]
    if not frames:
        empty = Stability(np.zeros(0), np.zeros(0, dtype=int))
        return Sweep((), np.zeros((0, 3)), units, empty, np.zeros(0), (), status, message)
    errors = np.full(len(frames), np.nan)
    if not look:
        frames, errors = _accurate(frames, tolerance, solver)
    if not look and status.ok and not np.max(errors) <= tolerance:
        worst = int(np.argmax(errors))
        status = Status.INACCURATE
        message = (
            f"cable {name}, frame {worst} of {len(motion)}: {status.value} (estimated error {errors[worst]:.1e} of its "
            f"length, asked for {tolerance:.1e}); try a looser tolerance"
        )
    rods = batch(frames)
    if margins and not look:
        answer = stability(rods, frames[0].case.boundary.kind)
    else:
        answer = Stability(np.full(len(frames), np.nan), np.zeros(len(frames), dtype=int))
    origins = np.array(
        [
            a.position if a.position is not None else np.asarray(b.position) - units.length * r[-1]
            for (a, b), r in zip(follower.kind_ends[: len(frames)], rods.r, strict=True)
        ]
    )
    return Sweep(frames, origins, units, answer, errors, tuple(follower.snaps), status, message)


def _accurate(frames: list[Solved], tolerance: float, solver: str) -> tuple[list[Solved], Array]:
    """Return the frames on a mesh, one for all, on which every estimated error is at most ``tolerance`` where
    possible.
    """
    while True:
        with np.errstate(over="ignore", invalid="ignore"):
            defects = batch(frames).defects()
        estimates = [error_from_defects(frame, *(d[k] for d in defects)) for k, frame in enumerate(frames)]
        errors = np.array([error for error, _ in estimates])
        mesh = frames[0].bound.mesh
        n = len(mesh) - 1
        finer = [m for m in ELEMENTS if m > n]
        if np.max(errors) <= tolerance or not finer:
            return frames, errors
        local = np.max([local for _, local in estimates], axis=0)
        mesh = refined_mesh(mesh, local, finer[0])
        again = [
            solve_on(frame.case, mesh, x, solver)
            for frame, x in zip(frames, resample(batch(frames), mesh), strict=True)
        ]
        if not all(frame.ok and not frame.turned for frame in again):
            return frames, errors
        frames = again


def cable_motion(swept: Sweep, stations: int = STATIONS) -> CableMotion:
    """Return the plain arrays of a sweep at equally spaced stations."""
    units = swept.units
    s = np.linspace(0.0, 1.0, stations)
    samples = swept.rod.sample(s)
    return CableMotion(
        s * units.length,
        swept.origins[:, None, :] + units.length * samples.r,
        samples.q,
        samples.omega / units.length,
        units.force * samples.force,
        units.moment * samples.moment,
        swept.stability.index == 0,
        swept.stability.margin,
        np.array([frame.solution.residual for frame in swept.frames]),
        swept.errors,
    )


@one_thread
def simulate(
    problem: Problem,
    *,
    spatial_step: float | None = None,
    frames: ArrayLike | None = None,
    elements: int | None = None,
    tolerance: float = TOLERANCE,
    solver: str = "gauss-newton",
    transcription: str = "collocation",
    progress: Progress | None = None,
    throw: bool = True,
) -> Motion:
    """Return the shapes of all cables over the whole motion.

    Args:
        problem: what to simulate.
        spatial_step: m; in place of the problem's own.
        frames: motion values (P,) to solve at, increasing within 0 to 1; in place of a spatial step.
        elements: least number of elements of a cable; None leaves it to ``tolerance``.
        tolerance: of the centrelines, in lengths of the cable.
        solver: name, as in :func:`harness_opt.equilibrium`.
        transcription: "collocation"; single poses know the paper's too.
        progress: called with a cable's name, frames done, frames in all.
        throw: raise where a shape cannot be found, or return the motion solved until there.

    Raises:
        ProblemError: ends that no shape can join; frames that do not increase from 0 to 1; a spatial step and frames
            both.
        SolveError: a shape could not be found; ``partial`` is the motion until there.
    """
    check_method(transcription, solver, ("collocation",))
    begin = time.perf_counter()
    motion = place_frames(problem, spatial_step) if frames is None else given_frames(frames, spatial_step)
    sweeps: dict[str, Sweep] = {}
    for name in problem.cables:
        sweeps[name] = sweep(
            problem, name, motion, tolerance=tolerance, solver=solver, elements=elements, progress=progress
        )
        if sweeps[name].status is Status.INTERRUPTED:
            break
    result = collect(problem, motion, sweeps, time.perf_counter() - begin)
    if throw and not result.ok:
        raise SolveError(result.message, result.status, result)
    return result


def collect(problem: Problem, motion: Array, sweeps: Mapping[str, Sweep], seconds: float) -> Motion:
    """Return the motion that ``sweeps`` hold, cut to the frames that all cables with any frame have."""
    frames = min((len(swept.frames) for swept in sweeps.values() if swept.frames), default=0)
    cables = {}
    for name, swept in sweeps.items():
        if swept.frames:
            kept = dataclasses.replace(
                swept,
                frames=swept.frames[:frames],
                origins=swept.origins[:frames],
                stability=Stability(*(getattr(swept.stability, f)[:frames] for f in ("margin", "index"))),
                errors=swept.errors[:frames],
            )
            cables[name] = cable_motion(kept)
    failed = [swept for swept in sweeps.values() if not swept.status.ok]
    snaps = [Snap(name, k, at) for name, swept in sweeps.items() for k, at in swept.snaps if k < frames]
    return Motion(
        problem,
        motion[:frames],
        cables,
        failed[0].status if failed else Status.OK,
        "; ".join(swept.message for swept in failed),
        tuple(snaps),
        left_out(problem),
        {"solve": seconds},
    )
