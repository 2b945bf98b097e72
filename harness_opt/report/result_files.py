"""The result folder: summary, shapes, the redesigned problem; pictures and page by whoever draws them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from harness_opt.clearance.measure import clearances
from harness_opt.clearance.pairs import ClearanceResult
from harness_opt.errors import ProblemError
from harness_opt.files.arrays import write_arrays
from harness_opt.files.read import write_problem
from harness_opt.files.result_folder import SUMMARY, replacing
from harness_opt.files.stored_results import GIVEN, REDESIGNED
from harness_opt.files.summary import Command, Summary
from harness_opt.model.problem import input_files
from harness_opt.model.results import Motion
from harness_opt.numerics.threads import one_at_a_time
from harness_opt.parts.scene import Scene, load_scene
from harness_opt.parts.used import write_used
from harness_opt.report.data_sheet import cut_list, cut_list_text
from harness_opt.report.summary import _asked, as_json, summary, timed

if TYPE_CHECKING:
    from harness_opt.design.result import Redesign


CUT_LIST = "cut_list.csv"

Pictures = Callable[["Motion | Redesign", Path], Iterable[str]]


Page = Callable[[Summary, Path], str]  # writes a report of a summary into a folder


@one_at_a_time
def write_results(
    result: Motion | Redesign,
    folder: str | Path,
    *,
    measured: ClearanceResult | None = None,
    command: Command | None = None,
    pictures: Pictures | None = None,
    page: Page | None = None,
    scene: Scene | None = None,
) -> Summary:
    """Write the result folder, complete or not at all, and return its summary.

    It holds ``summary.json`` and ``motion.npz``; for a redesign also ``redesigned.toml`` and ``before.npz``,
    the motion of the design given. In ``used`` lie the problem and the parts that it was made with. An earlier result
    of harness-opt in the same place is replaced.

    Args:
        result: of a simulation or a redesign.
        folder: to write; its parents are made.
        measured, command: as in :func:`summary`.
        pictures: draws a result into a folder and returns the names of the files; None draws none.
        page: writes a report of the summary into a folder and returns the name of its file; None writes none.
        scene: the parts; None loads them.

    Raises:
        ProblemError: ``folder`` holds something else, or cannot be written; a mesh that cannot be used.
    """
    given = _asked(result)
    scene = load_scene(given) if scene is None else scene
    if isinstance(result, Motion) and measured is None:
        measured = clearances(result, scene)
    problems = {GIVEN: given}
    with replacing(Path(folder), input_files(given)) as aside:
        if isinstance(result, Motion):
            _write_arrays(aside / "motion.npz", result)
        else:
            _write_arrays(aside / "motion.npz", result.motion)
            _write_arrays(aside / "before.npz", result.motion_before)
            write_problem(result.problem, aside / "redesigned.toml")
            problems[REDESIGNED] = result.problem
            if result.trade_off is not None:
                from harness_opt.report.trade_off_files import write_trade_off

                write_trade_off(result.trade_off, aside)
        marks = cut_list(result.problem)
        if marks:
            (aside / CUT_LIST).write_text(cut_list_text(marks), encoding="utf-8")
        write_used(aside, problems, scene)
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


def _write_arrays(file: Path, motion: Motion) -> None:
    try:
        write_arrays(file, motion.motion, motion.cables, motion.problem.found)
    except ValueError as error:
        raise ProblemError(f"{file.name}: found {error}, expected none: nothing was written") from error
