"""The scene of a motion as plain data for a browser: parts as triangles, cables as centrelines, poses of bodies.

Numbers that are many are base64 of little-endian arrays. What would make a page too large is thinned, and said so.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness_opt.clearance import along_cable as colouring
from harness_opt.clearance.limits import bending
from harness_opt.clearance.pairs import ClearanceResult, PairClearance
from harness_opt.model.problem import Problem
from harness_opt.model.results import Motion
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices
from harness_opt.parts.primitives import Primitive
from harness_opt.parts.scene import Scene
from harness_opt.parts.triangles import on_grid, triangles
from harness_opt.report import viewpoint

Json = dict[str, Any]

MOST_STATIONS = 120_000  # of all cables in all frames: 3.5 MB of a page
MOST_TRIANGLES = 15_000  # of all parts: a fifth of a megabyte of a page
FEW_SIDES = 20  # of a round primitive among many parts
MOST_SHORT = 65_536  # vertices that numbers of 16 bits count
EXTREMES = (0.0, 1.0)  # moments of the motion that are drawn faintly


def scene_data(motion: Motion, scene: Scene, measured: ClearanceResult, share: float = 1.0) -> Json:
    """Return frames, cables and bodies of a motion.

    Args:
        motion: simulated, with at least one frame.
        scene: its parts.
        measured: its clearances.
        share: of the room on the page that this motion may take.
    """
    problem, kept = motion.problem, frames_shown(motion, measured, share)
    at = motion.motion[kept]
    bodies = sorted({part.body for part in problem.parts.values()})
    return {
        "frames": kept.tolist(),
        "motion": np.round(at, 6).tolist(),
        "solved": len(motion.motion),
        "cables": [_cable(motion, scene, measured, name, kept) for name in motion.cables],
        "bodies": {name: pack(np.hstack(problem.poses(name, at)), np.float32) for name in bodies},
        "nearest": [_nearest(pair, kept) for pair in measured.pairs if math.isfinite(pair.worst)],
        "ghosts": sorted({int(np.argmin(np.abs(at - moment))) for moment in EXTREMES}),
    }


def frames_shown(motion: Motion, measured: ClearanceResult, share: float) -> Indices:
    """Return the numbers of the frames that are shown: all, or some, among them the worst and the snaps."""
    total = len(motion.motion)
    stations = sum(len(cable.s) for cable in motion.cables.values())
    most = max(2, int(share * MOST_STATIONS / max(stations, 1)))
    if total <= most:
        return np.arange(total)
    even = np.linspace(0, total - 1, most).round().astype(int).tolist()
    worst = [pair.frame for pair in measured.pairs]
    worst += [int(np.argmax(bending(cable).max(axis=1))) for cable in motion.cables.values()]
    snaps = [frame for snap in motion.snaps for frame in (snap.frame - 1, snap.frame) if 0 <= frame < total]
    return np.unique([*even, *worst, *snaps])


def _cable(motion: Motion, scene: Scene, measured: ClearanceResult, name: str, kept: Indices) -> Json:
    shapes, cable = motion.cables[name], motion.problem.cables[name].cable
    far = colouring.far(motion.problem)
    points = colouring.Points(name, kept, shapes.s, shapes.position[kept])
    nearest, state = colouring.states(motion, scene, measured.pairs, points, far)
    clamped = [0, *shapes.clip_stations, len(shapes.s) - 1]
    return {
        "name": name,
        "radius": cable.radius,
        "stations": len(shapes.s),
        "position": pack(shapes.position[kept], np.float32),
        "curvature": scaled(bending(shapes)[kept]),
        "twist": scaled(np.degrees(np.abs(shapes.curvature[kept, :, 2]))),
        "clearance": scaled(np.minimum(nearest, far)),
        "state": pack(state, np.uint8),
        "clamped": clamped,
        "clamps": pack(shapes.quaternion[kept][:, clamped], np.float32),
    }


def _nearest(pair: PairClearance, kept: Indices) -> Json:
    """Return the closest points of a pair in each frame: on the cable's surface, and on the obstacle's."""
    point, clearance = pair.nearest.point[kept], pair.clearance[kept]
    on_cable = point + clearance[:, None] * pair.nearest.normal[kept]
    return {
        "cable": pair.cable,
        "part": None if pair.obstacle.is_cable else pair.obstacle.name,
        "other": pair.obstacle.words(pair.cable),
        "limit": pair.limit,
        "clearance": np.round(clearance, 7).tolist(),
        "points": pack(np.hstack([on_cable, point]), np.float32),
    }


def view_data(shown: Sequence[Motion], scene: Scene) -> Json:
    """Return where to look from, and what a picture of all, and one of the cables, must hold.

    Args:
        shown: motions; it is looked across the last.
        scene: their parts.
    """
    outlines = outlines_of(scene)
    lines = [np.vstack([cable.position.reshape(-1, 3) for cable in one.cables.values()]) for one in shown]
    hold = [viewpoint.whole(one.problem, one.motion, outlines, at) for one, at in zip(shown, lines, strict=True)]
    near = [viewpoint.near(one.problem, one.motion, one.cables, outlines) for one in shown]
    back = viewpoint.clearest(shown[-1], scene)[2]
    return looked(back, np.vstack(hold), np.vstack(near))


def outlines_of(scene: Scene) -> dict[str, Array]:
    """Return points (k, 3) of each part in its body's coordinates that hold all of it, m."""
    return {name: viewpoint.extremes(triangles(part)[0]) for name, part in scene.parts.items()}


def looked(back: Array, hold: Array, near: Array) -> Json:
    """Return a view for a page: towards the eye (3,), and points (n, 3) of all, and of what is looked at from near."""
    found = (("back", back), ("hold", viewpoint.extremes(hold)), ("near", viewpoint.extremes(near)))
    return {key: np.round(value, 6).tolist() for key, value in found}


# --- parts ---------------------------------------------------------------------------------------------


def part_data(problem: Problem, scene: Scene) -> list[Json]:
    """Return the parts as triangles in the coordinates of their bodies, on a grid of 16-bit numbers."""
    shapes = {name: triangles(part) for name, part in scene.parts.items()}
    if sum(len(faces) for _, faces in shapes.values()) > MOST_TRIANGLES:  # round parts are still round with fewer
        shapes |= {
            name: triangles(part, FEW_SIDES) for name, part in scene.parts.items() if isinstance(part, Primitive)
        }
    total = sum(len(faces) for _, faces in shapes.values())
    rows = []
    for name, (vertices, faces) in shapes.items():
        most = max(12, int(MOST_TRIANGLES * len(faces) / max(total, 1)))
        lower, step, whole, kept = on_grid(vertices, faces, most)
        body = scene.parts[name].body
        rows.append(
            {
                "name": name,
                "body": body,
                "moves": problem.is_moved(body),
                "closed": scene.parts[name].closed,
                "triangles": len(kept),
                "triangles_of": len(faces),
                "lower": lower.tolist(),
                "step": step.tolist(),
                "vertices": pack(whole, np.uint16),
                "faces": pack(kept, np.uint16 if len(whole) <= MOST_SHORT else np.uint32),
                "wide": len(whole) > MOST_SHORT,
            }
        )
    return rows


def scaled(values: Array) -> Json:
    """Return ``values`` in steps of a 65,535th of their range, which no colour and no label shows: half the room."""
    low = float(np.min(values))
    step = (float(np.max(values)) - low) / (MOST_SHORT - 1) or 1.0
    return {"low": low, "step": step, "steps": pack(np.rint((values - low) / step), np.uint16)}


def pack(values: NDArray[Any], kind: Any) -> str:
    """Return ``values`` as base64 of little-endian numbers of ``kind``."""
    if np.dtype(kind) == np.float32 and not np.all(np.isfinite(values)):
        values = np.where(np.isfinite(values), values, math.inf)
    return base64.b64encode(np.ascontiguousarray(values, dtype=np.dtype(kind).newbyteorder("<")).tobytes()).decode()
