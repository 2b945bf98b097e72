"""The share of what is built that holds its limits, by simulating samples of the tolerances on all cores."""

from __future__ import annotations

import dataclasses
import math
from concurrent.futures import Executor

import numpy as np

from harness_opt.design.key_derivatives import linear
from harness_opt.design.result import Redesign
from harness_opt.design.robustness import Yield, smallest
from harness_opt.files.quantities import quantities_of
from harness_opt.model.design import Robust
from harness_opt.model.problem import Problem
from harness_opt.motion.follower import Progress
from harness_opt.parts.scene import load_scene
from harness_opt.studies.store import Store
from harness_opt.studies.study import plan, run
from harness_opt.studies.variant import variant_runner
from harness_opt.studies.variations import Variations
from harness_opt.studies.workers import Crew

SOLVED = ("ok", "violated", "uncertain")


def with_yields(result: Redesign, *, executor: Executor | None = None, progress: Progress | None = None) -> Redesign:
    """Return a redesign within tolerances with its yields, before and after, by Monte Carlo.

    Args:
        result: of :func:`harness_opt.redesign`, of a problem with tolerances.
        executor: where to simulate, as in :func:`harness_opt.study`.
        progress: called with a word, samples done and samples in all.

    Raises:
        ProblemError: tolerances that no problem can have.
    """
    robust, told = result.original.robust, result.robust
    if robust is None or told is None or not robust.samples:
        return result
    before = None if told.before is None else measured(result.original, robust, executor, progress, "before")
    after = None if told.after is None else measured(result.problem, robust, executor, progress, "after")
    return dataclasses.replace(result, robust=dataclasses.replace(told, yield_before=before, yield_after=after))


def measured(
    problem: Problem,
    robust: Robust,
    executor: Executor | None = None,
    progress: Progress | None = None,
    words: str = "samples",
) -> Yield:
    """Return the yield of a design by simulated samples of its tolerances, and by linearised margins of the same.

    Args:
        problem: the design.
        robust: its tolerances, and how many samples.
        executor, progress: as in :func:`with_yields`.
        words: that progress is called with.

    Raises:
        SolveError: the nominal design cannot be simulated.
    """
    variations = Variations("monte carlo", dict(robust.tolerances), robust.samples, robust.seed)
    planned = plan(problem, variations)
    results = []
    for result in run(planned, Crew(variant_runner(), executor), Store(None)):
        results.append(result)
        if progress is not None:
            progress(f"tolerances, {words}", len(results), robust.samples)
    keys = list(robust.tolerances)
    found = linear(quantities_of(problem), keys, load_scene(problem))
    nominal = np.array([quantity.value for quantity in found.quantities])
    deviations = np.array([[values[key] for key in keys] for values in planned.variants]) - nominal
    share = sum(result.ok for result in results) / len(results)
    return Yield(
        share,
        len(results),
        math.sqrt(share * (1.0 - share) / len(results)),
        sum(result.status not in SOLVED for result in results),
        float(np.mean(np.all(smallest(found, deviations) >= 0, axis=0))),
    )
