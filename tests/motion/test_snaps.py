"""Lost shapes: where a cable snaps, where it lands, and what else it might hang like.

The place of a snap belongs to the cable and not to the frames; going back shows hysteresis; other equilibria are those
that an independent search found (``reference/``).
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.motion.snaps import PLACE_TOLERANCE
from harness_opt.motion.sweep import sweep
from oracles.elastica import ALONG_X
from oracles.reference import G, cable, ends

SPAN = 0.6  # of the arch, in lengths of the cable
FROM, TO = 20.0, -100.0  # degrees that the lever turns through


def arch(weight: float, *, out_and_back: bool = False) -> ho.Problem:
    """Return an arch bowed up between a fixed clamp and one on a lever that turns it over."""
    cord = ho.Cable(1.0, 0.01, 1.0, 3.0, weight / G)
    run = ho.CableRun(cord, ho.End((0, 0, 0), ALONG_X), ho.End((SPAN, 0, 0), ALONG_X, body="lever"), bow=(0, 0, 1))
    hinge = ho.Hinge((SPAN, 0, 0), (0, 1, 0), np.radians(FROM), np.radians(TO))
    gravity = (0, 0, -G)
    return ho.Problem({"lead": run}, {"lever": ho.Body(hinge)}, gravity=gravity, out_and_back=out_and_back)


def energy(problem: ho.Problem, position: np.ndarray, curvature: np.ndarray) -> float:
    """Return elastic energy and weight of one frame by the trapezoidal rule."""
    lead = problem.cables["lead"].cable
    density = 0.5 * curvature**2 @ lead.stiffness + lead.mass_per_length * G * position[:, 2]
    return float(np.trapezoid(density, dx=lead.length / (len(position) - 1)))


@pytest.mark.parametrize("weight", [0.0, 5.0])
def test_a_snap_stands_at_one_motion_value_whatever_the_spatial_step(weight):
    found = [ho.simulate(arch(weight), spatial_step=step) for step in (0.011, 0.02, 0.05)]
    assert all(len(motion.snaps) == 1 and motion.cables["lead"].stable.all() for motion in found)
    places = [motion.snaps[0].motion for motion in found]
    assert max(places) - min(places) <= 2 * PLACE_TOLERANCE
    for motion in found:  # the frame that first shows the new shape is the first one past the place
        snap = motion.snaps[0]
        assert motion.motion[snap.frame - 1] < snap.motion <= motion.motion[snap.frame]


def test_a_sweep_that_does_not_recover_ends_where_the_shape_is_lost():
    problem, motion = arch(0.0), np.linspace(0.0, 1.0, 41)
    whole, ended = (sweep(problem, "lead", motion, recovers=recovers) for recovers in (True, False))
    ((frame, place, _),) = whole.snaps
    assert whole.status.ok and len(whole.frames) == len(motion)
    assert not ended.status.ok and not ended.snaps
    assert len(ended.frames) == frame and motion[frame - 1] < place
    for before, after in zip(ended.frames, whole.frames, strict=False):
        assert np.abs(before.rod.r[-1] - after.rod.r[-1]).max() < 1e-6


def test_out_and_back_shows_hysteresis():
    problem = arch(5.0, out_and_back=True)
    motion = ho.simulate(problem, spatial_step=0.02)
    lead = motion.cables["lead"]
    out, back = (FROM + (TO - FROM) * (1.0 - abs(2.0 * snap.motion - 1.0)) for snap in motion.snaps)
    assert motion.snaps[0].motion < 0.5 < motion.snaps[1].motion
    assert back > out + 0.1  # degrees: it holds on to the lower side for longer
    for snap in motion.snaps:  # downhill, by more than the step itself changes
        before, after = (energy(problem, lead.position[k], lead.curvature[k]) for k in (snap.frame - 1, snap.frame))
        earlier = energy(problem, lead.position[snap.frame - 2], lead.curvature[snap.frame - 2])
        assert after - before < before - earlier
    # on a path the equations, and with them the ends, hold to 1e-10
    np.testing.assert_allclose(lead.position[0, [0, -1]], lead.position[-1, [0, -1]], atol=1e-10)


def test_out_and_back_without_a_snap_comes_back_to_the_same_shapes():
    problem = dataclasses.replace(arch(0.0), bodies={"lever": ho.Body(ho.Hinge((SPAN, 0, 0), (0, 1, 0), 0.4, 1.2))})
    motion = ho.simulate(dataclasses.replace(problem, out_and_back=True), frames=np.linspace(0, 1, 11))
    there = motion.cables["lead"].position
    assert not motion.snaps
    np.testing.assert_allclose(there[:5], there[:5:-1], atol=1e-7)


LISTED = {
    "clamped_elastica_060": [17.658627],
    "clamped_3d": [13.128, 16.130, 27.10, 33.61],
    "clamped_3d_weight_30": [17.165, 17.875, 24.71, 27.23, 37.47],
    "twist_rig_080_180deg": [30.032],
}


@pytest.mark.parametrize("name", LISTED)
def test_other_equilibria(name):
    found = ho.equilibria(cable(name), *ends(name), (0, 0, -G))
    assert all(shape.ok and shape.stable for shape in found)
    energies = np.array([shape.energy for shape in found])
    assert np.all(np.diff(energies) >= 0)
    for listed in LISTED[name]:
        assert np.min(np.abs(energies / listed - 1.0)) < 1e-3
    if "rig" in name:  # the shape and its mirror image
        first, second = (shape.position for shape in found[:2])
        mirrored = min(np.max(np.abs(second * side - first)) for side in ((1, -1, 1), (1, 1, -1)))
        assert mirrored < 1e-6 < np.max(np.abs(second - first))


def test_a_chosen_shape_is_followed():
    name = "clamped_3d"
    start, end = ends(name)
    slide = ho.Body(ho.Slide((0, 0, 1), 0.0, 0.05))
    run = ho.CableRun(cable(name), start, dataclasses.replace(end, body="slider"))
    problem = ho.Problem({"lead": run}, {"slider": slide})
    for shape in ho.equilibria(cable(name), start, end)[:2]:
        motion = ho.simulate(problem, first={"lead": shape})
        assert not motion.snaps
        np.testing.assert_allclose(motion.cables["lead"].position[0], shape.position, atol=1e-7)


@pytest.mark.parametrize(
    ("first", "words"),
    [
        ({"cord": None}, r"first: found 'cord', expected one of lead"),
        ({"lead": None}, r"first\.lead: found no shape"),
    ],
)
def test_first_shapes_that_cannot_be(first, words):
    failed = ho.equilibrium(
        ho.Cable(1.0, 0.01, 1.0, 0.7), ho.End((0, 0, 0)), ho.End(force=(0, 0, 1), moment=(0, 0, 1)), throw=False
    )
    assert not failed.ok  # a moment about the only line that could balance the force
    with pytest.raises(ho.ProblemError, match=words):
        ho.simulate(arch(0.0), first={name: failed for name in first})


@pytest.mark.parametrize("option", [{"bows": 0}, {"bows": 2.5}, {"turns": ()}, {"bows": 10_001}], ids=str)
def test_searches_that_cannot_be(option):
    with pytest.raises(ho.ProblemError, match=r"bows, turns: found .*expected"):
        ho.equilibria(ho.Cable(1.0, 0.01, 1.0, 0.7), *ends("clamped_3d"), **option)
