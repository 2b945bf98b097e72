"""Workers: the same rows on any executor, none lost with a worker, and little spent beside the simulations."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from harness_opt.errors import HarnessError
from harness_opt.model.design import Tolerance
from harness_opt.studies.study import plan, study
from harness_opt.studies.variant import run_variant
from harness_opt.studies.variations import Variations
from harness_opt.studies.workers import Crew
from oracles.studies import (
    LENGTHS,
    Here,
    collected,
    fatal,
    fatal_once,
    squared,
)


def test_a_lost_worker_costs_no_task(tmp_path):
    tasks = [(number, str(tmp_path)) for number in range(12)]
    assert collected(Crew(fatal_once, workers=2).run(tasks)) == {n: n * n for n in range(12)}
    assert (tmp_path / "died").exists()


def test_a_task_that_kills_every_worker_is_the_only_one_lost():
    found = collected(Crew(fatal, workers=2).run([(number,) for number in range(8)]))
    assert type(found.pop(3)).__name__ == "BrokenProcessPool"
    assert found == {n: n * n for n in range(8) if n != 3}


def test_the_standard_executors_do(problem):
    with ThreadPoolExecutor(2) as threads:
        assert collected(Crew(squared, threads).run([(n,) for n in range(5)])) == {n: n * n for n in range(5)}
        found = list(study(problem, LENGTHS, executor=threads))
    assert {result.status for result in found} == {"ok"}


def test_an_executor_that_has_ended_is_an_error():
    threads = ThreadPoolExecutor(1)
    threads.shutdown()
    with pytest.raises(HarnessError, match="the workers are gone"):
        list(Crew(squared, threads).run([(1,)]))


def test_a_stop_waits_for_what_runs_and_begins_nothing():
    asked = iter([False, False, True])
    done = list(Crew(squared, Here(), stop=lambda: next(asked, True)).run((n,) for n in range(5000)))
    assert 0 < len(done) < 5000


def test_processes_give_the_same_rows_as_this_one(problem):
    mine = {r.number: r for r in study(problem, LENGTHS, executor=Here())}
    for result in study(problem, LENGTHS, workers=2):
        peer = mine.pop(result.number)
        assert (result.margins, result.worst, result.key) == (peer.margins, peer.worst, peer.key)
    assert not mine


def test_a_variant_costs_little_more_than_its_simulation(problem, monkeypatch):
    """Less than 10 ms: the processor time of a variant less that spent within ``simulate`` and ``clearances``."""
    from harness_opt.studies import variant as variant_run

    inside = []

    def timed(function):
        def call(*arguments: object, **options: object) -> object:
            begin = time.process_time()
            try:
                return function(*arguments, **options)
            finally:
                inside.append(time.process_time() - begin)

        return call

    monkeypatch.setattr(variant_run, "simulate", timed(variant_run.simulate))
    monkeypatch.setattr(variant_run, "clearances", timed(variant_run.clearances))
    planned = plan(problem, Variations("monte carlo", {"cables.lead.length": Tolerance(0.01)}, 5))
    spent = []
    for number, values in enumerate(planned.variants):
        inside.clear()
        begin = time.process_time()
        assert run_variant(planned.shared, number, values).ok
        spent.append(time.process_time() - begin - sum(inside))
        assert len(inside) == 2
    assert min(spent[1:]) < 0.010  # the least disturbed; the first reads the problem
