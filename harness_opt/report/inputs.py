"""What was put in, as tables for a page: cables, clamps as position and direction, motions, limits."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from harness_opt.model.bodies import Hinge, Poses, Slide
from harness_opt.model.cable import CableRun, End
from harness_opt.model.problem import Problem
from harness_opt.model.travel import travels
from harness_opt.numerics import rotations

Json = dict[str, Any]

HEAD_CABLES = ("Cable", "Length", "Diameter", "Bending stiffness", "Torsional stiffness", "Mass", "As made")
HEAD_CLAMPS = ("Clamp", "Held by", "Position, mm", "Direction along the cable", "Roll")
HEAD_BODIES = ("Body", "Motion", "From", "To")


def input_tables(problem: Problem) -> Iterator[Json]:
    """Give the tables, each as ``head`` and ``rows``."""
    yield {"head": HEAD_CABLES, "rows": [_cable(name, run) for name, run in problem.cables.items()]}
    clamps = [
        (f"{name}, {side}", *_clamp(end))
        for name, run in problem.cables.items()
        for side, end in (("start", run.start), ("end", run.end))
    ]
    yield {"head": HEAD_CLAMPS, "rows": clamps}
    moving = {way.body: way for way in travels(problem)}
    bodies = [(name, motion_words(problem, name), moving[name].at(0.0), moving[name].at(1.0)) for name in moving]
    if bodies:
        yield {"head": HEAD_BODIES, "rows": bodies}


def _cable(name: str, run: CableRun) -> tuple[str, ...]:
    cable = run.cable
    kx, ky, kz = cable.stiffness
    bending = f"{kx:.4g} N m2" if kx == ky else f"{kx:.4g} (about d1), {ky:.4g} (about d2) N m2"
    made = f"curved, {_numbers(cable.rest_curvature)} 1/m" if any(cable.rest_curvature) else "straight"
    mass = f"{1e3 * cable.mass_per_length:.4g} g/m"
    return name, f"{1e3 * cable.length:.6g} mm", f"{1e3 * cable.diameter:.4g} mm", bending, f"{kz:.4g} N m2", mass, made


def _clamp(end: End) -> tuple[str, ...]:
    if end.position is not None:
        place = _numbers(1e3 * np.asarray(end.position))
    else:
        place = "free" if end.force is None else f"pulled by {_numbers(end.force)} N"
    way = direction(end)
    if way is not None:
        told = _numbers(way)
    else:
        told = "free" if end.moment is None else f"turned by {_numbers(end.moment)} N m"
    return end.body, place, told, roll_words(end)


def direction(end: End) -> rotations.Array | None:
    """Return the unit tangent (3,) of a clamp in its body's coordinates; None where it is free."""
    if end.tangent is not None:
        return rotations.normalise(np.asarray(end.tangent, dtype=float))
    return None if end.quaternion is None else rotations.tangent(np.asarray(end.quaternion, dtype=float))


def roll_words(end: End) -> str:
    """Return how a clamp holds the cable about its tangent."""
    turns = f", {end.turns:+g} turns" if end.turns else ""
    if end.roll is not None:
        return {"untwisted": "as it comes, untwisted", "free": "free to turn (swivel)"}[end.roll] + turns
    if end.roll_deg is not None:
        return f"{end.roll_deg:g} deg{turns}"
    if end.swivel:
        return "free to turn (swivel)"
    return f"by its quaternion{turns}" if end.quaternion is not None else "-"


def motion_words(problem: Problem, name: str) -> str:
    """Return how a body moves: about which line, or which way."""
    motion = problem.body(name).motion
    if isinstance(motion, Hinge):
        return f"turns about {_numbers(motion.axis)} through {_numbers(1e3 * np.asarray(motion.point))} mm"
    if isinstance(motion, Slide):
        return f"slides along {_numbers(motion.direction)}"
    if isinstance(motion, Poses):
        return f"follows {len(motion.times)} poses" + ("" if motion.file is None else f" of {motion.file.name}")
    return "stands still"


def _numbers(values: Sequence[float] | rotations.Array) -> str:
    return f"({', '.join(f'{value:.4g}' for value in np.asarray(values, dtype=float) + 0.0)})"
