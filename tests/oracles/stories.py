"""Cables that move in closed form, and one on an arm that swings round."""

from __future__ import annotations

import numpy as np

from harness_opt.clearance.moving_centreline import MovingCurve
from harness_opt.clearance.solved_frames import SolvedFrames
from harness_opt.model.bodies import Body, Hinge
from harness_opt.model.cable import Cable, CableRun
from harness_opt.model.ends import End
from harness_opt.model.problem import Problem
from harness_opt.numerics import rotations
from oracles.curves import DIAMETER, LENGTH, helix, shapes


class Story:
    """A cable that bends, turns and wanders over a motion, in closed form.

    It starts from random helices and returns, as smoothly as clamps on hinges do; asked for frames in between, it
    counts them.
    """

    def __init__(self, rng, swing=0.04):
        self.bow, self.pitch = rng.uniform(0.03, 0.06), rng.uniform(0.1, 0.3)
        self.grow, self.phase = rng.uniform(0.1, 0.4), rng.uniform(0, 6)
        self.turn = rotations.normalise(rng.normal(size=4))
        self.axis = rotations.normalise(rng.normal(size=3))
        self.angle, self.swing = rng.uniform(0.3, 1.2), rng.uniform(-swing, swing, (2, 3))
        self.asked: list[float] = []

    def curve(self, t: float):
        spin = rotations.from_rotation_vector(self.angle * np.sin(1.5 * t) * self.axis)
        radius = self.bow * (1 + self.grow * np.sin(2 * t + self.phase))
        centre = self.swing[0] * t + self.swing[1] * np.sin(3 * t)
        return helix(radius, self.pitch, rotations.multiply(spin, self.turn), centre)

    def shapes(self, motion):
        return shapes([self.curve(t) for t in motion], LENGTH)

    def solve(self, cable, values):
        self.asked += list(values)
        return self.shapes(values), ("",) * len(values)

    def points(self, t, s):
        return self.curve(t)(s)[0]


def moving(*frames) -> MovingCurve:
    """The moving curve of frames without a snap; arguments as for SolvedFrames."""
    return MovingCurve(SolvedFrames(*frames, jumps=np.zeros(0), turns=np.zeros(0)))


def lift(parts, **changes):
    """A cable between the world and an arm that swings it round by 90 degrees."""
    run = CableRun(
        Cable(0.3, DIAMETER, 2e-3, 1.5e-3, 0.05),
        End(position=(0, 0, 0), quaternion=(1, 0, 0, 0)),
        End(position=(0.16, 0, 0.02), quaternion=(0, 0, 1, 0), body="arm"),
    )
    arm = {"arm": Body(Hinge((0, 0, 0), (0, 0, 1), 0.0, np.pi / 2))}
    given = {"gravity": (0, 0, -9.81), **changes}
    return Problem({"lead": run}, {**arm, **given.pop("bodies", {})}, parts, **given)
