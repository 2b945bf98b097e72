"""What a redesign may change: reading design variables from a problem, writing them into it, and what they move."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from harness_opt.errors import ProblemError
from harness_opt.model.design import Variable
from harness_opt.model.ends import ENDS, Clip, End, Side
from harness_opt.model.limits import quoted
from harness_opt.model.problem import Problem
from harness_opt.model.spans import Span, in_spans, spans_of
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array

AXES = ("x", "y", "z")
TURNS = tuple(f"rotate_{axis}_deg" for axis in AXES)
ALONG = 1e-9  # sine of the angle to the x axis, below which a tangent lies along it: as rotations.from_tangent


@dataclass(frozen=True)
class Target:
    """What a variable's name stands for.

    Args:
        cable: its name.
        clamp: "start", "end", or the name of a clip; None for the length.
        quantity: "length", "at" (the arc length at a clip), "position" or "rotate".
        axis: 0, 1 or 2; 0 for arc lengths.
    """

    cable: str
    clamp: str | None
    quantity: Literal["length", "at", "position", "rotate"]
    axis: int = 0


def target(name: str) -> Target:
    """Return what ``name`` stands for.

    ``CABLE.length``, ``CABLE.CLAMP.position.x`` and ``CABLE.CLAMP.rotate_x_deg``, the clamp "start", "end" or a clip,
    ``CABLE.CLIP.at``. No name of a cable or a clip holds a dot.

    Raises:
        ProblemError: a name of another form.
    """
    cable, *rest = name.split(".")
    match rest:
        case ["length"]:
            return Target(cable, None, "length")
        case [clamp, "at"]:
            return Target(cable, clamp, "at")
        case [clamp, "position", letter] if letter in AXES:
            return Target(cable, clamp, "position", AXES.index(letter))
        case [clamp, turn] if turn in TURNS:
            return Target(cable, clamp, "rotate", TURNS.index(turn))
    raise ProblemError(
        f"design.variables.{name}: found no such quantity, expected CABLE.length, CABLE.start.position.x or "
        "CABLE.end.rotate_x_deg and the like"
    )


def names(problem: Problem) -> list[str]:
    """Return every design variable that ``problem`` could have."""
    found = []
    for cable, run in problem.cables.items():
        found.append(f"{cable}.length")
        for side, end in run.clamps.items():
            if isinstance(end, Clip):
                found.append(f"{cable}.{side}.at")
            if end.position is not None:
                found += [f"{cable}.{side}.position.{axis}" for axis in AXES]
            if end.frame is not None:
                found += [f"{cable}.{side}.rotate_{axis}_deg" for axis in AXES]
    return found


def value(problem: Problem, name: str) -> float:
    """Return the present value of ``name``; turns are 0, being counted from the pose given."""
    what = target(name)
    run = problem.cables[what.cable]
    if what.quantity == "rotate":
        return 0.0
    if what.clamp is None:
        return run.cable.length
    clamp: Any = run.clamps[what.clamp]
    return float(clamp.at if what.quantity == "at" else clamp.position[what.axis])


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

    Clamps turn about their own d1, then d2, then d3; those with a tangent about the axes projected on it, and then
    about it. Bounds on turns are kept as they are; see :func:`rebased`.
    """
    runs = dict(problem.cables)
    turns: dict[tuple[str, str], dict[int, float]] = {}
    names, matrix, offset = _linear(problem)
    for name, number in zip(names, (matrix @ np.asarray(design, dtype=float) + offset).tolist(), strict=True):
        what = target(name)
        run = runs[what.cable]
        if what.clamp is None:
            runs[what.cable] = dataclasses.replace(run, cable=dataclasses.replace(run.cable, length=number))
            continue
        clamp = run.clamps[what.clamp]
        if what.quantity == "at":
            runs[what.cable] = run.with_clamp(what.clamp, dataclasses.replace(clamp, at=number))  # type: ignore[call-arg]
        elif what.quantity == "position":
            position = list(clamp.position)  # type: ignore[arg-type]
            position[what.axis] = number
            moved = dataclasses.replace(clamp, position=tuple(position))  # type: ignore[arg-type]
            runs[what.cable] = run.with_clamp(what.clamp, moved)
        else:
            turns.setdefault((what.cable, what.clamp), {})[what.axis] = number
    for (cable, name), angles in turns.items():
        runs[cable] = runs[cable].with_clamp(name, _turned(runs[cable].clamps[name], angles))
    changed: Problem = problem.changed(cables=runs)
    if wrong := misplaced(changed):
        raise ProblemError(wrong)
    return changed


def misplaced(problem: Problem) -> list[str]:
    """Return where clips do not follow each other along their cables, a line each, by the key that is too small."""
    found = []
    for span in spans_of(problem).values():
        if not span.last > span.first:
            before, here = span.clamps
            key = "length" if here == "end" else f"clips.{quoted(here)}.at"
            words = f"found {span.last:g} in the design, expected more than {span.first:g}, where clip {before} is"
            found.append(f"cables.{quoted(span.cable)}.{key}: {words}")
    return found


def _turned(end: End, angles: dict[int, float]) -> End:
    """Return ``end`` turned by ``angles`` (deg, by axis), in its own words."""
    if end.tangent is None:
        turned = rotations.multiply(np.asarray(end.quaternion), _turn(angles))
        return dataclasses.replace(end, quaternion=tuple(turned.tolist()))
    frame, about = _tilted(end, angles), angles.get(2, 0.0)
    tilted = any(angles.get(axis) for axis in (0, 1))
    tangent = tuple(rotations.tangent(frame).tolist()) if tilted else end.tangent
    if end.roll_deg is not None:
        section = rotations.multiply(frame, _turn({2: end.roll_deg + about}))
        left = rotations.multiply(rotations.conjugate(rotations.from_tangent(tangent)), section)
        roll = float(np.rad2deg(rotations.small_rotation_vector(left)[2])) if tilted else end.roll_deg + about
        return dataclasses.replace(end, tangent=tangent, roll_deg=roll)
    turns = end.turns + about / 360.0 if end.roll == "untwisted" else end.turns
    return dataclasses.replace(end, tangent=tangent, turns=turns)


def _tilted(end: End, angles: dict[int, float]) -> Array:
    """Return the frame (4,) projected on the tangent of ``end``, turned about its d1 and then its d2 (deg, by axis)."""
    tilt = {axis: angle for axis, angle in angles.items() if axis < 2}
    return rotations.multiply(rotations.from_tangent(end.tangent), _turn(tilt))  # type: ignore[arg-type]


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
        start_turn, end_turn: of the clamps' orientations, in their own section frames, (3, k), rad per unit; of the
            untwisted end that is fitted, only by how much it is turned on from there.
        length: (k,), m per unit.
        fitted: the same where the cable is fitted, in the one frame there; None where nothing is to be fitted.
    """

    start: Array
    end: Array
    start_turn: Array
    end_turn: Array
    length: Array
    fitted: ClampRates | None = None


def clamp_rates(problem: Problem, name: str, design: Array, motion: Array) -> ClampRates:
    """Return the rates of the clamps of a span with respect to all k design variables at ``design`` (k,).

    Args:
        problem: the problem before :func:`apply`.
        name: of the span, in :func:`~harness_opt.model.spans.spans_of`; of a cable without clips, its own.
        design: present values.
        motion: (P,) of the frames.
    """
    span, run = spans_of(problem)[name], in_spans(problem).cables[name]
    rates = _rates(problem, span, design, motion, as_fitted=False)
    if run.untwisted is None:
        return rates
    there = _rates(problem, span, design, np.array([run.fitted_at]), as_fitted=True)
    return dataclasses.replace(rates, fitted=there)


def _rates(problem: Problem, span: Span, design: Array, motion: Array, *, as_fitted: bool) -> ClampRates:
    """Return :func:`clamp_rates` without those of the fit, or, ``as_fitted``, of the ends before they are turned on."""
    names, matrix, offset = _linear(problem)
    place = dict(zip(names, matrix @ np.asarray(design, dtype=float) + offset, strict=True))
    count, run = len(names), in_spans(problem).cables[span.name]
    targets = [target(name) for name in names]
    angles: dict[str, dict[int, float]] = {"start": {}, "end": {}}
    sides: dict[str | None, Side] = dict(zip(span.clamps, ENDS, strict=True))  # type: ignore[arg-type]
    for name, what in zip(names, targets, strict=True):
        if what.cable == span.cable and what.clamp in sides and what.quantity == "rotate":
            angles[sides[what.clamp]][what.axis] = float(place[name])
    moves = {side: np.zeros((len(motion), 3, count)) for side in ENDS}
    turn = {side: np.zeros((3, count)) for side in ENDS}
    length = np.zeros(count)
    for j, what in enumerate(targets):
        if what.cable != span.cable:
            continue
        side = sides.get("end" if what.quantity == "length" else what.clamp)
        if side is None:
            continue
        end = problem.cables[span.cable].clamps[span.clamps[ENDS.index(side)]]
        if what.quantity in ("length", "at"):
            length[j] = 1.0 if side == "end" else -1.0
        elif what.quantity == "position":
            quaternions = problem.poses(end.body, motion)[1]
            moves[side][:, :, j] = rotations.matrix(quaternions)[:, :, what.axis]
        elif end.roll == "untwisted":
            turn[side][:, j] = _untwisted_rates(end, what.axis, angles[side], as_fitted, side == run.untwisted)
        else:
            turn[side][:, j] = _given_rates(end, what.axis, angles[side])
    return ClampRates(
        moves["start"] @ matrix,
        moves["end"] @ matrix,
        turn["start"] @ matrix,
        turn["end"] @ matrix,
        length @ matrix,
    )


def _given_rates(end: End, about: int, angles: dict[int, float]) -> Array:
    """Return the turn (3,), rad a degree, of an end whose roll is given or free, in its final section frame.

    Args:
        end: as drawn.
        about: number of the axis.
        angles: deg, by axis.
    """
    # the turns that come after this one carry its axis along
    after = {axis: angle for axis, angle in angles.items() if axis > about}
    if end.roll_deg is not None and about < 2:
        after[2] = after.get(2, 0.0) + end.roll_deg
    axis = rotations.rotate(rotations.conjugate(_turn(after)), np.eye(3)[about])
    turns = end.roll == "free" or (end.tangent is not None and end.roll is None and end.roll_deg is None)
    if turns and about < 2:  # it turns about its tangent whatever turns it there
        axis = _in_projection(end, angles, _tilt_axis(about, angles))
    found: Array = np.deg2rad(1.0) * np.asarray(axis)
    return found


def _tilt_axis(about: int, angles: dict[int, float]) -> Array:
    """Return the axis (3,) of a turn about d1 or d2 of a projected frame, in the frame tilted by ``angles``."""
    after = {1: angles.get(1, 0.0)} if about == 0 else {}
    return rotations.rotate(rotations.conjugate(_turn(after)), np.eye(3)[about])


def _in_projection(end: End, angles: dict[int, float], axis: Array) -> Array:
    """Return ``axis`` (3,) of the tilted frame in the frame projected on its tangent."""
    tilted = _tilted(end, angles)
    projected = rotations.from_tangent(rotations.tangent(tilted))
    return rotations.rotate(rotations.multiply(rotations.conjugate(projected), tilted), axis)


def _untwisted_rates(end: End, about: int, angles: dict[int, float], as_fitted: bool, found: bool) -> Array:
    """Return the turn (3,), rad a degree, of an untwisted end in its section frame.

    Args:
        end, about, angles: as above.
        as_fitted: before it is turned on.
        found: whether its roll is found by fitting, and not the projection's.
    """
    if about == 2:
        return np.zeros(3) if as_fitted else np.deg2rad(1.0) * np.eye(3)[2]
    if found and not as_fitted:
        return np.zeros(3)
    tilt = _in_projection(end, angles, _tilt_axis(about, angles))
    # the projected d1 turns about the tangent as that tilts: d2 . d1' = (d3 . e) w1 / |e - (d3 . e) d3|, e the axis
    projected = rotations.from_tangent(rotations.tangent(_tilted(end, angles)))
    d1, _, d3 = rotations.matrix(projected).T
    reference = np.eye(3)[0 if np.linalg.norm(np.cross(d3, np.eye(3)[0])) > ALONG else 1]
    tilt[2] = tilt[0] * (d3 @ reference) / (d1 @ reference)
    if not as_fitted:
        turns = end.turns + angles.get(2, 0.0) / 360.0
        tilt = rotations.rotate(rotations.conjugate(_turn({2: 360.0 * turns})), tilt)
    result: Array = np.deg2rad(1.0) * np.asarray(tilt)
    return result
