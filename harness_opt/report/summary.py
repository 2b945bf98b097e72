"""What a run found, for other programs: the summary as JSON, shapes as plain arrays, the result folder."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import json
import math
import platform
import sys
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from harness_opt.clearance.limits import cable_limits, held
from harness_opt.clearance.measure import clearances
from harness_opt.clearance.pairs import ClearanceResult, PairClearance
from harness_opt.files.result_folder import SUMMARY
from harness_opt.model import design_variables
from harness_opt.model.plausibility import doubts
from harness_opt.model.problem import Problem
from harness_opt.model.results import LimitResult, Motion
from harness_opt.numerics.rotations import Array
from harness_opt.report.data_sheet import DataSheet, data_sheets

if TYPE_CHECKING:
    from harness_opt.design.prices import Price
    from harness_opt.design.relaxations import Relaxation
    from harness_opt.design.result import Redesign

if TYPE_CHECKING:
    from harness_opt.design.result import Redesign

Json = dict[str, Any]
LimitWords = Callable[[LimitResult], Json]
FILE_WORDS = {"twist": ("twist_deg_per_m", math.degrees(1.0))}  # name and unit in the file of what is in rad here

SCHEMA = 1  # of the summary
PACKAGES = ("numpy", "scipy", "casadi", "trimesh", "coal", "pyvista")  # whose versions can matter
PHASES = ("load", "solve", "clearance", "pictures")


# --- the summary ---------------------------------------------------------------------------------------


def verdict(result: Motion | Redesign, rows: Iterable[LimitResult]) -> str:
    """Return "ok", "violated", "infeasible" or "unsolved".

    Args:
        result: of a simulation or a redesign.
        rows: its limits; a redesign has held them against its own rule already.
    """
    if not result.status.ok:
        return "unsolved"
    if isinstance(result, Motion):
        return "ok" if held(tuple(rows)) else "violated"
    return "ok" if result.feasible else "infeasible"


def summary(
    result: Motion | Redesign,
    measured: ClearanceResult | None = None,
    *,
    command: str | None = None,
    files: Iterable[str] = (),
) -> Json:
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
    rows = (*measured.limits, *cable_limits(motion.problem, motion))
    command = command or ("simulate" if isinstance(result, Motion) else "redesign")
    seconds = {phase: float(result.timing.get(phase, 0.0)) for phase in PHASES}
    seconds |= {"report": float(result.timing["report"])} if "report" in result.timing else {}
    seconds["total"] = float(result.timing.get("total", sum(seconds.values())))
    pictures = () if "pictures" in result.timing else ("pictures",)
    content = {
        "schema": SCHEMA,
        "command": command,
        "problem": problem_words(_asked(result)),
        "versions": versions(),
        "status": verdict(result, rows),
        "reason": result.status.name.lower(),
        "message": result.message,
        "frames": len(motion.motion),
        "limits": [_limit(row, measured) for row in rows],
        "clearances": [_pair(pair) for pair in measured.pairs],
        "open_meshes": sorted({pair.obstacle for pair in measured.pairs if not pair.closed}),
        "frames_solved_between": dict(measured.inserted),
        "data_sheet": {name: _sheet(sheet) for name, sheet in data_sheets(motion).items()},
        "snaps": [dataclasses.asdict(snap) for snap in motion.snaps],
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
        content["redesign"] = redesign_summary(result, _limit)
    return _strict(content)


def timed(result: Motion | Redesign, **seconds: float) -> Any:
    """Return ``result`` with ``seconds`` by phase added to its timing, and to the total if it has one."""
    timing = {**result.timing, **seconds}
    if "total" in result.timing and "total" not in seconds:
        timing["total"] += sum(seconds.values())
    return dataclasses.replace(result, timing=timing)


def _asked(result: Motion | Redesign) -> Problem:
    """Return the problem as the user gave it."""
    return result.problem if isinstance(result, Motion) else result.original


def problem_words(problem: Problem) -> Json:
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


def _limit(row: LimitResult, measured: ClearanceResult | None = None) -> Json:
    """Return a limit's row in the words and the unit of the problem file."""
    name, unit = FILE_WORDS.get(row.name, (row.name, 1.0))
    entry = dataclasses.asdict(row) | {"name": name}
    entry |= {key: unit * entry[key] for key in ("limit", "worst", "margin", "tolerance")}
    if measured is not None and row.name == "clearance":
        entry["certified_along_arc"] = any(
            pair.certified_along_arc for pair in measured.pairs if (pair.cable, pair.obstacle) == (row.cable, row.part)
        )
    return entry


def _pair(pair: PairClearance) -> Json:
    """Return a measured pair, with a limit or without."""
    return {
        "cable": pair.cable,
        "part": pair.obstacle,
        "limit": pair.limit,
        "smallest": pair.worst,
        "lower_bound": pair.lower_bound,
        "frame": pair.frame,
        "motion": pair.motion,
        "arc_length": pair.arc_length,
        "certified_along_arc": pair.certified_along_arc,
        "excluded_near_clamps": dict(zip(("start", "end"), pair.excluded, strict=True)),
        "closed": pair.closed,
    }


def _sheet(sheet: DataSheet) -> Json:
    """Return a data sheet with twists in degrees, as the problem file has them."""
    entry = dataclasses.asdict(sheet)
    turn = math.degrees(1.0)
    entry["twist_deg_per_m"] = turn * entry.pop("twist")
    entry["bend_range"] = entry.pop("bend")
    twisting = entry.pop("twisting")
    cycles = [{key: value * (1.0 if key == "count" else turn) for key, value in c.items()} for c in twisting["cycles"]]
    entry["twist_range_deg_per_m"] = twisting | {"range": turn * twisting["range"], "cycles": cycles}
    return entry


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


def as_json(content: Json) -> str:
    """Return ``content`` as strict JSON text: what is not finite is null."""
    return json.dumps(_strict(content), indent=2, allow_nan=False)


# --- of a redesign --------------------------------------------------------------------------------------


def redesign_summary(result: Motion | Redesign, limit_words: LimitWords) -> Json:
    """Return the part of a summary that is about the redesign.

    Args:
        result: a redesign, or the motion of the design given where that could not be simulated.
        limit_words: a limit's row as the summary has it.
    """
    from harness_opt.report.trade_off_files import trade_off_summary  # a simulation needs none of the rooms behind it

    if isinstance(result, Motion):  # no other design was looked for
        problem = result.problem
        given = zip(problem.design.variables, design_variables.values(problem), strict=True)
        bounds = {v.name: (float(at), None, v.lower, v.upper) for v, at in given}
        return {
            "variables": {
                name: dict(zip(("before", "after", "lower", "upper"), values, strict=True))
                for name, values in bounds.items()
            },
            "iterations": 0,
            "limits_before": [],
            "active": [],
        }
    design = result.original.design
    return {
        "variables": {name: dataclasses.asdict(found) for name, found in result.variables.items()},
        "goal": design.maximise or design.minimise,
        "coupled": {coupling.name: coupling.words for coupling in design.couplings},
        "moved_inside": {name: {"from": a, "to": b} for name, (a, b) in result.moved.items()},
        "iterations": result.iterations,
        "limits_before": [limit_words(row) for row in result.limits_before],
        "active": list(result.active),
        "in_the_way": [_relaxation(found) for found in result.relaxations],
        "costs": [_price(found) for found in result.prices],
        "history": [dataclasses.asdict(step) for step in result.history],
        **({} if result.robust is None else {"robust": dataclasses.asdict(result.robust)}),
        **({} if result.trade_off is None else {"pareto": trade_off_summary(result.trade_off)}),
    }


def _relaxation(found: Relaxation) -> Json:
    name, unit = FILE_WORDS.get(found.kind, (found.kind, 1.0))
    entry = dataclasses.asdict(found) | {"kind": name, "key": found.key.replace(f".{found.kind}", f".{name}")}
    for value in ("value", "estimate", "enough"):
        entry[value] = None if entry[value] is None else unit * entry[value]
    return entry


def _price(found: Price) -> Json:
    name, unit = FILE_WORDS.get(found.kind, (found.kind, 1.0))
    entry = dataclasses.asdict(found) | {"kind": name, "key": found.key.replace(f".{found.kind}", f".{name}")}
    buys = {variable: unit * float(rate) for variable, rate in found.buys.items()}
    return entry | {"value": unit * found.value, "saves": found.saves / unit, "buys": buys}
