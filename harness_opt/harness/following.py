"""A harness followed over the motion: what is free in it is found in every frame, over folds and snaps.

As a single cable is (:mod:`harness_opt.motion.follower`): a pose is extrapolated, corrected by Newton's method, and
taken where it stays near; stability and accuracy are looked at for many frames together, and gone back to where they
are lost. There the harness is let go.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from harness_opt.errors import Status
from harness_opt.harness.balance import State
from harness_opt.harness.freedoms import Pose
from harness_opt.harness.rest import ACCURATE, FOLLOWED, accurate, at_rest, is_at_rest, moved, newton, posed
from harness_opt.numerics.rotations import Array
from harness_opt.rod.stability import doubt, surely_stable
from harness_opt.statics.continuation import LEAST_STEP, MOST_TURNING, turning
from harness_opt.statics.release import is_stable
from harness_opt.statics.solve import batch, estimates

BATCH = 16  # frames that are looked at together; a lost one sends it back there
MOST_STEPS = 300  # tried on the way from one frame to the next, taken or not
MOST_TRAIL = 5  # states that the next one is predicted from
JUMP = 0.2  # rad, largest turning of a section above which a loss is a snap, as of a single cable
CORRECTIONS = 8  # of Newton's method, of a step that is not too long

Progress = Callable[[str, int, int], None]


@dataclass
class FollowedHarness:
    """A harness over the frames, as far as it could be followed.

    Args:
        states: of the frames.
        snaps: (frame, motion) of each jump.
        status, message: why it ended early; OK and empty otherwise.
    """

    states: list[State] = field(default_factory=list)
    snaps: list[tuple[int, float]] = field(default_factory=list)
    status: Status = Status.OK
    message: str = ""


def follow_harness(first: State, motion: Array, progress: Progress | None = None) -> FollowedHarness:
    """Follow a harness over ``motion`` (P,) from its ``first`` state, at motion[0].

    Args:
        first, motion: as above.
        progress: called with the name of its first span, frames done, frames in all; where it raises KeyboardInterrupt,
            the harness ends there.
    """
    found, trail, checked, careful = FollowedHarness([first]), [first], 1, False
    states = found.states
    while len(states) < len(motion) or checked < len(states):
        frame = len(states)
        if frame < len(motion) and frame - checked < BATCH:
            reached = _walk(trail, float(motion[frame]), careful=careful)
            if not reached:
                if not careful:  # perhaps one of the frames before it is lost already
                    checked = _first_bad(states, checked) or frame
                    trail, careful = _back_to(states, checked), True
                    continue
                if _over_snaps(trail, float(motion[frame]), found, frame) is None:
                    _give_up(found, motion)
                    break
            states.append(trail[-1])
            if careful:
                careful, checked = False, frame + 1
            if progress:
                try:
                    progress(first.harness.freedoms.spans[0], frame + 1, len(motion))
                except KeyboardInterrupt:
                    found.status, found.message = Status.INTERRUPTED, Status.INTERRUPTED.value
                    break
            continue
        bad = _first_bad(states, checked)
        if bad is None:
            checked = len(states)
            continue
        trail, careful, checked = _back_to(states, bad), True, bad
    return found


def _back_to(states: list[State], count: int) -> list[State]:
    """Keep the first ``count`` states alone, and return where to go on from."""
    del states[count:]
    return [states[-1]]


def _give_up(found: FollowedHarness, motion: Array) -> None:
    """Say that the next frame was not found."""
    freedoms, frame = found.states[0].harness.freedoms, len(found.states)
    at = freedoms.problem.moments.words(float(motion[frame]))
    found.status = Status.STEP_TOO_SMALL
    found.message = (
        f"harness of {', '.join(freedoms.spans)}, frame {frame} of {len(motion)} ({at}): the shape was lost and no "
        "stable one was found; try a smaller motion.spatial_step, more length, or other clips"
    )


def _first_bad(states: Sequence[State], first: int) -> int | None:
    """Return the first state from number ``first`` on that is unstable, or whose spans are not resolved."""
    bad = [first + k for k, state in enumerate(states[first:]) if state.index > 0][:1]
    for number in range(len(states[0].spans)):
        solves = [state.spans[number].solved for state in states[first:]]
        begin = 0
        for k in range(1, len(solves) + 1):  # those together that follow each other on one mesh
            if k < len(solves) and np.array_equal(solves[k].bound.mesh, solves[begin].bound.mesh):
                continue
            own = solves[begin:k]
            errors = np.array([error for error, _ in estimates(own)])
            bad += [first + begin + int(np.argmax(errors > ACCURATE))] if np.any(errors > ACCURATE) else []
            if not surely_stable(batch(own), own[0].case.boundary.kind, doubt(errors)):
                solver = states[0].harness.solver
                bad += [first + begin + j for j, one in enumerate(own) if not is_stable(one, solver)][:1]
            begin = k
    return min(bad, default=None)


def _over_snaps(trail: list[State], target: float, found: FollowedHarness, frame: int) -> State | None:
    """Return the state at ``target`` of a harness that was lost on the way there; None in vain.

    Args:
        trail: the last states, to which those on the way are added.
        target: motion value.
        found: what the snaps are added to.
        frame: number of the frame there.
    """
    most_losses = 8  # between two frames
    for _ in range(most_losses):
        released = _released(trail[-1], target)
        if released is None:
            return None
        if _turned(trail[-1], released) > JUMP:
            found.snaps.append((frame, released.at))
        trail[:] = [released]
        if _walk(trail, target, careful=True):
            return trail[-1]
    return None


def _walk(trail: list[State], target: float, *, careful: bool) -> bool:
    """Follow the last state of ``trail`` towards ``target`` as far as it goes, and add those on the way.

    Returns whether it came there. ``careful``: every state on the way is resolved and stable, or not taken.
    """
    begin = trail[-1].at
    shortest, length = abs(target - begin) * LEAST_STEP, target - begin
    for _ in range(MOST_STEPS):
        here = trail[-1]
        if here.at == target:
            return True
        at = target if abs(target - here.at) <= abs(length) * (1.0 + 1e-9) else here.at + length
        taken = _step(trail, at)
        if careful and taken is not None:
            taken = accurate(taken)
            taken = taken if taken is not None and is_at_rest(taken) else None
        if taken is None:
            length *= 0.5
            if abs(length) < shortest:
                return False
            continue
        trail.append(taken)
        del trail[:-MOST_TRAIL]
        length *= 2.0
    return trail[-1].at == target


def walked(near: Sequence[State], at: float) -> State | None:
    """Return the state at motion value ``at`` amid those ``near``, the nearest last; None where none leads there."""
    trail = list(near)
    return trail[-1] if _walk(trail, at, careful=False) else None


def _step(trail: Sequence[State], at: float) -> State | None:
    """Go from the last state of ``trail`` to motion value ``at`` in one step; None where it is too long to be trusted.

    It is predicted by the polynomial in the motion through as many of the last states as are on the same meshes.
    """
    here, same = trail[-1], [trail[-1]]
    for state in reversed(trail[:-1]):
        meshes = zip(state.spans, here.spans, strict=True)
        if not all(np.array_equal(a.solved.bound.mesh, b.solved.bound.mesh) for a, b in meshes):
            break
        same.insert(0, state)
    places = np.array([state.at for state in same])
    weights = np.array([np.prod([(at - q) / (p - q) for q in places if q != p]) for p in places])
    pose = Pose.weighted([state.pose for state in same], weights)
    guesses = [
        weights @ np.array([state.spans[number].solved.solution.x for state in same])
        for number in range(len(here.spans))
    ]
    predicted = posed(here.harness, pose, at, [span.solved for span in here.spans], guesses=guesses)
    if predicted is None:
        return None
    balanced = newton(predicted, CORRECTIONS, here, FOLLOWED)
    return None if balanced is None or _turned(predicted, balanced) > MOST_TURNING else balanced


def _turned(one: State, other: State) -> float:
    """Return the largest turning of a section between two states, rad."""
    return max(
        turning(a.solved.rod.q, b.solved.rod.sample(a.solved.rod.mesh).q)
        for a, b in zip(one.spans, other.spans, strict=True)
    )


def _released(here: State, target: float) -> State | None:
    """Return the state to which a harness goes that is let go just beyond ``here``, or later where none is found."""
    sizes, later = (0.05, 0.2, 0.6), 4  # rad and lengths, to leave what was lost; times further on that it is tried
    beyond = here.at + math.copysign(abs(target - here.at) * LEAST_STEP, target - here.at)
    direction = here.curvature[1][:, 0]
    for wait in np.linspace(0.0, 1.0, later + 1) ** 2:
        at = beyond + float(wait) * (target - beyond)
        for size in sizes:
            for sign in (1.0, -1.0):
                begun = moved(here, sign * size * direction, at, lets_go=True)
                rest = None if begun is None else at_rest(begun)
                if rest is not None:
                    return rest
    return None
