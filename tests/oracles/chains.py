"""Chains of bodies: three hinges in closed form, random chains of all kinds of motions, and a file with a pan-tilt."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

import harness_opt as ho
from harness_opt.numerics import rotations

PAN_TILT = """\
schema = 1
gravity = [0, 0, -9.81]

[cables.lead]
length = 0.3
diameter = 0.004
bending_stiffness = 1e-3
torsional_stiffness = 7e-4
start = { position = [0, 0.06, 0], tangent = [0, 0, 1] }
end = { body = "tilt", position = [0.03, 0, 0.19], tangent = [1, 0, 0] }

[bodies.pan.motion]
kind = "hinge"
point = [0, 0, 0]
axis = [0, 0, 1]
from_deg = -30
to_deg = 60

[bodies.tilt]
parent = "pan"
[bodies.tilt.motion]
kind = "hinge"
point = [0, 0, 0.15]
axis = [0, 1, 0]
from_deg = -20
to_deg = 40

[bodies.lamp]
parent = "tilt"

[motion]
spatial_step = 0.02

[parts.mast]
body = "pan"
box = { size = [0.02, 0.02, 0.14] }
position = [0, 0, 0.07]

[parts.head]
body = "lamp"
box = { size = [0.04, 0.03, 0.03] }
position = [0, 0, 0.17]

[limits]
clearance = 0.001
"""


def three_hinges(rng) -> tuple[dict[str, ho.Body], np.ndarray]:
    """Return bodies on three hinges in a row, and their points and axes (3, 2, 3)."""
    lines = rng.normal(size=(3, 2, 3))
    angles = rng.uniform(-3, 3, (3, 2))
    names = ("world", "a", "b", "c")
    hinges = [ho.Hinge(*map(tuple, line), *ends) for line, ends in zip(lines, angles.tolist(), strict=True)]
    return {name: ho.Body(hinges[k], names[k]) for k, name in enumerate(names[1:])}, lines


def closed_form(bodies: dict[str, ho.Body], motion: float) -> np.ndarray:
    """Return the matrix (4, 4) of the last of ``bodies``, hinges in a row: a product of exponentials of twists.

    Murray, Li, Sastry, A Mathematical Introduction to Robotic Manipulation, eq. (3.2), with (2.36) for each.
    """
    found = np.eye(4)
    for body in bodies.values():
        hinge = body.motion
        turn = Rotation.from_rotvec(
            (hinge.start + motion * (hinge.stop - hinge.start)) * rotations.normalise(hinge.axis)
        ).as_matrix()
        one = np.eye(4)
        one[:3, :3], one[:3, 3] = turn, (np.eye(3) - turn) @ np.asarray(hinge.point)
        found = found @ one
    return found


def random_course(rng) -> ho.ValueTable | ho.Moves:
    """Return a table of values or moves, about a unit large."""
    if rng.integers(2):
        count = int(rng.integers(2, 8))
        times = np.cumsum(rng.uniform(0.3, 1.0, count)) - 1.0
        return ho.ValueTable(tuple(times.tolist()), tuple(rng.normal(size=count).tolist()))
    moves = [
        ho.Move(rng.normal(), rng.uniform(0.3, 2.0), rng.choice([0.0, 0.4])) for _ in range(int(rng.integers(1, 4)))
    ]
    return ho.Moves(rng.normal(), tuple(moves))


def random_motion(rng) -> ho.Hinge | ho.Slide | ho.Poses:
    """Return a hinge, a slide or a table of poses, about a metre large; hinges and slides even or by a course."""
    kind = rng.integers(5)
    if kind < 4:
        line = (tuple(rng.normal(size=3)), tuple(rng.normal(size=3))) if kind % 2 else (tuple(rng.normal(size=3)),)
        motion = ho.Hinge if kind % 2 else ho.Slide
        return motion(*line, *rng.uniform(-1, 1, 2).tolist(), follows=random_course(rng) if kind < 2 else None)
    count = int(rng.integers(2, 8))
    turns = rotations.from_rotation_vector(np.cumsum(rng.normal(size=(count, 3)), axis=0) * 0.4)
    return ho.Poses(
        tuple(np.cumsum(rng.uniform(0.3, 1.0, count)).tolist()),
        tuple(map(tuple, rng.normal(size=(count, 3)))),
        tuple(map(tuple, turns)),
    )
