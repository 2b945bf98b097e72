"""Rates of shapes whose roll is fitted anew for every design, against fitting and simulating again."""

from __future__ import annotations

import functools

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.model import design_variables
from harness_opt.model.design import Design
from harness_opt.motion.shape_rates import shape_rates
from harness_opt.motion.sweep import cable_motion, sweep

FRAMES = np.array([0.0, 0.35, 1.0])
ELEMENTS = 16  # the same for all, so that differences do not see a change of mesh
EXACT = 1e-5  # of the largest rate, what differences of shapes are good to

SECTIONS = {
    "round": ho.Cable(0.42, 0.004, 0.010, 0.012, 0.05),
    "flat and bent": ho.Cable(0.42, 0.004, (0.010, 0.014), 0.012, 0.05, rest_curvature=(0.6, -0.5, 0.8)),
}
ENDS = {
    "both": ({"turns": 0.1}, {"turns": 0.3}),
    "end": ({"roll_deg": 20}, {"turns": 0.2}),
    "start": ({}, {"roll_deg": -15}),
    "start turned": ({"turns": 0.15}, {"roll_deg": 70, "turns": 0}),
    "swivel": ({"roll_deg": 10}, {"roll": "free"}),
}
CASES = [(section, ends) for section in SECTIONS for ends in ENDS]


def problem(section: str, ends: str) -> ho.Problem:
    """Return a heavy cable between two hinged bodies, fitted in the middle of the motion."""
    start, end = ENDS[ends]
    run = ho.CableRun(
        SECTIONS[section],
        ho.End((0, 0, 0), tangent=(0.87, 0.1, 0.5), body="a", **start),
        ho.End((0.16, 0.03, 0.01), tangent=(0.87, 0.2, -0.5), body="b", **end),
        fitted_at=0.35,
    )
    bodies = {
        "a": ho.Body(ho.Hinge((0.1, 0, 0), (0.2, 1, 0.3), 0.0, 0.1)),
        "b": ho.Body(ho.Hinge((0.1, 0.1, 0.05), (0.1, -0.4, 1), 0.0, 0.2)),
    }
    bare = ho.Problem({"lead": run}, bodies, gravity=(1.0, 2.0, -9.0))
    variables = tuple(ho.Variable(name, -100, 100) for name in design_variables.names(bare))
    return ho.Problem({"lead": run}, bodies, gravity=(1.0, 2.0, -9.0)).changed(design=Design(variables=variables))


@functools.cache
def rates(section: str, ends: str):
    """Return rates and differences of positions, curvatures and moments by every variable, and the variables."""
    drawn = problem(section, ends)
    names = [variable.name for variable in drawn.design.variables]
    begin = design_variables.values(drawn)
    begin = begin + np.array([2.0 * (j % 3 + 1) if "rotate" in name else 0.0 for j, name in enumerate(names)])

    def swept(values, near):
        changed = design_variables.apply(drawn, values)
        found = sweep(
            changed, "lead", FRAMES, elements=ELEMENTS, guesses=near and near.frames, near=near and near.fitted
        )
        assert found.status.ok and not found.snaps and len(found.rod.mesh) == ELEMENTS + 1
        return found

    here = swept(begin, None)
    clamps = design_variables.clamp_rates(drawn, "lead", begin, FRAMES)
    stations = cable_motion(here).s / here.units.length
    exact = shape_rates(here, clamps, stations)
    fields = ("position", "curvature", "moment")
    found = {field: getattr(exact, field) for field in fields}
    expected = {field: np.zeros_like(found[field]) for field in fields}
    scale = np.array([5.0 if "rotate" in name else 0.01 for name in names])
    for j in range(len(names)):
        step = 0.01 * scale[j]
        sides = {k: cable_motion(swept(begin + k * step * np.eye(len(names))[j], here)) for k in (-2, -1, 1, 2)}
        for field in fields:
            q = {k: getattr(side, field) for k, side in sides.items()}
            expected[field][..., j] = (8 * (q[1] - q[-1]) - (q[2] - q[-2])) / (12 * step)
    return names, scale, found, expected


@pytest.mark.parametrize(("section", "ends"), CASES)
def test_rates_with_a_fitted_roll(section, ends):
    names, scale, found, expected = rates(section, ends)
    for field, exact in expected.items():
        size = np.max(np.abs(exact * scale))
        assert size > 0
        for j, name in enumerate(names):
            assert np.max(np.abs(found[field] - exact)[..., j]) * scale[j] < EXACT * size, (field, name)


@pytest.mark.parametrize(("section", "ends"), CASES)
def test_a_drawn_end_keeps_its_words(section, ends):
    drawn = problem(section, ends)
    names = [variable.name for variable in drawn.design.variables]
    values = design_variables.values(drawn)
    values[names.index("lead.end.rotate_z_deg")] = 45.0
    values[names.index("lead.start.rotate_x_deg")] = 10.0
    before, after = drawn.cables["lead"], design_variables.apply(drawn, values).cables["lead"]
    for side in ("start", "end"):
        old, new = getattr(before, side), getattr(after, side)
        assert new.quaternion is None and new.tangent is not None and new.roll == old.roll
        assert (new.roll_deg is None) == (old.roll_deg is None)
    if before.end.roll == "untwisted":
        assert after.end.turns == pytest.approx(before.end.turns + 0.125) and after.end.tangent == before.end.tangent
