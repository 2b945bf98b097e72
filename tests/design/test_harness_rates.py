"""The rates of a harness's shapes with every design variable, against designs that are solved again."""

from __future__ import annotations

import functools
import itertools

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.model import design_variables
from harness_opt.model.design import Design
from harness_opt.motion.shape_rates import clamps_of_spans, shape_rates
from harness_opt.motion.sweep import SweptSpans, cable_motion, in_turn, sweep
from harness_opt.numerics import rotations

FRAMES = np.array([0.0, 0.4])
ELEMENTS = 16  # the same for all, so that differences do not see a change of mesh
SHARES = np.array([0.0, 0.25, 0.6, 1.0])
QUANTITIES = ("position", "curvature", "force", "moment")
EXACT = 1e-4  # of the largest rate: what central differences of shapes are good to


def clips_of_all_kinds() -> ho.Problem:
    """Return a flat cable through a swivel, a sleeve, a pivot and a ring, its end fitted untwisted and turned on."""
    clips = (
        ho.Clip(name="swivel", at=0.15, kind="swivel", position=(0.1, 0.02, 0.07), tangent=(1, 0.3, 0.1), body="a"),
        ho.Clip(name="sleeve", at=0.3, kind="sleeve", position=(0.2, 0.06, 0.05), tangent=(0.8, 0.4, -0.2)),
        ho.Clip(name="pivot", at=0.42, kind="pivot", position=(0.28, 0.12, 0.03)),
        ho.Clip(name="ring", at=0.55, kind="ring", position=(0.36, 0.2, 0.04), body="b"),
    )
    cable = ho.Cable(0.72, 0.006, (2e-3, 6e-3), 2.5e-3, 0.08)
    run = ho.CableRun(
        cable,
        ho.End((0, 0, 0), tangent=(0.87, 0.1, 0.5), roll_deg=10, body="a"),
        ho.End((0.48, 0.24, 0.1), tangent=(0.87, 0.2, 0.5), body="b", turns=0.1),
        clips=clips,
        fitted_at=0.2,
    )
    bodies = {
        "a": ho.Body(ho.Hinge((0.1, 0, 0), (0.2, 1, 0.3), 0.0, 0.1)),
        "b": ho.Body(ho.Hinge((0.3, 0.1, 0.05), (0.1, -0.4, 1), 0.0, 0.2)),
    }
    return ho.Problem({"lead": run}, bodies, gravity=(1.0, 2.0, -9.0))


def branches() -> ho.Problem:
    """Return a trunk that branches in a splice, one branch through a swivel on another body that hangs."""
    thick, thin = ho.Cable(0.3, 0.008, 0.02, 0.015, 0.2), ho.Cable(0.25, 0.006, (0.01, 0.006), 0.008, 0.1)
    on = ho.Clip(name="bead", at=0.12, kind="swivel", position=(0, 0.004, 0), tangent=(1, 0, 0), body="bead")
    held = {"roll_deg": 0.0}
    cables = {
        "trunk": ho.CableRun(
            thick, ho.End((0, 0, 0.2), tangent=(1, 0, 0)), ho.End((-0.01, 0, 0), tangent=(1, 0, 0), body="splice")
        ),
        "a": ho.CableRun(
            thin,
            ho.End((0.01, 0.005, 0), tangent=(1, 0.3, 0), body="splice", **held),
            ho.End((0.45, 0.1, 0.2), tangent=(0, 0, 1), body="arm", **held),
        ),
        "b": ho.CableRun(
            thin,
            ho.End((0.01, -0.005, 0), tangent=(1, -0.3, 0), body="splice", **held),
            ho.End((0.43, -0.1, 0.15), tangent=(0, 0, 1), **held),
            clips=(on,),
        ),
    }
    bodies = {
        "splice": ho.Body(free=True, mass=0.02),
        "bead": ho.Body(free=True, mass=0.01),
        "arm": ho.Body(ho.Hinge((0.45, 0.1, 0.1), (0, 1, 0), -0.3, 0.2)),
    }
    return ho.Problem(cables, bodies, gravity=(0, 0, -9.81))


SCENES = {"clips": clips_of_all_kinds, "branches": branches}
VARIABLES = {
    "clips": (
        "lead.length",
        "lead.start.rotate_y_deg",
        "lead.swivel.at",
        "lead.swivel.rotate_x_deg",
        "lead.sleeve.rotate_y_deg",
        "lead.sleeve.position.x",
        "lead.pivot.at",
        "lead.pivot.position.y",
        "lead.ring.position.z",
        "lead.end.rotate_x_deg",
        "lead.end.rotate_z_deg",
    ),
    "branches": (
        "trunk.length",
        "trunk.end.position.y",
        "trunk.end.rotate_x_deg",
        "a.length",
        "a.start.position.y",
        "a.start.rotate_z_deg",
        "b.bead.at",
        "b.bead.position.y",
    ),
}


@functools.cache
def problem(scene: str) -> ho.Problem:
    """Return a scene with its variables."""
    variables = tuple(ho.Variable(name, -100, 100) for name in VARIABLES[scene])
    return SCENES[scene]().changed(design=Design(variables=variables))


def swept_at(scene: str, values: np.ndarray, near: SweptSpans | None) -> SweptSpans:
    """Return the spans of the design ``values``, found again from those ``near``."""
    swept = in_turn(
        design_variables.apply(problem(scene), values),
        FRAMES,
        lambda apart, name, harness: sweep(apart, name, FRAMES, elements=ELEMENTS, harness=harness),
        "gauss-newton",
        between=False,
        near=near and near.harnesses,
    )
    assert all(one.status.ok for one in swept.sweeps.values())
    return swept


@functools.cache
def rates_and_differences(scene: str) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Return rates and differences by every variable, (..., k), of all quantities, and how large changes are, (k,)."""
    names = [variable.name for variable in problem(scene).design.variables]
    scale = np.array([5.0 if "rotate" in name else 0.01 for name in names])
    start = design_variables.values(problem(scene))
    start = start + np.array([2.0 * (j % 3 + 1) if "rotate" in name else 0.0 for j, name in enumerate(names)])
    swept = swept_at(scene, start, None)
    clamps = clamps_of_spans(problem(scene), start, FRAMES, swept)
    rates = {name: shape_rates(one, clamps[name], SHARES) for name, one in swept.sweeps.items()}
    found = {f"{of} of {name}": getattr(rates[name], of) for name in rates for of in QUANTITIES}

    def quantities(values: np.ndarray) -> dict[str, np.ndarray]:
        again = swept_at(scene, values, swept)
        shapes = {name: cable_motion(one, SHARES) for name, one in again.sweeps.items()}
        return {f"{of} of {name}": getattr(shapes[name], of) for name in shapes for of in QUANTITIES}

    columns = []
    for j in range(len(names)):
        step = 0.01 * scale[j]
        ahead, behind = (quantities(start + k * step * np.eye(len(names))[j]) for k in (1, -1))
        columns.append({key: (ahead[key] - behind[key]) / (2 * step) for key in found})
    return {key: (rate, np.stack([column[key] for column in columns], axis=-1), scale) for key, rate in found.items()}


ROW = ("start", "swivel", "sleeve", "pivot", "ring", "end")
SPANS = {
    "clips": [f"lead, {before} to {behind}" for before, behind in itertools.pairwise(ROW)],
    "branches": ["trunk", "a", "b, start to bead", "b, bead to end"],
}


@pytest.mark.parametrize("compared", QUANTITIES)
@pytest.mark.parametrize(("scene", "span"), [(scene, span) for scene, spans in SPANS.items() for span in spans])
def test_rates(scene, span, compared):
    found, exact, scale = rates_and_differences(scene)[f"{compared} of {span}"]
    size = np.max(np.abs(exact * scale))
    assert size > 0
    assert np.max(np.abs((found - exact) * scale)) < EXACT * size


def test_frames_of_clips_are_unit_quaternions_that_the_sections_stand_in():
    swept = swept_at("clips", design_variables.values(problem("clips")), None)
    for clip, before in (("swivel", "lead, start to swivel"), ("ring", "lead, pivot to ring")):
        found, run = swept.whole.found[f"lead, {clip}"], swept.problem.cables[before]
        body = swept.problem.poses(run.end.body, FRAMES)[1]
        frames = np.array([frame.rod.q[-1] for frame in swept.sweeps[before].frames])
        world = rotations.multiply(body, found.quaternions)
        assert np.max(np.abs(np.abs(np.sum(world * frames, axis=1)) - 1.0)) < 1e-9
