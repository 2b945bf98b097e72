"""Redesigns that may do without clips, and limits of how far cables slide through them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.design.evaluation import Evaluator
from harness_opt.model.design import Design, Robust
from harness_opt.parts.scene import load_scene


def row(**limits: float) -> ho.Problem:
    """Return a cable in two optional clips over a floor far below, its end on a slide."""
    clips = (
        ho.Clip(name="one", at=0.21, position=(0.2, 0, 0.02), tangent=(1, 0, 0), roll_deg=0, optional=True),
        ho.Clip(name="two", kind="sleeve", at=0.42, position=(0.4, 0, 0.0), tangent=(1, 0, 0), optional=True),
    )
    run = ho.CableRun(
        ho.Cable(0.64, 0.006, 0.02, 0.015, 0.05),
        ho.End((0, 0, 0), tangent=(1, 0, 0), roll_deg=0),
        ho.End((0.6, 0, 0), tangent=(1, 0, 0), roll_deg=0, body="slide"),
        clips=clips,
    )
    variables = (ho.Variable("lead.length", 0.635, 0.66), ho.Variable("lead.one.position.z", 0.0, 0.04))
    return ho.Problem(
        {"lead": run},
        {"slide": ho.Body(ho.Slide((1, 0, 0), 0.0, -0.03))},
        {"floor": ho.Part(ho.Box((1, 1, 0.01)), position=(0.3, 0, -0.4))},
        gravity=(0, 0, -9.81),
        limits=ho.Limits(**{"clearance": 0.01, **limits}),
        design=Design(variables=variables, minimise="clips"),
        spatial_step=0.01,
    )


def test_what_holds_without_clips_does_without_them():
    found = ho.redesign(row())
    assert found.ok
    assert found.without == ("lead.one", "lead.two")
    assert not found.problem.cables["lead"].clips
    assert list(found.variables) == ["lead.length"]  # that of a clip which is gone is gone too


@pytest.mark.parametrize(
    ("changes", "options", "words"),
    [
        ({}, {"pareto": ("length", "clearance")}, "for a trade-off curve"),
        ({"robust": Robust({"cables.lead.length": ho.Tolerance(0.001)})}, {}, "where tolerances are held"),
    ],
)
def test_what_fewest_clips_are_not_for(changes, options, words):
    with pytest.raises(ho.ProblemError, match=words):
        ho.redesign(dataclasses.replace(row(), **changes), **options)


def test_travel_and_its_rate():
    """The largest less the smallest arc length in the sleeve; its row falls with the length as differences say."""
    problem = dataclasses.replace(row(travel=0.01), design=Design(variables=(ho.Variable("lead.length", 0.635, 0.66),)))
    evaluate = Evaluator(problem, load_scene(problem), "gauss-newton", None)

    def travel(length: float):
        found = evaluate(np.array([length]), None)
        (number,) = (
            k for k, limit in enumerate(found.rows.limit) if limit is not None and limit.kind.value == "travel"
        )
        places = found.motion.problem.found["lead, two"].places
        assert found.rows.margin[number] == pytest.approx(
            1.0 - np.ptp(places) / 0.01 - evaluate.asked[found.rows.limit[number]]
        )
        return float(found.rows.margin[number]), float(found.rows.rate[number, 0])

    step = 1e-4
    ahead, here, behind = (travel(0.645 + sign * step) for sign in (1, 0, -1))
    assert here[1] == pytest.approx((ahead[0] - behind[0]) / (2 * step), rel=1e-3)
