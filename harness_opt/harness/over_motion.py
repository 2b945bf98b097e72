"""Everything that is free in a harness, found over a motion: what its spans are then held by, one by one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness_opt.errors import Status
from harness_opt.harness.balance import Harness, State
from harness_opt.harness.between import Filled, filled
from harness_opt.harness.first_pose import first_state
from harness_opt.harness.following import Progress, follow_harness
from harness_opt.harness.freedoms import Freedoms, with_found
from harness_opt.harness.rest import at_rest, posed, reheld
from harness_opt.model.cable import CableRun
from harness_opt.model.ends import ENDS, Clip, End
from harness_opt.model.problem import Problem, held_as
from harness_opt.model.spans import joints
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.statics.fitting import Fitted, own_turns, turned
from harness_opt.statics.solve import Solved

MOST_FITS = 20  # of a harness, until the rolls on both sides of its clips agree
TURN_STEPS = 16  # a turn: as an end is turned on after it was fitted, 22 degrees at a time


@dataclass(frozen=True)
class FoundHarness:
    """A harness over the frames of a motion.

    Args:
        problem: in spans, everything free in it where it was found, as far as it was followed.
        freedoms: of the harness.
        states: of the frames.
        snaps: (frame, motion) of each jump.
        status, message: why it ended early; OK and empty otherwise.
        fitted: as it was fitted, where rolls were found so; those of untwisted ends turned freely there.
    """

    problem: Problem
    freedoms: Freedoms
    states: Sequence[State]
    snaps: tuple[tuple[int, float], ...]
    status: Status
    message: str
    fitted: State | None = None

    def solves(self, span: str) -> list[Solved]:
        """Return the solves of ``span`` in all frames."""
        number = self.freedoms.spans.index(span)
        return [state.spans[number].solved for state in self.states]

    def fit(self, run: CableRun, span: str) -> Fitted | None:
        """Return how ``span``, described as ``run``, was fitted; None where there was nothing to fit."""
        if self.fitted is None or run.untwisted is None:
            return None
        own = self.fitted.spans[self.freedoms.spans.index(span)]
        return Fitted(run, own.solved, own.solved.bound.mesh, own.units.length)


def find(
    freedoms: Freedoms,
    motion: Array,
    solver: str,
    progress: Progress | None = None,
    *,
    between: bool = True,
    near: FoundHarness | None = None,
) -> FoundHarness:
    """Find what is free in a harness over ``motion`` (P,).

    Args:
        freedoms: of the harness, its problem in spans.
        motion: values of the frames.
        solver: name of the one that the spans are solved by.
        progress: as of :func:`~harness_opt.harness.following.follow_harness`.
        between: whether it is to be known between the frames as exactly as in them.
        near: a like harness to start from; None leaves it to a cold start from the clamps.
    """
    begun = _begun(freedoms, float(motion[0]), solver, near)
    problem, names = begun.problem, ", ".join(freedoms.spans)
    if begun.state is None:
        words = "no pose was found in which it is in balance: its cables may be too short, or slide out of their clips"
        return FoundHarness(problem, freedoms, (), (), Status.NO_START, f"harness of {names}: {words}")
    followed = follow_harness(begun.state, motion, progress)
    states = followed.states
    jumps = sorted({frame for frame, _ in followed.snaps if frame < len(states)})
    way = Filled(states, tuple(jumps), ())
    if between:
        way = filled(states, jumps, [0.5] if problem.out_and_back else [])
    at = np.array([state.at for state in way.states])
    found = freedoms.found(at, [state.pose for state in way.states], way.jumps, way.kinks)
    return FoundHarness(
        with_found(freedoms, problem, found), freedoms, states, tuple(followed.snaps), followed.status,
        followed.message, begun.fitted,
    )  # fmt: skip


@dataclass(frozen=True)
class _Begun:
    """A harness at the begin of a motion: its problem, rolls fitted, its state, and as it was fitted, if it was."""

    problem: Problem
    state: State | None
    fitted: State | None = None


def _begun(freedoms: Freedoms, at: float, solver: str, near: FoundHarness | None) -> _Begun:
    """Return a harness at motion value ``at``, the rolls of its untwisted ends fitted.

    All cables of a harness are fitted at one moment, that of the first that is; their untwisted ends turn freely then.
    """
    problem = freedoms.problem
    open_rolls = [span for span in freedoms.spans if problem.cables[span].untwisted is not None]
    to_fit = problem.changed(cables={**problem.cables, **{s: problem.cables[s].to_fit for s in freedoms.spans}})
    fitting = Harness(freedoms.of(to_fit), solver)
    if not open_rolls:
        return _Begun(to_fit, _first(fitting, at, None if near is None else near.states[:1]))
    fitted_at = problem.cables[open_rolls[0]].fitted_at
    fitted = _first(fitting, fitted_at, None if near is None or near.fitted is None else [near.fitted])
    for _ in range(MOST_FITS):  # what lies behind a clip has its roll, and pulls at what lies before it
        carried = None if fitted is None else _carried(freedoms, open_rolls, fitted)
        if fitted is None or carried is None:
            break
        runs = {name: replace(to_fit.cables[name], start=start) for name, start in carried.items()}
        again = Harness(freedoms.of(to_fit.changed(cables={**to_fit.cables, **runs})), solver)
        begun = reheld(again, fitted)
        fitted = None if begun is None else at_rest(begun)
    if fitted is None:
        return _Begun(problem, None)
    problem, state = _held(freedoms, open_rolls, fitted)
    if state is not None and state.at != at:
        followed = follow_harness(state, np.array([state.at, at]))
        state = followed.states[-1] if followed.status.ok else None
    return _Begun(problem, state, fitted)


def _carried(freedoms: Freedoms, open_rolls: Sequence[str], fitted: State) -> dict[str, End] | None:
    """Return the starts of spans behind fixed clips in the rolls that these were fitted in; None where they have them.

    Args:
        freedoms: of the harness, its clips as described.
        open_rolls: spans whose ends are fitted.
        fitted: so far.
    """
    same, found, changed = 1e-9, dict[str, End](), False  # rad
    held = fitted.harness.freedoms
    stood = with_found(held, held.problem, held.found(np.array([fitted.at]), [fitted.pose]))
    for _, before, behind in joints(freedoms.problem):
        if before not in open_rolls or behind not in freedoms.spans:
            continue
        clamp = freedoms.problem.cables[before].end
        q = rotations.normalise(fitted.spans[freedoms.spans.index(before)].solved.rod.q[-1])
        turn = turned(q, own_turns(clamp))
        body = stood.poses(clamp.body, [fitted.at])[1][0]
        own = rotations.multiply(rotations.conjugate(body), turn)
        start = held.problem.cables[behind].start
        now = np.asarray(start.frame)
        off = rotations.small_rotation_vector(rotations.multiply(rotations.conjugate(now), own))
        changed |= bool(np.linalg.norm(off) > same)
        found[behind] = start.held(own)
    return found if changed else None


def _first(harness: Harness, at: float, near: Sequence[State] | None) -> State | None:
    """Return a stable state at motion value ``at``: that which a state ``near`` leads to, or one from a cold start."""
    for state in near or ():
        begun = posed(harness, harness.freedoms.adapted(state.pose), at, [span.solved for span in state.spans])
        rest = None if begun is None else at_rest(begun)
        if rest is not None:
            return rest
    return first_state(harness, at)


def _held(freedoms: Freedoms, open_rolls: Sequence[str], fitted: State) -> tuple[Problem, State | None]:
    """Return the problem and the state with the rolls of ``open_rolls`` held as they were ``fitted``, and turned on."""
    problem, state = freedoms.problem, fitted
    fitting = fitted.harness.freedoms.problem
    stood = with_found(freedoms, fitting, freedoms.found(np.array([fitted.at]), [fitted.pose]))
    ends = [getattr(problem.cables[span], side) for span in open_rolls for side in ENDS]
    steps = math.ceil(TURN_STEPS * max(abs(own_turns(end)) for end in ends))
    held = problem
    for step in range(steps + 1):
        share, runs = step / max(steps, 1), dict(fitting.cables)
        for span in open_rolls:
            run, solved = problem.cables[span], fitted.spans[freedoms.spans.index(span)].solved
            frames = rotations.normalise(solved.rod.q[[0, -1]])
            rolled = [
                turned(frame, share * own_turns(end)) for frame, end in zip(frames, (run.start, run.end), strict=True)
            ]
            one = held_as(stood.changed(cables=problem.cables), span, fitted.at, rolled)
            runs[span] = one.cables[span].to_fit
            if isinstance(run.start, Clip):  # in the roll that the span before it was fitted in
                runs[span] = replace(runs[span], start=fitting.cables[span].start)
        held = problem.changed(cables=runs)
        begun = reheld(Harness(freedoms.of(held), fitted.harness.solver), state)
        rest = None if begun is None else at_rest(begun)
        if rest is None:
            return held, None
        state = rest
    return held, state
