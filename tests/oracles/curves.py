"""Centrelines in closed form, for the tests of clearances."""

from __future__ import annotations

import numpy as np

from harness_opt.model.cable import Cable, CableRun
from harness_opt.model.ends import End
from harness_opt.model.results import CableMotion
from harness_opt.numerics import rotations

LENGTH = 0.3
DIAMETER = 0.005


def shapes(curves, length: float, count: int = 101) -> CableMotion:
    """A motion (P frames) of curves: functions s (n,) -> position, tangent, curvature vector (n, 3)."""
    s = np.linspace(0, length, count)
    position, tangent, bend = (
        np.array([curve(s)[k] for curve in curves]).reshape(len(curves), count, 3) for k in range(3)
    )
    frames = rotations.shortest_arc([0.0, 0.0, 1.0], tangent)
    local = rotations.rotate(rotations.conjugate(frames), bend)
    # r'' = R (omega x e3)
    curvature = np.stack([-local[..., 1], local[..., 0], 0 * s + 0 * local[..., 0]], axis=-1)
    blank, per_frame = np.zeros_like(position), np.zeros(len(position))
    return CableMotion(s, position, frames, curvature, blank, blank, per_frame == 0, per_frame, per_frame, per_frame)


def helix(radius: float, pitch: float, turn=(1.0, 0.0, 0.0, 0.0), centre=(0.0, 0.0, 0.0), phase=0.0):
    """A helix by arc length, turned and moved."""

    def curve(s):
        scale = np.hypot(radius, pitch / (2 * np.pi))
        a = s / scale + phase
        rise = pitch / (2 * np.pi) / scale
        zero = np.zeros_like(a)
        r = np.stack([radius * np.cos(a), radius * np.sin(a), rise * s], -1)
        t = np.stack([-radius / scale * np.sin(a), radius / scale * np.cos(a), zero + rise], -1)
        k = np.stack([-np.cos(a), -np.sin(a), zero], -1) * radius / scale**2
        return centre + rotations.rotate(turn, r), rotations.rotate(turn, t), rotations.rotate(turn, k)

    return curve


def line(start, direction):
    def curve(s):
        d = rotations.normalise(direction)
        return start + s[:, None] * d, np.tile(d, (len(s), 1)), np.zeros((len(s), 3))

    return curve


def random_helices(rng, count):
    return [
        helix(
            rng.uniform(0.02, 0.06),
            rng.uniform(0.05, 0.2),
            rotations.normalise(rng.normal(size=4)),
            rng.uniform(-0.05, 0.05, 3),
            rng.uniform(0, 6),
        )
        for _ in range(count)
    ]


def runs(*names, bodies=("world", "world")):
    """Cables in clamps of their own, a decimetre apart."""
    return {
        name: CableRun(
            Cable(LENGTH, DIAMETER, 1e-3, 1e-3),
            End(position=(0.1 * k, 0, 0), body=bodies[0]),
            End(position=(0.1 * k, 0, 0.3), body=bodies[1]),
        )
        for k, name in enumerate(names or ("lead",))
    }
