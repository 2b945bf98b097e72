"""Taut cables: clamp layers a millionth of the length thin, and the long straight elements between them."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.numerics import rotations
from harness_opt.rod import equations as rod
from harness_opt.rod.boundary import case
from harness_opt.rod.long_elements import TERMS, LongElements
from harness_opt.statics.cold_start import cold_start
from harness_opt.statics.solve import correct_to_rounding, solve_on

CABLE = ho.Cable(1.0, 0.01, 1.0, 1.0)  # kx = ky = kz = 1 N m2


def taut(slack, angle):
    """A cable along z that leaves its first clamp at ``angle``, rad, off the line between the ends."""
    start = tuple(rotations.from_rotation_vector([angle, 0.0, 0.0]))
    return ho.equilibrium(CABLE, ho.End((0, 0, 0), start), ho.End((0, 0, 1.0 - slack), (1, 0, 0, 0)))


@pytest.mark.parametrize("angle", [0.5, 2.0])
@pytest.mark.parametrize("slack", [1e-3, 1e-4, 1e-5, 1e-6])
def test_clamp_layers_have_their_closed_form(slack, angle):
    """tan(theta / 4) falls off with exp(-sqrt(F / B) s); the layer at a clamp takes 4 sqrt(B / F) sin^2(theta / 4) of
    the slack (the separatrix of the pendulum: Love, "Mathematical Theory of Elasticity", section 262).
    """
    shape = taut(slack, angle)
    force = float(np.linalg.norm(shape.force[0]))
    along, decay = shape.force[0] / force, np.sqrt(force)
    s = np.unique(np.concatenate([np.linspace(0.0, 1.0, 501), np.linspace(0.0, 20.0, 201) / decay]))
    at = shape.at(s)
    tilt = np.arccos(np.clip(rotations.tangent(at.quaternion) @ along, -1.0, 1.0))
    layers = np.tan(tilt[0] / 4) * np.exp(-decay * s) + np.tan(tilt[-1] / 4) * np.exp(-decay * (1.0 - s))
    assert np.max(np.abs(tilt - 4 * np.arctan(layers))) < 1e-7
    taken = 4 / decay * (np.sin(tilt[0] / 4) ** 2 + np.sin(tilt[-1] / 4) ** 2)
    short = 1.0 - along @ (at.position[-1] - at.position[0])
    assert taken == pytest.approx(short, rel=1e-6, abs=1e-14)
    # what is left to give way is twist, of which the first mode has pi^2 kz
    assert shape.stable
    assert shape.stability_margin == pytest.approx(np.pi**2, rel=1e-4 + 5.0 / decay)


def waving(nodes, bent, rate):
    """Power series (TERMS, n, ...) about ``nodes`` of a planar rod that waves: turned by ``bent`` sin(rate s) about d2.

    With z = exp(i angle / 2), z' = i angle' z / 2, and the tangent is z^2.
    """
    angle = [bent * rate ** (k + 1) * np.cos(rate * nodes + 0.5 * k * np.pi) / math.factorial(k) for k in range(TERMS)]
    z = [np.exp(0.5j * bent * np.sin(rate * nodes))]
    for k in range(TERMS - 1):
        z.append(0.5j / (k + 1) * sum(angle[j] * z[k - j] for j in range(k + 1)))
    tangent = [sum(z[j] * z[k - j] for j in range(k + 1)) for k in range(TERMS - 1)]
    moved = [along(lambda s: np.exp(1j * bent * np.sin(rate * s)), nodes)]
    moved += [tangent[k] / (k + 1) for k in range(TERMS - 1)]
    zero = np.zeros((TERMS, len(nodes)))
    q = np.stack([np.real(z), zero, np.imag(z), zero], axis=-1)
    return np.stack([np.imag(moved), zero, np.real(moved)], axis=-1), q, np.stack([zero, angle, zero], axis=-1)


def along(rate, places):
    """Integrals (n,) of ``rate`` from 0 to places."""
    x, w = np.polynomial.legendre.leggauss(40)
    return 0.5 * places * (rate(0.5 * places[:, None] * (x + 1.0)) @ w)


def long_waves(count, order, rate=5.0):
    """A rod that waves in ``count`` long elements."""
    s = np.linspace(0.0, 1.0, count + 1)

    def ends(coefficients):
        return np.stack([coefficients[:, :-1], coefficients[:, 1:]])

    return LongElements(np.diff(s), np.full(count, order), *(ends(of) for of in waving(s, 1.0, rate)))


def test_long_elements_turn_evenly():
    part, omega = np.linspace(0.0, 1.0, 7), np.array([1.5, 0.0, 4.0])
    for count in (2, 5):
        s = np.linspace(0.0, 1.0, count + 1)
        half, q = 0.5 * np.append(0.0, omega), [rotations.from_rotation_vector(s[:, None] * omega)]
        for k in range(1, TERMS):
            q.append(rotations.multiply(q[-1], half) / k)
        spin = np.zeros((TERMS, count + 1, 3))
        spin[0] = omega
        ends = [np.stack([of[:, :-1], of[:, 1:]]) for of in (np.zeros_like(spin), np.stack(q), spin)]
        found = LongElements(np.diff(s), 1 + np.arange(count) % (TERMS - 1), *ends)
        for element in range(count):
            _, frames, turning = found.sample(np.full(len(part), element), part)
            expected = rotations.from_rotation_vector((element + part[:, None]) / count * omega)
            assert np.max(np.abs(frames - expected)) < 1e-14
            assert np.max(np.abs(turning - omega)) < 1e-13


@pytest.mark.parametrize("order", range(1, TERMS))
def test_each_derivative_at_both_nodes_of_long_elements_is_worth_two_orders(order):
    counts, errors = (16, 32), {"r": [], "q": [], "omega": [], "turned": []}
    for count in counts:
        element, at = np.arange(count), (np.arange(count) + 0.4) / count
        found = long_waves(count, order)
        exact = waving(at, 1.0, 5.0)
        for key, one, other in zip(("r", "q", "omega"), found.sample(element, np.full(count, 0.4)), exact, strict=True):
            errors[key].append(np.max(np.abs(one - other[0])))
        errors["turned"].append(np.max(np.abs(found.defects()[0])))
    expected = {"r": 2 * order + 2, "q": 2 * order + 2, "omega": 2 * order, "turned": 2 * order + 1}
    for key, power in expected.items():
        assert np.log2(errors[key][0] / errors[key][1]) == pytest.approx(power, abs=0.35), key


def test_defects_of_long_elements_are_what_their_nodes_miss():
    turn, shift = 1e-4, 2e-4
    good = long_waves(64, 3)
    q, r = good.q.copy(), good.r.copy()
    q[1, 0, 5] = rotations.multiply(q[1, 0, 5], rotations.from_rotation_vector([0.0, turn, 0.0]))
    r[1, 0, 5, 0] += shift
    missed, moved, _ = dataclasses.replace(good, q=q, r=r).defects()
    assert 2.0 * np.linalg.norm(missed[5]) > turn
    assert moved[5, 0] == pytest.approx(shift, rel=0.02)
    others = np.arange(64) != 5
    assert np.max(np.abs(missed[others])) < 1e-8 and np.max(np.abs(moved[others])) < 1e-12


def test_tangents_of_long_elements_have_their_moment_about_the_middle():
    arm = long_waves(8, 3).defects()[2]
    s = np.linspace(0.0, 1.0, 9)
    middle = 0.5 * (s[1:] + s[:-1])

    def moment(place):
        return along(lambda s: s * np.exp(1j * np.sin(5.0 * s)), place)

    exact = np.diff(moment(s)) - middle * np.diff(along(lambda s: np.exp(1j * np.sin(5.0 * s)), s))
    assert np.max(np.abs(arm[:, 0] - exact.imag)) < 1e-8 * np.max(np.abs(exact))
    assert np.max(np.abs(arm[:, 2] - exact.real)) < 1e-8 * np.max(np.abs(exact))


def test_fields_about_a_moment_along_an_axis_turn_as_eulers_top_does():
    stiffness, step = np.array([5.0, 0.3, 2.0]), 1e-6
    for axis in range(3):
        moment = 7.0 * np.eye(3)[axis]

        def rate(m):
            return np.cross(m, m / stiffness)

        columns = [(rate(moment + step * e) - rate(moment - step * e)) / (2.0 * step) for e in np.eye(3)]
        fastest = np.max(np.abs(np.linalg.eigvals(np.stack(columns, axis=1))))
        found = rod.twisted_waves(np.array(rotations.IDENTITY), moment, stiffness)
        assert found == pytest.approx(fastest, rel=1e-6)


def test_a_loose_solve_is_polished_until_rounding_is_left():
    posed = case(CABLE, ho.End((0, 0, 0), (1, 0, 0, 0)), ho.End((0.3, 0.2, 0.6), (0.8, 0.6, 0, 0)), np.zeros(3))
    good = cold_start(posed, 0, None, "gauss-newton")
    loose = solve_on(good.case, good.bound.mesh, good.solution.x + 1e-4, "gauss-newton", residual=1e-4)
    assert loose.ok and loose.solution.residual > 1e-12
    fine = correct_to_rounding(loose)
    assert fine.solution.residual < 1e-13
    assert fine.solution.residual == np.max(np.abs(fine.bound.residual(fine.solution.x)))
