"""A cable whose end is turned by a hinge, its clamp's poses by SciPy, and measures of profiles."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

import harness_opt as ho

CABLE = ho.Cable(length=1.0, diameter=0.01, bending_stiffness=1.0, torsional_stiffness=0.7, mass_per_length=0.2)
UP = (1.0, 0.0, 0.0, 0.0)
ALONG_X = (math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0)
CLAMP = ho.End(
    (0.3, 0.1, 0.4), tuple(Rotation.from_euler("x", 30, degrees=True).as_quat(scalar_first=True)), body="arm"
)
HINGE = ho.Hinge((0.6, 0.0, 0.3), (0.0, -1.0, 0.4), 0.2, 1.2)
STEP = 0.05


def problem_of(start: ho.End, end: ho.End, **changes: object) -> ho.Problem:
    return dataclasses.replace(
        ho.Problem(
            {"lead": ho.CableRun(CABLE, start, end)}, {"arm": ho.Body(HINGE)}, gravity=(0, 0, -9.81), duration=2.0
        ),
        spatial_step=STEP,
        **changes,
    )


PROBLEM = problem_of(ho.End((0, 0, 0), UP), CLAMP)


def hinged(angle: np.ndarray, end: ho.End) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and rotation matrices of a clamp that turns about HINGE, by SciPy's rotations."""
    axis = np.array(HINGE.axis) / np.linalg.norm(HINGE.axis)
    turn = Rotation.from_rotvec(np.outer(angle, axis))
    held = Rotation.from_quat(end.quaternion, scalar_first=True)
    return HINGE.point + turn.apply(np.subtract(end.position, HINGE.point)), (turn * held).as_matrix()


def polygon(position: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.diff(position, axis=-2), axis=-1).sum(axis=-1)


def turns(rotation: np.ndarray) -> np.ndarray:
    """Return the rotation vectors (T, 100, 3) from each of 101 nodes to the next, by SciPy."""
    frames = rotation.reshape(-1, 101, 3, 3)
    steps = np.swapaxes(frames[:, :-1], -1, -2) @ frames[:, 1:]
    return Rotation.from_matrix(steps.reshape(-1, 3, 3)).as_rotvec().reshape(-1, 100, 3)


def integrated(s: np.ndarray, profile: ho.Profile) -> np.ndarray:
    """Return the centreline (17) of the directors alone, by a spline of order 8."""
    return profile.position[0] + make_interp_spline(s, profile.rotation[:, :, 2], k=7).antiderivative()(s)


POINTS = np.arange(12.0).reshape(4, 3)
TURNS = Rotation.from_rotvec(POINTS).as_matrix()


def halves(motion: ho.Motion) -> np.ndarray:
    return 0.5 * (motion.motion[1:] + motion.motion[:-1])
