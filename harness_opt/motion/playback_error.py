"""How far a playback is from the shapes that would have been solved at its moments."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness_opt.model.cable import CableRun
from harness_opt.model.results import Motion
from harness_opt.motion.paper_data import solved
from harness_opt.motion.playback import AT_FRAME, INTERPOLATIONS, between, moments
from harness_opt.motion.simulate import simulate
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array


@dataclass(frozen=True)
class DisplayError:
    """The largest errors of one interpolation over a playback, against shapes solved at the same moments.

    Args:
        node: distance of a node from its place, m.
        time: when that is, s.
        length: relative error of the length of the polygon through the nodes.
        clamp: distance of the cable's ends from the positions that their clamps hold, m; 0 where none does.
        clamp_turn: angle of the section frames there from the orientations that the clamps hold, rad.
    """

    node: float
    time: float
    length: float
    clamp: float
    clamp_turn: float


def display_error(motion: Motion, cable: str, temporal_step: float | None = None) -> dict[str, DisplayError]:
    """Return the errors of the "exact" and the "linear" interpolation, by name.

    Shapes are solved at the moments too, on the way over all frames of ``motion``; at its frames there is no error.
    They are solved by collocation, whatever solved the motion, so that errors of the paper's own method count as well.
    Where the cable snaps, what is shown between two frames may be another shape than the solved one, and counts.

    Args:
        motion: simulated.
        cable: name.
        temporal_step: of the playback, s, as in :func:`harness_opt.display`; None measures half-way between every two
            frames, where the errors are largest.

    Raises:
        ProblemError: no such cable; a temporal step as in :func:`harness_opt.display`.
        SolveError: a shape between the frames could not be found, or the clamps could not be joined there.
    """
    solved(motion, cable)
    frames, run = motion.motion, motion.problem.cables[cable]
    if temporal_step is None:
        values = 0.5 * (frames[1:] + frames[:-1])
    else:
        values = moments(motion, temporal_step) / motion.problem.duration
        values = values[np.min(np.abs(values[:, None] - frames), axis=1) > AT_FRAME]
    if not len(values):
        return dict.fromkeys(INTERPOLATIONS, DisplayError(0.0, 0.0, 0.0, 0.0, 0.0))
    together = np.union1d(frames, values)
    there = simulate(motion.problem.changed(cables={cable: run}), frames=together).cables[cable]
    wanted = np.searchsorted(together, values)
    truth = there.position[wanted], rotations.matrix(there.quaternion[wanted])
    times = values * motion.problem.duration
    return {name: _compared(between(motion, cable, values, name), truth, times, run) for name in INTERPOLATIONS}


def _compared(shown: tuple[Array, Array], truth: tuple[Array, Array], times: Array, run: CableRun) -> DisplayError:
    """Return the errors of shown profiles, positions (T, N, 3) and rotations (T, N, 3, 3), against the true ones."""
    distance = np.linalg.norm(shown[0] - truth[0], axis=2)
    ends = {0: run.start, -1: run.end}
    clamped = [node for node, end in ends.items() if end.position is not None]
    turned = [node for node, end in ends.items() if end.frame is not None and not end.has_open_roll]
    # |A - B| in the Frobenius norm is sqrt(8) times the sine of half the angle between them
    sine = np.linalg.norm(shown[1][:, turned] - truth[1][:, turned], axis=(2, 3)) / np.sqrt(8.0)
    return DisplayError(
        float(distance.max()),
        float(times[distance.max(axis=1).argmax()]),
        float(np.abs(_length(shown[0]) / _length(truth[0]) - 1.0).max()),
        float(distance[:, clamped].max(initial=0.0)),
        float(2.0 * np.arcsin(np.minimum(sine, 1.0)).max(initial=0.0)),
    )


def _length(position: Array) -> Array:
    """Return the lengths (T,) of the polygons through nodes (T, N, 3)."""
    lengths: Array = np.linalg.norm(np.diff(position, axis=1), axis=2).sum(axis=1)
    return lengths
