"""Taut cables: clamp layers a millionth of the length thin, and the long straight elements between them."""

from __future__ import annotations

import numpy as np
import pytest

import harness_opt as ho
from harness_opt import rotations
from harness_opt.long_elements import LongElements

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


def helix(s, curvature, torsion):
    """Positions, quaternions and the Darboux vector of a helix that starts along z."""
    omega = np.array([curvature, 0.0, torsion])
    size = np.linalg.norm(omega)
    q = rotations.from_rotation_vector(s[:, None] * omega)
    axis = omega / size
    part = axis[2] * axis
    across = np.array([0.0, 0.0, 1.0]) - part
    turned = np.sin(size * s)[:, None] / size * across + (1 - np.cos(size * s))[:, None] / size * np.cross(axis, across)
    return s[:, None] * part + turned, q, np.broadcast_to(omega, (len(s), 3))


def long_helix(count):
    """The turn of a helix in ``count`` long elements."""
    s = np.linspace(0.0, 1.0, count + 1)
    r, q, omega = helix(s, 1.5, 4.0)

    def ends(values):
        return np.stack([values[:-1], values[1:]])

    return LongElements(np.diff(s), ends(r), ends(q), ends(omega))


def test_long_elements_turn_evenly():
    part = np.linspace(0.0, 1.0, 7)
    for count in (2, 5):
        for element in range(count):
            found = long_helix(count).sample(np.full(len(part), element), part)
            expected = helix((element + part) / count, 1.5, 4.0)
            assert np.max(np.abs(found[1] - expected[1])) < 1e-14
            assert np.max(np.abs(found[2] - expected[2])) < 1e-14


def test_positions_in_long_elements_are_of_fourth_order_and_so_are_their_defects():
    errors, defects = [], []
    for count in (8, 16):
        found = long_helix(count).sample(np.arange(count), np.full(count, 0.5))[0]
        expected = helix((np.arange(count) + 0.5) / count, 1.5, 4.0)[0]
        errors.append(np.max(np.linalg.norm(found - expected, axis=1)))
        turned, moved = long_helix(count).defects()
        assert np.max(np.abs(turned)) < 1e-14
        defects.append(np.max(np.linalg.norm(moved, axis=1)))
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.1)
    assert defects[0] / defects[1] == pytest.approx(32.0, rel=0.1)
