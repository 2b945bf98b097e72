"""What a further measurement would help most with: what is known least, and the measurements that could be made.

Each is added to the normal equations with the error that it has by experience.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from harness_opt.errors import HarnessError
from harness_opt.measured.measurements import Measurements, Pose
from harness_opt.measured.pose import Shaped, force_at, rates, shaped, tip
from harness_opt.model.cable import Cable
from harness_opt.model.ends import End
from harness_opt.numerics.rotations import Array

WELL = 0.05  # half an interval, as a share of a stiffness, that nobody improves on
Sides = Sequence[tuple[Cable, Cable, float]]  # the cable with a little more and less of each parameter, half the change


def advice(
    given: Measurements,
    cable: Cable,
    sides: Sides,
    shapes: Sequence[Shaped | float],
    normal: Array,
    halves: Array,
) -> str:
    """Return what a further measurement would help most with what is known least; nothing where all is known well.

    Args:
        given: what was measured.
        cable: found.
        sides: of it, for each parameter.
        shapes: of the measurements.
        normal: J^T J of the parameters (k, k).
        halves: half the widths of their intervals, (k,).
    """
    worst = int(np.argmax(halves))
    if halves[worst] < WELL:
        return ""
    name = given.sought[worst].replace("_", " ").replace(".", " ")
    widths = {words: _width(normal + np.outer(row, row), worst) for words, row in _further(given, cable, sides, shapes)}
    if not widths:
        return f"{name} is known least, and nothing of what is usually measured depends on it"
    helps = min(widths, key=lambda words: widths[words])
    if not widths[helps] < 0.9 * _width(normal, worst):
        return f"{name} is known least; more of the same measurements would help most"
    return f"{name} is known least; {helps} would help most"


def _width(normal: Array, number: int) -> float:
    """Return the standard deviation of a parameter."""
    return math.sqrt(max(float(inverse_of(normal)[number, number]), 0.0))


def _further(
    given: Measurements, cable: Cable, sides: Sides, shapes: Sequence[Shaped | float]
) -> list[tuple[str, Array]]:
    """Return measurements that could be made, in words, and their rows (k,) over their usual error."""
    gravity = given.gravity
    bending, weight = float(cable.bending_stiffness), cable.mass_per_length * float(np.linalg.norm(gravity))  # type: ignore[arg-type]
    found = []
    if weight > 0:
        # one that sags by a third of itself, or as much as there is of the cable
        length = float(f"{min((3.0 * bending / weight) ** (1 / 3), cable.length):.2g}")
        level = Pose(length, End((0.0, 0.0, 0.0), tangent=(1.0, 0.0, 0.0), roll_deg=0.0), End())
        try:
            piece = shaped(level, cable, gravity)
            row = rates(piece, gravity, sides, tip)[0] / (0.02 * max(tip(piece)[0], 1e-9))
            found.append((f"the sag of {length:g} m held level", row))
        except HarnessError:  # nothing to advise then
            pass
    for one, shape in zip(given.measured, shapes, strict=True):
        if isinstance(shape, Shaped) and one.kind == "loop":
            force = force_at(shape, "start")
            row = rates(shape, gravity, sides, lambda there: force_at(there, "start"))[0] / (0.05 * float(force[0]))
            found.append((f"the force at the start of {one.name}", row))
            break
    # a loop leaves its plane at a twist in proportion to bending over torsional stiffness (Michell; Goriely,
    # "Twisted elastic rings", 2006): to 2 %
    names = {"bending_stiffness": 1.0, "torsional_stiffness": -1.0}
    twist = np.array([names.get(name, 0.0) for name in given.sought]) / 0.02
    if "torsional_stiffness" in given.sought:
        found.append(("the twist at which a loop leaves its plane", twist))
    return found


def inverse_of(normal: Array) -> Array:
    """Return the inverse of normal equations; where nothing tells a direction, with a variance beyond all use."""
    least, beyond = 1e-14, 1e12  # eigenvalue that counts as none, of the largest; and the variance then
    values, vectors = np.linalg.eigh(normal)
    inverse = np.where(values > least * max(float(values[-1]), 1e-300), 1.0 / np.maximum(values, 1e-300), beyond)
    found: Array = (vectors * inverse) @ vectors.T
    return found
