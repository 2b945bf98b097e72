"""A few scenes of ``scripts/redesign_family.py``: with a design that is known, and with none."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest

import harness_opt as ho
from harness_opt.model.design_variables import apply

SCRIPT = Path(__file__).resolve().parent.parent / "scripts" / "redesign_family.py"


@pytest.fixture(scope="module")
def family():
    specification = importlib.util.spec_from_file_location("redesign_family", SCRIPT)
    module = importlib.util.module_from_spec(specification)
    sys.modules["redesign_family"] = module
    specification.loader.exec_module(module)
    return module


@pytest.mark.parametrize("seed", [0, 2, 13])  # 13: two shapes at one pose, and the bounds hold the edge between them
def test_a_design_that_exists_is_found(family, seed):
    scene = family.feasible(seed)
    assert family._holds(apply(scene.problem, scene.known))
    assert not family._holds(scene.problem)
    lower, upper = ([getattr(v, side) for v in scene.problem.design.variables] for side in ("lower", "upper"))
    assert all(low < known < high for low, known, high in zip(lower, scene.known, upper, strict=True))
    design = ho.redesign(scene.problem)
    assert family.solved(scene, design)
    assert family._holds(design.problem)


@pytest.mark.parametrize("seed", [2, 3])
def test_where_none_exists_that_is_said(family, seed):
    scene = family.infeasible(seed)
    design = ho.redesign(scene.problem)
    assert family.solved(scene, design)
    assert not design.ok and design.relaxations


def test_a_scene_is_the_same_every_time(family):
    assert family.feasible(3).problem == family.feasible(3).problem
