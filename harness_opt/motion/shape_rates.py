"""How shapes change with the design: implicit differentiation of the discretised equilibrium.

From R(x, p) = 0 follows dx/dp = -J^-1 dR/dp with the factorised Jacobian of the last solve: one back-substitution for
each design variable, whatever the number of limits (Griewank and Walther, "Evaluating Derivatives", section 15).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from harness_opt.harness.balance import State
from harness_opt.harness.over_motion import FoundHarness
from harness_opt.harness.rates import followed_by
from harness_opt.harness.span_loads import LENGTH, POSITION, ROTATION, SIZE
from harness_opt.model.design_variables import ClampRates, clamp_rates
from harness_opt.model.ends import ENDS, Clip
from harness_opt.model.problem import Problem
from harness_opt.model.spans import spans_of
from harness_opt.motion.sweep import Sweep, SweptSpans
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.rod.boundary import Boundary
from harness_opt.rod.equations import Section
from harness_opt.rod.states import Rod
from harness_opt.statics.fitting import own_turns, turned


@dataclass(frozen=True)
class ShapeRates:
    """Rates of one cable's shapes at N stations of fixed s/L with k design variables, in P frames, SI.

    Args:
        position: (P, N, 3, k), world.
        curvature: (P, N, 3, k), section frame.
        force, moment: (P, N, 3, k), world.
        unknowns: of the discretised equations themselves, (P, m, k): predicts the shapes of a nearby design.
        length: of the cable, (k,); of a span that slides, of each frame, (P, k).
    """

    position: Array
    curvature: Array
    force: Array
    moment: Array
    unknowns: Array
    length: Array


@dataclass(frozen=True)
class _NodeRates:
    """Dimensionless rates of the states at the nodes, each (P, n + 1, 3 or 4, k), of rest curvature and load (3, k), or
    (P, 1, 3, k) of a span in a harness, and of the unknowns (P, m, k)."""

    q: Array
    r: Array
    force: Array
    moment: Array
    rest: Array
    load: Array
    unknowns: Array


def clamps_of_spans(problem: Problem, design: Array, motion: Array, swept: SweptSpans) -> dict[str, ClampRates]:
    """Return how the clamps of all spans move with the design, the rolls that clips were fitted in carried on.

    What is free in a harness follows, and with it the clamps that it carries.

    Args:
        problem: of whole cables, before the design is applied.
        design: values of the k variables.
        motion: (P,) of the frames.
        swept: the spans with the design.
    """
    found, before = dict[str, ClampRates](), None
    problem = problem.changed(found=swept.whole.found)
    for name, span in spans_of(problem).items():
        if name in found:  # with its harness
            before = name
            continue
        group = swept.harnesses.get(name)
        there = dict[str, ClampRates]()
        for own in [name] if group is None else group.freedoms.spans:
            clamps = clamp_rates(problem, own, design, motion)
            clip = problem.cables[span.cable].clamps[span.clamps[0]]
            if own == name and isinstance(clip, Clip) and clip.roll == "untwisted" and before is not None:
                turn = held_turns(swept.sweeps[before], found[before])[1]
                fitted = None if clamps.fitted is None else dataclasses.replace(clamps.fitted, start_turn=turn)
                clamps = dataclasses.replace(clamps, start_turn=turn, fitted=fitted)
            found[own] = clamps
            if group is not None and group.fitted is not None:
                at = np.array([group.fitted.at])
                there[own] = clamps.fitted or clamp_rates(problem, own, design, at)
        if group is not None:
            found |= _of_harness(group, {own: found[own] for own in group.freedoms.spans}, there, swept)
        before = name
    return found


def _of_harness(
    group: FoundHarness, clamps: Mapping[str, ClampRates], there: Mapping[str, ClampRates], swept: SweptSpans
) -> dict[str, ClampRates]:
    """Return ``clamps`` of a harness's spans with what is free in it following the design.

    Args:
        group: the harness.
        clamps: how they move where everything free is held.
        there: the same in the one frame where the harness was fitted.
        swept: the spans.
    """
    held = dict(clamps)
    if group.fitted is not None:
        rates = _following([group.fitted], there)
        for number, name in enumerate(group.freedoms.spans):
            if clamps[name].fitted is None:
                continue
            turns = held_turns(swept.sweeps[name], dataclasses.replace(clamps[name], fitted=rates[name]))
            fitted = swept.sweeps[name].fitted
            assert fitted is not None
            carried = []
            for side, frame in enumerate(fitted.frames):  # what carries the end turned with it: not the end in it
                boundary = group.fitted.spans[number].solved.case.boundary
                clamp = (boundary.start_quaternion, boundary.end_quaternion)[side]
                own = rotations.matrix(rotations.multiply(rotations.conjugate(frame), rotations.normalise(clamp)))
                both = ((one.start_turn, one.end_turn)[side] for one in (rates[name], there[name]))
                total, still = (turn if turn.ndim == 2 else turn[0] for turn in both)
                is_fitted = ENDS[side] == fitted.run.untwisted
                carried.append(own @ (total - still) if is_fitted else np.zeros_like(total))
            start, end = (turn - by for turn, by in zip(turns, carried, strict=True))
            held[name] = dataclasses.replace(clamps[name], start_turn=start, end_turn=end, fitted=None)
    return _following(group.states, held)


def _following(states: Sequence[State], clamps: Mapping[str, ClampRates]) -> dict[str, ClampRates]:
    """Return ``clamps`` as they move where what is free follows, in the frames of ``states`` (P,)."""
    names = states[0].harness.freedoms.spans
    count = len(clamps[names[0]].length)
    moved = {name: np.zeros((len(states), SIZE, count)) for name in names}
    frames = {name: np.zeros((len(states), 2, 3, 3)) for name in names}
    for frame, state in enumerate(states):
        own = []
        for number, name in enumerate(names):
            boundary, ends = state.spans[number].solved.case.boundary, np.zeros((SIZE, count))
            held = (boundary.start_quaternion, boundary.end_quaternion)
            for side, quaternion in enumerate(held):
                clamp = clamps[name]
                frames[name][frame, side] = rotations.matrix(rotations.normalise(quaternion))
                ends[POSITION[side]] = (clamp.start, clamp.end)[side][frame]
                turn = _own_frame(state, number, side, frames[name][frame, side])
                ends[ROTATION[side]] = turn @ (clamp.start_turn, clamp.end_turn)[side]
            ends[LENGTH] = clamps[name].length
            own.append(ends)
        for name, ends in zip(names, followed_by(state, own), strict=True):
            moved[name][frame] = ends
    return {
        name: ClampRates(
            rates[:, POSITION[0]],
            rates[:, POSITION[1]],
            np.swapaxes(frames[name][:, 0], -1, -2) @ rates[:, ROTATION[0]],
            np.swapaxes(frames[name][:, 1], -1, -2) @ rates[:, ROTATION[1]],
            rates[:, LENGTH],
        )
        for name, rates in moved.items()
    }


def _own_frame(state: State, span: int, side: int, frame: Array) -> Array:
    """Return the frame (3, 3) in which a design turns the clamp of a span: its ``frame``, or that of a clip as drawn.

    None turns a clip that holds the cable's place alone.
    """
    freedoms = state.harness.freedoms
    number = freedoms.ends[span][side].clip
    if number is None:
        return frame
    clip = freedoms.clips[number].clip
    if clip.freedoms > 1 or clip.frame is None:
        return np.zeros((3, 3))
    carried = rotations.multiply(state.placed.clips[number], rotations.conjugate(state.pose.frames[number]))
    return rotations.matrix(rotations.multiply(carried, clip.frame))


def held_turns(swept: Sweep, clamps: ClampRates) -> tuple[Array, Array]:
    """Return the rates of the frames that the ends are held in, each (3, k), with those of a roll that was fitted.

    The fit is an equilibrium like any other: its unknowns follow the design by the same formula, and with them the
    frame of the end that turned freely.
    """
    turns = {"start": clamps.start_turn, "end": clamps.end_turn}
    if swept.fitted is not None and clamps.fitted is not None:
        fitted, there = swept.fitted, clamps.fitted
        side, solved = fitted.run.untwisted, fitted.solved
        length = swept.units.length if fitted.length is None else fitted.length
        longer, start_turn, end_turn = (
            values if values.ndim == ndim else values[0]
            for values, ndim in ((there.length / length, 1), (there.start_turn, 2), (there.end_turn, 2))
        )
        x, boundary = solved.solution.x, solved.case.boundary
        change = solved.bound.rates(
            x, gap=(there.end[0] - there.start[0]) / length - np.outer(boundary.gap, longer),
            start_turn=start_turn, end_turn=end_turn,
            rest=np.outer(solved.case.section.rest_curvature, longer), load=np.outer(solved.case.load, 3.0 * longer),
            loads=_applied_rates(boundary, longer),
        )  # fmt: skip
        dx = -solved.factor.solve(change)
        frames = solved.bound.quaternions(x)[[0, -1]]
        node = 0 if side == "start" else -1
        moved = dx[solved.bound.transcription.quaternions[node]]
        own = 2.0 * rotations.multiply(rotations.conjugate(frames[node]), moved.T)[:, 1:]
        on = turned(np.array(rotations.IDENTITY), own_turns(getattr(fitted.run, str(side))))
        turns[str(side)] = turns[str(side)] + rotations.rotate(rotations.conjugate(on), own).T
    return turns["start"], turns["end"]


def _node_rates(swept: Sweep, clamps: ClampRates, exact: bool) -> _NodeRates:
    count, held = clamps.length.shape[-1], held_turns(swept, clamps)
    q, r, force, moment, unknowns, rests, loads = [], [], [], [], [], [], []
    for k, frame in enumerate(swept.frames):
        bound, x, length = frame.bound, frame.solution.x, float(swept.lengths[k])
        longer = (clamps.length if clamps.length.ndim == 1 else clamps.length[k]) / length
        # f L^3 / B and omega_rest L grow with the length
        rest = np.outer(frame.case.section.rest_curvature, longer)
        load = np.outer(frame.case.load, 3.0 * longer)
        start_turn, end_turn = (turn if turn.ndim == 2 else turn[k] for turn in held)
        gap = (clamps.end[k] - clamps.start[k]) / length - np.outer(bound.boundary.gap, longer)
        change = bound.rates(
            x, gap=gap, start_turn=start_turn, end_turn=end_turn, rest=rest, load=load,
            loads=_applied_rates(bound.boundary, longer),
        )  # fmt: skip
        rests.append(rest)
        loads.append(load)
        left_behind = None if exact else frame.solution.factor
        dx = -(left_behind or frame.factor).solve(change)
        unknowns.append(dx)
        stride = bound.transcription.stages + 1
        _, places, turns = bound.centreline_rates(x, dx)
        r.append(places[::stride])
        q.append(turns[::stride])
        moment.append(bound.moment_rates(dx))
        force.append(dx[-3:] - bound.mesh[:, None, None] * load)
    stacked = [
        np.stack(v).reshape(len(swept.frames), -1, c, count) for v, c in ((q, 4), (r, 3), (force, 3), (moment, 3))
    ]
    if clamps.length.ndim > 1:  # they differ from frame to frame
        rest, load = np.stack(rests)[:, None], np.stack(loads)[:, None]
    return _NodeRates(stacked[0], stacked[1], stacked[2], stacked[3], rest, load, np.stack(unknowns))


def _applied_rates(boundary: Boundary, longer: Array) -> dict[str, Array]:
    """Return the rates of the dimensionless end loads, F L^2 / B and M L / B, of a cable that grows by shares (k,)."""
    return {
        f"{side}_{load}": np.outer(getattr(boundary, f"{side}_{load}"), power * longer)
        for side in ("start", "end")
        for load, power in (("force", 2.0), ("moment", 1.0))
    }


def _moved(rod: Rod, nodes: _NodeRates, number: int, step: float) -> Rod:
    """Return ``rod`` with variable ``number`` moved by ``step``, to first order."""
    return Rod(
        Section(rod.section.stiffness, rod.section.rest_curvature + step * nodes.rest[..., number]),
        rod.load + step * nodes.load[..., number],
        rod.mesh,
        rod.q + step * nodes.q[..., number],
        rod.r + step * nodes.r[..., number],
        rod.force + step * nodes.force[..., number],
        rod.moment + step * nodes.moment[..., number],
    )


def shape_rates(swept: Sweep, clamps: ClampRates, stations: Array, *, exact: bool = True) -> ShapeRates:
    """Return the rates of all quantities of a swept cable.

    Args:
        swept: the cable, P frames.
        clamps: what moves its clamps, k variables.
        stations: arc lengths over the length, (N,).
        exact: False takes the factors that the solver has left behind, of a frame nearby: mostly good to a per cent, at
            worst to a tenth (lift_arm, drawer), for a step of an optimiser.
    """
    # The rates of the states at the nodes are exact; what is sampled between the nodes follows from them by a central
    # difference of the sampling alone, with a step that turns no section by more than this, rad.
    sampling_step = 1e-4
    nodes, rod, units = _node_rates(swept, clamps, exact), swept.rod, swept.units.at(swept.lengths)
    count, frames = clamps.length.shape[-1], len(swept.frames)
    here = rod.sample(stations)
    out = {name: np.zeros((frames, len(stations), 3, count)) for name in ("r", "omega", "force", "moment")}
    for j in range(count):
        largest = max(float(np.max(np.abs(nodes.q[..., j]))), 1e-12)
        step = sampling_step / largest
        ahead = _moved(rod, nodes, j, step).sample(stations)
        # one side is good to SAMPLING_STEP: far better than factors of a frame nearby
        behind, apart = (_moved(rod, nodes, j, -step).sample(stations), 2.0 * step) if exact else (here, step)
        for name, rate in out.items():
            rate[..., j] = (getattr(ahead, name) - getattr(behind, name)) / apart
    # of all frames alike, or of each: beside stations and their three numbers
    rate = clamps.length if clamps.length.ndim == 1 else clamps.length[:, None, None]
    length, force, moment = (unit[..., None] for unit in units)
    longer = rate / length
    moved = out["r"] * length + here.r[..., None] * rate
    if frames and not swept.frames[0].case.boundary.kind.start_position:
        origin = clamps.end - moved[:, -1]
    else:
        origin = clamps.start
    return ShapeRates(
        origin[:, None] + moved,
        (out["omega"] - here.omega[..., None] * longer) / length,
        force * (out["force"] - 2.0 * here.force[..., None] * longer),
        moment * (out["moment"] - here.moment[..., None] * longer),
        nodes.unknowns,
        clamps.length,
    )
