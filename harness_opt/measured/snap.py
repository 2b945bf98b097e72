"""The twist at which a loop leaves its plane: the first snap while its end is turned about itself."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from harness_opt.errors import SolveError, Status
from harness_opt.measured.measurements import Pose
from harness_opt.model.bodies import Body, Hinge
from harness_opt.model.cable import Cable, CableRun
from harness_opt.model.design import Limits
from harness_opt.model.problem import Problem
from harness_opt.motion.simulate import simulate

STEP_DEG = 20.0  # of the end's turn between two frames
BEYOND = (1.15, 1.5, 3.0)  # times the measured twist, up to which a snap is looked for, one after the other
TOLERANCE = 1e-5  # of the shapes, in their length: a snap moves by less than a degree for it


def snap_twist(pose: Pose, cable: Cable, gravity: Sequence[float], measured: float) -> float:
    """Return the twist, rad, of the end at which the cable snaps out of the shape that it has untwisted.

    Args:
        pose: untwisted.
        cable: its length is the pose's.
        gravity: m/s2, (3,).
        measured: about where to look, rad.

    Raises:
        SolveError: the shape was lost, or does not snap up to far beyond the measured twist.
    """
    end = dataclasses.replace(pose.end, body="holder")
    if pose.end.position is None or pose.end.frame is None:
        raise SolveError("a loop whose end is free does not snap", Status.NO_START, None)
    axis = pose.end.tangent or tuple(np.asarray(_tangent(pose)).tolist())
    run = CableRun(dataclasses.replace(cable, length=pose.length), pose.start, end, pose.bow)
    for last in (share * measured for share in BEYOND):
        turning = Body(Hinge(pose.end.position, axis, 0.0, last))
        # with a limit to itself a cable may jump through itself: when it snaps is asked, not where to
        problem = Problem(
            {"cable": run}, {"holder": turning}, gravity=tuple(gravity), limits=Limits(clearance=0.0)  # type: ignore[arg-type]
        )  # fmt: skip
        frames = np.linspace(0.0, 1.0, max(3, math.ceil(math.degrees(last) / STEP_DEG) + 1))
        motion = simulate(problem, frames=frames, throw=False, tolerance=TOLERANCE)
        if motion.snaps:
            return float(motion.snaps[0].motion) * last
        if not motion.ok:
            raise SolveError(f"no snap was found: {motion.message}", motion.status, None)
    words = f"the loop does not leave its plane up to {math.degrees(last):.0f} degrees"
    raise SolveError(f"no snap was found: {words}", Status.NO_START, None)


def _tangent(pose: Pose) -> object:
    from harness_opt.numerics import rotations

    return rotations.tangent(np.asarray(pose.end.frame))
