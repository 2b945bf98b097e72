"""A harness followed over the motion: what is free in it is found in every frame, over folds and snaps.

The steps are those of a single cable (:mod:`harness_opt.statics.continuation`): a pose is extrapolated, corrected by
Newton's method, and taken only where it stays near and is stable; a harness that loses its shape is let go there.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from harness_opt.errors import Status
from harness_opt.harness.balance import Harness, State
from harness_opt.harness.rest import accurate, at_rest, is_at_rest, moved, newton, posed
from harness_opt.numerics.rotations import Array
from harness_opt.statics.continuation import LEAST_STEP, MOST_TURNING, turning

MOST_STEPS = 300  # tried on the way from one frame to the next, taken or not
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
        progress: called with the name of its first span, frames done, frames in all; one that raises KeyboardInterrupt
            ends it.
    """
    harness = first.harness
    found, before = FollowedHarness([first]), None
    for frame in range(1, len(motion)):
        here = found.states[-1]
        state, before = _to(harness, here, before, float(motion[frame]), found, frame)
        if state is None:
            names = ", ".join(harness.freedoms.spans)
            at = harness.freedoms.problem.moments.words(float(motion[frame]))
            found.status = Status.STEP_TOO_SMALL
            found.message = (
                f"harness of {names}, frame {frame} of {len(motion)} ({at}): the shape was lost and no stable one was "
                "found; try a smaller motion.spatial_step, more length, or other clips"
            )
            break
        found.states.append(state)
        if progress:
            progress(harness.freedoms.spans[0], frame + 1, len(motion))
    return found


def _to(
    harness: Harness, here: State, before: State | None, target: float, found: FollowedHarness, frame: int
) -> tuple[State | None, State | None]:
    """Return the state at ``target``, and the one before it on the way, over snaps if need be; None in vain."""
    most_losses = 8  # between two frames
    for _ in range(most_losses):
        state, before = _walk(here, before, target)
        if state.at == target:
            return state, before
        released = _released(state, target)
        if released is None:
            return None, None
        if _apart(state, released):
            found.snaps.append((frame, released.at))
        here, before = released, None
        if here.at == target:
            return here, None
    return None, None


def _walk(here: State, before: State | None, target: float) -> tuple[State, State | None]:
    """Follow a state towards ``target`` as far as it goes; return it, and the one before it on the way."""
    shortest = abs(target - here.at) * LEAST_STEP
    length = target - here.at
    for _ in range(MOST_STEPS):
        if here.at == target:
            break
        at = target if abs(target - here.at) <= abs(length) * (1.0 + 1e-9) else here.at + length
        taken = _step(here, before, at)
        if taken is None:
            length *= 0.5
            if abs(length) < shortest:
                break
            continue
        here, before = taken, here
        length *= 2.0
    return here, before


def _step(here: State, before: State | None, at: float) -> State | None:
    """Go from ``here`` to motion value ``at`` in one step; None where it is too long to be trusted."""
    pose = here.pose
    if before is not None and here.at != before.at:
        pose = pose.ahead(before.pose, (at - here.at) / (here.at - before.at))
    predicted = posed(here.harness, pose, at, [span.solved for span in here.spans])
    if predicted is None:
        return None
    state = newton(predicted, CORRECTIONS)
    if state is None or _turned(predicted, state) > MOST_TURNING:
        return None
    state = accurate(state)
    return state if state is not None and is_at_rest(state) else None


def _turned(one: State, other: State) -> float:
    """Return the largest turning of a section between two states, rad."""
    return max(
        turning(a.solved.rod.q, b.solved.rod.sample(a.solved.rod.mesh).q)
        for a, b in zip(one.spans, other.spans, strict=True)
    )


def _apart(one: State, other: State) -> bool:
    """Whether it is a jump from one state to the next, and not only a lean out of the first."""
    jump = 0.2  # rad, as of a single cable
    return _turned(one, other) > jump


def _released(here: State, target: float) -> State | None:
    """Return the state to which a harness goes that is let go just beyond ``here``, or later where none is found."""
    sizes, later = (0.05, 0.2, 0.6), 4  # rad and lengths, to leave what was lost; times further on that it is tried
    beyond = here.at + math.copysign(abs(target - here.at) * LEAST_STEP, target - here.at)
    direction = here.curvature[1][:, 0]
    for wait in np.linspace(0.0, 1.0, later + 1) ** 2:
        at = beyond + float(wait) * (target - beyond)
        for size in sizes:
            for sign in (1.0, -1.0):
                begun = moved(here, sign * size * direction, at)
                rest = None if begun is None else at_rest(begun)
                if rest is not None:
                    return rest
    return None
