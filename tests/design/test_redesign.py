"""Redesigns against dense searches, against themselves with a limit moved, and what they say where none is found.

All on the flap of ``flap_file.py``: a few frames, a second each.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.clearance.limits import all_limits
from harness_opt.clearance.measure import measure
from harness_opt.cli import redesign as redesign_command
from harness_opt.cli.commands import main
from harness_opt.design import evaluation
from harness_opt.design.result import Earlier
from harness_opt.design.sqp import Step
from harness_opt.model import design_variables
from harness_opt.model.limits import LimitId, LimitKind
from harness_opt.parts.scene import load_scene
from oracles.flap import HIT, PLAIN, WALLED, put, strict

CLOSE = 0.01  # of the objective: as near to the best of a dense search as a redesign has to come


def read(text: str, name: str = "flap.toml") -> ho.Problem:
    return ho.read_problem(put(text, name))


def margins(problem: ho.Problem) -> dict[tuple[str, str | None], float] | None:
    """Return the margins of a design's solved frames, without the redesign; None where it cannot be."""
    try:
        motion = ho.simulate(problem, throw=False)
    except ho.ProblemError:
        return None
    if not motion.ok or motion.snaps:
        return None
    found = measure(problem, load_scene(problem), motion.motion, motion.cables)
    return {(row.name, row.part): row.margin for row in all_limits(problem, motion, found)}


def holds(problem: ho.Problem) -> bool:
    found = margins(problem)
    return found is not None and min(found.values()) >= 0


def with_variables(problem: ho.Problem, **design) -> ho.Problem:
    return dataclasses.replace(problem, design=dataclasses.replace(problem.design, **design))


# --- the best there is -----------------------------------------------------------------------------------


def test_least_length_is_that_of_a_dense_search(here):
    problem = with_variables(read(HIT), minimise="length", variables=(ho.Variable("lead.length", 0.29, 0.45),))
    design = ho.redesign(problem)
    assert design.ok
    lengths = np.arange(0.3, 0.33, 0.001)
    shortest = min(length for length in lengths if holds(design_variables.apply(problem, [length])))
    assert design.variables["lead.length"].after < (1 + CLOSE) * shortest


def test_least_change_is_that_of_a_dense_search(here):
    # two ways out of the ball: longer, and aside; the best is a bit of both
    bounds = (ho.Variable("lead.length", 0.25, 0.40), ho.Variable("lead.start.position.y", -0.05, 0.05))
    problem = with_variables(read(HIT), variables=bounds)
    design = ho.redesign(problem)
    assert design.ok
    lower, upper = design_variables.bounds(problem)
    start = design_variables.values(problem)

    def change(values: np.ndarray) -> float:
        return 0.5 * float(np.sum(((values - start) / (upper - lower)) ** 2))

    after = np.array([variable.after for variable in design.variables.values()])
    # a ring of designs one per cent nearer to the given one: none holds, all the way round
    nearer = np.sqrt(2 * (1 - CLOSE) * change(after))
    for angle in np.linspace(0, 2 * np.pi, 48, endpoint=False):
        values = start + nearer * (upper - lower) * np.array([np.cos(angle), np.sin(angle)])
        if np.all((values >= lower) & (values <= upper)):
            assert not holds(design_variables.apply(problem, values)), values


def test_largest_margin_is_that_of_a_dense_search(here):
    problem = with_variables(read(HIT), maximise="margin")
    design = ho.redesign(problem)
    assert design.ok

    def worst(length: float) -> float:
        found = margins(design_variables.apply(problem, [length]))
        radius = problem.cables["lead"].cable.radius
        shares = {"clearance": 0.004 + radius}
        # of a bend radius the share of the curvature that is left
        return min(
            value / shares[name] if name == "clearance" else value / (value + 0.01)
            for (name, _), value in found.items()
        )

    best = max(worst(length) for length in np.linspace(0.3, 0.36, 31))
    assert worst(design.variables["lead.length"].after) > (1 - CLOSE) * best


def test_a_weight_of_zero_changes_for_nothing(here):
    bounds = (ho.Variable("lead.length", 0.25, 0.40), ho.Variable("lead.start.position.y", -0.05, 0.05))
    problem = with_variables(read(HIT), variables=bounds, weights={"lead.start.position.y": 0.0})
    design = ho.redesign(problem)
    assert design.ok
    assert abs(design.variables["lead.length"].after - 0.3) < 1e-4  # the other does it all


# --- couplings -------------------------------------------------------------------------------------------

COUPLED = HIT.replace(
    '"lead.length" = [0.25, 0.45]',
    '"lead.start.position.y" = [-0.05, 0.05]\n"lead.end.position.y" = "= lead.start.position.y + 0.02"\n'
    '"lead.start.rotate_z_deg" = "= -2 * lead.end.rotate_z_deg"\n"lead.end.rotate_z_deg" = [-5, 5]',
)


def test_what_is_coupled_follows(here):
    problem = read(COUPLED)
    design = ho.redesign(problem)
    run = design.problem.cables["lead"]
    assert design.ok
    assert run.start.position[1] != 0.0
    assert run.end.position[1] == pytest.approx(run.start.position[1] + 0.02, abs=1e-12)
    again = ho.read_problem(ho.write_problem(design.problem, "better.toml"))
    assert again == dataclasses.replace(design.problem, file=again.file, sha256=again.sha256)
    assert holds(again)
    # at the values that the new file stands at, nothing has to move
    assert not design_variables.moved(again)


def test_rates_of_coupled_variables_are_the_sums(here):
    problem = read(COUPLED)
    free = [v.name for v in problem.design.variables] + [c.name for c in problem.design.couplings]
    alone = with_variables(problem, variables=tuple(ho.Variable(n, -9.0, 9.0) for n in free), couplings=())
    values, motion = np.array([0.01, 3.0]), np.array([0.0, 0.5])
    both = design_variables.clamp_rates(problem, "lead", values, motion)
    each = design_variables.clamp_rates(alone, "lead", np.array([0.01, 3.0, 0.03, -6.0]), motion)
    for name in ("start", "end", "start_turn", "end_turn", "length"):
        q = getattr(each, name)
        np.testing.assert_allclose(
            getattr(both, name), np.stack([q[..., 0] + q[..., 2], q[..., 1] - 2.0 * q[..., 3]], axis=-1), atol=1e-15
        )


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ('"= lead.strt.position.y"', "expected a variable with bounds: 'lead.start.position.y'; did you mean"),
        ('"lead.start.position.y"', 'expected text such as "= lead.start.position.x"'),
        ('"= lead.start.position.x"', "expected a variable with bounds: 'lead.start.position.y'"),
        ('"= lead.end.position.y"', "expected a variable with bounds"),
        ("[0.1]", "expected [lower, upper], two numbers, or text"),
    ],
)
def test_couplings_that_cannot_be(here, words, expected):
    text = HIT.replace(
        '"lead.length" = [0.25, 0.45]', f'"lead.start.position.y" = [-0.05, 0.05]\n"lead.end.position.y" = {words}'
    )
    with pytest.raises(ho.ProblemError) as error:
        read(text)
    assert 'design.variables."lead.end.position.y": found' in str(error.value)
    assert expected in str(error.value)


def test_couplings_of_other_units_and_lengths_below_zero(here):
    text = HIT.replace("[0.25, 0.45]", '[0.25, 0.45]\n"lead.start.rotate_x_deg" = "= lead.length"')
    with pytest.raises(ho.ProblemError, match="expected a variable in the same unit"):
        read(text)
    text = HIT.replace(
        '"lead.length" = [0.25, 0.45]', '"lead.start.position.x" = [-1, 1]\n"lead.length" = "= lead.start.position.x"'
    )
    with pytest.raises(ho.ProblemError, match="which may be -1, expected a length above 0"):
        read(text)


# --- what limits cost, and what would do -----------------------------------------------------------------


def test_prices_are_what_a_redesign_with_another_limit_shows(here):
    problem = read(HIT)
    design = ho.redesign(problem)
    (price,) = design.prices
    assert (price.key, price.of) == ("parts.ball.clearance", "change")

    def change(limit: float) -> float:
        found = ho.redesign(dataclasses.replace(problem, limits=dataclasses.replace(problem.limits, clearance=limit)))
        return abs(found.variables["lead.length"].after - 0.3)

    step = 4e-4
    exact = (change(0.004 + step) - change(0.004 - step)) / (2 * step) / change(0.004)
    assert price.saves == pytest.approx(exact, rel=0.03)

    def clearance(length: float) -> float:
        return margins(design_variables.apply(problem, [length]))["clearance", "ball"]

    after = design.variables["lead.length"].after
    bought = (clearance(after + 1e-4) - clearance(after - 1e-4)) / 2e-4
    assert price.buys["lead.length"] == pytest.approx(bought, rel=0.02)


def test_what_would_do_does_and_half_of_it_does_not(here):
    problem = read(WALLED)
    design = ho.redesign(problem)
    assert not design.ok and design.status.ok
    ways = {relaxation.key: relaxation for relaxation in design.relaxations}
    assert set(ways) == {"parts.ball.clearance", "design.variables.lead.length"}
    assert ways["parts.ball.clearance"].enough is None  # the cable is in the ball
    bound = ways["design.variables.lead.length"]
    assert (bound.kind, bound.value) == ("upper", 0.305)

    def upper(value: float) -> ho.Problem:
        return with_variables(problem, variables=(ho.Variable("lead.length", 0.295, value),))

    assert ho.redesign(upper(bound.enough)).ok
    assert not ho.redesign(upper(0.305 + 0.95 * (bound.enough - 0.305))).ok


def test_a_limit_that_gives_way_is_enough_and_hardly_more(here):
    problem = read(WALLED.replace("[0.295, 0.305]", "[0.295, 0.315]"))
    design = ho.redesign(problem)
    ways = {relaxation.key: relaxation for relaxation in design.relaxations}
    limit = ways["parts.ball.clearance"]
    assert 0 < limit.enough < limit.value == 0.004
    # to first order all of the violation is this limit's, at the bound of the only variable
    assert limit.share == pytest.approx(1.0, abs=1e-3)
    longest = design_variables.apply(problem, [0.315])
    assert limit.enough == pytest.approx(0.004 + margins(longest)["clearance", "ball"], abs=1e-4)


def test_words_say_what_would_do_and_what_it_costs(here, capsys):
    assert main(["redesign", put(WALLED), *PLAIN]) == 1
    out = " ".join(capsys.readouterr().out.split())
    assert "This alone would do:" in out and "more lead.length (bound up to 0.31" in out
    assert "Giving way in one of these alone would not do: clearance to ball." in out
    assert main(["redesign", put(HIT), *PLAIN]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "1 mm less clearance to ball would save" in out
    assert "1 mm more lead.length buys 0.5" in out


def test_a_start_outside_its_bounds_is_moved_inside_and_said(here, capsys):
    assert main(["redesign", put(HIT.replace("[0.25, 0.45]", "[0.32, 0.45]")), *PLAIN]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "lead.length stood at 300 mm; the redesign began at 320 mm, inside its bounds." in out
    content = strict(Path("results/flap/summary.json").read_text())
    assert content["redesign"]["moved_inside"] == {"lead.length": {"from": 0.3, "to": 0.32}}
    assert content["redesign"]["variables"]["lead.length"]["after"] >= 0.32


# --- the same again, progress, interruptions -------------------------------------------------------------


def test_two_runs_write_the_same_file(here):
    put(HIT)
    for folder in ("one", "two"):
        assert main(["redesign", "flap.toml", *PLAIN, "-q", "-o", folder]) == 0
    assert Path("one/redesigned.toml").read_bytes() == Path("two/redesigned.toml").read_bytes()


def test_progress_tells_limit_margin_step_and_time(here, capsys):
    assert main(["redesign", put(HIT), *PLAIN]) == 0
    told = [line for line in capsys.readouterr().err.splitlines() if line.startswith("iteration ")]
    history = strict(Path("results/flap/summary.json").read_text())["redesign"]["history"]
    assert len(told) == len(history) > 0
    assert "clearance of lead to ball short by" in told[0]
    assert "% of the bounds" in told[0] and "s left" in told[0]


def test_twist_is_told_in_degrees():
    step = Step("least change", 0.0, -0.5, LimitId(LimitKind.TWIST, "lead"), -np.pi, 0.25, 0.1, False)
    assert redesign_command.words(step, 3) == (
        "iteration 3 (least change): twist of lead short by 180 deg/m, step 10 % of the bounds, not kept"
    )


def test_an_interrupted_redesign_goes_on(here, capsys, monkeypatch):
    put(HIT)
    count = 0

    def stop(self, step):
        nonlocal count
        count += 1
        if count == 1:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(redesign_command.Follower, "__call__", stop)
        main(["redesign", "flap.toml", *PLAIN])
    content = strict(Path("results/flap/summary.json").read_text())
    assert (content["status"], content["reason"]) == ("unsolved", "interrupted")
    before = content["redesign"]
    assert before["variables"]["lead.length"]["after"] != 0.3
    capsys.readouterr()
    assert main(["redesign", "flap.toml", *PLAIN]) == 0
    told = capsys.readouterr().err
    assert "Going on from the redesign interrupted in results/flap, after 1 iteration" in told
    after = strict(Path("results/flap/summary.json").read_text())["redesign"]
    assert after["history"][:1] == before["history"]
    assert after["variables"]["lead.length"]["before"] == 0.3  # changes still count from the design given
    alone = ho.redesign(read(HIT)).variables["lead.length"].after
    assert after["variables"]["lead.length"]["after"] == pytest.approx(alone, abs=2e-5)


def test_what_was_interrupted_counts_for_the_same_file_only(here):
    put(HIT)
    content = {"command": "redesign", "versions": {"harness-opt": "0"}, "reason": "interrupted"}
    content |= {"problem": {"sha256": "another"}, "redesign": {"variables": {"lead.length": {"after": 0.3}}}}
    Path("out").mkdir()
    Path("out/summary.json").write_text(json.dumps(content))
    problem = ho.read_problem("flap.toml")
    assert redesign_command.interrupted(Path("out"), problem) is None
    content["problem"]["sha256"] = problem.sha256
    Path("out/summary.json").write_text(json.dumps(content))
    assert redesign_command.interrupted(Path("out"), problem) == Earlier({"lead.length": 0.3})
    assert redesign_command.interrupted(Path("nowhere"), problem) is None


# --- two quantities --------------------------------------------------------------------------------------


def test_a_trade_off_curve_of_verified_designs(here, capsys):
    put(HIT)
    assert main(["redesign", "flap.toml", *PLAIN, "-q", "--pareto", "length,clearance"]) == 0
    folder = Path("results/flap")
    content = strict((folder / "summary.json").read_text())
    curve = content["redesign"]["pareto"]
    points = curve["points"]
    assert (curve["first"], curve["second"], len(points)) == ("length", "clearance", 7)
    assert all(point["verified"] for point in points)
    # more clearance takes more length, all the way
    for side in ("length", "clearance"):
        assert np.all(np.diff([point[side] for point in points]) > 0)
    rows = (folder / "pareto.csv").read_text().splitlines()
    assert rows[0] == "length,clearance,asked,verified,file,lead.length"
    assert len(rows) == 1 + len(points)
    assert {"pareto.csv", "pareto_1.toml", "pareto_7.toml"} <= set(content["files"])
    for point in (points[0], points[-1]):
        again = ho.read_problem(folder / point["file"])
        assert again.cables["lead"].cable.length == pytest.approx(point["length"])
        found = margins(again)
        assert min(found.values()) >= 0
        assert again.limits.clearance + found["clearance", "ball"] == pytest.approx(point["clearance"], abs=5e-5)
    # no shorter cable does: just below the length of a point its clearance is missed
    middle = points[3]
    shorter = design_variables.apply(ho.read_problem("flap.toml"), [(1 - CLOSE) * middle["length"]])
    assert margins(shorter)["clearance", "ball"] + 0.004 < middle["asked"]


@pytest.mark.parametrize("pair", ["length", "length,change", "length,weight", "clearance,clearance", "a,b,c"])
def test_quantities_that_cannot_be_traded(here, capsys, pair):
    assert main(["redesign", put(HIT), *PLAIN, "--pareto", pair]) == 2
    assert "--pareto: found" in capsys.readouterr().err
    assert not Path("results").exists()


def test_a_quantity_without_a_limit_is_refused_at_once(here, capsys, monkeypatch):
    monkeypatch.setattr(evaluation.Evaluator, "__call__", None)
    assert main(["redesign", put(HIT), *PLAIN, "--pareto", "length,clamp_force"]) == 2
    assert "limits.clamp_force: found none, expected one to trade in --pareto" in capsys.readouterr().err
