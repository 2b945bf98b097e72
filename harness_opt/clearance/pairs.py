"""Clearances of a motion, pair by pair: what is asked, and what is found."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from harness_opt.clearance.solved_frames import Solve
from harness_opt.clearance.what_counts import arc_apart
from harness_opt.clearance.witnesses import Certificate, Witnesses
from harness_opt.model.limits import LimitId, LimitKind, Obstacle
from harness_opt.model.problem import Problem
from harness_opt.model.results import LimitResult, Snap
from harness_opt.model.spans import Span, has_clips, spans_of, whole
from harness_opt.numerics.rotations import Array
from harness_opt.parts.scene import Scene


@dataclass(frozen=True)
class Options:
    """How hard to look.

    Args:
        tolerance: to which the smallest clearance is wanted, m; None takes 1 % of the cable's diameter, and 5 % of
            the clearance of what stays more than ten diameters above ``reach``.
        reach: witnesses are kept up to this much above the limit, m; None takes the cable's diameter.
        most_queries: for the certificate of one pair; where they do not suffice, the tolerance reached is
            larger.
        stop: asked while the motion is searched; once True, what is left is not certified, and says so.
        give_up: asked before each pair; once True, those that are left are not measured, and that is said.
    """

    tolerance: float | None = None
    reach: float | None = None
    most_queries: int = 20_000
    stop: Callable[[], bool] | None = None
    give_up: Callable[[], bool] | None = None


@dataclass(frozen=True, eq=False)
class PairClearance:
    """One cable against one obstacle, in P frames.

    Args:
        cable: its name.
        obstacle: a part, another cable, or the cable itself.
        limit: m, or None.
        nearest: the smallest clearance of each frame, P witnesses in order; of a part far away in all of them, one
            close to it.
        witnesses: the local minima along the cable that lie less than ``reach`` above the limit, by frame; several
            at one place where it lies between walls, a normal for each.
        place: the one witness with the smallest clearance of all solved frames, those solved in between included;
            its frame is the nearest of the P.
        motion: where it stands, 0 to 1.
        lower_bound: no point of the cable has a smaller clearance, m: in the P frames, or through the whole motion
            where that was looked at.
        certified_along_arc: whether the P frames hold nothing worse than their smallest by more than was asked.
        certified: whether the whole motion holds nothing worse than :attr:`worst` by more than was asked.
        reason: why not, where it is not.
        excluded: lengths from start and end that do not count, m.
        at_clips: stretches at the clips of the cable that do not count, from and to, m.
        closed: False where the obstacle is a shell without an inside, so that a cable inside would go unseen.
    """

    cable: str
    obstacle: Obstacle
    limit: float | None
    nearest: Witnesses
    witnesses: Witnesses
    place: Witnesses
    motion: float
    lower_bound: float
    certified_along_arc: bool
    certified: bool
    reason: str
    excluded: tuple[float, float]
    closed: bool
    at_clips: tuple[tuple[float, float], ...] = ()

    @property
    def id(self) -> LimitId:
        """Which limit, if it has one."""
        return LimitId(LimitKind.CLEARANCE, self.cable, self.obstacle)

    @property
    def is_to_itself(self) -> bool:
        """Whether the obstacle is the cable itself."""
        return self.obstacle == Obstacle(self.cable, is_cable=True)

    @property
    def start(self) -> Certificate:
        """What the P frames alone say of the motion."""
        return Certificate(self.place, self.motion, self.lower_bound, self.reason)

    @property
    def clearance(self) -> Array:
        """The smallest clearance of each frame, (P,), m."""
        return self.nearest.clearance

    @property
    def frame(self) -> int:
        """The frame with the smallest clearance, or the nearest one to where that is."""
        return int(self.place.frame[0])

    @property
    def arc_length(self) -> float:
        """Where along the cable the smallest clearance is, m."""
        return float(self.place.arc_length[0])

    @property
    def worst(self) -> float:
        """The smallest clearance of all solved frames, m."""
        return float(self.place.clearance[0])

    @property
    def tolerance(self) -> float:
        """By how much, at most, what lies between can be worse than :attr:`worst`, m."""
        return self.worst - self.lower_bound if math.isfinite(self.worst) else 0.0


@dataclass(frozen=True, eq=False)
class ClearanceResult:
    """Clearances of all cables to all obstacles.

    Args:
        motion: (P,), 0 to 1, of the frames.
        pairs: one for each cable and obstacle.
        left_out: what was not measured and why, a sentence each.
        inserted: how many frames were solved between the others to be certain, by cable.
        cable_limits: the rows of bend radius, twist and clamp loads; None where the frames alone were looked at.
        whole: False where the run was stopped before all pairs were measured.
    """

    motion: Array
    pairs: tuple[PairClearance, ...]
    left_out: tuple[str, ...] = ()
    inserted: Mapping[str, int] = field(default_factory=dict)
    cable_limits: tuple[LimitResult, ...] | None = None
    whole: bool = True

    def __repr__(self) -> str:
        """Return one line."""
        nearest = min(self.pairs, key=lambda pair: pair.worst, default=None)
        told = "none" if nearest is None else f"{1e3 * nearest.worst:.3g} mm, {nearest.id.words}"
        return f"<Clearances: {len(self.pairs)} pairs in {len(self.motion)} frames; smallest {told}>"

    @property
    def limits(self) -> tuple[LimitResult, ...]:
        """One row for each pair that has a limit."""
        return tuple(
            LimitResult(
                id=pair.id,
                limit=pair.limit,
                worst=pair.worst,
                margin=pair.worst - pair.limit,
                frame=pair.frame,
                motion=pair.motion,
                arc_length=pair.arc_length,
                certified=pair.certified and pair.lower_bound > -math.inf,
                tolerance=pair.tolerance,
                reason=pair.reason,
            )
            for pair in self.pairs
            if pair.limit is not None
        )


@dataclass(frozen=True)
class Between:
    """What is needed to be certain between frames.

    Args:
        solve: finds shapes there.
        snaps: of the cables.
    """

    solve: Solve
    snaps: tuple[Snap, ...] = ()


def met_itself(pair: PairClearance, radius: float, motion: Array) -> PairClearance:
    """Return the pair of a cable with itself by where it meets itself: not by the chord of the arc that is left out.

    Between the places that count, those the least arc apart are near because the cable is one piece. Where nothing else
    is near, and they are no nearer than the limit, the cable never comes near itself.

    Args:
        pair: along the whole cable.
        radius: of the cable, m.
        motion: (P,) of the frames.
    """
    limit, gap = pair.limit or 0.0, arc_apart(radius, pair.limit) * (1 + 1e-6)  # 1e-6: rounding, far below a station
    if pair.place.other_arc_length[0] - pair.place.arc_length[0] > gap or pair.worst < limit:
        return pair
    met = pair.witnesses.take(pair.witnesses.other_arc_length - pair.witnesses.arc_length > gap)
    if not len(met.frame):
        far = replace(pair.place, clearance=np.array([math.inf]))
        bound = max(pair.lower_bound, limit) if pair.certified else pair.lower_bound
        return replace(pair, place=far, lower_bound=bound)
    place = met.take(np.array([int(np.argmin(met.clearance))]))
    return replace(pair, place=place, motion=float(motion[place.frame[0]]))


def of_whole_cables(problem: Problem, found: ClearanceResult) -> ClearanceResult:
    """Return the clearances of the spans of ``problem`` as those of its whole cables.

    A cable is as near as the nearest of its spans; two spans of one cable count as the cable with itself. What was
    measured of some spans only says nothing of the cable, and is left out.
    """
    if not has_clips(problem):
        return found
    spans = spans_of(problem)
    groups: dict[LimitId, list[PairClearance]] = {}
    for pair in found.pairs:
        groups.setdefault(whole(spans, pair.id), []).append(_along_whole(pair, spans))
    inserted: dict[str, int] = {}
    for name, count in found.inserted.items():
        inserted[spans[name].cable] = inserted.get(spans[name].cable, 0) + count
    rows = None if found.cable_limits is None else rows_of_whole_cables(spans, found.cable_limits)
    numbers = Counter(span.cable for span in spans.values())
    pairs = [_nearest_of(which, pairs) for which, pairs in groups.items() if len(pairs) == _pieces(which, numbers)]
    pairs = [
        met_itself(pair, problem.cables[pair.cable].cable.radius, found.motion) if pair.is_to_itself else pair
        for pair in pairs
    ]
    return replace(found, pairs=tuple(pairs), inserted=inserted, cable_limits=rows)


def _pieces(which: LimitId, spans: Mapping[str, int]) -> int:
    """Return how many pairs of spans are one pair of a whole cable; ``spans`` a cable."""
    own, obstacle = spans[which.cable], which.obstacle
    if obstacle is None or not obstacle.is_cable:
        return own
    return own * (own + 1) // 2 if obstacle.name == which.cable else own * spans[obstacle.name]


def _along_whole(pair: PairClearance, spans: Mapping[str, Span]) -> PairClearance:
    """Return the pair of a span with its arc lengths along the whole cable."""
    span, own = spans[pair.cable], spans[pair.cable].first
    other = spans[pair.obstacle.name].first if pair.obstacle.is_cable else 0.0

    def moved(w: Witnesses) -> Witnesses:
        return replace(w, arc_length=w.arc_length + own, other_arc_length=w.other_arc_length + other)

    stretches = ((own, own + pair.excluded[0]), (span.last - pair.excluded[1], span.last))
    return replace(
        pair,
        nearest=moved(pair.nearest),
        witnesses=moved(pair.witnesses),
        place=moved(pair.place),
        at_clips=tuple((first, last) for first, last in stretches if last > first),
    )


def _nearest_of(which: LimitId, pairs: Sequence[PairClearance]) -> PairClearance:
    """Return one pair of what several spans of a cable are to one obstacle."""
    worst = min(pairs, key=lambda pair: pair.worst)
    nearest = Witnesses.joined([pair.nearest for pair in pairs])
    frames = len(worst.nearest.frame)
    least = np.argmin(nearest.clearance.reshape(len(pairs), frames), axis=0)
    witnesses = Witnesses.joined([pair.witnesses for pair in pairs])
    return replace(
        worst,
        cable=which.cable,
        obstacle=which.obstacle or worst.obstacle,
        nearest=nearest.take(least * frames + np.arange(frames)),
        witnesses=witnesses.take(np.lexsort((witnesses.arc_length, witnesses.frame))),
        lower_bound=min(pair.lower_bound for pair in pairs),
        certified_along_arc=all(pair.certified_along_arc for pair in pairs),
        certified=all(pair.certified for pair in pairs),
        reason="; ".join(dict.fromkeys(pair.reason for pair in pairs if pair.reason)),
        excluded=(pairs[0].excluded[0], pairs[-1].excluded[1]),
        closed=all(pair.closed for pair in pairs),
        at_clips=tuple(stretch for pair in pairs for stretch in pair.at_clips),
    )


def rows_of_whole_cables(spans: Mapping[str, Span], rows: Iterable[LimitResult]) -> tuple[LimitResult, ...]:
    """Return the limits of whole cables from those of their ``spans``: each as bad as in the worst of these."""
    groups: dict[LimitId, list[LimitResult]] = {}
    for row in rows:
        span = spans[row.cable]
        at = span.last if row.id.clip is not None else span.first + row.arc_length
        which = whole(spans, row.id)
        groups.setdefault(which, []).append(replace(row, id=which, arc_length=at))
    return tuple(_worst_of(group) for group in groups.values())


def _worst_of(rows: Sequence[LimitResult]) -> LimitResult:
    """Return one row of a limit of several spans of a cable."""
    if len(rows) == 1:
        return rows[0]
    worst = min(rows, key=lambda row: row.margin)
    bound = min(row.margin - row.tolerance for row in rows)
    return replace(
        worst,
        certified=all(row.certified for row in rows),
        tolerance=worst.margin - bound,
        reason="; ".join(dict.fromkeys(row.reason for row in rows if row.reason)),
    )


def pairs_asked(problem: Problem, scene: Scene) -> int:
    """Return how many pairs of a cable and an obstacle are measured."""
    cables = len(problem.cables)
    others = 0 if problem.limits.clearance is None else cables * (cables + 1) // 2
    return cables * len(scene.parts) + others
