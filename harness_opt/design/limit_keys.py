"""The keys of a problem file that set limits and bounds: which limits each sets, and the problem with another value."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from harness_opt.model.limits import CABLE_KINDS, CLIP_LOADS, LimitId, LimitKind, Obstacle, quoted
from harness_opt.model.problem import Problem


@dataclass(frozen=True)
class LimitKey:
    """One number of a problem that limits are held against.

    Args:
        kind: of the limits.
        part: whose own clearance limit it is; None for ``[limits]``.
        cable: whose own bend radius it is; None for ``[limits]``.
        limit: its value, SI.
        sets: the limits that it sets.
    """

    kind: LimitKind
    part: str | None
    limit: float
    sets: frozenset[LimitId]
    cable: str | None = None

    @property
    def general(self) -> bool:
        """Whether it is one of ``[limits]``."""
        return self.part is None and self.cable is None

    @property
    def name(self) -> str:
        """The key in the problem file."""
        if self.cable is not None:
            return f"cables.{quoted(self.cable)}.{self.kind.key}"
        return f"limits.{self.kind.key}" if self.part is None else f"parts.{quoted(self.part)}.{self.kind.key}"

    def value(self, shortfall: float, scale: float) -> float:
        """Return what it has to be for limits to hold that are violated by ``shortfall``, scaled.

        Args:
            shortfall: >= 0, as the margins of :mod:`harness_opt.design.margins`.
            scale: of those margins, SI.
        """
        if self.kind is LimitKind.BEND_RADIUS:  # scaled margins of curvatures
            return self.limit / (1.0 + shortfall)
        return self.limit - shortfall * scale if self.kind is LimitKind.CLEARANCE else self.limit * (1.0 + shortfall)

    def replaced(self, problem: Problem, value: float) -> Problem:
        """Return ``problem`` with ``value`` in its place."""
        if self.cable is not None:
            run = dataclasses.replace(problem.cables[self.cable], bend_radius=value)
            return dataclasses.replace(problem, cables={**problem.cables, self.cable: run})
        if self.part is None:
            return dataclasses.replace(problem, limits=dataclasses.replace(problem.limits, **{self.kind.value: value}))
        part = dataclasses.replace(problem.parts[self.part], clearance=value)
        return dataclasses.replace(problem, parts={**problem.parts, self.part: part})


def limit_keys(problem: Problem) -> tuple[LimitKey, ...]:
    """Return the keys of all limits of ``problem``; a part without a limit of its own can be given one."""
    found, limits = [], problem.limits
    bend = LimitKind.BEND_RADIUS
    own_bends = {cable: run.bend_radius for cable, run in problem.cables.items() if run.bend_radius is not None}
    found += [
        LimitKey(bend, None, limit, frozenset({LimitId(bend, cable)}), cable) for cable, limit in own_bends.items()
    ]
    for kind in CABLE_KINDS:
        limit = getattr(limits, kind.value)
        held = [cable for cable in problem.cables if kind is not bend or cable not in own_bends]
        if limit is not None and held:
            found.append(LimitKey(kind, None, limit, frozenset(LimitId(kind, cable) for cable in held)))
    clips = [(cable, clip) for cable, run in problem.cables.items() for clip in run.clips]
    for kind in (*CLIP_LOADS, LimitKind.TRAVEL):
        limit = getattr(limits, kind.value)
        at = [(cable, clip.name) for cable, clip in clips if clip.slides or kind is not LimitKind.TRAVEL]
        if limit is not None and at:
            own = frozenset(LimitId(kind, cable, clip=name) for cable, name in at)
            found.append(LimitKey(kind, None, limit, own))
    clearance = LimitKind.CLEARANCE
    shared = {LimitId(clearance, a, Obstacle(b, is_cable=True)) for a in problem.cables for b in problem.cables}
    for part, solid in problem.parts.items():
        limit = problem.clearance_limit(part)
        if limit is not None:
            own = frozenset(LimitId(clearance, cable, Obstacle(part)) for cable in problem.cables)
            found.append(LimitKey(clearance, part, limit, own))
            shared |= own if solid.clearance is None else set()
    if limits.clearance is not None:
        found.append(LimitKey(clearance, None, limits.clearance, frozenset(shared)))
    return tuple(found)


def is_between_cables(limit: LimitId | None) -> bool:
    """Return whether ``limit`` is the clearance of a cable to a cable: those have no limits of their own."""
    return limit is not None and limit.obstacle is not None and limit.obstacle.is_cable
