"""What is shown at snaps, of a part of a motion, of what stands still, and what cannot be shown."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.model.results import Snap
from harness_opt.motion.playback import between
from oracles.hinged import (
    ALONG_X,
    CLAMP,
    PROBLEM,
    halves,
)


@pytest.fixture(scope="module")
def snapping() -> ho.Motion:
    """Return the motion of a flat strip, bowed up, whose end is turned until it has to bow down."""
    strip = ho.Cable(length=1.0, diameter=0.01, bending_stiffness=(30.0, 1.0), torsional_stiffness=0.7)
    end = ho.End((0.8, 0, 0), ALONG_X, body="arm")
    arm = ho.Body(ho.Hinge((0.8, 0, 0), (0, 1, 0), -math.pi / 3, math.pi / 3))
    run = ho.CableRun(strip, ho.End((0, 0, 0), ALONG_X), end, bow=(0, 0, 1))
    found = ho.simulate(ho.Problem({"lead": run}, {"arm": arm}), spatial_step=0.04)
    assert len(found.snaps) == 1
    return found


def test_until_a_snap_the_older_shape_is_shown(snapping):
    k = snapping.snaps[0].frame
    solved = snapping.cables["lead"].position
    jump = np.linalg.norm(solved[k] - solved[k - 1], axis=1).max()
    values = snapping.motion[k - 1] + np.array([0.1, 0.5, 0.999]) * (snapping.motion[k] - snapping.motion[k - 1])
    held, _ = between(snapping, "lead", values, "linear")
    np.testing.assert_array_equal(held, np.stack([solved[k - 1]] * 3))
    position, rotation = between(snapping, "lead", values, "exact")
    assert np.linalg.norm(position - solved[k - 1], axis=-1).max() < 0.1 * jump
    angle = math.pi / 3 * (2 * values - 1) + math.pi / 2
    np.testing.assert_allclose(
        rotation[:, -1, :, 2], np.stack([np.sin(angle), 0 * angle, np.cos(angle)], 1), atol=2e-12
    )
    np.testing.assert_allclose(position[:, -1], [(0.8, 0, 0)] * 3, atol=2e-12)
    after, _ = between(snapping, "lead", snapping.motion[k : k + 1], "exact")
    np.testing.assert_array_equal(after[0], solved[k])


def test_another_cable_s_snap_is_its_own(snapping):
    others = dataclasses.replace(snapping, snaps=(Snap("power", 1, 0.1),))
    values = halves(snapping)[:1]
    for how in ("linear", "exact"):
        found, expected = (between(motion, "lead", values, how)[0] for motion in (others, snapping))
        np.testing.assert_array_equal(found, expected)


def test_a_motion_solved_in_part_is_shown_in_part(motion):
    lead = motion.cables["lead"]
    cut = {field.name: getattr(lead, field.name)[2:5] for field in dataclasses.fields(lead) if field.name != "s"}
    part = dataclasses.replace(motion, motion=motion.motion[2:5], cables={"lead": dataclasses.replace(lead, **cut)})
    times, shown = ho.display(part, "lead", 0.05)
    np.testing.assert_allclose(times[[0, -1]], 2.0 * part.motion[[0, -1]])
    np.testing.assert_allclose(times[1:-1] / 0.05, np.round(times[1:-1] / 0.05), atol=1e-9)
    np.testing.assert_array_equal(shown[-1].position, lead.position[4])


def test_a_scene_that_stands_still_has_one_moment():
    still = ho.simulate(dataclasses.replace(PROBLEM, bodies={"arm": ho.Body()}))
    times, shown = ho.display(still, "lead", 0.1)
    np.testing.assert_array_equal(times, [0.0])
    np.testing.assert_array_equal(shown[0].position, still.cables["lead"].position[0])
    assert ho.display_error(still, "lead")["exact"].node == 0.0


@pytest.mark.parametrize("step", [0.0, -0.1, math.nan, math.inf, 2.1, "fast", 1e-6])
def test_temporal_steps_that_cannot_be(motion, step):
    for call in (ho.display, ho.display_error):
        with pytest.raises(ho.ProblemError, match=r"temporal_step: found .*, expected"):
            call(motion, "lead", step)


def test_names_that_are_unknown(motion):
    for call in (ho.profiles, ho.display_error, lambda *given: ho.display(*given, 0.1)):
        with pytest.raises(ho.ProblemError, match="cable: found 'power', expected one of 'lead'"):
            call(motion, "power")
    with pytest.raises(ho.ProblemError, match="interpolation: found 'cubic', expected 'exact' or 'linear'"):
        ho.display(motion, "lead", 0.1, "cubic")
    with pytest.raises(ho.ProblemError, match="no cable was solved"):
        ho.profiles(dataclasses.replace(motion, cables={}), "lead")


def test_clamps_out_of_reach_between_two_frames(motion):
    """Solved at poses within reach, played with the clamp further away than the cable is long."""
    far = dataclasses.replace(CLAMP, position=(0.9, 0.1, 0.9))
    run = dataclasses.replace(PROBLEM.cables["lead"], end=far)
    played = dataclasses.replace(motion, problem=PROBLEM.changed(cables={"lead": run}))
    with pytest.raises(
        ho.SolveError, match=r"cable lead, at [\d.]+ deg, [\d.]+ %: no curve between frames 0 and 1 .*spatial_step"
    ):
        ho.display(played, "lead", 0.01)
