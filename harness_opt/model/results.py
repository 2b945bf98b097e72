"""What a run gives back: frozen results of plain arrays. No solver, mesh or CasADi object is kept.

SI units, world coordinates unless said otherwise. P frames, N stations along the cable.
"""

from __future__ import annotations

import dataclasses
import importlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from harness_opt.errors import Status
from harness_opt.model.limits import LimitId
from harness_opt.model.problem import Problem, held_as
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices

STATIONS = 101  # equally spaced along the cable; more where a shape turns sharply


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

    def at_frames(self, which: Indices) -> Quantities:
        """Return the shapes numbered ``which`` (k,)."""
        kept = {f.name: getattr(self, f.name)[which] for f in dataclasses.fields(Quantities) if f.name != "s"}
        return Quantities(s=self.s, **kept)


def cubic_errors(shapes: Quantities) -> Array:
    """Return the largest errors (N - 1,), m, of Hermite cubics through positions and tangents between stations.

    They stand at the middles of the intervals, and are estimated there against the quintics through positions,
    tangents and second derivatives ``r'' = R (omega x e3)``, which the curvatures give.
    """
    h = np.diff(shapes.s)[:, None]
    tangent = rotations.tangent(shapes.quaternion)
    across = np.stack([shapes.curvature[..., 1], -shapes.curvature[..., 0], np.zeros(shapes.curvature.shape[:-1])], -1)
    second = rotations.rotate(shapes.quaternion, across)
    difference = h / 32 * (tangent[..., :-1, :] - tangent[..., 1:, :])
    difference += h**2 / 64 * (second[..., :-1, :] + second[..., 1:, :])
    size = np.linalg.norm(difference, axis=-1)
    found: Array = size.reshape(-1, size.shape[-1]).max(axis=0, initial=0.0)
    return found


@dataclass(frozen=True)
class CableMotion(Quantities):
    """The shapes of one cable over the motion, as in ``motion.npz``; the quantities have the shape (P, N, ...).

    Args:
        stable: (P,), whether each shape is a stable equilibrium.
        stability_margin: (P,), lowest eigenvalue of the second variation, dimensionless; below 0 is unstable.
        residual: (P,), largest scaled residual of each frame.
        estimated_error: (P,), of the shape, in lengths of the cable.
        mesh: nodes of the elements that all frames were solved on, 0 to 1 along the cable, (n + 1,).
    """

    stable: Array
    stability_margin: Array
    residual: Array
    estimated_error: Array
    mesh: Array = field(default_factory=lambda: np.linspace(0.0, 1.0, 9))

    def frames(self, which: slice) -> CableMotion:
        """Return the frames that ``which`` names alone."""
        cut = {f.name: getattr(self, f.name)[which] for f in dataclasses.fields(self) if f.name not in ("s", "mesh")}
        return dataclasses.replace(self, **cut)


@dataclass(frozen=True)
class Followed:
    """One cable over the motion, as far as it could be followed.

    Args:
        shapes: of the frames solved; None where there are none.
        snaps: (frame, motion, whether the cable goes through itself) of each jump.
        status, message: why it ended early; OK and empty otherwise.
        begins_through_itself: whether no first shape was found with the turns that the clamps ask for: the cable would
            have to go through itself to have this one.
    """

    shapes: CableMotion | None
    snaps: tuple[tuple[int, float, bool], ...] = ()
    status: Status = Status.OK
    message: str = ""
    begins_through_itself: bool = False


@dataclass(frozen=True)
class Snap:
    """A jump of a cable to another shape.

    Args:
        cable: its name.
        frame: the one that first shows the new shape.
        motion: value, 0 to 1.
        passes_through_itself: whether the cable has other turns after it: it would have to go through itself.
    """

    cable: str
    frame: int
    motion: float
    passes_through_itself: bool = False


Holds = Literal["yes", "no", "uncertain"]


@dataclass(frozen=True)
class LimitResult:
    """How one limit fared over the whole motion.

    Args:
        id: which limit.
        limit, worst: in SI units (twist in rad/m); the worst is infinite where a cable never comes near itself.
        margin: >= 0 holds; ``worst - limit`` for clearance and bend radius, ``limit - worst`` for the others.
        frame, motion, arc_length: where the worst stands; the nearest frame, where that is between two.
        certified: True where no point between samples can be worse than ``worst`` by more than ``tolerance``.
        tolerance: in the unit of ``worst``.
        reason: why it is not certified, where it was tried.
    """

    id: LimitId
    limit: float
    worst: float
    margin: float
    frame: int
    motion: float
    arc_length: float
    certified: bool
    tolerance: float
    reason: str = ""

    @property
    def name(self) -> str:
        """The kind of limit: "clearance", "bend_radius", "twist", "clamp_force" or "clamp_moment"."""
        return str(self.id.kind.value)

    @property
    def cable(self) -> str:
        """Name of the cable."""
        return self.id.cable

    @property
    def part(self) -> str | None:
        """What a clearance is measured to: name of the part, "cable:NAME" of a cable; None for other limits."""
        return None if self.id.obstacle is None else self.id.obstacle.key

    @property
    def holds(self) -> Holds:
        """Whether the limit holds: "no" where any point found violates it, "yes" where that is certain."""
        if self.margin < 0:
            return "no"
        return "yes" if self.certified and self.margin >= self.tolerance else "uncertain"

    def scale(self, radius: float) -> float:
        """Return what the margin is divided by to be comparable with others, SI; ``radius`` of the cable, m."""
        return self.id.kind.scale(self.limit, radius)


def notebook_html(result: object) -> str:
    """Return a result as a notebook shows it: the work of a floor above, which is asked for by name."""
    room = importlib.import_module("harness_opt.report.html_page")
    return str(room.for_notebook(result))


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
        begun_through_themselves: cables whose first shape lacks turns that their clamps ask for: they would have to go
            through themselves to have it.
        left_out: what the scene did not need.
        timing: seconds by phase.
    """

    problem: Problem
    motion: Array
    cables: Mapping[str, CableMotion]
    status: Status = Status.OK
    message: str = ""
    snaps: tuple[Snap, ...] = ()
    begun_through_themselves: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    timing: Mapping[str, float] = field(default_factory=dict)

    def __repr__(self) -> str:
        """Return one line."""
        told = "solved" if self.ok else self.status.value
        snaps = f", {len(self.snaps)} snaps" if self.snaps else ""
        return f"<Motion: {len(self.motion)} frames of {', '.join(self.problem.cables)}{snaps}; {told}>"

    def _repr_html_(self) -> str:
        """Return what a notebook shows: the verdict, the limits, a small picture."""
        return notebook_html(self)

    @property
    def ok(self) -> bool:
        """True where every frame was solved."""
        return self.status.ok

    @property
    def through_themselves(self) -> dict[str, tuple[int, float]]:
        """The cables that lose turns by going through themselves, as none can: the first frame, and its motion value.

        At the start, or across a snap: twist and writhe together are not what the clamps say from there on.
        """
        found = {}
        for name in self.cables:
            places = [
                (snap.frame, snap.motion) for snap in self.snaps if snap.cable == name and snap.passes_through_itself
            ]
            if name in self.begun_through_themselves and len(self.motion):
                places.append((0, float(self.motion[0])))
            if places:
                found[name] = min(places)
        return found

    def held(self, cable: str) -> Problem:
        """Return the problem with the rolls at which ``cable`` was clamped, as its shapes have them."""
        return held_as(self.problem, cable, float(self.motion[0]), list(self.cables[cable].quaternion[0, [0, -1]]))
