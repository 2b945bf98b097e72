"""The four reference shapes, solved outside the project by ``solve_bvp`` at 1e-10 and checked by shooting."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.numerics import rotations

FOLDER = Path(__file__).parents[1] / "reference"
CASES = json.loads((FOLDER / "cases.json").read_text(encoding="utf-8"))
SHAPE = 1e-7  # of the centreline, in lengths of the cable
LOAD = 1e-7  # of forces and moments, relative to the largest one tabulated
ENERGY = 1e-7  # relative; the tabulated energies are good to about 5e-8
G = 9.81


def table(name: str) -> SimpleNamespace:
    """Return the tabulated shape with the product's names."""
    columns = np.genfromtxt(FOLDER / f"{name}.csv", delimiter=",", names=True)
    groups = {"position": "x y z", "quaternion": "q1 q2 q3 q4", "force": "Fx Fy Fz", "moment": "Mx My Mz"}
    stacked = {key: np.stack([columns[c] for c in names.split()], axis=1) for key, names in groups.items()}
    return SimpleNamespace(s=columns["s"], **stacked)


def cable(name: str) -> ho.Cable:
    case = CASES[name]
    return ho.Cable(
        case["length"],
        0.01,
        case["bending_stiffness"],
        case["torsional_stiffness"],
        case["weight_per_length"] / G,
    )


def ends(name: str) -> tuple[ho.End, ho.End]:
    return tuple(
        ho.End(tuple(pose["position"]), tuple(rotations.normalise(pose["quaternion"]).tolist()))
        for pose in (CASES[name]["start"], CASES[name]["end"])
    )


def assert_tabulated(name: str, shape, energy: float | None = None) -> None:
    """Assert that ``shape`` is the tabulated one: place, frames up to sign, force and moment, and energy."""
    expected = table(name)
    assert np.max(np.linalg.norm(shape.position - expected.position, axis=1)) < SHAPE
    sign = np.sign(np.sum(shape.quaternion * expected.quaternion, axis=1, keepdims=True))
    assert np.max(np.abs(sign * shape.quaternion - expected.quaternion)) < 5 * SHAPE
    for load in ("force", "moment"):
        found, wanted = getattr(shape, load), getattr(expected, load)
        assert np.max(np.abs(found - wanted)) < LOAD * np.max(np.linalg.norm(wanted, axis=1)), load
    if energy is not None:
        assert energy == pytest.approx(CASES[name]["energy"], rel=ENERGY)
