"""The limits of a problem, held against a simulated motion: worst value, margin and where, for each."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from harness_opt.clearance.pairs import ClearanceResult
from harness_opt.model.problem import Problem
from harness_opt.model.results import CableMotion, LimitResult, Motion
from harness_opt.numerics.rotations import Array

LOOKED_AT = "only the stations of the solved frames were looked at"
STRAIGHT = 1e-9  # 1/m; below this curvature the bend radius is given as that of a straight cable


def bending(cable: CableMotion) -> Array:
    """Return the curvature of the centreline (P, N), 1/m: the length of the Darboux vector's bending part."""
    return np.linalg.norm(cable.curvature[..., :2], axis=-1)


def between_stations(value: Array) -> Array:
    """Return how much a smooth quantity (P, N) may exceed its samples: an eighth of its second differences, (P,)."""
    return 0.125 * np.max(np.abs(np.diff(value, n=2, axis=1)), axis=1)


def _row(
    name: str, limit: float, value: Array, cable: str, shapes: CableMotion, motion: Array, tolerance: float
) -> LimitResult:
    """Return the row of a quantity ``value`` (P, N) that must stay below ``limit``."""
    frame, station = np.unravel_index(int(np.argmax(value)), value.shape)
    worst = float(value[frame, station])
    return LimitResult(
        name, limit, worst, limit - worst, cable, int(frame), float(motion[frame]), float(shapes.s[station]), None,
        False, tolerance, LOOKED_AT,
    )  # fmt: skip


def cable_limits(problem: Problem, motion: Motion) -> tuple[LimitResult, ...]:
    """Return the rows of all limits but clearance: bend radius, twist, clamp force and clamp moment of every cable.

    The rows are not certified: between the stations a value may be worse by ``tolerance``, estimated from second
    differences, and between the frames nothing is known.
    """
    limits, rows = problem.limits, []
    for name, shapes in motion.cables.items():
        if limits.bend_radius is not None:
            rows.append(_bend_row(limits.bend_radius, name, shapes, motion.motion))
        if limits.twist is not None:
            twist = np.abs(shapes.curvature[..., 2])
            tolerance = float(np.max(between_stations(twist)))
            rows.append(_row("twist", limits.twist, twist, name, shapes, motion.motion, tolerance))
        for name_of_limit, limit, load in (
            ("clamp_force", limits.clamp_force, shapes.force),
            ("clamp_moment", limits.clamp_moment, shapes.moment),
        ):
            if limit is None:
                continue
            at_clamps = np.zeros(load.shape[:2])
            at_clamps[:, [0, -1]] = np.linalg.norm(load[:, [0, -1]], axis=-1)
            rows.append(_row(name_of_limit, limit, at_clamps, name, shapes, motion.motion, 0.0))
    return tuple(rows)


def _bend_row(limit: float, name: str, shapes: CableMotion, motion: Array) -> LimitResult:
    curvature = bending(shapes)
    frame, station = np.unravel_index(int(np.argmax(curvature)), curvature.shape)
    worst = 1.0 / max(float(curvature[frame, station]), STRAIGHT)
    tolerance = worst**2 * float(np.max(between_stations(curvature)))
    return LimitResult(
        "bend_radius", limit, worst, worst - limit, name, int(frame), float(motion[frame]), float(shapes.s[station]),
        None, False, tolerance, LOOKED_AT,
    )  # fmt: skip


def all_limits(problem: Problem, motion: Motion, clearances: ClearanceResult) -> tuple[LimitResult, ...]:
    """Return the rows of every limit of ``problem``."""
    return (*clearances.limits, *cable_limits(problem, motion))


def limit_label(name: str, cable: str, part: str | None) -> str:
    """Return the words for a limit, such as "clearance of lead to bracket"."""
    return f"{name.replace('_', ' ')} of {cable}" + (f" to {part}" if part else "")


def held(rows: Sequence[LimitResult]) -> bool:
    """Return whether every limit holds."""
    return all(row.margin >= 0 for row in rows)


def most_urgent(problem: Problem, rows: Sequence[LimitResult]) -> LimitResult:
    """Return the row that people look at first.

    A violated limit comes before one that holds, clearance before bend radius before the rest, and then the smallest
    margin.

    Args:
        problem: whose limits they are.
        rows: at least one.
    """
    order = {"clearance": 0, "bend_radius": 1}

    def urgency(row: LimitResult) -> tuple[bool, int, float]:
        scale = row.limit + problem.cables[row.cable].cable.radius
        return row.margin >= 0, order.get(row.name, 2), row.margin / scale

    return min(rows, key=urgency)
