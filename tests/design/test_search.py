"""What a search finds: round thin parts, through slots, from cables too short; and what it leaves alone."""

from __future__ import annotations

import dataclasses
import json
import multiprocessing
import shutil
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.cli.commands import main
from harness_opt.design import evaluation, starts
from harness_opt.design.evaluation import GUARD, Evaluator
from harness_opt.design.objective import objective_of
from harness_opt.design.verification import rounded
from harness_opt.model import design_variables
from harness_opt.parts.scene import load_scene

CASES = Path(__file__).parents[1] / "reference" / "redesign"


def case(name: str) -> ho.Problem:
    return ho.read_problem(CASES / f"{name}.toml")


def evaluator(problem: ho.Problem) -> Evaluator:
    return Evaluator(problem, load_scene(problem), "gauss-newton", None)


def with_design(problem: ho.Problem, **keys: object) -> ho.Problem:
    return dataclasses.replace(problem, design=dataclasses.replace(problem.design, **keys))


def after(design: ho.Redesign) -> dict[str, float]:
    return {name: variable.after for name, variable in design.variables.items()}


# --- parts that a cable goes through ---------------------------------------------------------------------


def test_a_thin_floor_is_left_as_a_thick_one_is():
    thin, thick = ho.redesign(case("thin")), ho.redesign(case("thick"))
    assert thin.ok and thick.ok
    assert after(thin) == pytest.approx(after(thick), abs=1e-12)


@pytest.mark.parametrize("thickness", [0.0005, 0.002, 0.018])
def test_what_hangs_through_a_floor_is_measured_from_the_side_it_came_in_by(thickness):
    problem = case("thin")
    floor = ho.Part(ho.Box((3.0, 3.0, thickness)), position=(0.5, 0.0, -0.5 * thickness))
    seen = evaluator(dataclasses.replace(problem, parts={"floor": floor}))(np.array([1.2]), None)
    lowest = seen.motion.cables["hose"].position[..., 2].min()
    assert lowest < -0.02
    short = seen.rows.margin.min() + GUARD  # in scales: the radius, where the limit is 0
    assert short == pytest.approx((lowest - 0.01) / 0.01, rel=1e-3)


def test_the_slope_there_is_that_of_differences():
    evaluate, step = evaluator(case("thin")), 1e-4
    seen = evaluate(np.array([1.2]), None)
    worst = seen.rows.margin.argmin()
    up, down = (evaluate(np.array([1.2 + way * step]), None).rows.margin.min() for way in (1, -1))
    assert seen.rows.rate[worst, 0] == pytest.approx((up - down) / (2 * step), rel=1e-3)


def test_what_goes_through_a_panel_is_measured_aside_to_its_slot():
    # drawn at y = 0, the slot begins at 24 mm: with the radius and the limit the centreline has 29 mm to go
    problem = case("slot2")
    seen = evaluator(problem)(np.zeros(2), None)
    worst = seen.rows.margin.argmin()
    scale = 0.003 + 0.002
    assert seen.rows.margin[worst] + GUARD == pytest.approx(-0.029 / scale, abs=0.02)
    # and both clamps carry it there
    assert np.sum(seen.rows.rate[worst]) == pytest.approx(1.0 / scale, rel=0.05)


def test_a_slot_aside_is_found():
    known = ho.read_problem(CASES / "slot_solution.toml")
    assert min(row.margin for row in ho.clearances(ho.simulate(known)).limits) > 0.005
    design = ho.redesign(case("slot2"))
    assert design.ok and design.optimal
    assert 0.0289 < min(after(design).values()) <= max(after(design).values()) < 0.0411  # what the slot leaves room for


# --- other valleys ---------------------------------------------------------------------------------------


def test_looks_are_the_same_for_a_seed_and_fill_the_bounds():
    one, again, other = (starts.spread(0, 64, 2, seed) for seed in (1, 1, 2))
    assert np.array_equal(one, again) and not np.array_equal(one, other)
    assert np.array_equal(np.vstack([starts.spread(0, 40, 2, 1), starts.spread(40, 24, 2, 1)]), one)
    counts, _, _ = np.histogram2d(*one.T, bins=4, range=[[0, 1], [0, 1]])
    assert counts.min() >= 2  # of 4 in each of 16 cells; 64 at random leave one with none every third time


def test_a_look_from_known_shapes_sees_what_one_from_nothing_does():
    problem = case("slot2")
    evaluate, objective = evaluator(problem), objective_of(problem)
    drawn, aside, far = (evaluate(np.array(place), None) for place in ([0.0, 0.0], [0.02, 0.02], [0.06, -0.06]))
    place = np.array([0.025, 0.01])
    near = starts.nearest(objective, place, [drawn, aside, far])
    assert near is aside
    warm, cold = (evaluate(place, known, quick=True).rows.margin for known in (near, None))
    assert warm == pytest.approx(cold, abs=1e-6)
    assert starts.nearest(objective, np.array([-0.06, 0.06]), [drawn, aside, far]) is None


def seen(problem: ho.Problem, executor: Executor | None) -> tuple[list[np.ndarray], int]:
    evaluate = Evaluator(problem, load_scene(problem), "gauss-newton", None, executor)
    lower, upper = design_variables.bounds(problem)
    places = lower + starts.spread(0, 10, 2, 1) * (upper - lower)
    return [np.append(one.values, one.rows.margin) for one in evaluate.looks(places, 2) if one], evaluate.count


def test_other_processes_see_the_same(monkeypatch):
    alone = seen(case("slot2"), None)
    monkeypatch.setattr(evaluation, "STARTING", 0.0)
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as processes:
        helped = seen(case("slot2"), processes)
        broken = Broken(processes)
        left_alone = seen(case("slot2"), broken)
    assert broken.asked > 2
    for margins, count in (helped, left_alone):
        assert count == alone[1] == 10
        assert all(np.array_equal(one, other) for one, other in zip(margins, alone[0], strict=True))


class Broken(Executor):
    """Loses its processes after two tasks."""

    def __init__(self, processes: Executor):
        self._processes, self.asked = processes, 0

    def submit(self, *task):
        self.asked += 1
        if self.asked > 2:
            lost = Future()
            lost.set_exception(BrokenExecutor("gone"))
            return lost
        return self._processes.submit(*task)


def test_of_two_slots_the_nearer_one_is_taken():
    problem = case("slot2")
    box = ho.Box((0.01, 0.2, 0.6))
    parts = {
        "l": ho.Part(box, position=(0.1, -0.08, -0.05)),
        "r": ho.Part(box, position=(0.1, 0.16, -0.05)),
        "far": ho.Part(box, position=(0.1, -0.31, -0.05)),
    }
    variables = (ho.Variable("c.start.position.y", -0.25, 0.06),)
    couplings = (ho.Coupling("c.end.position.y", "c.start.position.y"),)
    posed = with_design(dataclasses.replace(problem, parts=parts), variables=variables, couplings=couplings)
    start = design_variables.apply(posed, [-0.11])  # slots from -0.21 to -0.18 and from 0.02 to 0.06
    design = ho.redesign(start)
    evaluate, objective = evaluator(start), objective_of(start)
    dense = (evaluate(np.array([y]), None, quick=True) for y in np.linspace(-0.25, 0.06, 125))
    best = min(objective.value(seen) for seen in dense if objective.held(seen))
    assert design.ok
    found = objective.preference(np.array(list(after(design).values())))
    assert found < 1.05 * best


def test_a_cable_is_laid_to_the_other_side_where_nothing_else_does():
    # weightless: bowed up it is the mirror image of bowed down, where a box stands in its way
    cable = ho.Cable(0.3, 4e-3, 2e-3, 1.5e-3, 0.05)
    start = ho.End((0.0, 0.0, 0.0), tangent=(1.0, 0.0, 0.0))
    end = ho.End((0.2, 0.0, 0.0), tangent=(1.0, 0.0, 0.0))
    problem = ho.Problem(
        {"c": ho.CableRun(cable, start, end, bow=(0.0, 0.0, -1.0))},
        parts={"box": ho.Part(ho.Box((0.1, 0.2, 0.06)), position=(0.1, 0.0, -0.06))},
        limits=ho.Limits(clearance=0.003),
        design=ho.Design(variables=(ho.Variable("c.start.position.x", -0.001, 0.001),)),
    )
    design = ho.redesign(problem)
    assert design.ok
    assert design.problem.cables["c"].bow == pytest.approx((0.0, 0.0, 1.0))
    assert design.motion.cables["c"].position[..., 2].max() > 0.05


# --- too short -------------------------------------------------------------------------------------------


def test_a_cable_drawn_too_short_begins_where_it_reaches(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    shutil.copy(CASES / "too_short.toml", "too_short.toml")
    assert main(["redesign", "too_short.toml"]) == 0
    assert "drawn 14.2 mm too short to reach its clamps" in " ".join(capsys.readouterr().out.split())
    found = json.loads(Path("results/too_short/summary.json").read_text())["redesign"]
    apart = np.hypot(0.2 + 0.02 / np.hypot(1.0, 0.3), 0.006 / np.hypot(1.0, 0.3))  # of the clamps at the end
    assert found["limits_before"] is None
    assert found["too_short"]["c"] == pytest.approx(apart - 0.205, abs=1e-9)
    assert 1.01 * apart <= found["variables"]["c.length"]["after"] <= 1.01 * apart + 1e-4
    for command in ("simulate", "check"):
        assert main([command, "too_short.toml"]) == 2
        assert "cables.c.length: found 0.205, expected at least 0.219" in capsys.readouterr().err


def test_a_cable_too_short_within_all_bounds_is_bad_input():
    problem = with_design(case("too_short"), variables=(ho.Variable("c.length", 0.19, 0.21),))
    with pytest.raises(ho.ProblemError, match=r"cables\.c\.length: found 0\.205, expected at least 0\.219"):
        ho.redesign(problem)


# --- what is not concerned ------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["slot2", "thin", pytest.param("lid", marks=pytest.mark.slow)])
def test_a_bystander_stays_as_drawn(name):
    # a second cable, 2 m away, within all its limits; of "lid" no design holds
    problem = case(name)
    cable = ho.Cable(0.4, 5e-3, 2e-3, 1.5e-3, 0.05)
    start = ho.End((2.0, 2.0, 0.0), tangent=(1.0, 0.0, 0.0))
    idle = ho.CableRun(cable, start, ho.End((2.25, 2.0, 0.0), tangent=(1.0, 0.0, 0.0)))
    variables = (
        *problem.design.variables,
        ho.Variable("idle.length", 0.35, 0.6),
        ho.Variable("idle.start.position.y", 1.9, 2.1),
        ho.Variable("idle.end.rotate_y_deg", -20.0, 20.0),
    )
    both = with_design(dataclasses.replace(problem, cables={**problem.cables, "idle": idle}), variables=variables)
    design = ho.redesign(both)
    assert any(variable.after != variable.before for variable in design.variables.values())
    for variable in (one for key, one in design.variables.items() if key.startswith("idle.")):
        assert variable.after == variable.before


# --- where none holds ------------------------------------------------------------------------------------


def test_what_has_nothing_to_do_with_it_stays_as_drawn():
    problem = case("wander")
    design = ho.redesign(problem)
    assert design.status.ok and not design.feasible
    found = after(design)
    assert (found["b.length"], found["b.end.rotate_y_deg"]) == (0.42, 0.0)
    drawn = ho.clearances(ho.simulate(problem)).limits
    worst = max(-row.margin / row.scale(0.005) for row in drawn)
    assert design.violation <= worst + 1e-3


@pytest.mark.slow
def test_the_least_violation_is_no_worse_than_at_random():
    problem = case("lid")
    design = ho.redesign(problem)
    lower, upper = design_variables.bounds(problem)
    evaluate = evaluator(problem)
    random = np.random.default_rng(1).uniform(lower, upper, (100, len(lower)))
    seen = [one for values in random if (one := evaluate(values, None, quick=True)) is not None]
    assert len(seen) > 60
    assert design.violation <= min(one.violation for one in seen)


# --- rounding --------------------------------------------------------------------------------------------


def test_values_are_rounded_before_they_are_verified():
    for unit in (1e-3, 1e-4):
        design = ho.redesign(with_design(case("thin"), round_length=unit))
        length = after(design)["hose.length"]
        assert design.ok and length == pytest.approx(unit * round(length / unit), abs=1e-12)
        assert design.problem.cables["hose"].cable.length == length


def test_rounding_takes_the_side_that_holds_and_can_be_left_out():
    problem = with_design(case("thin"), round_length=0.0)
    exact = after(ho.redesign(problem))["hose.length"]
    coarse = with_design(problem, round_length=5e-3)
    design = ho.redesign(coarse)
    assert design.ok and exact - 5e-3 <= after(design)["hose.length"] <= exact
    # and where no round value lies within the bounds, the exact one
    tight = with_design(problem, round_length=5e-3, variables=(ho.Variable("hose.length", 1.0455, 1.0495),))
    evaluate = evaluator(tight)
    best = evaluate(np.array([1.0471]), None)
    assert rounded(tight, objective_of(tight), best) == pytest.approx([1.0471])


@pytest.mark.parametrize(
    ("key", "value"),
    [("seed", '"one"'), ("seed", "1.5"), ("round_length", '"0.1 mm"'), ("round_deg", "-1"), ("seed", "-1")],
)
def test_a_seed_or_a_rounding_that_is_no_number_is_named(tmp_path, key, value, capsys):
    text = (
        (CASES / "thin.toml")
        .read_text()
        .replace("[design.variables]", f"[design]\n{key} = {value}\n[design.variables]")
    )
    file = tmp_path / "thin.toml"
    file.write_text(text)
    assert main(["redesign", str(file)]) == 2
    assert f"design.{key}: found" in capsys.readouterr().err
