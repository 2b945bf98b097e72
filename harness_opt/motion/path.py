"""The path of the clamps: where on the motion the frames are solved.

The paper's dispersion, section 4.2: the trail of the moving clamp is cut into path points by a spatial step.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from harness_opt.errors import ProblemError
from harness_opt.model import checks
from harness_opt.model.problem import Problem
from harness_opt.model.spans import in_spans, spans_of
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array

MOST_FRAMES = 10_000  # of all cables together: at 0.2 MB each, while clearances are measured, they keep to 2 GB


def place_frames(problem: Problem, spatial_step: float | None = None) -> Array:
    """Return the motion values (P,) from 0 to 1 of the frames to solve.

    Between two frames no clamp moves by more than the spatial step, and none turns by more than moves a point a quarter
    of the cable's length away by as much: a clamp that turns on the spot is followed too.

    Raises:
        ProblemError: a step that is not above 0, or longer than the whole trail of the clamps; more than MOST_FRAMES
            frames would be needed.
    """
    path_samples = 2001  # for measuring the path of the clamps
    lever_length = 0.25  # of the cable's length: a clamp's turn counts as the travel of a point that far away
    step_fraction = 0.01  # spatial step where none is given, in lengths of the longest cable
    if spatial_step is not None:
        checks.positive("spatial_step", spatial_step)
    if not problem.moves:
        return np.zeros(1)
    longest = max(run.cable.length for run in problem.cables.values())
    asked = spatial_step or problem.spatial_step
    allowed = asked or step_fraction * longest
    grid = np.linspace(0.0, 1.0, path_samples)
    increments = np.zeros(path_samples - 1)
    for run in problem.cables.values():
        for end in run.clamps.values():
            position, quaternion = problem.poses(end.body, grid)
            if end.position is not None:
                position = position + rotations.rotate(quaternion, end.position)
            moved = np.linalg.norm(np.diff(position, axis=0), axis=1)
            turned = 2.0 * np.minimum(
                np.linalg.norm(np.diff(quaternion, axis=0), axis=1),
                np.linalg.norm(quaternion[1:] + quaternion[:-1], axis=1),
            )
            increments = np.maximum(increments, np.maximum(moved, lever_length * run.cable.length * turned))
    with np.errstate(over="ignore"):  # of a step that is nearly nothing; it is refused below
        run_so_far = np.concatenate([[0.0], np.cumsum(increments / allowed)])
    if asked and 0.0 < run_so_far[-1] < 1.0 - 1e-9:
        raise ProblemError(
            f"motion.spatial_step: found {asked:g} m, expected at most {run_so_far[-1] * asked:.6g} m, "
            "the whole trail of the clamps"
        )
    steps = np.ceil(run_so_far[-1] - 1e-9)
    if (steps + 1) * len(problem.cables) > MOST_FRAMES:
        cables = f" of {len(problem.cables)} cables" if len(problem.cables) > 1 else ""
        raise ProblemError(
            f"motion.spatial_step: found {allowed:g} m, which asks for {steps + 1:.15g} frames{cables}, expected "
            f"at most {MOST_FRAMES // len(problem.cables)}"
        )
    count = int(steps) + 1
    # clamps that stand still for a while: the tiny slope keeps the inverse single-valued
    measure = run_so_far + 1e-6 * grid
    return np.interp(np.linspace(0.0, measure[-1], max(count, 2)), measure, grid)


def given_frames(frames: ArrayLike, spatial_step: float | None) -> Array:
    """Return ``frames`` (P,) as motion values to solve at.

    Raises:
        ProblemError: not one number or more, increasing, from 0 to 1; a spatial step beside them.
    """
    if spatial_step is not None:
        raise ProblemError("spatial_step: found beside frames, expected one of the two")
    motion = np.asarray(frames, dtype=float)
    increasing = motion.ndim == 1 and motion.size > 0 and bool(np.all(np.diff(motion) > 0))
    if not (increasing and motion[0] >= 0.0 and motion[-1] <= 1.0):
        raise ProblemError(f"frames: found {frames!r}, expected increasing numbers from 0 to 1")
    return motion


def clamp_twist(problem: Problem, name: str) -> float | None:
    """Return the twist, rad, that the clamps build into a cable; None where they leave it none to keep.

    Of one with clips, all spans together. Of a cable that is fitted untwisted, what its ends are turned by afterwards.
    Else what joins the clamps along the curve that the first shape is looked for from: nothing is solved for it.
    """
    run = problem.cables[name]
    hangs = not all(problem.is_placed(end.body) for end in run.clamps.values())
    if hangs or any(clip.is_free for clip in run.clips):
        return None
    if run.clips:
        apart = in_spans(problem)
        twists = [clamp_twist(apart, span.name) for span in spans_of(problem).values() if span.cable == name]
        known = [twist for twist in twists if twist is not None]
        return sum(known) if len(known) == len(twists) else None
    if run.untwisted is not None:
        return 2.0 * math.pi * run.turned_in
    # only a cable whose rolls are given asks for what solves
    from harness_opt.rod.boundary import HELD, case
    from harness_opt.rod.link import twist
    from harness_opt.statics.cold_start import wound_curve

    fixed = problem.changed(cables={name: run.to_fit})
    posed = case(run.cable, *fixed.ends(name, [0.0])[0], np.asarray(problem.gravity))
    if not posed.boundary.kind.start_held == posed.boundary.kind.end_held == HELD:
        return None
    bow = posed.load if run.bow is None and np.any(posed.load) else run.bow
    return 2.0 * math.pi * twist(wound_curve(posed, int(run.end.turns), None if bow is None else np.asarray(bow)).q)
