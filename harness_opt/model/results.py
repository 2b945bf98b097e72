"""What a run gives back: frozen results of plain arrays. No solver, mesh or CasADi object is kept.

SI units, world coordinates unless said otherwise. P frames, N stations along the cable.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field

from harness_opt.errors import Status
from harness_opt.model.problem import Problem
from harness_opt.numerics.rotations import Array

STATIONS = 101  # equally spaced along the cable


@dataclass(frozen=True)
class Quantities:
    """What is known at stations along a cable; leading axes (...) count shapes, none for a single one.

    Args:
        s: arc lengths of the stations, m, (N,).
        position: (..., N, 3), m.
        quaternion: section frames, scalar first, (..., N, 4).
        curvature: Darboux vector in the section frame, 1/m, (..., N, 3).
        force, moment: internal, s+ side on s- side, world, N and N m, (..., N, 3).
    """

    s: Array
    position: Array
    quaternion: Array
    curvature: Array
    force: Array
    moment: Array


@dataclass(frozen=True)
class CableMotion(Quantities):
    """The shapes of one cable over the motion, as in ``motion.npz``; the quantities have the shape (P, N, ...).

    Args:
        stable: (P,), whether each shape is a stable equilibrium.
        stability_margin: (P,), lowest eigenvalue of the second variation, dimensionless; below 0 is unstable.
        residual: (P,), largest scaled residual of each frame.
        estimated_error: (P,), of the shape, in lengths of the cable.
    """

    stable: Array
    stability_margin: Array
    residual: Array
    estimated_error: Array

    def frames(self, which: slice) -> CableMotion:
        """Return the frames that ``which`` names alone."""
        cut = {f.name: getattr(self, f.name)[which] for f in dataclasses.fields(self) if f.name != "s"}
        return dataclasses.replace(self, **cut)


@dataclass(frozen=True)
class Followed:
    """One cable over the motion, as far as it could be followed.

    Args:
        shapes: of the frames solved; None where there are none.
        snaps: (frame, motion) of each jump.
        status, message: why it ended early; OK and empty otherwise.
    """

    shapes: CableMotion | None
    snaps: tuple[tuple[int, float], ...] = ()
    status: Status = Status.OK
    message: str = ""


@dataclass(frozen=True)
class Snap:
    """A jump of a cable to another shape: the frame that first shows the new shape, and its motion value (0 to 1)."""

    cable: str
    frame: int
    motion: float


@dataclass(frozen=True)
class LimitResult:
    """How one limit fared over the whole motion.

    Args:
        name: "clearance", "bend_radius", "twist", "clamp_force" or "clamp_moment".
        limit, worst: in SI units (twist in rad/m).
        margin: >= 0 holds; ``worst - limit`` for clearance and bend radius, ``limit - worst`` for the others.
        cable: its name.
        frame, motion, arc_length: where the worst stands; the nearest frame, where that is between two.
        part: name of the part, "cable:NAME" for another cable or for itself, or None.
        certified: True where no point between samples can be worse than ``worst`` by more than ``tolerance``.
        tolerance: in the unit of ``worst``.
        reason: why it is not certified, where it was tried.
    """

    name: str
    limit: float
    worst: float
    margin: float
    cable: str
    frame: int
    motion: float
    arc_length: float
    part: str | None
    certified: bool
    tolerance: float
    reason: str = ""


@dataclass(frozen=True)
class Motion:
    """A simulated motion: one shape a cable and frame.

    Args:
        problem: what was simulated.
        motion: (P,), 0 to 1, of the solved frames; shorter than asked only where ``status`` says so.
        cables: by name.
        status: OK, or why the motion ends early.
        message: for the user; empty where all is well.
        snaps: the jumps met on the way.
        left_out: what the scene did not need.
        timing: seconds by phase.
    """

    problem: Problem
    motion: Array
    cables: Mapping[str, CableMotion]
    status: Status = Status.OK
    message: str = ""
    snaps: tuple[Snap, ...] = ()
    left_out: tuple[str, ...] = ()
    timing: Mapping[str, float] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        """True where every frame was solved."""
        return self.status.ok
