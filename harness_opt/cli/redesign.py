"""A redesign as the command line runs it: told as it goes on, and gone on with where it was interrupted."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from harness_opt.cli.redesign_progress import Follower, interrupted
from harness_opt.design import redesign as robust_loop
from harness_opt.design.trade_off import quantities
from harness_opt.studies.yields import with_yields

if TYPE_CHECKING:
    from harness_opt.cli.progress import Shown
    from harness_opt.design.nominal import Redesign
    from harness_opt.model.problem import Problem


def redesigned(problem: Problem, progress: Shown, folder: Path, pareto: str | None = None) -> Redesign:
    """Return the redesign of ``problem``; failures are in its status.

    Args:
        problem: as read.
        progress: told of frames and iterations.
        pareto: two quantities to trade, as ``length,clearance``.
        folder: of the results; an interrupted redesign of the same file in it is gone on with.

    Raises:
        ProblemError: as :func:`harness_opt.redesign`.
    """
    pair = None if pareto is None else quantities(pareto)
    earlier = interrupted(folder, problem)
    done = 0 if earlier is None else len(earlier.history)
    if earlier is not None:
        progress.line(f"Going on from the redesign interrupted in {folder}, after {done} iterations.")
    result = robust_loop.redesign(
        problem, progress=progress, watch=Follower(progress.line, done), earlier=earlier, pareto=pair, throw=False
    )
    if result.robust is not None and result.status.ok:
        result = with_yields(result, progress=progress)
    return result
