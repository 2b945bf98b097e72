"""Curls that slide along a cable: against the weight of what they take up, and where they come to rest."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.numerics import rotations
from harness_opt.numerics.descent import Ended, descend
from harness_opt.rod.boundary import case as posed
from harness_opt.rod.energy_chain import Chain
from harness_opt.statics import curls, energy_minimum
from harness_opt.statics.curl_steps import CurlStep, curl_shifts, has_curls, move_curls

DISTANCE = 0.95
WEIGHT = 20.0  # w L^3 / B: hardly changes the tension
UP = np.array([1.0, 0.0, 0.0, 0.0])


def upright(turns: int, stiffness: float = 50.0):
    """Return the case of a cable between clamps one above the other, both upwards."""
    cable = ho.Cable(1.0, 0.01, (1.0, 0.1), stiffness, WEIGHT / 9.81 * np.sqrt(0.1))
    ends = ho.End((0, 0, 0), tuple(UP)), ho.End((0, 0, DISTANCE), tuple(UP), turns=turns)
    return posed(cable, *ends, np.array([0.0, 0.0, -9.81]))


def begun(turns: int):
    """Return the case and a chain that has been given its curls half way up, and nothing else."""
    case = upright(turns)
    straight = dataclasses.replace(case.boundary, gap=case.boundary.gap / DISTANCE)
    chain = Chain(case.section, 0.0 * case.load, straight, np.linspace(0.0, 1.0, 9))
    base = energy_minimum.EnergyMinimum(chain, np.tile(UP, (len(chain.nodes), 1)), np.array([0.0, 0.0, 1.0]))
    s, q = curls._with_curls(base, turns, 0.5 * (1.0 - DISTANCE))
    end = dataclasses.replace(case.boundary, end_quaternion=q[-1])
    return dataclasses.replace(case, boundary=end), s, q


@pytest.fixture(scope="module")
def halfway():
    """A chain with a curl half way up, at rest on fine elements that hold the curl where it is."""
    case, s, q = begun(1)
    found = energy_minimum.minimise_energy(case, s, q, np.zeros(3), short_steps=True)
    count = len(found.chain.mesh) - 1
    finer = found.chain.on(np.interp(np.linspace(0.0, count, 4 * count + 1), np.arange(count + 1.0), found.chain.mesh))
    q = finer.clamped(found.chain.sample(found.q, finer.nodes)[0])
    resting = descend(finer, q, found.multipliers, longest=0.3, steps=300, shift=1e-3, room=1.0 - DISTANCE)
    assert resting.ended is Ended.AT_MINIMUM
    return energy_minimum.EnergyMinimum(finer, resting.q, resting.multipliers)


def test_what_drives_a_curl_is_the_weight_of_what_it_takes_up(halfway):
    # a curl that slides by a takes the slack with it, whatever its shape: virtual work
    shifts, width = curl_shifts(halfway.chain, halfway.q)
    assert len(shifts) == 1 and 0.02 < width < 0.3
    step = CurlStep(halfway.chain, halfway.q, halfway.multipliers, shifts, width)
    np.testing.assert_allclose(step.force, WEIGHT * (1.0 - DISTANCE), rtol=1e-2)


def places(chain: Chain, q) -> np.ndarray:
    """Return where the curls of a chain are, (curls,)."""
    on = curl_shifts(chain, q)[0] == 1.0
    return np.array([chain.mesh[along].mean() for along in on])


def test_a_step_takes_it_down_and_lowers_the_energy(halfway):
    moved = move_curls(halfway.chain, halfway.q, halfway.multipliers, 1.0 - DISTANCE)
    assert moved is not None
    energy, missed = moved.chain.energy(moved.q)
    assert energy < halfway.chain.energy(halfway.q)[0]
    assert np.linalg.norm(missed) < 1e-3 * (1.0 - DISTANCE)
    assert places(moved.chain, moved.q)[0] < places(halfway.chain, halfway.q)[0] - 0.01


def test_it_comes_to_rest_at_the_lower_clamp():
    case, s, q = begun(1)
    found = energy_minimum.minimise_energy(case, s, q, np.zeros(3), short_steps=False)
    # a curl is kept from a clamp by what decays with sqrt(k / F)
    decay = np.sqrt(0.1 / np.linalg.norm(found.multipliers))
    assert 2.0 * decay < places(found.chain, found.q)[0] < 15.0 * decay


@pytest.mark.parametrize("turns", [2, -3])
def test_a_cable_stiff_in_torsion_takes_its_turns_into_as_many_curls(turns):
    found = curls.minimum_with_curls(upright(turns, 500.0), turns, None)
    assert len(places(found.chain, found.q)) == abs(turns)
    omega = found.chain.sample(found.q, found.chain.points)[1]
    twist = np.trapezoid(omega[:, 2], found.chain.points)
    assert abs(twist) < 0.1  # rad, of what was 2 pi a turn
    # whole turns: an odd number of them ends at the other quaternion of the same frame
    assert found.chain.boundary.end_quaternion @ UP == pytest.approx((-1.0) ** turns)


def test_an_arch_has_no_curls():
    s = np.linspace(0.0, 1.0, 241)
    arch = rotations.from_rotation_vector(np.pi * (s - 0.5)[:, None] * np.array([1.0, 0.0, 0.0]))
    gap = np.array([0.0, 0.0, 2.0 / np.pi])
    case = upright(0)
    ends = dataclasses.replace(case.boundary, gap=gap, start_quaternion=arch[0], end_quaternion=arch[-1])
    found = energy_minimum.minimise_energy(
        dataclasses.replace(case, boundary=ends), s, arch, np.zeros(3), short_steps=False
    )
    assert not has_curls(found.chain, found.q)
    assert move_curls(found.chain, found.q, found.multipliers, 1.0) is None
    assert energy_minimum.refine_curls(found, 2) is None
