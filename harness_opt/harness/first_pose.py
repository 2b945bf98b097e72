"""The first pose of a harness, from its clamps alone: bodies placed within reach of all their cables, then let go."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from harness_opt.harness.balance import Harness, State
from harness_opt.harness.freedoms import Pose, drawn
from harness_opt.harness.rest import at_rest
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.rod.boundary import Case
from harness_opt.statics.cold_start import cold_start
from harness_opt.statics.solve import Solved

SLACK = (0.85, 0.95, 0.7)  # of a span's length, that its ends are set apart at most in a first guess


def first_state(harness: Harness, at: float) -> State | None:
    """Return a stable state at motion value ``at`` found from the clamps alone; None where there is none."""
    for reach in SLACK:
        state = started(harness, guess(harness, at, reach), at)
        rest = None if state is None else at_rest(state)
        if rest is not None:
            return _begun_again(rest)
    return None


def _begun_again(rest: State) -> State:
    """Return a state whose spans have the turns, and the sides they bow to, that they begin with where it rests.

    From a first guess bodies may come to rest half a turn on, and their cables with twist that no one asked for.
    """
    most, gain = 3, 1e-9  # times; of the energy, that is worth another
    for _ in range(most):
        begun = started(rest.harness, rest.pose, rest.at)
        again = None if begun is None else at_rest(begun)
        if again is None or not again.energy < rest.energy - gain * (rest.harness.stiff + abs(rest.energy)):
            break
        rest = again
    return rest


def started(harness: Harness, pose: Pose, at: float) -> State | None:
    """Return the state at ``pose`` with its spans solved from their ends; None where one has no shape there."""
    placed = harness.freedoms.placed(pose, at)
    cases = harness.cases(placed, [None] * len(harness.freedoms.spans))
    if cases is None:
        return None
    solves = [_alone(harness, number, case) for number, case in enumerate(cases)]
    known = [solved for solved in solves if solved is not None]
    return harness.state(at, pose, placed, known) if len(known) == len(solves) else None


def _alone(harness: Harness, number: int, case: Case) -> Solved | None:
    """Return the shape of a span between its ends as they stand; None where none is found."""
    run = harness.freedoms.problem.cables[harness.freedoms.spans[number]]
    bow = None if run.bow is None else np.asarray(run.bow)
    solved = cold_start(case, int(run.end.turns), bow, harness.solver)
    return solved if solved is not None and solved.ok else None


def guess(harness: Harness, at: float, reach: float) -> Pose:
    """Return a pose in which no span's ends are further apart than ``reach`` of its length, where there is one.

    Bodies are drawn towards what their cables are held by, as springs would that only pull beyond that reach, and
    turned so that their cables leave them towards where these go; so is the cable in its clips.
    """
    freedoms = harness.freedoms
    given = [_is_given(harness, body) for body in range(len(freedoms.bodies))]
    pose = _within_reach(harness, drawn(freedoms), at, reach, given)
    places = _shared(harness, pose, at)
    if np.any(places != pose.places):
        pose = _within_reach(harness, replace(pose, places=places), at, reach, [True] * len(given))
    return _turned(harness, pose, at, given)


def _within_reach(harness: Harness, pose: Pose, at: float, reach: float, given: Sequence[bool]) -> Pose:
    """Return ``pose`` with its bodies moved within reach of all their cables; those ``given`` no further than that."""
    rounds, stiff, freedoms = 400, 0.5, harness.freedoms
    for number in range(rounds):
        placed = freedoms.placed(pose, at)
        gap = placed.positions[:, 1] - placed.positions[:, 0]
        distance = np.linalg.norm(gap, axis=1)
        # first to the middle of all that holds them, then only where they do not reach
        excess = np.where(number < rounds // 4, distance, np.maximum(distance - reach * placed.lengths, 0.0))
        pull = np.nan_to_num(gap * (excess / np.maximum(distance, 1e-300))[:, None])
        forces, count = np.zeros_like(pose.positions), np.zeros(len(freedoms.bodies))
        for span, ends in enumerate(freedoms.ends):
            for side, sign in ((0, 1.0), (1, -1.0)):
                carrier = ends[side].carrier
                if carrier is not None and ends[1 - side].carrier != carrier:
                    forces[carrier] += sign * pull[span]
                    count[carrier] += 1
        moves = stiff * forces / np.maximum(count, 1)[:, None]
        if number < rounds // 4:
            moves[np.asarray(given, dtype=bool)] = 0.0
        elif not np.any(forces):
            break
        pose = replace(pose, positions=pose.positions + moves)
    return pose


def _shared(harness: Harness, pose: Pose, at: float) -> Array:
    """Return arc lengths (c,) at the clips through which cables slide that leave every span long enough, m.

    They are those drawn where these do; else what each cable has to spare is shared by the spans as they are long.
    """
    spare = 1.02  # times the distance of its ends, that a span is to be long
    freedoms, places = harness.freedoms, pose.places.copy()
    placed = freedoms.placed(pose, at)
    distance = np.nan_to_num(np.linalg.norm(placed.positions[:, 1] - placed.positions[:, 0], axis=1))
    row: list[int] = []
    for span, (_, end) in enumerate(freedoms.ends):
        row.append(span)
        if end.clip is not None and freedoms.clips[end.clip].clip.slides:
            continue
        lengths, apart = placed.lengths[row], distance[row]
        if len(row) > 1 and np.any(lengths < spare * apart):
            loose = not np.all(apart > 0.0)  # an end that hangs free takes what the others leave
            own = spare * apart if loose else apart * (lengths.sum() / apart.sum())
            behind = np.cumsum(own - lengths)
            for number, moved in zip(row[:-1], behind[:-1], strict=True):
                clip = freedoms.ends[number][1].clip
                assert clip is not None
                places[clip] += moved
        row = []
    return places


def _is_given(harness: Harness, body: int) -> bool:
    """Whether the problem says where a free body is about."""
    return harness.freedoms.problem.bodies[harness.freedoms.bodies[body]].is_placed


def _turned(harness: Harness, pose: Pose, at: float, given: list[bool]) -> Pose:
    """Return ``pose`` with bodies and clips turned to where their cables come from and go to."""
    freedoms = harness.freedoms
    placed = freedoms.placed(pose, at)
    gap = rotations.unit(np.nan_to_num(placed.positions[:, 1] - placed.positions[:, 0]) + 1e-12)
    quaternions, frames = pose.quaternions.copy(), pose.frames.copy()
    for body in range(len(freedoms.bodies)):
        if given[body]:
            continue
        own, wanted = [], []
        for span, ends in enumerate(freedoms.ends):
            for side in (0, 1):
                frame = placed.frames[span, side]
                if ends[side].carrier == body and ends[side].clip is None and not np.any(np.isnan(frame)):
                    own.append(rotations.tangent(frame))
                    wanted.append(gap[span])
        if own:
            quaternions[body] = rotations.multiply(_aligned(np.array(own), np.array(wanted)), quaternions[body])
    pose = replace(pose, quaternions=quaternions)
    placed = freedoms.placed(pose, at)
    for number, clip in enumerate(freedoms.clips):
        if clip.clip.freedoms < 3 or clip.clip.frame is not None:
            continue
        along = [gap[span] for span, ends in enumerate(freedoms.ends) for end in ends if end.clip == number]
        world, frame = placed.clips[number], rotations.from_tangent(_mean(along))
        carried = rotations.multiply(world, rotations.conjugate(pose.frames[number]))
        frames[number] = rotations.multiply(rotations.conjugate(carried), frame)
    return replace(pose, frames=frames)


def _mean(directions: list[Array]) -> Array:
    """Return the direction (3,) between some."""
    total = np.sum(directions, axis=0)
    return total if np.linalg.norm(total) > 1e-6 else directions[0]


def _aligned(own: Array, wanted: Array) -> Array:
    """Return the rotation (4,) that takes directions ``own`` (k, 3) nearest to those ``wanted`` (Kabsch)."""
    u, _, v = np.linalg.svd(wanted.T @ own)
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v)) or 1.0])
    return rotations.from_matrix(u @ flip @ v)
