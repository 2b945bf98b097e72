"""A motion read back from a result folder, with the problem it belongs to: for whoever draws or exports it."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from harness_opt.errors import HarnessError, ProblemError
from harness_opt.files.arrays import ROUNDING, read_arrays
from harness_opt.files.read import read_problem
from harness_opt.files.result_folder import SUMMARY, read_summary
from harness_opt.model.courses import FoundPoses
from harness_opt.model.problem import Problem
from harness_opt.model.results import CableMotion, Motion, Snap
from harness_opt.model.spans import clip_key, spans_of
from harness_opt.numerics.rotations import Array

USED = "used"  # in a result folder: the problem and the parts that it was made with
GIVEN, REDESIGNED = "problem.toml", "redesigned.toml"  # in it


def read_motion(folder: str | os.PathLike[str]) -> tuple[Motion, Motion | None, float]:
    """Return the motion that a result folder holds, that of the design before, and where the tightest limit stands.

    The latter from 0 to 1; the one before is None where nothing was redesigned. What ``motion.npz`` need not keep of
    a cable, its stability and errors, is NaN. Nothing is read but what lies in the folder: no link leads out of it.

    Args:
        folder: of the result.

    Raises:
        HarnessError: files are missing, or are not what ``harness-opt`` writes.
    """
    folder = Path(folder)
    try:
        within(folder, folder / SUMMARY)
        summary = read_summary(folder)
        if summary is None:
            raise HarnessError(f"{folder}: found no result of harness-opt, expected a result folder")
        values, cables, found = read_arrays(within(folder, folder / "motion.npz"))
        file = within(folder, folder / "before.npz")
        earlier = read_arrays(file) if file.is_file() else None
        rows = [row for row in summary["limits"] if row["margin"] is not None]
        tight = min(rows, key=lambda r: r["margin"] / (abs(r["limit"]) or 1.0), default={"motion": 0.0})
        worst = float(tight["motion"])
        if not 0.0 <= worst <= 1.0:
            raise ValueError(f"a limit at motion {worst:g}")
        snaps = tuple(
            Snap(
                str(snap["cable"]),
                int(snap["frame"]),
                float(snap["motion"]),
                bool(snap.get("passes_through_itself", False)),
                str(snap.get("span", "")),
            )
            for snap in summary.get("snaps", ())
        )
    except OSError as error:
        raise HarnessError(f"{folder}: found no {error.filename or error}, expected a result folder") from error
    except (ValueError, KeyError, TypeError, AttributeError, ArithmeticError, RecursionError) as error:
        raise HarnessError(f"{folder}: found a damaged result ({error!r}), expected a whole one") from error
    given = _problem(folder, GIVEN)
    redesigned = within(folder, folder / USED / REDESIGNED).is_file()
    problem = _with_found(folder, _problem(folder, REDESIGNED) if redesigned else given, found)
    if earlier is not None:
        given = _with_found(folder, given, earlier[2])
    for shapes, of in ((cables, problem), *(() if earlier is None else ((earlier[1], given),))):
        if set(shapes) != set(of.cables) or not len(values):
            raise HarnessError(f"{folder}: found shapes of {sorted(shapes)}, expected {sorted(of.cables)}")
        for name, run in of.cables.items():
            length = float(shapes[name].s[-1])
            if not math.isclose(length, run.cable.length, rel_tol=ROUNDING):
                words = f"{name} {length:g} m long, not {run.cable.length:g}"
                raise HarnessError(f"{folder}: found a damaged result ({words}), expected a whole one")
            if not _clipped(of, name, shapes[name]):
                words = f"{name} without two stations at each of its {len(run.clips)} clips"
                raise HarnessError(f"{folder}: found a damaged result ({words}), expected a whole one")
    if any(snap.cable not in cables or not 0 <= snap.frame < len(values) for snap in snaps):
        raise HarnessError(f"{folder}: found a damaged result (a snap of no cable or frame), expected a whole one")
    motion = Motion(problem, values, cables, snaps=snaps)
    before = None if earlier is None or not earlier[1] else Motion(given, earlier[0], earlier[1])
    return motion, before, worst


def _with_found(folder: Path, problem: Problem, found: Mapping[str, FoundPoses]) -> Problem:
    """Return ``problem`` with everything free where it was ``found``.

    Raises:
        HarnessError: something else was found than is free.
    """
    free = {name for name, body in problem.bodies.items() if body.free}
    free |= {clip_key(name, clip.name) for name, run in problem.cables.items() for clip in run.clips if clip.is_free}
    if set(found) != free:
        words = f"places of {sorted(found)}, not of {sorted(free)}"
        raise HarnessError(f"{folder}: found a damaged result ({words}), expected a whole one")
    return problem.changed(found=found)


def _clipped(problem: Problem, cable: str, shapes: CableMotion) -> bool:
    """Return whether there are two stations and two nodes at each clip, and nowhere else."""
    length = problem.cables[cable].cable.length
    for places, unit in ((shapes.s, length), (shapes.mesh, 1.0)):
        doubled = places[np.flatnonzero(np.diff(places) == 0.0)] / unit
        at = np.array([span.last / length for span in spans_of(problem).values() if span.cable == cable][:-1])
        if doubled.shape != at.shape or not np.allclose(doubled, at, rtol=0.0, atol=ROUNDING):
            return False
    return True


def within(folder: Path, file: Path) -> Path:
    """Return ``file`` of a result ``folder``.

    Raises:
        HarnessError: a link leads out of the folder.
        OSError: links lead in a circle.
    """
    try:
        real = file.resolve()
    except RuntimeError as error:  # of links in a circle
        raise OSError(str(error)) from error
    if not real.is_relative_to(folder.resolve()):
        raise HarnessError(f"{folder}: found a link out of it, {file.relative_to(folder)}, expected a file of its own")
    return file


def _problem(folder: Path, name: str) -> Problem:
    """Return a problem that a result was made with.

    Raises:
        HarnessError: it is not there, or damaged.
    """
    file = folder / USED / name
    if not within(folder, file).is_file():
        words = "expected the problem and the parts that it was made with; simulate writes them"
        raise HarnessError(f"{folder}: found no file {USED}/{name}, {words}")
    try:
        return read_problem(file)
    except ProblemError as error:
        raise HarnessError(f"{folder}: found a damaged result ({error.mistakes[0]}), expected a whole one") from error


@dataclass(frozen=True, eq=False)
class StoredResult:
    """A result folder, read back.

    Args:
        folder: absolute.
        summary: what ``summary.json`` holds.
        motion: (P,), 0 to 1, of the frames.
        cables: the shapes, by name.
        found: where free bodies stood, by name, and the cable in clips that let it turn or slide, "CABLE, CLIP".
    """

    folder: Path
    summary: Mapping[str, Any]
    motion: Array
    cables: Mapping[str, CableMotion]
    found: Mapping[str, FoundPoses]


def read_results(folder: str | Path) -> StoredResult:
    """Return the result that :func:`write_results` wrote to ``folder``.

    Raises:
        ProblemError: no folder, or no result of harness-opt in it.
    """
    place = Path(folder).resolve()
    try:
        within(place, place / SUMMARY)
        content = read_summary(place)
        if content is None:
            raise ProblemError(f"{folder}: found no result of harness-opt, expected a folder with {SUMMARY}")
        return StoredResult(place, content, *read_arrays(within(place, place / "motion.npz")))
    except HarnessError as error:
        raise ProblemError(str(error)) from error
    except (OSError, ValueError) as error:
        raise ProblemError(f"{folder}: found a damaged result ({error}), expected a whole one") from error
