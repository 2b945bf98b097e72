"""Which stretches of a cable count against what: near its clamps, and against the cable itself."""

from __future__ import annotations

import math

from harness_opt.clearance.witnesses import Task
from harness_opt.model.problem import Problem


def least_gap(task: Task) -> float:
    """Return :func:`arc_apart` of the cable of ``task``, m."""
    return arc_apart(task.radius, task.limit)


def arc_apart(radius: float, limit: float | None) -> float:
    """Return the least arc, m, between two points of one cable that count against each other.

    It is that of a hairpin, a half circle, whose limbs stand just the limit apart.

    Args:
        radius: of the cable, m.
        limit: of its clearance, m; None is none.
    """
    return 0.5 * math.pi * (2 * radius + (limit or 0.0))


def let_off(problem: Problem, task: Task, body: str) -> tuple[float, float]:
    """Return the lengths from start and end that do not count against parts of ``body``, m."""
    run = problem.cables[task.cable]
    length = 2.0 * ((task.limit or 0.0) + task.radius)
    start, end = (length if end.position is not None and end.body == body else 0.0 for end in (run.start, run.end))
    return start, end
