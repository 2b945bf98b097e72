"""The verdict is never falsely green: what holds is certain to, through the motion, near clamps and under any name."""

from __future__ import annotations

import csv
import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.clearance.limits import all_limits
from harness_opt.cli.commands import main
from harness_opt.model.limits import LimitKind
from harness_opt.model.results import LimitResult
from harness_opt.report.summary import summary
from oracles.problems import ROOT

CASES = ROOT / "tests" / "reference" / "verdict"


def rows_of(name: str) -> dict[str, LimitResult]:
    motion = ho.simulate(ho.read_problem(CASES / f"{name}.toml"))
    return {str(row.id): row for row in all_limits(motion.problem, motion, ho.clearances(motion))}


# --- between frames -------------------------------------------------------------------------------------


def test_a_heavy_wire_meets_a_rod_between_two_frames():
    """In the frames the wire stays clear of it by 2 mm; on twenty times the frames it is 1.4 mm deep."""
    row = rows_of("heavy_wire")["clearance.c.rod"]
    assert row.holds == "no" and row.certified
    assert row.worst == pytest.approx(-1.44e-3, abs=1e-4)


def test_bend_radius_and_loads_between_frames_against_many_frames():
    """A cable that swings from one side to the other: its sharpest bend lies between coarse frames."""
    cable = ho.Cable(0.4, 0.005, 2e-3, 1.5e-3, 0.05)
    run = ho.CableRun(
        cable,
        ho.End(position=(0, 0, 0), quaternion=(1, 0, 0, 0)),
        ho.End(position=(0.12, 0, 0.1), quaternion=(0, 1, 0, 0), body="arm"),
    )
    arm = ho.Body(ho.Slide((1.0, 0.0, 0.4), -0.06, 0.09))
    limits = ho.Limits(bend_radius=0.01, twist=30.0, clamp_force=5.0, clamp_moment=1.0)
    problem = ho.Problem({"lead": run}, {"arm": arm}, gravity=(0, 0, -9.81), limits=limits)
    coarse = ho.simulate(problem, frames=np.linspace(0, 1, 7))
    fine = ho.simulate(problem, frames=np.linspace(0, 1, 301)).cables["lead"]
    found = {row.id.kind: row for row in ho.clearances(coarse).cable_limits}
    loads = {
        LimitKind.CLAMP_FORCE: np.linalg.norm(fine.force[:, [0, -1]], axis=-1).max(),
        LimitKind.CLAMP_MOMENT: np.linalg.norm(fine.moment[:, [0, -1]], axis=-1).max(),
        LimitKind.TWIST: np.abs(fine.curvature[..., 2]).max(),
        LimitKind.BEND_RADIUS: 1.0 / np.linalg.norm(fine.curvature[..., :2], axis=-1).max(),
    }
    for kind, true in loads.items():
        row = found[kind]
        beyond = row.worst - true if kind.is_least else true - row.worst
        assert row.certified
        assert beyond <= row.tolerance + 1e-9 * abs(true), kind


# --- what counts ----------------------------------------------------------------------------------------


def test_a_panel_at_the_clamp_is_gone_through():
    row = rows_of("panel_at_the_clamp")["clearance.a.panel"]
    assert row.holds == "no"
    assert row.worst == pytest.approx(-6.5e-3, abs=2e-4), "half the panel and the radius"


def test_spans_that_share_a_clip_do_not_collide_there():
    row = rows_of("two_spans_at_a_clip")["clearance.a.cable:b"]
    assert row.holds == "yes"
    # a point at the clip against one a hairpin's arc away: the arc less two radii, as the spans run straight through
    assert row.worst == pytest.approx(np.pi / 2 * 0.014 - 0.010, abs=1e-4)


def test_a_cable_that_never_comes_near_itself_says_no_number():
    row = rows_of("itself")["clearance.a.cable:a"]
    assert row.holds == "yes" and row.worst == np.inf
    motion = ho.simulate(ho.read_problem(CASES / "itself.toml"))
    (entry,) = summary(motion)["limits"]
    assert (entry["worst"], entry["margin"], entry["holds"]) == (None, None, "yes")


@pytest.mark.parametrize(
    ("position", "given", "answer"),
    [
        pytest.param((0.0, 0.0, -0.011), {}, "yes", id="the block below the clamp holds it"),
        pytest.param((0.0, 0.0, -0.011), {"holders": ()}, "no", id="unless the file says that nothing does"),
        pytest.param((0.009, 0.0, 0.012), {}, "no", id="a block beside the way is no holder"),
    ],
)
def test_holders_alone_are_let_off(position, given, answer):
    cable = ho.Cable(0.3, 0.004, 2e-3, 1.5e-3)
    start = ho.End(position=(0, 0, 0), quaternion=(1, 0, 0, 0), **given)
    run = ho.CableRun(cable, start, ho.End(position=(0.0, 0, 0.3), quaternion=(1, 0, 0, 0)))
    block = ho.Part(ho.Box((0.02, 0.02, 0.02)) if position[0] == 0 else ho.Box((0.01, 0.01, 0.01)), position=position)
    problem = ho.Problem({"lead": run}, parts={"block": block}, limits=ho.Limits(clearance=0.003))
    (row,) = [row for row in ho.clearances(ho.simulate(problem)).limits if row.part == "block"]
    assert row.holds == answer


def test_a_holder_must_not_be_entered_again():
    """A cable leaves a block to the side, along a face, and a second wall of the same part stands in its way."""
    cable = ho.Cable(0.3, 0.004, 2e-3, 1.5e-3)
    start = ho.End(position=(0, 0, 0), quaternion=(1, 0, 0, 0), holders=("wall",), let_off=0.05)
    run = ho.CableRun(cable, start, ho.End(position=(0.0, 0, 0.3), quaternion=(1, 0, 0, 0)))
    wall = ho.Part(ho.Box((0.02, 0.02, 0.004)), position=(0, 0, 0.03))
    problem = ho.Problem({"lead": run}, parts={"wall": wall}, limits=ho.Limits(clearance=0.003))
    (row,) = [row for row in ho.clearances(ho.simulate(problem)).limits if row.part == "wall"]
    assert row.holds == "no" and row.worst == pytest.approx(-0.004, abs=5e-4), "half the wall and the radius"
    assert row.arc_length == pytest.approx(0.03, abs=0.002)


@pytest.mark.parametrize("at_end", [False, True], ids=["start", "end"])
@pytest.mark.parametrize("moment", [0.5, 0.2], ids=["between the frames", "in a frame"])
def test_a_holder_is_not_entered_again_between_frames(at_end, moment):
    """The cable bows out to a thin second wall of what holds it, and no frame need be there for it to be seen."""
    ends = [
        ho.End(position=(0, 0, 0), tangent=(0, 0, 1), roll_deg=0, holders=("wall",), let_off=0.12),
        ho.End(position=(0.06, 0, 0.2), tangent=(0, 0, 1), roll_deg=0, body="arm"),
    ]
    if at_end:
        ends = [dataclasses.replace(end, tangent=(0, 0, -1)) for end in reversed(ends)]
    run = ho.CableRun(ho.Cable(0.3, 0.004, 2e-3, 1.5e-3), *ends)
    slide = {"arm": ho.Body(ho.Slide((0, 1, 0), -0.12, 0.12))}
    far = {"wall": ho.Part(ho.Box((0.001, 0.02, 0.01)), position=(1, 1, 1))}
    drawn = ho.Problem({"lead": run}, slide, parts=far, limits=ho.Limits(clearance=0.003))
    shapes = ho.simulate(drawn, frames=np.array([0.0, moment, 1.0])).cables["lead"]
    out = shapes.position[1, np.argmin(np.abs(shapes.s - (0.24 if at_end else 0.06)))]
    problem = dataclasses.replace(drawn, parts={"wall": dataclasses.replace(far["wall"], position=tuple(out))})
    coarse = ho.simulate(problem, frames=np.array([0.0, 0.2, 0.8, 1.0]))
    (row,) = [row for row in ho.clearances(coarse).limits if row.part == "wall"]
    assert row.holds == "no"
    assert row.worst == pytest.approx(-0.0025, abs=3e-4), "half the wall and the radius"


# --- turns ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["turns", "turns3"])
def test_a_cable_that_lost_turns_has_gone_through_itself(name, here):
    """Let go without contact, the hose ends untwisted: that is no answer to four turns, or three."""
    assert rows_of(name)["clearance.hose.cable:hose"].holds == "no"
    text = (CASES / f"{name}.toml").read_text(encoding="utf-8")
    Path("free.toml").write_text(text.replace("clearance = 0.001\n", ""), encoding="utf-8")
    assert main(["simulate", "free.toml", "--no-pictures", "-q"]) == 3


# --- names ----------------------------------------------------------------------------------------------


def test_names_that_read_like_sentences_change_no_figure(here, capsys):
    """Cables and parts called "a to b" and "b to c", in every command."""
    figures = []
    for case in ("names_plain", "names_collide"):
        file = str(CASES / f"{case}.toml")
        study = f'schema = 1\nproblem = "{case}.toml"\nmethod = "grid"\n[vary]\n"cables.a.length" = [0.29, 0.3]\n'
        Path(f"{case}.toml").write_text(Path(file).read_text(encoding="utf-8"), encoding="utf-8")
        Path(f"{case}_study.toml").write_text(study, encoding="utf-8")
        found = []
        for command in ("simulate", "redesign", "sensitivity", "study"):
            given = f"{case}_study.toml" if command == "study" else file
            plain = ["--no-pictures", "-q"] if command in ("simulate", "redesign") else []
            main([command, given, "-o", f"{case}_{command}", "--json", *plain])
            found.append(numbers(json.loads(capsys.readouterr().out)))
        with open(f"{case}_study/variants.csv", newline="", encoding="utf-8") as table:
            found.append([[c for c in row if not c.startswith("clearance")] for row in list(csv.reader(table))[1:]])
        figures.append(found)
    plain, collide = figures
    for one, other in zip(plain, collide, strict=True):
        assert one == other


def numbers(value: object) -> list[float]:
    """Return all numbers of a summary but for times, in order."""
    if isinstance(value, dict):
        return [n for key, item in value.items() if key != "timing" for n in numbers(item)]
    if isinstance(value, list):
        return [n for item in value for n in numbers(item)]
    return [value] if isinstance(value, (int, float)) else []
