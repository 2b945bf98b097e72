"""The energy of a chain of elements: its derivatives by differences, and the order at which it falls to the rod's."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from harness_opt.numerics import rotations
from harness_opt.rod.boundary import Boundary, Kind
from harness_opt.rod.energy_chain import Chain
from harness_opt.rod.equations import Section

CLAMPED, CANTILEVER, HUNG = Kind(True, True, True, True), Kind(True, True, False, False), Kind(False, False, True, True)
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


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
