"""Limits within tolerances: corners and quantiles against closed forms, redesigns against simulated samples."""

from __future__ import annotations

import dataclasses
import itertools
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

import harness_opt as ho
from harness_opt.clearance.pairs import ClearanceResult
from harness_opt.cli.commands import main
from harness_opt.design.key_derivatives import Linear
from harness_opt.design.robustness import judged
from harness_opt.files.quantity_keys import Quantity
from harness_opt.files.read import read_problem, write_problem
from harness_opt.model.design import Robust, Tolerance
from harness_opt.studies.yields import measured
from oracles.flap import HIT, PLAIN, put, strict

ROBUST = """
[robust]
share = 0.9
samples = 12
seed = 2

[robust.tolerances]
"cables.lead.length" = { plus_minus = 0.004 }
"parts.ball.position.z" = { deviation = 0.0005 }
"""


def linear(margin: list[float], rate: list[list[float]], limit: list[int]) -> Linear:
    """Return margins as of one simulated problem, its quantities all 10 as given."""
    count = len(rate[0])
    quantities = tuple(Quantity(f"q{j}", ("cables", "lead", f"q{j}"), 10.0) for j in range(count))
    names = tuple(f"limit {i}" for i in range(max(limit) + 1))
    motion = ho.Motion(None, np.zeros(1), {})
    return Linear(
        quantities, np.array(margin), np.array(rate), np.array(limit), names, np.ones(len(names)), motion,
        ClearanceResult(np.zeros(1), ()), np.zeros((len(margin), count, count)),
    )  # fmt: skip


def robust(*spreads: Tolerance, **asked: object) -> Robust:
    return Robust({f"q{j}": spread for j, spread in enumerate(spreads)}, **asked)


# --- linearised margins ---------------------------------------------------------------------------------


def test_the_worst_corner_is_the_worst_of_all_corners(rng):
    rates, margins = rng.normal(size=(7, 3)), rng.uniform(1, 2, 7)
    widths = (0.1, 0.2, 0.3)
    found = judged(linear(margins, rates, [0, 0, 1, 1, 1, 2, 2]), robust(*map(Tolerance, widths), hold="corners"))
    corners = np.array(list(itertools.product(*((-w, w) for w in widths))))
    at_corners = margins[:, None] + rates @ corners.T
    assert found.corner == pytest.approx(at_corners.min())
    for i, rows in enumerate(([0, 1], [2, 3, 4], [5, 6])):
        allowance = margins[rows].min() - at_corners[rows].min()
        assert found.allowances[f"limit {i}"] == pytest.approx(allowance)
        assert found.nominal[f"limit {i}"] == margins[rows].min()


def test_the_yield_of_one_normal_quantity():
    spread = Tolerance.normal(0.2)
    found = judged(linear([0.3], [[1.0]], [0]), robust(spread))
    assert found.share == pytest.approx(stats.truncnorm(-4, 4, scale=0.2).cdf(0.3), abs=0.01)


def test_the_yield_of_two_limits_on_one_quantity():
    """Held between -0.1 and 0.4 of a uniform spread of +-0.5."""
    found = judged(linear([0.1, 0.4], [[1.0], [-1.0]], [0, 1]), robust(Tolerance(0.5)))
    assert found.share == pytest.approx(0.5, abs=0.02)
    assert found.by_limit == pytest.approx({"limit 0": 0.6, "limit 1": 0.9}, abs=0.02)


def test_tolerances_in_percent_are_of_the_value():
    found = judged(linear([1.0], [[1.0]], [0]), robust(Tolerance(20, percent=True), hold="corners"))
    assert found.allowances["limit 0"] == pytest.approx(2.0)


@pytest.mark.parametrize("share", [0.5, 0.9, 0.99])
def test_allowances_hold_the_share_that_was_asked_for(rng, share):
    """With every limit at its allowance exactly, that share of other samples holds all of them."""
    rates = rng.normal(size=(5, 3))
    spreads = (Tolerance(0.1), Tolerance.normal(0.1), Tolerance(0.2, distribution="triangular"))
    allowances = judged(linear([0.0] * 5, rates, range(5)), robust(*spreads, share=share)).allowances
    again = judged(linear(list(allowances.values()), rates, range(5)), robust(*spreads, share=share, seed=9))
    assert again.share == pytest.approx(share, abs=0.015)


def test_a_limit_far_away_asks_nothing_of_the_others():
    spread = robust(Tolerance(0.5), Tolerance(0.5), share=0.9)
    both = judged(linear([0.0, 0.0], [[1.0, 0], [0, 1.0]], [0, 1]), spread).allowances
    near = judged(linear([0.0, 9.0], [[1.0, 0], [0, 1.0]], [0, 1]), spread).allowances
    assert near["limit 0"] == pytest.approx(0.4, abs=0.01), "a tenth of the uniform spread lies below -0.4"
    assert both["limit 0"] == pytest.approx(0.5 - 0.5 * (1 - np.sqrt(0.9)) * 2, abs=0.01), "two have to hold together"


# --- redesign -------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def designs(tmp_path_factory):
    """The flap whose cable hits a ball, redesigned without tolerances, for a share of 0.9, and for all corners."""
    folder = tmp_path_factory.mktemp("robust")
    (folder / "flap.toml").write_text(HIT + ROBUST)
    problem = read_problem(folder / "flap.toml")
    corners = dataclasses.replace(problem, robust=dataclasses.replace(problem.robust, hold="corners"))
    plain = dataclasses.replace(problem, robust=None)
    return [ho.redesign(given) for given in (plain, problem, corners)]


def test_tolerances_cost_change_and_corners_more(designs):
    plain, share, corners = designs
    assert all(design.ok for design in designs)
    assert plain.robust is None
    changes = [abs(design.variables["lead.length"].after - 0.3) for design in designs]
    assert changes[0] < changes[1] < changes[2]
    assert share.robust.holds and share.robust.after.share >= 0.9
    assert corners.robust.holds and corners.robust.after.corner > -0.01
    assert share.robust.before.share == 0.0


def test_no_more_is_asked_than_the_share_needs(designs):
    assert designs[1].robust.after.share < 0.97


def test_simulated_samples_agree_with_linearised_margins(designs):
    """Where it is hardest: at the design that tolerances were not asked of, half of what is built is near its limit."""
    design, tolerances = designs[0], designs[1].original.robust
    found = measured(design.problem, dataclasses.replace(tolerances, samples=40, seed=8), executor=here())
    assert abs(found.share - found.linear) <= 0.03
    assert 0.2 < found.share < 0.8
    assert found.samples == 40 and found.failures == 0
    assert found.error == pytest.approx(np.sqrt(found.share * (1 - found.share) / 40))


def here():
    from oracles.studies import Here

    return Here()


def test_every_corner_is_simulated_and_holds(designs):
    problem = designs[2].problem
    length = problem.cables["lead"].cable.length
    z = problem.parts["ball"].position[2]
    variants = [
        {"cables.lead.length": length + a, "parts.ball.position.z": z + b}
        for a in (-0.004, 0.004)
        for b in (-0.002, 0.002)
    ]
    results = list(ho.study(problem, variants, executor=here()))
    assert min(result.worst_margin for result in results) > -0.02, "but for what is not linear"


def test_tolerances_that_nothing_holds_are_named_so(tmp_path):
    (tmp_path / "flap.toml").write_text((HIT + ROBUST).replace("[0.25, 0.45]", "[0.295, 0.3175]"))
    design = ho.redesign(read_problem(tmp_path / "flap.toml"))
    assert not design.ok and not design.robust.holds
    assert design.robust.after is None or design.robust.after.share < 0.9


# --- files ----------------------------------------------------------------------------------------------


def test_a_written_file_has_its_tolerances(here, tmp_path):
    spreads = '"cables.lead.stiffness_percent" = { plus_minus = 30, distribution = "triangular" }\n'
    spreads += '"parts.ball.position.x" = { plus_minus = 1, deviation = 0.2 }\n'
    problem = read_problem(put(HIT + ROBUST + spreads))
    again = read_problem(write_problem(problem, tmp_path / "again.toml"))
    assert again.robust == problem.robust
    assert again.robust.tolerances["parts.ball.position.z"] == Tolerance.normal(0.0005)
    assert list(again.robust.tolerances)[2] == "cables.lead.stiffness_percent"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"cables.lead.length"', '"cables.lead.lenght"', "did you mean 'cables.lead.length'?"),
        (
            '"cables.lead.length"',
            '"cables.lead.density"',
            "expected weight_percent of the cable, or",
        ),
        ('"cables.lead.length"', '"limits.clearance"', "found a tolerance of what is no number that moves"),
        (
            "{ plus_minus = 0.004 }",
            "{ plus_minus_percent = 3, deviation = 1 }",
            "found deviation and plus_minus_",
        ),
        ("{ plus_minus = 0.004 }", "{}", "found no spread"),
        ('"cables.lead.length" = { plus_minus =', '"parts.ball.position.y" = { plus_minus_percent =', ""),
        ("share = 0.9", "share = 1.0", "robust.share: found 1.0, expected a number between 0 and 1"),
        ("share = 0.9", 'hold = "corner"', "robust.hold: found \"corner\", expected one of 'quantile', 'corners'"),
        ("samples = 12", "samples = -1", "robust.samples: found -1, expected a number of at least 0"),
        (ROBUST[ROBUST.index("[robust.tol") :], "", "robust.tolerances: found none, expected at least one"),
    ],
)
def test_mistakes(here, old, new, words):
    assert ROBUST.count(old) == 1
    file = put(HIT.replace("0.08, 0.01,", "0.08, 0,") + ROBUST.replace(old, new))
    with pytest.raises(ho.ProblemError, match="robust") as caught:
        read_problem(file)
    assert (words or "found a tolerance in percent of 0") in str(caught.value)


def test_a_trade_off_knows_no_tolerances(here):
    problem = read_problem(put(HIT + ROBUST))
    with pytest.raises(ho.ProblemError, match="robust: found tolerances, expected none for a trade-off curve"):
        ho.redesign(problem, pareto=("length", "clearance"))


def test_the_command_tells_the_yield_before_and_after(here, capsys):
    file = put(HIT + ROBUST)
    assert main(["redesign", file, *PLAIN, "--json"]) == 0
    out, err = capsys.readouterr()
    found = strict(out)["redesign"]["robust"]
    assert found["yield_before"]["share"] == 0.0
    assert found["yield_after"]["share"] > 0.6, "of 12 samples, 0.9 was asked for"
    assert found["yield_after"]["samples"] == 12
    assert "Yield after, 12 samples simulated" in err
    assert read_problem(Path("results/flap/redesigned.toml")).robust == read_problem(file).robust
