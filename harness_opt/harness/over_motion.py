"""Everything that is free in a harness, found over a motion: what its spans are then held by, one by one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from harness_opt.errors import Status
from harness_opt.harness.balance import Harness, State
from harness_opt.harness.between import Filled, filled
from harness_opt.harness.first_pose import first_state
from harness_opt.harness.following import Progress, follow_harness
from harness_opt.harness.freedoms import Freedoms, with_found
from harness_opt.harness.rest import at_rest, reheld
from harness_opt.model.ends import ENDS
from harness_opt.model.problem import Problem, held_as
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.statics.fitting import own_turns, turned
from harness_opt.statics.solve import Solved

TURN_STEPS = 16  # a turn: as an end is turned on after it was fitted, 22 degrees at a time


@dataclass(frozen=True)
class FoundHarness:
    """A harness over the frames of a motion.

    Args:
        problem: in spans, everything free in it where it was found, as far as it was followed.
        solves: of the spans, by name, a solve a frame.
        snaps: (frame, motion) of each jump.
        status, message: why it ended early; OK and empty otherwise.
    """

    problem: Problem
    solves: Mapping[str, Sequence[Solved]]
    snaps: tuple[tuple[int, float], ...]
    status: Status
    message: str


def find(
    freedoms: Freedoms, motion: Array, solver: str, progress: Progress | None = None, *, between: bool = True
) -> FoundHarness:
    """Find what is free in a harness over ``motion`` (P,), from its clamps alone.

    Args:
        freedoms: of the harness, its problem in spans.
        motion: values of the frames.
        solver: name of the one that the spans are solved by.
        progress: as of :func:`~harness_opt.harness.following.follow_harness`.
        between: whether it is to be known between the frames as exactly as in them.
    """
    problem, first = _begun(freedoms, float(motion[0]), solver)
    names = ", ".join(freedoms.spans)
    if first is None:
        words = "no pose was found in which it is in balance: its cables may be too short for what holds them"
        return FoundHarness(problem, {}, (), Status.NO_START, f"harness of {names}: {words}")
    followed = follow_harness(first, motion, progress)
    states = followed.states
    jumps = sorted({frame for frame, _ in followed.snaps if frame < len(states)})
    way = Filled(states, tuple(jumps), ())
    if between:
        way = filled(states, jumps, [0.5] if problem.out_and_back else [])
    at = np.array([state.at for state in way.states])
    found = freedoms.found(at, [state.pose for state in way.states], way.jumps, way.kinks)
    solves = {span: [state.spans[number].solved for state in states] for number, span in enumerate(freedoms.spans)}
    return FoundHarness(
        with_found(freedoms, problem, found), solves, tuple(followed.snaps), followed.status, followed.message
    )


def _begun(freedoms: Freedoms, at: float, solver: str) -> tuple[Problem, State | None]:
    """Return the problem with the rolls that untwisted ends are fitted in, and the state at motion value ``at``.

    All cables of a harness are fitted at one moment, that of the first that is; their untwisted ends turn freely then.
    """
    problem = freedoms.problem
    open_rolls = [span for span in freedoms.spans if problem.cables[span].untwisted is not None]
    to_fit = problem.changed(cables={**problem.cables, **{s: problem.cables[s].to_fit for s in freedoms.spans}})
    fitting = Harness(freedoms.of(to_fit), solver)
    if not open_rolls:
        return to_fit, first_state(fitting, at)
    fitted_at = problem.cables[open_rolls[0]].fitted_at
    state = first_state(fitting, fitted_at)
    if state is None:
        return problem, None
    stood = with_found(freedoms, to_fit, freedoms.found(np.array([fitted_at]), [state.pose]))
    frames = {
        span: rotations.normalise(state.spans[freedoms.spans.index(span)].solved.rod.q[[0, -1]]) for span in open_rolls
    }
    ends = [getattr(problem.cables[span], side) for span in open_rolls for side in ENDS]
    steps = math.ceil(TURN_STEPS * max(abs(own_turns(end)) for end in ends))
    for step in range(steps + 1):
        share = step / max(steps, 1)
        runs = dict(to_fit.cables)
        for span in open_rolls:
            run = problem.cables[span]
            rolled = [
                turned(frame, share * own_turns(end))
                for frame, end in zip(frames[span], (run.start, run.end), strict=True)
            ]
            held = held_as(stood.changed(cables=problem.cables), span, fitted_at, rolled).cables[span]
            runs[span] = held.to_fit
        harness = Harness(freedoms.of(problem.changed(cables=runs)), solver)
        begun = None if state is None else reheld(harness, state)
        state = None if begun is None else at_rest(begun)
    problem = harness.freedoms.problem
    if state is not None and state.at != at:
        followed = follow_harness(state, np.array([state.at, at]))
        state = followed.states[-1] if followed.status.ok else None
    return problem, state
