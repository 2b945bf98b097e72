"""Where to look from: across the plane of a motion, a little from above. Without any graphics."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np

from harness_opt.model.problem import Problem
from harness_opt.model.results import CableMotion, Motion
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.parts.scene import Scene

ELEVATION = 20.0  # degrees above the plane of view, so that depth shows
ASIDE = 16.0  # degrees off the normal of the plane of motion, for the same
FLAT_ELEVATION = 55.0  # degrees, on a plane that lies flat, and on another where parts hide less from there
HIDDEN_AT = (0.0, 0.5, 1.0)  # moments of the motion, at which it is asked what is hidden
STEEP = 60.0  # degrees that a normal stands up, from which its plane lies flat
NEAR, NEXT = 1.0, 0.15  # extents of the cables: parts that reach up to here are shown whole, others so far
DIRECTIONS = 128  # in which the farthest points are looked for
MOMENTS = 8  # of a motion, at which moving parts are looked at
POINTS_LOOKED_AT = 20  # of a cable, for what hides it
LEAST_STEP = 0.005  # extents of a part, between two points of a line of sight
TINY = 1e-300  # in place of 0 in a direction, so that a line along a wall of a box is on one side of it


def plane_normal(positions: Sequence[Array]) -> Array:
    """Return the unit normal (3,) of the plane in which points of cables move mostly.

    The direction in which they move least; where that leaves two, the one in which the cables extend less.

    Args:
        positions: of each cable, (P, N, 3), m.
    """
    spread = np.zeros((3, 3))
    for position in positions:
        moved = (position - position.mean(axis=0)).reshape(-1, 3)
        extent = (position - position.mean(axis=(0, 1))).reshape(-1, 3)
        for share, points in ((1.0, moved), (0.2, extent)):
            total = float(np.sum(points * points))
            spread += share * points.T @ points / max(total, 1e-30)
    return np.linalg.eigh(spread)[1][:, 0]


def axes(normal: Array, aside: float, sign: float, other: bool = False) -> tuple[Array, Array, Array]:
    """Return right, up and back (3,) of a picture along ``normal``, ``aside`` degrees off and from above; z up.

    Args:
        normal: of the plane to look across, unit, (3,).
        aside: degrees.
        sign: 1 or -1: from which side.
        other: the other height: a plane that lies flat is looked at from little above, another from high above.
    """
    azimuth = math.atan2(sign * normal[1], sign * normal[0])
    steep = abs(normal[2]) > math.sin(math.radians(STEEP))
    if steep:
        azimuth = -math.pi / 2 if sign > 0 else math.pi / 2
    azimuth += math.radians(aside)
    elevation = math.radians(FLAT_ELEVATION if steep != other else ELEVATION)
    out = math.cos(elevation)
    back = np.array([out * math.cos(azimuth), out * math.sin(azimuth), math.sin(elevation)])
    right = rotations.normalise(np.cross([0.0, 0.0, 1.0], back))
    return right, np.cross(back, right), back


def clearest(motion: Motion, scene: Scene) -> tuple[Array, Array, Array]:
    """Return right, up and back (3,) of the picture across the plane of motion in which parts hide least of the cables.

    From above, and the same wherever the motion stands: a lid must not close before the eye. The first of the views
    that hide nothing is taken.
    """
    normal = plane_normal([cable.position for cable in motion.cables.values()])
    frames = sorted({int(np.argmin(np.abs(motion.motion - at))) for at in HIDDEN_AT})
    best, least = axes(normal, ASIDE, 1.0, False), math.inf
    for high, sign, aside in itertools.product((False, True), (1.0, -1.0), (ASIDE, -ASIDE)):
        view = axes(normal, aside, sign, high)
        hidden = _hidden(motion, frames, scene, view[2])
        if hidden < least:
            best, least = view, hidden
        if not hidden:
            break
    return best


def _hidden(motion: Motion, frames: Sequence[int], scene: Scene, back: Array) -> int:
    """Return how many points of the cables, in all ``frames``, parts hide from an eye far off along ``back`` (3,).

    A line of sight goes on by the distance to the part, which it cannot pass unseen (sphere tracing), from where it
    enters the part's box to where it leaves it (slabs).
    """
    every = [max(1, len(cable.s) // POINTS_LOOKED_AT) for cable in motion.cables.values()]
    cables = zip(motion.cables.values(), every, strict=True)
    points = np.concatenate([cable.position[frames, ::step] for cable, step in cables], axis=1)  # (frames, k, 3)
    hidden = np.zeros(points.shape[:2], dtype=bool)
    for part in scene.parts.values():
        position, q = motion.problem.poses(part.body, motion.motion[frames])
        home = rotations.conjugate(q)[:, None]
        at, way = rotations.rotate(home, points - position[:, None]), rotations.rotate(home, back)
        way = np.where(way == 0.0, TINY, way)
        walls = np.stack([(part.lower - at) / way, (part.upper - at) / way])
        along, leaves = np.maximum(0.0, walls.min(axis=0).max(axis=-1)), walls.max(axis=0).min(axis=-1)
        least = LEAST_STEP * float(np.linalg.norm(part.upper - part.lower))
        while np.any(going := ~hidden & (along <= leaves)):
            ways = np.broadcast_to(way, at.shape)[going]
            distance = part.signed_distance(at[going] + along[going, None] * ways)[0]
            hidden[going] |= distance < 0
            along[going] += np.maximum(distance, least)
    return int(np.sum(hidden))


def whole(problem: Problem, motion: Array, outlines: Mapping[str, Array], points: Array) -> Array:
    """Return points (n, 3), m, that hold the whole scene over the motion: ``points`` (k, 3), and all parts.

    Args:
        problem: bodies and parts.
        motion: (P,), 0 to 1, of the frames.
        outlines: points (k, 3) of each part in its body's coordinates that hold all of it, m.
        points: of what else is there, world, m.
    """
    at = motion[:: max(1, len(motion) // MOMENTS)]
    found = [points.reshape(-1, 3)]
    for name, outline in outlines.items():
        position, q = problem.poses(problem.parts[name].body, at)
        found.append((rotations.rotate(q[:, None], outline) + position[:, None]).reshape(-1, 3))
    return np.vstack(found)


def near(problem: Problem, motion: Array, cables: Mapping[str, CableMotion], outlines: Mapping[str, Array]) -> Array:
    """Return points (n, 3), m, that a picture of the cables must hold: these, and the parts near them.

    Of a part that reaches far away only what is next to the cables counts: a cable on a ship is not to be a
    dot on a ship.

    Args:
        problem, motion, outlines: as in :func:`whole`.
        cables: the shapes in these frames.
    """
    stations = np.vstack([cable.position.reshape(-1, 3) for cable in cables.values()])
    lower, upper = stations.min(axis=0), stations.max(axis=0)
    diagonal = float(np.linalg.norm(upper - lower))
    points = [stations]
    at = motion[:: max(1, len(motion) // MOMENTS)]
    for name, outline in outlines.items():
        position, q = problem.poses(problem.parts[name].body, at)
        reached = (rotations.rotate(q[:, None], outline) + position[:, None]).reshape(-1, 3)
        far = max(float(np.max(lower - reached)), float(np.max(reached - upper)))
        around = diagonal * (NEAR if far <= NEAR * diagonal else NEXT)
        points.append(np.clip(reached, lower - around, upper + around))
    return np.vstack(points)


def extremes(points: Array) -> Array:
    """Return those of ``points`` (k, 3) that lie farthest out in 128 directions, (n, 3)."""
    turns = np.arange(DIRECTIONS) + 0.5
    z = 1 - 2 * turns / DIRECTIONS
    around = math.pi * (1 + math.sqrt(5)) * turns  # the golden angle spreads directions evenly
    directions = np.column_stack([np.sqrt(1 - z * z) * np.cos(around), np.sqrt(1 - z * z) * np.sin(around), z])
    # one at a time: all at once would take a gigabyte for a million points
    found: Array = points[np.unique([np.argmax(points @ direction) for direction in directions])]
    return found
