"""Studies: every variant is a row, with a reason where it failed, and a table holds them all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.clearance.limits import all_limits
from harness_opt.parts.scene import load_scene
from harness_opt.studies.study import study
from harness_opt.studies.table import columns, csv_text, facts, write_tables
from harness_opt.studies.variant import VariantResult
from oracles.flap import FLAP, HIT
from oracles.studies import (
    LENGTHS,
    Here,
)

# --- rows -----------------------------------------------------------------------------------------------


def test_a_row_is_what_simulate_finds(problem):
    found = sorted(study(problem, LENGTHS, executor=Here()), key=lambda result: result.number)
    for result, values in zip(found, LENGTHS, strict=True):
        text = FLAP.replace("length = 0.3\n", f"length = {values['cables.lead.length']}\n")
        Path("one.toml").write_text(text)
        one = ho.read_problem("one.toml")
        motion = ho.simulate(one)
        peer = all_limits(one, motion, ho.clearances(motion, load_scene(one)))
        assert result.margins == {str(row.id): row.margin for row in peer if np.isfinite(row.worst)}, "to the last bit"
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
