"""The scene as it is drawn, before anything is solved: parts, clamps and motions as one page that needs no network."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np

from harness_opt.files.summary import path_entry
from harness_opt.files.whole_folder import write_whole
from harness_opt.model.bodies import Hinge
from harness_opt.model.ends import End
from harness_opt.model.plausibility import doubts, part_doubts
from harness_opt.model.problem import Problem
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.parts.scene import Scene
from harness_opt.report import colours, viewpoint
from harness_opt.report.html_page import MOST_NAMES, page, texts_of
from harness_opt.report.page_rows import input_tables
from harness_opt.report.scene_data import looked, outlines_of, pack, part_data
from harness_opt.report.suspects import suspects

Json = dict[str, Any]

MOMENTS = 25  # of the motion that are drawn
ARROW = 0.12  # of the scene, of a clamp's arrow
LEAST_ARROW = 4.0  # diameters of the cable
AXIS = 0.5  # of the scene, of the line that a hinge turns about


def write_preview(problem: Problem, scene: Scene, file: str | Path) -> Path:
    """Write the page of a problem as it is drawn, and return its path.

    Args:
        problem: what is drawn; nothing of it is solved.
        scene: its parts.
        file: to write.

    Raises:
        OSError: the file cannot be written.
    """
    write_whole(Path(file), preview(problem, scene).encode("utf-8", "replace"))
    return Path(file)


def preview(problem: Problem, scene: Scene) -> str:
    """Return the page of a problem as it is drawn."""
    found = suspects(problem, scene)
    odd_parts = {one.part for one in found}
    odd_parts |= {name for name, part in scene.parts.items() if [*part_doubts(problem, name, part.upper - part.lower)]}
    data = _data(problem, scene, odd_parts, {one.clamp for one in found})
    return page(
        "preview.html.jinja",
        data,
        title=problem.title or (problem.file.stem if problem.file else "A problem without title"),
        warnings=warnings_of(problem, scene),
        inputs=list(input_tables(problem)),
        parts=[_part_row(problem, scene, name, name in odd_parts) for name in problem.parts],
        modes=[],
        cables=list(problem.cables),
        colours=colours.CABLES,
        most_names=MOST_NAMES,
        texts=list(texts_of(problem).items()),
    )


def warnings_of(problem: Problem, scene: Scene) -> list[str]:
    """Return what is suspicious, a line each that begins with the key."""
    return [*doubts(problem), *scene.warnings, *(found.words for found in suspects(problem, scene))]


def _data(problem: Problem, scene: Scene, odd_parts: set[str | None], odd_clamps: set[tuple[str, str] | None]) -> Json:
    """Return what the page's script is given."""
    motion = np.linspace(0.0, 1.0, MOMENTS if problem.moves else 1)
    points = _clamp_points(problem, motion)
    hold = viewpoint.whole(problem, motion, outlines_of(scene), points)
    size = float(np.linalg.norm(np.ptp(hold, axis=0))) or 1.0
    bodies = sorted({part.body for part in problem.parts.values()} | set(problem.bodies) | {"world"})
    ends = [(name, side, end) for name, run in problem.cables.items() for side, end in run.clamps.items()]
    near = _near(points, size)
    shown = {
        "frames": list(range(len(motion))),
        "motion": motion.tolist(),
        "solved": len(motion),
        "cables": [],
        "bodies": {name: pack(np.hstack(problem.poses(name, motion)), np.float32) for name in bodies},
        "nearest": [],
        "ghosts": [0, len(motion) - 1] if problem.moves else [],
        "clamps": [
            _clamp(problem, name, side, end, ARROW * float(np.linalg.norm(np.ptp(near, axis=0))), odd_clamps)
            for name, side, end in ends
            if end.position is not None
        ],
        "lines": [*_links(problem), *_axes(problem, hold, size)],
        "title": "",
        "colours": colours.CABLES,
    }
    parts = [row | {"odd": row["name"] in odd_parts} for row in part_data(problem, scene)]
    return {
        "motion": motion.tolist(),
        "scenes": [shown],
        "parts": parts,
        "view": looked(_back(points), hold, near),
        "scales": {},
        "ramp": colours.RAMP,
        "palette": {"states": [None, colours.SHORT, colours.TOUCHES], "axes": colours.AXES, "sleeve": colours.SLEEVE},
        "path": path_entry(problem.moments),
        "worst": 0.0,
        "begin": 0.0,
        "rows": [],
        "curves": [],
        "chart": {"width": 1, "left": 0, "right": 0},
    }


def _clamp_points(problem: Problem, motion: Array) -> Array:
    """Return where clamps come to over the motion, in the world, (n, 3)."""
    found = [np.zeros((0, 3))]
    for run in problem.cables.values():
        for end in run.clamps.values():
            if end.position is not None:
                position, turn = problem.poses(end.body, motion)
                found.append(position + rotations.rotate(turn, np.asarray(end.position)))
    return np.vstack(found)


def _near(points: Array, size: float) -> Array:
    """Return points that hold the clamps and room around them, (n, 3)."""
    if not len(points):
        return np.array([[0.0, 0.0, 0.0], [size, size, size]])
    room = max(0.5 * float(np.linalg.norm(np.ptp(points, axis=0))), 0.05 * size)
    return np.vstack([points - room, points + room])


def _back(points: Array) -> Array:
    """Return the way to the eye, (3,): across the plane in which the clamps move, from above."""
    normal = np.array([0.0, -1.0, 0.0]) if len(points) < 2 else viewpoint.plane_normal([points[None]])
    return viewpoint.axes(normal, viewpoint.ASIDE, 1.0)[2]


def _clamp(problem: Problem, name: str, side: str, end: End, long: float, odd: set[tuple[str, str] | None]) -> Json:
    """Return one clamp: its place, the section's axes there, and what of these is given."""
    diameter = problem.cables[name].cable.diameter
    frame = rotations.IDENTITY if end.frame is None else np.asarray(end.frame)
    return {
        "name": f"{name} {side}",
        "body": end.body,
        "position": np.round(np.asarray(end.position, dtype=float), 7).tolist(),
        "quaternion": np.round(frame, 7).tolist(),
        "tangent": end.frame is not None,
        "roll": end.frame is not None and not end.has_open_roll,
        "radius": 0.5 * diameter,
        "long": max(long, LEAST_ARROW * diameter),
        "odd": (name, side) in odd,
    }


def _links(problem: Problem) -> list[Json]:
    """Return the straight lines between the clamps of each cable."""
    found = []
    for number, run in enumerate(problem.cables.values()):
        for pair in itertools.pairwise(run.clamps.values()):
            ends = [{"body": end.body, "position": list(end.position)} for end in pair if end.position is not None]
            if len(ends) == len(pair):
                found.append({"ends": ends, "colour": colours.CABLES[number % len(colours.CABLES)]})
    return found


def _axes(problem: Problem, hold: Array, size: float) -> list[Json]:
    """Return the lines that hinges turn about, on what carries them, where they pass the scene."""
    found = []
    for body in problem.bodies.values():
        if isinstance(body.motion, Hinge):
            axis = rotations.normalise(np.asarray(body.motion.axis, dtype=float))
            point = np.asarray(body.motion.point, dtype=float)
            position, turn = (pose[0] for pose in problem.poses(body.parent, [0.0]))
            scene = rotations.rotate(rotations.conjugate(turn), hold.mean(axis=0) - position)
            middle = point + axis * float(axis @ (scene - point))
            ends = [middle + sign * 0.5 * AXIS * size * axis for sign in (-1.0, 1.0)]
            found.append({"ends": [{"body": body.parent, "position": end.tolist()} for end in ends], "colour": None})
    return found


def _part_row(problem: Problem, scene: Scene, name: str, odd: bool) -> Json:
    part, limit = scene.parts[name], problem.clearance_limit(name)
    lower, upper = (1e3 * corner for corner in (part.lower, part.upper))
    return {
        "name": name,
        "odd": odd,
        "body": part.body,
        "size": " x ".join(f"{side:.4g}" for side in upper - lower),
        "from": ", ".join(f"{x:.4g}" for x in lower),
        "to": ", ".join(f"{x:.4g}" for x in upper),
        "closed": "closed" if part.closed else "shell",
        "limit": "none" if limit is None or not math.isfinite(limit) else f"{1e3 * limit:.4g} mm",
    }
