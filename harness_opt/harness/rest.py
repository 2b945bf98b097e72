"""A harness let go: down its energy to a pose at which it is in balance, and stable."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from harness_opt.harness.balance import NEUTRAL, Harness, State
from harness_opt.harness.freedoms import Pose
from harness_opt.numerics.rotations import Array
from harness_opt.rod.boundary import Case
from harness_opt.statics.continuation import follow, step
from harness_opt.statics.mesh import refine
from harness_opt.statics.release import is_stable, release, stabilised
from harness_opt.statics.solve import Solved, solve_on

BALANCED = 1e-11  # of the loads, that may be left of a pose at rest: what the spans are solved to
FOLLOWED = 1e-9  # of the loads, that may be left on a path: less is lost in what the spans' own correctors leave
STILL = 1e-8  # rad, and lengths of a span, that a pose may be off: a tenth of what it is known to between the frames
ROUNDED = 1e-8  # of the loads, up to which what is left may be rounding: of stiff cables in light harnesses
ACCURATE = 1e-9  # estimated error of the spans, in their lengths: what pulls at a joint is as right as its cable


def moved(state: State, way: Array, at: float | None = None, *, lets_go: bool = False) -> State | None:
    """Return ``state`` after a ``way`` (n,) in all freedoms, without dimensions; None where a span cannot follow.

    Args:
        state, way: as above.
        at: motion value; None stays at that of the state.
        lets_go: whether a span that loses its shape on the way is released to another.
    """
    pose = state.harness.freedoms.moved(state.pose, way * state.harness.scales, state.placed)
    near = [span.solved for span in state.spans]
    return posed(state.harness, pose, state.at if at is None else at, near, lets_go=lets_go)


def posed(
    harness: Harness,
    pose: Pose,
    at: float,
    near: Sequence[Solved],
    *,
    guesses: Sequence[Array | None] | None = None,
    lets_go: bool = False,
) -> State | None:
    """Return the state at ``pose`` and motion value ``at``, its spans continued from those ``near``; None in vain.

    Args:
        harness, pose, at, near: as above.
        guesses: unknowns of the spans to begin with, on the meshes of those near; None takes theirs.
        lets_go: as of :func:`moved`.
    """
    placed = harness.freedoms.placed(pose, at)
    cases = harness.cases(placed, near)
    if cases is None:
        return None
    solves = []
    for case, here, guess in zip(cases, near, guesses or [None] * len(near), strict=True):
        begin = here if guess is None else replace(here, solution=replace(here.solution, x=guess))
        solved = step(case, begin, None, 0.0, harness.solver) or _continued(case, here, harness.solver, lets_go)
        if solved is None:
            return None
        solves.append(solved)
    return harness.state(at, pose, placed, solves)


def _continued(case: Case, here: Solved, solver: str, lets_go: bool) -> Solved | None:
    """Return the shape of ``case`` that ``here`` leads to; None where it is lost on the way, and not let go."""
    begin = here.case
    solved, reached = follow(lambda share: begin.blend(case, share), here, 0.0, 1.0, solver)
    if reached != 1.0:
        return release(case, solved.rod, solver, short_steps=False) if lets_go else None
    solved = solve_on(case, solved.bound.mesh, solved.solution.x, solver, near=solved)
    return solved if solved.ok else None


def reheld(harness: Harness, state: State) -> State | None:
    """Return ``state`` as a harness of the same cables that are held otherwise has it; None where a span is lost."""
    placed, solves = harness.freedoms.placed(state.pose, state.at), []
    cases = harness.cases(placed, [span.solved for span in state.spans])
    if cases is None:
        return None
    for case, span in zip(cases, state.spans, strict=True):
        rod, mesh = span.solved.rod, span.solved.bound.mesh
        solved = solve_on(case.signed_like(rod.q[0], rod.q[-1]), mesh, span.solved.solution.x, harness.solver)
        if not solved.ok:
            return None
        solves.append(solved)
    return harness.state(state.at, state.pose, placed, solves)


def newton(state: State, most: int = 12, like: State | None = None, balanced: float = BALANCED) -> State | None:
    """Return the balanced state next to ``state`` by Newton's method; None where it does not come to one.

    Args:
        state: where to begin.
        most: corrections.
        like: a state nearby, whose Hessian serves as long as it leads on well.
        balanced: of the loads, that may be left.
    """
    far = 0.5  # rad, and lengths of a span: beyond any corrector
    slow = 0.1  # of what was left, that a correction with another state's Hessian is to leave at most
    matrix, own = (like or state).matrix, like is None
    for _ in range(most):
        way = np.asarray(np.linalg.lstsq(matrix, -state.slope, rcond=NEUTRAL)[0], dtype=float)
        if state.miss <= balanced and np.max(np.abs(way), initial=0.0) <= STILL:
            return state
        following = moved(state, way) if np.max(np.abs(way), initial=0.0) < far else None
        if following is None:
            return None
        if following.miss > 0.5 * state.miss and state.miss <= ROUNDED:
            return min(state, following, key=lambda one: one.miss)
        if following.miss > slow * state.miss and not own:
            matrix, own = following.matrix, True
        else:  # what the step has shown of the Hessian: Broyden's update
            matrix = matrix + np.outer(following.slope - state.slope - matrix @ way, way) / (way @ way)
        state = following
    return state if state.miss <= ROUNDED else None


def descend(state: State) -> State | None:
    """Return the pose at rest to which ``state`` goes down its energy; None where no span follows it there.

    By steps of a trust region with the Hessian's eigenvectors (Conn, Gould, Toint, "Trust-Region Methods", section
    7.3); next to the rest Newton's method ends it, where the energy's differences are rounding.
    """
    most_steps, smallest, largest = 200, 1e-9, 0.5  # rad, and lengths of a span
    cornered = 0.03  # room in which a span that cannot follow has come to the end of its shapes
    near = 1e-6  # of the loads, from which Newton's method is tried
    room = 0.2
    for _ in range(most_steps):
        if state.miss <= near and state.index == 0:
            ended = newton(state)
            if ended is not None and ended.index == 0:
                return ended
        way, gain = _step(state, room)
        if gain <= 0.0 or room < smallest:
            break
        following = moved(state, way, lets_go=room < cornered)
        if following is None:
            room *= 0.25
            continue
        lower = (state.energy - following.energy) / state.harness.stiff
        rounding = 1e-13 * (1.0 + abs(state.energy) / state.harness.stiff)
        better = lower > 0.1 * gain or (gain < 10.0 * rounding and following.miss < state.miss)
        if better:
            if lower > 0.75 * gain:
                room = min(largest, 2.0 * room)
            state = following
        else:
            room *= 0.25
    return newton(state) if state.miss <= 1e-3 and state.index == 0 else None


def _step(state: State, room: float) -> tuple[Array, float]:
    """Return a step (n,) of at most ``room`` down the energy's quadratic model, and by how much that falls."""
    values, vectors = state.curvature
    along = vectors.T @ state.slope
    stiff = np.maximum(np.abs(values), state.neutral + 1e-300)
    if values[0] < -state.neutral and abs(along[0]) < 1e-6 * state.load:
        along[0] = np.copysign(1e-6 * state.load, along[0])  # off a saddle, where the slope does not say to which side
    low, high = 0.0, float(np.linalg.norm(along)) / room
    way = -along / stiff
    if np.linalg.norm(way) > room:
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if np.linalg.norm(along / (stiff + middle)) > room else (low, middle)
        way = -along / (stiff + high)
    gain = -float(along @ way + 0.5 * way @ (values * way))
    return vectors @ way, gain


def accurate(state: State) -> State | None:
    """Return the balanced state on meshes that resolve every span; None where it is lost there."""
    solves = [refine(span.solved, ACCURATE, state.harness.solver)[0] for span in state.spans]
    if all(a is b.solved for a, b in zip(solves, state.spans, strict=True)):
        return state
    return newton(state.harness.state(state.at, state.pose, state.placed, solves))


def at_rest(state: State) -> State | None:
    """Return the stable state to which a harness goes from ``state``, resolved; None where none is found."""
    most_releases = 6  # of spans that turned over on the way, and of poses that were saddles
    for _ in range(most_releases):
        rest = descend(state)
        rest = None if rest is None else accurate(rest)
        if rest is None:
            return None
        solver = rest.harness.solver
        stable = [stabilised(span.solved, solver) for span in rest.spans]
        if rest.index == 0 and all(a is b.solved for a, b in zip(stable, rest.spans, strict=True)):
            return rest
        if any(one is None for one in stable):
            return None
        state = rest.harness.state(rest.at, rest.pose, rest.placed, [one for one in stable if one is not None])
    return None


def is_at_rest(state: State) -> bool:
    """Return whether a balanced state is stable: its pose, and its spans between their ends."""
    return state.index == 0 and all(is_stable(span.solved, state.harness.solver) for span in state.spans)
