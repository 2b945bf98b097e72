"""What can be but is hardly meant about clamps: inside a part that does not hold them, or pointing into a wall."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness_opt.clearance.what_counts import let_off_length
from harness_opt.model.ends import Clip, End
from harness_opt.model.problem import Problem
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.parts.scene import Geometry, Scene


@dataclass(frozen=True)
class Suspect:
    """What can be but is hardly meant.

    Args:
        words: a line that begins with the key.
        part: the part that is to be looked at, or None.
        clamp: cable and side of the clamp that is to be looked at, or None.
    """

    words: str
    part: str | None = None
    clamp: tuple[str, str] | None = None


def suspects(problem: Problem, scene: Scene) -> list[Suspect]:
    """Return clamps that stand in a part that does not hold them, and those that point into a wall."""
    return [
        found
        for name, run in problem.cables.items()
        for side, end in run.clamps.items()
        for part in scene.parts.values()
        if (found := _suspect(problem, (name, side), end, part)) is not None
    ]


def _suspect(problem: Problem, clamp: tuple[str, str], end: End, part: Geometry) -> Suspect | None:
    """Return what is odd about a clamp and a part at both ends and in the middle of the motion."""
    name, side = clamp
    moments, radius = np.array([0.0, 0.5, 1.0]), problem.cables[name].cable.radius
    position = _path(problem, end, moments)
    if position is None or not part.closed:
        return None
    where = f"clips.{side}" if isinstance(end, Clip) else side
    key, limit = f"cables.{name}.{where}", problem.clearance_limit(part.name)
    origin, turn = problem.poses(part.body, moments)
    home = rotations.conjugate(turn)
    depth = -part.signed_distance(rotations.rotate(home, position - origin))[0]
    holds = end.body == part.body if end.holders is None else part.name in end.holders
    if not holds:
        k = int(np.argmax(depth))
        at = problem.moments.words(float(moments[k]))
        words = f"{key}.position: found {1e3 * depth[k]:.3g} mm deep in {part.name}, which does not hold it, at {at}"
        return Suspect(words, part.name, clamp) if depth[k] > 0 else None
    if end.frame is None or isinstance(end, Clip):  # which the cable leaves both ways
        return None
    quaternion = problem.poses(end.body, moments[:1])[1][0]
    out = rotations.rotate(quaternion, rotations.tangent(np.asarray(end.frame))) * (1.0 if side == "start" else -1.0)
    reach = let_off_length(end, radius, limit)
    ahead, behind = (position[0] + sign * reach * out - origin[0] for sign in (1.0, -1.0))
    inside = part.signed_distance(rotations.rotate(home[0], np.stack([ahead, behind])))[0] < 0
    if not inside[0]:
        return None
    turned = "; the other way it would come out, so it may be turned round" if not inside[1] else ""
    words = f"{key}.tangent: found the cable {1e3 * reach:.3g} mm on still inside {part.name}, which holds it{turned}"
    return Suspect(words, part.name, clamp)


def _path(problem: Problem, end: End, motion: Array) -> Array | None:
    """Return the world positions (P, 3) of ``end``, or None where a force holds it."""
    if end.position is None:
        return None
    position, quaternion = problem.poses(end.body, motion)
    return position + rotations.rotate(quaternion, end.position)
