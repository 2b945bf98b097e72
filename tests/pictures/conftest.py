"""Motions and designs that are drawn."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from harness_opt.design.redesign import redesign
from harness_opt.files.arrays import KEPT
from harness_opt.files.read import write_problem
from harness_opt.model.bodies import Body, Hinge
from harness_opt.model.cable import Cable, CableRun
from harness_opt.model.design import Design, Limits, Variable
from harness_opt.model.ends import End
from harness_opt.model.parts import Box, Capsule, Cylinder, Part, Sphere
from harness_opt.model.problem import Problem
from harness_opt.model.results import Motion
from harness_opt.motion.simulate import simulate
from harness_opt.numerics import rotations

UP, ALONG = (tuple(rotations.from_tangent(way)) for way in ((0, 0, 1), (1, 0, 0)))


@pytest.fixture(scope="session")
def pyvista():
    return pytest.importorskip("pyvista", reason="pyvista (the extra 'pictures') is not installed")


@pytest.fixture(scope="session")
def two_cables() -> Motion:
    """A head that turns on a mast, with two cables, of which one runs through the mast."""

    def run(length: float, side: float) -> CableRun:
        start = End((0.05, side, 0.0), UP)
        return CableRun(Cable(length, 0.006, 2e-3, 1.5e-3), start, End((0.12, side, 0.2), ALONG, body="head"))

    parts = {
        "base": Part(Box((0.3, 0.3, 0.02)), position=(0, 0, -0.015)),
        "mast": Part(Cylinder(0.02, 0.2), position=(0, 0, 0.1)),
        "head": Part(Box((0.2, 0.1, 0.05)), body="head", position=(0.02, 0, 0.26)),
        "knob": Part(Capsule(0.01, 0.04), body="head", position=(0, 0.06, 0.2)),
        "ball": Part(Sphere(0.03), position=(-0.1, 0, 0.02)),
    }
    problem = Problem(
        cables={"power": run(0.36, 0.03), "video": run(0.34, -0.03)},
        bodies={"head": Body(Hinge((0, 0, 0), (0, 0, 1), -0.8, 0.8))},
        parts=parts,
        limits=Limits(clearance=0.006, bend_radius=0.03),
        spatial_step=0.03,
        title="Head on a mast",
    )
    return simulate(problem)


@pytest.fixture(scope="session")
def design():
    """A cable over a post that is too high for it as drawn, and the longer one that clears it."""
    cable = Cable(0.2, 0.006, 2e-3, 1.5e-3)
    problem = Problem(
        cables={"lead": CableRun(cable, End((0, 0, 0), UP), End((0.15, 0, 0.02), ALONG, body="arm"))},
        bodies={"arm": Body(Hinge((0.05, 0, 0), (0, -1, 0), 0.0, 0.3))},
        parts={"post": Part(Box((0.01, 0.03, 0.06)), position=(0.06, 0, 0.03))},
        limits=Limits(clearance=0.003),
        design=Design("change", (Variable("lead.length", 0.18, 0.3),)),
        spatial_step=0.02,
    )
    found = redesign(problem)
    assert min(row.margin for row in found.limits_before) < 0 <= min(row.margin for row in found.limits)
    return found


@pytest.fixture
def folder(two_cables, tmp_path) -> Path:
    """A result folder with no more in it than the contract promises."""
    limits = [{"name": "clearance", "limit": 0.006, "margin": -0.01, "motion": 0.5}]
    summary = {
        "command": "simulate", "versions": {"harness-opt": "0"}, "limits": limits
    }  # fmt: skip
    place = tmp_path / "result"
    write_problem(two_cables.problem, place / "used" / "problem.toml")
    (place / "summary.json").write_text(json.dumps(summary))
    arrays = {f"{n}/{key}": getattr(c, key) for n, c in two_cables.cables.items() for key in ("s", *KEPT)}
    np.savez(place / "motion.npz", motion=two_cables.motion, **arrays)
    return place
