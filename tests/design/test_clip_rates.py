"""Rates of a clipped cable with where its clips stand, how they turn and where they hold it, against differences."""

from __future__ import annotations

import collections
import functools

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.clearance.pairs import ClearanceResult
from harness_opt.design.margins import linearised
from harness_opt.model import design_variables
from harness_opt.model.design import Design
from harness_opt.motion.shape_rates import clamps_of_spans, shape_rates
from harness_opt.motion.sweep import cable_motion, in_turn, sweep

FRAMES = np.array([0.0, 0.35, 1.0])
ELEMENTS = 16  # the same for all, so that differences do not see a change of mesh
EXACT = 1e-5  # of the largest rate of a limit: what differences of shapes are good to
QUANTITIES = ("position", "curvature", "force", "moment")
SHARES = np.linspace(0.0, 1.0, 21)
SECTIONS = {
    "round": ho.Cable(0.5, 0.004, 0.010, 0.012, 0.05),
    "flat and bent": ho.Cable(0.5, 0.004, (0.010, 0.014), 0.012, 0.05, rest_curvature=(0.6, -0.5, 0.8)),
}


@functools.cache
def problem(section: str) -> ho.Problem:
    """Return a cable with two clips, the first fitted untwisted and turned on, the second in a roll by hand."""
    clips = (
        ho.Clip(name="elbow", at=0.17, position=(0.1, 0.02, 0.07), tangent=(1, 0.1, 0.1), body="a", turns=0.1),
        ho.Clip(name="wrist", at=0.33, position=(0.2, 0.05, 0.02), tangent=(0.8, 0.4, -0.5), roll_deg=40),
    )
    run = ho.CableRun(
        SECTIONS[section],
        ho.End((0, 0, 0), tangent=(0.87, 0.1, 0.5), body="a"),
        ho.End((0.3, 0.13, 0.04), tangent=(0.87, 0.2, 0.5), body="b", turns=0.2),
        clips=clips,
    )
    bodies = {
        "a": ho.Body(ho.Hinge((0.1, 0, 0), (0.2, 1, 0.3), 0.0, 0.1)),
        "b": ho.Body(ho.Hinge((0.1, 0.1, 0.05), (0.1, -0.4, 1), 0.0, 0.2)),
    }
    limits = ho.Limits(clip_force=3.0, clip_moment=0.3)
    bare = ho.Problem({"lead": run}, bodies, gravity=(1.0, 2.0, -9.0), limits=limits)
    variables = tuple(ho.Variable(name, -100, 100) for name in design_variables.names(bare))
    return bare.changed(design=Design(variables=variables))


NAMES = [variable.name for variable in problem("round").design.variables]
START = design_variables.values(problem("round")) + np.array(
    [2.0 * (j % 3 + 1) if "rotate" in name else 0.0 for j, name in enumerate(NAMES)]
)
SCALE = np.array([5.0 if "rotate" in name else 0.01 for name in NAMES])  # changes that count about the same


def swept_at(section: str, values: np.ndarray, near: dict | None):
    """Return the spans of the design ``values`` as they are followed."""
    swept = in_turn(
        design_variables.apply(problem(section), values),
        FRAMES,
        lambda apart, name, _: sweep(apart, name, FRAMES, elements=ELEMENTS, guesses=near and near[name].frames),
        "gauss-newton",
    )
    assert all(one.status.ok and len(one.rod.mesh) == ELEMENTS + 1 for one in swept.sweeps.values())
    return swept


def quantities(section: str, values: np.ndarray, near: dict) -> dict[str, np.ndarray]:
    """Return what is compared: shapes at fixed shares of each span, and the margins of what clips apply."""
    swept = swept_at(section, values, near)
    apart, sweeps = swept.problem, swept.sweeps
    shapes = {name: cable_motion(swept, SHARES) for name, swept in sweeps.items()}
    found = {f"{of} of {name}": getattr(shapes[name], of) for name in shapes for of in QUANTITIES}
    return found | {str(which): margin for which, (margin, _) in clip_rows(apart, shapes, {}, len(values)).items()}


def clip_rows(apart: ho.Problem, shapes: dict, rates: dict, count: int) -> dict:
    """Return margins (P,) and rates (P, k) of what each clip applies, by limit."""
    motion = ho.Motion(apart, FRAMES, shapes)
    rows = linearised(apart, motion, ClearanceResult(FRAMES, ()), rates, collections.defaultdict(float), count)
    limits = dict.fromkeys(which for which in rows.limit if which is not None and which.clip)
    chosen = {which: np.array([row == which for row in rows.limit]) for which in limits}
    return {which: (rows.margin[own], rows.rate[own]) for which, own in chosen.items()}


@functools.cache
def rates_and_differences(section: str) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return rates and differences by every variable, (..., k), of all :func:`quantities`."""
    swept = swept_at(section, START, None)
    apart, sweeps = swept.problem, swept.sweeps
    shapes = {name: cable_motion(swept, SHARES) for name, swept in sweeps.items()}
    clamps = clamps_of_spans(problem(section), START, FRAMES, swept)
    rates = {name: shape_rates(swept, clamps[name], SHARES) for name, swept in sweeps.items()}
    found = {f"{of} of {name}": getattr(rates[name], of) for name in rates for of in QUANTITIES}
    found |= {str(which): rate for which, (_, rate) in clip_rows(apart, shapes, rates, len(NAMES)).items()}
    columns = []
    for j, scale in enumerate(SCALE):
        step = 0.01 * scale
        q = {k: quantities(section, START + k * step * np.eye(len(NAMES))[j], sweeps) for k in (-2, -1, 1, 2)}
        columns.append({key: (8 * (q[1][key] - q[-1][key]) - (q[2][key] - q[-2][key])) / (12 * step) for key in found})
    return {key: (rate, np.stack([column[key] for column in columns], axis=-1)) for key, rate in found.items()}


SPANS = ("start to elbow", "elbow to wrist", "wrist to end")
COMPARED = [f"{of} of lead, {span}" for span in SPANS for of in QUANTITIES]
COMPARED += [
    f'{load}."lead, {span}".{clip}'
    for load in ("clip_force", "clip_moment")
    for span, clip in (("start to elbow", "elbow"), ("elbow to wrist", "wrist"))
]


@pytest.mark.parametrize("compared", COMPARED)
@pytest.mark.parametrize("section", SECTIONS)
def test_rates(section, compared):
    found, exact = rates_and_differences(section)[compared]
    size = np.max(np.abs(exact * SCALE))
    assert size > 0
    assert np.max(np.abs((found - exact) * SCALE)) < EXACT * size
