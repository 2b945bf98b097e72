"""Harnesses through a motion: the same as a cable that is not cut, snaps included, and known between the frames."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.harness.between import BETWEEN
from harness_opt.model.results import split
from harness_opt.motion.between_frames import BetweenFrames
from harness_opt.numerics import rotations
from oracles.elastica import ALONG_X

G = 9.81
FRAMES = np.linspace(0.0, 1.0, 101)


def arch(*, cut: bool) -> ho.Problem:
    """Return an arch between a clamp and one on a lever that turns it over, whole or cut by a weightless body."""
    weight, span = 5.0, 0.6
    start = ho.End((0, 0, 0), ALONG_X)
    end = ho.End((span, 0, 0), ALONG_X, body="lever")
    lever = ho.Body(ho.Hinge((span, 0, 0), (0, 1, 0), np.radians(20.0), np.radians(-100.0)))

    def cable(length: float) -> ho.Cable:
        return ho.Cable(length, 0.01, 1.0, 3.0, weight / G)

    if not cut:
        run = ho.CableRun(cable(1.0), start, end, bow=(0, 0, 1))
        return ho.Problem({"lead": run}, {"lever": lever}, gravity=(0, 0, -G))
    here = ho.End((0, 0, 0), ALONG_X, body="bead")
    cables = {"one": ho.CableRun(cable(0.4), start, here), "other": ho.CableRun(cable(0.6), here, end)}
    bead = ho.Body(position=(0.22, 0.0, 0.3), free=True)
    bodies, limits = {"lever": lever, "bead": bead}, ho.Limits(bend_radius=0.02)  # to be certain of between the frames
    return ho.Problem(cables, bodies, gravity=(0, 0, -G), limits=limits)


@pytest.fixture(scope="module")
def both() -> tuple[ho.Motion, ho.Motion]:
    return ho.simulate(arch(cut=False), frames=FRAMES), ho.simulate(arch(cut=True), frames=FRAMES)


def test_a_harness_snaps_where_the_whole_cable_does(both):
    whole, cut = both
    assert len(whole.snaps) == 1
    assert {snap.cable for snap in cut.snaps} == {"one", "other"}
    for snap in cut.snaps:
        assert snap.frame == whole.snaps[0].frame
        assert snap.motion == pytest.approx(whole.snaps[0].motion, abs=5e-4)


def test_a_harness_lands_where_the_whole_cable_does(both):
    whole, cut = both
    lead = whole.cables["lead"]
    for name, first, length in (("one", 0.0, 0.4), ("other", 0.4, 0.6)):
        shapes = cut.cables[name]
        assert shapes.stable.all()
        own = (lead.s >= first - 1e-12) & (lead.s <= first + length + 1e-12)
        here = np.searchsorted(shapes.s, np.clip(lead.s[own] - first, 0.0, length) - 1e-9)
        same = np.isclose(shapes.s[here], lead.s[own] - first, rtol=0, atol=1e-9)
        assert same.sum() > 10
        off = np.linalg.norm(shapes.position[:, here[same]] - lead.position[:, own][:, same], axis=-1)
        assert off.max() < 5e-7


def test_the_body_is_known_between_the_frames():
    coarse = ho.simulate(arch(cut=True), frames=np.linspace(0.0, 0.11, 6))
    fine = ho.simulate(arch(cut=True), frames=np.linspace(0.0, 0.11, 51))
    found, exact = (one.problem.found["bead"].poses(fine.motion) for one in (coarse, fine))
    assert np.max(np.abs(found[0] - exact[0])) < 2 * BETWEEN
    turned = rotations.multiply(rotations.conjugate(found[1]), exact[1])
    assert np.max(np.abs(rotations.small_rotation_vector(turned))) < 2 * BETWEEN


def test_shapes_between_the_frames_hang_together():
    motion = split(ho.simulate(arch(cut=True), frames=np.linspace(0.0, 0.11, 11)))
    between, at = BetweenFrames(motion), np.array([0.013, 0.05, 0.104])
    one, why = between("one", at)
    other, why_not = between("other", at)
    assert not any(why) and not any(why_not)
    for field in ("position", "force", "moment"):
        a, b = getattr(one, field)[:, -1], getattr(other, field)[:, 0]
        assert np.max(np.abs(a - b)) < 1e-4 * max(1.0, np.max(np.abs(a)))


def test_a_motion_there_and_back_is_found_on_both_ways():
    problem = dataclasses.replace(arch(cut=True), out_and_back=True)
    motion = ho.simulate(problem, spatial_step=0.05)
    assert motion.ok
    found = motion.problem.found["bead"]
    assert len(found.kinks) == 1
    assert found.motion[found.kinks[0]] == 0.5


def test_ends_are_fitted_untwisted_beside_what_is_free():
    """A roll that is found while a splice hangs: no twisting moment there at that moment, held from then on."""
    flat = ho.Cable(0.3, 0.008, (0.02, 0.05), 0.015, 0.2)
    tangents = {"trunk": (1, 0, 0), "branch": (1, 0.3, 0)}
    cables = {
        "trunk": ho.CableRun(
            flat, ho.End((0, 0, 0.2), tangent=(1, 0, 0.2), roll_deg=30),
            ho.End((-0.01, 0, 0), tangent=tangents["trunk"], body="splice"), fitted_at=0.4,
        ),
        "branch": ho.CableRun(
            flat, ho.End((0.01, 0, 0), tangent=tangents["branch"], roll_deg=0, body="splice"),
            ho.End((0.45, 0.1, 0.2), tangent=(0, 0.4, 1), body="arm"), fitted_at=0.4,
        ),
    }  # fmt: skip
    bodies = {"splice": ho.Body(free=True, mass=0.02), "arm": ho.Body(ho.Hinge((0.4, 0, 0.2), (0, 1, 0), 0.0, 0.4))}
    motion = ho.simulate(ho.Problem(cables, bodies, gravity=(0, 0, -G)), frames=[0.0, 0.2, 0.4, 0.7, 1.0])
    for name in cables:
        shapes = motion.cables[name]
        twisting = np.sum(shapes.moment[:, -1] * rotations.tangent(shapes.quaternion[:, -1]), axis=-1)
        assert abs(twisting[2]) < 1e-9
        assert np.max(np.abs(twisting)) > 1e-4


def test_harnesses_are_not_for_differential_quadrature():
    with pytest.raises(ho.ProblemError, match="transcription: found 'dqm', expected 'collocation' with free bodies"):
        ho.simulate(arch(cut=True), transcription="dqm")
