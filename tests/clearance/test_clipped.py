"""Clearances and loads of clipped cables, against what is measured of whole cables on many frames."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.clearance.limits import TENSION, all_limits
from harness_opt.clearance.measure import measure
from harness_opt.clearance.pairs import Options
from harness_opt.model.results import CableMotion, Snap, joined, split
from harness_opt.parts.scene import load_scene
from oracles.clipped import arm


def finely(problem: ho.Problem, count: int = 2001) -> ho.Motion:
    motion = ho.simulate(problem, frames=np.linspace(0.0, 1.0, count))
    assert motion.ok
    return motion


def densely(shapes: CableMotion) -> np.ndarray:
    """Return 2,001 points of the first frame, straight between its stations."""
    s = np.linspace(0.0, shapes.s[-1], 2001)
    return np.stack([np.interp(s, shapes.s, shapes.position[0, :, k]) for k in range(3)], axis=-1)


def to_box(position: np.ndarray, part: ho.Part) -> np.ndarray:
    """Return the distances of points (..., 3) to a box that stands straight, outside of it."""
    outside = np.abs(position - np.asarray(part.position)) - 0.5 * np.asarray(part.shape.size)
    return np.linalg.norm(np.maximum(outside, 0.0), axis=-1) + np.minimum(np.max(outside, axis=-1), 0.0)


def test_the_clearance_to_a_part_is_that_of_the_nearest_span():
    problem = arm()
    found = ho.clearances(ho.simulate(problem))
    (row,) = [row for row in found.limits if row.part == "post"]
    fine = finely(problem).cables["lead"].position
    exact = float(np.min(to_box(fine, problem.parts["post"]))) - 0.003
    assert row.certified and row.cable == "lead"
    assert row.worst - row.tolerance - 1e-6 <= exact <= row.worst + 1e-6
    at = row.arc_length
    (pair,) = [pair for pair in found.pairs if pair.obstacle.name == "post"]
    assert pair.place.arc_length[0] == at and 0.0 <= at <= 0.66


def test_loads_of_clips_are_certain_between_the_frames():
    problem = arm()
    coarse = ho.simulate(problem, frames=np.array([0.0, 0.3, 0.7, 1.0]))
    rows = {str(row.id): row for row in all_limits(problem, coarse, ho.clearances(coarse))}
    parts = list(split(finely(problem, 201)).cables.values())
    for (before, behind), clip in zip(itertools.pairwise(parts), ("elbow", "wrist"), strict=True):
        for kind in ("force", "moment"):
            jump = getattr(before, kind)[:, -1] - getattr(behind, kind)[:, 0]
            exact = float(np.max(np.linalg.norm(jump, axis=-1)))
            row = rows[f"clip_{kind}.lead.{clip}"]
            assert row.certified and row.holds == "yes"
            assert row.worst <= exact * (1 + 1e-6) and exact <= row.worst + row.tolerance + 1e-9
            assert row.arc_length == pytest.approx({"elbow": 0.15, "wrist": 0.42}[clip])


def test_loads_of_clamps_are_those_of_the_two_ends():
    elbow, wrist = arm().cables["lead"].clips
    pulled = dataclasses.replace(arm().cables["lead"], clips=(elbow, dataclasses.replace(wrist, at=0.348)))
    problem = arm(cables={"lead": pulled})
    motion = ho.simulate(problem)
    rows = {str(row.id): row for row in all_limits(problem, motion, ho.clearances(motion))}
    shapes = motion.cables["lead"]
    exact = float(np.max(np.linalg.norm(shapes.force[:, [0, -1]], axis=-1)))
    assert rows["clamp_force.lead"].worst == pytest.approx(exact, rel=1e-2)
    between = max(float(np.max(np.linalg.norm(s.force, axis=-1))) for s in split(motion).cables.values())
    assert between > 1.05 * exact, "the cable is pulled more at a clip than at its ends: no load of a clamp"


def test_spans_that_follow_each_other_do_not_collide_at_their_clip():
    (row,) = [row for row in ho.clearances(ho.simulate(arm())).limits if row.part == "cable:lead"]
    assert row.holds == "yes" and row.worst == np.inf


@pytest.mark.parametrize("apart", [0.016, 0.009])
def test_a_span_that_comes_near_another_is_the_cable_near_itself(apart):
    """The cable is led round and back beside itself: a long way along it, ``apart`` in space."""
    clips = (
        ho.Clip(name="turn", at=0.3, position=(0.25, 0.05, 0.0), tangent=(0, 1, 0)),
        ho.Clip(name="back", at=0.6, position=(0.0, 0.1, 0.0), tangent=(-1, 0, 0)),
        ho.Clip(name="round", at=0.9, position=(-0.15, 0.05, apart), tangent=(0, -1, 0)),
    )
    run = ho.CableRun(
        ho.Cable(1.22, 0.006, 2e-3, 1.6e-3),
        ho.End((0, 0, 0), tangent=(1, 0, 0)),
        ho.End((0.12, 0.0, apart), tangent=(1, 0, 0)),
        clips=clips,
    )
    motion = ho.simulate(ho.Problem({"lead": run}, limits=ho.Limits(clearance=0.005)))
    (row,) = [row for row in ho.clearances(motion).limits if row.part == "cable:lead"]
    pieces = list(split(motion).cables.values())
    one, other = (densely(pieces[k]) for k in (0, 3))
    gap = np.linalg.norm(one[:, None] - other[None], axis=-1)
    assert row.worst == pytest.approx(float(np.min(gap)) - 0.006, abs=1e-4)
    assert row.holds == ("yes" if row.worst >= 0.005 else "no")


def test_two_cables_with_clips_are_measured_as_wholes():
    lead = arm().cables["lead"]
    shift = (0.0, 0.05, 0.0)

    def moved(end: ho.End) -> ho.End:
        return dataclasses.replace(end, position=tuple(np.add(end.position, shift)))

    other = dataclasses.replace(
        lead, start=moved(lead.start), end=moved(lead.end), clips=tuple(moved(clip) for clip in lead.clips)
    )
    motion = ho.simulate(arm(cables={"lead": lead, "loom": other}))
    rows = {row.part: row for row in ho.clearances(motion).limits if row.cable == "lead"}
    row = rows["cable:loom"]
    one, two = motion.cables["lead"].position, motion.cables["loom"].position
    nearest = min(float(np.min(np.linalg.norm(a[:, None] - b[None], axis=-1))) for a, b in zip(one, two, strict=True))
    assert row.certified and row.worst == pytest.approx(nearest - 0.006, abs=1e-4)


def test_a_holder_is_let_off_at_its_clip_and_nowhere_else():
    """A block round the clip holds the cable there; the same block is in the way of another span."""
    wrist = np.asarray(arm().cables["lead"].clips[1].position)
    gland = ho.Part(ho.Box((0.008, 0.03, 0.03)), body="arm", position=tuple(wrist))
    motion = ho.simulate(arm(parts={"gland": gland}))
    (row,) = [row for row in ho.clearances(motion).limits if row.part == "gland"]
    assert row.holds == "yes"
    world = dataclasses.replace(gland, body="world")
    (row,) = [row for row in ho.clearances(ho.simulate(arm(parts={"gland": world}))).limits if row.part == "gland"]
    assert row.holds == "no" and row.worst < -0.003


def test_a_span_as_long_as_its_clamps_are_apart_is_straight_and_its_tension_not_known():
    """Both clips stand on one body: the span between is straight at every moment, whatever pulls it."""
    elbow, wrist = arm().cables["lead"].clips
    wrist = dataclasses.replace(wrist, tangent=(1, 0, 0))
    end = ho.End((0.34, 0.04, 0.4), tangent=(1, 0, 0), body="arm")
    cable = dataclasses.replace(arm().cables["lead"].cable, mass_per_length=0.0)
    run = dataclasses.replace(arm().cables["lead"], cable=cable, clips=(elbow, wrist), end=end)
    motion = ho.simulate(arm(cables={"lead": run}))
    span = split(motion).cables["lead, wrist to end"].position
    straight = span[:, :1] + np.linspace(0, 1, span.shape[1])[:, None] * (span[:, -1:] - span[:, :1])
    assert np.max(np.abs(span - straight)) < 1e-9
    rows = {str(row.id): row for row in all_limits(motion.problem, motion, ho.clearances(motion))}
    for name in ("clip_force.lead.wrist", "clamp_force.lead"):
        assert rows[name].holds == "uncertain" and rows[name].reason == f"lead, wrist to end {TENSION}"
    assert rows["clip_force.lead.elbow"].holds == rows["clip_moment.lead.wrist"].holds == "yes"


@pytest.mark.parametrize("done", range(11))
def test_a_run_that_is_stopped_says_nothing_of_cables_that_it_measured_in_part(done):
    """One part and the cable itself, of three spans: 3 + 6 pairs of spans are 2 of the cable."""
    problem = arm()
    motion = ho.simulate(problem, frames=[0.0, 1.0])
    asked = itertools.count()
    options = Options(give_up=lambda: next(asked) >= done)
    found = measure(problem, load_scene(problem), motion.motion, motion.cables, options)
    whole = ho.clearances(motion)
    exact = {str(row.id): row.worst for row in whole.limits}
    assert all(row.worst == pytest.approx(exact[str(row.id)], abs=1e-6) for row in found.limits)
    left = 2 - len(found.pairs)
    assert found.whole == (left == 0)
    if left:
        assert found.left_out == (f"clearances of {left} pairs: the run was stopped before they were measured",)


def test_a_snap_of_a_span_is_one_of_the_cable():
    motion = ho.simulate(arm())
    snap = Snap("lead", 3, 0.2, span="lead, elbow to wrist")
    apart = split(dataclasses.replace(motion, snaps=(snap,)))
    assert apart.snaps == (dataclasses.replace(snap, cable="lead, elbow to wrist"),)
    assert joined(motion.problem, apart).snaps == (snap,)
