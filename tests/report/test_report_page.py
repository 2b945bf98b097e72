"""How a report is laid out: worst first, whole scene first, nothing cut off unmarked, nothing by colour alone."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.report import charts
from harness_opt.report import html_page as html_report
from harness_opt.report import page_rows as report_words
from harness_opt.report.summary import summary
from oracles.browser import opened
from oracles.report_scene import data_of, flap, heights, page_of


def test_what_lies_beyond_the_picture_is_marked():
    values = np.array([5.0, 30.0, 60.0, 50.0, 4.0, 90.0])
    chart = charts.Chart("T", "mm", np.linspace(0, 1, 6), {"": values}, limits=(5.0,), most=False, bounded=True)
    drawn = charts.drawn(chart)
    top = charts.TOP + charts.HEIGHT * 0.06
    assert set(heights(drawn.beyond[""])) == {min(heights(drawn.lines[""]))} and min(heights(drawn.beyond[""])) < top
    at = [float(x) for x in re.findall(r"[ML]([\d.]+) ", drawn.beyond[""])]
    assert at == [charts.place(0.2), charts.place(0.4), charts.place(0.6)], "from 30 over 60 to 50 it is beyond"
    assert len(heights(drawn.lines[""])) == 5, "and the curve goes up to the edge and comes down from it"
    assert drawn.most == "up to 90 mm"


def test_several_curves_have_numbers_as_well_as_colours():
    motion = np.linspace(0, 1, 50)
    drawn = charts.drawn(charts.Chart("T", "mm", motion, {"a": 0 * motion, "b": 1 + motion, "c": 3 - motion}))
    assert [number for _, _, number in drawn.numbers] == ["1", "2", "3"]
    assert len({x for x, _, _ in drawn.numbers}) == 3
    assert charts.drawn(charts.Chart("T", "mm", motion, {"": motion})).numbers == ()


def test_of_many_parts_the_nearest_are_drawn_and_the_others_counted():
    balls = {f"ball{k}": ho.Part(ho.Sphere(0.01), position=(0.08, 0.05 * k, -0.1)) for k in range(12)}
    moved = ho.simulate(flap(parts=balls), frames=[0.0, 1.0])
    measured = ho.clearances(moved)
    first = next(charts.charts(moved, measured, "lead"))
    assert len(first.series) == charts.MOST_SERIES and first.left_out == len(balls) - charts.MOST_SERIES
    worst = {name: values.min() for name, values in first.series.items()}
    others = [1e3 * pair.worst for pair in measured.pairs if pair.obstacle.words("lead") not in worst]
    assert len(others) == first.left_out + 1, "itself, which the cable never comes near, is not counted"
    assert max(worst.values()) <= min(others)


def test_limits_stand_worst_first_by_part_and_what_holds_can_wait(design):
    before = design.motion_before
    parts = {f"ball{k}": ho.Part(ho.Sphere(0.01), position=(0.08, 0.05 * k, -0.1)) for k in range(16)}
    problem = dataclasses.replace(before.problem, parts={**before.problem.parts, **parts})
    content = summary(ho.simulate(problem, frames=[0.0, 1.0]))
    shown, held = report_words.limit_groups(content)
    assert shown[0][0]["group"] == "ball" and shown[0][0]["answer"] == "NO"
    assert len(shown) == report_words.MOST_GROUPS and len(shown) + len(held) == len(content["limits"])
    rows = [rows[0] for rows in (*shown, *held)]
    assert sorted(row["number"] for row in rows) == list(range(len(content["limits"])))
    shares = [report_words._share(content["limits"][row["number"]]) for row in rows if row["holds"] == "yes"]
    assert shares == sorted(shares)
    two = [{**row, "cable": "other"} for row in content["limits"] if row["part"] == "ball"]
    both = report_words.limit_groups({**content, "limits": [*content["limits"], *two]})[0]
    assert [row["cable"] for row in both[0]] == ["lead", "other"], "one part, two cables"


def test_a_redesign_says_so_and_a_cable_keeps_its_colour(design):
    page = page_of(design)
    assert "<title>A flap: redesigned</title>" in page
    before, after = data_of(page)["scenes"]
    assert before["colours"] == after["colours"]


def test_the_view_holds_everything_from_above():
    wall = {"wall": ho.Part(ho.Box((0.02, 4.0, 3.0)), position=(-0.3, 0, 0))}
    data = data_of(page_of(ho.simulate(flap(parts=wall), frames=[0.0, 1.0])))
    hold, near = np.array(data["view"]["hold"]), np.array(data["view"]["near"])
    assert hold.min(axis=0) == pytest.approx([-0.31, -2.0, -1.5], abs=1e-3), "the whole wall"
    assert np.ptp(near, axis=0)[1] < 1.0, "but not where the cables are looked at"
    assert data["view"]["back"][2] > 0.3


def test_inputs_are_told(motion):
    page = page_of(motion)
    for words in (
        "0.002 N m2",
        "0.0015 N m2",
        "50 g/m",
        "(150, 20, 0)",
        "(0, 0, 1)",
        "turns about (0, 1, 0)",
        "20.0 deg",
    ):
        assert words in page, words


def test_parts_are_named_hidden_and_isolated(tmp_path):
    parts = {"ball": ho.Part(ho.Sphere(0.02), position=(0.08, 0, 0)), "slab": ho.Part(ho.Box((0.1, 0.1, 0.01)))}
    moved = ho.simulate(flap(parts=parts), frames=[0.0, 1.0])
    file = tmp_path / html_report.write_page(html_report.prepare(moved), summary(moved), tmp_path)
    with opened(file) as view:
        names = view.page.locator("#labels .name")
        assert set(names.all_inner_texts()) == {"ball", "slab"}
        whole = view.pixels()
        view.choose("[data-only='1']")
        assert names.all_inner_texts() == ["slab"]
        assert view.pixels() != whole
        view.choose("[data-only=all]")
        assert view.pixels() == whole
        view.choose("input[name=names]")
        assert names.count() == 0
        assert view.page.inner_text("#scale").endswith(" mm")
        axis = "document.querySelector('#axes .z').getAttribute('y2')"
        assert float(view.page.evaluate(axis)) < 0, "z points up"
        assert view.said == []


@pytest.mark.parametrize("width", [1280, 400])
def test_nothing_runs_out_of_the_page(design, tmp_path, width):
    file = tmp_path / html_report.write_page(html_report.prepare(design), summary(design), tmp_path)
    with opened(file) as view:
        view.page.set_viewport_size({"width": width, "height": 800})
        view.settle()
        assert view.page.evaluate("document.documentElement.scrollWidth") <= width
        box = view.page.locator("#stage").bounding_box()
        assert box["y"] < 400, "the motion is in the first screen"


def test_the_problem_is_printed_though_it_is_folded(design, tmp_path):
    file = ho.write_report(design, tmp_path / "flap.html")
    with opened(file) as view:
        open_ = "document.querySelector('details.card').open"
        assert not view.page.evaluate(open_)
        view.page.emulate_media(media="print")
        view.page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
        assert view.page.evaluate(open_)
        height = "document.querySelector('details.card pre').getBoundingClientRect().height"
        assert view.page.evaluate(height) > 200
        view.page.evaluate("window.dispatchEvent(new Event('afterprint'))")
        assert not view.page.evaluate(open_)
