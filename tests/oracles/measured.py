"""Cables that are measured in the tests: photographed ones, and computed ones with noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import harness_opt as ho
from harness_opt.measured.measurements import Measurement, Measurements, Pose

LOOPS = Path(__file__).resolve().parents[1] / "measured" / "loops"
GRAVITY = (0.0, 0.0, -9.81)
CABLES = {  # kg/m, B, C/B as published, and the mean of the measured twists of the snap, deg
    "white": (0.087 / 5, 1.2166e-4, 0.8232, 975.0),
    "black": (0.081 / 2.98, 1.19645e-3, 1.4619, 482.0),
}


def photographed(name: str, find: str = '["bending_stiffness"]', more: str = "") -> str:
    """Return the file of measurements of one of the photographed cables, as it may lie beside the loops."""
    mass, bending, ratio, _ = CABLES[name]
    loops = "\n".join(f'[[measurements]]\nkind = "loop"\nfile = "{name}{k}.csv"\nunit = "m"' for k in range(5))
    return f"""schema = 1
find = {find}
[cable]
diameter = 3e-3
length = 1.5
mass_per_length = {mass!r}
bending_stiffness = {bending!r}
torsional_stiffness = {bending * ratio!r}
[start]
tangent = [1, 0, 0]
roll_deg = 0
[end]
tangent = [1, 0, 0]
{loops}
{more}
"""


def hanging(bending: float = 1e-3) -> tuple[ho.Cable, Pose]:
    """Return a cable and a pose in which it hangs as a loop between two level holders."""
    cable = ho.Cable(1.2, 6e-3, bending, 0.8 * bending, 0.05)
    ends = (
        ho.End((0.0, 0.0, 0.0), tangent=(1.0, 0.0, 0.0), roll_deg=0.0),
        ho.End((-0.1, 0.0, 0.0), tangent=(1.0, 0.0, 0.0)),
    )
    return cable, Pose(1.2, *ends, bow=(0.0, 0.0, -1.0))


def noisy(shape: ho.Motion | object, pose: Pose, noise: float, seed: int, *, planar: bool = True) -> Measurement:
    """Return 40 points of an equilibrium, each off by noise, m, in both directions of a photograph, or in all three."""
    random = np.random.default_rng(seed)
    points = shape.at(np.linspace(0.0, pose.length, 40)).position  # type: ignore[attr-defined]
    off = noise * random.standard_normal(points.shape)
    if planar:
        off[:, 1] = 0.0
    return Measurement("loop", "loop", pose, 0.0, points + off, None, planar, noise, True)


def given(cable: ho.Cable, *measured: Measurement, sought: tuple[str, ...] = ("bending_stiffness",)) -> Measurements:
    return Measurements(cable, sought, GRAVITY, measured)
