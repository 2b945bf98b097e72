"""A redesign as the command line runs it: told as it goes on, and gone on with where it was interrupted."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness_opt.design import redesign as robust_loop
from harness_opt.design.trade_off import quantities
from harness_opt.errors import Status
from harness_opt.files.result_folder import ASIDE, SUMMARY, read_summary
from harness_opt.studies.workers import Pool, cores

if TYPE_CHECKING:
    from harness_opt.cli.progress import Shown
    from harness_opt.design.result import Earlier, Redesign
    from harness_opt.design.sqp import Step
    from harness_opt.model.problem import Problem

FALLS = 4.0  # times that a step becomes smaller from one iteration to the next, for a guess at the time left
VERIFYING = 4.0  # iterations' worth of time that the verification takes, about
DONE = 1e-3  # of the bounds' ranges: steps end there


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
    pool = Pool(None) if cores() > 1 else None  # its processes start when they are given something
    try:
        result = robust_loop.redesign(
            problem,
            progress=progress.designs(),
            watch=Follower(progress.line, done),
            earlier=earlier,
            pareto=pair,
            executor=pool.executor if pool else None,
            throw=False,
        )
    finally:
        if pool:
            pool.close()
    if result.robust is not None and result.status.ok:
        from harness_opt.studies.yields import with_yields

        result = with_yields(result, progress=progress)
    return result


class Follower:
    """Tells of every iteration of a redesign: worst limit and its margin, step, time left.

    Args:
        tell: shows a line.
        done: iterations of an earlier run that this one goes on from.
    """

    def __init__(self, tell: Callable[[str], None], done: int = 0):
        self._tell, self._done, self._count = tell, done, 0
        self._begin = time.monotonic()

    def __call__(self, step: Step) -> None:
        """Tell of ``step``."""
        self._count += 1
        each = (time.monotonic() - self._begin) / self._count
        more = max(0.0, math.log(max(step.step, DONE) / DONE) / math.log(FALLS))
        self._tell(f"{words(step, self._done + self._count)}, about {each * (more + VERIFYING):.0f} s left")


def words(step: Step, number: int) -> str:
    """Return an iteration in words, without the time.

    Args:
        step: the iteration.
        number: of it, from 1.
    """
    if step.limit is None:
        tightest = "nothing near its limit"
    else:
        kind = step.limit.kind
        amount, unit = step.amount * kind.from_si * kind.unit.factor, kind.unit.name
        margin = f"{amount:.3g} {unit} to spare" if amount >= 0 else f"short by {-amount:.3g} {unit}"
        tightest = f"{step.limit.words} {margin}"
    kept = "" if step.accepted else ", not kept"
    return f"iteration {number} ({step.aim}): {tightest}, step {100 * step.step:.2g} % of the bounds{kept}"


def interrupted(folder: Path, problem: Problem) -> Earlier | None:
    """Return the redesign of the same problem file that was interrupted and left in ``folder``; None without one.

    Beside a result that is whole it lies in a folder of its own, and counts while it is the later of the two.

    Raises:
        OSError: a summary that cannot be read.
    """
    aside = folder.with_name(folder.name + ASIDE)
    places = [place / SUMMARY for place in (folder, aside) if (place / SUMMARY).is_file()]
    if not places:
        return None
    found = read_summary(max(places, key=lambda file: file.stat().st_mtime_ns).parent)
    try:
        return _earlier(found, problem)
    except (KeyError, TypeError, ValueError, AttributeError):  # somebody else's, or damaged: begun anew
        return None


def _earlier(found: dict[str, Any] | None, problem: Problem) -> Earlier | None:
    """Return what the summary of an interrupted redesign of ``problem`` holds; None where it is of something else."""
    from harness_opt.design.limit_keys import limit_keys
    from harness_opt.design.result import Earlier
    from harness_opt.design.sqp import Step

    parts = (Status.INTERRUPTED.name.lower(), Status.TIME_LIMIT.name.lower())
    if (
        found is None
        or found.get("reason") not in parts
        or found.get("problem", {}).get("sha256") != problem.sha256
        or found.get("command") != "redesign"
    ):
        return None
    variables = found["redesign"]["variables"]
    values = {name: float(row["after"]) for name, row in variables.items() if row["after"] is not None}
    if set(values) != {variable.name for variable in problem.design.variables}:
        return None
    named = {str(limit): limit for key in limit_keys(problem) for limit in key.sets}
    steps = found["redesign"].get("history", ())
    return Earlier(values, tuple(Step(**step | {"limit": named.get(step["limit"])}) for step in steps))
