"""Going down an energy: derivatives by differences, minima that are known, and taut cables against the theory of
clamp layers."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import harness_opt as ho
from harness_opt.numerics import rotations
from harness_opt.numerics.descent import Ended, descend
from harness_opt.numerics.interface import Expansion
from harness_opt.rod.boundary import Boundary, Kind
from harness_opt.rod.energy_chain import Chain
from harness_opt.rod.equations import Section
from harness_opt.statics.starting_curve import starting_curve

CLAMPED, CANTILEVER, HUNG = Kind(True, True, True, True), Kind(True, True, False, False), Kind(False, False, True, True)
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


# --- a landscape with a saddle ---------------------------------------------------------------------------


class Sphere:
    """Height over the unit sphere, a . q + q . H q / 2 with |q| = 1 as the constraint: everything is known."""

    constraints = 1

    def __init__(self, slope, curvature):
        self.slope, self.curvature = np.asarray(slope, dtype=float), np.diag(curvature).astype(float)
        self.sparsity = ca.Sparsity.dense(4, 4)

    def energy(self, q):
        return float(self.slope @ q + 0.5 * q @ self.curvature @ q), np.array([0.5 * (q @ q - 1.0)])

    def expand(self, q, multipliers):
        matrix = np.zeros((4, 4))
        matrix[:3, :3] = self.curvature - multipliers[0] * np.eye(3)
        matrix[3, :3] = matrix[:3, 3] = q
        order = np.concatenate([np.flatnonzero(np.pad(np.ones((3, 3)), (0, 1)).ravel()), [3, 7, 11, 12, 13, 14, 15]])
        places = np.concatenate([order, [0, 5, 10]])
        gradient = self.slope + self.curvature @ q - multipliers[0] * q
        return Expansion(gradient, self.energy(q)[1], matrix.ravel()[order], 9, places, self.sparsity, np.ones(3))

    def move(self, q, step):
        return q + step

    def strained(self, q):
        return False


@pytest.mark.parametrize("start", [(1e-3, 0.0, 1.0), (1.0, 1.0, 1.0), (0.1, -3.0, 0.2), (1e-6, 1.0, 1e-6)])
def test_a_minimum_is_found_and_not_a_saddle(start):
    # without a slope minimum, saddle and maximum are the axes
    found = descend(Sphere((0.0, 0.0, 1e-3), (-3.0, -1.0, 2.0)), np.array(start), np.zeros(1), longest=0.3, steps=300)
    assert found.ended is Ended.AT_REST
    np.testing.assert_allclose(np.abs(found.q), [1.0, 0.0, 1e-3 / 5.0], atol=1e-6)
    assert found.multipliers[0] == pytest.approx(-3.0, abs=1e-6)


def test_a_descent_out_of_steps_says_so():
    found = descend(Sphere((0, 0, 0.1), (-3, -1, 2)), np.array([0.0, 0.1, 1.0]), np.zeros(1), longest=0.01, steps=5)
    assert found.ended is Ended.UNFINISHED and found.steps == 5


# --- the chain -------------------------------------------------------------------------------------------


def bent(kind: Kind, elements: int, *, exact: bool = False) -> tuple[Chain, np.ndarray]:
    """Return a chain between ends of ``kind`` and a shape of it that is no equilibrium."""
    rng = np.random.default_rng(7)
    loads = [rng.normal(size=3) for _ in range(2)]
    ends = Boundary(kind, np.array([0.3, 0.2, 0.4]), UPRIGHT, UPRIGHT, *loads, np.zeros(3), np.zeros(3))
    mesh = np.linspace(0.0, 1.0, elements + 1) ** 1.2
    chain = Chain(Section(np.array([2.0, 0.5, 3.0]), np.array([0.3, 0.1, 0.2])), np.array([1.0, 2.0, -3.0]), ends, mesh,
                  exact=exact)  # fmt: skip
    s = chain.nodes
    return chain, rotations.from_rotation_vector(np.stack([np.sin(3 * s + 1), 2 * s**2, np.cos(4 * s)], axis=1))


@pytest.mark.parametrize("kind", [CLAMPED, CANTILEVER, HUNG])
@pytest.mark.parametrize(("exact", "close"), [(True, 1e-6), (False, 5e-3)])
def test_derivatives_are_those_of_the_energy(kind, exact, close):
    chain, q = bent(kind, 30, exact=exact)
    multipliers = np.array([0.5, -1.0, 2.0])[: chain.constraints]
    expansion = chain.expand(q, multipliers)
    size = len(expansion.gradient)
    matrix = np.array(ca.DM(expansion.sparsity, expansion.bordered(0.0)))
    s, first = chain.nodes, 0 if kind is HUNG else 1
    last = len(s) if kind is CANTILEVER else len(s) - 1
    field = np.stack([np.sin(2 * s), np.cos(3 * s), s * (1 - s)], axis=1)[first:last].ravel()
    h = 1e-4

    def value(step: float) -> tuple[float, np.ndarray]:
        energy, missed = chain.energy(chain.move(q, step * field))
        return energy - multipliers @ missed, missed

    (low, back), (here, _), (high, ahead) = value(-h), value(0.0), value(h)
    assert expansion.gradient @ field == pytest.approx((high - low) / (2 * h), rel=1e-6)
    assert field @ matrix[:size, :size] @ field == pytest.approx((high - 2 * here + low) / h**2, rel=close)
    np.testing.assert_allclose(matrix[size:, :size] @ field, (ahead - back) / (2 * h), atol=1e-7)


def test_energy_of_an_arc_falls_to_that_of_the_rod_with_the_sixth_order():
    # wound about all three axes, so that the polynomials are not exact
    errors = []
    for elements in (4, 8, 16):
        chain, q = bent(CANTILEVER, elements)
        fine, there = bent(CANTILEVER, 128)
        errors.append(abs(chain.energy(q)[0] - fine.energy(there)[0]))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(orders > 5.0), orders


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
