"""What a run found, for other programs: the summary as JSON, shapes as plain arrays, the result folder."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import json
import math
import platform
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from harness_opt.clearance.limits import cable_limits, held
from harness_opt.clearance.measure import Between, ClearanceResult, Options, PairClearance, measure
from harness_opt.errors import ProblemError
from harness_opt.files.arrays import read_arrays, write_arrays
from harness_opt.files.read import write_problem
from harness_opt.files.result_folder import SUMMARY, read_summary, replacing
from harness_opt.model import checks
from harness_opt.model.bodies import Poses
from harness_opt.model.plausibility import doubts
from harness_opt.model.problem import MeshFile, Problem
from harness_opt.model.results import CableMotion, LimitResult, Motion
from harness_opt.numerics.rotations import Array
from harness_opt.parts.scene import Scene, load_scene
from harness_opt.report.data_sheet import DataSheet, data_sheets
from harness_opt.report.redesign_summary import FILE_WORDS, redesign_summary

if TYPE_CHECKING:
    from harness_opt.design.nominal import Redesign

Json = dict[str, Any]
Pictures = Callable[["Motion | Redesign", Path], Iterable[str]]
Page = Callable[[Json, Path], str]  # writes a report of a summary into a folder

SCHEMA = 1  # of the summary
PACKAGES = ("numpy", "scipy", "casadi", "trimesh", "coal", "pyvista")  # whose versions can matter
PHASES = ("load", "solve", "clearance", "pictures")


def clearances(
    motion: Motion,
    scene: Scene | None = None,
    *,
    tolerance: float | None = None,
    stop: Callable[[], bool] | None = None,
) -> ClearanceResult:
    """Return the clearances of a motion: all cables to all parts and, where a limit asks for it, to cables.

    Where there is a limit, frames are solved between those of the motion until the smallest clearance of the whole
    motion is certain; they are not added to it.

    Args:
        motion: simulated; what was solved of it is measured.
        scene: the parts as geometry; None loads them.
        tolerance: to which the smallest clearances are wanted, m; None takes 1 % of the cable's diameter.
        stop: asked while the motion is searched between its frames; once True, the rest is left uncertain.

    Raises:
        ProblemError: a mesh that cannot be used; a tolerance that is not above 0.
    """
    if tolerance is not None:
        checks.positive("tolerance", tolerance)
    if not motion.cables:
        return ClearanceResult(motion.motion, ())
    from harness_opt.motion.between_frames import BetweenFrames

    scene = load_scene(motion.problem) if scene is None else scene
    between = Between(BetweenFrames(motion), motion.snaps)
    return measure(motion.problem, scene, motion.motion, motion.cables, Options(tolerance, stop=stop), between)


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


# --- the result folder ---------------------------------------------------------------------------------


def write_results(
    result: Motion | Redesign,
    folder: str | Path,
    *,
    measured: ClearanceResult | None = None,
    command: str | None = None,
    pictures: Pictures | None = None,
    page: Page | None = None,
) -> Json:
    """Write the result folder, complete or not at all, and return its summary.

    It holds ``summary.json`` and ``motion.npz``; for a redesign also ``redesigned.toml`` and ``before.npz``,
    the motion of the design given. An earlier result of harness-opt in the same place is replaced.

    Args:
        result: of a simulation or a redesign.
        folder: to write; its parents are made.
        measured, command: as in :func:`summary`.
        pictures: draws a result into a folder and returns the names of the files; None draws none.
        page: writes a report of the summary into a folder and returns the name of its file; None writes none.

    Raises:
        ProblemError: ``folder`` holds something else, or cannot be written; a mesh that cannot be used.
    """
    if isinstance(result, Motion) and measured is None:
        measured = clearances(result)
    with replacing(Path(folder), input_files(_asked(result))) as aside:
        if isinstance(result, Motion):
            _write_arrays(aside / "motion.npz", result)
        else:
            _write_arrays(aside / "motion.npz", result.motion)
            _write_arrays(aside / "before.npz", result.motion_before)
            write_problem(result.problem, aside / "redesigned.toml")
            if result.trade_off is not None:
                from harness_opt.report.trade_off_files import write_trade_off

                write_trade_off(result.trade_off, aside)
        if pictures is not None:
            begin = time.perf_counter()
            pictures(result, aside)
            result = timed(result, pictures=time.perf_counter() - begin)
        files = [entry.name for entry in aside.iterdir()]
        content = summary(result, measured, command=command, files=files)
        if page is not None:
            content["files"] = sorted([*content["files"], page(content, aside)])
        (aside / SUMMARY).write_text(as_json(content) + "\n", encoding="utf-8")
    return content


def input_files(problem: Problem) -> list[Path]:
    """Return the files that ``problem`` was read from and still needs."""
    files = [part.shape.path for part in problem.parts.values() if isinstance(part.shape, MeshFile)]
    files += [
        body.motion.file for body in problem.bodies.values() if isinstance(body.motion, Poses) and body.motion.file
    ]
    return [*files, problem.file] if problem.file else files


def _write_arrays(file: Path, motion: Motion) -> None:
    try:
        write_arrays(file, motion.motion, motion.cables)
    except ValueError as error:
        raise ProblemError(f"{file.name}: found {error}, expected none: nothing was written") from error


@dataclass(frozen=True, eq=False)
class StoredResult:
    """A result folder, read back.

    Args:
        folder: absolute.
        summary: as :func:`summary` gave it.
        motion: (P,), 0 to 1, of the frames.
        cables: the shapes, by name.
    """

    folder: Path
    summary: Json
    motion: Array
    cables: Mapping[str, CableMotion]


def read_results(folder: str | Path) -> StoredResult:
    """Return the result that :func:`write_results` wrote to ``folder``.

    Raises:
        ProblemError: no folder, or no result of harness-opt in it.
    """
    place = Path(folder).resolve()
    try:
        content = read_summary(place)
        if content is None:
            raise ProblemError(f"{folder}: found no result of harness-opt, expected a folder with {SUMMARY}")
        return StoredResult(place, content, *read_arrays(place / "motion.npz"))
    except (OSError, ValueError) as error:
        raise ProblemError(f"{folder}: found a damaged result ({error}), expected a whole one") from error
