"""How shapes change with the design: implicit differentiation of the discretised equilibrium.

From R(x, p) = 0 follows dx/dp = -J^-1 dR/dp with the factorised Jacobian of the last solve: one back-substitution for
each design variable, whatever the number of limits (Griewank and Walther, "Evaluating Derivatives", section 15).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from harness_opt.model.design_variables import ClampRates, clamp_rates
from harness_opt.model.ends import Clip
from harness_opt.model.problem import Problem
from harness_opt.model.spans import spans_of
from harness_opt.motion.sweep import Sweep
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
        length: of the cable, (k,).
    """

    position: Array
    curvature: Array
    force: Array
    moment: Array
    unknowns: Array
    length: Array


@dataclass(frozen=True)
class _NodeRates:
    """Dimensionless rates of the states at the nodes, each (P, n + 1, 3 or 4, k), of rest curvature and load (3, k),
    and of the unknowns (P, m, k)."""

    q: Array
    r: Array
    force: Array
    moment: Array
    rest: Array
    load: Array
    unknowns: Array


def clamps_of_spans(
    problem: Problem, design: Array, motion: Array, sweeps: Mapping[str, Sweep]
) -> dict[str, ClampRates]:
    """Return how the clamps of all spans move with the design, the rolls that clips were fitted in carried on.

    Args:
        problem: of whole cables, before the design is applied.
        design: values of the k variables.
        motion: (P,) of the frames.
        sweeps: by span.
    """
    found, before = {}, None
    for name, span in spans_of(problem).items():
        clamps = clamp_rates(problem, name, design, motion)
        clip = problem.cables[span.cable].clamps[span.clamps[0]]
        if isinstance(clip, Clip) and clip.roll == "untwisted" and before is not None:
            turn = held_turns(sweeps[before], found[before])[1]
            fitted = None if clamps.fitted is None else dataclasses.replace(clamps.fitted, start_turn=turn)
            clamps = dataclasses.replace(clamps, start_turn=turn, fitted=fitted)
        found[name], before = clamps, name
    return found


def held_turns(swept: Sweep, clamps: ClampRates) -> tuple[Array, Array]:
    """Return the rates of the frames that the ends are held in, each (3, k), with those of a roll that was fitted.

    The fit is an equilibrium like any other: its unknowns follow the design by the same formula, and with them the
    frame of the end that turned freely.
    """
    turns = {"start": clamps.start_turn, "end": clamps.end_turn}
    if swept.fitted is not None and clamps.fitted is not None:
        fitted, there = swept.fitted, clamps.fitted
        side, solved, units = fitted.run.untwisted, fitted.solved, swept.units
        longer = there.length / units.length
        x, boundary = solved.solution.x, solved.case.boundary
        change = solved.bound.rates(
            x, gap=(there.end[0] - there.start[0]) / units.length - np.outer(boundary.gap, longer),
            start_turn=there.start_turn, end_turn=there.end_turn,
            rest=np.outer(solved.case.section.rest_curvature, longer), load=np.outer(solved.case.load, 3.0 * longer),
            loads=_applied_rates(boundary, there, units.length),
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
    first = swept.frames[0].case
    units, count = swept.units, len(clamps.length)
    longer = clamps.length / units.length
    # f L^3 / B and omega_rest L grow with the length
    rest = np.outer(first.section.rest_curvature, longer)
    load = np.outer(first.load, 3.0 * longer)
    start_turn, end_turn = held_turns(swept, clamps)
    q, r, force, moment, unknowns = [], [], [], [], []
    for k, frame in enumerate(swept.frames):
        bound, x = frame.bound, frame.solution.x
        gap = (clamps.end[k] - clamps.start[k]) / units.length - np.outer(bound.boundary.gap, longer)
        change = bound.rates(
            x, gap=gap, start_turn=start_turn, end_turn=end_turn, rest=rest, load=load,
            loads=_applied_rates(bound.boundary, clamps, units.length),
        )  # fmt: skip
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
    return _NodeRates(stacked[0], stacked[1], stacked[2], stacked[3], rest, load, np.stack(unknowns))


def _applied_rates(boundary: Boundary, clamps: ClampRates, length: float) -> dict[str, Array]:
    """Return the rates of the dimensionless end loads: F L^2 / B and M L / B grow with the length."""
    return {
        f"{side}_{load}": np.outer(getattr(boundary, f"{side}_{load}"), power * clamps.length / length)
        for side in ("start", "end")
        for load, power in (("force", 2.0), ("moment", 1.0))
    }


def _moved(rod: Rod, nodes: _NodeRates, number: int, step: float) -> Rod:
    """Return ``rod`` with variable ``number`` moved by ``step``, to first order."""
    return Rod(
        Section(rod.section.stiffness, rod.section.rest_curvature + step * nodes.rest[:, number]),
        rod.load + step * nodes.load[:, number],
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
    nodes, rod, units = _node_rates(swept, clamps, exact), swept.rod, swept.units
    count, frames = len(clamps.length), len(swept.frames)
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
    longer = clamps.length / units.length
    moved = out["r"] * units.length + here.r[..., None] * clamps.length
    if frames and not swept.frames[0].case.boundary.kind.start_position:
        origin = clamps.end - moved[:, -1]
    else:
        origin = clamps.start
    return ShapeRates(
        origin[:, None] + moved,
        (out["omega"] - here.omega[..., None] * longer) / units.length,
        units.force * (out["force"] - 2.0 * here.force[..., None] * longer),
        units.moment * (out["moment"] - here.moment[..., None] * longer),
        nodes.unknowns,
        clamps.length,
    )
