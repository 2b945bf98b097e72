"""What a redesign may change: reading design variables from a problem, writing them into it, and what they move."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from harness_opt.errors import ProblemError
from harness_opt.model.cable import End
from harness_opt.model.design import Variable
from harness_opt.model.problem import Problem
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array

AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Target:
    """What a variable's name stands for.

    Args:
        cable: its name.
        side: "start" or "end"; None for the length.
        quantity: "length", "position" or "rotate".
        axis: 0, 1 or 2; 0 for the length.
    """

    cable: str
    side: Literal["start", "end"] | None
    quantity: Literal["length", "position", "rotate"]
    axis: int


def target(name: str) -> Target:
    """Return what ``name`` stands for: ``CABLE.length``, ``CABLE.SIDE.position.x``, ``CABLE.SIDE.rotate_x_deg``.

    Raises:
        ProblemError: a name of another form.
    """
    cable, _, rest = name.rpartition(".length")
    if cable and not rest:
        return Target(cable, None, "length", 0)
    for side in ("start", "end"):
        for axis, letter in enumerate(AXES):
            for quantity, ending in (
                ("position", f".{side}.position.{letter}"),
                ("rotate", f".{side}.rotate_{letter}_deg"),
            ):
                if name.endswith(ending) and len(name) > len(ending):
                    return Target(name[: -len(ending)], side, quantity, axis)  # type: ignore[arg-type]
    raise ProblemError(
        f"design.variables.{name}: found no such quantity, expected CABLE.length, CABLE.start.position.x or "
        "CABLE.end.rotate_x_deg and the like"
    )


def names(problem: Problem) -> list[str]:
    """Return every design variable that ``problem`` could have."""
    found = []
    for cable, run in problem.cables.items():
        found.append(f"{cable}.length")
        for side, end in (("start", run.start), ("end", run.end)):
            if end.position is not None:
                found += [f"{cable}.{side}.position.{axis}" for axis in AXES]
            if end.quaternion is not None:
                found += [f"{cable}.{side}.rotate_{axis}_deg" for axis in AXES]
    return found


def value(problem: Problem, name: str) -> float:
    """Return the present value of ``name``; turns are 0, being counted from the pose given."""
    what = target(name)
    run = problem.cables[what.cable]
    if what.quantity == "rotate":
        return 0.0
    if what.side is None:
        return run.cable.length
    return float(getattr(run, what.side).position[what.axis])


def values(problem: Problem) -> Array:
    """Return the present values (k,) of the design variables."""
    return np.array([value(problem, variable.name) for variable in problem.design.variables])


def bounds(problem: Problem) -> tuple[Array, Array]:
    """Return the lower and upper bounds (k,) of the design variables."""
    variables = problem.design.variables
    return np.array([v.lower for v in variables]), np.array([v.upper for v in variables])


def moved(problem: Problem) -> dict[str, tuple[float, float]]:
    """Return what does not stand where the design may begin, by name: where it stands, and where it is moved to.

    Variables outside their bounds are moved inside, and what is coupled goes where it belongs.
    """
    begin = np.clip(values(problem), *bounds(problem))
    names, matrix, offset = _linear(problem)
    told = {}
    for name, place in zip(names, matrix @ begin + offset, strict=True):
        given = value(problem, name)
        if abs(place - given) > 1e-12 * (1.0 + abs(given)):
            told[name] = (given, float(place))
    return told


def lengths(problem: Problem) -> Array:
    """Return how much all cables together grow with each design variable, (k,), m per unit."""
    names, matrix, _ = _linear(problem)
    return np.array([float(target(name).quantity == "length") for name in names]) @ matrix


def _linear(problem: Problem) -> tuple[list[str], Array, Array]:
    """Return the names of all n quantities that change, and matrix (n, k) and offset (n,) that give their values."""
    variables, couplings = problem.design.variables, problem.design.couplings
    names = [variable.name for variable in variables]
    followers = np.zeros((len(couplings), len(names)))
    for row, coupling in zip(followers, couplings, strict=True):
        row[names.index(coupling.leader)] = coupling.factor
    offset = np.array([0.0] * len(names) + [coupling.offset for coupling in couplings])
    return [*names, *(c.name for c in couplings)], np.vstack([np.eye(len(names)), followers]), offset


def _turn(turns: dict[int, float]) -> Array:
    """Return the quaternion of turns (deg) about the clamp's own d1, then d2, then d3, by axis."""
    q = np.array(rotations.IDENTITY)
    for axis in sorted(turns):
        q = rotations.multiply(q, rotations.from_rotation_vector(np.deg2rad(turns[axis]) * np.eye(3)[axis]))
    return q


def apply(problem: Problem, design: Sequence[float] | Array) -> Problem:
    """Return ``problem`` with its design variables set to ``design`` (k,), and what is coupled with them.

    Clamps turn about their own d1, then d2, then d3. Bounds on turns are kept as they are; see :func:`rebased`.
    """
    runs = dict(problem.cables)
    turns: dict[tuple[str, str], dict[int, float]] = {}
    names, matrix, offset = _linear(problem)
    for name, number in zip(names, (matrix @ np.asarray(design, dtype=float) + offset).tolist(), strict=True):
        what = target(name)
        run = runs[what.cable]
        if what.side is None:
            runs[what.cable] = dataclasses.replace(run, cable=dataclasses.replace(run.cable, length=number))
        elif what.quantity == "position":
            end: End = getattr(run, what.side)
            position = list(end.position)  # type: ignore[arg-type]
            position[what.axis] = number
            runs[what.cable] = dataclasses.replace(
                run,
                **{what.side: dataclasses.replace(end, position=tuple(position))},  # type: ignore[arg-type]
            )
        else:
            turns.setdefault((what.cable, what.side), {})[what.axis] = number
    for (cable, side), angles in turns.items():
        end = getattr(runs[cable], side)
        turned = tuple(rotations.multiply(np.asarray(end.quaternion), _turn(angles)).tolist())
        runs[cable] = dataclasses.replace(runs[cable], **{side: dataclasses.replace(end, quaternion=turned)})  # type: ignore[arg-type]
    return dataclasses.replace(problem, cables=runs)


def rebased(problem: Problem, design: Array) -> Problem:
    """Return :func:`apply` with what counts turns counting them from the new poses, as a written file must have it."""
    names, matrix, offset = _linear(problem)
    turned = {
        name: float(number) if target(name).quantity == "rotate" else 0.0
        for name, number in zip(names, matrix @ design + offset, strict=True)
    }
    variables = tuple(
        Variable(v.name, v.lower - turned[v.name], v.upper - turned[v.name]) for v in problem.design.variables
    )
    couplings = tuple(
        dataclasses.replace(c, offset=c.offset + c.factor * turned[c.leader] - turned[c.name])
        for c in problem.design.couplings
    )
    changed = dataclasses.replace(problem.design, variables=variables, couplings=couplings)
    return dataclasses.replace(apply(problem, design), design=changed)


@dataclass(frozen=True)
class ClampRates:
    """How the clamps and the length of one cable move with k design variables, in P frames.

    Args:
        start, end: of the clamps' world positions, (P, 3, k), m per unit of the variable.
        start_turn, end_turn: of the clamps' orientations, in their own section frames, (3, k), rad per unit.
        length: (k,), m per unit.
    """

    start: Array
    end: Array
    start_turn: Array
    end_turn: Array
    length: Array


def clamp_rates(problem: Problem, cable: str, design: Array, motion: Array) -> ClampRates:
    """Return the rates of the clamps of ``cable`` with respect to all k design variables at ``design`` (k,).

    Args:
        problem: the problem before :func:`apply`.
        cable: name.
        design: present values.
        motion: (P,) of the frames.
    """
    names, matrix, offset = _linear(problem)
    place = dict(zip(names, matrix @ np.asarray(design, dtype=float) + offset, strict=True))
    count, run = len(names), problem.cables[cable]
    targets = [target(name) for name in names]
    angles: dict[str, dict[int, float]] = {"start": {}, "end": {}}
    for name, what in zip(names, targets, strict=True):
        if what.cable == cable and what.side is not None and what.quantity == "rotate":
            angles[what.side][what.axis] = float(place[name])
    moves = {side: np.zeros((len(motion), 3, count)) for side in ("start", "end")}
    turn = {side: np.zeros((3, count)) for side in ("start", "end")}
    length = np.zeros(count)
    for j, what in enumerate(targets):
        if what.cable != cable:
            continue
        if what.side is None:
            length[j] = 1.0
        elif what.quantity == "position":
            quaternions = problem.poses(getattr(run, what.side).body, motion)[1]
            moves[what.side][:, :, j] = rotations.matrix(quaternions)[:, :, what.axis]
        else:
            # the turns that come after this one carry its axis along: seen from the final section frame
            after = {axis: angle for axis, angle in angles[what.side].items() if axis > what.axis}
            axis = rotations.rotate(rotations.conjugate(_turn(after)), np.eye(3)[what.axis])
            turn[what.side][:, j] = np.deg2rad(1.0) * axis
    return ClampRates(
        moves["start"] @ matrix,
        moves["end"] @ matrix,
        turn["start"] @ matrix,
        turn["end"] @ matrix,
        length @ matrix,
    )
