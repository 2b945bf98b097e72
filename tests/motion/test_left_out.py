"""What a scene does not need is left out, and what it does need is not: a cable that tips is not drawn flat."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy import integrate

import harness_opt as ho
from harness_opt.model.problem import left_out
from harness_opt.numerics import rotations
from oracles.elastica import Elastica

ALONG_X = tuple(rotations.from_tangent((1, 0, 0)).tolist())
TIPS_BELOW = 0.446  # end distance over length where the clamped elastica of kz/kx = 0.7 leaves its plane


def arch(first: float, last: float) -> ho.Problem:
    """Return an elastica of kz/kx = 0.7 whose end slides from one distance to another; the scene is planar."""
    run = ho.CableRun(
        ho.Cable(1.0, 0.01, 1.0, 0.7), ho.End((0, 0, 0), ALONG_X), ho.End((0, 0, 0), ALONG_X, body="slide"),
        bow=(0, 0, 1),
    )  # fmt: skip
    return ho.Problem({"lead": run}, {"slide": ho.Body(ho.Slide((1, 0, 0), first, last))})


def out_of_plane(position: np.ndarray) -> float:
    """Return how far a centreline (N, 3) lies off the plane through it that fits best."""
    return float(np.linalg.svd(position - position.mean(axis=0), compute_uv=False)[-1]) / np.sqrt(len(position))


def energy_of_the_planar_arch(distance: float) -> float:
    """Return half the integral of the squared curvature, 2 k lam cn(lam s), of the planar shape."""
    exact = Elastica.between(distance)
    s = np.linspace(0.0, 1.0, 2001)
    angle = 2 * np.arctan2(np.gradient(exact.plane(s)[:, 1], s), 1 + np.gradient(exact.plane(s)[:, 0], s))
    return float(integrate.simpson(0.5 * np.gradient(angle, s) ** 2, x=s))


def test_an_elastica_that_tips_is_not_drawn_flat():
    motion = ho.simulate(arch(0.6, 0.3))
    lead = motion.cables["lead"]
    distances = np.linalg.norm(lead.position[:, -1] - lead.position[:, 0], axis=1)
    off = np.array([out_of_plane(r) for r in lead.position])
    assert motion.ok and np.all(lead.stable)
    assert np.all(off[distances > TIPS_BELOW + 0.02] < 1e-6)
    assert np.all(off[distances < TIPS_BELOW - 0.02] > 0.01)
    found = integrate.simpson(0.5 * lead.curvature[-1] ** 2 @ np.array([1.0, 1.0, 0.7]), x=lead.s)
    assert found < energy_of_the_planar_arch(distances[-1]) - 0.1


def test_one_that_does_not_tip_stays_in_its_plane():
    lead = ho.simulate(arch(0.7, 0.5)).cables["lead"]
    assert max(out_of_plane(r) for r in lead.position) < 1e-6


@pytest.mark.parametrize(
    ("limits", "named"), [(ho.Limits(), True), (ho.Limits(clearance=0.001), False)], ids=["no limit", "limit"]
)
def test_clearance_that_nobody_asked_for_is_left_out(limits, named):
    problem = dataclasses.replace(arch(0.6, 0.5), limits=limits)
    words = "clearance of cables to each other and to themselves"
    assert (words in left_out(problem)) == named
    report = ho.clearances(ho.simulate(problem))
    assert (len(report.pairs) == 0) == named


def test_weight_is_left_out_where_it_is_none():
    light = arch(0.6, 0.5)
    assert {"weight", "parts", "other cables"} <= set(left_out(light))
    heavy = dataclasses.replace(
        light,
        gravity=(0, 0, -9.81),
        cables={k: dataclasses.replace(r, cable=ho.Cable(1.0, 0.01, 1.0, 0.7, 0.1)) for k, r in light.cables.items()},
    )
    assert "weight" not in left_out(heavy)
