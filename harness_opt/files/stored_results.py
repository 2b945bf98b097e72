"""A motion read back from a result folder, with the problem it belongs to: for whoever draws or exports it."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from harness_opt.errors import HarnessError, ProblemError
from harness_opt.files.arrays import read_arrays
from harness_opt.files.read import read_problem
from harness_opt.files.result_folder import SUMMARY, read_summary
from harness_opt.model.results import CableMotion, Motion, Snap
from harness_opt.numerics.rotations import Array


def read_motion(
    folder: str | os.PathLike[str], folders: Iterable[str | os.PathLike[str]] = ()
) -> tuple[Motion, Motion | None, float]:
    """Return the motion that a result folder holds, that of the design before, and where the tightest limit stands.

    The latter from 0 to 1; the one before is None where nothing was redesigned. What ``motion.npz`` need not keep of
    a cable, its stability and errors, is NaN.

    Args:
        folder: of the result.
        folders: from which its problem file may read, as for :func:`harness_opt.read_problem`.

    Raises:
        HarnessError: files are missing, or are not what ``harness-opt`` writes.
        ProblemError: the problem file can't be read any more.
    """
    folder = Path(folder)
    try:
        summary = read_summary(folder)
        if summary is None:
            raise HarnessError(f"{folder}: found no result of harness-opt, expected a result folder")
        values, cables = read_arrays(folder / "motion.npz")
        earlier = read_arrays(folder / "before.npz") if (folder / "before.npz").is_file() else None
        source, rows = summary["problem"]["file"], [r for r in summary["limits"] if r["margin"] is not None]
        tight = min(rows, key=lambda r: r["margin"] / (abs(r["limit"]) or 1.0), default={"motion": 0.0})
        worst = float(tight["motion"])
        snaps = tuple(
            Snap(str(snap["cable"]), int(snap["frame"]), float(snap["motion"])) for snap in summary.get("snaps", ())
        )
    except OSError as error:
        raise HarnessError(f"{folder}: found no {error.filename or error}, expected a result folder") from error
    except (ValueError, KeyError, TypeError, AttributeError, ArithmeticError) as error:
        raise HarnessError(f"{folder}: found a damaged result ({error!r}), expected a whole one") from error
    if not isinstance(source, str):
        raise HarnessError(f"{folder}: found no name of a problem file, expected one to know the parts by")
    if (folder / source).exists() and not (folder / source).is_file():
        raise HarnessError(f"{folder}: found {source!r} for its problem file, a folder or a device, expected a file")
    given = read_problem(folder / source, folders)
    redesigned = folder / "redesigned.toml"
    problem = read_problem(redesigned, folders) if redesigned.is_file() else given
    if set(cables) != set(problem.cables) or not len(values):
        raise HarnessError(f"{folder}: found shapes of {sorted(cables)}, expected {sorted(problem.cables)}")
    motion = Motion(problem, values, cables, snaps=snaps)
    before = None if earlier is None or not earlier[1] else Motion(given, *earlier)
    return motion, before, worst


@dataclass(frozen=True, eq=False)
class StoredResult:
    """A result folder, read back.

    Args:
        folder: absolute.
        summary: what ``summary.json`` holds.
        motion: (P,), 0 to 1, of the frames.
        cables: the shapes, by name.
    """

    folder: Path
    summary: Mapping[str, Any]
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
