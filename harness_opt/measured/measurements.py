"""What was measured of a cable, and what is sought: plain checked data."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from harness_opt.model.cable import Cable
from harness_opt.model.ends import End
from harness_opt.numerics.rotations import Array

TORSION = 0.75  # of the bending stiffness, where nothing is known of the torsional one: between rubber and metal


@dataclass(frozen=True)
class Pose:
    """A cable as it was held while it was measured.

    Args:
        length: between the two ends, m.
        start, end: what held it, in world coordinates; without a roll, untwisted.
        bow: world direction to which it bowed, (3,), or None.
    """

    length: float
    start: End
    end: End
    bow: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class Measurement:
    """One measurement.

    Args:
        name: for people.
        kind: "loop", points along its shape; "sag", of the tip of a piece held level; "force", at a clamp; "snap",
            the twist of the end at which a loop leaves its plane.
        pose: how it was held.
        value: sag, m; force, N; twist, rad; 0 of a loop.
        points: of a loop, (n, 3), world, m.
        arc_lengths: of the points, (n,), m, or None where they are not known.
        planar: whether only the places in the x-z plane were measured, as in a photograph.
        error: standard deviation of the value, or of a coordinate of a point, in the same unit.
        error_given: whether somebody said so; else it is a guess, and the scatter decides.
        side: of a force, the end that it was measured at.
    """

    name: str
    kind: Literal["loop", "sag", "force", "snap"]
    pose: Pose
    value: float
    points: Array
    arc_lengths: Array | None
    planar: bool
    error: float
    error_given: bool
    side: Literal["start", "end"] = "start"


@dataclass(frozen=True)
class Measurements:
    """All that was measured of one cable.

    Args:
        cable: what is known of it, and where the search begins; its length is the longest pose's.
        begin_known: whether a bending stiffness to begin at was given.
        torsion_known: whether a torsional stiffness was given; else it stays :data:`TORSION` of the bending stiffness.
        sought: names of what is to be found.
        gravity: m/s2, (3,).
        measured: the measurements.
        band: of the bending stiffness by the cable's construction, N m2: all wires slipping, and all sticking; None
            where that is not known.
        title: one line for people.
        file: where they were read from, or None.
    """

    cable: Cable
    sought: tuple[str, ...]
    gravity: tuple[float, float, float]
    measured: tuple[Measurement, ...]
    begin_known: bool = True
    torsion_known: bool = True
    band: tuple[float, float] | None = None
    title: str = ""
    file: Path | None = None
