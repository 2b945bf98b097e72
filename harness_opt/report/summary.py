"""What a run found, for other programs: the summary that ``summary.json`` holds."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import json
import math
import platform
import sys
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from harness_opt.clearance.limits import all_hold, all_limits
from harness_opt.clearance.measure import clearances
from harness_opt.clearance.pairs import ClearanceResult, PairClearance
from harness_opt.files.result_folder import SUMMARY
from harness_opt.files.summary import (
    ClipEntry,
    Command,
    CycleEntry,
    LimitEntry,
    PairEntry,
    ProblemEntry,
    RangeEntry,
    SheetEntry,
    SnapEntry,
    Summary,
    Verdict,
    limit_entry,
    obstacle_entry,
    path_entry,
)
from harness_opt.model.limits import LimitKind
from harness_opt.model.plausibility import doubts
from harness_opt.model.problem import Problem
from harness_opt.model.results import LimitResult, Motion, Snap
from harness_opt.numerics.rotations import Array
from harness_opt.report.data_sheet import ClipUse, DataSheet, Ranging, clip_uses, data_sheets
from harness_opt.report.redesign_words import redesign_summary

if TYPE_CHECKING:
    from harness_opt.design.result import Redesign


SCHEMA = 1  # of the summary
PACKAGES = ("numpy", "scipy", "casadi", "trimesh", "coal", "pyvista")  # whose versions can matter
PHASES = ("load", "solve", "clearance", "pictures")


# --- the summary ---------------------------------------------------------------------------------------


def verdict(result: Motion | Redesign, rows: Iterable[LimitResult]) -> Verdict:
    """Return "ok", "violated", "uncertain", "infeasible" or "unsolved".

    Args:
        result: of a simulation or a redesign.
        rows: its limits; a redesign has held them against its own rule already.
    """
    if not result.status.ok:
        return "unsolved"
    answer = all_hold(rows)
    if isinstance(result, Motion):
        return "ok" if answer == "yes" else "violated" if answer == "no" else "uncertain"
    if result.feasible:
        return "ok"
    return "uncertain" if answer == "uncertain" and not result.motion.snaps else "infeasible"


def summary(
    result: Motion | Redesign,
    measured: ClearanceResult | None = None,
    *,
    command: Command | None = None,
    files: Iterable[str] = (),
) -> Summary:
    """Return ``summary.json`` as dicts and lists that strict JSON can hold: what is not finite is None.

    Args:
        result: of a simulation or a redesign; pictures count as left out where its timing does not have them.
        measured: clearances of a simulated motion; None measures them. A redesign brings its own.
        command: "simulate" or "redesign"; None takes what the result is of. A redesign whose first motion
            could not be solved gives that motion.
        files: names of the files in the result folder.
    """
    motion = result if isinstance(result, Motion) else result.motion
    if not isinstance(result, Motion):
        measured = result.clearances
    elif measured is None:
        measured = clearances(motion)
    rows = all_limits(motion.problem, motion, measured)
    command = command or ("simulate" if isinstance(result, Motion) else "redesign")
    seconds = {phase: float(result.timing.get(phase, 0.0)) for phase in PHASES}
    seconds |= {"report": float(result.timing["report"])} if "report" in result.timing else {}
    seconds["total"] = float(result.timing.get("total", sum(seconds.values())))
    pictures = () if "pictures" in result.timing else ("pictures",)
    content: Summary = {
        "schema": SCHEMA,
        "command": command,
        "problem": problem_words(_asked(result)),
        "versions": versions(),
        "status": verdict(result, rows),
        "reason": result.status.name.lower(),
        "message": result.message,
        "frames": len(motion.motion),
        "path": path_entry(motion.problem.moments),
        "limits": [_limit(row, measured) for row in rows],
        "clearances": [_pair(pair) for pair in measured.pairs],
        "open_meshes": sorted({pair.obstacle.name for pair in measured.pairs if not pair.closed}),
        "frames_solved_between": dict(measured.inserted),
        "data_sheet": {name: _sheet(sheet) for name, sheet in data_sheets(motion).items()},
        "clips": [_clip(use) for use in clip_uses(motion)],
        "snaps": [_snap(snap) for snap in motion.snaps],
        "stable": bool(motion.cables) and all(np.all(cable.stable) for cable in motion.cables.values()),
        "equilibrium": {
            "max_residual": _largest(cable.residual for cable in motion.cables.values()),
            "estimated_error": _largest(cable.estimated_error for cable in motion.cables.values()),
        },
        "timing": seconds,
        "warnings": list(doubts(motion.problem)),
        "left_out": [*motion.left_out, *measured.left_out, *pictures],
        "files": sorted({*files, SUMMARY}),
    }
    if command == "redesign":
        content["redesign"] = redesign_summary(result)
    found: Summary = _strict(content)
    return found


def _clip(use: ClipUse) -> ClipEntry:
    return ClipEntry(
        cable=use.cable,
        clip=use.clip,
        kind=use.kind,
        body=use.body,
        arc_length=[use.first, use.least, use.most],
        force=use.force,
        moment=use.moment,
    )


def _snap(snap: Snap) -> SnapEntry:
    return SnapEntry(
        cable=snap.cable,
        frame=snap.frame,
        motion=snap.motion,
        passes_through_itself=snap.passes_through_itself,
        span=snap.span,
    )


def timed(result: Motion | Redesign, **seconds: float) -> Any:
    """Return ``result`` with ``seconds`` by phase added to its timing, and to the total if it has one."""
    timing = {**result.timing, **seconds}
    if "total" in result.timing and "total" not in seconds:
        timing["total"] += sum(seconds.values())
    return dataclasses.replace(result, timing=timing)


def _asked(result: Motion | Redesign) -> Problem:
    """Return the problem as the user gave it."""
    return result.problem if isinstance(result, Motion) else result.original


def problem_words(problem: Problem) -> ProblemEntry:
    """Return title, file and sha256 of ``problem``."""
    file = None if problem.file is None else str(problem.file)
    return {"title": problem.title, "file": file, "sha256": problem.sha256}


def versions() -> dict[str, str]:
    """Return the versions of harness-opt, Python, and of the packages that this run has imported."""
    found = {"harness-opt": _version("harness-opt"), "python": platform.python_version()}
    return found | {name: _version(name) for name in PACKAGES if name in sys.modules}


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:  # run from a checkout, or installed by other means than pip
        return str(getattr(sys.modules.get(package), "__version__", "not installed"))


def _limit(row: LimitResult, measured: ClearanceResult) -> LimitEntry:
    """Return a limit's row, with what is known of a clearance along the cable."""
    entry = limit_entry(row)
    if row.id.kind is LimitKind.CLEARANCE:
        entry["certified_along_arc"] = any(pair.certified_along_arc for pair in measured.pairs if pair.id == row.id)
    return entry


def _pair(pair: PairClearance) -> PairEntry:
    """Return a measured pair, with a limit or without."""
    return PairEntry(
        cable=pair.cable,
        part=pair.obstacle.key,
        other_cable=obstacle_entry(pair.obstacle)[1],
        limit=pair.limit,
        smallest=pair.worst,
        lower_bound=pair.lower_bound,
        frame=pair.frame,
        motion=pair.motion,
        arc_length=pair.arc_length,
        certified_along_arc=pair.certified_along_arc,
        excluded_near_clamps=dict(zip(("start", "end"), pair.excluded, strict=True)),
        closed=pair.closed,
    )


def _sheet(sheet: DataSheet) -> SheetEntry:
    """Return a data sheet with twists in degrees, as the problem file has them."""
    turn = LimitKind.TWIST.from_si
    return SheetEntry(
        bend_radius=sheet.bend_radius,
        bend_diameters=sheet.bend_diameters,
        twist_deg_per_m=turn * sheet.twist,
        bend_range=_range(sheet.bend, 1.0),
        twist_range_deg_per_m=_range(sheet.twisting, turn),
        sag=sheet.sag,
        reach=list(sheet.reach),
    )


def _range(found: Ranging, unit: float) -> RangeEntry:
    cycles = [CycleEntry(range=unit * c.range, mean=unit * c.mean, count=c.count) for c in found.cycles]
    return RangeEntry(range=unit * found.range, arc_length=found.arc_length, cycles=cycles)


def _largest(values: Iterable[Array]) -> float | None:
    return max((float(np.max(value)) for value in values if len(value)), default=None)


def _strict(value: Any) -> Any:
    """Return ``value`` with plain numbers, None in place of what is not finite, and lists for tuples."""
    if isinstance(value, Mapping):
        return {str(key): _strict(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_strict(item) for item in value]
    if isinstance(value, np.generic):
        return _strict(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def as_json(content: Mapping[str, Any]) -> str:
    """Return ``content`` as strict JSON text: what is not finite is null."""
    return json.dumps(_strict(content), indent=2, allow_nan=False)
