from __future__ import annotations

import pytest

import harness_opt as ho
from harness_opt.model.results import Motion
from oracles.report_scene import flap


@pytest.fixture(scope="module")
def motion() -> Motion:
    return ho.simulate(flap())


@pytest.fixture(scope="module")
def design():
    ball = {"ball": ho.Part(ho.Sphere(0.02), position=(0.08, 0.01, 0.092))}
    return ho.redesign(flap(parts=ball, design=ho.Design("change", (ho.Variable("lead.length", 0.25, 0.45),))))
