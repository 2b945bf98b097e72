"""The paper's display, section 4.2: the shapes at the moments of the playback, between those that were solved.

The clamp takes many temporal steps for one spatial step, so most moments have no profile of their own. Two
interpolations between the profiles j and j + 1 of the neighbouring path points, w the part of the way:

- "linear", the paper's eq. (29): every node goes straight from place to place. The cable is shortened on the way, and
  clamps that turn are missed. The paper turns no frames; here they take the shortest way.
- "exact": the cable keeps its length and its clamps. The shape is cut at its stations, and the pose of each station as
  seen from the one before is exp(Omega) on SE(3), Omega the integral of (omega, e3) over the piece up to commutators
  (Magnus; Iserles, Munthe-Kaas, Norsett, Zanna, "Lie-group methods", Acta Numerica 9 (2000), section 4). Omega is
  blended, (1 - w) Omega_j + w Omega_{j+1}: that is the blend of the curvatures, and at w = 0 and 1 the solved shape to
  rounding, however few the stations. The curve starts at the clamp's own pose of the moment. What is missing at its
  other end is made up by the change of curvature that costs least elastic energy to first order,

      K delta omega(s) = R(s)^T (mu + (r_end - r(s)) x phi),

  the moment mu and force phi at the end from Newton's method. Only what the ends are given is met. A start that is free
  to move or to turn is interpolated between the frames first, and moves and turns as far as that saves bending.

Across a snap there is nothing between the two shapes: the older one is shown until the frame that shows the new.
Both are of second order in the spatial step. Dimensionless inside: lengths in those of the cable.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from harness_opt.errors import ProblemError, SolveError, Status
from harness_opt.model import checks
from harness_opt.model.ends import End
from harness_opt.model.results import CableMotion, Motion, split
from harness_opt.model.spans import spans_of
from harness_opt.motion.paper_data import Profile, solved
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array

Interpolation = Literal["exact", "linear"]
INTERPOLATIONS: tuple[Interpolation, ...] = get_args(Interpolation)
AT_FRAME = 1e-12  # motion values this close are one: t / duration, rounded
MOST_MOMENTS = 20_000
MOST_MISSED = 1e-12  # what may be missing at the end clamp, in lengths of the cable and rad
E3 = np.array([0.0, 0.0, 1.0])


def display(
    motion: Motion, cable: str, temporal_step: float, interpolation: Interpolation = "exact"
) -> tuple[Array, tuple[Profile, ...]]:
    """Return the moments of a playback (T,), s, and the profile that is shown at each.

    The moments run from 0 to the problem's duration, both included; of a motion solved in part, over the frames it has.
    At a frame the profile is that frame's, between two it is interpolated: eq. (29), or as the module says of "exact".
    Across a snap that is the older shape's, still ("linear") or on its clamps ("exact"), until the frame of the snap.

    Args:
        motion: simulated.
        cable: name.
        temporal_step: between two moments, s; the last is shorter where the duration is no multiple.
        interpolation: "exact" keeps the cable's length and its clamps, "linear" is as published.

    Raises:
        ProblemError: no such cable or interpolation; a step that is not above 0, longer than the duration, or so short
            that there are more than MOST_MOMENTS.
        SolveError: "exact" can't join the clamps from a neighbouring shape: the spatial step is too long.
    """
    solved(motion, cable)
    duration = motion.problem.duration
    values = moments(motion, temporal_step) / duration
    position, rotation = between(motion, cable, values, interpolation)
    return values * duration, tuple(map(Profile, position, rotation))


def moments(motion: Motion, temporal_step: float) -> Array:
    """Return the times (T,), s, of a playback of ``motion``; arguments and raises as in :func:`display`."""
    duration = motion.problem.duration
    step = checks.positive("temporal_step", temporal_step)
    if step > duration:
        raise ProblemError(f"temporal_step: found {step:g} s, expected at most {duration:g} s, the motion's duration")
    if duration / step > MOST_MOMENTS:
        raise ProblemError(
            f"temporal_step: found {step:g} s, which asks for {duration / step:.0f} moments, "
            f"expected at most {MOST_MOMENTS}"
        )
    first, last = duration * motion.motion[0], duration * motion.motion[-1]
    times = step * np.arange(int(duration / step) + 1)
    slack = AT_FRAME * duration
    inside = times[(times > first + slack) & (times < last - slack)]
    return np.array([first, *inside, last] if last > first else [first])


def between(motion: Motion, cable: str, values: Array, interpolation: str) -> tuple[Array, Array]:
    """Return positions (T, N, 3), m, and rotation matrices (T, N, 3, 3) between the frames.

    Args:
        motion: simulated.
        cable: name.
        values: motion values (T,), from that of the first frame to that of the last.
        interpolation: as in :func:`display`.

    Raises:
        ProblemError, SolveError: as :func:`display`.
    """
    moments_at_once = 256  # moments computed together, so that long playbacks need no more memory than their profiles
    if interpolation not in INTERPOLATIONS:
        expected = " or ".join(map(repr, INTERPOLATIONS))
        raise ProblemError(f"interpolation: found {interpolation!r}, expected {expected}")
    solved(motion, cable)
    if motion.problem.cables[cable].clips:
        apart = split(motion)
        own = [span.name for span in spans_of(motion.problem).values() if span.cable == cable]
        pieces = [between(apart, name, values, interpolation) for name in own]
        position, rotation = (np.concatenate(several, axis=1) for several in zip(*pieces, strict=True))
        return position, rotation
    lead = motion.cables[cable]
    blocks = []
    for first in range(0, len(values), moments_at_once):
        block = values[first : first + moments_at_once]
        here = _place(motion, cable, block)
        if interpolation == "linear":
            position, rotation = _linear(lead, here)
        else:
            position, rotation = _exact(motion, cable, block, here)
        frames = here.before[here.at_frame]
        position[here.at_frame] = lead.position[frames]
        rotation[here.at_frame] = rotations.matrix(lead.quaternion[frames])
        blocks.append((position, rotation))
    return np.concatenate([p for p, _ in blocks]), np.concatenate([a for _, a in blocks])


@dataclass(frozen=True)
class _Place:
    """Where moments stand among the frames.

    Args:
        before, after: neighbouring frames, (T,).
        weight: of the one after, (T,); 0 across a snap.
        at_frame: whether the one before is the moment's own, (T,).
    """

    before: NDArray[np.intp]
    after: NDArray[np.intp]
    weight: Array
    at_frame: NDArray[np.bool_]


def _place(motion: Motion, cable: str, values: Array) -> _Place:
    frames = motion.motion
    before = np.clip(np.searchsorted(frames, values + AT_FRAME, side="right") - 1, 0, len(frames) - 1)
    after = np.minimum(before + 1, len(frames) - 1)
    way = values - frames[before]
    weight = np.where(after > before, way / np.where(after > before, frames[after] - frames[before], 1.0), 0.0)
    snapped = np.isin(after, [snap.frame for snap in motion.snaps if snap.cable == cable])
    return _Place(before, after, np.where(snapped, 0.0, weight), np.abs(way) <= AT_FRAME)


def _linear(lead: CableMotion, here: _Place) -> tuple[Array, Array]:
    """Interpolate the nodes as published, eq. (29), and the frames the shortest way."""
    w = here.weight[:, None, None]
    position = (1.0 - w) * lead.position[here.before] + w * lead.position[here.after]
    return position, rotations.matrix(_shortest(lead.quaternion[here.before], lead.quaternion[here.after], w))


def _shortest(a: Array, b: Array, weight: Array) -> Array:
    """Return the quaternions (..., 4) at ``weight`` (..., 1) of the shortest way from ``a`` to ``b``."""
    return rotations.slerp(a, np.copysign(1.0, np.sum(a * b, axis=-1, keepdims=True)) * b, weight)


# --- "exact": blended curvatures, closed ------------------------------------------------------------------------


def _exact(motion: Motion, cable: str, values: Array, here: _Place) -> tuple[Array, Array]:
    """Blend the pieces of the neighbouring shapes, put them together from the start on, and close them at the end."""
    lead, run = solved(motion, cable), motion.problem.cables[cable]
    length = float(lead.s[-1])
    w = here.weight[:, None]
    base = lead.position[here.before, :1]  # far from the world's origin no digits are lost
    before, after = ((lead.quaternion[k], (lead.position[k] - base) / length) for k in (here.before, here.after))
    turn, shift = (
        (1.0 - w[..., None]) * a + w[..., None] * b for a, b in zip(_pieces(*before), _pieces(*after), strict=True)
    )
    ends = motion.held(cable).ends(cable, values)
    blends = [rotations.slerp(before[0][:, node], after[0][:, node], w) for node in (0, -1)]
    origin, frame = _given([start for start, _ in ends], base[:, 0], length, blends[0])
    goal, goal_frame = _given([end for _, end in ends], base[:, 0], length, blends[1])
    clamps = _Clamps(origin is None, frame is None, goal, goal_frame)
    if origin is None:
        origin = w * after[1][:, 0]  # from that of the frame before, which is 0
    if frame is None:
        frame = rotations.matrix(_shortest(before[0][:, 0], after[0][:, 0], w))
    curve = _Curve(origin, frame, turn, shift, np.diff(lead.s) / length)
    r, a, missing = _closed(curve, clamps, run.cable.stiffness)
    if not np.all(missing <= MOST_MISSED):
        k = int(np.argmin(missing <= MOST_MISSED))
        where = motion.problem.moments.words(float(values[k]))
        raise SolveError(
            f"cable {cable}, at {where}: no curve between frames {here.before[k]} and {here.after[k]} was "
            "found that meets the clamps; try a smaller motion.spatial_step, or the linear interpolation",
            Status.STALLED,
        )
    return base + length * r, a


def _given(ends: list[End], base: Array, length: float, blend: Array) -> tuple[Array | None, Array | None]:
    """Return positions (T, 3), from ``base`` and in ``length``, and frames (T, 3, 3) of ``ends``, None where free.

    A swivel has the roll of the blended frames (T, 4).
    """
    position = None if ends[0].position is None else (np.array([end.position for end in ends]) - base) / length
    if ends[0].quaternion is None:
        return position, None
    q = np.array([end.quaternion for end in ends])
    if ends[0].swivel:
        q = rotations.multiply(rotations.shortest_arc(rotations.tangent(blend), rotations.tangent(q)), blend)
    return position, rotations.matrix(q)


def _coefficients(turn: Array) -> tuple[Array, Array, Array]:
    """Return (1 - cos t) / t^2, (t - sin t) / t^3 and (1 - t/2 cot t/2) / t^2, (..., 1), t the angle of ``turn``.

    Where cancellation costs their digits, what they multiply is as small: the poses lose none.
    """
    small_angle = 1e-6  # rad, below which the coefficients of a rotation are those of none to rounding
    angle = np.linalg.norm(turn, axis=-1, keepdims=True)
    t = np.maximum(angle, small_angle)
    cotangent = (1.0 - 0.5 * t / np.tan(0.5 * t)) / t**2
    return 0.5 * np.sinc(0.5 * angle / np.pi) ** 2, (t - np.sin(t)) / t**3, cotangent


def _pieces(quaternion: Array, position: Array) -> tuple[Array, Array]:
    """Return the logarithms on SE(3) of each station's pose as seen from the one before.

    Args:
        quaternion, position: (..., N, 4) and (..., N, 3).

    Returns rotation vectors and shifts, (..., N - 1, 3): integrals of omega and e3 over the piece, up to commutators.
    """
    turn = rotations.small_rotation_vector(
        rotations.multiply(rotations.conjugate(quaternion[..., :-1, :]), quaternion[..., 1:, :])
    )
    chord = rotations.rotate(rotations.conjugate(quaternion[..., :-1, :]), np.diff(position, axis=-2))
    across = rotations.cross(turn, chord)
    return turn, chord - 0.5 * across + _coefficients(turn)[2] * rotations.cross(turn, across)


@dataclass(frozen=True)
class _Curve:
    """Curves as pieces put together.

    Args:
        origin, frame: of the start, (T, 3) and (T, 3, 3).
        turn, shift: of the pieces, as :func:`_pieces` returns them, (T, N - 1, 3).
        steps: lengths of the pieces, (N - 1,).
    """

    origin: Array
    frame: Array
    turn: Array
    shift: Array
    steps: Array

    def nodes(self) -> tuple[Array, Array]:
        """Return positions (T, N, 3) and frames (T, N, 3, 3) of the nodes."""
        shape = (len(self.turn), len(self.steps) + 1)
        pieces = rotations.matrix(rotations.from_rotation_vector(self.turn))
        a, r = np.empty((*shape, 3, 3)), np.empty((*shape, 3))
        a[:, 0], r[:, 0] = self.frame, self.origin
        for k in range(len(self.steps)):
            np.matmul(a[:, k], pieces[:, k], out=a[:, k + 1])
        bend, wind, _ = _coefficients(self.turn)
        across = rotations.cross(self.turn, self.shift)
        chord = self.shift + bend * across + wind * rotations.cross(self.turn, across)
        r[:, 1:] = np.einsum("tnij,tnj->tni", a[:, :-1], chord)
        return np.cumsum(r, axis=1), a

    def bent(self, change: Array) -> _Curve:
        """Return the curves with ``change`` (T, N, 3) added to their curvature at the nodes."""
        turn = self.turn + 0.5 * self.steps[:, None] * (change[:, 1:] + change[:, :-1])
        # the commutator of (0, e3) with a curvature that varies along the piece
        shift = self.shift + self.steps[:, None] ** 2 / 12.0 * rotations.cross(E3, np.diff(change, axis=1))
        return dataclasses.replace(self, turn=turn, shift=shift)

    def moved(self, slide: Array, turn: Array) -> _Curve:
        """Return the curves with their start moved by ``slide`` and turned by ``turn``, section frame, (T, 3)."""
        turned = self.frame @ rotations.matrix(rotations.from_rotation_vector(turn))
        return dataclasses.replace(self, origin=self.origin + slide, frame=turned)


@dataclass(frozen=True)
class _Clamps:
    """What curves have to meet.

    Args:
        slides, turns: whether the start's position and its orientation are free.
        goal, goal_frame: position (T, 3) and frame (T, 3, 3) of the end, None where free.
    """

    slides: bool
    turns: bool
    goal: Array | None
    goal_frame: Array | None

    def gap(self, r: Array, a: Array) -> Array:
        """Return what the end of a curve is missing, (T, m): rotation vector (its sine), position; m = 0, 3 or 6."""
        missing = [np.zeros((len(r), 0))]
        if self.goal_frame is not None:
            # half the sum of d x d_goal over the three directors is the axis times the sine of the angle
            here, there = np.swapaxes(a[:, -1], 1, 2), np.swapaxes(self.goal_frame, 1, 2)
            missing.append(0.5 * np.sum(rotations.cross(here, there), axis=1))
        if self.goal is not None:
            missing.append(self.goal - r[:, -1])
        return np.concatenate(missing, axis=1)

    def loads(self, r: Array, a: Array) -> tuple[Array, Array]:
        """Return what unit loads on the end, one for each number of the gap, cause inside.

        Returns the moments, section frame, (T, N, 3, m), and the force, (3, m), which is the same all along.
        """
        to_section = np.swapaxes(a, -1, -2)
        moments, forces = [], []
        if self.goal_frame is not None:
            moments.append(to_section)
            forces.append(np.zeros((3, 3)))
        if self.goal is not None:
            x, y, z = np.moveaxis(r[:, -1:] - r, -1, 0)
            zero = np.zeros_like(x)
            lever_cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(a.shape)
            moments.append(to_section @ lever_cross)
            forces.append(np.eye(3))
        return np.concatenate(moments, axis=-1), np.concatenate(forces, axis=-1)


def _closed(curve: _Curve, clamps: _Clamps, stiffness: Array) -> tuple[Array, Array, Array]:
    """Return positions, frames and what is missing at the end, (T,), of curves bent and placed to meet the clamps.

    The bending that costs least energy is that by loads on the end. By virtual work their effect on its pose is the
    Gram matrix of the moments they cause, weighted by the compliance; and they are such that no force and no moment is
    left at the start where it is free to move.
    """
    rank_tolerance = 1e-13  # eigenvalue, in the largest, below which a straight cable can't move its end that way
    most_steps = 30  # of Newton's method; two to four are usual
    compliance = (stiffness.max() / stiffness)[:, None]
    weights = 0.5 * (np.append(curve.steps, 0.0) + np.append(0.0, curve.steps))[:, None, None]
    for _ in range(most_steps):
        r, a = curve.nodes()
        gap = clamps.gap(r, a)
        missing = np.max(np.abs(gap), axis=1, initial=0.0)
        if np.all(missing <= MOST_MISSED) or not np.all(np.isfinite(missing)):
            break
        moments, force = clamps.loads(r, a)
        count = gap.shape[1]
        rows = (moments * np.sqrt(compliance * weights)).reshape(len(r), -1, count)
        free = np.concatenate(
            [clamps.slides * np.broadcast_to(force, moments[:, 0].shape), clamps.turns * moments[:, 0]], 1
        )
        system = np.zeros((len(r), count + 6, count + 6))
        system[:, :count, :count] = np.swapaxes(rows, 1, 2) @ rows
        system[:, count:, :count] = free
        system[:, :count, count:] = np.swapaxes(free, 1, 2)
        answer = np.linalg.pinv(system, rcond=rank_tolerance, hermitian=True)[:, :, :count] @ gap[..., None]
        change = compliance * (moments @ answer[:, None, :count])
        curve = curve.bent(change[..., 0]).moved(answer[:, count:-3, 0], answer[:, -3:, 0])
    return r, a, missing
