"""Twist, writhe and link against closed forms: plane curves, a figure eight, helices, knots on a torus."""

from __future__ import annotations

import math

import numpy as np
import pytest

from harness_opt.numerics import rotations
from harness_opt.rod.boundary import CLAMPED
from harness_opt.rod.link import links, links_of_curve, turns_lost, twist, writhe

CLOSE = 2e-3  # turns: of polygons of some hundred sides, whose error falls with the square of these


def frames(tangent: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return quaternions (N, 4) with d3 along ``tangent`` and d1 towards ``normal`` (N, 3)."""
    d3 = rotations.normalise(tangent)
    d1 = rotations.normalise(normal - d3 * np.sum(d3 * normal, axis=1, keepdims=True))
    axes = np.stack([d1, np.cross(d3, d1), d3], axis=-1)
    return np.array([rotations.from_matrix(one) for one in axes])


def torus_curve(p: int, q: int, count: int = 600) -> tuple[np.ndarray, np.ndarray]:
    """Return points (N, 3) of a curve that runs p times round a torus and q times through its hole, and frames.

    d1 is the torus's normal.
    """
    t = 2.0 * math.pi * np.arange(count + 1) / count
    wide, thin = 1.0, 0.35
    u, v = p * t, q * t
    out = np.stack([np.cos(u), np.sin(u), 0.0 * u], axis=1)
    normal = np.cos(v)[:, None] * out + np.sin(v)[:, None] * np.array([0.0, 0.0, 1.0])
    points = wide * out + thin * normal
    around = np.stack([-np.sin(u), np.cos(u), 0.0 * u], axis=1)
    slope = p * (wide + thin * np.cos(v))[:, None] * around
    slope += thin * q * (-np.sin(v)[:, None] * out + np.cos(v)[:, None] * np.array([0.0, 0.0, 1.0]))
    return points[:-1], frames(slope, normal)


def test_plane_curves_have_no_writhe():
    t = 2.0 * math.pi * np.arange(100) / 100
    ellipse = np.stack([2.0 * np.cos(t), np.sin(t), 0.0 * t], axis=1)
    assert writhe(ellipse, closed=True) == pytest.approx(0.0, abs=1e-12)
    assert writhe(ellipse[:60]) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_flat_figure_eight_has_the_writhe_of_its_one_crossing(side):
    t = 2.0 * math.pi * (np.arange(400) + 0.5) / 400
    height = 1e-4
    eight = np.stack([np.sin(t), np.sin(2.0 * t), side * height * np.cos(t)], axis=1)
    assert abs(writhe(eight, closed=True)) == pytest.approx(1.0, abs=CLOSE)
    assert np.sign(writhe(eight, closed=True)) == -np.sign(writhe(eight * (1, 1, -1), closed=True))


@pytest.mark.parametrize(("p", "q"), [(1, 1), (1, 4), (2, 3), (3, 2), (2, -3), (1, 0)])
def test_the_link_of_a_closed_ribbon_is_whole(p, q):
    # the edge along the torus's normal runs beside the curve on a wider torus: it links it p q times, left-handed
    points, section = torus_curve(p, q)
    assert twist(section) + writhe(points, closed=True) == pytest.approx(-p * q, abs=CLOSE)


def test_a_ribbon_of_any_twist_closes_to_a_whole_number():
    points, section = torus_curve(2, 3)
    more = rotations.from_rotation_vector(np.outer(4.0 * math.pi * np.arange(601) / 600, [0, 0, 1]))
    assert twist(rotations.multiply(section, more)) + writhe(points, closed=True) == pytest.approx(-4.0, abs=CLOSE)


def helix(turns: int, pitch_angle: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return frames and points of a helix about z with d1 towards its axis."""
    t = np.linspace(0.0, 2.0 * math.pi * turns, count)
    rise = math.tan(pitch_angle)
    points = np.stack([np.cos(t), np.sin(t), rise * t], axis=1)
    slope = np.stack([-np.sin(t), np.cos(t), 0.0 * t + rise], axis=1)
    return frames(slope, -points * (1, 1, 0)), points


@pytest.mark.parametrize("pitch_angle", [0.3, 0.8, 1.2])
def test_a_helix(pitch_angle):
    # torsion gives the twist of its normal, sin(angle) a turn, and what is left of one is writhe: Fuller 1978
    per_turn = []
    for turns in (6, 7):
        q, points = helix(turns, pitch_angle, 120 * turns + 1)
        assert twist(q) == pytest.approx(turns * math.sin(pitch_angle), abs=CLOSE)
        per_turn.append(writhe(points))
    # far from the ends, which a helix of one turn more has as well
    assert per_turn[1] - per_turn[0] == pytest.approx(1.0 - math.sin(pitch_angle), abs=0.02)


def test_what_passes_through_itself_loses_two_turns():
    # a straight cable with a loop that lies in front, or behind: the same frames, but two turns apart
    t = np.linspace(-6.0, 6.0, 601)
    loop = np.exp(-(t**2))
    found = []
    for side in (1.0, -1.0):
        points = np.stack([t - 3.0 * t * loop, 2.0 * loop, side * 0.2 * t * loop], axis=1)
        section = frames(np.gradient(points, t, axis=0), np.tile([0.3, 0.2, 1.0], (len(t), 1)))
        found.append(links(t, section, points))
        np.testing.assert_allclose(links_of_curve(t, section, points), found[-1], atol=0.02)  # on fewer points
    assert abs(turns_lost(CLAMPED, *found)) == 2
    assert turns_lost(CLAMPED, found[0], found[0] + 0.3) == 0
    assert turns_lost(CLAMPED._replace(end_swivels=True), *found) == 0


def test_what_goes_through_one_ray_alone_loses_none():
    before = np.array([0.5, 0.5, 0.5, 0.5, 0.5])
    assert turns_lost(CLAMPED, before, before + np.array([2, 0, 0, 0, 0])) == 0
    assert turns_lost(CLAMPED, before, before - 2) == -2
