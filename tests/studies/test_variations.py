"""What a study varies: keys of the problem, spreads and their distributions, variants, and messages about mistakes."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
from scipy import stats

import harness_opt as ho
from harness_opt.errors import ProblemError
from harness_opt.model import design_variables
from harness_opt.model.design import Design, Tolerance, Variable
from harness_opt.numerics import rotations
from harness_opt.parts.scene import load_scene
from harness_opt.studies.shared_problem import LocalProblem, Shared
from harness_opt.studies.study import plan
from harness_opt.studies.study_file import read_study
from harness_opt.studies.variations import Variations, expand
from oracles.flap import FLAP
from oracles.problems import PROBLEMS
from oracles.studies import STUDY, placed, quantities

LIFT_ARM = PROBLEMS / "lift_arm" / "lift_arm.toml"


def monte_carlo(**spreads: object) -> Variations:
    return Variations("monte carlo", {key.replace("__", "."): value for key, value in spreads.items()}, 5)


# --- distributions --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("tolerance", "peer"),
    [
        (Tolerance(2.0), stats.uniform(-1, 2)),
        (Tolerance(2.0, distribution="triangular"), stats.triang(0.5, -1, 2)),
        (Tolerance(2.0, distribution="normal"), stats.truncnorm(-3, 3, scale=1 / 3)),
        (Tolerance(2.0, distribution="normal", deviation=1.5), stats.truncnorm(-4 / 3, 4 / 3, scale=0.75)),
        (Tolerance.normal(0.5), stats.truncnorm(-4, 4, scale=0.25)),
    ],
)
def test_distributions_are_those_of_scipy(tolerance, peer):
    probability = np.linspace(0, 1, 201)
    assert tolerance.offsets(probability) == pytest.approx(peer.ppf(probability), abs=1e-9)


def test_a_uniform_spread_between_two_values():
    spread = Tolerance.between(2.0, 5.0)
    assert spread.nominal + spread.plus_minus * spread.offsets(np.array([0, 1.0])) == pytest.approx([2.0, 5.0])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"plus_minus": 0.0}, "plus_minus: found 0.0, expected a number above 0"),
        ({"plus_minus": 1.0, "deviation": 1.0}, 'found one of a uniform distribution, expected "normal"'),
        ({"plus_minus": 1.0, "distribution": "gauss"}, "found 'gauss', expected one of 'uniform'"),
        ({"plus_minus": 1.0, "nominal": float("nan")}, "nominal: found nan"),
    ],
)
def test_spreads_that_are_none(arguments, words):
    with pytest.raises(ProblemError, match=words):
        Tolerance(**arguments)


# --- quantities -----------------------------------------------------------------------------------------


def test_a_key_changes_what_it_names_and_nothing_else(here):
    given = quantities()
    before = given.problem({})
    after = given.problem({"cables.lead.start.position.y": 0.25, "bodies.flap.motion.to_deg": 30})
    lead = after.cables["lead"]
    assert lead.start.position == (0.0, 0.25, 0.0)
    assert after.bodies["flap"].motion.stop == np.deg2rad(30)
    start = dataclasses.replace(lead.start, position=before.cables["lead"].start.position)
    restored = dataclasses.replace(after, bodies=before.bodies, cables={"lead": dataclasses.replace(lead, start=start)})
    assert restored == before
    assert given.problem({}) == before, "nothing is left of a change"


def test_every_number_of_a_file_can_be_set_to_what_it_is(here):
    given = quantities()
    before = given.problem({})
    numbers = {key: q.value for key, q in given.items() if type(q.value) in (int, float) and not q.change}
    assert len(numbers) > 30
    for key, value in numbers.items():
        assert given.problem({key: value}) == before, key
    changes = {key: 0.0 for key, q in given.items() if q.change}
    assert len(changes) == 2 + 6 + 3, "stiffness, weight; two clamps and a part about three axes"
    for key in changes:
        assert given.problem({key: 0.0}) == before, key


def test_clamps_turn_as_design_variables_do(here):
    given = quantities()
    angles = {"rotate_z_deg": 3.0, "rotate_x_deg": -7.0, "rotate_y_deg": 11.0}
    turned = given.problem({f"cables.lead.end.{key}": angle for key, angle in angles.items()})
    variables = tuple(Variable(f"lead.end.{key}", -90, 90) for key in angles)
    peer = dataclasses.replace(given.problem({}), design=Design(variables=variables))
    assert turned.cables == design_variables.apply(peer, list(angles.values())).cables


def test_parts_turn_about_their_own_axes(here):
    part = quantities().problem({"parts.ball.rotate_z_deg": 90, "parts.ball.rotate_x_deg": 90}).parts["ball"]
    # about x first: y goes to z; then about the part's own z, which stands along -y by then: x goes to z
    assert rotations.rotate(part.quaternion, [1.0, 0, 0]) == pytest.approx([0, 0, 1], abs=1e-15)
    assert part.position == (0.08, 0.0, 0.0)


def test_percents_are_of_what_stands_there(here):
    flat = FLAP.replace("bending_stiffness = 2e-3", "bending_stiffness = [2e-3, 4e-3]")
    values = {"cables.lead.stiffness_percent": 50, "cables.lead.torsional_stiffness": 1.0}
    cable = quantities(flat).problem(values | {"cables.lead.weight_percent": -20}).cables["lead"].cable
    assert cable.bending_stiffness == pytest.approx((3e-3, 6e-3))
    assert cable.torsional_stiffness == pytest.approx(1.5)
    assert cable.mass_per_length == pytest.approx(0.04)


@pytest.mark.parametrize(
    ("key", "nearest"),
    [
        ("cables.lead.lenght", "cables.lead.length"),
        ("lead.length", "cables.lead.length"),
        ("parts.bal.position.x", "parts.ball.position.x"),
        ("cables.lead.start.rotate_x", "cables.lead.start.rotate_x_deg"),
    ],
)
def test_an_unknown_key_is_told_the_nearest(here, key, nearest):
    with pytest.raises(ProblemError, match=f"found an unknown key.*did you mean '{nearest}'"):
        expand(quantities(), Variations("list", variants=({key: 1.0},)))


# --- variants -------------------------------------------------------------------------------------------


def test_a_grid_has_all_combinations(here):
    vary = {"cables.lead.length": [0.3, 0.31], "limits.clearance": [0.001, 0.002, 0.003]}
    found = expand(quantities(), Variations("grid", vary))
    assert [tuple(v.values()) for v in found] == list(itertools.product(*vary.values()))
    assert all(list(v) == list(vary) for v in found)


def test_a_latin_hypercube_fills_every_stratum_once(here):
    vary = {"cables.lead.length": Tolerance(0.01), "cables.lead.start.rotate_x_deg": Tolerance(5.0)}
    found = expand(quantities(), Variations("latin hypercube", vary, 16, seed=4))
    for key, (low, width) in zip(vary, ((0.29, 0.02), (-5.0, 10.0)), strict=True):
        strata = sorted(int(16 * (v[key] - low) / width) for v in found)
        assert strata == list(range(16))


def test_more_samples_begin_with_the_same_ones(here):
    vary = {
        "cables.lead.length": Tolerance(0.01),
        "gravity": Tolerance(10, percent=True),
        "motion.duration": [1.0, 2.0],
    }
    few, many = (expand(quantities(), Variations("monte carlo", vary, count, seed=4)) for count in (3, 30))
    assert many[:3] == few
    assert expand(quantities(), Variations("monte carlo", vary, 3, seed=5)) != few
    assert {v["motion.duration"] for v in many} == {1.0, 2.0}
    assert all(v["gravity"][:2] == [0, 0] and 8.829 <= -v["gravity"][2] <= 10.791 for v in many)


def test_samples_have_the_spread_that_was_stated(here):
    vary = {"cables.lead.length": Tolerance.normal(0.002)}
    found = [v["cables.lead.length"] for v in expand(quantities(), Variations("monte carlo", vary, 4000, seed=1))]
    peer = stats.truncnorm(-4, 4, loc=0.3, scale=0.002)
    assert stats.kstest(found, peer.cdf).pvalue > 0.01


@pytest.mark.parametrize(
    ("variations", "words"),
    [
        (monte_carlo(cables__lead__length=Tolerance.normal(0.1)), r"normal distribution from -0\.1.* above 0"),
        (monte_carlo(cables__lead__length=Tolerance(120, percent=True)), "uniform distribution from -0.06.* above 0"),
        (monte_carlo(cables__lead__diameter=Tolerance(0.05)), "found a uniform distribution from -0.045"),
        (monte_carlo(cables__lead__stiffness_percent=Tolerance(100)), "bending_stiffness: found 0.0, expected"),
        (monte_carlo(cables__lead__start__rotate_x_deg=Tolerance(5, percent=True)), "in percent of 0"),
        (monte_carlo(cables__lead__start__position=Tolerance(5)), "expected one in percent"),
        (monte_carlo(limits__clamp_force=Tolerance(5)), "around None, expected a nominal number"),
        (monte_carlo(cables__lead__end__turns=Tolerance(1)), "expected a whole number"),
        (monte_carlo(cables__lead__end__body=["flop"]), "'world', 'flap'; did you mean 'flap'"),
        (monte_carlo(cables__lead__length=[]), r"found \[\], expected a list of values"),
        (Variations("grid", {"cables.lead.length": Tolerance(0.01)}), "found a distribution, expected values"),
        (Variations("grid", {"limits.clearance": [0] * 2000, "motion.duration": [1] * 1000}), "2,000,000 variants"),
        (Variations("grid", {"gravity": [[0, 0, 0]], "gravity.x": [1]}), "gravity: found gravity.x as well"),
        (Variations("list", variants=({"cables.lead.length": 0.3}, {"limits.clearance": "a"})), "number 1: limits"),
    ],
)  # fmt: skip
def test_what_no_problem_can_have_is_refused_at_once(here, variations, words):
    with pytest.raises(ProblemError, match=words):
        expand(quantities(), variations)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("random", {"a": [1]}), "found \"random\", expected one of 'grid'"),
        (("grid",), "vary: expected at least one key"),
        (("list",), "variants: expected the variants of a list"),
        (("monte carlo", {"a": [1]}), "samples: found 0"),
        (("grid", {"a": [1]}, 5), "samples: found 5, expected none for a grid"),
    ],
)
def test_methods_and_what_goes_with_them(arguments, words):
    with pytest.raises(ProblemError, match=words):
        Variations(*arguments)


# --- parts and files of a worker ------------------------------------------------------------------------


def test_a_local_problem_moves_meshes_as_a_problem_does(tmp_path):
    given = ho.read_problem(LIFT_ARM)
    values = {"parts.bracket.position.z": 0.003, "parts.bracket.rotate_y_deg": 20.0}
    planned = plan(given, [values, {}])
    local = LocalProblem(planned.shared)
    for variant in (values, {}, values):
        problem = local.problem(variant)
        mine, peer = local.scene(problem), load_scene(problem)
        assert mine.parts.keys() == peer.parts.keys()
        points = np.random.default_rng(1).uniform(-0.1, 0.2, (40, 3))
        for name in peer.parts:
            for a, b in zip(
                mine.parts[name].signed_distance(points), peer.parts[name].signed_distance(points), strict=True
            ):
                assert np.array_equal(a, b)
        assert problem.parts["bracket"].position[2] == variant.get("parts.bracket.position.z", 0.0)


def test_a_worker_without_the_files_takes_those_that_were_sent(tmp_path, monkeypatch, folder):
    from harness_opt.studies import shared_problem
    from oracles.problem_files import CONTRACT, written

    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(shared_problem.tempfile, "gettempdir", lambda: str(tmp_path / "temporary"))
    shared = plan(written(folder, CONTRACT), [{"cables.lead.length": 0.43}]).shared
    ((path, digest),) = shared.paths().items()
    content = path.read_bytes()
    assert bench_part(shared).path == path
    path.write_bytes(content + b" ")
    with pytest.raises(ProblemError, match=r"housing\.stl: found no such file, or another, on this machine"):
        LocalProblem(shared)
    sent = shared_problem.carried_root(shared.name) / digest / path.name
    sent.parent.mkdir(parents=True)
    sent.write_bytes(content)
    assert bench_part(shared).path == sent
    path.unlink()
    assert bench_part(shared).path == sent


def bench_part(shared: Shared) -> ho.MeshFile:
    return LocalProblem(shared).problem({"cables.lead.length": 0.43}).parts["housing"].shape


# --- study files ----------------------------------------------------------------------------------------


def test_a_study_file(here):
    file = placed(here)
    found = read_study(file)
    assert found.problem == here / "flap.toml"
    assert (found.title, found.command) == ("A flap, more or less", "simulate")
    assert found.variations == Variations(
        "monte carlo",
        {
            "cables.lead.length": Tolerance(0.01),
            "cables.lead.stiffness_percent": Tolerance(30, distribution="normal", deviation=15),
            "parts.ball.position.y": Tolerance.normal(0.002),
        },
        8,
        3,
    )


def test_a_list_in_a_study_file(here):
    study = STUDY[: STUDY.index("method")] + 'method = "list"\n'
    study += '[[variants]]\n"cables.lead.length" = 0.31\n[[variants]]\n"limits.clearance" = 0.001\n'
    found = read_study(placed(here, study)).variations
    assert expand(quantities(), found) == [{"cables.lead.length": 0.31}, {"limits.clearance": 0.001}]
    assert found.keys == ["cables.lead.length", "limits.clearance"]


def test_the_shipped_study():
    study = read_study(LIFT_ARM.parent / "tolerances.toml")
    planned = plan(study.problem, study.variations, study.command)
    assert len(set(planned.keys)) == 500
    lengths = [values["cables.lead.length"] for values in planned.variants]
    assert 0.2425 <= min(lengths) < 0.2426 and 0.2524 < max(lengths) <= 0.2525


def test_spreads_of_a_study_file(here):
    vary = """
"a" = [1, 2]
"b" = { values = [3, 4] }
"c" = { from = 0, to = 1, count = 3 }
"d" = { from = 0, to = 1 }
"e" = { plus_minus_percent = 5, distribution = "triangular", nominal = 2 }
"f" = { deviation_percent = 5 }
"""
    file = placed(here, STUDY[: STUDY.index("[vary]")] + "[vary]" + vary)
    assert read_study(file).variations.vary == {
        "a": [1, 2],
        "b": [3, 4],
        "c": [0.0, 0.5, 1.0],
        "d": Tolerance(0.5, nominal=0.5),
        "e": Tolerance(5, True, "triangular", None, 2),
        "f": Tolerance.normal(5, percent=True),
    }


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"flap.toml"', '"flop.toml"', 'problem: found "flop.toml", no such file (did you mean'),
        ('"monte carlo"', '"monte-carlo"', "method: found \"monte-carlo\", expected one of 'grid'"),
        ("samples = 8", "samples = 0", "samples: found 0"),
        ("samples = 8", "sample = 8", "sample: found an unknown key"),
        ("{ plus_minus = 0.01 }", "{ plus_minus = -1 }", "plus_minus: found -1, expected a number above 0"),
        ("{ plus_minus = 0.01 }", "{ plus = 1 }", "plus: found an unknown key"),
        ("{ plus_minus = 0.01 }", "3", 'vary."cables.lead.length": found 3, expected a table'),
        ("{ plus_minus = 0.01 }", "{}", "found no spread, expected plus_minus or deviation"),
        (
            "{ plus_minus = 0.01 }",
            "{ plus_minus = 1, deviation_percent = 3 }",
            "found deviation_percent and plus_minus",
        ),
        ("{ plus_minus = 0.01 }", "{ from = 2, to = 1 }", "from: found 2.0, expected a value below to"),
        ("{ plus_minus = 0.01 }", "{ from = 1, to = 2, count = 1 }", "count: found 1, expected at least 2"),
        ("{ plus_minus = 0.01 }", "{ deviation = 1, count = 4 }", "found count and deviation, expected plus_minus"),
        (
            "deviation = 15",
            'deviation = 15, distribution = "uniform"',
            'distribution: found "uniform" with a deviation',
        ),
        ("schema = 1", "schema = 2", "schema: found 2, expected 1"),
    ],
)
def test_mistakes_of_study_files(here, old, new, words):
    assert STUDY.count(old) == 1
    file = placed(here, STUDY.replace(old, new))
    with pytest.raises(ProblemError) as caught:
        read_study(file)
    assert all(line.startswith(f"{file}: ") for line in caught.value.mistakes)
    assert words in str(caught.value)
