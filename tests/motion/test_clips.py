"""Cables that are clipped on their way: their spans, what clips apply, and whole cables put together from spans."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest

import harness_opt as ho
from harness_opt.files.stored_results import read_motion
from harness_opt.model.results import ALONG, at_clip, joined, split
from harness_opt.model.spans import in_spans
from harness_opt.motion.follower import TAUT
from harness_opt.numerics import rotations
from oracles.clipped import arm

SECTIONS = {
    "round": ho.Cable(0.6, 0.006, 2e-3, 1.6e-3, 0.05),
    "flat and bent": ho.Cable(0.6, 0.006, (2e-3, 3e-3), 1.6e-3, 0.05, rest_curvature=(1.0, -0.5, 0.8)),
}
START = ho.End((0, 0, 0), tangent=(0, 0, 1), roll_deg=20)
END = ho.End((0.25, 0.05, 0.1), tangent=(1, 0, 0), roll_deg=-10)
GRAVITY = (0.5, 0.0, -9.81)


def at_rest(cable: ho.Cable, *clips: ho.Clip, start: ho.End = START, end: ho.End = END) -> ho.Motion:
    return ho.simulate(ho.Problem({"lead": ho.CableRun(cable, start, end, clips=clips)}, gravity=GRAVITY))


@pytest.mark.parametrize("section", SECTIONS)
def test_a_clip_where_the_cable_is_anyway_changes_nothing(section):
    cable = SECTIONS[section]
    free = ho.equilibrium(cable, START, END, GRAVITY)
    place = free.at(0.23)
    clip = ho.Clip(name="here", at=0.23, position=tuple(place.position), quaternion=tuple(place.quaternion))
    clipped = at_rest(cable, clip)
    shapes = clipped.cables["lead"]
    expected = free.at(shapes.s)
    for name in ("position", "curvature", "force", "moment"):
        size = np.max(np.abs(getattr(expected, name)))
        assert np.max(np.abs(getattr(shapes, name)[0] - getattr(expected, name))) < 2e-7 * size, name
    assert np.max(np.abs(shapes.position[0] - expected.position)) < 1e-9 * cable.length
    loads = at_clip(*split(clipped).cables.values())
    assert np.max(np.abs(loads.force)) < 1e-7 * np.max(np.abs(expected.force))


@pytest.mark.parametrize("section", SECTIONS)
def test_spans_are_the_equilibria_between_their_clamps(section):
    """The rolls that were left open are found along the way: each span is solved alone with those."""
    cable = SECTIONS[section]
    clips = (
        ho.Clip(name="first", at=0.2, position=(0.05, 0.06, 0.12), tangent=(1, 0.3, 0.2), turns=0.25),
        ho.Clip(name="second", at=0.4, position=(0.17, 0.02, 0.16), tangent=(1, -0.3, -0.4)),
    )
    motion = at_rest(cable, *clips, end=dataclasses.replace(END, roll_deg=None, turns=0.5))
    before = START
    for run, shapes in zip(in_spans(motion.problem).cables.values(), split(motion).cables.values(), strict=True):
        end = run.end if isinstance(run.end, ho.Clip) else dataclasses.replace(run.end)
        alone = ho.equilibrium(run.cable, before, ho.End(**{
            key: getattr(end, key) for key in ("position", "tangent", "roll", "turns")}), GRAVITY)  # fmt: skip
        expected = alone.at(shapes.s)
        assert np.max(np.abs(shapes.position[0] - expected.position)) < 1e-6 * run.cable.length
        same = np.abs(np.sum(shapes.quaternion[0] * expected.quaternion, axis=-1))
        assert np.min(same) > 1 - 1e-9
        before = ho.End(expected.position[-1], quaternion=tuple(rotations.normalise(expected.quaternion[-1])))


def test_forces_and_moments_balance():
    """What both clamps, the clips and gravity apply to the whole cable adds up to nothing, in force and in moment."""
    motion = ho.simulate(arm())
    shapes, run = motion.cables["lead"], arm().cables["lead"]
    parts = list(split(motion).cables.values())
    weight = np.array(arm().gravity) * run.cable.mass_per_length
    force = -shapes.force[:, 0] + shapes.force[:, -1] + weight * run.cable.length
    lever = np.zeros_like(force)
    for load, sign, station in ((shapes, -1, 0), (shapes, 1, -1)):
        lever += sign * (load.moment[:, station] + np.cross(load.position[:, station], load.force[:, station]))
    for before, behind in itertools.pairwise(parts):
        clip = at_clip(before, behind)
        force += clip.force[:, 0]
        lever += clip.moment[:, 0] + np.cross(behind.position[:, 0], clip.force[:, 0])
    for part in parts:  # Simpson's rule on even stations
        steps = np.diff(part.s)
        assert np.ptp(steps) < 1e-12 and len(part.s) % 2 == 1
        weights = np.ones(len(part.s))
        weights[1:-1:2], weights[2:-1:2] = 4, 2
        middle = np.einsum("n,pnc->pc", weights * steps[0] / 3, part.position)
        lever += np.cross(middle, weight)
    assert np.max(np.abs(force)) < 1e-9 * np.max(np.abs(shapes.force))
    assert np.max(np.abs(lever)) < 1e-6 * np.max(np.abs(shapes.moment))


def test_clips_stand_where_they_are_said_to_on_bodies_that_move():
    motion = ho.simulate(arm())
    problem, shapes = motion.problem, motion.cables["lead"]
    assert motion.ok and len(motion.motion) > 10
    for clip, station in zip(problem.cables["lead"].clips, shapes.clip_stations, strict=True):
        position, quaternion = problem.poses(clip.body, motion.motion)
        for side in (station, station + 1):
            assert shapes.s[side] == clip.at
            placed = position + rotations.rotate(quaternion, np.asarray(clip.position))
            assert np.max(np.abs(shapes.position[:, side] - placed)) < 1e-9
            d3 = rotations.rotate(quaternion, rotations.normalise(np.asarray(clip.tangent)))
            assert np.max(np.abs(rotations.tangent(shapes.quaternion[:, side]) - d3)) < 1e-9
        assert np.max(np.abs(shapes.quaternion[:, station] - shapes.quaternion[:, station + 1])) < 1e-9


def test_a_clip_fitted_untwisted_leaves_no_twisting_moment_before_it():
    motion = ho.simulate(arm())
    before = split(motion).cables["lead, start to elbow"]
    twisting = np.einsum("nc,nc->n", before.moment[0], rotations.tangent(before.quaternion[0]))
    assert np.max(np.abs(twisting)) < 1e-8 * np.max(np.abs(before.moment[0]))


def test_whole_cables_and_spans_are_two_ways_to_say_the_same():
    motion = ho.simulate(arm())
    again = joined(motion.problem, split(motion))
    for field in dataclasses.fields(motion.cables["lead"]):
        one, other = (getattr(each.cables["lead"], field.name) for each in (motion, again))
        assert np.allclose(one, other, rtol=1e-12, atol=1e-15), field.name
    assert again.snaps == motion.snaps and again.status is motion.status


def test_a_problem_without_clips_is_its_own_problem_of_spans():
    problem = arm()
    bare = dataclasses.replace(problem, cables={"lead": dataclasses.replace(problem.cables["lead"], clips=())})
    assert in_spans(bare) is bare


def test_the_playback_keeps_every_clip_between_the_frames():
    motion = ho.simulate(arm())
    moments, profiles = ho.display(motion, "lead", 0.0173)
    stations = motion.cables["lead"].clip_stations
    values = moments / motion.problem.duration
    for clip, station in zip(motion.problem.cables["lead"].clips, stations, strict=True):
        position, quaternion = motion.problem.poses(clip.body, values)
        placed = position + rotations.rotate(quaternion, np.asarray(clip.position))
        shown = np.array([profile.position[station : station + 2] for profile in profiles])
        assert np.max(np.abs(shown - placed[:, None])) < 1e-9


def test_a_span_that_has_no_shape_leaves_no_frames_of_its_cable():
    """Its clamps stand its length apart and do not point along it; the spans before it are solved."""
    elbow, wrist = arm().cables["lead"].clips
    end = ho.End((0.34, 0.04, 0.4), tangent=(1, 0, 0.4), body="arm")
    run = dataclasses.replace(
        arm().cables["lead"], clips=(elbow, dataclasses.replace(wrist, tangent=(1, 0, 0))), end=end
    )
    motion = ho.simulate(arm(cables={"lead": run}), frames=[0.0, 1.0], throw=False)
    assert not motion.ok and "wrist to end" in motion.message and TAUT in motion.message
    assert len(motion.motion) == 0 and not motion.cables and not motion.snaps


def test_results_have_a_cut_list_and_can_be_gone_on_from(tmp_path):
    motion = ho.simulate(arm())
    ho.write_results(motion, tmp_path / "found")
    lines = (tmp_path / "found" / "cut_list.csv").read_text(encoding="utf-8").splitlines()
    assert lines == [
        "cable,mark,arc_length_mm,from_mark_before_mm,body",
        "lead,start,0,0,world",
        "lead,elbow,150,150,world",
        "lead,wrist,420,270,arm",
        "lead,end,660,240,arm",
    ]
    back = read_motion(tmp_path / "found")[0]
    for field in dataclasses.fields(back.cables["lead"]):
        if field.name in (*ALONG, "s"):
            assert np.array_equal(getattr(back.cables["lead"], field.name), getattr(motion.cables["lead"], field.name))
    assert clearances_of(back) == pytest.approx(clearances_of(motion), abs=1e-9)


def clearances_of(motion: ho.Motion) -> list[float]:
    return [row.worst for row in ho.clearances(motion).limits]
