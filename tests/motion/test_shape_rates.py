"""The rates of shapes by design variables against simulating again."""

from __future__ import annotations

import dataclasses
import functools
import itertools

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.model import design_variables
from harness_opt.model.design import Design
from harness_opt.motion.shape_rates import shape_rates
from harness_opt.motion.sweep import cable_motion, sweep
from harness_opt.numerics import rotations

FRAMES = np.array([0.0, 0.4, 1.0])
ELEMENTS_OF_THE_SWEEP = 16  # the same for all, so that differences do not see a change of mesh
QUANTITIES = ("position", "curvature", "force", "moment")


def ends(held: str) -> tuple[ho.End, ho.End]:
    start = ho.End((0.02, -0.05, 0.01), tuple(rotations.normalise([0.9, 0.3, 0.2, -0.1])), body="a")
    end = ho.End((0.03, 0.02, -0.04), tuple(rotations.normalise([0.5, 0.6, -0.3, 0.4])), body="b")
    if held == "end free":
        end = ho.End(force=(0.4, -0.3, 0.2), moment=(0.01, 0.02, -0.03))
    if held == "end pinned":
        end = dataclasses.replace(end, quaternion=None, moment=(0.01, 0.02, -0.03))
    if held == "start guided":
        start = dataclasses.replace(start, position=None, force=(0.2, -0.1, 0.3))
    if held == "start pinned":
        start = dataclasses.replace(start, quaternion=None, moment=(0.01, 0.02, -0.03))
    return start, end


@functools.cache
def problem(held: str) -> ho.Problem:
    """Return a heavy, precurved, flat cable between two hinged bodies."""
    cable = ho.Cable(0.6, 0.006, (0.01, 0.02), 0.012, 0.05, rest_curvature=(1.0, -0.5, 0.8))
    start, end = ends(held)
    bodies = {
        "a": ho.Body(ho.Hinge((0.1, 0, 0), (0.2, 1, 0.3), 0.3, 0.4)),
        "b": ho.Body(ho.Hinge((0.35, 0.1, 0.2), (0.1, -0.4, 1), 0.9, 0.7)),
    }
    bare = ho.Problem({"lead": ho.CableRun(cable, start, end)}, bodies, gravity=(1.0, 2.0, -9.0))
    variables = tuple(ho.Variable(name, -100, 100) for name in design_variables.names(bare))
    return bare.changed(design=Design(variables=variables))


def swept(problem: ho.Problem, near=None):
    found = sweep(problem, "lead", FRAMES, tolerance=1e-7, elements=ELEMENTS_OF_THE_SWEEP, guesses=near and near.frames)
    assert found.status.ok and not found.snaps
    assert len(found.rod.mesh) == ELEMENTS_OF_THE_SWEEP + 1
    return found


@functools.cache
def rates_and_differences(held: str, turned: bool):
    """Return rates and differences (P, N, 3, k) by quantity, and the variables' names."""
    base = problem(held)
    names = [variable.name for variable in base.design.variables]
    values = design_variables.values(base)
    if turned:  # the axes of later turns are carried along by the ones before
        values = values + np.array([5.0 * (j % 3 + 1) if "rotate" in n else 0.0 for j, n in enumerate(names)])
    here = swept(design_variables.apply(base, values))
    stations = np.linspace(0, 1, 101)
    found = shape_rates(here, design_variables.clamp_rates(base, "lead", values, FRAMES), stations)
    columns = {quantity: [] for quantity in QUANTITIES}
    for j, name in enumerate(names):
        step = 0.03 if "rotate" in name else 3e-4

        def at(change: float, j: int = j) -> object:
            moved = design_variables.apply(base, values + change * np.eye(len(names))[j])
            return cable_motion(swept(moved, here))

        sides = {k: at(k * step) for k in (-2, -1, 1, 2)}
        for quantity, column in columns.items():
            q = {k: getattr(side, quantity) for k, side in sides.items()}
            column.append((8 * (q[1] - q[-1]) - (q[2] - q[-2])) / (12 * step))
    return found, {quantity: np.stack(column, axis=-1) for quantity, column in columns.items()}, names


@pytest.mark.parametrize("quantity", QUANTITIES)
@pytest.mark.parametrize(
    ("held", "turned"),
    [
        ("clamped", False),
        ("clamped", True),
        ("end free", False),
        ("end pinned", False),
        ("start guided", False),
        ("start pinned", False),
    ],
)
def test_shape_rates(held, turned, quantity):
    found, expected, names = rates_and_differences(held, turned)
    assert np.all(np.isfinite(expected[quantity]))
    for j, name in enumerate(names):
        exact = expected[quantity][..., j]
        size = np.max(np.abs(exact))
        worst = np.max(np.abs(getattr(found, quantity)[..., j] - exact))
        floor = np.max(np.abs(expected[quantity])) * 1e-12  # rounding of a quantity that does not change
        assert worst < 2e-6 * size + floor, name


def test_every_kind_of_variable_is_tried():
    names = {name.removeprefix("lead.") for name in rates_and_differences("clamped", False)[2]}
    wanted = {"length"}
    for side, axis in itertools.product(("start", "end"), "xyz"):
        wanted |= {f"{side}.position.{axis}", f"{side}.rotate_{axis}_deg"}
    assert names == wanted
