"""Runs of the paper's rig, section 5: its end turned about its own tangent, then brought towards the other."""

from __future__ import annotations

import dataclasses
import math
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import harness_opt as ho
from harness_opt.numerics import rotations
from harness_opt.pictures import drawing

Array = np.ndarray
FILES = {"0.1345": "twist_rig.toml", "134.5": "twist_rig_134_5.toml"}  # by reading of the bending rigidity, mN m2
PROBLEMS = Path(__file__).resolve().parents[2] / "problems" / "twist_rig"
CABLE = "cable"
NEAR, FAR = 0.2, 0.98  # distance of the ends, in lengths of the cable
TURN_STEP, STEP = 5.0, 0.01  # degrees and lengths of the cable between two frames; twice that in a quick run
TOUCHING = 0.0  # m, clearance of the cable to itself below which it touches
SAME = 1e-4  # of the length: what two shapes of one branch may differ by
OUT = 1e4  # lengths of the cable, to which its ends are lengthened for the writhe
CHORDS = 300  # of the polygon for the writhe; half as many for its error


# --- the rig ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Rig:
    """One run: a reading, a twist, and the poses of the moving end.

    Args:
        reading: key of FILES.
        twist: degrees.
        problem: with the end on a body that turns, then slides.
        angle: of the end at each frame, degrees, (P,).
        distance: of the ends at each frame, in lengths of the cable, (P,).
    """

    reading: str
    twist: float
    problem: ho.Problem
    angle: Array
    distance: Array

    @property
    def cable(self) -> ho.Cable:
        """The cable."""
        return self.problem.cables[CABLE].cable

    @property
    def frames(self) -> Array:
        """Values of the motion at which the frames stand: at the poses given, (P,)."""
        return np.linspace(0.0, 1.0, len(self.angle))


def rig(reading: str, twist: float, coarser: int = 1) -> Rig:
    """Return the rig that turns its end by ``twist`` degrees at FAR and brings it in to NEAR."""
    shipped = ho.read_problem(PROBLEMS / FILES[reading])
    run = shipped.cables[CABLE]
    turns = math.ceil(twist / (coarser * TURN_STEP))
    comes = round((FAR - NEAR) / (coarser * STEP))
    angle = np.append(np.linspace(0.0, twist, turns + 1), np.full(comes, twist))
    distance = np.append(np.full(turns, FAR), np.linspace(FAR, NEAR, comes + 1))
    along = rotations.tangent(run.start.frame)
    turned = rotations.from_rotation_vector(np.radians(angle)[:, None] * along)
    chuck = ho.Poses(
        tuple(np.arange(len(angle), dtype=float)),
        tuple(map(tuple, run.cable.length * distance[:, None] * along)),
        tuple(map(tuple, turned)),
    )
    end = ho.End((0.0, 0.0, 0.0), run.start.frame, body="chuck")
    problem = dataclasses.replace(
        shipped,
        cables={CABLE: ho.CableRun(run.cable, run.start, end)},
        bodies={"chuck": ho.Body(chuck)},
        limits=ho.Limits(clearance=TOUCHING),
    )
    return Rig(reading, twist, problem, angle, distance)


# --- twist and writhe ---------------------------------------------------------------------------------------


def writhe(points: Array) -> float:
    """Return the writhe of a polygon (n, 3), in turns: the exact Gauss integral over all pairs of its sides.

    Klenin and Langowski, "Computation of writhe in modeling of supercoiled DNA", Biopolymers 54 (2000), method 1a.
    """
    side = np.diff(points, axis=0)
    i, j = np.triu_indices(len(side), 2)
    r13, r14 = points[j] - points[i], points[j + 1] - points[i]
    r23, r24 = points[j] - points[i + 1], points[j + 1] - points[i + 1]
    normals = [np.cross(a, b) for a, b in ((r13, r14), (r14, r24), (r24, r23), (r23, r13))]
    size = [np.linalg.norm(n, axis=1, keepdims=True) for n in normals]
    n = [a / np.where(b > 0.0, b, 1.0) for a, b in zip(normals, size, strict=True)]
    corners = sum(np.arcsin(np.clip(np.sum(n[k] * n[(k + 1) % 4], axis=1), -1.0, 1.0)) for k in range(4))
    sign = np.sign(np.sum(np.cross(side[j], side[i]) * r13, axis=1))
    return float(np.sum(corners * sign)) / (2.0 * math.pi)


def cable_writhe(shapes: Any, frame: int) -> float:
    """Return the writhe of the cable with its ends lengthened straight, in turns.

    That of the polygon through CHORDS points, and of half as many, extrapolated: its error falls with the square.
    """
    curve, tangent = drawing.curve_of(shapes), rotations.tangent(shapes.quaternion[frame])
    out = OUT * shapes.s[-1]
    found = []
    for chords in (CHORDS // 2, CHORDS):
        points = curve.at(np.full(chords + 1, frame), np.linspace(0.0, shapes.s[-1], chords + 1))
        found.append(writhe(np.vstack([points[0] - out * tangent[0], points, points[-1] + out * tangent[-1]])))
    return found[1] + (found[1] - found[0]) / 3.0


def cable_twist(shapes: Any) -> Array:
    """Return the twist of the cable in each frame, in turns, (P,): the integral of omega_3 by Simpson's rule."""
    weights = np.ones(len(shapes.s))
    weights[1:-1:2], weights[2:-1:2] = 4.0, 2.0
    return shapes.curvature[..., 2] @ weights * (shapes.s[1] - shapes.s[0]) / 3.0 / (2.0 * math.pi)


# --- a run ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Run:
    """What came of a rig.

    Args:
        rig: what was run.
        motion: what was solved of it.
        clearance: of the cable to itself, m, (P,).
        twist, writhe: turns, (P,).
        seconds: wall time of the motion.
        cold: what a cold start at FAR finds.
    """

    rig: Rig
    motion: ho.Motion
    clearance: Array
    twist: Array
    writhe: Array
    seconds: float
    cold: str

    @property
    def shapes(self) -> Any:
        """The frames solved."""
        return self.motion.cables[CABLE]

    @property
    def came(self) -> Array:
        """The frames in which the end comes in, the twist being complete."""
        solved = np.arange(len(self.motion.motion))
        return solved[self.rig.angle[solved] >= self.rig.twist]

    @property
    def turns(self) -> Array:
        """Twist and writhe, (P,): what was turned in, unless the cable has pulled through itself."""
        return self.twist + self.writhe

    @property
    def slipped(self) -> int | None:
        """The first frame with other turns than were turned in."""
        off = np.flatnonzero(np.abs(self.turns - self.rig.angle[: len(self.turns)] / 360.0) > 0.5)
        return int(off[0]) if len(off) else None

    @property
    def touches(self) -> int | None:
        """The first frame in which the cable touches itself."""
        hit = np.flatnonzero(self.clearance < TOUCHING)
        return int(hit[0]) if len(hit) else None

    def place(self, frame: int | None) -> str:
        """Return where the end stands in a frame, in words."""
        if frame is None:
            return "-"
        turning = f" ({self.rig.angle[frame]:.0f} deg)" if self.rig.angle[frame] < self.rig.twist else ""
        return f"{self.rig.distance[frame]:.2f} L{turning}"


def run(reading: str, twist: float, coarser: int) -> Run:
    """Simulate one rig and measure its shapes."""
    wanted = rig(reading, twist, coarser)
    begin = time.perf_counter()
    motion = ho.simulate(wanted.problem, frames=wanted.frames, throw=False)
    seconds = time.perf_counter() - begin
    if not motion.cables:
        nothing = np.zeros(0)
        return Run(wanted, motion, nothing, nothing, nothing, seconds, "")
    shapes = motion.cables[CABLE]
    clearance = np.concatenate([pair.clearance for pair in ho.clearances(motion).pairs])
    turns = np.array([cable_writhe(shapes, frame) for frame in range(len(shapes.position))])
    found = Run(wanted, motion, clearance, cable_twist(shapes), turns, seconds, "")
    return dataclasses.replace(found, cold=cold_start(found))


def cold_start(found: Run) -> str:
    """Return what :func:`harness_opt.equilibrium` finds, with the turns asked for, where the run begins to come in."""
    wanted = found.rig
    turns = math.ceil(wanted.twist / 360.0 - 0.5)  # the rest, at most half a turn, is the clamp's own
    start = wanted.problem.cables[CABLE].start
    end = wanted.problem.ends(CABLE, [float(wanted.frames[np.flatnonzero(wanted.angle >= wanted.twist)[0]])])[0][1]
    end = dataclasses.replace(end, turns=turns)
    shape = ho.equilibrium(wanted.cable, start, end, wanted.problem.gravity, throw=False)
    if not shape.ok:
        return "no shape"
    if not shape.stable:
        return "unstable"
    single = dataclasses.replace(
        found.shapes.frames(slice(1)),
        **{key: getattr(shape, key)[None] for key in ("position", "quaternion", "curvature")},
    )
    linked = float(cable_twist(single)[0]) + cable_writhe(single, 0)
    if abs(linked - wanted.twist / 360.0) > 0.5:
        return f"{linked:+.2f} turns"
    if not len(found.came):
        return "a shape"
    there = found.shapes.position[found.came[0]]
    middle = 0.5 * (there[0] + there[-1])
    swapped = 2.0 * middle * (1, 1, 0) + there[::-1] * (-1, -1, 1)  # half a turn about the vertical, ends swapped
    apart = min(np.max(np.linalg.norm(shape.position - other, axis=1)) for other in (there, swapped))
    return "the same" if apart < SAME * wanted.cable.length else "another"
