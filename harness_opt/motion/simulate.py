"""The whole motion: frames along the path of the clamps, every cable followed from frame to frame.

The paper's dispersion, section 4.2: the moving clamp's trail is cut by a spatial step, one shape is solved for each
point.
"""

from __future__ import annotations

import time
from collections.abc import Mapping

from numpy.typing import ArrayLike

from harness_opt.errors import ProblemError, SolveError, Status
from harness_opt.harness.freedoms import harnesses
from harness_opt.harness.over_motion import FoundHarness
from harness_opt.model.problem import Problem, given_problem, left_out
from harness_opt.model.results import Followed, Motion, Snap, joined
from harness_opt.model.spans import carried, in_spans, spans_of, too_short
from harness_opt.motion.follower import Progress
from harness_opt.motion.paper_sweep import sweep_by_quadrature
from harness_opt.motion.path import given_frames, place_frames
from harness_opt.motion.sweep import MOTION_TOLERANCE, Sweep, SweptSpans, in_turn, sweep
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.threads import one_thread
from harness_opt.rod.methods import check_method
from harness_opt.rod.states import Rod
from harness_opt.statics.equilibrium import Shape
from harness_opt.statics.paper_pose import Quadrature


@one_thread
def simulate(  # noqa: PLR0913
    problem: Problem,
    *,
    spatial_step: float | None = None,
    frames: ArrayLike | None = None,
    elements: int | None = None,
    tolerance: float = MOTION_TOLERANCE,
    solver: str = "gauss-newton",
    transcription: str = "collocation",
    points: int | None = None,
    closure: bool = False,
    first: Mapping[str, Shape] | None = None,
    progress: Progress | None = None,
    throw: bool = True,
) -> Motion:
    """Return the shapes of all cables over the whole motion.

    Args:
        problem: what to simulate.
        spatial_step: m; in place of the problem's own.
        frames: motion values (P,) to solve at, increasing within 0 to 1; in place of a spatial step.
        elements: least number of elements of a cable; None leaves it to ``tolerance``.
        tolerance: of the centrelines, in lengths of the cable.
        solver: name, as in :func:`harness_opt.equilibrium`.
        transcription: "collocation", or "dqm": the paper's own, each profile from the one before.
        points, closure: of "dqm", as in :func:`harness_opt.equilibrium`.
        first: shapes of the first frame, by cable, such as one of :func:`harness_opt.equilibria`; the others, and
            cables with clips, are found from their clamps alone.
        progress: called with a cable's name, frames done, frames in all; where it raises KeyboardInterrupt, the motion
            ends there, with the status INTERRUPTED.
        throw: raise where a shape cannot be found, or return the motion solved until there.

    Raises:
        ProblemError: a cable too short for its clamps; ends that no shape can join; frames that do not increase from 0
            to 1; a spatial step and frames both.
        SolveError: a shape could not be found; ``partial`` is the motion until there.
    """
    problem = given_problem(problem)
    check_method(transcription, solver)
    options = Quadrature(points, closure, solver, tolerance)
    if frames is None and (short := too_short(problem, problem.cables)):
        raise ProblemError([one.message for one in short])
    begin = time.perf_counter()
    motion = place_frames(problem, spatial_step) if frames is None else given_frames(frames, spatial_step)
    begins = _first_shapes(problem, first)
    if transcription == "dqm":
        swept = _by_quadrature(problem, motion, options, begins, progress)
    else:

        def follow(apart: Problem, name: str, harness: FoundHarness | None) -> Sweep:
            return sweep(
                apart, name, motion, tolerance=tolerance, solver=solver, elements=elements, first=begins.get(name),
                harness=harness, progress=progress,
            )  # fmt: skip

        swept = in_turn(problem, motion, follow, solver, progress, between=problem.has_limits)
    result = joined(problem, collect(swept, motion, time.perf_counter() - begin))
    if throw and not result.ok:
        raise SolveError(result.message, result.status, result)
    return result


def _first_shapes(problem: Problem, first: Mapping[str, Shape] | None) -> dict[str, Rod]:
    """Return the solved rods of the shapes that the first frame is to have.

    Raises:
        ProblemError: a shape of no cable of the problem, or one that was not found itself.
    """
    given = dict(first or {})
    whole = [name for name, run in problem.cables.items() if not run.clips]
    known = ", ".join(whole) or "the cables without clips"
    mistakes = [f"first: found {name!r}, expected one of {known}" for name in given if name not in whole]
    mistakes += [
        f"first.{name}: found no shape ({shape.status.value}), expected a solved one"
        for name, shape in given.items()
        if not shape.ok
    ]
    if mistakes:
        raise ProblemError(mistakes)
    return {name: shape.rod for name, shape in given.items()}


def _by_quadrature(
    problem: Problem, motion: Array, options: Quadrature, begins: Mapping[str, Rod], progress: Progress | None
) -> SweptSpans:
    """Follow all spans by the paper's transcription.

    Raises:
        ProblemError: free bodies, or clips that let the cable turn: these are found by the collocation.
    """
    spans, apart, cables = spans_of(problem), in_spans(problem), dict[str, Followed]()
    if harnesses(apart, problem):
        words = "expected 'collocation' with free bodies, and with clips that let the cable turn"
        raise ProblemError(f"transcription: found 'dqm', {words}")
    for name in spans:
        cables[name] = found = sweep_by_quadrature(apart, name, motion, options, begins.get(name), progress)
        if found.status is Status.INTERRUPTED:
            break
        if found.shapes is not None:
            apart = carried(apart, spans, name, float(motion[0]), found.shapes.quaternion[0, -1])
    return SweptSpans(problem, apart, {}, {}, cables)


def collect(swept: SweptSpans, motion: Array, seconds: float) -> Motion:
    """Return the motion of all spans, cut to the frames that all of them with any frame have.

    Args:
        swept: each as far as it could be followed.
        motion: values of the frames asked for, (P,).
        seconds: that it took.
    """
    problem, cables = swept.problem, swept.followed
    solved = {name: found.shapes for name, found in cables.items() if found.shapes is not None}
    frames = min((len(shapes.position) for shapes in solved.values()), default=0)
    failed = [found for found in cables.values() if not found.status.ok]
    snaps = [Snap(name, *snap) for name, found in cables.items() for snap in found.snaps if snap[0] < frames]
    return Motion(
        problem,
        motion[:frames],
        {name: shapes.frames(slice(frames)) for name, shapes in solved.items()},
        failed[0].status if failed else Status.OK,
        "; ".join(found.message for found in failed),
        tuple(snaps),
        tuple(name for name, found in cables.items() if found.begins_through_itself),
        left_out(problem),
        {"solve": seconds},
    )
