"""The rates of every limit's margin with every design variable, against simulating and measuring again."""

from __future__ import annotations

import collections
import dataclasses
import functools

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.clearance.measure import measure
from harness_opt.clearance.what_counts import arc_apart
from harness_opt.design.evaluation import GUARD, Evaluator
from harness_opt.design.margins import linearised
from harness_opt.model import design_variables
from harness_opt.model.design import Design
from harness_opt.motion.shape_rates import shape_rates
from harness_opt.motion.simulate import collect
from harness_opt.motion.sweep import sweep, swept_spans
from harness_opt.numerics import rotations
from harness_opt.parts.scene import load_scene
from oracles.problems import ROOT

SOLVER = "gauss-newton"
FRAMES = np.array([0.0, 0.35, 1.0])
ELEMENTS = 16  # the same for all, so that differences do not see a change of mesh
EXACT = 1e-5  # of the largest rate of a limit: what differences of shapes are good to
QUERIED = 1e-3  # the same where coal is asked, whose distances end at 1e-6
BETWEEN = 1e-2  # the same between cables: chords stand for them, which misses the nearest points by a little


HELD = tuple(rotations.from_tangent((0.87, 0, -0.5), 0.0).tolist())  # by the part "clamp"


def turned(*angles: float) -> tuple[float, ...]:
    return tuple(rotations.from_rotation_vector(np.array(angles)).tolist())


@functools.cache
def problem() -> ho.Problem:
    """Return two heavy cables between two hinged bodies: one crosses itself at a distance, the other passes near.

    Every limit is given; a ball stands still, another moves with one of the bodies that hold the cables.
    """
    lead = ho.Cable(0.42, 0.004, (0.010, 0.014), 0.012, 0.05, rest_curvature=(0.6, -0.5, 0.8))
    loom = ho.Cable(0.37, 0.005, 0.015, 0.012, 0.03)
    cables = {
        "lead": ho.CableRun(
            lead,
            ho.End((0, 0, 0), tuple(rotations.from_tangent((0.87, 0, 0.5), 0.0).tolist()), body="a"),
            ho.End((0.06, 0.03, 0.01), HELD, turns=-2, body="b", holders=("clamp",)),
        ),
        "loom": ho.CableRun(
            loom,
            ho.End((0.05, -0.04, 0.03), turned(0.1, 0.2, 0.3), body="b"),
            ho.End((0.02, 0.11, 0.15), turned(-0.9, 0.1, 0.2)),
        ),
    }
    bodies = {
        "a": ho.Body(ho.Hinge((0.1, 0, 0), (0.2, 1, 0.3), 0.0, 0.1)),
        "b": ho.Body(ho.Hinge((0.1, 0.1, 0.05), (0.1, -0.4, 1), 0.0, 0.2)),
    }
    parts = {
        "still": ho.Part(ho.Sphere(0.02), position=(0.0, 0.06, 0.10)),
        "carried": ho.Part(ho.Sphere(0.015), body="b", position=(0.11, 0.05, -0.06)),
        "clamp": ho.Part(ho.Sphere(0.004), body="b", position=(0.075, 0.03, 0.002)),
    }
    limits = ho.Limits(0.003, 0.02, 6.0, 2.0, 0.2)
    bare = ho.Problem(cables, bodies, parts, (1.0, 2.0, -9.0), limits)
    names = design_variables.names(bare)
    variables = tuple(ho.Variable(name, -100, 100) for name in names)
    return bare.changed(design=Design(variables=variables))


NAMES = [variable.name for variable in problem().design.variables]
START = design_variables.values(problem()) + np.array(
    [2.0 * (j % 3 + 1) if "rotate" in name else 0.0 for j, name in enumerate(NAMES)]
)
SCALE = np.array([5.0 if "rotate" in name else 0.01 for name in NAMES])  # changes that count about the same


def rows_at(values: np.ndarray, near: dict | None, rated: bool):
    """Return the rows of the design ``values``, and its sweeps."""
    changed = design_variables.apply(problem(), values)
    sweeps = {
        name: sweep(changed, name, FRAMES, elements=ELEMENTS, guesses=near and near[name].frames)
        for name in changed.cables
    }
    assert all(swept.status.ok and not swept.snaps and len(swept.rod.mesh) == ELEMENTS + 1 for swept in sweeps.values())
    motion = collect(swept_spans(changed, changed, sweeps), FRAMES, 0.0)
    clearances = measure(changed, load_scene(changed), FRAMES, motion.cables)
    rates = {}
    if rated:
        for name, swept in sweeps.items():
            clamps = design_variables.clamp_rates(problem(), name, values, FRAMES)
            rates[name] = shape_rates(swept, clamps, motion.cables[name].s / swept.units.length)
    asked = collections.defaultdict(float)
    return linearised(changed, motion, clearances, rates, asked, len(values)), sweeps


def worst(rows) -> dict[tuple[str, int], int]:
    """Return the number of the worst row of each limit and frame."""
    found: dict[tuple[str, int], int] = {}
    for number in np.argsort(-rows.margin, kind="stable"):
        found[rows.limit[number].words, int(rows.frame[number])] = int(number)
    return found


@functools.cache
def rates_and_differences() -> tuple[dict, dict]:
    """Return rates (k,) and differences (k,) of the worst margin of each limit in each frame."""
    rows, sweeps = rows_at(START, None, True)
    found = {key: rows.rate[number] for key, number in worst(rows).items()}
    expected = {key: np.zeros(len(NAMES)) for key in found}
    for j in range(len(NAMES)):
        step = 0.01 * SCALE[j]
        sides = {}
        for k in (-2, -1, 1, 2):
            side = rows_at(START + k * step * np.eye(len(NAMES))[j], sweeps, False)[0]
            sides[k] = {key: side.margin[number] for key, number in worst(side).items()}
        for key, column in expected.items():
            q = {k: side[key] for k, side in sides.items()}
            column[j] = (8 * (q[1] - q[-1]) - (q[2] - q[-2])) / (12 * step)
    return found, expected


OF_EACH = ("bend radius", "twist", "clamp force", "clamp moment")
LIMITS = [
    *(f"{kind} of {cable}" for cable in ("lead", "loom") for kind in OF_EACH),
    *(f"clearance of {cable} to {part}" for cable in ("lead", "loom") for part in ("still", "carried", "clamp")),
    "clearance of lead to itself",
    "clearance of lead to cable loom",
    "clearance of loom to itself",
]


def test_every_limit_is_tried():
    assert {name for name, _ in rates_and_differences()[0]} == set(LIMITS)


@pytest.mark.parametrize("limit", LIMITS)
def test_rates(limit):
    found, expected = rates_and_differences()
    for (name, frame), exact in expected.items():
        if name == limit:
            size = np.max(np.abs(exact * SCALE))
            assert size > 0
            close = BETWEEN if limit.endswith((" itself", " cable loom")) else QUERIED if " to " in limit else EXACT
            for j, variable in enumerate(NAMES):
                assert abs((found[name, frame] - exact)[j] * SCALE[j]) < close * size, (variable, frame)


def test_the_edges_of_what_counts_are_met():
    # where a clamp's own body is near, the nearest point that counts does not move along the cable with its length
    rows = rows_at(START, None, False)[1]
    changed = design_variables.apply(problem(), START)
    motion = collect(swept_spans(changed, changed, rows), FRAMES, 0.0)
    clearances = measure(changed, load_scene(changed), FRAMES, motion.cables)
    pairs = {(pair.cable, pair.obstacle.key): pair for pair in clearances.pairs}
    clamp, itself = pairs["lead", "clamp"], pairs["loom", "cable:loom"]
    length = changed.cables["lead"].cable.length
    assert clamp.excluded[1] > 0
    assert clamp.nearest.arc_length == pytest.approx(length - clamp.excluded[1])
    apart = itself.nearest.other_arc_length - itself.nearest.arc_length
    assert apart == pytest.approx(arc_apart(0.0025, 0.003))


def test_a_design_sees_a_cable_go_through_itself():
    """Four turns that the first shape got rid of: the frames show nothing near itself, a design does not hold."""
    drawn = ho.read_problem(ROOT / "tests" / "reference" / "verdict" / "turns.toml")
    variables = (ho.Variable("hose.length", 0.99, 1.1),)
    evaluate = Evaluator(
        dataclasses.replace(drawn, design=Design(variables=variables)), load_scene(drawn), SOLVER, None
    )
    first = evaluate(np.array([1.0]), None)
    assert first is not None
    near = evaluate(np.array([1.001]), first)  # which begins with the shapes of the first
    assert near is not None
    for design in (first, near):
        which = design.rows.limit[design.worst]
        assert str(which) == "clearance.hose.cable:hose"
        scale = design.rows.scale[design.worst]
        assert design.rows.margin[design.worst] * scale == pytest.approx(-0.013, abs=2 * GUARD * scale)
