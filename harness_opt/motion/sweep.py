"""One cable followed from frame to frame.

Each shape starts from the last ones; a cable that loses its shape is released to one of less energy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from harness_opt.errors import Status
from harness_opt.harness.freedoms import harnesses
from harness_opt.harness.over_motion import FoundHarness, find
from harness_opt.model.ends import End
from harness_opt.model.problem import Problem
from harness_opt.model.results import STATIONS, CableMotion, Followed, Quantities, cubic_errors
from harness_opt.model.spans import carried, in_spans, spans_of
from harness_opt.motion.cases import CableCases
from harness_opt.motion.common_mesh import on_one_mesh
from harness_opt.motion.follower import CableFollower, Progress
from harness_opt.motion.frames import Frames, blocks, stretches
from harness_opt.numerics.rotations import Array
from harness_opt.rod import equations as rod_module
from harness_opt.rod.equations import Units
from harness_opt.rod.stability import Stability, stability
from harness_opt.rod.states import Rod
from harness_opt.statics.fitting import Fitted
from harness_opt.statics.mesh import finer_mesh
from harness_opt.statics.solve import Solved, batch, resample, solve_along_near_null, solve_on

Rigour = Literal["full", "stable", "quick look"]

MOTION_TOLERANCE = 1e-7  # of the centreline over a motion, in lengths of the cable


@dataclass(frozen=True)
class Sweep:
    """One cable followed over the frames, with the solver's own objects; not for keeping.

    Args:
        frames: a solve each, all on one mesh; fewer than asked where ``status`` says so.
        origins: world position of the cable's start, (P, 3), m.
        units, diameter: of the cable, m.
        lengths: of the cable in the frames, (P,), m: of a span between clips that it slides through they differ.
        stability: of the frames, batched.
        errors: estimated, (P,), in lengths of the cable.
        snaps: (frame, motion, whether the cable goes through itself) of each jump.
        status, message: why the sweep ended early; OK and empty otherwise.
        fitted: the cable as it was fitted, where the roll of an end was found so.
        begins_through_itself: as of :class:`~harness_opt.model.results.Followed`.
    """

    frames: Sequence[Solved]
    origins: Array
    units: Units
    diameter: float
    lengths: Array
    stability: Stability
    errors: Array
    snaps: tuple[tuple[int, float, bool], ...]
    status: Status
    message: str
    fitted: Fitted | None = None
    begins_through_itself: bool = False

    @property
    def rod(self) -> Rod:
        """All frames as one batch."""
        return batch(self.frames)


def start_positions(ends: Sequence[tuple[End, End]], last: Array, lengths: Array) -> Array:
    """Return the world positions (P, 3) of a cable's start, m: given, or the end's less where the shape leads.

    Args:
        ends: in world coordinates, of P frames or more.
        last: the shapes' own end, relative to their start, (P, 3), in lengths of the cable.
        lengths: of the cable, (P,), m.
    """
    return np.array(
        [
            start.position if start.position is not None else np.asarray(end.position) - length * r
            for (start, end), length, r in zip(ends, lengths, last, strict=False)
        ]
    )


def sweep(  # noqa: PLR0913
    problem: Problem,
    name: str,
    motion: Array,
    *,
    tolerance: float = MOTION_TOLERANCE,
    solver: str = "gauss-newton",
    elements: int | None = None,
    first: Rod | None = None,
    guesses: Sequence[Solved | None] | None = None,
    near: Fitted | None = None,
    harness: FoundHarness | None = None,
    rigour: Rigour = "full",
    recovers: bool = True,
    progress: Progress | None = None,
) -> Sweep:
    """Follow the cable ``name`` over ``motion`` (P,).

    Args:
        problem: the problem.
        name: of the cable.
        motion: values of the frames.
        tolerance: of the centreline, in lengths of the cable; the mesh is refined and the frames solved again until
            it holds.
        solver: name.
        elements: least number of elements; None leaves it to the tolerance.
        first: the shape of the first frame, of a like cable; None leaves it to a cold start.
        guesses: solves of a like motion to start from, one a frame or None.
        near: a fit of a like cable to start from, for the roll of an untwisted end.
        harness: that the cable is a span of, found over the same frames: what the shapes are taken from.
        rigour: "full"; "stable" leaves the stability margins out (NaN), whether the frames are stable is checked all
            the same; "quick look" leaves out stability and accuracy both.
        recovers: whether a cable that loses its shape is released, and followed on; the sweep ends there otherwise.
        progress: called with the cable's name, frames done, frames in all.
    """
    quick_look = rigour == "quick look"
    if harness is not None:
        guesses = on_one_mesh(stretches(harness.solves(name)), solver)
        motion, recovers = motion[: len(guesses)], False
        if not len(motion):
            return _none(problem, name, harness.status, harness.message)
    cases = CableCases(problem, name, solver, near, first if motion[0] == 0.0 else None)
    follower = CableFollower(cases, motion, elements or 0, progress, recovers=recovers)
    try:
        status, message = follower.run_all(first, guesses, check=not quick_look)
    except KeyboardInterrupt:  # raised by ``progress``: what is solved until here is kept
        status, message = Status.INTERRUPTED, f"cable {name}: {Status.INTERRUPTED.value}"
    frames = on_one_mesh(follower.frames, solver)
    if len(frames) < len(follower.frames):
        status, message = Status.STEP_TOO_SMALL, follower.failure(len(frames), "no mesh serves for all frames")
    if not frames:
        return _none(problem, name, status, message)
    cable = problem.cables[name].cable
    units = rod_module.scale(cable)[1]
    errors = np.full(len(frames), np.nan)
    if not quick_look:
        frames, errors = accurate(frames, tolerance, solver)
    if not quick_look and status.ok and not np.max(errors) <= tolerance:
        worst = int(np.argmax(errors))
        status = Status.INACCURATE
        message = (
            f"cable {name}, frame {worst} of {len(motion)}: {status.value} (estimated error {errors[worst]:.1e} of its "
            f"length, asked for {tolerance:.1e}); try a looser tolerance"
        )
    if rigour == "full":
        answer = _stability(frames)
    else:
        answer = Stability(np.full(len(frames), np.nan), np.zeros(len(frames), dtype=int))
    snaps, fitted = tuple(follower.snaps), cases.fitted
    if harness is not None:
        fitted = harness.fit(harness.freedoms.problem.cables[name], name)
        snaps += tuple((frame, at, False) for frame, at in harness.snaps)
        if status.ok:
            status, message = harness.status, harness.message
    lengths = follower.lengths[: len(frames)]
    origins = start_positions(follower.ends, np.concatenate([rods.r[:, -1] for rods in blocks(frames)]), lengths)
    return Sweep(
        frames, origins, units, cable.diameter, lengths, answer, errors, snaps, status, message, fitted,
        follower.begins_through_itself,
    )  # fmt: skip


def _none(problem: Problem, name: str, status: Status, message: str) -> Sweep:
    """Return the sweep of a cable of which no frame was solved."""
    cable = problem.cables[name].cable
    nothing, stability = np.zeros(0), Stability(np.zeros(0), np.zeros(0, dtype=int))
    units = rod_module.scale(cable)[1]
    return Sweep(Frames(), np.zeros((0, 3)), units, cable.diameter, nothing, stability, nothing, (), status, message)


@dataclass(frozen=True)
class SweptSpans:
    """The spans of all cables over the frames.

    Args:
        whole: the problem of whole cables, with everything free where it was found.
        problem: of spans, with the rolls that clips were fitted in, and everything free where it was found.
        sweeps: by span, with the solver's own objects.
        harnesses: by span, those that are part of one.
        followed: the plain results, by span.
    """

    whole: Problem
    problem: Problem
    sweeps: Mapping[str, Sweep]
    harnesses: Mapping[str, FoundHarness]
    followed: Mapping[str, Followed]


def swept_spans(
    whole: Problem, problem: Problem, sweeps: Mapping[str, Sweep], harnesses: Mapping[str, FoundHarness] | None = None
) -> SweptSpans:
    """Return the spans of ``whole`` cables, in ``problem``, with the plain results of their ``sweeps``."""
    return SweptSpans(whole, problem, sweeps, harnesses or {}, {name: followed(one) for name, one in sweeps.items()})


def in_turn(
    problem: Problem,
    motion: Array,
    follow: Callable[[Problem, str, FoundHarness | None], Sweep],
    solver: str,
    progress: Progress | None = None,
    *,
    between: bool = True,
    near: Mapping[str, FoundHarness] | None = None,
) -> SweptSpans:
    """Follow the spans of all cables one after the other: what rolls clips are fitted in, the spans behind them hold.

    Spans that free bodies or clips couple are found together first, then followed with these held.

    Args:
        problem: of whole cables.
        motion: values (P,) of the frames.
        follow: one span of the problem of spans, by name, with the harness that it is part of, if any.
        solver: name of the one that harnesses are found by.
        progress: as of :func:`sweep`.
        between: whether harnesses are to be known between the frames as exactly as in them.
        near: like harnesses to start from, by span.
    """
    problem = problem.changed(found={})
    spans, apart = spans_of(problem), in_spans(problem)
    swept, coupled = dict[str, Sweep](), dict[str, FoundHarness]()
    groups = {span: freedoms for freedoms in harnesses(apart, problem) for span in freedoms.spans}
    for name in spans:
        if name in groups and name not in coupled:
            like, freedoms = (near or {}).get(name), groups[name].of(apart)
            harness = find(freedoms, motion, solver, progress, between=between, near=like)
            coupled |= dict.fromkeys(groups[name].spans, harness)
            apart = harness.problem
        swept[name] = follow(apart, name, coupled.get(name))
        if swept[name].status is Status.INTERRUPTED:
            break
        if len(swept[name].frames):
            clamp = problem.cables[spans[name].cable].clamps[spans[name].clamps[1]]
            apart = carried(apart, spans, name, float(motion[0]), swept[name].frames[0].rod.q[-1], clamp)
    return swept_spans(problem.changed(found=apart.found), apart, swept, coupled)


def _stability(frames: Sequence[Solved]) -> Stability:
    """Return the stability of all frames, batched."""
    kind = frames[0].case.boundary.kind
    found = [stability(rods, kind) for rods in blocks(frames)]
    return Stability(*(np.concatenate([getattr(one, key) for one in found]) for key in ("margin", "index")))


def accurate(frames: Frames, tolerance: float, solver: str) -> tuple[Frames, Array]:
    """Return the frames on a mesh, one for all, on which every estimated error is at most ``tolerance`` where
    possible.
    """
    few_frames = 20  # frames that are too inaccurate, up to which their near-null directions are looked for
    before = np.inf
    while True:
        errors, local = frames.errors()
        loose = np.flatnonzero(~(errors <= tolerance))
        if 0 < len(loose) <= few_frames:
            changed = {
                k: better for k in loose.tolist() if (better := solve_along_near_null(frames[k])) is not frames[k]
            }
            if changed:
                frames = Frames((changed.get(k, frame) for k, frame in enumerate(frames)), frames.most_held)
                errors, local = frames.errors()
        worst = float(np.max(errors))
        if worst <= tolerance:
            return frames, errors
        mesh = finer_mesh(frames[0].bound.mesh, local, worst / tolerance, before)
        if mesh is None:
            return frames, errors
        before = worst / tolerance
        again = Frames(most_held=frames.most_held)
        shapes = (x for rods in blocks(frames) for x in resample(rods, mesh))
        for frame, x in zip(frames, shapes, strict=True):
            solved = solve_on(frame.case, mesh, x, solver, near=again[-1] if again else None)
            if not solved.ok or solved.turned:
                return frames, errors
            again.append(solved)
        frames = again


def sampled(rods: Iterable[Rod], origins: Array, units: Units, shares: Array, lengths: Array) -> Quantities:
    """Return the quantities at stations, with a leading axis of P frames.

    Args:
        rods: the shapes of the frames in turn, one or many of them a rod.
        origins: world positions of the cable's start, (P, 3), m.
        units: of the cable.
        shares: of the length at which the stations stand, (N,).
        lengths: of the cable in the frames, (P,), m.
    """
    shape = (len(origins), len(shares))
    vectors = {name: np.empty((*shape, 3)) for name in ("position", "curvature", "force", "moment")}
    whole, first = Quantities(s=shares * units.length, quaternion=np.empty((*shape, 4)), **vectors), 0
    for rod in rods:  # into their places block by block: all frames are not there twice
        some = slice(first, first + (len(rod.q) if rod.q.ndim == 3 else 1))
        block = rod.sample(shares).in_si(whole.s, units.at(lengths[some]), origins[some])
        for name in (*vectors, "quaternion"):
            getattr(whole, name)[some] = getattr(block, name)
        first = some.stop
    return whole


def well_sampled(sample: Callable[[Array], Quantities], diameter: float, stations: int = STATIONS) -> Quantities:
    """Return what ``sample`` gives at stations so dense that cubics between them are as good as the curve.

    They are equally spaced where that will do, and denser where a shape turns: in the layer at a clamp that a heavy or
    taut cable bends in, and in curls. A cubic's error falls with the fourth power of the spacing.

    Args:
        sample: gives the quantities at shares (N,) of the length.
        diameter: of the cable, m: cubics are asked to be within a thousandth of it, a tenth of what clearances are
            wanted to.
        stations: least number.
    """
    close_enough, rounds, most = 1e-3 * diameter, 4, 4 * stations
    shares = np.linspace(0.0, 1.0, stations)
    found = sample(shares)
    for _ in range(rounds):
        error = cubic_errors(found)
        parts = np.ceil((np.maximum(error, close_enough) / close_enough) ** 0.25 - 1e-9).astype(int)
        if np.all(parts == 1) or len(shares) >= most:
            break
        steps = [np.arange(1, n + 1) / n for n in parts]
        within = [low + step * (high - low) for low, high, step in zip(shares[:-1], shares[1:], steps, strict=True)]
        shares = np.concatenate([[0.0], *within])
        found = sample(shares)
    return found


def cable_motion(swept: Sweep, shares: Array | None = None) -> CableMotion:
    """Return the plain arrays of a sweep.

    Args:
        swept: the sweep.
        shares: of the length at which the stations stand, (N,); None puts them as :func:`well_sampled` does.
    """

    def sample(shares: Array) -> Quantities:
        return sampled(blocks(swept.frames), swept.origins, swept.units, shares, swept.lengths)

    return CableMotion(
        **vars(well_sampled(sample, swept.diameter) if shares is None else sample(shares)),
        stable=swept.stability.index == 0,
        stability_margin=swept.stability.margin,
        residual=np.array([frame.solution.residual for frame in swept.frames]),
        estimated_error=swept.errors,
        mesh=swept.frames[0].bound.mesh,
    )


def followed(swept: Sweep) -> Followed:
    """Return the plain results of a sweep."""
    shapes = cable_motion(swept) if swept.frames else None
    return Followed(shapes, swept.snaps, swept.status, swept.message, swept.begins_through_itself)
