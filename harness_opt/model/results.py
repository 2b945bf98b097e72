"""What a run gives back: frozen results of plain arrays. No solver, mesh or CasADi object is kept.

SI units, world coordinates unless said otherwise. P frames, N stations along the cable.
"""

from __future__ import annotations

import dataclasses
import importlib
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from harness_opt.errors import Status
from harness_opt.model.limits import LimitId
from harness_opt.model.problem import Problem, held_as, left_out
from harness_opt.model.spans import Span, carried, has_clips, in_spans, spans_of
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.numerics.vectors import Indices

ALONG = ("position", "quaternion", "curvature", "force", "moment")  # what is known at stations
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

    @property
    def clip_stations(self) -> list[int]:
        """The first of the two stations at each clip, along the cable."""
        found: list[int] = np.flatnonzero(np.diff(self.s) == 0.0).tolist()
        return found

    @property
    def line(self) -> CableMotion:
        """The shapes with one station at each clip: as a line has them, for drawing."""
        once = np.delete(np.arange(len(self.s)), self.clip_stations)
        along = {name: getattr(self, name)[:, once] for name in ALONG}
        return dataclasses.replace(self, s=self.s[once], **along)

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
        span: name of the span that jumps, where cables have clips; else empty.
    """

    cable: str
    frame: int
    motion: float
    passes_through_itself: bool = False
    span: str = ""


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


# --- whole cables and their spans -----------------------------------------------------------------------------------
#
# Along a whole cable every clip has two stations at one arc length, the last of the span before it and the first of the
# span behind it: force and moment jump there by what the clip applies.


def split(motion: Motion) -> Motion:
    """Return a motion of whole cables as that of their spans; itself where no cable has clips."""
    if not has_clips(motion.problem):
        return motion
    spans, problem, cables = spans_of(motion.problem), in_spans(motion.problem), {}
    for cable, shapes in motion.cables.items():
        own = [span for span in spans.values() if span.cable == cable]
        lengths = [problem.cables[span.name].cable.length for span in own]
        for span, piece in zip(own, _pieces(shapes, own, lengths), strict=True):
            cables[span.name] = piece
            if len(motion.motion):
                problem = carried(problem, spans, span.name, float(motion.motion[0]), piece.quaternion[0, -1])
    snaps = [dataclasses.replace(snap, cable=snap.span or snap.cable) for snap in motion.snaps]
    through = [span.name for span in spans.values() if span.cable in motion.begun_through_themselves]
    return dataclasses.replace(
        motion, problem=problem, cables=cables, snaps=tuple(snaps), begun_through_themselves=tuple(through)
    )


def joined(problem: Problem, motion: Motion) -> Motion:
    """Return the motion of the spans of ``problem`` as that of its whole cables; itself where no cable has clips.

    A cable of which a span was not solved at all is left out, as one that was not solved is; where none is left, no
    frame is.
    """
    if not has_clips(problem):
        return motion
    problem = problem.changed(found=motion.problem.found)
    spans, cables = spans_of(problem), {}
    for cable in problem.cables:
        own = [span for span in spans.values() if span.cable == cable]
        if all(span.name in motion.cables for span in own):
            cables[cable] = _whole([motion.cables[span.name] for span in own], own)
    snaps = [dataclasses.replace(snap, cable=spans[snap.cable].cable, span=snap.cable) for snap in motion.snaps]
    through = dict.fromkeys(spans[name].cable for name in motion.begun_through_themselves)
    return dataclasses.replace(
        motion,
        problem=problem,
        motion=motion.motion if cables else motion.motion[:0],
        cables=cables,
        snaps=tuple(snap for snap in snaps if snap.cable in cables),
        begun_through_themselves=tuple(through),
        left_out=left_out(problem),
    )


def _whole(pieces: Sequence[CableMotion], spans: Sequence[Span]) -> CableMotion:
    """Return the shapes of a whole cable from those of its spans."""
    if len(pieces) == 1:
        return pieces[0]
    length = spans[-1].last
    along = {name: np.concatenate([getattr(piece, name) for piece in pieces], axis=1) for name in ALONG}
    places = []  # a span that slides is counted along as it is drawn
    for span, piece in zip(spans, pieces, strict=True):
        counted = (span.last - span.first) / piece.s[-1]
        places.append(np.append(span.first + counted * piece.s[:-1], span.last))
    meshes = [span.first + piece.mesh * (span.last - span.first) for span, piece in zip(spans, pieces, strict=True)]
    errors = [piece.estimated_error * piece.s[-1] / length for piece in pieces]  # theirs are in lengths of the span
    return CableMotion(
        s=np.concatenate(places),
        **along,
        stable=np.all([piece.stable for piece in pieces], axis=0),
        stability_margin=np.min([piece.stability_margin for piece in pieces], axis=0),
        residual=np.max([piece.residual for piece in pieces], axis=0),
        estimated_error=np.max(errors, axis=0),
        mesh=np.concatenate(meshes) / length,
    )


def _pieces(shapes: CableMotion, spans: Sequence[Span], lengths: Sequence[float]) -> list[CableMotion]:
    """Return the shapes of the spans of a cable, ``lengths`` long, m, from the whole; what is known of all holds."""
    if len(spans) == 1:
        return [shapes]
    length, found = spans[-1].last, []
    stations, nodes = _cuts(shapes.s), _cuts(shapes.mesh)
    for span, counted, own, mesh in zip(spans, lengths, stations, nodes, strict=True):
        long = span.last - span.first
        along = {name: getattr(shapes, name)[:, own] for name in ALONG}
        s = np.concatenate([[0.0], counted / long * (shapes.s[own][1:-1] - span.first), [counted]])
        inner = (shapes.mesh[mesh][1:-1] * length - span.first) / long
        found.append(
            dataclasses.replace(
                shapes,
                s=s,
                **along,
                estimated_error=shapes.estimated_error * length / counted,
                mesh=np.concatenate([[0.0], inner, [1.0]]),
            )
        )
    return found


def _cuts(places: Array) -> list[slice]:
    """Return the stretches between two equal neighbours in increasing ``places`` (n,)."""
    ends = [0, *(np.flatnonzero(np.diff(places) == 0.0) + 1).tolist(), len(places)]
    return [slice(a, b) for a, b in itertools.pairwise(ends)]


def at_clip(before: Quantities, behind: Quantities) -> Quantities:
    """Return the two stations at a clip, with what it applies to the cable as their force, N, and moment, N m, world.

    It is what force and moment inside the cable lose there: the span behind pulls on the one before, and the clip makes
    up the difference.

    Args:
        before, behind: the spans that meet at the clip.
    """
    ends = {
        name: np.stack([getattr(before, name)[..., -1, :], getattr(behind, name)[..., 0, :]], axis=-2)
        for name in ("position", "quaternion", "curvature")
    }
    loads = {
        name: np.repeat(getattr(before, name)[..., -1:, :] - getattr(behind, name)[..., :1, :], 2, axis=-2)
        for name in ("force", "moment")
    }
    return Quantities(s=np.zeros(2), **ends, **loads)
