"""Cold starts: taut cables by the theory of clamp layers, starting curves without kinks, and few steps."""

from __future__ import annotations

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.numerics import rotations
from harness_opt.rod.boundary import Boundary, Kind
from harness_opt.rod.energy_chain import Chain
from harness_opt.statics.starting_curve import starting_curve

CLAMPED, CANTILEVER, HUNG = Kind(True, True, True, True), Kind(True, True, False, False), Kind(False, False, True, True)


# --- taut cables -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("slack", "angle"), [(1e-3, 0.5), (1e-4, 0.5), (1e-2, 2.0)])
def test_tension_of_a_taut_cable_is_that_of_its_clamp_layers(slack, angle):
    """Far from the other end an elastica that leaves its clamp at an angle a to the line of the tension T falls to it
    as tan(phi / 4) = tan(a / 4) exp(-sqrt(T) s) and takes up a slack of 2 (1 - cos(a / 2)) / sqrt(T)."""
    cable = ho.Cable(1.0, 0.001, (1.0, 1.0), 1.0)
    start = rotations.from_rotation_vector([0.0, angle, 0.0])
    end = rotations.from_rotation_vector([0.0, -angle, 0.0])
    shape = ho.equilibrium(cable, ho.End((0, 0, 0), tuple(start)), ho.End((0, 0, 1.0 - slack), tuple(end)))
    tension = (4.0 * (1.0 - np.cos(0.5 * angle)) / slack) ** 2
    assert shape.ok and shape.stable
    assert np.linalg.norm(shape.force[0]) == pytest.approx(tension, rel=1e-6 + 4.0 * np.exp(-np.sqrt(tension)))


# --- what a cold start costs -----------------------------------------------------------------------------


KINKED = [
    ((0.05, 0, 0), (1, 0, 0.02), (1, 0, 0)),
    ((0.6, 0, 0), (0, 0, 1), (0, 0, 1)),
    ((0.3, 0, 0), (1, 0, 0), (-1, 0.01, 0)),
]


@pytest.mark.parametrize(("gap", "first", "last"), KINKED)
@pytest.mark.parametrize("turns", [0, 3])
def test_a_starting_curve_has_no_kinks_and_keeps_its_ends_and_turns(gap, first, last, turns):
    # a cubic between these bends by a radian within a few thousandths of the length
    start, end = (rotations.from_tangent(tangent) for tangent in (first, last))
    nothing = np.zeros(3)
    boundary = Boundary(CLAMPED, np.array(gap, dtype=float), start, end, *[nothing] * 4)
    frames = starting_curve(boundary, 241, turns)[1]
    np.testing.assert_allclose(frames[0], start, atol=1e-14)
    assert abs(frames[-1] @ end) == pytest.approx(1.0, abs=1e-14)
    spin = 240 * rotations.rotation_vector(rotations.multiply(rotations.conjugate(frames[:-1]), frames[1:]))
    assert np.max(np.linalg.norm(spin[:, :2], axis=1)) < 2.0 * np.pi / 0.1  # two half turns in a tenth of the length
    without = starting_curve(boundary, 241, 0)[1]
    plain = 240 * rotations.rotation_vector(rotations.multiply(rotations.conjugate(without[:-1]), without[1:]))
    np.testing.assert_allclose(np.mean(spin[:, 2] - plain[:, 2]), 2.0 * np.pi * turns, atol=0.01)


def test_a_cold_start_takes_few_expansions_on_few_elements(monkeypatch):
    """Counted, not timed: a step takes one, and seven steps do where twelve did, on half the elements."""
    elements = []
    original = Chain.expand

    def counting(self, q, multipliers):
        elements.append(len(self.mesh) - 1)
        return original(self, q, multipliers)

    monkeypatch.setattr(Chain, "expand", counting)
    rng, starts = np.random.default_rng(3), 20
    cable = ho.Cable(1.0, 0.01, 1.0, 1.0)
    for _ in range(starts):
        gap = rotations.normalise(rng.normal(size=3)) * rng.uniform(0.05, 0.9)
        q = rotations.normalise(rng.normal(size=(2, 4)))
        shape = ho.equilibrium(cable, ho.End((0, 0, 0), tuple(q[0])), ho.End(tuple(gap), tuple(q[1])), tolerance=1e-6)
        assert shape.ok and shape.stable
    assert len(elements) < 9 * starts
    assert np.mean(elements) < 20
