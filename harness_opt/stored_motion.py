"""A motion read back from a result folder, with the problem it belongs to: for whoever draws or exports it."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np

from .errors import HarnessError
from .problem_file import read_problem
from .results import CableMotion, Motion, Snap
from .rotations import Array

KEPT = ("s", "position", "quaternion", "curvature", "force", "moment")  # of a cable, in every motion.npz
EXTRA = ("stable", "stability_margin", "residual", "estimated_error")  # in those that harness-opt writes


def read_motion(folder: str | os.PathLike[str]) -> tuple[Motion, Motion | None, float]:
    """Return the motion that a result folder holds, that of the design before, and where the tightest limit stands.

    The latter from 0 to 1; the one before is None where nothing was redesigned. What ``motion.npz`` need not keep of
    a cable, its stability and errors, is NaN.

    Raises:
        HarnessError: files are missing, or are not what ``harness-opt`` writes.
        ProblemError: the problem file can't be read any more.
    """
    folder = Path(folder)
    try:
        summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
        arrays = _arrays(folder / "motion.npz")
        earlier = _arrays(folder / "before.npz") if (folder / "before.npz").is_file() else None
        source, rows = summary["problem"]["file"], [r for r in summary["limits"] if r["margin"] is not None]
        tight = min(rows, key=lambda r: r["margin"] / (abs(r["limit"]) or 1.0), default={"motion": 0.0})
        cables = _cables(arrays)
        cables_before = None if earlier is None else _cables(earlier)
    except OSError as error:
        raise HarnessError(f"{folder}: found no {error.filename or error}, expected a result folder") from error
    except (ValueError, KeyError, TypeError) as error:
        raise HarnessError(f"{folder}: found a damaged result ({error!r}), expected a whole one") from error
    if source is None:
        raise HarnessError(f"{folder}: found no name of a problem file, expected one to know the parts by")
    given = read_problem(folder / source)
    redesigned = folder / "redesigned.toml"
    problem = read_problem(redesigned) if redesigned.is_file() else given
    if set(cables) != set(problem.cables) or not len(arrays["motion"]):
        raise HarnessError(f"{folder}: found shapes of {sorted(cables)}, expected {sorted(problem.cables)}")
    snaps = tuple(Snap(**snap) for snap in summary.get("snaps", ()))
    motion = Motion(problem, arrays["motion"], cables, snaps=snaps)
    before = None if earlier is None or not cables_before else Motion(given, earlier["motion"], cables_before)
    return motion, before, float(tight["motion"])


def _arrays(file: Path) -> dict[str, Array]:
    with np.load(file, allow_pickle=False) as stored:
        return dict(stored)


def _cables(arrays: dict[str, Array]) -> dict[str, CableMotion]:
    """Return the shapes by name; what is not kept of them is NaN."""
    unknown = np.full(len(arrays["motion"]), np.nan)
    return {
        name: CableMotion(
            *(arrays[f"{name}/{key}"] for key in KEPT), *(arrays.get(f"{name}/{key}", unknown) for key in EXTRA)
        )
        for name in (key.removesuffix("/position") for key in arrays if key.endswith("/position"))
    }
