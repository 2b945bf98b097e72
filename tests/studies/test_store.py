"""What a study keeps: it goes on from there, and knows a changed problem from the same."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest

from harness_opt.errors import ProblemError
from harness_opt.studies.store import Store
from harness_opt.studies.study import plan, study
from harness_opt.studies.variant import LOST, VariantResult
from oracles.flap import FLAP
from oracles.studies import (
    LENGTHS,
    Here,
)


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
