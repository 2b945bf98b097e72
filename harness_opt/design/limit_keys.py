"""The keys of a problem file that set limits and bounds: which limits each sets, and the problem with another value."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from harness_opt.clearance.limits import limit_label
from harness_opt.model.problem import Problem

KINDS = ("bend_radius", "twist", "clamp_force", "clamp_moment")  # limits of cables alone


@dataclass(frozen=True)
class LimitKey:
    """One number of a problem that limits are held against.

    Args:
        kind: as in :class:`harness_opt.model.results.LimitResult`.
        part: whose own clearance limit it is; None for ``[limits]``.
        limit: its value, SI.
        labels: of the limits that it sets, as :func:`harness_opt.clearance.limits.limit_label` has them.
    """

    kind: str
    part: str | None
    limit: float
    labels: frozenset[str]

    @property
    def name(self) -> str:
        """The key in the problem file, without its unit's ending."""
        return f"limits.{self.kind}" if self.part is None else f"parts.{self.part}.{self.kind}"

    def value(self, shortfall: float, scale: float) -> float:
        """Return what it has to be for limits to hold that are violated by ``shortfall``, scaled.

        Args:
            shortfall: >= 0, as the margins of :mod:`harness_opt.design.margins`.
            scale: of those margins, SI.
        """
        if self.kind == "bend_radius":  # scaled margins of curvatures
            return self.limit / (1.0 + shortfall)
        return self.limit - shortfall * scale if self.kind == "clearance" else self.limit * (1.0 + shortfall)

    def replaced(self, problem: Problem, value: float) -> Problem:
        """Return ``problem`` with ``value`` in its place."""
        if self.part is None:
            return dataclasses.replace(problem, limits=dataclasses.replace(problem.limits, **{self.kind: value}))
        part = dataclasses.replace(problem.parts[self.part], clearance=value)
        return dataclasses.replace(problem, parts={**problem.parts, self.part: part})


def limit_keys(problem: Problem) -> tuple[LimitKey, ...]:
    """Return the keys of all limits of ``problem``; a part without a limit of its own can be given one."""
    found, limits = [], problem.limits
    for kind in KINDS:
        limit = getattr(limits, kind)
        if limit is not None:
            labels = frozenset(limit_label(kind, cable, None) for cable in problem.cables)
            found.append(LimitKey(kind, None, limit, labels))
    shared = {limit_label("clearance", a, f"cable:{b}") for a in problem.cables for b in problem.cables}
    for part, solid in problem.parts.items():
        limit = problem.clearance_limit(part)
        if limit is not None:
            labels = frozenset(limit_label("clearance", cable, part) for cable in problem.cables)
            found.append(LimitKey("clearance", part, limit, labels))
            shared |= labels if solid.clearance is None else set()
    if limits.clearance is not None:
        found.append(LimitKey("clearance", None, limits.clearance, frozenset(shared)))
    return tuple(found)
