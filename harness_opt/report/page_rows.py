"""The rows and sentences of a report: what a summary says, laid out for a page."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from harness_opt.clearance.pairs import ClearanceResult
from harness_opt.files.summary import LimitEntry, Summary, limit_of, moments_of
from harness_opt.model.bodies import WORLD, BodyMotion, Hinge, Poses, Slide
from harness_opt.model.cable import CableRun
from harness_opt.model.courses import Course, Moves, ValueTable
from harness_opt.model.ends import Clip, End
from harness_opt.model.limits import KIND_OF_KEY, LimitKind
from harness_opt.model.problem import Moments, Problem, travels
from harness_opt.model.results import Motion
from harness_opt.numerics import rotations
from harness_opt.numerics.rotations import Array
from harness_opt.report import charts
from harness_opt.report import redesign_words as redesigned
from harness_opt.report import words as tables
from harness_opt.report.data_sheet import cut_list

Json = dict[str, Any]

BAR = 50.0  # half the width of a margin's bar
WORDS = {
    "ok": ("All limits hold", "good"),
    "violated": ("Limits are violated", "bad"),
    "uncertain": ("Not certain that all limits hold", "warn"),
    "infeasible": ("No design found that holds all limits", "bad"),
    "unsolved": ("Not solved", "bad"),
}
HOLDS = {
    "yes": ("good-text", "yes", "held"),
    "no": ("bad-text", "NO", "short"),
    "uncertain": ("warn-text", "not certain", "unsure"),
}
MOST_GROUPS = 12  # of limits that are shown whether they hold or not
HEAD_CABLES = ("Cable", "Length", "Diameter", "Bending stiffness", "Torsional stiffness", "Mass", "As made")
HEAD_CLAMPS = ("Clamp", "Held by", "Position, mm", "Direction along the cable", "Roll")
HEAD_CUT = ("Cut and marks", "At", "Along the cable", "From the mark before")
HEAD_BODIES = ("Body", "Motion", "From", "To")


def verdict(summary: Summary) -> tuple[str, str]:
    """Return the verdict in a few words, and its tone: "good", "bad" or "warn"."""
    if summary["status"] == "ok" and not summary["stable"]:
        return "All limits hold, not all shapes are stable", "warn"
    if summary["status"] == "ok" and not summary["limits"]:
        return "Solved, without limits", "good"
    return WORDS[summary["status"]]


def conclusion(summary: Summary) -> str:
    """Return what to say beside the verdict: what is violated, or else what is tightest."""
    rows = [row for row in summary["limits"] if row["margin"] is not None]
    if summary["status"] != "ok" or not rows:
        return tables.conclusion(summary)
    tight = min(rows, key=_share)
    margin = tables.quantity(tight, tight["margin"])
    at = moments_of(summary).words(tight["motion"])
    return f"The tightest of {len(rows)} is {tables.limit_words(tight)}: {margin} to spare, at {at}."


def limit_groups(summary: Summary) -> tuple[list[list[Json]], list[list[Json]]]:
    """Return the limits of a summary as groups of rows of cells, worst first, and those that can wait.

    A group has all clearances to one part, or all limits of one kind; its worst row stands first. Of many groups those
    that hold can wait.
    """
    moments = moments_of(summary)
    groups: dict[str, list[Json]] = {}
    for number, row in sorted(enumerate(summary["limits"]), key=lambda pair: _urgency(pair[1])):
        cells = _limit_cells(row, moments) | {"number": number}
        groups.setdefault(cells["group"], []).append(cells)
    found = list(groups.values())
    wait = [k for k, rows in enumerate(found) if k >= MOST_GROUPS and rows[0]["holds"] == "yes"]
    return [rows for k, rows in enumerate(found) if k not in wait], [found[k] for k in wait]


def _urgency(row: LimitEntry) -> tuple[int, float]:
    return ("no", "uncertain", "yes").index(row["holds"]), _share(row)


def _limit_cells(row: LimitEntry, moments: Moments) -> Json:
    reach = BAR * min(1.0, abs(_share(row)))
    tone, answer, kind = HOLDS[row["holds"]]
    words, against = KIND_OF_KEY[row["name"]].words, tables.against(row)
    at = "never near"
    if row["worst"] is not None:
        at = f"{moments.words(row['motion'])},\n{1e3 * row['arc_length']:.0f} mm along"
    return {
        "label": words,
        "group": against or words,
        "cable": row["cable"],
        "against": against,
        "allowed": tables.quantity(row, row["limit"]),
        "worst": tables.quantity(row, row["worst"]),
        "margin": tables.quantity(row, row["margin"], "+"),
        "holds": row["holds"],
        "tone": tone,
        "answer": answer,
        "kind": kind,
        "bar": (round(-reach, 2) if row["holds"] == "no" else 0.0, round(max(reach, 1.0), 2)),
        "motion": row["motion"],
        "where": at,
        "sure": _certainty(row),
    }


def _share(row: LimitEntry) -> float:
    """Return a margin as a share of its limit."""
    return 1.0 if row["margin"] is None else row["margin"] / (abs(row["limit"] or 0.0) or 1.0)


def _certainty(row: LimitEntry) -> str:
    """Return how sure the worst value of a row is between the points that were looked at."""
    unit = KIND_OF_KEY[row["name"]].unit
    tolerance = "-" if row["tolerance"] is None else f"{row['tolerance'] * unit.factor:.2g} {unit.name}"
    if row["certified"]:
        return f"to {tolerance}"
    if row.get("certified_along_arc"):
        return f"at frames, to {tolerance}"
    return f"estimated, to {tolerance}" if row["tolerance"] else "at the clamps"


def live_rows(
    motion: Motion,
    measured: ClearanceResult,
    rows: Sequence[LimitEntry],
    curves: Mapping[str, Mapping[str, Mapping[str, Array]]],
) -> list[Json]:
    """Return the values of each limit's row at every frame, in the unit shown; None where there is none.

    Args:
        motion, measured: what was simulated, and its clearances.
        rows: limits of the summary.
        curves: values (P,) by cable, title and name of a chart.
    """
    pairs = {pair.id: pair for pair in measured.pairs}
    found = []
    for row in rows:
        which = limit_of(row)
        kind, unit = which.kind, which.kind.unit
        if kind is LimitKind.CLEARANCE:
            values = np.where(math.isfinite(pairs[which].worst), unit.factor * pairs[which].clearance, np.inf)
        else:
            series = curves[row["cable"]][charts.TITLES[kind]]
            values = np.max(list(series.values()), axis=0) if which.clip is None else series[which.clip]
        limit = None if row["limit"] is None else unit.factor * row["limit"]
        digits = min(unit.digits, 2)
        found.append({"values": plain(values), "limit": limit, "most": not kind.is_least, "digits": digits})
    return found


def plain(values: Array) -> list[float | None]:
    """Return ``values`` (P,) to six digits, None for what is not finite."""
    return [float(f"{value:.6g}") if math.isfinite(value) else None for value in values]


# --- redesign ------------------------------------------------------------------------------------------


def variable_rows(summary: Summary) -> list[Json]:
    """Return the design variables of a summary as the cells of a table; none for a simulation."""
    found = []
    for name, row in summary["redesign"]["variables"].items() if "redesign" in summary else ():
        unit, scale, digits = ("deg", 1.0, 2) if name.endswith("_deg") else ("mm", 1e3, 1)

        def words(value: float | None, sign: str = "", scale: float = scale, digits: int = digits) -> str:
            return "-" if value is None else f"{scale * value:{sign}.{digits}f}"

        change = None if row["after"] is None else row["after"] - row["before"]
        found.append(
            {
                "name": name,
                "before": f"{words(row['before'])} {unit}",
                "after": f"{words(row['after'])} {unit}",
                "change": f"{words(change, '+')} {unit}",
                "bounds": f"{words(row['lower'])} to {words(row['upper'])} {unit}",
            }
        )
    return found


def redesign_words(summary: Summary) -> Iterator[str]:
    """Give what else there is to say about a redesign, a sentence each."""
    if "redesign" not in summary:
        return
    found = summary["redesign"]
    steps = f"Found in {found['iterations']} steps, {found['looked_at']} designs looked at"
    yield f"{steps}; then simulated anew on twice the frames and twice the elements."
    for clamp in found.get("clamps", []):
        yield f"{redesigned.clamp_words(clamp)}."
    if found["active"]:
        yield f"What holds the design where it is: {'; '.join(found['active'])}."
    yield from redesigned.redesign_words(summary)


def before_after(summary: Summary) -> list[Json]:
    """Return the limits of a redesign's summary before and after as the cells of a table."""
    if "redesign" not in summary or not summary["redesign"]["limits_before"]:
        return []
    before = {row["id"]: row for row in summary["redesign"]["limits_before"]}
    found = []
    for row in summary["limits"]:
        old = before.get(row["id"])
        found.append(
            {
                "words": tables.limit_words(row),
                "allowed": tables.quantity(row, row["limit"]),
                "before": "-" if old is None else tables.quantity(old, old["worst"]),
                "after": tables.quantity(row, row["worst"]),
                "before_holds": old is None or old["holds"] != "no",
                "after_holds": row["holds"] != "no",
            }
        )
    return found


# --- notes ---------------------------------------------------------------------------------------------


def notes(summary: Summary) -> Iterator[str]:
    """Give what a reader has to know: what is certain, what was left out, how exact the shapes are."""
    yield from tables.notes(summary)
    clearances = [row for row in summary["limits"] if row["name"] == "clearance"]
    if clearances and all(row["certified"] for row in clearances):
        yield "Clearances are certain along the whole cables, to the tolerances in the table."
    elif clearances:
        yield (
            "Clearances are certain along the whole cables at the solved frames, to the tolerances in the table. "
            "Between two frames they are not: what moves there is not bounded."
        )
    if any(row["name"] != "clearance" for row in summary["limits"]):
        yield (
            "Bend radius and twist are looked at in 101 places along each cable; their tolerances are estimates of "
            "what lies between. The forces and moments of the clamps are those of the solved frames."
        )
    numbers = summary["equilibrium"]
    if numbers["max_residual"] is not None and numbers["estimated_error"] is not None:
        yield (
            f"Every shape solves the rod's equations to {numbers['max_residual']:.1g} (scaled), and lies within "
            f"{numbers['estimated_error']:.1g} of its length of the exact one, by its own estimate."
        )
    if summary["stable"]:
        yield "Every shape shown is a stable equilibrium: no small motion that its ends allow lowers its energy."
    yield (
        "The cable is a thin elastic rod under its weight: friction, dynamics, permanent set and temperature are "
        "left out, and contact pushes nothing away."
    )


# --- inputs ---------------------------------------------------------------------------------------------


def input_tables(problem: Problem) -> Iterator[Json]:
    """Give the tables, each as ``head`` and ``rows``."""
    yield {"head": HEAD_CABLES, "rows": [_input_cable(name, run) for name, run in problem.cables.items()]}
    clamps = [
        (f"{name}, {side}{_where(end)}", *_input_clamp(end))
        for name, run in problem.cables.items()
        for side, end in run.clamps.items()
    ]
    yield {"head": HEAD_CLAMPS, "rows": clamps}
    marks = [(m.cable, m.at, f"{1e3 * m.arc_length:.6g} mm", f"{1e3 * m.apart:.6g} mm") for m in cut_list(problem)]
    if marks:
        yield {"head": HEAD_CUT, "rows": marks}
    moving = {way.body: way for way in travels(problem)}
    bodies = [(name, motion_words(problem, name), moving[name].at(0.0), moving[name].at(1.0)) for name in moving]
    bodies += [(name, motion_words(problem, name), "", "") for name, body in problem.bodies.items() if body.free]
    if bodies:
        yield {"head": HEAD_BODIES, "rows": bodies}


def _input_cable(name: str, run: CableRun) -> tuple[str, ...]:
    cable = run.cable
    kx, ky, kz = cable.stiffness
    bending = f"{kx:.4g} N m2" if kx == ky else f"{kx:.4g} (about d1), {ky:.4g} (about d2) N m2"
    made = f"curved, {_numbers(cable.rest_curvature)} 1/m" if any(cable.rest_curvature) else "straight"
    mass = f"{1e3 * cable.mass_per_length:.4g} g/m"
    return name, f"{1e3 * cable.length:.6g} mm", f"{1e3 * cable.diameter:.4g} mm", bending, f"{kz:.4g} N m2", mass, made


def _where(end: End) -> str:
    return f" at {1e3 * end.at:.6g} mm" if isinstance(end, Clip) else ""


def _input_clamp(end: End) -> tuple[str, ...]:
    if end.position is not None:
        place = _numbers(1e3 * np.asarray(end.position))
    else:
        place = "free" if end.force is None else f"pulled by {_numbers(end.force)} N"
    way = direction(end)
    if way is not None:
        told = _numbers(way)
    else:
        told = "free" if end.moment is None else f"turned by {_numbers(end.moment)} N m"
    return end.body, place, told, roll_words(end)


def direction(end: End) -> rotations.Array | None:
    """Return the unit tangent (3,) of a clamp in its body's coordinates; None where it is free."""
    if end.tangent is not None:
        return rotations.normalise(np.asarray(end.tangent, dtype=float))
    return None if end.quaternion is None else rotations.tangent(np.asarray(end.quaternion, dtype=float))


def roll_words(end: End) -> str:
    """Return how a clamp holds the cable about its tangent."""
    turns = f", {end.turns:+g} turns" if end.turns else ""
    if end.roll is not None:
        return {"untwisted": "as it comes, untwisted", "free": "free to turn (swivel)"}[end.roll] + turns
    if end.roll_deg is not None:
        return f"{end.roll_deg:g} deg{turns}"
    if end.swivel:
        return "free to turn (swivel)"
    return f"by its quaternion{turns}" if end.quaternion is not None else "-"


def motion_words(problem: Problem, name: str) -> str:
    """Return how a body moves: about which line, or which way."""
    body = problem.body(name)
    if body.free:
        return f"hangs on its cables, {1e3 * body.mass:.4g} g" if body.mass else "hangs on its cables, weightless"
    words = _own_motion_words(body.motion)
    return words if body.parent == WORLD else f"{words}, on {body.parent}"


def _own_motion_words(motion: BodyMotion | None) -> str:
    if isinstance(motion, Hinge):
        line = f"{_numbers(motion.axis)} through {_numbers(1e3 * np.asarray(motion.point))} mm"
        return f"turns about {line}{_course_words(motion.follows)}"
    if isinstance(motion, Slide):
        return f"slides along {_numbers(motion.direction)}{_course_words(motion.follows)}"
    if isinstance(motion, Poses):
        return f"follows {len(motion.times)} poses" + ("" if motion.file is None else f" of {motion.file.name}")
    return "stands still"


def _course_words(course: Course | None) -> str:
    """Return what a hinge or a slide follows; nothing where it goes evenly."""
    if isinstance(course, ValueTable):
        by = f"{len(course.times)} rows" + ("" if course.file is None else f" of {course.file.name}")
    elif isinstance(course, Moves):
        by = "one move" if len(course.moves) == 1 else f"{len(course.moves)} moves"
    else:
        return ""
    return f", by {by} in {course.seconds:.4g} s"


def _numbers(values: Sequence[float] | rotations.Array) -> str:
    return f"({', '.join(f'{value:.4g}' for value in np.asarray(values, dtype=float) + 0.0)})"
