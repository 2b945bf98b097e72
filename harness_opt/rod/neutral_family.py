"""Shapes that are one of a family: a weightless round cable between clamps on one line turns about that line freely.

Turned about the line by an angle, with every section turned back by it about its own tangent, a shape meets the same
clamps, has the same curvatures and the same energy. Which member of the family is shown is arbitrary, but it should not
wander: each shape is turned to where it comes nearest to the one before. What goes out and comes back then ends where
it began, as a step back undoes a step there.
"""

from __future__ import annotations

import math

import numpy as np

from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.rod.boundary import CLAMPED, Case
from harness_opt.rod.collocation import BoundCollocation
from harness_opt.rod.collocation_element import FORCE, NODE

ALONG = 1e-9  # sine of the angle up to which two directions are one


def line_of(case: Case) -> Array | None:
    """Return the direction (3,) of the line that the shapes of ``case`` turn about freely; None where they do not."""
    boundary, (kx, ky, _) = case.boundary, case.section.stiffness
    if boundary.kind != CLAMPED or kx != ky or np.any(case.section.rest_curvature) or np.any(case.load):
        return None
    line, end = rotations.tangent(boundary.start_quaternion), rotations.tangent(boundary.end_quaternion)
    apart = np.linalg.norm(end - line)
    aside = np.linalg.norm(rotations.cross(line, boundary.gap))
    return line if apart <= ALONG and aside <= ALONG else None


def angle_between(line: Array, points: Array, others: Array) -> float:
    """Return by which angle about ``line`` points (N, 3) come nearest to others, rad; both begin at the line."""
    size = 1e-9  # squared distances from the line, in lengths, below which a cable has no side
    aside, wanted = (p - np.outer(p @ line, line) for p in (points, others))
    sine, cosine = float(np.sum(rotations.cross(aside, wanted) @ line)), float(np.sum(aside * wanted))
    return math.atan2(sine, cosine) if math.hypot(sine, cosine) > size else 0.0


def turned(bound: BoundCollocation, x: Array, line: Array, angle: float) -> Array:
    """Return the unknowns of the shape ``x`` turned by ``angle`` about ``line`` (3,), its sections turned back."""
    about = rotations.from_rotation_vector(angle * line)
    back = rotations.from_rotation_vector(np.array([0.0, 0.0, -angle]))
    stages = bound.transcription.stages
    body, last, force = x[: -NODE - FORCE].reshape(-1, NODE + 4 * stages), x[-NODE - FORCE : -FORCE], x[-FORCE:]

    def frames(q: Array) -> Array:
        return rotations.multiply(about, rotations.multiply(q, back))

    blocks = [
        frames(body[:, :4]),
        rotations.rotate(about, body[:, 4:NODE]),
        frames(body[:, NODE:].reshape(-1, stages, 4)).reshape(len(body), -1),
    ]
    ends = [frames(last[:4]), rotations.rotate(about, last[4:]), rotations.rotate(about, force)]
    return np.concatenate([np.hstack(blocks).ravel(), *ends])
