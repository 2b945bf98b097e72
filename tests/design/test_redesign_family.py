"""A few scenes of ``scripts/benchmarks/redesign_family.py``: with a design that is known, and with none."""

from __future__ import annotations

import pytest

import harness_opt as ho
from harness_opt.model.design_variables import apply
from oracles.scripts import script


@pytest.fixture
def family():
    return script("redesign_family")


@pytest.mark.parametrize("seed", [0, 2, 13])  # 13: two shapes at one pose, and the bounds hold the edge between them
def test_a_design_that_exists_is_found(family, seed):
    scene = family.feasible(seed)
    assert family.holds(apply(scene.problem, scene.known))
    assert not family.holds(scene.problem)
    lower, upper = ([getattr(v, side) for v in scene.problem.design.variables] for side in ("lower", "upper"))
    assert all(low < known < high for low, known, high in zip(lower, scene.known, upper, strict=True))
    design = ho.redesign(scene.problem)
    assert family.solved(scene, design)
    assert family.holds(design.problem)


@pytest.mark.parametrize("seed", [2, 3])
def test_where_none_exists_that_is_said(family, seed):
    scene = family.infeasible(seed)
    design = ho.redesign(scene.problem)
    assert family.solved(scene, design)
    assert not design.ok and design.relaxations


def test_a_scene_is_the_same_every_time(family):
    assert family.feasible(3).problem == family.feasible(3).problem
