"""A study: many variants of one problem, simulated or redesigned, each a row, on any executor.

Variants know nothing of each other, and each is named by the content of what it depends on; so a study that was killed
goes on where it was, and it does not matter which worker runs what.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from harness_opt.errors import ProblemError
from harness_opt.files.quantities import Quantities, quantities_of
from harness_opt.model.checks import one_of, shown
from harness_opt.model.problem import Problem
from harness_opt.studies.shared_problem import COMMANDS, Command, Shared
from harness_opt.studies.store import Store
from harness_opt.studies.variant import LOST, VariantResult, variant_runner
from harness_opt.studies.variations import Values, Variations, expand
from harness_opt.studies.workers import Crew, Finished


@dataclass(frozen=True)
class Plan:
    """A study before it runs.

    Args:
        quantities: of the problem.
        variants: the varied values of each, in order.
        shared: what all of them share.
        keys: what names each.
    """

    quantities: Quantities
    variants: tuple[Values, ...]
    shared: Shared
    keys: tuple[str, ...]


def plan(
    problem: Quantities | Problem | str | os.PathLike[str],
    variations: Variations | Iterable[Mapping[str, Any]],
    command: Command = "simulate",
) -> Plan:
    """Return the variants of a problem, all that can be checked beforehand checked; see :func:`study`."""
    if command not in COMMANDS:
        raise ProblemError(f"command: found {shown(command)}, expected {one_of(COMMANDS, command)}")
    if not isinstance(variations, Variations):
        variations = Variations("list", variants=tuple(variations))
    quantities = problem if isinstance(problem, Quantities) else quantities_of(problem)
    variants = tuple(expand(quantities, variations))
    shared = Shared.of(quantities, variants, command)
    return Plan(quantities, variants, shared, tuple(shared.key(values) for values in variants))


def study(
    problem: Problem | str | os.PathLike[str],
    variations: Variations | Iterable[Mapping[str, Any]],
    *,
    command: Command = "simulate",
    executor: Executor | None = None,
    workers: int | None = None,
    store: str | os.PathLike[str] | None = None,
    stop: Callable[[], bool] | None = None,
) -> Iterator[VariantResult]:
    """Return an iterator over the results of all variants, as they finish; those that the store has come first.

    In a script, call it under ``if __name__ == "__main__":``, as all that starts processes.

    Args:
        problem: or the path of its file.
        variations: what to vary, and how; or the values of each variant, by key.
        command: "simulate" or "redesign".
        executor: where to run, such as ``dask.distributed.Client(...).get_executor(pure=False)``: harness-opt must be
            installed there, and the problem's files lie at the same paths. None starts processes of its own.
        workers: processes to start; None takes all cores.
        store: an SQLite file that keeps what is finished; a study started again goes on from it.
        stop: asked before a variant is handed out; once it says True, only what runs is waited for.

    Raises:
        ProblemError: at once: an unknown key, values that no problem can have, a store in use, a problem with mistakes.
        HarnessError: while iterating: the workers of ``executor`` are gone; what was finished is in the store.
    """
    planned = plan(problem, variations, command)
    return run(planned, Crew(variant_runner(), executor, workers, stop), Store(None if store is None else Path(store)))


def run(planned: Plan, crew: Crew, store: Store) -> Iterator[VariantResult]:
    """Return an iterator over the results of a plan; closes the store when it ends. See :func:`study`."""
    numbers: dict[str, list[int]] = {}
    for number, key in enumerate(planned.keys):
        numbers.setdefault(key, []).append(number)

    def every(result: VariantResult) -> Iterator[VariantResult]:
        """Yield a result for each variant with the same values."""
        for number in numbers[result.key]:
            yield dataclasses.replace(result, number=number, values=planned.variants[number])

    def iterate() -> Iterator[VariantResult]:
        with store:
            known = store.found(numbers)
            for result in known.values():
                yield from every(result)
            missing = (same[0] for key, same in numbers.items() if key not in known)
            tasks = ((planned.shared, number, planned.variants[number]) for number in missing)
            for finished in crew.run(tasks):
                result = _result(finished, planned)
                store.keep([result])
                yield from every(result)

    return iterate()


def _result(finished: Finished, planned: Plan) -> VariantResult:
    (_, number, values), outcome = finished
    if isinstance(outcome, VariantResult):
        return outcome
    return VariantResult(number, planned.keys[number], values, LOST, f"{type(outcome).__name__}: {outcome}")
