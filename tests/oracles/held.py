"""A cable between two clamps, one of which may move; the tests of failures start from it."""

from __future__ import annotations

import dataclasses

import harness_opt as ho
from harness_opt.numerics import rotations

CABLE = ho.Cable(length=1.0, diameter=0.01, bending_stiffness=1.0, torsional_stiffness=0.7, mass_per_length=0.5)
UP = (1.0, 0.0, 0.0, 0.0)
ALONG_X = tuple(rotations.from_tangent((1, 0, 0)).tolist())
START = ho.End(position=(0, 0, 0), quaternion=UP)
END = ho.End(position=(0.3, 0, 0.4), quaternion=UP)


MOVING = ho.CableRun(CABLE, START, ho.End((0.3, 0, 0.4), UP, body="arm"))


def moving(motion: object, **changes: object) -> ho.Problem:
    return dataclasses.replace(ho.Problem({"lead": MOVING}, {"arm": ho.Body(motion)}), **changes)
