"""One cable over the motion by the paper's own transcription: section 4.2, one profile for each path point.

The first shape is that of a cold start, each other begins at the profile before it, as published. There is no step
control and no release after a snap: where the equations do not lead to a shape that the collocation confirms, the
sweep ends and says so.
"""

from __future__ import annotations

import numpy as np

from harness_opt.errors import Status
from harness_opt.model.problem import Problem
from harness_opt.model.results import STATIONS, CableMotion, Followed
from harness_opt.motion.cases import CableCases
from harness_opt.motion.follower import Progress
from harness_opt.motion.snaps import first_shape
from harness_opt.motion.sweep import sampled, start_positions
from harness_opt.numerics.rotations import Array
from harness_opt.rod import equations as rod_module
from harness_opt.rod.stability import Stability, stability
from harness_opt.rod.states import Rod
from harness_opt.statics.paper_pose import START_SOLVER, Quadrature, QuadratureSolve, solve_by_quadrature


def sweep_by_quadrature(
    problem: Problem,
    name: str,
    motion: Array,
    options: Quadrature,
    first: Rod | None = None,
    progress: Progress | None = None,
) -> Followed:
    """Follow the cable ``name`` over ``motion`` (P,).

    Args:
        problem: the problem.
        name: of the cable.
        motion: values of the frames.
        options: number of points, closure, solver and tolerance; a number of points left open is found by the first
            frame and raised where a later one needs it.
        first: the shape to begin the first frame at; None leaves it to a cold start.
        progress: called with the cable's name, frames done, frames in all.
    """
    units = rod_module.scale(problem.cables[name].cable)[1]
    cases = CableCases(problem, name, START_SOLVER, first=first if motion[0] == 0.0 else None)
    ends = cases.problem.ends(name, motion)
    before = first or _first_shape(cases, float(motion[0]))
    frames: list[QuadratureSolve] = []
    judged: list[Stability] = []
    status, message = Status.OK, ""
    if before is None:
        status, message = Status.NO_START, f"cable {name}, frame 0 of {len(motion)}: {Status.NO_START.value}"
    try:
        while status.ok and before is not None and len(frames) < len(motion):
            k = len(frames)
            posed = cases.posed(ends[k], None).signed_like(before.q[0], before.q[-1])
            answer = solve_by_quadrature(posed, before, options)
            if not answer.status.ok:
                status = answer.status
                at = problem.moments.words(float(motion[k]))
                message = (
                    f"cable {name}, frame {k} of {len(motion)} ({at}): differential quadrature on "
                    f"{answer.points} points: {status.value}; try more points, or the collocation"
                )
                break
            frames.append(answer)
            judged.append(stability(answer.rod, posed.boundary.kind))
            before = answer.rod
            if progress:
                progress(name, len(frames), len(motion))
    except KeyboardInterrupt:  # raised by ``progress``: what is solved until here is kept
        status, message = Status.INTERRUPTED, f"cable {name}: {Status.INTERRUPTED.value}"
    if not frames:
        return Followed(None, (), status, message)
    lengths = np.full(len(frames), units.length)
    origins = start_positions(ends, np.array([frame.rod.r[-1] for frame in frames]), lengths)
    shapes = CableMotion(
        **vars(sampled([frame.rod for frame in frames], origins, units, np.linspace(0.0, 1.0, STATIONS), lengths)),
        stable=np.array([bool(one.stable) for one in judged]),
        stability_margin=np.array([float(one.margin) for one in judged]),
        residual=np.array([frame.residual for frame in frames]),
        estimated_error=np.array([frame.error for frame in frames]),
    )
    return Followed(shapes, (), status, message)


def _first_shape(cases: CableCases, at: float) -> Rod | None:
    """Return the shape of a cold start with the turns asked for; None where there is none."""
    solved = first_shape(cases, at)
    return solved.rod if solved is not None and solved.ok and not solved.passed else None
