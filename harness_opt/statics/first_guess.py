"""What a cold start begins with: a curve between the ends of a case, or between nearer ones."""

from __future__ import annotations

import dataclasses

import numpy as np

from harness_opt.numerics.rotations import Array
from harness_opt.rod.boundary import Boundary, Case
from harness_opt.statics.starting_curve import starting_curve

CURVE = 241  # places at which a starting curve is looked at
EASY = 0.1  # slack, in L, with which a taut cable is begun


def loose(boundary: Boundary) -> Boundary:
    """Return ``boundary`` with a gap that leaves EASY for a slack, where it leaves less."""
    kind, distance = boundary.kind, float(np.linalg.norm(boundary.gap))
    if not (kind.start_position and kind.end_position and 1.0 - distance < EASY):
        return boundary
    return dataclasses.replace(boundary, gap=(1.0 - EASY) / distance * boundary.gap)


def curve(case: Case, boundary: Boundary, turns: int, bow: Array | None) -> tuple[Case, Array, Array]:
    """Return ``case`` with ``boundary``, and the arc lengths (m,) and quaternions (m, 4) of the curve between these."""
    _, q = starting_curve(boundary, CURVE, turns, bow)
    return dataclasses.replace(case, boundary=signed(boundary, q)), np.linspace(0.0, 1.0, CURVE), q


def signed(boundary: Boundary, q: Array) -> Boundary:
    """Return ``boundary`` with that of the end's two quaternions that stands for the turns of the curve (m, 4)."""
    if not boundary.kind.end_orientation:
        return boundary
    sign = 1.0 if q[-1] @ boundary.end_quaternion >= 0 else -1.0
    return dataclasses.replace(boundary, end_quaternion=sign * boundary.end_quaternion)
