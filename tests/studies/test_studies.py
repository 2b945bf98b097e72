"""Studies: every variant a row, the same on any executor, through kills, lost workers and interrupts."""

from __future__ import annotations

import json
import os
import random
import signal
import sqlite3
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.clearance.limits import all_limits
from harness_opt.cli.commands import main
from harness_opt.errors import HarnessError, ProblemError
from harness_opt.model.tolerances import Tolerance
from harness_opt.parts.scene import load_scene
from harness_opt.studies.store import Store
from harness_opt.studies.study import plan, study
from harness_opt.studies.table import columns, csv_text, facts, write_tables
from harness_opt.studies.variant import LOST, VariantResult, label, run_variant
from harness_opt.studies.variations import Variations
from harness_opt.studies.workers import Crew
from oracles.flap import FLAP, HIT, run, strict
from oracles.studies import STUDY, Here, alive, collected, fatal, fatal_once, gone, placed, rows, squared, started

LENGTHS = [{"cables.lead.length": length} for length in (0.3, 0.29, 0.31)]


@pytest.fixture
def problem(here) -> ho.Problem:
    (here / "flap.toml").write_text(FLAP)
    return ho.read_problem("flap.toml")


# --- rows -----------------------------------------------------------------------------------------------


def test_a_row_is_what_simulate_finds(problem):
    found = sorted(study(problem, LENGTHS, executor=Here()), key=lambda result: result.number)
    for result, values in zip(found, LENGTHS, strict=True):
        text = FLAP.replace("length = 0.3\n", f"length = {values['cables.lead.length']}\n")
        Path("one.toml").write_text(text)
        one = ho.read_problem("one.toml")
        motion = ho.simulate(one)
        peer = all_limits(one, motion, ho.clearances(motion, load_scene(one)))
        assert result.margins == {label(row): row.margin for row in peer}, "to the last bit"
        assert result.values == values
        assert (result.status, result.frames, result.stable) == ("ok", len(motion.motion), True)
        assert result.worst_limit == min(result.margins, key=lambda name: result.margins[name] / _scale(name))


def _scale(name: str) -> float:
    return {"clearance.lead.ball": 0.0065, "clearance.lead.cable:lead": 0.0065, "bend_radius.lead": 0.01}[name]


def test_problems_in_no_file_and_changed_ones_are_studied_as_they_are(problem):
    import dataclasses

    changed = dataclasses.replace(problem, gravity=(0.0, 0.0, -1.62))
    (moon,) = study(changed, [{"cables.lead.length": 0.3}], executor=Here())
    (peer,) = study(problem, [{"gravity.z": -1.62}], executor=Here())
    (earth,) = study(problem, [{}], executor=Here())
    assert moon.margins == pytest.approx(peer.margins, rel=1e-9)
    assert moon.margins != pytest.approx(earth.margins, rel=1e-3)


def test_failures_are_rows_with_reasons(problem, monkeypatch):
    from harness_opt.studies import variant as variant_run

    def simulate(problem: ho.Problem, **options: object) -> ho.Motion:
        if problem.cables["lead"].cable.length == 0.31:
            raise ZeroDivisionError("a mistake of ours")
        return ho.simulate(problem, **options)

    monkeypatch.setattr(variant_run, "simulate", simulate)
    lengths = [0.3, 0.1, 0.31, 0.29]
    found = list(study(problem, [{"cables.lead.length": length} for length in lengths], executor=Here()))
    assert [result.status for result in found] == ["ok", "refused", "failed", "ok"]
    assert found[1].reason.startswith("cables.lead.length: found 0.1, expected at least 0.")
    assert found[2].reason == "ZeroDivisionError: a mistake of ours"
    table = columns(found)
    assert table["margin.bend_radius.lead"][1:3] == [None, None]
    assert table["reason"][1] == found[1].reason


def test_a_cable_that_cannot_be_followed_is_a_row(problem, monkeypatch):
    from harness_opt.errors import Status
    from harness_opt.studies import variant as variant_run

    def simulate(problem: ho.Problem, **_: object) -> ho.Motion:
        return ho.Motion(problem, np.zeros(0), {}, Status.NO_START, "cable lead: no shape")

    monkeypatch.setattr(variant_run, "simulate", simulate)
    (found,) = study(problem, [{}], executor=Here())
    assert (found.status, found.reason, found.worst_limit, found.stable) == (
        "unsolved",
        "cable lead: no shape",
        None,
        False,
    )
    assert facts([found], 1)["yield"] == 0.0


def test_a_worker_of_another_version_says_so(problem, monkeypatch):
    from harness_opt.studies import variant as variant_run

    monkeypatch.setattr(variant_run, "version", lambda: "0.0.1")
    (found,) = study(problem, [{}], executor=Here())
    assert found.status == "refused"
    assert "found harness-opt 0.0.1 on this worker, expected 0.1.0" in found.reason


def test_equal_variants_run_once_and_have_a_row_each(problem):
    executor = Here()
    found = list(study(problem, [LENGTHS[0], LENGTHS[1], LENGTHS[0]], executor=executor))
    assert executor.count == 2
    assert sorted(result.number for result in found) == [0, 1, 2]


def test_redesigned_variants(here):
    (here / "flap.toml").write_text(HIT)
    variants = [{"parts.ball.position.y": y} for y in (0.01, 0.012)]
    found = sorted(study("flap.toml", variants, command="redesign", executor=Here()), key=lambda r: r.number)
    assert [result.status for result in found] == ["ok", "ok"]
    for result, y in zip(found, (0.01, 0.012), strict=True):
        assert min(result.margins.values()) >= 0
        length = result.after["lead.length"]
        text = HIT.replace("length = 0.3\n", f"length = {length!r}\n").replace("[0.08, 0.01,", f"[0.08, {y},")
        Path("one.toml").write_text(text)
        motion = ho.simulate(ho.read_problem("one.toml"))
        assert min(row.margin for row in ho.clearances(motion).limits) >= 0, "a simulation of the file agrees"
    assert "after.lead.length" in columns(found)


# --- tables ---------------------------------------------------------------------------------------------


def test_tables(here):
    found = [
        VariantResult(1, "b", {"x": [1, 2], "mesh": "a.stl"}, "refused", "why, oh why"),
        VariantResult(0, "a", {"x": 0.1, "mesh": "b.stl"}, "ok", margins={"clearance.lead.ball": 1e-3}, worst={}),
    ]
    assert csv_text(columns(found)) == (
        "number,x,mesh,status,reason,worst_limit,worst_margin,margin.clearance.lead.ball,frames,snaps,stable\n"
        "0,0.1,b.stl,ok,,,,0.001,0,0,false\n"
        '1,"[1, 2]",a.stl,refused,"why, oh why",,,,0,0,false\n'
    )
    content = facts(found, 2)
    assert content["yield"] == 0.5
    assert content["counts"] == {"ok": 1, "refused": 1}
    assert content["limits"] == [
        {"name": "clearance.lead.ball", "held": 1.0, "smallest": 1e-3, "tenth": 1e-3, "median": 1e-3, "variant": 0}
    ]


def test_parquet_holds_what_csv_does(here):
    parquet = pytest.importorskip("pyarrow.parquet")
    found = [
        VariantResult(i, str(i), {"x": x}, "ok", margins={"bend_radius.lead": 0.1 * i}) for i, x in enumerate((1, 2.5))
    ]
    assert write_tables(here, found) == ["variants.csv", "variants.parquet"]
    assert parquet.read_table(here / "variants.parquet").to_pydict() == columns(found)


# --- the store ------------------------------------------------------------------------------------------


def test_a_study_goes_on_from_its_store(problem):
    first = dict(enumerate(study(problem, LENGTHS[:2], executor=Here(), store="kept.sqlite")))
    executor = Here()
    found = list(study(problem, [LENGTHS[2], *LENGTHS[:2]], executor=executor, store="kept.sqlite"))
    assert executor.count == 1
    assert {result.number for result in found} == {0, 1, 2}
    known = next(result for result in found if result.number == 1)
    assert known.margins == first[0].margins and known.values == LENGTHS[0]


def test_what_a_result_depends_on_names_it(problem, here):
    keys = {plan(problem, [LENGTHS[0]]).keys, plan(problem, [LENGTHS[1]]).keys}
    keys |= {plan(problem, [LENGTHS[0]], "redesign").keys}
    (here / "flap.toml").write_text(FLAP.replace("to_deg = 20", "to_deg = 21"))
    keys |= {plan("flap.toml", [LENGTHS[0]]).keys}
    assert len(keys) == 4
    (here / "flap.toml").write_text("# the same, in other words\n" + FLAP)
    keys |= {plan("flap.toml", [LENGTHS[0]]).keys}
    assert len(keys) == 4


def test_a_changed_mesh_is_another_problem(folder):
    from oracles.problem_files import CONTRACT, written

    file = written(folder, CONTRACT)
    before = plan(file, [LENGTHS[0] | {"cables.lead.length": 0.43}]).keys
    mesh = folder / "meshes" / "housing.stl"
    mesh.write_bytes(mesh.read_bytes() + b" ")
    assert plan(file, [LENGTHS[0] | {"cables.lead.length": 0.43}]).keys != before


def test_what_was_lost_with_its_worker_is_tried_again(problem):
    executor = Here()
    (key,) = plan(problem, [LENGTHS[0]]).keys
    with Store(Path("kept.sqlite")) as store:
        store.keep([VariantResult(0, key, LENGTHS[0], LOST, "BrokenProcessPool")])
        assert store.found([key]) == {}
    (found,) = study(problem, [LENGTHS[0]], executor=executor, store="kept.sqlite")
    assert executor.count == 1 and found.status == "ok"


def test_one_study_at_a_time(here, monkeypatch):
    from harness_opt.studies import store as study_store

    monkeypatch.setattr(study_store, "WAIT", 0.01)
    with (
        Store(Path("kept.sqlite")),
        pytest.raises(ProblemError, match=r"kept\.sqlite: found a study that is running"),
    ):
        Store(Path("kept.sqlite"))
    Store(Path("kept.sqlite")).close()


def test_a_store_that_is_none(here):
    Path("text").write_text("no database, and long enough to be looked at as one" * 20)
    with sqlite3.connect("other.sqlite") as other:
        other.execute("CREATE TABLE mine (x)")
    other.close()
    for name in ("text", "other.sqlite", "."):
        with pytest.raises(ProblemError, match=f"{name}: found no way to use it"):
            Store(Path(name))
    with sqlite3.connect("other.sqlite") as other:
        assert other.execute("SELECT count(*) FROM mine").fetchone() == (0,), "left as it was"
    other.close()


# --- workers --------------------------------------------------------------------------------------------


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


# --- the command ----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def alone(tmp_path_factory) -> tuple[bytes, dict]:
    """The table of the study, run without a break, and its summary."""
    folder = tmp_path_factory.mktemp("alone")
    placed(folder)
    done = run("study", "study.toml", "--json", "-q", cwd=folder)
    assert done.returncode == 1, done.stderr
    return (folder / "results/study/variants.csv").read_bytes(), strict(done.stdout)


def test_the_command(alone):
    table, summary = alone
    assert summary["status"] == "violated" and summary["finished"] == summary["variants"] == 8
    assert sum(summary["counts"].values()) == 8
    assert 0 < summary["yield"] < 1
    assert table.count(b"\n") == 9


def test_killed_at_random_moments_and_started_again(here, alone):
    file = placed(here)
    moments = random.Random(11)
    for _ in range(10):
        process = started("study", file.name, "-q", cwd=here)
        store = here / "results/study/study.sqlite"
        end = time.monotonic() + moments.uniform(0.2, 6.0)
        while time.monotonic() < end and process.poll() is None:
            time.sleep(0.01)
        process.kill()  # nothing where it has ended by itself
        process.communicate()
        assert gone(process.pid, 20.0), "no worker outlives its study"
        assert not (here / "results/study/summary.json").exists() or store.exists()
    done = run("study", file.name, "-q", cwd=here)
    assert done.returncode == 1, done.stderr
    assert (here / "results/study/variants.csv").read_bytes() == alone[0]


def test_a_killed_worker(here, alone):
    file = placed(here)
    process = started("study", file.name, "--workers", "2", cwd=here)
    while len(alive(process.pid)) < 3:  # the study, and its workers
        assert process.poll() is None
        time.sleep(0.02)
    while not (store := here / "results/study/study.sqlite").exists() or store.stat().st_size < 8192:
        time.sleep(0.02)
    victim = max(alive(process.pid))
    assert victim != process.pid
    os.kill(victim, signal.SIGKILL)
    output, _ = process.communicate()
    assert process.returncode == 1, output
    assert (here / "results/study/variants.csv").read_bytes() == alone[0]


def test_an_interrupt_keeps_what_is_finished(here, alone):
    file = placed(here)
    process = started("study", file.name, "--workers", "1", cwd=here)
    assert process.stdout is not None
    for line in process.stdout:
        if "1 of 8" in line:
            break
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the workers too
    output, _ = process.communicate()
    assert process.returncode == 130, output
    assert "Traceback" not in output and "is kept" in output
    kept = rows(here / "results/study")
    assert 0 < len(kept) < 8
    assert json.loads((here / "results/study/summary.json").read_text())["finished"] == len(kept)
    assert run("study", file.name, "-q", cwd=here).returncode == 1
    assert (here / "results/study/variants.csv").read_bytes() == alone[0]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"cables.lead.length"', '"cables.lead.lenght"', "did you mean 'cables.lead.length'?"),
        ("plus_minus = 0.01", "plus_minus = 0.4", "distribution from -0.1"),
        ('"flap.toml"', '"flop.toml"', "no such file"),
    ],
)
def test_bad_input_is_refused_at_once_and_writes_nothing(here, capsys, old, new, words):
    file = placed(here, STUDY.replace(old, new))
    assert main(["study", str(file)]) == 2
    out, err = capsys.readouterr()
    assert words in err and not out
    assert sorted(os.listdir(here)) == ["flap.toml", "study.toml"]


def test_a_folder_of_something_else_is_refused(here, capsys):
    file = placed(here)
    assert main(["simulate", "flap.toml", "--no-pictures", "-q", "-o", "out"]) == 0
    assert main(["study", str(file), "-o", "out"]) == 2
    assert "out: found the results of another command" in capsys.readouterr().err
    (here / "mine").mkdir()
    (here / "mine" / "letter.txt").write_text("Dear")
    assert main(["study", str(file), "-o", "mine"]) == 2
    assert "found files that are no result" in capsys.readouterr().err
