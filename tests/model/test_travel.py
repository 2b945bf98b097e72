"""What a motion is told in: each body's own unit, with per cent beside, there and back too."""

from __future__ import annotations

import dataclasses
import math

import pytest

import harness_opt as ho
from harness_opt.files.summary import moments_of
from harness_opt.model.problem import Moments
from harness_opt.report.summary import summary
from oracles.problems import shipped

HINGE = ho.Body(ho.Hinge((0, 0, 0), (0, 1, 0), math.radians(-10), math.radians(110)))
SLIDE = ho.Body(ho.Slide((1, 0, 0), 0.0, 0.25))
TABLE = ho.Body(ho.Poses((2.0, 3.0, 6.0), ((0, 0, 0),) * 3, ((1, 0, 0, 0),) * 3))


def moments(duration: float = 4.0, **bodies: ho.Body) -> Moments:
    return shipped("lift_arm").changed(bodies=bodies, duration=duration).moments


@pytest.mark.parametrize(
    ("bodies", "at", "words", "short"),
    [
        ({"lid": HINGE}, 0.5, "50.0 deg, 50.0 %", "50.0 deg"),
        ({"tray": SLIDE}, 0.1, "25.0 mm, 10.0 %", "25.0 mm"),
        ({"tool": TABLE}, 0.25, "3.00 s, 25.0 %", "3.00 s"),
        ({"lid": HINGE, "tray": SLIDE}, 1.0, "lid 110.0 deg, tray 250.0 mm, 100.0 %", "4.00 s"),
        ({"a": HINGE, "b": SLIDE, "c": TABLE}, 0.5, "2.00 s, 50.0 %", "2.00 s"),
        ({"still": ho.Body()}, 0.5, "50.0 %", ""),
    ],
)
def test_moments_are_told_in_the_unit_of_what_moves(bodies, at, words, short):
    found = moments(**bodies)
    assert found.words(at) == words
    assert found.short(at) == short


def test_the_way_back_is_said():
    found = dataclasses.replace(moments(lid=HINGE), out_and_back=True)
    assert found.words(0.25) == "50.0 deg, 25.0 %"
    assert found.words(0.75) == "50.0 deg on the way back, 75.0 %"
    assert found.words(1.0) == "-10.0 deg on the way back, 100.0 %"


def test_a_summary_tells_its_moments_alone():
    problem = shipped("lift_arm")
    content = summary(ho.simulate(problem, frames=[0.0, 0.5]))
    assert [moments_of(content).words(at) for at in (0.0, 0.3)] == ["0.0 deg, 0.0 %", "33.0 deg, 30.0 %"]
    del content["path"]
    assert moments_of(content).words(0.5) == "50.0 %", "of an older version"
